"""The road behind the block, which is cooler beside its edges: there the block's face was cooler, and took more heat.

In 2D the road is the one behind the middle.  Beside its edges it received less by what the contact passes on of that by
which the face is cooler near the side walls (`flashtemp/camera/corner.py`).
"""

from __future__ import annotations

import numpy as np

from flashtemp.camera.wall import Face, Films, corner_of
from flashtemp.model.scene import Scene
from flashtemp.physics.interpolation import between

DEEPEST, NODES = 0.012, 9  # m that air reaches into a block while it is tested, and nodes over it
LEAST = 0.02  # of what friction releases, below which the road's heat is no measure


def across(scene: Scene, run, films: Films, times, behind, face: Face) -> tuple[np.ndarray, np.ndarray]:
    """Places y (m) across the road, and what share (frames, y, behind) of the middle's rise they show.

    At `times` (s), and at `behind` (m) from the leading edge.
    """
    half = 0.5 * scene.width
    off = min(half, DEEPEST) * np.linspace(0.0, 1.0, NODES) ** 2
    slid = _sliding(scene, np.asarray(times))
    corner, moments = corner_of(scene, films, slid, face)
    lacks, _, into_block = corner.lacks(np.zeros(1), off, moments)
    released = _released(scene, run, slid, corner.edges)
    taken = np.maximum(released - into_block, LEAST * released)
    missing = corner.hold[np.maximum(moments - 1, 0), :, None] * lacks[..., 0]
    ends = corner.edges - corner.edges[0]
    roots = np.sqrt(np.maximum(np.asarray(behind)[:, None] - ends, 0.0))
    weight = roots[:, :-1] - roots[:, 1:]
    less = np.einsum("ux,fxy->fyu", weight, missing) / np.maximum((taken @ weight.T)[:, None], 1e-12)
    share = 1.0 - np.clip(less, 0.0, 1.0)
    return np.concatenate([-half + off, half - off[::-1]]), np.concatenate([share, share[:, ::-1]], axis=1)


def _sliding(scene: Scene, times: np.ndarray) -> np.ndarray:
    """The times (s), or where the block waits then the end of its last sliding."""
    out = times.astype(float)
    for phase in scene.schedule.phases:
        if not phase.sliding:
            out[(times > phase.begin) & (times <= phase.end)] = phase.begin
    return out


def _released(scene: Scene, run, times: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Friction heat mu p v (frames, x) in W/m2 of face, means over groups of columns between `edges` (m)."""
    phases = [p for p in scene.schedule.phases if p.sliding]
    speed = [
        next((scene.moment(p, t).speed for p in reversed(phases) if p.begin <= t <= p.end + 1e-9), 0.0) for t in times
    ]
    slides = np.isfinite(run.friction)
    mu = np.interp(times, run.time[slides], run.friction[slides])
    columns = run.mesh.x[run.mesh.first : run.mesh.last + 1]
    group = np.clip(np.searchsorted(edges, 0.5 * (columns[1:] + columns[:-1])) - 1, 0, len(edges) - 2)
    inside = group[:, None] == np.arange(len(edges) - 1)
    pressure = between(run.pressure.astype(float), run.time, times) @ (
        inside * np.diff(columns)[:, None] / np.diff(edges)
    )
    return pressure * (mu * speed)[:, None]
