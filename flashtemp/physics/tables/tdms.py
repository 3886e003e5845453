"""Read TDMS files of National Instruments by npTDMS: channels are columns, times come from waveform properties."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.errors import BadInput, describe_exception
from flashtemp.physics.tables import header
from flashtemp.physics.tables.dialect import TableDialect
from flashtemp.physics.tables.header import TableColumn
from flashtemp.physics.tables.text_table import SCPI_MARK_MIN, TextTable
from flashtemp.physics.tables.time_axis import TimeAxis

TDMS_MAGIC = b"TDSm"
MAX_VALUES = 50_000_000  # in all channels of a group: 400 MB
STEP_TOLERANCE = 1e-9  # relative difference of the increments of two channels


@dataclass(frozen=True)
class ChannelTable(TextTable):
    """Channels (rows,) as columns; `arrays` are their numbers."""

    arrays: dict[int, np.ndarray] = field(default_factory=dict)

    def numbers(self, column: TableColumn) -> np.ndarray:
        """The numbers of a channel (rows,)."""
        return self.arrays[column.number]

    def cells(self, column: TableColumn) -> list[str]:
        """The numbers of a channel as text."""
        return [f"{v:.17g}" for v in self.arrays[column.number]]

    def locate_row(self, row: int) -> str:
        """File and sample number of a row (from 0), for messages."""
        return f"{self.where}: sample {self.lines[row]}"

    def every_nth_row(self, step: int) -> ChannelTable:
        """The table with every `step`-th sample."""
        arrays = {n: a[::step] for n, a in self.arrays.items()}
        return replace(self, rows=self.rows[::step], lines=self.lines[::step], arrays=arrays)


def read_tdms(path: Path, where: str, group: str | None = None) -> tuple[TextTable, TimeAxis | None]:
    """Channels of one group of a TDMS file, and their times or None where the file does not state them.

    Raises BadInput for damaged files, for several groups of numbers without `group`, and for channels of different
    lengths or increments.
    """
    try:
        import nptdms.log
    except ImportError as fault:
        raise BadInput(f"{where}: TDMS needs npTDMS; use pip install 'flashtemp[camera]', or export as CSV") from fault
    try:
        nptdms.log.log_manager.set_level(logging.ERROR)  # its warnings are errors below
        with nptdms.TdmsFile.open(path) as file:
            if file.file_status.incomplete_final_segment:
                raise BadInput(f"{where}: ends within its last segment: cut off; give a whole copy")
            return _read_group(file, where, group)
    except BadInput:
        raise
    except Exception as fault:  # the library raises many types of exception for damaged files
        raise BadInput(f"{where}: cannot be read as TDMS ({describe_exception(fault)}); give a whole copy") from fault


def _read_group(file: Any, where: str, wanted: str | None) -> tuple[TextTable, TimeAxis | None]:
    groups = {g.name: [c for c in g.channels() if len(c) and _is_numeric(c)] for g in file.groups()}
    groups = {name: channels for name, channels in groups.items() if any(_is_float(c) for c in channels)}
    if wanted is not None and wanted not in groups:
        raise BadInput(f"{where}: variable: {wanted!r}: no such group of numbers; groups are {', '.join(groups)}")
    if len(groups) != 1 and wanted is None:
        several = f"{len(groups)} groups of numbers: name one with --variable, of {', '.join(groups)}"
        raise BadInput(f"{where}: {several if groups else 'no channel of numbers in it; give a file of temperatures'}")
    name = wanted if wanted is not None else next(iter(groups))
    channels = groups[name]
    lengths = {len(c) for c in channels}
    if len(lengths) > 1:
        raise BadInput(f"{where}: channels of {name!r} have {min(lengths)} to {max(lengths)} samples; give one length")
    count = lengths.pop()
    if count * len(channels) > MAX_VALUES:
        raise BadInput(f"{where}: {count} samples of {len(channels)} channels; give a part of the file")
    arrays: dict[int, np.ndarray] = {}
    columns, dated = [], None
    for number, channel in enumerate(channels, 1):
        unit = str(channel.properties.get("unit_string", channel.properties.get("NI_UnitDescription", "")))
        columns.append(TableColumn(number, channel.name, unit))
        values = np.asarray(channel[:])
        if np.issubdtype(values.dtype, np.datetime64):
            dated = number
            arrays[number] = (values - np.datetime64("1970-01-01")) / np.timedelta64(1, "us") * 1e-6
        else:
            arrays[number] = values.astype(float)
            arrays[number][~(np.abs(arrays[number]) < SCPI_MARK_MIN)] = np.nan
    table = ChannelTable(
        where, TableDialect(",", False), tuple(columns), [()] * count, list(range(1, count + 1)), (),
        (f"TDMS file, group {name!r} of {len(channels)} channels",), True, arrays=arrays,
    )  # fmt: skip
    return table, _dated_axis(table, dated) if dated else _waveform_axis(channels, table)


def _is_numeric(channel: Any) -> bool:
    return channel.dtype is not None and (channel.dtype.kind in "iuf" or channel.dtype.kind == "M")


def _is_float(channel: Any) -> bool:
    return bool(channel.dtype.kind == "f")


def _dated_axis(table: ChannelTable, number: int) -> TimeAxis:
    """Times from a channel of time stamps, which are UTC in TDMS."""
    seconds = table.arrays[number]
    name = table.columns[number - 1].label
    return _check_increasing(
        table, TimeAxis(seconds - seconds[0], (number,), (float(seconds[0]),), True, 0.0, (f"time from {name!r}, UTC",))
    )


def _waveform_axis(channels: Sequence[Any], table: ChannelTable) -> TimeAxis | None:
    """Times from waveform properties; None where a channel is a time or none has an increment."""
    if any(header.is_time_label(c) for c in table.columns):
        return None
    steps = [c.properties["wf_increment"] for c in channels if c.properties.get("wf_increment", 0) > 0]
    if not steps:
        return None
    if len(steps) < len(channels) or max(steps) - min(steps) > STEP_TOLERANCE * max(steps):
        raise BadInput(f"{table.where}: channels differ in wf_increment; give channels of one sampling rate")
    offsets = {float(c.properties.get("wf_start_offset", 0.0)) for c in channels}
    starts = set(_start_times(channels))
    if len(offsets) > 1 or len(starts) > 1:
        raise BadInput(f"{table.where}: channels begin at times of their own; give channels of one start")
    seconds = float(steps[0]) * np.arange(len(table.rows))
    note = f"time from wf_increment, {steps[0]:g} s"
    if not starts:
        return TimeAxis(seconds, notes=(note,))
    return TimeAxis(seconds, (), (starts.pop() + offsets.pop(),), True, 0.0, (f"{note}; start in UTC",))


def _start_times(channels: Sequence[Any]) -> Iterator[float]:
    for channel in channels:
        start = channel.properties.get("wf_start_time")
        if start is not None:
            yield float((np.datetime64(start, "us") - np.datetime64("1970-01-01")) / np.timedelta64(1, "us")) * 1e-6


def _check_increasing(table: ChannelTable, axis: TimeAxis) -> TimeAxis:
    steps = np.diff(axis.seconds)
    if np.any(steps <= 0):
        k = int(np.argmax(steps <= 0))
        raise BadInput(f"{table.locate_row(k + 1)}: time does not increase after the sample before; give --fps")
    return axis
