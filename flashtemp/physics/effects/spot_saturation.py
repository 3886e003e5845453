"""Saturation of the contact fraction: phi = s erf(sqrt(pi)/2 phi_0/s), s the largest fraction.

>>> from types import SimpleNamespace as N
>>> [law] = SpotSaturation().heat(None, None)
>>> float(law.law(None, N(base=0.2), N(saturation=0.0)))
1.0
"""

from __future__ import annotations

import numpy as np
from scipy.special import erf

from flashtemp.physics.effect import Effect, Factor, Param


class SpotSaturation(Effect):
    """The macroasperity contact fraction approaches an upper limit as the pressure increases."""

    cause = "the macroasperity contact fraction saturates with pressure"
    source = "theory 7.4: phi = phi_sat erf((sqrt(pi)/2) (phi_ref/phi_sat) (p/p_ref)^n)"
    tells = ("heat per spot grows with pressure",)
    candidate = True
    steady = True

    saturation = Param(2.0, "1", "reciprocal of the largest contact fraction", low=0.0, high=20.0, off=0.0, curved=True)

    def heat(self, scene, p):
        """Multiplies the unsaturated fraction `now.base`."""

        def law(T, now, p):
            u = 0.5 * np.sqrt(np.pi) * np.asarray(now.base) * p.saturation
            safe = np.where(np.real(u) > 0, u, 1.0)
            return np.where(np.real(u) > 0, 0.5 * np.sqrt(np.pi) * erf(safe) / safe, 1.0)

        yield Factor("contact.spot_fraction", law)
