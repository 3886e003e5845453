"""Keys of a case in words, and their values in customary units (MPa, mm)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeGuard

import numpy as np

from flashtemp.viz import theme
from flashtemp.viz.number_format import unit_suffix

SHORT_LENGTH_M = 0.1  # m; keys with a shorter default are labelled in mm
OMITTED_TABLES = ("schedule", "numerics")  # tables whose name is left out of a label


@dataclass(frozen=True)
class KeyLabel:
    """A key in `words`; its SI values times `factor` are in `unit`."""

    words: str
    factor: float
    unit: str

    @property
    def label(self) -> str:
        """The label of an axis: words and unit."""
        return f"{self.words} ({self.unit})" if self.unit else self.words

    def format_value(self, value: object) -> str:
        """A value without its unit; texts are unchanged."""
        return theme.format_decimal(self.factor * float(value)) if _is_number(value) else str(value)

    def describe_value(self, value: object) -> str:
        """Words, value and unit."""
        return f"{self.words} {self.format_value(value)} {self.unit if _is_number(value) else ''}".rstrip()


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float | np.number) and not isinstance(value, bool)


def describe_key(key: str, unit: str | None = None) -> KeyLabel:
    """The label of a case key; `unit` (SI) is needed for a key that no table declares.

    >>> [describe_key(key).label for key in ("contact.pressure", "block.length", "schedule.distance")]
    ['contact pressure (MPa)', 'block length (mm)', 'distance (m)']
    >>> describe_key("contact.pressure").format_value(1.5e5), describe_key("schedule.speed").format_value("speed.csv")
    ('0.15', 'speed.csv')
    """
    from flashtemp.model.schema import CASE_TABLES

    table, _, name = key.rpartition(".")
    param = CASE_TABLES.get(table, {}).get(name)
    unit = getattr(param, "unit", "") if unit is None else unit
    words = (name if table in OMITTED_TABLES else key).replace(".", " ").replace("_", " ")
    if unit == "Pa":
        return KeyLabel(words, 1e-6, "MPa")
    default = getattr(param, "value", None)
    if unit == "m" and isinstance(default, int | float) and default < SHORT_LENGTH_M:
        return KeyLabel(words, 1e3, "mm")
    return KeyLabel(words, 1.0, unit_suffix(unit).strip())


def describe_condition(overrides: dict) -> str:
    """The overrides {key: value} of a recording in words with units.

    >>> describe_condition({"contact.pressure": 1.5e5, "schedule.speed": 0.1}), describe_condition({})
    ('contact pressure 0.15 MPa, speed 0.1 m/s', 'as in the case')
    """
    return ", ".join(describe_key(key).describe_value(value) for key, value in overrides.items()) or "as in the case"
