"""A heater irradiates the face of a block without contact; heat is absorbed there, or partly as exp(-z/depth).

>>> from types import SimpleNamespace as N
>>> _, on_face, inside = HeatedFace().heat(None, None)
>>> p = N(irradiance=5e4, absorptivity=0.9, in_depth=0.2, depth=1e-3, course=lambda t: 1.0, place=lambda x: 1.0)
>>> now = N(t=3.0, x=0.01, touching=False, low=0.0, high=1e-3)
>>> on_face.law(300.0, now, p), round(float(inside.law(300.0, now, p)))
(36000.0, 5689085)
"""

from __future__ import annotations

import numpy as np

from flashtemp.physics.effect import Effect, Heat, Param
from flashtemp.physics.interpolation import Curve, read_xy_pairs
from flashtemp.physics.tables.column_matching import PLACE_X, RELATIVE_VALUE, TIME


class HeatedFace(Effect):
    """Irradiance over time and place; the radiation of the face itself is `radiation.face`."""

    cause = "a heater shines on the face of the block"
    source = "Beer-Lambert law; course and profile of the heater from its own calibration"
    tells = ("hot face while nothing touches it",)
    needs = "a block that nothing touches: schedule.alone, or lifted waits"

    irradiance = Param(5e4, "W/m2", "irradiance of the face", low=0.0, high=1e8, off=0.0)
    absorptivity = Param(0.95, "1", "fraction of it that is absorbed", low=0.0, high=1.0)
    in_depth = Param(0.0, "1", "fraction of the absorbed heat that is released in depth", low=0.0, high=1.0)
    depth = Param(1e-3, "m", "e-folding depth of that heat", low=1e-7, high=1.0)
    film = Param(
        0.0,
        "W/m2K",
        "heat-transfer coefficient of gas on the face, besides ambient.convection",
        low=0.0,
        high=1e4,
        off=0.0,
    )
    course = Param(None, "s, 1", "time against relative irradiance: CSV file or rows", kinds=("text", "table"))
    place = Param(None, "m, 1", "x against relative irradiance: CSV file or rows", kinds=("text", "table"))

    @classmethod
    def prepare(cls, values, folder):
        """Read the tables; a missing one is 1."""
        for key, along in (("course", TIME), ("place", PLACE_X)):
            values[key] = _read_curve(values[key], folder, f"heated_face.{key}", along)
        return values

    def heat(self, scene, p):
        """Flux at the face, and heat in depth as exact means over cells, normalised to the height of the block."""

        def absorbed_flux(now, p):
            on = 0.0 if now.touching else p.absorptivity * p.irradiance
            return on * p.course(now.t) * p.place(now.x)

        def face_flux(T, now, p):
            return (1.0 - p.in_depth) * absorbed_flux(now, p) + 0.0 * T

        def depth_heat(T, now, p):
            whole = -np.expm1(-scene.height / p.depth) if scene is not None else 1.0
            decayed = np.exp(-now.low / p.depth) - np.exp(-now.high / p.depth)
            return p.in_depth * absorbed_flux(now, p) * decayed / (whole * (now.high - now.low)) + 0.0 * T

        yield Heat.film("block.face", lambda now, p: 0.0 if now.touching else p.film)
        yield Heat.patch("block.face", face_flux)
        yield Heat.zone("block", depth_heat)


def _read_curve(given, folder, key, along):
    """Curve of a table, the constant 1 without a table."""
    if given is None:
        return lambda at: 1.0
    at, y = read_xy_pairs(given, folder, key, low=0.0, columns=(along, RELATIVE_VALUE))
    return Curve(at, y) if len(at) > 1 else (lambda at: y[0])
