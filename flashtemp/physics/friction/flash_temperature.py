"""Flash temperature and friction that agree: the hot branch, and the way there from the cold one.

>>> from flashtemp.physics.friction import persson, rheology, roughness_spectrum
>>> from flashtemp.physics.material import LIBRARY
>>> theory = persson.Theory(rheology.READY["A"], roughness_spectrum.READY["asphalt A"])
>>> cold, hot = branches(theory, LIBRARY["tread_rubber"], Spots(3e-3), [0.1], 293.15, 1.5e5)
>>> print(f"{cold.viscous[0]:.3f} {hot.viscous[0]:.3f}")
0.428 0.324
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from flashtemp.errors import SolverFailure
from flashtemp.physics.arrays import Value
from flashtemp.physics.friction.heat_kernels import Memory, overlap
from flashtemp.physics.friction.persson import Found, Theory
from flashtemp.physics.material import Material

PASSES, CLOSE = 600, 1e-6  # of the fixed point; K, and share of the rise
STANDING = 1e-9  # m/s: what moves slower has the friction of this speed, and the heat of its own


@dataclass(frozen=True)
class Spots:
    """Macroasperity contact regions: `diameter` m; they cover `fraction`, P(2 pi/diameter) if not given."""

    diameter: float
    fraction: float | None = None

    def covered(self, theory: Theory, v: float, T0: float, p: float) -> float:
        """phi at speed v (m/s), background T0 (K), which the long waves feel, and pressure p (Pa)."""
        if self.fraction is not None:
            return self.fraction
        return float(theory.contact(2 * np.pi / self.diameter, v, T0, p))


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

    Only viscoelastic heat acts, and none of it flows into the road.  Raises SolverFailure where they do not agree.
    """
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
        self.n = 0
        self.T = np.full(len(theory.q), T0)

    def friction(self, v: float) -> float:
        """Friction coefficient at the temperatures of the moment; v >= 0."""
        return float(self.theory(max(v, STANDING), self.T, self.p).mu)

    def step(self, dt: float, v: float) -> None:
        """Go on by dt (s) at speed v >= 0 (m/s), which may change from step to step; nothing heats what sticks."""
        slow = max(v, STANDING)
        n, start = self.n, self.theory(slow, self.T, self.p)
        phi = self.spots.covered(self.theory, slow, self.T0, self.p)
        self.time[n + 1], self.slid[n + 1] = self.time[n] + dt, self.slid[n] + v * dt
        first = self.heat[n] = source(start, phi, v, self.p)
        for last in (False, True):
            self.kept[n] = self.past.spread(self.heat[n])
            self.T = self._felt(n + 1)
            if not last:  # heat of the step: mean of its ends
                self.heat[n] = 0.5 * (first + source(self.theory(slow, self.T, self.p), phi, v, self.p))
        self.n = n + 1

    def _felt(self, n: int) -> np.ndarray:
        """T_q (n_q,) K at step n."""
        mid = 0.5 * (self.slid[1 : n + 1] + self.slid[:n])
        h = overlap(np.abs(self.slid[n] - mid) / self.spots.diameter)
        first = int(np.argmax(h > 0)) if np.any(h > 0) else n
        ages = self.time[n] - self.time[first : n + 1]
        off, on = (-np.diff(f, axis=0) * h[first:n, None] for f in self.past.feel(ages))
        return self.T0 + self.past.rise(off, on, self.heat[first:n], self.kept[first:n])


def heating(theory: Theory, rubber: Material, spots: Spots, v: float, T0: float, p: float, steps: Value = 120) -> Way:
    """From the cold towards the hot branch at a constant speed v (m/s), over two spot diameters."""
    slid = 2.0 * spots.diameter * (np.arange(steps + 1) / steps) ** 2
    slide, mu, highest = Slide(theory, rubber, spots, T0, p, steps), [], []
    for dr in np.diff(slid):
        mu.append(slide.friction(v))
        highest.append(slide.T.max())
        slide.step(dr / v, v)
    mu.append(slide.friction(v))
    highest.append(slide.T.max())
    return Way(slide.time, slide.slid, np.full(steps + 1, v), np.array(mu), np.array(highest))
