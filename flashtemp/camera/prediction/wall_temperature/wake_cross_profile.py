"""The road behind the block, which is cooler beside its edges: there the block's face was cooler, and took more heat.

In 2D the road is the one behind the middle.  Beside its edges it received less by what the contact passes on of that by
which the face is cooler near the side walls (`flashtemp/camera/prediction/wall_temperature/side_wall_conduction.py`).
"""

from __future__ import annotations

import numpy as np

from flashtemp.camera.prediction.wall_temperature.side_wall_temperature import (
    FaceHistory,
    WallFilmCoefficients,
    build_corner_model,
    group_columns,
)
from flashtemp.model.scene import Scene
from flashtemp.physics.interpolation import interpolate_linear

MAX_LATERAL_REACH_M, LATERAL_NODES = 0.012, 9  # m that air reaches into a block while it is tested, and nodes over it
SLOW_SPEED_FRACTION = 0.5  # of the speed so far: below, the road that is seen was passed before
MIN_HEAT_FRACTION = 0.02  # of what friction releases, below which the road's heat is no measure


def wake_lateral_profile(
    scene: Scene, run, films: WallFilmCoefficients, times, behind, face: FaceHistory
) -> tuple[np.ndarray, np.ndarray]:
    """Places y (m) across the road, and what share (frames, y, behind) of the middle's rise they show.

    At `times` (s), and at `behind` (m) from the leading edge.
    """
    half, reach = 0.5 * scene.width, min(0.5 * scene.width, MAX_LATERAL_REACH_M)
    off = reach * np.linspace(0.0, 1.0, LATERAL_NODES) ** 2
    middle = slice(1, None) if reach == half else slice(None)  # there both sides meet
    y = np.concatenate([-half + off, (half - off[::-1])[middle]])
    slid = _passage_times(scene, run, np.asarray(times, dtype=float))
    if slid.max() <= face.times[0]:
        return y, np.ones((len(slid), len(y), len(behind)))
    corner, moments = build_corner_model(scene, films, slid, face)
    lacks, _, into_block = corner.temperature_deficit(np.zeros(1), off, moments)
    released = _friction_heat(scene, run, slid)
    taken = np.maximum(released - into_block, MIN_HEAT_FRACTION * released)
    missing = corner.contact_conductance[np.maximum(moments - 1, 0), :, None] * lacks[..., 0]
    ends = corner.edges - corner.edges[0]
    roots = np.sqrt(np.maximum(np.asarray(behind)[:, None] - ends, 0.0))
    weight = roots[:, :-1] - roots[:, 1:]
    less = np.einsum("ux,fxy->fyu", weight, missing) / np.maximum((taken @ weight.T)[:, None], 1e-12)
    share = 1.0 - np.clip(less, 0.0, 1.0)
    return y, np.concatenate([share, share[:, ::-1][:, middle]], axis=1)


def _passage_times(scene: Scene, run, times: np.ndarray) -> np.ndarray:
    """When (s) the road passed that the camera sees: the times themselves, or where the block slides at less than half
    of its speed so far, or waits, the last record of more."""
    speeds = np.array([_sliding_speed(scene, t) for t in run.time])
    top = np.maximum.accumulate(speeds)
    last = np.maximum.accumulate(np.where(speeds >= SLOW_SPEED_FRACTION * top, run.time, run.time[0]))
    now = np.maximum(np.searchsorted(run.time, times, side="right") - 1, 0)
    return np.where(
        [_sliding_speed(scene, t) >= SLOW_SPEED_FRACTION * top[k] for t, k in zip(times, now, strict=True)],
        times,
        last[now],
    )


def _sliding_speed(scene: Scene, t: float) -> float:
    """Speed (m/s) at a time (s), 0 while the block waits."""
    for phase in scene.schedule.phases:
        if phase.begin <= t <= phase.end and phase.sliding:
            return scene.law_context(phase, t).speed
    return 0.0


def _friction_heat(scene: Scene, run, times: np.ndarray) -> np.ndarray:
    """Friction heat mu p v (frames, groups of columns) in W/m2 of face."""
    slides = np.isfinite(run.friction)
    mu = np.interp(times, run.time[slides], run.friction[slides])
    speed = np.array([_sliding_speed(scene, t) for t in times])
    return (
        interpolate_linear(run.pressure.astype(float), run.time, times)
        @ group_columns(scene)[1]
        * (mu * speed)[:, None]
    )
