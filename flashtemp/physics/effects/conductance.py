"""Heat-transfer coefficient of the contact spots: infinite, constant, a0 + a1 sqrt(v), a table, or of micro-contacts.

>>> from types import SimpleNamespace as N
>>> law, split = Conductance().heat(None, N(alpha=lambda v: 1e4 + 2e4 * v**0.5))
>>> law.law(None, N(speed=0.25), None)
5e-05
>>> from flashtemp.physics.material import LIBRARY
>>> law = sliding_conductance(LIBRARY["tread_rubber"], LIBRARY["asphalt"], 1e-5, 0.1)
>>> print(f"{law(0.1):.4g} {law(1.0):.4g}")
6121 1.274e+04
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from flashtemp.errors import BadInput
from flashtemp.physics.effect import Effect, Param, Term
from flashtemp.physics.interpolation import Curve, read_xy_pairs
from flashtemp.physics.material import Material
from flashtemp.physics.tables.column_matching import CONDUCTANCE, SPEED


class Conductance(Effect):
    """Temperature jump (T_block - T_road) = J/alpha inside the spots; theory.md, eq. (4)."""

    cause = "the contact resists the passage of heat"
    source = "theory 2.7; speed dependence after Fortunato et al. 2015"
    tells = ("block surface hotter than road", "less so at high speed")
    section = "contact"
    base = True

    alpha = Param(
        float("inf"),
        "W/m2K",
        "heat-transfer coefficient in the spots: number, 'inf' or a law in v",
        low=0.0,
        open_low=True,
        off=float("inf"),
        kinds=("number", "table", "text"),
    )
    heat_split = Param(
        1.0, "1", "fraction of the interfacial heat released on the block's side of alpha", low=0.0, high=1.0
    )

    @classmethod
    def prepare(cls, values, folder):
        """Convert a number, {a0, a1} or a table to a law alpha(v)."""
        alpha, key = values["alpha"], "contact.alpha"
        if isinstance(alpha, dict):
            if set(alpha) == {"contact_size", "contact_share"}:
                if not all(type(a) in (int, float) and 0 < a < 1 for a in alpha.values()):
                    raise BadInput(f"{key}: {alpha!r}; give contact_size in m and contact_share, both > 0 and < 1")
                return values
            a0, a1 = (alpha.get(k, 0.0) for k in ("a0", "a1"))
            numbers = all(type(a) in (int, float) and 0 <= a < float("inf") for a in (a0, a1))
            if set(alpha) - {"a0", "a1"} or not numbers or a0 + a1 <= 0:
                raise BadInput(
                    f"{key}: {alpha!r}; give {{ a0 = W/m2K, a1 = W/m2K per sqrt(m/s) }}, both >= 0, not both 0, "
                    "or { contact_size = m, contact_share = 1 }"
                )
            values["alpha"] = lambda v: a0 + a1 * v**0.5
        elif isinstance(alpha, (list, str)):
            x, y = read_xy_pairs(alpha, folder, key, columns=(SPEED, CONDUCTANCE))
            if min(y) <= 0:
                raise BadInput(f"{key}: {min(y):g} W/m2K in the table; give values > 0")
            values["alpha"] = Curve(x, y) if len(x) > 1 else (lambda v: y[0])
        else:
            values["alpha"] = lambda v: alpha
        return values

    def heat(self, scene, p):
        """1/alpha in m2 K/W and the side on which the heat appears."""
        alpha = p.alpha
        if isinstance(alpha, dict):
            alpha = sliding_conductance(scene.block, scene.road, alpha["contact_size"], alpha["contact_share"])
        yield Term("contact.resistance", lambda T, now, p: 1.0 / max(alpha(now.speed), 1e-6))
        yield Term("contact.heat_split", lambda T, now, p: p.heat_split)


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
