"""Cells of text tables: numbers with either decimal sign, marks of a missing value, dates and times."""

from __future__ import annotations

import math
import re
from functools import lru_cache

MAX_NUMBER_LETTERS = 100
NUMBERS = {  # by whether commas are decimal; "20." is a number, "20," may be the end of a list
    False: re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][-+]?\d+)?", re.ASCII),
    True: re.compile(r"[-+]?(?:\d+(?:,\d+)?|,\d+)(?:[eEdD][-+]?\d+)?", re.ASCII),
}
UNIT_SUFFIX = re.compile(r"[ \u00a0]*((?:°|º|deg[ _]?)[CFK]|[CFK℃℉]|ms|msec|s|sec|min|h)$")
SCPI_MARK = re.compile(r"[-+]?9[.,]9(?:10*|0*)[eE]\+?37")
MISSING = re.compile(
    r"""
    (?=[^-]*-)[-.\ ]+ | \*+ | \?+ | \++ | \#{2,} | [<>].*
    | [-+]?(?:1[.,])?\#(?:qnan|snan|ind|inf)\d* | [-+]?1[.,]\#(?:qnan|snan|ind|inf)\d*
    | \#?n\.?/?a\.?!? | \#?nan | [-+]?inf(?:inity)? | null | none | no[ ]?data | missing | invalid | bad | k\.a\.
    | [-+]?o\.?l\.? | [-+]?(?:over|under)(?:[ _-]?(?:range|flow|load|ld))? | [-+]?(?:ovr|uvr|ovl|ovld|ovfl|unfl|ofl|ufl)
    | tc[ _-]?open | no[ ]?sensor | sensor[ ](?:error|fault|open) | n\.?c\.?
    | open(?:[ _-]?(?:circuit|tc|input|sensor|channel))? | short(?:ed)? | disc(?:onnected)?
    | burn[ _-]?out | b\.?out | err(?:or)?[.!]?(?:[ :_-]?\d{1,4})? | fault | fail(?:ed|ure)?
    | \#(?:value|ref|div/0|num|null|name|wert|zahl|bezug)[!?]? | fehler | offen | bruch
    """,
    re.IGNORECASE | re.VERBOSE,
)
DATE = (
    r"(?:\d{4}[-/.]\d{1,2}[-/.]\d{1,2}|\d{1,2}[-/.]\d{1,2}[-/.](?:\d{4}|\d{2})"
    r"|\d{1,2}[-/. ]{1,2}[^\W\d]{3,9}\.?[-/., ]{1,2}\d{2,4}|[^\W\d]{3,9}\.? {1,2}\d{1,2},? {1,2}\d{4})"
)
CLOCK = r"\d{1,4}:\d{2}(?::\d{2})?(?:[.,:]\d{1,30})?(?: ?[AaPp]\.?[Mm]\.?)?"
LOOKS_LIKE_TIME = re.compile(
    rf"\W{{0,2}}{DATE}\b.{{0,40}}|(?:\d+ days?,? )?\W{{0,2}}{CLOCK}\b.{{0,20}}", re.ASCII | re.DOTALL
)


def parse_number(cell: str, comma: bool) -> float | None:
    """The number in a cell, with a decimal comma or a decimal point; None for anything else and beyond any double.

    >>> parse_number("1e3", False), parse_number("2,5", True), parse_number("2,5", False), parse_number("1_0", False)
    (1000.0, 2.5, None, None)
    """
    if len(cell) > MAX_NUMBER_LETTERS or not NUMBERS[comma].fullmatch(cell):
        return None
    try:
        value = float(cell)
    except ValueError:  # a decimal comma, or an exponent of FORTRAN
        value = float(cell.replace(",", ".").replace("d", "e").replace("D", "e"))
    return value if math.isfinite(value) else None


def is_missing(cell: str) -> bool:
    """Whether a cell is a mark of a missing value: empty, "OL", "----", "#N/A", "Over Range", "1.#QNAN" and the like.

    SCPI-99 (volume 1, 7.2.1.4 and 7.2.1.5) writes 9.91E37 for "not a number" and 9.9E37 for infinity, the usual mark of
    an open thermocouple.  No plausible number, -9999 neither, counts as missing.

    >>> [is_missing(c) for c in ("", "OL", "----", "-9.9E+37", "9.91E37", "1.#QNAN", "-9999", "99", "Oil")]
    [True, True, True, True, True, True, False, False, False]
    """
    return len(cell) <= MAX_NUMBER_LETTERS and (not cell or _is_mark(cell))


@lru_cache(maxsize=4096)
def _is_mark(cell: str) -> bool:
    return SCPI_MARK.fullmatch(cell) is not None or MISSING.fullmatch(cell) is not None


def split_suffix(cell: str) -> tuple[str, str]:
    """A number and the unit behind it in the same cell, as "22.5 °C"; ("22.5", "") without one.

    >>> split_suffix("22.5 °C"), split_suffix("200ms"), split_suffix("22.5"), split_suffix("1O")
    (('22.5', '°C'), ('200', 'ms'), ('22.5', ''), ('1O', ''))
    """
    found = UNIT_SUFFIX.search(cell) if cell and not cell[-1].isdigit() else None
    if found is None or not found.start():
        return cell, ""
    return cell[: found.start()], found[1]


def is_value(cell: str, comma: bool) -> bool:
    """Whether a cell is a number, perhaps with its unit, a mark of a missing value, or a date or time."""
    if not cell or len(cell) > MAX_NUMBER_LETTERS:
        return False
    if NUMBERS[comma].fullmatch(cell):
        return True
    if LOOKS_LIKE_TIME.fullmatch(cell) or _is_mark(cell):
        return True
    number, unit = split_suffix(cell)
    return bool(unit) and NUMBERS[comma].fullmatch(number) is not None
