"""What a file is, found from its content: recording, camera export, load-cell trace, table of a logger, template."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from flashtemp.camera.importing.file_preview import iter_frames
from flashtemp.camera.importing.formats.raw_frames import ScaleMissing
from flashtemp.camera.importing.import_options import ImportOptions
from flashtemp.camera.importing.thermocouple_files import read_logger_file
from flashtemp.display import format_count
from flashtemp.errors import BadInput, FlashtempError
from flashtemp.lab.camera_files import has_time_header
from flashtemp.lab.page_layout import refuse_damaged
from flashtemp.lab.recording_store import RecordingStore
from flashtemp.lab.workspace import CAMERA_SUFFIXES, kind_of
from flashtemp.physics.tables.column_matching import FRICTION, TIME, find_columns
from flashtemp.physics.tables.text_table import TextTable
from flashtemp.physics.tables.time_axis import read_time_axis

RECORDING, CAMERA, FRAME_TIMES, LOAD_CELL = "recording", "camera file", "times of frames", "load-cell trace"
THERMOCOUPLES, TABLE, UNKNOWN = "table of temperatures", "table", "not recognised"
TEXT_SUFFIXES: Final = (".csv", ".txt", ".asc")
IMAGE_SUFFIXES: Final = CAMERA_SUFFIXES - {*TEXT_SUFFIXES}
MAX_NAMES: Final = 4  # of columns that are named
TEMPERATURE_LABEL: Final = re.compile(r"\((°|deg)?[CFK]\)|°C|degC|^\s*(t|tc|temp\w*)\s*\d*\b", re.IGNORECASE)


@dataclass(frozen=True)
class RecognisedFile:
    """A file with its `kind`, and what was found in it, in `words`."""

    path: Path
    kind: str
    words: str

    def __str__(self) -> str:
        return f"{self.path.name}: {self.kind}{f', {self.words}' if self.words else ''}"


def recognise_file(path: Path, store: RecordingStore) -> RecognisedFile:
    """What a file of the folder is; a file that cannot be read is `UNKNOWN`, with the reason."""
    try:
        kind, words = _recognise(path, store)
    except (FlashtempError, OSError) as fault:
        lines = str(fault).splitlines() or [type(fault).__name__]
        kind = CAMERA if path.suffix.lower() in IMAGE_SUFFIXES else UNKNOWN
        words = "cannot be read: " + re.sub(rf"^.*{re.escape(path.name)}(:\d+)?: ", "", lines[0])
    return RecognisedFile(path, kind, words)


def _recognise(path: Path, store: RecordingStore) -> tuple[str, str]:
    suffix = path.suffix.lower()
    if suffix == ".nc":
        brief = store.describe_file(path)
        return RECORDING, f"{brief.view}, {format_count(brief.frames, 'frame')}"
    if suffix == ".toml":
        return kind_of(path) or UNKNOWN, ""
    if suffix in TEXT_SUFFIXES and has_time_header(path):
        return FRAME_TIMES, "columns file and time"
    try:
        return CAMERA, _describe_frames(path)
    except FlashtempError:
        if suffix not in TEXT_SUFFIXES:
            raise
    with refuse_damaged(path):
        table, _ = read_logger_file(path, path.name)
        return _describe_table(table)


def _describe_frames(path: Path) -> str:
    """Size and range of the first frame.  Raises BadInput where the file holds no image."""
    with refuse_damaged(path):
        try:
            frame = next(iter_frames(path, ImportOptions())).temperature[0]
        except ScaleMissing:
            return "counts without a scale"
        except StopIteration as fault:
            raise BadInput(f"{path}: no frame in it") from fault
        size = f"{frame.shape[1]} × {frame.shape[0]} px"
        return f"{size}, {np.nanmin(frame):.1f} to {np.nanmax(frame):.1f} °C" if np.isfinite(frame).any() else size


def _describe_table(table: TextTable) -> tuple[str, str]:
    """Kind and columns of a table: a load-cell trace or temperatures only where its names say so."""
    labels = [column.label.strip() for column in table.columns]
    named = [label for label in labels if label]
    names = ", ".join(named[:MAX_NAMES]) + (" ..." if len(named) > MAX_NAMES else "")
    words = f"columns {names}" if named else f"{format_count(len(labels), 'column')} without names"
    if not named:
        return TABLE, words
    if len(labels) == len(_find_friction(table) or ()):
        return LOAD_CELL, words
    taken = {number - 1 for number in read_time_axis(table).columns}
    values = [label for k, label in enumerate(labels) if k not in taken]
    return THERMOCOUPLES if values and all(map(TEMPERATURE_LABEL.search, values)) else TABLE, words


def _find_friction(table: TextTable) -> list[object] | None:
    """The columns of time and friction; None where the table has not exactly these."""
    try:
        return list(find_columns(table, (TIME, FRICTION)))
    except BadInput:
        return None
