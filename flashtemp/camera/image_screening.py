"""Screening of a recording from its own frames: bad pixels, bad lines, frozen frames and shutter events.

Robust methods with published names: scales from the median absolute deviation (Rousseeuw & Croux, J. Am. Stat. Assoc.
88, 1993, 1273), outliers against order statistics of neighbours (conditional rank filter; Tukey 1977, Pitas &
Venetsanopoulos 1990) and over time, components of noise in space and time as in the 3-D noise model (D'Agostino &
Webb, Proc. SPIE 1488, 1991).  Every threshold follows from FALSE_ALARMS by Bonferroni's inequality.

Three conditions distinguish defects from edges and real heat.  A value must lie outside the range of its neighbours
along both axes, unlike an edge or a corner.  It must be sharper than the point spread of the optics allows.  And it
must be equal in the coldest and the hottest frames, or change at random.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from flashtemp.camera.camera_classes import CAMERA_CLASSES
from flashtemp.camera.quantisation import (
    add_dither,
    likeliest_digit_probability,
    quantisation_step,
    remove_dither,
)

if TYPE_CHECKING:
    from flashtemp.camera.recording import Recording

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
FALSE_ALARMS = 0.01  # expected number per recording and kind of defect
MAD_TO_SD = 1.482602218505602  # standard deviation over median absolute deviation of a normal distribution
MAD_EFFICIENCY = 0.37  # statistical efficiency of the MAD (Rousseeuw & Croux 1993), for degrees of freedom
MIN_CAMERA_NOISE_K = 1e-3  # K: frames with less noise were computed, not measured
USUAL_PSF_PX = 0.7  # px, standard deviation of the point spread where a recording states none
PIXEL_APERTURE_SD_PX = 12.0**-0.5  # standard deviation of a pixel's own aperture, px
COMMON_STEP_FRACTION = 0.98  # fraction of the pixels that a step of the offset must explain,
COMMON_STEP_SDS = 3.0  # within so many standard deviations
MAX_SCREENED_VALUES = 10_000_000  # values of the evenly spaced frames in which pixels and lines are tested
BATCH = 64  # frames that are processed at a time
NEIGHBOURS_PER_SIDE = 2  # neighbours on each side
MIN_SCALE_PIXELS = 30  # pixels needed for an estimate of scale
FLICKER_SIGMA = 3.0  # standard deviations of pixel noise by which a line must flicker to be masked
MIN_DIFFERENCE_FRACTION = 0.5  # half the mean square successive difference over the variance; 1 for independent frames


@dataclass(frozen=True, eq=False)
class ScreeningResult:
    """Defects of the camera in a recording (frames, nv, nu).

    `stuck`, `off_level` and `flickering` pixels (nv, nu); bad `rows` and `columns` by index; `frozen` frames (frames,)
    repeat the one before; `shutter_events` are indices of the first frame after a jump of the common offset.
    """

    stuck: Mask
    off_level: Mask
    flickering: Mask
    rows: tuple[int, ...]
    columns: tuple[int, ...]
    frozen: Mask
    shutter_events: tuple[int, ...]

    @property
    def bad_pixels(self) -> Mask:
        """Mask (nv, nu) of pixels that no comparison may use."""
        out = self.stuck | self.off_level | self.flickering
        out[list(self.rows)] = True
        out[:, list(self.columns)] = True
        return out

    @property
    def summary(self) -> str:
        """Defects in one line for people; empty where there are none."""
        single = ~self._line_mask
        found = (
            (int((self.stuck & single).sum()), "stuck pixel"),
            (int((self.off_level & ~self.stuck & single).sum()), "pixel off level"),
            (int((self.flickering & ~self.off_level & ~self.stuck & single).sum()), "flickering pixel"),
            (len(self.rows), "bad row"),
            (len(self.columns), "bad column"),
            (int(self.frozen.sum()), "frozen frame"),
        )
        parts = [f"{n} {_pluralise_defect(name, n)}" for n, name in found if n]
        jumps = len(self.shutter_events)
        left_out = f"left out {', '.join(parts)}" if parts else ""
        shutter = f"{jumps} {_pluralise_defect('shutter event', jumps)} found" if jumps else ""
        return "; ".join(filter(None, (left_out, shutter)))

    @property
    def _line_mask(self) -> Mask:
        out = np.zeros(self.stuck.shape, bool)
        out[list(self.rows)] = True
        out[:, list(self.columns)] = True
        return out

    def apply_to(self, recording: Recording) -> Recording:
        """The recording without frozen frames, NaN at bad pixels; the same object where there is nothing to mask."""
        out = recording
        if self.frozen.any():
            times = tuple(recording.time[self.frozen].tolist())
            out = replace(recording.select_frames(~self.frozen), frozen_times=times)
        bad = self.bad_pixels
        return replace(out, temperature=np.where(bad, np.nan, out.temperature)) if bad.any() else out


def _pluralise_defect(name: str, n: int) -> str:
    if n == 1:
        return name
    return name.replace("pixel off", "pixels off") if "pixel off" in name else f"{name}s"


def screen_recording(recording: Recording) -> ScreeningResult:
    """Defects of a recording's camera; points (thermocouples) and computed frames have none."""
    T = recording.temperature
    n, shape = len(T), T.shape[1:]
    none = np.zeros(shape, bool)
    clean = ScreeningResult(none, none, none, (), (), np.zeros(n, bool), ())
    if recording.places is not None or T[0].size < 3:
        return clean
    every = -(-T.size // MAX_SCREENED_VALUES)
    sigma = temporal_noise(T[::every])
    if not sigma > MIN_CAMERA_NOISE_K:
        return clean
    frozen = _find_frozen_frames(T)
    live = T[np.flatnonzero(~frozen)[::every]] if frozen.any() or every > 1 else T
    sharp = _sharpness_limit(recording.psf_sigma_px)
    stuck = _find_stuck_pixels(live, sigma)
    good = np.where(stuck, np.nan, live) if stuck.any() else live
    off_level, flickering = _find_bad_pixels(good, sigma, sharp)
    alone = np.where(off_level | flickering, np.nan, good)
    rows, columns = (_find_bad_lines(alone, stuck, axis, sigma, sharp) for axis in (1, 2))
    shown = recording.select_frames(~frozen) if frozen.any() else recording
    events = np.flatnonzero(~frozen)[find_shutter_events(shown.temperature, shown, sigma)]
    return ScreeningResult(stuck, off_level, flickering, rows, columns, frozen, tuple(map(int, events)))


def temporal_noise(T: Array, digit_step: float | None = None) -> float:
    """Standard deviation (K) of a pixel from frame to frame, robust against smooth heat, common offsets and edges.

    MAD of second differences along the image of first differences in time (without the latter for a single frame).
    `digit_step` (K): quantisation step of the camera, needed where `T` is a residual.
    """
    axis = 2 if T.shape[2] > 2 else 1
    digit = quantisation_step(T) if digit_step is None else digit_step
    T = add_dither(T, digit)
    steps = np.diff(np.diff(T, axis=0) if len(T) > 1 else T, n=2, axis=axis)
    return remove_dither(_mad_scale(steps) / np.sqrt(12.0 if len(T) > 1 else 6.0), digit)


def _mad_scale(values: Array) -> float:
    values = values[np.isfinite(values)]
    return MAD_TO_SD * float(np.median(np.abs(values - np.median(values)))) if len(values) else 0.0


def _outlier_limit(tests: int, sample: int) -> float:
    """Limit in standard deviations for so many `tests`, with a scale from a `sample` (Bonferroni, Student t)."""
    from scipy.stats import t

    return float(t.isf(0.5 * FALSE_ALARMS / max(tests, 1), max(MAD_EFFICIENCY * sample, 2.0)))


def _find_frozen_frames(T: Array) -> Mask:
    """Mask (frames,) of frames that repeat the one before in all values, unless coarse digits explain that."""
    out = np.zeros(len(T), bool)
    if len(T) < 3:
        return out
    same = np.array([np.mean(a == b) for a, b in zip(T[1:], T[:-1], strict=True)])
    known = np.array([np.isfinite(a).mean() for a in T[1:]])
    equal = same / np.maximum(known, 1e-9)
    usual = float(np.median(equal))  # fraction of pixels that repeat their value because of coarse digits
    by_chance = np.log(max(usual, 1e-12)) * known * T[0].size
    out[1:] = (equal == 1.0) & (known > 0) & (np.log(len(T)) + by_chance < np.log(FALSE_ALARMS))
    return out


def _find_stuck_pixels(T: Array, sigma: float) -> Mask:
    """Mask (nv, nu) of pixels that change less from frame to frame than noise alone.

    Differences of disjoint pairs of frames are independent.  The sum of their squares over 2 sigma^2 follows a
    chi-squared distribution, which real heat can only increase.  With coarse digits a pixel may repeat its value by
    chance: n values are all equal with a probability of at most p^(n - 1), where p is that of the likeliest digit.
    """
    from scipy.stats import chi2

    last = len(T) // 2 * 2
    step = T[1:last:2] - T[0:last:2]
    known = np.isfinite(step)
    pairs = known.sum(axis=0)
    total = np.sum(step**2, axis=0, where=known) / (2.0 * sigma**2)
    chance = chi2.cdf(total, np.maximum(pairs, 1))
    count = np.maximum(np.isfinite(T).sum(axis=0), 1)
    constant = np.nan_to_num(T, nan=-np.inf).max(axis=0) == np.nan_to_num(T, nan=np.inf).min(axis=0)
    # pairs of equal values that are not all the same are no sign of a defect
    still = np.where(constant, likeliest_digit_probability(T, sigma) ** (count - 1.0), total == 0.0)
    out: Mask = (pairs > 1) & (np.maximum(chance, still) * max(int((pairs > 1).sum()), 1) < FALSE_ALARMS)
    return out


def _sharpness_limit(psf_sigma_px: float | None) -> float:
    """Half the ratio of (first - second neighbour) to (peak - first neighbour) in the image of a point source."""
    sd = np.hypot(USUAL_PSF_PX if psf_sigma_px is None else psf_sigma_px, PIXEL_APERTURE_SD_PX)
    first, second = np.exp(-0.5 / sd**2), np.exp(-2.0 / sd**2)
    return float(0.5 * (first - second) / (1.0 - first))


def _excess_over_neighbours(T: Array, axis: int, sharp: float) -> Array:
    """Signed excess (K) of values over the range of their neighbours along an axis; 0 inside the range.

    The range is that of the four nearest neighbours without the most extreme one, extended by the linear extrapolation
    from either side, so that a hot edge is no excess.  The excess is 0 where the neighbours rise towards the value as
    in the image of a point, and where one of them is unknown, since one side cannot distinguish a defect from an edge.
    """
    T = np.moveaxis(T, axis, -1)
    out = np.zeros(T.shape)
    size = T.shape[-1] - 2 * NEIGHBOURS_PER_SIDE
    if size < 1:
        return np.moveaxis(out, -1, axis)
    near = np.stack([T[..., NEIGHBOURS_PER_SIDE + s : NEIGHBOURS_PER_SIDE + s + size] for s in (-2, -1, 1, 2)])
    value, ordered = T[..., NEIGHBOURS_PER_SIDE : NEIGHBOURS_PER_SIDE + size], np.sort(near, axis=0)
    sides = 2.0 * near[1] - near[0], 2.0 * near[2] - near[3]
    high, low = np.maximum.reduce((ordered[-2], *sides)), np.minimum.reduce((ordered[1], *sides))
    # comparisons with NaN are false
    excess = np.where(value > high, value - high, np.where(value < low, value - low, 0.0))
    rising = 0.5 * (near[1] + near[2] - near[0] - near[3]) * np.sign(excess)
    excess[(rising > sharp * np.abs(excess)) | ~np.isfinite(near).all(axis=0)] = 0.0
    out[..., NEIGHBOURS_PER_SIDE : NEIGHBOURS_PER_SIDE + size] = excess
    return np.moveaxis(out, -1, axis)


def _smaller_deviation(a: Array, b: Array) -> Array:
    """The smaller of two signed deviations, 0 where their signs differ."""
    same = np.sign(a) == np.sign(b)
    out: Array = np.where(same, np.sign(a) * np.minimum(np.abs(a), np.abs(b)), 0.0)
    return out


def _robust_sd(T: Array, axes: tuple[int, ...]) -> float:
    """Robust standard deviation (K) of values (maps, nv, nu) without smooth structure, along the quieter axis.

    From fourth differences, whose squared coefficients sum to 70; along short axes from second differences, 6.
    """
    orders = [(a, 4 if T.shape[a] > 8 else 2) for a in axes if T.shape[a] > 2]
    found = [_mad_scale(np.diff(T, n=order, axis=a)) / np.sqrt(70.0 if order == 4 else 6.0) for a, order in orders]
    return min(found, default=0.0)


def _mean_cold_and_hot_frames(T: Array) -> Array:
    """Mean (2, nv, nu) of the coldest and of the hottest quarter of the frames."""
    # the median of a frame, because defective pixels may not decide which frames are hot; a quarter, so that the mean
    # lowers the noise and the two still differ in heat: a defective pixel stands out in both, the scene does not
    level = np.array([np.median(a[np.isfinite(a)]) if np.isfinite(a).any() else np.nan for a in T])
    order = np.argsort(level)[: int(np.isfinite(level).sum())]
    k = max(1, len(order) // 4)
    return np.stack([_time_mean(T[order[:k]]), _time_mean(T[order[-k:]])])


def _time_mean(T: Array) -> Array:
    known = np.isfinite(T)
    count = known.sum(axis=0)
    out: Array = np.where(count > 0, np.sum(T, axis=0, where=known) / np.maximum(count, 1), np.nan)
    return out


def _static_outliers(T: Array, axes: tuple[int, ...], sigma: float, sharp: float) -> Mask:
    """Mask of values that stand out along all `axes`, equally in the coldest and in the hottest frames."""
    ends = _mean_cold_and_hot_frames(T)
    found = [_excess_over_neighbours(ends, a, sharp) for a in axes]
    out = found[0] if len(found) == 1 else _smaller_deviation(*found)
    far = np.maximum(np.abs(out[0]), np.abs(out[1]))
    both = np.abs(_smaller_deviation(out[0], out[1]))
    scale = max(_robust_sd(ends, axes), sigma / np.sqrt(max(len(T) // 4, 1)))
    tests = out[0].size
    mask: Mask = (both > _outlier_limit(tests, tests) * np.sqrt(1.5) * scale) & (both > 0.5 * far)
    return mask


def _flickering_outliers(T: Array, axes: tuple[int, ...], sigma: float, sharp: float) -> Mask:
    """Mask of values whose excess differs in at least two frames, beyond its trend with the surrounding heat."""
    if len(T) < 5:
        return np.zeros(T.shape[1:], bool)
    out, around = np.empty_like(T), np.empty_like(T)
    for begin in range(0, len(T), BATCH):
        part = slice(begin, begin + BATCH)
        found = [_excess_over_neighbours(T[part], a, sharp) for a in axes]
        out[part] = found[0] if len(found) == 1 else _smaller_deviation(*found)
        around[part] = _neighbour_mean(T[part], axes[0])
    around -= np.mean(around, axis=0)
    away = out - np.mean(out, axis=0)
    away -= around * (np.sum(around * away, axis=0) / np.maximum(np.sum(around**2, axis=0), 1e-12))
    limit = _outlier_limit(T.size, T[0].size) * np.sqrt(1.5) * sigma
    mask: Mask = (np.abs(away - np.median(away, axis=0)) > limit).sum(axis=0) > 1
    return mask


def _neighbour_mean(T: Array, axis: int) -> Array:
    """Mean of the two nearest neighbours along an axis, 0 where one is unknown."""
    T = np.moveaxis(T, axis, -1)
    out = np.zeros(T.shape)
    out[..., 1:-1] = np.nan_to_num(0.5 * (T[..., 2:] + T[..., :-2]))
    return np.moveaxis(out, -1, axis)


def _find_bad_pixels(T: Array, sigma: float, sharp: float) -> tuple[Mask, Mask]:
    """Masks (nv, nu) of pixels that are off level, and of pixels that flicker."""
    axes = (2,) if T.shape[1] == 1 else (1, 2)
    return _static_outliers(T, axes, sigma, sharp), _flickering_outliers(T, axes, sigma, sharp)


def _find_bad_lines(T: Array, stuck: Mask, axis: int, sigma: float, sharp: float) -> tuple[int, ...]:
    """Indices of rows (`axis` 1) or columns (2) that are stuck, off level or flicker as a whole.

    `T` is NaN at bad pixels.  Lines are compared by their means over the positions at which no line has a bad pixel.
    """
    other = 3 - axis
    if min(T.shape[1:]) < 2 * NEIGHBOURS_PER_SIDE + 1:
        return ()
    dead = stuck.mean(axis=other - 1) > 0.5
    lines = np.moveaxis(T, axis, 1)  # (frames, lines, places)
    places = np.isfinite(lines[:, ~dead]).all(axis=(0, 1))
    if places.sum() < NEIGHBOURS_PER_SIDE:
        return tuple(map(int, np.flatnonzero(dead)))
    mean = np.where(dead, np.nan, lines[:, :, places].mean(axis=2))[:, None]
    line_sd = max(_robust_sd(np.diff(mean, axis=0), (2,)) / np.sqrt(2.0), sigma / np.sqrt(places.sum()))
    off = _static_outliers(mean, (2,), line_sd, sharp)[0] | _flickering_outliers(mean, (2,), line_sd, sharp)[0]
    return tuple(map(int, np.flatnonzero(dead | off)))


def find_outlying_pixels(residual: Array) -> Mask:
    """Mask (nv, nu) of pixels whose residuals (frames, nv, nu) K, NaN if masked, are outliers among their neighbours.

    Tested is the deviation from the median of the four nearest neighbours, along the axis where it is smaller: an error
    of the model is wider than one pixel along one axis at least.  Its mean over the frames and its scatter are compared
    with those of all pixels, by their median and MAD.  At an edge of the known pixels, where the neighbours of one side
    cannot distinguish a defect from an edge of the scene, only the scatter is tested.
    """
    from scipy.stats import chi2

    none = np.zeros(residual.shape[1:], bool)
    axes = [a for a in (1, 2) if residual.shape[a] > 2 * NEIGHBOURS_PER_SIDE]
    if not axes:
        return none
    found = [_deviation_from_neighbours(residual, a) for a in axes]
    alone = found[0] if len(found) == 1 else _smaller_known_deviation(*found)
    mean, _, count = _time_moments(alone)
    tests = int((count > 0).sum())
    if tests < MIN_SCALE_PIXELS:
        return none
    # along one axis deviations are larger than along both, so these scales are on the safe side
    single = [_time_moments(one) for one in found]
    far: Mask = np.abs(mean) > _outlier_limit(tests, tests) * max(min(_mad_scale(one) for one, _, _ in single), 1e-12)
    if len(residual) < 3 or not (count > 1).any():
        return far
    middle = float(np.median(count[count > 1] - 1))
    if len(found) > 1:
        at_edge = np.isnan(found[0]) != np.isnan(found[1])  # not at a corner
        loose = [_deviation_from_neighbours(residual, a, is_one_sided=True) for a in axes]
        alone = np.where(at_edge, _smaller_known_deviation(*loose), alone)
    _, scatter, count = _time_moments(alone)
    free = np.maximum(count - 1, 1)
    usual = min(float(np.median(one[n > 1])) for _, one, n in single) * middle / chi2.median(middle)
    return far | ((count > 1) & (scatter * free > usual * chi2.isf(FALSE_ALARMS / tests, free)))


def find_flickering_lines(residual: Array, axis: int, sigma: float) -> tuple[int, ...]:
    """Indices of rows (`axis` 1) or columns (2) whose residuals (frames, nv, nu) K, NaN if masked, flicker as a whole.

    Three conditions distinguish a defect from an error of the model.  It changes from frame to frame: the mean square
    successive difference is about twice the variance (von Neumann, Ann. Math. Stat. 12, 1941, 367).  It changes by more
    than the noise `sigma` (K) of a pixel.  And it is one line wide, while optics spread heat over neighbouring lines.
    """
    lines = np.moveaxis(residual, axis, 1)
    known = np.isfinite(lines)
    count = known.sum(axis=2)
    enough = count >= max(NEIGHBOURS_PER_SIDE, 0.5 * count.max(initial=0))
    mean = np.where(enough, np.sum(lines, axis=2, where=known) / np.maximum(count, 1), np.nan)
    out: list[int] = []
    while True:  # the worst line first, because it disturbs its neighbours
        alone = _deviation_from_known_neighbours(mean)
        step = np.diff(alone, axis=0)
        judged = np.isfinite(step).sum(axis=0) > NEIGHBOURS_PER_SIDE
        if not judged.any():
            return tuple(sorted(out))
        square = np.where(judged, np.nanmean(np.where(judged, step, 0.0) ** 2, axis=0), 0.0)
        worst = int(np.argmax(square))
        fast = 0.5 * square[worst] > MIN_DIFFERENCE_FRACTION * float(np.nanvar(alone[:, worst]))
        if not (0.5 * square[worst] > (FLICKER_SIGMA * sigma) ** 2 and fast and _is_one_line(mean, worst)):
            return tuple(sorted(out))
        out.append(worst)
        mean[:, worst] = np.nan


def _is_one_line(mean: Array, line: int) -> bool:
    """Whether the neighbours of a line do not follow its changes; `mean` (frames, lines).

    Optics spread any real change over the neighbouring lines.
    """
    step = np.diff(mean, axis=0)
    sd = np.hypot(USUAL_PSF_PX, PIXEL_APERTURE_SD_PX)
    spread = float(np.exp(-0.5 / sd**2))  # response of the next pixel to a point
    for near in {line - 1, line + 1} & set(range(mean.shape[1])):
        both = np.isfinite(step[:, line]) & np.isfinite(step[:, near])
        if both.sum() > NEIGHBOURS_PER_SIDE:
            part = float(np.sum(step[both, line] * step[both, near]) / np.sum(step[both, line] ** 2))
            if abs(part) > 0.5 * spread:
                return False
    return True


def _deviation_from_known_neighbours(values: Array) -> Array:
    """Values (frames, lines) minus the median of the known ones among the four nearest neighbours."""
    padded = np.pad(values, [(0, 0), (NEIGHBOURS_PER_SIDE, NEIGHBOURS_PER_SIDE)], constant_values=np.nan)
    near = np.stack(
        [padded[:, NEIGHBOURS_PER_SIDE + s : NEIGHBOURS_PER_SIDE + s + values.shape[1]] for s in (-2, -1, 1, 2)]
    )
    known = np.isfinite(near)
    middle = np.ma.median(np.ma.array(near, mask=~known), axis=0)
    return np.asarray(values - np.ma.filled(middle, np.nan))


def _time_moments(values: Array) -> tuple[Array, Array, npt.NDArray[np.int64]]:
    """Mean, variance and number of known values over the frames, each (nv, nu); the mean is NaN where there is none."""
    known = np.isfinite(values)
    count = known.sum(axis=0)
    mean = np.where(count > 0, np.sum(values, axis=0, where=known) / np.maximum(count, 1), np.nan)
    return mean, np.sum((values - mean) ** 2, axis=0, where=known) / np.maximum(count - 1, 1), count


def _deviation_from_neighbours(T: Array, axis: int, is_one_sided: bool = False) -> Array:
    """Values minus the median of their known neighbours, two per side along an axis.

    NaN if a side has none, or with `is_one_sided` if both have none.
    """
    T = np.moveaxis(T, axis, -1)
    padded = np.pad(T, [(0, 0)] * (T.ndim - 1) + [(NEIGHBOURS_PER_SIDE, NEIGHBOURS_PER_SIDE)], constant_values=np.nan)
    near = np.stack(
        [padded[..., NEIGHBOURS_PER_SIDE + s : NEIGHBOURS_PER_SIDE + s + T.shape[-1]] for s in (-2, -1, 1, 2)]
    )
    known = np.isfinite(near)
    count = known.sum(axis=0)
    ordered = np.sort(near, axis=0)  # NaN last
    low, high = (np.take_along_axis(ordered, k[None], 0)[0] for k in (np.maximum(count - 1, 0) // 2, count // 2))
    sides = known[:2].any(axis=0), known[2:].any(axis=0)
    enough = sides[0] | sides[1] if is_one_sided else sides[0] & sides[1]
    return np.moveaxis(np.where(enough, T - 0.5 * (low + np.where(count == 4, high, low)), np.nan), -1, axis)


def _smaller_known_deviation(a: Array, b: Array) -> Array:
    """`_smaller_deviation`, NaN where either value is."""
    return np.where(np.isfinite(a) & np.isfinite(b), _smaller_deviation(a, b), np.nan)


def find_shutter_events(
    T: Array, recording: Recording, sigma: float, min_fraction: float = COMMON_STEP_FRACTION
) -> npt.NDArray[np.int64]:
    """Indices of frames at which the offset of the image jumps by more than its drift, a Wiener process, explains.

    The common step is the mean of the shortest interval that contains half of all pixels' steps (the shorth, Andrews et
    al. 1972; Rousseeuw & Leroy 1988).  It is a jump of the offset if it explains the steps of nearly all pixels, a
    fraction `min_fraction`, within noise: heat that sets in changes pixels differently.  `T` (frames, nv, nu) K may
    also be a residual.
    """
    from scipy.stats import norm

    if len(T) < 4:
        return np.zeros(0, np.int64)
    digit = quantisation_step(recording.temperature)
    noise = np.sqrt(2.0) * np.hypot(sigma, digit / np.sqrt(12.0))
    dithered = (add_dither(frame, digit, k) for k, frame in enumerate(T))
    steps = (after - before for before, after in pairwise(dithered))
    found = [_common_step(step[np.isfinite(step)], COMMON_STEP_SDS * noise) for step in steps]
    common, fraction, pixels = np.array(found).T
    drift = CAMERA_CLASSES[recording.camera].drift_K_per_sqrt_s
    error = np.hypot(drift * np.sqrt(np.diff(recording.time)), 1.5 * noise / np.sqrt(np.maximum(pixels, 1.0)))
    next_to = np.stack([common - np.append(common[1:], np.nan), common - np.append(np.nan, common[:-1])])
    # heating continues from frame to frame, a jump does not
    away = np.fmin.reduce(np.abs([*next_to, common - np.median(common)]))
    error = np.hypot(error, MAD_TO_SD * np.median(away))  # of whole frames, sigma_t of the 3-D noise model
    far = away > norm.isf(0.5 * FALSE_ALARMS / len(common)) * error
    return np.flatnonzero(far & (fraction > min_fraction)) + 1


def _common_step(steps: Array, within: float) -> tuple[float, float, int]:
    """Common part of steps (pixels,) K, the fraction of the steps `within` so much of it, and their number."""
    n = len(steps)
    if n < 4:
        return 0.0, 0.0, n
    ordered = np.sort(steps)
    half = n // 2
    first = int(np.argmin(ordered[half:] - ordered[: n - half]))
    common = float(np.mean(ordered[first : first + half + 1]))
    return common, float(np.mean(np.abs(steps - common) < within)), n
