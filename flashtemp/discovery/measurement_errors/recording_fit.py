"""The fit of one recording alone under one hypothesis: its ln evidence with all freedom of a calibration.

Free keys, friction of each repetition, free pressure shapes, camera errors and the pose of the image are all estimated.
The noise variance is estimated from the residual and is at least the stated one (Birge's ratio).  A hypothesis with a
misfit chi2 over n data therefore costs n/2 ln(chi2/n), whatever the model itself lacks.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from flashtemp.camera.recording import Recording
from flashtemp.comparison.campaign import RecordingEntry
from flashtemp.comparison.compare import check_recording
from flashtemp.comparison.noise import NoiseLevels
from flashtemp.discovery.criteria import CRITERIA
from flashtemp.discovery.estimation.hyperparameters import EvidenceMaximum, maximise_evidence
from flashtemp.discovery.estimation.image_alignment import Linearisation, align_images
from flashtemp.discovery.estimation.linear_gaussian import DataBlock, LinearSystem, gram_matrices
from flashtemp.discovery.estimation.whitening import WhitenedData
from flashtemp.discovery.measurement_errors.image_pose import STATED_POSE, ImagePose, register_image
from flashtemp.discovery.parameters import ALL_CONDITIONS, ParameterId, ParameterKind
from flashtemp.discovery.prediction.prediction import (
    Observable,
    Prediction,
    PredictionTask,
    Single,
    flatten_valid_pixels,
    predict_again,
)
from flashtemp.discovery.prediction.problem import Problem
from flashtemp.errors import BadInput, FlashtempError
from flashtemp.model.scene import Scene

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Weights = tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], Single]  # lower, upper index, weight of the upper
MIN_COMMON_FRACTION = 0.25  # of the data that a hypothesis must predict, to be compared with the recording as stated
FRICTION_LAW_SD = 0.3  # ln of friction between conditions, for laws of load and speed that a case may lack
TIME_TOLERANCE = 1e-4  # relative difference of frame times that count as equal


@dataclass(frozen=True)
class RecordingHypothesis:
    """A hypothesis about a recording: the corrected recording `view`, under the condition number `condition`.

    `flipped`: axes of its images (1 up, 2 along) whose order is reversed against the file.
    """

    view: RecordingEntry
    condition: int
    flipped: tuple[int, ...] = ()

    @property
    def file(self) -> str:
        return self.view.file

    def in_file_order(self, images: Mask) -> Mask:
        """Images (frames, nv, nu) with their pixels in the order of the file."""
        return np.flip(images, self.flipped) if self.flipped else images


def is_adequate(chi2_per_datum: float, count: int) -> bool:
    """Whether chi2 per datum of a number of data is compatible with noise of the stated size and its uncertainty."""
    tolerance = CRITERIA.adequacy_standard_errors * np.sqrt(2.0 / max(count, 1))
    return bool(chi2_per_datum <= (1.0 + CRITERIA.noise_sd_uncertainty) ** 2 + tolerance)


@dataclass(frozen=True)
class RecordingFit:
    """The fit of one recording alone: a `linearisation` at a position of its image, and the evidence `maximum` there.

    `problem` and `data`: of this recording alone.  `known` (frames, nv, nu): the pixels that are compared.
    """

    hypothesis: RecordingHypothesis
    problem: Problem
    data: WhitenedData
    known: Mask
    linearisation: Linearisation
    maximum: EvidenceMaximum

    @property
    def block(self) -> DataBlock:
        return self.linearisation.system.blocks[0]

    @property
    def ln_evidence(self) -> float:
        return self.maximum.solution.ln_evidence

    @property
    def chi2_per_datum(self) -> float:
        """chi2 per datum after the best calibration, in stated variances."""
        return float(self.linearisation.system.block_chi2(self.maximum.solution)[0]) / max(self.block.count, 1)

    @property
    def pose(self) -> ImagePose:
        return ImagePose(
            self.linearisation.model.image_placement(self.hypothesis.file),
            self.linearisation.model.image_shift(self.hypothesis.file),
        )

    @property
    def noise(self) -> NoiseLevels:
        return self.data.noises[self.hypothesis.file]

    @property
    def known_in_file(self) -> Mask:
        """`known` in the order of the file."""
        return self.hypothesis.in_file_order(self.known)

    @property
    def is_adequate(self) -> bool:
        """Whether what is left may be noise of the stated size, as well as that is known."""
        return is_adequate(self.chi2_per_datum, self.block.count)

    def with_aligned_image(self) -> RecordingFit:
        """The fit with its image aligned with the data.  Raises SolverFailure."""
        if self.hypothesis.view.recording.places is not None:
            return self
        at = self.linearisation
        at = align_images(self.problem, self.data, at, self.maximum.hyper, frozenset(), at.model)
        return replace(self, linearisation=at, maximum=maximise_evidence(self.problem, at.system, at.model, {}))

    def restrict_to(self, common: Mask) -> RecordingFit:
        """The same with those data alone that are `common` (frames, nv, nu), in the order of the file."""
        keep = self.hypothesis.in_file_order(common)[self.known]
        if keep.all():
            return self
        F = self.block.F[keep]
        block = replace(self.block, r=self.block.r[keep], C=self.block.C[keep], F=F, FF=gram_matrices([F])[0])
        at = replace(self.linearisation, system=LinearSystem([block]))
        known = self.hypothesis.in_file_order(common)
        return replace(
            self, known=known, linearisation=at, maximum=maximise_evidence(self.problem, at.system, at.model, {})
        )


def fit_recording(
    problem: Problem,
    task: PredictionTask,
    prediction: Prediction,
    hypothesis: RecordingHypothesis,
    noise: NoiseLevels | None = None,
) -> RecordingFit:
    """The better of linearised fits at the stated pose and, where that is not adequate, at the registered one.

    `prediction` holds the recording as it would be seen, with its fields.  Raises BadInput, SolverFailure.
    """
    stated = fit_at_pose(problem, task, prediction, hypothesis, STATED_POSE, noise)
    if stated.is_adequate:
        return stated
    pose = register_image(problem, hypothesis.view.recording, prediction.observables[hypothesis.file])
    if pose is None:
        return stated
    try:
        registered = fit_at_pose(problem, task, prediction, hypothesis, pose, stated.noise)
    except FlashtempError:  # in this pose the image shows no part of the block
        return stated
    return max(stated, registered, key=lambda fit: fit.ln_evidence)


def fit_at_pose(
    problem: Problem, task: PredictionTask, prediction: Prediction, hypothesis: RecordingHypothesis, pose: ImagePose,
    noise: NoiseLevels | None = None,
) -> RecordingFit:  # fmt: skip
    """The linearised fit of one recording with its image in a pose.  Raises BadInput, SolverFailure."""
    view, alone = hypothesis.view, single_recording_problem(problem, hypothesis)
    model, observable, task = (
        alone.stated_model,
        prediction.observables[view.file],
        replace(task, views=(view,), forces=()),
    )
    if pose != STATED_POSE:
        assert prediction.full_run is not None
        model = pose.apply_to(model, view.file)
        moved = predict_again(task, prediction.full_run, view, model)
        observable = replace(moved, columns=observable.columns | moved.columns)
    shown = replace(prediction, observables={view.file: observable})
    data = WhitenedData.from_predictions(alone, [shown], noises=None if noise is None else {view.file: noise})
    block = replace(
        data.make_blocks([shown])[0], held_out=False
    )  # its image placement is fitted even if its temperatures are held out
    at = Linearisation(model, (task,), (shown,), LinearSystem([block]))
    known = np.zeros(observable.values.shape, bool)
    known[:, observable.inside] = data.is_compared[view.file]
    return RecordingFit(hypothesis, alone, data, known, at, maximise_evidence(alone, at.system, model, {}))


def single_recording_problem(problem: Problem, hypothesis: RecordingHypothesis) -> Problem:
    """The problem of one recording alone, under the condition of a hypothesis."""
    view, number = hypothesis.view, hypothesis.condition
    condition = replace(problem.conditions[number], views=(view,), forces=())
    return replace(
        problem, conditions=(condition,), mesh_overrides=(problem.mesh_overrides[number],),
        campaign=replace(problem.campaign, views=(view,), forces=()),
    )  # fmt: skip


# --- comparisons on the same data -----------------------------------------------------------------------------
@dataclass(frozen=True)
class HypothesisEvidence:
    """Evidence of a hypothesis: `ln_bayes` against the recordings as stated, infinite if these are impossible; chi2 per
    datum after the best calibration of `count` data, `chi2_stated` and `chi2_corrected`, NaN if unknown."""

    ln_bayes: float
    chi2_stated: float = np.nan
    chi2_corrected: float = np.nan
    count: int = 0

    @property
    def is_adequate(self) -> bool:
        """Whether the residuals under the hypothesis may be noise; True if the recording as stated is impossible."""
        return not np.isfinite(self.ln_bayes) or is_adequate(self.chi2_corrected, self.count)

    @property
    def is_excess_halved(self) -> bool:
        """Whether at most half of the excess chi2 remains under the hypothesis.

        The misfit of an incomplete model is smooth, so the number of pixels overstates its evidence.  A hypothesis with
        nearly the same misfit is therefore no better, whatever its ln Bayes factor.
        """
        before, after = (max(chi2 - 1.0, 0.0) for chi2 in (self.chi2_stated, self.chi2_corrected))
        return after <= CRITERIA.law_excess_left * before

    def is_clear(self, hypotheses: int) -> bool:
        """Whether one of a number of hypotheses about a recording is accepted against the stated one.

        The evidence must be very strong after the prior odds of a handling error and the number of hypotheses.
        """
        odds = CRITERIA.ln_odds_handling_error + float(np.log(max(hypotheses, 1)))
        needed = CRITERIA.ln_bayes_distinct + odds
        return self.ln_bayes > needed and self.is_excess_halved


@dataclass(frozen=True)
class UnaffectedData:
    """The other data of the conditions between which recordings may be moved: `fits` of recordings and `traces`
    (blocks) of load cells.  They are as stated under every hypothesis."""

    fits: tuple[RecordingFit, ...] = ()
    traces: tuple[DataBlock, ...] = ()


NO_UNAFFECTED_DATA = UnaffectedData()


def compare_fits(
    problem: Problem, stated: Sequence[RecordingFit], other: Sequence[RecordingFit],
    unaffected: UnaffectedData = NO_UNAFFECTED_DATA,
) -> HypothesisEvidence:  # fmt: skip
    """Joint evidence of fits of recordings against fits as stated, from the data that both predict.

    A hypothesis is impossible if it describes all data that it predicts worse than the recordings as stated describe
    theirs, and not adequately: the data that both predict may be few and show little.
    """
    own = [_chi2_of_all(fits) for fits in (stated, other)]
    if own[1] > own[0] and not is_adequate(own[1], sum(fit.block.count for fit in other)):
        return HypothesisEvidence(-np.inf)
    before, after = [], []
    for a, b in zip(stated, other, strict=True):
        common = a.known_in_file & b.known_in_file
        if np.count_nonzero(common) < MIN_COMMON_FRACTION * np.count_nonzero(a.known):
            return HypothesisEvidence(-np.inf)
        before.append(a.restrict_to(common))
        after.append(b.restrict_to(common))
    (ln_stated, chi2_stated, count), (ln_other, chi2_other, _) = (
        _joint_fit(problem, fits, unaffected) for fits in (before, after)
    )
    return HypothesisEvidence(ln_other - ln_stated, chi2_stated, chi2_other, count)


def _chi2_of_all(fits: Sequence[RecordingFit]) -> float:
    """chi2 per datum of all data that fits of single recordings predict."""
    counts = [fit.block.count for fit in fits]
    return sum(fit.chi2_per_datum * n for fit, n in zip(fits, counts, strict=True)) / max(sum(counts), 1)


def _joint_fit(problem: Problem, fits: Sequence[RecordingFit], unaffected: UnaffectedData) -> tuple[float, float, int]:
    """ln evidence, chi2 per datum and number of data of recordings and the unaffected data together.

    Each condition has its own friction, because the case may lack a law.  The size of a temperature rise alone then
    does not show the condition of a recording, but one friction must explain all data of a condition.
    """
    if len(fits) == 1 and unaffected == NO_UNAFFECTED_DATA:
        return fits[0].ln_evidence, fits[0].chi2_per_datum, fits[0].block.count
    together = (*fits, *unaffected.fits)
    views = tuple(fit.hypothesis.view for fit in together)
    whole = replace(problem, campaign=replace(problem.campaign, views=views, forces=()))
    model = whole.stated_model
    for fit in together:
        model = fit.pose.apply_to(model, fit.hypothesis.file)
    blocks = [number_block(fit.block, fit.hypothesis.condition) for fit in together]
    system = LinearSystem([*blocks, *unaffected.traces])
    levels = {p: (0.0, FRICTION_LAW_SD) for p in system.names if p.kind is ParameterKind.LEVEL}
    solution = maximise_evidence(whole, system, model, levels).solution
    count = sum(b.count for b in system.blocks)
    return solution.ln_evidence, sum(system.block_chi2(solution)) / max(count, 1), count


def fit_traces(problem: Problem, prediction: Prediction, number: int) -> tuple[DataBlock, ...]:
    """Load-cell records of one condition as whitened blocks."""
    condition = replace(problem.conditions[number], views=())
    if not condition.forces:
        return ()
    alone = replace(
        problem, conditions=(condition,), mesh_overrides=(problem.mesh_overrides[number],),
        campaign=replace(problem.campaign, views=(), forces=condition.forces),
    )  # fmt: skip
    blocks = WhitenedData.from_predictions(alone, [prediction]).make_blocks([prediction])
    return tuple(number_block(replace(b, held_out=False), number) for b in blocks)


def number_block(block: DataBlock, condition: int) -> DataBlock:
    """A block of a problem of one condition, numbered as in the whole one."""
    names = tuple((n if n.condition == ALL_CONDITIONS else replace(n, condition=condition), k) for n, k in block.names)
    return replace(block, condition=condition, names=names)


# --- predictions of a recording under a hypothesis ---------------------------------------------------------------
def flip_recording(r: Recording, axes: tuple[int, ...], length: float) -> list[Recording]:
    """A recording with the order of its pixels reversed along some axes: 1 up, 2 along.

    Two versions along the block: pixels keep their positions (the file was written in another order), or the block of a
    `length` (m) keeps its ends (they were marked in the flipped images).
    """
    flipped = replace(r, temperature=np.ascontiguousarray(np.flip(r.temperature, axes)))
    if 2 not in axes:
        return [flipped]
    in_place = replace(flipped, u=np.ascontiguousarray((r.u[0] + r.u[-1] - r.u)[::-1]))
    if r.view == "wake":
        return [in_place]
    return [in_place, replace(flipped, u=np.ascontiguousarray((length - r.u)[::-1]))]


def predict_hypothesis(
    problem: Problem,
    task: PredictionTask,
    prediction: Prediction,
    source: RecordingEntry,
    hypothesis: RecordingHypothesis,
) -> tuple[RecordingHypothesis, Prediction]:
    """Predict a recording under a hypothesis from existing fields, without pixels that have no sensitivities.

    Its images are predicted exactly.  Sensitivities to the physics are interpolated from those of `source`, a recording
    of the same condition, view and frame times.  Raises BadInput, SolverFailure.
    """
    assert prediction.full_run is not None
    view = hypothesis.view
    seen = predict_again(replace(task, views=(view,), forces=()), prediction.full_run, view, problem.stated_model)
    columns: dict[ParameterId, Single] = {}
    valid = seen.inside.copy()
    for p, values in _interpolate_columns(prediction.observables[source.file], source.recording, view.recording):
        if p not in seen.columns:
            columns[p] = values
            valid &= np.isfinite(values).all(axis=0)
    if not valid.any():
        raise BadInput(f"{view.file}: no pixel of it would be valid")
    masked = np.where(valid, view.recording.temperature, np.nan)
    view = replace(view, recording=replace(view.recording, temperature=masked))
    own = {p: flatten_valid_pixels(np.nan_to_num(values), seen.inside) for p, values in columns.items()}
    observable = replace(seen, columns=seen.columns | own)
    return replace(hypothesis, view=view), replace(prediction, observables={view.file: observable})


def _interpolate_columns(
    observable: Observable, source: Recording, wanted: Recording
) -> Iterator[tuple[ParameterId, Single]]:
    """Sensitivities as images (frames, nv, nu) on the pixels of another recording, NaN beyond those of the source."""
    weights = [_linear_weights(getattr(source, axis), getattr(wanted, axis)) for axis in ("v", "u")]
    images = np.full(observable.values.shape, np.nan, np.float32)
    for p, values in observable.columns.items():
        images[:, observable.inside] = values
        yield p, _interpolate_axis(_interpolate_axis(images, weights[0], 1), weights[1], 2)


def resample_images(observable: Observable, source: RecordingEntry, wanted: RecordingEntry) -> Array:
    """Predicted images (frames, nv, nu) at the times and pixels of another recording, NaN where not predicted.

    Interpolation is linear between frames and pixels, which is accurate enough to compare images.
    """
    a, b = source.recording, wanted.recording
    images = np.where(observable.inside, observable.values, np.nan).astype(np.float32)
    if not has_same_times(source, wanted):
        at = np.clip(b.time, a.time[0], a.time[-1])
        images = _interpolate_axis(images, _linear_weights(a.time, at), 0)
    images = _interpolate_axis(images, _linear_weights(a.v, b.v), 1)
    return np.asarray(_interpolate_axis(images, _linear_weights(a.u, b.u), 2), float)


def _linear_weights(centres: Array, at: Array) -> Weights:
    """Lower and upper index (n,) of the centres around each position, and weight of the upper; NaN outside."""
    position = np.interp(at, centres, np.arange(len(centres)), left=np.nan, right=np.nan)
    near = np.rint(np.nan_to_num(position))
    position = np.where(np.abs(position - near) < 1e-6, near, position)
    low = np.floor(np.nan_to_num(position)).astype(int)
    high = np.minimum(low + (position > low), len(centres) - 1)
    return low, high, (position - low).astype(np.float32)


def _interpolate_axis(images: Single, weights: Weights, axis: int) -> Single:
    low, high, share = weights
    share = share.reshape([-1 if k == axis else 1 for k in range(images.ndim)])
    lower = images.take(low, axis)
    return np.asarray(lower + share * (images.take(high, axis) - lower), np.float32)


def has_same_times(first: RecordingEntry, second: RecordingEntry) -> bool:
    """Whether the frames of two recordings are at the same times."""
    a, b = first.recording, second.recording
    if len(a.time) != len(b.time) or first.means != second.means:
        return False
    return bool(np.allclose(a.time, b.time, rtol=0.0, atol=TIME_TOLERANCE * max(float(a.time[-1]), 1e-12)))


def is_schedule_possible(view: RecordingEntry, scene: Scene) -> bool:
    """Whether the frames of a recording can belong to the schedule of a scene."""
    try:
        check_recording(view, scene)
    except FlashtempError:
        return False
    return True
