"""Units in which a field of the case page shows a number: chosen from a list, converted to the unit of the key.

A number without a unit in a case is in the unit of its key.  A number in another unit is written with it, as "25 mm".
"""

from __future__ import annotations

import math
import re
from typing import Any, Final

from flashtemp.model.case import Case
from flashtemp.model.case_file import parse_toml
from flashtemp.model.schema import declared_params
from flashtemp.model.toml_format import value_text
from flashtemp.physics.effect import Param
from flashtemp.physics.units import QUANTITY_PATTERN, looks_like_quantity

# unit of a key: {unit to choose: (factor, offset) that converts to the unit of the key}, the most natural first
UNIT_CHOICES: Final[dict[str, dict[str, tuple[float, float]]]] = {
    "m": {"m": (1.0, 0.0), "mm": (1e-3, 0.0), "um": (1e-6, 0.0)},
    "Pa": {"MPa": (1e6, 0.0), "kPa": (1e3, 0.0), "bar": (1e5, 0.0), "Pa": (1.0, 0.0)},
    "m/s": {"m/s": (1.0, 0.0), "km/h": (1.0 / 3.6, 0.0)},
    "degC": {"degC": (1.0, 0.0), "degF": (5.0 / 9.0, -160.0 / 9.0)},
    "s": {"s": (1.0, 0.0), "min": (60.0, 0.0), "h": (3600.0, 0.0)},
    "Pa/m": {"MPa/mm": (1e9, 0.0), "MPa/m": (1e6, 0.0), "Pa/m": (1.0, 0.0)},
    "N": {"N": (1.0, 0.0), "kN": (1e3, 0.0)},
}
UNIT_LABELS: Final = {"um": "µm", "degC": "°C", "degF": "°F"}  # as people write them
NATURAL_RANGE = (1.0, 1000.0)  # of a number that is easy to read


def unit_choices(param: Param) -> dict[str, tuple[float, float]]:
    """The units to choose for a key with their conversions; empty where there is no choice."""
    return UNIT_CHOICES.get(param.unit, {}) if {"number", "amount"} & set(param.kinds) else {}


def natural_unit(param: Param) -> str:
    """The unit in which the default of a key, or the middle of its range, is easy to read.

    >>> natural_unit(Param(0.025, "m", "length")), natural_unit(Param(1.5e5, "Pa", "")), natural_unit(Param(1, "1", ""))
    ('mm', 'kPa', '1')
    """
    size = abs(param.value) if isinstance(param.value, (int, float)) else 0.0
    if param.value is None and 0.0 < param.low < param.high < math.inf:
        size = math.sqrt(param.low * param.high)
    if param.value == 0 and param.high < 1.0:  # a length that is off by default
        size = param.high / 10.0
    for unit, (factor, offset) in unit_choices(param).items():
        if offset == 0.0 and NATURAL_RANGE[0] <= size / factor * (1 + 1e-9) < NATURAL_RANGE[1]:
            return unit
    return param.unit


def unit_label(unit: str) -> str:
    """A unit as people write it; "" for a number without a unit, and for the columns of a table.

    >>> unit_label("um"), unit_label("1"), unit_label("W/m2K")
    ('µm', '', 'W/m²K')
    """
    return UNIT_LABELS.get(unit, "" if unit == "1" or "," in unit else unit.replace("m2", "m²").replace("m3", "m³"))


def describe_key(param: Param, unit: str) -> str:
    """Meaning and range of a key in words; the range is in `unit`.

    >>> describe_key(Param(0.025, "m", "length of the block", low=1e-4, high=1.0), "mm")
    'length of the block; 0.1 to 1000 mm'
    """
    factor, offset = unit_choices(param).get(unit, (1.0, 0.0))
    label = unit_label(unit if unit in unit_choices(param) else param.unit)
    if not {"number", "amount", "whole", "level"} & set(param.kinds):
        return f"{param.about}; {param.unit}" if param.unit not in ("", "1") else param.about
    low, high = (f"{(v - offset) / factor:.6g}" if math.isfinite(v) else "" for v in (param.low, param.high))
    span = f"{low} to {high}" if low and high else f"from {low}" if low else f"up to {high}" if high else ""
    more = f"{span} {label}".strip()
    return f"{param.about}; {more}" if more else param.about


def show_number(value: Any, param: Param, unit: str) -> tuple[str, str]:
    """The text of a field for a value of a case, and the unit it is in: the value's own, or else `unit`.

    >>> length = Param(0.025, "m", "length")
    >>> show_number(0.03, length, "mm"), show_number("3 cm", length, "mm"), show_number("20 um", length, "mm")
    (('30', 'mm'), ('3 cm', 'mm'), ('20', 'um'))
    """
    if value is None:
        return "", unit
    choices = unit_choices(param)
    if looks_like_quantity(value) and (found := QUANTITY_PATTERN.fullmatch(value)):
        return (found[1], found[2]) if found[2] in choices else (value, unit)
    if unit in choices and isinstance(value, (int, float)) and not isinstance(value, bool):
        factor, offset = choices[unit]
        return f"{(value - offset) / factor:.10g}", unit
    return format_value(value), unit


def describe_value(value: Any, param: Param, unit: str | None = None) -> str:
    """A value with its unit as people write it; a number of the key's unit in `unit`, or else in its natural unit.

    >>> pressure = Param(1.5e5, "Pa", "mean contact pressure", kinds=("number", "text", "table"))
    >>> describe_value(75000.0, pressure), describe_value("0.2 MPa", pressure), describe_value("p.csv", pressure)
    ('75 kPa', '0.2 MPa', 'p.csv')
    >>> describe_value(True, Param(True, "", "", kinds=("flag",))), describe_value(None, pressure)
    ('yes', 'none')
    """
    if value is None or isinstance(value, bool):
        return "none" if value is None else "yes" if value else "no"
    text, unit = show_number(value, param, natural_unit(param) if unit is None else unit)
    if isinstance(value, float) and unit not in unit_choices(param):
        text = f"{value:.10g}"
    return text if isinstance(value, str) and text == value else f"{text} {unit_label(unit)}".strip()


def find_param(case: Case | None, key: str) -> Param | None:
    """The declaration of a key "table.name" of a case, or where that is not known yet, of any case; None for others.

    >>> find_param(None, "contact.pressure").unit, find_param(None, "contact.presure")
    ('Pa', None)
    """
    table, _, name = key.rpartition(".")
    if case is not None and table in case.values:
        return case.declared_params(table).get(name)
    return declared_params(table).get(name)


def describe_overrides(command: str) -> str:
    """The keys that a command line sets to numbers without units, in words; "" for none.

    >>> describe_overrides("flashtemp run case.toml contact.pressure=2e5 schedule.speed=0.1,0.3 --out a")
    'contact.pressure is in Pa: 200 kPa; schedule.speed is in m/s: 0.1 m/s, 0.3 m/s'
    >>> describe_overrides("flashtemp run case.toml contact.pressure=200kPa friction.mu=0.8 numerics.mesh=fine")
    ''
    """
    out = []
    for key, text in re.findall(r"(?<![\w.-])([a-z_]\w*\.\w+)=([^\s'\"]+)", command):
        param, values = find_param(None, key), [parse_value(part) for part in text.split(",")]
        has_unit = param is not None and param.unit not in ("", "1")
        if param is not None and has_unit and all(isinstance(v, (int, float)) for v in values):
            words = ", ".join(describe_value(value, param) for value in values)
            out.append(f"{key} is in {unit_label(param.unit)}: {words}")
    return "; ".join(out)


def read_number(typed: str | None, param: Param, unit: str) -> Any:
    """The value for the text of a case of what was typed in a field with that unit; None where nothing was typed.

    >>> length = Param(0.025, "m", "length")
    >>> read_number("30", length, "mm"), read_number("0.03", length, "m"), read_number("3 cm", length, "mm")
    ('30 mm', 0.03, '3 cm')
    """
    value = parse_value(typed)
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return (
        f"{(typed or '').strip()} {unit}" if is_number and unit != param.unit and unit in unit_choices(param) else value
    )


def convert_to_key_unit(value: Any, param: Param) -> Any:
    """A number with one of the units to choose in the unit of its key; other values unchanged.

    >>> convert_to_key_unit("30 mm", Param(0.025, "m", "length"))
    0.03
    """
    found = QUANTITY_PATTERN.fullmatch(value) if looks_like_quantity(value) else None
    if found is None or found[2] not in unit_choices(param):
        return value
    factor, offset = unit_choices(param)[found[2]]
    return float(f"{float(found[1]) * factor + offset:.15g}")


def is_default(value: Any, param: Param) -> bool:
    """Whether a stated value equals the default of its key.

    >>> is_default("2.5 cm", Param(0.025, "m", "")), is_default("25 mm", Param(0.025, "m", ""))
    (False, True)
    """
    stated = float("inf") if value == "inf" and "number" in param.kinds else convert_to_key_unit(value, param)
    return isinstance(stated, bool) == isinstance(param.value, bool) and bool(stated == param.value)


def format_value(value: Any) -> str:
    """A value in TOML; a text without its quotes."""
    return value if isinstance(value, str) else value_text(value)


def parse_value(typed: str | None) -> Any:
    """A typed value: a number or TOML, or else the text itself; None where nothing was typed.

    >>> parse_value("1."), parse_value("[1, 2]"), parse_value("true"), parse_value("far"), parse_value(" ")
    (1.0, [1, 2], True, 'far', None)
    """
    text = (typed or "").strip()
    if not text:
        return None
    try:
        return parse_toml(f"v = {text}")["v"] if "\n" not in text else text
    except (ValueError, RecursionError):
        pass
    try:
        return float(text) if math.isfinite(float(text)) else text
    except ValueError:
        return text
