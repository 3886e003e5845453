"""Heat-transfer coefficient of the contact from its micro-contacts (theory 2.7).

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
    `decay` u0 in m, 0.4 to 0.5 of the rms height.  It is nominal: inside a spot give the pressure and the height there.
    A reference for checks, used by no run.
    """
    k = rubber.conductivity * road.conductivity / (rubber.conductivity + road.conductivity)
    return 2.0 * k * pressure / (modulus * decay)


def sliding_conductance(rubber: Material, road: Material, size: float, share: float) -> Callable[[float], float]:
    """alpha(v) (W/m2K) of micro-contacts of `size` m on the road's tops that cover a `share` of a spot.

    Rubber flows past them: 1/h = 1/h_R + 1/h_S, h_R the larger of constriction and renewal, which grows as sqrt(v).
    """
    h_S = 8.0 * road.conductivity / (np.pi * size)
    rest = 8.0 * rubber.conductivity / (np.pi * size)

    def law(v: float) -> float:
        h_R = max(rest, 2.0 / np.sqrt(np.pi) * rubber.effusivity * np.sqrt(v / size))
        found: float = share * h_R * h_S / (h_R + h_S)
        return found

    return law
