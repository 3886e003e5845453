"""Block and road as points in space with the colours of their temperature, for a page that can turn them."""

from __future__ import annotations

import numpy as np

from flashtemp.viz import theme

N_POINTS_X, N_POINTS_Y, N_POINTS_Z, SCENE_LENGTH = 90, 24, 28, 10.0  # points of a body, and how long the block is made


def surface_points(fields) -> tuple[np.ndarray, np.ndarray]:
    """Places (n, 3) and colours (n, 3) from 0 to 1 of the surfaces of block and road at the last kept time."""
    t = float(fields.times[-1])
    bodies = [_sample_surface(*fields.tensor(name, t)) for name in ("block", "road")]
    x = bodies[0][0][:, 0]
    scale, middle = SCENE_LENGTH / float(np.ptp(x)), np.array([x.mean(), 0.0, 0.0])
    T = np.concatenate([b[1] for b in bodies])
    low, high = (float(v) for v in np.percentile(T, (0.5, 99.5)))
    colours = theme.temperature_map()((T - low) / max(high - low, 1e-9))[:, :3]
    return scale * (np.concatenate([b[0] for b in bodies]) - middle), colours


def _sample_surface(x: np.ndarray, y: np.ndarray, z: np.ndarray, T: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points on the six faces of a body spread evenly, and the temperatures of the cells that they lie in."""
    width = y if len(y) > 1 else np.array([-0.5, 0.5]) * float(np.ptp(x))  # 2D says nothing of the width
    axes = [np.linspace(a[0], a[-1], n) for a, n in ((x, N_POINTS_X), (width, N_POINTS_Y), (z, N_POINTS_Z))]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    edge = np.zeros(places.shape[:3], bool)
    for axis in range(3):
        ends = [slice(None)] * 3
        for end in (0, -1):
            ends[axis] = end  # type: ignore[call-overload]
            edge[tuple(ends)] = True
    found = places[edge]
    at = [np.clip(np.searchsorted(e, found[:, k], side="right") - 1, 0, n - 1)
          for k, (e, n) in enumerate(zip((x, y, z), T.shape, strict=True))]  # fmt: skip
    at[1] = at[1] if len(y) > 1 else np.zeros(len(found), int)
    return found, T[tuple(at)]
