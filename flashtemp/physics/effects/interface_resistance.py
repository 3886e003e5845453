"""A film (wear debris, dust, moisture) in the contact adds thermal resistance.

>>> from types import SimpleNamespace as N
>>> [law] = InterfaceResistance().heat(None, None)
>>> law.law(None, None, N(resistance=2e-5))
2e-05
"""

from __future__ import annotations

from flashtemp.physics.effect import Effect, Param, Term


class InterfaceResistance(Effect):
    """Resistance in series with 1/alpha inside the spots."""

    cause = "a film in the contact resists the passage of heat"
    source = "series resistance of a thin layer; a debris film of 10 um and 0.2 W/mK has 5e-5 m2K/W"
    tells = ("block hotter, road cooler, by the same flux",)
    candidate = True
    steady = True

    resistance = Param(2e-5, "m2K/W", "thermal resistance of the film", low=0.0, high=1e-2, off=0.0)

    def heat(self, scene, p):
        """Adds to 1/alpha."""
        yield Term("contact.resistance", lambda T, now, p: p.resistance)
