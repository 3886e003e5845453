"""Friction that falls with local pressure, as the area of contact saturates: mu = mu_ref (p/p_ref)^-m.

>>> from types import SimpleNamespace as N
>>> [law] = FrictionLoad().heat(None, None)
>>> round(float(law.law(300.0, N(local_pressure=4e5), N(exponent=0.5, reference=1e5))), 6)
0.5
"""

from __future__ import annotations

import numpy as np

from flashtemp.physics.effect import Effect, Factor, Param

MIN_FRICTION_PRESSURE_RATIO = 1e-3  # fraction of the reference pressure below which the law is constant


class FrictionLoad(Effect):
    """Power law of the friction coefficient in the local nominal contact pressure."""

    cause = "friction falls with the local pressure"
    source = "Persson contact theory: the fraction erf(..) is 2.5 % under proportion at 0.3, 7.6 % at 0.5"
    tells = ("less than proportional rise with load", "peaks of pressure heat less", "nothing at a single load")
    candidate = True

    exponent = Param(0.1, "1", "exponent m of the fall with pressure", low=-0.5, high=0.9, off=0.0)
    reference = Param(1e5, "Pa", "local nominal pressure at which friction.mu holds", low=0.0, open_low=True)

    def heat(self, scene, p):
        """Multiplies mu."""

        def law(T, now, p):
            ratio = now.local_pressure / p.reference
            return (
                np.where(np.real(ratio) > MIN_FRICTION_PRESSURE_RATIO, ratio, MIN_FRICTION_PRESSURE_RATIO)
                ** -p.exponent
            )

        yield Factor("friction.mu", law)
