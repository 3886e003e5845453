"""Measured less predicted as whitened columns: every recording and trace with noise, nuisances and derivatives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from flashtemp.comparison.campaign import Force, View
from flashtemp.comparison.compare import levels, scatter
from flashtemp.comparison.noise import Noise, beyond_stated, noise, unwhiten, whiten
from flashtemp.discovery.estimation.camera_error_columns import camera_columns
from flashtemp.discovery.estimation.linear_gaussian import Array, Block, gram_matrices
from flashtemp.discovery.estimation.model_discrepancy import discrepancy_basis
from flashtemp.discovery.estimation.nuisance_priors import GROUPS, camera_smooth_basis
from flashtemp.discovery.estimation.outlier_rejection import calibrated_residual
from flashtemp.discovery.parameters import PLACED, Kind, ParameterId
from flashtemp.discovery.prediction.prediction import Observable, Prediction, Single, flatten_valid_pixels
from flashtemp.discovery.prediction.problem import Problem
from flashtemp.errors import BadInput, SolverFailure
from flashtemp.solver.run import Run

# small, or of unknown shape: their first traces serve all fits
FIXED = (Kind.SCATTER, Kind.MODE, Kind.TREND)
SURE = 3.0  # standard deviations of a clock within which a frame may be of another phase
ANCHOR = "friction.mu"  # the free key that a condition may have a level of its own for


@dataclass(frozen=True)
class Fixed:
    """Whitened columns `F` (n, f) of some `names`, and their products `FF` (f, f)."""

    names: tuple[ParameterId, ...]
    F: Single
    FF: Array


@dataclass(frozen=True)
class Data:
    """What is kept from the first predictions, so that all hypotheses are compared alike.

    `noises` of recordings and `sigmas` of load-cell traces by file; `known` what of them is compared, `fixed` columns
    that stay as they are, whitened.  Pixels `inside` (nv, nu) of images with noise of rows and columns.
    """

    problem: Problem
    noises: dict[str, Noise]
    sigmas: dict[str, float]
    known: dict[str, npt.NDArray[np.bool_]]
    fixed: dict[str, Fixed]
    inside: dict[str, npt.NDArray[np.bool_]] = field(default_factory=dict)

    @classmethod
    def begin(
        cls, problem: Problem, first: Sequence[Prediction], coarse: Sequence[Sequence[Prediction]] = (),
        noises: Mapping[str, Noise] | None = None,
    ) -> Data:  # fmt: skip
        """Keep traces of what is small and of unknown shape, differences to predictions on coarser meshes, and noise.

        What `noises` does not give is what a campaign states or, last, what the data show.  Raises BadInput.
        """
        data = cls(problem, dict(noises or {}), {}, {}, {})
        for condition, fine, *rough in zip(problem.conditions, first, *coarse, strict=True):
            for entry in condition.entries:
                seen = fine.observables[entry.file]
                own = {p: v for p, v in seen.columns.items() if p.kind in FIXED}
                own |= _mesh(seen, [other.observables[entry.file] for other in rough])
                if isinstance(entry, View):
                    rest = calibrated_residual(entry, seen)
                    own |= camera_smooth_basis(entry, seen) | discrepancy_basis(entry, seen)
                    own |= camera_columns(entry.recording, seen, rest, _speed(fine.run, entry.recording.time))
                    known = np.isfinite(_left(entry, seen)[:, seen.inside])
                    data.known[entry.file] = known & ~_starting(entry, fine.run)[:, None]
                    if entry.file not in data.noises:
                        data.noises[entry.file] = _noise(entry, seen, rest)
                    if not data.noises[entry.file].lines.is_none:
                        data.inside[entry.file] = seen.inside
                else:
                    own[ParameterId(Kind.CELL)] = seen.values
                    good = data.known[entry.file] = seen.inside & np.isfinite(seen.values)
                    data.sigmas[entry.file] = entry.sigma or scatter((np.array(entry.mu) - seen.values)[good])
                F = data._stack(entry, own)
                data.fixed[entry.file] = Fixed(tuple(own), F, gram_matrices([F])[0])
        return data

    def blocks(self, predictions: Sequence[Prediction], first: int = 0) -> list[Block]:
        """One block per recording and trace; conditions are numbered from `first`."""
        return [
            self.block(number, entry, prediction.observables[entry.file])
            for number, (c, prediction) in enumerate(zip(self.problem.conditions, predictions, strict=True), first)
            for entry in c.entries
        ]

    def block(self, number: int, entry: View | Force, seen: Observable) -> Block:
        """One recording or trace as predicted, of a condition with a number."""
        fixed = self.fixed[entry.file]
        own = {p: v for p, v in seen.columns.items() if p not in fixed.names}
        names = self._names([*own, *fixed.names], number, entry)
        r, C = self._residual(entry, seen), self._stack(entry, own)
        return Block(entry.file, number, entry.held_out, r, C, names, fixed.F, fixed.FF)

    def kelvin(self, file: str, whitened: Array) -> Array:
        """What is whitened (n,), as it was: of a recording (frames, pixels inside) K, of a trace (n,) friction; 0 where
        nothing is compared."""
        known = self.known[file]
        out = np.zeros(known.shape)
        if file in self.sigmas:
            out[known] = self.sigmas[file] * whitened
            return out
        spread = np.full(known.shape, np.nan)
        spread[known] = whitened
        out[known] = unwhiten(self._image(file, spread), self.noises[file])[:, self._inside(file)][known]
        return out

    def _inside(self, file: str) -> npt.NDArray[np.bool_]:
        """Pixels (nv, nu) of an image whose values are kept; all in one row where it does not matter where they lie."""
        inside = self.inside.get(file)
        return np.ones((1, self.known[file].shape[1]), bool) if inside is None else inside

    def _image(self, file: str, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Values (frames, pixels inside) as images (frames, nv, nu), NaN outside."""
        inside = self._inside(file)
        out = np.full((len(values), *inside.shape), np.nan)
        out[:, inside] = values
        return out

    def _names(
        self, columns: list[ParameterId], number: int, entry: View | Force
    ) -> tuple[tuple[ParameterId, int], ...]:
        """Names under which columns are known: those of one recording or condition carry its name."""
        out = []
        for i, p in enumerate(columns):
            out.append((p.within(number, entry.file), i))
            if p.kind in PLACED and isinstance(entry, View):  # all recordings of a view may have it alike
                out.append((ParameterId(p.kind, name=entry.recording.view), i))
            if p.kind is Kind.KEY and p.name == ANCHOR and p in self.problem.free:
                out.append((ParameterId(Kind.LEVEL, condition=number), i))
            if p.kind is Kind.MODE:
                out.append((ParameterId(Kind.FLUX, p.index, condition=number), i))
        return tuple(out)

    def _residual(self, entry: View | Force, seen: Observable) -> Array:
        """Measured less predicted (n,) in sigma.  Raises SolverFailure where nothing is predicted any more."""
        left = _left(entry, seen)[:, seen.inside] if isinstance(entry, View) else np.array(entry.mu) - seen.values
        if left.shape != self.known[entry.file].shape or not np.isfinite(left[self.known[entry.file]]).all():
            raise SolverFailure(f"{entry.file}: the model no longer predicts all that was measured")
        return self._white(entry, left)

    def _white(self, entry: View | Force, values: npt.NDArray[Any]) -> Array:
        """What belongs to an observable, (frames, pixels inside) K or (n,), in sigma (n,)."""
        known = self.known[entry.file]
        if isinstance(entry, Force):
            return np.asarray(values, float)[known] / self.sigmas[entry.file]
        images = self._image(entry.file, np.where(known, values, np.nan))
        return whiten(images, self.noises[entry.file])[:, self._inside(entry.file)][known]

    def _stack(self, entry: View | Force, columns: Mapping[ParameterId, npt.NDArray[Any]]) -> Single:
        """The columns (n, k) whitened, one after the other: two at once would be much memory."""
        out = np.empty((np.count_nonzero(self.known[entry.file]), len(columns)), np.float32, order="F")
        for k, values in enumerate(columns.values()):
            out[:, k] = self._white(entry, values)
        return out


def _mesh(seen: Observable, rough: list[Observable]) -> dict[ParameterId, npt.NDArray[Any]]:
    """Differences to predictions on coarser meshes."""
    out = {}
    for k, other in enumerate(rough):
        change = seen.values - other.values
        out[ParameterId(Kind.MESH, (k,))] = flatten_valid_pixels(change, seen.inside) if change.ndim == 3 else change
    return out


def _noise(view: View, seen: Observable, rest: Array) -> Noise:
    """The noise of a recording, stated or estimated; of lines from the `rest` (frames, nv, nu) K of a first fit."""
    found = noise(_left(view, seen), *levels(view), view.means.frames if view.means else None, rest)
    return beyond_stated(found, view.recording, rest)


def _speed(run: Run, time: Array) -> Array:
    """Speed of sliding (frames,) m/s at the times of frames."""
    speed = np.abs(np.diff(run.slid)) / np.maximum(np.diff(run.time), 1e-12)
    later = np.searchsorted(run.time, time) - 1
    return np.asarray(speed[np.clip(later, 0, len(speed) - 1)])


def _starting(view: View, run: Run) -> npt.NDArray[np.bool_]:
    """Frames (frames,) of a wake so near to a start that its clock says whether there is a wake: no tangent tells."""
    t = view.recording.time
    way = run.sliding * (1 if run.direction is None else run.direction)
    turns = (np.diff(way, prepend=0) != 0) | (np.diff(run.repetition, prepend=0) > 0)  # with a wait, and without
    begun = np.flatnonzero(run.sliding & turns)
    if view.recording.view != "wake" or not len(begun):
        return np.zeros(len(t), bool)
    starts = run.time[np.maximum(begun - 1, 0)]  # a wait is recorded to its end
    near = (np.abs(t[:, None] - starts) < SURE * GROUPS[Kind.CLOCK]).any(axis=1)
    return near if not near.all() else np.zeros(len(t), bool)


def _left(view: View, seen: Observable) -> Array:
    """Measured less predicted (frames, nv, nu) K, NaN where not compared."""
    left = np.where(seen.inside, view.recording.temperature - seen.values, np.nan)
    if not np.isfinite(left).any():
        raise BadInput(
            f"{view.file}: no pixel of it lies on the block or the road, clear of their edges; check u, v and view"
        )
    return left
