"""Filled rubber conducts better along the direction in which it was rolled: k_x = k_z (1 + excess).

>>> from types import SimpleNamespace as N
>>> [law] = ConductivityAnisotropy().heat(None, None)
>>> law.law(None, None, N(excess=0.3))
1.3
"""

from __future__ import annotations

from flashtemp.physics.effect import Effect, Factor, Param


class ConductivityAnisotropy(Effect):
    """Conductivity of the rubber along the direction of sliding relative to that through its height."""

    cause = "the block conducts differently along its length and through its height"
    source = "calendered and extruded compounds: fillers align, k_x/k_z = 1.1-2"
    uniform = True
    tells = ("profile along the block smoothed", "grows with time", "nothing at a uniform temperature along x")
    candidate = True

    excess = Param(0.3, "1", "k_x/k_z of the block minus 1", low=-0.9, high=20.0, off=0.0)

    def heat(self, scene, p):
        """Multiplies the rubber's conductivity along x."""
        yield Factor("block.conductivity_along", lambda T, now, p: 1.0 + p.excess)
