"""Predicted readings of thermocouples and pyrometers: the field at their positions, delayed by a time constant."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.linalg import solve_banded

from flashtemp.camera.sensors import SensorPositions
from flashtemp.errors import BadInput
from flashtemp.physics.interpolation import interpolate_linear

REMEMBERED_LAGS = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0)  # earlier times that matter, in time constants
LAG_SUBSTEPS = 8  # between two kept fields, for the convolution with the lag
HEIGHT_TOLERANCE = 1e-9  # relative difference below which two heights are equal
MIN_SPACING_LAGS = 0.2  # of the mean time constant: earlier times closer together than this are left out


def required_times(places: SensorPositions, times: np.ndarray) -> np.ndarray:
    """Times (s) at which a run must keep its field for readings at `times` (s), with those that a lag depends on."""
    lags = np.unique(np.maximum(places.lag_s, places.lag_sigma_s))
    lags = lags[lags > 0]
    more = np.concatenate([times, *(times - w * lag for lag in lags for w in REMEMBERED_LAGS)])
    more = np.unique(more[more > 0])
    if not len(lags):
        return more
    kept: list[float] = []
    readings = set(times.tolist())
    for t in more.tolist():
        if t in readings or not kept or t - kept[-1] > MIN_SPACING_LAGS * lags.mean():
            kept.append(t)
    return np.array(kept)


def sensor_temperatures(run, places: SensorPositions, times: np.ndarray) -> np.ndarray:
    """Readings (times, points) degC; between the kept fields of a run temperature is linear in time."""
    kept = run.time[run.frames]
    T = _fields_at_sensors(run, places)
    readings = interpolate_linear(T, kept, times)
    fine = np.unique(
        np.concatenate([kept[:-1] + f * np.diff(kept) for f in np.arange(LAG_SUBSTEPS) / LAG_SUBSTEPS] + [kept[-1:]])
    )
    for j in np.flatnonzero(places.lag_s):
        smooth, lag = PchipInterpolator(kept, T[:, j])(fine), float(places.lag_s[j])
        delay = first_order_lag(fine, smooth, abs(lag)) - smooth
        # a fit may try a negative lag: the reading is then early by as much, which keeps the derivative continuous
        readings[:, j] = np.interp(times, fine, smooth + np.sign(lag) * delay)
    return readings


def first_order_lag(time: np.ndarray, T: np.ndarray, lag: float) -> np.ndarray:
    """Solution (n,) of lag dS/dt = T - S from equilibrium, exact for T (n,) that is linear between `time` (n,) s.

    >>> first_order_lag(np.array([0.0, 1.0]), np.array([0.0, 1.0]), 1.0).round(6).tolist()  # t - lag (1 - exp(-t/lag))
    [0.0, 0.367879]
    """
    T = np.asarray(T, dtype=float)
    step = np.diff(time)
    # T is linear in a step: the solution of eq. (39) decays towards T less the lag times its slope
    decay, offset = np.exp(-step / lag), lag * np.diff(T) / step
    source = np.concatenate([T[:1], T[1:] - offset - (T[:-1] - offset) * decay])  # S[i] - decay S[i-1]
    bands = np.vstack([np.ones(len(T)), np.append(-decay, 0.0)])
    readings: np.ndarray = solve_banded((1, 0), bands, source)
    return readings


def check_positions(places: SensorPositions, scene, file: str) -> None:
    """BadInput for a point outside the block or outside the simulated part of the road."""
    mesh, half = scene.mesh, 0.5 * scene.width
    for i, name in enumerate(places.names):
        x, y, z = (float(getattr(places, k)[i]) for k in "xyz")
        low, high = (0.0, scene.length) if z > 0 else (float(mesh.x[0]), float(mesh.x[-1]))
        for key, value, lowest, highest in (
            ("x", x, low, high),
            ("y", y, -half, half),
            ("z", z, -float(mesh.depth[-1]), scene.height),
        ):
            if not lowest <= value <= highest:
                raise BadInput(
                    f"{file}: points: {name}: {key} = {value:g} m lies outside what is simulated, {lowest:g} to "
                    f"{highest:g} m; correct its position, or the case"
                )


# --- fields at positions ----------------------------------------------------------------------------
def _fields_at_sensors(run, places: SensorPositions) -> np.ndarray:
    """Temperatures (frames, points) degC at the positions, in all kept fields."""
    out = np.empty((len(run.frames), len(places)))
    mesh = run.mesh
    above = places.z >= 0
    if above.any():
        edges_x, here = mesh.x[mesh.first : mesh.last + 1], places.select_points(above)
        at_face, wz = block_height_weights(mesh, here.z)
        out[:, above] = _interpolate_columns(run.field, mesh.everywhere(mesh.block), edges_x, mesh.y, here, wz)
        if at_face.any():
            wx, wy = cell_weights(edges_x, here.x), cell_weights(mesh.y, here.y)
            face = np.einsum("fij,pi,pj->fp", _face_temperatures(run), wx, wy, optimize=True)
            out[:, above] += face * at_face
    if (~above).any():
        here = places.select_points(~above)
        wz = cell_weights(-mesh.depth[::-1], here.z)
        out[:, ~above] = _interpolate_columns(run.field, mesh.everywhere(mesh.road), mesh.x, mesh.y, here, wz)
    return out


def _interpolate_columns(
    field: np.ndarray, cells: np.ndarray, edges_x: np.ndarray, edges_y: np.ndarray, places: SensorPositions,
    height_weights: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Temperatures (frames, points) degC in `cells` (columns, heights, planes) of a `field` (frames, all cells).

    `height_weights` (points, heights).  Points above one another share a column, which is interpolated once.
    """
    spots, column = np.unique(np.stack([places.x, places.y]), axis=1, return_inverse=True)
    weights = np.einsum("pi,pj->ijp", cell_weights(edges_x, spots[0]), cell_weights(edges_y, spots[1]))
    weights, by_height = weights.reshape(-1, weights.shape[-1]), np.moveaxis(cells, 1, 0)
    out = np.empty((len(field), len(places)))
    for frame, T in enumerate(field):  # one at a time: all of them in double precision would need much memory
        columns = T[by_height].astype(float).reshape(len(by_height), -1) @ weights
        out[frame] = np.einsum("pk,kp->p", height_weights, columns[:, column])
    return out


def _face_temperatures(run) -> np.ndarray:
    """Surface temperature of the block's face (frames, columns, planes across) degC."""
    if run.mesh.n_across > 1:
        shape = (len(run.frames), -1, run.mesh.n_across)
        return np.asarray(run.maps["T_block"], dtype=float).reshape(shape)
    return np.asarray(run.T_block[run.frames], dtype=float)[..., None]


def cell_weights(edges: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Weights (points, cells) of values at cell centres: splines over the cell number, parabolas at the edges."""
    n = len(edges) - 1
    if n == 1:
        return np.ones((len(at), 1))
    ends = np.array([_edge_weights(edges, 0), _edge_weights(edges, n)])
    return _spline_weights(edges, at) @ np.vstack([ends[:1], np.eye(n), ends[1:]])


def block_height_weights(mesh, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weights of the face (points,) and of the cells up the block (points, cells) at heights `at` (points,) m.

    Each layer is interpolated by itself, since temperature has a kink or a jump at a joint.  A point there belongs to
    the lower layer.
    """
    if not mesh.joints:
        return _height_weights(mesh.height, at)
    at_face, cells = np.zeros(len(at)), np.zeros((len(at), mesh.n_block))
    tops = mesh.height[[s.stop for s in mesh.layers]]
    number = np.minimum(np.searchsorted(tops * (1.0 + HEIGHT_TOLERANCE), at), len(tops) - 1)
    for n, layer in enumerate(mesh.layers):
        edges, here = mesh.height[layer.start : layer.stop + 1], number == n
        if n == 0:
            at_face[here], cells[here, layer] = _height_weights(edges, at[here])
        else:
            cells[here, layer] = cell_weights(edges, at[here])
    return at_face, cells


def _height_weights(height: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weights of the face (points,) and of the cells up the block (points, cells)."""
    n = len(height) - 1
    if n == 1:
        of_face = np.clip(1.0 - at / (0.5 * height[1]), 0.0, 1.0)
        return of_face, (1.0 - of_face)[:, None]
    spline = _spline_weights(height, at)
    return spline[:, 0], spline[:, 1:-1] + spline[:, -1:] * _edge_weights(height, n)


def _spline_weights(edges: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Weights (points, cells + 2) of first edge, centres, last edge: graded meshes are smooth in the cell number."""
    n = len(edges) - 1
    number = np.concatenate([[0.0], np.arange(n) + 0.5, [n]])
    place = np.concatenate([edges[:1], 0.5 * (edges[1:] + edges[:-1]), edges[-1:]])
    to_place = CubicSpline(number, place)
    cell_number = np.interp(at, place, number)
    for _ in range(4):  # Newton from the piecewise linear map, which is close
        cell_number = np.clip(cell_number - (to_place(cell_number) - at) / to_place(cell_number, 1), 0.0, n)
    return np.asarray(CubicSpline(number, np.eye(n + 2))(cell_number))


def _edge_weights(edges: np.ndarray, k: int) -> np.ndarray:
    """Weights (cells,) of the value at an outermost edge: the parabola, or line, through the nearest cells."""
    n = len(edges) - 1
    near = np.arange(min(n, 3)) if k == 0 else np.arange(max(n - 3, 0), n)
    centre = 0.5 * (edges[1:] + edges[:-1])[near]
    out = np.zeros(n)
    for i, c in zip(near, centre, strict=True):
        others = centre[near != i]
        out[i] = np.prod((edges[k] - others) / (c - others))
    return out
