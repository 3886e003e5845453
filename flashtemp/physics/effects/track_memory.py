"""Switches on that the circular track remembers: road that comes round again is still warm.

>>> from types import SimpleNamespace as N
>>> [law] = TrackMemory().heat(None, None)
>>> law.law(None, N(carried=1.5), N(strength=1.0))
1.5
"""

from __future__ import annotations

from flashtemp.physics.effect import Effect, Param, Term


class TrackMemory(Effect):
    """Road entering under the block carries what earlier passes left, spread out and diffused."""

    cause = "the road still holds heat of earlier passes"
    source = "theory 1.5: about 1-2 K after ten repetitions"
    needs = "a schedule on which the block comes round the track again"
    tells = ("whole profile lifted, most at the leading edge", "grows with repetition")
    candidate = True

    strength = Param(1.0, "1", "share of the left heat that comes round", low=0.0, high=1.5, off=0.0)

    def heat(self, scene, p):
        """Adds to the temperature of the entering road."""
        yield Term("road.inflow", lambda T, now, p: p.strength * now.carried)
