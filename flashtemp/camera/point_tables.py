"""Tables of thermocouples as loggers write them: time and one column of degC per point -> a recording of points."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.camera.points import of_rows
from flashtemp.camera.recording import Recording
from flashtemp.errors import BadInput
from flashtemp.physics.interpolation import rows


def read(entry: dict[str, Any], folder: Path, schedule: Any, key: str) -> Recording:
    """The recording of an entry of a campaign that gives `points`: a CSV file of s and degC, `points` in its order.

    The repetition of every row follows from the schedule of its condition.  Raises BadInput.
    """
    if entry.get("view", "points") != "points":
        raise BadInput(f'{key}: view: {entry["view"]!r}; points belong to view = "points"')
    places = of_rows(entry["points"], f"{key}: points")
    table = rows(entry["file"], folder, f"{key}: file", 1 + len(places))
    time = table[:, 0]
    if np.any(np.diff(time) <= 0):
        k = int(np.argmax(np.diff(time) <= 0))
        raise BadInput(f"{key}: {entry['file']}: time goes from {time[k]:g} to {time[k + 1]:g} s; it must increase")
    repetition = np.array([schedule.phase(t).repetition for t in time])
    try:
        return Recording(
            "points", table[:, None, 1:], time, repetition, np.arange(len(places), dtype=float), np.zeros(1),
            source=entry["file"], places=places,
        )  # fmt: skip
    except BadInput as fault:
        raise BadInput(*(f"{key}: {entry['file']}: {line}" for line in fault.lines)) from fault
