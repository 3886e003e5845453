"""Noise of a recording, estimated from its frames; whitened residuals and tests of their structure."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from flashtemp.camera.quantisation import add_dither, quantisation_step, remove_dither
from flashtemp.comparison.line_noise import (
    CHANCE_LIMIT_SDS,
    MAD_EFFICIENCY,
    MAD_TO_SD,
    NO_LINES,
    LineNoise,
    estimate_line_noise,
    frame_mean,
)

FRAMES_PER_BATCH = 256  # processed at a time
DIFFERENCE_OVERLAP = 18.0  # values in one difference along three axes (2 x 3 x 3)
RAISED_WHITE = "white above the stated one"
MIN_FRAME_PIXELS = 30  # of which the median of a frame takes hardly any noise of single pixels
SECOND_DIFFERENCE = np.array([1.0, -2.0, 1.0])


@dataclass(frozen=True)
class NoiseLevels:
    """Standard deviations, K: `white` of one pixel of one frame, fixed `pattern` between pixels; `lines` of lines.

    `estimated`: names of those that were estimated from the data.  `averaged` (frames,): number of camera frames in
    each frame, None where frames are single ones.  `renewals`: first frames after the shutter events that renew a part
    of what is fixed, of single pixels `renewed_pattern`.
    """

    white: float
    pattern: float
    estimated: tuple[str, ...] = ()
    averaged: tuple[int, ...] | None = None
    lines: LineNoise = NO_LINES
    renewed_pattern: float = 0.0
    renewals: tuple[int, ...] = ()

    @property
    def averaged_frames(self) -> np.ndarray | None:
        """Number of camera frames (frames,) in each frame, None where frames are single ones."""
        return None if self.averaged is None else np.array(self.averaged, float)

    def frame_weights(self) -> np.ndarray | float:
        """Number of camera frames in each frame, in a shape that multiplies images (frames, nv, nu)."""
        return 1.0 if self.averaged_frames is None else self.averaged_frames[:, None, None]


def estimate_noise(
    residual: np.ndarray, white: float | None, pattern: float | None, averaged: tuple[int, ...] | None = None,
    rest: np.ndarray | None = None, known_renewals: tuple[int, ...] = (), digit_step: float = 0.0,
) -> NoiseLevels:  # fmt: skip
    """Noise of residuals (frames, nv, nu) K, NaN where masked; levels that are not stated are estimated.

    White noise follows from differences of successive frames and of neighbouring pixels along both axes, the fixed
    pattern from the latter in the mean over frames: neither smooth structure nor noise of lines enters them.  Line
    noise is estimated from the residual `rest` of a first fit where there is one, because a gradient across few lines
    looks like it.  Only then is it searched for renewals besides the known ones (indices of frames).  `digit_step` (K):
    quantisation step of the camera; estimates are made with dither, because medians of rounded values are multiples of
    the step.
    """
    residual, rest = add_dither(residual, digit_step), None if rest is None else add_dither(rest, digit_step)
    stated, rounding = white, digit_step / np.sqrt(12.0)
    estimated = []
    weights = None if averaged is None else np.array(averaged, float)
    if white is None:
        estimated.append("white")
        white = _estimate_pixel_noise(residual, weights)
    else:
        white = float(np.sqrt(white**2 + 2.0 * rounding**2))  # rounding and dither
    if pattern is None:
        estimated.append("pattern")
        pattern = _pattern_beside(residual, white, weights)
    white, pattern = max(float(white), 1e-6), float(pattern)
    of_lines = residual if rest is None else rest
    lines, renewals = estimate_line_noise(of_lines, white, pattern, rest is not None, weights, known_renewals)
    levels = NoiseLevels(white, pattern, tuple(estimated), averaged, lines, renewals=renewals)
    found = _with_renewed_pattern(levels, of_lines)
    return replace(found, white=remove_dither(found.white, digit_step) if stated is None else max(stated, 1e-6))


def estimate_white_noise(residual: np.ndarray, weights: np.ndarray | None = None) -> float:
    """White noise (K) of one pixel of one camera frame, from residuals or temperatures (frames, nv, nu) K.

    `weights` (frames,): number of camera frames in each frame.  The noise is the MAD of differences of successive
    frames, or of second differences along rows where there are at most two frames.
    """
    n = len(residual)
    each = np.ones(n) if weights is None else weights
    if n > 2:
        step = np.diff(residual, axis=0) / np.sqrt(1.0 / each[1:] + 1.0 / each[:-1])[:, None, None]
        if step[0].size >= MIN_FRAME_PIXELS:  # noise of whole frames is none of single pixels
            step -= np.array([_known_median(one) for one in step])[:, None, None]
    else:
        step = np.diff(residual, n=2, axis=-1) * np.sqrt(each / 6.0)[:, None, None]
    return _robust_sd(step)


def _estimate_pixel_noise(residual: np.ndarray, weights: np.ndarray | None) -> float:
    """White noise (K) of one pixel of one camera frame without that of lines; with it where lines or frames are few."""
    if len(residual) > 2 and min(residual.shape[1:]) > 2:
        each = np.ones(len(residual)) if weights is None else weights
        steps = np.diff(residual, axis=0) / np.sqrt(1.0 / each[1:] + 1.0 / each[:-1])[:, None, None]
        steps = np.diff(np.diff(steps, n=2, axis=1), n=2, axis=2)
        if np.isfinite(steps).sum() > DIFFERENCE_OVERLAP * MIN_FRAME_PIXELS:
            return _robust_sd(steps) / 6.0  # the squared weights add up to 36
    return estimate_white_noise(residual, weights)


def raise_stated_noise(noise: NoiseLevels, recording, residual: np.ndarray) -> NoiseLevels:
    """Noise with its stated white part raised to that of the frames.

    Quantisation adds step^2/12 (Sheppard 1898), and the NETD of a data sheet may be too low for the camera.  The noise
    of the frames is the MAD of residuals (frames, nv, nu) K after a first difference in time and second
    differences along both axes, which remove smooth misfit and line noise.  It replaces the stated noise where it is
    larger by more than chance, once in a thousand.
    """
    if "white" in noise.estimated or noise.averaged is not None:
        return noise
    white = float(np.hypot(noise.white, quantisation_step(recording.temperature) / np.sqrt(12.0)))
    if len(residual) > 2 and min(residual.shape[1:]) > 2:
        steps = np.diff(np.diff(np.diff(residual, axis=0), n=2, axis=1), n=2, axis=2)
        count = int(np.isfinite(steps).sum()) / DIFFERENCE_OVERLAP
        observed = _robust_sd(steps) / np.sqrt(72.0)  # sum of squared weights: 2 x 6 x 6
        if count > 1 and observed > white * (1.0 + CHANCE_LIMIT_SDS / np.sqrt(2.0 * MAD_EFFICIENCY * count)):
            return replace(noise, white=observed, estimated=(*noise.estimated, RAISED_WHITE))
    return replace(noise, white=white)


def _pattern_beside(residual: np.ndarray, white: float, weights: np.ndarray | None) -> float:
    """Fixed pattern (K) of pixels, beside `white` noise; frames without any value do not count."""
    known = np.isfinite(residual).any(axis=(1, 2))
    frames = float(np.sum(known if weights is None else known * weights))
    return float(np.sqrt(max(_pixel_variance(frame_mean(residual, weights)) - white**2 / max(frames, 1.0), 0.0)))


def _pixel_variance(image: np.ndarray) -> float:
    """Variance (K2) of the single pixels of an image (nv, nu), from second differences along both axes, which cancel
    smooth structure and noise of lines; of few lines, along one axis."""
    if min(image.shape) > 2:
        return (_robust_sd(np.diff(np.diff(image, n=2, axis=0), n=2, axis=1)) / 6.0) ** 2
    axis = int(np.argmax(image.shape))
    return _robust_sd(np.diff(image, n=2, axis=axis)) ** 2 / 6.0


def _with_renewed_pattern(noise: NoiseLevels, residual: np.ndarray) -> NoiseLevels:
    """Noise with the part of the pattern that shutter events renew, from the differences between the intervals."""
    if not noise.renewals or min(residual.shape[1:]) < 3:
        return noise
    weights = np.ones(len(residual)) if noise.averaged_frames is None else noise.averaged_frames
    parts = [np.split(a, noise.renewals) for a in (residual, weights)]
    frames = np.array([(np.isfinite(part) * w[:, None, None]).sum(axis=0) for part, w in zip(*parts, strict=True)])
    each = noise.white**2 / np.maximum(frames, 1)
    weights = np.outer(*[SECOND_DIFFERENCE**2] * 2)
    variance = np.sum(sliding_window_view(0.5 * (each[1:] + each[:-1]), (3, 3), axis=(1, 2)) * weights, axis=(3, 4))
    change = np.diff([frame_mean(part, w) for part, w in zip(*parts, strict=True)], axis=0) / np.sqrt(2.0)
    change = np.diff(np.diff(change, n=2, axis=1), n=2, axis=2) / np.sqrt(variance)
    count = int(np.isfinite(change).sum()) / DIFFERENCE_OVERLAP * 2.0
    ratio = _robust_sd(change) ** 2
    if ratio < 1.0 + CHANCE_LIMIT_SDS * np.sqrt(2.0 / (MAD_EFFICIENCY * max(count, 1.0))):
        return noise
    renewed = (ratio - 1.0) * float(np.median(variance[np.isfinite(change)])) / weights.sum()
    pattern = noise.pattern
    if "pattern" in noise.estimated:  # the mean over all frames contains what each interval has anew
        total = np.maximum(frames.sum(axis=0), 1)
        pattern = np.sqrt(max(pattern**2 - renewed * float(np.median(np.sum(frames**2, axis=0) / total**2)), 0.0))
    return replace(noise, renewed_pattern=float(np.sqrt(renewed)), pattern=float(pattern))


def _known_median(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else 0.0


def _robust_sd(values: np.ndarray) -> float:
    """Robust standard deviation of differences."""
    values = values[np.isfinite(values)]
    return MAD_TO_SD * float(np.median(np.abs(values - np.median(values)))) if len(values) else 0.0


def lag1_autocorrelation(whitened: np.ndarray, axis: int) -> tuple[float, float]:
    """Correlation of neighbours along an axis, and in units of its standard error for white noise."""
    count, product, kept, power = 0, 0.0, 0, 0.0
    for begin in range(0, len(whitened), FRAMES_PER_BATCH):
        part = whitened[begin : begin + FRAMES_PER_BATCH]
        known = part[np.isfinite(part)]
        kept, power = kept + known.size, power + float(known @ known)
        a = np.moveaxis(whitened[begin : begin + FRAMES_PER_BATCH + 1] if axis == 0 else part, axis, 0)
        both = a[:-1] * a[1:]
        both = both[np.isfinite(both)]
        count, product = count + both.size, product + float(both.sum())
    if count < 8:
        return 0.0, 0.0
    r = product / count / (power / kept) if power > 0 else 0.0
    return r, r * np.sqrt(count)


@dataclass(frozen=True)
class ResidualPeak:
    """Largest residual, in `K` and in `sigma`, at `u`, `v` (m), `time` (s) and `repetition`."""

    K: float
    sigma: float
    u: float
    v: float
    time: float
    repetition: int


def largest_structured_residual(
    residual: np.ndarray, noise: NoiseLevels, recording, size: int = 5
) -> ResidualPeak | None:
    """Largest residual that is wider than a pixel: among means over `size` x `size` pixels of one frame."""
    # sensors are not neighbours, so their residuals are not averaged
    axes = [a for a in (1, 2) if residual.shape[a] >= size and getattr(recording, "places", None) is None]
    best, where = (-1.0, 0.0), (0, 0, 0)
    for begin in range(0, len(residual), FRAMES_PER_BATCH):
        mean, error, known = _box_means(residual[begin : begin + FRAMES_PER_BATCH], noise, axes, size)
        if known.any():
            k, j, i = map(int, np.unravel_index(int(np.argmax(np.abs(mean) / error)), mean.shape))
            sigmas = abs(mean[k, j, i]) / error[k, j, i]
            if sigmas > best[0]:
                best, where = (sigmas, float(mean[k, j, i])), (begin + k, j, i)
    if best[0] < 0.0:
        return None
    (sigmas, K), (k, j, i) = best, where
    return ResidualPeak(
        K, float(np.copysign(sigmas, K)), float(recording.u[i]), float(recording.v[j]), float(recording.time[k]),
        int(recording.repetition[k]),
    )  # fmt: skip


def _box_means(residual: np.ndarray, noise: NoiseLevels, axes: list[int], size: int):
    """Means (frames, nv, nu) over `size` pixels along `axes`, their standard errors, and the mask of known pixels."""
    from scipy.ndimage import uniform_filter1d

    known = np.isfinite(residual)
    values, weight = np.where(known, residual, 0.0), known.astype(float)
    for axis in axes:
        values = uniform_filter1d(values, size, axis=axis, mode="constant") * size
        weight = uniform_filter1d(weight, size, axis=axis, mode="constant") * size
    weight[~known] = 0.0
    mean = np.where(weight > 0.5, values / np.maximum(weight, 1.0), 0.0)
    return mean, np.sqrt((noise.white**2 + noise.pattern**2) / np.maximum(weight, 1.0)), known
