"""Bayes factors of candidates against the density of the data, written out as one multivariate normal distribution."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from flashtemp.discovery.estimation.linear_gaussian import DataBlock, LinearSystem
from flashtemp.discovery.estimation.linearised_fit import LinearisedFit
from flashtemp.discovery.hypotheses.candidates import CandidateEffect
from flashtemp.discovery.parameters import ParameterId
from flashtemp.discovery.prediction.problem import Problem
from flashtemp.discovery.selection import forward_selection
from flashtemp.discovery.selection.scores import score_candidates
from flashtemp.physics.effect import Param

MU = ParameterId.of_key("friction.mu")
PRIOR_MU = (0.0, 0.3)
TYPICAL = 0.5  # amplitude of the candidate's strength, and the standard deviation of its prior
COUNT = 60  # data, each with unit noise


def candidate(low: float, spread: float) -> CandidateEffect:
    """An effect of one strength, off at 0, and one shape: with a spread above 1 it has three variants."""
    strength = Param(TYPICAL, "1", "strength", low=low, high=2.0, off=0.0)
    shape = Param(0.002, "m", "length", low=1e-4, high=0.1, spread=spread)
    return CandidateEffect(
        "peak", {"B": strength, "length": shape}, {"B": TYPICAL}, {"length": 0.002}, is_optical=False
    )


def signatures(variants: int) -> np.ndarray:
    """Sensitivities (COUNT, 1 + variants) to the friction and to the strength in every variant."""
    x = np.linspace(0.0, 1.0, COUNT)
    return 8.0 * np.column_stack([np.ones(COUNT), *(np.exp(-x / width) for width in (0.2, 0.05, 0.6)[:variants])])


def score(c: CandidateEffect, amplitude: float):
    """Score of a candidate whose second (or only) variant made the data, and ln density without and with it."""
    variants = len(c.shape_variants)
    F = signatures(variants)
    made = min(1, variants - 1)
    r = amplitude * F[:, 1 + made] + np.random.default_rng(3).normal(size=COUNT)
    names = [MU, *(c.strength_column("B", v) for v in range(variants))]
    none = np.zeros((COUNT, 0))
    block = DataBlock("a", 0, False, r, F, tuple((n, i) for i, n in enumerate(names)), none, np.zeros((0, 0)))
    system = LinearSystem([block])

    def solved(problem, more, equations=None):
        return SimpleNamespace(solution=system.solve({MU: PRIOR_MU} | more, equations))

    fit = SimpleNamespace(
        system=system,
        free_priors={MU: PRIOR_MU},
        free_effect_priors={},
        model=SimpleNamespace(effects={}),
        solve_with=solved,
        equations=system.normal_equations(),
    )
    [found] = score_candidates(cast("Problem", SimpleNamespace(free_keys=())), cast("LinearisedFit", fit), [c])

    def density(columns, sd):
        A = F[:, columns] * np.asarray(sd)
        return multivariate_normal(np.zeros(COUNT), np.eye(COUNT) + A @ A.T).logpdf(r)

    with_it = density([0, 1 + made], [PRIOR_MU[1], TYPICAL])
    return found, with_it - density([0], [PRIOR_MU[1]])


def test_ln_bayes_of_a_candidate_is_the_ratio_of_the_densities():
    found, ratio = score(candidate(low=-2.0, spread=1.0), 0.4)
    assert ratio > 10.0
    assert found.ln_bayes == pytest.approx(ratio, rel=1e-9)


def test_each_variant_of_a_candidate_has_its_part_of_the_prior():
    """The best of three shapes counts a third: ln 3 less than had it been the only one."""
    found, ratio = score(candidate(low=-2.0, spread=2.0), 0.4)
    assert found.variant == 1
    assert found.ln_bayes == pytest.approx(ratio - np.log(3.0), rel=1e-9)


def test_an_amplitude_that_cannot_be_is_no_evidence():
    """A strength of at least 0 that would have to be -0.4 explains nothing, however much the data would gain."""
    found, ratio = score(candidate(low=0.0, spread=1.0), -0.4)
    assert ratio > 10.0
    assert found.amplitude[0] < -0.3
    assert found.reason == "would need B below its bound"
    assert found.ln_bayes <= 0.0


def test_no_fit_is_announced_where_none_is_left(monkeypatch):
    shortlist = [SimpleNamespace(candidate=SimpleNamespace(effect="wear"))]
    monkeypatch.setattr(forward_selection, "shortlist_candidates", lambda ranked: shortlist)
    monkeypatch.setattr(forward_selection, "effect_names", lambda fit: frozenset({"tilt"}))
    search, said = SimpleNamespace(best=None, fits={frozenset({"tilt", "wear"}): None}), []
    assert forward_selection._fit_shortlist(search, [], said.append) is search
    assert said == []


@pytest.mark.parametrize(("scores", "fitted"), [
    ((29.5, 10.2, 9.4, 8.0), 3),  # at most three
    ((29.5, 4.9, 4.0), 1),  # no hint
    ((90.0, 31.0, 29.0), 2),  # a full fit may gain twice the score, and is stopped 30 behind the best
    ((4.0, 3.0), 0),
])  # fmt: skip
def test_candidates_that_may_reach_the_best_one_are_fitted_in_full(scores, fitted):
    ranked = [SimpleNamespace(ln_bayes=s) for s in scores]
    assert forward_selection.shortlist_candidates(ranked) == ranked[:fitted]
