"""Predicted images of a run: the side wall, the wake or a profile as a camera reports them.

Temperatures become radiance first, because pixel and point spread average radiance, not temperature.  The camera turns
the mean back into a temperature with the emissivity and the reflected temperature that were set in it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from scipy.interpolate import CubicSpline

from flashtemp.camera.image_placement import STATED_PLACEMENT, ImagePlacement, scale_origin
from flashtemp.camera.prediction import sensor_observation
from flashtemp.camera.prediction.camera_model import CameraModel, ImageFormation
from flashtemp.camera.prediction.pixel_sampling import MatrixCache
from flashtemp.camera.prediction.sensor_observation import sensor_temperatures
from flashtemp.camera.prediction.wall_temperature.side_wall_temperature import (
    FaceHistory,
    WallFilmCoefficients,
    side_wall_rise,
    wall_deficit_length,
)
from flashtemp.camera.prediction.wall_temperature.wake_cross_profile import wake_lateral_profile
from flashtemp.camera.recording import Recording
from flashtemp.errors import BadInput
from flashtemp.model.scene import ActiveEffect, Scene
from flashtemp.physics.interpolation import interpolate_linear
from flashtemp.physics.quantities import KELVIN

WAKE_CELL_GROWTH = 1.1  # growth of the road's cells behind the block if a wake is recorded
SIDE_WALL_CELLS = 10  # uniform cells up the block if a side wall is recorded
POINTS_PER_CELL = 3  # of the refined fields that are sampled
BATCH = 64  # frames that are predicted at a time: refined fields are large
EDGE_MARGIN_PX = 1.5  # px around the edge of a body that no comparison uses
BLOCK_SIZE_TOLERANCE = 0.01  # relative uncertainty of the block's length and width, and so of its edges
ROUNDED_TIME_S = 1e-6  # by which a stamp at the end of a phase may be rounded
PSF_TAIL_WIDTHS = 4.0  # widths of the point spread within which the edge of the wake shows


@dataclass(frozen=True)
class PredictedImage:
    """Predicted `temperature` (frames, nv, nu) degC; `inside` (nv, nu): pixels that see only the block or the road.

    `slopes` (frames, nv, nu) where required: derivatives by "shift_u" and "shift_v" (K/px), "scale" (K), "turn"
    (K/rad), relative "spread" of the optics (K), and "gain", by the true emissivity (K).
    """

    temperature: np.ndarray
    inside: np.ndarray
    slopes: dict[str, np.ndarray] = field(default_factory=dict)


# --- fields between cells --------------------------------------------------------------------------------
def _repeat_ends(values, axis: int):
    """A field with its outermost values repeated at the ends of an axis."""
    return np.concatenate([values.take([0], axis), values, values.take([-1], axis)], axis)


def _extrapolate_ends(values, nodes, axis: int):
    """A field at cell centres with its values at both edges of an axis added, on parabolas through three cells.

    `nodes` are the first edge, the centres and the last edge.
    """
    ends = []
    for at, near in ((nodes[0], slice(0, 3)), (nodes[-1], slice(-3, None))):
        centre = nodes[1:-1][near]
        weights = [np.prod((at - np.delete(centre, i)) / (c - np.delete(centre, i))) for i, c in enumerate(centre)]
        end = np.tensordot(np.array([weights]), np.moveaxis(values, axis, 0)[near], 1)
        ends.append(np.moveaxis(end, 0, axis))
    return np.concatenate([ends[0], values, ends[1]], axis)


def refine_field(values: np.ndarray, nodes: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """A field and its nodes at POINTS_PER_CELL points per cell, by cubic splines over the number of the cell.

    The nodes are the first edge, the centres of cells and the last edge.  Graded meshes are smooth in the cell number,
    so a field that is linear between the new nodes is far closer to the true one.
    """
    if len(nodes) < 4:
        return values, nodes
    weights = _refinement_weights(len(nodes) - 2)
    return np.moveaxis(np.tensordot(weights, values, (1, axis)), 0, axis), weights @ nodes


@cache
def _refinement_weights(n: int) -> np.ndarray:
    """Weights (points, n + 2) of the first edge, n centres of cells and the last edge in the refined field."""
    number = np.concatenate([[0.0], np.arange(n) + 0.5, [n]])
    weights: np.ndarray = CubicSpline(number, np.eye(n + 2))(np.arange(n * POINTS_PER_CELL + 1) / POINTS_PER_CELL)
    return weights


# --- the operator -----------------------------------------------------------------------------------
def check_view(recording: Recording, scene: Scene, file: str) -> None:
    """BadInput for a view that this scene cannot predict."""
    if recording.view == "sidewall" and scene.layers:
        raise BadInput(
            f"{file}: view: the side wall of a block with layers is not modelled; give points, a wake or a profile"
        )
    if recording.view == "wake" and scene.mesh.last == len(scene.mesh.x) - 1:
        raise BadInput(f"{file}: view: no road lies behind the block; give road.downstream more than 0 m for a wake")
    if recording.places is not None:
        sensor_observation.check_positions(recording.places, scene, file)


def observe(
    run,
    scene: Scene,
    recording: Recording,
    acting: tuple[ActiveEffect, ...] = (),
    shift=(0.0, 0.0),
    change: float = 0.0,
    place: ImagePlacement = STATED_PLACEMENT,
    kept: MatrixCache | None = None,
    face: FaceHistory | None = None,
    ruler: tuple[float, float] | None = None,
    slopes: bool = False,
) -> PredictedImage:
    """Predicted image of a run for the camera of a recording, with instrument effects `acting`.

    `shift` (px along u, v) of the whole image; `change` of the true emissivity against the stated one; `place` is the
    image's scale, rotation and clock.  `kept` caches matrices of one recording; `face` is the history of the block's
    face, for runs with few records.  `ruler`: length and width (m) of the block by which pixels are selected, where
    they differ from the scene's.  `slopes` adds the derivatives of `PredictedImage` (not for thermocouples).  Fields
    are interpolated linearly in time, exactly if the run kept them at `CameraModel.required_times`.
    """
    camera = CameraModel(recording, acting, place.clock)
    if recording.places is not None:
        return _observe_sensors(run, recording, camera)
    times = np.clip(camera.observed_times(), 0.0, run.time[-1])
    if recording.view == "wake":
        times = np.minimum(times, _latest_times(scene, recording.time))
    formation = ImageFormation.from_camera(camera, scene, shift, change, place)
    offset = np.broadcast_to(camera("offset", 0.0), len(times))[:, None, None]
    predicted: dict[str, np.ndarray] = {}
    batches = np.array_split(np.arange(len(times)), max(1, -(-len(times) // BATCH)))
    for batch in batches:
        # refined fields are large, so each batch uses only those around its own times
        near = run if len(batches) == 1 else _run_around(run, times[batch])
        body, along, up = _visible_temperatures(near, scene, recording, times[batch], face, kept)
        for name, part in formation.apparent_temperatures(body, (along, up), kept, slopes).items():
            if name not in predicted:
                predicted[name] = np.empty((len(times), *part.shape[1:]), np.float32 if name else float)
            predicted[name][batch] = part
    temperature = predicted.pop("") + offset
    return PredictedImage(
        temperature, _interior_mask(recording, *_stated_nodes(recording, scene, ruler, along, up)), predicted
    )


def _latest_times(scene: Scene, stamped: np.ndarray) -> np.ndarray:
    """Latest times (frames,) in s that frames with the times `stamped` may show.

    A frame that is stamped at the very end of a phase, as schedules have it, shows this phase: a moment later the block
    may be lifted.  Others have no limit, because their clock may be off by more than they are from the end.
    """
    ends = np.array([phase.end for phase in scene.schedule.phases])
    is_end = np.any(np.abs(stamped[:, None] - ends) <= ROUNDED_TIME_S, axis=1)
    return np.where(is_end, stamped, np.inf)


def _observe_sensors(run, recording: Recording, camera: CameraModel) -> PredictedImage:
    """Readings of thermocouples, which have neither optics nor emissivity."""
    assert recording.places is not None
    T = sensor_temperatures(run, recording.places, np.clip(camera.observed_times(), 0.0, run.time[-1]))
    T = T + np.broadcast_to(camera("offset", 0.0), len(T))[:, None]
    return PredictedImage(T[:, None], np.ones((1, len(recording.u)), dtype=bool))


def _run_around(run, times: np.ndarray):
    """The run with only those of its fields that surround `times` (s)."""
    kept = run.time[run.frames]
    k = slice(max(np.searchsorted(kept, times.min()) - 1, 0), np.searchsorted(kept, times.max()) + 1)
    maps = {name: values[k] for name, values in run.maps.items()}
    return replace(run, frames=run.frames[k], field=run.field[k], maps=maps)


def _visible_temperatures(run, scene, recording, times, face: FaceHistory | None, kept: MatrixCache | None):
    """Temperatures (frames, v nodes, u nodes) degC of the body in view, and its nodes along u and v (m)."""
    if recording.view == "profile":
        x = np.concatenate([run.mesh.x[[run.mesh.first]], run.x, run.mesh.x[[run.mesh.last]]])
        T = _extrapolate_ends(interpolate_linear(run.T_block, run.time, times)[:, None], x, 2)
        return *refine_field(T, x, 2), np.zeros(1)
    if recording.view == "wake":
        return _wake_temperatures(run, scene, recording, times, face, {} if kept is None else kept)
    return _wall_temperatures(run, scene, times, face, kept)


def _wake_temperatures(run, scene, recording, times, face: FaceHistory | None, kept: MatrixCache):
    """Surface of the road behind the block, in the form of `_visible_temperatures`."""
    behind, road = _visible_road(run, run.mesh.x[run.mesh.last], recording)
    half, films = 0.5 * scene.width, WallFilmCoefficients.from_scene(scene)
    T = road(run.maps, run.frames) if scene.resolved else road(vars(run), slice(None))
    T = interpolate_linear(T, run.time[run.frames] if scene.resolved else run.time, times)
    T, behind = refine_field(_extrapolate_ends(T, behind, 1), behind, 1)
    if scene.resolved:
        return np.swapaxes(_repeat_ends(T, 2), 1, 2), behind, np.concatenate([[-half], run.mesh.y_centre, [half]])
    if run.direction is not None or scene.schedule.alone or not films.wall.any():
        return np.repeat(T[:, None], 2, axis=1), behind, np.array([-half, half])
    inputs = times, behind, films.start_times, films.wall, films.section, run.mesh.x, run.mesh.y
    key = b"edges of a wake" + b"".join(a.tobytes() for a in inputs)
    if key not in kept:  # perturbed runs share the profile: its change is of second order
        kept[key] = wake_lateral_profile(scene, run, films, times, behind, face or FaceHistory.from_run(run, scene))
    y, ratio = kept[key]
    air = scene.ambient - KELVIN + np.interp(times, *films.air)[:, None]
    return air[:, None] + (T - air)[:, None] * ratio, behind, y


def _wall_temperatures(run, scene, times, face: FaceHistory | None, kept: MatrixCache | None):
    """Side wall of the block, in the form of `_visible_temperatures`."""
    mesh, height = run.mesh, run.mesh.height
    x = np.concatenate([mesh.x[[mesh.first]], run.x, mesh.x[[mesh.last]]])
    z = np.concatenate([[0.0], 0.5 * (height[1:] + height[:-1]), height[-1:]])
    records = run.time[run.frames]
    near = mesh.everywhere(mesh.block)[..., 0]  # x to the right and z up: the camera sees the wall at y = -W/2
    cells = interpolate_linear(run.field[:, near].astype(float), records, times)
    surface = run.maps["T_block"][..., 0] if scene.resolved else run.T_block[run.frames]
    surface = interpolate_linear(surface.astype(float), records, times)
    air, films = scene.ambient - KELVIN, WallFilmCoefficients.from_scene(scene)
    rise = np.concatenate([surface[..., None], _extrapolate_ends(cells, z, 2)[..., 1:]], axis=2) - air
    if scene.resolved:  # from the centre of the outermost cell to its wall (eq. (34))
        length = wall_deficit_length(z, 0.5 * (mesh.y[1] - mesh.y[0]))
        film = films.coefficient_at(times, films.section)
        rise = rise / (1.0 + film[:, None] * length / scene.block.conductivity)[:, None]
    elif films.wall.any():
        rise = side_wall_rise(scene, films, z, times, rise, face or FaceHistory.from_run(run, scene), kept)
    wall = np.swapaxes(air + _extrapolate_ends(rise, x, 1), 1, 2)
    wall, x = refine_field(wall, x, 2)
    wall, z = refine_field(wall, z, 1)
    return wall, x, z


def _visible_road(run, length: float, recording: Recording):
    """Nodes (m) of the road that the camera of a wake sees, and the function that takes its temperatures from fields.

    The road lies behind the block, x > L, or at x < 0 for a block that slides back, if the pixels lie there.  While the
    block slides the other way, the camera sees the road ahead of it.  The function takes the fields and the indices of
    their records.
    """
    x = run.mesh.x
    if run.direction is None:
        return np.concatenate([[length], run.x_wake, x[-1:]]), lambda fields, kept: np.asarray(fields["T_wake"], float)
    right = float(np.median(recording.u)) > 0.5 * length
    names = ("T_wake", "T_ahead") if right else ("T_ahead", "T_wake")  # sliding forward, and back

    def road(fields, kept):
        forward, back = (np.asarray(fields[name], float) for name in names)
        direction = run.direction[kept].reshape(-1, *[1] * (forward.ndim - 1))
        if np.all(direction < 0):
            return back[:, ::-1]
        return np.where(direction > 0, forward, back[:, ::-1])

    lines = run.mesh.x_centre[run.mesh.last :] if right else run.mesh.x_centre[: run.mesh.first]
    return np.concatenate([[length], lines, x[-1:]] if right else [x[:1], lines, [0.0]]), road


def _stated_nodes(recording: Recording, scene: Scene, ruler: tuple[float, float] | None, along, up):
    """Nodes (m) along u and v of the body in view, for a block of the length and width in `ruler`."""
    if ruler is None:
        return along, up
    if recording.view != "wake":
        return along * (ruler[0] / scene.length), up
    behind = scale_origin(recording, scene.length)
    return along + (ruler[0] - behind if behind else 0.0), up * (ruler[1] / scene.width)


def _interior_mask(recording: Recording, along: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Pixels (nv, nu) that stay EDGE_MARGIN_PX away from the edges of the body, wherever the image may be shifted.

    The trailing edge is as uncertain as the block's length.  The sides of a wake carry no information but their own
    position, in the tails of a few pixels, where a linearisation fails: they are left out as far as they may show.
    """
    masks, moved = [], max(0.0, 3.0 * (recording.registration_sigma_px or 0.0) - 0.5)
    rims, ends = [EDGE_MARGIN_PX + moved] * 2, [(0.0, BLOCK_SIZE_TOLERANCE * (along[-1] - along[0])), (0.0, 0.0)]
    if recording.view == "wake":
        rims[1] = max(EDGE_MARGIN_PX, 0.5 + PSF_TAIL_WIDTHS * (recording.psf_sigma_px or 0.0)) + moved
        ends = [(0.0, 0.0), (0.5 * BLOCK_SIZE_TOLERANCE * (up[-1] - up[0]),) * 2]
    axes = zip((recording.u, recording.v), recording.pitch, (along, up), rims, ends, strict=True)
    for centres, pitch, nodes, least, (first, last) in axes:
        rim, free = least * pitch, len(nodes) == 1 or not np.isfinite(pitch)
        inside = (centres >= nodes[0] + rim + first) & (centres <= nodes[-1] - rim - last)
        masks.append(np.full(len(centres), True) if free else inside)
    return masks[1][:, None] & masks[0][None]
