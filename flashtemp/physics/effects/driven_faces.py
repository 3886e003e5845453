"""Face and back of a block without contact follow measured temperatures, exactly or through a coefficient.

>>> from types import SimpleNamespace as N
>>> p = N(coefficient=float("inf"), face=lambda t: 20.0 + t, back=None)
>>> face, *_ = DrivenFaces().heat(None, p)
>>> face.law(N(touching=False), p), face.far(N(t=5.0), p)
(inf, 298.15)
"""

from __future__ import annotations

from functools import partial
from math import inf

from flashtemp.errors import BadInput
from flashtemp.physics.effect import Effect, Heat, Param, Term
from flashtemp.physics.interpolation import Curve, read_xy_pairs
from flashtemp.physics.quantities import KELVIN
from flashtemp.physics.tables.column_matching import TEMPERATURE, TIME

DRIVEN_SITES = {"face": "block.face", "back": "block.holder"}


class DrivenFaces(Effect):
    """Thermocouples as boundary conditions: T(t) of face and back from tables, linear, constant outside their range."""

    cause = "face or back of the block follows what a thermocouple shows"
    source = "the table's own source"
    tells = ("surface temperatures as measured",)
    needs = "a block that nothing touches: schedule.alone, or lifted waits"

    coefficient = Param(
        inf,
        "W/m2K",
        "conductance between table and surface; 'inf' prescribes the surface temperature",
        low=0.0,
        off=0.0,
    )
    face = Param(None, "s, degC", "time against temperature of the face: CSV file or rows", kinds=("text", "table"))
    back = Param(None, "s, degC", "the same for the back, at the holder", kinds=("text", "table"))

    @classmethod
    def prepare(cls, values, folder):
        """Read the tables.  Raises BadInput if both are missing."""
        if values["face"] is None and values["back"] is None:
            raise BadInput(
                "driven_faces.face: missing; give rows of [time in s, degC] or a CSV file, or driven_faces.back"
            )
        pace = 0.0
        for key in DRIVEN_SITES:
            if values[key] is not None:
                name, wanted = f"driven_faces.{key}", (TIME, TEMPERATURE)
                t, T = read_xy_pairs(values[key], folder, name, low=-KELVIN, high=5000.0, columns=wanted)
                pace = max(pace, (len(t) - 1) / (t[-1] - t[0]) if len(t) > 1 else 0.0)
                values[key] = Curve(t, T) if len(t) > 1 else (lambda at, T=T[0]: T)
        return values | {"pace": pace}

    def heat(self, scene, p):
        """Boundary conditions at both ends; time steps are at most the mean step of a table."""

        def coefficient(now, p):
            return 0.0 if now.touching else p.coefficient

        def far_temperature(key, now, p):
            return getattr(p, key)(now.t) + KELVIN

        for key, site in DRIVEN_SITES.items():
            if getattr(p, key) is not None:
                yield Heat.film(site, coefficient, to="holder", far=partial(far_temperature, key))
        if getattr(p, "pace", 0.0) > 0:
            yield Term("march.rate", lambda T, now, p: p.pace if p.coefficient > 0 and not now.touching else 0.0)
