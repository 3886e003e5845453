"""From a campaign to a verdict: `discover` corrects recordings, calibrates, selects effects and judges.

The kind of the verdict is decided by `decision.decide` alone; `collect_evidence` computes all numbers that it compares.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from flashtemp.comparison.campaign import Campaign
from flashtemp.discovery.assessment import (
    InputAssessment,
    ModelAssessment,
    assess_inputs,
    assess_model,
    size_of_change,
)
from flashtemp.discovery.criteria import CRITERIA
from flashtemp.discovery.decision import AlternativeCause, VerdictEvidence, decide
from flashtemp.discovery.diagnostics import verdict_sentences
from flashtemp.discovery.diagnostics.adequacy_tests import run_adequacy_tests
from flashtemp.discovery.diagnostics.effect_size import LargestChange
from flashtemp.discovery.diagnostics.extended_case import write_extended_case
from flashtemp.discovery.diagnostics.mesh_resolution import mesh_resolution_warnings
from flashtemp.discovery.diagnostics.setup_errors import SetupError, find_setup_errors
from flashtemp.discovery.diagnostics.stated_inputs import list_stated_inputs
from flashtemp.discovery.estimation.fitting import Hypothesis, ProgressCallback
from flashtemp.discovery.estimation.image_alignment import Linearisation
from flashtemp.discovery.estimation.linear_gaussian import LinearSystem
from flashtemp.discovery.estimation.linearised_fit import FitStatus, LinearisedFit
from flashtemp.discovery.estimation.nuisance_priors import NUISANCE_SD, all_derivatives
from flashtemp.discovery.estimation.outlier_rejection import reject_outliers
from flashtemp.discovery.estimation.whitening import WhitenedData
from flashtemp.discovery.hypotheses.candidates import ModelPoint
from flashtemp.discovery.input_alternatives import find_input_alternatives, free_input
from flashtemp.discovery.law_identification import IdentifiedLaw, excess_left, identify_law
from flashtemp.discovery.measurement_errors.initial_registration import register_images
from flashtemp.discovery.measurement_errors.recording_errors import (
    RecordingError,
    correct_recordings,
    find_misassigned_recordings,
    find_recording_errors,
)
from flashtemp.discovery.parameters import ParameterKind
from flashtemp.discovery.prediction.mesh_extrapolation import coarser_mesh_factors
from flashtemp.discovery.prediction.prediction import DerivativeRequest, Prediction, predict_again, predict_condition
from flashtemp.discovery.prediction.problem import Problem, prepare_problem
from flashtemp.discovery.selection.forward_selection import (
    EffectSearch,
    describe_search,
    effect_names,
    find_unjudged_effects,
    finish_fit,
    refit_with_candidates,
    select_effects,
)
from flashtemp.discovery.verdict import Verdict
from flashtemp.discovery.verdict_assembly import assemble_verdict
from flashtemp.display import ProgressMessage
from flashtemp.errors import SolverFailure
from flashtemp.runs.results.worker_pool import open_worker_pool

# typical fraction of the total work done when a stage begins, by the first word of its progress message
STAGE_START_FRACTIONS = {
    "calibrating": 0.3, "sensitivities": 0.4, "fitting": 0.55, "judging": 0.85, "checking": 0.9, "identifying": 0.25,
}  # fmt: skip


def discover(
    campaign: Campaign,
    watch: ProgressCallback = lambda text: None,
    workers: int | None = None,
    scheduler: str | None = None,
) -> tuple[Verdict, EffectSearch]:
    """Run a whole discovery; return the verdict and the search that led to it.

    `watch` receives progress messages; `workers` and `scheduler` select where simulations run.
    Raises BadInput, SolverFailure.
    """
    began, watch = time.monotonic(), _with_time_left(watch)
    with open_worker_pool(predict_condition, workers, scheduler) as run:
        problem = prepare_problem(campaign, run)
        list_stated_inputs(problem)  # refuses a key of `known` that is no input, before anything is computed
        problem, errors, first = correct_measurements(problem, watch)
        problem, data, base = calibrate_base(problem, first, watch)
        search = select_with_inputs(problem, data, base, watch)
        search = replace(search, recording_errors=errors)
        watch(ProgressMessage("judging", **describe_search(search)))
        verdict = judge_search(search, watch)
        if verdict.kind == "unexplained":
            verdict, search = judge_with_law(verdict, search, watch)
    return replace(verdict, seconds=time.monotonic() - began), search


def correct_measurements(
    problem: Problem, watch: ProgressCallback
) -> tuple[Problem, tuple[RecordingError, ...], list[Prediction]]:
    """Correct recordings that are not what they are stated to be, and register images that are far off.

    Returns the corrected problem, the errors, and predictions of the stated model with derivatives for all nuisances.
    Raises BadInput, SolverFailure.
    """
    impossible = find_misassigned_recordings(problem)
    problem = correct_recordings(problem, impossible) if impossible else problem
    watch("simulating the stated model")
    first = _predict_stated_model(problem)
    problem = reject_outliers(problem, first, lines_only=True)
    misfiled = find_recording_errors(problem, first)
    if misfiled:
        problem = correct_recordings(problem, misfiled)
        first = _predict_stated_model(problem)
    registered = register_images(problem, first)
    if registered is not problem:
        problem, first = registered, _predict_stated_model(registered)
    return problem, (*impossible, *misfiled), first


def _predict_stated_model(problem: Problem) -> list[Prediction]:
    return problem.predict(problem.make_tasks(problem.stated_model, replace(all_derivatives(problem), fields=True)))


def calibrate_base(
    problem: Problem, first: list[Prediction], watch: ProgressCallback
) -> tuple[Problem, WhitenedData, LinearisedFit]:
    """Fit the stated model without further effects; the fit has sensitivities of all candidates.

    Raises BadInput, SolverFailure.
    """
    problem = reject_outliers(problem, first)
    watch("simulating coarser meshes")
    coarser = predict_coarser_meshes(problem)
    data = WhitenedData.from_predictions(problem, first, coarser)
    for warning in mesh_resolution_warnings(data, first):
        watch(warning)
    tasks = problem.make_tasks(problem.stated_model, replace(all_derivatives(problem), fields=True))
    start = Linearisation(problem.stated_model, tuple(tasks), tuple(first), LinearSystem(data.make_blocks(first)))
    watch("calibrating the stated model")
    base = finish_fit(Hypothesis(problem, data, problem.stated_model), start, watch)
    base = refit_opposite_sizes(problem, data, base, watch)
    factors = (None, *coarser_mesh_factors(problem.case))
    meshes = [_place_images(problem, run, f, base.model) for f, run in zip(factors, (first, *coarser), strict=True)]
    data = data.with_image_errors_of(base.predictions, meshes)
    names = [c.effect for c in problem.candidates]
    watch(ProgressMessage(f"sensitivities of {len(names)} candidates", candidates=[{"effect": n} for n in names]))
    return problem, data, refit_with_candidates(problem, data, base, problem.candidates, watch)


def refit_opposite_sizes(
    problem: Problem, data: WhitenedData, base: LinearisedFit, watch: ProgressCallback
) -> LinearisedFit:
    """The better of a calibrated fit and of one that starts on the other side of the stated size of the block.

    The second fit is made where a size differs from the stated one by more than its usual error.  Edges guide a fit
    from within a pixel or so only: from farther away it may end with a block that is too short where it is too long,
    and with errors of the camera that stand for the difference (multistart).
    """
    sizes = {
        p: base.model.setup_value(p) + base.solution[p] for p in base.solution.names if p.kind is ParameterKind.SIZE
    }
    far = {p: v for p, v in sizes.items() if abs(v) > NUISANCE_SD[ParameterKind.SIZE]}
    if not far:
        return base
    model = problem.stated_model
    for p, value in far.items():
        model = model.with_step(p, -value)
    try:
        other = finish_fit(Hypothesis(problem, data, model), None, watch)
    except SolverFailure:
        return base
    return other if other.is_comparable and other.secured_evidence > base.secured_evidence else base


def select_with_inputs(
    problem: Problem, data: WhitenedData, base: LinearisedFit, watch: ProgressCallback
) -> EffectSearch:
    """Select effects; where a stated input explains the data better than what was selected, estimate it and select
    again.

    Raises BadInput, SolverFailure.
    """
    while True:
        search = select_effects(problem, data, base, watch)
        alternatives = find_input_alternatives(search, watch)
        search = replace(search, input_alternatives=alternatives)
        best = min(alternatives, key=lambda a: a.deficit_against(search.best), default=None)
        if best is None or not best.is_key or best.deficit_against(search.best) > -CRITERIA.ln_bayes_distinct:
            return search
        problem = free_input(problem, best.key, best.prior_sd)
        problem, data, base = calibrate_base(problem, _predict_stated_model(problem), watch)


def judge_with_law(verdict: Verdict, search: EffectSearch, watch: ProgressCallback) -> tuple[Verdict, EffectSearch]:
    """Try to identify a law outside the catalogue after an unexplained verdict.

    If the law predicts left-out data, the verdict becomes `learned`; else it is unchanged and the law is only a hint.
    """
    try:
        law = identify_law(search, watch)
    except SolverFailure:  # a law that cannot be simulated must not cost the verdict reached so far
        return verdict, search
    if law is None:
        return verdict, search
    judged = judge_search(law.search, watch, law)
    if judged.kind == "learned":
        verdict, search = judged, law.search
    else:
        verdict = replace(verdict, rules=(*verdict.rules, *judged.rules))
    verdict = replace(verdict, law=law.to_report())
    return replace(verdict, says=verdict_sentences.describe_verdict(verdict, search.problem.case.known_effects)), search


def _place_images(
    problem: Problem, predictions: list[Prediction], cell_factors: tuple[float, ...] | None, seen: ModelPoint
) -> list[Prediction]:
    """Predictions of the stated model on one of the meshes, with all images where they lie in the model `seen`.

    The mesh error depends on the distance from the contact, hence on the place and rotation of an image.
    """
    stated, placements = problem.stated_model, {}
    for file, place in seen.placements.items():  # the fields serve the stated clocks
        placements[file] = replace(place, clock=stated.image_placement(file).clock)
    model, out = replace(stated, shifts=seen.shifts, placements=placements), []
    tasks = problem.make_tasks(stated, DerivativeRequest(), cell_factors)
    for task, prediction in zip(tasks, predictions, strict=True):
        run = prediction.full_run
        assert run is not None
        images = [v for v in task.views if v.recording.places is None]
        moved = {v.file: predict_again(task, run, v, model, with_columns=False) for v in images}
        out.append(replace(prediction, observables=prediction.observables | moved))
    return out


def predict_coarser_meshes(problem: Problem) -> list[list[Prediction]]:
    """Predictions of the stated model on each of the coarser meshes with their fields, simulated in one batch."""
    tasks = [
        task
        for c in coarser_mesh_factors(problem.case)
        for task in problem.make_tasks(problem.stated_model, DerivativeRequest(fields=True, stated_clocks=True), c)
    ]
    answers, count = problem.predict(tasks), len(problem.conditions)
    return [answers[k : k + count] for k in range(0, len(answers), count)]


def _with_time_left(watch: ProgressCallback) -> Callable[[str], Any]:
    """A progress callback that adds the elapsed time and, from the first known stage on, an estimate of the rest.

    Each stage sets the estimate when it occurs first.  Between them, and in repeated stages, it only falls.
    """
    began, reached, stage_time, stage_left = time.monotonic(), 0.0, 0.0, 0.0
    begun_stages: set[str] = set()

    def say_with_time(text: str) -> None:
        nonlocal reached, stage_time, stage_left
        gone = time.monotonic() - began
        word = text.split()[0]
        if word in STAGE_START_FRACTIONS and word not in begun_stages:
            begun_stages.add(word)
            reached, stage_time = STAGE_START_FRACTIONS[word], gone
            stage_left = gone * (1.0 / reached - 1.0)
        since = gone - stage_time
        # falls second by second at first, and never reaches 0: how often stages will be repeated is not known
        left = stage_left**2 / (stage_left + since) if since else stage_left
        done = gone / (gone + left) if since else reached
        words = f"{text} ({gone:.0f} s{f', about {left:.0f} s left' if reached else ''})"
        about = {
            "stage": text.strip(),
            "fraction_done": done if reached else None,
            "left_s": left if reached else None,
        }
        watch(ProgressMessage(words, **getattr(text, "details", {}), **about))

    return say_with_time


def write_extended(search: EffectSearch, verdict: Verdict, folder: Path) -> None:
    """Write extended.toml with the accepted causes, or with the best hint if there are none."""
    final = search.best if effect_names(search.best) else find_best_hint(search) or search.best
    write_extended_case(search.problem, final, verdict, folder)


# --- judging -------------------------------------------------------------------------------------------------


def judge_search(search: EffectSearch, watch: ProgressCallback, law: IdentifiedLaw | None = None) -> Verdict:
    """The verdict on a finished search; with `law`, the verdict on a search that ended with that law."""
    problem = search.problem
    hint = None if effect_names(search.best) else find_best_hint(search)
    final = hint or search.best
    base = assess_model(search, search.base)
    extended = assess_model(search, final) if effect_names(final) else base
    change = size_of_change(search, base, extended) if effect_names(final) else None
    inputs = assess_inputs(search, final, watch)
    setup = find_setup_errors(problem, search.data, final, inputs.system, [c.input for c in inputs.checks], CRITERIA)
    evidence = collect_evidence(search, final, base, extended, change, setup, inputs, hint is not None)
    if law is not None:
        evidence = replace(evidence, learned_law=law.law.description, law_excess_left=excess_left(search))
    return assemble_verdict(search, final, base, extended, change, setup, inputs, decide(evidence))


def find_best_hint(search: EffectSearch) -> LinearisedFit | None:
    """The fit of the best single effect, if its ln Bayes factor reaches that of a hint; else None."""
    single = [f for names, f in search.fits.items() if len(names) == 1 and f.is_comparable]
    best = max(single, key=lambda f: f.secured_evidence, default=None)
    if best is None or best.secured_evidence - search.base.secured_evidence < CRITERIA.ln_bayes_hint:
        return None
    return best


def collect_evidence(
    search: EffectSearch,
    final: LinearisedFit,
    base: ModelAssessment,
    extended: ModelAssessment,
    change: LargestChange | None,
    setup: tuple[SetupError, ...],
    inputs: InputAssessment,
    is_hint: bool,
) -> VerdictEvidence:
    """Compute all numbers from which `decide` derives the verdict."""
    problem, names = search.problem, effect_names(final)
    free = {p: v for p, v in final.effect_priors.items() if p not in final.bound}
    ln_bayes_discrepancy = (
        final.evidence_at_max_discrepancy(problem, free) - search.base.evidence_at_max_discrepancy(problem, {})
        if names
        else 0.0
    )
    gain = float(extended.left_out.density.sum() - base.left_out.density.sum())
    has_left_out = len(base.left_out.density) > 1 or base.left_out.is_held_out
    unusual = [e for e in setup if e.is_unusual(CRITERIA)]
    return VerdictEvidence(
        is_converged=final.is_comparable and search.base.status is not FitStatus.FAILED,
        base_certainly_misfits=search.base.chi2 > CRITERIA.certain_misfit_chi2 * search.base.solution.count,
        causes=tuple(sorted(names)),
        is_hint=is_hint,
        ln_bayes=final.secured_evidence - search.base.secured_evidence,
        ln_bayes_discrepancy=ln_bayes_discrepancy,
        heldout_gain=gain if names and has_left_out else None,
        size=change.size if change else None,
        alternatives=_find_alternatives(search, final) if not is_hint else (),
        unresolved=_unresolved_effects(search, final),
        adequacy=run_adequacy_tests(problem, final, CRITERIA),
        setup_errors=tuple(e.name for e in unusual if not e.is_input),
        recording_errors=tuple(str(e.kind) for e in search.recording_errors),
        contradicted_input=next((e.name for e in unusual if e.is_input), ""),
        setup_alternatives=tuple(dict.fromkeys(name for e in unusual[:1] for name, _ in e.alternatives)),
    )


def _find_alternatives(search: EffectSearch, final: LinearisedFit) -> tuple[AlternativeCause, ...]:
    """Fits with as many effects as the final one, of which one differs, and stated inputs; the best first."""
    own, out = effect_names(final), []
    for names, fit in search.fits.items():
        if len(names) == len(own) and len(names - own) == 1:
            out.append(AlternativeCause(names, final.ln_evidence - fit.ln_evidence, fit.is_comparable))
    out += [AlternativeCause(a.cause_names, a.deficit_against(final)) for a in search.input_alternatives]
    return tuple(sorted(out, key=lambda a: a.deficit))


def _unresolved_effects(search: EffectSearch, final: LinearisedFit) -> dict[str, float]:
    """Models that may explain more than the final one but have no completed fit, in words, with ln Bayes factors.

    Models that only add effects to the final one are left out, because they do not question its effects.
    """
    own = effect_names(final)
    return {
        " with ".join(sorted(n)): gain
        for n, gain in find_unjudged_effects(search, final).items()
        if not (own and n > own)
    }
