"""Checks of stated inputs against the data: one input is freed at a time, on top of a linearised fit.

The measure is the normalised deviation ("pull") of the estimate from the data alone from the stated value, in units of
both uncertainties together: Demortier & Lyons, Everything you always wanted to know about pulls, CDF/ANAL/PUBLIC/5776
(2002).  It is normal with unit variance if the stated value and its standard deviation are right.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from flashtemp.discovery.criteria import CRITERIA
from flashtemp.discovery.diagnostics.stated_inputs import StatedInput
from flashtemp.discovery.estimation.linear_gaussian import LinearSystem, NormalEquations
from flashtemp.discovery.hypotheses.heavy_tails import INPUT_TAIL, local_width, width_price
from flashtemp.discovery.parameters import ParameterId, ParameterKind, Prior, Priors

MIN_GROUP_CORRELATION = 0.9  # of the columns of two inputs after nuisances were projected out
FIXED_INPUT_SD_FRACTION = 1e-4  # of a prior's standard deviation: as good as fixed, and safe in double precision


class InputVerdict(StrEnum):
    """The result of checking a stated number."""

    CONTRADICTED = "contradicted"
    CONSISTENT = "consistent"
    NOT_CHECKABLE = "not checkable"


@dataclass(frozen=True)
class InputCheck:
    """The check of a stated `input`: `estimate` and `sd` (unit of the input, K for degC) are from the data alone.

    `shift`: estimate minus stated value, in prior standard deviations.  `pull`: the same in standard deviations of both
    together.  `ln_bayes`: of freeing the input with its prior, which has heavy tails, against fixing it.
    `influence`: change of all data together by one prior standard deviation of the input with nothing else changed, in
    standard deviations of their noise.  `change`: largest relative change of a recording's temperature rise, or of a
    load-cell record's friction, by the difference between estimate and stated value.
    """

    input: StatedInput
    estimate: float
    sd: float
    shift: float
    pull: float
    ln_bayes: float
    influence: float
    verdict: InputVerdict
    change: float = 0.0

    @property
    def prior_width(self) -> float:
        """Local width of the input's prior at the estimate, in the unit of its standard deviation."""
        return local_width(self.input.sd, self.shift * self.input.sd, INPUT_TAIL)

    @property
    def is_contradicted(self) -> bool:
        return self.verdict is InputVerdict.CONTRADICTED

    @property
    def is_invisible(self) -> bool:
        """Whether a deviating estimate would change the data by less than the model may err."""
        return abs(self.pull) > CRITERIA.pull_input and self.change < CRITERIA.visible_fraction

    @property
    def summary_line(self) -> str:
        """The result in one line for reports."""
        i = self.input
        unit = "" if i.unit == "1" else f" {i.unit}"
        known = f"{100 * i.sd:.2g} %" if i.relative else f"{i.sd:.2g}{unit.replace('degC', 'K')}"
        stated = f"{i.key}: stated {i.value:.4g}{unit}, known to {known} ({i.source})"
        if self.verdict is InputVerdict.NOT_CHECKABLE:
            why = (
                "they hardly depend on it"
                if self.is_invisible or self.influence < 1.0
                else "other unknowns have the same effect"
            )
            return f"{stated}; these data cannot check it: {why}"
        estimate = f"{self.estimate:.4g} +- {self.sd:.2g}{unit}"
        return f"{stated}; the data require {estimate}, {abs(self.pull):.1f} standard deviations away"


def compare_inputs_with_data(
    system: LinearSystem, nuisance_priors: Priors, equations: NormalEquations | None, inputs: Sequence[StatedInput],
    change_per_unit: Callable[[ParameterId], float],
) -> tuple[InputCheck, ...]:  # fmt: skip
    """Check every input: free it alone, with its prior, in addition to the nuisances of a linearised fit.

    `change_per_unit`: largest relative change of a recording by one unit of a column (`effect_size.change_per_unit`).
    If a nuisance is the same number (the length of the block), it is removed from the nuisances, and the freed input is
    compared with a fit in which the input is fixed at its stated value.
    """
    total = equations or system.normal_equations()
    plain = system.solve(nuisance_priors, total).ln_evidence
    return tuple(_check_input(system, nuisance_priors, total, i, plain, change_per_unit) for i in inputs)


def _check_input(
    system: LinearSystem, nuisances: Priors, total: NormalEquations, i: StatedInput, plain: float,
    change_per_unit: Callable[[ParameterId], float],
) -> InputCheck:  # fmt: skip
    column = find_column(system, i)
    if column is None:
        return InputCheck(i, i.value, math.inf, 0.0, 0.0, 0.0, 0.0, InputVerdict.NOT_CHECKABLE)
    twin = same_nuisance(nuisances, i)
    mean = nuisances[twin][0] if twin else 0.0
    others = {p: prior for p, prior in nuisances.items() if p != twin}
    prior: Prior = (mean, i.sd)
    ln_evidence_fixed = (
        plain
        if twin is None
        else system.solve(others | {column: (mean, FIXED_INPUT_SD_FRACTION * i.sd)}, total).ln_evidence
    )
    freed = system.solve(others | {column: prior}, total)
    change, sd = _remove_prior(freed[column], freed.sd(column), prior)
    ratio = min(freed.sd(column) / i.sd, 1.0)
    change = max(change - mean, 0.0) if i.from_zero else change - mean
    width = local_width(i.sd, change, INPUT_TAIL)
    wide = freed if width == i.sd else system.solve(others | {column: (mean, width)}, total)
    bound_factor = i.ln_bound_factor(wide[column], wide.sd(column)) - width_price(width, i.sd, INPUT_TAIL)
    ln_bayes = wide.ln_evidence + bound_factor - ln_evidence_fixed
    pull = change / math.hypot(sd, i.sd)  # two independent values of the same number: their variances add up
    value, stderr = i.changed_value(change, sd)
    k = system.index[column]
    influence = i.sd * math.sqrt(max(float(total.matrix[k, k]), 0.0))
    check = InputCheck(
        i, value, stderr, change / i.sd, pull, ln_bayes, influence, _classify_pull(ratio, pull),
        abs(change) * change_per_unit(column),
    )  # fmt: skip
    return replace(check, verdict=InputVerdict.NOT_CHECKABLE) if check.is_invisible else check


def _remove_prior(posterior: float, sd: float, prior: Prior) -> tuple[float, float]:
    """Estimate and standard deviation from the data alone: the normal posterior divided by the normal prior."""
    mean, wide = prior
    precision = 1.0 / sd**2 - 1.0 / wide**2
    if precision <= 1e-9 / wide**2:
        return mean, math.inf
    return (posterior / sd**2 - mean / wide**2) / precision, precision**-0.5


def _classify_pull(ratio: float, pull: float) -> InputVerdict:
    if ratio > CRITERIA.sd_ratio_uncheckable:
        return InputVerdict.NOT_CHECKABLE
    return InputVerdict.CONTRADICTED if abs(pull) > CRITERIA.pull_input else InputVerdict.CONSISTENT


def find_column(system: LinearSystem, i: StatedInput) -> ParameterId | None:
    """The column of an input in a system: its own, that of a block size or that of a free key; None without any."""
    ways = (i.column_id, ParameterId(ParameterKind.SIZE, name=i.key), ParameterId.of_key(i.key))
    return next((p for p in ways if p in system.index), None)


def same_nuisance(nuisances: Priors, i: StatedInput) -> ParameterId | None:
    """The nuisance that is the same number as an input."""
    return next(
        (p for p in (ParameterId(ParameterKind.SIZE, name=i.key), ParameterId.of_key(i.key)) if p in nuisances), None
    )


def group_inputs(
    system: LinearSystem, nuisance_priors: Priors, equations: NormalEquations | None, inputs: Sequence[StatedInput]
) -> tuple[tuple[StatedInput, ...], ...]:
    """Inputs that the data can check but cannot distinguish from each other, in groups of two or more.

    Their columns are nearly parallel after the nuisances were projected out.
    """
    from scipy.sparse.csgraph import connected_components

    columns = {i.key: find_column(system, i) for i in inputs}
    twins = {same_nuisance(nuisance_priors, i) for i in inputs}
    known = [i for i in inputs if columns[i.key] is not None]
    if not known:
        return ()
    nuisances = {p: prior for p, prior in nuisance_priors.items() if p not in twins}
    wanted = [p for i in known if (p := columns[i.key]) is not None]
    information = system.project_out(nuisances, wanted, equations).information
    strength = np.diag(information) * np.array([i.sd for i in known]) ** 2
    checkable = np.flatnonzero(1.0 / (1.0 + np.maximum(strength, 0.0)) < CRITERIA.sd_ratio_uncheckable**2)
    size = np.sqrt(np.diag(information)[checkable])
    is_parallel = np.abs(information[np.ix_(checkable, checkable)]) / np.outer(size, size) > MIN_GROUP_CORRELATION
    _, label = connected_components(is_parallel, directed=False)
    groups = [tuple(known[k] for k in checkable[label == n].tolist()) for n in range(label.max(initial=-1) + 1)]
    return tuple(g for g in groups if len(g) > 1)
