"""An image whose scale or clock is off or that is turned: where its pixels lie, and what they see of a body.

The scale is counted from the corner where the block's contact begins to be seen, and the image turns about the middle
of what it shows of the contact.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import erfc

from flashtemp.camera.recording import Recording

REACH = 7.0  # widths of the optics beyond the edge of a pixel that it sees
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


def corner(recording: Recording, length: float) -> float:
    """u (m) that the scale is counted from: the leading edge; for a wake the trailing edge that it follows."""
    if recording.view != "wake":
        return 0.0
    return length if float(np.median(recording.u)) > 0.5 * length else 0.0


def pivot(recording: Recording, length: float) -> float:
    """u (m) about which an image is turned: the middle of the block, or the edge that a wake begins at."""
    return 0.5 * length if recording.view != "wake" else corner(recording, length)


def ramp(x: Any, s: Any) -> tuple[Any, Any]:
    """Integral of the normal distribution function of width s, and its integral.

    Of complex x and s to first order in their imaginary parts, which is all that a complex step asks for.
    """
    at, wide = np.real(x), float(np.real(s))
    if wide == 0:
        up = np.where(at > 0, x, 0.0)
        return up, 0.5 * up * up
    half = 0.5 * erfc(-at / (np.sqrt(2.0) * wide))
    density = np.exp(-0.5 * (at / wide) ** 2) / np.sqrt(2 * np.pi)
    up = at * half + wide * density
    twice = 0.5 * ((at * at + wide * wide) * half + wide * at * density)
    if not (np.iscomplexobj(x) or np.iscomplexobj(s)):
        return up, twice
    dx, ds = np.imag(x), np.imag(s)
    return up + 1j * (half * dx + density * ds), twice + 1j * (up * dx + wide * half * ds)


def hats(x: Any, pitch: float, sigma: Any, step: Any) -> Any:
    """Weights (n, nodes) of a field that is linear between nodes and zero outside, seen by pixels `x` (n, nodes) m
    before each node, `step` (nodes - 1,) or (n, nodes - 1) m apart; a box of `pitch` convolved with a Gaussian."""
    ahead, behind = ramp(x + 0.5 * pitch, sigma), ramp(x - 0.5 * pitch, sigma)
    once, twice = ((a - b) / pitch for a, b in zip(ahead, behind, strict=True))
    area = once[:, :-1] - once[:, 1:]
    later = (-step * once[:, 1:] + twice[:, :-1] - twice[:, 1:]) / step
    weights = np.zeros(x.shape, dtype=later.dtype)
    weights[:, :-1] += area - later
    weights[:, 1:] += later
    return weights


Kept = dict[bytes, Any]  # matrices that several images share


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
        _sparse(first, along, optics[0], lambda k, j, at: k * len(along) + at, values[0].size),
        _sparse(second, up, optics[1], lambda i, j, at: at * len(u) + j, len(up) * len(u)),
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


def _sparse(at: Any, nodes: Any, optics: Any, column: Any, size: int) -> Any:
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
    weights = hats(flat[:, None] - near, pitch, sigma, np.diff(near, axis=1))
    i, j = (a.ravel()[:, None] for a in np.indices(at.shape))
    start = np.arange(len(flat) + 1) * width
    return csr_array((weights.ravel(), column(i, j, which).ravel(), start), shape=(len(flat), size))
