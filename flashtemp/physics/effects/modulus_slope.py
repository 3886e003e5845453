"""Young's modulus of the rubber changes with temperature: E = E_0 [1 + slope (T - T_0)].

>>> from types import SimpleNamespace as N
>>> [law] = ModulusSlope().heat(N(ambient=293.15), None)
>>> float(law.law(303.15, None, N(slope=-0.005)))
0.95
"""

from __future__ import annotations

import numpy as np

from flashtemp.physics.effect import Effect, Factor, Param

SOFTEST = 0.05  # of E_0: a straight line does not go on for ever


class ModulusSlope(Effect):
    """Modulus of the elastic block at its mean temperature; it acts on wear, expansion and tilt.

    The pressure under a flat face that friction shears does not depend on the modulus.
    """

    cause = "the rubber of the block softens as it warms"
    source = "filled tread rubber from 20 to 60 degC: E falls by 0.3 to 1 % per kelvin"
    uniform = True
    tells = ("worn profile and tilt press less unevenly as the block warms",)
    alike = "wear"

    slope = Param(-0.005, "1/K", "relative slope of Young's modulus", low=-0.05, high=0.05, off=0.0)

    def heat(self, scene, p):
        """Factor on the modulus."""

        def law(T, now, p):
            factor = 1.0 + p.slope * (T - scene.ambient)
            return np.where(np.real(factor) > SOFTEST, factor, SOFTEST)

        yield Factor("block.modulus", law)
