"""Pressure of a bulging block, highest in its middle: p = p_mean [1 + c (1 - 3 (2x/L - 1)^2)].

>>> from types import SimpleNamespace as N
>>> [law] = PressureCrown().heat(N(length=0.02), None)
>>> law.law(None, N(x=0.01), N(c=0.2)), law.law(None, N(x=0.0), N(c=0.2))
(0.2, -0.4)
"""

from __future__ import annotations

from flashtemp.physics.effect import Effect, Param, Term


class PressureCrown(Effect):
    """Even parabola of nominal contact pressure along the block, of zero mean, high in the middle for c > 0."""

    cause = "the nominal contact pressure is highest in the middle of the block"
    source = "parabolic pressure under a bonded block of incompressible rubber (Gent); barrelling"
    tells = ("middle of the side wall warmer, both ends cooler", "the same when the block is turned round")
    candidate = True
    steady = True

    c = Param(0.2, "1", "relative excess of pressure in the middle", low=-1.0, high=0.5, off=0.0)

    def heat(self, scene, p):
        """Adds to the ratio of local to mean pressure; the mean over the block is zero."""
        yield Term("contact.pressure", lambda T, now, p: p.c * (1.0 - 3.0 * (2.0 * now.x / scene.length - 1.0) ** 2))
