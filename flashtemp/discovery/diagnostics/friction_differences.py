"""Differences of friction between conditions, or between repetitions, that are larger than usual scatter.

Calibration lets friction of every condition and repetition scatter, because it does so from test to test.  A change of
friction with load or speed, or a load that is not what is stated, can hide in this scatter.  A difference is reported
if it exceeds the range of as many normal scatters in 95 % of cases (Tukey's studentised range; Miller, "Simultaneous
statistical inference", 1981) and its own error.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flashtemp.discovery.estimation.linearised_fit import LinearisedFit
from flashtemp.discovery.estimation.nuisance_priors import NUISANCE_SD
from flashtemp.discovery.parameters import ParameterId, ParameterKind
from flashtemp.discovery.verdict import FrictionDifference

SCATTER_PROBABILITY = 0.95  # of a smaller range by scatter alone
MIN_STANDARD_ERRORS = 3.0  # of a difference, below which it may be an error of its estimate


def find_friction_differences(fit: LinearisedFit) -> tuple[FrictionDifference, ...]:
    """The largest difference between conditions, and between repetitions of any one condition, if beyond scatter."""
    levels = [p for p in fit.solution.names if p.kind is ParameterKind.LEVEL]
    scatter = [p for p in fit.solution.names if p.kind is ParameterKind.SCATTER]
    each = [[p for p in scatter if p.condition == number] for number in sorted({p.condition for p in scatter})]
    repeated = [d for own in each if (d := _largest_difference(fit, own)) is not None]
    return (
        *filter(None, (_largest_difference(fit, levels),)),
        *sorted(repeated, key=lambda d: -d.value)[:1],
    )


def _largest_difference(fit: LinearisedFit, parameters: Sequence[ParameterId]) -> FrictionDifference | None:
    """The largest difference between some parameters of one kind; None if scatter or errors may give it."""
    if len(parameters) < 2:
        return None
    at = [fit.solution.names.index(p) for p in parameters]
    d, covariance = fit.solution.d[at], fit.solution.covariance[np.ix_(at, at)]
    i, j = int(np.argmax(d)), int(np.argmin(d))
    value = float(d[i] - d[j])
    stderr = float(np.sqrt(max(covariance[i, i] + covariance[j, j] - 2.0 * covariance[i, j], 0.0)))
    usual = _range_limit(len(parameters)) * NUISANCE_SD[parameters[0].kind]
    if value <= max(usual, MIN_STANDARD_ERRORS * stderr):
        return None
    is_between_conditions = parameters[0].kind is ParameterKind.LEVEL
    higher, lower = (_describe_part(parameters[k], is_between_conditions) for k in (i, j))
    return FrictionDifference(higher, lower, value, stderr, is_between_conditions)


def _describe_part(p: ParameterId, is_between_conditions: bool) -> str:
    condition = f"condition {p.condition + 1}"
    return condition if is_between_conditions else f"repetition {p.index[0]} of {condition}"


def _range_limit(count: int) -> float:
    """The range, in standard deviations, that `count` normal values exceed in 1 - SCATTER_PROBABILITY of cases.

    For two it is 1.96 sqrt(2) = 2.77.
    """
    from scipy.stats import studentized_range

    return float(studentized_range.ppf(SCATTER_PROBABILITY, count, np.inf))
