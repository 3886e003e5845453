"""A block on a road by memory kernels alone (Level K): an independent check of the finite volumes.

The temperature of every point of the block's face follows from its flux history.  That of the road follows from its
history since it entered under the block, and that of a spot from its time over the same rubber (theory.md, eqs. (14)
and (15)).  Rubber and road are half-spaces without conduction along x.  Heat is released in the contact, which has no
thermal resistance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from reference.analytical_solutions import (
    ROOT_PI,
    SPOT_OVERLAP_INTEGRAL,
    HalfSpace,
    Value,
    flash_build_up,
    lane_retained,
)


class KernelTemperatures(NamedTuple):
    """At times (n,) s and positions (m,) m from the leading edge: temperatures (n, m) K and friction (n, m)."""

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

    rubber: HalfSpace
    road: HalfSpace
    length: float
    speed: float
    pressure: float
    fraction: float
    diameter: float
    ambient: float
    widening: bool = True

    def lane_fraction(self, tau: Value) -> Value:
        """Fraction of the heat that is still under a spot, eq. (15b), at least the contact fraction."""
        if not self.widening:
            return np.ones_like(tau)
        return np.maximum(lane_retained(self.road.diffusivity, self.diameter, tau), self.fraction)

    def graded_places(self, count: int) -> np.ndarray:
        """Positions (count,) m, denser at the leading edge; the last one is the trailing edge."""
        return self.length * (np.arange(1, count + 1) / count) ** 2

    def road_weights(self, x: np.ndarray) -> np.ndarray:
        """(m, m) K m2/W: temperature rise of the road at x by fluxes linear between the positions, constant before."""
        nodes, weights = np.polynomial.legendre.leggauss(12)
        edges = np.concatenate([[0.0], x])
        out = np.zeros((len(x), len(x)))
        for i, at in enumerate(x):
            for j in range(i + 1):
                # age = (at - x')/v; integration over its square root removes the singularity
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

        The road is quasi-steady, because it passes in L/v, during which the block hardly changes; results for t < L/v
        are not valid.  Raises RuntimeError where friction and temperature do not converge.
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
                raise RuntimeError(f"friction and temperature do not agree after {t[n]:.3g} s")
            rows.append((spot, face, mu))
        return KernelTemperatures(t, x, *(np.array(part) for part in zip(*rows, strict=True)))

    def flash_resistance(self, t: float) -> float:
        """Flash resistance (m2 K/W): temperature excess in a spot over flux, growing with slid distance (V10, V11)."""
        theta = SPOT_OVERLAP_INTEGRAL * flash_build_up(self.speed * t / self.diameter) / ROOT_PI
        resistance: float = (1 - self.fraction) * theta * np.sqrt(self.diameter / self.speed) / self.rubber.effusivity
        return resistance

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
        scaled: np.ndarray = self.fraction * weights / (ROOT_PI * self.rubber.effusivity)
        return scaled
