"""Spots on the tops of stones: the road has the effusivity of stone there, not that of the asphalt mix.

Parallel half-spaces with equal surface temperature take heat in proportion to their effusivity e = sqrt(k rho c), for
any history of that temperature.  A fraction a of stone in the spots therefore gives

    e = (1 - a) e_mix + a e_stone

for the road.  It is applied to the conductivity, which becomes (e/e_mix)^2 times that of the mix.

>>> from types import SimpleNamespace as N
>>> from flashtemp.physics.material import LIBRARY
>>> p = N(share=1.0, effusivity=2302.0)
>>> [factor] = StoneTops().heat(N(road=LIBRARY["asphalt"]), p)
>>> round(factor.law(None, None, p) ** 0.5, 3)
1.557
"""

from __future__ import annotations

from flashtemp.physics.effect import Effect, Factor, Param


class StoneTops(Effect):
    """Effusivity of the road under the spots between that of the mix and that of the stones in it."""

    cause = "the spots stand on stones, which take heat better than the mix"
    source = (
        "parallel half-spaces, Carslaw & Jaeger; granite 2-3.5 W/mK, rho c 2.12e6 J/(m3K): 2,060-2,720 W s^0.5/(m2K); "
        "holds while heat stays within the stone, sqrt(D t) below its radius: 0.1-0.5 mm under the block"
    )
    tells = ("road and block cooler by one factor at every speed", "friction does not change with it")
    candidate = True

    share = Param(
        1.0, "1", "fraction of the spots' area on bare stone, the rest on the mix", low=0.0, high=1.0, off=0.0
    )
    effusivity = Param(2302.0, "W s^0.5/(m2K)", "effusivity of the stones", low=100.0, high=1e5)

    def heat(self, scene, p):
        """Multiplies the road's conductivity."""
        mix = scene.road.effusivity
        ratio = 1.0 + p.share * (p.effusivity / mix - 1.0)
        yield Factor("road.conductivity", lambda T, now, p: ratio**2)
