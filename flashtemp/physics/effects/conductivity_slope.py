"""Thermal conductivity changes with temperature: k = k_0 [1 + slope (T - T_0)].

>>> from types import SimpleNamespace as N
>>> block, road = ConductivitySlope().heat(N(ambient=293.15), None)
>>> round(block.law(303.15, None, N(block=-0.002, road=0.0)), 6)
0.98
"""

from __future__ import annotations

from flashtemp.physics.effect import Effect, Factor, Param


class ConductivitySlope(Effect):
    """Linear conductivity of rubber and road about the ambient temperature."""

    cause = "thermal conductivity changes with temperature"
    source = "filled rubbers lose 0.1-0.3 % per kelvin"
    tells = ("profile through the depth bends", "grows with the rise squared")

    block = Param(-0.002, "1/K", "relative slope of the rubber's conductivity", low=-0.005, high=0.02, off=0.0)
    road = Param(0.0, "1/K", "relative slope of the road's conductivity", low=-0.005, high=0.02, off=0.0)

    def heat(self, scene, p):
        """Multiplies both conductivities."""
        zero = scene.ambient
        yield Factor("block.conductivity", lambda T, now, p: 1.0 + p.block * (T - zero))
        yield Factor("road.conductivity", lambda T, now, p: 1.0 + p.road * (T - zero))
