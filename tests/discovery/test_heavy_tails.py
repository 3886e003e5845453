"""Priors with heavy tails: the touching normal distributions, and strengths that they must not shrink."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from flashtemp.discovery.estimation.linear_gaussian import Solution
from flashtemp.discovery.hypotheses.heavy_tails import INPUT_TAIL, STRENGTH_TAIL, local_width, width_price
from flashtemp.discovery.parameters import ParameterId
from flashtemp.discovery.selection import scores

STRENGTH = ParameterId.of_effect("third_body", "growth")


def density(a, usual, tail):
    width = local_width(usual, a, tail)
    return norm.pdf(a, scale=width) * np.exp(-width_price(width, usual, tail))


@pytest.mark.parametrize(("tail", "integral"), [(STRENGTH_TAIL, 1.258), (INPUT_TAIL, 1.026)])
def test_the_prior_is_the_largest_normal_density_over_widths(tail, integral):
    wide = np.geomspace(1.0, 100.0, 20_001)
    for a in (0.5, 1.9, 2.1, 5.0, 20.0):
        largest = np.max(norm.pdf(a, scale=2.0 * wide) * wide**-tail)
        assert density(a, 2.0, tail) == pytest.approx(largest, rel=1e-5)
    core = 2.0 * np.sqrt(1.0 + tail)
    total = 2.0 * sum(quad(density, *span, args=(2.0, tail))[0] for span in ((0.0, core), (core, np.inf)))
    assert total == pytest.approx(integral, abs=1e-3)


@pytest.mark.parametrize(("estimate", "sd"), [(0.7, 0.2), (20.0, 1.0), (-8.0, 0.5)])
def test_a_strong_effect_is_not_shrunk_by_its_prior(estimate, sd):
    """One strength of typical size 1, determined by data to `estimate` +- `sd`."""

    def solve_with(problem, priors, equations):
        width = priors[STRENGTH][1]
        total = width**2 + sd**2
        evidence = norm.logpdf(estimate, scale=np.sqrt(total))
        return SimpleNamespace(solution=Solution((STRENGTH,), np.array([estimate * width**2 / total]),
                                                 np.array([[sd**2 * width**2 / total]]), evidence, 0.0, 1))  # fmt: skip

    fit = SimpleNamespace(solve_with=solve_with, free_effect_priors={})
    found = scores._solve_with_strengths(SimpleNamespace(fit=fit, problem=None, equations=None), {STRENGTH: 1.0})
    assert found[STRENGTH] == pytest.approx(estimate, abs=0.3 * sd)
    points = [estimate + k * sd for k in (-8, 0, 8)]
    exact = quad(lambda a: norm.pdf(estimate, a, sd) * density(a, 1.0, STRENGTH_TAIL), points[0], points[-1],
                 points=points[1:2])[0]  # fmt: skip
    assert found.ln_evidence == pytest.approx(np.log(exact), abs=0.02)
