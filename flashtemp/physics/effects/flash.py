"""Flash temperature: rubber in a spot is warmer than its average over the passage of spots.

>>> from types import SimpleNamespace as N
>>> from flashtemp.physics.material import LIBRARY
>>> p, now = N(flash_factor=1.0), N(waited=0.0, speed=0.1, slid=1.0, spot_fraction=0.2, contact_time=10.0)
>>> surface, deep = Flash().heat(N(spot_diameter=3e-3, block=LIBRARY["tread_rubber"]), p)
>>> round(float(surface.law(None, now, p)), 8), round(deep.law(None, now, p, 1e-4), 4)
(0.0001336, 0.2771)
"""

from __future__ import annotations

import numpy as np

from flashtemp.physics.effect import Effect, Param, Term
from flashtemp.physics.friction.heat_kernels import flash_response, overlap_integral


class Flash(Effect):
    """Excess of the temperature in a spot above the passage average; theory.md, eqs. (12) and (13)."""

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
        cap = np.pi * D / (8 * rubber.conductivity)  # limit of a resting spot: constriction resistance of a disc

        def residence_and_slip(now):  # time (s) a spot has been in place, and slid distance over its diameter
            if now.waited > 0 or now.speed <= 0:
                passed = D / now.last_speed if now.last_speed > 0 else np.inf
                return min(now.contact_time, passed) + now.waited, 1.0
            return D / now.speed, now.slid / D

        def flash_resistance(T, now, p):
            if np.min(np.real(now.spot_fraction)) >= 1.0:
                return 0.0
            time, slid = residence_and_slip(now)
            theta = overlap_integral(slid) / np.sqrt(np.pi) * np.sqrt(time) / rubber.effusivity
            return p.flash_factor * (1.0 - now.spot_fraction) * min(theta, cap)

        def depth_fraction(T, now, p, depth):
            time, slid = residence_and_slip(now)
            return float(flash_response(np.sqrt(rubber.diffusivity * time) / depth, slid))

        yield Term("contact.flash_resistance", flash_resistance)
        yield Term("contact.flash_share", depth_fraction)
