"""Self-consistent flash temperature and friction: the hot branch, and the transition from the cold branch to it.

>>> from flashtemp.physics.friction import persson, rheology, roughness_spectrum
>>> from flashtemp.physics.material import LIBRARY
>>> theory = persson.PerssonTheory(rheology.READY_RUBBERS["A"], roughness_spectrum.READY_ROADS["asphalt A"])
>>> cold, hot = compute_branches(theory, LIBRARY["tread_rubber"], ContactSpots(3e-3), [0.1], 293.15, 1.5e5)
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
from flashtemp.physics.friction.heat_kernels import HeatMemory, disc_overlap
from flashtemp.physics.friction.persson import PerssonTheory, TheoryResult
from flashtemp.physics.friction.road_side import RoadSide
from flashtemp.physics.material import Material

MAX_FLASH_ITERATIONS, FLASH_TOLERANCE = 600, 1e-6  # fixed-point iteration; K, and fraction of the temperature rise
HOT_SLIDING_DIAMETERS = 2.0  # slid spot diameters after which friction counts as hot
ROAD_SLIDING_STEPS = 48  # steps to the hot branch where heat flows into a road
MIN_SLIDING_SPEED_M_S = 1e-9  # m/s: friction at lower speeds is that at this speed; heat uses the speed itself


@dataclass(frozen=True)
class ContactSpots:
    """Macroasperity contact regions of `diameter` (m) that cover `fraction`, by default P(2 pi/diameter).

    With a `road`, part of the heat flows into it, and the heat of the adhesive part is included.  Without a road only
    viscoelastic heat acts, and all of it stays in the rubber.
    """

    diameter: float
    fraction: float | None = None
    road: RoadSide | None = None

    def contact_fraction(self, theory: PerssonTheory, v: float, T0: float, p: float) -> float:
        """phi at speed v (m/s), background T0 (K), the temperature of long waves, and pressure p (Pa)."""
        if self.fraction is not None:
            return self.fraction
        return float(theory.contact_fraction(2 * np.pi / self.diameter, v, T0, p))

    def road_heat_fraction(self, rubber: Material) -> float:
        """Initial fraction of the contact's heat that flows into the road, e_S/(e_R + e_S); 0 without a road."""
        if self.road is None:
            return 0.0
        return self.road.material.effusivity / (rubber.effusivity + self.road.material.effusivity)


class FrictionBranch(NamedTuple):
    """Friction at speeds (n,): viscoelastic and adhesive parts, and the highest T_q (K)."""

    speed: np.ndarray
    viscous: np.ndarray
    adhesive: np.ndarray
    T: np.ndarray

    @property
    def mu(self) -> np.ndarray:
        """Friction coefficient (n,), viscoelastic and adhesive."""
        total: np.ndarray = self.viscous + self.adhesive
        return total


def rubber_memory(theory: PerssonTheory, rubber: Material) -> HeatMemory:
    """Heat memory of the rubber at the wavenumbers of the theory."""
    return HeatMemory(theory.q, rubber.volumetric_capacity, rubber.diffusivity)


def viscoelastic_heat(result: TheoryResult, phi: float, v: float, p: float) -> np.ndarray:
    """Viscoelastic heat (n,) W/m2 in a spot by wavenumber node: (p v/phi) dmu/dq dq; theory.md, eq. (5)."""
    heat: np.ndarray = p * v / phi * result.density * result.weight
    return heat


def solve_hot_branch(
    theory: PerssonTheory, rubber: Material, spots: ContactSpots, v: float, T0: float, p: float, start: Value = None
) -> Value:
    """Steady self-consistent friction and T_q (n,) K while spots pass over rubber at T0 (K); theory.md, section 2.5.

    With a road there is no steady state: friction after `HOT_SLIDING_DIAMETERS` is taken as hot, and `start` is unused.
    Raises SolverFailure where the iteration does not converge.
    """
    if spots.road is not None:
        *_, slide = _slide_towards_hot(theory, rubber, spots, v, T0, p, ROAD_SLIDING_STEPS)
        return slide.evaluate_theory(v), slide.T
    memory = rubber_memory(theory, rubber)
    off, on = memory.steady_weights(spots.diameter / v)
    phi = spots.contact_fraction(theory, v, T0, p)
    T = np.full(len(theory.q), T0) if start is None else start
    relax, last = 0.5, np.inf
    for _ in range(MAX_FLASH_ITERATIONS):
        result = theory(v, T, p)
        heat = viscoelastic_heat(result, phi, v, p)
        new = T0 + memory.temperature_rise(off, on, heat[None], memory.spread_heat(heat)[None])
        change = np.max(np.abs(new - T))
        # damped fixed-point iteration: the step is shortened whenever the change does not decrease
        relax = relax if change < last else max(0.7 * relax, 0.02)
        T, last = T + relax * (new - T), change
        if change < FLASH_TOLERANCE * max(1.0, new.max() - T0):
            return result, T
    raise SolverFailure(f"friction and flash temperature do not agree at {v:g} m/s: {change:.2g} K apart")


def compute_branches(
    theory: PerssonTheory, rubber: Material, spots: ContactSpots, speeds: Value, T0: float, p: float
) -> tuple[FrictionBranch, FrictionBranch]:
    """Cold branch (no flash temperature) and hot branch at speeds (m/s), background T0 (K) and pressure p (Pa)."""
    speeds = np.asarray(speeds, dtype=float)
    cold = theory(speeds, T0, p)
    rows, T = [], None
    for v in speeds:
        result, T = solve_hot_branch(
            theory, rubber, spots, v, T0, p, T
        )  # starts from the temperatures of the last speed
        rows.append((result.viscous, result.adhesive, T.max()))
    viscous, adhesive, highest = np.array(rows, dtype=float).T
    return FrictionBranch(speeds, cold.viscous, cold.adhesive, np.full(len(speeds), T0)), FrictionBranch(
        speeds, viscous, adhesive, highest
    )


class HeatingPath(NamedTuple):
    """Friction along a path: times (n,) s, slid distance m, speed m/s, friction coefficient, highest T_q (K)."""

    time: np.ndarray
    slid: np.ndarray
    speed: np.ndarray
    mu: np.ndarray
    T: np.ndarray


class SlidingHistory:
    """Friction of a sliding spot step by step, by the kernel theory with its full heat history."""

    def __init__(
        self, theory: PerssonTheory, rubber: Material, spots: ContactSpots, T0: float, p: float, steps: int
    ) -> None:
        self.theory, self.spots, self.T0, self.p = theory, spots, T0, p
        self.heat_memory = rubber_memory(theory, rubber)
        self.time, self.slid = np.zeros(steps + 1), np.zeros(steps + 1)
        self.heat, self.spread_heat = np.zeros((2, steps, len(theory.q)))
        self.rubber_flux, self.road_flux = np.zeros((2, steps))  # W/m2 of the contact into rubber and road
        self.n = 0
        self.T = np.full(len(theory.q), T0)
        self.surface = None if spots.road is None else T0

    def friction(self, v: float) -> float:
        """Friction coefficient at the current temperatures; v >= 0."""
        return float(self.evaluate_theory(v).mu)

    def evaluate_theory(self, v: float) -> TheoryResult:
        """Contact and friction at the current temperatures; v >= 0."""
        return self.theory(max(v, MIN_SLIDING_SPEED_M_S), self.T, self.p, self.surface)

    def step(self, dt: float, v: float) -> None:
        """Advance by dt (s) at speed v >= 0 (m/s), which may vary between steps; v = 0 releases no heat."""
        n, start = self.n, self.evaluate_theory(v)
        phi = self.spots.contact_fraction(self.theory, max(v, MIN_SLIDING_SPEED_M_S), self.T0, self.p)
        self.time[n + 1], self.slid[n + 1] = self.time[n] + dt, self.slid[n] + v * dt
        temperatures = _MemoryWeights(self, n + 1)
        first = self.heat[n] = viscoelastic_heat(start, phi, v, self.p)
        released = at_first = self.p * v / phi * float(start.adhesive)
        for last in (False, True):
            self.spread_heat[n] = self.heat_memory.spread_heat(self.heat[n])
            self.T, self.surface = temperatures(released)
            if not last:  # corrector: the heat of the step becomes the mean of both ends
                end = self.evaluate_theory(v)
                self.heat[n] = 0.5 * (first + viscoelastic_heat(end, phi, v, self.p))
                released = 0.5 * (at_first + self.p * v / phi * float(end.adhesive))
        self.n = n + 1


class _MemoryWeights:
    """Weights of the heat history at step n for the temperatures of all wavenumbers and of the surface."""

    def __init__(self, slide: SlidingHistory, n: int) -> None:
        self.slide, self.n = slide, n
        mid = 0.5 * (slide.slid[1 : n + 1] + slide.slid[:n])
        h = disc_overlap(np.abs(slide.slid[n] - mid) / slide.spots.diameter)
        self.first = int(np.argmax(h > 0)) if np.any(h > 0) else n
        ago = slide.time[n] - slide.time[: n + 1]
        ages, h = ago[self.first :], h[self.first :]
        self.off, self.on = (-np.diff(f, axis=0) * h[:, None] for f in slide.heat_memory.age_weights(ages))
        if slide.spots.road is not None:
            self.surface_weights = slide.heat_memory.surface_weights(self.off)
            self.rubber_flux_weights = (
                -np.diff(np.sqrt(ages)) * h * 2.0 / (np.sqrt(np.pi) * slide.heat_memory.effusivity)
            )
            self.road_flux_weights = -np.diff(slide.spots.road.mean_rise(ago, slide.spots.diameter))

    def __call__(self, released: float) -> tuple[np.ndarray, float | None]:
        """T_q (n_q,) and temperature of the surface, K, with `released` W/m2 in the contact in the last step."""
        s, past, to = self.slide, slice(self.first, self.n), self.n - 1
        T = s.T0 + s.heat_memory.temperature_rise(self.off, self.on, s.heat[past], s.spread_heat[past])
        if s.spots.road is None:
            return T, None
        if len(self.rubber_flux_weights) == 0:  # rubber that has just entered the spot
            return T, s.T0
        s.rubber_flux[to] = released
        s.road_flux[to] = 0.0
        top = float(np.sum(self.surface_weights * s.heat[past]) + self.rubber_flux_weights @ s.rubber_flux[past])
        taken = s.spots.road.road_flux(
            top,
            float(self.road_flux_weights @ s.road_flux[: self.n]),
            self.rubber_flux_weights[-1],
            self.road_flux_weights[-1],
        )
        s.road_flux[to], s.rubber_flux[to] = taken, released - taken
        return T + s.rubber_flux[past] @ self.surface_weights, s.T0 + top - self.rubber_flux_weights[-1] * taken


def _slide_towards_hot(
    theory: PerssonTheory, rubber: Material, spots: ContactSpots, v: float, T0: float, p: float, steps: int
) -> Iterator[SlidingHistory]:
    """Slide at constant speed v (m/s) over `HOT_SLIDING_DIAMETERS`; yields before the first and after every step."""
    slid = HOT_SLIDING_DIAMETERS * spots.diameter * (np.arange(steps + 1) / steps) ** 2
    slide = SlidingHistory(theory, rubber, spots, T0, p, steps)
    yield slide
    for dr in np.diff(slid):
        slide.step(dr / v, v)
        yield slide


def compute_heating_path(
    theory: PerssonTheory, rubber: Material, spots: ContactSpots, v: float, T0: float, p: float, steps: int = 120
) -> HeatingPath:
    """Path from the cold towards the hot branch at constant speed v (m/s), over `HOT_SLIDING_DIAMETERS`."""
    rows = [(s.friction(v), s.T.max()) for s in _slide_towards_hot(theory, rubber, spots, v, T0, p, steps)]
    slid = HOT_SLIDING_DIAMETERS * spots.diameter * (np.arange(steps + 1) / steps) ** 2
    return HeatingPath(slid / v, slid, np.full(steps + 1, v), *np.array(rows).T)
