"""The block swells where it is hot and presses harder there: dp = k_n e times the rise summed up the block.

>>> from types import SimpleNamespace as N
>>> [law] = ThermalExpansion().heat(None, None)
>>> round(1e4 * law.law(None, None, N(coefficient=1.6e-4, poisson=0.49)), 4)
4.6745
"""

from __future__ import annotations

from flashtemp.physics.effect import Effect, Param, Term


class ThermalExpansion(Effect):
    """Free swelling of every column of the block, against the springs on which it stands; the load is kept.

    Rubber that is hot in a thin layer cannot give way sideways: it swells by e = alpha (1 + nu)/(1 - nu) per kelvin,
    three times as much as freely.  As good as springs side by side are: not within about 0.2 H of an edge.
    """

    cause = "the block swells where it is hot, and takes load from where it is cool"
    source = "layer held sideways, Boley and Weiner; filled tread rubber: 4.5e-4 to 6e-4 per K of volume"
    uniform = True
    tells = ("trailing edge pressed harder, the more so the hotter", "grows during a repetition, fades in a wait")
    alike = "pressure_tilt"

    coefficient = Param(1.6e-4, "1/K", "linear thermal expansion of the rubber", low=0.0, high=1e-3, off=0.0)
    poisson = Param(0.49, "1", "Poisson ratio of the rubber", low=0.0, high=0.5)

    def heat(self, scene, p):
        """Strain per kelvin of a column that cannot give way sideways."""
        yield Term("block.expansion", lambda T, now, p: p.coefficient * (1.0 + p.poisson) / (1.0 - p.poisson))
