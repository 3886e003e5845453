"""Candidate positions for an additional thermocouple: a grid in the block, with the properties of those that exist."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flashtemp.camera.prediction import synthetic_recording
from flashtemp.camera.sensors import SensorPositions, positions_from_arrays
from flashtemp.comparison.campaign import RecordingEntry
from flashtemp.discovery.prediction.problem import Problem

HEIGHT_FRACTIONS, LENGTH_FRACTIONS = (
    (0.02, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.98),
    (0.1, 0.5, 0.9),
)  # of height and length


def candidate_sensor_recordings(problem: Problem) -> list[RecordingEntry]:
    """One empty recording for every position, named after it; none if the campaign has no thermocouples.

    Each is read, and its place known, like the first recording of points of the first condition.
    """
    first = problem.conditions[0]
    like = next((v for v in first.views if v.recording.places is not None), None)
    if like is None or like.recording.places is None:
        return []
    scene, r = problem.campaign.load(first.given | problem.mesh_overrides[0]).scene, like.recording
    out = []
    for words, places in _iter_positions(scene.length, scene.height, like.recording.places):
        blank = synthetic_recording.empty_sensor_recording(places, scene, r.time, r.repetition, r.netd_K or 0.05)
        out.append(RecordingEntry(words, blank, first.given, like.sigma_K))
    return out


def _iter_positions(length: float, height: float, like: SensorPositions) -> Iterator[tuple[str, SensorPositions]]:
    """Words and position of every node; one column if all existing thermocouples are at one x."""
    alone = np.ptp(like.x) == 0.0
    for x in (float(like.x[0]),) if alone else tuple(length * a for a in LENGTH_FRACTIONS):
        for z in (height * u for u in HEIGHT_FRACTIONS):
            alike = ("lag_s", "lag_sigma_s", "place_sigma_m", "depth_sigma_m", "gain_sigma")
            known = {k: [float(getattr(like, k).max())] for k in alike}
            words = f"at x = {1e3 * x:.3g} mm, z = {1e3 * z:.3g} mm"
            yield words, positions_from_arrays((words,), {"x": [x], "z": [z]} | known)
