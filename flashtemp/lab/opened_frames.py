"""All frames of camera files for the camera page, in the order of their times where the files have them."""

from __future__ import annotations

from base64 import b64encode
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flashtemp.camera.importing.file_preview import FilePreview, preview_files
from flashtemp.camera.importing.frame_buffer import FrameBuffer
from flashtemp.camera.importing.import_options import ImportOptions

MAX_PICTURE_WIDTH_PX = 960  # of a picture on the page


@dataclass(frozen=True)
class OpenedFrames:
    """Camera `files` with all `frames` (n, rows, columns) in degC, their `time` (s, or numbers) and a `preview`."""

    files: tuple[Path, ...]
    frames: np.ndarray
    time: np.ndarray
    has_times: bool
    preview: FilePreview

    @property
    def zoom(self) -> int:
        """Pixels of the page per pixel of the camera."""
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
        """Temperature (degC) of the pixel at a position, None outside the image."""
        c, r = round(column), round(row)
        rows, columns = self.frames.shape[1:]
        return float(self.frames[frame, r, c]) if 0 <= c < columns and 0 <= r < rows else None

    def describe_pixel(self, frame: int, column: float, row: float) -> str:
        """Temperature or state of the pixel at a position, in words."""
        T = self.pixel_value(frame, column, row)
        if T is None:
            return "outside"
        if np.isfinite(T):
            return f"{T:.2f} °C"
        return "dead in every frame" if self.preview.dead[round(row), round(column)] else "beyond the camera's range"

    @property
    def legend(self) -> str:
        """The meaning of the colours of pixels without a value; "" where there are none."""
        dead = int(self.preview.dead.sum())
        words = [f"cyan: {dead} dead in every frame"] if dead else []
        missing = int(np.isnan(self.frames).sum()) - dead * len(self.frames)
        words += [f"grey: beyond the camera's range, {missing} in all frames together"] if missing else []
        return "; ".join(words)

    def encode_frame(self, frame: int, low: float, high: float) -> str:
        """One frame as the data address of a PNG."""
        return _png_address(self.frames[frame], low, high, self.zoom, self.preview.dead)

    def encode_detail(
        self, frame: int, column: float, row: float, low: float, high: float, half: int, zoom: int
    ) -> str:
        """The surroundings of a position, 2 half + 1 pixels square, magnified; grey outside the image."""
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
    """Read all frames of camera files, in order of time where the files have it.  Raises BadInput."""
    stack = FrameBuffer()
    preview = preview_files(files, facts, receive_images=stack.add)
    clock = preview.time if preview.time is not None else preview.clock
    has_times = clock is not None and bool(np.isfinite(clock).all()) and (len(clock) == 1 or float(np.ptp(clock)) > 0.0)
    if clock is None or not has_times:
        time = np.arange(len(preview.mean)) / (preview.fps or 1.0)
        return OpenedFrames(preview.files, stack.ordered_images(np.arange(len(time))), time, bool(preview.fps), preview)
    order = np.argsort(clock, kind="stable")
    return OpenedFrames(preview.files, stack.ordered_images(order), clock[order] - clock[order[0]], True, preview)
