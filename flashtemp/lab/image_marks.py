"""From marks on an image to import options: known points, outline of the block, starts of sliding."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np
import numpy.typing as npt

from flashtemp.camera.importing.import_options import Direction, ImportOptions

Array = npt.NDArray[np.float64]
Pixel = tuple[float, float]  # column, row; the middle of the upper left pixel is 0, 0
IMAGE_DIRECTIONS = {"right": (1.0, 0.0), "left": (-1.0, 0.0), "up": (0.0, -1.0), "down": (0.0, 1.0)}
EDGE_NAMES = ("leading edge", "trailing edge")  # both at the interface
CORNER_NAMES = ("leading edge", "trailing edge", "trailing edge, top", "leading edge, top")
SLOPE_IMAGES = 6  # images before and after an onset from which its slopes are fitted
MIN_ONSET_FRACTION, MIN_ONSET_SIGMA = 0.35, 5.0  # of the largest change of slope; in its standard errors
SD_PER_MAD = 1.4826  # standard deviation over median absolute deviation


@dataclass(frozen=True)
class BlockMarks:
    """Marked points by name, `length` and `height` of the block (mm), and the direction of v in the image, `up`."""

    points: dict[str, Pixel]
    length: float
    height: float
    up: str = "up"

    @property
    def has_edges(self) -> bool:
        """Whether leading and trailing edge are marked, which fixes position and scale."""
        return all(name in self.points for name in EDGE_NAMES)

    @property
    def has_corners(self) -> bool:
        """Whether all four corners are marked."""
        return all(name in self.points for name in CORNER_NAMES)

    @property
    def downstream(self) -> str:
        """Direction of u in the image: the one nearest to the line through the marks."""
        along = np.subtract(self.points[EDGE_NAMES[1]], self.points[EDGE_NAMES[0]])
        return max(IMAGE_DIRECTIONS, key=lambda name: float(np.dot(IMAGE_DIRECTIONS[name], along)))

    def to_options(self) -> ImportOptions:
        """Import options of the marks; four corners also define the perspective of an oblique image."""
        if self.has_corners:
            known = ((0.0, 0.0), (self.length, 0.0), (self.length, self.height), (0.0, self.height))
            rows = zip((self.points[name] for name in CORNER_NAMES), known, strict=True)
            return ImportOptions(point=tuple((_round_px(c), _round_px(r), u, v) for (c, r), (u, v) in rows))
        if not self.has_edges:
            return ImportOptions()
        (c, r), (c2, r2) = (self.points[name] for name in EDGE_NAMES)
        return ImportOptions(
            downstream=cast(Direction, self.downstream),
            up=cast(Direction, self.up),
            pixel=(_round_px(c), _round_px(r)),
            second=(_round_px(c2), _round_px(r2), self.length, 0.0),
        )

    def block_outline(self) -> list[Pixel]:
        """Corners of the block in the image; [] without both edges."""
        if self.has_corners:
            return [self.points[name] for name in CORNER_NAMES]
        if not self.has_edges:
            return []
        a, b = (np.array(self.points[name]) for name in EDGE_NAMES)
        along = (b - a) / self.length
        across = np.array([along[1], -along[0]])
        across = across if across @ np.array(IMAGE_DIRECTIONS[self.up]) >= 0 else -across
        return [(float(p[0]), float(p[1])) for p in (a, b, b + self.height * across, a + self.height * across)]


def _round_px(value: float) -> float:
    """Round to a hundredth of a pixel."""
    return round(float(value), 2)


def find_onsets(time: Array, mean: Array) -> list[float]:
    """Times (s) at which the slope of the mean temperature increases sharply: likely starts of sliding.

    >>> t = np.arange(0.0, 40.0, 0.5)
    >>> rise = np.where(t % 20 < 8, np.sqrt(np.maximum(t % 20 - 4, 0)), 2.0 * np.exp(-(t % 20 - 8) / 5))
    >>> find_onsets(t, rise)
    [4.0, 24.0]
    """
    n = len(time)
    if n < 2 * SLOPE_IMAGES + 1:
        return []
    before = np.array(
        [
            _fit_slope(time[k - SLOPE_IMAGES : k + 1], mean[k - SLOPE_IMAGES : k + 1])
            for k in range(SLOPE_IMAGES, n - SLOPE_IMAGES)
        ]
    )
    after = np.array(
        [
            _fit_slope(time[k : k + SLOPE_IMAGES + 1], mean[k : k + SLOPE_IMAGES + 1])
            for k in range(SLOPE_IMAGES, n - SLOPE_IMAGES)
        ]
    )
    jump = after - before
    step = float(np.median(np.diff(time)))
    noise = SD_PER_MAD * float(np.median(np.abs(np.diff(mean, 2)))) / 6.0**0.5  # of one image's mean
    error = noise / step * (24.0 / SLOPE_IMAGES**3) ** 0.5  # of a difference of two slopes
    min_jump = max(MIN_ONSET_SIGMA * error, MIN_ONSET_FRACTION * float(jump.max()))
    found: list[int] = []
    for k in np.argsort(-jump):
        if jump[k] < min_jump or jump[k] <= 0.0:
            break
        if after[k] > 0.0 and all(abs(k - other) > SLOPE_IMAGES for other in found):
            found.append(int(k))
    return [float(time[_locate_onset(time, mean, k + SLOPE_IMAGES)]) for k in sorted(found)]


def _locate_onset(time: Array, mean: Array, near: int) -> int:
    """The image near `near` at which an increase with sqrt(t) begins, by least squares."""

    def squared_error(k: int) -> float:
        part = slice(max(0, near - SLOPE_IMAGES), near + SLOPE_IMAGES + 1)
        t, y = time[part] - time[k], mean[part]
        A = np.stack([np.ones(len(t)), t, np.sqrt(np.maximum(t, 0.0))], axis=1)
        return float(np.sum((y - A @ np.linalg.lstsq(A, y, rcond=None)[0]) ** 2))

    return min(range(near - SLOPE_IMAGES // 2, near + SLOPE_IMAGES // 2 + 1), key=squared_error)


def _fit_slope(t: Array, y: Array) -> float:
    """Least-squares slope."""
    dt = t - t.mean()
    return float(dt @ y / max(dt @ dt, 1e-300))
