"""Images of camera files opened for looking: all frames in order, times where the files tell them."""

from __future__ import annotations

from base64 import b64encode
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flashtemp.camera.importing.file_preview import FilePreview, preview_files
from flashtemp.camera.importing.frame_buffer import FrameBuffer
from flashtemp.camera.importing.import_options import ImportOptions

MAX_PICTURE_WIDTH_PX = 960  # pixels of a picture on the page


@dataclass(frozen=True)
class OpenedFrames:
    """Camera `files` with all their `frames` (n, rows, columns) degC, their `time` (s, or numbers), and a look."""

    files: tuple[Path, ...]
    frames: np.ndarray
    time: np.ndarray
    has_times: bool
    preview: FilePreview

    @property
    def zoom(self) -> int:
        """How many pixels of the page one pixel of the camera takes."""
        return max(1, MAX_PICTURE_WIDTH_PX // self.frames.shape[2])

    @property
    def mean(self) -> np.ndarray:
        """Mean of every frame (n,) degC."""
        return (
            self.preview.mean[np.argsort(self._frame_clock(), kind="stable")] if self.has_times else self.preview.mean
        )

    def _frame_clock(self) -> np.ndarray:
        clock = self.preview.time if self.preview.time is not None else self.preview.clock
        return np.arange(len(self.preview.mean)) if clock is None else clock

    def pixel_value(self, frame: int, column: float, row: float) -> float | None:
        """Temperature (degC) of the pixel at a place, None outside the image."""
        c, r = round(column), round(row)
        rows, columns = self.frames.shape[1:]
        return float(self.frames[frame, r, c]) if 0 <= c < columns and 0 <= r < rows else None

    def describe_pixel(self, frame: int, column: float, row: float) -> str:
        """What there is to say of the pixel at a place."""
        T = self.pixel_value(frame, column, row)
        if T is None:
            return "outside"
        if np.isfinite(T):
            return f"{T:.2f} °C"
        return "dead in every frame" if self.preview.dead[round(row), round(column)] else "beyond the camera's range"

    @property
    def legend(self) -> str:
        """What the colours of pixels without a value mean, where there are any."""
        dead = int(self.preview.dead.sum())
        words = [f"cyan: {dead} dead in every frame"] if dead else []
        missing = int(np.isnan(self.frames).sum()) - dead * len(self.frames)
        words += [f"grey: beyond the camera's range, {missing} in all frames together"] if missing else []
        return "; ".join(words)

    def encode_frame(self, frame: int, low: float, high: float) -> str:
        """One frame as the address of a PNG picture."""
        return _png_address(self.frames[frame], low, high, self.zoom, self.preview.dead)

    def encode_detail(
        self, frame: int, column: float, row: float, low: float, high: float, half: int, zoom: int
    ) -> str:
        """What lies about a place, magnified: 2 half + 1 pixels square, grey beyond the image."""
        c, r = round(column), round(row)
        T = np.full((2 * half + 1,) * 2, np.nan)
        rows, columns = self.frames.shape[1:]
        top, left = max(0, r - half), max(0, c - half)
        part = self.frames[frame, top : min(rows, r + half + 1), left : min(columns, c + half + 1)]
        dead = np.zeros(T.shape, bool)
        if part.size:
            there = slice(top - r + half, top - r + half + len(part)), slice(left - c + half, None)
            T[there][:, : part.shape[1]] = part
            dead[there][:, : part.shape[1]] = self.preview.dead[top:, left:][: part.shape[0], : part.shape[1]]
        return _png_address(T, low, high, zoom, dead)


def _png_address(T: np.ndarray, low: float, high: float, zoom: int, dead: np.ndarray | None = None) -> str:
    from flashtemp.viz.measurement.raw_images import encode_png

    return "data:image/png;base64," + b64encode(encode_png(T, low, high, zoom, dead)).decode()


def open_frames(files: list[Path], facts: ImportOptions = ImportOptions()) -> OpenedFrames:  # noqa: B008 (frozen)
    """All frames of camera files, in order of time where the files tell it.  Raises BadInput."""
    stack = FrameBuffer()
    seen = preview_files(files, facts, receive_images=stack.add)
    clock = seen.time if seen.time is not None else seen.clock
    timed = clock is not None and bool(np.isfinite(clock).all()) and (len(clock) == 1 or float(np.ptp(clock)) > 0.0)
    if clock is None or not timed:
        time = np.arange(len(seen.mean)) / (seen.fps or 1.0)
        return OpenedFrames(seen.files, stack.ordered_images(np.arange(len(time))), time, bool(seen.fps), seen)
    order = np.argsort(clock, kind="stable")
    return OpenedFrames(seen.files, stack.ordered_images(order), clock[order] - clock[order[0]], True, seen)
