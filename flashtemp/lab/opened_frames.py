"""All frames of camera files or of a recording for the camera page, in the order of their times."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from flashtemp.camera.importing.file_preview import FilePreview, preview_files
from flashtemp.camera.importing.frame_buffer import FrameBuffer
from flashtemp.camera.importing.import_options import ImportOptions
from flashtemp.camera.recording import Recording, load
from flashtemp.lab.frame_screening import ScreenedFrames, screen_frames

PERCENTILES = (0.01, 0.99)  # of all values, for a range without outliers
RECORDING_FORMAT = "recording"  # of a preview: a file that `flashtemp import` has written
MAX_PITCH_DEVIATION = 0.02  # of a grid whose pixels have one size, relative


@dataclass(frozen=True, eq=False)
class OpenedFrames:
    """Camera `files` with all `frames` (n, rows, columns) in degC, their `time` (s, or numbers) and a `preview`.

    `screened` are the defects of the camera, None before they have been searched.  Rows count downwards, those of a
    `recording` too: its largest v is row 0, its time counts from the first start of sliding.
    """

    files: tuple[Path, ...]
    frames: np.ndarray
    time: np.ndarray
    has_times: bool
    preview: FilePreview
    screened: ScreenedFrames | None = None
    recording: Recording | None = None

    @property
    def time_label(self) -> str:
        """What the times count, with their unit."""
        if self.recording is not None:
            return "time from the first start of sliding, s"
        return "time after the first frame, s" if self.has_times else "frame"

    def find_map(self) -> np.ndarray | None:
        """The map (3, 3) from pixels to m of a recording; None for camera files and pixels of unequal size."""
        known = self.recording
        if known is None or known.is_single_row or not (_is_even(known.u) and _is_even(known.v)):
            return None
        du, dv = known.pitch
        return np.array([[du, 0.0, known.u[0]], [0.0, -dv, known.v[-1]], [0.0, 0.0, 1.0]])

    @property
    def mean(self) -> np.ndarray:
        """Mean of every frame (n,) degC."""
        return (
            self.preview.mean[np.argsort(self._frame_clock(), kind="stable")] if self.has_times else self.preview.mean
        )

    def _frame_clock(self) -> np.ndarray:
        clock = self.preview.time if self.preview.time is not None else self.preview.clock
        return np.arange(len(self.preview.mean)) if clock is None else clock

    @property
    def missing_words(self) -> str:
        """Why a pixel that is not dead may have no value."""
        return "beyond the camera's range" if self.recording is None else "no value in this frame"

    @property
    def legend(self) -> str:
        """The meaning of the colours of pixels without a value; "" where there are none."""
        dead = int(self.preview.dead.sum())
        words = [f"cyan: {dead} dead in every frame"] if dead else []
        missing = int(np.isnan(self.frames).sum()) - dead * len(self.frames)
        words += [f"grey: {self.missing_words}, {missing} in all frames together"] if missing else []
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
    report_share: Callable[[float], object] = lambda share: None,
) -> OpenedFrames:
    """Read all frames of camera files, in order of time where the files have it.  Raises BadInput.

    `report_frames` is called with the number of frames that have just been read, `report_share` with the part of all
    files that has been read, from 0 to 1.
    """
    stack = FrameBuffer()

    def keep(images: np.ndarray) -> None:
        stack.add(images)
        report_frames(len(images))

    try:
        preview = preview_files(files, facts, receive_images=keep, report_share=report_share)
    except BaseException:
        stack.close()
        raise
    if preview.format == RECORDING_FORMAT and len(files) == 1:
        stack.close()  # its values are read again with all that is known of them
        known = load(files[0], facts.limit)
        return _turn_upright(preview, known.select_frames(np.arange(0, known.frames, facts.every or 1)))
    clock = preview.time if preview.time is not None else preview.clock
    has_times = clock is not None and bool(np.isfinite(clock).all()) and (len(clock) == 1 or float(np.ptp(clock)) > 0.0)
    if clock is None or not has_times:
        time = np.arange(len(preview.mean)) / (preview.fps or 1.0)
        return OpenedFrames(preview.files, stack.ordered_images(np.arange(len(time))), time, bool(preview.fps), preview)
    order = np.argsort(clock, kind="stable")
    return OpenedFrames(preview.files, stack.ordered_images(order), clock[order] - clock[order[0]], True, preview)


def _turn_upright(preview: FilePreview, recording: Recording) -> OpenedFrames:
    """The frames of a recording with v upwards, as images of it are drawn."""
    upright = replace(preview, dead=preview.dead[::-1], images=preview.images[:, ::-1])
    frames = recording.temperature[:, ::-1]
    return OpenedFrames(preview.files, frames, recording.time, True, upright, recording=recording)


def _is_even(centres: np.ndarray) -> bool:
    """Whether pixel centres have one distance from each other."""
    steps = np.diff(centres)
    return len(steps) > 0 and float(np.ptp(steps)) <= MAX_PITCH_DEVIATION * float(steps.mean())
