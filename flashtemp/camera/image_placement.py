"""Errors of an image's placement: scale, rotation and clock, and the points about which they act.

The scale acts about the corner at which the image of the contact begins, the rotation about the middle of the visible
wall.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flashtemp.camera.recording import Recording
from flashtemp.errors import BadInput


@dataclass(frozen=True)
class ImagePlacement:
    """Deviation of an image from its stated placement: relative `scale`, rotation `turn` (rad), late `clock` (s).

    Pixels grow about `scale_origin`.  A point that is then at x, y from `rotation_centre` is at x cos(turn) - y
    sin(turn), y cos(turn) + x sin(turn).
    """

    scale: float = 0.0
    turn: float = 0.0
    clock: float = 0.0


STATED_PLACEMENT = ImagePlacement()


def scale_origin(recording: Recording, length: float) -> float:
    """Fixed point of the scale, u (m): the leading edge, or for a wake the edge of the block that it follows."""
    if recording.view != "wake":
        return 0.0
    return length if float(np.median(recording.u)) > 0.5 * length else 0.0


def rotation_centre(recording: Recording, length: float) -> tuple[float, float]:
    """Fixed point of the rotation, u and v (m): the middle of the visible wall, so that its edges stay on the mean.

    For a wake it is the middle of the edge at which the wake begins.
    """
    if recording.view == "wake":
        return scale_origin(recording, length), 0.0
    high = recording.v[recording.v >= 0.0]
    return 0.5 * length, 0.5 * float(high.max()) if recording.view == "sidewall" and len(high) else 0.0


def check_block_in_view(recording: Recording, block: tuple[float, float] | None) -> None:
    """BadInput where the image of a side wall shows no part of the `block` (length, height in m), if that is known."""
    if block is None or recording.view != "sidewall":
        return
    for name, at, size in zip("uv", (recording.u, recording.v), block, strict=True):
        if not np.any((at >= 0.0) & (at <= size)):
            raise BadInput(
                f"pixel: the image shows {name} = {1e3 * at[0]:.4g} to {1e3 * at[-1]:.4g} mm, the block lies from 0 to "
                f"{1e3 * size:.4g} mm: no pixel is on it; give --pixel COLUMN ROW of its leading edge at the interface"
            )
