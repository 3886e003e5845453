"""What asperities of a road keep of their heat: discs thrown at random that do not overlap, heat between them by waves.

Nothing is known here of lanes, columns or depth: a plane is warm under its discs, conducts, and is looked at there again.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

SIDE, PIXELS, DRAWS = 30, 600, 8  # diameters along a square plane, its pixels, how many of them
FOURIER = np.geomspace(0.02, 200.0, 60)  # conductivity times time over heat capacity and diameter squared


def place_discs(fraction, rng):
    """Whether pixels (n, n) lie under a disc, as many as cover about a `fraction` of the plane."""
    places, grid = np.empty((0, 2)), np.arange(PIXELS) * SIDE / PIXELS
    while len(places) < round(fraction * SIDE**2 / (np.pi / 4)):
        place = SIDE * rng.random(2)
        if len(places) == 0 or _periodic_distance(places, place).min() >= 1.0:
            places = np.vstack([places, place])
    under = np.zeros((PIXELS, PIXELS), bool)
    for place in places:
        near = [np.flatnonzero(np.abs((grid - at + SIDE / 2) % SIDE - SIDE / 2) < 0.5) for at in place]
        x, y = (_periodic_distance(grid[i, None], at[None]) for i, at in zip(near, place, strict=True))
        under[np.ix_(*near)] |= np.hypot(x[:, None], y) < 0.5
    return under


def _periodic_distance(places, place):
    """Distances (n,) of places (n, d) from one, round the plane."""
    return np.linalg.norm((places - place + SIDE / 2) % SIDE - SIDE / 2, axis=1)


@lru_cache(maxsize=16)
def _disc_excess(fraction):
    """Excess of the discs over the plane at FOURIER, of 1 at first: the mean of all draws."""
    k = 2.0 * np.pi * np.fft.fftfreq(PIXELS, SIDE / PIXELS)
    square, out = k[:, None] ** 2 + k**2, np.zeros(len(FOURIER))
    for draw in range(DRAWS):
        under = place_discs(fraction, np.random.default_rng([draw, 11]))
        f, waves = under.mean(), np.abs(np.fft.fft2(under) / PIXELS**2) ** 2
        waves[0, 0] = 0.0
        order = np.argsort(square, axis=None)
        rising, power = square.ravel()[order], waves.ravel()[order]
        for i, fourier in enumerate(FOURIER):
            n = np.searchsorted(rising, 40.0 / fourier)
            out[i] += np.exp(-rising[:n] * fourier) @ power[:n] / (f * (1.0 - f)) / DRAWS
    return out


def retained_fraction(fraction, diameter, diffusivity, age):
    """What is left under discs (m across) of heat that came in there an `age` (s) ago: 1 at first, `fraction` at last."""
    fourier = diffusivity * np.asarray(age) / diameter**2
    if np.min(fourier) < FOURIER[0]:
        raise ValueError(f"heat of {np.min(age):.2g} s is too young: pixels would show")
    return fraction + (1.0 - fraction) * np.exp(
        np.interp(np.log(fourier), np.log(FOURIER), np.log(_disc_excess(fraction)))
    )
