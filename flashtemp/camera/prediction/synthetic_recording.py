"""Synthetic recordings of a run: pixels, noise, fixed pattern, dead pixels and an origin that is slightly off."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flashtemp.camera.prediction.camera_model import CameraModel
from flashtemp.camera.prediction.observation import check_view, observe
from flashtemp.camera.prediction.synthetic_camera_errors import SyntheticCamera
from flashtemp.camera.recording import Recording
from flashtemp.camera.sensors import SensorPositions
from flashtemp.physics.quantities import KELVIN

EMISSIVITY_AND_SD = 0.95, 0.01  # emissivity set in the camera, and the standard deviation of the true one
VIEW_GEOMETRY = {  # view: pixel pitch, margin around the body, visible road behind the block; all m
    "sidewall": (2.5e-4, 1e-3, None),
    "wake": (5e-4, 5e-3, 0.04),
    "profile": (2.5e-4, 0.0, None),
}


@dataclass(frozen=True)
class SyntheticRecordingErrors:
    """Errors that a recording does not state: shift in px, fixed pattern in K, true emissivity and point spread.

    For sensors: the errors of each position up the block, `astray` (m), of the gains and of the lags (s).
    """

    shift: tuple[float, float]
    pattern_K: float
    emissivity: float
    psf_sigma_px: float
    astray: tuple[float, ...] = ()
    gains: tuple[float, ...] = ()
    lags: tuple[float, ...] = ()


def empty_recording(view: str, scene, times, repetition, netd: float) -> Recording:
    """A recording of a view without images: pixels that cover the body, and the camera facts that its file states."""
    pitch, margin, behind = VIEW_GEOMETRY[view]
    length = scene.length

    def pixels(low, high):
        return np.arange(low + 0.5 * pitch, high, pitch)

    if view == "wake":
        u, v = pixels(length, length + behind), pixels(-0.5 * scene.width - margin, 0.5 * scene.width + margin)
    else:
        u = pixels(-margin, length + margin)
        v = np.zeros(1) if view == "profile" else pixels(-margin, scene.height + margin)
    frames = np.full((len(times), len(v), len(u)), scene.ambient - KELVIN)
    stated: dict[str, Any] = {} if view == "profile" else {"emissivity": EMISSIVITY_AND_SD[0], "psf_sigma_px": 0.7}
    recording = Recording(
        view, frames, np.asarray(times), np.asarray(repetition), u, v, netd_K=netd,
        reflected_degC=None if view == "profile" else scene.ambient - KELVIN,
        registration_sigma_px=None if view == "profile" else 0.2, source="synthetic", **stated,
    )  # fmt: skip
    check_view(recording, scene, view)
    return recording


def empty_sensor_recording(places: SensorPositions, scene, times, repetition, netd: float) -> Recording:
    """A recording of thermocouples without readings."""
    frames = np.full((len(times), 1, len(places)), scene.ambient - KELVIN)
    return Recording(
        "points", frames, np.asarray(times), np.asarray(repetition), np.arange(len(places), dtype=float), np.zeros(1),
        netd_K=netd, source="synthetic", places=places,
    )  # fmt: skip


def draw_errors(recording: Recording, rng, nuisance: float) -> SyntheticRecordingErrors:
    """Random errors of a recording; `nuisance` scales all of them but the fixed pattern."""
    if recording.places is not None:
        places = recording.places
        n = len(places)
        astray = nuisance * places.depth_sigma_m * rng.normal(size=n)
        known = (places.gain_sigma, places.lag_sigma_s)
        gains, lags = (nuisance * sd * rng.normal(size=n) if sd.any() else np.zeros(n) for sd in known)
        return SyntheticRecordingErrors((0.0, 0.0), 0.0, 1.0, 0.0, tuple(astray), tuple(gains), tuple(lags))
    sigma = recording.registration_sigma_px or 0.0
    along, up = (float(s) for s in nuisance * sigma * rng.normal(size=2))
    pattern = 0.0 if recording.view == "profile" else float(rng.uniform(0.02, 0.05))
    stated = recording.emissivity or 1.0
    truth = min(stated + nuisance * EMISSIVITY_AND_SD[1] * float(rng.normal()), 1.0)
    spread = (recording.psf_sigma_px or 0.0) * (1.0 + 0.05 * nuisance * float(rng.normal()))
    return SyntheticRecordingErrors((along, up), pattern, truth if recording.emissivity else 1.0, spread)


def render_recording(
    run,
    scene,
    recording: Recording,
    faults: SyntheticRecordingErrors,
    rng,
    dead: float = 1e-3,
    camera: SyntheticCamera | None = None,
) -> Recording:
    """The recording with its images: the predicted image of a run, and noise.

    The camera turns radiance back with the emissivity that is set in it, whatever the true one.  A `camera` with
    further errors writes a number for every pixel; without one, the fraction `dead` of the pixels is NaN.
    """
    if recording.places is not None:
        true = recording.places
        for i, off in enumerate(faults.astray):
            true = true.perturb_key("z", float(np.clip(true.z[i] + off, 0.0, scene.height) - true.z[i]), i)
        for i, late in enumerate(faults.lags):
            true = true.perturb_key("lag_s", max(late, -float(true.lag_s[i])), i)
        T = observe(run, scene, replace(recording, places=true), scene.acting).temperature
        T = T + (T - scene.ambient + KELVIN) * np.array(faults.gains or 0.0)
        return replace(recording, temperature=T + (recording.netd_K or 0.0) * rng.normal(size=T.shape))
    change = 0.0 if recording.emissivity is None else faults.emissivity - recording.emissivity
    blurred = replace(recording, psf_sigma_px=None if recording.psf_sigma_px is None else faults.psf_sigma_px)
    predicted = observe(run, scene, blurred, scene.acting, faults.shift, change)
    shape, T = recording.temperature.shape, predicted.temperature
    if camera is not None:
        T = camera.distort(T, sliding_speed(scene.schedule, recording.time) / recording.pitch[0])
    T = T + faults.pattern_K * rng.normal(size=shape[1:])
    T = T + (recording.netd_K or 0.0) * rng.normal(size=shape)
    if camera is not None:
        T = camera.degrade(T, recording.time, rng)
    elif recording.view != "profile":
        T[:, rng.random(shape[1:]) < dead] = np.nan
    return replace(recording, temperature=T)


def sliding_speed(schedule, times) -> np.ndarray:
    """Signed speed (frames,) m/s of the block along u at `times` (s), 0 while it does not slide."""
    phases = [schedule.phase_at(float(t)) for t in times]
    return np.array([p.sliding * p.direction * schedule.speed(t - p.start) for p, t in zip(phases, times, strict=True)])


def frame_schedule(schedule, sliding: int, waiting: int, crowding: float = 1.5) -> tuple[np.ndarray, np.ndarray]:
    """Times (s) and repetitions of `sliding` and `waiting` frames per repetition, dense after each start.

    With a `crowding` of 1 they are evenly spaced, as a camera that runs all the time takes them.
    """
    times, repetition = [], []
    for r in range(1, schedule.repetitions + 1):
        phases = [p for p in schedule.phases if p.repetition == r]
        for on, count in ((True, sliding), (False, waiting)):
            part = [p for p in phases if p.sliding == on]
            if not part or not count:
                continue
            begin, end = part[0].begin, part[-1].end
            times += list(begin + (end - begin) * (np.arange(1, count + 1) / count) ** crowding)
            repetition += [r] * count
    return np.array(times), np.array(repetition)


def exposure_times(recording: Recording, acting) -> np.ndarray:
    """Times (frames,) in s that the frames show."""
    return CameraModel(recording, acting).required_times()
