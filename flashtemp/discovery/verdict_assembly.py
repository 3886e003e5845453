"""The verdict with everything that a report shows, assembled from a decision and the fits behind it."""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from flashtemp.discovery import experiment_design
from flashtemp.discovery.assessment import InputAssessment, ModelAssessment
from flashtemp.discovery.criteria import CRITERIA
from flashtemp.discovery.decision import Decision, VerdictRule
from flashtemp.discovery.diagnostics import fit_report, missing_heat, verdict_sentences
from flashtemp.discovery.diagnostics.adequacy_tests import run_adequacy_tests, simulate_structure_tests
from flashtemp.discovery.diagnostics.cross_validation import rms_change_error
from flashtemp.discovery.diagnostics.effect_size import LargestChange
from flashtemp.discovery.diagnostics.friction_differences import find_friction_differences
from flashtemp.discovery.diagnostics.input_checks import FIXED_INPUT_SD_FRACTION, InputCheck
from flashtemp.discovery.diagnostics.mesh_resolution import mesh_resolution_warnings, unconverged_fit_warnings
from flashtemp.discovery.diagnostics.rule_sentences import describe_success
from flashtemp.discovery.diagnostics.setup_errors import SetupError
from flashtemp.discovery.estimation.linearised_fit import LinearisedFit
from flashtemp.discovery.measurement_errors.recording_errors import RecordingError
from flashtemp.discovery.parameters import ParameterId
from flashtemp.discovery.prediction.problem import Problem
from flashtemp.discovery.selection.forward_selection import (
    EffectSearch,
    effect_names,
    find_unjudged_effects,
    refit_with_candidates,
)
from flashtemp.discovery.selection.scores import compute_separability
from flashtemp.discovery.verdict import (
    CandidateReport,
    Cause,
    FitMetrics,
    InputCorrection,
    InputResult,
    ParameterEstimate,
    RuleResult,
    SetupErrorReport,
    Verdict,
)
from flashtemp.model.schema import refinement_factor

MAX_MATRIX_CANDIDATES = 20  # candidates in the separability matrix


def assemble_verdict(
    search: EffectSearch,
    final: LinearisedFit,
    base: ModelAssessment,
    extended: ModelAssessment,
    change: LargestChange | None,
    setup: tuple[SetupError, ...],
    inputs: InputAssessment,
    decision: Decision,
) -> Verdict:
    """The verdict with everything that a report shows."""
    problem, kind = search.problem, decision.kind
    accepted = sorted(effect_names(search.best))
    shown_kinds = ("group", "weak", "unexplained", "learned", *(("named",) if accepted else ()))
    shows_cause = bool(effect_names(final)) and kind in shown_kinds
    gain = float(extended.left_out.density.sum() - base.left_out.density.sum())
    causes = (
        tuple(fit_report.describe_cause(search, final, e, gain) for e in final.model.effects) if shows_cause else ()
    )
    rivals = fit_report.report_candidates(search, accepted)
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
        next_experiment=_suggest_experiment(search, decision.group, rivals),
        base=base.metrics,
        extended=_with_change_errors(base, extended) if causes else None,
        rivals=rivals,
        nuisance=fit_report.calibrated_parameters(search, final),
        tests=(*simulate_structure_tests(base.rigid, 1, "before"),
               *(simulate_structure_tests(extended.rigid, 2, "after") if causes else ())),
        missing=missing_heat.estimate_missing_heat(problem, search.base),
        separability=(tuple(separable.names[i] for i in order), separable.rho[np.ix_(order, order)]),
        shifts=_parameter_shifts(search, base.rigid, final) if causes else (),
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
        alternative_inputs=_alternative_inputs(search, inputs, decision.group),
        friction_differences=find_friction_differences(final),
    )  # fmt: skip
    return replace(verdict, says=verdict_sentences.describe_verdict(verdict, problem.case.known_effects))


def _alternative_inputs(
    search: EffectSearch, inputs: InputAssessment, group: tuple[str, ...]
) -> tuple[InputCorrection, ...]:
    """The stated inputs of a group with the values that they would need in place of an effect."""
    stated = {c.input.key: c.input for c in inputs.checks}
    return tuple(
        InputCorrection(a.key, i.value, a.value, a.stderr, i.unit, -a.deficit_against(search.best), i.words)
        for a in search.input_alternatives
        if a.key in group and (i := stated.get(a.key)) is not None
    )


def _recording_error_cause(e: RecordingError) -> Cause:
    gain = float(np.clip(e.evidence.ln_bayes, 0.0, 1e6))  # infinite for a recording that is impossible as stated
    return Cause(str(e.kind), e.words, (), 2.0 * gain, 0.0, 1.0, ln_bayes=gain, laboratory=True)


def _input_correction(
    problem: Problem, final: LinearisedFit, inputs: InputAssessment, unusual: list[SetupError]
) -> InputCorrection | None:
    """The most certain stated input that the data contradict, with its correction; None if there is none."""
    e = next((e for e in unusual if e.is_input), None)
    check = next((c for c in inputs.checks if e is not None and c.input.key == e.name), None)
    if e is None or check is None:
        return None
    i = check.input
    value, sd = i.changed_value(e.value, e.stderr)
    # the free keys are estimated again with the input corrected, because they absorbed a part of its error before
    freed = ParameterId.of_key(i.key)
    fixed = {p: v for p, v in final.free_priors.items() if p != freed}
    fixed[e.parameter] = (e.value - final.model.free.get(i.key, 0.0), FIXED_INPUT_SD_FRACTION * i.sd)
    solution = inputs.system.solve(fixed, inputs.system.normal_equations(variances=final.hyper.variances))
    calibrated = {
        p.name: problem.case[p.name] * math.exp(final.model.free[p.name] + solution[p])
        for p in problem.free_keys if p != freed
    }  # fmt: skip
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
    """A rule for the report, with the sentence that is true of its result."""
    result = RuleResult(**asdict(r))
    return replace(result, consequence=describe_success(result)) if r.passed else result


def _suggest_experiment(search: EffectSearch, group: tuple[str, ...], rivals: tuple[CandidateReport, ...]) -> str:
    """The experiment that distinguishes the effects of a group, by the amplitudes that they need; else empty."""
    if not group or not all(name in search.problem.case.known_effects for name in group):
        return ""
    members = [c for c in search.problem.candidates if c.effect in group]
    fit = refit_with_candidates(search.problem, search.data, search.best, members, lambda text: None)
    neutral = {c.effect: c.params[c.leading_strength[0]].off or 0.0 for c in members}
    strengths = {r.effect: r.amplitude - neutral[r.effect] for r in rivals if r.effect in neutral}
    return experiment_design.suggest_experiment(search.problem, fit, group, strengths)


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
    """The metrics of an extended model with the standard errors of their changes against the base."""
    fitted = rms_change_error(*(fit_report.fitted_residuals(m.recording_comparisons) for m in (base, extended)))
    left_out = rms_change_error(base.rigid_left_out.residuals, extended.rigid_left_out.residuals)
    return replace(extended.metrics, rmse_change_error_K=fitted, held_out_z_change_error=left_out)


def _gain_record(
    change: LargestChange | None, base: ModelAssessment, extended: ModelAssessment
) -> dict[str, Any] | None:
    if change is None:
        return None
    size = change.size
    return {
        "file": change.file, "changed_K": size.change_K, "share": size.rise_fraction,
        "friction": size.friction_fraction,
        "left_out_K": (base.left_out.rmse_K, extended.left_out.rmse_K),
    }  # fmt: skip


def _collect_warnings(search: EffectSearch, final: LinearisedFit) -> tuple[str, ...]:
    problem = search.problem
    out = [f"{file}: {found}" for file, found in problem.screening.items()]
    out += [verdict_sentences.describe_assumed_optics(*item) for item in problem.assumed_camera_facts.items()]
    out += fit_report.camera_error_warnings(search.data, final)
    out += mesh_resolution_warnings(search.data, search.base.predictions)
    out += unconverged_fit_warnings(search.fits, refinement_factor(problem.case["numerics.mesh"]))
    for label, variance in final.hyper.variances.items():
        if variance > (1.0 + 2.0 * CRITERIA.noise_sd_uncertainty) ** 2:
            out.append(
                f"{label}: the residuals are {math.sqrt(variance):.2g} times its noise; its weight was reduced "
                "accordingly"
            )
    own = effect_names(final)
    for names, gain in find_unjudged_effects(search, final).items():
        if own and names > own:
            more = " and ".join(sorted(names - own))
            why = (
                "could not be simulated"
                if names in search.unfitted
                else f"(ln Bayes factor {gain:.0f}) did not converge"
            )
            out.append(f"the fit of {more} in addition to {' and '.join(sorted(own))} {why}")
    if len(problem.conditions) == 1:
        alone = float(np.ptp(search.base.predictions[0].run.slid)) == 0.0
        out.append(describe_single_condition(alone))
    return tuple(out)


def describe_single_condition(alone: bool) -> str:
    """A warning that all data are of one condition; `alone`: the block does not slide.

    >>> describe_single_condition(alone=True)
    'all data are of one condition: effects that differ only under another heating cannot be distinguished'
    """
    what = "under another heating" if alone else "in speed or load"
    return f"all data are of one condition: effects that differ only {what} cannot be distinguished"
