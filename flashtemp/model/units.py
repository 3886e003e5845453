"""Numbers with units, as "25 mm", "0.3MPa" or "68 degF", turned into the unit that a key declares."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from typing import Any

from flashtemp.errors import BadInput

NUMBER = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
UNIT = r"(?:1?/)?[A-Za-zµ°Ω%][^\"'=;,]{0,40}?"
QUANTITY = re.compile(rf"\s*({NUMBER})(?:\s*(?=[^1\s])|\s+(?=1/))({UNIT})\s*")
FILE = re.compile(r".*\.[A-Za-z][A-Za-z0-9]{1,5}")  # a name with an ending
OURS = {  # as tables write them: a product below the line without its brackets
    "W/mK": "W/(m*K)", "W/m2K": "W/(m**2*K)", "m2K/W": "m**2*K/W", "J/kgK": "J/(kg*K)", "W/m2": "W/m**2",
    "J/m2": "J/m**2", "kg/m3": "kg/m**3", "kg/m2": "kg/m**2", "m2/N": "m**2/N", "1": "", "px": "pixel",
    "W/m2K/(m/s)^0.8": "W/(m**2*K)/(m/s)**0.8", "W s^0.5/(m2K)": "W*s**0.5/(m**2*K)", "%": "percent",
}  # fmt: skip
ABSOLUTE = ("degC",)  # units in which zero is a place, not nothing


def meant(value: Any) -> bool:
    """Whether a value is a text that may be a number with its unit.

    >>> meant("25 mm"), meant("0.3MPa"), meant("speed.csv"), meant("2.csv"), meant(0.3), meant("1e-3"), meant("inf")
    (True, True, False, False, False, False, False)
    """
    if not isinstance(value, str) or re.fullmatch(NUMBER, value) or FILE.fullmatch(value):
        return False
    return QUANTITY.fullmatch(value) is not None


def plain(value: str, unit: str, difference: bool = False) -> float:
    """The number that a text with a unit is in `unit`, of a `difference` where zero means none.  Raises BadInput.

    >>> plain("25 mm", "m"), plain("0.3MPa", "Pa"), round(plain("68 degF", "degC"), 9), plain("5 %", "1")
    (0.025, 300000.0, 20.0, 0.05)
    >>> plain("0.2 W/mK", "W/mK"), plain("2 K", "degC", difference=True), plain("10 W/(m2 K)", "W/m2K")
    (0.2, 2.0, 10.0)
    >>> plain("10 W/m²K", "W/m2K"), plain("1.5 N/mm2", "Pa"), plain("0.2/m", "1/m")
    (10.0, 1500000.0, 0.2)
    """
    found = QUANTITY.fullmatch(value)
    assert found is not None  # `meant` was asked
    number, said = float(found[1]), found[2]
    wanted = "in " + unit if unit not in ("", "1") else "without a unit"
    if said == unit and not (difference and unit in ABSOLUTE):
        return number
    if unit == "":
        raise BadInput(f"{value!r}; give a number {wanted}")
    pint, registry = _pint()
    try:
        if unit in ABSOLUTE:
            to = f"delta_{unit}" if difference else unit
            theirs = f"delta_{said}" if difference and said.startswith("deg") else _theirs(said)
            quantity = registry.Quantity(number, theirs)
        else:
            to, quantity = _theirs(unit), registry.Quantity(number, _theirs(said))
        return float(f"{quantity.to(to).magnitude:.15g}")
    except pint.errors.DimensionalityError as fault:
        raise BadInput(f"{value!r} is no quantity {wanted}; give one that can be turned into it") from fault
    except Exception as fault:  # pint raises what its parser does for a unit that nobody knows
        raise BadInput(f"{value!r}: the unit {said!r} is not known; give a number {wanted}") from fault


def _theirs(unit: str) -> str:
    """A unit as the library reads it: powers written small or behind a length or a second, products below the line
    without their brackets, nothing above the line.

    >>> _theirs("W/m²K"), _theirs("kW/m2K"), _theirs("N/mm2"), _theirs("mm2K/W"), _theirs("/m"), _theirs("cmH2O")
    ('W/(m**2*K)', 'kW/(m**2*K)', 'N/mm**2', 'mm**2*K/W', '1/m', 'cmH2O')
    """
    flat = unit.replace("²", "2").replace("³", "3").replace("·", "*")
    if flat in OURS:
        return OURS[flat]
    raised = re.sub(r"(?<![A-Za-z])([kdcmµun]?m|in|ft|s)([23])(?![0-9])", r"\1**\2", flat.replace("^", "**"))
    below = re.sub(r"/(\w+\*\*[23])([A-Za-z]+)", r"/(\1*\2)", raised)
    return ("1" if below.startswith("/") else "") + re.sub(r"(\*\*[23])(?=[A-Za-z])", r"\1*", below)


@cache
def _pint() -> Any:
    """The library of units, loaded when the first number has one."""
    import pint

    return pint, pint.UnitRegistry(autoconvert_offset_to_baseunit=True)


def of_options(words: list[str], declared: Mapping[str, str]) -> list[str]:
    """Words of a command line with the numbers of options, whose units are `declared`, as plain ones.  Raises BadInput.

    >>> of_options(["--block", "2.5 cm", "7", "--start=-20ms", "--was.air", "293.15 K"], {"block": "mm", "air": "degC"})
    ['--block', '25.0', '7', '--start=-20ms', '--was.air', '20.0']
    """
    out, option = [], ""
    for word in words:
        name, given, value = word.partition("=") if word.startswith("--") else ("", "", word)
        option = name[2:].replace("-", "_") or option
        unit = declared.get(option.split(".")[-1])
        if unit is not None and meant(value):
            try:
                value = repr(plain(value, unit))
            except BadInput as fault:
                raise BadInput(f"{option}: {fault}") from fault
        out.append(name + given + value)
    return out
