"""Friction shears the block under its holder, which presses the leading edge: a peak that follows mu, without a number.

>>> from types import SimpleNamespace as N
>>> [law] = ShearedBlock().heat(N(length=0.025, height=0.02), N(poisson=0.49))
>>> [round(float(law.law(None, N(lead=x), N(strength=1.0))), 2) for x in (0.0025, 0.0125)]
[1.63, 0.0]
"""

from __future__ import annotations

import numpy as np

from flashtemp.physics.effect import Effect, Param, Term
from flashtemp.physics.sheared_block import pressure_by_friction


class ShearedBlock(Effect):
    """Nominal contact pressure rises towards the leading edge in proportion to the friction that shears the block."""

    cause = "friction shears the block, which presses its leading edge"
    source = "plane strain of a block held at its top, theory 7.1; for tall blocks 3 mu H/L (1 - 2x/L), beam theory"
    uniform = True
    tells = ("leading edge pressed harder, the more so the higher friction", "fades as friction falls with temperature")
    alike = "edge_pressure"

    strength = Param(1.0, "1", "share of it that the holder does not take away", low=0.0, high=2.0, off=0.0)
    poisson = Param(0.49, "1", "Poisson's ratio of the rubber", low=0.0, high=0.499)

    def heat(self, scene, p):
        """Adds to local over mean pressure, per unit of friction; E cancels, and so does the load."""
        x, change = pressure_by_friction(round(scene.height / scene.length, 6), p.poisson)

        def law(T, now, p):
            return p.strength * np.interp(np.real(now.lead) / scene.length, x, change)

        yield Term("contact.pressure_by_friction", law)
