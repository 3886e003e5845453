"""From marks on an image to what an import is told: places of known points, the block's outline, starts of sliding."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np
import numpy.typing as npt

from flashtemp.camera.import_options import Direction, Facts

Array = npt.NDArray[np.float64]
Pixel = tuple[float, float]  # column, row; the middle of the upper left pixel is 0, 0
WAYS = {"right": (1.0, 0.0), "left": (-1.0, 0.0), "up": (0.0, -1.0), "down": (0.0, 1.0)}
TWO = ("leading edge", "trailing edge")  # both at the interface
FOUR = ("leading edge", "trailing edge", "trailing edge, top", "leading edge, top")
ONSET, QUIET, APART = 0.3, 5, 5  # of the steepest rise; frames that are averaged; and those between two starts


@dataclass(frozen=True)
class Marks:
    """Marked points by name, the block's `length` and `height` (mm), and where v points in the image."""

    points: dict[str, Pixel]
    length: float
    height: float
    up: str = "up"

    @property
    def whole(self) -> bool:
        """Whether the marks place the image."""
        return all(name in self.points for name in TWO)

    @property
    def corners(self) -> bool:
        """Whether all four corners are marked."""
        return all(name in self.points for name in FOUR)

    @property
    def downstream(self) -> str:
        """Where u points in the image: the direction that is nearest to the marks."""
        way = np.subtract(self.points[TWO[1]], self.points[TWO[0]])
        return max(WAYS, key=lambda name: float(np.dot(WAYS[name], way)))

    def facts(self) -> Facts:
        """What an import is told; of four corners the map of an image seen at an angle."""
        if self.corners:
            known = ((0.0, 0.0), (self.length, 0.0), (self.length, self.height), (0.0, self.height))
            rows = zip((self.points[name] for name in FOUR), known, strict=True)
            return Facts(point=tuple((_px(c), _px(r), u, v) for (c, r), (u, v) in rows))
        if not self.whole:
            return Facts()
        (c, r), (c2, r2) = (self.points[name] for name in TWO)
        return Facts(
            downstream=cast(Direction, self.downstream),
            up=cast(Direction, self.up),
            pixel=(_px(c), _px(r)),
            second=(_px(c2), _px(r2), self.length, 0.0),
        )

    def outline(self) -> list[Pixel]:
        """Corners of the block in the image, as far as the marks tell."""
        if self.corners:
            return [self.points[name] for name in FOUR]
        if not self.whole:
            return []
        a, b = (np.array(self.points[name]) for name in TWO)
        along = (b - a) / self.length
        across = np.array([along[1], -along[0]])
        across = across if across @ np.array(WAYS[self.up]) >= 0 else -across
        return [(float(p[0]), float(p[1])) for p in (a, b, b + self.height * across, a + self.height * across)]


def _px(value: float) -> float:
    """To a hundredth of a pixel, as people write it."""
    return round(float(value), 2)


def onsets(time: Array, mean: Array) -> list[float]:
    """Times (s) at which the mean of the images begins to rise steeply: starts of sliding, to be confirmed.

    >>> t = np.arange(0.0, 40.0, 0.5)
    >>> rise = np.where(t % 20 < 8, np.sqrt(np.maximum(t % 20 - 4, 0)), 2.0 * np.exp(-(t % 20 - 8) / 5))
    >>> onsets(t, rise)
    [4.0, 24.0]
    """
    if len(time) < 2 * QUIET:
        return []
    rate = np.diff(mean) / np.maximum(np.diff(time), 1e-12)
    steep = float(np.nanpercentile(rate, 98))
    scatter = 1.4826 * float(np.nanmedian(np.abs(rate - np.nanmedian(rate))))
    if not steep > max(0.0, 4.0 * scatter / QUIET**0.5):
        return []
    rising = rate > ONSET * steep
    found: list[int] = []
    for k in np.flatnonzero(rising):
        before = rate[max(0, k - QUIET) : k]
        fresh = not len(before) or float(np.nanmedian(before)) < 0.5 * ONSET * steep
        if fresh and (not found or k - found[-1] >= APART):
            found.append(int(k))
    return [float(time[k]) for k in found]
