"""Whether steady sliding would shake itself up: friction that falls with speed, and the damping that this takes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flashtemp.model.scene import Scene
from flashtemp.physics.quantities import KELVIN
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.run import Run
from flashtemp.solver.system import PhaseSystem

SPEED_STEP_RATIO = 1e-3  # of the speed, for its slope
FLAT_SLOPE_S_M = 1e-9  # s/m: friction that does not depend on speed


class VelocityWeakening(NamedTuple):
    """At a sliding `speed` (m/s): `estimate_velocity_weakening` dmu/dv (s/m), and the `damping` (N s/m) below which sliding is unsteady.

    A block of mass m held by a spring moves as m u'' + (c + N dmu/dv) u' + k u = 0 about steady sliding: it shakes
    itself up where c < -N dmu/dv, whatever its mass and however stiff the spring.
    """

    speed: float
    slope: float
    damping: float


def estimate_velocity_weakening(scene: Scene, run: Run) -> VelocityWeakening:
    """How friction answers at once to speed, at the temperatures and pressures of the end of a run, load-weighted."""
    k = run.last_sliding_index
    phase = [p for p in scene.schedule.phases if p.sliding][-1]
    now = scene.law_context(phase, phase.end)
    if now.speed <= 0.0:
        now = scene.law_context(phase, 0.5 * (phase.begin + phase.end))
    towards, across = (1 if run.leading_line_index(k) == 0 else -1), scene.mesh.n_across
    pressure, T = (np.repeat(a[k][::towards], across) for a in (run.pressure, run.T_spot + KELVIN))
    system = PhaseSystem(HeatBalance(scene), phase)
    at = system.interface.moment_at_contact(system.interface.contact_state(now, pressure), now)._replace(face=T)

    def mean_friction(speed: float) -> float:
        mu = system.b.laws("friction.mu", 0.0, T, at._replace(speed=speed, last_speed=speed)) + 0.0 * T
        return float((mu * pressure) @ scene.mesh.column_area / (pressure @ scene.mesh.column_area))

    steep = (mean_friction(now.speed * (1 + SPEED_STEP_RATIO)) - mean_friction(now.speed * (1 - SPEED_STEP_RATIO))) / (
        2 * SPEED_STEP_RATIO * now.speed
    )
    load = now.pressure * scene.length * scene.width
    return VelocityWeakening(now.speed, steep, max(0.0, -steep * load))


def warn_of_stick_slip(scene: Scene, run: Run) -> list[str]:
    """What a user should know where friction falls with speed; nothing where nothing slides."""
    if scene.schedule.alone:
        return []
    found = estimate_velocity_weakening(scene, run)
    if found.slope >= -FLAT_SLOPE_S_M:
        return []
    return [
        f"friction falls with speed, dmu/dv = {found.slope:.3g} s/m at {found.speed:g} m/s: with less than "
        f"{found.damping:.3g} N s/m of damping along the sliding the block shakes itself up (stick-slip), which is not "
        "modelled here"
    ]
