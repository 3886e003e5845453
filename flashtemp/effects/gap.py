"""Between the spots the rubber may lose heat across the gap.

>>> from types import SimpleNamespace as N
>>> [film] = Gap().heat(None, None)
>>> film.law(N(touching=True, covered=0.2), N(gap_coefficient=10.0))
8.0
"""

from __future__ import annotations

from flashtemp.effect import Effect, Heat, Param


class Gap(Effect):
    """Loss (1 - phi) h_gap (T - T_air) of the block's face outside the spots, eq. (9)."""

    cause = "heat crosses the gap between the spots"
    source = "theory 1.3, h_gap 0-10 W/m2K"
    tells = ("grows where spots are sparse",)
    section = "contact"
    base = True

    gap_coefficient = Param(0.0, "W/m2K", "heat-transfer coefficient of the gap", low=0.0, high=1e4, off=0.0)

    def heat(self, scene, p):
        """Film on the face while it touches the road."""

        def law(now, p):
            return (1.0 - now.covered) * p.gap_coefficient if now.touching else 0.0

        yield Heat.film("block.face", law)
