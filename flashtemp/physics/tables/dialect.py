"""Detect the dialect of a text table: the separator of cells and the decimal sign (quotes as in RFC 4180)."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from flashtemp.physics.tables.cells import is_value

SAMPLE_LINES = 100  # lines at the end of a file, and as many spread over it
SAMPLE_LETTERS = 4000  # characters of a line
MAX_QUOTED_LINES = 6  # lines that a quoted cell may span
SEPARATOR_LETTERS = " ,;\t|"  # characters that a cell of digits does not contain in the right dialect
SEPARATOR_NAMES = {"\t": "TAB", ";": "';'", ",": "','", "|": "'|'", " ": "spaces"}


@dataclass(frozen=True)
class TableDialect:
    """Separator of cells (" " means any white space) and whether commas are decimal."""

    separator: str
    comma: bool

    def __str__(self) -> str:
        return f"{SEPARATOR_NAMES[self.separator]} between the values" + (", decimal commas" if self.comma else "")


class TableLine(NamedTuple):
    """A line of a file: its number from 1, its text and its cells."""

    number: int
    text: str
    cells: tuple[str, ...]


TABLE_DIALECTS = tuple(
    TableDialect(separator, comma)
    for separator, comma in (
        ("\t", False), ("\t", True), (";", False), (";", True), (",", False), (",", True), ("|", False), ("|", True),
        (" ", False), (" ", True),
    )
)  # fmt: skip


def split_cells(line: str, separator: str) -> list[str]:
    """Cells of a line without blanks around them; quotes as in RFC 4180, so that "25,03" is one cell.

    >>> split_cells('"25,03","25,01", x', ","), split_cells(" 1  2 ", " "), split_cells("1;2;", ";")
    (['25,03', '25,01', 'x'], ['1', '2'], ['1', '2', ''])
    """
    if separator == " ":
        return line.split() if '"' not in line else [c.strip() for c in _split_quoted(" ".join(line.split()), " ")]
    if '"' not in line:
        return [cell.strip() for cell in line.split(separator)]
    return [cell.strip() for cell in _split_quoted(line, separator)]


def _split_quoted(line: str, separator: str) -> list[str]:
    try:
        return next(csv.reader([line], delimiter=separator, skipinitialspace=True, strict=True), [""])
    except csv.Error:  # an unclosed quote, or text after one
        return line.split(separator)


def split_lines(lines: Sequence[str], dialect: TableDialect) -> list[TableLine]:
    """Lines with their cells; a quoted cell may span several lines."""
    if not any('"' in line for line in lines):
        sign = dialect.separator
        if sign == " ":
            return [TableLine(number, text, tuple(text.split())) for number, text in enumerate(lines, 1)]
        return [
            TableLine(number, text, tuple([c.strip() for c in text.split(sign)]) if text and not text.isspace() else ())
            for number, text in enumerate(lines, 1)
        ]
    out: list[TableLine] = []
    at = 0
    while at < len(lines):
        text, number = lines[at], at + 1
        if text.count('"') % 2 and dialect.separator != " ":
            for more in range(1, min(MAX_QUOTED_LINES, len(lines) - at)):
                joined = "\n".join(lines[at : at + more + 1])
                if joined.count('"') % 2 == 0 and _has_closed_quotes(joined, dialect.separator):
                    text, at = joined, at + more
                    break
        out.append(
            TableLine(number, text, tuple(" ".join(c.split()) if "\n" in c else c for c in _line_cells(text, dialect)))
        )
        at += 1
    return out


def _line_cells(text: str, dialect: TableDialect) -> list[str]:
    return split_cells(text, dialect.separator) if text.strip() else []


def _has_closed_quotes(text: str, separator: str) -> bool:
    """Whether a text over several lines is one record with closed quotes."""
    try:
        return len(list(csv.reader(text.split("\n"), delimiter=separator, skipinitialspace=True, strict=True))) == 1
    except csv.Error:
        return False


def detect_dialect(lines: Sequence[str], comma: bool | None = None) -> TableDialect | None:
    """The dialect in which most cells are values, None without values; `comma` states whether commas are decimal."""
    filled = [line[:SAMPLE_LETTERS] for line in lines if line.strip() and line.lstrip()[0] not in "#%"]
    sample = [*filled[-SAMPLE_LINES:], *filled[:: max(1, len(filled) // SAMPLE_LINES)]]
    known = [d for d in TABLE_DIALECTS if comma is None or d.comma is comma]
    clear = {d: sum(_count_clear_values(line, d) for line in sample) for d in known}
    best = max(known, key=lambda d: clear[d])
    if clear[best]:
        return best
    single = {d: sum(is_value(line.strip(), d.comma) for line in sample) for d in known if d.separator == ","}
    best = max(single, key=lambda d: single[d])  # a file of one column
    return best if single[best] else None


def _count_clear_values(line: str, dialect: TableDialect) -> int:
    """Number of cells of a line that are values; 0 where other separators remain between digits."""
    cells = [c for c in split_cells(line, dialect.separator) if c]
    if len(cells) < 2:
        return 0
    values = 0
    for cell in cells:
        if is_value(cell, dialect.comma):
            values += 1
        elif (
            any(c.isdigit() for c in cell) and not any(c.isalpha() for c in cell) and set(cell) & set(SEPARATOR_LETTERS)
        ):
            return 0
    return values if 2 * values >= len(cells) else 0
