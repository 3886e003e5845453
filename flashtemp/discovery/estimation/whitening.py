"""Whitened data: residuals and columns of every recording and load-cell record, in standard deviations of the noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from flashtemp.camera.prediction.observation import PSF_TAIL_WIDTHS
from flashtemp.camera.quantisation import quantisation_step
from flashtemp.comparison.campaign import LoadCellEntry, RecordingEntry
from flashtemp.comparison.compare import estimate_reading_noise, stated_noise
from flashtemp.comparison.noise import NoiseLevels, estimate_noise, raise_stated_noise
from flashtemp.comparison.noise_whitening import NoiseWhitening
from flashtemp.discovery.estimation.camera_error_columns import camera_columns
from flashtemp.discovery.estimation.linear_gaussian import Array, DataBlock, gram_matrices
from flashtemp.discovery.estimation.model_discrepancy import discrepancy_basis
from flashtemp.discovery.estimation.nuisance_priors import NUISANCE_SD, camera_smooth_basis
from flashtemp.discovery.estimation.outlier_rejection import calibrated_residual
from flashtemp.discovery.parameters import PLACEMENT_KINDS, ParameterId, ParameterKind
from flashtemp.discovery.prediction.mesh_extrapolation import coarser_mesh_factors, error_per_difference
from flashtemp.discovery.prediction.prediction import Observable, Prediction, Single, flatten_valid_pixels
from flashtemp.discovery.prediction.problem import Problem
from flashtemp.errors import BadInput, SolverFailure
from flashtemp.solver.run import Run

# small, or of unknown shape: their sensitivities from the first predictions are used in all fits
FIXED_KINDS = (ParameterKind.SCATTER, ParameterKind.MODE, ParameterKind.TREND)
MODEL_KINDS = (ParameterKind.LEVEL, ParameterKind.MESH)  # whose columns come from simulations too
BLURRED_CELLS = 2.0  # over which an edge that moves along the road is blurred
CLOCK_STANDARD_DEVIATIONS = 3.0  # of the clock prior, within which a frame may belong to another phase
FRICTION_LEVEL_KEY = "friction.mu"  # where it is a free key, its derivatives are those of the level of a condition too


@dataclass(frozen=True)
class FixedColumns:
    """Whitened columns `F` (n, f) of some `names`, and their products `FF` (f, f)."""

    names: tuple[ParameterId, ...]
    F: Single
    FF: Array


@dataclass(frozen=True)
class WhitenedData:
    """Noise, masks and fixed columns from the first predictions, the same for all hypotheses.

    By file: `noises` of recordings, `sigmas` of load-cell records, `is_compared` (frames, valid pixels) or (n,),
    whitened columns `fixed` that are not computed again, valid pixels `inside` (nv, nu) of images with line noise, and
    `whitenings` of recordings.
    """

    problem: Problem
    noises: dict[str, NoiseLevels]
    sigmas: dict[str, float]
    is_compared: dict[str, npt.NDArray[np.bool_]]
    fixed: dict[str, FixedColumns]
    inside: dict[str, npt.NDArray[np.bool_]] = field(default_factory=dict)
    whitenings: dict[str, NoiseWhitening] = field(default_factory=dict)

    @classmethod
    def from_predictions(
        cls, problem: Problem, first: Sequence[Prediction], coarser: Sequence[Sequence[Prediction]] = (),
        noises: Mapping[str, NoiseLevels] | None = None,
    ) -> WhitenedData:  # fmt: skip
        """Whitened data with fixed columns from `first` and mesh columns from predictions on `coarser` meshes.

        Noise that is not in `noises` is stated by the campaign or else estimated from the data.  Raises BadInput.
        """
        data = cls(problem, dict(noises or {}), {}, {}, {})
        for condition, fine, *rough in zip(problem.conditions, first, *coarser, strict=True):
            for entry in condition.entries:
                seen = fine.observables[entry.file]
                own = {p: v for p, v in seen.columns.items() if p.kind in FIXED_KINDS}
                own |= _friction_level(problem, own)
                own |= _mesh_errors(problem, seen, [other.observables[entry.file] for other in rough])
                if isinstance(entry, RecordingEntry):
                    # noise is estimated from what no smooth shape explains: a missing effect is not noise
                    known = np.isfinite(_image_residual(entry, seen)[:, seen.inside])
                    known &= ~_is_starting_road(entry, seen, fine.run)
                    rest = calibrated_residual(entry, seen)
                    rest[:, seen.inside] = np.where(known, rest[:, seen.inside], np.nan)
                    data.is_compared[entry.file] = known
                    if entry.file not in data.noises:
                        data.noises[entry.file] = _recording_noise(entry, seen, rest)
                    noise = data.noises[entry.file]
                    if not noise.lines.is_none:
                        data.inside[entry.file] = seen.inside
                    images = np.isfinite(data._as_images(entry.file, np.where(known, 0.0, np.nan)))
                    data.whitenings[entry.file] = NoiseWhitening.from_known(images, noise)
                    own |= _image_errors(entry, seen, rest, fine.run, noise)
                else:
                    own[ParameterId(ParameterKind.CELL)] = seen.values
                    good = data.is_compared[entry.file] = seen.inside & np.isfinite(seen.values)
                    data.sigmas[entry.file] = entry.sigma or estimate_reading_noise(
                        (np.array(entry.mu) - seen.values)[good]
                    )
                F = data._whiten_columns(entry, own)
                data.fixed[entry.file] = FixedColumns(tuple(own), F, gram_matrices([F])[0])
        return data

    def with_image_errors_of(
        self, predictions: Sequence[Prediction], meshes: Sequence[Sequence[Prediction]] = ()
    ) -> WhitenedData:
        """The data with the columns of camera and model errors computed anew, for predictions of a calibrated model.

        These errors multiply with the place of an image, so they are not those of an image that lies elsewhere.
        Offsets of whole frames stay: the jumps among them show in the residual of the first predictions.  `meshes`:
        the stated model on its own mesh and on coarser ones, seen as in the predictions, for columns of the mesh error.
        """
        fixed = dict(self.fixed)
        for condition, prediction, *runs in zip(self.problem.conditions, predictions, *meshes, strict=True):
            for view in condition.views:
                seen, old = prediction.observables[view.file], self.fixed[view.file]
                own = _image_errors(view, seen, None, prediction.run, self.noises[view.file])
                if runs:
                    fine, *rough = (r.observables[view.file] for r in runs)
                    own |= _mesh_errors(self.problem, fine, rough)
                same = (*FIXED_KINDS, *MODEL_KINDS, ParameterKind.OFFSET)
                kept = [k for k, p in enumerate(old.names) if p.kind in same and p not in own]
                F = np.hstack([old.F[:, kept], self._whiten_columns(view, own)])
                names = (*(old.names[k] for k in kept), *own)
                fixed[view.file] = FixedColumns(names, F, gram_matrices([F])[0])
        return replace(self, fixed=fixed)

    def update_block(self, block: DataBlock) -> DataBlock:
        """A block that was made before, with the fixed columns of these data."""
        fixed, own = self.fixed[block.label], block.C.shape[1]
        if block.F is fixed.F:
            return block
        entry = next(e for c in self.problem.conditions for e in c.entries if e.file == block.label)
        shared = self._column_names(list(fixed.names), block.condition, entry)
        names = (*((p, k) for p, k in block.names if k < own), *((p, own + k) for p, k in shared))
        return replace(block, names=names, F=fixed.F, FF=fixed.FF)

    def make_blocks(self, predictions: Sequence[Prediction], first: int = 0) -> list[DataBlock]:
        """One block for each recording and load-cell record; conditions are numbered from `first`."""
        return [
            self.make_block(number, entry, prediction.observables[entry.file])
            for number, (c, prediction) in enumerate(zip(self.problem.conditions, predictions, strict=True), first)
            for entry in c.entries
        ]

    def make_block(self, number: int, entry: RecordingEntry | LoadCellEntry, predicted: Observable) -> DataBlock:
        """The block of one recording or load-cell record of a condition."""
        fixed = self.fixed[entry.file]
        own = {p: v for p, v in predicted.columns.items() if p not in fixed.names}
        names = self._column_names([*own, *fixed.names], number, entry)
        r, C = self._whitened_residual(entry, predicted), self._whiten_columns(entry, own)
        return DataBlock(entry.file, number, entry.held_out, r, C, names, fixed.F, fixed.FF)

    def to_kelvin(self, file: str, whitened: Array) -> Array:
        """Undo the whitening of values (n,): (frames, valid pixels) K of a recording, or (n,) friction of a load-cell
        record; 0 where nothing is compared."""
        known = self.is_compared[file]
        out = np.zeros(known.shape)
        if file in self.sigmas:
            out[known] = self.sigmas[file] * whitened
            return out
        spread = np.full(known.shape, np.nan)
        spread[known] = whitened
        images = self.whitenings[file].restore_residual(self._as_images(file, spread))
        out[known] = images[:, self._pixel_mask(file)][known]
        return out

    def _pixel_mask(self, file: str) -> npt.NDArray[np.bool_]:
        """Valid pixels (nv, nu) of an image; all in one row if their positions do not matter for the noise."""
        inside = self.inside.get(file)
        return np.ones((1, self.is_compared[file].shape[1]), bool) if inside is None else inside

    def _as_images(self, file: str, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Values (frames, valid pixels) as images (frames, nv, nu), NaN elsewhere."""
        inside = self._pixel_mask(file)
        out = np.full((len(values), *inside.shape), np.nan)
        out[:, inside] = values
        return out

    def _column_names(
        self, columns: list[ParameterId], number: int, entry: RecordingEntry | LoadCellEntry
    ) -> tuple[tuple[ParameterId, int], ...]:
        """Pairs of parameter and column number; some columns belong to several parameters."""
        out = []
        for i, p in enumerate(columns):
            out.append((p.with_scope(number, entry.file), i))
            if p.kind in PLACEMENT_KINDS and isinstance(
                entry, RecordingEntry
            ):  # all recordings of a view may have it alike
                out.append((ParameterId(p.kind, name=entry.recording.view), i))
            if p in self.problem.free_keys and p.name == FRICTION_LEVEL_KEY:
                out.append((ParameterId(ParameterKind.LEVEL, condition=number), i))
            if p.kind is ParameterKind.MODE:
                out.append((ParameterId(ParameterKind.FLUX, p.index, condition=number), i))
        return tuple(out)

    def _whitened_residual(self, entry: RecordingEntry | LoadCellEntry, predicted: Observable) -> Array:
        """Measured minus predicted (n,) in standard deviations.  SolverFailure if a compared datum is missing."""
        left = (
            _image_residual(entry, predicted)[:, predicted.inside]
            if isinstance(entry, RecordingEntry)
            else np.array(entry.mu) - predicted.values
        )
        if (
            left.shape != self.is_compared[entry.file].shape
            or not np.isfinite(left[self.is_compared[entry.file]]).all()
        ):
            raise SolverFailure(f"{entry.file}: the model no longer predicts all measured values")
        return self._whiten_values(entry, left)

    def _whiten_values(self, entry: RecordingEntry | LoadCellEntry, values: npt.NDArray[Any]) -> Array:
        """Values of an observable, (frames, valid pixels) K or (n,), in standard deviations (n,)."""
        known = self.is_compared[entry.file]
        if isinstance(entry, LoadCellEntry):
            return np.asarray(values, float)[known] / self.sigmas[entry.file]
        images = self._as_images(entry.file, np.where(known, values, np.nan))
        return self.whitenings[entry.file](images)[:, self._pixel_mask(entry.file)][known]

    def _whiten_columns(
        self, entry: RecordingEntry | LoadCellEntry, columns: Mapping[ParameterId, npt.NDArray[Any]]
    ) -> Single:
        """The whitened columns (n, k), computed one by one to save memory."""
        out = np.empty((np.count_nonzero(self.is_compared[entry.file]), len(columns)), np.float32, order="F")
        for k, values in enumerate(columns.values()):
            out[:, k] = self._whiten_values(entry, values)
        return out


def _friction_level(problem: Problem, columns: Mapping[ParameterId, Single]) -> dict[ParameterId, Single]:
    """Friction of a condition, all repetitions together; empty where friction itself is a free key."""
    scatter = [c for p, c in columns.items() if p.kind is ParameterKind.SCATTER]
    if not scatter or FRICTION_LEVEL_KEY in problem.campaign.free:
        return {}
    return {ParameterId(ParameterKind.LEVEL): np.sum(scatter, axis=0)}


def _mesh_errors(
    problem: Problem, predicted: Observable, coarser: list[Observable]
) -> dict[ParameterId, npt.NDArray[Any]]:
    """What a prediction lacks by its mesh, in each direction, by Richardson extrapolation from coarser meshes."""
    out = {}
    for k, (other, factors) in enumerate(zip(coarser, coarser_mesh_factors(problem.case), strict=False)):
        error = (predicted.values - other.values) * error_per_difference(problem.case, factors)
        out[ParameterId(ParameterKind.MESH, (k,))] = (
            flatten_valid_pixels(error, predicted.inside) if error.ndim == 3 else error
        )
    return out


def _image_errors(
    view: RecordingEntry, predicted: Observable, rest: Array | None, run: Run, noise: NoiseLevels
) -> dict[ParameterId, npt.NDArray[Any]]:
    """Columns of errors that no simulation contains: those of the camera, and of a model at this prediction.

    `rest` (frames, nv, nu) K: residual of a first fit, None without offsets of the camera.
    """
    out: dict[ParameterId, npt.NDArray[Any]] = dict(camera_smooth_basis(view, predicted))
    out |= discrepancy_basis(view, predicted)
    speed = _sliding_speed(run, view.recording.time)
    return out | camera_columns(view.recording, predicted, rest, speed, noise.renewals)


def _recording_noise(view: RecordingEntry, predicted: Observable, rest: Array) -> NoiseLevels:
    """The noise of a recording, stated or estimated; of lines from the `rest` (frames, nv, nu) K of a first fit."""
    averaged, residual = view.means.frames if view.means else None, _image_residual(view, predicted)
    recording = view.recording
    step = quantisation_step(recording.temperature)
    found = estimate_noise(residual, *stated_noise(view), averaged, rest, recording.frames_after_frozen, step)
    return raise_stated_noise(found, recording, rest)


def _sliding_speed(run: Run, time: Array) -> Array:
    """Sliding speed (frames,) m/s at the times of frames."""
    speed = np.abs(np.diff(run.slid)) / np.maximum(np.diff(run.time), 1e-12)
    later = np.searchsorted(run.time, time) - 1
    return np.asarray(speed[np.clip(later, 0, len(speed) - 1)])


def _is_starting_road(view: RecordingEntry, seen: Observable, run: Run) -> npt.NDArray[np.bool_]:
    """Valid pixels of a wake (frames, pixels) on road that the block covered when it began to slide, or beyond it.

    The heat in that road depends on how the block was set down and accelerated, which the schedule idealises, and its
    edges are blurred by the cells that they cross.  Frames so near to a start that their wake exists or not by the
    clock belong to it.  Nothing is left out if nothing else would remain.
    """
    r = view.recording
    starts, slid_before, ways = _find_starts(run)
    if r.view != "wake" or not len(starts):
        return np.zeros((r.frames, np.count_nonzero(seen.inside)), bool)
    unsure = CLOCK_STANDARD_DEVIATIONS * NUISANCE_SD[ParameterKind.CLOCK]
    near = np.asarray((np.abs(r.time[:, None] - starts) < unsure).any(axis=1))
    begun = np.maximum(np.searchsorted(starts, r.time, "right") - 1, 0)
    x, first, last = run.mesh.x, run.mesh.first, run.mesh.last
    is_right = float(np.median(r.u)) > 0.0
    # sliding the other way, the block comes back over the road in view
    sign = np.where(ways == (1 if is_right else -1), 1.0, -1.0)
    met = np.zeros(len(starts))
    for k in range(1, len(starts)):
        met[k] = 0.0 if sign[k] > 0.0 else met[k - 1] + sign[k - 1] * (slid_before[k] - slid_before[k - 1])
    slid = met[begun] + sign[begun] * (np.interp(r.time, run.time, run.slid) - slid_before[begun])
    if is_right:
        behind, nodes = r.u - x[last], x[last:] - x[last]
    else:  # of a block that slides back
        behind, nodes = x[first] - r.u, (x[first] - x[: first + 1])[::-1]
    covered = slid - (x[last] - x[first])
    cells = np.interp(covered, 0.5 * (nodes[1:] + nodes[:-1]), np.diff(nodes))
    blurred = BLURRED_CELLS * cells + PSF_TAIL_WIDTHS * (r.psf_sigma_px or 0.0) * r.pitch[0]
    early = near[:, None] | (behind > (covered - blurred)[:, None])
    for mask in (early, near[:, None]):
        out = np.broadcast_to(mask[:, None], (r.frames, *seen.inside.shape))[:, seen.inside]
        if not out.all():
            return out
    return np.zeros_like(out)


def _find_starts(run: Run) -> tuple[Array, Array, npt.NDArray[np.int_]]:
    """Times (s) at which sliding begins or turns, the distance (m) slid by then, and the direction from then on."""
    way = run.sliding * (1 if run.direction is None else run.direction)
    turns = (np.diff(way, prepend=0) != 0) | (np.diff(run.repetition, prepend=0) > 0)  # with a wait, and without
    first = np.flatnonzero(run.sliding & turns)
    begun = np.maximum(first - 1, 0)  # a wait is recorded to its end
    return run.time[begun], run.slid[begun], way[first]


def _image_residual(view: RecordingEntry, predicted: Observable) -> Array:
    """Measured minus predicted (frames, nv, nu) K, NaN where not compared."""
    left = np.where(predicted.inside, view.recording.temperature - predicted.values, np.nan)
    if not np.isfinite(left).any():
        raise BadInput(f"{view.file}: no pixel is on the block or the road, away from their edges; check u, v and view")
    return left
