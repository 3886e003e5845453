"""Thermal contact conductance of micro-contacts (theory.md, section 2.7 and eq. (19)).

>>> from flashtemp.physics.material import LIBRARY
>>> rubber, road = LIBRARY["tread_rubber"], LIBRARY["asphalt"]
>>> law = sliding_conductance(rubber, road, 1e-5, 0.1)
>>> print(f"{law(0.1):.4g} {law(1.0):.4g} {resting_conductance(rubber, road, 13.3e6, 0.75e6, 4.5e-6):.4g}")
6121 1.274e+04 5013
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from flashtemp.physics.material import Material


def resting_conductance(rubber: Material, road: Material, modulus: float, pressure: float, decay: float) -> float:
    """alpha (W/m2K) of an elastic contact at rest: 2 k_m p/(E* u0), k_m = k_R k_S/(k_R + k_S).

    Barber's relation of conductance and stiffness with p ~ exp(-u/u0): `modulus` E* and local `pressure` in Pa,
    `decay` u0 in m, 0.4 to 0.5 of the rms height.  For a spot, use the pressure and the rms height inside it.
    A reference for tests; the model does not use it.
    """
    k = rubber.conductivity * road.conductivity / (rubber.conductivity + road.conductivity)
    return 2.0 * k * pressure / (modulus * decay)


def sliding_conductance(rubber: Material, road: Material, size: float, share: float) -> Callable[[float], float]:
    """alpha(v) (W/m2K) of micro-contacts of `size` m on the road that cover a fraction `share` of a spot.

    They slide over the rubber: 1/h = 1/h_R + 1/h_S, where h_R is the larger of constriction and of surface renewal,
    which grows as sqrt(v); eq. (19).
    """
    h_S = 8.0 * road.conductivity / (np.pi * size)
    rest = 8.0 * rubber.conductivity / (np.pi * size)

    def law(v: float) -> float:
        h_R = max(rest, 2.0 / np.sqrt(np.pi) * rubber.effusivity * np.sqrt(v / size))
        alpha: float = share * h_R * h_S / (h_R + h_S)
        return alpha

    return law
