"""Emissivity of the wall that differs from the one set in the camera.

>>> from types import SimpleNamespace as N
>>> [law] = Emissivity().see(None)
>>> law.law(None, None, N(change=-0.02))
-0.02
"""

from __future__ import annotations

from flashtemp.physics.effect import Effect, Param, Term


class Emissivity(Effect):
    """Radiance eps S(T) + (1 - eps) S(T_reflected) with another eps than that of the recording."""

    cause = "the emissivity is not the one that the camera reckons with"
    source = "rubber 0.94-0.97, asphalt 0.93-0.96; 0.02 is 1.0 K at 80 degC"
    tells = ("one factor on all rises of one camera", "nothing at the reflected temperature")
    candidate = True

    change = Param(-0.02, "1", "true emissivity minus that of the recording", low=-0.5, high=0.3, off=0.0)

    def see(self, p):
        """Adds to the recording's emissivity."""
        yield Term("camera.emissivity", lambda T, now, p: p.change)
