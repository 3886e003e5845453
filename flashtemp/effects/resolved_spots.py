"""The macroasperity spots themselves, fixed in the road and moving through the contact (Level R).

>>> spots = discs("regular", 3e-3, 0.2, 0.05, 0.05, 1)
>>> repeat, centres = spots
>>> round(len(centres) * 3.14159265 * 2.25e-6 / (repeat * 0.05), 6)
0.2
"""

from __future__ import annotations

from functools import cache

import numpy as np

from flashtemp.effect import Effect, Param, Term
from flashtemp.errors import BadInput

PIXELS = 48  # per diameter: the area of a disc is then good to 1e-4
PATTERNS = ("random", "regular", "stripes")
STEPS = 12.0  # at least, while the road moves by a diameter


def discs(pattern: str, diameter: float, fraction: float, width: float, length: float, seed: int):
    """Length (m) after which the pattern repeats, near `length`, and centres (n, 2) m of discs that cover `fraction`.

    The pattern is periodic across the `width` too.  Raises BadInput where discs cannot be placed without overlap.
    """
    one = np.pi * diameter**2 / 4
    if pattern == "regular":  # rows across, every other one shifted by half
        rows = max(1, round(width * np.sqrt(fraction / one * np.sqrt(3) / 2)))
        pitch = one * rows / (fraction * width)
        count = 2 * max(1, round(length / pitch / 2))
        y = (np.arange(rows) + 0.5) / rows - 0.5
        sites = [(pitch * (i + 0.5), width * ((b + 0.25 * (-1) ** i / rows + 0.5) % 1 - 0.5))
                 for i in range(count) for b in y]  # fmt: skip
        return pitch * count, np.array(sites)
    number = max(1, round(fraction * width * length / one))
    repeat = number * one / (fraction * width)
    rng, sites = np.random.default_rng(seed), np.empty((0, 2))
    for _ in range(2000 * number):
        new = rng.uniform(0, 1, 2) * (repeat, width)
        apart = np.abs(sites - new)
        apart = np.minimum(apart, np.array([repeat, width]) - apart)
        if not np.any(np.hypot(*apart.T) < diameter):
            sites = np.vstack([sites, new])
        if len(sites) == number:
            return repeat, sites - (0.0, 0.5 * width)
    raise BadInput(
        f"resolved_spots.pattern: {number} discs cannot be placed at random at contact.spot_fraction = {fraction:g}; "
        'give a smaller fraction or "regular"'
    )


def covered(centres, repeat: float, diameter: float, y: np.ndarray, width: float) -> np.ndarray:
    """Integral (rows, pixels + 1) m along x of the covered share of rows with edges `y` (rows + 1,) m."""
    count = int(np.ceil(repeat / diameter * PIXELS))
    x = (np.arange(count) + 0.5) * repeat / count
    share = np.zeros((len(y) - 1, count))
    for cx, cy in centres:
        off = (x - cx + 0.5 * repeat) % repeat - 0.5 * repeat
        near = np.flatnonzero(np.abs(off) < 0.5 * diameter)
        half = np.sqrt(0.25 * diameter**2 - off[near] ** 2)
        for shift in (-width, 0.0, width):
            low = np.maximum(y[:-1, None], cy + shift - half)
            high = np.minimum(y[1:, None], cy + shift + half)
            share[:, near] += np.maximum(high - low, 0.0) / np.diff(y)[:, None]
    area = np.cumsum(share, axis=1) * repeat / count
    return np.concatenate([np.zeros((len(share), 1)), area], axis=1)


class ResolvedSpots(Effect):
    """Contact only where spots of the road are at the moment, each heated by its share of the load."""

    cause = "each macroasperity spot heats rubber and road by itself"
    source = "theory 1.3 eqs. (1)-(7)"
    tells = ("hot spots that move with the road", "tracks of spots on the block")
    detail = True

    weight = Param(1.0, "1", "1: spots resolved; 0: averaged over their passage", low=0.0, high=1.0, off=0.0)
    pattern = Param("random", "1", 'arrangement of the spots: "random", "regular" or "stripes"', kinds=("name",))
    repeat = Param(0.05, "m", "length of road after which the pattern repeats, about", low=1e-3, high=10.0)
    seed = Param(1, "1", "number from which a random pattern is drawn", low=0, high=1e9, kinds=("whole",))

    @classmethod
    def prepare(cls, values, folder):
        """Check the pattern."""
        if values["pattern"] not in PATTERNS:
            raise BadInput(f"resolved_spots.pattern: {values['pattern']!r}; give {', '.join(PATTERNS)}")
        return values

    def heat(self, scene, p):
        """Covered share of every column, and the longest step that follows the spots."""

        @cache
        def ground():
            D, phi, W = scene.spot_diameter, scene.spot_fraction, scene.width
            if p.pattern == "stripes":
                repeat = D / phi
                grid = np.linspace(0.0, repeat, 4097)
                return repeat, np.tile(np.minimum(grid, D), (scene.mesh.n_across, 1))
            repeat, centres = discs(p.pattern, D, phi, W, p.repeat, p.seed)
            return repeat, covered(centres, repeat, D, scene.mesh.y, W)

        def cover(T, now, p):
            repeat, area = ground()
            mesh, count = scene.mesh, area.shape[1] - 1
            edges = (mesh.x[mesh.first : mesh.last + 1] - now.slid) / repeat
            turns = np.floor(edges)
            at = (edges - turns) * count
            k = np.minimum(at.astype(int), count - 1)
            F = area[:, k] + (at - k) * (area[:, k + 1] - area[:, k]) + turns * area[:, -1:]
            return (np.diff(F, axis=1) / mesh.dx_block).T.ravel()

        yield Term("contact.cover", cover)
        yield Term("contact.resolved", lambda T, now, p: p.weight)
        yield Term("march.rate", lambda T, now, p: STEPS * p.weight * now.speed / scene.spot_diameter)
