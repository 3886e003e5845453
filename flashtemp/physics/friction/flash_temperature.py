"""Flash temperature and friction that agree: the hot branch, and the way there from the cold one.

>>> from flashtemp.physics.friction import persson, rheology, roughness_spectrum
>>> from flashtemp.physics.material import LIBRARY
>>> theory = persson.Theory(rheology.READY["A"], roughness_spectrum.READY["asphalt A"])
>>> cold, hot = branches(theory, LIBRARY["tread_rubber"], Spots(3e-3), [0.1], 293.15, 1.5e5)
>>> print(f"{cold.viscous[0]:.3f} {hot.viscous[0]:.3f}")
0.428 0.324
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from flashtemp.errors import SolverFailure
from flashtemp.physics.arrays import Value
from flashtemp.physics.friction.heat_kernels import Memory, overlap
from flashtemp.physics.friction.persson import Found, Theory
from flashtemp.physics.friction.road_side import RoadSide
from flashtemp.physics.material import Material

PASSES, CLOSE = 600, 1e-6  # of the fixed point; K, and share of the rise
WAY = 2.0  # spot diameters after which friction counts as hot
QUICK = 48  # steps to the hot branch where a road takes heat
STANDING = 1e-9  # m/s: what moves slower has the friction of this speed, and the heat of its own


@dataclass(frozen=True)
class Spots:
    """Macroasperity contact regions: `diameter` m; they cover `fraction`, P(2 pi/diameter) if not given.

    With a `road` under them it takes its share of the heat, and that of the adhesive part is released too; without one
    only viscoelastic heat acts, and none of it flows into the road.
    """

    diameter: float
    fraction: float | None = None
    road: RoadSide | None = None

    def covered(self, theory: Theory, v: float, T0: float, p: float) -> float:
        """phi at speed v (m/s), background T0 (K), which the long waves feel, and pressure p (Pa)."""
        if self.fraction is not None:
            return self.fraction
        return float(theory.contact(2 * np.pi / self.diameter, v, T0, p))

    def share(self, rubber: Material) -> float:
        """Share of the contact's heat that flows into the road at first, e_S/(e_R + e_S); 0 without a road."""
        if self.road is None:
            return 0.0
        return self.road.material.effusivity / (rubber.effusivity + self.road.material.effusivity)


class Branch(NamedTuple):
    """Friction at speeds (n,): viscoelastic and adhesive parts, and the highest T_q (K)."""

    speed: np.ndarray
    viscous: np.ndarray
    adhesive: np.ndarray
    T: np.ndarray

    @property
    def mu(self) -> np.ndarray:
        found: np.ndarray = self.viscous + self.adhesive
        return found


def memory(theory: Theory, rubber: Material) -> Memory:
    """The rubber's memory at the theory's wavenumbers."""
    return Memory(theory.q, rubber.volumetric_capacity, rubber.diffusivity)


def source(found: Found, phi: float, v: float, p: float) -> np.ndarray:
    """Viscoelastic heat (n,) W/m2 of every node in a spot, eq. (5): (p v/phi) dmu/dq dq."""
    heat: np.ndarray = p * v / phi * found.density * found.weight
    return heat


def hot(theory: Theory, rubber: Material, spots: Spots, v: float, T0: float, p: float, start: Value = None) -> Value:
    """Friction and T_q (n,) K that agree while spots pass over rubber at T0 (K); theory 2.5, steady.

    A road under the spots never gets steady: then friction is hot that has slid over WAY diameters, and `start` is not
    needed.  Raises SolverFailure where friction and temperature do not agree.
    """
    if spots.road is not None:
        *_, slide = _steps(theory, rubber, spots, v, T0, p, QUICK)
        return slide.found(v), slide.T
    past = memory(theory, rubber)
    off, on = past.steady(spots.diameter / v)
    phi = spots.covered(theory, v, T0, p)
    T = np.full(len(theory.q), T0) if start is None else start
    relax, last = 0.5, np.inf
    for _ in range(PASSES):
        found = theory(v, T, p)
        heat = source(found, phi, v, p)
        new = T0 + past.rise(off, on, heat[None], past.spread(heat)[None])
        change = np.max(np.abs(new - T))
        relax = relax if change < last else max(0.7 * relax, 0.02)
        T, last = T + relax * (new - T), change
        if change < CLOSE * max(1.0, new.max() - T0):
            return found, T
    raise SolverFailure(f"friction and flash temperature do not agree at {v:g} m/s: {change:.2g} K apart")


def branches(
    theory: Theory, rubber: Material, spots: Spots, speeds: Value, T0: float, p: float
) -> tuple[Branch, Branch]:
    """Cold branch (no flash temperature) and hot branch at speeds (m/s), background T0 (K) and pressure p (Pa)."""
    speeds = np.asarray(speeds, dtype=float)
    cold = theory(speeds, T0, p)
    rows, T = [], None
    for v in speeds:
        found, T = hot(theory, rubber, spots, v, T0, p, T)
        rows.append((found.viscous, found.adhesive, T.max()))
    viscous, adhesive, highest = np.array(rows, dtype=float).T
    return Branch(speeds, cold.viscous, cold.adhesive, np.full(len(speeds), T0)), Branch(
        speeds, viscous, adhesive, highest
    )


class Way(NamedTuple):
    """Friction along a way: times (n,) s, slid distance m, speed m/s, friction coefficient, highest T_q (K)."""

    time: np.ndarray
    slid: np.ndarray
    speed: np.ndarray
    mu: np.ndarray
    T: np.ndarray


class Slide:
    """A spot's friction as it slides, step by step: the kernel theory with all it remembers."""

    def __init__(self, theory: Theory, rubber: Material, spots: Spots, T0: float, p: float, steps: int) -> None:
        self.theory, self.spots, self.T0, self.p = theory, spots, T0, p
        self.past = memory(theory, rubber)
        self.time, self.slid = np.zeros(steps + 1), np.zeros(steps + 1)
        self.heat, self.kept = np.zeros((2, steps, len(theory.q)))
        self.net, self.taken = np.zeros((2, steps))  # W/m2 of the contact into rubber and road
        self.n = 0
        self.T = np.full(len(theory.q), T0)
        self.surface = None if spots.road is None else T0

    def friction(self, v: float) -> float:
        """Friction coefficient at the temperatures of the moment; v >= 0."""
        return float(self.found(v).mu)

    def found(self, v: float) -> Found:
        """Contact and friction at the temperatures of the moment; v >= 0."""
        return self.theory(max(v, STANDING), self.T, self.p, self.surface)

    def step(self, dt: float, v: float) -> None:
        """Go on by dt (s) at speed v >= 0 (m/s), which may change from step to step; nothing heats what sticks."""
        n, start = self.n, self.found(v)
        phi = self.spots.covered(self.theory, max(v, STANDING), self.T0, self.p)
        self.time[n + 1], self.slid[n + 1] = self.time[n] + dt, self.slid[n] + v * dt
        felt = _Felt(self, n + 1)
        first = self.heat[n] = source(start, phi, v, self.p)
        released = at_first = self.p * v / phi * float(start.adhesive)
        for last in (False, True):
            self.kept[n] = self.past.spread(self.heat[n])
            self.T, self.surface = felt(released)
            if not last:  # heat of the step: mean of its ends
                end = self.found(v)
                self.heat[n] = 0.5 * (first + source(end, phi, v, self.p))
                released = 0.5 * (at_first + self.p * v / phi * float(end.adhesive))
        self.n = n + 1


class _Felt:
    """Weights of all that a slide remembers at its step n: what every wavenumber and the surface feel there."""

    def __init__(self, slide: Slide, n: int) -> None:
        self.slide, self.n = slide, n
        mid = 0.5 * (slide.slid[1 : n + 1] + slide.slid[:n])
        h = overlap(np.abs(slide.slid[n] - mid) / slide.spots.diameter)
        self.first = int(np.argmax(h > 0)) if np.any(h > 0) else n
        ago = slide.time[n] - slide.time[: n + 1]
        ages, h = ago[self.first :], h[self.first :]
        self.off, self.on = (-np.diff(f, axis=0) * h[:, None] for f in slide.past.feel(ages))
        if slide.spots.road is not None:
            self.near = slide.past.surface(self.off)
            self.own = -np.diff(np.sqrt(ages)) * h * 2.0 / (np.sqrt(np.pi) * slide.past.effusivity)
            self.mine = -np.diff(slide.spots.road.warmed(ago, slide.spots.diameter))

    def __call__(self, released: float) -> tuple[np.ndarray, float | None]:
        """T_q (n_q,) and temperature of the surface, K, with `released` W/m2 in the contact in the last step."""
        s, past, to = self.slide, slice(self.first, self.n), self.n - 1
        T = s.T0 + s.past.rise(self.off, self.on, s.heat[past], s.kept[past])
        if s.spots.road is None:
            return T, None
        if len(self.own) == 0:  # rubber that is new to the spot
            return T, s.T0
        s.net[to] = released
        s.taken[to] = 0.0
        top = float(np.sum(self.near * s.heat[past]) + self.own @ s.net[past])
        taken = s.spots.road.taken(top, float(self.mine @ s.taken[: self.n]), self.own[-1], self.mine[-1])
        s.taken[to], s.net[to] = taken, released - taken
        return T + s.net[past] @ self.near, s.T0 + top - self.own[-1] * taken


def _steps(
    theory: Theory, rubber: Material, spots: Spots, v: float, T0: float, p: float, steps: int
) -> Iterator[Slide]:
    """A slide at constant speed v (m/s) over WAY spot diameters, before the first step and after every one."""
    slid = WAY * spots.diameter * (np.arange(steps + 1) / steps) ** 2
    slide = Slide(theory, rubber, spots, T0, p, steps)
    yield slide
    for dr in np.diff(slid):
        slide.step(dr / v, v)
        yield slide


def heating(theory: Theory, rubber: Material, spots: Spots, v: float, T0: float, p: float, steps: int = 120) -> Way:
    """From the cold towards the hot branch at a constant speed v (m/s), over WAY spot diameters."""
    rows = [(s.friction(v), s.T.max()) for s in _steps(theory, rubber, spots, v, T0, p, steps)]
    slid = WAY * spots.diameter * (np.arange(steps + 1) / steps) ** 2
    return Way(slid / v, slid, np.full(steps + 1, v), *np.array(rows).T)
