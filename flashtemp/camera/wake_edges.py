"""The road behind the block, which is cooler beside its edges: there the block's face was cooler, and took more heat.

In 2D the road is the one behind the middle.  Beside its edges it received less by what the contact passes on of that by
which the face is cooler near the side walls (`flashtemp/camera/corner.py`).
"""

from __future__ import annotations

import numpy as np

from flashtemp.camera.wall import Face, Films, corner_of, means
from flashtemp.model.scene import Scene
from flashtemp.physics.interpolation import between

DEEPEST, NODES = 0.012, 9  # m that air reaches into a block while it is tested, and nodes over it
SLOW = 0.5  # of the speed so far: below, the road that is seen was passed before
LEAST = 0.02  # of what friction releases, below which the road's heat is no measure


def across(scene: Scene, run, films: Films, times, behind, face: Face) -> tuple[np.ndarray, np.ndarray]:
    """Places y (m) across the road, and what share (frames, y, behind) of the middle's rise they show.

    At `times` (s), and at `behind` (m) from the leading edge.
    """
    half, reach = 0.5 * scene.width, min(0.5 * scene.width, DEEPEST)
    off = reach * np.linspace(0.0, 1.0, NODES) ** 2
    middle = slice(1, None) if reach == half else slice(None)  # there both sides meet
    y = np.concatenate([-half + off, (half - off[::-1])[middle]])
    slid = _passing(scene, run, np.asarray(times, dtype=float))
    if slid.max() <= face.times[0]:
        return y, np.ones((len(slid), len(y), len(behind)))
    corner, moments = corner_of(scene, films, slid, face)
    lacks, _, into_block = corner.lacks(np.zeros(1), off, moments)
    released = _released(scene, run, slid)
    taken = np.maximum(released - into_block, LEAST * released)
    missing = corner.hold[np.maximum(moments - 1, 0), :, None] * lacks[..., 0]
    ends = corner.edges - corner.edges[0]
    roots = np.sqrt(np.maximum(np.asarray(behind)[:, None] - ends, 0.0))
    weight = roots[:, :-1] - roots[:, 1:]
    less = np.einsum("ux,fxy->fyu", weight, missing) / np.maximum((taken @ weight.T)[:, None], 1e-12)
    share = 1.0 - np.clip(less, 0.0, 1.0)
    return y, np.concatenate([share, share[:, ::-1][:, middle]], axis=1)


def _passing(scene: Scene, run, times: np.ndarray) -> np.ndarray:
    """When (s) the road passed that the camera sees: the times themselves, or where the block slides at less than half
    of its speed so far, or waits, the last record of more."""
    speeds = np.array([_speed(scene, t) for t in run.time])
    top = np.maximum.accumulate(speeds)
    last = np.maximum.accumulate(np.where(speeds >= SLOW * top, run.time, run.time[0]))
    now = np.maximum(np.searchsorted(run.time, times, side="right") - 1, 0)
    return np.where([_speed(scene, t) >= SLOW * top[k] for t, k in zip(times, now, strict=True)], times, last[now])


def _speed(scene: Scene, t: float) -> float:
    """Speed (m/s) at a time (s), 0 while the block waits."""
    for phase in scene.schedule.phases:
        if phase.begin <= t <= phase.end and phase.sliding:
            return scene.moment(phase, t).speed
    return 0.0


def _released(scene: Scene, run, times: np.ndarray) -> np.ndarray:
    """Friction heat mu p v (frames, groups of columns) in W/m2 of face."""
    slides = np.isfinite(run.friction)
    mu = np.interp(times, run.time[slides], run.friction[slides])
    speed = np.array([_speed(scene, t) for t in times])
    return between(run.pressure.astype(float), run.time, times) @ means(scene)[1] * (mu * speed)[:, None]
