"""Gauss-Newton in a box: the bounded step is optimal, the radius follows the ratio, and known problems are solved."""

import numpy as np
import pytest
from scipy.optimize import minimize

from flashtemp.discovery.estimation.trust_region import FIRST_RADIUS, QuadraticModel, TrustRegion


def quadratic(rng, n):
    A = rng.normal(size=(n, n))
    return rng.normal(size=n), A @ A.T + 0.1 * np.eye(n)


@pytest.mark.parametrize("seed", range(8))
def test_the_step_is_the_best_within_bounds_and_region(seed):
    """Against an independent optimiser from several starts."""
    rng = np.random.default_rng(seed)
    n = 2 + seed % 4
    g, S = quadratic(rng, n)
    low, high = -rng.uniform(0.0, 0.5, n), rng.uniform(0.0, 0.5, n)
    model = QuadraticModel(g, S, low, high)
    step = model.best_step(0.3)
    box = list(zip(np.maximum(low, -0.3), np.minimum(high, 0.3), strict=True))
    assert all(a - 1e-9 <= s <= b + 1e-9 for s, (a, b) in zip(step, box, strict=True))
    best = max(-minimize(lambda d: -model.predicted_reduction(d), rng.uniform(-0.1, 0.1, n), bounds=box, tol=1e-12).fun
               for _ in range(3))  # fmt: skip
    assert model.predicted_reduction(step) == pytest.approx(best, rel=1e-6, abs=1e-9)


def test_a_free_step_is_the_newton_step():
    g, S = quadratic(np.random.default_rng(1), 3)
    free = QuadraticModel(g, S, np.full(3, -np.inf), np.full(3, np.inf)).best_step()
    np.testing.assert_allclose(free, np.linalg.solve(S, g), rtol=1e-6)


def test_a_parameter_on_its_bound_stays_and_the_others_move():
    model = QuadraticModel(np.array([-1.0, 1.0]), np.eye(2), np.array([0.0, -np.inf]), np.full(2, np.inf))
    np.testing.assert_allclose(model.best_step(), [0.0, 1.0], atol=1e-9)


def test_the_radius_follows_the_ratio_of_actual_to_predicted_reduction():
    one = np.ones(1)
    region = TrustRegion()
    assert region.next_region(0.9, FIRST_RADIUS * one, one).radius == 2.0 * FIRST_RADIUS
    assert region.next_region(0.9, 0.5 * one, one).radius == FIRST_RADIUS  # a step that the region did not limit
    assert region.next_region(0.5, FIRST_RADIUS * one, one).radius == FIRST_RADIUS
    assert region.next_region(-1.0, 0.4 * one, one).radius == pytest.approx(0.1)


def test_rosenbrock_is_solved_in_few_evaluations():
    """A curved valley, as residuals r = (10 (y - x^2), 1 - x): Gauss-Newton steps, accepted by their ratio."""
    x, region, evaluations = np.array([-1.2, 1.0]), TrustRegion(), 0

    def residual(x):
        return np.array([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0]])

    for _ in range(100):
        J, r = np.array([[-20.0 * x[0], 10.0], [-1.0, 0.0]]), residual(x)
        model = QuadraticModel(-J.T @ r, J.T @ J, np.full(2, -np.inf), np.full(2, np.inf))
        if model.predicted_reduction(model.best_step()) < 1e-12:
            break
        step = region.limited_step(model, np.ones(2))
        evaluations += 1
        ratio = 0.5 * (r @ r - residual(x + step) @ residual(x + step)) / model.predicted_reduction(step)
        region = region.next_region(ratio, step, np.ones(2))
        x = x + step if ratio > 0.0 else x
    np.testing.assert_allclose(x, [1.0, 1.0], atol=1e-5)
    assert evaluations < 40
