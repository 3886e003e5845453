"""Heat flow into the road under a spot by memory kernels, including heat released at the contact itself.

A spot belongs to a road asperity.  Rubber leaves it after D/v, but the stone stays in contact: the temperature of the
road depends on its whole flux history since it came under the rubber, without the disc overlap h(w) that limits the
history of the rubber.  The mean contact temperatures of both sides agree,

    T_0 + int h(w) [int Q' 2q' erfcx(2q' sqrt(D tau))/(rho c) dq' + (q_a - J)/(e_R sqrt(pi tau))] dtau
        = T_0 + int R(tau) J/(e_S sqrt(pi tau)) dtau + J/alpha

with J into the road and R the fraction of heat that remains under a disc (theory.md, eqs. (11), (14), (15), (15b)).

>>> from flashtemp.physics.material import LIBRARY
>>> stone = RoadSide(LIBRARY["asphalt"])
>>> print(f"{1e6 * stone.mean_rise(0.25, 3e-3):.2f} {1e6 * stone.mean_rise(0.25, 1.0):.2f} K m2/MW")
333.43 381.53 K m2/MW
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.interpolate import CubicSpline

from flashtemp.physics.arrays import Value
from flashtemp.physics.friction.heat_kernels import ROOT_PI, retained_fraction
from flashtemp.physics.material import Material

LOG10_AGE_RANGE = (-12.0, 8.0)  # log10 of D tau over the square of the diameter


@cache
def _disc_rise_spline() -> CubicSpline:
    """int_0^u R du/(2 sqrt u) over sqrt u, against log10 u: u the age over diameter^2/diffusivity."""
    logs = np.linspace(*LOG10_AGE_RANGE, 801)
    edges = np.concatenate([[0.0], 10.0 ** (0.5 * logs)])  # sqrt u
    nodes, weights = np.polynomial.legendre.leggauss(8)
    half = 0.5 * np.diff(edges)[:, None]
    s = 0.5 * (edges[1:] + edges[:-1])[:, None] + half * nodes
    kept = np.cumsum(np.sum(half * weights * retained_fraction(s * s, 1.0, 1.0), axis=1))
    return CubicSpline(logs, kept / edges[1:])


@dataclass(frozen=True)
class RoadSide:
    """A road as a half-space of a `material` with the contact conductance `alpha` (W/m2K)."""

    material: Material
    alpha: float = np.inf

    def mean_rise(self, age: Value, diameter: float) -> Value:
        """Mean temperature rise of a spot per W/m2 of a constant flux (K m2/W) after `age` (s >= 0), by eq. (15b)."""
        age = np.asarray(age, dtype=float)
        u = self.material.diffusivity * age / diameter**2
        at = np.log10(np.clip(u, 10.0 ** LOG10_AGE_RANGE[0], 10.0 ** LOG10_AGE_RANGE[1]))
        root = np.sqrt(np.minimum(age, 10.0 ** LOG10_AGE_RANGE[1] * diameter**2 / self.material.diffusivity))
        return 2.0 * root * _disc_rise_spline()(at) / (ROOT_PI * self.material.effusivity)

    def road_flux(
        self, rubber_surface: Value, road_surface: Value, rubber_resistance: Value, road_resistance: Value
    ) -> Value:
        """Flux (W/m2) into the road at which the temperatures of both sides agree.

        `rubber_surface` and `road_surface` (K) are the surface temperatures without this flux, `rubber_resistance` and
        `road_resistance` (K m2/W) their changes per unit flux.
        """
        return (rubber_surface - road_surface) / (rubber_resistance + road_resistance + 1.0 / self.alpha)
