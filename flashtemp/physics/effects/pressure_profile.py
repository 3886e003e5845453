"""Prescribed profile of nominal pressure, from a pressure-sensitive film or a mechanical model.

>>> from types import SimpleNamespace as N
>>> [law] = PressureProfile().heat(None, None)
>>> law.law(None, N(x=0.0, y=0.0), N(weight=0.5, profile=lambda x: 1.4, across=lambda y: 2.0, map=lambda x, y: 1.0))
1.9
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from flashtemp.errors import BadInput
from flashtemp.physics.effect import Effect, Factor, Param
from flashtemp.physics.interpolation import Curve, read_surface, read_xy_pairs
from flashtemp.physics.tables.column_matching import PLACE_X, PLACE_Y, RELATIVE_PRESSURE


class PressureProfile(Effect):
    """Local nominal pressure proportional to a table over x, y (3D) or both; the mean load is unchanged."""

    cause = "the nominal contact pressure follows a measured profile"
    source = "the table's own source"
    tells = ("hot where the profile is high",)
    candidate = True
    steady = True

    weight = Param(1.0, "1", "0 uniform, 1 the profile as given", low=0.0, high=1.0, off=0.0)
    profile = Param(None, "m, 1", "x against relative pressure: CSV file or rows", kinds=("text", "table"))
    across = Param(
        None, "m, 1", "y from the centre line against relative pressure (3D): CSV file or rows", kinds=("text", "table")
    )
    map = Param(None, "m, m, 1", "x and y against relative pressure (3D): CSV file or rows", kinds=("text", "table"))

    @classmethod
    def prepare(cls, values, folder):
        """Read the tables; a missing one is 1."""
        if all(values[k] is None for k in ("profile", "across", "map")):
            raise BadInput("pressure_profile.profile: missing; give rows of [x in m, relative pressure] or a CSV file")
        for key in ("profile", "across"):
            values[key] = _read_curve(values[key], folder, f"pressure_profile.{key}", "x" if key == "profile" else "y")
        values["map"] = _read_map(values["map"], folder, "pressure_profile.map")
        return values

    def heat(self, scene, p):
        """Multiplies the ratio of local to mean pressure."""

        def law(T, now, p):
            return 1.0 + p.weight * (p.profile(now.x) * p.across(now.y) * p.map(now.x, now.y) - 1.0)

        yield Factor("contact.pressure", law)


def _read_curve(given, folder, key, axis):
    """Curve of a table, the constant 1 without a table."""
    if given is None:
        return lambda at: 1.0
    place = PLACE_X if axis == "x" else PLACE_Y
    at, y = read_xy_pairs(given, folder, key, low=0.0, columns=(place, RELATIVE_PRESSURE))
    if len(at) < 2 or max(y) <= 0:
        raise BadInput(
            f"{key}: {len(at)} row(s), largest {max(y):g}; give at least two rows of [{axis} in m, relative pressure], "
            "not all zero"
        )
    return Curve(at, y)


def _read_map(given, folder, key):
    """Bilinear map of a table over x and y, constant beyond its edges; 1 without a table."""
    if given is None:
        return lambda x, y: 1.0
    table = read_surface(given, folder, key, (PLACE_X, PLACE_Y, RELATIVE_PRESSURE))
    z, nodes = np.asarray(table.z), (np.asarray(table.u), np.asarray(table.v))
    if z.min() < 0 or z.max() <= 0 or min(z.shape) < 2:
        raise BadInput(
            f"{key}: {z.shape[0]} x {z.shape[1]} nodes from {z.min():g} to {z.max():g}; "
            "give at least two in x and in y, pressures >= 0, not all zero"
        )
    inner = RegularGridInterpolator(nodes, z)

    def interpolate_map(x, y):
        at = np.broadcast_arrays(*(np.clip(v, n[0], n[-1]) for v, n in zip((x, y), nodes, strict=True)))
        return inner(np.stack(at, axis=-1))

    return interpolate_map
