"""A fraction of the friction heat is released deeper in the rubber than in the base model.

>>> from types import SimpleNamespace as N
>>> [part] = HeatDepth().heat(None, N(share=0.2, depth=1e-4))
>>> part
Deposit(share=0.2, depth=0.0001)
"""

from __future__ import annotations

from flashtemp.physics.effect import Deposit, Effect, Param


class HeatDepth(Effect):
    """Viscoelastic heat, released in the rubber as exp(-z/depth) instead of at the interface; theory.md, eq. (6)."""

    cause = "part of the heat is released inside the rubber"
    source = "theory eq. (6): 10 % of the viscoelastic heat lies 0.1-0.2 mm deep"
    tells = ("more heat stays in the block", "temperature maximum below the surface")
    candidate = True

    share = Param(0.2, "1", "fraction of the friction heat released at depth", low=0.0, high=1.0, off=0.0)
    depth = Param(1e-4, "m", "e-folding depth of that heat", low=5e-8, high=5e-3, spread=3.0)

    def heat(self, scene, p):
        """One deposit."""
        yield Deposit(p.share, p.depth)
