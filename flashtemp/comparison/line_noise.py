"""Noise of rows and columns, fixed and from frame to frame: components of the 3-D noise model of infrared imagers.

D'Agostino & Webb, Proc. SPIE 1488 (1991) 110, name them by what they vary along: v and h stay, tv and th are new in
every frame.  `whiten_lines` makes them as small as the noise of single pixels; it is linear and has an inverse.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
MAD_TO_SD = 1.482602218505602  # standard deviation over median absolute deviation of a normal distribution
MAD_EFFICIENCY = 0.37  # of the MAD (Rousseeuw & Croux 1993)
DIFFERENCE_WEIGHTS = {2: np.array([1.0, -2.0, 1.0]), 4: np.array([1.0, -4.0, 6.0, -4.0, 1.0])}  # second and fourth
MIN_LINES_FOURTH_ORDER, MIN_DIFFERENCES = (
    9,
    4,
)  # lines for fourth differences, and differences of which a scale is taken
CHANCE_LIMIT_SDS = 3.09  # one of a thousand: standard deviations beyond which a component is more than chance


@dataclass(frozen=True)
class LineNoise:
    """Standard deviations, K: of rows and columns of pixels, that stay (`rows`, `columns`), and of single frames."""

    rows: float = 0.0
    columns: float = 0.0
    frame_rows: float = 0.0
    frame_columns: float = 0.0

    @property
    def is_none(self) -> bool:
        return not (self.rows or self.columns or self.frame_rows or self.frame_columns)


NO_LINES = LineNoise()


def estimate_line_noise(residual: Array, white: float, pattern: float) -> LineNoise:
    """Components of residuals (frames, nv, nu) K, NaN where masked; those that chance explains are none.

    From fourth differences of the means of neighbouring lines (second ones of few lines), which what is smooth, such as
    heat that fades away from the contact, hardly changes.
    """
    known = np.isfinite(residual)
    frames = max(int(known.any(axis=(1, 2)).sum()), 1)
    found: dict[str, float] = {}
    steps = np.diff(residual, axis=0) / np.sqrt(2.0) if len(residual) > 2 else residual[:0]
    count = known.sum(axis=0)
    mean = np.where(count > 0, np.sum(residual, axis=0, where=known) / np.maximum(count, 1), np.nan)[None]
    for axis, name in ((2, "rows"), (1, "columns")):
        own = _excess_variance(steps, axis, white**2, 0.0) if len(steps) else 0.0
        stays = _excess_variance(mean, axis, white**2 / frames + pattern**2, own / frames)
        found |= {f"frame_{name}": float(np.sqrt(own)), name: float(np.sqrt(stays))}
    return LineNoise(**found)


def _excess_variance(images: Array, axis: int, pixel: float, line: float) -> float:
    """Variance (K^2) of the means along an `axis` of images beyond what variances of a pixel and of a line explain."""
    known = np.isfinite(images)
    count = known.sum(axis=axis)
    lines = np.where(count > 1, np.sum(images, axis=axis, where=known) / np.maximum(count, 1), np.nan)
    weights = DIFFERENCE_WEIGHTS[4 if lines.shape[1] >= MIN_LINES_FOURTH_ORDER else 2]
    if lines.shape[1] <= len(weights):
        return 0.0
    usual = line + pixel * _combine_lines(1.0 / np.maximum(count, 1), weights**2) / np.sum(weights**2)
    ratio = _combine_lines(lines, weights) / np.sqrt(np.sum(weights**2) * usual)
    known = ratio[np.isfinite(ratio)]
    chance = CHANCE_LIMIT_SDS * np.sqrt(
        2.0 / (MAD_EFFICIENCY * max(len(known), 1) / (0.5 * len(weights)))
    )  # differences overlap
    if len(known) < MIN_DIFFERENCES or _robust_variance(known) < 1.0 + chance:
        return 0.0
    beyond = max(min(map(_robust_variance, _split_halves(ratio))) - 1.0, 0.0)
    return beyond * float(np.nanmedian(usual))


def _split_halves(ratio: Array) -> list[Array]:
    """Halves of neighbouring lines, where each has enough of them: noise of lines is the same in both, what a model
    misses lies near the contact or an edge."""
    known = np.flatnonzero(np.isfinite(ratio).any(axis=0))
    parts = [ratio[:, part] for part in np.array_split(known, 2 if len(known) >= 2 * MIN_DIFFERENCES else 1)]
    return [part[np.isfinite(part)] for part in parts]


def _robust_variance(ratio: Array) -> float:
    """Robust variance about zero."""
    return (MAD_TO_SD * float(np.median(np.abs(ratio)))) ** 2


def _combine_lines(lines: Array, weights: Array) -> Array:
    """Sums (images, n) of neighbouring lines with some weights."""
    out: Array = np.lib.stride_tricks.sliding_window_view(lines, len(weights), axis=1) @ weights
    return out


@dataclass(frozen=True)
class LineWhitening:
    """A linear map of residuals (frames, nv, nu) in sigma, white but for noise of lines, to white ones, and back.

    `known` what has a value, `along` what stays, as a unit vector over the frames of each pixel; by axis, variances of
    lines over those of a pixel: of what is new in each frame, and of all that stays.  Exact where the same pixels are
    known in all frames and only rows, or only columns, have noise.  With both, the mean of a whole frame, which either
    contains, counts for less than it could.
    """

    known: npt.NDArray[np.bool_]
    along: Array
    variances: tuple[tuple[int, float, float], ...]

    @classmethod
    def from_values(
        cls, values: Array, weight: Array | float, white: float, pattern: float, lines: LineNoise
    ) -> LineWhitening:
        """For values NaN where unknown, `weight` frames of the camera in each, with noise of pixels `white` and
        `pattern`, K."""
        known = np.isfinite(values)
        n = (known * weight).sum(axis=0)
        along = np.where(known, np.sqrt(weight), 0.0) / np.sqrt(np.maximum(n, 1e-12))
        frames = float(np.median(n[n > 0])) if (n > 0).any() else 1.0
        still = white**2 + frames * pattern**2
        variances = tuple(
            (axis, (fresh / white) ** 2, (frames * stays**2 + fresh**2) / still)
            for axis, stays, fresh in ((2, lines.rows, lines.frame_rows), (1, lines.columns, lines.frame_columns))
        )
        return cls(known, along, variances)

    def __call__(self, values: Array) -> Array:
        """White ones."""
        fresh = np.where(self.known, values, 0.0)
        for axis, times in self._frame_factors():
            fresh = _scale_line_means(fresh, self.known, axis, times)
        return self._scale_static_part(fresh, self._static_factors())

    def inverse(self, whitened: Array) -> Array:
        """What gave white ones."""
        values = self._scale_static_part(
            np.where(self.known, whitened, 0.0), [(a, 1.0 / t) for a, t in self._static_factors()[::-1]]
        )
        for axis, times in self._frame_factors()[::-1]:
            values = _scale_line_means(values, self.known, axis, 1.0 / times)
        return np.where(self.known, values, np.nan)

    def _frame_factors(self) -> list[tuple[int, Array]]:
        """Factors on the means of lines of each frame, by the axis along which these are taken."""
        return [
            (axis, 1.0 / np.sqrt(1.0 + now * self.known.sum(axis=axis, keepdims=True)))
            for axis, now, _ in self.variances
        ]

    def _static_factors(self) -> list[tuple[int, Array]]:
        """The same of what stays, which `_frame_factors` has made smaller already."""
        some = np.any(self.known, axis=0, keepdims=True)
        counts = [some.sum(axis=axis, keepdims=True) for axis, _, _ in self.variances]
        return [
            (axis, np.sqrt((1.0 + count * now) / (1.0 + count * still)))
            for count, (axis, now, still) in zip(counts, self.variances, strict=True)
        ]

    def _scale_static_part(self, values: Array, factors: list[tuple[int, Array]]) -> Array:
        """Values with the means of lines of their part that stays times some factors."""
        some = np.any(self.known, axis=0, keepdims=True)
        still = np.sum(self.along * values, axis=0)[None]
        new = still
        for axis, times in factors:
            new = _scale_line_means(new, some, axis, times)
        return np.where(self.known, values + self.along * (new - still), np.nan)


def _scale_line_means(x: Array, known: npt.NDArray[np.bool_], axis: int, times: Array) -> Array:
    """Values whose mean over known ones along an axis is `times` as large, all else as it was."""
    count = np.maximum(known.sum(axis=axis, keepdims=True), 1)
    mean = np.sum(x, axis=axis, keepdims=True, where=known) / count
    return np.where(known, x + (times - 1.0) * mean, 0.0)
