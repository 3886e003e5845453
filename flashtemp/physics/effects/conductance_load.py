"""Thermal contact resistance that falls with pressure: R (p_ref/p)^0.95.

>>> from types import SimpleNamespace as N
>>> [law] = ConductanceLoad().heat(None, None)
>>> float(law.law(None, N(local_pressure=1.5e5), N(resistance=2e-5, reference=1.5e5)))
2e-05
"""

from __future__ import annotations

import numpy as np

from flashtemp.physics.effect import Effect, Param, Term

CONDUCTANCE_EXPONENT = 0.95
MIN_RESISTANCE_PRESSURE_RATIO = 1e-2  # fraction of the reference pressure below which the resistance is constant


class ConductanceLoad(Effect):
    """Resistance in the spots whose conductance rises with the local nominal pressure, in series with 1/alpha."""

    cause = "the thermal resistance of the contact falls with pressure"
    source = "conductance ~ p^0.95 of rough solids in contact (Cooper, Mikic, Yovanovich); theory 2.7"
    tells = ("block hotter and road cooler at low load", "most where the pressure is low")
    candidate = True

    resistance = Param(2e-5, "m2K/W", "thermal resistance at the reference pressure", low=0.0, high=1e-2, off=0.0)
    reference = Param(1.5e5, "Pa", "local nominal pressure of that resistance", low=0.0, open_low=True)

    def heat(self, scene, p):
        """Adds to 1/alpha."""

        def law(T, now, p):
            ratio = now.local_pressure / p.reference
            return (
                p.resistance
                * np.where(np.real(ratio) > MIN_RESISTANCE_PRESSURE_RATIO, ratio, MIN_RESISTANCE_PRESSURE_RATIO)
                ** -CONDUCTANCE_EXPONENT
            )

        yield Term("contact.resistance", law)
