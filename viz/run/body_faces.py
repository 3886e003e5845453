"""The six faces of block and road with their temperatures on even grids, for the 3D view of the web page."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flashtemp.viz import theme

N_FACE_POINTS = (240, 48, 128)  # points of a face along x, y, z
MAX_FACE_CELLS = 20_000_000  # of a body that is read at once
MAX_LIMIT_TIMES = 16  # stored times, spread evenly, that give the limits of the colours
LOW_PERCENT, HIGH_PERCENT = 0.1, 99.9  # of the temperatures: limits of the colours

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class BodyFace:
    """A face of `body`: it lies across `axis` (0 to 2) on the `side` 0 (low) or 1 (high).

    `low` and `high` (3,) m are the corners of the body; `T` (n, m) degC runs along the other two axes in their order.
    """

    body: str
    axis: int
    side: int
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    T: Array


def sample_faces(fields, time: float, width: float) -> list[BodyFace]:
    """The faces of block and road at the stored time nearest to `time` (s); `width` (m) is drawn for a 2D field."""
    return [face for name in ("block", "road") for face in _body_faces(name, fields.tensor(name, time), width)]


def temperature_limits(fields) -> tuple[float, float]:
    """Lowest and highest temperature (degC) over the stored times, without outliers; at least 1 K apart."""
    low, high = np.inf, -np.inf
    for t in fields.times[theme.spread_indices(len(fields.times), MAX_LIMIT_TIMES)]:
        for name in ("block", "road"):
            T = fields.T(name, float(t))
            T = T[np.isfinite(T)]
            if len(T):
                limits = np.percentile(T, (LOW_PERCENT, HIGH_PERCENT))
                low, high = min(low, float(limits[0])), max(high, float(limits[1]))
    return (low, max(high, low + 1.0)) if low <= high else (0.0, 1.0)


def _body_faces(name: str, tensor: tuple[Array, Array, Array, Array], width: float) -> list[BodyFace]:
    x, y, z, T = tensor
    if T.size > MAX_FACE_CELLS:
        raise ValueError(f"{T.size} cells in one body; open the result with `flashtemp view`")
    is_flat = len(y) < 2
    edges = (x, np.array([-0.5, 0.5]) * width if is_flat else y, z)
    low, high = ((float(e[0]), float(e[1]), float(e[2])) for e in zip(*((a[0], a[-1]) for a in edges), strict=True))
    shape = (N_FACE_POINTS[0], 1 if is_flat else N_FACE_POINTS[1], N_FACE_POINTS[2])  # a 2D field is even across y
    out = []
    for axis in range(3):
        for side in (0, 1):
            face, (u, v) = np.take(T, -side, axis=axis), [k for k in range(3) if k != axis]
            even = _resample_axis(_resample_axis(face, edges[u], shape[u], 0), edges[v], shape[v], 1)
            out.append(BodyFace(name, axis, side, low, high, even))
    return out


def _resample_axis(values: Array, edges: Array, count: int, axis: int) -> Array:
    """Cell values at `count` even places between the outermost edges, linear between the centres of cells."""
    places = edges[0] + (np.arange(count) + 0.5) / count * (edges[-1] - edges[0])
    centres = 0.5 * (edges[1:] + edges[:-1])
    if len(centres) == 1:
        return np.repeat(values, count, axis=axis)
    upper = np.clip(np.searchsorted(centres, places), 1, len(centres) - 1)
    weight = np.clip((places - centres[upper - 1]) / (centres[upper] - centres[upper - 1]), 0.0, 1.0)
    weight = weight[:, None] if axis == 0 else weight[None, :]
    mixed = (1.0 - weight) * np.take(values, upper - 1, axis=axis) + weight * np.take(values, upper, axis=axis)
    return np.asarray(mixed, float)
