"""When each frame was seen: seconds from the first start of sliding, and the number of its repetition."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flashtemp.camera.formats.cells import moment
from flashtemp.camera.formats.text import decoded
from flashtemp.camera.import_options import Facts
from flashtemp.camera.raw_frames import Frames
from flashtemp.errors import BadInput, short
from flashtemp.physics import bounded_reading


@dataclass(frozen=True)
class Stamps:
    """What a file says of the times of its frames, without their images; fields as of `Frames`."""

    count: int
    time: np.ndarray | None = None
    clock: np.ndarray | None = None
    fps: float | None = None
    repetition: np.ndarray | None = None

    @classmethod
    def of(cls, pieces: Sequence[Frames | Stamps]) -> Stamps:
        """Of the pieces of one file, in order."""
        found: dict[str, np.ndarray | None] = {}
        for name in ("time", "clock", "repetition"):
            parts = [getattr(p, name) for p in pieces]
            found[name] = None if any(p is None for p in parts) else np.concatenate(parts)
        count = sum(p.count if isinstance(p, Stamps) else len(p.temperature) for p in pieces)
        return cls(count, found["time"], found["clock"], pieces[0].fps, found["repetition"])


Seen = Sequence[tuple[Path, Stamps]]


def times(seen: Seen, facts: Facts) -> np.ndarray:
    """Seconds from the first start of sliding of every frame of every file, in the order of the files."""
    if facts.times is not None:
        return np.concatenate([_from_rows(p, f, facts) for p, f in seen])
    counts = [f.count for _, f in seen]
    if facts.fps is not None:
        if facts.fps <= 0:
            raise BadInput(f"fps: {facts.fps:g}; give frames per second, more than 0")
        return _from(facts, np.arange(sum(counts)) * (facts.every or 1) / facts.fps, clock=False)
    times = [f.time for _, f in seen if f.time is not None]
    if len(times) == len(seen):
        own = np.concatenate(times)
        return own if facts.start is None else own - own.min() + facts.start
    clocks = [f.clock for _, f in seen if f.clock is not None]
    if len(clocks) == len(seen):
        clock = np.concatenate(clocks)
        if len(clock) == 1 or len(np.unique(clock)) == len(clock):
            return _from(facts, clock, clock=True)
        if len(seen) == 1 and seen[0][1].fps:
            return _from(facts, np.arange(counts[0]) / seen[0][1].fps, clock=False)
        raise BadInput(f"{seen[0][0]}: frames share a time stamp; give --fps, or --times with the time of every file")
    if sum(counts) == 1:
        return _from(facts, np.zeros(1), clock=False)
    bare = next(p for p, f in seen if f.clock is None)
    if len(seen) == 1 and seen[0][1].fps:
        return _from(facts, np.arange(counts[0]) / seen[0][1].fps, clock=False)
    raise BadInput(f"{bare}: does not say when its frames were seen; give --fps and --start, or --times FILE.csv")


def _from(facts: Facts, relative: np.ndarray, clock: bool) -> np.ndarray:
    """Times shifted so that the first start of sliding is 0, as the facts say."""
    if facts.start is not None:
        return relative - relative.min() + facts.start
    if facts.zero is not None and clock:
        begin = moment(facts.zero)
        if begin is None:
            raise BadInput(f"zero: {facts.zero!r}; give date and time of the camera's clock, as 2024-05-31T12:00:03.25")
        return relative - begin
    if facts.zero is not None:
        raise BadInput("zero: the files have no usable time stamps; give --start, s from the first start of sliding")
    also = ", or --zero with the camera's clock at the first start of sliding" if clock else ""
    raise BadInput(f"start: missing; give --start, s of the first frame after the first start of sliding{also}")


def _rows(path: Path) -> list[dict[str, str]]:
    """Rows of a CSV file with columns file, time and perhaps repetition; BadInput names line and remedy."""
    try:
        if path.is_file() and path.stat().st_size > bounded_reading.MOST_TEXT:
            raise BadInput("too large")
        text = decoded(path.read_bytes())
    except OSError as fault:
        raise BadInput(f"times: {path}: no such file; give a CSV file with columns file,time") from fault
    except BadInput as fault:
        raise BadInput(f"times: {path}: no text; give a CSV file with columns file,time") from fault
    lines = bounded_reading.lines(text, f"times: {path}")
    try:
        rows = list(csv.DictReader(lines, delimiter=";" if ";" in lines[0] else ",", restval=""))
    except csv.Error as fault:
        raise BadInput(f"times: {path}: no text of cells; give a CSV file with columns file,time") from fault
    if not rows or not {"file", "time"} <= {str(k).strip() for k in rows[0]}:
        raise BadInput(f"times: {path}: columns file and time are missing; give a header file,time[,repetition]")
    clean = [{str(k).strip(): str(v).strip() for k, v in row.items()} for row in rows]
    for line, row in enumerate(clean, 2):
        for name in {"time", "repetition"} & set(row):
            try:
                good = math.isfinite(float(row[name]))
            except ValueError:
                good = False
            if not good:
                raise BadInput(f"times: {path}:{line}: {name} {short(repr(row[name]))}; give a number")
    return clean


def _rows_of(path: Path, frames: Stamps, facts: Facts) -> list[dict[str, str]]:
    rows = [r for r in _rows(Path(facts.times or "")) if Path(r["file"]).name == path.name]
    count = frames.count
    if len(rows) not in (1, count):
        raise BadInput(
            f"times: {facts.times}: {len(rows)} rows for {path.name} with {count} frames; give one for each frame,"
            " or one for the first"
        )
    return rows


def _from_rows(path: Path, frames: Stamps, facts: Facts) -> np.ndarray:
    rows, count = _rows_of(path, frames, facts), frames.count
    given = np.array([float(r["time"]) for r in rows])
    if len(rows) == count:
        return given
    if facts.fps or frames.clock is None:
        rate = (facts.fps / (facts.every or 1)) if facts.fps else frames.fps
        if not rate or rate <= 0:
            raise BadInput(f"{path}: {count} frames and no time stamps; give --fps")
        return given[0] + np.arange(count) / rate
    return given[0] + frames.clock - frames.clock[0]


def repetitions(seen: Seen, time: np.ndarray, facts: Facts) -> np.ndarray:
    """Number of the repetition of every frame, from 1; during a wait the one before."""
    if facts.times is not None:
        rows = [(_rows_of(p, f, facts), f.count) for p, f in seen]
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
        from flashtemp.model.case import NO_EFFECTS, load

        begins = sorted({p.start for p in load(facts.case, NO_EFFECTS).scene.schedule.phases})
        return np.maximum(np.searchsorted(begins, time + 1e-9, side="right"), 1)
    if all(f.repetition is not None for _, f in seen):
        return np.concatenate([f.repetition for _, f in seen])
    raise BadInput(
        "repetition: missing; give --repetition N, --starts with the time of each start of sliding, --case, or a"
        " column repetition in --times"
    )
