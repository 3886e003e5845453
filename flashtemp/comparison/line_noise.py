"""Noise of rows and columns, fixed and temporal: components of the 3-D noise model of infrared imagers.

D'Agostino & Webb, Proc. SPIE 1488 (1991) 110, name them by the directions along which they vary: v and h are constant,
tv and th are new in every frame.  `LineWhitening` reduces them to the noise of single pixels; it is linear and
invertible.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
MAD_TO_SD = 1.482602218505602  # standard deviation over median absolute deviation of a normal distribution
MAD_EFFICIENCY = 0.37  # statistical efficiency of the MAD (Rousseeuw & Croux 1993)
DIFFERENCE_WEIGHTS = {2: np.array([1.0, -2.0, 1.0]), 4: np.array([1.0, -4.0, 6.0, -4.0, 1.0])}  # second and fourth
MIN_LINES_FOURTH_ORDER = 9  # lines needed for fourth differences
MIN_DIFFERENCES = 4  # differences needed for an estimate of scale
CHANCE_LIMIT_SDS = 3.09  # standard deviations, exceeded by chance once in a thousand


@dataclass(frozen=True)
class LineNoise:
    """Standard deviations, K, of rows and columns: constant ones (`rows`, `columns`) and those new in every frame."""

    rows: float = 0.0
    columns: float = 0.0
    frame_rows: float = 0.0
    frame_columns: float = 0.0

    @property
    def is_none(self) -> bool:
        return not (self.rows or self.columns or self.frame_rows or self.frame_columns)


NO_LINES = LineNoise()


def estimate_line_noise(residual: Array, white: float, pattern: float) -> LineNoise:
    """Line noise of residuals (frames, nv, nu) K, NaN where masked; insignificant components are 0.

    Estimated from fourth differences between the means of neighbouring lines (second differences of few lines).  Smooth
    structure, such as heat that fades away from the contact, hardly enters them.
    """
    known = np.isfinite(residual)
    frames = max(int(known.any(axis=(1, 2)).sum()), 1)
    components: dict[str, float] = {}
    steps = np.diff(residual, axis=0) / np.sqrt(2.0) if len(residual) > 2 else residual[:0]
    count = known.sum(axis=0)
    mean = np.where(count > 0, np.sum(residual, axis=0, where=known) / np.maximum(count, 1), np.nan)[None]
    for axis, name in ((2, "rows"), (1, "columns")):
        temporal = _excess_variance(steps, axis, white**2, 0.0) if len(steps) else 0.0
        constant = _excess_variance(mean, axis, white**2 / frames + pattern**2, temporal / frames)
        components |= {f"frame_{name}": float(np.sqrt(temporal)), name: float(np.sqrt(constant))}
    return LineNoise(**components)


def _excess_variance(images: Array, axis: int, pixel: float, line: float) -> float:
    """Variance (K^2) of the line means along an `axis` in excess of that from variances of a `pixel` and a `line`."""
    known = np.isfinite(images)
    count = known.sum(axis=axis)
    lines = np.where(count > 1, np.sum(images, axis=axis, where=known) / np.maximum(count, 1), np.nan)
    weights = DIFFERENCE_WEIGHTS[4 if lines.shape[1] >= MIN_LINES_FOURTH_ORDER else 2]
    if lines.shape[1] <= len(weights):
        return 0.0
    expected = line + pixel * _combine_lines(1.0 / np.maximum(count, 1), weights**2) / np.sum(weights**2)
    ratio = _combine_lines(lines, weights) / np.sqrt(np.sum(weights**2) * expected)
    known = ratio[np.isfinite(ratio)]
    # overlapping differences count as len/(0.5 len(weights)) independent ones
    chance = CHANCE_LIMIT_SDS * np.sqrt(2.0 / (MAD_EFFICIENCY * max(len(known), 1) / (0.5 * len(weights))))
    if len(known) < MIN_DIFFERENCES or _robust_mean_square(known) < 1.0 + chance:
        return 0.0
    excess = max(min(map(_robust_mean_square, _split_halves(ratio))) - 1.0, 0.0)
    return excess * float(np.nanmedian(expected))


def _split_halves(ratio: Array) -> list[Array]:
    """Ratios of two halves of the lines, if each has enough of them.

    Line noise is the same in both halves, while errors of a model lie near the contact or an edge.
    """
    known = np.flatnonzero(np.isfinite(ratio).any(axis=0))
    parts = [ratio[:, part] for part in np.array_split(known, 2 if len(known) >= 2 * MIN_DIFFERENCES else 1)]
    return [part[np.isfinite(part)] for part in parts]


def _robust_mean_square(normalised: Array) -> float:
    """Mean square of values about zero from their median magnitude; 1 for normal values of unit variance."""
    return (MAD_TO_SD * float(np.median(np.abs(normalised)))) ** 2


def _combine_lines(lines: Array, weights: Array) -> Array:
    """Weighted sums (images, n) of neighbouring lines."""
    out: Array = np.lib.stride_tricks.sliding_window_view(lines, len(weights), axis=1) @ weights
    return out


@dataclass(frozen=True)
class LineWhitening:
    """Invertible linear map from residuals (frames, nv, nu) in sigma with line noise to white ones.

    `known`: pixels with a value.  `along`: the constant part of each pixel, as a unit vector over frames.  `variances`:
    by axis, the line variances over those of a pixel, first of the part new in each frame, then of all that is
    constant.  Exact if the same pixels are known in all frames and only rows, or only columns, have noise.  With both,
    the mean of a whole frame, which rows and columns contain, has too small a weight.
    """

    known: npt.NDArray[np.bool_]
    along: Array
    variances: tuple[tuple[int, float, float], ...]

    @classmethod
    def from_values(
        cls, values: Array, weight: Array | float, white: float, pattern: float, lines: LineNoise
    ) -> LineWhitening:
        """Map for `values`, NaN where unknown, of `weight` camera frames each; pixel noise `white`, `pattern` in K."""
        known = np.isfinite(values)
        n = (known * weight).sum(axis=0)
        along = np.where(known, np.sqrt(weight), 0.0) / np.sqrt(np.maximum(n, 1e-12))
        frames = float(np.median(n[n > 0])) if (n > 0).any() else 1.0
        constant = white**2 + frames * pattern**2
        variances = tuple(
            (axis, (temporal / white) ** 2, (frames * fixed**2 + temporal**2) / constant)
            for axis, fixed, temporal in ((2, lines.rows, lines.frame_rows), (1, lines.columns, lines.frame_columns))
        )
        return cls(known, along, variances)

    def __call__(self, values: Array) -> Array:
        """White residuals (frames, nv, nu), NaN where unknown."""
        whitened = np.where(self.known, values, 0.0)
        for axis, factor in self._frame_factors():
            whitened = _scale_line_means(whitened, self.known, axis, factor)
        return self._scale_static_part(whitened, self._constant_factors())

    def inverse(self, whitened: Array) -> Array:
        """Residuals with line noise from white ones."""
        values = self._scale_static_part(
            np.where(self.known, whitened, 0.0), [(a, 1.0 / t) for a, t in self._constant_factors()[::-1]]
        )
        for axis, factor in self._frame_factors()[::-1]:
            values = _scale_line_means(values, self.known, axis, 1.0 / factor)
        return np.where(self.known, values, np.nan)

    def _frame_factors(self) -> list[tuple[int, Array]]:
        """Factors on the line means of each frame, with the axis of these means."""
        return [
            (axis, 1.0 / np.sqrt(1.0 + now * self.known.sum(axis=axis, keepdims=True)))
            for axis, now, _ in self.variances
        ]

    def _constant_factors(self) -> list[tuple[int, Array]]:
        """Factors on the line means of the constant part, which `_frame_factors` has reduced already."""
        some = np.any(self.known, axis=0, keepdims=True)
        counts = [some.sum(axis=axis, keepdims=True) for axis, _, _ in self.variances]
        return [
            (axis, np.sqrt((1.0 + count * now) / (1.0 + count * constant)))
            for count, (axis, now, constant) in zip(counts, self.variances, strict=True)
        ]

    def _scale_static_part(self, values: Array, factors: list[tuple[int, Array]]) -> Array:
        """Values with the line means of their constant part multiplied by `factors`."""
        some = np.any(self.known, axis=0, keepdims=True)
        constant = np.sum(self.along * values, axis=0)[None]
        scaled = constant
        for axis, factor in factors:
            scaled = _scale_line_means(scaled, some, axis, factor)
        return np.where(self.known, values + self.along * (scaled - constant), np.nan)


def _scale_line_means(x: Array, known: npt.NDArray[np.bool_], axis: int, factor: Array) -> Array:
    """Values with their means over known ones along an axis multiplied by `factor`, deviations unchanged."""
    count = np.maximum(known.sum(axis=axis, keepdims=True), 1)
    mean = np.sum(x, axis=axis, keepdims=True, where=known) / count
    return np.where(known, x + (factor - 1.0) * mean, 0.0)
