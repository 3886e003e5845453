"""Heat spreads sideways out of the lane that a spot draws on the road.

>>> round(float(retained(0.25, 3e-3, 1 / (2300 * 950.0))), 6)
0.748848
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline

from flashtemp.physics.effect import Effect, Factor, Param
from flashtemp.physics.friction.heat_kernels import retained

FRACTION = 0.01  # distance between the contact fractions for which the retained heat is tabulated


@lru_cache(maxsize=128)
def _kept(node: int) -> CubicSpline:
    """K(u) = integral of max(R, phi) d(sqrt theta) over u = sqrt(theta), theta = D_S t/diameter^2, at nodes of phi.

    Two columns: at this node and at the next.
    """
    u = np.concatenate([[0.0], np.geomspace(1e-4, 30.0, 600)])
    nodes, weights = np.polynomial.legendre.leggauss(6)
    half, mid = 0.5 * np.diff(u), 0.5 * (u[1:] + u[:-1])
    parts = np.zeros((len(half), 2))
    for n, w in zip(nodes, weights, strict=True):
        R = retained((mid + half * n) ** 2, 1.0, 1.0)
        parts += w * np.maximum(R[:, None], FRACTION * np.array([node, node + 1.0]))
    return CubicSpline(u, np.concatenate([[[0.0, 0.0]], np.cumsum(parts * half[:, None], axis=0)]))


def mean_factor(entered, left, diameter, diffusivity, fraction):
    """Lane-mean rise over the 1D column, for heat received evenly from `entered` to `left` s ago, V23."""
    scale = np.sqrt(diffusivity) / diameter
    a = np.minimum(np.sqrt(np.maximum(left, 0.0)) * scale, 29.0)
    b = np.minimum(np.sqrt(np.maximum(entered, 1e-12)) * scale, 30.0)
    place = fraction / FRACTION
    below = int(np.real(place) + 1e-9)  # linear between nodes: a fraction that moves does not jump
    K = _kept(below)
    late, early = K(np.array([b, a]))
    apart = (b - a > 1e-6)[..., None]
    mean = np.where(apart, (late - early) / np.where(apart, (b - a)[..., None], 1.0), late)
    if not apart.all():
        mean = np.where(apart, mean, K(b, 1))
    return (below + 1 - place) * mean[..., 0] + (place - below) * mean[..., 1]


class Lanes(Effect):
    """Lane-mean temperature rise falls below that of a 1D column as the lane widens (V23)."""

    cause = "lanes on the road widen by conduction sideways"
    source = "theory 1.6 eq. (15b) and V23; a lane never falls below the mean of the road"
    tells = ("road cooler, most at low speed and small spots",)
    section = "contact"
    base = True

    lane_widening = Param(1.0, "1", "strength of the widening of the lanes", low=0.0, high=1.0, off=0.0)

    def heat(self, scene, p):
        """Factor f(x) on the rise of the lanes above the entering road."""
        D, material, L = scene.spot_diameter, scene.road, scene.length

        def law(T, now, p):
            phi = now.covered
            if np.real(phi) >= 1.0:
                return 1.0
            slid_for = now.contact_time - now.waited
            x = np.maximum(now.x, 0.0)
            entered = now.history.ago(slid_for, x)
            left = now.history.ago(slid_for, np.maximum(x - L, 0.0))
            rest = 0.0 if now.touching else now.waited
            f = mean_factor(entered + now.waited, left + rest, D, material.diffusivity, phi)
            return 1.0 - p.lane_widening * (1.0 - f)

        yield Factor("road.lane_rise", law)
