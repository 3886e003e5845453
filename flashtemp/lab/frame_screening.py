"""Bad pixels, frozen frames and shutter events of opened frames, found by the tests that import and discovery use."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flashtemp.camera.image_screening import ScreeningResult, screen_recording
from flashtemp.camera.importing.pixel_masks import find_dead_pixels
from flashtemp.camera.recording import Recording
from flashtemp.display import format_count
from flashtemp.errors import BadInput

MAX_PIXEL_VALUES, MAX_EVENT_VALUES = 6_000_000, 2_000_000  # values that are tested, to bound memory and time
MIN_MEDIAN_TEST_PX = 3  # rows and columns that the median test needs
DEAD, BAD = 1, 2  # classes of pixels; 0 is good


@dataclass(frozen=True, eq=False)
class ScreenedFrames:
    """Defects of a camera: `classes` (rows, columns) of pixels, indices of `shutter` events and `frozen` frames.

    Class 1 has no value in any frame, class 2 fails a test.
    """

    classes: np.ndarray
    shutter: tuple[int, ...] = ()
    frozen: tuple[int, ...] = ()

    def list_pixels(self, most: int) -> list[tuple[int, int, str]]:
        """Column, row and kind of the first `most` bad pixels, row by row."""
        rows, columns = np.nonzero(self.classes)
        kinds = {DEAD: "no value in any frame", BAD: "differs from its neighbours or does not change"}
        found = zip(columns[:most], rows[:most], strict=True)
        return [(int(c), int(r), kinds[int(self.classes[r, c])]) for c, r in found]

    @property
    def summary(self) -> str:
        """What was found, in one sentence."""
        number = int(np.count_nonzero(self.classes))
        parts = [format_count(number, "bad pixel")] if number else []
        parts += [format_count(len(self.shutter), "shutter event")] if self.shutter else []
        parts += [format_count(len(self.frozen), "frozen frame")] if self.frozen else []
        return ", ".join(parts) or "no bad pixels, shutter events or frozen frames"


def screen_frames(frames: np.ndarray, time: np.ndarray, dead: np.ndarray) -> ScreenedFrames:
    """Screen frames (n, rows, columns) degC at `time` (n,) s; `dead` (rows, columns) have no value in any frame.

    Of many frames, pixels are tested in some frames at every pixel and events in every frame at some pixels.
    """
    every = -(-frames.size // MAX_PIXEL_VALUES)
    bad = np.zeros(dead.shape, bool)
    if min(dead.shape) >= MIN_MEDIAN_TEST_PX:
        bad |= find_dead_pixels(frames[::every])
    pixels = _screen(frames[::every], time[::every])
    bad |= pixels.bad_pixels
    spacing = max(1, int(np.ceil(np.sqrt(frames.size / MAX_EVENT_VALUES))))
    events = pixels if every == spacing == 1 else _screen(frames[:, ::spacing, ::spacing], time)
    classes = np.where(dead, DEAD, np.where(bad, BAD, 0)).astype(np.uint8)
    return ScreenedFrames(classes, events.shutter_events, tuple(map(int, np.flatnonzero(events.frozen))))


def _screen(frames: np.ndarray, time: np.ndarray) -> ScreeningResult:
    """Screen frames as a recording whose pixels have unknown size; frames that no recording holds have no defects."""
    n, rows, columns = frames.shape
    try:
        recording = Recording(
            "sidewall", frames, np.sort(time), np.ones(n, int), np.arange(columns, dtype=float),
            np.arange(rows, dtype=float),
        )  # fmt: skip
    except BadInput:
        none = np.zeros((rows, columns), bool)
        return ScreeningResult(none, none, none, (), (), np.zeros(n, bool), ())
    return screen_recording(recording)
