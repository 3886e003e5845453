"""Errors of the set-up that the data show: pixel scale, turn and clock of images, length and width of the block.

All of them are unknowns of every fit, with priors.  Here each is asked alone, all others held at what is stated: how
much more probable are the data with it?  The best is accepted, then the rest is asked again.  Those that explain the
data as well as the best share its effect, such as the length of the block and the pixel scale; they are told together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flashtemp.discovery.criteria import Criteria
from flashtemp.discovery.estimation.linearised_fit import Fit
from flashtemp.discovery.floor import LARGEST
from flashtemp.discovery.laboratory import UNITS, name, words
from flashtemp.discovery.linear_gaussian import Solution
from flashtemp.discovery.nuisances import GROUPS
from flashtemp.discovery.parameters import PLACED, Kind, ParameterId, Priors
from flashtemp.discovery.problem import Problem
from flashtemp.discovery.whitening import Data

MAX_ERRORS = 3
FIXED = 1e-4  # of a prior standard deviation: as good as fixed, and safe in double precision


@dataclass(frozen=True)
class SetupError:
    """An error of the set-up: `value` with `stderr` in `unit`, `pull` in standard deviations of what is usual, `ln_bayes`
    against none, `words` for people, and `alternatives` in words that explain the data as well."""

    name: str
    parameter: ParameterId
    value: float
    stderr: float
    unit: str
    pull: float
    ln_bayes: float
    words: str
    alternatives: tuple[str, ...] = ()

    def is_unusual(self, criteria: Criteria) -> bool:
        """Whether it lies, its own uncertainty allowed for, where few set-ups do."""
        certain = max(1.0 - 2.0 * self.stderr / max(abs(self.value), 1e-300), 0.0)
        return abs(self.pull) * certain > criteria.pull_setup


def setup_errors(problem: Problem, data: Data, fit: Fit, criteria: Criteria) -> tuple[SetupError, ...]:
    """Errors of the set-up that a fit shows, the most certain first."""
    asked = _asked(problem, fit)
    free: dict[ParameterId, float] = {}
    found: list[SetupError] = []
    plain = _solve(fit, asked, free)
    while asked and len(found) < MAX_ERRORS:
        tried = {p: _solve(fit, asked, {**free, p: sd}) for p, sd in asked.items() if p not in free}
        if not tried:
            break
        best = max(tried, key=lambda p: tried[p].ln_evidence)
        gain = tried[best].ln_evidence - plain.ln_evidence
        gain = min(gain, _gain_beyond_discrepancy(fit, asked, free, best))
        if gain < criteria.ln_bayes_named:
            break
        alike = [p for p, s in tried.items()
                 if p != best and tried[best].ln_evidence - s.ln_evidence < criteria.ln_bayes_distinct]  # fmt: skip
        error = _error(problem, fit, best, asked[best], tried[best], gain, alike, tried)
        certain = abs(error.value) > criteria.setup_standard_errors * error.stderr
        if certain and _visible_fraction(data, fit, best, gain) > criteria.visible_fraction:
            found.append(error)
        free[best], plain = asked[best], tried[best]
    return tuple(found)


def _asked(problem: Problem, fit: Fit) -> dict[ParameterId, float]:
    """Standard deviations of all errors that may be asked: of the block, of all images of a view, of each of several."""
    views = {v.file: v.recording.view for v in problem.campaign.views}
    count = {view: sum(v == view for v in views.values()) for view in views.values()}
    out = {}
    for p in fit.solution.names:
        alone = p.kind in PLACED and p.file and count[views[p.file]] > 1
        shared = p.kind in PLACED and not p.file
        if p.kind is Kind.SIZE or alone or shared:
            out[p] = GROUPS[p.kind]
    return out


def _visible_fraction(data: Data, fit: Fit, p: ParameterId, gain: float) -> float:
    """What no other unknown can imitate of an error, rms over the recordings that it acts on, over their rise."""
    shown = {file: o for prediction in fit.predictions for file, o in prediction.observables.items()}
    squares = 0.0
    for b in fit.blocks:
        if b.label in data.noises and any(q == p for q, _ in b.names):
            seen = shown[b.label]
            rise = seen.values[:, seen.inside] - float(np.nanmin(seen.values))
            squares += b.count * float(np.nanmean(rise**2)) / data.noises[b.label].white ** 2
    return float(np.sqrt(2.0 * gain / squares)) if squares else 1.0


def _gain_beyond_discrepancy(
    fit: Fit, asked: dict[ParameterId, float], free: dict[ParameterId, float], p: ParameterId
) -> float:
    """ln Bayes factor of one error where the model's own smooth error is as large as it may be: what that explains as
    well is no error of the set-up."""
    plain = _solve(fit, asked, free, LARGEST)
    return _solve(fit, asked, {**free, p: asked[p]}, LARGEST).ln_evidence - plain.ln_evidence


def _solve(
    fit: Fit, asked: dict[ParameterId, float], free: dict[ParameterId, float], discrepancy: float | None = None
) -> Solution:
    """The fit with every error of the set-up held at what is stated, but for those that are `free`."""
    priors: Priors = dict(fit.nuisances)
    for p in priors:
        if p.kind is Kind.FLOOR and discrepancy is not None:
            priors[p] = (priors[p][0], discrepancy)
        if p.kind in PLACED or p.kind is Kind.SIZE:
            sd = free.get(p, FIXED * GROUPS[p.kind])
            priors[p] = (-fit.model.placed(p), sd)
    return fit.system.solve(priors, fit.equations)


def _error(
    problem: Problem, fit: Fit, p: ParameterId, usual: float, solution: Solution, gain: float,
    alike: list[ParameterId], tried: dict[ParameterId, Solution],
) -> SetupError:  # fmt: skip
    value, sd = _value(fit, p, solution), solution.sd(p)
    factor = 180.0 / np.pi if p.kind is Kind.TURN else 1.0
    others = tuple(words(problem, q, _value(fit, q, tried[q])) for q in alike)
    return SetupError(
        name(p), p, factor * value, factor * sd, UNITS[p.kind], value / usual, gain, words(problem, p, value), others
    )


def _value(fit: Fit, p: ParameterId, solution: Solution) -> float:
    """The error itself: where the fit stands, and what the solution adds."""
    return fit.model.placed(p) + solution[p]
