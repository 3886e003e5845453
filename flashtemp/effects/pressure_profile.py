"""A given profile of nominal pressure, from a pressure film or a mechanical model.

>>> from types import SimpleNamespace as N
>>> [law] = PressureProfile().heat(None, None)
>>> law.law(None, N(x=0.0), N(weight=1.0, profile=lambda x: 1.4))
1.4
"""

from __future__ import annotations

from flashtemp.effect import Effect, Factor, Param
from flashtemp.errors import BadInput
from flashtemp.tables import Curve, pairs


class PressureProfile(Effect):
    """Local nominal pressure proportional to a table of x; the mean load is kept."""

    cause = "the nominal contact pressure follows a measured profile"
    source = "the table's own source"
    tells = ("hot where the profile is high",)
    steady = True

    weight = Param(1.0, "1", "0 uniform, 1 the profile as given", low=0.0, high=1.0, off=0.0)
    profile = Param(None, "m, 1", "x against relative pressure: CSV file or rows", kinds=("text", "table"))

    @classmethod
    def prepare(cls, values, folder):
        """Read the profile."""
        if values["profile"] is None:
            raise BadInput("pressure_profile.profile: missing; give rows of [x in m, relative pressure] or a CSV file")
        x, y = pairs(values["profile"], folder, "pressure_profile.profile", low=0.0)
        if len(x) < 2 or max(y) <= 0:
            raise BadInput(
                f"pressure_profile.profile: {len(x)} row(s), largest {max(y):g}; give at least two rows, not all zero"
            )
        values["profile"] = Curve(x, y)
        return values

    def heat(self, scene, p):
        """Multiplies local over mean pressure."""
        yield Factor("contact.pressure", lambda T, now, p: 1.0 + p.weight * (p.profile(now.x) - 1.0))
