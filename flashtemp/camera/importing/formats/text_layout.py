"""Layout of a text file: its separator, its decimal sign, and the rows of its images."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flashtemp.camera.image_validation import MAX_CAMERA_DEGC
from flashtemp.camera.importing.formats.cell_parsing import (
    CELL_UNIT,
    NO_VALUE,
    count_numeric,
    is_mostly_numbers,
    parse_cells,
    split_cells,
)
from flashtemp.camera.importing.formats.text_labels import is_evenly_spaced
from flashtemp.errors import BadInput, shorten_text

SEPARATOR_WORDS = {"\t": "TAB", ";": "';'", ",": "','", None: "spaces"}
SEPARATOR_LINES, SEPARATOR_CHARACTERS = 20, 4000  # lines from which the separator is found, characters of each
COMMENT = ("#", "%", "//", "!")
ASK_DECIMAL = "say which with --decimal comma or --decimal point, or export with TAB or ';' between the values"
EXPORT_REMEDY = "copy it again or export it anew and give that"
THOUSANDS_GROUPS = re.compile(r"[-+]?\d{1,3}(?:,\d{3})+")  # a number as thousands separators would have it
NUMBER_LIKE = re.compile(r"[-+]?[.,]?\d").match
THOUSANDS = re.compile(r"(?<!\d)\d{1,3}(?:\.\d{3}){1,4},\d|(?<!\d)\d{1,3}(?:['\u2019]\d{3}){1,4}(?!\d)")
SEVERAL_MARKS = re.compile(r"[.,]\d*[.,]|'")  # of a number with thousands separators: two marks, or an apostrophe


@dataclass(frozen=True)
class RowBlock:
    """Consecutive rows of cells, and the line number of each, from 1."""

    rows: list[list[str]]
    lines: list[int]


@dataclass(frozen=True)
class TextLayout:
    """Blocks of rows, the separator of cells (None: blanks), whether commas are decimal, and all other lines.

    `others`: number from 1 and text of lines that are no rows; `edge`: a row of labels directly above the first block,
    one cell shorter than its rows.
    """

    blocks: tuple[RowBlock, ...]
    separator: str | None
    comma: bool
    others: tuple[tuple[int, str], ...]
    edge: list[str] | None = None

    @property
    def rows(self) -> list[list[str]]:
        """Rows of all blocks."""
        return [row for block in self.blocks for row in block.rows]


def read_layout(lines: Sequence[str], decimal: str | None, ended: bool) -> TextLayout:
    """The layout of a text; `decimal`: "comma" or "point" if the user states it; `ended`: it has a final line end.

    Raises BadInput with the line for rows of another width, and if decimal and other commas cannot be distinguished.
    """
    lines = _without_outer_quotes(lines)
    separator = _find_separator(lines)
    split = [split_cells(line, separator) for line in lines]
    comment = [_is_comment(line, row, separator) for line, row in zip(lines, split, strict=True)]
    wide = [k for k, c in enumerate(split) if len(c) > 1 and not comment[k] and is_mostly_numbers(c)]
    if not wide:
        raise BadInput(
            "no matrix of numbers in it; give files with a row of numbers per line, or a pattern that leaves this out"
        )
    columns = _count_columns(split, wide, separator)
    inside = {
        k: row for k in range(len(lines)) if not comment[k] and (row := _matrix_row(split[k], columns)) is not None
    }
    first, last = _find_matrix_lines([k for k in wide if k in inside], inside)
    blocks: list[RowBlock] = []
    others: list[tuple[int, str]] = []
    for k, line in enumerate(lines):
        if first <= k <= last and k in inside and _has_values(inside[k]):
            if not (blocks and blocks[-1].lines[-1] == k):
                blocks.append(RowBlock([], []))
            blocks[-1].rows.append(inside[k])
            blocks[-1].lines.append(k + 1)
            continue
        others.append((k + 1, line))
        if not comment[k] and line.strip():
            after = k == last + 1 or first < k < last
            _refuse_part_of_row(split[k], k, columns, 0.0 if after else 0.5)
    rows = [row for block in blocks for row in block.rows]
    comma = _has_decimal_commas(
        rows, separator, decimal, any('"' in lines[k - 1] for k in blocks[0].lines[:SEPARATOR_LINES])
    )
    if not ended and last == len(lines) - 1:
        _refuse_loose_end(rows, comma)
    elif not ended and last == len(lines) - 2 and not any(c.isalpha() for c in lines[-1]):
        raise BadInput(f"it ends with {lines[-1][:40]!r} and without a line end: cut off; {EXPORT_REMEDY}")
    edge = (
        split[first - 1]
        if first and len(split[first - 1]) == columns - 1 and _is_evenly_counting(split[first - 1])
        else None
    )
    return TextLayout(tuple(blocks), separator, comma, tuple(others), edge)


def _is_comment(line: str, row: list[str], separator: str | None) -> bool:
    """Whether a line is a remark by its first character; ';' begins one if it is not the separator.

    A first cell like "#N/A" marks a missing value, one of "#" alone is the name of a column of numbers.
    """
    text = line.lstrip()
    if len(row) > 1 and (row[0] in COMMENT or NO_VALUE.fullmatch(row[0])):
        return False
    return text.startswith(COMMENT) or (text.startswith(";") and separator != ";")


def _without_outer_quotes(lines: Sequence[str]) -> list[str]:
    """Lines without quotes around whole rows, which spreadsheets write for a row in one cell."""
    whole = [len(t) > 2 and t[0] == t[-1] == '"' and t.count('"') == 2 for t in map(str.strip, lines)]
    if 2 * sum(whole) <= sum(bool(line.strip()) for line in lines):
        return list(lines)
    return [line.strip()[1:-1] if one else line for line, one in zip(lines, whole, strict=True)]


def _find_separator(lines: Sequence[str]) -> str | None:
    """The separator that splits a sample of lines into most numbers: those with most digits, and some of all."""
    filled = [line[:SEPARATOR_CHARACTERS] for line in lines if line.strip()]
    sample = [
        *sorted(filled, key=_count_digits, reverse=True)[:SEPARATOR_LINES],
        *filled[:: max(1, len(filled) // SEPARATOR_LINES)],
    ]

    def clear(separator) -> int:
        split = [split_cells(line, separator) for line in sample]
        return sum(n if (n := count_numeric(c)) > 0.5 * len(c) and len(c) > 1 else 0 for c in split)

    clearest = {separator: clear(separator) for separator in SEPARATOR_WORDS}
    separator = max(clearest, key=lambda separator: clearest[separator])
    if not clearest[separator]:
        if any(THOUSANDS.search(line) for line in sample):
            raise BadInput(
                "no matrix of numbers in it, but numbers with thousands separators; export them without and give that"
            )
        raise BadInput(
            "no matrix of numbers in it; give files with a row of numbers per line, or a pattern that leaves this out"
        )
    return separator


def _count_digits(line: str) -> int:
    return sum(map(line.count, "0123456789"))


def _count_columns(split: list[list[str]], wide: list[int], separator: str | None) -> int:
    """Number of columns, without empty cells from separators at the ends of rows."""
    counts = np.bincount([len(split[k]) for k in wide])
    columns = int(np.argmax(counts * np.arange(len(counts))))
    full = [split[k] for k in wide if len(split[k]) == columns]
    while separator is not None and columns > 2 and sum(not row[columns - 1] for row in full) > 0.9 * len(full):
        columns -= 1
    return columns


def _matrix_row(row: list[str], columns: int) -> list[str] | None:
    """The first `columns` cells of a row if nothing or a remark follows them, else None."""
    if len(row) < columns or any(cell and (cell[0].isdigit() or count_numeric([cell])) for cell in row[columns:]):
        return None
    return row[:columns]


def _has_values(row: list[str]) -> bool:
    """Whether a row of the image's width has more numbers and marks than words."""
    numbers = count_numeric(row)
    return numbers > 0 and numbers > sum(map(bool, row)) - numbers


def _find_matrix_lines(wide: list[int], inside: dict[int, list[str]]) -> tuple[int, int]:
    """First and last line of the matrix, with rows that have only a few numbers."""
    first, last = wide[0], wide[-1]
    while first - 1 in inside and _has_values(inside[first - 1]):
        first -= 1
    while last + 1 in inside and _has_values(inside[last + 1]):
        last += 1
    return first, last


def _refuse_part_of_row(row: list[str], k: int, columns: int, fraction: float) -> None:
    """BadInput if a line next to the matrix is part of a row: numbers, more than a `fraction` of a row, but fewer."""
    if len(row) > fraction * columns and count_numeric(row) > 0.5 * len(row) and not _is_evenly_counting(row):
        what = shorten_text(" ".join(row[:4]))
        raise BadInput(
            f"line {k + 1} has {len(row)} values ({what}{' ...' if len(row) > 4 else ''}), others {columns}; the file"
            f" is cut off or damaged: {EXPORT_REMEDY}"
        )


def _is_evenly_counting(row: list[str]) -> bool:
    """Whether the cells of a line count evenly, like numbers or positions of columns."""
    if len(row) < 3:
        return False
    for comma in (False, True):
        values = parse_cells([row], None, comma)[0]
        if np.isfinite(values).all():
            return is_evenly_spaced(values)
    return False


def _refuse_loose_end(rows: list[list[str]], comma: bool) -> None:
    """BadInput if the text, without a final line end, ends inside its last number: one shorter than most others."""

    def decimals(cell: str) -> int:
        return len(cell.rpartition("," if comma else ".")[2]) if ("," if comma else ".") in cell else 0

    others = [c for row in rows for c in row[-1:]]
    usual = int(np.median([decimals(c) for c in others]))
    if decimals(rows[-1][-1]) < usual or (not rows[-1][-1] and any(others[:-1])):
        raise BadInput(f"it ends with {rows[-1][-1]!r} and without a line end: cut off; {EXPORT_REMEDY}")


def _has_decimal_commas(rows: list[list[str]], separator: str | None, decimal: str | None, quoted: bool) -> bool:
    """Whether commas inside of cells are decimal signs.

    RFC 4180 puts a cell with a comma between quotes, so that it stays one cell if commas separate cells.  Raises
    BadInput for thousands separators, for both signs in one file, and if a comma could be either.
    """
    numbers = [c if c[-1].isdigit() else CELL_UNIT.sub("", c) for row in rows for c in row if NUMBER_LIKE(c)]
    commas = [c for c in numbers if "," in c]
    points = [c for c in numbers if "." in c]
    if double := next((c for c in (*commas, *points) if SEVERAL_MARKS.search(c)), None):
        raise BadInput(
            f"{shorten_text(double)!r} has a thousands separator; export the numbers without it and give that"
        )
    if commas and points:
        raise BadInput(
            f"{shorten_text(commas[0])!r} has a comma and {shorten_text(points[0])!r} a point: one is no decimal sign;"
            " export all numbers with one sign and without thousands separators and give that"
        )
    said = {"comma": points, "point": commas}.get(decimal or "", [])
    if said and (decimal == "comma" or separator != ","):
        raise BadInput(
            f"decimal: {decimal} said, but {shorten_text(said[0])!r} is in the file; leave --decimal out or correct it"
        )
    if separator == "," and not commas:
        if decimal == "comma" or (decimal is None and not points and len(rows[0]) % 2 == 0):
            raise BadInput(f"commas between whole numbers could be decimal commas; {ASK_DECIMAL}")
        return False
    grouped = separator == "," and quoted and decimal is None and all(map(THOUSANDS_GROUPS.fullmatch, commas))
    if grouped and all(abs(float(c.replace(",", ""))) <= MAX_CAMERA_DEGC for c in commas):
        raise BadInput(
            f"{shorten_text(commas[0])!r} could be {commas[0].replace(',', '')} or {commas[0].replace(',', '.')}; say"
            " --decimal comma, or export the numbers without thousands separators"
        )
    return bool(commas)
