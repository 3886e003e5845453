"""The back of the block radiates to surroundings at ambient temperature.

>>> from types import SimpleNamespace as N
>>> [law] = BackRadiates().heat(None, None)
>>> round(law.law(343.15, N(ambient=293.15), N(emissivity=0.95)), 3)
-349.088
"""

from __future__ import annotations

from flashtemp.physics import Effect, Heat, Param

STEFAN_BOLTZMANN = 5.670374419e-8  # W/m2K4, CODATA 2018


class BackRadiates(Effect):
    """Exchange between the back and its surroundings, which the catalogue has for walls and face only."""

    cause = "the back of the block radiates"
    source = "Stefan-Boltzmann law; paint of 0.95"
    tells = ("more than proportional to the rise",)

    emissivity = Param(0.95, "1", "emissivity of the back", low=0.0, high=1.0, off=0.0)

    def heat(self, scene, p):
        """Flux through the back."""
        yield Heat.patch("block.holder", lambda T, now, p: p.emissivity * STEFAN_BOLTZMANN * (now.ambient**4 - T**4))
