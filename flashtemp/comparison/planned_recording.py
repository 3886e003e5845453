"""Empty recordings of views that a campaign plans."""

from __future__ import annotations

from typing import Any

from flashtemp.camera.prediction import synthetic_recording
from flashtemp.camera.recording import Recording
from flashtemp.camera.sensors import positions_from_rows
from flashtemp.model.case import Case

PLANNED_NETD_K = 0.05  # K, noise of the camera in a planned recording
PLANNED_READINGS = 40  # readings of planned thermocouples per repetition


def make_planned_recording(entry: dict[str, Any], case: Case, key: str) -> Recording:
    """An empty recording of a planned view: four frames per repetition and one per wait; more readings of points."""
    scene = case.scene
    if entry["view"] == "points":
        places = positions_from_rows(entry["points"], f"{key}: points")
        return synthetic_recording.empty_sensor_recording(
            places, scene, *synthetic_recording.frame_schedule(scene.schedule, PLANNED_READINGS, 4), PLANNED_NETD_K
        )
    return synthetic_recording.empty_recording(
        entry["view"], scene, *synthetic_recording.frame_schedule(scene.schedule, 4, 1), PLANNED_NETD_K
    )
