"""Profile across the road behind the block, which is cooler near its edges than a 2D run predicts for the middle.

Near the side walls the block's face is cooler and takes more of the friction heat.  The road received less by the
contact conductance times the deficit of the face, eqs. (29) and (33) of docs/explanation/theory.md.
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

MAX_LATERAL_REACH_M, LATERAL_NODES = 0.012, 9  # m, depth that the wall's cooling reaches in a test; nodes over it
SLOW_SPEED_FRACTION = 0.5  # of the highest speed so far: below, the camera shows road that was passed earlier
MIN_HEAT_FRACTION = 0.02  # of the friction heat: lower bound of the road's part, by which the deficit is divided


def wake_lateral_profile(
    scene: Scene, run, films: WallFilmCoefficients, times, behind, face: FaceHistory
) -> tuple[np.ndarray, np.ndarray]:
    """Positions y (m) across the road, and the ratio (frames, y, behind) of the rise there to that of the middle.

    At `times` (s) and at distances `behind` (m) from the leading edge.
    """
    half, reach = 0.5 * scene.width, min(0.5 * scene.width, MAX_LATERAL_REACH_M)
    off = reach * np.linspace(0.0, 1.0, LATERAL_NODES) ** 2
    middle = slice(1, None) if reach == half else slice(None)  # there both sides meet
    y = np.concatenate([-half + off, (half - off[::-1])[middle]])
    passed = _passage_times(scene, run, np.asarray(times, dtype=float))
    if passed.max() <= face.times[0]:
        return y, np.ones((len(passed), len(y), len(behind)))
    corner, moments = build_corner_model(scene, films, passed, face)
    deficits, _, into_block = corner.temperature_deficit(np.zeros(1), off, moments)
    released = _friction_heat(scene, run, passed)
    into_road = np.maximum(released - into_block, MIN_HEAT_FRACTION * released)
    missing = corner.contact_conductance[np.maximum(moments - 1, 0), :, None] * deficits[..., 0]
    ends = corner.edges - corner.edges[0]
    # heat that the road took at x has cooled as 1/sqrt(x_behind - x) (eq. (33)): integrals over the groups
    roots = np.sqrt(np.maximum(np.asarray(behind)[:, None] - ends, 0.0))
    weight = roots[:, :-1] - roots[:, 1:]
    loss = np.einsum("ux,fxy->fyu", weight, missing) / np.maximum((into_road @ weight.T)[:, None], 1e-12)
    ratio = 1.0 - np.clip(loss, 0.0, 1.0)
    return y, np.concatenate([ratio, ratio[:, ::-1][:, middle]], axis=1)


def _passage_times(scene: Scene, run, times: np.ndarray) -> np.ndarray:
    """Times (s) at which the block passed the road that the camera shows at `times`.

    They are the times themselves.  Where the block waits, or slides at less than half of its highest speed so far, they
    are the time of the last record of a higher speed.
    """
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
    """Friction heat mu p v (frames, groups of columns) per area of the face, W/m2."""
    slides = np.isfinite(run.friction)
    mu = np.interp(times, run.time[slides], run.friction[slides])
    speed = np.array([_sliding_speed(scene, t) for t in times])
    return (
        interpolate_linear(run.pressure.astype(float), run.time, times)
        @ group_columns(scene)[1]
        * (mu * speed)[:, None]
    )
