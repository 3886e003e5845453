"""Errors of real cameras as linear columns of every image: offset in time, smooth maps, smear and stray light.

Their coefficients are marginalised in closed form with all other nuisances.  Each column is as large as its error
usually is for the class of the camera (`camera_classes`), so that one prior of unit width serves all.  How many times
as large each family is, none among the values, is a hyperparameter of every hypothesis, chosen by its evidence (MacKay,
Neural Computation 4, 1992, 415): data of an ideal camera lose nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter

from flashtemp.camera.camera_classes import CAMERA_CLASSES, CameraErrors
from flashtemp.camera.image_screening import find_shutter_events, temporal_noise
from flashtemp.camera.quantisation import quantisation_step
from flashtemp.camera.recording import Recording
from flashtemp.discovery.parameters import ParameterId, ParameterKind
from flashtemp.discovery.prediction.prediction import Observable, Single, flatten_valid_pixels

Array = npt.NDArray[np.float64]
MAX_MAP_ORDER = 4  # total order of Legendre products: vignetting by the fourth power of the cosine has no more
MAX_GROWING_MAP_ORDER = 2  # order of maps that a warming lens makes grow with time
MAX_WIENER_MODES = 16  # of the offset between shutter events
MIN_JUMP_PIXEL_FRACTION = (
    0.5  # fraction of pixels of a residual that must show a jump; residual heat may hide it in the others
)
HALO_WIDTH_FRACTIONS = (0.05, 0.2)  # fractions of an image over which light goes astray
MAX_UNTRACKED_FRACTION = 0.4  # of the motion, that a camera which follows the body may miss
UNTRACKED_FRACTIONS = 6  # fractions of either sign for which the smear is computed
MIN_SMEAR_VARIANCE = 1e-5  # of the largest mode of the smear, below which a mode is left out
VALUES_PER_BATCH = 1_000_000  # of images that are smeared at a time
CAMERA_ERROR_SCALES: dict[ParameterKind, tuple[float, ...]] = {  # times its usual size that a family of errors may have
    ParameterKind.OFFSET: (0.0, 0.3, 1.0, 3.0),
    ParameterKind.STATIC: (0.0, 0.3, 1.0, 3.0),
    ParameterKind.MAP: (0.0, 0.5, 1.0, 2.0),
    ParameterKind.OPTICS: (0.0, 1.0),
}
NO_CAMERA_ERRORS: Mapping[ParameterKind, float] = dict.fromkeys(CAMERA_ERROR_SCALES, 0.0)
USUAL_CAMERA_ERRORS: Mapping[ParameterKind, float] = dict.fromkeys(CAMERA_ERROR_SCALES, 1.0)


def camera_columns(
    r: Recording,
    predicted: Observable,
    residual: Array | None,
    speed: Array | None = None,
    renewals: tuple[int, ...] = (),
) -> dict[ParameterId, Single]:
    """Columns (frames, valid pixels) K of all camera errors of a recording; none for points.

    `residual` (frames, nv, nu) K: residual of a first fit, in which jumps of the offset show; None leaves out the
    offsets, which do not depend on a prediction.  `speed` (frames,) m/s: sliding speed.  `renewals`: first frames after
    shutter events that the line noise shows.
    """
    if r.places is not None:
        return {}
    sizes = CAMERA_CLASSES[r.camera]
    ones = np.ones((1, *predicted.values.shape[1:]))
    out: dict[ParameterId, Single] = {}
    for k, wave in enumerate(() if residual is None else _iter_offsets(r, residual, sizes, renewals)):
        out[ParameterId(ParameterKind.OFFSET, (k,))] = flatten_valid_pixels(
            wave[:, None, None] * ones, predicted.inside
        )
    rise = predicted.values - _reflected_temperature(r, predicted.values)
    ramp = ((r.time - r.time.mean()) / max(float(np.ptp(r.time)), 1e-12))[:, None, None]
    for (m, n), shape in smooth_maps(r, MAX_MAP_ORDER):
        if m + n:  # the constant one is the offset's, or the gain's
            flat = np.broadcast_to(sizes.map_K * shape, predicted.values.shape)
            out[ParameterId(ParameterKind.STATIC, (m, n))] = flatten_valid_pixels(flat, predicted.inside)
            if m + n <= MAX_GROWING_MAP_ORDER:
                out[ParameterId(ParameterKind.STATIC, (m, n, 1))] = flatten_valid_pixels(ramp * flat, predicted.inside)
            out[ParameterId(ParameterKind.MAP, (m, n, 1))] = flatten_valid_pixels(rise * shape, predicted.inside)
    stray = (flatten_valid_pixels(light, predicted.inside) for light in _iter_stray_light(predicted.values, sizes))
    for k, change in enumerate((*smear_modes(r, predicted, sizes, speed), *stray)):
        out[ParameterId(ParameterKind.OPTICS, (k,))] = change
    return out


def _reflected_temperature(r: Recording, values: Array) -> float:
    return r.reflected_degC if r.reflected_degC is not None else float(np.nanmin(values))


# --- offset in time --------------------------------------------------------------------------------------
def _iter_offsets(r: Recording, residual: Array, sizes: CameraErrors, renewals: tuple[int, ...]) -> Iterator[Array]:
    """Offsets (frames,) K: a steady drift, and between shutter events a free level and modes of a Wiener process."""
    ramp = (r.time - r.time[0]) / max(float(np.ptp(r.time)), 1e-12)
    for curve in (ramp, ramp * (1.0 - ramp)):  # a camera that settles drifts faster at first
        yield sizes.warm_up_K * curve
    sigma = temporal_noise(residual, quantisation_step(r.temperature))
    jumps = find_shutter_events(residual, r, sigma, MIN_JUMP_PIXEL_FRACTION)
    certain = {*r.frames_after_frozen, *renewals}
    # what seems a jump one frame away is the same event: heat may hide it in the frame itself
    events = sorted(certain | {k for k in jumps.tolist() if certain.isdisjoint((k - 1, k + 1))})
    for begin, end in zip((0, *events), (*events, r.frames), strict=True):
        part = slice(int(begin), int(end))
        level = np.zeros(r.frames)
        level[part] = sizes.level_K
        yield level
        for mode in wiener_modes(r.time[part] - r.time[part][0], MAX_WIENER_MODES):
            wave = np.zeros(r.frames)
            wave[part] = sizes.drift_K_per_sqrt_s * mode
            yield wave


def wiener_modes(time: Array, most: int) -> Array:
    """Modes (modes, n) whose outer products add up to the covariance min(s, t) of a Wiener process at n times (s).

    The Karhunen-Loeve expansion (Karhunen 1947, Loeve 1948) of the sampled process, the `most` largest modes of it.

    >>> modes = wiener_modes(np.array([0.0, 1.0, 3.0]), 3)
    >>> print((modes.T @ modes).round(6) + 0.0)
    [[0. 0. 0.]
     [0. 1. 1.]
     [0. 1. 3.]]
    """
    variance, shape = np.linalg.eigh(np.minimum.outer(time, time))
    order = np.argsort(-variance)[:most]
    order = order[variance[order] > 1e-12 * max(float(variance[-1]), 1e-300)]
    return np.asarray(np.sqrt(variance[order])[:, None] * shape[:, order].T)


# --- maps that stay ---------------------------------------------------------------------------------------
def smooth_maps(r: Recording, order: int) -> Iterator[tuple[tuple[int, int], Array]]:
    """Products (nv, nu) of Legendre polynomials along and up the image up to a total `order`, of rms 2^(-1/2) each.

    Powers of the distance from any point, hence vignetting and narcissus, are sums of them.
    """
    x, y = _legendre_waves(r.u, order), _legendre_waves(r.v, order)
    for m in range(len(x)):
        for n in range(min(len(y), order + 1 - m)):
            yield (m, n), np.sqrt(0.5) * y[n][:, None] * x[m]


def _legendre_waves(centres: Array, order: int) -> Array:
    """Legendre polynomials (orders, n) over the pixels of an axis, of unit rms; the constant alone of one pixel."""
    if len(centres) <= order:
        order = len(centres) - 1
    where = 2.0 * (centres - centres[0]) / max(float(centres[-1] - centres[0]), 1e-12) - 1.0
    waves = np.polynomial.legendre.legvander(where, order).T
    return np.asarray(waves / np.sqrt(np.mean(waves**2, axis=1, keepdims=True)))


# --- what moves and scatters light ------------------------------------------------------------------------
def smear_modes(r: Recording, predicted: Observable, sizes: CameraErrors, speed: Array | None) -> list[Single]:
    """Changes (frames, valid pixels) K where a part of the motion is not followed, either way along u.

    A pixel that answers with a time constant shows the mean of what it saw, weighed by exp(-age / constant): a body
    that moves through the image is drawn out over speed times constant, and what lies beyond its edge is drawn in.
    An image is no linear function of that length.  Any part of the motion up to the largest is equally likely, and the
    changes are the modes of that distribution (Karhunen-Loeve).
    """
    if speed is None or len(r.u) < 3 or not np.any(speed):
        return []
    images, lags = predicted.values, np.abs(speed) * sizes.smear_s / r.pitch[0]
    batch = max(1, VALUES_PER_BATCH // images[0].size)
    parts = [slice(k, k + batch) for k in range(0, len(images), batch)]
    square = np.zeros((2 * UNTRACKED_FRACTIONS, 2 * UNTRACKED_FRACTIONS))
    for part in parts:
        samples = _smear_samples(images[part], predicted.inside, lags[part]).reshape(len(square), -1)
        square += samples @ samples.T
    variance, shape = np.linalg.eigh(square)
    used = [k for k in np.argsort(-variance) if variance[k] > MIN_SMEAR_VARIANCE * variance[-1]]
    modes = np.empty((len(used), len(images), np.count_nonzero(predicted.inside)), np.float32)
    for part in parts:  # again, because all samples together would need much memory
        samples = _smear_samples(images[part], predicted.inside, lags[part])
        modes[:, part] = np.tensordot(shape[:, used].T.astype(np.float32), samples, 1)
    return list(modes)


def _smear_samples(images: Array, inside: npt.NDArray[np.bool_], lags: Array) -> Single:
    """Changes (2 UNTRACKED_FRACTIONS, frames, valid pixels) by parts of motion with `lags` (frames,) px, as nodes of a
    quadrature times the root of their weights."""
    nodes, weights = np.polynomial.legendre.leggauss(UNTRACKED_FRACTIONS)
    out = []
    for node, weight in zip(nodes, weights, strict=True):
        length = 0.5 * (1.0 + node) * MAX_UNTRACKED_FRACTION * lags
        for way in (1, -1):
            late = _filter_along_u(images[:, :, ::way], length)[:, :, ::way]
            out.append(0.5 * np.sqrt(weight) * flatten_valid_pixels(late - images, inside))
    return np.stack(out).astype(np.float32, copy=False)


def _filter_along_u(images: Array, length: Array) -> Array:
    """Images (frames, nv, nu) after a one-sided exponential filter along u of a `length` (frames,) px of each frame.

    Between pixels the image is linear; the integral over each pixel is exact.
    """
    lag = np.maximum(length, 1e-3)[:, None]
    kept = np.exp(-1.0 / lag)
    older = lag * (1.0 - kept) - kept  # weight of the pixel before
    out = np.array(np.moveaxis(images, 2, 0))  # pixels along u first: neighbours in memory are filtered together
    before = out[0].copy()
    for i in range(1, len(out)):
        now = out[i].copy()
        out[i] = kept * out[i - 1] + older * before + (1.0 - kept - older) * now
        before = now
    return np.moveaxis(out, 0, 2)


def _iter_stray_light(values: Array, sizes: CameraErrors) -> Iterator[Array]:
    """Changes (frames, nv, nu) K by light that is spread over a wide part of the image (veiling glare, ISO 9358)."""
    for width in HALO_WIDTH_FRACTIONS:
        wide = [width * max(values.shape[1:])] * 2
        yield sizes.halo * (gaussian_filter(values, (0.0, *wide), mode="nearest") - values)
