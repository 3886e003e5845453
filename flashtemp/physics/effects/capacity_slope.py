"""Heat capacity changes with temperature: c = c_0 [1 + slope (T - T_0)].

>>> from types import SimpleNamespace as N
>>> block, road = CapacitySlope().heat(N(layers=()), N(layer=None))
>>> block.law(None, None, N(block=0.003, road=0.0))
0.003
"""

from __future__ import annotations

from flashtemp.physics.effect import Effect, Param, Term, layer_param, require_layer


class CapacitySlope(Effect):
    """Linear volumetric heat capacity of rubber and road about the ambient temperature."""

    cause = "heat capacity changes with temperature"
    source = "rubber c rises by about 0.3 % per kelvin above its glass transition"
    tells = ("slower warming of the hot parts",)
    candidate = True

    block = Param(0.003, "1/K", "relative slope of the block's heat capacity", low=0.0, high=0.02, off=0.0)
    road = Param(0.0, "1/K", "relative slope of the road's heat capacity", low=0.0, high=0.02, off=0.0)

    layer = layer_param("`block` applies to it alone; to the whole block if not given")

    def heat(self, scene, p):
        """Slopes of the enthalpy's derivative."""
        where = require_layer(scene, p.layer, "capacity_slope.layer")
        yield Term(
            "block.capacity_gradient", lambda T, now, p: p.block if where is None else p.block * scene.in_layer(where)
        )
        yield Term("road.capacity_gradient", lambda T, now, p: p.road)
