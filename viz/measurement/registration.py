"""Registration of a recording: the middle frame with the outline of the block."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from flashtemp.viz import theme

OUTLINE_COLOUR, ORIGIN_COLOUR = "#56B4E9", "white"


@theme.styled
def draw(recording, block=None) -> Figure:
    """The middle frame (mm) with the expected outline of the `block` (length, height in m), if given.

    Side wall: the block's face, with the leading edge at u = 0 and the interface at v = 0.  Wake: the trailing edge.
    """
    u, v = 1e3 * recording.u, 1e3 * recording.v
    du, dv = (1e3 * p for p in recording.pitch)
    edges = (u[0] - du / 2, u[-1] + du / 2, v[0] - dv / 2, v[-1] + dv / 2)
    image = recording.temperature[recording.frames // 2]
    tall = np.clip((edges[3] - edges[2]) / (edges[1] - edges[0]), 0.15, 1.2)
    height = 1.1 + 0.85 * theme.WIDE_FIGURE_IN * tall
    fig = theme.make_figure(
        "Position of the block in the image", recording.source or "the recording", theme.WIDE_FIGURE_IN, height
    )
    ax = fig.subplots()
    shown = ax.imshow(
        image,
        origin="lower",
        extent=edges,
        cmap=theme.temperature_map(),
        norm=theme.temperature_norm(image),
        interpolation="nearest",
    )
    ax.set_facecolor("#D0D0D0")  # dead pixels
    label = f"temperature ({theme.CELSIUS})"
    theme.add_colour_bar(fig, shown, None, label, cax=ax.inset_axes((1.02, 0, 0.025, 1)))
    _draw_outline(ax, recording.view, block)
    low, high = (edges[0], edges[2]), (edges[1], edges[3])
    if block is not None and recording.view == "sidewall":
        low = min(low[0], -1.0), min(low[1], -0.5)
        high = max(high[0], 1e3 * block[0] + 1.0), high[1]
    ax.set_xlim(low[0], high[0])
    ax.set_ylim(low[1], high[1])
    ax.set_xlabel("u = x from the leading edge (mm)")
    ax.set_ylabel(
        {"sidewall": "v = z above the interface (mm)", "wake": "v = y from the centre line (mm)"}[recording.view]
    )
    return fig


def _draw_outline(ax, view: str, block) -> None:
    """The block's face and the interface (sidewall) or its trailing edge and the centre line (wake)."""
    if view == "sidewall":
        ax.axhline(0.0, color=OUTLINE_COLOUR, lw=0.8, ls="--")
        ax.plot(0.0, 0.0, "+", color=ORIGIN_COLOUR, ms=12, mew=1.5, clip_on=False)
        if block is not None:
            length, height = (1e3 * x for x in block)
            ax.add_patch(Rectangle((0, 0), length, height, fill=False, ec=OUTLINE_COLOUR, lw=1.6))
        return
    ax.axhline(0.0, color=OUTLINE_COLOUR, lw=0.8, ls="--")
    if block is not None:
        ax.axvline(1e3 * block[0], color=OUTLINE_COLOUR, lw=1.6)
