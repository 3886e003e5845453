"""What is not known better of a thermocouple: its place along x, y and z, and the gain with which it shows its rise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from flashtemp.camera.recording import Recording
from flashtemp.comparison.campaign import View
from flashtemp.discovery.hypothesis import Model
from flashtemp.discovery.parameters import ALL, Kind, ParameterId

Array = npt.NDArray[np.float64]
AWAY = 0.25  # of what is known of the place of a point: step of its derivative


def columns(see: Callable[..., Array], recording: Recording, rise: Array) -> dict[ParameterId, Array]:
    """What thermocouples' places change (K/m), and their gains (K): the `rise` (frames, 1, points) over the air."""
    out: dict[ParameterId, Array] = {}
    places = recording.places
    assert places is not None
    for i in np.flatnonzero((places.place_sigma_m > 0) | (places.depth_sigma_m > 0)):
        for axis, name in enumerate("xyz"):
            step = AWAY * float(places.place_sigma(axis)[i])
            if step > 0:
                moved = (replace(recording, places=places.moved(name, s, int(i))) for s in (step, -step))
                ahead, behind = (see(recording=r) for r in moved)
                out[placed(places.names[i], int(i), axis)] = (ahead - behind) / (2.0 * step)
    for i in np.flatnonzero(places.gain_sigma > 0):
        out[gain_of(places.names[i], int(i))] = np.where(np.arange(len(places)) == i, rise, 0.0)
    return out


def where(view: View, model: Model) -> Recording:
    """The recording with its points where the model has them."""
    recording = view.recording
    for i, name in enumerate(recording.places.names if recording.places is not None and model.beads else ()):
        for axis, along in enumerate("xyz"):
            step = model.beads.get(placed(name, i, axis).within(ALL, view.file), 0.0)
            if step and recording.places is not None:
                recording = replace(recording, places=recording.places.moved(along, step, i))
    return recording


def placed(name: str, number: int, axis: int) -> ParameterId:
    """The place of a point along an axis: a name is that of one thermocouple in all recordings, a number is not."""
    return ParameterId(Kind.PLACE, (number, axis)) if name.isdigit() else ParameterId(Kind.PLACE, (axis,), name=name)


def gain_of(name: str, number: int) -> ParameterId:
    """The gain of a point, likewise."""
    return ParameterId(Kind.SENSOR, (number,)) if name.isdigit() else ParameterId(Kind.SENSOR, name=name)
