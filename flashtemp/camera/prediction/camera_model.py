"""A camera with what acts on it: its clock, where its pixels lie, and what it makes of the light that they get."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np

from flashtemp.camera.image_placement import ImagePlacement, rotation_centre, scale_origin
from flashtemp.camera.prediction.pixel_sampling import (
    MatrixCache,
    PixelAxis,
    SampledImage,
    mixed_derivative,
    sample_aligned,
    sample_rotated,
)
from flashtemp.camera.prediction.sensor_observation import required_times
from flashtemp.camera.radiometry import LONG_WAVE
from flashtemp.camera.recording import Recording
from flashtemp.model.scene import ActiveEffect, Scene
from flashtemp.physics.quantities import KELVIN

BLUR_STEP_FRACTION = 0.01  # share of a point spread: step of what follows from it
TYPICAL_EMISSIVITY = 0.95  # emissivity where a recording does not say


class CameraModel:
    """The camera with what acts on it: values of its quantities for a recording, stamped late by `clock` (s)."""

    def __init__(self, recording: Recording, acting: tuple[ActiveEffect, ...] = (), clock: float = 0.0):
        self.recording = recording
        self.clock = clock
        self.laws = [(part, a.p) for a in acting for part in a.effect.see(a.p)]

    def __call__(self, quantity: str, base):
        """A quantity of the camera: `base` plus all that acts on it; numbers, or one value for every frame."""
        now = SimpleNamespace(recording=self.recording, repetition=self.recording.repetition)
        return base + sum(part.law(None, now, p) for part, p in self.laws if part.target == f"camera.{quantity}")

    @property
    def blur(self) -> float:
        """Width of the point spread, px."""
        return float(self("blur", self.recording.psf_sigma_px or 0.0))

    def with_recording(self, recording: Recording) -> CameraModel:
        """The same camera with another recording."""
        other = copy(self)
        other.recording = recording
        return other

    def observed_times(self) -> np.ndarray:
        """Times (frames,) in s whose temperatures the frames show: the middle of the exposure, less the lag."""
        return self.recording.time - 0.5 * (self.recording.exposure_s or 0.0) - self("lag", self.clock)

    def required_times(self) -> np.ndarray:
        """Times (s) at which a run must keep its fields: those, and for points what their lag remembers."""
        return (
            self.observed_times()
            if self.recording.places is None
            else required_times(self.recording.places, self.observed_times())
        )


@dataclass(frozen=True)
class ImageFormation:
    """A camera's axes along u and v and its radiometry: `emissivity` true and `stated_emissivity`, counts that are `reflected_counts` truly
    and as told, and of what is `background_counts` the body."""

    camera: CameraModel
    axes: tuple[PixelAxis, PixelAxis]
    placement: ImagePlacement
    block_length: float
    emissivity: float
    stated_emissivity: float
    reflected_counts: float
    stated_reflected_counts: float
    background_counts: float

    @classmethod
    def from_camera(
        cls, camera: CameraModel, scene: Scene, shift, change: float, place: ImagePlacement
    ) -> ImageFormation:
        recording, background = camera.recording, scene.ambient - KELVIN
        given = recording.emissivity or (1.0 if recording.view == "profile" else TYPICAL_EMISSIVITY)
        reflected = background if recording.reflected_degC is None else recording.reflected_degC
        u, v = (_pixel_axis(camera, a, shift, place, scene.length) for a in (0, 1))
        return cls(
            camera, (u, v), place, scene.length, camera("emissivity", given + change), given,
            LONG_WAVE.counts(camera("reflected", reflected)), LONG_WAVE.counts(reflected), LONG_WAVE.counts(background),
        )  # fmt: skip

    @property
    def recording(self) -> Recording:
        return self.camera.recording

    def apparent_temperatures(self, body, nodes, kept: MatrixCache | None, slopes: bool) -> dict[str, np.ndarray]:
        """Temperatures "" (frames, nv, nu) degC of pixels before a `body` (frames, v nodes, u nodes) degC with `nodes`
        (m) along u and v, and `Seen.slopes`."""
        got = self._sample_light(LONG_WAVE.counts(body) - self.background_counts, nodes, kept, slopes)
        S = self.background_counts + got.seen
        mirrored = (1.0 - self.emissivity) * self.reflected_counts
        told = (
            self.emissivity * S + mirrored - (1.0 - self.stated_emissivity) * self.stated_reflected_counts
        ) / self.stated_emissivity
        out = {"": LONG_WAVE.temperature(told)}
        if slopes:
            steep = LONG_WAVE.temperature_per_count(told) / self.stated_emissivity
            out |= {name: steep * self.emissivity * change for name, change in self._placement_derivatives(got).items()}
            out["gain"] = steep * (S - self.reflected_counts)
        return out

    def _sample_light(self, light, nodes, kept: MatrixCache | None, slopes: bool) -> SampledImage:
        """What pixels get of the light of a body."""
        if self.recording.view == "profile":
            return sample_aligned(light, nodes, (self.axes[0], None), slopes)
        if self.placement.turn:
            return sample_rotated(
                light,
                nodes,
                self.axes,
                self.placement.turn,
                rotation_centre(self.recording, self.block_length),
                kept,
                slopes,
            )
        return sample_aligned(light, nodes, self.axes, slopes)

    def _placement_derivatives(self, got: SampledImage) -> dict[str, np.ndarray]:
        """What light changes as the image lies otherwise: scale and turn move pixels along u and v, and turn them."""
        (u, v), (across, above) = self.axes, rotation_centre(self.recording, self.block_length)
        origin, grown = scale_origin(self.recording, self.block_length), 1.0 + self.placement.scale
        square = self.recording.view == "profile" or u.variance == v.variance
        oblong = 0.0 if square else (u.variance - v.variance) * mixed_derivative(got.seen, u, v)
        x, y = u.centres, 0.0 if self.recording.view == "profile" else v.centres[:, None]
        larger = got.along_u * (x - origin) + got.along_v * y + got.larger
        return {
            "shift_u": got.along_u * u.pitch,
            "shift_v": got.along_v * v.pitch,
            "scale": larger / grown,
            "turn": got.along_v * (x - across) - got.along_u * (y - above) + oblong,
            "spread": got.wider * self._blur_ratio,
        }

    @property
    def _blur_ratio(self) -> float:
        """Share by which the point spread is wider per share of what the recording tells of it."""
        now = self.camera.blur
        if not now:
            return 0.0
        wide = replace(self.recording, psf_sigma_px=(1.0 + BLUR_STEP_FRACTION) * (self.recording.psf_sigma_px or 0.0))
        return (self.camera.with_recording(wide).blur / now - 1.0) / BLUR_STEP_FRACTION


def _pixel_axis(camera: CameraModel, axis: int, shift, place: ImagePlacement, length: float) -> PixelAxis:
    """Pixels along u (0) or v (1) with the camera's shift and the image's scale."""
    recording, name = camera.recording, "uv"[axis]
    pitch = recording.pitch[axis]
    if not np.isfinite(pitch):
        pitch = next(p for p in (*recording.pitch, 1e-4) if np.isfinite(p))
    centres = (recording.u, recording.v)[axis] + camera(f"shift_{name}", shift[axis]) * pitch
    if place.scale:
        about = 0.0 if axis else scale_origin(recording, length)
        centres, pitch = about + (centres - about) * (1.0 + place.scale), pitch * (1.0 + place.scale)
    return PixelAxis(centres, pitch, camera.blur * pitch)
