"""Thermal contact resistance that falls with sliding speed: R (v_ref/v)^n.

>>> from types import SimpleNamespace as N
>>> [law] = ConductanceSpeed().heat(None, None)
>>> round(law.law(None, N(speed=0.4), N(resistance=2e-5, reference=0.1, exponent=0.5)), 12)
1e-05
"""

from __future__ import annotations

from flashtemp.physics.effect import Effect, Param, Term

MIN_RESISTANCE_SPEED_RATIO = 1e-2  # fraction of the reference speed below which the resistance is constant


class ConductanceSpeed(Effect):
    """Resistance in the spots, in series with 1/alpha; by default its conductance grows as sqrt(v)."""

    cause = "the thermal resistance of the contact falls with speed"
    source = "theory 2.7; conductance rising with speed after Fortunato et al. 2015"
    tells = ("block hotter and road cooler at low speed", "one change per speed, all along the block")
    candidate = True

    resistance = Param(2e-5, "m2K/W", "thermal resistance at the reference speed", low=0.0, high=1e-2, off=0.0)
    reference = Param(0.1, "m/s", "speed at which that resistance holds", low=0.0, high=100.0, open_low=True)
    exponent = Param(0.5, "1", "exponent n of the fall with speed", low=0.0, high=2.0)

    def heat(self, scene, p):
        """Adds to 1/alpha."""
        yield Term(
            "contact.resistance",
            lambda T, now, p: p.resistance * max(now.speed / p.reference, MIN_RESISTANCE_SPEED_RATIO) ** -p.exponent,
        )
