"""A corner of the block in its section across: what films on the walls take from heat that came in through the face.

Up the block and across it heat spreads alike wherever it is, so that temperature is a sum of products of two slabs'
modes: one is held at its face by the contact, the other is cooled at its wall.  Both decay exactly, and what flows in
through the face is even within a step.  Beside it goes the same block without a wall, whose face is known; it tells what
flowed in.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import legendre

from flashtemp.physics.arrays import Array
from flashtemp.physics.material import Material

ACROSS, UP = 12, 18  # modes
SLOW = 1e-9  # 1/s, taken for the rate of what does not decay


@dataclass(frozen=True)
class Slab:
    """Heat conduction in a slab of some `depth` (m), insulated at its back: `count` functions, orthonormal over it.

    They are Legendre polynomials in the root of the depth, since what happens happens near the face.
    """

    depth: float
    count: int

    @cached_property
    def _basis(self) -> tuple[Array, Array]:
        """Coefficients that make the polynomials orthonormal, and -d2/dz2 among them in 1/m2."""
        nodes, weights = legendre.leggauss(2 * self.count)
        root, weights = 0.5 * (nodes + 1.0), 0.5 * weights
        values = legendre.legvander(nodes, self.count - 1)
        slopes = 2.0 * legendre.legval(nodes, legendre.legder(np.eye(self.count)), tensor=True).T
        stretch = 2.0 * self.depth * root
        mass = (values.T * (weights * stretch)) @ values
        make = np.linalg.inv(np.linalg.cholesky(mass))
        return make, make @ ((slopes.T * (weights / stretch)) @ slopes) @ make.T

    def at(self, z: Array) -> Array:
        """The functions (z, count) at depths z (m)."""
        values: Array = legendre.legvander(2.0 * np.sqrt(np.asarray(z) / self.depth) - 1.0, self.count - 1)
        return values @ self._basis[0].T

    @cached_property
    def foot(self) -> Array:
        """The functions (count,) at the face."""
        return self.at(np.zeros(1))[0]

    @property
    def whole(self) -> Array:
        """Their integrals (count,) over the depth, of which an even temperature is made: the first one is even."""
        return np.sqrt(self.depth) * np.eye(self.count)[0]

    def modes(self, diffusivity: float, held: Array) -> tuple[Array, Array]:
        """Rates (..., count) in 1/s and vectors (..., count, count) of a face `held` (...) 1/m by what lies beyond."""
        stiff = self._basis[1] + np.asarray(held)[..., None, None] * np.outer(self.foot, self.foot)
        rates, vectors = np.linalg.eigh(diffusivity * stiff)
        return np.maximum(rates, SLOW), vectors


@dataclass(frozen=True)
class Corner:
    """A block of some `width` and `height` (m), and what acts on it in each of n - 1 steps between `times` (n,) in s.

    `rise` (n, x) in K of the face far from the walls, `hold` (n - 1, x) W/m2K by which the contact holds it, `film`
    (n - 1,) W/m2K of the walls, `fin` (n - 1,) that part of the film which the section itself feels, as a whole.
    """

    block: Material
    width: float
    height: float
    times: Array
    rise: Array
    hold: Array
    film: Array
    fin: Array

    def lacks(self, z: Array, moments: Array) -> Array:
        """How much cooler than the section the wall is, as a share (moments, x, z) of the section's rise.

        `moments` are numbers of `times`, z heights (m) above the face.
        """
        up, across = Slab(self.height, UP), Slab(0.5 * self.width, ACROSS)
        k, D, at = self.block.conductivity, self.block.diffusivity, up.at(z)
        out, n = np.zeros((len(moments), self.rise.shape[1], len(z))), self.rise.shape[1]
        state, plain = np.zeros((n, ACROSS, UP)), np.zeros((n, UP))  # of the corner, and of the block without a wall
        wanted = {int(number): row for row, number in enumerate(moments)}
        turn, turned = np.eye(ACROSS), np.broadcast_to(np.eye(UP), (n, UP, UP))
        now, rates = None, (np.zeros(0), np.zeros(0))
        for i, dt in enumerate(np.diff(self.times)):
            if now is None or self.film[i] != self.film[now] or not np.array_equal(self.hold[i], self.hold[now]):
                state = turn @ state @ turned.swapaxes(-1, -2)
                plain = (turned @ plain[..., None])[..., 0]
                (wall, turn), (face, turned) = across.modes(D, self.film[i] / k), up.modes(D, self.hold[i] / k)
                state, plain = turn.T @ state @ turned, (plain[:, None] @ turned)[:, 0]
                enters = D / k * (up.foot @ turned)
                spread, rates, now = (across.whole @ turn)[:, None], (wall, face), i
            sinking = rates[1] + 2.0 * self.fin[i] * D / (k * self.width)
            kept, gone = np.exp(-rates[1] * dt)[:, None] * np.exp(-rates[0] * dt)[:, None], np.exp(-sinking * dt)
            gain = (1.0 - gone) / sinking * enters
            foot = k / D * enters
            flux = (self.rise[i + 1] - (foot * gone * plain).sum(axis=-1)) / (foot * gain).sum(axis=-1)
            plain = gone * plain + gain * flux[:, None]
            into = (1.0 - kept) / (rates[0][:, None] + rates[1][:, None]) * (spread * enters[:, None])
            state = kept * state + into * flux[:, None, None]
            if i + 1 in wanted:
                section = (turned @ plain[..., None])[..., 0] @ at.T
                seen = (turned @ ((across.foot @ turn) @ state)[..., None])[..., 0] @ at.T
                out[wanted[i + 1]] = _share(section - seen, section)
        return out


def _share(lack: Array, section: Array) -> Array:
    """The lack over the section, nothing where hardly any heat has come yet."""
    faint = 1e-3 * np.abs(section).max() + 1e-12
    return lack * section / (section**2 + faint**2)
