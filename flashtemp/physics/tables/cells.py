"""Recognise cells of text tables: numbers with decimal point or comma, marks of missing values, dates and times."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

MAX_NUMBER_LETTERS = 100
# By whether commas are decimal.  "20." is a number, "20," may be the end of a list; some formats pad "+ 22.5".
NUMBER_BY_COMMA = {
    False: re.compile(r"(?:[-+] {0,8})?(?:\d+\.?\d*|\.\d+)(?:[eEdD][-+]?\d+)?", re.ASCII),
    True: re.compile(r"(?:[-+] {0,8})?(?:\d+(?:,\d+)?|,\d+)(?:[eEdD][-+]?\d+)?", re.ASCII),
}
UNIT_SUFFIX = re.compile(r"[ \u00a0]*((?:°|º|deg[ _]?)[CFK]|[CFK℃℉]|ms|msec|s|sec|min|h)$")
SCPI_MARK = re.compile(r"[-+]?9[.,]9(?:10*|0*)[eE]\+?37")
_OF_DIGITS = re.compile(r"[eE]\+?37")
_ZEROS = str.maketrans("123456789", "000000000")
PLAIN_NUMBER_LETTERS = frozenset("0123456789+-.eE")  # with these alone, float() and `parse_number` agree
MISSING_MARK = re.compile(
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
DATE_PATTERN = (
    r"(?:[0-9]{4}[-/.][0-9]{1,2}[-/.][0-9]{1,2}|[0-9]{1,2}[-/.][0-9]{1,2}[-/.](?:[0-9]{4}|[0-9]{2})"
    r"|[0-9]{1,2}[-/. ]{1,2}[^\W\d]{3,9}\.?[-/., ]{1,2}[0-9]{2,4}|[^\W\d]{3,9}\.? {1,2}[0-9]{1,2},? {1,2}[0-9]{4})"
)
CLOCK_PATTERN = r"[0-9]{1,4}:[0-9]{2}(?::[0-9]{2})?(?:[.,:][0-9]{1,30})?(?: ?[AaPp]\.?[Mm]\.?)?"
LOOKS_LIKE_TIME = re.compile(
    rf"\W{{0,2}}{DATE_PATTERN}(?:\b|(?=T[0-9])).{{0,40}}"
    rf"|(?:[0-9]+ days?,? )?\W{{0,2}}{CLOCK_PATTERN}(?:\b|(?=Z)).{{0,20}}",
    re.DOTALL,
)


def shape_of(text: str) -> str:
    """A text with 0 for every digit.  The kind of a cell depends on its shape only, unless `has_marks_of_digits`.

    >>> shape_of("2024-05-31 14:03;22.5 °C")
    '0000-00-00 00:00;00.0 °C'
    """
    return text.translate(_ZEROS)


def has_marks_of_digits(text: str) -> bool:
    """Whether a text may contain marks of a missing value with certain digits, as 9.9E37 and 1.#QNAN."""
    return "#" in text or _OF_DIGITS.search(text) is not None


def parse_numbers(cells: Sequence[str]) -> np.ndarray | None:
    """The numbers (n,) of cells with plain decimal points, as by `parse_number`; None if any cell is not plain."""
    if not set("".join(cells)) <= PLAIN_NUMBER_LETTERS:
        return None
    try:
        values = np.array(list(map(float, cells)))
    except ValueError:
        return None
    longest = max(map(len, cells), default=0)
    return values if longest <= MAX_NUMBER_LETTERS and np.all(np.isfinite(values)) else None


def parse_number(cell: str, comma: bool) -> float | None:
    """The number in a cell, with a decimal comma or a decimal point; None for anything else and for infinity.

    >>> parse_number("1e3", False), parse_number("2,5", True), parse_number("2,5", False), parse_number("1_0", False)
    (1000.0, 2.5, None, None)
    >>> parse_number("+  22.5", False), parse_number("- 1,5D+01", True), parse_number("2 2.5", False)
    (22.5, -15.0, None)
    """
    if len(cell) > MAX_NUMBER_LETTERS or not NUMBER_BY_COMMA[comma].fullmatch(cell):
        return None
    try:
        value = float(cell)
    except ValueError:  # a decimal comma, a Fortran exponent, blanks after the sign
        value = float(cell.replace(",", ".").replace("d", "e").replace("D", "e").replace(" ", ""))
    return value if math.isfinite(value) else None


def is_missing(cell: str) -> bool:
    """Whether a cell is a mark of a missing value: empty, "OL", "----", "#N/A", "Over Range", "1.#QNAN" and the like.

    SCPI-99 (volume 1, 7.2.1.4 and 7.2.1.5) writes 9.91E37 for "not a number" and 9.9E37 for infinity, the usual mark of
    an open thermocouple.  Plausible numbers such as -9999 do not count as missing.

    >>> [is_missing(c) for c in ("", "OL", "----", "-9.9E+37", "9.91E37", "1.#QNAN", "-9999", "99", "Oil")]
    [True, True, True, True, True, True, False, False, False]
    """
    return len(cell) <= MAX_NUMBER_LETTERS and (not cell or _is_missing_mark(cell))


@lru_cache(maxsize=4096)
def _is_missing_mark(cell: str) -> bool:
    return SCPI_MARK.fullmatch(cell) is not None or MISSING_MARK.fullmatch(cell) is not None


def split_suffix(cell: str) -> tuple[str, str]:
    """A number and the unit after it in the same cell, as "22.5 °C"; ("22.5", "") without a unit.

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
    if NUMBER_BY_COMMA[comma].fullmatch(cell):
        return True
    if LOOKS_LIKE_TIME.fullmatch(cell) or _is_missing_mark(cell):
        return True
    number, unit = split_suffix(cell)
    return bool(unit) and NUMBER_BY_COMMA[comma].fullmatch(number) is not None
