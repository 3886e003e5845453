"""The parts of a report on a fit: comparisons with recordings, causes, rejected candidates, calibrated parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from flashtemp.comparison.compare import (
    ForceComparison,
    RecordingComparison,
    compare_force_with_prediction,
    compare_with_prediction,
)
from flashtemp.discovery.criteria import CRITERIA
from flashtemp.discovery.diagnostics.adequacy_tests import (
    near_contact_rmse,
    normalised_deviations,
    time_mean_rmse,
)
from flashtemp.discovery.diagnostics.cross_validation import CrossValidation
from flashtemp.discovery.diagnostics.quantity_format import format_digits, unit_suffix
from flashtemp.discovery.diagnostics.verdict_sentences import NUISANCE_WORDS, describe_nuisance
from flashtemp.discovery.estimation.linear_gaussian import Array, DataBlock, Solution, predicted_change
from flashtemp.discovery.estimation.linearised_fit import LinearisedFit
from flashtemp.discovery.estimation.nuisance_priors import NUISANCE_SD, is_camera_gain
from flashtemp.discovery.estimation.per_condition import estimate_effect_by_condition
from flashtemp.discovery.estimation.whitening import WhitenedData
from flashtemp.discovery.hypotheses.candidates import parameter_spec
from flashtemp.discovery.parameters import (
    BEAD_KINDS,
    CAMERA_ERROR_KINDS,
    SETUP_KINDS,
    SHIFT_KINDS,
    ZERO_KINDS,
    ParameterId,
    ParameterKind,
)
from flashtemp.discovery.prediction.problem import Problem
from flashtemp.discovery.selection.forward_selection import EffectSearch
from flashtemp.discovery.selection.scores import CandidateScore, Separability, compute_separability
from flashtemp.discovery.verdict import CandidateReport, Cause, FitMetrics, NormalisedDeviation, ParameterEstimate

STDERR_INFLATION = 1.2  # errors scatter 1.13 times their standard errors (benchmarks/discover.py, seeds below 1000)
CAMERA_ERROR_WORDS = {
    ParameterKind.OFFSET: "offset in time",
    ParameterKind.STATIC: "static map",
    ParameterKind.MAP: "gain map",
    ParameterKind.OPTICS: "smear and stray light",
}
MAX_SIMILAR_DISTINCTNESS = 0.5  # of two sensitivities that resemble each other: a correlation of 0.87 or more
MIN_REPORTED_ERROR_K = 5e-3  # rms below which a camera error is not reported


def compare_all_recordings(
    search: EffectSearch, fit: LinearisedFit
) -> tuple[tuple[RecordingComparison, ...], tuple[ForceComparison, ...]]:
    """Compare every recording and load-cell record with a fit, including its nuisances."""
    recordings, forces = {}, {}
    blocks = {b.label: b for b in fit.blocks}
    for condition, prediction in zip(search.problem.conditions, fit.predictions, strict=True):
        for view in condition.views:
            observable = prediction.observables[view.file]
            predicted = np.array(observable.values, dtype=float)
            predicted[:, observable.inside] += _fitted_change(search.data, fit, blocks[view.file])
            residual = np.full(
                predicted.shape, np.nan
            )  # NaN at pixels that no fit compares, such as a wake's beginning
            difference = view.recording.temperature[:, observable.inside] - predicted[:, observable.inside]
            residual[:, observable.inside] = np.where(search.data.is_compared[view.file], difference, np.nan)
            u, v = (_column_sd(fit.solution, ParameterId(axis, file=view.file)) for axis in SHIFT_KINDS)
            noise, shift = search.data.noises[view.file], fit.model.image_shift(view.file)
            recordings[view.file] = compare_with_prediction(view, predicted, residual, noise, shift, (u, v))
        for force in condition.forces:
            observable = prediction.observables[force.file]
            predicted = observable.values + _fitted_change(search.data, fit, blocks[force.file])
            residual = np.where(observable.inside, np.array(force.mu) - predicted, np.nan)
            forces[force.file] = compare_force_with_prediction(force, predicted, residual)
    campaign = search.problem.campaign
    return tuple(recordings[v.file] for v in campaign.views), tuple(forces[f.file] for f in campaign.forces)


def _fitted_change(data: WhitenedData, fit: LinearisedFit, block: DataBlock) -> Array:
    """Change of an observable by the solution of a fit, (frames, valid pixels) or (n,), in its unit."""
    return data.to_kelvin(block.label, predicted_change(block, fit.solution))


def _column_sd(solution: Solution, p: ParameterId) -> float:
    return solution.sd(p) if p in solution.names else 0.0


def fitted_residuals(recordings: Sequence[RecordingComparison]) -> Array:
    """Measured minus predicted (n,) K of all fitted recordings; of all recordings if every one is held out."""
    fitted = [s for s in recordings if not s.view.held_out] or list(recordings)
    kept = [s.residual[np.isfinite(s.residual)] for s in fitted]
    return np.concatenate(kept) if kept else np.zeros(0)


def summary_metrics(
    fit: LinearisedFit, recordings: Sequence[RecordingComparison], validation: CrossValidation
) -> FitMetrics:
    """Root mean square residuals and chi2 of a fit."""
    fitted = [s for s in recordings if not s.view.held_out] or list(recordings)
    residual = fitted_residuals(recordings)
    maps = [time_mean_rmse(s.residual) for s in fitted]
    near = [near_contact_rmse(s.view, s.residual) for s in fitted if s.view.recording.view != "wake"]
    return FitMetrics(
        rmse_K=float(np.sqrt(np.mean(residual**2))) if len(residual) else float("nan"),
        chi2_per_dof=fit.chi2 / max(fit.solution.count, 1),
        held_out_rmse_K=validation.rmse_K,
        held_out_z=validation.z,
        mean_map_rmse_K=float(np.sqrt(np.mean(np.square(maps)))) if maps else float("nan"),
        near_contact_rmse_K=float(np.sqrt(np.nanmean(np.square(near)))) if near else float("nan"),
    )


# --- causes and rejected candidates -------------------------------------------------------------------------
def describe_cause(search: EffectSearch, fit: LinearisedFit, effect: str, heldout_gain: float) -> Cause:
    """One effect of a fit, compared with the model without it (its own fit, or the base)."""
    without = search.fits.get(frozenset(fit.model.effects) - {effect}, search.base)
    score = next((s for ranking in search.ranking for s in ranking if s.effect == effect), None)
    own = [p for p in fit.solution.names if p.effect == effect]
    bound = sorted(p for p in fit.bound if p.effect == effect)
    sizes = estimate_effect_by_condition(search.problem, fit, effect, every=True)
    return Cause(
        effect=effect,
        words=search.problem.case.known_effects[effect].cause,
        parameters=tuple(_estimate_parameter(search, fit, p) for p in (*own, *bound)),
        delta_chi2=_chi2_with_same_priors(without, fit) - fit.solution.chi2,
        held_out_gain=heldout_gain,
        distinctness=compute_separability(search.base, search.problem.candidates).distinctness(effect),
        ln_bayes=fit.ln_evidence - without.ln_evidence,
        z=score.z if score else 0.0,
        raw_share=score.raw_share if score else 0.0,
        per_condition=sizes[0].conditions if sizes else (),
        consistent=sizes[0].probability if sizes else 1.0,
        references=_references_of_keys(search.problem, fit, effect),
    )


def _references_of_keys(problem: Problem, fit: LinearisedFit, effect: str) -> dict[str, str]:
    """{free key: "effect.reference = value"} for the keys that the effect changes, if it has a reference."""
    param = problem.case.known_effects[effect].params().get("reference")
    if param is None:
        return {}
    case, name = fit.model.apply_to(problem.case), f"{effect}.reference"
    parts = (part for acting in case.scene.acting if acting.name == effect for part in acting.contributions(case.scene))
    changed = {getattr(part, "target", "") for part in parts}
    where = f"{name} = {format_digits(case[name])}{unit_suffix(param.unit)}"
    return {p.name: where for p in problem.free_keys if p.name in changed}


def _chi2_with_same_priors(without: LinearisedFit, fit: LinearisedFit) -> float:
    """chi2 of a model without an effect, with the prior widths and noise of the fit that has it."""
    priors = {p: (mean, fit.priors[p][1] if p in fit.priors else sd) for p, (mean, sd) in without.priors.items()}
    return without.system.solve(priors, without.system.normal_equations(variances=fit.hyper.variances)).chi2


def _estimate_parameter(search: EffectSearch, fit: LinearisedFit, p: ParameterId) -> ParameterEstimate:
    param, value = search.problem.case.known_effects[p.effect].params()[p.name], fit.model.effect_value(p)
    if p not in fit.solution.names:
        return ParameterEstimate(str(p), value, 0.0, (value, value), param.unit, True)
    value, sd = value + fit.solution[p], STDERR_INFLATION * fit.solution.sd(p)
    low, high = (float(np.clip(value + s * 1.96 * sd, param.low, param.high)) for s in (-1, 1))
    return ParameterEstimate(str(p), float(np.clip(value, param.low, param.high)), sd, (low, high), param.unit)


def report_candidates(search: EffectSearch, accepted: Sequence[str]) -> tuple[CandidateReport, ...]:
    """Every candidate with the reason why it was not accepted."""
    single = compute_separability(search.base, search.problem.candidates)
    out = [_report_candidate(search, s, single, accepted) for s in (search.ranking[0] if search.ranking else ())]
    out += [
        CandidateReport(e, 0.0, 0.0, f"not tried: {why}", seen=0.0)
        for e, why in search.problem.excluded_candidates.items()
    ]
    return tuple(sorted(out, key=lambda r: -r.score))


def _report_candidate(
    search: EffectSearch, s: CandidateScore, single: Separability, accepted: Sequence[str]
) -> CandidateReport:
    """A candidate with the results of its full fit if there is one, else with its score."""
    k, a = s.candidate.leading_strength
    param, name = s.candidate.params[k], s.candidate.strength_column(k)
    refit, left = search.fits.get(frozenset({s.effect})), None
    score, amplitude, sd = s.ln_bayes, (param.off or 0.0) + s.amplitude[0], s.sd[0]
    if frozenset({s.effect}) in search.vanished:
        score, amplitude = min(score, 0.0), param.off or 0.0
    if refit is not None:
        score, e = refit.secured_evidence - search.base.secured_evidence, _estimate_parameter(search, refit, name)
        amplitude, sd = e.value, e.stderr
        if accepted and s.effect not in accepted:
            left = search.best.ln_evidence - refit.ln_evidence
    return CandidateReport(
        effect=s.effect, score=score, distinctness=single.distinctness(s.effect),
        reason=_rejection_reason(search, s, single, score, left, accepted), parameter=str(name), amplitude=amplitude,
        stderr=sd, unit=param.unit, z=s.z, raw_share=s.raw_share, seen=s.typical_z,
        detectable=5.0 * abs(a) / s.typical_z if s.typical_z > 1e-9 else float("inf"), left=left,
        refitted=refit is not None and refit.is_comparable,
    )  # fmt: skip


def _rejection_reason(
    search: EffectSearch,
    s: CandidateScore,
    single: Separability,
    score: float,
    left: float | None,
    accepted: Sequence[str],
) -> str:
    if s.effect in accepted:
        return "accepted"
    if s.reason:
        return s.reason
    if frozenset({s.effect}) in search.vanished:
        return "its strength became zero in the full fit"
    if left is not None and score > CRITERIA.ln_bayes_hint:
        return f"explains a part, but {' and '.join(accepted)} is better by a ln Bayes factor of {left:.0f}"
    if score > CRITERIA.ln_bayes_named and accepted:
        nearest = min(accepted, key=lambda a: single.pair_distinctness(s.effect, a))
        is_similar = single.pair_distinctness(s.effect, nearest) < MAX_SIMILAR_DISTINCTNESS
        similar = f"its sensitivity resembles that of {nearest}; " if is_similar else ""
        return f"{similar}with {' and '.join(accepted)} in the model it explains nothing more"
    if s.typical_z < 3.0:
        return "calibration absorbs it: even at its typical strength these data would hardly show it"
    return "the data do not require it"


def calibrated_parameters(search: EffectSearch, fit: LinearisedFit) -> tuple[NormalisedDeviation, ...]:
    """Calibrated parameters: free keys first, then nuisances by their deviation from the prior."""
    free, other, away = [], [], normalised_deviations(fit)
    for p in fit.solution.names:
        step, sd = fit.solution[p], fit.solution.sd(p)
        if p.kind is ParameterKind.KEY:
            value = search.problem.case[p.name] * float(np.exp(fit.model.free[p.name] + step))
            free.append(NormalisedDeviation(str(p), value, value * sd, away[p], _key_unit(search, p.name)))
        elif p.kind in SHIFT_KINDS:
            other.append(
                NormalisedDeviation(
                    describe_nuisance(p), fit.model.image_shift(p.file)[p.shift_axis] + step, sd, away[p], "px"
                )
            )
        elif p.kind in SETUP_KINDS:
            unit = {ParameterKind.TURN: "rad", ParameterKind.CLOCK: "s"}.get(p.kind, "1")
            other.append(NormalisedDeviation(describe_nuisance(p), fit.model.setup_value(p) + step, sd, away[p], unit))
        elif p.kind in BEAD_KINDS:
            unit = "m" if p.kind is ParameterKind.PLACE else "s"
            other.append(
                NormalisedDeviation(describe_nuisance(p), fit.model.bead_offsets.get(p, 0.0) + step, sd, away[p], unit)
            )
        elif p.kind not in (
            ParameterKind.EFFECT,
            ParameterKind.MODE,
            ParameterKind.MODEL_DISCREPANCY,
            *CAMERA_ERROR_KINDS,
        ) and not is_camera_gain(p):
            unit = "K" if p.kind in ZERO_KINDS else "1"
            other.append(NormalisedDeviation(describe_nuisance(p), 0.0 + step, sd, away[p], unit))
    return (*free, *sorted(other, key=lambda p: -abs(p.pull)))


def _key_unit(search: EffectSearch, key: str) -> str:
    return parameter_spec(search.problem.case, key).unit


def assumed_priors(problem: Problem) -> dict[str, float]:
    """Prior standard deviations of free keys, and of every kind of nuisance in words; relative if no unit is given."""
    units = {ParameterKind.TURN: " (rad)", ParameterKind.CLOCK: " (s)", ParameterKind.COLD_JUNCTION: " (K)"}
    kinds = {NUISANCE_WORDS[k].rstrip(",").removesuffix(" of").removesuffix(" in") + units.get(k, ""): sd
             for k, sd in NUISANCE_SD.items()}  # fmt: skip
    return {str(p): sd for p, sd in problem.key_priors.items()} | kinds


def camera_error_warnings(data: WhitenedData, fit: LinearisedFit) -> tuple[str, ...]:
    """One line for each recording in which a fit estimates camera errors, with their rms in K."""
    out = []
    for block in fit.blocks:
        sizes = {kind: _family_rms(data, fit, block, kind) for kind in CAMERA_ERROR_WORDS}
        parts = [
            f"{CAMERA_ERROR_WORDS[kind]} {size:.2g} K" for kind, size in sizes.items() if size > MIN_REPORTED_ERROR_K
        ]
        if parts:
            out.append(f"{block.label}: camera errors were calibrated (rms): {', '.join(parts)}")
    return tuple(out)


def _family_rms(data: WhitenedData, fit: LinearisedFit, block: DataBlock, kind: ParameterKind) -> float:
    """Root mean square (K) of the estimated errors of one family in a recording."""
    keep = {p for p in fit.solution.names if p.kind is kind and p.file == block.label and _is_camera_error(p)}
    if not keep:
        return 0.0
    own = tuple((p, column) for p, column in block.names if p in keep)
    values = data.to_kelvin(block.label, predicted_change(replace(block, names=own), fit.solution))
    return float(np.sqrt(np.mean(values[data.is_compared[block.label]] ** 2)))


def _is_camera_error(p: ParameterId) -> bool:
    return p.kind in CAMERA_ERROR_KINDS or is_camera_gain(p)
