"""Whether steady sliding would shake itself up: friction that falls with speed, and the damping that this takes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flashtemp.model.scene import Scene
from flashtemp.physics.quantities import KELVIN
from flashtemp.solver.balance import Balance
from flashtemp.solver.run import Run
from flashtemp.solver.system import System

STEP = 1e-3  # of the speed, for its slope
FLAT = 1e-9  # s/m: friction that does not depend on speed


class Slope(NamedTuple):
    """At a sliding `speed` (m/s): `slope` dmu/dv (s/m), and the `damping` (N s/m) below which sliding is unsteady.

    A block of mass m held by a spring moves as m u'' + (c + N dmu/dv) u' + k u = 0 about steady sliding: it shakes
    itself up where c < -N dmu/dv, whatever its mass and however stiff the spring.
    """

    speed: float
    slope: float
    damping: float


def slope(scene: Scene, run: Run) -> Slope:
    """How friction answers at once to speed, at the temperatures and pressures of the end of a run, load-weighted."""
    k = run.last
    phase = [p for p in scene.schedule.phases if p.sliding][-1]
    now = scene.moment(phase, phase.end)
    if now.speed <= 0.0:
        now = scene.moment(phase, 0.5 * (phase.begin + phase.end))
    towards, across = (1 if run.leads(k) == 0 else -1), scene.mesh.n_across
    pressure, T = (np.repeat(a[k][::towards], across) for a in (run.pressure, run.T_spot + KELVIN))
    system = System(Balance(scene), phase)
    at = system.interface.at(system.interface.state(now, pressure), now)._replace(face=T)

    def friction(speed: float) -> float:
        mu = system.b.laws("friction.mu", 0.0, T, at._replace(speed=speed, last_speed=speed)) + 0.0 * T
        return float((mu * pressure) @ scene.mesh.column_area / (pressure @ scene.mesh.column_area))

    steep = (friction(now.speed * (1 + STEP)) - friction(now.speed * (1 - STEP))) / (2 * STEP * now.speed)
    load = now.pressure * scene.length * scene.width
    return Slope(now.speed, steep, max(0.0, -steep * load))


def remarks(scene: Scene, run: Run) -> list[str]:
    """What a user should know where friction falls with speed; nothing where nothing slides."""
    if scene.schedule.alone:
        return []
    found = slope(scene, run)
    if found.slope >= -FLAT:
        return []
    return [
        f"friction falls with speed, dmu/dv = {found.slope:.3g} s/m at {found.speed:g} m/s: with less than "
        f"{found.damping:.3g} N s/m of damping along the sliding the block shakes itself up (stick-slip), which is not "
        "modelled here"
    ]
