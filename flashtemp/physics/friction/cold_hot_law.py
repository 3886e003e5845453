"""The cold-hot law: friction changes from its cold to its hot value over a slid distance r0.

    mu(v, r) = mu_cold(v) exp(-r/r0) + mu_hot(v) (1 - exp(-r/r0))

with r the distance slid since the rubber came into contact; law (2) of the source, theory.md, eq. (20).  A fit to the
kernel theory with spots of diameter D gives

    r0/D = 0.192 e^(1.51 s) (mu_hot/mu_cold)^0.95,    s = e_S/(e_R + e_S), or 0 without heat flow into the road

The flash temperature itself builds up over 0.17 D.  Friction that falls with temperature produces less heat, so the
hot branch is reached earlier; a road that warms under the spot delays it.  Speed, diameter, diffusivity and the
temperature dependence of the rubber act through mu_hot/mu_cold; in addition to it, the Peclet number v D/D_R has an
exponent of only -0.002 (friction.md, eq. (20b)).

>>> import numpy as np
>>> v, zero = np.array([0.1, 10.0]), np.zeros(2)
>>> cold, hot = (FrictionBranch(v, np.array(mu), zero, zero) for mu in ([1, 2], [0.5, 0.5]))
>>> law = ColdHotLaw(cold, hot, 2e-3)
>>> print(f"{law(1.0, 0.0):.3f} {law(1.0, 2e-3):.3f} {law(1.0, 1.0):.3f}")
1.500 0.868 0.500
>>> print(memory_ratio(np.array([1.0, 0.5]), 0.5).round(4), memory_ratio(1.0, 0.5, 0.674).round(4))
[0.0994 0.192 ] 0.275
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar

from flashtemp.physics.arrays import Value
from flashtemp.physics.friction.flash_temperature import (
    ContactSpots,
    FrictionBranch,
    compute_branches,
    compute_heating_path,
)
from flashtemp.physics.friction.persson import PerssonTheory, TheoryResult
from flashtemp.physics.material import Material

MEMORY_FIT = (0.192, 1.51, 0.95)  # prefactor, coefficient of the road's heat fraction, exponent of mu_hot/mu_cold
COLD_OVER_HOT_RANGE = (0.82, 3.32)  # range of mu_cold/mu_hot in which the fit is valid
PUBLISHED_MEMORY_RATIO = 0.2  # r0/D of the source
MIN_LAW_SPEED_M_S = 1e-5  # lowest speed of the branches; friction below is that at this speed
SPEEDS_PER_DECADE, ROAD_SPEED_STRIDE = 12, 3  # speeds of the branches; with a road only every third is computed


def memory_ratio(cold: Value, hot: Value, road_heat_fraction: float = 0.0) -> np.ndarray:
    """Ratio r0/D (n,) for cold and hot friction (n,) and the heat fraction of the road, e_S/(e_R + e_S)."""
    prefactor, road, exponent = MEMORY_FIT
    ratio: np.ndarray = (
        prefactor
        * np.exp(road * road_heat_fraction)
        * np.clip(np.asarray(cold) / np.asarray(hot), *COLD_OVER_HOT_RANGE) ** -exponent
    )
    return ratio


def _interpolate_branches(
    hot: FrictionBranch, cold_result: TheoryResult, speeds: np.ndarray, T0: float
) -> tuple[FrictionBranch, FrictionBranch]:
    """Both branches at all speeds (n,) from a hot branch at some of them: the change by the flash is splined."""
    cold = FrictionBranch(speeds, cold_result.viscous, cold_result.adhesive, np.full(len(speeds), T0))
    x, at = np.log(speeds), np.log(hot.speed)

    def interpolate_change(values: np.ndarray, before: np.ndarray) -> np.ndarray:
        changed: np.ndarray = before + CubicSpline(at, values - np.interp(at, x, before))(x)
        return changed

    return cold, FrictionBranch(
        speeds, *(interpolate_change(getattr(hot, k), getattr(cold, k)) for k in ("viscous", "adhesive", "T"))
    )


@dataclass(frozen=True, eq=False)
class ColdHotLaw:
    """Cold and hot branch and the memory distance `r0` (m), a number or (n,) at the speeds of the branches.

    Linear in ln v between these speeds, constant beyond.
    """

    cold: FrictionBranch
    hot: FrictionBranch
    r0: float | np.ndarray

    @cached_property
    def _curves(self) -> Any:
        each = np.broadcast_to(self.r0, np.shape(self.cold.speed))
        return [np.log(self.cold.speed), *(np.asarray(c, dtype=float) for c in (self.cold.mu, self.hot.mu, each))]

    def _values_at_speed(self, v: Value) -> tuple[np.ndarray, ...]:
        """mu_cold, mu_hot and r0 (m) at speeds v >= 0 (m/s)."""
        logs, *curves = self._curves
        x = np.log(np.maximum(v, self.cold.speed[0]))
        return tuple(np.interp(x, logs, curve) for curve in curves)

    def branch_friction(self, v: Value) -> Value:
        """mu_cold and mu_hot at speeds v >= 0 (m/s)."""
        return self._values_at_speed(v)[:2]

    def memory_distance(self, v: Value) -> np.ndarray:
        """r0 (m) at speeds v >= 0 (m/s)."""
        r0: np.ndarray = self._values_at_speed(v)[2]
        return r0

    @property
    def memory_text(self) -> str:
        """r0 in mm as text: one number, or from the smallest to the largest."""
        ends = {f"{1e3 * r:.3g}" for r in (np.min(self.r0), np.max(self.r0))}
        return " to ".join(sorted(ends, key=float))

    def __call__(self, v: Value, r: Value) -> Value:
        """mu at speeds v >= 0 (m/s), r (m) after coming into contact; both broadcast."""
        cold, hot, r0 = self._values_at_speed(v)
        return hot + (cold - hot) * np.exp(-np.asarray(r) / r0)

    def without_memory(self, branch_name: str) -> ColdHotLaw:
        """The control without memory: both branches equal to the "cold" or to the "hot" one."""
        branch = getattr(self, branch_name)
        return replace(self, cold=branch, hot=branch)


def derive_law(
    theory: PerssonTheory,
    rubber: Material,
    spots: ContactSpots,
    T0: float,
    p: float,
    fastest: float,
    stated_ratio: float | None = None,
) -> ColdHotLaw:
    """The cold-hot law of a theory at background T0 (K), pressure p (Pa) and speeds up to `fastest` (m/s).

    r0 is `stated_ratio` times the diameter of a spot, by default from the fit.  The speeds cover at least one decade.
    Raises SolverFailure where the hot branch is not found.
    """
    fastest = max(fastest, 10.0 * MIN_LAW_SPEED_M_S)
    count = round(SPEEDS_PER_DECADE * np.log10(fastest / MIN_LAW_SPEED_M_S)) + 1
    speeds = np.geomspace(MIN_LAW_SPEED_M_S, fastest, count)
    sparse = (
        slice(None) if spots.road is None else np.unique(np.append(np.arange(0, count, ROAD_SPEED_STRIDE), count - 1))
    )
    cold, hot = compute_branches(theory, rubber, spots, speeds[sparse], T0, p)
    if spots.road is not None:
        cold, hot = _interpolate_branches(hot, theory(speeds, T0, p), speeds, T0)
    ratio = memory_ratio(cold.mu, hot.mu, spots.road_heat_fraction(rubber)) if stated_ratio is None else stated_ratio
    return ColdHotLaw(cold, hot, ratio * spots.diameter)


class ColdHotFit(NamedTuple):
    """At speeds (n,) m/s: `best` r0/D by comparison with the kernel theory, `memory` r0/D by the general fit.

    `deviation` is the largest relative deviation of the law with the fit from the kernel theory, `paper` that of the
    law with r0 = 0.2 D.
    """

    speed: np.ndarray
    best: np.ndarray
    memory: np.ndarray
    deviation: np.ndarray
    paper: np.ndarray


def compare_with_kernels(
    theory: PerssonTheory, rubber: Material, spots: ContactSpots, speeds: Value, T0: float, p: float
) -> ColdHotFit:
    """Compare the law with the kernel theory at constant speeds (m/s), background T0 (K) and pressure p (Pa); C25.

    The reference is `compute_heating_path` over two diameters; least squares weighted by slid distance.
    """
    speeds = np.asarray(speeds, dtype=float)
    cold, hot = compute_branches(theory, rubber, spots, speeds, T0, p)
    fitted = memory_ratio(cold.mu, hot.mu, spots.road_heat_fraction(rubber))
    rows = []
    for v, first, last, fit in zip(speeds, cold.mu, hot.mu, fitted, strict=True):
        path = compute_heating_path(theory, rubber, spots, v, T0, p)
        r = path.slid / spots.diameter

        def law(memory: float, r: Value = r, first: Value = first, last: Value = last) -> Value:
            return last + (first - last) * np.exp(-r / memory)

        def squared_error(memory: float, mu: Value = path.mu, r: Value = r, law: Value = law) -> Value:
            return np.sum(np.gradient(r) * (law(memory) - mu) ** 2)

        best = minimize_scalar(squared_error, bounds=(0.01, 1.0), method="bounded")
        deviations = (np.max(np.abs(law(m) / path.mu - 1.0)) for m in (fit, PUBLISHED_MEMORY_RATIO))
        rows.append((best.x, fit, *deviations))
    return ColdHotFit(speeds, *np.array(rows).T)
