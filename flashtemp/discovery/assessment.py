"""Comparison of models and stated inputs with the data: the numbers of a fit that `engine` judges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from flashtemp.discovery.diagnostics import fit_report
from flashtemp.discovery.diagnostics.cross_validation import (
    CrossValidation,
    cross_validate,
    without_flexible_terms,
)
from flashtemp.discovery.diagnostics.effect_size import (
    LargestChange,
    camera_fraction,
    change_per_unit,
    largest_change,
)
from flashtemp.discovery.diagnostics.input_checks import InputCheck, compare_inputs_with_data, group_inputs
from flashtemp.discovery.diagnostics.stated_inputs import (
    INPUT_CELL_FACTORS,
    StatedInput,
    add_input_columns,
    list_stated_inputs,
    merge_columns,
)
from flashtemp.discovery.estimation.fitting import ProgressCallback
from flashtemp.discovery.estimation.linear_gaussian import LinearSystem
from flashtemp.discovery.estimation.linearised_fit import LinearisedFit
from flashtemp.discovery.parameters import ParameterKind
from flashtemp.discovery.prediction.prediction import Prediction
from flashtemp.discovery.selection.forward_selection import EffectSearch
from flashtemp.discovery.verdict import FitMetrics


@dataclass(frozen=True)
class ModelAssessment:
    """A fit compared with all data.

    `rigid` is the fit without flexible terms (pressure modes, walls, friction scatter), so that a recording is compared
    with the model that the case describes.  `left_out` and `rigid_left_out` are the cross-validations of both fits.
    The comparisons and `metrics` are those of `rigid`; evidence and adequacy tests are those of `fit`.
    """

    fit: LinearisedFit
    rigid: LinearisedFit
    recording_comparisons: tuple[Any, ...]
    force_comparisons: tuple[Any, ...]
    left_out: CrossValidation
    rigid_left_out: CrossValidation
    metrics: FitMetrics


@dataclass(frozen=True)
class InputAssessment:
    """The check of every stated input, and groups of inputs that the data cannot distinguish.

    `system`: the linear system of the final fit with columns of all stated inputs.
    """

    checks: tuple[InputCheck, ...]
    groups: tuple[tuple[str, ...], ...]
    system: LinearSystem


def assess_model(search: EffectSearch, fit: LinearisedFit) -> ModelAssessment:
    """Compare a fit with all recordings and cross-validate it; used for the base and the extended model alike."""
    rigid = without_flexible_terms(fit)
    recordings, forces = fit_report.compare_all_recordings(search, rigid)
    left_out, rigid_left_out = (cross_validate(search.data, f) for f in (fit, rigid))
    metrics = fit_report.summary_metrics(rigid, recordings, rigid_left_out)
    return ModelAssessment(fit, rigid, recordings, forces, left_out, rigid_left_out, metrics)


def size_of_change(search: EffectSearch, base: ModelAssessment, extended: ModelAssessment) -> LargestChange:
    """How much the extended model changes the recordings against the base."""
    change = largest_change(
        base.recording_comparisons,
        extended.recording_comparisons,
        base.force_comparisons,
        extended.force_comparisons,
    )
    fraction = camera_fraction(search.data, search.base, extended.fit, search.problem.candidates)
    return replace(change, size=replace(change.size, camera_fraction=fraction))


def assess_inputs(search: EffectSearch, final: LinearisedFit, watch: ProgressCallback) -> InputAssessment:
    """Check every stated number of case and set-up against the data, at the final fit.

    Sensitivities are computed on a coarse mesh first, which is accurate enough for most inputs.  The coarse sensitivity
    of an input with hardly any influence may be a mesh error, so contradicted inputs are checked again on the mesh of
    the fit.
    """
    inputs = list_stated_inputs(search.problem)
    watch(f"checking {len(inputs)} stated inputs")
    coarse = _predict_input_columns(search, final, inputs, INPUT_CELL_FACTORS)
    assessment = _assess_with_sensitivities(search, final, inputs, coarse)
    contradicted = [c.input for c in assessment.checks if c.is_contradicted]
    if not contradicted:
        return assessment
    exact = _predict_input_columns(search, final, contradicted, None)
    return _assess_with_sensitivities(search, final, inputs, list(map(merge_columns, exact, coarse)))


def screen_inputs(search: EffectSearch, fit: LinearisedFit) -> InputAssessment:
    """Check all stated inputs at a fit with sensitivities on the coarse mesh alone."""
    inputs = list_stated_inputs(search.problem)
    return _assess_with_sensitivities(
        search, fit, inputs, _predict_input_columns(search, fit, inputs, INPUT_CELL_FACTORS)
    )


def _predict_input_columns(
    search: EffectSearch, fit: LinearisedFit, inputs: Sequence[StatedInput], cells: tuple[float, ...] | None
) -> list[Prediction]:
    """Predictions at a fit whose only columns are those of stated inputs."""
    bare = [replace(p, observables={k: replace(o, columns={}) for k, o in p.observables.items()})
            for p in fit.predictions]  # fmt: skip
    return add_input_columns(search.problem, fit.model, bare, inputs, cells)


def _assess_with_sensitivities(
    search: EffectSearch, final: LinearisedFit, inputs: Sequence[StatedInput], predictions: Sequence[Prediction]
) -> InputAssessment:
    """Check inputs with predictions at the final fit that contain their sensitivities."""
    blocks = search.data.make_blocks(predictions)
    blocks = [b.with_columns_of(o, lambda p: p.kind is not ParameterKind.EFFECT or p in final.effect_priors)
              for b, o in zip(blocks, final.blocks, strict=True)]  # fmt: skip
    system = LinearSystem(blocks)
    equations = system.normal_equations(variances=final.hyper.variances)
    changes = partial(change_per_unit, search.data, final.predictions, system)
    checks = compare_inputs_with_data(system, final.free_priors, equations, inputs, changes)
    groups = group_inputs(system, final.free_priors, equations, inputs)
    return InputAssessment(checks, tuple(tuple(i.key for i in g) for g in groups), system)
