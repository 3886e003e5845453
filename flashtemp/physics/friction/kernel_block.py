"""A block on a road by memory kernels alone (Level K): the independent check of the finite volumes.

Every point of the block's face remembers what it received, every point of the road what it received since it came
under the block, and a spot what it received while it lay over the same rubber (theory 1.6 eqs. (14), (15)).  Rubber and
road are half-spaces without conduction along x; heat is released in the contact, which conducts perfectly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from flashtemp.errors import SolverFailure
from flashtemp.physics.arrays import Value
from flashtemp.physics.friction.heat_kernels import ROOT_PI, overlap_integral, retained_fraction
from flashtemp.physics.material import Material


class KernelTemperatures(NamedTuple):
    """At times (n,) s and places (m,) m from the leading edge: temperatures (n, m) K, friction coefficient (n, m)."""

    time: np.ndarray
    x: np.ndarray
    spot: np.ndarray
    face: np.ndarray
    mu: np.ndarray


@dataclass(frozen=True)
class KernelBlock:
    """A block of `length` m at constant speed (m/s) and uniform nominal pressure (Pa) from `ambient` K.

    Spots of `diameter` m cover `fraction`; lanes on the road widen unless `widening` is False.
    """

    rubber: Material
    road: Material
    length: float
    speed: float
    pressure: float
    fraction: float
    diameter: float
    ambient: float
    widening: bool = True

    def lane_fraction(self, tau: Value) -> Value:
        """Share of the heat that is still under a spot, eq. (15b), never below the contact fraction."""
        if not self.widening:
            return np.ones_like(tau)
        return np.maximum(retained_fraction(tau, self.diameter, self.road.diffusivity), self.fraction)

    def graded_places(self, count: int) -> np.ndarray:
        """Places (count,) m, denser at the leading edge; the last one is the trailing edge."""
        return self.length * (np.arange(1, count + 1) / count) ** 2

    def road_weights(self, x: np.ndarray) -> np.ndarray:
        """(m, m) K m2/W: rise of the road at x by fluxes linear between 0 (as at the first place) and the places."""
        nodes, weights = np.polynomial.legendre.leggauss(12)
        edges = np.concatenate([[0.0], x])
        out = np.zeros((len(x), len(x)))
        for i, at in enumerate(x):
            for j in range(i + 1):
                # age = (at - x')/v, and its root as the variable takes the singularity away
                a, b = np.sqrt((at - edges[j + 1]) / self.speed), np.sqrt((at - edges[j]) / self.speed)
                root = 0.5 * (a + b) + 0.5 * (b - a) * nodes
                part = (b - a) * weights * self.lane_fraction(root**2) / (self.road.effusivity * ROOT_PI)
                share = (at - self.speed * root**2 - edges[j]) / (edges[j + 1] - edges[j])
                out[i, j] += np.sum(part * share)
                out[i, max(j - 1, 0)] += np.sum(part * (1.0 - share))
        return out

    def march(
        self, duration: float, friction: Callable[..., Value], times: int = 80, places: int = 60
    ) -> KernelTemperatures:
        """Slide for `duration` s with friction(T_spot, T_face) (m,); times denser at the start.

        The road is taken as settled: it passes in L/v, in which the block hardly changes; the first L/v is no result.
        Raises SolverFailure where friction and temperature do not agree.
        """
        t, x = duration * (np.arange(times + 1) / times) ** 2, self.graded_places(places)
        heat = self.pressure * self.speed / self.fraction
        into = np.zeros((times + 1, places))  # J into the rubber per spot area
        W, cold = self.road_weights(x), np.full(places, self.ambient)
        rows = [(cold, cold, friction(cold, cold))]
        for n in range(1, times + 1):
            memory = self._history_weights(t[: n + 1])
            past = memory[:-1] @ into[:n]
            resistance = memory[-1] + self.flash_resistance(t[n])
            mu = rows[-1][2]
            for _ in range(100):
                q = heat * mu
                # T_face + R_flash J = W (q - J): one triangular system for J
                into[n] = np.linalg.solve(W + np.eye(places) * resistance, W @ q - past)
                face = self.ambient + past + memory[-1] * into[n]
                spot = face + self.flash_resistance(t[n]) * into[n]
                new = friction(spot, face)
                change = np.max(np.abs(new - mu))
                mu = new
                if change < 1e-10:
                    break
            else:
                raise SolverFailure(f"friction and temperature do not agree after {t[n]:.3g} s")
            rows.append((spot, face, mu))
        return KernelTemperatures(t, x, *(np.array(part) for part in zip(*rows, strict=True)))

    def flash_resistance(self, t: float) -> float:
        """Resistance (m2 K/W) of the excess in a spot over the face, built up over the distance slid: V10, V11."""
        theta = overlap_integral(self.speed * t / self.diameter) / ROOT_PI
        found: float = (1 - self.fraction) * theta * np.sqrt(self.diameter / self.speed) / self.rubber.effusivity
        return found

    def _history_weights(self, t: np.ndarray) -> np.ndarray:
        """Weights (n + 1,) K m2/W at t[-1] of fluxes per spot area, linear in time between the moments t."""
        ago = t[-1] - t
        a, b = ago[:-1], ago[1:]
        whole = 2.0 * (np.sqrt(a) - np.sqrt(b))
        first = 2.0 / 3.0 * (a**1.5 - b**1.5)
        early = (first - b * whole) / (a - b)
        weights = np.zeros(len(t))
        weights[:-1] += early
        weights[1:] += whole - early
        found: np.ndarray = self.fraction * weights / (ROOT_PI * self.rubber.effusivity)
        return found
