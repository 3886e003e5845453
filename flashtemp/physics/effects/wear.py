"""Wear of the block, which makes the pressure more uniform: dw/ds = k mu p exp(b (T - T_0)); theory.md, eq. (25).

Wear is assumed to depend on temperature as crack growth does.  Cracks in natural rubber grow four times as fast at
100 degC as at 0 degC (Lake & Lindley 1964, J. Appl. Polym. Sci. 8, 707), so b = ln 4/100 K = 0.014/K.  Those in
unfilled SBR grow 10^4 times as fast, 0.092/K; filled treads lie in between (Mars & Fatemi 2004, Rubber Chem. Technol.
77, 391): 0.005 to 0.05/K.

>>> from types import SimpleNamespace as N
>>> rate, worn = Wear().heat(N(ambient=293.15, length=0.025), None)
>>> now, p = N(local_pressure=2e5, friction=0.8), N(rate=6e-11, energy=1.0, temperature=0.0)
>>> round(float(1e6 * rate.law(293.15, now, p)), 6)
9.6
"""

from __future__ import annotations

import numpy as np

from flashtemp.errors import BadInput
from flashtemp.physics.effect import Effect, Param, Term
from flashtemp.physics.interpolation import Curve, read_xy_pairs
from flashtemp.physics.tables.column_matching import PLACE_X, WORN_DEPTH

LITERATURE_EXPONENT_1_K = float(np.log(4.0) / 100.0)  # 1/K


class Wear(Effect):
    """Worn depth per slid distance, proportional to friction energy (or to pressure alone, Archard)."""

    cause = "the block wears, so that its nominal contact pressure changes with the distance slid"
    source = "theory 7.2; relaxation over s_w = 1/(k_n k) whatever the load and speed; b: Lake & Lindley 1964"
    tells = ("leading edge cools from one repetition to the next", "friction drifts and settles", "rounded edge")
    candidate = True

    rate = Param(6e-11, "m2/N", "worn depth per slid distance and pressure", low=0.0, high=1e-7, off=0.0)
    energy = Param(1.0, "1", "1: in proportion to friction energy, k mu p; 0: to pressure, k p", low=0.0, high=1.0)
    temperature = Param(
        0.0, "1/K", 'exponent b of the rate with the temperature rise in spots; "literature": 0.014 within a factor 3',
        low=-0.1, high=0.1, kinds=("number", "name"),
    )  # fmt: skip
    profile = Param(None, "m, m", "x against worn depth at the start: CSV file or rows", kinds=("text", "table"))
    turned = Param(False, "1", "the block was rotated by 180 degrees after that profile was worn", kinds=("flag",))

    @classmethod
    def prepare(cls, values, folder):
        """Read the initial profile of the block, and replace the word "literature" by its value."""
        if isinstance(given := values["temperature"], str):
            if given != "literature":
                raise BadInput(f'wear.temperature: {given!r}; give a number (1/K) or "literature"')
            values["temperature"] = LITERATURE_EXPONENT_1_K
        if values["profile"] is not None:
            x, y = read_xy_pairs(values["profile"], folder, "wear.profile", columns=(PLACE_X, WORN_DEPTH))
            values["profile"] = Curve(x, y) if len(x) > 1 else (lambda at: y[0] + 0.0 * at)
        return values

    def heat(self, scene, p):
        """Wear in m per m slid, and the depth (m) worn before the start."""

        def rate(T, now, p):
            energy = 1.0 - p.energy + p.energy * now.friction
            power = p.temperature * (T - scene.ambient)
            power = np.where(np.real(power) > 50.0, 50.0, power)  # iterates of the solver may be far too hot
            return p.rate * energy * now.local_pressure * np.exp(power)

        def worn(T, now, p):
            return 0.0 if p.profile is None else p.profile(scene.length - now.x if p.turned else now.x)

        yield Term("block.abrasion", rate)
        yield Term("block.worn", worn)
