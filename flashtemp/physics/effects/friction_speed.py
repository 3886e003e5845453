"""Friction as a power of the sliding speed: mu = mu_ref (v/v_ref)^m.

>>> from types import SimpleNamespace as N
>>> [law] = FrictionSpeed().heat(None, None)
>>> round(law.law(300.0, N(speed=1.2), N(exponent=0.5, reference=0.3)), 6)
2.0
"""

from __future__ import annotations

from flashtemp.physics.effect import Effect, Factor, Param

MIN_FRICTION_SPEED_M_S = 1e-4  # m/s: friction at rest is that of creep


class FrictionSpeed(Effect):
    """Power law of the friction coefficient in the sliding speed, constant below a creep speed of 0.1 mm/s."""

    cause = "friction depends on the sliding speed"
    source = "adhesive friction exp(-0.1 log10(v/(6 mm/s))^2): m = -0.1 at 0.1 m/s, -0.2 at 1 m/s; viscoelastic: > 0"
    tells = ("one factor on all heat at each speed", "friction changes alike", "nothing at a single speed")
    candidate = True

    exponent = Param(0.1, "1", "exponent m of the speed", low=-1.0, high=1.0, off=0.0)
    reference = Param(0.3, "m/s", "speed at which friction.mu holds", low=0.0, high=100.0, open_low=True)

    def heat(self, scene, p):
        """Multiplies mu."""
        yield Factor(
            "friction.mu", lambda T, now, p: (max(now.speed, MIN_FRICTION_SPEED_M_S) / p.reference) ** p.exponent
        )
