"""Errors of real uncooled microbolometer cameras, applied to the apparent temperatures that an ideal camera would show.

The signal passes lens, bolometers, readout and shutter in this order, and each of them adds its errors:

1. lens: a wide halo beside the point spread, vignetting, narcissus and the reflection of a lamp;
2. bolometers: a first-order response in time, which smears a scene that moves through the image;
3. readout: temporal and fixed noise of the frame, of rows and of columns, stuck and flickering pixels, rows and columns;
4. offset: a random walk that the shutter resets, and the slow warming of the lens in front of the shutter, which stays;
5. output: quantisation, the measuring range, and frames that are repeated while the shutter is closed.

Sources of the magnitudes:

- P. W. Nugent, J. A. Shaw, N. J. Pust, Opt. Eng. 52, 061304 (2013) and 53, 123106 (2014): drift with the temperature of
  the focal plane; 0.26 K rms are left after correction with the internal shutter.
- W. Yuan, W. Hua, Drones 6, 394 (2022): warming takes 20 to 40 min, drift is uneven over the image.
- FLIR Tau 640 User's Manual, TAU-0640-00-10 (2011), flat-field correction: the image is frozen for less than 0.5 s.
- J. D'Agostino, C. Webb, Proc. SPIE 1488, 110 (1991): the three-dimensional noise model, also used by NVThermIP.
- J. B. Thomassen, A. D. van Rheenen, Proc. SPIE 11536, 115360F (2020): large-scale nonuniformity of up to 0.6 K in
  calibrated images.
- J. W. Howard, I. R. Abel, Appl. Opt. 21, 3393 (1982): narcissus.
- H. Budzier, G. Gerlach, J. Sens. Sens. Syst. 10, 179 (2021): the size-of-source effect by scattering and diffraction.
- A. N. Danial, Using High Speed Shutter to Reduce Motion Blur in a Microbolometer, Lulea (2013), FLIR A35; and the makers'
  own 8 to 12 ms: time constant of the bolometers.
- FLIR A35/A65 and Optris PI 640 data sheets: noise of 50 to 75 mK, steps of 40 mK and less, ranges from -20 or -25 degC.
- FLIR A6000 User's Manual, bad pixel correction: dead pixels and twinklers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import correlate1d

TWINKLE = 0.3  # share of frames in which a flickering pixel, row or column is in its other state


@dataclass(frozen=True)
class CameraErrors:
    """Magnitudes of the errors of one camera; their sources stand at the head of this module."""

    walk: float = 0.015  # K per root of a second: random walk of the offset between two shutter events
    jump: float = 0.10  # K: standard deviation of the offset that is left after a shutter event
    period: float = 12.0  # s between shutter events
    frozen: int = 2  # frames that repeat the last one while the shutter is closed
    drift: float = 0.2  # K that the warming lens has added at the end of the recording
    drift_time: float = np.inf  # s: time constant of the warming; infinite: linear in time
    unevenness: float = 0.1  # of the drift, from the middle of the image to its edge
    reflection: float = 0.25  # K at the middle of the reflection of a lamp
    reflection_width: float = 0.3  # of the image: its standard deviation
    narcissus: float = 0.03  # K: depth of a ring around the optical axis
    vignetting: float = 0.005  # of the contrast against the housing, lost in the farthest corner
    housing: float = 30.0  # degC of shutter and housing, where vignetting does not show
    halo: float = 0.02  # of the energy of every point that reaches a wide Gaussian
    halo_width: float = 9.0  # px: standard deviation of it
    tau: float = 0.010  # s: time constant of the bolometers
    unfollowed: float = 0.0  # of the speed of the scene along u, that the camera does not follow
    frame: float = 0.005  # K: temporal noise of whole frames, sigma_t of the three-dimensional noise model
    rows: float = 0.035  # K: fixed noise of rows, sigma_v
    columns: float = 0.035  # K: fixed noise of columns, sigma_h
    row_flicker: float = 0.015  # K: temporal noise of rows, sigma_tv
    column_flicker: float = 0.015  # K: temporal noise of columns, sigma_th
    renewed: float = 0.2  # of the variance of fixed rows and columns that every shutter event draws again
    dead: float = 0.001  # of the pixels, stuck or flickering
    clustered: float = 0.3  # of the dead pixels that lie in blocks of two by two
    flickering: float = 0.3  # of the dead pixels, rows and columns
    dead_rows: int = 1
    dead_columns: int = 0
    step: float = 0.02  # K between two counts
    low: float = -25.0  # degC: the measuring range
    high: float = 135.0


IDEAL = CameraErrors(
    walk=0.0, jump=0.0, period=np.inf, frozen=0, drift=0.0, unevenness=0.0, reflection=0.0, narcissus=0.0,
    vignetting=0.0, halo=0.0, tau=0.0, frame=0.0, rows=0.0, columns=0.0, row_flicker=0.0, column_flicker=0.0, renewed=0.0,
    dead=0.0, dead_rows=0, dead_columns=0, step=0.0, low=-np.inf, high=np.inf,
)  # fmt: skip


def draw_errors(rng):
    """Errors of a random camera; every second one rides with the scene, the others lose a part of its speed."""
    u = rng.uniform
    signs = rng.choice([-1.0, 1.0], size=3)
    return CameraErrors(
        walk=u(0.005, 0.03), jump=u(0.05, 0.2), period=float(np.exp(u(np.log(5.0), np.log(40.0)))),
        frozen=int(rng.integers(1, 4)), drift=signs[0] * u(0.1, 0.3),
        drift_time=np.inf if rng.random() < 0.5 else u(5.0, 60.0), unevenness=u(0.0, 0.2), reflection=u(0.1, 0.5),
        reflection_width=u(0.15, 0.45), narcissus=signs[1] * u(0.01, 0.05), vignetting=u(0.003, 0.01),
        housing=u(27.0, 38.0), halo=u(0.01, 0.03), halo_width=u(5.0, 15.0), tau=u(0.008, 0.012),
        unfollowed=0.0 if rng.random() < 0.5 else signs[2] * u(0.05, 0.3), frame=u(0.0, 0.01), rows=u(0.02, 0.05),
        columns=u(0.02, 0.05), row_flicker=u(0.01, 0.02), column_flicker=u(0.01, 0.02), renewed=u(0.0, 0.4),
        dead=u(5e-4, 2e-3), clustered=u(0.0, 0.5), flickering=u(0.1, 0.5), dead_rows=int(rng.integers(0, 3)),
        dead_columns=int(rng.integers(0, 3)), step=u(0.01, 0.04), low=(-25.0, -20.0)[rng.integers(2)],
        high=(100.0, 135.0)[rng.integers(2)],
    )  # fmt: skip


def record_frames(ideal, time, errors, device, rng, noise=0.0, motion=None):
    """What the camera writes (frames, nv, nu), degC, instead of `ideal` at `time` (frames,) s.

    `device` draws what stays with the camera in all its recordings, `rng` what is new in each.  `noise` (frames, nv, nu)
    K is that of single pixels, behind the lens; `motion` (frames,) of the scene along u in px per second.
    """
    ideal, time = np.asarray(ideal, float), np.asarray(time, float)
    shape, events = ideal.shape[1:], draw_shutter_events(time, errors, rng)
    T = spread_halo(ideal, errors)
    if motion is not None:
        T = np.array(
            [smear_motion(image, errors.unfollowed * m * errors.tau) for image, m in zip(T, motion, strict=True)]
        )
    T = errors.housing + draw_vignetting(shape, errors, device) * (T - errors.housing)
    T = (
        T
        + draw_static_map(shape, errors, device)
        + noise
        + draw_readout_noise(time, shape, events, errors, device, rng)
    )
    T = T + draw_drift(time, shape, errors, device) + draw_offset(time, events, errors, rng)[:, None, None]
    T = np.clip(quantise_temperatures(spoil_pixels(T, errors, device, rng), errors.step), errors.low, errors.high)
    return freeze_frames(T, time, events, errors.frozen)


# --- lens ---------------------------------------------------------------------------------------------------
def spread_halo(T, errors):
    """Images (frames, nv, nu) of which a share of the energy of every point reaches a wide Gaussian.

    Beyond its edges the scene goes on as it is there.
    """
    if not errors.halo:
        return T
    kernel = halo_kernel(errors.halo_width)
    wide = correlate1d(correlate1d(T, kernel, axis=1, mode="nearest"), kernel, axis=2, mode="nearest")
    return (1.0 - errors.halo) * T + errors.halo * wide


def halo_kernel(width):
    """Weights along one direction, their sum 1, of a Gaussian with a standard deviation of `width` (px)."""
    reach = int(np.ceil(4.0 * width))
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / width) ** 2)
    return weights / weights.sum()


def draw_vignetting(shape, errors, rng):
    """Contrast (nv, nu) against the housing by the law of cos^4 about an axis near the middle of the image."""
    away = _distance(shape, rng.uniform(0.4, 0.6, 2))
    tangent = np.tan(np.arccos((1.0 - errors.vignetting) ** 0.25)) * away / away.max()
    return np.cos(np.arctan(tangent)) ** 4


def draw_static_map(shape, errors, rng):
    """What stays on all images (nv, nu), K: the reflection of a lamp somewhere, and a ring of narcissus."""
    lamp, axis = rng.uniform(0.1, 0.9, 2), rng.uniform(0.4, 0.6, 2)
    radius, width = rng.uniform(0.15, 0.4), rng.uniform(0.05, 0.15)
    ring = np.exp(-0.5 * ((_distance(shape, axis) - radius) / width) ** 2)
    blob = np.exp(-0.5 * (_distance(shape, lamp) / errors.reflection_width) ** 2)
    return errors.reflection * blob - errors.narcissus * ring


def _distance(shape, middle):
    """Distance (nv, nu) from `middle` (shares of the image), the larger extent of the image being 1."""
    v, u = (np.arange(n) for n in shape)
    scale = max(*shape, 2) - 1.0
    y, x = middle * (np.array(shape) - 1.0)
    return np.hypot((v[:, None] - y) / scale, (u - x) / scale)


# --- bolometers ---------------------------------------------------------------------------------------------
def smear_motion(T, length):
    """Images of a scene that moves by `length` (px, along u) during the time constant of the bolometers.

    What a pixel shows is the mean of what it saw, weighed by exp(-age / tau): of a scene that moves to larger u it shows
    what now lies farther along u.  Between pixels the scene is linear, so the integral is exact.
    """
    if not length:
        return T
    ahead = T[..., ::-1] if length > 0.0 else T
    x = 1.0 / abs(length)
    kept = np.exp(-x)
    far = -np.expm1(-x) / x - kept  # weight of the neighbour that left the pixel a while ago
    near = 1.0 - kept - far
    out = np.empty_like(ahead)
    out[..., 0] = ahead[..., 0]
    for i in range(1, ahead.shape[-1]):
        out[..., i] = kept * out[..., i - 1] + far * ahead[..., i - 1] + near * ahead[..., i]
    return out[..., ::-1] if length > 0.0 else out


# --- readout ------------------------------------------------------------------------------------------------
def draw_readout_noise(time, shape, events, errors, device, rng):
    """Noise (frames, nv, nu) K of frames, rows and columns; a part of what is fixed is new after every shutter event."""
    frames, (nv, nu) = len(time), shape
    interval = np.searchsorted(events, time, side="right")
    out = errors.frame * rng.normal(size=(frames, 1, 1))
    for size, flicker, axes in (
        (errors.rows, errors.row_flicker, (nv, 1)),
        (errors.columns, errors.column_flicker, (1, nu)),
    ):
        stays, anew = device.normal(size=axes), rng.normal(size=(len(events) + 1, *axes))
        fixed = np.sqrt(1.0 - errors.renewed) * stays + np.sqrt(errors.renewed) * anew[interval]
        out = out + size * fixed + flicker * rng.normal(size=(frames, *axes))
    return out


def draw_dead_pixels(shape, errors, rng):
    """Which pixels (nv, nu) do not measure: single ones, and blocks of two by two."""
    where, total = np.zeros(shape, bool), round(errors.dead * shape[0] * shape[1])
    blocks = round(total * errors.clustered / 4.0)
    for _ in range(blocks):
        i, j = (int(rng.integers(max(n - 1, 1))) for n in shape)
        where[i : i + 2, j : j + 2] = True
    single = rng.choice(where.size, size=max(total - 4 * blocks, 0), replace=False)
    where.flat[single] = True
    return where


def spoil_pixels(T, errors, device, rng):
    """Images with dead pixels, rows and columns: stuck near the temperature of the housing, or now and then off."""
    out, shape = T.copy(), T.shape[1:]
    groups = [np.array([[i], [j]]) for i, j in np.argwhere(draw_dead_pixels(shape, errors, device))]
    for axis, count in ((0, errors.dead_rows), (1, errors.dead_columns)):
        for line in device.choice(shape[axis], size=min(count, shape[axis]), replace=False):
            along = np.arange(shape[1 - axis])
            own = np.full_like(along, line)
            groups.append(np.array([own, along] if axis == 0 else [along, own]))
    for i, j in groups:
        off = float(device.choice([-1.0, 1.0]) * np.exp(device.uniform(np.log(0.5), np.log(30.0))))
        if device.random() < errors.flickering:
            out[:, i, j] += np.clip(off, -3.0, 3.0) * (rng.random(len(T)) < TWINKLE)[:, None]
        else:
            out[:, i, j] = errors.housing + off
    return out


# --- offset and output --------------------------------------------------------------------------------------
def draw_shutter_events(time, errors, rng):
    """Times (s) within the recording at which the shutter closes: every `period`, from a random moment on."""
    if not np.isfinite(errors.period):
        return np.zeros(0)
    first = time[0] + errors.period * rng.uniform(0.02, 1.0)
    return np.arange(first, time[-1], errors.period)


def draw_offset(time, events, errors, rng):
    """Offset (frames,) K: a random walk that every shutter event ends; what is left after it is drawn anew."""
    interval = np.searchsorted(events, time, side="right")
    begins = np.concatenate([time[:1], events])
    since = time - begins[interval]
    out, before = np.empty(len(time)), 0.0
    for k in range(len(time)):
        new = k == 0 or interval[k] > interval[k - 1]
        before = 0.0 if new else before + errors.walk * np.sqrt(since[k] - since[k - 1]) * rng.normal()
        if new:
            left = errors.jump * rng.normal()
            before = errors.walk * np.sqrt(since[k]) * rng.normal()
        out[k] = left + before
    return out


def draw_drift(time, shape, errors, rng):
    """What the warming lens adds (frames, nv, nu), K: 0 at first, `drift` at the end, uneven along one direction."""
    share = (time - time[0]) / max(np.ptp(time), 1e-9)
    if np.isfinite(errors.drift_time):
        speed = max(np.ptp(time), 1e-9) / errors.drift_time
        share = np.expm1(-share * speed) / np.expm1(-speed)
    angle = rng.uniform(0.0, 2.0 * np.pi)
    v, u = (np.linspace(-1.0, 1.0, n) if n > 1 else np.zeros(1) for n in shape)
    uneven = 1.0 + errors.unevenness * (np.cos(angle) * u + np.sin(angle) * v[:, None])
    return errors.drift * share[:, None, None] * uneven


def quantise_temperatures(T, step):
    """Temperatures in whole counts of `step` (K)."""
    return np.round(T / step) * step if step else T


def freeze_frames(T, time, events, count):
    """Images of which `count` repeat the last one before each shutter event."""
    out = T.copy()
    for event in events:
        first = int(np.searchsorted(time, event))
        if 0 < first < len(T):
            out[first : first + count] = out[first - 1]
    return out
