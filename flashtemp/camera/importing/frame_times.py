"""Times of frames, s from the first start of sliding, and the numbers of their repetitions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flashtemp.camera.importing.formats.raw_frames import RawFrames
from flashtemp.camera.importing.import_options import ImportOptions
from flashtemp.errors import BadInput, shorten_text
from flashtemp.physics import units
from flashtemp.physics.tables import header
from flashtemp.physics.tables.records import TableRecord, read_records
from flashtemp.physics.tables.timestamps import DAY_S, HALF_DAY_S, parse_moments, parse_stamp

TIMES_HEADER = "give a CSV file with columns file,time[,repetition]"


@dataclass(frozen=True)
class FrameTimestamps:
    """Time stamps of a file's frames; fields as in `RawFrames`.

    `starts`: possible moments of clock time 0, s since 1970, several if the order of day and month is open; None if the
    clock counts from 1970, () if it has no date.  `zone`: offset of the clock from UTC, s, if stated.
    """

    count: int
    time: np.ndarray | None = None
    clock: np.ndarray | None = None
    fps: float | None = None
    repetition: np.ndarray | None = None
    starts: tuple[float, ...] | None = None
    zone: float | None = None

    @classmethod
    def from_pieces(cls, pieces: Sequence[RawFrames | FrameTimestamps]) -> FrameTimestamps:
        """Time stamps of the pieces of one file, in order."""
        joined: dict[str, np.ndarray | None] = {}
        for name in ("time", "clock", "repetition"):
            parts = [getattr(p, name) for p in pieces]
            joined[name] = None if any(p is None for p in parts) else np.concatenate(parts)
        count = sum(p.count if isinstance(p, FrameTimestamps) else len(p.temperature) for p in pieces)
        return cls(count, joined["time"], joined["clock"], pieces[0].fps, joined["repetition"])


FileTimestamps = Sequence[tuple[Path, FrameTimestamps]]


def resolve_times(seen: FileTimestamps, facts: ImportOptions) -> np.ndarray:
    """Times of all frames of all files, s from the first start of sliding, in the order of the files.  Raises BadInput.

    They follow from --times, --fps, the file's own times, or its clock, in this order of priority.
    """
    if facts.times is not None:
        return np.concatenate([_times_from_rows(p, f, facts) for p, f in seen])
    counts = [f.count for _, f in seen]
    if facts.fps is not None:
        if facts.fps <= 0:
            raise BadInput(f"fps: {facts.fps:g}; give frames per second, more than 0")
        return _shift_to_start(facts, np.arange(sum(counts)) * (facts.every or 1) / facts.fps, clock=False)
    times = [f.time for _, f in seen if f.time is not None]
    if len(times) == len(seen):
        file_times = np.concatenate(times)
        return file_times if facts.start is None else file_times - file_times.min() + facts.start
    clocks = [f.clock for _, f in seen if f.clock is not None]
    if len(clocks) == len(seen):
        clock = np.concatenate(clocks)
        if len(clock) == 1 or len(np.unique(clock)) == len(clock):
            return _shift_to_start(facts, _add_date(clock, seen[0][1], facts), clock=True, zone=seen[0][1].zone)
        if len(seen) == 1 and seen[0][1].fps:
            return _shift_to_start(facts, np.arange(counts[0]) / seen[0][1].fps, clock=False)
        raise BadInput(f"{seen[0][0]}: frames share a time stamp; give --fps, or --times with the time of every file")
    if sum(counts) == 1:
        return _shift_to_start(facts, np.zeros(1), clock=False)
    bare = next(p for p, f in seen if f.clock is None)
    if len(seen) == 1 and seen[0][1].fps:
        return _shift_to_start(facts, np.arange(counts[0]) / seen[0][1].fps, clock=False)
    raise BadInput(f"{bare}: does not say when its frames were taken; give --fps and --start, or --times FILE.csv")


def _shift_to_start(facts: ImportOptions, relative: np.ndarray, clock: bool, zone: float | None = None) -> np.ndarray:
    """Times shifted so that the first start of sliding is 0, by --start or --zero; `zone` of the clock, s."""
    if facts.start is not None:
        return relative - relative.min() + facts.start
    if facts.zero is not None and clock:
        begin, zero_zone = _parse_zero(facts)
        if zero_zone is not None and zone is None:
            raise BadInput(f"zero: {facts.zero!r} has a zone, the file's clock has none; give it as that clock shows")
        return relative - (begin if zero_zone is None else begin - zero_zone + (zone or 0.0))
    if facts.zero is not None:
        raise BadInput("zero: the files have no usable time stamps; give --start, s from the first start of sliding")
    also = ", or --zero with the camera's clock at the first start of sliding" if clock else ""
    raise BadInput(f"start: missing; give --start, s of the first frame after the first start of sliding{also}")


def _parse_zero(facts: ImportOptions) -> tuple[float, float | None]:
    """The moment that --zero states, s since 1970 or since midnight, and its zone.  Raises BadInput."""
    text = facts.zero or ""
    stamp = parse_stamp(text)
    if stamp is None or not stamp.clock:
        raise BadInput(f"zero: {text!r}; give date and time of the camera's clock, as 2024-05-31T12:00:03.25")
    moments = parse_moments([text], lambda _: "zero")
    if len(moments.starts) > 1:
        raise BadInput(f"zero: {text!r}: day and month may stand in either order; write it as 2024-05-31T12:00:03.25")
    return float(moments.seconds[0]) + (moments.starts[0] if moments.starts else 0.0), moments.zone


def _add_date(clock: np.ndarray, stamps: FrameTimestamps, facts: ImportOptions) -> np.ndarray:
    """The clock (frames,) with the date of --zero, where the file leaves it open.  Raises BadInput."""
    if facts.zero is None or facts.start is not None or stamps.starts is None:
        return clock
    has_date = bool((parse_stamp(facts.zero) or parse_stamp("0:00:00")).date)  # type: ignore[union-attr]
    if not stamps.starts:
        if has_date:
            raise BadInput(f"zero: {facts.zero!r}: the file's clock has no date; give the time alone, as 12:00:03.25")
        return clock
    if not has_date:
        raise BadInput(f"zero: {facts.zero!r}: the file's clock has a date; give one too, as 2024-05-31T12:00:03.25")
    if len(stamps.starts) == 1:
        return clock + stamps.starts[0]
    begin, _ = _parse_zero(facts)
    near = [s for s in stamps.starts if abs(s - begin) < DAY_S + HALF_DAY_S]
    if len(near) != 1:
        raise BadInput(f"zero: {facts.zero!r}: day and month of the file may stand in either order; give --start")
    return clock + near[0]


def _read_rows(path: Path) -> list[dict[str, str]]:
    """Rows of a CSV file with columns file, time and optionally repetition, times in s.  BadInput names the line."""
    where = f"times: {path}"
    if not path.is_file():
        raise BadInput(f"{where}: no such file; {TIMES_HEADER}")
    try:
        records = read_records(path, where, TIMES_HEADER)
    except BadInput as fault:
        raise BadInput(f"{fault}" if TIMES_HEADER in str(fault) else f"{fault}; {TIMES_HEADER}") from fault
    named = {label: _times_key(label, where) for label in records[0].cells} if records else {}
    if not {"file", "time"} <= {key for key, _ in named.values()}:
        raise BadInput(f"{where}: columns file and time are missing; give a header file,time[,repetition]")
    return [
        {named[label][0]: _times_cell(record, *named[label], cell, where) for label, cell in record.cells.items()}
        for record in records
    ]


def read_stated_times(facts: ImportOptions) -> np.ndarray | None:
    """Times of all frames that the table `times` states, s, increasing; None without one.  Raises BadInput."""
    if facts.times is None:
        return None
    return np.sort(np.array([float(row["time"]) for row in _read_rows(Path(facts.times))]))


def _times_key(label: str, where: str) -> tuple[str, float]:
    """Key of a column, and for times the factor from its unit to s."""
    name, unit = header.split_label(label, "s")
    if name.casefold() != "time" or not unit:
        return label.casefold(), 1.0
    return "time", header.convert_unit(unit, "s", f"{where}: {label!r}")[0]


def _times_cell(record: TableRecord, key: str, factor: float, cell: str, where: str) -> str:
    """A cell as text; times in s and with a decimal point.  Raises BadInput."""
    if key not in ("time", "repetition"):
        return cell
    value = record.parse_number_cell(cell)
    if value is None and key == "time" and units.looks_like_quantity(record.replace_decimal_comma(cell)):
        return repr(units.to_unit(record.replace_decimal_comma(cell), "s"))
    if value is None:
        raise BadInput(f"{where}:{record.line}: {key} {shorten_text(repr(cell))}; give a number")
    return repr(value * factor)


def _rows_of_file(path: Path, frames: FrameTimestamps, facts: ImportOptions) -> list[dict[str, str]]:
    rows = [r for r in _read_rows(Path(facts.times or "")) if Path(r["file"]).name == path.name]
    count = frames.count
    if len(rows) not in (1, count):
        raise BadInput(
            f"times: {facts.times}: {len(rows)} rows for {path.name} with {count} frames; give one for each frame,"
            " or one for the first"
        )
    return rows


def _times_from_rows(path: Path, frames: FrameTimestamps, facts: ImportOptions) -> np.ndarray:
    rows, count = _rows_of_file(path, frames, facts), frames.count
    given = np.array([float(r["time"]) for r in rows])
    if len(rows) == count:
        return given
    if facts.fps or frames.clock is None:
        rate = (facts.fps / (facts.every or 1)) if facts.fps else frames.fps
        if not rate or rate <= 0:
            raise BadInput(f"{path}: {count} frames and no time stamps; give --fps")
        return given[0] + np.arange(count) / rate
    return given[0] + frames.clock - frames.clock[0]


def resolve_repetitions(seen: FileTimestamps, time: np.ndarray, facts: ImportOptions) -> np.ndarray:
    """Number of the repetition of every frame, from 1; during a wait the preceding one.  Raises BadInput."""
    if facts.times is not None:
        rows = [(_rows_of_file(p, f, facts), f.count) for p, f in seen]
        if all("repetition" in r[0] for r, _ in rows):
            found = [[int(float(r["repetition"])) for r in rs] * (n if len(rs) == 1 else 1) for rs, n in rows]
            return np.concatenate(found).astype(int)
    if facts.repetition is not None:
        return np.full(len(time), facts.repetition)
    if facts.starts is not None:
        starts = np.asarray(facts.starts)
        if np.any(np.diff(starts) <= 0):
            raise BadInput(f"starts: {list(facts.starts)}; they must increase, s from the first start of sliding")
        return np.maximum(np.searchsorted(starts, time + 1e-9, side="right"), 1)
    if facts.case is not None:
        from flashtemp.model.case import NO_EFFECTS, load_case

        begins = sorted({p.start for p in load_case(facts.case, NO_EFFECTS).scene.schedule.phases})
        return np.maximum(np.searchsorted(begins, time + 1e-9, side="right"), 1)
    if all(f.repetition is not None for _, f in seen):
        return np.concatenate([f.repetition for _, f in seen])
    raise BadInput(
        "repetition: missing; give --repetition N, --starts with the time of each start of sliding, --case, or a"
        " column repetition in --times"
    )
