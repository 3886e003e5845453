"""Thermal conductivity changes with temperature: k = k_0 [1 + slope (T - T_0)].

>>> from types import SimpleNamespace as N
>>> block, road = ConductivitySlope().heat(N(ambient=293.15, layers=()), N(layer=None))
>>> round(block.law(303.15, None, N(block=-0.002, road=0.0)), 6)
0.98
"""

from __future__ import annotations

from flashtemp.physics.effect import Effect, Factor, Param, layer_param, require_layer


class ConductivitySlope(Effect):
    """Linear conductivity of rubber and road about the ambient temperature."""

    cause = "thermal conductivity changes with temperature"
    source = "filled rubbers lose 0.1-0.3 % per kelvin"
    tells = ("profile through the depth bends", "grows with the rise squared")
    candidate = True

    block = Param(-0.002, "1/K", "relative slope of the block's conductivity", low=-0.005, high=0.02, off=0.0)
    road = Param(0.0, "1/K", "relative slope of the road's conductivity", low=-0.005, high=0.02, off=0.0)

    layer = layer_param("`block` applies to it alone; to the whole block if not given")

    def heat(self, scene, p):
        """Multiplies both conductivities."""
        zero, where = scene.ambient, require_layer(scene, p.layer, "conductivity_slope.layer")

        def block_factor(T, now, p):
            warmer = 1.0 + p.block * (T - zero)
            return warmer if where is None else 1.0 + (warmer - 1.0) * scene.in_layer(where)[:, None]

        yield Factor("block.conductivity", block_factor)
        yield Factor("road.conductivity", lambda T, now, p: 1.0 + p.road * (T - zero))
