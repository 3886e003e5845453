"""Flash temperature: rubber passing through a spot is heated above its time average.

>>> round(deep_share(1e5), 4), round(deep_share(0.1), 4)
(1.0, 0.0583)
"""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.special import erfcx

from flashtemp.effect import Effect, Param, Term
from flashtemp.friction.kernel import FULL, overlap, overlap_integral


@cache
def _deep() -> CubicSpline:
    """Theta_v/Theta_s over log10 kappa."""
    nodes, weights = np.polynomial.legendre.leggauss(120)
    s = 0.5 * (nodes + 1)  # w = s^2
    logs = np.linspace(-5.0, 5.0, 801)
    kappa = 10.0 ** logs[:, None]
    integral = 0.5 * np.sum(weights * 2 * s * overlap(s * s) * erfcx(kappa * s), axis=1)
    return CubicSpline(logs, kappa[:, 0] * integral * np.sqrt(np.pi) / FULL)


def deep_share(kappa: float) -> float:
    """Theta_v/Theta_s for a source decaying over depth d; kappa = sqrt(D t_spot)/d (eq. 13)."""
    return float(_deep()(np.log10(min(max(kappa, 1e-5), 1e5))))


class Flash(Effect):
    """Excess of the temperature in a spot over the passage average, closure eqs. (12)-(13)."""

    cause = "heat concentrated in spots raises the temperature there above the average"
    source = "theory 1.4 eqs. (12)-(13), V10, V11; early transient F(r/D)"
    tells = ("gap between spot and average temperature, growing as sqrt(v)",)
    section = "contact"
    base = True

    flash_factor = Param(1.0, "1", "calibration factor of the flash closure", low=0.0, high=3.0, off=0.0)

    def heat(self, scene, p):
        """Flash resistance (m2 K/W) of the surface flux and of every deposit."""
        D = scene.spot_diameter
        rubber = scene.block
        cap = np.pi * D / (8 * rubber.conductivity)  # a resting spot: constriction of a disc

        def residence(now):
            if now.waited > 0 or now.speed <= 0:
                passed = D / now.last_speed if now.last_speed > 0 else 0.0
                return min(now.contact_time, passed) + now.waited, 1.0
            return D / now.speed, overlap_integral(now.slid / D) / FULL

        def surface(T, now, p):
            if np.min(np.real(now.spot_fraction)) >= 1.0:
                return 0.0
            time, built = residence(now)
            theta = FULL / np.sqrt(np.pi) * np.sqrt(time) * built / rubber.effusivity
            return p.flash_factor * (1.0 - now.spot_fraction) * min(theta, cap)

        def deep(T, now, p, depth):
            time, _ = residence(now)
            return deep_share(float(np.sqrt(rubber.diffusivity * time)) / depth)

        yield Term("contact.flash_resistance", surface)
        yield Term("contact.flash_share", deep)
