"""Convert units of measurement as people, loggers and cameras write them: "25 mm", "W/m2K", "m s-1", "°C", "msec".

A unit text is parsed by a small grammar of bounded length: a product or quotient of names with exponents of one digit.
Only single names from this parser reach the units library (pint), which supplies their size.  A name with several
meanings, such as "C" or "F", is resolved by the wanted dimension.
"""

from __future__ import annotations

import itertools
import math
import re
import unicodedata
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cache, lru_cache
from typing import Any

from flashtemp.errors import BadInput, shorten_text

NUMBER_PATTERN = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
UNIT_PATTERN = r"(?:1?/)?(?:[^\W\d_]|[°º˚℃℉%‰])[^\"'=;,]{0,40}?"
QUANTITY_PATTERN = re.compile(rf"\s*({NUMBER_PATTERN})(?:\s*(?=[^1\s])|\s+(?=1/))({UNIT_PATTERN})\s*")
FILE_NAME_PATTERN = re.compile(r".*\.[A-Za-z][A-Za-z0-9]{1,5}")  # a name with a file extension
MAX_UNIT_LETTERS = 60  # "W s^0.5/(m2K)" has 13
MAX_UNIT_NAMES = 8
MAX_BRACKET_DEPTH = 2
MAX_SYMBOL_LETTERS = 4  # "mmHg", "kcal"; longer ones are words, which have a plural and may begin with a capital letter
OFFSET_SCALES = ("degC", "degF")  # scales whose zero is not absolute zero
DECLARED_SPELLINGS = {"1": "", "W/mK": "W/(m K)"}  # in flashtemp's own keys mK is metre times kelvin
UNIT_NAME_PATTERN = re.compile(r"(?:cm|mm|in|ft)H2O|(?:deg(?:ree)?s?[ _])?°?[^\W\d]+|[°%‰]")
EXPONENT_PATTERN = re.compile(r"(?:\*\*|\^)?([-+]?[0-9](?:\.[0-9])?)(?![0-9.]*[0-9])")
TEMPERATURE_PATTERN = re.compile(
    r"(?:°|\ufffd|o|deg(?:ree)?s?)?[ ._]*(celsius|centigrade|fahrenheit|kelvins?|rankine|[cfkr])", re.IGNORECASE
)
TEMPERATURE_SCALES_K = {  # size of a degree in K, and its zero in K
    "c": (Fraction(1), Fraction("273.15")),
    "f": (Fraction(5, 9), Fraction("459.67") * Fraction(5, 9)),
    "k": (Fraction(1), Fraction(0)),
    "r": (Fraction(5, 9), Fraction(0)),
}
UNIT_SPELLINGS = {  # in addition to the library's; the wanted dimension selects one of several
    "px": ("pixel",), "pixels": ("pixel",), "mil": ("thou",),
    "mK": ("millikelvin", "meter*kelvin"), "kgK": ("kilogram*kelvin",), "gK": ("gram*kelvin",), "Nm": ("newton*meter",),
    "Pas": ("pascal*second",), "mPas": ("millipascal*second",),
}  # fmt: skip
UNIT_WORDS = {  # in upper or lower case; the library's own meaning has priority
    "sec": "second", "secs": "second", "msec": "millisecond", "msecs": "millisecond", "millis": "millisecond",
    "usec": "microsecond", "usecs": "microsecond", "min": "minute", "mins": "minute", "hr": "hour", "hrs": "hour",
    "h": "hour", "s": "second", "kmh": "kilometer/hour", "kmph": "kilometer/hour", "kph": "kilometer/hour",
    "mph": "mile/hour", "mps": "meter/second", "fps": "hertz", "bar": "bar", "deg": "degree", "degs": "degree",
    "pct": "percent", "°": "degree", "%": "percent", "‰": "permille",
}  # fmt: skip
PROPORTIONS = {"percent": 1e-2, "permille": 1e-3, "ppm": 1e-6, "ppb": 1e-9}
PINT_CONSTANTS = {  # constants in the library that are not units
    "speed_of_light", "elementary_charge", "boltzmann_constant", "molar_gas_constant", "standard_gravity",
    "dirac_constant", "stefan_boltzmann_constant",
}  # fmt: skip
COUNTED_UNITS = ("bit", "count")  # units of information and counts
EXPONENT_TOLERANCE = 1e-9  # rounding of exponents such as 0.8


class _UnknownUnit(Exception):
    """A text that is not a unit."""


@dataclass(frozen=True)
class _UnitSize:
    """A unit: its factor to base units, and the exponents of these."""

    factor: float
    dimension: tuple[tuple[str, float], ...]


Factors = list[tuple[str, float]]  # names of units with their exponents


def looks_like_quantity(value: Any) -> bool:
    """Whether a value is a text that may be a number with its unit.

    >>> [looks_like_quantity(v) for v in ("25 mm", "0.3MPa", "speed.csv", "2.csv", 0.3, "1e-3", "inf")]
    [True, True, False, False, False, False, False]
    """
    if not isinstance(value, str) or re.fullmatch(NUMBER_PATTERN, value) or FILE_NAME_PATTERN.fullmatch(value):
        return False
    return QUANTITY_PATTERN.fullmatch(value) is not None


def to_unit(value: str, unit: str, difference: bool = False) -> float:
    """Convert a number with a unit to `unit`; a temperature `difference` has no offset.  Raises BadInput.

    Keys in K are always differences: temperatures themselves are in degC.

    >>> to_unit("25 mm", "m"), to_unit("0.3MPa", "Pa"), to_unit("68 degF", "degC"), to_unit("5 %", "1")
    (0.025, 300000.0, 20.0, 0.05)
    >>> to_unit("0.2 W/mK", "W/mK"), to_unit("2 K", "degC", difference=True), to_unit("3 degC", "K")
    (0.2, 2.0, 3.0)
    >>> to_unit("10 W/m²K", "W/m2K"), to_unit("1.5 N/mm2", "Pa"), to_unit("0.2/m", "1/m")
    (10.0, 1500000.0, 0.2)
    """
    found = QUANTITY_PATTERN.fullmatch(value)
    wanted = _describe_unit("K" if difference and unit in OFFSET_SCALES else unit)
    if found is None:
        raise BadInput(f"{shorten_text(repr(value))}; give a number {wanted}")
    number, text, difference = float(found[1]), found[2], difference or unit == "K"
    if text == unit and not (difference and unit in OFFSET_SCALES):
        return number
    if unit == "":
        raise BadInput(f"{value!r}; give a number without a unit")
    try:
        line = _compute_conversion(text, unit, difference)
    except _UnknownUnit as fault:
        raise BadInput(f"{value!r}: the unit {text!r} is not known; give a number {wanted}") from fault
    if line is None:
        raise BadInput(f"{value!r} is not a quantity {wanted}; give a unit that converts to it")
    return float(f"{line[0] * number + line[1]:.15g}")  # 0.3 MPa is 300000 Pa, not 299999.99999999994


def find_conversion(unit_text: str, unit: str, difference: bool = False) -> tuple[float, float]:
    """Factor and offset that convert numbers in the unit `unit_text` to `unit`: factor * x + offset.

    With `difference` the numbers are temperature differences, without offset.  Raises BadInput for an unknown unit and
    for one of another dimension.

    >>> find_conversion("mm", "m"), find_conversion("msec", "s"), find_conversion("K", "degC")
    ((0.001, 0.0), (0.001, 0.0), (1.0, -273.15))
    >>> find_conversion("°F", "K", difference=True)
    (0.5555555555555556, 0.0)
    >>> find_conversion("m", "s")
    Traceback (most recent call last):
        ...
    flashtemp.errors.BadInput: the unit 'm' cannot be converted to s
    """
    try:
        line = _compute_conversion(unit_text, unit, difference)
    except _UnknownUnit as fault:
        what = f"that can be converted to {unit}" if unit not in ("", "1") else "of a number, such as % or 1"
        raise BadInput(f"the unit {shorten_text(repr(unit_text))} is not known; give a unit {what}") from fault
    if line is None:
        into = unit if unit not in ("", "1") else "a number without a unit"
        raise BadInput(f"the unit {unit_text!r} cannot be converted to {into}")
    return line


def is_unit(text: str, unit: str) -> bool:
    """Whether a text is a unit that converts to `unit`.

    >>> is_unit("deg C", "degC"), is_unit("F", "degC"), is_unit("mV", "degC"), is_unit("m", "s"), is_unit("h", "s")
    (True, True, False, False, True)
    """
    try:
        return _compute_conversion(text, unit, False) is not None
    except _UnknownUnit:
        return False


def convert_options(words: list[str], declared: Mapping[str, str]) -> list[str]:
    """Convert the values of options in a command line to their `declared` units, as plain numbers.  Raises BadInput.

    >>> units = {"block": "mm", "air": "degC"}
    >>> convert_options(["--block", "2.5 cm", "7", "--start=-20ms", "--was.air", "293.15 K"], units)
    ['--block', '25.0', '7', '--start=-20ms', '--was.air', '20.0']
    """
    out, option = [], ""
    for word in words:
        name, given, value = word.partition("=") if word.startswith("--") else ("", "", word)
        option = name[2:].replace("-", "_") or option
        unit = declared.get(option.split(".")[-1])
        if unit is not None and looks_like_quantity(value):
            try:
                value = repr(to_unit(value, unit))
            except BadInput as fault:
                raise BadInput(f"{option}: {fault}") from fault
        out.append(name + given + value)
    return out


def _describe_unit(unit: str) -> str:
    return "in " + unit if unit not in ("", "1") else "without a unit"


@lru_cache(maxsize=4096)
def _compute_conversion(text: str, unit: str, difference: bool) -> tuple[float, float] | None:
    """Factor and offset, None where the dimensions differ.  Raises _UnknownUnit."""
    if not text.strip():
        raise _UnknownUnit(text)
    scale = _temperature_scale(unit)
    if scale is None:
        wanted = _possible_sizes(_normalise_text(DECLARED_SPELLINGS.get(unit, unit)))[0]
        size = next(
            (
                s
                for s in _possible_sizes(_normalise_text(DECLARED_SPELLINGS.get(text, text)))
                if _is_same_dimension(s, wanted)
            ),
            None,
        )
        return None if size is None else (_round_factor(size.factor / wanted.factor), 0.0)
    given_scale = _temperature_scale(text)
    if given_scale is None:
        size = next((s for s in _possible_sizes(_normalise_text(text)) if s.dimension == (("kelvin", 1.0),)), None)
        if size is None:
            return None
        given_scale = Fraction(_round_factor(size.factor)), Fraction(0)
    offset = Fraction(0) if difference else (given_scale[1] - scale[1]) / scale[0]
    return float(given_scale[0] / scale[0]), float(offset)


def _temperature_scale(text: str) -> tuple[Fraction, Fraction] | None:
    """Size of a degree and the zero of a scale of temperature, both in K; None for any other text.

    >>> _temperature_scale("deg C") == _temperature_scale("°C"), _temperature_scale("mV")
    (True, None)
    """
    found = TEMPERATURE_PATTERN.fullmatch(_normalise_text(text))
    return TEMPERATURE_SCALES_K[found[1][0].lower()] if found else None


def _normalise_text(text: str) -> str:
    """A unit in common characters: superscript digits, operators and degree signs in their usual form.

    >>> _normalise_text(" W·m⁻² "), _normalise_text("℃"), _normalise_text("deg  C"), _normalise_text("m per second")
    ('W*m-2', '°C', 'deg C', 'm/second')
    """
    if len(text) > MAX_UNIT_LETTERS:
        raise _UnknownUnit(text)
    for ring in ("Â°", "º", "˚", "ᵒ", "∘"):  # the first is ° of a file in UTF-8 read as Latin-1
        text = text.replace(ring, "°")
    plain = unicodedata.normalize("NFKC", text.strip())
    for sign, usual in (("\u2212", "-"), ("·", "*"), ("⋅", "*"), ("∙", "*"), ("×", "*"), ("μ", "µ")):
        plain = plain.replace(sign, usual)
    return re.sub(r" +per +", "/", re.sub(r"[ \t]+", " ", plain))


def _is_same_dimension(one: _UnitSize, other: _UnitSize) -> bool:
    """Whether two units have the same dimension."""
    a, b = dict(one.dimension), dict(other.dimension)
    return a.keys() == b.keys() and all(abs(a[k] - b[k]) < EXPONENT_TOLERANCE for k in a)


def _round_factor(factor: float) -> float:
    """A factor without rounding errors in its last bits.

    >>> _round_factor(0.1 * 3), _round_factor(1 / 3.6)
    (0.3, 0.2777777777777778)
    """
    near = float(f"{factor:.12g}")
    return near if abs(near - factor) <= 1e-15 * abs(factor) else factor


@lru_cache(maxsize=4096)
def _possible_sizes(text: str) -> list[_UnitSize]:
    """Possible meanings of a unit text, the most common first.  Raises _UnknownUnit."""
    sizes: list[_UnitSize] = []
    for factors in _parse_readings(text):
        meanings = [_name_sizes(name) for name, _ in factors]
        for chosen in itertools.islice(itertools.product(*meanings), 64):
            size = _multiply_sizes([(one, power) for one, (_, power) in zip(chosen, factors, strict=True)])
            if size is not None and size not in sizes:
                sizes.append(size)
    if not sizes:
        raise _UnknownUnit(text)
    return sizes


def _multiply_sizes(factors: list[tuple[_UnitSize, float]]) -> _UnitSize | None:
    """The product of units with exponents; None where its size is no finite float."""
    factor, dimension = 1.0, dict[str, float]()
    for size, power in factors:
        try:
            factor *= size.factor**power
        except OverflowError:
            return None
        for base, exponent in size.dimension:
            dimension[base] = dimension.get(base, 0.0) + exponent * power
    if not (math.isfinite(factor) and factor > 0):
        return None
    return _UnitSize(factor, tuple(sorted((b, e) for b, e in dimension.items() if abs(e) > EXPONENT_TOLERANCE)))


# --- the grammar ------------------------------------------------------------------------------------
def _parse_readings(text: str) -> Iterator[Factors]:
    """A unit text as names with exponents: as written, and with everything after the first / in the denominator.

    The second reading is the usual meaning of "J/kg K"; the wanted dimension decides between both.

    >>> list(_parse_readings("W/m2K")), [*_parse_readings("J/kg K")][1]
    ([[('W', 1.0), ('m', -2.0), ('K', -1.0)]], [('J', 1.0), ('kg', -1.0), ('K', -1.0)])
    """
    parser = _UnitParser(text)
    terms = parser.parse_terms(0) if text not in ("", "1") else []
    if (terms and parser.at < len(text)) or sum(len(factors) for _, factors in terms) > MAX_UNIT_NAMES:
        raise _UnknownUnit(text)
    yield [(name, sign * power) for sign, factors in terms for name, power in factors]
    first = next((n for n, (sign, _) in enumerate(terms) if sign < 0), len(terms))
    if any(sign > 0 for sign, _ in terms[first:]):
        yield [
            (name, power * (1 if n < first else -1)) for n, (_, factors) in enumerate(terms) for name, power in factors
        ]


@dataclass
class _UnitParser:
    """Recursive-descent parser of a unit text; `at` is its position."""

    text: str
    at: int = 0

    def parse_terms(self, depth: int) -> list[tuple[int, Factors]]:
        """Terms with sign 1 after a product and -1 after a /, up to a closing bracket or the end.

        Raises _UnknownUnit.
        """
        out: list[tuple[int, Factors]] = []
        sign = 1
        if self._take_sign("1/") or self._take_sign("/"):
            sign = -1
        while True:
            out.append((sign, self._parse_term(depth)))
            if self._take_sign("/"):
                sign = -1
            elif self._take_sign("**") or self._take_sign("^"):  # without a valid exponent
                raise _UnknownUnit(self.text)
            elif self._take_sign("*") or self._take_sign(".") or self._take_blank():
                sign = 1
            else:
                return out

    def _parse_term(self, depth: int) -> Factors:
        """A name or bracket, or several that an exponent or a degree sign separates, as m2K or m°C."""
        self._skip_blank()
        out: Factors = []
        while True:
            if depth < MAX_BRACKET_DEPTH and self._take_sign("("):
                inside = [(n, s * p) for s, factors in self.parse_terms(depth + 1) for n, p in factors]
                self._skip_blank()
                if not self._take_sign(")"):
                    raise _UnknownUnit(self.text)
            elif name := UNIT_NAME_PATTERN.match(self.text, self.at):
                inside, self.at = [(name[0], 1.0)], name.end()
            else:
                break
            power = EXPONENT_PATTERN.match(self.text, self.at)
            out += [(n, p * float(power[1])) for n, p in inside] if power else inside
            self.at = power.end() if power else self.at
            if power is None and self.text[self.at : self.at + 1] != "°":  # nothing else separates two names
                break
        if not out:
            raise _UnknownUnit(self.text)
        return out

    def _take_sign(self, sign: str) -> bool:
        """Skip `sign` if it comes next, perhaps after a blank; return whether it did."""
        start = self.at + (self.text[self.at : self.at + 1] == " " and sign != "(")
        if not self.text.startswith(sign, start):
            return False
        self.at = start + len(sign)
        return True

    def _take_blank(self) -> bool:
        """Skip a blank if it comes next; return whether another term follows it."""
        if self.text[self.at : self.at + 1] != " " or self.at + 1 >= len(self.text):
            return False
        self.at += 1
        return self.text[self.at] != ")"

    def _skip_blank(self) -> None:
        self.at += self.text[self.at : self.at + 1] == " "


# --- names ------------------------------------------------------------------------------------------
@lru_cache(maxsize=4096)
def _name_sizes(name: str) -> tuple[_UnitSize, ...]:
    """Possible meanings of a single name, the most common first; empty for an unknown one."""
    found = [_expression_size(text) for text in UNIT_SPELLINGS.get(name, (name,))]
    if scale := _temperature_scale(name):  # in a product only the size of a degree matters
        found.append(_UnitSize(float(scale[0]), (("kelvin", 1.0),)))
    if word := UNIT_WORDS.get(name.casefold()):
        found.append(_expression_size(word))
    return tuple(dict.fromkeys(size for size in found if size is not None))


def _expression_size(text: str) -> _UnitSize | None:
    """Size of names joined by * and one /, without brackets; None where one is unknown."""
    above, _, below = text.partition("/")
    factors: list[tuple[_UnitSize, float]] = []
    for names, power in ((above, 1.0), (below, -1.0)):
        for name in names.split("*") if names else ():
            size = _UnitSize(PROPORTIONS[name], ()) if name in PROPORTIONS else _pint_size(name)
            if size is None:
                return None
            factors.append((size, power))
    return _multiply_sizes(factors)


def _pint_size(name: str) -> _UnitSize | None:
    """Size of a single name from the library; None for logarithmic units, counts, information, constants."""
    registry = _pint_registry()
    for text in dict.fromkeys((name, name.lower())):
        for prefix, unit, plural in registry.parse_unit_name(text)[:1]:
            stem = text.removesuffix("s")
            is_word = len(stem) > MAX_SYMBOL_LETTERS or text in {prefix + unit + end for end in ("", "s", "es")}
            is_plural = plural or (text != stem and registry.parse_unit_name(stem)[:1] == ((prefix, unit, ""),))
            # "Pas" is not a plural of Pa; in symbols the case matters, as in Mbar and mbar
            if (text != name or is_plural) and not is_word:
                continue
            if unit in PINT_CONSTANTS or "_" in text or not registry._units[unit].is_multiplicative:
                return None
            factor, base = registry.get_root_units(prefix + unit)
            dimension = tuple(sorted((b, float(e)) for b, e in base._units.items()))
            if any(b in COUNTED_UNITS for b, _ in dimension) or not dimension:
                return None
            return _UnitSize(float(factor), dimension)
    return None


@cache
def _pint_registry() -> Any:
    """The pint registry, imported when the first unit needs it."""
    import pint

    return pint.UnitRegistry()
