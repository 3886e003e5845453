"""Cells of exported text files: numbers with either decimal sign, units, marks of missing values, dates."""

from __future__ import annotations

import contextlib
import csv
import re
from collections import Counter
from datetime import datetime

import numpy as np

MAX_CELL_LENGTH = 64  # characters of a cell that can be a number, a mark or a label
MIN_MISSING_MARK = 9.9e37  # SCPI-1999 volume 1, 7.2.1: 9.9E37 is infinity, 9.91E37 not a number
_NUMBER_REGEX = r"[-+]?(?:[0-9]+(?:[.,][0-9]*)?|[.,][0-9]+)(?:[eE][-+]?[0-9]+)?"
_UNIT_REGEX = (
    r"[^\S\n]*(?:°[^\S\n]*[CFK]?|o[CF]|(?i:deg(?:rees?|\.)?[^\S\n]*(?:celsius|fahrenheit|kelvins?|[cfk]))"
    r"|(?i:celsius|fahrenheit|kelvins?)|mK|[CKF])"
)
_MARK_REGEX = (
    r"(?i:-+|[<>].*|\*+|\?+|[-+]?nan(?:\(ind\))?|[-+]?inf(?:inity)?|[-+]?1\.#(?:qnan|snan|ind|inf)\d*|#?n/[av]|#?na|#nv"
    r"|#(?:num|value|wert|zahl|ref|bezug|div/0)!|#div/0|null|none|under.*|over.*|out of range|[-+]?o\.?l\.?|ovld?|ovf"
    r"|err(?:or)?|open|invalid|missing|fault)"
)
CELL_NUMBER = re.compile(_NUMBER_REGEX)
CELL_UNIT = re.compile(f"{_UNIT_REGEX}$")
NO_VALUE = re.compile(f"(?:{_MARK_REGEX}|)")
NUMERIC = re.compile(
    f"^(?=.{{1,{MAX_CELL_LENGTH}}}$)(?:{_NUMBER_REGEX}(?:{_UNIT_REGEX})?|{_MARK_REGEX})$", re.MULTILINE
)  # of a cell per line
WITH_UNIT = re.compile(f"^(?=.{{1,{MAX_CELL_LENGTH}}}$){_NUMBER_REGEX}({_UNIT_REGEX})$", re.MULTILINE)
OF_UNIT = re.compile(r"[°CFKcfknst]\n|[°CFKcfknst]$").search  # quick test whether any cell can end with a unit
QUOTED = re.compile(r'"((?:[^"]|"")*)"|(\S+)')  # cells separated by blanks
DATE_TIME_PATTERN = re.compile(r"(\d{4})-(\d\d)-(\d\d)[ T_](\d\d):(\d\d):(\d\d)(?:[.,](\d{1,9}))?", re.ASCII)
PLAIN_NUMBER_CHARACTERS = frozenset("0123456789.+-eE")  # of plain numbers
UNIX_EPOCH = datetime(1970, 1, 1)


def split_cells(line: str, separator: str | None) -> list[str]:
    """Cells of a line, with quotes by RFC 4180; a separator at its end makes one empty cell.

    >>> split_cells('"25,03","25,01",-', ","), split_cells('"25,03" 25', None)
    (['25,03', '25,01', '-'], ['25,03', '25'])
    """
    if '"' not in line:
        return [c.strip() for c in line.split(separator)]
    if separator is None:
        return [(quoted or bare).replace('""', '"').strip() for quoted, bare in QUOTED.findall(line)]
    try:
        return [c.strip() for c in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]
    except (csv.Error, StopIteration, TypeError, ValueError):  # an open quote, or an invalid delimiter
        return [c.strip().strip('"') for c in line.split(separator)]


def is_number(cell: str) -> bool:
    """Whether a cell is a number, perhaps with its unit."""
    return len(cell) <= MAX_CELL_LENGTH and CELL_NUMBER.fullmatch(CELL_UNIT.sub("", cell)) is not None


def count_numeric(row: list[str]) -> int:
    """Number of cells that are numbers or marks of missing values."""
    return len(NUMERIC.findall("\n".join(row)))


def is_mostly_numbers(row: list[str], most: int = 40) -> bool:
    """Whether more than half of a row's first cells are numbers or marks."""
    return count_numeric(row[:most]) > 0.5 * len(row[:most])


def count_units(rows: list[list[str]]) -> Counter[str]:
    """Units after the numbers of cells, as they are written, and their counts."""
    texts = ["\n".join(row) for row in rows]
    found = Counter(unit.strip() for text in texts if OF_UNIT(text) for unit in WITH_UNIT.findall(text))
    return Counter({unit: n for unit, n in found.items() if unit != "°"})


def parse_cells(rows: list[list[str]], separator: str | None, comma: bool) -> np.ndarray:
    """Numbers of cells (rows, columns); NaN for a mark of a missing value, infinity for a word."""
    if comma:
        rows = [[c.replace(",", ".") for c in row] for row in rows]
    if not set("".join("".join(row) for row in rows)) - PLAIN_NUMBER_CHARACTERS:
        with contextlib.suppress(ValueError):
            return mask_missing_marks(np.array([list(map(float, row)) for row in rows]))
    return mask_missing_marks(np.array([[_parse_cell(c) for c in row] for row in rows]))


def mask_missing_marks(values: np.ndarray) -> np.ndarray:
    """Values with NaN for the numbers that instruments write for missing values."""
    with np.errstate(invalid="ignore"):
        return np.where((np.abs(values) >= MIN_MISSING_MARK) & np.isfinite(values), np.nan, values)


def _parse_cell(cell: str) -> float:
    if len(cell) > MAX_CELL_LENGTH:
        return np.inf
    if CELL_NUMBER.fullmatch(cell):
        try:
            return float(cell)
        except ValueError:  # a decimal comma where points are decimal
            return np.inf
    if NO_VALUE.fullmatch(cell):
        return np.nan
    bare = CELL_UNIT.sub("", cell)
    return float(bare) if CELL_NUMBER.fullmatch(bare) and "," not in bare else np.inf


def parse_clock(text: str) -> float | None:
    """Seconds since 1970 of a date and time like 2024-05-31 12:00:03.25; None where there is none.

    >>> parse_clock("start 1970-01-02T00:00:01.5")
    86401.5
    """
    found = DATE_TIME_PATTERN.search(text)
    if not found:
        return None
    try:
        year, month, date, hour, minute, second = (int(p) for p in found.groups()[:6])
        day = datetime(year, month, date, hour, minute, second)
    except ValueError:
        return None
    return (day - UNIX_EPOCH).total_seconds() + float("0." + (found.group(7) or "0"))
