"""Convection to the air: walls of the block, free road, and the face of a lifted block.

>>> from types import SimpleNamespace as N
>>> films = list(Convection().heat(N(resolved=False), None))
>>> films[0].law(N(touching=True), N(convection=10.0))
10.0
"""

from __future__ import annotations

from flashtemp.physics.effect import Effect, Heat, Param


class Convection(Effect):
    """Newton cooling h (T_air - T) on every surface in contact with air."""

    cause = "surfaces lose heat to the air"
    source = "theory 1.3: natural, slow forced convection and radiation together 5-20 W/m2K"
    tells = ("slow: time constant of 1000 s and more",)
    section = "ambient"
    base = True

    convection = Param(
        10.0, "W/m2K", "heat-transfer coefficient to the air; in 2D (numerics.across = 1) not of the side walls",
        low=0.0, high=1e4, off=0.0,
    )  # fmt: skip
    road_sides = Param(
        0.0, "W/m2K", "heat-transfer coefficient of the sides of a road no wider than the block",
        low=0.0, high=1e4, off=0.0,
    )  # fmt: skip

    def heat(self, scene, p):
        """Convection on walls, free road and, while lifted, both faces; in 2D without the side walls."""
        walls = ("block.leading", "block.trailing", "road.free")
        for site in (*walls, "block.sides") if scene.resolved else walls:
            yield Heat.film(site, lambda now, p: p.convection)
        yield Heat.film("road.sides", lambda now, p: p.road_sides)
        for site in ("block.face", "road.under"):
            yield Heat.film(site, lambda now, p: 0.0 if now.touching else p.convection)
