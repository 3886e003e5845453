"""What the air draws from the side wall of a block: waves up it and across it, held at the face or free; no closure.

What a draw takes is spread by diffusion, up the block among waves that the contact holds at the face while the block
slides and that are free while it is lifted, across it among cosines.  A draw is proportional to the wall's own rise and
linear in time between moments; cosines that are too short to matter follow it at once.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

HEIGHTS, PLACES = 160, 16
WAVES, COSINES = 64, 48
NODES, WEIGHTS = np.polynomial.legendre.leggauss(128)


class Wall:
    """What a block's wall lacks at some places along it, from t = 0 on."""

    def __init__(self, pair, held, free):
        """`held` (places,) and `free` (W/m2K): what leaves the face for every kelvin that it is warmer."""
        self.pair, (z, places) = pair, self.grid(pair)
        self.up = {True: Waves(pair, held, z), False: Waves(pair, np.full(PLACES, free), z)}
        self.above, self.along = pair.above(self.up[True].nodes), pair.along(places)
        n, half = np.arange(COSINES + 1), 0.5 * pair.width
        self.across = (n * np.pi / half)[:, None, None]
        self.share = np.where(n > 0, 2.0, 1.0)[:, None, None] / (half * pair.rc)
        short = np.pi**2 / 6.0 - (1.0 / n[1:] ** 2).sum()
        self.tail = 2.0 * half / (np.pi**2 * pair.k) * short
        self.t, self.touching = 0.0, True
        self.left = np.zeros((COSINES + 1, PLACES, WAVES))
        self.draw = np.zeros((COSINES + 1, PLACES, WAVES))

    @staticmethod
    def grid(pair):
        """Heights (m) from the face on, and places along the block."""
        return np.linspace(0.0, pair.height, HEIGHTS + 1), np.linspace(0.0, pair.length, PLACES)

    def step(self, t, film, fin, touching, amplitude, air):
        """Go on to t (s) with a `film` (W/m2K) of which the section itself feels `fin`; what is lacking (z, places)."""
        if touching != self.touching:
            turn = self.up[touching].overlap(self.up[self.touching])
            self.left, self.draw = (np.einsum("pij,npj->npi", turn, a) for a in (self.left, self.draw))
            self.touching = touching
        up, p = self.up[touching], self.pair
        section = up.project(self.above @ amplitude.T @ self.along.T - air)
        rate = p.k / p.rc * (self.across**2 + up.wave**2)
        kept, young, old = _within(rate, t - self.t)
        beside = np.where(self.across > 0.0, 0.0, fin * section)
        known = kept * self.left + self.share * (old * self.draw - young * beside)
        answer = (self.share * young).sum(axis=0) + self.tail
        wall = (section - known.sum(axis=0)) / (1.0 + film * answer)
        self.draw = film * wall - beside
        self.left = known + self.share * young * film * wall
        self.t = t
        return up.values(self.left.sum(axis=0) + self.tail * film * wall)


class Waves:
    """Cosines that end flat at the block's back and obey k dT/dz = H T at its face; orthonormal, for H (places,)."""

    def __init__(self, pair, held, z):
        self.height = pair.height
        angles = [
            brentq(lambda q, n=n, b=b: (q + n * np.pi) * np.sin(q) - b * np.cos(q), 0.0, 0.5 * np.pi) + n * np.pi
            for b in np.maximum(held, 1e-6) * pair.height / pair.k
            for n in range(WAVES)
        ]
        self.wave = np.reshape(angles, (len(held), WAVES)) / pair.height
        twice = 2.0 * self.wave * pair.height
        self.size = 1.0 / np.sqrt(0.5 * pair.height * (1.0 + np.sin(twice) / twice))
        self.nodes = 0.5 * pair.height * (1.0 + NODES)
        self.onto = 0.5 * pair.height * WEIGHTS[:, None] * self._at(self.nodes)
        self.seen = self._at(z)

    def _at(self, z):
        return self.size[:, None] * np.cos((self.height - z)[None, :, None] * self.wave[:, None])

    def project(self, field):
        """Sizes (places, waves) of a field (nodes, places)."""
        return np.einsum("pzm,zp->pm", self.onto, field)

    def values(self, sizes):
        """The field (z, places)."""
        return np.einsum("pzm,pm->zp", self.seen, sizes)

    def overlap(self, other):
        """What waves (places, own, other) of another kind are made of; exact."""
        a, b, h = self.wave[:, :, None], other.wave[:, None], self.height
        both = 0.5 * h * (np.sinc((a - b) * h / np.pi) + np.sinc((a + b) * h / np.pi))
        return both * self.size[:, :, None] * other.size[:, None]


def _within(rate, dt):
    """What is left of a state after dt (s), and weights of the young and the old end of a source that is linear."""
    x = np.maximum(rate * dt, 1e-9)
    kept, whole = np.exp(-x), -np.expm1(-x) / x
    young = np.where(x > 1e-3, (1.0 - whole) / x, 0.5 - x / 6.0)
    return kept, dt * young, dt * (whole - young)
