"""Import of thermocouple records of loggers (tables, LabVIEW, TDMS) as a recording of points."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.camera import sensors
from flashtemp.camera.importing import frame_times
from flashtemp.camera.importing.formats.raw_frames import UNIT_REMEDY, ScaleMissing, scale_counts, to_celsius
from flashtemp.camera.importing.import_options import ImportOptions, option_name
from flashtemp.camera.recording import Recording
from flashtemp.camera.sensors import SENSOR_KEYS, SensorPositions
from flashtemp.errors import BadInput, shorten_text, suggest_name
from flashtemp.physics import safe_text, units
from flashtemp.physics.quantities import KELVIN
from flashtemp.physics.tables import header, lvm, tdms
from flashtemp.physics.tables.cells import is_missing
from flashtemp.physics.tables.encoding import decode_text
from flashtemp.physics.tables.header import TableColumn
from flashtemp.physics.tables.records import TableRecord, read_records
from flashtemp.physics.tables.table import parse_table
from flashtemp.physics.tables.text_table import TextTable
from flashtemp.physics.tables.time_axis import TimeAxis, read_time_axis

POINT_OPTIONS = {
    "view", "places", "start", "zero", "fps", "repetition", "starts", "case", "block", "every", "unit", "scale",
    "offset", "decimal", "limit", "netd", "time_column", "variable",
}  # fmt: skip
POSITION_COLUMNS = ("column", "name", *SENSOR_KEYS)
POSITIONS_REMEDY = (
    f"--places FILE.csv with a line of names among {','.join(POSITION_COLUMNS)} and a line per thermocouple (m, s)"
)
SERIES_NAME = re.compile(
    r"entityid|(?:sensor|channel|device|probe|series|tag|topic|field|variable|parameter|kanal|messstelle|fühler)"
    r"(?:id|name|no|nr|number)?|measurement|location"
)
COLDEST_DEGC = -273.0  # absolute zero in whole degrees: not a reading
HOTTEST_DEGC = 3500.0  # hotter than any thermocouple or pyrometer measures
COLDEST_KELVIN_MEDIAN = 150.0  # K: below, a column headed K rather means a thermocouple of type K
UNIT_KEY = re.compile(
    r"(?:temp\w*[ _.]?)?(?:units?|einheit)(?: of temp\w*)?|temp\w*[ _](?:units?|scale)|温度単位", re.IGNORECASE
)


@dataclass(frozen=True)
class SensorColumns:
    """Thermocouples and the column of each: number or name in the header, None if neither is stated."""

    places: SensorPositions
    columns: tuple[int | str | None, ...]
    where: str


def read_recording(names: list[Path], facts: ImportOptions) -> tuple[Recording, tuple[str, ...]]:
    """The recording of one logger file, and notes on what was recognised and assumed.  Raises BadInput."""
    given = [name for name in ImportOptions.__dataclass_fields__ if getattr(facts, name) is not None]
    if other := next((name for name in given if name not in POINT_OPTIONS), None):
        raise BadInput(f"{option_name(other)}: belongs to images; leave it out for points")
    if len(names) != 1:
        raise BadInput(f"files: {len(names)} given; give one table of all thermocouples")
    if facts.places is None:
        raise BadInput(f"places: missing; where the thermocouples sit is not in the file: give {POSITIONS_REMEDY}")
    path, placed = names[0], read_positions(facts.places)
    comma = None if facts.decimal is None else facts.decimal == "comma"
    table, axis = read_logger_file(path, str(path), comma, facts.variable)
    columns, axis = _assign_columns(table, axis, placed, facts)
    _check_one_series(table, columns)
    ordered = _note_of_order(table, columns, axis, placed)
    if facts.every and facts.every > 1:
        table = table.every_nth_row(facts.every)
        axis = None if axis is None else replace(axis, seconds=axis.seconds[:: facts.every])
    T, notes = read_temperatures(table, columns, facts)
    stamps = _axis_timestamps(axis, len(table.lines))
    t = frame_times.resolve_times([(path, stamps)], facts)
    repetition = frame_times.resolve_repetitions([(path, stamps)], t, facts)
    recording = Recording(
        "points", T[:, None], t, repetition, np.arange(len(columns), dtype=float), np.zeros(1), netd_K=facts.netd,
        source=path.name, places=placed.places,
    )  # fmt: skip
    separated = "" if table.rows and not table.rows[0] else f", {table.dialect}"
    shape = f"{len(table.lines)} readings{separated}"
    return recording, (shape, *table.notes, *(() if axis is None else axis.notes), *ordered, *notes)


def read_campaign_points(entry: dict[str, Any], folder: Path, schedule: Any, key: str) -> Recording:
    """The recording of an entry of a campaign that gives `points`: a file of times and one column per point.

    Columns are found by the names of the points where the header has them all, else they stand in the points' order.
    Times count in s from the first start of sliding, without a date; the repetition of every row follows from the
    schedule of its condition.  Raises BadInput.
    """
    if entry.get("view", "points") != "points":
        raise BadInput(f'{key}: view: {entry["view"]!r}; points belong to view = "points"')
    places = sensors.positions_from_rows(entry["points"], f"{key}: points")
    where = f"{key}: {entry['file']}"
    table, axis = read_logger_file(folder / entry["file"], where)
    axis = axis or read_time_axis(table)
    if axis.starts:
        raise BadInput(
            f"{where}: times are dates; use flashtemp import FILE --view points --zero, or give s from the start"
        )
    placed = SensorColumns(places, (None,) * len(places), f"{key}: points")
    own = [e.get("name") for e in entry["points"]]
    columns = _columns_by_name(table, own) or _columns_in_order(table, axis, placed, exact=True)
    T, _ = read_temperatures(table, columns, ImportOptions(), in_campaign=True)
    repetition = np.array([schedule.phase_at(t).repetition for t in axis.seconds])
    try:
        return Recording(
            "points", T[:, None], axis.seconds, repetition, np.arange(len(places), dtype=float), np.zeros(1),
            source=entry["file"], places=places,
        )  # fmt: skip
    except BadInput as fault:
        raise BadInput(*(f"{where}: {line}" for line in fault.lines)) from fault


# --- columns ----------------------------------------------------------------------------------------
def _assign_columns(
    table: TextTable, axis: TimeAxis | None, placed: SensorColumns, facts: ImportOptions
) -> tuple[list[TableColumn], TimeAxis | None]:
    """The column of every thermocouple, and the time axis unless `fps` replaces it.  Raises BadInput."""
    if facts.time_column is not None:
        axis = None
    columns: list[TableColumn] | None
    if None in placed.columns:
        columns = _columns_by_name(table, list(placed.places.names))
    else:
        columns = [_find_column(table, c, placed.where) for c in placed.columns if c is not None]
    taken = [c.number for c in columns or ()]
    if time_column := next((c for c in columns or () if table.has_header and header.is_time_label(c)), None):
        raise BadInput(f"{table.where}: {time_column} says time, a thermocouple is expected there; correct --places")
    if facts.fps is not None:
        return columns or _columns_in_order(table, TimeAxis(np.zeros(0), (1,)), placed), None
    if axis is None and 1 in taken and len(taken) == len(table.columns):
        raise BadInput(f"{table.where}: every column is a thermocouple, none the time; give --fps, readings per second")
    axis = axis or read_time_axis(table, taken, facts.time_column)
    columns = columns or _columns_in_order(table, axis, placed)
    for column in columns:
        if column.number in axis.columns:
            raise BadInput(f"{table.where}: {column} holds the time, not a thermocouple; correct --places")
    return columns, axis


def _find_column(table: TextTable, wanted: int | str, where: str) -> TableColumn:
    """The column with a number or with a name in the header.  Raises BadInput."""
    if isinstance(wanted, int):
        if wanted > len(table.columns):
            raise BadInput(
                f"{table.where}: {len(table.columns)} columns, but a thermocouple is in column {wanted}; correct"
                " --places"
            )
        return table.columns[wanted - 1]
    same = [c for c in table.columns if wanted in (c.label, header.split_label(c.label, "degC")[0])]
    if len(same) != 1:
        known = [c.label for c in table.columns if c.label]
        raise BadInput(f"{where}: column: {wanted!r}: {len(same)} columns have that name{suggest_name(wanted, known)}")
    return same[0]


def _columns_by_name(table: TextTable, names: list[str | None]) -> list[TableColumn] | None:
    """The columns with the names of the points; None if the header does not contain each of them once."""
    labels: dict[str, list[TableColumn]] = {}
    for column in table.columns:
        for label in {column.label.casefold().strip(), header.split_label(column.label, "degC")[0].casefold()}:
            labels.setdefault(label, []).append(column)
    wanted = [n.casefold().strip() for n in names if n is not None]
    if len(wanted) < len(names) or not wanted or len(set(wanted)) < len(wanted):
        return None
    found = [labels.get(n, []) for n in wanted]
    if not all(len(f) == 1 for f in found):
        return None
    return [f[0] for f in found]


def _columns_in_order(
    table: TextTable, axis: TimeAxis, placed: SensorColumns, exact: bool = False
) -> list[TableColumn]:
    """The columns of values after the time, one per thermocouple in their order.  Raises BadInput."""
    free = _free_columns(table, axis)
    count = len(placed.places)
    if len(free) < count or (exact and len(free) > count):
        have, need = len(free) + len(axis.columns), count + len(axis.columns)
        if exact:
            raise BadInput(
                f"{table.where}: the table has {have} values; give {need} numbers per row, or name the columns as the"
                " points"
            )
        raise BadInput(f"{table.where}: {have} columns, but a thermocouple is in column {need}; correct --places")
    return free[:count]


def _free_columns(table: TextTable, axis: TimeAxis | None) -> list[TableColumn]:
    """The columns of values after the time, without counters and status columns."""
    behind = 0 if axis is None else max(axis.columns, default=0)
    return [
        c
        for c in table.columns
        if c.number > behind
        and c.number not in table.text_columns
        and not (header.is_counter_label(c) or header.is_status_label(c))
    ]


def _note_of_order(
    table: TextTable, columns: list[TableColumn], axis: TimeAxis | None, placed: SensorColumns
) -> tuple[str, ...]:
    """A note if thermocouples were assigned by their order alone and the table has more columns of values."""
    if None not in placed.columns or _columns_by_name(table, list(placed.places.names)) is not None:
        return ()
    if len(_free_columns(table, axis)) <= len(columns):
        return ()
    return (f"thermocouples in their order from {', '.join(map(str, columns))}; give `column` in --places for others",)


def _check_one_series(table: TextTable, columns: list[TableColumn]) -> None:
    """BadInput where a column names several sensors, whose readings are in one column."""
    for column in table.columns:
        if column in columns or not SERIES_NAME.fullmatch(header.bare_name(column.label)):
            continue
        names = set(table.cells(column))
        words = column.number in table.text_columns or all(name.isdecimal() for name in names)
        if words and 1 < len(names) <= len(table.rows) / 2:
            some = ", ".join(shorten_text(repr(name)) for name in sorted(names)[:3])
            raise BadInput(
                f"{table.where}: {column} names {len(names)} sensors under each other ({some}); give a table with"
                " a column of temperatures for each"
            )


# --- temperatures -----------------------------------------------------------------------------------
def read_temperatures(
    table: TextTable, columns: list[TableColumn], facts: ImportOptions, in_campaign: bool = False
) -> tuple[np.ndarray, list[str]]:
    """Temperatures (rows, columns) in degC, NaN where missing, and notes on their units.

    `in_campaign`: a campaign lists the table, so that only its header can state a unit.  Raises BadInput, naming line
    and cell, for words, for units that are none of temperature and for values below absolute zero.
    """
    if facts.scale is not None or facts.offset is not None:
        values = np.stack([_column_numbers(table, c) for c in columns], axis=1)
        # called for its checks alone
        scale_counts(values[np.isfinite(values)], facts.scale, facts.offset, f"{table.where}: table")
        return (facts.scale or 1.0) * values + (facts.offset or 0.0), []
    general = facts.unit or _preamble_unit(table)
    out, notes, bare = [], [], []
    for column in columns:
        T, unit = _column_temperatures(table, column, facts.unit, general, in_campaign)
        _check_known(table, column, T, in_campaign)
        stated = header.column_unit(column, "degC")[1]
        if facts.unit and header.is_unit_text(stated, "degC") and not _is_same_unit(stated, facts.unit):
            notes.append(f"{column} says {stated}, read as {facts.unit} as --unit says")
        elif unit and not _is_same_unit(unit, "degC"):
            notes.append(f"{column} in {unit}, converted to degC")
        if not unit:
            bare.append(T)
        out.append(T)
    if bare:
        first = columns[next(k for k, T in enumerate(out) if T is bare[0])]
        table.check_fahrenheit_remarks(_header_remedy(first, "degF") if in_campaign else "give --unit degF or degC")
        remedy = _header_remedy(first) if in_campaign else UNIT_REMEDY
        try:
            _, note = to_celsius(np.stack(bare, axis=1), None, remedy=remedy)
        except ScaleMissing as fault:
            raise ScaleMissing(f"{table.where}: {fault}") from fault
        notes.append(note)
    values = np.stack(out, axis=1)
    for j, column in enumerate(columns):
        _check_range(table, column, values[:, j], in_campaign)
    marks = {c for column in columns for c in table.cells(column) if is_missing(c)} if np.isnan(values).any() else set()
    if marks:
        some = ", ".join(repr(m) for m in sorted(marks)[:4])
        notes.append(f"missing values: {int(np.isnan(values).sum())}, marked {some}")
    return values, notes


def _column_numbers(table: TextTable, column: TableColumn) -> np.ndarray:
    return table.read_quantity(column, "1", unit="1")[0]


def _column_temperatures(
    table: TextTable, column: TableColumn, own: str | None, general: str | None, in_campaign: bool = False
) -> tuple[np.ndarray, str]:
    """Temperatures of a column in degC, and its unit in the file, "" if none is stated."""
    try:
        T, unit = table.read_quantity(column, "degC", own)
    except BadInput as fault:
        if "is no number" in str(fault):
            raise
        others = ", or name the column of the point" if in_campaign else ", give --unit, or correct --places"
        raise BadInput(f"{fault}; write degC, K or degF there{others}") from fault
    if not unit and general:
        T, unit = table.read_quantity(column, "degC", general)
    known = T[np.isfinite(T)]
    if own is None and unit and _is_same_unit(unit, "K") and known.size:
        middle = float(np.median(known)) + KELVIN
        if middle < COLDEST_KELVIN_MEDIAN:
            raise BadInput(
                f"{table.where}: {column}: {middle:g} K is no usual temperature; if K is the type of the thermocouple, "
                + ("write degC instead" if in_campaign else "give --unit degC")
            )
    return T, unit


def _is_same_unit(one: str, other: str) -> bool:
    return header.is_unit_text(one, "degC") and units.find_conversion(one, "degC") == units.find_conversion(
        other, "degC"
    )


def _preamble_unit(table: TextTable) -> str | None:
    """Unit of temperatures that the lines above the table state, or None."""
    for key, value in table.preamble:
        if UNIT_KEY.fullmatch(key.strip()) and header.is_unit_text(value, "degC"):
            return value
    return None


def _header_remedy(column: TableColumn, unit: str = "degC") -> str:
    """How a table that a campaign lists states the unit of a column.

    >>> _header_remedy(TableColumn(2, "T1"))
    "write it in the header of its column, e.g. 'T1 (degC)'"
    >>> _header_remedy(TableColumn(2))
    "write it in a header line above the numbers, e.g. 'time (s), T1 (degC)'"
    """
    if not column.label:
        return f"write it in a header line above the numbers, e.g. 'time (s), T1 ({unit})'"
    name = shorten_text(header.split_label(column.label, unit)[0] or column.label)
    return f"write it in the header of its column, e.g. '{name} ({unit})'"


def _check_known(table: TextTable, column: TableColumn, T: np.ndarray, in_campaign: bool = False) -> None:
    if not np.isfinite(T).any():
        remedy = "leave its point out" if in_campaign else "correct --places"
        raise BadInput(f"{table.where}: {column} holds no temperature at all; {remedy}")


def _check_range(table: TextTable, column: TableColumn, T: np.ndarray, in_campaign: bool = False) -> None:
    """BadInput for impossible temperatures, with their line and cell."""
    bad = (T <= COLDEST_DEGC) | (T > HOTTEST_DEGC)
    if not bad.any():
        return
    k = int(np.argmax(bad))
    cell = shorten_text(repr(table.cells(column)[k]))
    what = (
        ("is below absolute zero" if T[k] < -KELVIN else "is absolute zero")
        if T[k] < 0
        else f"is above {HOTTEST_DEGC:g} degC"
    )
    raise BadInput(
        f"{table.locate_row(k)}: {cell} in column {column.number} {what}; if it marks a missing value, empty that cell,"
        f" else {'correct the unit in the header' if in_campaign else 'give --unit'}"
    )


def _axis_timestamps(axis: TimeAxis | None, count: int) -> frame_times.FrameTimestamps:
    """Time stamps of a logger file: from a clock, or counted by the file itself."""
    if axis is None:
        return frame_times.FrameTimestamps(count)
    if axis.is_clock:
        return frame_times.FrameTimestamps(count, clock=axis.seconds, starts=axis.starts, zone=axis.zone)
    return frame_times.FrameTimestamps(count, time=axis.seconds)


# --- positions --------------------------------------------------------------------------------------
def read_positions(file: Path) -> SensorColumns:
    """Positions of thermocouples from a CSV file with a header.  Raises BadInput."""
    where = f"places: {file}"
    records = read_records(file, where, f"give {POSITIONS_REMEDY}")
    named = {name: _parse_label(name, where) for name in records[0].cells} if records else {}
    if not records:
        raise BadInput(f"{where}: no thermocouple in it; give {POSITIONS_REMEDY}")
    made: list[dict[str, Any]] = []
    columns: list[int | str | None] = []
    for number, record in enumerate(records, 1):
        entry: dict[str, Any] = {}
        for label, cell in record.cells.items():
            key, unit = named[label]
            entry[key] = (
                cell if key in ("name", "column") else _read_number_cell(where, number, key, unit, cell, record)
            )
        columns.append(_read_column_cell(where, number, entry.pop("column", None), record))
        made.append(entry)
    for number, column in enumerate(columns, 1):
        if column is not None and columns.count(column) > 1:
            raise BadInput(f"{where}: thermocouple {number}: column: {column}; give each its own, counted from 1")
    return SensorColumns(sensors.positions_from_rows(made, where), tuple(columns), where)


def _parse_label(label: str, where: str) -> tuple[str, str]:
    """Key of a column from its label, and the unit in the label, "" for none."""
    columns = {name.casefold(): name for name in POSITION_COLUMNS}
    if label.casefold() in columns:
        return columns[label.casefold()], ""
    for key, (unit, *_) in SENSOR_KEYS.items():
        name, own = header.split_label(label, unit)
        if name.casefold() == key.casefold() and own:
            header.convert_unit(own, unit, f"{where}: {label!r}")
            return key, own
    raise BadInput(
        f"{where}: {label!r}: unknown column{suggest_name(label, POSITION_COLUMNS)}; give {', '.join(POSITION_COLUMNS)}"
    )


def _read_column_cell(where: str, number: int, cell: str | None, record: TableRecord) -> int | str | None:
    if cell is None:
        return None
    value = safe_text.parse_plain_number(cell)
    if value is None and cell:
        return cell
    if value is None or value != int(value) or value < 1:
        raise BadInput(f"{where}: thermocouple {number}: column: {cell}; give each its own, counted from 1")
    return int(value)


def _read_number_cell(where: str, row: int, key: str, unit: str, cell: str, record: TableRecord) -> float:
    value = record.parse_number_cell(cell)
    try:
        if value is None and units.looks_like_quantity(record.replace_decimal_comma(cell)):
            value = units.to_unit(record.replace_decimal_comma(cell), SENSOR_KEYS[key][0], difference=True)
        elif value is not None and unit:
            value *= units.find_conversion(unit, SENSOR_KEYS[key][0], difference=True)[0]
    except BadInput as fault:
        raise BadInput(f"{where}: thermocouple {row}: {key}: {fault}") from fault
    if value is None or not np.isfinite(value):
        raise BadInput(f"{where}: thermocouple {row}: {key}: {cell!r}; give a number")
    return value


def read_logger_file(
    path: Path, where: str, comma: bool | None = None, group: str | None = None
) -> tuple[TextTable, TimeAxis | None]:
    """The table of a logger's file, and its times if the format states them.  Raises BadInput, beginning with `where`.

    The user may state whether commas are decimal (`comma`) and the `group` of a TDMS file.
    """
    data = safe_text.read_bounded_bytes(path, where)
    if data.startswith(tdms.TDMS_MAGIC):
        return tdms.read_tdms(path, where, group)
    text = decode_text(data, where)
    if text.lstrip().startswith(lvm.LVM_MAGIC):
        return lvm.parse_lvm(text.lstrip(), where)
    return parse_table(text, where, comma, of_logger=True), None
