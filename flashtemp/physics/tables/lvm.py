"""Read LabVIEW Measurement files (.lvm) by the specification of National Instruments.

Tags of the header state separator, decimal sign and the columns of x.  Every segment has its own tags: first x,
increment, date and time of every channel.  Special blocks are skipped.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from flashtemp.errors import BadInput, shorten_text
from flashtemp.physics import safe_text
from flashtemp.physics.tables import header
from flashtemp.physics.tables.cells import is_missing, parse_number
from flashtemp.physics.tables.dialect import TableDialect
from flashtemp.physics.tables.header import TableColumn
from flashtemp.physics.tables.text_table import TextTable
from flashtemp.physics.tables.time_axis import LABVIEW_EPOCH_S, TimeAxis
from flashtemp.physics.tables.timestamps import parse_moments, parse_stamp

LVM_MAGIC = "LabVIEW Measurement"
END_OF_HEADER = "***End_of_Header***"
LVM_SEPARATORS = {"tab": "\t", "comma": ",", "semicolon": ";"}
SAME_START_S = 1e-3  # largest difference between the clocks of the channels of one segment


@dataclass
class LvmSegment:
    """One block of rows with its tags, one value per channel, and its first `line` in the file."""

    line: int
    tags: dict[str, list[str]] = field(default_factory=dict)
    names: list[str] = field(default_factory=list)
    rows: list[tuple[str, ...]] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)

    def tag_numbers(self, tag: str, default: float) -> list[float]:
        """The numbers of a tag, one per channel, with the decimal sign of the file."""
        cells = [c.replace(",", ".") for c in self.tags.get(tag, []) if c]
        return [default if (v := parse_number(c, False)) is None else v for c in cells] or [default]


def parse_lvm(text: str, where: str) -> tuple[TextTable, TimeAxis]:
    """Rows and times of an LVM file; column 1 is X_Value, even without values of x.

    Raises BadInput, naming the line, for truncated files, for segments with different channels, and for channels with
    different times.
    """
    lines = safe_text.split_bounded_lines(text, where)
    separator, body, tags = _read_file_header(lines, where)
    comma = tags.get("Decimal_Separator", ["."])[:1] == [","]
    segments = _read_segments(lines, body, separator, tags.get("Multi_Headings", ["No"])[:1] != ["Yes"], where)
    names = segments[0].names
    for segment in segments:
        if segment.names != names:
            raise BadInput(f"{where}:{segment.line}: a segment has other channels than the first; give one file each")
        _check_complete(segment, segments, where)
    x_columns = tags.get("X_Columns", ["One"])[0].casefold()
    times = [_segment_times(s, x_columns, comma, where) for s in segments]
    absolute = tags.get("Time_Pref", ["Relative"])[0].casefold() == "absolute"
    rows = [row for s in segments for row in s.rows]
    note = f"LabVIEW Measurement file, {len(segments)} segment{'s' * (len(segments) > 1)}"
    table = TextTable(
        where, TableDialect(separator, comma), _segment_columns(segments[0], x_columns), rows,
        [n for s in segments for n in s.lines], (), (note,), True,
    )  # fmt: skip
    return table, _join_times(segments, times, absolute, table)


def _read_file_header(lines: Sequence[str], where: str) -> tuple[str, int, dict[str, list[str]]]:
    """The separator, the index of the first line after the header, and the header's tags."""
    separator = "\t"
    for line in lines:
        if line.startswith("Separator"):
            rest = line[len("Separator") :].strip("\t,; ").casefold()
            separator = LVM_SEPARATORS.get(rest, separator)
            break
    tags: dict[str, list[str]] = {}
    for number, line in enumerate(lines):
        cells = [c.strip() for c in line.split(separator)]
        if cells[0] == END_OF_HEADER:
            return separator, number + 1, tags
        tags[cells[0]] = cells[1:] if line.strip() != "Decimal_Separator" + 2 * separator else [separator]
    raise BadInput(f"{where}: the header of this LabVIEW file does not end; give a whole copy")


def _read_segments(lines: Sequence[str], body: int, separator: str, single: bool, where: str) -> list[LvmSegment]:
    """The segments of a file.  Raises BadInput."""
    found: list[LvmSegment] = []
    now, in_tags, special = LvmSegment(body + 1), True, False
    for number, line in enumerate(lines[body:], body + 1):
        cells = tuple(c.strip() for c in line.split(separator))
        if cells[0].startswith(("***Start_Special", "***End_Special")):
            special = cells[0].startswith("***Start_Special")
        elif special or not any(cells):
            continue
        elif cells[0] == "Channels" and not in_tags:
            found.append(now)
            now, in_tags = LvmSegment(number, {"Channels": list(cells[1:])}), True
        elif cells[0] == END_OF_HEADER:
            in_tags = False
        elif in_tags and not now.tags and cells[0] == "X_Value":  # a segment without its own header
            now.names, in_tags = list(cells), False
        elif in_tags:
            now.tags[cells[0]] = list(cells[1:])
        elif not now.names:
            now.names = list(cells)
        elif list(cells) != now.names:
            now.rows.append(cells)
            now.lines.append(number)
    found.append(now)
    if in_tags or not all(s.rows and s.names for s in found):
        bad = next((s for s in found if not s.rows), found[-1])
        raise BadInput(f"{where}:{bad.line}: a segment of this file has no rows; give a whole copy")
    return found


def _check_complete(segment: LvmSegment, segments: Sequence[LvmSegment], where: str) -> None:
    """Raise BadInput for a row with too few cells, and for a segment with fewer rows than its header states."""
    while len(segment.names) > 1 and not segment.names[-1]:
        segment.names.pop()
    comment = segment.names[-1].casefold() == "comment"
    needed = len(segment.names) - comment
    for k, row in enumerate(segment.rows):
        if len(row) < needed:
            raise BadInput(
                f"{where}:{segment.lines[k]}: {len(row)} cells, others {needed}; cut off or damaged: repair that line"
            )
        segment.rows[k] = (*row, *[""] * len(segment.names))[: len(segment.names)]
    samples = max((int(n) for n in segment.tag_numbers("Samples", 0.0)), default=0)
    if len(segment.rows) < samples:
        raise BadInput(
            f"{where}:{segment.lines[-1]}: {len(segment.rows)} rows of a segment of {samples} samples; the file is cut"
            " off: give a whole copy"
        )


def _segment_columns(segment: LvmSegment, x_columns: str) -> tuple[TableColumn, ...]:
    """Columns with the units that the segment states for its channels."""
    units = segment.tags.get("Y_Unit_Label", [])
    columns, channel = [], 0
    for number, name in enumerate(segment.names, 1):
        is_x = number == 1 or (x_columns == "multi" and number % 2 == 1)
        if is_x or name.casefold() == "comment":
            columns.append(TableColumn(number, name))
            continue
        columns.append(TableColumn(number, name, units[channel] if channel < len(units) else ""))
        channel += 1
    return tuple(columns)


def _segment_times(segment: LvmSegment, x_columns: str, comma: bool, where: str) -> np.ndarray:
    """x (n,) of the rows of a segment, in s.  Raises BadInput where it is not a time or differs between channels."""
    for tag in ("X_Dimension", "X_Unit_Label"):
        for value in filter(None, segment.tags.get(tag, [])):
            if value.casefold() != "time" and not header.is_unit_text(value, "s"):
                raise BadInput(f"{where}:{segment.line}: {tag} is {value!r}; give a file over time")
    count = len(segment.rows)
    if x_columns == "no":
        pairs = set(zip(segment.tag_numbers("X0", 0.0), segment.tag_numbers("Delta_X", 0.0), strict=False))
        if len(pairs) != 1:
            raise BadInput(f"{where}:{segment.line}: channels differ in X0 or Delta_X; give a file of one time")
        first, step = pairs.pop()
        if not step > 0:
            raise BadInput(
                f"{where}:{segment.line}: no Delta_X and no column of x; write x with the file, or give --fps"
            )
        return first + step * np.arange(count)
    places = range(0, len(segment.names), 2) if x_columns == "multi" else (0,)
    found = []
    for place in places:
        if place and segment.names[place].casefold() != "x_value":
            continue
        cells = [row[place] for row in segment.rows]
        numbers = [parse_number(c, comma) for c in cells]
        if None in numbers:
            k = numbers.index(None)
            mark = "no time" if is_missing(cells[k]) else "is no time"
            raise BadInput(
                f"{where}:{segment.lines[k]}: {shorten_text(repr(cells[k]))} in column {place + 1} {mark}; repair it"
            )
        found.append(np.array(numbers, dtype=float))
    if any(not np.array_equal(found[0], other) for other in found[1:]):
        raise BadInput(f"{where}:{segment.line}: channels have times of their own; give a file with one column of x")
    unit = next(filter(None, segment.tags.get("X_Unit_Label", [])), "s")
    return np.asarray(found[0] * header.convert_unit(unit, "s", where)[0])


def _segment_start(segment: LvmSegment, where: str) -> float | None:
    """The time of x = 0, s since 1970; None where the segment has no date.  Raises BadInput."""
    dates, clocks = segment.tags.get("Date", []), segment.tags.get("Time", [])
    starts = []
    for day, clock in zip(dates, clocks, strict=False):
        text = f"{day} {clock.replace(',', '.')}"
        if day and clock and parse_stamp(text):
            moments = parse_moments([text], lambda _: f"{where}:{segment.line}")
            starts.append(moments.starts[0] + moments.seconds[0])
    if starts and max(starts) - min(starts) > SAME_START_S:
        raise BadInput(f"{where}:{segment.line}: channels begin at times of their own; give a file of one time")
    return starts[0] if starts else None


def _join_times(segments: list[LvmSegment], times: list[np.ndarray], absolute: bool, table: TextTable) -> TimeAxis:
    """The times of all segments: x itself where it continues from one to the next, else x plus each segment's clock.

    Raises BadInput where x continues and contradicts the clocks.
    """
    where = table.where
    starts = [LABVIEW_EPOCH_S if absolute else _segment_start(s, where) for s in segments]
    first = starts[0]
    goes_on = all(b[0] > a[-1] for a, b in zip(times, times[1:], strict=False))
    seconds = np.concatenate(times)
    if not goes_on or len(segments) > 1:
        if None not in starts and len({*starts}) > 1:
            clock_times = [t + (s or 0.0) - (first or 0.0) for t, s in zip(times, starts, strict=True)]
            steps = [
                abs((b or 0.0) - (first or 0.0) - (t[0] - times[0][0])) for b, t in zip(starts, times, strict=True)
            ]
            if not goes_on:
                seconds = np.concatenate(clock_times)
            elif max(steps) > max(1.0, 0.01 * (seconds[-1] - seconds[0])):
                raise BadInput(
                    f"{where}:{segments[1].line}: X_Value goes on from the segment before, Date and Time say another"
                    " time; give --fps, or one segment"
                )
        elif not goes_on:
            raise BadInput(f"{where}:{segments[1].line}: X_Value begins again under the same clock; give --fps")
    if np.any(np.diff(seconds) <= 0):
        k = int(np.argmax(np.diff(seconds) <= 0))
        raise BadInput(
            f"{table.locate_row(k + 1)}: time goes from {seconds[k]:g} to {seconds[k + 1]:g} s; it must increase:"
            " remove that line, or give --fps"
        )
    dated = first is not None
    base = float(seconds[0])
    return TimeAxis(
        seconds - base,
        (1,),
        ((first or 0.0) + base,) if dated else (),
        dated,
        0.0 if absolute else None,
        ("times are UTC",) if absolute else (),
    )
