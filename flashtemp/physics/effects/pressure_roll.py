"""Pressure tilted across the block, which leans to one side: p = p_mean [1 + a 2y/W].

>>> from types import SimpleNamespace as N
>>> [law] = PressureRoll().heat(N(width=0.05, resolved=True), None)
>>> law.law(None, N(y=0.0125), N(a=0.5))
0.25
"""

from __future__ import annotations

from flashtemp.physics.effect import Effect, Param, Term


class PressureRoll(Effect):
    """Linear nominal contact pressure across the block (3D), higher at its y > 0 side for a > 0."""

    cause = "the nominal contact pressure is tilted towards one side"
    source = "moment balance of the holder about the direction of sliding"
    tells = ("one side wall warmer than the other",)
    candidate = True
    steady = True
    needs = "3D, numerics.across above 1"

    a = Param(0.5, "1", "relative excess of pressure at the side y = W/2", low=-1.0, high=1.0, off=0.0)

    def heat(self, scene, p):
        """Adds to the ratio of local to mean pressure; nothing in 2D, where the width is one cell."""
        if scene.resolved:
            yield Term("contact.pressure", lambda T, now, p: p.a * 2.0 * now.y / scene.width)
