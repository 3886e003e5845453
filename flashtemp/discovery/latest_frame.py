"""The latest frame of a running test as plain data: measured, computed, their difference, and lines of both."""

from __future__ import annotations

from typing import Any

import numpy as np

from flashtemp.discovery.live_evidence import ComparedRecording

MAX_IMAGE_SHAPE = (60, 160)  # rows and columns of a described image; larger ones are thinned
MAX_POINTS_DESCRIBED = 5  # sensors of a recording of points
TEMPERATURE_DECIMALS, POSITION_DECIMALS = 3, 4


def describe_latest_frame(name: str, compared: ComparedRecording) -> dict[str, Any]:
    """The last frame of the recording `name`: images with the top row first (degC, K), and `lines` along x.

    The lines of an image are those of its lowest row, next to the road; of points, one for each sensor over time.
    Lengths are in mm, times in s; None stands where nothing is compared.
    """
    r = compared.entry.recording
    about: dict[str, Any] = {
        "recording": name,
        "view": r.view,
        "time_s": float(r.time[-1]),
        "repetition": int(r.repetition[-1]),
        "lines": _describe_lines(compared),
        "axis": "time (s)" if r.places is not None else "x (mm)",
    }
    if not r.is_single_row:
        about |= _describe_images(compared)
    return about


def _describe_images(compared: ComparedRecording) -> dict[str, Any]:
    """Images (rows, columns) of the compared pixels with their size, mm."""
    r, difference = compared.entry.recording, compared.residual[-1]
    measured = np.where(np.isfinite(difference), r.temperature[-1], np.nan)
    computed = np.where(np.isfinite(difference), compared.predicted[-1], np.nan)
    rows, columns = (-(-n // most) for n, most in zip(difference.shape, MAX_IMAGE_SHAPE, strict=True))
    thin = np.s_[::-rows, ::columns]
    images = {"measured": measured, "computed": computed, "difference": difference}
    size = {"length": _row_length_mm(r.u), "height": _row_length_mm(r.v)}
    return size | {key: [_round_values(row) for row in image[thin]] for key, image in images.items()}


def _row_length_mm(centres: np.ndarray) -> float:
    """Length (mm) of a row of pixels with these centres (m)."""
    return float(1e3 * (centres[-1] - centres[0]) * len(centres) / max(len(centres) - 1, 1))


def _describe_lines(compared: ComparedRecording) -> list[dict[str, Any]]:
    """Measured and computed temperatures (degC) along x (mm), or over time (s) at the sensors."""
    r = compared.entry.recording
    if r.places is not None:
        return [
            _describe_line(r.places.names[k], r.time, r.temperature[:, 0, k], compared.predicted[:, 0, k])
            for k in range(min(len(r.places), MAX_POINTS_DESCRIBED))
        ]
    known = np.flatnonzero(np.isfinite(compared.residual[-1]).any(axis=1))
    lowest = int(known[0]) if len(known) else 0
    is_known = np.isfinite(compared.residual[-1, lowest])
    both = (np.where(is_known, T[-1, lowest], np.nan) for T in (r.temperature, compared.predicted))
    return [_describe_line("", 1e3 * r.u, *both)]


def _describe_line(name: str, x: np.ndarray, measured: np.ndarray, computed: np.ndarray) -> dict[str, Any]:
    return {
        "name": name,
        "x": _round_values(x, POSITION_DECIMALS),
        "measured": _round_values(measured),
        "computed": _round_values(computed),
    }


def _round_values(values: np.ndarray, decimals: int = TEMPERATURE_DECIMALS) -> list[float | None]:
    """Values as a list, with None where one is not finite."""
    return [round(float(v), decimals) if np.isfinite(v) else None for v in values]
