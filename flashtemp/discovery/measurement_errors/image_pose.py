"""Registration of images that are far from their stated positions, with the predicted mean image, before any fit.

A pixel that crosses the edge of the block changes by kelvins, so Gauss-Newton steps cannot correct an image that was
rotated by two degrees about its far corner.  Shifting and rotating the predicted mean image as a whole can.  The
registered pose is a second starting point of the same fit; it is used if the evidence of the recording alone is clearly
larger there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from flashtemp.camera.image_placement import STATED_PLACEMENT, ImagePlacement, rotation_centre, scale_origin
from flashtemp.camera.recording import Recording
from flashtemp.discovery.estimation.nuisance_priors import NUISANCE_SD, position_sd_px
from flashtemp.discovery.hypotheses.candidates import KEY_PRIOR_SD, ModelPoint
from flashtemp.discovery.parameters import ParameterKind
from flashtemp.discovery.prediction.prediction import Observable
from flashtemp.discovery.prediction.problem import Problem

Array = npt.NDArray[np.float64]
# Factor by which unknown friction may change all rises: three standard deviations of its prior
MAX_RISE_FACTOR = float(np.exp(3.0 * KEY_PRIOR_SD["friction.mu"]))
START_TURNS_SD = (0.0, -2.0, 2.0)  # starting points, in standard deviations of a usual turn
MAX_ALIGNED_SHIFT_PX = 1.0  # displacement that Gauss-Newton steps follow: the contrast at an edge bends over a pixel


@dataclass(frozen=True)
class ImagePose:
    """The position of an image: its `place` (scale, rotation) and its `shift` (px along u and v)."""

    place: ImagePlacement = STATED_PLACEMENT
    shift: tuple[float, float] = (0.0, 0.0)

    def apply_to(self, model: ModelPoint, file: str) -> ModelPoint:
        """The model with the image of a recording in this pose."""
        return replace(
            model, placements=model.placements | {file: self.place}, shifts=model.shifts | {file: self.shift}
        )


STATED_POSE = ImagePose()


def with_poses(problem: Problem, poses: dict[str, ImagePose]) -> Problem:
    """The problem with other starting poses of images, by file."""
    places = {file: pose.place for file, pose in poses.items()}
    shifts = {file: pose.shift for file, pose in poses.items()}
    return replace(problem, placements=problem.placements | places, shifts=problem.shifts | shifts)


def register_image(problem: Problem, recording: Recording, predicted: Observable) -> ImagePose | None:
    """The pose in which the predicted mean image fits a side wall best.

    None if the image shows no edge, or if it is so near that the alignment of every fit finds its position.
    """
    from scipy.optimize import least_squares

    if (
        recording.view != "sidewall"
        or not recording.registration_sigma_px
        or min(len(recording.u), len(recording.v)) < 2
    ):
        return None
    picture = _MeanImage(problem, recording, predicted)
    if picture.measured.size < 4:
        return None
    ends = [least_squares(picture.residuals, [0.0, 0.0, 0.0, turn]) for turn in START_TURNS_SD]
    best = min(ends, key=lambda end: float(end.cost)).x
    pose = picture.to_pose(best)
    return pose if is_far_from(recording, picture.length, pose, STATED_POSE) else None


def displace_pixels(recording: Recording, length: float, pose: ImagePose, u: Array, v: Array) -> tuple[Array, Array]:
    """Where pixels at stated u and v (m) of a wall of a block of a `length` (m) lie in a pose, as `observe` has it."""
    pitch, about = recording.pitch, rotation_centre(recording, length)
    grown, start = 1.0 + pose.place.scale, scale_origin(recording, length)
    x = start + (u + pose.shift[0] * pitch[0] - start) * grown - about[0]
    y = (v + pose.shift[1] * pitch[1]) * grown - about[1]
    cos, sin = np.cos(pose.place.turn), np.sin(pose.place.turn)
    return about[0] + x * cos - y * sin, about[1] + y * cos + x * sin


def is_far_from(recording: Recording, length: float, pose: ImagePose, other: ImagePose) -> bool:
    """Whether a corner of the image is too far from its position in another pose for an alignment to get there."""
    u, v = (a.ravel() for a in np.meshgrid(recording.u[[0, -1]], recording.v[[0, -1]]))
    (x, y), (X, Y) = (displace_pixels(recording, length, p, u, v) for p in (pose, other))
    return bool(np.max(np.hypot((x - X) / recording.pitch[0], (y - Y) / recording.pitch[1])) > MAX_ALIGNED_SHIFT_PX)


class _MeanImage:
    """Mean measured rise (pixels,) K and the mean predicted one as displaced pixels see it.

    `z` (4,) holds a shift along u and v in px, and a scale and a turn in their prior standard deviations.
    """

    def __init__(self, problem: Problem, recording: Recording, predicted: Observable):
        from scipy.ndimage import spline_filter

        ambient = problem.case["ambient.temperature"]
        difference = recording.temperature - predicted.values
        known = predicted.inside & np.isfinite(difference).any(axis=0)
        mean = np.nan_to_num(predicted.values.mean(axis=0) - ambient)
        self.recording = recording
        # differences are averaged, so that frames without a value for a pixel do not count for it
        self.measured: Array = mean[known] + np.nanmean(difference[:, known], axis=0)
        self.predicted = spline_filter(mean, mode="nearest")
        self.u, self.v = (a[known] for a in np.meshgrid(recording.u, recording.v))
        self.length: float = problem.case["block.length"]
        self.noise = max(float(np.sqrt(np.mean(self.rise_difference(np.zeros(4)) ** 2))) if known.any() else 0.0, 1e-12)

    def to_pose(self, z: Array) -> ImagePose:
        scale, turn = NUISANCE_SD[ParameterKind.SCALE] * z[2], NUISANCE_SD[ParameterKind.TURN] * z[3]
        return ImagePose(ImagePlacement(scale=float(scale), turn=float(turn)), (float(z[0]), float(z[1])))

    def rise_difference(self, z: Array) -> Array:
        """Measured minus predicted (pixels,) K, with rises scaled by a factor that unknown friction may explain."""
        from scipy.ndimage import map_coordinates

        x, y = displace_pixels(self.recording, self.length, self.to_pose(z), self.u, self.v)
        centres = (y, self.recording.v), (x, self.recording.u)
        pixels = [np.interp(at, c, np.arange(len(c))) for at, c in centres]
        rise = map_coordinates(self.predicted, pixels, order=3, mode="nearest", prefilter=False)
        factor = np.clip(self.measured @ rise / max(float(rise @ rise), 1e-300), 1.0 / MAX_RISE_FACTOR, MAX_RISE_FACTOR)
        return np.asarray(self.measured - factor * rise)

    def residuals(self, z: Array) -> Array:
        """Differences in units of those in the stated pose (Birge's ratio), and pulls of the pose's priors."""
        pose = self.to_pose(z)
        pulls = [s / position_sd_px(self.recording, pose.place, axis) for axis, s in enumerate(pose.shift)]
        return np.concatenate([self.rise_difference(z) / self.noise, pulls, z[2:]])
