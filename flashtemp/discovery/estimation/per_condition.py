"""Estimates of a shared parameter from each condition alone, to test whether an effect is the same in all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flashtemp.discovery.estimation.linear_gaussian import Array, DataBlock, Solution
from flashtemp.discovery.estimation.linearised_fit import LinearisedFit
from flashtemp.discovery.hypotheses.piecewise_linear_law import LEARNED_LAW_NAME
from flashtemp.discovery.parameters import ParameterId
from flashtemp.discovery.prediction.problem import Problem
from flashtemp.discovery.verdict import ConditionEstimate


@dataclass(frozen=True)
class PerConditionEstimates:
    """Estimates of one shared quantity from each condition, with their `covariance` (n, n)."""

    conditions: tuple[ConditionEstimate, ...]
    covariance: Array

    @property
    def probability(self) -> float:
        """p value of the scatter between conditions if all have the same true value (chi2 test)."""
        from scipy.stats import chi2

        if len(self.conditions) < 2:
            return 1.0
        value, precision = np.array([c.value for c in self.conditions]), np.linalg.inv(self.covariance)
        away = value - np.sum(precision @ value) / np.sum(precision)
        return float(chi2.sf(away @ precision @ away, len(value) - 1))


def estimate_by_condition(
    problem: Problem, fit: LinearisedFit, parameter: ParameterId, every: bool = False
) -> PerConditionEstimates:
    """A parameter of an effect estimated for each condition separately, with all other parameters shared.

    `every`: use held-out data too.
    """
    now, (words, split, own) = fit.model.effect_value(parameter), _split_by_condition(problem, fit, [parameter], every)
    return _make_estimates(words, [now + split[p] for [p] in own], _select_covariance(split, [p for [p] in own]))


def estimate_law_by_condition(
    problem: Problem, fit: LinearisedFit, effect: str, every: bool = False
) -> PerConditionEstimates:
    """The factor on a fitted law for each condition, with all nodes of the law free there.

    The nodes are not tested one by one, because a node is hardly free while its neighbours are fixed.
    """
    nodes = [p for p in fit.effect_parameters if p.effect == effect]
    if not nodes:  # all on their bounds
        return PerConditionEstimates((), np.zeros((0, 0)))
    found = np.array([fit.model.effect_value(p) + fit.solution[p] for p in nodes])
    words, split, own = _split_by_condition(problem, fit, nodes, every)
    sizes, weights = [], np.zeros((len(own), len(own) * len(nodes)))
    for k, names in enumerate(own):
        precision = np.linalg.inv(_select_covariance(split, names)) @ found
        weights[k, k * len(nodes) : (k + 1) * len(nodes)] = precision / (found @ precision)
        theirs = [fit.model.effect_value(p) + split[q] for p, q in zip(nodes, names, strict=True)]
        sizes.append(float(precision @ theirs / (found @ precision)))
    return _make_estimates(
        words, sizes, weights @ _select_covariance(split, [p for names in own for p in names]) @ weights.T
    )


def _split_by_condition(
    problem: Problem, fit: LinearisedFit, own: list[ParameterId], every: bool
) -> tuple[list[str], Solution, list[list[ParameterId]]]:
    """Conditions in words, the solution with the parameters `own` split by condition, and the names of the parts."""

    def is_counted(b: DataBlock) -> bool:
        return every or not b.held_out

    numbers = {b.condition for b in fit.blocks if is_counted(b) and {n for n, _ in b.names} >= set(own)}
    split = fit.system.split_by_condition(own)
    names = [[replace(p, condition=n) for p in own] for n in sorted(numbers)]
    loose = {q: (0.0, 1e3 * fit.priors[p][1]) for each in names for p, q in zip(own, each, strict=True)}
    shared = {p: v for p, v in fit.priors.items() if p not in own}
    solution = split.solve(shared | loose, split.normal_equations(is_counted, fit.hyper.variances))
    return [problem.conditions[n].words for n in sorted(numbers)], solution, names


def _select_covariance(solution: Solution, names: list[ParameterId]) -> Array:
    at = [solution.names.index(p) for p in names]
    return solution.covariance[np.ix_(at, at)]


def _make_estimates(words: Sequence[str], values: Sequence[float], covariance: Array) -> PerConditionEstimates:
    errors = np.sqrt(np.diag(covariance)).tolist()
    return PerConditionEstimates(
        tuple(ConditionEstimate(*own) for own in zip(words, values, errors, strict=True)), covariance
    )


def estimate_effect_by_condition(
    problem: Problem, fit: LinearisedFit, effect: str, every: bool = False
) -> list[PerConditionEstimates]:
    """Estimates by condition of every parameter of an effect; for a learned law, of its factor as a whole."""
    if effect == LEARNED_LAW_NAME:
        return [estimate_law_by_condition(problem, fit, effect, every)]
    return [estimate_by_condition(problem, fit, p, every) for p in fit.effect_parameters if p.effect == effect]
