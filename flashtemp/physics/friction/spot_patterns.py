"""Patterns of macroasperity spots on the road: discs, stripes or a contact map, and their coverage of mesh cells.

Every pattern repeats along x after `repeat` (m).  `cumulative_cover(y, width)` is the integral (rows, pixels + 1) m of
the covered fraction along one repeat, for rows with edges `y` (m from the centre line).  Its differences are exact
means over cells.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flashtemp.errors import BadInput

PIXELS_PER_DIAMETER = 48  # the area of a disc is then accurate to 1e-4


@dataclass(frozen=True)
class StripePattern:
    """Stripes across the road, `diameter` (m) long, that cover `fraction`."""

    diameter: float
    fraction: float

    @property
    def repeat(self) -> float:
        return self.diameter / self.fraction

    def cumulative_cover(self, y: np.ndarray, width: float) -> np.ndarray:
        grid = np.linspace(0.0, self.repeat, 4097)
        return np.tile(np.minimum(grid, self.diameter), (len(y) - 1, 1))


@dataclass(frozen=True)
class DiscPattern:
    """Discs of a `diameter` (m) at `centres` (n, 2) m, periodic across the width as well."""

    diameter: float
    repeat: float
    centres: np.ndarray

    def cumulative_cover(self, y: np.ndarray, width: float) -> np.ndarray:
        count = int(np.ceil(self.repeat / self.diameter * PIXELS_PER_DIAMETER))
        x = (np.arange(count) + 0.5) * self.repeat / count
        share = np.zeros((len(y) - 1, count))
        around = np.arange(-PIXELS_PER_DIAMETER, PIXELS_PER_DIAMETER + 1)
        for cx, cy in self.centres:
            at = np.unique((int(cx / self.repeat * count) + around) % count)
            off = (x[at] - cx + 0.5 * self.repeat) % self.repeat - 0.5 * self.repeat
            inside = np.abs(off) < 0.5 * self.diameter
            near, half = at[inside], np.sqrt(0.25 * self.diameter**2 - off[inside] ** 2)
            for shift in (-width, 0.0, width):
                low = np.maximum(y[:-1, None], cy + shift - half)
                high = np.minimum(y[1:, None], cy + shift + half)
                share[:, near] += np.maximum(high - low, 0.0) / np.diff(y)[:, None]
        return _integrate_rows(share, self.repeat / count)


MAX_RANDOM_COVER = 0.6  # random sequential placement covers 0.547 of an area (Feder 1980), slightly more of a small one


@dataclass(frozen=True)
class ContactMap:
    """Covered fraction (nx, ny) of pixels of `pixel` (dx, dy) m, repeated along and across the road."""

    covered: np.ndarray
    pixel: tuple[float, float]

    @property
    def repeat(self) -> float:
        return len(self.covered) * self.pixel[0]

    def cumulative_cover(self, y: np.ndarray, width: float) -> np.ndarray:
        dx, dy = self.pixel
        up = np.concatenate([np.zeros((len(self.covered), 1)), np.cumsum(self.covered, axis=1)], axis=1)
        at = (y + 0.5 * width) / dy
        turns, rest = np.divmod(at, self.covered.shape[1])
        k = np.minimum(rest.astype(int), self.covered.shape[1] - 1)
        below = up[:, k] + (rest - k) * (up[:, k + 1] - up[:, k]) + turns * up[:, -1:]
        return _integrate_rows(np.diff(below, axis=1).T * dy / np.diff(y)[:, None], dx)


def _integrate_rows(share: np.ndarray, pixel: float) -> np.ndarray:
    """Running integral along x of pixel values (rows, n)."""
    return np.concatenate([np.zeros((len(share), 1)), np.cumsum(share, axis=1) * pixel], axis=1)


def place_discs(
    pattern: str, diameter: float, fraction: float, width: float, length: float, seed: int, key: str = "pattern"
) -> DiscPattern:
    """Discs that cover `fraction` of a road of `width`, repeated after about `length` (m): "regular" or "random".

    Raises BadInput, which begins with `key`, where discs cannot be placed without overlap.

    >>> road = place_discs("regular", 3e-3, 0.2, 0.05, 0.05, 1)
    >>> round(len(road.centres) * 3.14159265 * 2.25e-6 / (road.repeat * 0.05), 6)
    0.2
    """
    one = np.pi * diameter**2 / 4
    if pattern == "regular":  # rows along x, every second one shifted by half a pitch
        rows = 2 * max(1, round(0.5 * width * np.sqrt(fraction / one * np.sqrt(3) / 2)))
        pitch = one * rows / (fraction * width)
        count = max(1, round(length / pitch))
        i, b = np.meshgrid(np.arange(count), np.arange(rows), indexing="ij")
        x, y = pitch * (i + 0.25 + 0.5 * (b % 2)), width * ((b + 0.5) / rows - 0.5)
        return DiscPattern(diameter, pitch * count, np.stack([x.ravel(), y.ravel()], axis=1))
    number = max(1, round(fraction * width * length / one))
    repeat = number * one / (fraction * width)
    rng, sites = np.random.default_rng(seed), np.empty((0, 2))
    for _ in range(2000 * number if fraction < MAX_RANDOM_COVER else 0):
        new = rng.uniform(0, 1, 2) * (repeat, width)
        apart = np.abs(sites - new)
        apart = np.minimum(apart, np.array([repeat, width]) - apart)
        if not np.any(np.hypot(*apart.T) < diameter):
            sites = np.vstack([sites, new])
        if len(sites) == number:
            return DiscPattern(diameter, repeat, sites - (0.0, 0.5 * width))
    raise BadInput(
        f"{key}: {number} discs cannot be placed at random at contact.spot_fraction = {fraction:g}; "
        'give a smaller fraction or "regular"'
    )


def read_contact_map(file: Path, key: str) -> ContactMap:
    """A contact map that `flashtemp spots` wrote (NumPy .npz: covered, pixel_m).  Raises BadInput."""
    try:
        with np.load(file) as data:
            covered, pixel = np.asarray(data["covered"], dtype=float), np.asarray(data["pixel_m"], dtype=float)
    except (OSError, ValueError, KeyError, TypeError, EOFError) as fault:
        raise BadInput(f"{key}: {file} is not a contact map; give a .npz file that 'flashtemp spots' wrote") from fault
    good = covered.ndim == 2 and pixel.shape == (2,) and np.all(pixel > 0) and covered.min() >= 0 and covered.max() <= 1
    if not good or not covered.any():
        raise BadInput(
            f"{key}: {file} does not contain fractions from 0 to 1 and two pixel sizes;"
            " give a .npz file that 'flashtemp spots' wrote"
        )
    return ContactMap(covered, (float(pixel[0]), float(pixel[1])))
