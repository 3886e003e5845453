"""The spring foundation: pressure that carries load and moment, with lines that lift off."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from flashtemp.errors import SolverFailure
from flashtemp.meshes.grading import two_sided
from flashtemp.solver.winkler_foundation import SpringFoundation

L, K_N, MEAN, LOAD = 0.025, 1.4e9, 1.5e5, 1.5e5 * 0.025
EDGES = two_sided(L, 3e-5, 6e-5, 56, 1)
X, DX = 0.5 * (EDGES[1:] + EDGES[:-1]), np.diff(EDGES)
XI = 1 - 2 * X / L
BED = SpringFoundation(X, DX, L, K_N)


def moment_of(pressure) -> float:
    """Moment about the middle of the block, N per metre across, leading edge positive."""
    return float(0.5 * L * (pressure * XI) @ DX)


def uneven(seed: int, height: float) -> np.ndarray:
    return MEAN * (1 + height * np.random.default_rng(seed).normal(size=len(X)))


# --- balance ----------------------------------------------------------------------------------------
@settings(max_examples=200, deadline=None)
@given(st.integers(0, 10**6), st.floats(-2, 1.4), st.floats(-0.9, 0.9), st.one_of(st.just(0.0), st.floats(1e-8, 1e2)))
def test_load_and_moment_balance_to_rounding(seed, log_height, lever, turning):
    moment = 0.5 * L * lever * LOAD
    press = BED.solve_equilibrium(uneven(seed, 10**log_height), MEAN, moment, turning)
    assert press.pressure.min() >= 0
    assert press.pressure @ DX == pytest.approx(LOAD, rel=1e-12)
    assert moment_of(press.pressure) + turning * K_N * press.tilt == pytest.approx(moment, abs=1e-11 * 0.5 * L * LOAD)


@settings(max_examples=200, deadline=None)
@given(st.integers(0, 10**6), st.floats(-2, 3))
def test_guided_block_is_an_independent_root_of_the_load(seed, log_height):
    free = uneven(seed, 10**log_height)
    shift = brentq(lambda c: np.maximum(0, free + c) @ DX - LOAD, -free.max(), MEAN - free.min() + MEAN, xtol=1e-9)
    np.testing.assert_allclose(
        BED.solve_equilibrium(free, MEAN).pressure, np.maximum(0, free + shift), atol=1e-7 * MEAN
    )


def test_pressure_that_carries_its_load_is_left_alone():
    free = np.full(len(X), MEAN)
    assert BED.solve_equilibrium(free, MEAN).pressure is free


def test_no_load_no_pressure():
    assert not BED.solve_equilibrium(-uneven(1, 0.1), 0.0).pressure.any()


# --- a holder that turns freely: theory 7.1 -----------------------------------------------------------
def test_free_tilt_in_full_contact():
    """mu = 1, h = H/2: p/mean = 1 + a xi with a = 6 mu h/L = 0.84."""
    a = 6 * 3.5e-3 / L
    press = BED.solve_equilibrium(np.full(len(X), MEAN), MEAN, 3.5e-3 * LOAD, 0.0)
    slope = np.polyfit(XI, press.pressure / MEAN, 1)[0]
    assert slope == pytest.approx(a, rel=2e-3)  # cells: the sum of xi^2 dx is L/3 to second order


def test_free_tilt_with_lift_off():
    """mu = 1, h = H: p = p_max (1 - x/l) with l = 3 (L/2 - mu h) = 16.5 mm and p_max = 3.030303 mean."""
    x = (np.arange(2000) + 0.5) * L / 2000
    fine = SpringFoundation(x, np.full(2000, L / 2000), L, K_N)
    press = fine.solve_equilibrium(np.full(2000, MEAN), MEAN, 7e-3 * LOAD, 0.0)
    expected = 3.030303 * MEAN * np.maximum(0, 1 - x / 16.5e-3)
    np.testing.assert_allclose(press.pressure, expected, atol=2e-3 * MEAN)
    assert x[press.touching][-1] == pytest.approx(16.5e-3, abs=2 * L / 2000)


def test_stiff_and_soft_holders_are_the_limits():
    free, moment = uneven(3, 0.5), 3e-3 * LOAD
    stiff, guided = BED.solve_equilibrium(free, MEAN, moment, 1e6), BED.solve_equilibrium(free, MEAN)
    np.testing.assert_allclose(stiff.pressure, guided.pressure, rtol=1e-6, atol=1e-4)
    soft, loose = BED.solve_equilibrium(free, MEAN, moment, 1e-12), BED.solve_equilibrium(free, MEAN, moment, 0.0)
    np.testing.assert_allclose(soft.pressure, loose.pressure, rtol=1e-6)


def test_a_block_that_tips_over_is_a_failure():
    with pytest.raises(SolverFailure, match="tips the block over"):
        BED.solve_equilibrium(np.full(len(X), MEAN), MEAN, 0.6 * L * LOAD, 0.0)


# --- derivatives ------------------------------------------------------------------------------------
@pytest.mark.parametrize(("moment", "turning"), [(0.0, np.inf), (3e-3 * LOAD, 2e-5), (7e-3 * LOAD, 0.0)])
def test_response_is_the_derivative(moment, turning):
    free = uneven(5, 0.8)
    press = BED.solve_equilibrium(free, MEAN, moment, turning)
    response = BED.pressure_response(press)
    rng = np.random.default_rng(0)
    worn = 1e-9 * rng.normal(size=len(X))
    assert not press.touching.all()
    step = BED.solve_equilibrium(free - K_N * worn, MEAN, moment, turning).pressure - press.pressure
    np.testing.assert_allclose(response(worn), step, atol=1e-8 * np.abs(step).max())
    direct = np.imag(BED.solve_equilibrium(free - 1e-30j * K_N * worn, MEAN, moment, turning).pressure) / 1e-30
    np.testing.assert_allclose(response(worn), direct, atol=1e-12 * np.abs(step).max())
    gain, r = 1e-9 * rng.uniform(size=len(X)), rng.normal(size=len(X))
    z = response.build_wear_inverse(gain)(r)
    np.testing.assert_allclose(z - gain * response(z), r, atol=1e-12)
