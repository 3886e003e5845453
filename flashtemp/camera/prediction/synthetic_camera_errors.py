"""Errors of real infrared cameras for synthetic recordings: drift, shutter, maps, lag, line noise, bad pixels.

Magnitudes of uncooled microbolometers: Nugent, Shaw & Pust, Opt. Eng. 52, 061304 (2013) and 53, 123106 (2014) for
drift; Thomassen & van Rheenen, Proc. SPIE 11536, 115360F (2020) for large-scale nonuniformity; D'Agostino & Webb,
Proc. SPIE 1488, 110 (1991) for noise of rows and columns; Budzier & Gerlach, J. Sens. Sens. Syst. 10, 179 (2021) for
stray light; data sheets of FLIR A35/A65 and Optris PI 640 for the time constant of 8 to 12 ms, counts and ranges.

Cooled photon detectors integrate for a millisecond or less and need no shutter for hours, but they see their own cold
image, narcissus (Howard & Abel, Appl. Opt. 21, 3393, 1982; Vollmer & Moellmann, Infrared Thermal Imaging, 2nd ed. 2018,
ch. 2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flashtemp.camera.camera_classes import COOLED, UNCOOLED

IDEAL = "ideal"
CAMERA_KINDS = (IDEAL, UNCOOLED, COOLED)
FLICKERING_SHARE = 0.3  # of the bad pixels; the others are stuck at a value
FLICKER_PROBABILITY = 0.25  # of a frame in which a flickering pixel is off its value


@dataclass(frozen=True)
class SyntheticCameraErrors:
    """Errors that one camera adds to its recordings; lengths without a unit are fractions of the image."""

    wander_K_per_sqrt_s: float  # Wiener process of the offset between two closings of the shutter
    offset_sd_K: float  # left after the shutter has closed
    shutter_interval_s: float
    repeated_frames: float  # while the shutter is closed
    warming_K: float  # of the lens, from the first frame to the last
    warming_gradient: float  # relative difference of the warming from edge to edge
    lamp_K: float  # apparent temperature excess of its mirror image
    lamp_width: float
    narcissus_K: float
    vignetting: float  # of the contrast against the housing, in the farthest corner
    housing_degC: float
    stray_light: float  # fraction of the light of every point that is scattered
    stray_sigma_px: float
    response_s: float  # of a pixel
    untracked_speed: float  # of the scene through the image, as a fraction of the sliding speed
    row_pattern_K: float
    column_pattern_K: float
    row_noise_K: float
    column_noise_K: float
    bad_pixels: float  # fraction of all pixels
    bad_rows: float
    bad_columns: float
    count_K: float
    lowest_degC: float
    highest_degC: float
    renewed_pattern: float  # fraction of the variance of row and column patterns that the shutter renews


ERROR_RANGES = {  # of random uncooled and cooled cameras; numbers of frames and lines are rounded down
    "wander_K_per_sqrt_s": ((0.005, 0.03), (5e-4, 3e-3)),
    "offset_sd_K": ((0.05, 0.2), (0.01, 0.05)),
    "shutter_interval_s": ((5.0, 40.0), (600.0, 3600.0)),
    "repeated_frames": ((1.0, 4.0), (1.0, 4.0)),
    "warming_K": ((0.1, 0.3), (0.01, 0.05)),
    "warming_gradient": ((0.0, 0.3), (0.0, 0.1)),
    "lamp_K": ((0.1, 0.5), (0.05, 0.3)),
    "lamp_width": ((0.15, 0.45), (0.15, 0.45)),
    "narcissus_K": ((0.01, 0.05), (0.03, 0.1)),
    "vignetting": ((3e-3, 0.01), (1e-3, 4e-3)),
    "housing_degC": ((27.0, 38.0), (25.0, 32.0)),
    "stray_light": ((0.01, 0.03), (5e-3, 0.015)),
    "stray_sigma_px": ((5.0, 15.0), (5.0, 15.0)),
    "response_s": ((8e-3, 0.012), (2e-4, 1e-3)),
    "untracked_speed": ((-0.2, 0.2), (-0.2, 0.2)),
    "row_pattern_K": ((0.02, 0.05), (5e-3, 0.015)),
    "column_pattern_K": ((0.02, 0.05), (5e-3, 0.015)),
    "row_noise_K": ((0.01, 0.02), (2e-3, 6e-3)),
    "column_noise_K": ((0.01, 0.02), (2e-3, 6e-3)),
    "bad_pixels": ((5e-4, 2e-3), (1e-4, 1e-3)),
    "bad_rows": ((0.0, 3.0), (0.0, 0.0)),
    "bad_columns": ((0.0, 3.0), (0.0, 0.0)),
    "count_K": ((0.01, 0.04), (2e-3, 0.01)),
    "lowest_degC": ((-25.0, -20.0), (-20.0, -10.0)),
    "highest_degC": ((100.0, 135.0), (80.0, 150.0)),
    "renewed_pattern": ((0.0, 0.4), (0.0, 0.2)),
}


@dataclass(frozen=True)
class SyntheticCamera:
    """A camera with its errors; `seed` fixes its constant ones: maps, patterns and bad pixels."""

    errors: SyntheticCameraErrors
    seed: tuple[int, ...]

    @classmethod
    def draw_random(cls, camera_class: str, seed: tuple[int, ...]) -> SyntheticCamera:
        """A random camera of a class, uncooled or cooled."""
        rng = np.random.default_rng((*seed, 1))
        column = (UNCOOLED, COOLED).index(camera_class)
        values = {name: float(rng.uniform(*spans[column])) for name, spans in ERROR_RANGES.items()}
        return cls(SyntheticCameraErrors(**values), seed)

    def distort(self, images: np.ndarray, speed_px: np.ndarray) -> np.ndarray:
        """Images (frames, nv, nu) degC after stray light, pixel lag and vignetting, before any noise.

        `speed_px` (frames,) px/s: sliding speed of the block, positive along u.
        """
        from scipy.ndimage import gaussian_filter1d

        e = self.errors
        wide = gaussian_filter1d(images, e.stray_sigma_px, axis=2, mode="nearest")
        wide = gaussian_filter1d(wide, e.stray_sigma_px, axis=1, mode="nearest")
        scattered = images + e.stray_light * (wide - images)
        length = e.response_s * e.untracked_speed * np.asarray(speed_px)
        lagged = np.stack(
            [_apply_pixel_lag(image, float(pixels)) for image, pixels in zip(scattered, length, strict=True)]
        )
        return e.housing_degC + (1.0 - self._vignetting_loss(images.shape[1:])) * (lagged - e.housing_degC)

    def degrade(self, images: np.ndarray, time: np.ndarray, rng) -> np.ndarray:
        """The values that the camera writes for noisy images (frames, nv, nu) degC taken at `time` (frames,) s."""
        e, shape = self.errors, images.shape[1:]
        closings = shutter_closings(time, e.shutter_interval_s, rng)
        out = images + self._static_offset(shape) + self._warming_offset(time, shape)
        out = out + self._renewed_lines(time, closings, shape, rng.spawn(1)[0])
        out = out + _draw_offset_drift(time, closings, e, rng)[:, None, None]
        out = out + e.row_noise_K * rng.normal(size=(len(time), shape[0], 1))
        out = out + e.column_noise_K * rng.normal(size=(len(time), 1, shape[1]))
        out = self._add_bad_pixels(out, rng)
        out = np.clip(np.rint(out / e.count_K) * e.count_K, e.lowest_degC, e.highest_degC)
        return _repeat_shutter_frames(out, time, closings, int(e.repeated_frames))

    def _vignetting_loss(self, shape) -> np.ndarray:
        """Loss (nv, nu) of contrast: 1 - cos^4 of the angle to the axis, which is the middle of the image."""
        off = np.hypot(*_image_positions(shape))
        slope = np.sqrt((1.0 - self.errors.vignetting) ** -0.5 - 1.0)  # tangent of the angle in the corner
        return 1.0 - (1.0 + (slope * off / max(off.max(), 1e-12)) ** 2) ** -2

    def _static_offset(self, shape) -> np.ndarray:
        """Constant offset (nv, nu) K: lamp, narcissus, patterns of rows and columns."""
        e, rng = self.errors, np.random.default_rng((*self.seed, 2))
        y, x = _image_positions(shape)
        (lamp_y, lamp_x), radius = 0.4 * rng.uniform(-1.0, 1.0, 2), rng.uniform(0.15, 0.35)
        lamp = np.exp(-((x - lamp_x) ** 2 + (y - lamp_y) ** 2) / (2.0 * e.lamp_width**2))
        ring = np.exp(-(((np.hypot(x, y) - radius) / 0.08) ** 2) / 2.0)
        rows, columns = rng.normal(size=(shape[0], 1)), rng.normal(size=(1, shape[1]))
        lines = np.sqrt(1.0 - e.renewed_pattern) * (e.row_pattern_K * rows + e.column_pattern_K * columns)
        return e.lamp_K * lamp - e.narcissus_K * ring + lines

    def _renewed_lines(self, time, closings, shape, rng) -> np.ndarray:
        """Part (frames, nv, nu) K of the patterns of rows and columns that is new after each closing of the shutter."""
        e, interval = self.errors, np.searchsorted(closings, time, side="right")
        rows = e.row_pattern_K * rng.normal(size=(len(closings) + 1, shape[0], 1))
        columns = e.column_pattern_K * rng.normal(size=(len(closings) + 1, 1, shape[1]))
        return np.asarray(np.sqrt(e.renewed_pattern) * (rows + columns)[interval])

    def _warming_offset(self, time, shape) -> np.ndarray:
        """Offset (frames, nv, nu) K of a lens that warms up linearly, along one direction more than across it."""
        angle = np.random.default_rng((*self.seed, 3)).uniform(0.0, 2.0 * np.pi)
        y, x = _image_positions(shape)
        uneven = 1.0 + self.errors.warming_gradient * (np.cos(angle) * x + np.sin(angle) * y)
        elapsed = (time - time[0]) / max(float(time[-1] - time[0]), 1e-9)
        return self.errors.warming_K * elapsed[:, None, None] * uneven

    def bad_pixels(self, shape) -> list[np.ndarray]:
        """Masks (nv, nu) of pixels that are stuck or flicker together: single ones, pairs, rows and columns."""
        e, rng = self.errors, np.random.default_rng((*self.seed, 4))
        masks, wanted = [], round(e.bad_pixels * shape[0] * shape[1])
        while wanted > 0:
            mask = np.zeros(shape, bool)
            i, j = int(rng.integers(shape[0])), int(rng.integers(shape[1]))
            mask[i, j : j + (2 if rng.random() < 0.3 else 1)] = True
            wanted -= int(mask.sum())
            masks.append(mask)
        for axis, count in ((0, int(e.bad_rows)), (1, int(e.bad_columns))):
            if shape[axis] == 1:
                continue
            for line in rng.choice(shape[axis], size=min(count, shape[axis]), replace=False):
                mask = np.zeros(shape, bool)
                mask[(line, slice(None)) if axis == 0 else (slice(None), line)] = True
                masks.append(mask)
        return masks

    def _add_bad_pixels(self, images, rng) -> np.ndarray:
        out, constant_rng = images.copy(), np.random.default_rng((*self.seed, 5))
        for mask in self.bad_pixels(images.shape[1:]):
            off = float(constant_rng.choice([-1.0, 1.0]) * constant_rng.uniform(0.5, 20.0))
            if constant_rng.random() < FLICKERING_SHARE:
                out[:, mask] += np.clip(off, -2.0, 2.0) * (rng.random(len(out)) < FLICKER_PROBABILITY)[:, None]
            else:
                out[:, mask] = self.errors.housing_degC + off
        return out


def _image_positions(shape) -> tuple[np.ndarray, np.ndarray]:
    """Positions (nv, 1) and (1, nu) from the middle of the image, as fractions of its longer side."""
    longest = max(*shape, 2) - 1.0
    y, x = ((np.arange(n) - 0.5 * (n - 1.0)) / longest for n in shape)
    return y[:, None], x[None, :]


def _apply_pixel_lag(image: np.ndarray, length: float) -> np.ndarray:
    """Image (nv, nu) of pixels with a time constant in which the scene moves by `length` px along u.

    A first-order response to a scene that is linear between pixels, integrated exactly.
    """
    from scipy.signal import lfilter

    if not length:
        return image
    ahead = image[:, ::-1] if length > 0.0 else image
    decay = np.exp(-1.0 / abs(length))
    neighbour = abs(length) * (1.0 - decay) - decay
    weights = [1.0 - decay - neighbour, neighbour]
    state = (1.0 - weights[0]) * ahead[:, :1]
    late, _ = lfilter(weights, [1.0, -decay], ahead, axis=1, zi=state)
    return late[:, ::-1] if length > 0.0 else late


def shutter_closings(time: np.ndarray, interval: float, rng) -> np.ndarray:
    """Times (s) at which the shutter closes during a recording, the first after a random part of the interval."""
    first = time[0] + interval * rng.random()
    return np.arange(first, time[-1], interval)


def _draw_offset_drift(time, closings, errors: SyntheticCameraErrors, rng) -> np.ndarray:
    """Offset (frames,) K: a Wiener process that starts again from a new random offset after each shutter closing."""
    interval = np.searchsorted(closings, time, side="right")
    starts = np.concatenate([time[:1], closings])
    out = np.empty(len(time))
    for number in np.unique(interval):
        within = interval == number
        steps = np.diff(time[within], prepend=starts[number])
        walk = np.cumsum(np.sqrt(np.maximum(steps, 0.0)) * rng.normal(size=len(steps)))
        out[within] = errors.offset_sd_K * rng.normal() + errors.wander_K_per_sqrt_s * walk
    return out


def _repeat_shutter_frames(images, time, closings, count: int) -> np.ndarray:
    """Images of which `count` after each shutter closing repeat the last one before it."""
    show = np.arange(len(time))
    for closing in closings:
        first = int(np.searchsorted(time, closing))
        if first:
            show[first : first + count] = show[first - 1]
    return images[show]
