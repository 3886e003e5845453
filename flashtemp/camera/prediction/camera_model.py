"""Camera model: clock, pixel positions, and the temperature that a camera reports for the radiance of its pixels."""

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

PSF_STEP_FRACTION = 0.01  # relative step of the point spread, for a numerical derivative
TYPICAL_EMISSIVITY = 0.95  # emissivity of a recording that states none


class CameraModel:
    """A camera and the instrument effects that act on it, for one recording; frames are stamped late by `clock` (s)."""

    def __init__(self, recording: Recording, acting: tuple[ActiveEffect, ...] = (), clock: float = 0.0):
        self.recording = recording
        self.clock = clock
        self.laws = [(part, a.p) for a in acting for part in a.effect.see(a.p)]

    def __call__(self, quantity: str, base):
        """A quantity of the camera: `base` plus the contributions of all effects, one value or one per frame."""
        now = SimpleNamespace(recording=self.recording, repetition=self.recording.repetition)
        return base + sum(part.law(None, now, p) for part, p in self.laws if part.target == f"camera.{quantity}")

    @property
    def psf_sigma(self) -> float:
        """Standard deviation of the Gaussian point spread, px; the quantity `camera.blur` of effects adds to it."""
        return float(self("blur", self.recording.psf_sigma_px or 0.0))

    def with_recording(self, recording: Recording) -> CameraModel:
        """The same camera with another recording."""
        other = copy(self)
        other.recording = recording
        return other

    def observed_times(self) -> np.ndarray:
        """Times (frames,) in s whose temperatures the frames show: the middle of the exposure minus the lag."""
        return self.recording.time - 0.5 * (self.recording.exposure_s or 0.0) - self("lag", self.clock)

    def required_times(self) -> np.ndarray:
        """Times (s) at which a run must keep its fields; for sensors also earlier ones that their lag depends on."""
        return (
            self.observed_times()
            if self.recording.places is None
            else required_times(self.recording.places, self.observed_times())
        )


@dataclass(frozen=True)
class ImageFormation:
    """Pixel axes of a camera along u and v and its radiometry.

    `emissivity` is the true one, `stated_emissivity` that set in the camera.  `reflected_counts` and
    `stated_reflected_counts` are the radiance of the reflected surroundings, true and as set in the camera;
    `background_counts` is the radiance of what surrounds the body in the image.
    """

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
        stated = recording.emissivity or (1.0 if recording.view == "profile" else TYPICAL_EMISSIVITY)
        reflected = background if recording.reflected_degC is None else recording.reflected_degC
        u, v = (_pixel_axis(camera, a, shift, place, scene.length) for a in (0, 1))
        return cls(
            camera, (u, v), place, scene.length, camera("emissivity", stated + change), stated,
            LONG_WAVE.counts(camera("reflected", reflected)), LONG_WAVE.counts(reflected), LONG_WAVE.counts(background),
        )  # fmt: skip

    @property
    def recording(self) -> Recording:
        return self.camera.recording

    def apparent_temperatures(self, body, nodes, kept: MatrixCache | None, slopes: bool) -> dict[str, np.ndarray]:
        """Temperatures that the camera reports of a `body` (frames, v nodes, u nodes) degC at `nodes` (m) along u, v.

        Returns them under the key "", (frames, nv, nu) degC, and with `slopes` the derivatives of `PredictedImage`.
        """
        # pixels average radiance (eq. (36)), and only the excess over the background: a body may end inside the image
        sampled = self._sample_light(LONG_WAVE.counts(body) - self.background_counts, nodes, kept, slopes)
        S = self.background_counts + sampled.seen
        # eq. (38): eps S + (1 - eps) S_reflected with the true values, solved for S with those set in the camera
        mirrored = (1.0 - self.emissivity) * self.reflected_counts
        apparent = (
            self.emissivity * S + mirrored - (1.0 - self.stated_emissivity) * self.stated_reflected_counts
        ) / self.stated_emissivity
        out = {"": LONG_WAVE.temperature(apparent)}
        if slopes:
            per_count = LONG_WAVE.temperature_per_count(apparent) / self.stated_emissivity
            out |= {
                name: per_count * self.emissivity * change
                for name, change in self._placement_derivatives(sampled).items()
            }
            out["gain"] = per_count * (S - self.reflected_counts)
        return out

    def _sample_light(self, light, nodes, kept: MatrixCache | None, slopes: bool) -> SampledImage:
        """Radiance of a body as the pixels average it."""
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

    def _placement_derivatives(self, sampled: SampledImage) -> dict[str, np.ndarray]:
        """Derivatives of the pixels' radiance with respect to shift, scale, rotation and point spread of the image.

        Scale and rotation move pixels along u and v.  A pixel whose variances along u and v differ also turns: that is
        the mixed derivative.
        """
        (u, v), (across, above) = self.axes, rotation_centre(self.recording, self.block_length)
        origin, magnification = scale_origin(self.recording, self.block_length), 1.0 + self.placement.scale
        square = self.recording.view == "profile" or u.variance == v.variance
        oblong = 0.0 if square else (u.variance - v.variance) * mixed_derivative(sampled.seen, u, v)
        x, y = u.centres, 0.0 if self.recording.view == "profile" else v.centres[:, None]
        by_scale = sampled.along_u * (x - origin) + sampled.along_v * y + sampled.by_scale
        return {
            "shift_u": sampled.along_u * u.pitch,
            "shift_v": sampled.along_v * v.pitch,
            "scale": by_scale / magnification,
            "turn": sampled.along_v * (x - across) - sampled.along_u * (y - above) + oblong,
            "spread": sampled.by_psf * self._psf_ratio,
        }

    @property
    def _psf_ratio(self) -> float:
        """Relative change of the point spread per relative change of the one that the recording states."""
        now = self.camera.psf_sigma
        if not now:
            return 0.0
        wide = replace(self.recording, psf_sigma_px=(1.0 + PSF_STEP_FRACTION) * (self.recording.psf_sigma_px or 0.0))
        return (self.camera.with_recording(wide).psf_sigma / now - 1.0) / PSF_STEP_FRACTION


def _pixel_axis(camera: CameraModel, axis: int, shift, place: ImagePlacement, length: float) -> PixelAxis:
    """Pixels along u (0) or v (1), with the camera's shift and the scale of the image."""
    recording, name = camera.recording, "uv"[axis]
    pitch = recording.pitch[axis]
    if not np.isfinite(pitch):  # a single row or column: square pixels
        pitch = next(p for p in (*recording.pitch, 1e-4) if np.isfinite(p))
    centres = (recording.u, recording.v)[axis] + camera(f"shift_{name}", shift[axis]) * pitch
    if place.scale:
        about = 0.0 if axis else scale_origin(recording, length)
        centres, pitch = about + (centres - about) * (1.0 + place.scale), pitch * (1.0 + place.scale)
    return PixelAxis(centres, pitch, camera.psf_sigma * pitch)
