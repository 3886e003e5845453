"""Self-excited stick-slip: the damping below which steady sliding is unsteady, and what a run says of it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flashtemp.runs.checks import stick_slip_stability


def ran(lab, **given):
    made = lab.assemble_case(
        {}, {k.replace("__", "."): v for k, v in ({"numerics__mesh": 0.3, "schedule__distance": 0.2} | given).items()},
        lab.KeyLocations("none"), lab.Path(), "",
    )  # fmt: skip
    return made.scene, lab.integrate_schedule(made.scene, made.settings)


FALLS = {"effects": ["friction_speed", "friction_softening"], "friction_speed__exponent": -0.3}


@pytest.mark.parametrize("speed", [0.1, -0.5])
def test_slope_of_a_power_law(lab, speed):
    """mu ~ v^m at given temperatures: dmu/dv = m mu/v."""
    scene, run = ran(lab, **FALLS, schedule__speed=speed)
    found = stick_slip_stability.estimate_velocity_weakening(scene, run)
    assert found.speed == abs(speed)
    assert found.slope == pytest.approx(-0.3 * run.friction[run.last_sliding_index] / abs(speed), rel=1e-4)
    assert found.damping == pytest.approx(-found.slope * 1.5e5 * 0.025 * 0.05, rel=1e-12)


@pytest.mark.parametrize("mass", [0.05, 5.0])
@pytest.mark.parametrize("stiffness", [1e4, 1e6])
def test_a_block_on_a_spring_shakes_below_that_damping_and_rests_above(lab, mass, stiffness):
    scene, run = ran(lab, **FALLS)
    found = stick_slip_stability.estimate_velocity_weakening(scene, run)
    mu, N, v = run.friction[run.last_sliding_index], 1.5e5 * 0.025 * 0.05, found.speed

    def grows(damping):
        def moves(t, state):
            u, w = state
            friction = mu * np.maximum((v - w) / v, 1e-3) ** -0.3
            return [w, (friction * N - damping * w - stiffness * u) / mass]

        period = 2 * np.pi * np.sqrt(mass / stiffness)
        start = [mu * N / stiffness + 1e-4 * v * period, 0.0]
        path = solve_ivp(moves, (0.0, 20 * period), start, rtol=1e-10, atol=1e-14, max_step=period / 40)
        early, late = (np.abs(path.y[0][on] - mu * N / stiffness).max() for on in (
            path.t < 2 * period, path.t > 18 * period))  # fmt: skip
        return late > early

    few = 0.02 * min(found.damping, np.sqrt(mass * stiffness))
    assert grows(found.damping - few)
    assert not grows(found.damping + few)


def test_a_run_says_so_only_where_friction_falls(lab):
    [said] = stick_slip_stability.warn_of_stick_slip(*ran(lab, **FALLS))
    assert "not modelled" in said
    assert "N s/m" in said
    assert stick_slip_stability.warn_of_stick_slip(*ran(lab)) == []
    assert stick_slip_stability.warn_of_stick_slip(*ran(lab, **FALLS | {"friction_speed__exponent": 0.3})) == []
