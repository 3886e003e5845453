"""Conditions that the name of a recording may state, such as 150kPa_0.1ms.nc: suggestions that a user confirms."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

CONDITION_UNITS: Final = {  # key: {unit in a file name, without "/": unit}
    "contact.pressure": {"kPa": "kPa", "MPa": "MPa", "hPa": "hPa", "bar": "bar", "Pa": "Pa"},
    "schedule.speed": {"mps": "m/s", "ms": "m/s", "mmps": "mm/s", "mms": "mm/s", "cms": "cm/s", "kmh": "km/h"},
    "ambient.temperature": {"degC": "degC", "C": "degC"},
}
NUMBER_WITH_UNIT: Final = re.compile(
    r"(?:^|(?<=[^A-Za-z0-9.,]))(\d+(?:[.,]\d+)?)[ _]?([A-Za-z]+(?:-s|_s)?)(?![A-Za-z0-9])"
)


def guess_conditions(name: str) -> dict[str, str]:
    """Conditions from a file name, as quantities with their units.

    >>> guess_conditions("side_150kPa_0.1ms.nc"), guess_conditions("a12.nc")
    ({'contact.pressure': '150 kPa', 'schedule.speed': '0.1 m/s'}, {})
    >>> guess_conditions("wake-0,3 MPa-50mm_s.nc")
    {'contact.pressure': '0.3 MPa', 'schedule.speed': '50 mm/s'}
    """
    out: dict[str, str] = {}
    for number, unit in NUMBER_WITH_UNIT.findall(Path(name).stem):
        plain = unit.replace("-s", "s").replace("_s", "s")
        for key, units in CONDITION_UNITS.items():
            if plain in units and key not in out:
                out[key] = f"{number.replace(',', '.')} {units[plain]}"
    return out


def find_conditions(name: str) -> list[tuple[int, int]]:
    """Places in a file name, from and to, of numbers that state a load or a speed.

    >>> find_conditions("side_150kPa_007.csv"), find_conditions("T_23C.csv")
    ([(5, 11)], [])
    """
    units = CONDITION_UNITS["contact.pressure"] | CONDITION_UNITS["schedule.speed"]
    found = NUMBER_WITH_UNIT.finditer(Path(name).stem)
    return [m.span() for m in found if m[2].replace("-s", "s").replace("_s", "s") in units]


def suggest_conditions(entries: Sequence[Mapping[str, Any]]) -> dict[int, dict[str, str]]:
    """Conditions that file names state and their entries do not, by the number of the entry, counted from 1.

    >>> suggest_conditions([{"file": "2bar.nc"}, {"file": "3bar.nc", "with": {"contact.pressure": 1e5}}])
    {1: {'contact.pressure': '2 bar'}}
    """
    out: dict[int, dict[str, str]] = {}
    for number, entry in enumerate(entries, 1):
        given = entry.get("with", {})
        given = given if isinstance(given, Mapping) else {}
        if new := {k: v for k, v in guess_conditions(str(entry.get("file", ""))).items() if k not in given}:
            out[number] = new
    return out
