"""Block and road as a cloud of points coloured by temperature, for the 3D scene of the web page."""

from __future__ import annotations

import numpy as np

from flashtemp.viz import theme

N_POINTS_X, N_POINTS_Y, N_POINTS_Z, SCENE_LENGTH = (
    90,
    24,
    28,
    10.0,
)  # points of a body, and length of the block in the scene


def surface_points(fields) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n, 3) and colours (n, 3), 0 to 1, on the surfaces of block and road at the last stored time."""
    t = float(fields.times[-1])
    bodies = [_sample_surface(*fields.tensor(name, t)) for name in ("block", "road")]
    x = bodies[0][0][:, 0]
    scale, middle = SCENE_LENGTH / float(np.ptp(x)), np.array([x.mean(), 0.0, 0.0])
    T = np.concatenate([b[1] for b in bodies])
    low, high = (float(v) for v in np.percentile(T, (0.5, 99.5)))
    colours = theme.temperature_map()((T - low) / max(high - low, 1e-9))[:, :3]
    return scale * (np.concatenate([b[0] for b in bodies]) - middle), colours


def _sample_surface(x: np.ndarray, y: np.ndarray, z: np.ndarray, T: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Evenly spread points on the six faces of a body, and the temperatures of their cells."""
    width = (
        y if len(y) > 1 else np.array([-0.5, 0.5]) * float(np.ptp(x))
    )  # a 2D field has no width: draw it as wide as long
    axes = [np.linspace(a[0], a[-1], n) for a, n in ((x, N_POINTS_X), (width, N_POINTS_Y), (z, N_POINTS_Z))]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    edge = np.zeros(places.shape[:3], bool)
    for axis in range(3):
        ends = [slice(None)] * 3
        for end in (0, -1):
            ends[axis] = end  # type: ignore[call-overload]
            edge[tuple(ends)] = True
    points = places[edge]
    at = [np.clip(np.searchsorted(e, points[:, k], side="right") - 1, 0, n - 1)
          for k, (e, n) in enumerate(zip((x, y, z), T.shape, strict=True))]  # fmt: skip
    at[1] = at[1] if len(y) > 1 else np.zeros(len(points), int)
    return points, T[tuple(at)]
