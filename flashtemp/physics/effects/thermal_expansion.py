"""Thermal expansion: the block expands where it is hot, which raises the pressure there.

>>> from types import SimpleNamespace as N
>>> [law] = ThermalExpansion().heat(None, None)
>>> law.law(None, None, N(coefficient=1.6e-4))
0.00016
"""

from __future__ import annotations

from flashtemp.physics.effect import Effect, Param, Term


class ThermalExpansion(Effect):
    """Thermal expansion of the block between its holder and the road at constant load; T_exp of eq. (21).

    The elastic block expands as a whole (Maysel's theorem, `physics.elastic_block`).  On springs (`block.stiffness`)
    each column expands independently by (1 + nu)/(1 - nu) times the free strain, which is inaccurate near an edge.
    """

    cause = "the block swells where it is hot, and takes load from where it is cool"
    source = "Boley and Weiner, Theory of Thermal Stresses, 1960; filled tread rubber: 4.5e-4 to 6e-4 per K of volume"
    uniform = True
    tells = ("trailing edge pressed harder, the more so the hotter", "grows during a repetition, fades in a wait")
    alike = "pressure_tilt"
    candidate = True

    coefficient = Param(1.6e-4, "1/K", "linear thermal expansion of the block", low=0.0, high=1e-3, off=0.0)

    def heat(self, scene, p):
        """Free strain per kelvin."""
        yield Term("block.expansion", lambda T, now, p: p.coefficient)
