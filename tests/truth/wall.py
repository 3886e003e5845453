"""What the air draws from the side wall of a block: waves up it, a memory in time, a plate across; no closure.

The draw of every moment spreads from the wall by diffusion and is made good at the face by what the contact passes on;
it is proportional to the wall's own rise, so that every moment is solved with all before it.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

AGES, WEIGHTS = np.polynomial.legendre.leggauss(6)
HEIGHTS, PLACES = 160, 16


class Wall:
    """The draw on a block's wall at some places along it, from t = 0 on."""

    def __init__(self, pair, held, modes=64):
        """`held` (W/m2K): what the contact passes on for every kelvin that the face lacks."""
        self.pair, (places, z) = pair, self.grid(pair)[::-1]
        self.z = z[1:]
        biot = held * pair.height / pair.k
        angle = np.array([brentq(lambda q, n=n: (q + n * np.pi) * np.sin(q) - biot * np.cos(q), 0.0, 0.5 * np.pi)
                          for n in range(modes)]) + np.pi * np.arange(modes)  # fmt: skip
        self.wave = angle / pair.height
        self.shapes = np.cos(np.outer(pair.height - self.z, self.wave))
        self.sizes = (self.shapes**2).sum(axis=0)[:, None]
        self.above, self.along = pair.above(self.z), pair.along(places)
        self.times, self.fluxes = [0.0], [np.zeros((modes, len(places)))]
        self.drawn = np.zeros((len(self.z), len(places)))  # K

    @staticmethod
    def grid(pair):
        """Heights (m) from the face on, and places along the block."""
        z = (np.arange(HEIGHTS) + 0.5) * pair.height / HEIGHTS
        return np.append(0.0, z), np.linspace(0.0, pair.length, PLACES)

    def step(self, t, film, amplitude, air):
        """Go on to t (s) with a `film` (W/m2K) and the section's modes; the draw (z, places) in K."""
        rise = self.above @ amplitude.T @ self.along.T - air
        young, old = self._memory(t)
        known = np.einsum("jm,jmx->mx", old, np.array(self.fluxes))
        known += np.einsum("jm,jmx->mx", young[:-1], np.array(self.fluxes[1:])) if len(young) > 1 else 0.0
        last = young[-1][:, None]
        flux = film * self._modes(rise)
        for _ in range(6):  # the draw of this moment acts on itself
            flux = film * self._modes(rise - self.shapes @ (known + last * flux))
        self.drawn = self.shapes @ (known + last * flux)
        self.times.append(t)
        self.fluxes.append(flux)
        return self.drawn

    def _modes(self, field):
        return (self.shapes.T @ field) / self.sizes

    def _memory(self, t):
        """What fluxes that are linear between the moments so far, and then until t, do to the wall against its mean:
        shares (moments, modes) in m2K/W of the young and of the old end of every stretch."""
        p, D = self.pair, self.pair.k / self.pair.rc
        ages = t - np.append(self.times, t)
        a, b = np.sqrt(ages[1:])[:, None], np.sqrt(ages[:-1])[:, None]
        root = 0.5 * (a + b) + 0.5 * (b - a) * AGES
        part = (
            2.0 * np.sqrt(D / np.pi) / p.k * 0.5 * (b - a) * WEIGHTS * (1.0 - 2.0 * np.sqrt(np.pi * D) * root / p.width)
        )
        part = part[:, None] * np.exp(-D * self.wave[:, None] ** 2 * (root * root)[:, None])
        late = ((root * root - a * a) / (b * b - a * a))[:, None]
        return (part * (1.0 - late)).sum(axis=2), (part * late).sum(axis=2)
