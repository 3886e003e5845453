"""Header of a text image: unit of its values, object parameters, size and time."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from flashtemp.camera.importing.formats.cell_parsing import parse_clock
from flashtemp.camera.importing.formats.raw_frames import ScaleMissing, temperature_unit, to_celsius
from flashtemp.errors import BadInput, shorten_text

MOST_LINES, MOST_CHARACTERS = 200, 300  # lines that are searched, and characters of each
_HEADER_NUMBER = r"[-+]?\d{1,20}(?:[.,]\d{1,20})?(?:[eE][-+]?\d{1,3})?"
_UNIT_NAME = (  # an unambiguous spelling of a unit
    r"(?:°\s?[CFKR]|(?-i:o[CF])|deg(?:rees?|\.)?\s?(?:celsius|centigrade|fahrenheit|kelvins?|rankine|[cfk])"
    r"|grad\s?(?:celsius|c)|celsius|centigrade|fahrenheit|kelvins?|millikelvin|rankine|(?-i:mK))(?!\w)"
)
_UNIT_NAME_OR_LETTER = rf"(?:{_UNIT_NAME}|(?-i:[CFK])(?!\w))"
_COUNTS_UNIT = r"(?:counts?|raw(?:\s?counts?)?|digital\s?(?:level|number|value)s?|dl|dn|adu|volts?|mv|w/\S+)(?!\w)"
_UNIT_KEYWORD = r"(?:units?|einheit(?:en)?|unidad(?:es)?|unité|unita|unità|eenheid|enhet|jednotka|单位|單位|単位)"
_VALUE_WORD = (
    r"(?:\w{0,20}temp(?:erat\w{1,6})?s?|temp[._]|t|values?|data|werte?|mess\w{0,4}werte?|scale|skala)(?![^\W_])"
)
_SHORT_GAP = r"[^\w°\d]{0,10}"
OF_LENGTH = re.compile(
    r"distan|length|pixel|size|time|zeit|humid|emiss|entfern|länge|height|width|x\s?unit|y\s?unit", re.I
)
STATEMENTS = tuple(
    re.compile(pattern, re.IGNORECASE)
    for pattern in (
        rf"{_UNIT_KEYWORD}\b(?:\s?(?:of|der|von|de)\s[a-zäöü ]{{0,30}})?{_SHORT_GAP}(?:temp\w*{_SHORT_GAP})?"
        rf"(?P<unit>{_UNIT_NAME}|[CFK](?!\w))",
        rf"(?<!\w){_VALUE_WORD}[^()\[\]{{}}\d:;=\t]{{0,25}}[\[({{]\s?(?P<unit>{_UNIT_NAME_OR_LETTER})\s?[\])}}]",
        rf"[\[({{]\s?(?P<unit>{_UNIT_NAME})\s?[\])}}]",
        rf"(?:^|[;,\t])\s*\"?[\[({{]\s?(?P<unit>{_UNIT_NAME_OR_LETTER})\s?[\])}}]\"?\s*(?:$|[;,\t])",
        rf"(?<!\w){_VALUE_WORD}(?:\s+(?:in|en)\s+|\s{{0,3}}[/:=;,\t_|-]\s{{0,3}}(?:in\s+)?)"
        rf"\"?(?P<unit>{_UNIT_NAME_OR_LETTER})",
        rf"(?<!\w){_VALUE_WORD}\s+(?P<unit>{_UNIT_NAME})",
        rf"(?<!\w){_VALUE_WORD}[^()\[\]{{}}\d:;=,\t]{{0,25}}[:=;,\t]\s{{0,3}}"
        rf"\"?(?P<unit>{_UNIT_NAME_OR_LETTER})\"?\s*(?:$|[;,\t])",
        rf"(?:^|[;,\t])\s*\"?(?P<unit>{_UNIT_NAME})\"?\s*(?:$|[;,\t])",
        rf"(?<!\w)(?:in|as)\s+(?P<unit>{_UNIT_NAME})",
    )
)
MENTION = re.compile(rf"(?<!\w){_UNIT_NAME}", re.IGNORECASE)
OF_COUNTS = re.compile(rf"{_UNIT_KEYWORD}\b{_SHORT_GAP}(?P<unit>{_COUNTS_UNIT})", re.IGNORECASE)
STATED_TEMPERATURE = re.compile(
    rf"(?P<number>{_HEADER_NUMBER})\s?(?P<unit>{_UNIT_NAME}|(?-i:[CF])(?!\w))", re.IGNORECASE
)
STATISTIC = re.compile(r"max|min|mean|avg|average|mittel|durchschnitt|hot|cold|high|low|peak", re.IGNORECASE)
SIZE_PATTERNS = {  # names of the numbers of rows and columns in headers
    "rows": re.compile(r"\W*(?:image[ _]?)?(?:rows|height|zeilen|höhe)\W{1,8}(\d{1,5})\W*", re.IGNORECASE),
    "columns": re.compile(r"\W*(?:image[ _]?)?(?:columns|width|spalten|breite)\W{1,8}(\d{1,5})\W*", re.IGNORECASE),
}
PARAMETERS = {  # beginnings of words in headers: object parameter
    "emiss": "emissivity", "refle": "reflected", "rtemp": "reflected", "atmos": "air", "air temp": "air",
    "ambient": "air", "lufttemp": "air", "umgebungs": "air", "distan": "distance", "entfern": "distance",
    "humid": "humidity", "luftfeucht": "humidity", "feucht": "humidity",
}  # fmt: skip
PARAMETER = re.compile(r"(?<![^\W\d_])(?:object |relative |rel\. ?)?(?:" + "|".join(PARAMETERS) + ")", re.IGNORECASE)
VALUE = re.compile(_HEADER_NUMBER, re.ASCII)
VALUE_BEFORE_COMMA = re.compile(_HEADER_NUMBER.replace("[.,]", "[.]"), re.ASCII)  # if commas separate cells
IN_METRES = {
    "": 1.0, "m": 1.0, "meter": 1.0, "metre": 1.0, "meters": 1.0, "metres": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048,
    "feet": 0.3048, "'": 0.3048, "in": 0.0254, "inch": 0.0254, "inches": 0.0254, "yd": 0.9144,
}  # fmt: skip


@dataclass(frozen=True)
class TextHeader:
    """Object parameters `stated_parameters`, `unit` of the values and the `line` that states it, `clock` (s).

    `counts`: the values are not temperatures; `size`: (rows, columns) of the image, None if not stated; `quantities`:
    temperatures in the lines with their units (text of the line, number, decimals, unit).
    """

    stated_parameters: dict[str, float] = field(default_factory=dict)
    unit: str | None = None
    line: str = ""
    counts: bool = False
    clock: float | None = None
    size: tuple[int | None, int | None] = (None, None)
    quantities: tuple[tuple[str, float, int, str], ...] = ()


def read_header(lines: Sequence[str], commas_part: bool = False) -> TextHeader:
    """Statements of the lines of a header, in English or German; `commas_part`: a comma is no decimal sign.

    Raises BadInput if two lines state different units, or one states an unknown unit.
    """
    unit, stated, clock, counts = None, "", None, False
    texts: list[tuple[str, float, str]] = []
    size: dict[str, int | None] = dict.fromkeys(SIZE_PATTERNS)
    quantities: list[tuple[str, float, int, str]] = []
    for line in (whole[:MOST_CHARACTERS] for whole in lines[:MOST_LINES]):
        if not line.strip():
            continue
        rest = _without_parameters(line, texts, VALUE_BEFORE_COMMA if commas_part else VALUE)
        rest = _without_quantities(rest, line, quantities)
        found, other = _unit_statement(rest)
        if found is None and (mention := MENTION.search(rest)) and (own := temperature_unit(mention[0])):
            quantities.append((line, float("nan"), 0, own))
        if found and unit and found != unit:
            raise BadInput(
                f"{_quote_line(stated)} and {_quote_line(line)} state different units; remove the wrong line"
            )
        unit, stated = (found, line) if found and not unit else (unit, stated)
        counts = counts or other
        for name, pattern in SIZE_PATTERNS.items():
            if match := pattern.fullmatch(line.strip()):
                size[name] = int(match[1])
        clock = clock if clock is not None else parse_clock(line)
    said: dict[str, float] = {}
    for name, value, word in texts:
        if name in ("reflected", "air") and (own := temperature_unit(word)) is not None:
            quantities.append((f"{name} {value:g} {word}", value, 0, own))
        if name not in said and (number := _convert_parameter(name, value, word, unit)) is not None:
            said[name] = number
    return TextHeader(said, unit, stated, counts, clock, (size["rows"], size["columns"]), tuple(quantities))


def _quote_line(line: str) -> str:
    return repr(shorten_text(line.strip())[:60])


def _unit_statement(line: str) -> tuple[str | None, bool]:
    """The unit of the values that a line states, and whether it states that they are counts.  Raises BadInput."""
    if OF_LENGTH.search(line) and not re.search(r"temp", line, re.IGNORECASE):
        return None, False
    for pattern in STATEMENTS:
        if match := pattern.search(line):
            unit = temperature_unit(match["unit"])
            if unit is None:
                raise BadInput(
                    f"{_quote_line(line)} states a unit that is not known; export the temperatures in degC, K or degF"
                )
            return unit, False
    return None, OF_COUNTS.search(line) is not None


def _without_parameters(line: str, found: list[tuple[str, float, str]], value: re.Pattern[str]) -> str:
    """A line without its object parameters, which are appended to `found`: name, number, unit as written."""
    places = list(PARAMETER.finditer(line))
    kept, end = [], 0
    for k, place in enumerate(places):
        stop = places[k + 1].start() if k + 1 < len(places) else len(line)
        segment = line[place.end() : stop]
        number = value.search(segment)
        kept.append(line[end : place.start()])
        end = stop
        key = next(name for word, name in PARAMETERS.items() if word in place[0].lower())
        if number is None:
            kept.append(re.sub(r"^[^;,\t:=]*", "", segment))
            continue
        before = re.search(r"[\[(]\s?([^\d()\[\]]{1,12})\s?[\])]", segment[: number.start()])
        after = re.match(r"\s?([^\s;,\t\d()\[\]]{0,12}(?:\s[CFK](?!\w))?)", segment[number.end() :])
        word = (after[1] if after else "") or (before[1] if before else "")
        if "trans" not in segment[: number.start()].lower():
            found.append((key, float(number.group().replace(",", ".")), word.strip().strip('"')))
        kept.append(" " + segment[number.end() + (after.end() if after else 0) :])
    return "".join(kept) + line[end:]


def _without_quantities(text: str, line: str, found: list[tuple[str, float, int, str]]) -> str:
    """A text without temperatures and their units, which are appended to `found`."""
    for match in STATED_TEMPERATURE.finditer(text):
        unit = temperature_unit(match["unit"])
        if unit is not None:
            number = match["number"].replace(",", ".")
            decimals = len(number.partition(".")[2]) if "e" not in number.lower() else 0
            found.append((line, float(number), decimals, unit))
    return STATED_TEMPERATURE.sub(" ", text)


def _convert_parameter(name: str, value: float, word: str, unit: str | None) -> float | None:
    """An object parameter in degC, m or as a fraction; None if its unit is unknown."""
    if name in ("reflected", "air"):
        own = temperature_unit(word) if word else unit or "degC"
        return None if own is None else round(float(to_celsius(np.array([value]), own)[0][0]), 6)
    if name == "distance":
        factor = IN_METRES.get(word.lower().rstrip("."))
        return None if factor is None else value * factor
    if word not in ("", "%"):
        return None
    return value / 100 if word == "%" or (name == "humidity" and value > 1) else value


def find_unit(header: TextHeader, of_cells: str | None, said: str | None, values: np.ndarray) -> tuple[str | None, str]:
    """The unit of the values (degC, degF, K, mK; None if not stated) and a note on its source.

    `of_cells`: the unit after the numbers; `said`: that of the user.  BadInput if two of them differ, or if only other
    numbers of the file have a unit and it is not degC; ScaleMissing if the file states that it holds counts.
    """
    if header.unit and of_cells and header.unit != of_cells:
        raise BadInput(
            f"{_quote_line(header.line)} and the cells, in {of_cells}, state different units; repair the line or the"
            " cells"
        )
    own = of_cells or header.unit
    where = "the cells say" if of_cells else f"{_quote_line(header.line)} says"
    if own and said and temperature_unit(said) != own:
        raise BadInput(f"unit: --unit {said}, but {where} {own}; leave --unit out, or repair the file")
    if own or said:
        return own or said, f"{own}, as {where}" if own and not said else ""
    if header.counts:
        raise ScaleMissing("counts, as its header says; give --scale and --offset: T = scale count + offset in degC")
    known = values[np.isfinite(values)]
    units = {unit for *_, unit in header.quantities}
    if not known.size or not units:
        return None, ""
    ends = {"max": float(known.max()), "min": float(known.min()), "mean": float(known.mean())}
    for line, number, decimals, unit in header.quantities:
        if STATISTIC.search(line) and any(abs(number - end) <= 0.51 * 10.0**-decimals for end in ends.values()):
            return unit, f"{unit}, as {_quote_line(line)} says of these values"
    if units != {"degC"}:
        line = next(line for line, *_, unit in header.quantities if unit != "degC")
        raise BadInput(
            f"values {known.min():g} to {known.max():g} in a unit that the file does not say, while"
            f" {_quote_line(line)} is not in degC; give --unit degC, K or degF"
        )
    return None, ""
