"""Determine the time of every reading of a table: its columns, format and zero."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flashtemp.errors import BadInput, shorten_text, suggest_name
from flashtemp.physics.tables import header
from flashtemp.physics.tables.cells import is_missing, parse_number, split_suffix
from flashtemp.physics.tables.header import TableColumn
from flashtemp.physics.tables.text_table import TextTable
from flashtemp.physics.tables.timestamps import DAY_S, TimeColumn, parse_moments, parse_stamp

UNIX_RANGE_S = (9.0e8, 2.3e9)  # seconds since 1970 of the years 1998 to 2042
LABVIEW_RANGE_S = (2.95e9, 4.4e9)  # seconds since 1904 of the years 1997 to 2043
LABVIEW_EPOCH_S = -2082844800.0  # 1904-01-01 in seconds since 1970
SPREADSHEET_RANGE_DAYS = (32874.0, 55153.0)  # days since 1899-12-30 of the years 1990 to 2050
SPREADSHEET_EPOCH_DAYS = -25569.0
DATENUM_RANGE_DAYS = (726834.0, 749113.0)  # MATLAB's datenum, the same years
DATENUM_EPOCH_DAYS = -719529.0
HOUR_S, MINUTE_S = 3600.0, 60.0
SECOND_S = 1.0  # resolution of a clock without fractions
INTERVAL_TOLERANCE = 0.02  # relative difference up to which two intervals count as equal, for rounded steps
CLOCK_TOLERANCE = 0.01  # relative difference of two clocks of one file
RATE_UNIT = re.compile(r"(?:k?)(?:hz|s/s|sa/s|sps|samples?/s(?:ec)?|1/s|/s)", re.IGNORECASE)
INTERVAL_KEY = re.compile(
    r"sampl|interval|scan ?rate|log(?:ging)? ?rate|recording ?rate|^rate\b|data ?rate|abtast|messrate|messtakt|period|"
    r"delta ?t|^dt\b|測定間隔",
    re.IGNORECASE,
)
NUMBER_WITH_UNIT = re.compile(r"([-+]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][-+]?\d+)?)\s*([^\W\d_][^\s,;:]{0,15}|/s|1/s)?")


@dataclass(frozen=True)
class TimeAxis:
    """Times (n,) s of the readings, numbers of their columns, and notes for the user.

    `starts` are the possible dates of second 0, s since 1970 on the file's own clock, () without a date; `is_clock`:
    the times are clock times; `zone`: their offset from UTC if stated, s.
    """

    seconds: np.ndarray
    columns: tuple[int, ...] = ()
    starts: tuple[float, ...] = ()
    is_clock: bool = False
    zone: float | None = None
    notes: tuple[str, ...] = ()


def read_time_axis(table: TextTable, taken: Sequence[int] = (), named: str | None = None) -> TimeAxis:
    """The times of a table, which increase strictly.

    `taken` are numbers of columns with other quantities; `named` is the name or the number of the time column.
    Raises BadInput, naming line and cells, where no column is the time or its format is ambiguous.
    """
    main = _named_column(table, named) if named is not None else _find_time_column(table, taken)
    if main is None:
        axis = _counted_axis(table, taken)
    else:
        axis = _read_axis(table, main, taken)
        if not axis.notes and axis.columns != (1,):
            sources = " and ".join(str(table.columns[n - 1]) for n in axis.columns)
            axis = replace(axis, notes=(f"time from {sources}",))
        if named is None:
            axis = _compare_other_times(table, axis, taken)
    return _check_increasing(table, axis)


# --- which column -----------------------------------------------------------------------------------
def _named_column(table: TextTable, named: str) -> TableColumn:
    """The column with the name or number that the user gave.  Raises BadInput."""
    text = named.strip()
    same = [c for c in table.columns if c.label.strip() == text]
    same = same or [c for c in table.columns if c.label.casefold().strip() == text.casefold()]
    same = same or [c for c in table.columns if c.label and header.split_label(c.label, "s")[0] == text]
    if len(same) == 1:
        return same[0]
    if text.isdecimal() and text.isascii() and 1 <= int(text) <= len(table.columns):
        return table.columns[int(text) - 1]
    known = [c.label for c in table.columns if c.label] or [f"1 to {len(table.columns)}"]
    reason = (
        f"{len(same)} columns have that name; give its number" if same else f"no such column{suggest_name(text, known)}"
    )
    raise BadInput(f"{table.where}: time_column: {shorten_text(repr(named))}: {reason}")


def _column_kind(table: TextTable, column: TableColumn) -> str:
    """The kind of a column's cells, "stamp", "number" or "text", by the first cell that is not missing."""
    cell = next((c for c in table.cells(column) if not is_missing(c)), "")
    if parse_number(split_suffix(cell)[0], table.dialect.comma) is not None:
        return "number"
    return "stamp" if parse_stamp(cell) else "text"


def _find_time_column(table: TextTable, taken: Sequence[int]) -> TableColumn | None:
    """The column that is the time by its name or its cells; None where readings are only counted."""
    free = [c for c in table.columns if c.number not in taken]
    kinds = {c.number: _column_kind(table, c) for c in free}
    times = [
        c for c in free if kinds[c.number] != "text" and header.is_time_label(c) and not _is_millisecond_part(table, c)
    ]
    times += [c for c in free if kinds[c.number] == "stamp" and c not in times]
    if times:
        # a full stamp needs no other column, while a date alone must be joined with a clock
        full = [c for c in times if not _is_only_date(table, c)]
        return min(full or times, key=lambda c: c.number)
    if not free or any(header.is_counter_label(c) for c in free if kinds[c.number] == "number"):
        return None
    first = table.columns[0]
    if first.number in taken or kinds[first.number] != "number" or _is_counter(table, first):
        return None
    return first


def _is_millisecond_part(table: TextTable, column: TableColumn) -> bool:
    """Whether a column contains milliseconds that belong to a clock in another column."""
    bare = {header.bare_name(header.column_unit(column, "s")[0]), header.bare_name(column.unit_cell)}
    if not any(header.MILLISECOND_NAME.fullmatch(b) for b in bare if b):
        return False
    values = [parse_number(c, table.dialect.comma) for c in table.cells(column)]
    inside = all(v is not None and 0 <= v < 1000 for v in values)
    return inside and any(_column_kind(table, c) == "stamp" for c in table.columns)


def _is_only_date(table: TextTable, column: TableColumn) -> bool:
    stamp = parse_stamp(table.cells(column)[0])
    return bool(stamp and stamp.date and not stamp.clock) or (
        header.DATE_NAME.fullmatch(header.bare_name(column.label)) is not None
        and re.fullmatch(r"\d{8}", table.cells(column)[0]) is not None
    )


def _is_counter(table: TextTable, column: TableColumn) -> bool:
    """Whether a column counts readings: 1, 2, 3, ... or, in a table with a header, 0, 1, 2, ..."""
    cells = table.cells(column)
    if not all(c.isdecimal() for c in cells):
        return False
    numbers = [int(c) for c in cells]
    starts = (0, 1) if table.has_header else (1,)
    return numbers[0] in starts and numbers == list(range(numbers[0], numbers[0] + len(numbers)))


# --- its seconds ------------------------------------------------------------------------------------
def _read_axis(table: TextTable, column: TableColumn, taken: Sequence[int]) -> TimeAxis:
    """The times of a column, completed by the date, the clock or the milliseconds of other columns."""
    cells = table.cells(column)
    for k, cell in enumerate(cells):
        if not (cell and cell[-1].isdigit()) and is_missing(cell):
            raise BadInput(
                f"{table.locate_row(k)}: no time in {column}, {shorten_text(repr(cell))} instead; remove that line"
            )
    kind = _column_kind(table, column)
    if kind == "number" and not _is_only_date(table, column):
        axis = _axis_from_numbers(table, column)
        if axis.is_clock and not axis.starts:
            axis = _add_date(table, axis, taken)
        return axis
    moments = parse_moments(cells, table.locate_row, column.label, column.number)
    axis = TimeAxis(moments.seconds, (column.number,), moments.starts, True, moments.zone)
    if moments.has_date and not moments.has_clock:
        axis = _add_clock(table, axis, taken)
    elif not moments.has_date:
        axis = _add_date(table, axis, taken)
    return _add_milliseconds(table, axis) if moments.whole_seconds else axis


def _add_clock(table: TextTable, axis: TimeAxis, taken: Sequence[int]) -> TimeAxis:
    """Add the clock of another column to a date; columns to the right are tried first."""
    here = axis.columns[0]
    others = sorted(
        (c for c in table.columns if c.number not in (*taken, here)), key=lambda c: (c.number < here, c.number)
    )
    for other in others:
        moments = _read_clock(table, other)
        if moments is not None:
            both = replace(
                axis,
                seconds=axis.seconds + _wrap_to_day(moments.seconds),
                columns=(here, other.number),
                zone=moments.zone,
            )
            return _add_milliseconds(table, both) if moments.whole_seconds else both
    return axis


def _wrap_to_day(seconds: np.ndarray) -> np.ndarray:
    """Clock times without the days added at midnight, which the column of dates already contains."""
    return np.asarray(np.mod(seconds, DAY_S))


def _read_clock(table: TextTable, column: TableColumn) -> TimeColumn | None:
    """A column of clock times, including digits HHMMSS in a time column; None for any other."""
    cells = table.cells(column)
    stamp = parse_stamp(cells[0])
    if stamp and stamp.clock and not stamp.date:
        return parse_moments(cells, table.locate_row, column.label)
    if header.is_time_label(column) and (seconds := _clock_digits(cells)) is not None:
        return TimeColumn(seconds, False, True, whole_seconds=True)
    return None


def _add_date(table: TextTable, axis: TimeAxis, taken: Sequence[int]) -> TimeAxis:
    """Add the date of another column, or of the lines above the table, to clock times."""
    for other in table.columns:
        if other.number in (*taken, *axis.columns) or not _is_only_date(table, other):
            continue
        moments = parse_moments(table.cells(other), table.locate_row, other.label)
        seconds = moments.seconds + _wrap_to_day(axis.seconds)
        return replace(axis, seconds=seconds, columns=(*axis.columns, other.number), starts=moments.starts)
    for key, value in table.preamble:
        if not re.search(r"date|datum|start|begin|fecha|日", key, re.IGNORECASE):
            continue
        for word in re.split(r"[,;\t ]+", value):
            stamp = parse_stamp(word)
            if stamp and stamp.date and not stamp.clock:
                return replace(axis, starts=parse_moments([word], lambda _: table.where).starts)
    return axis


def _add_milliseconds(table: TextTable, axis: TimeAxis) -> TimeAxis:
    """Add the milliseconds of a separate column to times of whole seconds, if there is one."""
    for other in table.columns:
        if other.number not in axis.columns and _is_millisecond_part(table, other):
            part = np.array([parse_number(c, table.dialect.comma) or 0.0 for c in table.cells(other)])
            return replace(axis, seconds=axis.seconds + 1e-3 * part, columns=(*axis.columns, other.number))
    return axis


def _axis_from_numbers(table: TextTable, column: TableColumn) -> TimeAxis:
    """Times from numbers: in the stated unit, as clock digits, as days or seconds since an epoch, or in s."""
    cells = table.cells(column)
    header.check_units_agree(column, "s", table.where)
    unit = header.column_unit(column, "s")[1]
    suffixes = {"" if c[-1:].isdigit() else split_suffix(c)[1] for c in cells}
    values = table.numbers(column)
    if not np.all(np.isfinite(values)):
        k = int(np.argmin(np.isfinite(values)))
        raise BadInput(
            f"{table.locate_row(k)}: {shorten_text(repr(cells[k]))} in column {column.number} is no time; repair it,"
            " or name the time with --time-column"
        )
    if suffixes != {""}:
        if len(suffixes) > 1:
            raise BadInput(f"{table.where}: {column}: units {sorted(suffixes)} in one column; give one unit")
        unit = suffixes.pop()
    numbers, columns = np.asarray(values), (column.number,)
    is_name = header.TIME_NAME.fullmatch(header.bare_name(unit)) and not header.is_unit_text(unit, "s")
    if not unit or is_name or header.FORMAT_HINT.fullmatch(unit) or unit.casefold() in header.UNITLESS_MARKS:
        return _axis_without_unit(table, column, numbers, cells)
    seconds = numbers * _seconds_per_unit(table, column, unit)
    start = _epoch_seconds(seconds)
    if start is not None:
        return TimeAxis(seconds - seconds[0], columns, starts=(start + seconds[0],), is_clock=True, zone=0.0)
    note = "" if unit in ("s", "sec") else f"time from {column} in {unit}"
    return TimeAxis(seconds, columns, notes=(note,) if note else ())


def _seconds_per_unit(table: TextTable, column: TableColumn, unit: str) -> float:
    """Seconds per unit.  Raises BadInput for a unit that is not a time."""
    try:
        return header.convert_unit(unit, "s", f"{table.where}: {column}")[0]
    except BadInput as fault:
        raise BadInput(f"{fault}; correct the header, or name the time with --time-column") from fault


def _axis_without_unit(table: TextTable, column: TableColumn, numbers: np.ndarray, cells: Sequence[str]) -> TimeAxis:
    """Times from numbers without a unit in the header."""
    columns, bare = (column.number,), header.bare_name(column.label)
    # from the most to the least specific magnitude: digits of a date, epochs, days, digits of a clock; then elapsed s
    if all(re.fullmatch(r"\d{14}", c) for c in cells):
        moments = parse_moments([f"{c[:8]} {c[8:10]}:{c[10:12]}:{c[12:]}" for c in cells], table.locate_row)
        return TimeAxis(moments.seconds, columns, moments.starts, is_clock=True)
    for factor, unit in ((1.0, "s"), (1e-3, "ms"), (1e-6, "us"), (1e-9, "ns")):
        start = _epoch_seconds(numbers * factor)
        if start is not None:
            since = "1904 (LabVIEW), UTC" if start else "1970 (Unix), UTC"
            seconds = (numbers - numbers[0]) * factor
            note = f"time from {column}, {unit} since {since}"
            starts = (start + numbers[0] * factor,)
            return TimeAxis(seconds, columns, starts, is_clock=True, zone=0.0, notes=(note,))
    for days, epoch, kind in (
        (SPREADSHEET_RANGE_DAYS, SPREADSHEET_EPOCH_DAYS, "days of a spreadsheet"),
        (DATENUM_RANGE_DAYS, DATENUM_EPOCH_DAYS, "days of MATLAB's datenum"),
    ):
        if days[0] <= numbers.min() and numbers.max() <= days[1] and _is_in_days(bare, numbers):
            start_s = DAY_S * (numbers[0] + epoch)
            note = f"time from {column}, {kind}"
            return TimeAxis(DAY_S * (numbers - numbers[0]), columns, (start_s,), is_clock=True, notes=(note,))
    digits = _clock_digits(cells)
    if digits is not None and _is_clock_digits(table, column, numbers, digits):
        return TimeAxis(digits, columns, is_clock=True, notes=(f"time from {column}, HHMMSS of a clock",))
    if len(numbers) > 2 and numbers.min() > 0 and numbers.max() < 1 and _is_day_fraction(numbers):
        raise BadInput(
            f"{table.where}: {column}: steps of {numbers[1] - numbers[0]:.3g} may be parts of a day; write the unit"
            " behind the name, as Time (d) or Time (s)"
        )
    where = str(column) if column.label else f"{column} (no header)"
    return TimeAxis(numbers, columns, notes=(f"time from {where}, unit not stated, taken as s",))


def _epoch_seconds(seconds: np.ndarray) -> float | None:
    """The epoch (s since 1970) for numbers of that magnitude; None where they are elapsed times."""
    low, high = float(np.min(seconds)), float(np.max(seconds))
    if UNIX_RANGE_S[0] <= low and high <= UNIX_RANGE_S[1]:
        return 0.0
    return LABVIEW_EPOCH_S if LABVIEW_RANGE_S[0] <= low and high <= LABVIEW_RANGE_S[1] else None


def _is_in_days(bare: str, numbers: np.ndarray) -> bool:
    """Whether numbers are days: their name is a date, or their steps would be below a millisecond if in s."""
    if re.match(header.DATE_NAME, bare) or "date" in bare or "datum" in bare:
        return True
    return len(numbers) > 1 and bool(header.TIME_NAME.fullmatch(bare)) and float(np.median(np.diff(numbers))) < 1e-3


def _is_day_fraction(numbers: np.ndarray) -> bool:
    """Whether numbers below 1 are fractions of a day: steps below 1e-3 that are whole seconds of a day."""
    whole = np.round(DAY_S * numbers)
    digits = 1e-3 * SECOND_S
    return bool(np.max(np.abs(np.diff(numbers))) < digits and np.max(np.abs(DAY_S * numbers - whole)) < 1e2 * digits)


def _clock_digits(cells: Sequence[str]) -> np.ndarray | None:
    """Seconds of clock times written as HHMMSS, continued over midnight; None where a cell is not one."""
    out = []
    for cell in cells:
        found = re.fullmatch(r"(\d{5,6})(?:[.,](\d{1,9}))?", cell, re.ASCII)
        hours, rest = divmod(int(found[1]), 10000) if found else (99, 0)
        if found is None or hours > 23 or rest // 100 > 59 or rest % 100 > 59:
            return None
        out.append(3600.0 * hours + 60.0 * (rest // 100) + rest % 100 + float(f"0.{found[2] or 0}"))
    seconds = np.array(out)
    return np.asarray(seconds + DAY_S * np.concatenate([[0.0], np.cumsum(np.diff(seconds) < -DAY_S / 2)]))


def _is_clock_digits(table: TextTable, column: TableColumn, numbers: np.ndarray, digits: np.ndarray) -> bool:
    """Whether numbers are HHMMSS: by their name, or because only then their steps are more uniform."""
    bare = header.bare_name(column.label)
    if header.CLOCK_NAME.fullmatch(bare) or np.any(np.diff(numbers) < 0):
        return True
    plain, clock = np.diff(numbers), np.diff(digits)
    if np.allclose(plain, clock, rtol=0.0, atol=1e-6):
        return False  # within a minute both are the same
    spread_plain, spread_clock = (float(np.ptp(d)) for d in (plain, clock))
    if spread_clock < spread_plain:
        return True
    raise BadInput(
        f"{table.locate_row(0)}: {shorten_text(repr(table.cells(column)[0]))} in {column} may be seconds or HHMMSS"
        " of a clock; say which in the header, as Time (s) or Clock"
    )


# --- counted readings and checks --------------------------------------------------------------------
def sampling_interval(table: TextTable) -> tuple[float, str] | None:
    """The interval (s) between readings stated above a table, and the text that states it."""
    for key, value in table.preamble:
        if not INTERVAL_KEY.search(key) or re.search(r"points|count|number|anzahl|total", key, re.IGNORECASE):
            continue
        stamp = parse_stamp(value.strip())
        if stamp and len(stamp.clock) == 3 and not stamp.date:
            return float(parse_moments([value.strip()], lambda _: table.where).seconds[0]), f"{key} {value}"
        found = NUMBER_WITH_UNIT.match(value.strip())
        unit = (found[2] or "") if found else ""
        unit = unit or header.split_label(key, "s")[1] or header.split_label(key, "Hz")[1]
        if found is None or not unit:
            continue
        number = float(found[1].replace(",", "."))
        if number > 0 and header.is_unit_text(unit, "s"):
            return number * header.convert_unit(unit, "s", key)[0], f"{key} {value}"
        if number > 0 and RATE_UNIT.fullmatch(unit):
            return 1.0 / (number * (1e3 if unit[0] in "kK" else 1.0)), f"{key} {value}"
    return None


def _counted_axis(table: TextTable, taken: Sequence[int]) -> TimeAxis:
    """Times of readings without a time column: reading number times the interval stated in the file."""
    first = next((c for c in table.columns if c.number not in taken), None)
    interval = sampling_interval(table)
    what = (
        f"{first} counts the readings" if first and _column_kind(table, first) == "number" else "no column is the time"
    )
    if interval is None:
        raise BadInput(
            f"{table.where}: {what}, and no line states an interval; give --fps, readings per second, or --time-column"
        )
    numbers = np.arange(len(table.rows), dtype=float)
    if first is not None and header.is_counter_label(first) and _column_kind(table, first) == "number":
        numbers = table.numbers(first)
    note = f"{what}; time from the stated interval, {interval[1].strip()}"
    return TimeAxis((numbers - numbers[0]) * interval[0], (first.number,) if first else (), notes=(note,))


def _check_increasing(table: TextTable, axis: TimeAxis) -> TimeAxis:
    """The axis, checked to increase strictly and by the interval stated in the file.  Raises BadInput."""
    interval = sampling_interval(table)
    steps = np.diff(axis.seconds)
    resolution = _clock_resolution_s(axis.seconds)
    if interval and axis.is_clock and interval[0] < resolution and np.any(steps == 0) and np.all(steps >= 0):
        counted = interval[0] * np.arange(len(axis.seconds))
        if np.max(np.abs(counted - (axis.seconds - axis.seconds[0]))) <= resolution + INTERVAL_TOLERANCE * counted[-1]:
            what = "second" if resolution == SECOND_S else "minute"
            note = f"several readings in a {what}; time from the stated interval, {interval[1].strip()}"
            return replace(axis, seconds=axis.seconds[0] + counted, notes=(*axis.notes, note))
    if np.any(steps <= 0):
        k = int(np.argmax(steps <= 0))
        cells = [" ".join(table.rows[n][c - 1] for c in axis.columns) for n in (k, k + 1)]
        raise BadInput(
            f"{table.locate_row(k + 1)}: time goes from {shorten_text(cells[0])} to {shorten_text(cells[1])}; it must"
            " increase: remove that line, or give --fps or --time-column"
        )
    if axis.is_clock and axis.zone is None and len(steps) > 1:
        usual = float(np.median(steps))
        hour = np.abs(steps - usual - HOUR_S) < 0.5 * usual
        if usual < HOUR_S / 2 and np.count_nonzero(hour) == 1:
            line = table.locate_row(int(np.argmax(hour)) + 1).rpartition(":")[2]
            note = f"line {line}: the clock goes on by an hour more than usual: a gap, or summer time (give --fps)"
            axis = replace(axis, notes=(*axis.notes, note))
    if interval and not axis.is_clock and len(steps) and _has_assumed_seconds(axis):
        step = float(np.median(steps))
        if abs(step / interval[0] - 1.0) > INTERVAL_TOLERANCE:
            raise BadInput(
                f"{table.where}: time steps by {step:g} s, but {interval[1].strip()} is stated; give --fps, or the time"
                " with --time-column"
            )
    return axis


def _clock_resolution_s(seconds: np.ndarray) -> float:
    """The resolution of a clock, s: a minute or a second if all its times are multiples, else 0."""
    passed = seconds - seconds[0]
    return next((step for step in (MINUTE_S, SECOND_S) if not np.any(passed % step)), 0.0)


def _has_assumed_seconds(axis: TimeAxis) -> bool:
    """Whether the unit of a time with steps of 1 is only assumed."""
    return any("taken as s" in n for n in axis.notes) and bool(np.all(np.diff(axis.seconds) == 1.0))


def _compare_other_times(table: TextTable, axis: TimeAxis, taken: Sequence[int]) -> TimeAxis:
    """Compare the axis with other time columns: a finer one replaces the seconds, a later one is noted.

    Raises BadInput where a second column differs by more than the resolution of a clock.
    """
    for other in table.columns:
        used = (
            other.number in (*taken, *axis.columns) or _is_millisecond_part(table, other) or _is_only_date(table, other)
        )
        if used or not (header.is_time_label(other) and _column_kind(table, other) != "text"):
            continue
        try:
            found = _read_axis(table, other, (*taken, *axis.columns))
        except BadInput:
            continue
        passed, also = (s - s[0] for s in (axis.seconds, found.seconds))
        one, two = (str(table.columns[n - 1]) for n in (axis.columns[0], other.number))
        if np.max(np.abs(passed - also)) > SECOND_S + CLOCK_TOLERANCE * passed[-1]:
            raise BadInput(
                f"{table.where}: {one} and {two} both say time and differ: {passed[-1]:g} and {also[-1]:g} s in all;"
                " give --time-column"
            )
        later = found.seconds[0] - axis.seconds[0]
        if not axis.is_clock and not found.is_clock and 0 < abs(later) <= np.max(np.diff(passed), initial=0.0):
            note = f"{two} is {later:g} s after {one}, whose time is taken for all; --time-column takes the other"
            axis = replace(axis, notes=(*axis.notes, note))
        elif axis.is_clock and not found.is_clock and _is_finer(table, other, axis):
            note = f"time from {two}, the date and clock of its zero from {one}"
            axis = replace(axis, seconds=axis.seconds[0] + also, notes=(note,))
    return axis


def _is_finer(table: TextTable, other: TableColumn, axis: TimeAxis) -> bool:
    """Whether a column of seconds has a finer resolution than a clock in days."""
    if not any("days of" in note for note in axis.notes):
        return False
    day = DAY_S * _last_decimal(table, table.columns[axis.columns[0] - 1])
    return _last_decimal(table, other) < day and day > 1e-3


def _last_decimal(table: TextTable, column: TableColumn) -> float:
    """The value of the last decimal of a column, 1 for whole numbers."""
    sign = "," if table.dialect.comma else "."
    return float(10.0 ** -max(len(cell.partition(sign)[2]) for cell in table.cells(column)))
