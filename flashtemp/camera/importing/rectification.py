"""Rectification, from pixels to metres: orientation, scale, origin, marked points and crop.

A pixel is (column, row) counted from 0 at the upper left, its centre at whole numbers.  A map is a 3 x 3 matrix M
with (u, v, 1) ~ M (column, row, 1), u and v in m.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flashtemp.camera.importing.formats.raw_frames import require_module
from flashtemp.camera.radiometry import LONG_WAVE, PlanckCalibration
from flashtemp.errors import BadInput

DIRECTIONS = {"right": (1.0, 0.0), "left": (-1.0, 0.0), "down": (0.0, 1.0), "up": (0.0, -1.0)}  # (column, row)
MM = 1e-3
CUBIC_MARGIN_PX = 6  # pixels added around an image, so that cubic interpolation has no edge
MAX_PIXEL_GROWTH = 4  # ratio of pixels of the rectified image to those of the original


@dataclass(frozen=True)
class RectifiedFrames:
    """Rectified images: `temperature` (frames, nv, nu), pixel centres `u` (nu,), `v` (nv,) in m, and a note."""

    temperature: np.ndarray
    u: np.ndarray
    v: np.ndarray
    note: str = ""


def image_axes(downstream: str, up: str | None) -> np.ndarray:
    """Matrix (2, 2) of the image directions (column, row) of u and v; `up` is optional if u is horizontal."""
    if up is None and downstream in ("left", "right"):
        up = "up"
    if up is None:
        raise BadInput(
            f"up: the direction of v in the image is missing, and u points {downstream}; give --up left or right"
        )
    both = np.array([DIRECTIONS[downstream], DIRECTIONS[up]])
    if both[0] @ both[1] != 0:
        raise BadInput(f"up: {up!r} lies along downstream {downstream!r}; choose a direction across it")
    return both


def map_from_scale(turn: np.ndarray, pixel, at, pitch) -> np.ndarray:
    """M of an image parallel to u and v: `pixel` lies at `at` (u, v; mm), pixels are `pitch` (u, v; mm) apart."""
    M = np.eye(3)
    M[:2, :2] = np.asarray(pitch)[:, None] * turn
    M[:2, 2] = np.asarray(at) - M[:2, :2] @ np.asarray(pixel)
    return _convert_to_metres(M)


def map_from_two_points(turn: np.ndarray, pixel, at, second, shape) -> tuple[np.ndarray, str]:
    """M from two known points, (pixel, at) and `second` (column, row, u, v); and a note on scale and tilt.

    A tilt that moves no pixel of the image (rows, columns) by half a pixel is left out, so that nothing needs to be
    interpolated.
    """
    step = turn @ (np.asarray(second[:2]) - pixel)
    world = np.asarray(second[2:]) - at
    if np.hypot(*step) < 2 or np.hypot(*world) == 0:
        raise BadInput("second: lies on the first point; give one as far from it as possible")
    scale = np.hypot(*world) / np.hypot(*step)
    tilt = np.angle(complex(*world) / complex(*step))
    if abs(tilt) > np.radians(30):
        raise BadInput(
            f"second: lies {np.degrees(tilt):.0f} degrees off; give --downstream and --up as the image has them,"
            " and (column, row, u mm, v mm)"
        )
    note = f"{scale:.4g} mm per pixel, tilt {np.degrees(tilt):.2f} degrees"
    if abs(tilt) * np.hypot(*shape) < 0.5:
        return map_from_scale(turn, pixel, at, (scale, scale)), note
    M = np.eye(3)
    M[:2, :2] = scale * np.array([[np.cos(tilt), -np.sin(tilt)], [np.sin(tilt), np.cos(tilt)]]) @ turn
    M[:2, 2] = at - M[:2, :2] @ pixel
    return _convert_to_metres(M), note


def map_from_points(points) -> tuple[np.ndarray, str]:
    """M from four or more marked points (column, row, u mm, v mm), a homography; and a note on its residuals."""
    p = np.asarray(points, dtype=float)
    if len(p) < 4:
        raise BadInput(f"point: {len(p)} marked; give at least four, no three of them on a line")
    transform = require_module("skimage.transform").ProjectiveTransform.from_estimate(p[:, :2], p[:, 2:])
    M = getattr(transform, "params", None)
    if M is None or not np.all(np.isfinite(M)) or np.linalg.cond(M) > 1e12:
        raise BadInput("point: the marked points lie on a line; give four of which no three do")
    M = M / (M[2] @ (*p[:, :2].mean(axis=0), 1.0))  # sign: the points lie in front of the horizon
    off = apply_homography(np.linalg.inv(M), p[:, 2:]) - p[:, :2]
    rms = float(np.sqrt((off**2).sum(axis=1).mean()))
    if not rms <= 5:
        raise BadInput(f"point: no plane fits the points, {rms:.1f} px off; repair the numbers of one of them")
    return _convert_to_metres(M), f"{len(p)} points fit to {rms:.2f} px" + (", four always fit" if len(p) == 4 else "")


def _convert_to_metres(M: np.ndarray) -> np.ndarray:
    return np.diag([MM, MM, 1.0]) @ M


def apply_homography(M: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (n, 2) through M; NaN behind the horizon of a perspective."""
    x = np.column_stack([points, np.ones(len(points))]) @ M.T
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(x[:, 2:] > 0, x[:, :2] / x[:, 2:], np.nan)


def rectify_frames(
    T: np.ndarray, M: np.ndarray, crop=None, pitch=None, band: PlanckCalibration = LONG_WAVE
) -> RectifiedFrames:
    """Images (frames, rows, columns) on a grid of u and v; `crop` (u0, u1, v0, v1), `pitch` (u, v) in m.

    An image parallel to u and v is only flipped and cropped; any other is interpolated, as radiance and not as degC.
    """
    if np.all(M[2, :2] == 0) and np.count_nonzero(M[:2, :2]) == 2:
        placed = _rectify_aligned(T, M)
    else:
        placed = _rectify_perspective(T, M, crop, pitch, band)
    return placed if crop is None else crop_frames(placed, crop)


def _rectify_aligned(T: np.ndarray, M: np.ndarray) -> RectifiedFrames:
    if M[0, 0] == 0:  # u runs along the rows
        T, M = T.swapaxes(1, 2), M[:, [1, 0, 2]]
    u = M[0, 2] + M[0, 0] * np.arange(T.shape[2])
    v = M[1, 2] + M[1, 1] * np.arange(T.shape[1])
    if M[0, 0] < 0:
        T, u = T[:, :, ::-1], u[::-1]
    if M[1, 1] < 0:
        T, v = T[:, ::-1], v[::-1]
    return RectifiedFrames(T, u, v)


def crop_frames(placed: RectifiedFrames, crop) -> RectifiedFrames:
    """Only pixels with centres in `crop` (u0, u1, v0, v1), m."""
    keep_u = (placed.u >= crop[0] - 1e-9) & (placed.u <= crop[1] + 1e-9)
    keep_v = (placed.v >= crop[2] - 1e-9) & (placed.v <= crop[3] + 1e-9)
    if not keep_u.any() or not keep_v.any():
        extent = ", ".join(f"{1e3 * x:.4g}" for x in (placed.u[0], placed.u[-1], placed.v[0], placed.v[-1]))
        raise BadInput(f"crop: no pixel lies in it; the image spans (u0, u1, v0, v1) {extent} mm: choose within that")
    return RectifiedFrames(placed.temperature[:, keep_v][:, :, keep_u], placed.u[keep_u], placed.v[keep_v], placed.note)


def _rectify_perspective(T: np.ndarray, M: np.ndarray, crop, pitch, band: PlanckCalibration) -> RectifiedFrames:
    rows, columns = T.shape[1:]
    back = np.linalg.inv(M)
    corners = np.array([[0, 0], [columns - 1, 0], [0, rows - 1], [columns - 1, rows - 1]], float)
    if pitch is None:  # the size of the pixel in the middle
        middle = apply_homography(M, np.array([[0, 0], [1, 0], [0, 1]]) + np.array([columns, rows]) / 2)
        pitch = (float(np.sqrt(abs(np.linalg.det(middle[1:] - middle[0])))),) * 2
    if crop is None:
        extent = apply_homography(M, corners)
        if np.any(np.isnan(extent)):
            raise BadInput("crop: the image reaches the horizon of its perspective; give --crop u0 u1 v0 v1 in mm")
        crop = (*np.sort(extent[:, 0])[[0, -1]], *np.sort(extent[:, 1])[[0, -1]])
    nu, nv = (int((b - a) / p + 1e-6) + 1 for a, b, p in zip(crop[::2], crop[1::2], pitch, strict=True))
    if not 0 < nu * nv <= MAX_PIXEL_GROWTH * rows * columns:
        raise BadInput(
            f"crop: {nu} x {nv} pixels from an image of {columns} x {rows}; give a smaller --crop or a larger"
            " --mm-per-pixel"
        )
    u, v = crop[0] + pitch[0] * np.arange(nu), crop[2] + pitch[1] * np.arange(nv)
    grid = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    wanted = apply_homography(back, grid).reshape(nv, nu, 2)
    out = np.stack([_interpolate_image(image, wanted, band) for image in T])
    return RectifiedFrames(out, u, v, f"interpolated to {1e3 * pitch[0]:.4g} x {1e3 * pitch[1]:.4g} mm")


def _interpolate_image(image: np.ndarray, wanted: np.ndarray, band: PlanckCalibration) -> np.ndarray:
    """An image at pixels `wanted` (nv, nu, 2), cubic in radiance; NaN outside and next to dead pixels."""
    from scipy.ndimage import map_coordinates

    where = np.nan_to_num(wanted[..., ::-1].transpose(2, 0, 1), nan=-10.0)
    last = np.array(image.shape)[:, None, None] - 1
    lost = np.any((where < -1e-6) | (where > last + 1e-6), axis=0)
    dead = np.isnan(image)
    if dead.any():
        lost |= map_coordinates(dead.astype(float), where, order=1, mode="nearest") > 0.01
    # odd reflection continues gradients beyond the rim
    light = np.pad(band.counts(fill_gaps(image)), CUBIC_MARGIN_PX, mode="reflect", reflect_type="odd")
    light = map_coordinates(light, where + CUBIC_MARGIN_PX, order=3, mode="nearest")
    return np.where(lost, np.nan, band.temperature(light))


def fill_gaps(image: np.ndarray) -> np.ndarray:
    """The image with every NaN replaced by its nearest known pixel."""
    from scipy.ndimage import distance_transform_edt

    if not np.isnan(image).any():
        return image
    at = distance_transform_edt(np.isnan(image), return_distances=False, return_indices=True)
    return image[tuple(at)]
