"""Noise of rows and columns, fixed and temporal: components of the 3-D noise model of infrared imagers.

D'Agostino & Webb, Proc. SPIE 1488 (1991) 110, name them by the directions along which they vary: v and h are constant,
t, tv and th are new in every frame.  At shutter events a camera corrects the nonuniformity of its detector, which
renews a part of the constant noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy.stats import chi2

Array = npt.NDArray[np.float64]
MAD_TO_SD = 1.482602218505602  # standard deviation over median absolute deviation of a normal distribution
MAD_EFFICIENCY = 0.37  # statistical efficiency of the MAD (Rousseeuw & Croux 1993)
DIFFERENCE_WEIGHTS = {2: np.array([1.0, -2.0, 1.0]), 4: np.array([1.0, -4.0, 6.0, -4.0, 1.0])}  # second and fourth
MIN_LINES_FOURTH_ORDER = 9  # lines, or frames, needed for fourth differences
MIN_DIFFERENCES = 4  # differences needed for an estimate of scale
MAX_RENEWALS = 10  # in a recording; noise that drifts is cut into so many parts
MIN_LINES_ALONE = 20  # differences of rows or of columns from which their renewal is judged alone
FALSE_ALARMS = 1e-3  # renewals that chance finds in a recording
AXES = ROWS_AXIS, COLUMNS_AXIS = 2, 1  # along which rows and columns of images (frames, nv, nu) extend
CHANCE_LIMIT_SDS = 3.09  # standard deviations, exceeded by chance once in a thousand


@dataclass(frozen=True)
class LineNoise:
    """Standard deviations, K, of rows and columns: constant ones, those new in every frame, and those that a shutter
    event renews; and of whole `frames`."""

    rows: float = 0.0
    columns: float = 0.0
    frame_rows: float = 0.0
    frame_columns: float = 0.0
    renewed_rows: float = 0.0
    renewed_columns: float = 0.0
    frames: float = 0.0

    @property
    def is_none(self) -> bool:
        return not (self.frames or any(any(levels) for _, *levels in self.by_axis()))

    def by_axis(self) -> tuple[tuple[int, float, float, float], ...]:
        """Levels by the axis along which lines extend: new in every frame, renewed, constant."""
        return (
            (ROWS_AXIS, self.frame_rows, self.renewed_rows, self.rows),
            (COLUMNS_AXIS, self.frame_columns, self.renewed_columns, self.columns),
        )


NO_LINES = LineNoise()


def estimate_line_noise(
    residual: Array,
    white: float,
    pattern: float,
    find_renewals: bool = False,
    weights: Array | None = None,
    known_renewals: tuple[int, ...] = (),
) -> tuple[LineNoise, tuple[int, ...]]:
    """Line noise of residuals (frames, nv, nu) K, NaN where masked, and the first frame after each renewal of it.

    It is estimated from fourth differences between the means of neighbouring lines (second differences of few lines).
    Smooth structure, such as heat that fades away from the contact, hardly enters them.  Components that chance may
    make are 0, unless lines have noise in every frame, which errors of a model hardly make: then all are as found.
    `weights` (frames,): number of camera frames in each frame; all noise is that of a camera frame.  With
    `find_renewals`, more are searched between those that are known already.
    """
    weights = np.ones(len(residual)) if weights is None else weights
    temporal = _temporal_variances(residual, white, False, weights)
    renewals = _find_renewals(residual, white, temporal, weights, known_renewals) if find_renewals else ()
    found = _measure_lines(residual, white, pattern, renewals, False, weights)
    is_certain = bool(found.frame_rows or found.frame_columns)
    return _measure_lines(residual, white, pattern, renewals, True, weights) if is_certain else found, renewals


def _temporal_variances(residual: Array, white: float, is_certain: bool, weights: Array) -> list[float]:
    """Variances (K2) of rows and of columns that are new in every frame."""
    if len(residual) < 3:
        return [0.0, 0.0]
    steps = np.diff(residual, axis=0) / np.sqrt(1.0 / weights[1:] + 1.0 / weights[:-1])[:, None, None]
    return [_excess_variance(steps, axis, white**2, 0.0, is_certain) for axis in AXES]


def _measure_lines(
    residual: Array, white: float, pattern: float, renewals: tuple[int, ...], is_certain: bool, weights: Array
) -> LineNoise:
    """All components; unless line noise `is_certain`, those that chance may make are 0."""
    temporal = _temporal_variances(residual, white, is_certain, weights)
    parts = [np.split(a, list(renewals)) for a in (residual, weights)]
    frames = np.array(
        [max(float(w[np.isfinite(part).any(axis=(1, 2))].sum()), 1.0) for part, w in zip(*parts, strict=True)]
    )
    changes = np.diff([frame_mean(part, w) for part, w in zip(*parts, strict=True)], axis=0) / np.sqrt(2.0)
    each = 0.5 * (1.0 / frames[1:] + 1.0 / frames[:-1])[:, None]
    mean, total = frame_mean(residual, weights)[None], float(frames.sum())
    constant, renewed = [], []
    for axis, now in zip(AXES, temporal, strict=True):
        change = _excess_variance(changes, axis, white**2 * each, now * each, is_certain) if renewals else 0.0
        renewed.append(change)
        known = now / total + change * float(np.sum(frames**2.0)) / total**2
        constant.append(_excess_variance(mean, axis, white**2 / total + pattern**2, known, is_certain))
    whole = _frame_variance(residual, white, temporal, weights)
    return LineNoise(*(float(np.sqrt(variance)) for variance in (*constant, *temporal, *renewed, whole)))


def _frame_variance(residual: Array, white: float, temporal: list[float], weights: Array) -> float:
    """Variance (K2) that whole frames have anew, from differences in time of their means; 0 if insignificant.

    They are fourth differences (second of few frames), because the mean of many pixels shows the least curvature.
    """
    always = np.asarray(np.isfinite(residual).all(axis=0))
    rows, columns = (max(int(always.any(axis=axis).sum()), 1) for axis in (1, 0))
    factors = DIFFERENCE_WEIGHTS[4 if len(residual) >= MIN_LINES_FOURTH_ORDER else 2]
    is_enough = always.any() and len(residual) >= len(factors)
    steps = _combine_lines(residual[:, always].mean(axis=1)[None], factors)[0] if is_enough else np.zeros(0)
    if len(steps) < MIN_DIFFERENCES:
        return 0.0
    expected = white**2 / max(int(np.count_nonzero(always)), 1) + temporal[0] / rows + temporal[1] / columns
    each = np.sqrt(_combine_lines(1.0 / weights[None], factors**2)[0])
    ratio = _robust_mean_square(steps / each) / expected
    freedom = MAD_EFFICIENCY * len(steps) / (0.5 * len(factors))
    return (ratio - 1.0) * expected if ratio > chi2.isf(FALSE_ALARMS, freedom) / freedom else 0.0


def frame_mean(residual: Array, weights: Array | None = None) -> Array:
    """Mean over frames (nv, nu) with `weights` (frames,), NaN where no frame has a value."""
    known = np.isfinite(residual)
    if weights is None or np.all(weights == 1.0):
        total, n = np.sum(residual, axis=0, where=known), known.sum(axis=0)
    else:
        each = weights[:, None, None]
        total, n = np.sum(residual * each, axis=0, where=known), np.sum(known * each, axis=0)
    return np.where(n > 0, total / np.maximum(n, 1), np.nan)


def _find_renewals(
    residual: Array, white: float, temporal: list[float], weights: Array, known: tuple[int, ...] = ()
) -> tuple[int, ...]:
    """First frame after each renewal of line noise, by binary segmentation (Vostrikova, Sov. Math. Dokl. 24, 1981, 55).

    A segment is split where the rows, the columns, or both before and after differ most, if that is more than chance:
    the robust mean square of all of them, so that errors of a model near the contact or an edge cannot cause it.  Few
    lines scatter too much to be judged alone.  The `known` renewals are among the result.
    """
    rows, columns = (
        _line_differences(residual, axis, white**2, now, weights) for axis, now in zip(AXES, temporal, strict=True)
    )
    both = tuple(np.concatenate(pair, axis=-1) for pair in zip(rows, columns, strict=True))
    lines = [both, *(part for part in (rows, columns) if len(part[2]) >= MIN_LINES_ALONE)]
    chance = FALSE_ALARMS / (len(lines) * max(len(residual), 1))
    freedoms = [MAD_EFFICIENCY * max(float(independent.sum()), 1.0) for *_, independent in lines]
    limits = [chi2.isf(chance, freedom) / freedom for freedom in freedoms]

    def best_split(first: int, last: int) -> tuple[float, int, int, int]:
        """The largest ratio to its limit, where it splits the segment, and the segment."""
        found = (0.0, 0)
        for k in range(first + 2, last - 1):
            ratios = (_split_ratio(values, precision, first, k, last) for values, precision, _ in lines)
            found = max(found, (max(ratio / limit for ratio, limit in zip(ratios, limits, strict=True)), k))
        return *found, first, last

    renewals = list(known)
    segments = [best_split(*ends) for ends in pairwise((0, *known, len(residual)))]
    while segments and len(renewals) < len(known) + MAX_RENEWALS:
        size, split, first, last = segments.pop(segments.index(max(segments)))
        if size <= 1.0:
            break
        renewals.append(split)
        segments += [best_split(first, split), best_split(split, last)]
    return tuple(sorted(renewals))


def _line_differences(
    residual: Array, axis: int, pixel: float, line: float, weights: Array
) -> tuple[Array, Array, Array]:
    """Differences (frames, n) of neighbouring line means, their precisions (0 where unknown), and the number (n,) of
    independent ones for which each counts."""
    known = np.isfinite(residual)
    count = known.sum(axis=axis)
    mean = np.where(count > 1, np.sum(residual, axis=axis, where=known) / np.maximum(count, 1), np.nan)
    factors = DIFFERENCE_WEIGHTS[4 if mean.shape[1] >= MIN_LINES_FOURTH_ORDER else 2]
    if mean.shape[1] <= len(factors):
        return np.zeros((len(residual), 0)), np.zeros((len(residual), 0)), np.zeros(0)
    values = _combine_lines(mean, factors)
    variance = _combine_lines(pixel / np.maximum(count, 1) + line, factors**2)
    precision = np.where(np.isfinite(values), weights[:, None] / variance, 0.0)
    return np.nan_to_num(values), precision, np.full(values.shape[1], 2.0 / len(factors))


def _split_ratio(values: Array, precision: Array, first: int, split: int, last: int) -> float:
    """Robust mean square of the differences between the means before and after a split, in units of noise."""
    halves = (slice(first, split), slice(split, last))
    weight = [precision[half].sum(axis=0) for half in halves]
    both = (weight[0] > 0.0) & (weight[1] > 0.0)
    if np.count_nonzero(both) < 2 * MIN_DIFFERENCES:
        return 0.0
    mean = [
        np.sum(precision[half] * values[half], axis=0)[both] / w[both] for half, w in zip(halves, weight, strict=True)
    ]
    return _robust_mean_square((mean[1] - mean[0]) / np.sqrt(1.0 / weight[0][both] + 1.0 / weight[1][both]))


def _excess_variance(images: Array, axis: int, pixel: Array | float, line: Array | float, is_certain: bool) -> float:
    """Variance (K2) of the line means along an `axis` in excess of that from variances of a `pixel` and a `line`.

    Unless line noise `is_certain`, it must exceed chance, and is that of the half of the lines that has less.
    """
    known = np.isfinite(images)
    count = known.sum(axis=axis)
    lines = np.where(count > 1, np.sum(images, axis=axis, where=known) / np.maximum(count, 1), np.nan)
    weights = DIFFERENCE_WEIGHTS[4 if lines.shape[1] >= MIN_LINES_FOURTH_ORDER else 2]
    if lines.shape[1] <= len(weights):
        return 0.0
    expected = line + pixel * _combine_lines(1.0 / np.maximum(count, 1), weights**2) / np.sum(weights**2)
    ratio = _combine_lines(lines, weights) / np.sqrt(np.sum(weights**2) * expected)
    known = ratio[np.isfinite(ratio)]
    if len(known) < MIN_DIFFERENCES:
        return 0.0
    found = _robust_mean_square(known)
    if not is_certain:
        # overlapping differences count as len/(0.5 len(weights)) independent ones
        chance = CHANCE_LIMIT_SDS * np.sqrt(2.0 / (MAD_EFFICIENCY * len(known) / (0.5 * len(weights))))
        found = min(map(_robust_mean_square, _split_halves(ratio))) if found > 1.0 + chance else 0.0
    return max(found - 1.0, 0.0) * float(np.nanmedian(expected))


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
