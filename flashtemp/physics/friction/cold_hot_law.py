"""The cold-hot law: friction that forgets its cold value over a slid distance r0, a fifth of a spot's diameter.

    mu(v, r) = mu_cold(v) exp(-r/r0) + mu_hot(v) (1 - exp(-r/r0))

with r slid since the rubber came into contact; law (2) of the source, theory 2.8.

>>> import numpy as np
>>> cold, hot = (Branch(np.array([0.1, 10.0]), np.array(mu), np.zeros(2), np.zeros(2)) for mu in ([1, 2], [0.5, 0.5]))
>>> law = Law(cold, hot, 2e-3)
>>> print(f"{law(1.0, 0.0):.3f} {law(1.0, 2e-3):.3f} {law(1.0, 1.0):.3f}")
1.500 0.868 0.500
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from flashtemp.physics.arrays import Value
from flashtemp.physics.friction.flash_temperature import Branch, Spots, branches, heating
from flashtemp.physics.friction.persson import Theory
from flashtemp.physics.material import Material

MEMORY = 0.2  # r0 over the diameter of a spot
SLOWEST = 1e-5  # m/s: friction of what hardly moves
PER_DECADE = 12  # speeds at which the branches are computed


@dataclass(frozen=True, eq=False)
class Law:
    """Cold and hot branch and the distance `r0` (m) between them; linear in ln v, held beyond their speeds."""

    cold: Branch
    hot: Branch
    r0: float

    @cached_property
    def _curves(self) -> Any:
        return [(np.log(b.speed), np.asarray(b.mu, dtype=float)) for b in (self.cold, self.hot)]

    def ends(self, v: Value) -> Value:
        """mu_cold and mu_hot at speeds v >= 0 (m/s)."""
        x = np.log(np.maximum(v, self.cold.speed[0]))
        return tuple(np.interp(x, at, mu) for at, mu in self._curves)

    def __call__(self, v: Value, r: Value) -> Value:
        """mu at speeds v >= 0 (m/s), r (m) after coming into contact; both broadcast."""
        cold, hot = self.ends(v)
        return hot + (cold - hot) * np.exp(-np.asarray(r) / self.r0)

    def alike(self, which: str) -> Law:
        """The control without memory: both branches "cold", or both "hot"."""
        branch = getattr(self, which)
        return replace(self, cold=branch, hot=branch)


def law(
    theory: Theory, rubber: Material, spots: Spots, T0: float, p: float, fastest: float, memory: float = MEMORY
) -> Law:
    """The law of a theory at background T0 (K), pressure p (Pa), speeds up to `fastest` (m/s); r0 = memory x diameter.

    They reach at least a decade above the slowest.  Raises SolverFailure where the hot branch cannot be found.
    """
    fastest = max(fastest, 10.0 * SLOWEST)
    count = round(PER_DECADE * np.log10(fastest / SLOWEST)) + 1
    cold, hot = branches(theory, rubber, spots, np.geomspace(SLOWEST, fastest, count), T0, p)
    return Law(cold, hot, memory * spots.diameter)


class Fit(NamedTuple):
    """At speeds (n,) m/s: `memory` r0 over the spot's diameter that fits the kernel theory best, and the largest
    relative `deviation` of the law with r0 = 0.2 diameters from it."""

    speed: np.ndarray
    memory: np.ndarray
    deviation: np.ndarray


def fit(theory: Theory, rubber: Material, spots: Spots, speeds: Value, T0: float, p: float) -> Fit:
    """How well the law stands for the kernel theory at constant speeds (m/s), background T0 (K) and pressure p (Pa).

    The history is `hot.heating` over two diameters; least squares, every stretch of it weighing by its length (C25).
    """
    speeds = np.asarray(speeds, dtype=float)
    cold, hot = branches(theory, rubber, spots, speeds, T0, p)
    rows = []
    for v, first, last in zip(speeds, cold.mu, hot.mu, strict=True):
        way = heating(theory, rubber, spots, v, T0, p)
        r = way.slid / spots.diameter

        def law(memory: float, r: Value = r, first: Value = first, last: Value = last) -> Value:
            return last + (first - last) * np.exp(-r / memory)

        def miss(memory: float, mu: Value = way.mu, r: Value = r, law: Value = law) -> Value:
            return np.sum(np.gradient(r) * (law(memory) - mu) ** 2)

        best = minimize_scalar(miss, bounds=(0.01, 1.0), method="bounded")
        rows.append((best.x, np.max(np.abs(law(MEMORY) / way.mu - 1.0))))
    return Fit(speeds, *np.array(rows).T)
