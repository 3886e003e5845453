"""Forward selection of missing effects: score all candidates, fit the best in full, extend the model, repeat.

Each candidate is scored by its sensitivities at the best point of the model so far.  `fit_hypothesis` fits a short list
of them in full, and a pair of candidates where the pair scores far better than each alone.  The extension with the
largest evidence is accepted if its ln Bayes factor exceeds `ln_bayes_named` for each new effect.  The remaining
candidates are then scored again at the new best point.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from flashtemp.discovery.criteria import CRITERIA
from flashtemp.discovery.estimation.concurrent_fits import describe_fit, lowest_score_within_reach, run_fits
from flashtemp.discovery.estimation.fitting import Hypothesis, ProgressCallback, fit_hypothesis
from flashtemp.discovery.estimation.hyperparameters import maximise_evidence
from flashtemp.discovery.estimation.image_alignment import FIXED_STEP_SD, Linearisation
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
from flashtemp.display import ProgressMessage
from flashtemp.errors import SolverFailure

EffectNames = frozenset[str]


@dataclass(frozen=True)
class InputAlternative:
    """A model in which the stated input `key` is estimated, beside the effects that it `keeps`.

    `prior_sd`: local width of the prior of the ln of the key (`heavy_tails`), if the key can be estimated with the
    others (`is_key`); else the evidence is that of the linearised model.  The data want `value` with standard error
    `stderr`, in the unit of the key.
    """

    key: str
    keeps: EffectNames
    ln_evidence: float
    prior_sd: float
    is_key: bool
    value: float = math.nan
    stderr: float = math.nan

    @property
    def cause_names(self) -> EffectNames:
        return self.keeps | {self.key}

    def deficit_against(self, accepted: LinearisedFit) -> float:
        """ln Bayes factor of the accepted model against this one, where each cause costs what it needs to be named."""
        more = len(effect_names(accepted)) - len(self.cause_names)
        return accepted.ln_evidence - self.ln_evidence - CRITERIA.ln_bayes_named * more


@dataclass(frozen=True)
class EffectSearch:
    """A selection of effects on a `problem` with its whitened `data`, as far as it has got.

    `base`: the calibrated stated model.  `best`: the best extended fit so far.  Both have sensitivities of all
    candidates that may still matter.
    `fits` {effects: fit}: every full fit.  `ranking`: scores at the base and at every accepted extension.
    `unfitted` {effects: reason}: models that could not be simulated.  `vanished`: models in which the full fit brought
    the strength of an effect to its neutral value.
    `recording_errors`: errors of recordings that were corrected before the first fit.  `input_alternatives`: stated
    inputs in place of the accepted effects.
    """

    problem: Problem
    data: WhitenedData
    base: LinearisedFit
    best: LinearisedFit
    fits: dict[EffectNames, LinearisedFit]
    ranking: tuple[tuple[CandidateScore, ...], ...] = ()
    unfitted: dict[EffectNames, str] = field(default_factory=dict)
    vanished: frozenset[EffectNames] = frozenset()
    recording_errors: tuple[RecordingError, ...] = ()
    input_alternatives: tuple[InputAlternative, ...] = ()


def effect_names(fit: LinearisedFit) -> EffectNames:
    return frozenset(fit.model.effects)


def refit_with_candidates(
    problem: Problem,
    data: WhitenedData,
    fit: LinearisedFit,
    candidates: Sequence[CandidateEffect],
    watch: ProgressCallback,
    inputs: tuple[ParameterId, ...] = (),
) -> LinearisedFit:
    """Fit again from the best point of `fit`, with exact derivatives that include those of `candidates` and `inputs`.

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


def finish_fit(
    h: Hypothesis, first: Linearisation | None, watch: ProgressCallback, least: float = -math.inf
) -> LinearisedFit:
    """Run one fit until it ends, or cannot reach the ln evidence `least`.

    It starts at the linearisation `first`, or at the model of the hypothesis.  Raises SolverFailure.
    """
    outcome = run_fits(h.problem, {"": fit_hypothesis(h, first)}, watch, least)
    if "" not in outcome.fits:
        raise SolverFailure(outcome.failed[""])
    return outcome.fits[""]


def select_effects(problem: Problem, data: WhitenedData, base: LinearisedFit, watch: ProgressCallback) -> EffectSearch:
    """Extend a calibrated base by one or more effects while the evidence requires it.  Raises SolverFailure."""
    search = EffectSearch(problem, data, base, base, {frozenset(): base})
    for _ in range(int(CRITERIA.max_causes)):
        ranked = score_candidates(problem, search.best, problem.candidates)
        search = _fit_shortlist(replace(search, ranking=(*search.ranking, ranked)), ranked, watch)
        extension = _best_extension(search)
        if extension is None:
            return search
        candidates = select_for_rescoring(problem, search.best, extension, ranked)
        words = f"candidates in addition to {' and '.join(sorted(effect_names(extension)))}"
        watch(ProgressMessage(words, **(describe_search(search) | {"accepted": sorted(effect_names(extension))})))
        search = update_image_errors(search, extension)
        best = refit_with_candidates(problem, search.data, extension, candidates, watch)
        search = replace(search, best=best, fits=search.fits | {effect_names(best): best})
        search = drop_needless_effects(search, watch)
    last = score_candidates(problem, search.best, problem.candidates)
    return replace(search, ranking=(*search.ranking, last))


def update_image_errors(search: EffectSearch, fit: LinearisedFit) -> EffectSearch:
    """A search whose fits share the columns of camera and model errors at the image that `fit` predicts.

    Smear and stray light follow the image: where an effect changes it, those of the stated model fit no more.  All fits
    are solved again with the new columns, so that their evidence stays comparable.
    """
    data = search.data.with_image_errors_of(fit.predictions)
    fits = {names: _solve_again(search.problem, data, f) for names, f in search.fits.items()}
    return replace(
        search, data=data, base=fits[effect_names(search.base)], best=fits[effect_names(search.best)], fits=fits
    )


def drop_needless_effects(search: EffectSearch, watch: ProgressCallback) -> EffectSearch:
    """A search whose best fit has no effect without which the data are explained as well.

    "Stepwise" selection with backward elimination (Efroymson, in Ralston and Wilf (eds.), Mathematical Methods for
    Digital Computers, 1960, ch. 17): a fit of several effects may end better than those of fewer, because it started
    elsewhere.  Fits of fewer effects are therefore started from its best point, where the linearised model needs them
    no more.
    """
    for effect in sorted(effect_names(search.best)):
        if len(effect_names(search.best)) == 1:
            break
        before = search.best
        if before.secured_evidence - _evidence_without(search.problem, before, effect) > CRITERIA.ln_bayes_named:
            continue
        model = replace(before.model, effects={k: v for k, v in before.model.effects.items() if k != effect})
        candidates = search.problem.candidates
        try:
            fewer = refit_with_candidates(search.problem, search.data, replace(before, model=model), candidates, watch)
        except SolverFailure:  # a model that cannot be simulated must not cost what was found
            continue
        known = search.fits.get(effect_names(fewer), fewer)
        better = max(known, fewer, key=lambda f: f.secured_evidence)
        search = replace(search, fits=search.fits | {effect_names(fewer): better})
        if before.secured_evidence - fewer.secured_evidence <= CRITERIA.ln_bayes_named:
            search = replace(search, best=fewer)
    return search


def _evidence_without(problem: Problem, fit: LinearisedFit, effect: str) -> float:
    """ln evidence of the linearised model of a fit with all strengths of an effect held at their neutral values.

    What the fit pays for strengths larger than typical is kept, because an effect that is not needed pays nothing.
    """
    params, values = problem.case.known_effects[effect].params(), fit.model.effects[effect]
    held = {}
    for p in fit.effect_parameters:
        if p.effect == effect and (off := params[p.name].off) is not None:
            step = off - values[p.name]
            held[p] = (step, FIXED_STEP_SD * max(abs(step), FIXED_STEP_SD))
    others = {p: v for p, v in fit.free_effect_priors.items() if p.effect != effect}
    return fit.solve_with(problem, others | held).solution.ln_evidence - fit.width_price


def _solve_again(problem: Problem, data: WhitenedData, fit: LinearisedFit) -> LinearisedFit:
    """A fit at its point with the fixed columns of other data."""
    system = LinearSystem([data.update_block(b) for b in fit.blocks])
    found = maximise_evidence(problem, system, fit.model, fit.free_effect_priors)
    solution = replace(found.solution, ln_evidence=found.solution.ln_evidence - fit.width_price)
    return replace(fit, system=system, solution=solution, priors=found.priors, hyper=found.hyper)


def _fit_shortlist(search: EffectSearch, ranked: Sequence[CandidateScore], watch: ProgressCallback) -> EffectSearch:
    """Fit the candidates with the best scores in full, and the best pair if it scores far better than each alone."""
    groups: list[tuple[CandidateEffect, ...]] = [(s.candidate,) for s in shortlist_candidates(ranked)]
    # with an effect accepted, every single candidate makes a pair with it
    if not effect_names(search.best):
        groups += [tuple(s.candidate for s in p.scores) for p in _promising_pairs(search, ranked)]
    if not groups:
        return search
    wanted = {frozenset({*effect_names(search.best), *(c.effect for c in g)}): g for g in groups}
    wanted = {names: g for names, g in wanted.items() if names not in search.fits}
    if not wanted:
        return search
    words = f"fitting {', '.join(' with '.join(c.effect for c in g) for g in wanted.values())}"
    watch(ProgressMessage(words, **describe_search(search), fitting=[sorted(names) for names in wanted]))
    fittings = {
        names: fit_hypothesis(Hypothesis.from_parent(search.problem, search.data, search.best, g))
        for names, g in wanted.items()
    }
    outcome = run_fits(search.problem, fittings, watch)
    fits = {names: f for names, f in outcome.fits.items() if has_active_effects(search.problem, f)}
    vanished = search.vanished | (outcome.fits.keys() - fits.keys())
    return replace(search, fits=search.fits | fits, unfitted=search.unfitted | outcome.failed, vanished=vanished)


def describe_search(search: EffectSearch) -> dict[str, Any]:
    """How far a selection has got, as plain data: scores of all candidates, and full fits with their ln evidence.

    `ln_evidence_base` is that of the stated model; an ln Bayes factor is the difference to it.
    """
    scores = search.ranking[-1] if search.ranking else ()
    return {
        "candidates": [{"effect": s.effect, "score": s.ln_bayes, "reason": s.reason} for s in scores],
        "fits": [describe_fit(names, fit) for names, fit in search.fits.items() if names],
        "failed": [{"effects": sorted(names), "reason": reason} for names, reason in search.unfitted.items()],
        "ln_evidence_base": search.base.secured_evidence,
        "accepted": sorted(effect_names(search.best)),
    }


def shortlist_candidates(ranked: Sequence[CandidateScore]) -> list[CandidateScore]:
    """The candidates that are fitted in full: those above a hint that may reach the best one, at most three.

    `ranked` are scores, best first.
    """
    likely = [s for s in ranked if s.ln_bayes > CRITERIA.ln_bayes_hint]
    if not likely:
        return []
    lowest = lowest_score_within_reach(likely[0].ln_bayes)
    return [s for s in likely if s.ln_bayes > lowest][: int(CRITERIA.shortlist)]


def _promising_pairs(search: EffectSearch, ranked: Sequence[CandidateScore]) -> list[EffectPair]:
    """The best pair, if its score exceeds the best single score by the factor that another cause needs; else none."""
    if len(ranked) < 2:
        return []
    best = max((s.ln_bayes for s in ranked), default=0.0)
    found = score_pairs(search.problem, search.best, ranked)[:1]
    return [
        p for p in found if p.ln_bayes > max(best, 0.0) + CRITERIA.ln_bayes_named and p.more > CRITERIA.ln_bayes_named
    ]


def _best_extension(search: EffectSearch) -> LinearisedFit | None:
    """The extension with the largest evidence, if each new effect is worth `ln_bayes_named`; else None."""
    own = effect_names(search.best)
    # ranked after the price of each effect, so that two effects replace one only if both are worth it
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
    """Whether another cause has the same amplitude in all conditions and explains more than a smooth model discrepancy.

    If not, it only absorbs misfit that the effects accepted before leave.
    """
    problem = search.problem
    new = effect_names(fit) - effect_names(search.best)
    estimates = [e for effect in new for e in estimate_effect_by_condition(problem, fit, effect)]
    before, after = (f.evidence_at_max_discrepancy(problem, f.effect_priors) for f in (search.best, fit))
    is_same_amplitude = all(e.probability > CRITERIA.condition_scatter for e in estimates)
    return is_same_amplitude and after - before > CRITERIA.ln_bayes_named


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
    """Whether every effect of a fit still acts: none ended with all its strengths at their neutral values."""
    for name, values in fit.model.effects.items():
        params = problem.case.known_effects[name].params()
        if all(values[k] == p.off for k, p in params.items() if k in values and p.off is not None):
            return False
    return True
