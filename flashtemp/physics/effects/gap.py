"""Convection in the gap between the spots: heat loss of the rubber by a heat-transfer coefficient.

>>> from types import SimpleNamespace as N
>>> [patch] = GapConvection().heat(None, N(gap_coefficient=10.0))
>>> patch.law(30.0, N(touching=True, spot_fraction=0.2, ambient=20.0), N(gap_coefficient=10.0))
-80.0
"""

from __future__ import annotations

from flashtemp.physics.effect import Effect, Heat, Param


class GapConvection(Effect):
    """Loss (1 - phi) h_gap (T - T_air) of the block's face outside the spots; theory.md, eq. (9)."""

    cause = "heat crosses the gap between the spots"
    source = "theory 1.3, h_gap 0-10 W/m2K"
    tells = ("grows where spots are sparse",)
    section = "contact"
    base = True

    gap_coefficient = Param(0.0, "W/m2K", "heat-transfer coefficient of the gap", low=0.0, high=1e4, off=0.0)

    def heat(self, scene, p):
        """Flux through the face while it touches the road."""

        def law(T, now, p):
            return (1.0 - now.spot_fraction) * p.gap_coefficient * now.touching * (now.ambient - T)

        if p.gap_coefficient > 0:
            yield Heat.patch("block.face", law)
