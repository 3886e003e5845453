"""An image whose scale or clock is off or that is turned: where its pixels lie.

The scale is counted from the corner where the block's contact begins to be seen, and the image turns about the middle
of what it shows of the wall.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flashtemp.camera.recording import Recording
from flashtemp.errors import BadInput


@dataclass(frozen=True)
class ImagePlacement:
    """How an image lies otherwise than told: pixels larger by a share `scale`, all of it turned by `turn` (rad); by
    `clock` (s) its frames are stamped late.

    Pixels grow from `scale_origin`; what they show then x, y from `rotation_centre` is x cos turn - y sin turn, y cos + x sin from it.
    """

    scale: float = 0.0
    turn: float = 0.0
    clock: float = 0.0


STATED_PLACEMENT = ImagePlacement()


def scale_origin(recording: Recording, length: float) -> float:
    """u (m) that the scale is counted from: the leading edge; for a wake the trailing edge that it follows."""
    if recording.view != "wake":
        return 0.0
    return length if float(np.median(recording.u)) > 0.5 * length else 0.0


def rotation_centre(recording: Recording, length: float) -> tuple[float, float]:
    """u and v (m) about which an image is turned: the middle of what it shows of the wall, so that its edges stay where
    they are on the mean; of a wake the middle of the edge that it begins at."""
    if recording.view == "wake":
        return scale_origin(recording, length), 0.0
    high = recording.v[recording.v >= 0.0]
    return 0.5 * length, 0.5 * float(high.max()) if recording.view == "sidewall" and len(high) else 0.0


def check_block_in_view(recording: Recording, block: tuple[float, float] | None) -> None:
    """BadInput where the whole image of a side wall lies beside the `block` (length, height in m), if that is known."""
    if block is None or recording.view != "sidewall":
        return
    for name, at, size in zip("uv", (recording.u, recording.v), block, strict=True):
        if not np.any((at >= 0.0) & (at <= size)):
            raise BadInput(
                f"pixel: the image shows {name} = {1e3 * at[0]:.4g} to {1e3 * at[-1]:.4g} mm, the block lies from 0 to "
                f"{1e3 * size:.4g} mm: no pixel is on it; give --pixel COLUMN ROW of its leading edge at the interface"
            )
