"""From a campaign to a verdict: prepare, calibrate, select causes, judge.  Discovery starts here, in `discover`."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.comparison.campaign import Campaign
from flashtemp.discovery import experiment_design
from flashtemp.discovery.criteria import CRITERIA
from flashtemp.discovery.decision import AlternativeCause, Decision, VerdictEvidence, VerdictRule, decide
from flashtemp.discovery.diagnostics import fit_report, missing_heat, verdict_sentences
from flashtemp.discovery.diagnostics.adequacy_tests import run_adequacy_tests, simulate_structure_tests
from flashtemp.discovery.diagnostics.camera_error_sizes import camera_error_warnings
from flashtemp.discovery.diagnostics.cross_validation import (
    CrossValidation,
    cross_validate,
    rms_change_error,
    without_flexible_terms,
)
from flashtemp.discovery.diagnostics.effect_size import (
    LargestChange,
    camera_fraction,
    change_per_unit,
    largest_change,
)
from flashtemp.discovery.diagnostics.extended_case import write_extended_case
from flashtemp.discovery.diagnostics.input_checks import FIXED_INPUT_SD_FRACTION, InputCheck, check_inputs, group_inputs
from flashtemp.discovery.diagnostics.input_columns import add_input_columns, merge_columns
from flashtemp.discovery.diagnostics.mesh_resolution import lateral_resolution_warnings, unconverged_fit_warnings
from flashtemp.discovery.diagnostics.setup_errors import SetupError, find_setup_errors
from flashtemp.discovery.diagnostics.stated_inputs import StatedInput, list_stated_inputs
from flashtemp.discovery.estimation.fitting import Hypothesis, ProgressCallback
from flashtemp.discovery.estimation.image_alignment import Linearisation
from flashtemp.discovery.estimation.linear_gaussian import LinearSystem
from flashtemp.discovery.estimation.linearised_fit import FitStatus, LinearisedFit
from flashtemp.discovery.estimation.nuisance_priors import all_derivatives
from flashtemp.discovery.estimation.outlier_rejection import reject_outliers
from flashtemp.discovery.estimation.whitening import WhitenedData
from flashtemp.discovery.law_identification import IdentifiedLaw, heldout_excess, identify_law
from flashtemp.discovery.measurement_errors.initial_registration import register_images
from flashtemp.discovery.measurement_errors.recording_errors import (
    RecordingError,
    correct_recordings,
    find_recording_errors,
    find_schedule_errors,
)
from flashtemp.discovery.parameters import Kind
from flashtemp.discovery.prediction.prediction import DerivativeRequest, Prediction, predict_condition
from flashtemp.discovery.prediction.problem import Problem, prepare_problem
from flashtemp.discovery.selection.forward_selection import (
    EffectSearch,
    effect_names,
    finish_fit,
    refit_with_candidates,
    select_effects,
)
from flashtemp.discovery.selection.scores import compute_separability
from flashtemp.discovery.verdict import (
    Cause,
    FitMetrics,
    InputCorrection,
    InputResult,
    ParameterEstimate,
    RuleResult,
    SetupErrorReport,
    Verdict,
)
from flashtemp.errors import SolverFailure
from flashtemp.runs.results.worker_pool import open_worker_pool

# cells of runs that show what the mesh gets wrong: along, up and down, and across in 3D
COARSER_CELL_FACTORS = ((0.6, 1, 1), (1, 0.6, 1), (1, 1, 0.6), (0.5, 0.5, 0.5))
COARSER_ACROSS_FACTORS = (1, 1, 1, 0.5)
# fraction of all work that is done when a stage begins, as a rule, by the first word of what is said of it
STAGE_START_FRACTIONS = {"calibrating": 0.3, "sensitivities": 0.4, "fitting": 0.55, "judging": 0.85, "questioning": 0.9}
MAX_MATRIX_CANDIDATES = 20  # candidates in the separability matrix


@dataclass(frozen=True)
class ModelAssessment:
    """A fit, the same as people know the model, what each recording shows against it, and data left out, by each."""

    fit: LinearisedFit
    known: LinearisedFit
    recording_comparisons: tuple[Any, ...]
    force_comparisons: tuple[Any, ...]
    left_out: CrossValidation
    known_left_out: CrossValidation
    metrics: FitMetrics


def discover(
    campaign: Campaign,
    watch: ProgressCallback = lambda text: None,
    workers: int | None = None,
    scheduler: str | None = None,
) -> tuple[Verdict, EffectSearch]:
    """Everything: calibrate, select, judge.  Raises BadInput, SolverFailure."""
    began, watch = time.monotonic(), _with_time_left(watch)
    with open_worker_pool(predict_condition, workers, scheduler) as run:
        problem = prepare_problem(campaign, run)
        problem, errors, first = correct_measurements(problem, watch)
        problem, data, base = calibrate_base(problem, first, watch)
        search = replace(select_effects(problem, data, base, watch), recording_errors=errors)
        watch("judging")
        verdict = judge_search(search, watch)
        if verdict.kind == "unexplained":
            verdict, search = judge_with_law(verdict, search, watch)
    return replace(verdict, seconds=time.monotonic() - began), search


def correct_measurements(
    problem: Problem, watch: ProgressCallback
) -> tuple[Problem, tuple[RecordingError, ...], list[Prediction]]:
    """Recordings that are not what they are stated to be corrected, images that lie far off registered; and predictions
    of the stated model with all nuisances.  Raises BadInput, SolverFailure."""
    impossible = find_schedule_errors(problem)
    problem = correct_recordings(problem, impossible) if impossible else problem
    watch("simulating the stated model")
    first = _predict_stated_model(problem)
    found = find_recording_errors(problem, first)
    if found:
        problem = correct_recordings(problem, found)
        first = _predict_stated_model(problem)
    registered = register_images(problem, first)
    if registered is not problem:
        problem, first = registered, _predict_stated_model(registered)
    return problem, (*impossible, *found), first


def _predict_stated_model(problem: Problem) -> list[Prediction]:
    return problem.predict(problem.make_tasks(problem.stated_model, replace(all_derivatives(problem), fields=True)))


def calibrate_base(
    problem: Problem, first: list[Prediction], watch: ProgressCallback
) -> tuple[Problem, WhitenedData, LinearisedFit]:
    """The stated model at its best point, with sensitivities of all candidates.  Raises BadInput, SolverFailure."""
    problem = reject_outliers(problem, first)
    watch("simulating coarser meshes")
    data = WhitenedData.from_predictions(problem, first, predict_coarser_meshes(problem))
    for warning in lateral_resolution_warnings(data, first, len(COARSER_CELL_FACTORS)):
        watch(warning)
    tasks = problem.make_tasks(problem.stated_model, replace(all_derivatives(problem), fields=True))
    start = Linearisation(problem.stated_model, tuple(tasks), tuple(first), LinearSystem(data.make_blocks(first)))
    watch("calibrating the stated model")
    base = finish_fit(Hypothesis(problem, data, problem.stated_model), start, watch)
    watch(f"sensitivities of {len(problem.candidates)} candidates")
    return problem, data, refit_with_candidates(problem, data, base, problem.candidates, watch)


def judge_with_law(verdict: Verdict, search: EffectSearch, watch: ProgressCallback) -> tuple[Verdict, EffectSearch]:
    """The verdict on a law outside the catalogue, if one explains what no effect does and predicts; else the verdict as
    it was, with the law as a hint."""
    try:
        found = identify_law(search, watch)
    except SolverFailure:  # a law that cannot be followed is none; what is known already is not lost
        return verdict, search
    if found is None:
        return verdict, search
    judged = judge_search(found.search, watch, found)
    if judged.kind == "learned":
        verdict, search = judged, found.search
    else:
        verdict = replace(verdict, rules=(*verdict.rules, *judged.rules))
    verdict = replace(verdict, law=found.to_report())
    return replace(verdict, says=verdict_sentences.describe_verdict(verdict, search.problem.case.known_effects)), search


def predict_coarser_meshes(problem: Problem) -> list[list[Prediction]]:
    """Predictions of the stated model on coarser meshes, all tasks at once for all workers."""
    cells = (
        (*COARSER_CELL_FACTORS, COARSER_ACROSS_FACTORS) if problem.case["numerics.across"] > 1 else COARSER_CELL_FACTORS
    )
    tasks = [task for c in cells for task in problem.make_tasks(problem.stated_model, DerivativeRequest(), c)]
    answers, count = problem.predict(tasks), len(problem.conditions)
    return [answers[k : k + count] for k in range(0, len(answers), count)]


def _with_time_left(watch: ProgressCallback) -> Callable[[str], Any]:
    """The same with the time gone and, once everything was simulated, an estimate of the time left."""
    began, done = time.monotonic(), 0.0

    def say_with_time(text: str) -> None:
        nonlocal done
        gone = time.monotonic() - began
        stage = STAGE_START_FRACTIONS.get(text.split()[0], 0.0)
        if stage:  # a stage that comes again takes half of what was left
            done = stage if stage > done else 0.5 * (1.0 + done)
        left = gone * (1.0 / done - 1.0) if done else 0.0
        watch(f"{text} ({gone:.0f} s{f', about {left:.0f} s left' if done else ''})")

    return say_with_time


def write_extended(search: EffectSearch, verdict: Verdict, folder: Path) -> None:
    """extended.toml of the accepted causes, or of the best hint."""
    final = search.best if effect_names(search.best) else find_best_hint(search) or search.best
    write_extended_case(search.problem, final, verdict, folder)


# --- judging -------------------------------------------------------------------------------------------------
def assess_model(search: EffectSearch, fit: LinearisedFit) -> ModelAssessment:
    """Everything that is asked of the base model and of the extended one alike."""
    known = without_flexible_terms(fit)
    seeings, pullings = fit_report.compare_all_recordings(search, known)
    left_out, known_left_out = (cross_validate(search.data, f) for f in (fit, known))
    metrics = fit_report.summary_metrics(known, seeings, known_left_out)
    return ModelAssessment(fit, known, seeings, pullings, left_out, known_left_out, metrics)


def judge_search(search: EffectSearch, watch: ProgressCallback, law: IdentifiedLaw | None = None) -> Verdict:
    """What a search amounts to; of a search that ends with a `law`, whether that is learned."""
    problem = search.problem
    hint = None if effect_names(search.best) else find_best_hint(search)
    final = hint or search.best
    base = assess_model(search, search.base)
    extended = assess_model(search, final) if effect_names(final) else base
    change = size_of_change(search, base, extended) if effect_names(final) else None
    inputs = question_inputs(search, final, watch)
    setup = find_setup_errors(problem, search.data, final, inputs.system, [c.input for c in inputs.checks], CRITERIA)
    evidence = collect_evidence(search, final, base, extended, change, setup, inputs, hint is not None)
    if law is not None:
        before, after = heldout_excess(search)
        left = max(after, 0.0) / max(before, 1e-300) if before > 0.0 else 1.0
        evidence = replace(evidence, learned_law=law.law.description, law_excess_left=left)
    return assemble_verdict(search, final, base, extended, change, setup, inputs, decide(evidence))


def size_of_change(search: EffectSearch, base: ModelAssessment, extended: ModelAssessment) -> LargestChange:
    """What the extended model changes of the recordings."""
    found = largest_change(
        search.data,
        base.recording_comparisons,
        extended.recording_comparisons,
        base.force_comparisons,
        extended.force_comparisons,
    )
    own = camera_fraction(search.data, search.base, extended.fit, search.problem.candidates)
    return replace(found, size=replace(found.size, camera_fraction=own))


def find_best_hint(search: EffectSearch) -> LinearisedFit | None:
    """The best single effect where it is more than chance but less than accepted."""
    single = [f for names, f in search.fits.items() if len(names) == 1 and f.is_comparable]
    best = max(single, key=lambda f: f.secured_evidence, default=None)
    if best is None or best.secured_evidence - search.base.secured_evidence < CRITERIA.ln_bayes_hint:
        return None
    return best


@dataclass(frozen=True)
class InputAssessment:
    """Every stated number against the data, and groups of keys that the data cannot tell from each other."""

    checks: tuple[InputCheck, ...]
    groups: tuple[tuple[str, ...], ...]
    system: LinearSystem


def question_inputs(search: EffectSearch, final: LinearisedFit, watch: ProgressCallback) -> InputAssessment:
    """Every stated number of case and set-up against the data, at the final fit.

    Columns of a coarse mesh do for most.  Of what next to nothing depends on they may be made by the mesh alone, so
    that inputs which data contradict are asked again with columns of the mesh that data are compared with.
    """
    problem = search.problem
    inputs = list_stated_inputs(problem)
    watch(f"questioning {len(inputs)} stated inputs")
    bare = [replace(p, observables={k: replace(o, columns={}) for k, o in p.observables.items()})
            for p in final.predictions]  # fmt: skip
    shown = add_input_columns(problem, final.model, bare, inputs)
    found = _questioned(search, final, inputs, shown)
    doubtful = [c.input for c in found.checks if c.is_contradicted]
    if not doubtful:
        return found
    exact = add_input_columns(problem, final.model, bare, doubtful, None)
    return _questioned(search, final, inputs, list(map(merge_columns, exact, shown)))


def _questioned(
    search: EffectSearch, final: LinearisedFit, inputs: Sequence[StatedInput], shown: Sequence[Prediction]
) -> InputAssessment:
    """Inputs against the data by predictions at the final fit with their columns."""
    blocks = search.data.make_blocks(shown)
    blocks = [b.with_columns_of(o, lambda p: p.kind is not Kind.EFFECT or p in final.effect_priors)
              for b, o in zip(blocks, final.blocks, strict=True)]  # fmt: skip
    system = LinearSystem(blocks)
    equations = system.normal_equations(variances=final.hyper.variances)
    changes = partial(change_per_unit, search.data, final.predictions, system)
    checks = check_inputs(system, final.free_priors, equations, inputs, changes)
    groups = group_inputs(system, final.free_priors, equations, inputs)
    return InputAssessment(checks, tuple(tuple(i.key for i in g) for g in groups), system)


def collect_evidence(
    search: EffectSearch, final: LinearisedFit, base: ModelAssessment, extended: ModelAssessment, change: LargestChange | None,
    setup: tuple[SetupError, ...], inputs: InputAssessment, is_hint: bool,
) -> VerdictEvidence:  # fmt: skip
    """All numbers that the verdict rests on."""
    problem, names = search.problem, effect_names(final)
    free = {p: v for p, v in final.effect_priors.items() if p not in final.bound}
    beyond = (
        final.evidence_at_max_discrepancy(problem, free) - search.base.evidence_at_max_discrepancy(problem, {})
        if names
        else 0.0
    )
    gain = float(extended.left_out.density.sum() - base.left_out.density.sum())
    several = len(base.left_out.density) > 1 or base.left_out.is_held_out
    unusual = [e for e in setup if e.is_unusual(CRITERIA)]
    return VerdictEvidence(
        is_converged=final.is_comparable and search.base.status is not FitStatus.FAILED,
        base_certainly_misfits=search.base.chi2 > CRITERIA.certain_misfit_chi2 * search.base.solution.count,
        causes=tuple(sorted(names)),
        is_hint=is_hint,
        ln_bayes=final.secured_evidence - search.base.secured_evidence,
        ln_bayes_discrepancy=beyond,
        heldout_gain=gain if names and several else None,
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
    """Fits with as many effects of which one is another."""
    own, out = effect_names(final), []
    for names, fit in search.fits.items():
        if len(names) == len(own) and len(names - own) == 1:
            out.append(AlternativeCause(names, final.ln_evidence - fit.ln_evidence, fit.is_comparable))
    return tuple(sorted(out, key=lambda a: a.deficit))


def _unresolved_effects(search: EffectSearch, final: LinearisedFit) -> dict[str, float]:
    """Effects that are asked for in place of the final model's and were not judged; what lies beside them changes
    nothing of what was found."""
    own = effect_names(final)
    return {
        " with ".join(sorted(n)): gain for n, gain in _unjudged_effects(search, final).items() if not (own and n > own)
    }


def _unjudged_effects(search: EffectSearch, final: LinearisedFit) -> dict[frozenset[str], float]:
    """Effects whose fits did not end and yet explain more than the final one, by how much; and those not simulated."""
    out = {}
    for names, fit in search.fits.items():
        gain = fit.secured_evidence - final.secured_evidence
        if not fit.is_comparable and fit.status is not FitStatus.OUTRUN and gain > CRITERIA.ln_bayes_distinct:
            out[names] = gain
    return out | {names: CRITERIA.ln_bayes_named for names in search.unfitted}


# --- the verdict for people -------------------------------------------------------------------------------------
def assemble_verdict(
    search: EffectSearch, final: LinearisedFit, base: ModelAssessment, extended: ModelAssessment, change: LargestChange | None,
    setup: tuple[SetupError, ...], inputs: InputAssessment, decision: Decision,
) -> Verdict:  # fmt: skip
    """The verdict with all that a report shows."""
    problem, kind = search.problem, decision.kind
    accepted = sorted(effect_names(search.best))
    shows_cause = bool(effect_names(final)) and kind in ("named", "group", "weak", "unexplained", "learned")
    if kind == "named" and not accepted:
        shows_cause = False
    gain = float(extended.left_out.density.sum() - base.left_out.density.sum())
    causes = (
        tuple(fit_report.describe_cause(search, final, e, gain) for e in final.model.effects) if shows_cause else ()
    )
    unusual = [e for e in setup if e.is_unusual(CRITERIA)]
    named_setup = [e for e in unusual if not e.is_input] if kind not in ("no_verdict", "unexplained") else []
    separable = compute_separability(search.base, problem.candidates)
    order = np.argsort(-separable.z)[:MAX_MATRIX_CANDIDATES]
    shown = extended if shows_cause else base
    verdict = Verdict(
        title=problem.campaign.title,
        kind=kind,
        says=(),
        causes=(*map(_recording_error_cause, search.recording_errors), *map(_setup_error_cause, named_setup), *causes),
        group=decision.group,
        next_experiment=_suggest_experiment(search, decision.group),
        base=base.metrics,
        extended=_with_change_errors(base, extended) if causes else None,
        rivals=fit_report.report_candidates(search, accepted),
        nuisance=fit_report.calibrated_parameters(search, final),
        tests=(*simulate_structure_tests(base.known, 1, "before"),
               *(simulate_structure_tests(extended.known, 2, "after") if causes else ())),
        missing=missing_heat.estimate_missing_heat(problem, search.base),
        separability=(tuple(separable.names[i] for i in order), separable.rho[np.ix_(order, order)]),
        shifts=_parameter_shifts(search, base.known, final) if causes else (),
        before=base.recording_comparisons,
        after=shown.recording_comparisons,
        pulled=(base.force_comparisons, shown.force_comparisons),
        gates={t.name: (t.value, t.limit) for t in run_adequacy_tests(problem, final, CRITERIA)},
        certificate=_convergence_record(search),
        assumed=fit_report.assumed_priors(problem),
        warnings=_collect_warnings(search, final),
        gain=_gain_record(change, base, extended) if causes else None,
        not_named=decision.reasons if kind in ("weak", "none_needed", "no_verdict") else (),
        certain=tuple(c.effect for c in causes if c.effect not in decision.group) if kind == "group" else (),
        laboratory=tuple(_setup_error_report(e) for e in setup if not e.is_unusual(CRITERIA)),
        held_key=_input_correction(problem, final, inputs, unusual) if kind in ("held_key", "group", "named") else None,
        rules=tuple(map(_rule_result, decision.rules)),
        inputs=tuple(map(_input_result, inputs.checks)),
        inputs_told_together=inputs.groups,
    )  # fmt: skip
    return replace(verdict, says=verdict_sentences.describe_verdict(verdict, problem.case.known_effects))


def _recording_error_cause(e: RecordingError) -> Cause:
    gain = float(np.clip(e.evidence.ln_bayes, 0.0, 1e6))  # of what cannot be as stated it is infinite
    return Cause(str(e.kind), e.words, (), 2.0 * gain, 0.0, 1.0, ln_bayes=gain, laboratory=True)


def _input_correction(
    problem: Problem, final: LinearisedFit, inputs: InputAssessment, unusual: list[SetupError]
) -> InputCorrection | None:
    """The stated input that explains what a cause would, the most certain first."""
    e = next((e for e in unusual if e.is_input), None)
    check = next((c for c in inputs.checks if e is not None and c.input.key == e.name), None)
    if e is None or check is None:
        return None
    i = check.input
    value = i.value * math.exp(e.value) if i.relative else i.value + e.value
    sd = value * e.stderr if i.relative else e.stderr
    # free keys follow an input that is corrected: what it had to explain before is taken from them
    fixed = final.free_priors | {e.parameter: (e.value, FIXED_INPUT_SD_FRACTION * i.sd)}
    solution = inputs.system.solve(fixed, inputs.system.normal_equations(variances=final.hyper.variances))
    calibrated = {
        p.name: problem.case[p.name] * math.exp(final.model.free[p.name] + solution[p]) for p in problem.free_keys
    }
    return InputCorrection(i.key, i.value, value, sd, i.unit, e.ln_bayes, e.words, calibrated)


def _setup_error_cause(e: SetupError) -> Cause:
    sd = fit_report.STDERR_INFLATION * e.stderr
    where = e.parameter.file or e.parameter.name
    ends = (e.value - 1.96 * sd, e.value + 1.96 * sd)
    estimate = ParameterEstimate(f"{e.name}.{where}", e.value, sd, ends, e.unit)
    return Cause(e.name, _setup_error_words(e), (estimate,), e.pull**2, 0.0, 1.0, ln_bayes=e.ln_bayes, laboratory=True)


def _setup_error_report(e: SetupError) -> SetupErrorReport:
    return SetupErrorReport(e.name, e.value, e.stderr, e.unit, e.pull, _setup_error_words(e))


def _setup_error_words(e: SetupError) -> str:
    return e.words + (f" (or {'; or '.join(w for _, w in e.alternatives)})" if e.alternatives else "")


def _input_result(c: InputCheck) -> InputResult:
    i = c.input
    return InputResult(
        i.key, i.words, i.value, i.unit, i.sd, i.relative, i.source, c.estimate, c.sd, c.pull, c.ln_bayes,
        str(c.verdict), c.summary_line,
    )  # fmt: skip


def _rule_result(r: VerdictRule) -> RuleResult:
    """A rule with a text that is true of how it ended."""
    found = RuleResult(**asdict(r))
    return replace(found, consequence=verdict_sentences.describe_success(found)) if r.passed else found


def _suggest_experiment(search: EffectSearch, group: tuple[str, ...]) -> str:
    if not group or not all(name in search.problem.case.known_effects for name in group):
        return ""
    fit = refit_with_candidates(search.problem, search.data, search.best, search.problem.candidates, lambda text: None)
    return experiment_design.suggest_experiment(search.problem, fit, group)


def _parameter_shifts(
    search: EffectSearch, base: LinearisedFit, final: LinearisedFit
) -> tuple[tuple[str, float, float, float], ...]:
    out = []
    for p in search.problem.free_keys:
        now = search.problem.case[p.name]
        before, after = (now * math.exp(f.model.free[p.name] + f.solution[p]) for f in (base, final))
        out.append((p.name, before, after, after * final.solution.sd(p)))
    return tuple(out)


def _convergence_record(search: EffectSearch) -> dict[str, Any]:
    return {
        "converged": search.best.is_comparable,
        "fits": {
            " + ".join(sorted(names)) or "base": {
                "status": f.status.value, "evaluations": f.evaluations, "promise": list(f.history),
            }
            for names, f in search.fits.items()
        },
    }  # fmt: skip


def _with_change_errors(base: ModelAssessment, extended: ModelAssessment) -> FitMetrics:
    """The metrics of an extended model with the standard errors of what changes from the base."""
    fitted = rms_change_error(*(fit_report.fitted_residuals(m.recording_comparisons) for m in (base, extended)))
    left_out = rms_change_error(base.known_left_out.residuals, extended.known_left_out.residuals)
    return replace(extended.metrics, rmse_change_error_K=fitted, held_out_z_change_error=left_out)


def _gain_record(
    change: LargestChange | None, base: ModelAssessment, extended: ModelAssessment
) -> dict[str, Any] | None:
    if change is None:
        return None
    size = change.size
    return {
        "file": change.file, "changed_K": size.change_K, "share": size.rise_fraction,
        "friction": size.friction_fraction, "numerics_K": size.mesh_error_K,
        "left_out_K": (base.left_out.rmse_K, extended.left_out.rmse_K),
    }  # fmt: skip


def _collect_warnings(search: EffectSearch, final: LinearisedFit) -> tuple[str, ...]:
    problem = search.problem
    out = [f"{file}: {found}" for file, found in problem.screening.items()]
    out += [verdict_sentences.describe_assumed_optics(*item) for item in problem.assumed_camera_facts.items()]
    out += camera_error_warnings(search.data, final)
    out += lateral_resolution_warnings(search.data, search.base.predictions, len(COARSER_CELL_FACTORS))
    out += unconverged_fit_warnings(search.fits, problem.case["numerics.mesh"])
    for label, variance in final.hyper.variances.items():
        if variance > (1.0 + 2.0 * CRITERIA.noise_sd_uncertainty) ** 2:
            out.append(
                f"{label}: the model leaves {math.sqrt(variance):.2g} times its noise; it counted for that much less"
            )
    own = effect_names(final)
    for names, gain in _unjudged_effects(search, final).items():
        if own and names > own:
            more = " and ".join(sorted(names - own))
            why = "could not be simulated" if names in search.unfitted else f"(ln Bayes factor {gain:.0f}) did not end"
            out.append(f"the fit of {more} beside it {why}")
    if len(problem.conditions) == 1:
        out.append("all data are of one condition: effects that differ in speed or load only cannot be told apart")
    return tuple(out)
