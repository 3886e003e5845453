"""Find the columns that a key requires, by their names or their order, and convert them to the unit of the key."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flashtemp.errors import BadInput, shorten_text
from flashtemp.physics.safe_text import format_cells as show_cells
from flashtemp.physics.tables import header
from flashtemp.physics.tables.cells import is_missing, parse_number, split_suffix
from flashtemp.physics.tables.header import TableColumn
from flashtemp.physics.tables.text_table import TextTable
from flashtemp.physics.tables.timestamps import parse_moments, parse_stamp


@dataclass(frozen=True)
class RequiredColumn:
    """A quantity of a key, its unit, and the pattern of its `names` in headers, in letters and digits."""

    name: str
    unit: str
    names: str

    def __str__(self) -> str:
        return f"{self.name} in {self.unit}" if self.unit != "1" else self.name


TIME = RequiredColumn("time", "s", header.TIME_WORDS)
SPEED = RequiredColumn(
    "speed", "m/s", r"v\d?|u|speed|velocity|slidingspeed|slidingvelocity|geschwindigkeit|vs|vel|vslide|vx"
)
PRESSURE = RequiredColumn(
    "pressure", "Pa", r"p\d?|pressure|contactpressure|nominalpressure|druck|pressung|pn|p0|sigma|load"
)
TEMPERATURE = RequiredColumn(
    "temperature",
    "degC",
    r"t\d*|tc\d*|temp\d*|temperature\d*|temperatur\d*|ts|tspot|tsurf|surfacetemperature|theta|degc",
)
FRICTION = RequiredColumn(
    "friction coefficient", "1", r"mu|μ|µ|cof|friction|frictioncoefficient|coefficientoffriction|reibwert|reibbeiwert|f"
)
PLACE_X = RequiredColumn("x", "m", r"x|position|place|distance|abscissa|pos|location")
PLACE_Y = RequiredColumn("y", "m", r"y|position|place|distance|pos|location")
WORN_DEPTH = RequiredColumn("worn depth", "m", r"worn|worndepth|wear|depth|w|z|h|height|verschleiss|weardepth|profile")
RELATIVE_PRESSURE = RequiredColumn(
    "relative pressure", "1", r"relativepressure|relative|rel|p|pressure|ratio|factor|prel|weight"
)
RELATIVE_VALUE = RequiredColumn(
    "relative value", "1", r"relative.*|rel|ratio|factor|share|course|place|irradiance|weight|g|q"
)
CONDUCTANCE = RequiredColumn(
    "conductance", "W/m2K", r"alpha|α|h|htc|conductance|a|hc|heattransfercoefficient|contactconductance"
)
SHARE = RequiredColumn("share", "1", r"share|fraction|weight|shares|part")
SOURCE_DEPTH = RequiredColumn("depth", "m", r"depth|d|z|sourcedepth")
VOCABULARY = (TIME, SPEED, PRESSURE, TEMPERATURE, FRICTION)  # quantities whose names exclude another quantity


def read_required_columns(table: TextTable, required: Sequence[RequiredColumn]) -> np.ndarray:
    """The required quantities (rows, quantities), each in its unit.

    Raises BadInput, naming the line and the cell, where names contradict the required quantities, columns are missing,
    cells are not finite numbers, or units have another dimension.
    """
    columns = find_columns(table, required)
    out = np.empty((len(table.rows), len(required)))
    for j, (column, quantity) in enumerate(zip(columns, required, strict=True)):
        _check_cells(table, column, quantity)
        out[:, j] = _column_values(table, column, quantity)
    return out


def note_assumed_units(table: TextTable, required: Sequence[RequiredColumn]) -> list[str]:
    """Notes on assumed units in a table that states the units of other columns."""
    columns = find_columns(table, required)
    stated = [header.column_unit(column, quantity.unit)[1] for column, quantity in zip(columns, required, strict=True)]
    if not any(stated):
        return []
    return [
        f"{column}: unit not stated, taken as {quantity.unit}"
        for column, quantity, unit in zip(columns, required, stated, strict=True)
        if not unit and quantity.unit != "1"
    ]


def find_columns(table: TextTable, required: Sequence[RequiredColumn]) -> list[TableColumn]:
    """The column of every required quantity: by name, a single remaining one by elimination, or by order.

    Raises BadInput.
    """
    named = (
        [_matching_columns(table, quantity, required) for quantity in required]
        if table.has_header
        else [[] for _ in required]
    )
    for quantity, found in zip(required, named, strict=True):
        if len(found) > 1:
            both = " and ".join(shorten_text(repr(c.label)) for c in found[:2])
            raise BadInput(f"{table.where}: {both} both say {quantity.name}; give one column of it")
    chosen = [found[0] if found else None for found in named]
    if None not in chosen:
        return [c for c in chosen if c is not None]
    if len(table.columns) != len(required):
        raise BadInput(
            f"{table.locate_row(0)}: {show_cells(list(table.rows[0]))} has {len(table.columns)} values; give"
            f" {len(required)} numbers per row: {', '.join(map(str, required))}"
        )
    free = [c for c in table.columns if c not in chosen]
    if len(free) == 1 or all(c is None or c.number == n for n, c in enumerate(chosen, 1)):
        rest = iter(free)
        columns = [next(rest) if c is None else c for c in chosen]
        for column, known, quantity in zip(columns, chosen, required, strict=True):
            if known is None and table.has_header and quantity.names:
                _check_contradiction(table, column, quantity)
        return columns
    raise BadInput(
        f"{table.where}: columns {', '.join(repr(c.label) for c in table.columns)}; name {_list_required(required)}"
    )


def _list_required(required: Sequence[RequiredColumn]) -> str:
    return "them " + ", ".join(map(str, required))


def _matching_columns(
    table: TextTable, quantity: RequiredColumn, required: Sequence[RequiredColumn]
) -> list[TableColumn]:
    """The columns whose name, or whose unit as a name, identifies the quantity."""
    return [c for c in table.columns if _is_column_of(c, quantity, required)]


def _is_column_of(column: TableColumn, quantity: RequiredColumn, required: Sequence[RequiredColumn]) -> bool:
    label = column.label.strip()
    if len(label) > header.MAX_LABEL_LETTERS or not label:
        return False
    pattern = re.compile(quantity.names)
    if len(label) == 1 and label in "tT" and TIME in required and TEMPERATURE in required:
        return quantity is (TIME if label == "t" else TEMPERATURE)
    if pattern.fullmatch(header.bare_name(label)):
        return True
    name, unit = header.split_label(label, quantity.unit)
    if unit and unit != name and header.is_unit_text(unit, quantity.unit):
        bare = header.bare_name(name)
        if len(bare) == 1 and bare == "t" and TIME in required and TEMPERATURE in required:
            return True
        return pattern.fullmatch(bare) is not None
    if unit and unit == name:  # a unit alone
        return quantity.unit != "1" and header.is_unit_text(unit, quantity.unit)
    return pattern.fullmatch(header.bare_name(name)) is not None and not unit


def _check_contradiction(table: TextTable, column: TableColumn, quantity: RequiredColumn) -> None:
    """Raise BadInput where a column taken by elimination is named as another quantity."""
    if unit := _foreign_unit(column.label, quantity):
        raise BadInput(f"{table.where}: {column}: {unit!r} is no unit of {quantity}; correct the names of the columns")
    for other in VOCABULARY:
        if other is not quantity and column.label and _is_column_of(column, other, (other,)):
            raise BadInput(
                f"{table.where}: {column} says {other.name}, where {quantity} is expected; correct the names of the"
                " columns"
            )


def _foreign_unit(label: str, quantity: RequiredColumn) -> str:
    """The unit after an underscore or a slash of a label if it has another dimension than `quantity`, else ""."""
    unit = re.split(r"[_/]", label)[-1].strip() if re.search(r"[^\W_][_/]", label) else ""
    return unit if unit in header.COMMON_UNITS and not header.is_unit_text(unit, quantity.unit) else ""


def _check_cells(table: TextTable, column: TableColumn, quantity: RequiredColumn) -> None:
    """Raise BadInput for the first cell that is not a finite number."""
    comma = table.dialect.comma
    for k, cell in enumerate(table.cells(column)):
        if parse_number(split_suffix(cell)[0], comma) is not None and not is_missing(cell):
            continue
        place = f"{table.where}:{table.lines[k]}"
        if is_missing(cell):
            raise BadInput(
                f"{place}: {shorten_text(cell) or 'an empty cell'} is not a finite number; remove or repair the row"
            )
        if quantity is TIME and parse_stamp(cell):
            continue
        raise BadInput(
            f"{place}: {show_cells([c for c in table.rows[k] if c])} is not numeric;"
            f" {shorten_text(repr(cell))} in column {column.number} is no number: repair it"
        )


def _column_values(table: TextTable, column: TableColumn, quantity: RequiredColumn) -> np.ndarray:
    """Numbers of a column in the required unit; elapsed times such as 00:01:02.5 in s."""
    cells = table.cells(column)
    if quantity is TIME and parse_number(split_suffix(cells[0])[0], table.dialect.comma) is None:
        moments = parse_moments(cells, table.locate_row, column.label)
        if moments.has_date:
            raise BadInput(
                f"{table.locate_row(0)}: {shorten_text(repr(cells[0]))} is a date; give the time in s from its zero"
            )
        return moments.seconds
    values, unit = table.read_quantity(column, quantity.unit)
    if quantity.unit == "degC" and not unit:
        table.check_fahrenheit_remarks(f"write it behind the name, as {quantity.name} (degF)")
    return values
