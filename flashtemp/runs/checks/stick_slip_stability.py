"""Stick-slip stability of steady sliding: friction that falls with speed, and the damping needed against it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flashtemp.model.scene import Scene
from flashtemp.physics.quantities import KELVIN
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.run import Run
from flashtemp.solver.system import PhaseSystem

SPEED_STEP_RATIO = 1e-3  # speed step of the derivative over speed
FLAT_SLOPE_S_M = 1e-9  # s/m, below which friction counts as independent of speed


class VelocityWeakening(NamedTuple):
    """At a sliding `speed` (m/s): `slope` dmu/dv (s/m), and `damping` (N s/m) below which sliding is unstable.

    A block of mass m on a spring of stiffness k obeys m u'' + (c + N dmu/dv) u' + k u = 0 about steady sliding: its
    vibration grows where c < -N dmu/dv, for any mass and stiffness.
    """

    speed: float
    slope: float
    damping: float


def estimate_velocity_weakening(scene: Scene, run: Run) -> VelocityWeakening:
    """Load-weighted derivative of friction by speed, at the temperatures and pressures of the end of a run."""
    k = run.last_sliding_index
    phase = [p for p in scene.schedule.phases if p.sliding][-1]
    now = scene.law_context(phase, phase.end)
    if now.speed <= 0.0:
        now = scene.law_context(phase, 0.5 * (phase.begin + phase.end))
    order, across = (1 if run.leading_line_index(k) == 0 else -1), scene.mesh.n_across  # from the leading edge
    pressure, T = (np.repeat(a[k][::order], across) for a in (run.pressure, run.T_spot + KELVIN))
    system = PhaseSystem(HeatBalance(scene), phase)
    at = system.interface.context_at_contact(system.interface.contact_state(now, pressure), now)._replace(face=T)

    def mean_friction(speed: float) -> float:
        mu = system.b.laws("friction.mu", 0.0, T, at._replace(speed=speed, last_speed=speed)) + 0.0 * T
        return float((mu * pressure) @ scene.mesh.column_area / (pressure @ scene.mesh.column_area))

    slope = (mean_friction(now.speed * (1 + SPEED_STEP_RATIO)) - mean_friction(now.speed * (1 - SPEED_STEP_RATIO))) / (
        2 * SPEED_STEP_RATIO * now.speed
    )
    load = now.pressure * scene.length * scene.width
    return VelocityWeakening(now.speed, slope, max(0.0, -slope * load))


def warn_of_stick_slip(scene: Scene, run: Run) -> list[str]:
    """A warning where friction falls with speed; none for a block that does not slide."""
    if scene.schedule.alone:
        return []
    weakening = estimate_velocity_weakening(scene, run)
    if weakening.slope >= -FLAT_SLOPE_S_M:
        return []
    return [
        f"friction falls with speed, dmu/dv = {weakening.slope:.3g} s/m at {weakening.speed:g} m/s: with less than "
        f"{weakening.damping:.3g} N s/m of damping in the sliding direction the block vibrates (stick-slip), which is "
        "not modelled"
    ]
