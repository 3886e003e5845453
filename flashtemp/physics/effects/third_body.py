"""Debris layer that grows with every repetition r: resistance = growth (r - 1 + slid fraction of this repetition).

>>> from types import SimpleNamespace as N
>>> [law] = ThirdBody().heat(N(schedule=N(distance=3.5)), None)
>>> round(law.law(None, N(repetition=3, slid=1.75), N(growth=4e-6)), 12)
1e-05
"""

from __future__ import annotations

from flashtemp.physics.effect import Effect, Param, Term


class ThirdBody(Effect):
    """Resistance of a debris layer in the spots, in proportion to the distance slid on the same track."""

    cause = "a layer of debris grows in the contact"
    source = "a layer of 10 um and 0.2 W/mK has 5e-5 m2K/W; the default reaches it in ten repetitions"
    tells = ("block hotter and road cooler with every repetition", "all along the block", "gone on a cleaned track")
    candidate = True

    growth = Param(5e-6, "m2K/W", "thermal resistance gained in one repetition", low=0.0, high=1e-2, off=0.0)

    def heat(self, scene, p):
        """Adds to 1/alpha."""

        def law(T, now, p):
            return p.growth * (now.repetition - 1 + now.slid / scene.schedule.distance)

        yield Term("contact.resistance", law)
