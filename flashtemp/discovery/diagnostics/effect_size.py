"""The size of an extension: the change of the predicted data in kelvin and as a fraction of the temperature rise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flashtemp.comparison.compare import ForceComparison, RecordingComparison
from flashtemp.discovery.decision import EffectSize
from flashtemp.discovery.estimation.linear_gaussian import LinearSystem
from flashtemp.discovery.estimation.linearised_fit import LinearisedFit
from flashtemp.discovery.estimation.whitening import WhitenedData
from flashtemp.discovery.hypotheses.candidates import CandidateEffect
from flashtemp.discovery.parameters import ParameterId
from flashtemp.discovery.prediction.prediction import Prediction


@dataclass(frozen=True)
class LargestChange:
    """The recording `file` with the largest relative change by an extension, and the `size` of the change."""

    file: str
    size: EffectSize


def largest_change(
    before: tuple[RecordingComparison, ...],
    after: tuple[RecordingComparison, ...],
    forces_before: tuple[ForceComparison, ...],
    forces_after: tuple[ForceComparison, ...],
) -> LargestChange:
    """The largest change by an extended model against the base, both calibrated."""
    changes = [_recording_change(b, e) for b, e in zip(before, after, strict=True)]
    file, change_K, fraction = max(changes, key=lambda c: c[2], default=("", 0.0, 0.0))
    friction = max((_friction_change(b, e) for b, e in zip(forces_before, forces_after, strict=True)), default=0.0)
    return LargestChange(file, EffectSize(fraction, friction, change_K))


def camera_fraction(
    data: WhitenedData, base: LinearisedFit, extended: LinearisedFit, candidates: Sequence[CandidateEffect]
) -> float:
    """The largest relative change of a recording by the effects of an extended model, with nothing calibrated again.

    0 unless all effects of the model act in the camera only.  `base` must have sensitivities of all `candidates`.
    """
    own = [c for c in candidates if c.effect in extended.model.effects]
    if not all(c.is_optical for c in own):
        return 0.0
    changes = (
        abs(extended.model.effects[c.effect][k] - c.neutral_values()[k])
        * change_per_unit(data, base.predictions, base.system, c.strength_column(k))
        for c in own for k in c.strengths
    )  # fmt: skip
    return max(changes, default=0.0)


def change_per_unit(
    data: WhitenedData, predictions: Sequence[Prediction], system: LinearSystem, p: ParameterId
) -> float:
    """The largest relative change (rms) of a recording's temperature rise, or of a load-cell record's friction, by one
    unit of a parameter with nothing else changed.

    `predictions`: of all conditions, at the point where `system` was linearised.
    """
    shown = {file: o for prediction in predictions for file, o in prediction.observables.items()}
    largest = 0.0
    for b in system.blocks:
        for column in (c for q, c in b.names if q == p):
            compared, o = data.is_compared[b.label], shown[b.label]
            low = 0.0 if b.label in data.sigmas else float(np.nanmin(o.values))
            values = o.values if b.label in data.sigmas else o.values[:, o.inside] - low
            change = data.to_kelvin(b.label, b.C[:, column].astype(float))[compared]
            largest = max(largest, float(np.sqrt(np.mean(change**2) / np.mean(values[compared] ** 2))))
    return largest


def _recording_change(base: RecordingComparison, extended: RecordingComparison) -> tuple[str, float, float]:
    """File, rms change (K) and its ratio to the rms temperature rise of one recording."""
    here = np.isfinite(base.residual) & np.isfinite(extended.residual)
    r = base.view.recording
    if not here.any():
        return base.view.file, 0.0, 0.0
    low = float(np.nanmin(base.predicted)) if r.reflected_degC is None else r.reflected_degC
    changed = float(np.sqrt(np.mean((extended.predicted - base.predicted)[here] ** 2)))
    return base.view.file, changed, changed / max(float(np.sqrt(np.mean((base.predicted - low)[here] ** 2))), 1e-9)


def _friction_change(base: ForceComparison, extended: ForceComparison) -> float:
    """rms change of one load-cell record as a fraction of its friction."""
    here = np.isfinite(base.residual) & np.isfinite(extended.residual)
    if not here.any():
        return 0.0
    changed = float(np.sqrt(np.mean((extended.predicted - base.predicted)[here] ** 2)))
    return changed / max(float(np.sqrt(np.mean(base.predicted[here] ** 2))), 1e-9)
