"""Nominal pressure tilted along the block by a pitching moment: p = p_mean [1 + a (1 - 2x/L)].

>>> from types import SimpleNamespace as N
>>> [law] = PressureTilt().heat(N(length=0.02), None)
>>> law.law(None, N(x=0.0), N(a=0.5)), law.law(None, N(x=0.02), N(a=0.5))
(0.5, -0.5)
"""

from __future__ import annotations

from flashtemp.physics.effect import Effect, Param, Term


class PressureTilt(Effect):
    """Linear nominal contact pressure along the block, higher at the leading edge for a > 0."""

    cause = "the nominal contact pressure is tilted towards one edge"
    source = "moment balance of the holder, theory 7.1"
    tells = ("side wall warmer near the leading edge, cooler at the trailing one",)
    candidate = True
    steady = True

    a = Param(
        0.5,
        "1",
        "relative excess of pressure at the edge x = 0, which leads unless the block slides back",
        low=-1.0,
        high=1.0,
        off=0.0,
    )

    def heat(self, scene, p):
        """Adds to the ratio of local to mean pressure."""
        yield Term("contact.pressure", lambda T, now, p: p.a * (1.0 - 2.0 * now.x / scene.length))
