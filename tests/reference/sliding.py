"""A block that slides on a road, by modes and memory: no mesh, no closure, no integrator of flashtemp.

The block is a sum of cosines along it and of the eigenfunctions of Legendre polynomials up it, each integrated exactly
for a flux that is linear within a step.  The road has no mesh at all: every stretch of it remembers what it received
since it came under the block, and what a lane keeps of that after a time tau is eq. (15b) in its own words, Bessel
functions.  Heat that enters a spot is felt there by eq. (14) as it stands, a convolution.  Rises are in K, the rest is SI.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.polynomial import legendre
from scipy.linalg import eigh, lu_factor, lu_solve
from scipy.special import erfcx, i0e, i1e

AGES, WEIGHTS = legendre.leggauss(8)


@dataclass(frozen=True)
class SlidingPair:
    """Block and road: sizes, conductivities `k`, heat capacities `rc` of a volume, and the spots' `diameter`.

    `columns` along the block, of which the road passes one a step; `degree` of the polynomials up it.
    """

    length: float = 0.025
    height: float = 0.007
    width: float = 0.05
    k: float = 0.25
    rc: float = 1200.0 * 1700.0
    road_k: float = 1.0
    road_rc: float = 2300.0 * 950.0
    diameter: float = 3e-3
    columns: int = 100
    degree: int = 48

    @property
    def x(self):
        return (np.arange(self.columns) + 0.5) * self.length / self.columns

    @property
    def dx(self):
        return self.length / self.columns

    @property
    def road_effusivity(self):
        return np.sqrt(self.road_k * self.road_rc)

    @cached_property
    def height_modes(self):
        """Eigenvalues (k,) and Legendre coefficients (k, k) of the functions up the block, orthonormal over its height."""
        n = self.degree
        s, w = legendre.leggauss(n + 1)
        slope = np.stack([legendre.legval(s, legendre.legder(row)) for row in self._polynomials]) * 2.0 / self.height
        return eigh((slope * w * 0.5 * self.height) @ slope.T)

    @cached_property
    def _polynomials(self):
        n = np.arange(self.degree)
        return np.diag(np.sqrt((2.0 * n + 1.0) / self.height))

    def evaluate_height_modes(self, z):
        """The functions up the block (places, k) at z (m)."""
        values = legendre.legval(2.0 * np.asarray(z) / self.height - 1.0, self._polynomials.T)
        return values.T @ self.height_modes[1]

    def evaluate_length_modes(self, x):
        """The cosines along the block (places, m)."""
        return np.cos(np.pi * np.outer(x, np.arange(self.columns)) / self.length)

    # --- memory ---------------------------------------------------------------------------------------
    def retained_fraction(self, tau, floor):
        """What a lane keeps of its heat after tau, never less than its share of the road."""
        X = (self.diameter / 2) ** 2 / (2 * self.road_k / self.road_rc * tau)
        return np.maximum(1.0 - i0e(X) - i1e(X), floor)

    def surface_response(self, start_age, end_age, keep=None, effusivity=None):
        """What a flux that is linear between these ages does to a surface: shares of its young and its old end."""
        a, b = np.sqrt(start_age)[:, None], np.sqrt(end_age)[:, None]
        root = 0.5 * (a + b) + 0.5 * (b - a) * AGES
        part = (b - a) * WEIGHTS / (np.sqrt(np.pi) * (effusivity or self.road_effusivity))
        if keep is not None:
            part = part * keep(root * root)
        late = (root * root - a * a) / (b * b - a * a)
        return (part * (1.0 - late)).sum(axis=1), (part * late).sum(axis=1)

    def disc_overlap(self, w):
        """What two discs share that lie `w` diameters apart."""
        w = np.minimum(w, 1.0)
        return 2.0 / np.pi * (np.arccos(w) - w * np.sqrt(1.0 - w * w))


@dataclass
class SlidingBlock:
    """A block on its way: amplitudes of its modes, and what the road under it and `wake_columns` behind it received.

    `fraction` (columns,) of contact; lanes may widen, and `flash_factor` is the share of eq. (14) that spots feel.  Where the
    fraction varies, the lanes in contact at one place were in contact at another on the lesser of both fractions.
    """

    pair: SlidingPair
    fraction: np.ndarray
    widening: bool = True
    flash_factor: float = 0.0
    slope: float = 0.0  # of the block's conductivity, 1/K
    wake_columns: int = 0
    amplitude: np.ndarray = field(init=False)

    def __post_init__(self):
        p, n = self.pair, self.pair.columns
        self.fraction = np.broadcast_to(self.fraction, n).astype(float)
        m = np.arange(n)
        self.cosines = p.evaluate_length_modes(p.x)
        self.share = np.where(m > 0, 2.0, 1.0)
        self.forward = self.share[:, None] * self.cosines.T / n
        self.rates = p.k / p.rc * ((np.pi * m / p.length)[:, None] ** 2 + np.maximum(p.height_modes[0], 0.0))
        self.foot = p.evaluate_height_modes(np.zeros(1))[0]
        nodes, weights = legendre.leggauss(p.degree)
        self.nodal = p.evaluate_height_modes(0.5 * p.height * (1.0 + nodes))
        self.modal = 0.5 * p.height * weights[:, None] * self.nodal
        self.amplitude = np.zeros((n, p.degree))
        self.cached: tuple = ()
        self.lift_block()

    def lift_block(self):
        """Forget the road: the block was lifted and comes down on fresh road."""
        n = self.pair.columns
        self.received = np.zeros((n + self.wake_columns + 2, n))  # by stretch of road and the column under which it was
        self.steps, self.stretches, self.J, self.into, self.settled = 0, [], None, [], 0

    @property
    def face(self):
        """Rise (columns,) of the block's face, mean of spots and the rest."""
        return self.cosines @ (self.amplitude @ self.foot)

    def section_rise(self, x, z):
        """Rise (z, x) of the section at places (m)."""
        return self.pair.evaluate_height_modes(z) @ self.amplitude.T @ self.pair.evaluate_length_modes(x).T

    # --- one step ---------------------------------------------------------------------------------------
    def advance_sliding(self, dt, heat, resistance=0.0, inflow=0.0, films=(0.0, 0.0), air=0.0):
        """Move on by a column: `heat` (columns,) W/m2 of spot area, a film's `resistance` m2 K/W on the road's side of the
        heat, `inflow` (columns,) K of road that is warm before, `films` W/m2K of the end walls and the side walls.

        Face and flux into the road (columns,), and the rise where rubber touches road.
        """
        n = self.pair.columns
        first = self.J is None or dt != self.stretches[0]  # the flux jumps, else it goes on along a line
        length = 2 * n + self.wake_columns
        self.settled = length if self.J is None else 0 if first else self.settled + 1
        self.stretches = [dt] * length if self.J is None else [dt, *self.stretches[:-1]]
        at = self._step_operators(dt, resistance, films[1])
        left = self.amplitude * at["decayed"] + at["source"] * self._modal_sources(films, air)
        if not first:
            left = left + at["early"] * (self.forward @ (self.fraction * self.J))[:, None]
        known = self.cosines @ (left @ self.foot)
        rows = (self.steps - np.arange(n)) % len(self.received)
        past = np.einsum("ij,ij->i", self.received[rows], at["road"])
        felt = sum((w * J for w, J in zip(at["flash_memory"], self.into, strict=False)), np.zeros(n))
        right = past + inflow + at["own"] * heat - known - felt
        J = lu_solve(at["lu"][first], right)
        enters = at["late"] + at["early"] if first else at["late"]
        self.amplitude = left + enters * (self.forward @ (self.fraction * J))[:, None]
        self.J, self.into = J, [J, *self.into[: len(at["flash_memory"]) - 1]]
        self.received[rows, np.arange(n)] = heat - J
        self.steps += 1
        self.received[self.steps % len(self.received)] = 0.0
        face = self.face
        return face, heat - J, face + felt + at["flash"] * J

    def advance_rest(self, dt, films=(0.0, 0.0), face=0.0, air=0.0):
        """Stand in the air, with a film on the face too."""
        at = self._modal_decay(dt, films[1])
        lost = self.forward @ (face * (air - self.face))
        left = self.amplitude * at["decayed"] + at["source"] * self._modal_sources(films, air)
        self.amplitude = left + (at["early"] + at["late"]) * lost[:, None]

    def _modal_sources(self, films, air):
        """Rates of the amplitudes by heat through the walls and by a conductivity that varies, at the present state."""
        p, a = self.pair, self.amplitude
        change = np.zeros_like(a)
        even = self.modal.sum(axis=0)
        if films[0]:
            sign = (-1.0) ** np.arange(p.columns)
            for ends in (np.ones(p.columns), sign):
                wall = air * even - ends @ a
                change += films[0] / (p.rc * p.length) * (self.share * ends)[:, None] * wall
        if films[1] and air:
            change[0] += 2.0 * films[1] / (p.rc * p.width) * air * even
        if self.slope:
            rise = self.cosines @ a @ self.nodal.T
            change -= self.rates * (self.forward @ (0.5 * self.slope * rise * rise) @ self.modal)
        return change

    def _modal_decay(self, dt, sides):
        rates = self.rates + 2.0 * sides / (self.pair.rc * self.pair.width)
        held = np.exp(-rates * dt)
        x = np.maximum(rates * dt, 1e-8)
        moved = dt * -np.expm1(-x) / x
        late = np.where(x > 1e-3, (1.0 - moved / dt) / x, 0.5 - x / 6.0) * dt
        unit = self.foot / self.pair.rc
        return {"decayed": held, "source": moved, "late": late * unit, "early": (moved - late) * unit}

    def _step_operators(self, dt, resistance, sides):
        """All that a step needs which its fluxes do not change."""
        p, n = self.pair, self.pair.columns
        key = (dt, resistance, sides)
        if self.cached and self.cached[0] == key and self.settled > n + 1:
            return self.cached[1]
        at = self._modal_decay(dt, sides)
        ages = np.concatenate([[0.0], np.cumsum(self.stretches)])
        keep = (lambda tau: p.retained_fraction(tau, self.fraction.mean())) if self.widening else None
        w0, w1 = p.surface_response(ages[:n], ages[1 : n + 1], keep)
        enter = 0.5 * np.array(self.stretches[:n])
        first = sum(p.surface_response(ages[:n], ages[:n] + enter, keep))
        common = np.minimum(self.fraction[:, None], self.fraction) / self.fraction[:, None]
        i, c = np.indices((n, n))
        age = np.maximum(i - c, 0)
        road = np.where(c > 0, w0[age], first[age]) + np.where(age > 0, w1[np.maximum(age - 1, 0)], 0.0)
        at["road"] = np.where(c < i, road * common, 0.0)
        own = np.full(n, w0[0])
        own[0] = first[0]
        felt = self._flash_weights(dt)
        at["flash"], at["flash_memory"], at["own"] = felt[0], felt[1:], own + resistance
        beside = np.diag(own + resistance + at["flash"])
        late = self.cosines @ ((at["late"] @ self.foot)[:, None] * self.forward * self.fraction)
        early = self.cosines @ ((at["early"] @ self.foot)[:, None] * self.forward * self.fraction)
        at["lu"] = lu_factor(late + beside), lu_factor(late + early + beside)
        self.cached = key, at
        return at

    def _flash_weights(self, dt):
        """Weights of the fluxes into the spot's rubber, the present first."""
        p = self.pair
        if not self.flash_factor:
            return np.zeros(1)
        count = int(np.ceil(p.diameter / (p.dx / dt) / dt)) + 1
        ages = dt * np.arange(count + 1)
        w0, w1 = p.surface_response(
            ages[:-1], ages[1:], lambda tau: p.disc_overlap(tau * p.dx / dt / p.diameter), np.sqrt(p.k * p.rc)
        )
        out = np.concatenate([w0, [0.0]]) + np.concatenate([[0.0], w1])
        return self.flash_factor * (1.0 - self.fraction.mean()) * out

    # --- the road behind ------------------------------------------------------------------------------------
    def wake_profile(self, film=0.0):
        """Places (m, from the trailing edge) and rise (places,) of the road behind, mean of lanes and the rest.

        All lanes and the road between them hold what the lanes took; what the air takes is small and counted once.
        """
        p, n, dt = self.pair, self.pair.columns, self.stretches[0]
        i = np.arange(n, n + self.wake_columns)
        rows = (self.steps - 1 - i) % len(self.received)
        ages = dt * np.arange(n + self.wake_columns + 1)
        w0, w1 = p.surface_response(ages[:-1], ages[1:])
        enter = sum(p.surface_response(ages[:-1], ages[:-1] + 0.5 * dt))
        leave = sum(p.surface_response(ages[1:-1] - 0.5 * dt, ages[1:-1]))
        c = np.arange(n)
        age = i[:, None] - c
        weight = np.where(c > 0, w0[age], enter[age])
        weight = weight + np.where(c < n - 1, w1[age - 1], leave[age - 1])
        rise = self.fraction.mean() * np.einsum("ij,ij->i", self.received[rows], weight)
        under = w0 + np.concatenate([[0.0], w1[:-1]])
        lost = film * np.array([under[k::-1][: k + 1] @ rise[: k + 1] for k in range(self.wake_columns)])
        return (i + 0.5) * p.dx - p.length, rise - lost

    def departed_heat(self):
        """Heat (J/m2 of lane) that the stretch of road received which left last."""
        row = (self.steps - 1 - self.pair.columns) % len(self.received)
        return float(self.received[row].sum() * self.stretches[0])


def impulse_rise(heat, age, pair, film):
    """Rise of a road that received `heat` (J/m2) `age` (s) ago and has lost some to the air since."""
    e = pair.road_effusivity
    return heat / e * (1.0 / np.sqrt(np.pi * age) - film / e * erfcx(film * np.sqrt(age) / e))


def road_conductance(pair, fraction, speed, shape, places):
    """W/m2K of face by which the road takes heat at `places` (m): of a block that slides without friction and is as warm
    along it as `shape` (columns,) says, for every kelvin of the face alone."""
    s, taken, n = SlidingBlock(pair, fraction, True, 1.0), np.zeros((2, pair.columns)), pair.columns
    s.amplitude += np.sqrt(pair.height) * np.outer(s.forward @ shape, pair.height_modes[1][0])
    for k in range(2 * n):
        face, road, _ = s.advance_sliding(pair.dx / speed, np.zeros(n))
        taken += np.array([s.fraction * road, face]) if k >= n else 0.0
    return np.interp(places, pair.x, taken[0] / taken[1])


def simulate_sliding(pair, speeds, pressure, mu=1.0, fraction=0.2, widening=True):
    """Slide as `speeds` [(m/s, m), ...] say under `pressure` (columns,) Pa; at the end face and heat into the road.

    Rises (columns,) in K and W/m2 of spot area.
    """
    s = SlidingBlock(pair, fraction, widening)
    for v, distance in speeds:
        for _ in range(round(distance / pair.dx)):
            face, road, _ = s.advance_sliding(pair.dx / v, mu * pressure * v / s.fraction)
    return face, road
