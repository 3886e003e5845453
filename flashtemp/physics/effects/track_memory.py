"""Memory of the circular track: road that returns under the block is still warm (theory.md, section 1.5).

>>> from types import SimpleNamespace as N
>>> [law] = TrackMemory().heat(None, None)
>>> law.law(None, N(carried=1.5), N(strength=1.0))
1.5
"""

from __future__ import annotations

from flashtemp.physics.effect import Effect, Param, Term


class TrackMemory(Effect):
    """Road that enters under the block carries the temperature rise left by earlier passes, after diffusion."""

    cause = "the road still holds heat of earlier passes"
    source = "theory 1.5: about 1-2 K after ten repetitions"
    needs = "a schedule on which the block comes round the track again"
    tells = ("whole profile lifted, most at the leading edge", "grows with repetition")
    candidate = True

    strength = Param(1.0, "1", "fraction of the remaining heat that returns", low=0.0, high=1.5, off=0.0)

    def heat(self, scene, p):
        """Adds to the temperature of the entering road."""
        yield Term("road.inflow", lambda T, now, p: p.strength * now.carried)
