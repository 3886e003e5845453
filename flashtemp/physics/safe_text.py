"""Read text files of numbers safely: file size and line length are checked before parsing."""

from __future__ import annotations

import math
import re
from pathlib import Path

from flashtemp.errors import BadInput, shorten_text

MAX_TABLE_BYTES = 100 * 10**6  # largest table file; its numbers take ten times that in memory
MAX_LINE_LETTERS = 10**6  # characters
MAX_PLAIN_NUMBER_LETTERS = 100  # characters
PLAIN_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?", re.ASCII)
UNDEFINED = ("nan", "inf", "infinity")
LETTERS_OF_MISTYPED_NUMBERS = frozenset("0123456789OoIlS.,eEdD+-−")  # characters of damaged or mistyped numbers


def read_bounded_bytes(path: Path, where: str) -> bytes:
    """The bytes of a text file.  Raises BadInput, beginning with `where`, if it is too large or cannot be read."""
    try:
        if (size := path.stat().st_size) > MAX_TABLE_BYTES:
            limit = MAX_TABLE_BYTES / 1e6
            raise BadInput(f"{where}: {size / 1e6:.0f} MB; a table may have {limit:.0f} MB: give the relevant part")
        return path.read_bytes()
    except OSError as fault:
        raise BadInput(f"{where}: cannot be read ({fault.strerror}); give a readable file") from fault


def split_bounded_lines(text: str, where: str) -> list[str]:
    """The lines of a text.  Raises BadInput for one of more than `MAX_LINE_LETTERS` characters."""
    found = text.splitlines()
    for number, line in enumerate(found, 1):
        if len(line) > MAX_LINE_LETTERS:
            raise BadInput(
                f"{where}:{number}: a line of {len(line)} characters; give one row of numbers per line, no line longer"
                f" than {MAX_LINE_LETTERS}"
            )
    return found


def parse_plain_number(cell: str) -> float | None:
    """The number in a cell with a decimal point; None for anything else.

    >>> parse_plain_number("1e3"), parse_plain_number("O.1"), parse_plain_number("1_0"), parse_plain_number("nan")
    (1000.0, None, None, nan)
    """
    if len(cell) > MAX_PLAIN_NUMBER_LETTERS:
        return None
    if PLAIN_NUMBER.fullmatch(cell):
        return float(cell)
    return math.nan if cell.lower().lstrip("+-") in UNDEFINED else None


def is_mistyped_number(cell: str) -> bool:
    """Whether a cell that is not a number was probably meant as one: a letter O for a zero, a second point.

    >>> is_mistyped_number("O.1"), is_mistyped_number("1.2.3"), is_mistyped_number("speed"), is_mistyped_number("Oil")
    (True, True, False, False)
    """
    return any(c.isdigit() or c == "." for c in cell) and set(cell) <= LETTERS_OF_MISTYPED_NUMBERS


def format_cells(cells: list[str]) -> str:
    """Text of a row of cells for a message."""
    return shorten_text(repr(cells))
