"""Reflected surroundings that are warmer or colder than set in the camera.

>>> from types import SimpleNamespace as N
>>> [law] = Reflection().see(None)
>>> law.law(None, None, N(excess=10.0))
10.0
"""

from __future__ import annotations

from flashtemp.physics.effect import Effect, Param, Term


class Reflection(Effect):
    """Radiance (1 - eps) S(T_reflected) with another reflected temperature than that of the recording."""

    cause = "something warmer or colder than assumed is mirrored in the wall"
    source = "10 K at emissivity 0.95 show 0.5 K too much at 40 degC"
    tells = ("one offset of the whole image, smaller where it is hot",)
    candidate = True

    excess = Param(10.0, "K", "reflected temperature minus that of the recording", low=-200.0, high=500.0, off=0.0)

    def see(self, p):
        """Adds to the recording's reflected temperature."""
        yield Term("camera.reflected", lambda T, now, p: p.excess)
