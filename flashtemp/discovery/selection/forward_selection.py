"""Forward selection: calibrate the stated model, score every candidate, fit the best in full, extend while it pays.

Each candidate is scored by its sensitivities at the best point of the model so far; a short list, and a pair where no
candidate alone will do, is fitted in full by `fit_hypothesis`; the one with the largest evidence is accepted where it
pays for its parameters.  Then all that is left is scored again at the new best point.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from flashtemp.discovery.criteria import CRITERIA
from flashtemp.discovery.estimation.fitting import Hypothesis, Watch, fit_hypothesis, run_fits
from flashtemp.discovery.estimation.image_alignment import Linearisation
from flashtemp.discovery.estimation.linear_gaussian import System
from flashtemp.discovery.estimation.linearised_fit import Fit
from flashtemp.discovery.estimation.per_condition import estimates_per_condition
from flashtemp.discovery.estimation.whitening import Data
from flashtemp.discovery.hypotheses.candidates import Candidate
from flashtemp.discovery.measurement_errors.recording_errors import RecordingError
from flashtemp.discovery.parameters import ParameterId
from flashtemp.discovery.prediction.problem import Problem
from flashtemp.discovery.selection.scores import Pair, Score, pairs, scores, worth_another_look
from flashtemp.errors import SolverFailure

Names = frozenset[str]


@dataclass(frozen=True)
class Search:
    """What was tried on a `problem`: the calibrated `base` and the `best` extended fit, both with sensitivities of all
    candidates that may still matter; `fits` {effects: fit} of every full fit; `ranking` scores at the base and at
    every extension; `unfitted` {effects: why} of those that could not be simulated, `vanished` effects whose strength
    became none in a full fit.  `recording_errors` were corrected before anything was fitted."""

    problem: Problem
    data: Data
    base: Fit
    best: Fit
    fits: dict[Names, Fit]
    ranking: tuple[tuple[Score, ...], ...] = ()
    unfitted: dict[Names, str] = field(default_factory=dict)
    vanished: frozenset[Names] = frozenset()
    recording_errors: tuple[RecordingError, ...] = ()


def names_of(fit: Fit) -> Names:
    return frozenset(fit.model.effects)


def with_candidates(
    problem: Problem, data: Data, fit: Fit, candidates: Sequence[Candidate], watch: Watch,
    inputs: tuple[ParameterId, ...] = (),
) -> Fit:  # fmt: skip
    """A fit with exact derivatives at its point, those of candidates among them, and brought to its best point again.

    Raises SolverFailure.
    """
    own = [c for c in problem.candidates if c.effect in fit.model.effects]
    others = tuple(c for c in candidates if c.effect not in fit.model.effects)
    h = Hypothesis(problem, data, fit.model, tuple(own), keeps_candidates=True)
    wanted = replace(h.all_derivatives(), candidates=others, inputs=inputs)
    tasks = problem.tasks(fit.model, wanted)
    predictions = problem.predictions(tasks)
    first = Linearisation(fit.model, tuple(tasks), tuple(predictions), System(data.blocks(predictions)))
    return settle(h, first, watch)


def settle(h: Hypothesis, first: Linearisation, watch: Watch) -> Fit:
    """One fit from a linearised point to its end.  Raises SolverFailure."""
    found = run_fits(h.problem, {"": fit_hypothesis(h, first)}, watch)
    if "" not in found.fits:
        raise SolverFailure(found.failed[""])
    return found.fits[""]


def select(problem: Problem, data: Data, base: Fit, watch: Watch) -> Search:
    """Extend a calibrated base as long as the evidence asks for it.  Raises SolverFailure."""
    search = Search(problem, data, base, base, {frozenset(): base})
    for _ in range(int(CRITERIA.max_causes)):
        ranked = scores(problem, search.best, problem.candidates)
        search = _fit_shortlist(replace(search, ranking=(*search.ranking, ranked)), ranked, watch)
        found = _worth_its_parameters(search)
        if found is None:
            return search
        more = worth_another_look(problem, search.best, found, ranked)
        watch(f"candidates beside {' and '.join(sorted(names_of(found)))}")
        best = with_candidates(problem, data, found, more, watch)
        search = replace(search, best=best, fits=search.fits | {names_of(best): best})
    last = scores(problem, search.best, problem.candidates)
    return replace(search, ranking=(*search.ranking, last))


def _fit_shortlist(search: Search, ranked: Sequence[Score], watch: Watch) -> Search:
    """Full fits of the candidates with the best scores, and of the best pair where it explains far more than each."""
    groups: list[tuple[Candidate, ...]] = [(s.candidate,) for s in shortlist(ranked)]
    if not names_of(search.best):
        groups += [tuple(s.candidate for s in p.scores) for p in _pairs(search, ranked)]
    if not groups:
        return search
    wanted = {frozenset({*names_of(search.best), *(c.effect for c in g)}): g for g in groups}
    wanted = {names: g for names, g in wanted.items() if names not in search.fits}
    watch(f"fitting {', '.join(' with '.join(c.effect for c in g) for g in wanted.values())}")
    fittings = {
        names: fit_hypothesis(Hypothesis.extending(search.problem, search.data, search.best, g))
        for names, g in wanted.items()
    }
    found = run_fits(search.problem, fittings, watch)
    fits = {names: f for names, f in found.fits.items() if is_alive(search.problem, f)}
    vanished = search.vanished | (found.fits.keys() - fits.keys())
    return replace(search, fits=search.fits | fits, unfitted=search.unfitted | found.failed, vanished=vanished)


def shortlist(ranked: Sequence[Score]) -> list[Score]:
    """Candidates that are fitted in full."""
    likely = [s for s in ranked if s.ln_bayes > CRITERIA.ln_bayes_hint]
    if not likely:
        return []
    best = likely[0].ln_bayes
    return [s for s in likely if s.ln_bayes > min(best - CRITERIA.shortlist_range, CRITERIA.shortlist_fraction * best)][
        : int(CRITERIA.shortlist)
    ]


def _pairs(search: Search, ranked: Sequence[Score]) -> list[Pair]:
    """The best pair, if its score exceeds that of its better member by what a further cause needs."""
    if len(ranked) < 2:
        return []
    best = max((s.ln_bayes for s in ranked), default=0.0)
    found = pairs(search.problem, search.best, ranked)[:1]
    return [
        p for p in found if p.ln_bayes > max(best, 0.0) + CRITERIA.ln_bayes_named and p.more > CRITERIA.ln_bayes_named
    ]


def _worth_its_parameters(search: Search) -> Fit | None:
    """The extension with the largest evidence, if each of its effects pays for itself."""
    own = names_of(search.best)
    extended = [f for names, f in search.fits.items() if names > own and f.usable and (not own or _is_sound(search, f))]
    best = max(extended, key=lambda f: f.secured - CRITERIA.ln_bayes_named * len(names_of(f)), default=None)
    if best is None:
        return None
    gained = best.secured - search.best.secured
    return best if gained > CRITERIA.ln_bayes_named * (len(names_of(best)) - len(own)) else None


def _is_sound(search: Search, fit: Fit) -> bool:
    """Whether a further cause is one: alike in all conditions, and more than a smooth error of the model may be.

    If not, it mops up what another one left.
    """
    problem = search.problem
    new = names_of(fit) - names_of(search.best)
    estimates = [e for effect in new for e in estimates_per_condition(problem, fit, effect)]
    before, after = (f.at_largest(problem, f.effects) for f in (search.best, fit))
    alike = all(e.probability > CRITERIA.condition_scatter for e in estimates)
    return alike and after - before > CRITERIA.ln_bayes_named


def is_alive(problem: Problem, fit: Fit) -> bool:
    """Whether every effect of a model still acts: none of them ended with a strength at off."""
    for name, values in fit.model.effects.items():
        params = problem.case.known[name].params()
        if all(values[k] == p.off for k, p in params.items() if k in values and p.off is not None):
            return False
    return True
