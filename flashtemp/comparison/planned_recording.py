"""Empty recordings of views that a campaign plans."""

from __future__ import annotations

from typing import Any

from flashtemp.camera.prediction import synthetic_recording
from flashtemp.camera.recording import Recording
from flashtemp.camera.sensors import positions_from_rows
from flashtemp.errors import BadInput, shorten_text
from flashtemp.model.case import Case

PLANNED_NETD_K = 0.05  # K, noise of the camera in a planned recording
PLANNED_READINGS = 40  # readings of planned thermocouples per repetition


def make_planned_recording(entry: dict[str, Any], case: Case, key: str) -> Recording:
    """An empty recording of a planned view: four frames per repetition and one per wait; more readings of points.

    Raises BadInput for an unknown view, which names the entry by its `key`.
    """
    scene, view = case.scene, entry["view"]
    if view not in [*synthetic_recording.VIEW_GEOMETRY, *(["points"] if "points" in entry else [])]:
        known = ", ".join(synthetic_recording.VIEW_GEOMETRY) + ", or points with their places"
        raise BadInput(f"{key}: view: {shorten_text(repr(view))}; give {known}")
    if view == "points":
        places = positions_from_rows(entry["points"], f"{key}: points")
        return synthetic_recording.empty_sensor_recording(
            places, scene, *synthetic_recording.frame_schedule(scene.schedule, PLANNED_READINGS, 4), PLANNED_NETD_K
        )
    return synthetic_recording.empty_recording(
        view, scene, *synthetic_recording.frame_schedule(scene.schedule, 4, 1), PLANNED_NETD_K
    )
