"""Forced convection on the walls of the block that grows with speed: h = gain v^n.

>>> from types import SimpleNamespace as N
>>> films = list(SideCooling().heat(None, None))
>>> films[0].law(N(speed=0.25), N(gain=10.0, exponent=0.5))
5.0
"""

from __future__ import annotations

from flashtemp.physics.effect import Effect, Heat, Param


class SideCooling(Effect):
    """Forced convection in addition to `convection`; in 2D the two side walls act as a fin over the width."""

    cause = "the block's walls lose heat to the air stream"
    source = "flat plate, Nu ~ Re^0.8 where turbulent, Re^0.5 where laminar (Re < 5e5 on a smooth one)"
    tells = ("grows with speed", "covers the whole wall", "nothing at rest")
    candidate = True

    gain = Param(20.0, "W/m2K", "heat-transfer coefficient at 1 m/s", low=0.0, high=500.0, off=0.0)
    exponent = Param(0.8, "1", "exponent n of the speed", low=0.0, high=1.5, open_low=True, spread=1.3)

    def heat(self, scene, p):
        """Heat transfer on the leading, trailing and side walls."""

        def film(now, p):
            return p.gain * now.speed**p.exponent

        for site in ("block.leading", "block.trailing", "block.sides"):
            yield Heat.film(site, film)
