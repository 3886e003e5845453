"""Moisture on the warm road evaporates until the track is dry: h exp(-(r-1)/n) (T_air - T).

>>> from types import SimpleNamespace as N
>>> [sink] = Evaporation().heat(N(length=0.025), None)
>>> now, p = N(lead=0.03, repetition=1, ambient=293.15), N(coefficient=150.0, repetitions=2.0)
>>> float(sink.law(303.15, now, p))
-1500.0
"""

from __future__ import annotations

import numpy as np

from flashtemp.physics.effect import Effect, Heat, Param


class Evaporation(Effect):
    """Latent heat taken from the warm road behind the block, less in every repetition.

    The vapour pressure is in equilibrium with the air at ambient temperature and linear in the temperature rise: the
    sink vanishes where the road is as warm as the air.  Only its decay with repetition distinguishes it from
    convection.
    """

    cause = "moisture on the road evaporates behind the block"
    source = "Lewis' relation: 3.4 times the film of air at a rise of 20 K, 5.5 times at 40 K; film of 30-50 W/m2K"
    tells = ("road behind the block cooler", "gone after a few repetitions", "nothing on a dry track")
    candidate = True

    coefficient = Param(
        150.0, "W/m2K", "latent heat per temperature rise in the first repetition", low=0.0, high=5e3, off=0.0
    )
    repetitions = Param(
        2.0, "1", "repetitions in which the moisture falls by a factor e", low=0.0, high=1e3, open_low=True
    )

    def heat(self, scene, p):
        """Sink on the free road behind the trailing edge."""

        def law(T, now, p):
            wet = np.where(now.lead > scene.length, np.exp(-(now.repetition - 1) / p.repetitions), 0.0)
            return p.coefficient * wet * (now.ambient - T)

        yield Heat.patch("road.free", law)
