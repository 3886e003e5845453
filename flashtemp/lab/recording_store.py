"""Recordings of the folder in brief: a thumbnail, their facts, and a few frames, read once and kept in memory."""

from __future__ import annotations

import os
from base64 import b64encode
from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any, Final

import numpy as np

from flashtemp.camera.image_screening import temporal_noise
from flashtemp.camera.recording import Recording, load
from flashtemp.errors import BadInput, FlashtempError
from flashtemp.lab.page_layout import refuse_damaged
from flashtemp.lab.workspace import escape_control, resolve_inside
from flashtemp.physics.interpolation import read_xy_pairs
from flashtemp.physics.tables.column_matching import FRICTION, TIME

MAX_READ_GB: Final = 1.0  # of memory for one recording
MAX_SAMPLE_VALUES: Final = 500_000  # of the frames that are kept of one recording
MAX_SAMPLES: Final = 100  # recordings that are kept
MAX_NOISE_VALUES: Final = 1_000_000  # from which the noise is measured
THUMBNAIL_PX: Final = 160  # pixels of a thumbnail along its longer side


@dataclass(frozen=True)
class RecordingBrief:
    """What a page shows of a recording: its `view`, number of `frames`, `pixels` along u and v, lowest and highest
    temperature `span` in degC, noise in K as stated by the camera (`netd_K`) and as measured (`noise_K`), `camera`
    class, `picture` as the data address of a PNG ("" for sensors), and `curve` of sensors as (time, value) pairs."""

    view: str
    frames: int
    pixels: tuple[int, int]
    span: tuple[float, float]
    netd_K: float | None
    noise_K: float | None
    camera: str
    picture: str
    curve: tuple[tuple[float, float], ...] = ()


Kept = tuple[RecordingBrief, Recording | None]  # of a file: its brief, and some frames of a recording


class RecordingStore:
    """Briefs and samples of recordings by file and time of change; only files inside the folder are read."""

    def __init__(self, folder: Path):
        self.folder = folder
        self._kept: OrderedDict[tuple[Path, int, int], Kept | BadInput] = OrderedDict()
        self._lock = Lock()

    def load_sample(self, path: Path) -> Recording:
        """A few frames of a recording, evenly spaced in time.  Raises BadInput."""
        sample = self._open_file(path)[1]
        if sample is None:
            raise BadInput(f"{path}: a table of a load cell, not a recording")
        return sample

    def describe_file(self, path: Path) -> RecordingBrief:
        """A recording in brief.  Raises BadInput."""
        return self._open_file(path)[0]

    def describe_trace(self, path: Path) -> RecordingBrief:
        """A table of a load cell in brief: its number of readings as `frames`, and its curve.  Raises BadInput."""
        return self._open_file(path, _read_trace)[0]

    def find_brief(self, path: Path) -> RecordingBrief | None:
        """The brief of a recording that has been read before, None for any other."""
        try:
            kept = self._kept.get(self._make_key(path))
        except (BadInput, OSError):
            return None
        return kept[0] if isinstance(kept, tuple) else None

    def _make_key(self, path: Path) -> tuple[Path, int, int]:
        file = resolve_inside(self.folder, os.path.relpath(path, self.folder.resolve()))
        if not file.is_file():
            raise BadInput(f"{escape_control(str(path))}: no such recording")
        state = file.stat()
        return file, state.st_mtime_ns, state.st_size

    def _open_file(self, path: Path, read: Callable[[Path], Kept] | None = None) -> Kept:
        key = self._make_key(path)
        with self._lock:  # one at a time: each may take MAX_READ_GB
            kept = self._kept.get(key)
            if kept is None:
                try:
                    kept = (read or _read_brief)(key[0])
                except BadInput as fault:  # a damaged file is not read again until it changes
                    kept = fault
                self._kept[key] = kept
            self._kept.move_to_end(key)
            while len(self._kept) > MAX_SAMPLES:
                self._kept.popitem(last=False)
        if isinstance(kept, BadInput):
            raise kept
        return kept


def _read_trace(file: Path) -> Kept:
    with refuse_damaged(file):
        time, mu = read_xy_pairs(file.name, file.parent, "file", columns=(TIME, FRICTION))
    curve = sample_curve(time, mu)
    return RecordingBrief("load cell", len(time), (1, 1), (min(mu), max(mu)), None, None, "", "", curve), None


def _read_brief(file: Path) -> Kept:
    with refuse_damaged(file):
        full = load(file, MAX_READ_GB)
        T = full.temperature
        few = max(2, MAX_NOISE_VALUES // max(T[0].size, 1))
        noise = None if full.places is not None or T[0].size < 3 else float(temporal_noise(T[:few]))
        picture, curve = "", tuple[tuple[float, float], ...]()
        if full.places is None:
            picture = _encode_picture(full)
        else:
            curve = sample_curve(full.time, np.nanmean(T[:, 0], axis=1))
        low, high, _ = full.span
        brief = RecordingBrief(
            full.view, full.frames, (len(full.u), len(full.v)), (low, high), full.netd_K, noise, full.camera, picture,
            curve,
        )  # fmt: skip
        every = max(1, -(-T.size // MAX_SAMPLE_VALUES))
        chosen = np.arange(0, full.frames, every)
        return brief, full.select_frames(chosen)


def _encode_picture(recording: Recording) -> str:
    """A frame near the middle, or the rows of a profile over time, as the data address of a PNG."""
    from flashtemp.viz.measurement.raw_images import encode_png

    T = recording.temperature
    image = T[:, 0][::-1] if recording.is_single_row else T[find_middle_frame(T)][::-1]  # v counts upwards
    step = max(1, -(-max(image.shape) // THUMBNAIL_PX))
    image = np.ascontiguousarray(image[::step, ::step])
    known = image[np.isfinite(image)]
    low, high = np.percentile(known, [1.0, 99.0]) if known.size else (0.0, 1.0)
    zoom = max(1, THUMBNAIL_PX // max(image.shape))
    png = encode_png(image, float(low), float(max(high, low + 0.1)), zoom)
    return "data:image/png;base64," + b64encode(png).decode()


def find_middle_frame(T: Any) -> int:
    """The frame nearest the middle that holds values."""
    order = sorted(range(len(T)), key=lambda k: abs(k - len(T) // 2))
    return next((k for k in order[:64] if np.isfinite(T[k]).any()), len(T) // 2)


def sample_curve(time: Any, values: Any, points: int = 120) -> tuple[tuple[float, float], ...]:
    """At most about `points` finite pairs of time and value, evenly spaced."""
    step = max(1, len(time) // points)
    pairs = zip(time[::step], values[::step], strict=True)
    return tuple((float(t), float(v)) for t, v in pairs if np.isfinite(t) and np.isfinite(v))


def try_describe(store: RecordingStore, path: Path) -> None:
    """Read a recording or the table of a load cell into the store; the store remembers a file that cannot be read."""
    with suppress(FlashtempError, OSError):
        if path.suffix == ".nc":
            store.describe_file(path)
        else:
            store.describe_trace(path)
