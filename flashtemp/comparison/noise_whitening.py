"""Whitening: the linear, invertible map from residuals with the noise of a camera to independent ones of unit variance.

The noise of a pixel or of a line is new in every frame, new in every interval between two shutter events, or constant.
What is constant in an interval acts on the mean of its frames alone.  These means are a few values per pixel, whose
covariance matrix has a square root in closed form.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from flashtemp.comparison.noise import NoiseLevels

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
VALUES_PER_BATCH = 1_000_000  # of matrices on pixels


def whiten_residual(residual: Array, noise: NoiseLevels) -> Array:
    """Whitened residuals (frames, nv, nu) in sigma, NaN where unknown; those of noise alone are independent."""
    return NoiseWhitening.from_known(np.isfinite(residual), noise)(residual)


@dataclass(frozen=True)
class NoiseWhitening:
    """The map for values that are `known` (frames, nv, nu).

    `along` (frames, nv, nu): the part of each pixel that is constant in an interval, a unit vector over the frames of
    each.  `starts` (intervals,): first frame of each; `counts` (intervals, nv, nu): known camera frames in it.
    Exact if the same pixels are known in all frames, and one noise alone is constant, that of rows or of columns.  With
    both, the mean of an interval, which rows and columns contain, has too small a weight.
    """

    noise: NoiseLevels
    known: Mask
    along: Array
    starts: tuple[int, ...]
    counts: Array

    @classmethod
    def from_known(cls, known: Mask, noise: NoiseLevels) -> NoiseWhitening:
        """The map of residuals with these levels of noise, `known` (frames, nv, nu)."""
        starts = (0, *(k for k in noise.renewals if 0 < k < len(known)))
        weight = known * noise.frame_weights()
        counts = np.add.reduceat(weight, starts, axis=0, dtype=float)
        lengths = np.sqrt(np.maximum(counts, 1e-12))
        return cls(noise, known, np.sqrt(weight) / lengths[_interval_numbers(starts, len(known))], starts, counts)

    def __call__(self, residual: Array) -> Array:
        """White residuals (frames, nv, nu), NaN where unknown."""
        out = np.where(self.known, residual, 0.0) * self._frame_scale
        out = self._scale_intervals(out, self._pixel_factors[0])
        if not self.noise.lines.is_none:
            for axis, factor in self._frame_factors():
                out = _scale_line_means(out, self.known, axis, factor)
            out = self._scale_interval_lines(out, list(self._line_factors(-0.5)))
        return np.where(self.known, out, np.nan)

    def restore_residual(self, whitened: Array) -> Array:
        """Residuals (frames, nv, nu) K from white ones, NaN where unknown."""
        out = np.where(self.known, whitened, 0.0)
        if not self.noise.lines.is_none:
            out = self._scale_interval_lines(out, list(self._line_factors(0.5))[::-1])
            for axis, factor in self._frame_factors()[::-1]:
                out = _scale_line_means(out, self.known, axis, 1.0 / factor)
        out = self._scale_intervals(out, self._pixel_factors[1])
        return np.where(self.known, out / self._frame_scale, np.nan)

    @property
    def _frame_scale(self) -> Array | float:
        return np.sqrt(self.noise.frame_weights()) / self.noise.white

    # --- means of the intervals ---------------------------------------------------------------------------
    def _interval_means(self, values: Array) -> Array:
        """Coefficients (intervals, nv, nu) of values along the constant part of each interval."""
        return np.asarray(np.add.reduceat(self.along * values, self.starts, axis=0))

    def _with_interval_means(self, values: Array, change: Array) -> Array:
        return values + self.along * change[_interval_numbers(self.starts, len(values))]

    @cached_property
    def _pixel_factors(self) -> tuple[Array, Array]:
        """Matrices (different counts, intervals, intervals) on the interval means of pixels, that whiten them and back,
        for each of the `_different_counts`."""
        covariances = [
            _interval_covariance(n, self.noise.renewed_pattern, self.noise.pattern) for n in self._different_counts[0]
        ]
        variance, shape = np.linalg.eigh(np.eye(len(self.starts)) + self.noise.white**-2.0 * np.array(covariances))
        forth, back = ((shape * variance[:, None] ** power) @ np.swapaxes(shape, 1, 2) for power in (-0.5, 0.5))
        return forth, back

    @cached_property
    def _different_counts(self) -> tuple[Array, npt.NDArray[np.int64]]:
        """The different `counts` (n, intervals) of pixels, and the number (pixels,) of that of each pixel."""
        each, number = np.unique(self.counts.reshape(len(self.starts), -1), axis=1, return_inverse=True)
        return each.T, np.ravel(number)

    def _scale_intervals(self, values: Array, factors: Array) -> Array:
        if not (self.noise.pattern or self.noise.renewed_pattern):
            return values
        means, number = self._interval_means(values), self._different_counts[1]
        change, pixels = -means.reshape(len(means), -1), means.reshape(len(means), -1)
        if len(factors) == 1:
            change += factors[0] @ pixels
        else:  # a few pixels at a time, because a matrix for each of all would need much memory
            batch = max(1, VALUES_PER_BATCH // factors[0].size)
            for part in (slice(k, k + batch) for k in range(0, len(number), batch)):
                change[:, part] += np.einsum("pkl,lp->kp", factors[number[part]], pixels[:, part])
        return self._with_interval_means(values, change.reshape(means.shape))

    # --- lines --------------------------------------------------------------------------------------------
    def _line_variances(self) -> Iterator[tuple[int, float, Array]]:
        """By axis: variance of lines that is new in each frame, and covariance (intervals, intervals) of the interval
        means of lines, each over those of a pixel."""
        noise, some = self.noise, self.counts.sum(axis=0) > 0
        n = np.median(self.counts[:, some], axis=1) if some.any() else np.ones(len(self.starts))
        pixel = np.eye(len(n)) + noise.white**-2.0 * _interval_covariance(n, noise.renewed_pattern, noise.pattern)
        root = _matrix_power(pixel, -0.5)
        for axis, now, renewed, fixed in noise.lines.by_axis():
            line = now**2 * np.eye(len(n)) + _interval_covariance(n, renewed, fixed)
            yield axis, (now / noise.white) ** 2, noise.white**-2.0 * root @ line @ root

    def _frame_factors(self) -> list[tuple[int | tuple[int, int], Array]]:
        """Factors on the line means of each frame and on its mean, with the axis of these means."""
        out, product, total = [], 1.0, 1.0
        frame = (1, 2)
        for axis, now, _ in self._line_variances():
            line = now * self.known.sum(axis=axis, keepdims=True)
            out.append((axis, 1.0 / np.sqrt(1.0 + line)))
            mean = line.sum(axis=frame, keepdims=True) / np.maximum((line > 0).sum(axis=frame, keepdims=True), 1)
            product, total = product * (1.0 + mean), total + mean
        whole = (self.noise.lines.frames / self.noise.white) ** 2 * self.known.sum(axis=frame, keepdims=True)
        return [*out, (frame, np.sqrt(product / (total + whole)))]  # rows and columns contain the mean of the frame

    def _line_factors(self, power: float) -> Iterator[tuple[int, Array]]:
        """Matrices (intervals, intervals, nv, nu) on the line means of interval means that `_frame_factors` has reduced
        (`power` -1/2), or back (1/2), with 1 in place of the axis of these means."""
        some = self.known.any(axis=0)
        for axis, now, covariance in self._line_variances():
            count = some.sum(axis=axis - 1, keepdims=True)
            variance, shape = np.linalg.eigh(covariance)
            factor = (1.0 + variance[:, None, None] * count) ** power * (1.0 + now * count) ** -power
            yield axis, np.einsum("ka,avu,la->klvu", shape, factor, shape)

    def _scale_interval_lines(self, values: Array, factors: list[tuple[int, Array]]) -> Array:
        means, some = self._interval_means(values), self.known.any(axis=0)
        scaled = means
        for axis, factor in factors:
            count = np.maximum(some.sum(axis=axis - 1, keepdims=True), 1)
            line = np.sum(scaled, axis=axis, keepdims=True, where=some) / count
            scaled = np.where(some, scaled + np.einsum("klvu,lvu->kvu", factor, line) - line, 0.0)
        return self._with_interval_means(values, scaled - means)


def _interval_numbers(starts: tuple[int, ...], frames: int) -> npt.NDArray[np.int64]:
    """Number of the interval (frames,) to which each frame belongs."""
    return np.searchsorted(starts, np.arange(frames), side="right") - 1


def _interval_covariance(counts: Array, renewed: float, fixed: float) -> Array:
    """Covariance (intervals, intervals) K2 of interval means times root `counts`, of noise that each interval has anew
    and noise that all have alike."""
    root = np.sqrt(counts)
    return renewed**2 * np.diag(counts) + fixed**2 * np.outer(root, root)


def _matrix_power(matrix: Array, power: float) -> Array:
    """Power of a symmetric positive definite matrix."""
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray((vectors * values**power) @ vectors.T)


def _scale_line_means(x: Array, known: Mask, axis: int | tuple[int, int], factor: Array) -> Array:
    """Values with their means over known ones along an axis multiplied by `factor`, deviations unchanged."""
    count = np.maximum(known.sum(axis=axis, keepdims=True), 1)
    mean = np.sum(x, axis=axis, keepdims=True, where=known) / count
    return np.where(known, x + (factor - 1.0) * mean, 0.0)
