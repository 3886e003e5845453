"""Forward selection: calibrate the stated model, score every candidate, fit the best in full, extend while it pays.

Each candidate is scored by its sensitivities at the best point of the model so far; a short list, and a pair where no
candidate alone will do, is fitted in full by `fit_hypothesis`; the one with the largest evidence is accepted where it
pays for its parameters.  Then all that is left is scored again at the new best point.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from flashtemp.discovery.criteria import CRITERIA
from flashtemp.discovery.estimation.fitting import Hypothesis, ProgressCallback, fit_hypothesis, run_fits
from flashtemp.discovery.estimation.image_alignment import Linearisation
from flashtemp.discovery.estimation.linear_gaussian import LinearSystem
from flashtemp.discovery.estimation.linearised_fit import FitStatus, LinearisedFit
from flashtemp.discovery.estimation.per_condition import estimate_effect_by_condition
from flashtemp.discovery.estimation.whitening import WhitenedData
from flashtemp.discovery.hypotheses.candidates import CandidateEffect
from flashtemp.discovery.measurement_errors.recording_errors import RecordingError
from flashtemp.discovery.parameters import ParameterId
from flashtemp.discovery.prediction.problem import Problem
from flashtemp.discovery.selection.scores import (
    CandidateScore,
    EffectPair,
    score_candidates,
    score_pairs,
    select_for_rescoring,
)
from flashtemp.errors import SolverFailure

EffectNames = frozenset[str]


@dataclass(frozen=True)
class EffectSearch:
    """What was tried on a `problem`: the calibrated `base` and the `best` extended fit, both with sensitivities of all
    candidates that may still matter; `fits` {effects: fit} of every full fit; `ranking` scores at the base and at
    every extension; `unfitted` {effects: why} of those that could not be simulated, `vanished` effects whose strength
    became none in a full fit.  `recording_errors` were corrected before anything was fitted."""

    problem: Problem
    data: WhitenedData
    base: LinearisedFit
    best: LinearisedFit
    fits: dict[EffectNames, LinearisedFit]
    ranking: tuple[tuple[CandidateScore, ...], ...] = ()
    unfitted: dict[EffectNames, str] = field(default_factory=dict)
    vanished: frozenset[EffectNames] = frozenset()
    recording_errors: tuple[RecordingError, ...] = ()


def effect_names(fit: LinearisedFit) -> EffectNames:
    return frozenset(fit.model.effects)


def refit_with_candidates(
    problem: Problem, data: WhitenedData, fit: LinearisedFit, candidates: Sequence[CandidateEffect], watch: ProgressCallback,
    inputs: tuple[ParameterId, ...] = (),
) -> LinearisedFit:  # fmt: skip
    """A fit with exact derivatives at its point, those of candidates among them, and brought to its best point again.

    Raises SolverFailure.
    """
    own = [c for c in problem.candidates if c.effect in fit.model.effects]
    others = tuple(c for c in candidates if c.effect not in fit.model.effects)
    h = Hypothesis(problem, data, fit.model, tuple(own), keeps_candidates=True)
    wanted = replace(h.all_derivatives(), candidates=others, inputs=inputs)
    tasks = problem.make_tasks(fit.model, wanted)
    predictions = problem.predict(tasks)
    first = Linearisation(fit.model, tuple(tasks), tuple(predictions), LinearSystem(data.make_blocks(predictions)))
    return finish_fit(h, first, watch)


def finish_fit(h: Hypothesis, first: Linearisation, watch: ProgressCallback) -> LinearisedFit:
    """One fit from a linearised point to its end.  Raises SolverFailure."""
    found = run_fits(h.problem, {"": fit_hypothesis(h, first)}, watch)
    if "" not in found.fits:
        raise SolverFailure(found.failed[""])
    return found.fits[""]


def select_effects(problem: Problem, data: WhitenedData, base: LinearisedFit, watch: ProgressCallback) -> EffectSearch:
    """Extend a calibrated base as long as the evidence asks for it.  Raises SolverFailure."""
    search = EffectSearch(problem, data, base, base, {frozenset(): base})
    for _ in range(int(CRITERIA.max_causes)):
        ranked = score_candidates(problem, search.best, problem.candidates)
        search = _fit_shortlist(replace(search, ranking=(*search.ranking, ranked)), ranked, watch)
        found = _best_extension(search)
        if found is None:
            return search
        more = select_for_rescoring(problem, search.best, found, ranked)
        watch(f"candidates beside {' and '.join(sorted(effect_names(found)))}")
        best = refit_with_candidates(problem, data, found, more, watch)
        search = replace(search, best=best, fits=search.fits | {effect_names(best): best})
    last = score_candidates(problem, search.best, problem.candidates)
    return replace(search, ranking=(*search.ranking, last))


def _fit_shortlist(search: EffectSearch, ranked: Sequence[CandidateScore], watch: ProgressCallback) -> EffectSearch:
    """Full fits of the candidates with the best scores, and of the best pair where it explains far more than each."""
    groups: list[tuple[CandidateEffect, ...]] = [(s.candidate,) for s in shortlist_candidates(ranked)]
    if not effect_names(search.best):
        groups += [tuple(s.candidate for s in p.scores) for p in _promising_pairs(search, ranked)]
    if not groups:
        return search
    wanted = {frozenset({*effect_names(search.best), *(c.effect for c in g)}): g for g in groups}
    wanted = {names: g for names, g in wanted.items() if names not in search.fits}
    watch(f"fitting {', '.join(' with '.join(c.effect for c in g) for g in wanted.values())}")
    fittings = {
        names: fit_hypothesis(Hypothesis.from_parent(search.problem, search.data, search.best, g))
        for names, g in wanted.items()
    }
    found = run_fits(search.problem, fittings, watch)
    fits = {names: f for names, f in found.fits.items() if has_active_effects(search.problem, f)}
    vanished = search.vanished | (found.fits.keys() - fits.keys())
    return replace(search, fits=search.fits | fits, unfitted=search.unfitted | found.failed, vanished=vanished)


def shortlist_candidates(ranked: Sequence[CandidateScore]) -> list[CandidateScore]:
    """Candidates that are fitted in full."""
    likely = [s for s in ranked if s.ln_bayes > CRITERIA.ln_bayes_hint]
    if not likely:
        return []
    best = likely[0].ln_bayes
    return [s for s in likely if s.ln_bayes > min(best - CRITERIA.shortlist_range, CRITERIA.shortlist_fraction * best)][
        : int(CRITERIA.shortlist)
    ]


def _promising_pairs(search: EffectSearch, ranked: Sequence[CandidateScore]) -> list[EffectPair]:
    """The best pair, if its score exceeds that of its better member by what a further cause needs."""
    if len(ranked) < 2:
        return []
    best = max((s.ln_bayes for s in ranked), default=0.0)
    found = score_pairs(search.problem, search.best, ranked)[:1]
    return [
        p for p in found if p.ln_bayes > max(best, 0.0) + CRITERIA.ln_bayes_named and p.more > CRITERIA.ln_bayes_named
    ]


def _best_extension(search: EffectSearch) -> LinearisedFit | None:
    """The extension with the largest evidence, if each of its effects pays for itself."""
    own = effect_names(search.best)
    extended = [
        f
        for names, f in search.fits.items()
        if names > own and f.is_comparable and (not own or _is_consistent(search, f))
    ]
    best = max(
        extended, key=lambda f: f.secured_evidence - CRITERIA.ln_bayes_named * len(effect_names(f)), default=None
    )
    if best is None:
        return None
    gained = best.secured_evidence - search.best.secured_evidence
    return best if gained > CRITERIA.ln_bayes_named * (len(effect_names(best)) - len(own)) else None


def _is_consistent(search: EffectSearch, fit: LinearisedFit) -> bool:
    """Whether a further cause is one: alike in all conditions, and more than a smooth error of the model may be.

    If not, it mops up what another one left.
    """
    problem = search.problem
    new = effect_names(fit) - effect_names(search.best)
    estimates = [e for effect in new for e in estimate_effect_by_condition(problem, fit, effect)]
    before, after = (f.evidence_at_max_discrepancy(problem, f.effect_priors) for f in (search.best, fit))
    alike = all(e.probability > CRITERIA.condition_scatter for e in estimates)
    return alike and after - before > CRITERIA.ln_bayes_named


def find_unjudged_effects(search: EffectSearch, final: LinearisedFit) -> dict[frozenset[str], float]:
    """Models whose fits did not converge and still explain more than the final one, with ln Bayes factors against it;
    models that could not be simulated have the factor that a cause needs."""
    out = {}
    for names, fit in search.fits.items():
        gain = fit.secured_evidence - final.secured_evidence
        if not fit.is_comparable and fit.status is not FitStatus.OUTRUN and gain > CRITERIA.ln_bayes_distinct:
            out[names] = gain
    return out | {names: CRITERIA.ln_bayes_named for names in search.unfitted}


def has_active_effects(problem: Problem, fit: LinearisedFit) -> bool:
    """Whether every effect of a model still acts: none of them ended with a strength at off."""
    for name, values in fit.model.effects.items():
        params = problem.case.known_effects[name].params()
        if all(values[k] == p.off for k, p in params.items() if k in values and p.off is not None):
            return False
    return True
