"""Gaussian point spread of a camera: averages of the radiance over pixels, and their derivatives.

Radiance is linear between nodes.  Derivatives are with respect to position, scale and width of the point spread.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from flashtemp.physics.just_in_time import njit

PSF_REACH_WIDTHS = 7.0  # widths of the point spread beyond the edge of a pixel that contribute to it
NORMAL_CUTOFF_WIDTHS = 8.5  # widths beyond which the normal distribution function is 0 or 1 in double precision
MIN_ROTATED_ROWS = 24  # rows of nodes of a rotated body, at least: rotated lines are straight between them

Array = np.ndarray
EMPTY_IMAGE = np.empty(0)
MatrixCache = dict[bytes, Any]  # matrices that the images of one recording share, by the bytes of their inputs


class PixelAxis(NamedTuple):
    """Pixels along an axis: `centres` (n,), `pitch` and width `psf_sigma` of a Gaussian point spread, all m."""

    centres: Array
    pitch: float
    psf_sigma: float

    @property
    def variance(self) -> float:
        """Variance of the pixel's response (point spread and box), m2."""
        return self.psf_sigma**2 + self.pitch**2 / 12.0


class SampledImage(NamedTuple):
    """Averages over pixels, `seen` (frames, nv, nu), and their derivatives where required (else empty).

    `along_u` and `along_v` are per metre of shift; `by_scale` per relative growth of pixels and point spread together,
    `by_psf` per relative growth of the point spread alone.
    """

    seen: Array
    along_u: Array = EMPTY_IMAGE
    along_v: Array = EMPTY_IMAGE
    by_scale: Array = EMPTY_IMAGE
    by_psf: Array = EMPTY_IMAGE


@njit(cache=True)
def _response_integrals(x: float, pitch: float, psf_sigma: float, once, twice):
    """First and second integral of a pixel's response, `once` and `twice` (4,), at `x` (m) beyond a node.

    Index 0 is the integral, 1 its derivative by position, 2 by scale (pitch and psf_sigma) and 3 by psf_sigma alone.
    The response is a box convolved with a Gaussian, so its integrals are differences over the two edges of the box.
    """
    half, density, integral, ramp = np.empty(2), np.empty(2), np.empty(2), np.empty(2)
    for side in range(2):
        at = x + (0.5 - side) * pitch
        if abs(at) >= NORMAL_CUTOFF_WIDTHS * psf_sigma:
            half[side] = 1.0 if at > 0.0 else 0.0
            density[side] = 0.0
        else:
            half[side] = 0.5 * math.erfc(-at / (math.sqrt(2.0) * psf_sigma))
            density[side] = math.exp(-0.5 * (at / psf_sigma) ** 2) / math.sqrt(2.0 * math.pi)
        # closed integrals of the Gaussian, so that eq. (36) is exact for a field that is linear between nodes
        integral[side] = at * half[side] + psf_sigma * density[side]
        ramp[side] = 0.5 * (at * integral[side] + psf_sigma * psf_sigma * half[side])
    once[0], twice[0] = (integral[0] - integral[1]) / pitch, (ramp[0] - ramp[1]) / pitch
    once[1], twice[1] = (half[0] - half[1]) / pitch, once[0]  # derivative by position
    once[3], twice[3] = psf_sigma * (density[0] - density[1]) / pitch, psf_sigma * psf_sigma * once[1]
    once[2] = 0.5 * (half[0] + half[1]) - once[0] + once[3]
    twice[2] = 0.5 * (integral[0] + integral[1]) - twice[0] + twice[3]


@njit(cache=True)
def _fill_hat_weights(at, nodes, first, start, pitch: float, psf_sigma: float, out):
    """Fills `out` with the weights of `hat_weights`, one by one: arrays would pass through memory twenty times.

    Pixel i has `start[i + 1] - start[i]` nodes, the first of them number `first[i]`.  The weight of a hat function is
    the second difference of the second integrals, written with first integrals to keep the digits.
    """
    slopes = out.shape[0]
    once, twice, last, before = np.empty(4), np.empty(4), np.empty(4), np.empty(4)
    for i in range(at.shape[0]):
        for k in range(start[i + 1] - start[i]):
            node, place = first[i] + k, start[i] + k
            _response_integrals(at[i] - nodes[node], pitch, psf_sigma, once, twice)
            for d in range(slopes):
                if k > 0:
                    apart = nodes[node] - nodes[node - 1]
                    # each interval between nodes adds to the hat functions of both
                    later = (before[d] - twice[d] - apart * once[d]) / apart
                    out[d, place - 1] += last[d] - once[d] - later
                    out[d, place] = later
                last[d], before[d] = once[d], twice[d]


def hat_weights(at: Array, nodes: Array, first: Array, start: Array, axis: PixelAxis, slopes: bool = False) -> Array:
    """Weights (1, total) by which pixels centred `at` (n,) m average a field linear between `nodes` (m), zero outside.

    The response is a box of the pitch of `axis` convolved with its Gaussian; integrals are exact.  Each pixel has nodes
    from number `first` (n,) on, and its weights begin at index `start` (n + 1,).  With `slopes` (4, total): the weights
    and their derivatives per metre of `at`, per relative growth of pitch and psf_sigma, and of psf_sigma alone.
    """
    out = np.zeros((4 if slopes else 1, int(start[-1])))
    _fill_hat_weights(at, nodes, first, start, float(axis.pitch), float(axis.psf_sigma), out)
    return out


def axis_weights(axis: PixelAxis, nodes: Array, slopes: bool = False) -> Array:
    """`hat_weights` (1 or 4, pixels, nodes) of pixels along an axis over all nodes; exact integrals."""
    at, nodes = np.ascontiguousarray(axis.centres, float), np.ascontiguousarray(nodes, float)
    first, start = np.zeros(len(at), np.int64), len(nodes) * np.arange(len(at) + 1)
    return hat_weights(at, nodes, first, start, axis, slopes).reshape(-1, len(at), len(nodes))


def sample_aligned(
    values: Array, nodes: tuple[Array, Array], axes: tuple[PixelAxis, PixelAxis | None], slopes: bool = False
) -> SampledImage:
    """Pixel averages of `values` (frames, v nodes, u nodes) in an image whose axes are parallel to those of the body.

    Without an axis along v the field is one line.
    """
    (along, up), (u, v) = nodes, axes
    x = axis_weights(u, along, slopes)
    z = np.eye(len(x), 1)[:, None] if v is None else axis_weights(v, up, slopes)
    frames, high, _ = values.shape  # two large products: many small ones would wake threads for each
    lines = (values.reshape(frames * high, -1) @ x.reshape(-1, len(along)).T).reshape(frames, high, len(x), -1)

    def image(up: int, along: int) -> Array:
        return np.swapaxes(np.tensordot(z[up], lines[:, :, along], (1, 1)), 0, 1)

    if not slopes:
        return SampledImage(image(0, 0))
    return SampledImage(image(0, 0), image(0, 1), image(1, 0), image(2, 0) + image(0, 2), image(3, 0) + image(0, 3))


def sample_rotated(
    values: Array,
    nodes: tuple[Array, Array],
    axes: tuple[PixelAxis, PixelAxis],
    turn: float,
    about: tuple[float, float],
    kept: MatrixCache | None = None,
    slopes: bool = False,
) -> SampledImage:
    """Pixel averages of `values` (frames, v nodes, u nodes) in an image that is rotated by `turn` (rad).

    `axes` are those of the image, with its scale; `about` is the fixed point (u, v).  Two shears make the rotation:
    every row of nodes is averaged along u for the pixels that need it, then every column of the result along v.
    Averaging along sheared lines adds a covariance, which the mixed derivative removes to first order.  `kept` caches
    matrices from one image to the next.
    """
    (along, up), (u, v) = nodes, axes
    if len(up) < MIN_ROTATED_ROWS:
        finer = np.linspace(up[0], up[-1], MIN_ROTATED_ROWS)
        weights = np.stack([np.interp(finer, up, row) for row in np.eye(len(up))], axis=1)
        values, up = np.einsum("kz,fzx->fkx", weights, values), finer
    cos, sin = np.cos(turn), np.sin(turn)
    lines, columns = _shear_matrices(u, v, (along, up), turn, about, kept, slopes)
    flat = np.ascontiguousarray(values.reshape(len(values), -1).T)

    def image(seen: Array) -> Array:
        return seen.T.reshape(len(values), len(v.centres), len(u.centres))

    sheared = lines[0] @ flat
    seen = image(columns[0] @ sheared)
    skew = sin / cos * u.variance  # covariance of the response along sheared lines, to be removed (eq. (37))
    if not slopes:
        return SampledImage(seen + skew * mixed_derivative(seen, u, v))
    first, second = image(columns[0] @ (lines[1] @ flat)), image(columns[1] @ sheared)
    by_scale, by_psf = (image(columns[d] @ sheared + columns[0] @ (lines[d] @ flat)) for d in (2, 3))
    bent = 2.0 * sin / cos * mixed_derivative(seen, u, v)
    changes = (seen, first / cos + sin * second, cos * second, by_scale, by_psf)
    seen, along_u, along_v, by_scale, by_psf = (c + skew * mixed_derivative(c, u, v) for c in changes)
    return SampledImage(seen, along_u, along_v, by_scale + bent * u.variance, by_psf + bent * u.psf_sigma**2)


def mixed_derivative(image: Array, u: PixelAxis, v: PixelAxis) -> Array:
    """d2/du dv of an image, per m2: the change of a pixel average along sheared lines, per shear and variance."""
    if min(len(u.centres), len(v.centres)) < 2:
        return np.zeros_like(image)
    return np.gradient(np.gradient(image, u.centres, axis=2), v.centres, axis=1)


def _shear_matrices(
    u: PixelAxis, v: PixelAxis, nodes: tuple[Array, Array], turn: float, about, kept: MatrixCache | None, slopes: bool
):
    """Matrices of both shears, with their derivatives if `slopes` (a cached pair may have them anyway)."""
    (along, up), (x, y) = nodes, about
    first = x + (u.centres[None] - x) / np.cos(turn) - np.tan(turn) * (up[:, None] - y)  # (v nodes, nu)
    second = y + (v.centres[:, None] - y) * np.cos(turn) + (u.centres[None] - x) * np.sin(turn)  # (nv, nu)
    key = b"".join(np.asarray(a, float).tobytes() for a in (first, second, along, up, [*u[1:], *v[1:]]))
    matrices = None if kept is None else kept.get(key)
    if matrices is None or (slopes and len(matrices[0]) == 1):
        n, wide = len(along), len(u.centres)
        lines = _sparse_weights(first, along, u, np.arange(len(up)).repeat(wide) * n, 1, len(up) * n, slopes)
        columns = _sparse_weights(second, up, v, np.tile(np.arange(wide), len(second)), wide, len(up) * wide, slopes)
        matrices = lines, columns
        if kept is not None:
            kept[key] = matrices
    return matrices


def _sparse_weights(
    at: Array, nodes: Array, axis: PixelAxis, begin: Array, stride: int, size: int, slopes: bool
) -> list[Any]:
    """Sparse matrices (pixels, size) for pixels `at` (a, b) m; node k of a pixel is column `begin` + `stride` k."""
    from scipy.sparse import csr_array

    reach = 0.5 * axis.pitch + PSF_REACH_WIDTHS * axis.psf_sigma
    flat, nodes = np.ascontiguousarray(at.ravel(), float), np.ascontiguousarray(nodes, float)
    first = np.clip(np.searchsorted(nodes, flat - reach) - 1, 0, len(nodes) - 2)
    last = np.clip(np.searchsorted(nodes, flat + reach) + 1, 2, len(nodes))
    width = last - first  # many nodes where the mesh is fine, few elsewhere
    start = np.concatenate([[0], np.cumsum(width)])
    which = np.arange(start[-1]) - np.repeat(start[:-1] - first, width)
    weights = hat_weights(flat, nodes, first, start, axis, slopes)
    # 32-bit indices halve the memory of the index arrays
    column = (np.repeat(begin, width) + stride * which).astype(np.int32)
    row = start.astype(np.int32)
    return [csr_array((w, column, row), shape=(len(flat), size)) for w in weights]
