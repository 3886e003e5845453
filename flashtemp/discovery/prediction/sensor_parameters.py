"""Uncertain parameters of thermocouples: position, time constant, gain on the temperature rise, and zero."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from flashtemp.camera.recording import Recording
from flashtemp.camera.sensors import SensorPositions
from flashtemp.comparison.campaign import RecordingEntry
from flashtemp.discovery.hypotheses.candidates import ModelPoint
from flashtemp.discovery.parameters import ALL_CONDITIONS, ParameterId, ParameterKind

Array = npt.NDArray[np.float64]
# K: error of the cold junction of a logger, which all of its thermocouples share; data sheets state 0.5 to 1 K
COLD_JUNCTION_SD_K = 0.5
NAMED_POINTS = "the named points"  # points that campaigns name are read by one device in all recordings
SENSOR_STEP_FRACTION = 0.25  # of the uncertainty of a position or time constant: step of its derivative


def sensor_columns(predict_images: Callable[..., Array], recording: Recording, rise: Array) -> dict[ParameterId, Array]:
    """Derivatives by positions (K/m), time constants (K/s), gains (K) and zeros (1).

    `rise` (frames, 1, points) K: temperature above that of the air.
    """
    out: dict[ParameterId, Array] = {}
    places = recording.places
    assert places is not None

    def only_point(number: int, change: Array) -> Array:
        return np.where(np.arange(len(places)) == number, change, 0.0)

    uncertain = [row for row in _iter_bead_parameters(places) if row[-1] > 0]
    if uncertain:  # every perturbed point is a point of one recording, whose fields are interpolated once
        steps = SENSOR_STEP_FRACTION * np.array([sd for *_, sd in uncertain])
        moved = places.select_points(np.tile([i for i, *_ in uncertain], 2))
        for number, step in enumerate([*steps, *-steps]):
            moved = moved.perturb_key(uncertain[number % len(uncertain)][2], step, number)
        ahead, behind = np.split(predict_images(recording=_without_readings(recording, moved)), 2, axis=-1)
        slopes = (ahead - behind) / (2.0 * steps)
        out |= {p: only_point(i, slopes[..., [n]]) for n, (i, p, *_) in enumerate(uncertain)}
    for i, name in enumerate(places.names):
        if places.gain_sigma[i] > 0:
            out[sensor_gain_id(name, i)] = only_point(i, rise)
        if places.zero_sigma_K[i] > 0:
            out[sensor_zero_id(name, i)] = only_point(i, np.ones_like(rise))
    if np.any(places.zero_sigma_K):  # zeros that were corrected contain the cold junction
        out[cold_junction_id(places)] = np.where(places.zero_sigma_K > 0, np.ones_like(rise), 0.0)
    return out


def place_sensors(view: RecordingEntry, model: ModelPoint) -> Recording:
    """The recording with the positions and time constants that the model gives its points."""
    places = view.recording.places
    if places is None or not model.bead_offsets:
        return view.recording
    moved = places
    for i, p, key, _ in _iter_bead_parameters(places):
        moved = moved.perturb_key(key, model.bead_offsets.get(p.with_scope(ALL_CONDITIONS, view.file), 0.0), i)
    return replace(view.recording, places=moved)


def sensor_priors(views: Iterable[RecordingEntry]) -> dict[ParameterId, float]:
    """Standard deviations of positions (m), time constants (s), gains and zeros (K) of all points of recordings."""
    out: dict[ParameterId, float] = {}
    for v in views:
        places = v.recording.places
        if places is not None:
            out |= {p.with_scope(ALL_CONDITIONS, v.file): sd for _, p, _, sd in _iter_bead_parameters(places)}
            gains = zip(places.names, places.gain_sigma, strict=True)
            out |= {
                sensor_gain_id(name, i).with_scope(ALL_CONDITIONS, v.file): float(sd)
                for i, (name, sd) in enumerate(gains)
            }
            zeros = zip(places.names, places.zero_sigma_K, strict=True)
            out |= {
                sensor_zero_id(name, i).with_scope(ALL_CONDITIONS, v.file): float(sd)
                for i, (name, sd) in enumerate(zeros)
            }
            out[cold_junction_id(places).with_scope(ALL_CONDITIONS, v.file)] = COLD_JUNCTION_SD_K
    return out


def _without_readings(recording: Recording, places: SensorPositions) -> Recording:
    """The times of a recording with other points, whose readings are not known."""
    n = len(places)
    return replace(recording, temperature=np.zeros((recording.frames, 1, n)), u=np.arange(float(n)), places=places)


def _iter_bead_parameters(places: SensorPositions) -> Iterator[tuple[int, ParameterId, str, float]]:
    """Uncertain values of points: number, parameter, key of its table, standard deviation (m, s)."""
    for i, name in enumerate(places.names):
        for axis, key in enumerate("xyz"):
            yield i, _point_parameter(ParameterKind.PLACE, name, i, axis), key, float(places.place_sigma(axis)[i])
        yield i, _point_parameter(ParameterKind.LAG, name, i), "lag_s", float(places.lag_sigma_s[i])


def _point_parameter(kind: ParameterKind, name: str, number: int, *axis: int) -> ParameterId:
    """A parameter of a point: named points are one thermocouple in all recordings, unnamed ones are not."""
    return ParameterId(kind, (number, *axis)) if name.isdigit() else ParameterId(kind, axis, name=name)


def sensor_gain_id(name: str, number: int) -> ParameterId:
    """The gain of a point, identified in the same way."""
    return _point_parameter(ParameterKind.SENSOR, name, number)


def sensor_zero_id(name: str, number: int) -> ParameterId:
    """The zero error of a point, identified in the same way."""
    return _point_parameter(ParameterKind.ZERO, name, number)


def cold_junction_id(places: SensorPositions) -> ParameterId:
    """The error of the cold junction: one for named points in all recordings, else one for each recording."""
    is_named = not all(name.isdigit() for name in places.names)
    return ParameterId(ParameterKind.COLD_JUNCTION, name=NAMED_POINTS if is_named else "")
