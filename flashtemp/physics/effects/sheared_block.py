"""Friction shears the elastic block under its holder, so that the leading edge is pressed harder.

>>> law = next(part for part in ShearedBlock().heat(None, None) if part.target == "contact.shear_traction")
>>> from types import SimpleNamespace as N
>>> law.law(None, None, N(strength=1.0))
1.0
"""

from __future__ import annotations

from flashtemp.physics.effect import Effect, Param, Term


class ShearedBlock(Effect):
    """The friction traction mu p shears the elastic block, which raises the pressure at its leading edge."""

    cause = "friction shears the block, which presses its leading edge"
    source = "elastic block bonded to its holder, theory 7.1; for tall blocks 3 mu H/L (1 - 2x/L), beam theory"
    uniform = True
    tells = ("leading edge pressed harder, the more so the higher friction", "fades as friction falls with temperature")
    alike = "edge_pressure"
    candidate = True

    strength = Param(1.0, "1", "fraction of the friction that shears the block", low=0.0, high=2.0, off=0.0)

    def heat(self, scene, p):
        """The fraction of the friction that shears the block; s of eq. (21)."""
        yield Term("contact.shear_traction", lambda T, now, p: p.strength)
