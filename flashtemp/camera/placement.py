"""An image whose scale or clock is off or that is turned: where its pixels lie, and what they see of a body.

The scale is counted from the corner where the block's contact begins to be seen, and the image turns about the middle
of what it shows of the contact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from flashtemp.camera.recording import Recording
from flashtemp.errors import BadInput

REACH = 7.0  # widths of the optics beyond the edge of a pixel that it sees
PLACES = 9  # decimals of a pixel to which images lie in one place
ROWS = 24  # nodes across a turned body, at least: the turned lines between them are straight


@dataclass(frozen=True)
class Place:
    """How an image lies otherwise than told: pixels larger by a share `scale`, all of it turned by `turn` (rad); by
    `clock` (s) its frames are stamped late.

    What is told at u = u0 + x, v = y lies at u0 + (1 + scale)(x cos turn - y sin turn), (1 + scale)(y cos + x sin).
    """

    scale: Any = 0.0  # both complex for derivatives
    turn: Any = 0.0
    clock: float = 0.0


AS_TOLD = Place()
Kept = dict[bytes, Any]  # matrices that several images share, and what they are made from


def corner(recording: Recording, length: float) -> float:
    """u (m) that the scale is counted from: the leading edge; for a wake the trailing edge that it follows."""
    if recording.view != "wake":
        return 0.0
    return length if float(np.median(recording.u)) > 0.5 * length else 0.0


def pivot(recording: Recording, length: float) -> float:
    """u (m) about which an image is turned: the middle of the block, or the edge that a wake begins at."""
    return 0.5 * length if recording.view != "wake" else corner(recording, length)


def check_seen(recording: Recording, block: tuple[float, float] | None) -> None:
    """BadInput where the whole image of a side wall lies beside the `block` (length, height in m), if that is known."""
    if block is None or recording.view != "sidewall":
        return
    for name, at, size in zip("uv", (recording.u, recording.v), block, strict=True):
        if not np.any((at >= 0.0) & (at <= size)):
            raise BadInput(
                f"pixel: the image shows {name} = {1e3 * at[0]:.4g} to {1e3 * at[-1]:.4g} mm, the block lies from 0 to "
                f"{1e3 * size:.4g} mm: no pixel is on it; give --pixel COLUMN ROW of its leading edge at the interface"
            )


@njit(cache=True)
def _normal(x, pitch: float, sigma: float, found):
    """Normal distribution function and density of width `sigma` (places, nodes, 2) at both edges of pixels at x."""
    for i in range(x.shape[0]):
        for k in range(x.shape[1]):
            for side in range(2):
                at = x[i, k] + (0.5 - side) * pitch
                if sigma > 0.0:
                    found[0, i, k, side] = 0.5 * math.erfc(-at / (math.sqrt(2.0) * sigma))
                    found[1, i, k, side] = math.exp(-0.5 * (at / sigma) ** 2) / math.sqrt(2.0 * math.pi)
                else:
                    found[0, i, k, side] = 1.0 if at > 0.0 else 0.0


@njit(cache=True)
def _ramp(x: complex, s: complex, half: float, density: float):
    """Integral of the normal distribution function of width s, and its integral, from function and density.

    To first order in the imaginary parts of x and s, which is all that a complex step asks for.
    """
    at, wide = x.real, s.real
    up = at * half + wide * density
    twice = 0.5 * ((at * at + wide * wide) * half + wide * at * density)
    return complex(up, half * x.imag + density * s.imag), complex(twice, up * x.imag + wide * half * s.imag)


@njit(cache=True)
def _hats(x, pitch: complex, sigma: complex, step, normal, weights):
    """`hats` one by one: as arrays they would pass through memory twenty times."""
    half, density = normal
    last, before = 0j, 0j
    for i in range(x.shape[0]):
        for k in range(x.shape[1]):
            up, high = _ramp(x[i, k] + 0.5 * pitch, sigma, half[i, k, 0], density[i, k, 0])
            low, deep = _ramp(x[i, k] - 0.5 * pitch, sigma, half[i, k, 1], density[i, k, 1])
            once, twice = (up - low) / pitch, (high - deep) / pitch
            if k > 0:
                apart = step[i, k - 1]
                later = (before - twice - apart * once) / apart
                weights[i, k - 1] += last - once - later
                weights[i, k] = later
            last, before = once, twice


def hats(x: Any, pitch: Any, sigma: Any, step: Any, kept: Kept | None = None) -> Any:
    """Weights (n, nodes) of a field that is linear between nodes and zero outside, seen by pixels `x` (n, nodes) m
    before each node, `step` (nodes - 1,) or (n, nodes - 1) m apart; a box of `pitch` convolved with a Gaussian.

    `kept` holds what complex steps from the same place share.
    """
    plain = np.ascontiguousarray(np.real(x), float)
    wide = float(np.real(pitch)), float(np.real(sigma))
    key = np.round(plain / wide[0], PLACES).tobytes() + np.array(wide).round(12).tobytes()
    normal = None if kept is None else kept.get(key)
    if normal is None:
        normal = np.zeros((2, *plain.shape, 2))
        _normal(plain, *wide, normal)
        if kept is not None:
            kept[key] = normal
    weights = np.zeros(plain.shape, complex)
    apart = np.broadcast_to(step, (len(plain), plain.shape[1] - 1)).astype(float)
    _hats(np.ascontiguousarray(x, complex), complex(pitch), complex(sigma), apart, normal, weights)
    return weights if any(np.iscomplexobj(a) for a in (x, pitch, sigma)) else weights.real


def turned(
    values: Any, nodes: tuple[Any, Any], centres: tuple[Any, Any], optics: Any, place: Place, about: float,
    kept: Kept | None = None,
) -> Any:  # fmt: skip
    """What pixels see (frames, nv, nu) of `values` (frames, v nodes, u nodes) when the image is turned.

    `nodes` and `centres` (complex for derivatives) along u and v in m, the scale applied already; `optics` (pitch,
    sigma) m along u and v; `about` the u that does not move.  Two shears are the turn: first every line of nodes is
    seen by the pixels that will need it, then every column of these.  `kept` holds matrices from one image to the next.
    """
    (along, up), (u, v) = nodes, centres
    if len(up) < ROWS:
        finer = np.linspace(up[0], up[-1], ROWS)
        share = np.stack([np.interp(finer, up, row) for row in np.eye(len(up))], axis=1)
        values, up = np.einsum("kz,fzx->fkx", share, values), finer
    cos, sin = np.cos(place.turn), np.sin(place.turn)
    first = about + (u[None] - about) / cos - sin / cos * up[:, None]  # (v nodes, nu)
    second = v[:, None] * cos + (u[None] - about) * sin  # (nv, nu)
    key = b"".join(np.asarray(a, complex).tobytes() for a in (first, second, along, up, [*optics[0], *optics[1]]))
    lines, columns = (kept or {}).get(key) or (
        _sparse(first, along, optics[0], lambda k, j, at: k * len(along) + at, values[0].size, kept),
        _sparse(second, up, optics[1], lambda i, j, at: at * len(u) + j, len(up) * len(u), kept),
    )
    if kept is not None:
        kept[key] = lines, columns
    image = (columns @ (lines @ values.reshape(len(values), -1).T)).T.reshape(len(values), len(v), len(u))
    return image + sin / cos * _skewed(image, (u, v), optics[1])


def _skewed(image: Any, centres: tuple[Any, Any], optics: Any) -> Any:
    """What is lost because pixels look along sheared lines, per unit of shear: their variance times d2T/du dv."""
    u, v = (np.real(c) for c in centres)
    if min(len(u), len(v)) < 2:
        return np.zeros_like(image)
    variance = optics[1] ** 2 + optics[0] ** 2 / 12.0
    return variance * np.gradient(np.gradient(image, u, axis=2), v, axis=1)


def _sparse(at: Any, nodes: Any, optics: Any, column: Any, size: int, kept: Kept | None) -> Any:
    """Matrix (pixels, size) of pixels `at` (a, b) m over nodes; `column(i, j, node)` numbers what they see."""
    from scipy.sparse import csr_array

    pitch, sigma = optics
    reach = 0.5 * float(np.real(pitch)) + REACH * float(np.real(sigma))
    flat = at.ravel()
    first = np.clip(np.searchsorted(nodes, np.real(flat) - reach) - 1, 0, len(nodes) - 2)
    last = np.clip(np.searchsorted(nodes, np.real(flat) + reach) + 1, 2, len(nodes))
    width = int(np.max(last - first))
    first = np.minimum(first, len(nodes) - width)
    which = first[:, None] + np.arange(width)
    near = nodes[which]
    weights = hats(flat[:, None] - near, pitch, sigma, np.diff(near, axis=1), kept)
    i, j = (a.ravel()[:, None] for a in np.indices(at.shape))
    start = np.arange(len(flat) + 1) * width
    return csr_array((weights.ravel(), column(i, j, which).ravel(), start), shape=(len(flat), size))
