"""A parsed text table: rows of cells in named columns, with their numbers, units and positions in the file."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from flashtemp.errors import BadInput, shorten_text
from flashtemp.physics.tables import header
from flashtemp.physics.tables.cells import is_missing, parse_number, parse_numbers, split_suffix
from flashtemp.physics.tables.dialect import TableDialect
from flashtemp.physics.tables.header import TableColumn

POINT_OR_LOOSE_COMMA = re.compile(r"\.|,(?![0-9])")  # in cells with decimal commas
FAHRENHEIT_PATTERN = re.compile(r"(?<!\w)(?:°\s?F|℉|deg(?:ree)?s?[ ._]?F|fahrenheit|in F)(?!\w)", re.IGNORECASE)
SCPI_MARK_MIN = 9e37  # larger numbers may be SCPI marks of missing values


@dataclass(frozen=True)
class TextTable:
    """Rows of cells in named columns.  `where` begins messages, `lines` are the line numbers of the rows.

    `preamble` are pairs of key and value above the table, `notes` describe lines left out of it; `remarks` are the
    lines above and between the rows with their line numbers.
    """

    where: str
    dialect: TableDialect
    columns: tuple[TableColumn, ...]
    rows: list[tuple[str, ...]]
    lines: list[int]
    preamble: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = ()
    has_header: bool = False
    text_columns: frozenset[int] = field(default=frozenset())
    remarks: tuple[tuple[int, str], ...] = ()

    def cells(self, column: TableColumn) -> Sequence[str]:
        """The cells of a column."""
        return self._column_cells[column.number - 1]

    @cached_property
    def _column_cells(self) -> list[tuple[str, ...]]:
        return list(zip(*self.rows, strict=True))

    def locate_row(self, row: int) -> str:
        """File and line of a row (from 0), for messages."""
        return f"{self.where}:{self.lines[row]}"

    def numbers(self, column: TableColumn) -> np.ndarray:
        """The numbers of a column (rows,), NaN for missing values and infinity for words; units are ignored."""
        comma, cells = self.dialect.comma, self.cells(column)
        plain: Sequence[str] | None = cells
        if comma:
            no_comma = POINT_OR_LOOSE_COMMA.search("\n".join(cells)) is not None
            plain = None if no_comma else [c.replace(",", ".") for c in cells]
        values = None if plain is None else parse_numbers(plain)
        if values is not None and np.all(np.abs(values) < SCPI_MARK_MIN):
            return values
        known = {cell: _cell_value(cell, comma) for cell in set(cells)}
        return np.array([known[cell] for cell in cells], dtype=float)

    def read_quantity(self, column: TableColumn, wanted: str, unit: str | None = None) -> tuple[np.ndarray, str]:
        """Numbers of a column converted to the unit `wanted`, and their unit in the file, "" where none is stated.

        `unit` overrides the unit in the file.  Raises BadInput, naming line and cell, for words among the numbers and
        for units of another dimension.
        """
        values = self.numbers(column)
        if np.isinf(values).any():
            k = int(np.argmax(np.isinf(values)))
            cell = self.rows[k][column.number - 1]
            raise BadInput(
                f"{self.where}:{self.lines[k]}: {shorten_text(repr(cell))} in {_column_text(column)} is no number;"
                " repair that row"
            )
        stated = {split_suffix(c)[1] for c in self.cells(column) if c and not c[-1].isdigit() and not is_missing(c)}
        stated = (stated | self._units_in_next_column(column, wanted)) - {""}
        if len(stated) > 1:
            raise BadInput(f"{self.where}: {column}: units {' and '.join(sorted(stated))} in one column; give one unit")
        if unit is None:
            header.check_units_agree(column, wanted, self.where)
        unit = unit or (stated.pop() if stated else header.column_unit(column, wanted)[1])
        if unit.casefold() in header.UNITLESS_MARKS:
            return values, ""
        factor, offset = header.convert_unit(unit, wanted, f"{self.where}: {column}")
        return values * factor + offset, unit

    def _units_in_next_column(self, column: TableColumn, wanted: str) -> set[str]:
        """The units in the next column if it is named "Unit" or contains only units of several letters."""
        if column.number >= len(self.columns) or column.number + 1 not in self.text_columns:
            return set()
        neighbour = self.columns[column.number]
        texts = {cell for cell in self.cells(neighbour) if cell}
        is_named = re.search(r"unit|einheit", neighbour.label, re.IGNORECASE) is not None
        return texts if is_named or all(len(u) > 1 and header.is_unit_text(u, wanted) for u in texts) else set()

    def check_fahrenheit_remarks(self, remedy: str) -> None:
        """Raise BadInput where a remark mentions Fahrenheit but the temperature columns state no unit."""
        for number, text in self.remarks:
            if FAHRENHEIT_PATTERN.search(text) or "F" in (cell.strip(' "') for cell in re.split(r"[,;\t]", text)):
                quote = shorten_text(repr(" ".join(text.split())))
                raise BadInput(f"{self.where}:{number}: {quote} says Fahrenheit, the columns state no unit; {remedy}")

    def every_nth_row(self, step: int) -> TextTable:
        """The table with every `step`-th row."""
        return self if step == 1 else replace(self, rows=self.rows[::step], lines=self.lines[::step])


def _cell_value(cell: str, comma: bool) -> float:
    """The number in a cell, NaN for a missing value, infinity for a word."""
    value = parse_number(cell, comma)
    if value is not None and abs(value) < SCPI_MARK_MIN:
        return value
    if is_missing(cell):
        return np.nan
    value = parse_number(split_suffix(cell)[0], comma)
    return np.inf if value is None else value


def _column_text(column: TableColumn) -> str:
    return f"column {column.number}"
