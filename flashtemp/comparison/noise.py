"""Noise of a recording estimated from its frames, and residuals in sigma: fixed pattern, whitening, structure."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flashtemp.comparison.line_noise import EFFICIENCY, NO_LINES, SURE, LineNoise, LineWhitening, estimate_line_noise

FRAMES = 256  # that are worked on at a time
OVERLAP = 18.0  # values that differences along three axes share
RAISED = "white above the stated one"
DIGITS = 20_000  # values of which the step between digits is taken
MAD = 1.482602218505602  # standard deviation over median absolute deviation of a normal distribution


@dataclass(frozen=True)
class Noise:
    """`white` of one pixel of one frame, `pattern` between pixels that stays in all frames; K.

    `estimated`: the names of those that the data themselves had to give.  `averaged`: how many frames of the camera
    each frame (frames,) is the mean of, None where it is one of them.  `lines`: noise of rows and columns.
    """

    white: float
    pattern: float
    estimated: tuple[str, ...] = ()
    averaged: tuple[int, ...] | None = None
    lines: LineNoise = NO_LINES

    def weight(self) -> np.ndarray | float:
        """Frames of the camera in each frame, to multiply images (frames, nv, nu)."""
        return 1.0 if self.averaged is None else np.array(self.averaged, float)[:, None, None]


def noise(
    residual: np.ndarray, white: float | None, pattern: float | None, averaged: tuple[int, ...] | None = None,
    rest: np.ndarray | None = None,
) -> Noise:  # fmt: skip
    """Noise of residuals (frames, nv, nu) K, NaN where masked; what is not given is estimated.

    White noise from differences of successive frames, the fixed pattern from differences between
    neighbouring pixels of the mean over frames, so that smooth structure counts for neither.  That of lines is taken
    from the `rest` of a first fit where there is one, since a gradient across few lines looks like it.
    """
    estimated, n = [], len(residual)
    if white is None:
        estimated.append("white")
        each = np.ones(n) if averaged is None else np.array(averaged, float)
        if n > 2:
            step = np.diff(residual, axis=0) / np.sqrt(1.0 / each[1:] + 1.0 / each[:-1])[:, None, None]
        else:
            step = np.diff(residual, n=2, axis=-1) * np.sqrt(each / 6.0)[:, None, None]
        white = _spread(step)
    if pattern is None:
        estimated.append("pattern")
        mean = over_frames(residual)
        steps = [np.diff(mean, n=2, axis=a).ravel() / np.sqrt(6.0) for a in (0, 1) if mean.shape[a] > 2]
        total = _spread(np.concatenate(steps)) if steps else 0.0
        frames = n if averaged is None else sum(averaged)
        pattern = float(np.sqrt(max(total**2 - white**2 / max(frames, 1), 0.0)))
    white, pattern = max(float(white), 1e-6), float(pattern)
    lines = estimate_line_noise(residual if rest is None else rest, white, pattern)
    return _apart(Noise(white, pattern, tuple(estimated), averaged, lines), residual)


def beyond_stated(found: Noise, recording, residual: np.ndarray) -> Noise:
    """Noise of which the stated white part is raised to what frames show: coarse digits add step^2/12 (Sheppard 1898),
    and a data sheet's NETD may be too low for the camera at hand.

    What frames show is the MAD of residuals (frames, nv, nu) K differenced in time and twice along both axes, in which
    neither smooth misfit nor noise of lines is left; it counts where chance explains it once in a thousand.
    """
    if "white" in found.estimated or found.averaged is not None:
        return found
    white = float(np.hypot(found.white, quantisation_step(recording.temperature) / np.sqrt(12.0)))
    if len(residual) > 2 and min(residual.shape[1:]) > 2:
        steps = np.diff(np.diff(np.diff(residual, axis=0), n=2, axis=1), n=2, axis=2)
        count = int(np.isfinite(steps).sum()) / OVERLAP
        shown = _spread(steps) / np.sqrt(72.0)
        if count > 1 and shown > white * (1.0 + SURE / np.sqrt(2.0 * EFFICIENCY * count)):
            return replace(found, white=shown, estimated=(*found.estimated, RAISED))
    return replace(found, white=white)


def quantisation_step(temperature: np.ndarray) -> float:
    """Step (K) of which all differences between values are multiples, 0 where there is none or it is below 1 mK."""
    values = temperature[np.isfinite(temperature)][:DIGITS]
    different = np.unique(values)
    steps = np.diff(different)
    steps = steps[steps > 1e-6]  # else of rounding
    if len(steps) < 2 or 2 * len(different) > len(values) or (step := float(steps.min())) < 1e-3:
        return 0.0
    return step if np.all(np.abs(steps / step - np.round(steps / step)) < 0.01) else 0.0


def _apart(found: Noise, residual: np.ndarray) -> Noise:
    """Noise whose estimates for single pixels do not count that of lines once more."""
    if found.lines.is_none or min(residual.shape[1:]) < 3:
        return found
    n, lines = len(residual), found.lines
    white, pattern = found.white, found.pattern
    if "white" in found.estimated and n > 2:
        white = np.sqrt(max(white**2 - lines.frame_rows**2 - lines.frame_columns**2, (0.5 * white) ** 2))
    if "pattern" in found.estimated:  # second differences along both axes, in which no line shows
        total = _spread(np.diff(np.diff(over_frames(residual), n=2, axis=0), n=2, axis=1)) / 6.0
        frames = n if found.averaged is None else sum(found.averaged)
        pattern = np.sqrt(max(total**2 - white**2 / max(frames, 1), 0.0))
    return replace(found, white=float(white), pattern=float(pattern))


def _spread(values: np.ndarray) -> float:
    """Robust standard deviation of differences."""
    values = values[np.isfinite(values)]
    return MAD * float(np.median(np.abs(values - np.median(values)))) if len(values) else 0.0


def over_frames(residual: np.ndarray) -> np.ndarray:
    """Mean over frames (nv, nu), NaN where no frame has a value."""
    known = np.isfinite(residual)
    n = known.sum(axis=0)
    return np.where(n > 0, np.sum(residual, axis=0, where=known) / np.maximum(n, 1), np.nan)


def whiten(residual: np.ndarray, noise: Noise) -> np.ndarray:
    """Residuals (frames, nv, nu) in sigma: independent and of unit variance where only `noise` is in them.

    Per pixel with n frames of the camera, w in each frame: sqrt(w) (y - c mean(y))/sigma, mean weighted by w,
    c = 1 - (1 + n pattern^2/sigma^2)^(-1/2).
    """
    w = noise.weight()
    even = noise.averaged is None
    known = np.isfinite(residual)
    n = known.sum(axis=0) if even else (known * w).sum(axis=0)
    total = np.sum(residual if even else residual * w, axis=0, where=known)
    mean = np.where(n > 0, total / np.maximum(n, 1), np.nan)
    c = 1.0 - 1.0 / np.sqrt(1.0 + n * (noise.pattern / noise.white) ** 2)
    out: np.ndarray = residual - c * mean
    out *= np.sqrt(w) / noise.white
    return out if noise.lines.is_none else _lines(residual, noise)(out)


def _lines(values: np.ndarray, noise: Noise) -> LineWhitening:
    return LineWhitening.of(values, noise.weight(), noise.white, noise.pattern, noise.lines)


def unwhiten(whitened: np.ndarray, noise: Noise) -> np.ndarray:
    """Kelvin (frames, nv, nu) of what `whiten` made of it, NaN where that is NaN."""
    if not noise.lines.is_none:
        whitened = _lines(whitened, noise).inverse(whitened)
    w = noise.weight()
    known = np.isfinite(whitened)
    n = (known * w).sum(axis=0)
    out = whitened * (noise.white / np.sqrt(w))
    mean = np.sum(out * w, axis=0, where=known) / np.maximum(n, 1)  # of it `whiten` leaves 1 - c
    out += (np.sqrt(1.0 + n * (noise.pattern / noise.white) ** 2) - 1.0) * mean
    return out


def lag_one(whitened: np.ndarray, axis: int) -> tuple[float, float]:
    """Correlation of neighbours along an axis, and in units of its standard error for white noise."""
    count, product, kept, power = 0, 0.0, 0, 0.0
    for begin in range(0, len(whitened), FRAMES):
        part = whitened[begin : begin + FRAMES]
        known = part[np.isfinite(part)]
        kept, power = kept + known.size, power + float(known @ known)
        a = np.moveaxis(whitened[begin : begin + FRAMES + 1] if axis == 0 else part, axis, 0)
        both = a[:-1] * a[1:]
        both = both[np.isfinite(both)]
        count, product = count + both.size, product + float(both.sum())
    if count < 8:
        return 0.0, 0.0
    r = product / count / (power / kept) if power > 0 else 0.0
    return r, r * np.sqrt(count)


@dataclass(frozen=True)
class Place:
    """Where a residual is largest: `K` and in `sigma`, at `u`, `v` (m), `time` (s) and `repetition`."""

    K: float
    sigma: float
    u: float
    v: float
    time: float
    repetition: int


def structured(residual: np.ndarray, noise: Noise, recording, size: int = 5) -> Place | None:
    """The largest residual that is wider than a pixel: of means over `size` x `size` pixels of one frame."""
    axes = [a for a in (1, 2) if residual.shape[a] >= size and getattr(recording, "places", None) is None]
    best, where = (-1.0, 0.0), (0, 0, 0)  # points are no neighbours
    for begin in range(0, len(residual), FRAMES):
        mean, error, known = _means(residual[begin : begin + FRAMES], noise, axes, size)
        if known.any():
            k, j, i = map(int, np.unravel_index(int(np.argmax(np.abs(mean) / error)), mean.shape))
            far = abs(mean[k, j, i]) / error[k, j, i]
            if far > best[0]:
                best, where = (far, float(mean[k, j, i])), (begin + k, j, i)
    if best[0] < 0.0:
        return None
    (far, K), (k, j, i) = best, where
    return Place(
        K, float(np.copysign(far, K)), float(recording.u[i]), float(recording.v[j]), float(recording.time[k]),
        int(recording.repetition[k]),
    )  # fmt: skip


def _means(residual: np.ndarray, noise: Noise, axes: list[int], size: int):
    """Means (frames, nv, nu) over `size` pixels along `axes`, their standard errors, and what is known at all."""
    from scipy.ndimage import uniform_filter1d

    known = np.isfinite(residual)
    values, weight = np.where(known, residual, 0.0), known.astype(float)
    for axis in axes:
        values = uniform_filter1d(values, size, axis=axis, mode="constant") * size
        weight = uniform_filter1d(weight, size, axis=axis, mode="constant") * size
    weight[~known] = 0.0
    mean = np.where(weight > 0.5, values / np.maximum(weight, 1.0), 0.0)
    return mean, np.sqrt((noise.white**2 + noise.pattern**2) / np.maximum(weight, 1.0)), known
