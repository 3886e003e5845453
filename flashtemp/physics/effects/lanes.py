"""Heat spreads sideways out of a lane, the heated track of a spot on the road.

A lane of discs shifted sideways by a distance r overlaps itself by the fraction h(r/diameter).  With isotropic
conduction, heat that has reached the depth r has also moved r sideways.  The surface temperature rise of the lane is
therefore the integral of the slope of its column's rise T, weighted with that fraction (theory.md, section 1.6):

    T_lane = -int_0^inf c(r) dT/dr dr,       c(r) = max(h(r/diameter), phi)

for any history of the flux into the road.

>>> from types import SimpleNamespace as N
>>> [factor] = Lanes().heat(N(spot_diameter=3e-3), None)
>>> share = factor.law(None, N(covered=0.2), N(lane_widening=1.0), np.array([0.0, 1e-3, 1.0]))
>>> np.round(share, 4).tolist()
[1.0, 0.5836, 0.2]
"""

from __future__ import annotations

import numpy as np

from flashtemp.physics.effect import Effect, Factor, Param
from flashtemp.physics.friction.heat_kernels import disc_overlap


class Lanes(Effect):
    """The mean temperature rise of a lane falls below that of a 1D column as the lane widens (eq. (15b), V23)."""

    cause = "lanes on the road widen by conduction sideways"
    source = "theory 1.6 eq. (15b) and V23 for any flux; a lane never falls below the mean of the road"
    tells = ("road cooler, most at low speed and small spots",)
    section = "contact"
    base = True

    lane_widening = Param(1.0, "1", "strength of the widening of the lanes", low=0.0, high=1.0, off=0.0)

    def heat(self, scene, p):
        """Overlap of a lane with itself after a sideways shift by a distance."""
        D = scene.spot_diameter

        def law(T, now, p, apart):
            lost = 1.0 - np.maximum(disc_overlap(np.asarray(apart) / D), now.covered)
            return 1.0 - p.lane_widening * np.where(np.asarray(apart) > 0.0, lost, 0.0)

        yield Factor("road.lane_overlap", law)
