"""Conduction through the air in the gap around the spots: heat loss of the rubber towards a road at air temperature.

    h = 1/(u/k_air + r),    r = (4/3) sqrt(t/pi)/e_S

u is the mean height of the gap.  r is the mean temperature rise of the road per unit of a uniform flux, while it passes
under the block in t = L/v; the road enters at ambient temperature.  The law warms the road only in this resistance:
the energy audit books the heat as a loss to the air, and the cells of the road between the lanes stay as they are.

>>> from types import SimpleNamespace as N
>>> from flashtemp.physics.material import LIBRARY
>>> p = N(conductivity=0.026, height=5e-4)
>>> [patch] = GapConduction().heat(N(length=0.025, road=LIBRARY["asphalt"]), p)
>>> now = N(touching=True, spot_fraction=0.2, ambient=20.0, last_speed=0.1, contact_time=9.0, waited=0.0)
>>> round(float(patch.law(30.0, now, p)), 2)
-410.57
"""

from __future__ import annotations

import numpy as np

from flashtemp.physics.effect import Effect, Heat, Param


class GapConduction(Effect):
    """Loss (1 - phi) h (T - T_air) of the block's face outside the spots, conducted through the air of the gap."""

    cause = "the block loses heat through the air between the spots"
    source = (
        "conduction through a layer of air, 0.026 W/mK at 20 degC; its height is one to two rms heights of the road "
        "(0.3 mm for asphalt), without slip above 10 um; up to twice as much above 1 m/s, where cool air is drawn in"
    )
    tells = ("block cooler all over its face, most where spots are sparse", "the road behind does not show it")
    candidate = True

    conductivity = Param(0.026, "W/mK", "heat conductivity of the air", low=0.0, high=1.0, off=0.0)
    height = Param(5e-4, "m", "mean height of the gap around the spots", low=1e-6, high=1e-2)

    def heat(self, scene, p):
        """Flux through the face while it touches the road."""

        def law(T, now, p):
            under = min(now.contact_time - now.waited, scene.length / max(now.last_speed, 1e-9)) + now.waited
            road = 4.0 / 3.0 * np.sqrt(under / np.pi) / scene.road.effusivity
            h = p.conductivity / (p.height + p.conductivity * road)
            return (1.0 - now.spot_fraction) * h * now.touching * (now.ambient - T)

        yield Heat.patch("block.face", law)
