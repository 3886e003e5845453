"""All frames of camera files for the camera page, in the order of their times where the files have them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from flashtemp.camera.importing.file_preview import FilePreview, preview_files
from flashtemp.camera.importing.frame_buffer import FrameBuffer
from flashtemp.camera.importing.import_options import ImportOptions
from flashtemp.lab.frame_screening import ScreenedFrames, screen_frames

PERCENTILES = (0.01, 0.99)  # of all values, for a range without outliers


@dataclass(frozen=True, eq=False)
class OpenedFrames:
    """Camera `files` with all `frames` (n, rows, columns) in degC, their `time` (s, or numbers) and a `preview`.

    `screened` are the defects of the camera, None before they have been searched.
    """

    files: tuple[Path, ...]
    frames: np.ndarray
    time: np.ndarray
    has_times: bool
    preview: FilePreview
    screened: ScreenedFrames | None = None

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

    @property
    def pixel_classes(self) -> np.ndarray:
        """Classes (rows, columns) of pixels: those of the screening, or before it 1 for dead in every frame."""
        return self.preview.dead.astype(np.uint8) if self.screened is None else self.screened.classes

    @property
    def unit(self) -> str:
        """Unit of the values, as it is shown."""
        return "°C" if self.preview.unit == "degC" else self.preview.unit

    @property
    def percentile_range(self) -> tuple[float, float]:
        """Values between which all but the outermost hundredths lie."""
        share = np.cumsum(self.preview.counts) / max(int(self.preview.counts.sum()), 1)
        low, high = (int(np.searchsorted(share, p)) for p in PERCENTILES)
        edges = self.preview.edges
        return float(edges[low]), float(edges[min(high + 1, len(edges) - 1)])

    def frame_name(self, frame: int) -> str:
        """Number of a frame, with its time where the files have times."""
        return f"frame {frame}, {self.time[frame]:.4g} s" if self.has_times else f"frame {frame}"

    def with_screening(self) -> OpenedFrames:
        """The same frames with bad pixels, shutter events and frozen frames searched."""
        return replace(self, screened=screen_frames(self.frames, self.time, self.preview.dead))


def open_frames(
    files: list[Path],
    facts: ImportOptions = ImportOptions(),  # noqa: B008 (frozen)
    report_frames: Callable[[int], object] = lambda number: None,
) -> OpenedFrames:
    """Read all frames of camera files, in order of time where the files have it.  Raises BadInput.

    `report_frames` is called with the number of frames that have just been read.
    """
    stack = FrameBuffer()

    def keep(images: np.ndarray) -> None:
        stack.add(images)
        report_frames(len(images))

    preview = preview_files(files, facts, receive_images=keep)
    clock = preview.time if preview.time is not None else preview.clock
    has_times = clock is not None and bool(np.isfinite(clock).all()) and (len(clock) == 1 or float(np.ptp(clock)) > 0.0)
    if clock is None or not has_times:
        time = np.arange(len(preview.mean)) / (preview.fps or 1.0)
        return OpenedFrames(preview.files, stack.ordered_images(np.arange(len(time))), time, bool(preview.fps), preview)
    order = np.argsort(clock, kind="stable")
    return OpenedFrames(preview.files, stack.ordered_images(order), clock[order] - clock[order[0]], True, preview)
