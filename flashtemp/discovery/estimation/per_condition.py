"""What each condition alone would have of a parameter that all share: does an effect agree with itself?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flashtemp.discovery.estimation.linear_gaussian import Array, Block, Solution
from flashtemp.discovery.estimation.linearised_fit import Fit
from flashtemp.discovery.hypotheses.piecewise_linear_law import EFFECT_NAME
from flashtemp.discovery.parameters import ParameterId
from flashtemp.discovery.prediction.problem import Problem
from flashtemp.discovery.verdict import OwnValue


@dataclass(frozen=True)
class PerConditionEstimates:
    """What each condition would have of something that all share, with the `covariance` (n, n) of these values."""

    conditions: tuple[OwnValue, ...]
    covariance: Array

    @property
    def probability(self) -> float:
        """Probability of so much scatter between conditions if all had the same value."""
        from scipy.stats import chi2

        if len(self.conditions) < 2:
            return 1.0
        value, precision = np.array([c.value for c in self.conditions]), np.linalg.inv(self.covariance)
        away = value - np.sum(precision @ value) / np.sum(precision)
        return float(chi2.sf(away @ precision @ away, len(value) - 1))


def estimate_per_condition(
    problem: Problem, fit: Fit, parameter: ParameterId, every: bool = False
) -> PerConditionEstimates:
    """A parameter of an effect as each condition would have it, if it were one for each and all else shared; by `every`
    datum, those held out too."""
    now, (words, split, own) = fit.model.value(parameter), _split_by_condition(problem, fit, [parameter], every)
    return _estimates(words, [now + split[p] for [p] in own], _covariance(split, [p for [p] in own]))


def law_scale_per_condition(problem: Problem, fit: Fit, effect: str, every: bool = False) -> PerConditionEstimates:
    """How many times a law as found each condition would have it, all its nodes free there.

    A node alone says little: nodes beside it, kept as all conditions want them, leave it no room.
    """
    nodes = [p for p in fit.fitted if p.effect == effect]
    if not nodes:  # all on their bounds
        return PerConditionEstimates((), np.zeros((0, 0)))
    found = np.array([fit.model.value(p) + fit.solution[p] for p in nodes])
    words, split, own = _split_by_condition(problem, fit, nodes, every)
    sizes, weights = [], np.zeros((len(own), len(own) * len(nodes)))
    for k, names in enumerate(own):
        precision = np.linalg.inv(_covariance(split, names)) @ found
        weights[k, k * len(nodes) : (k + 1) * len(nodes)] = precision / (found @ precision)
        theirs = [fit.model.value(p) + split[q] for p, q in zip(nodes, names, strict=True)]
        sizes.append(float(precision @ theirs / (found @ precision)))
    return _estimates(words, sizes, weights @ _covariance(split, [p for names in own for p in names]) @ weights.T)


def _split_by_condition(
    problem: Problem, fit: Fit, own: list[ParameterId], every: bool
) -> tuple[list[str], Solution, list[list[ParameterId]]]:
    """Conditions in words, the solution with some parameters one for each of them, and what these are called there."""

    def asked(b: Block) -> bool:
        return every or not b.held_out

    seen = {b.condition for b in fit.blocks if asked(b) and {n for n, _ in b.names} >= set(own)}
    split = fit.system.split(own)
    names = [[replace(p, condition=n) for p in own] for n in sorted(seen)]
    loose = {q: (0.0, 1e3 * fit.priors[p][1]) for each in names for p, q in zip(own, each, strict=True)}
    shared = {p: v for p, v in fit.priors.items() if p not in own}
    solution = split.solve(shared | loose, split.total(asked, fit.hyper.variances))
    return [problem.conditions[n].words for n in sorted(seen)], solution, names


def _covariance(solution: Solution, names: list[ParameterId]) -> Array:
    at = [solution.names.index(p) for p in names]
    return solution.covariance[np.ix_(at, at)]


def _estimates(words: Sequence[str], values: Sequence[float], covariance: Array) -> PerConditionEstimates:
    errors = np.sqrt(np.diag(covariance)).tolist()
    return PerConditionEstimates(tuple(OwnValue(*own) for own in zip(words, values, errors, strict=True)), covariance)


def estimates_per_condition(
    problem: Problem, fit: Fit, effect: str, every: bool = False
) -> list[PerConditionEstimates]:
    """The same of everything that says how large an effect is: its parameters one by one, or a learned law whole."""
    if effect == EFFECT_NAME:
        return [law_scale_per_condition(problem, fit, effect, every)]
    return [estimate_per_condition(problem, fit, p, every) for p in fit.fitted if p.effect == effect]
