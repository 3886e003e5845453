"""Friction that falls with the temperature of the contact: mu = mu_ref exp(-b (T - T_ref)).

>>> from types import SimpleNamespace as N
>>> [law] = FrictionSoftening().heat(None, None)
>>> round(float(law.law(303.15, None, N(b=0.01, reference=20.0))), 6)
0.904837
"""

from __future__ import annotations

import numpy as np

from flashtemp.physics.effect import Effect, Factor, Param
from flashtemp.physics.quantities import KELVIN


class FrictionSoftening(Effect):
    """Exponential fall of the friction coefficient with the temperature in the spots."""

    cause = "friction falls with the temperature of the contact"
    source = "theory section 3, set N: b = 0.006 /K (0.003-0.01)"
    tells = ("friction falls within a repetition", "less than proportional rise with load and speed")
    candidate = True

    b = Param(0.006, "1/K", "rate of the exponential", low=-0.05, high=0.1, off=0.0)
    reference = Param(20.0, "degC", "temperature at which friction.mu holds", low=-60.0, high=300.0)

    def heat(self, scene, p):
        """Multiplies mu at the spot temperature."""
        yield Factor("friction.mu", lambda T, now, p: np.exp(-p.b * (T - KELVIN - p.reference)))
