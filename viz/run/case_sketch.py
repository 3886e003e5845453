"""Sketch of a case before it runs: the block on the road to scale, speed and pressure over one repetition."""

from __future__ import annotations

from io import StringIO

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from flashtemp.viz import theme


def sketch_svg(case) -> str:
    """The sketch of a case as an SVG element."""
    out = StringIO()
    draw(case).savefig(out, format="svg")
    text = out.getvalue()
    return text[text.index("<svg") :]


@theme.styled
def draw(case) -> Figure:
    """Block and road in mm, and below speed (m/s) and nominal contact pressure (kPa) over time (s)."""
    scene, schedule = case.scene, case.scene.schedule
    fig = Figure(figsize=(theme.WIDE_FIGURE_IN, 4.4), layout="constrained", facecolor="white")
    above, below = fig.subplots(2, 1, height_ratios=[1.0, 1.0])
    _draw_block(above, scene)
    t = np.linspace(0.0, schedule.slide_time, 200)
    below.plot(t, [schedule.speed(s) for s in t], color=theme.BLOCK_COLOUR)
    below.set(ylabel="speed (m/s)", xlabel=f"time in a repetition (s); {_describe_times(schedule)}")
    below.set_ylim(bottom=0.0)
    other = below.twinx()
    other.plot(t, [1e-3 * schedule.pressure(s) for s in t], color=theme.AMBIENT_COLOUR, ls="--")
    other.set_ylabel("pressure (kPa, dashed)")
    other.set_ylim(bottom=0.0)
    return fig


def _draw_block(ax, scene) -> None:
    length, height = 1e3 * scene.length, 1e3 * scene.height
    ax.add_patch(Rectangle((0.0, 0.0), length, height, fc="#D9D9D9", ec="#2B2B2B"))
    ends = np.cumsum([1e3 * layer.thickness for layer in scene.layers])
    for layer, end in zip(scene.layers, ends, strict=True):
        ax.plot([0.0, length], [end, end], color="#2B2B2B", lw=0.8)
        ax.annotate(layer.name, (0.98 * length, end), va="top", ha="right", fontsize=8)
    ax.axhspan(-0.35 * height, 0.0, color="#BCAAA4", lw=0)
    back, ways = scene.schedule.heading < 0, len(scene.schedule.directions)
    words = ["leading edge", "trailing edge"] if ways == 1 else ["leads forward", "leads back"]
    for x, word in zip((0.0, length), words[::-1] if back and ways == 1 else words, strict=True):
        ax.annotate(word, (x, 0.0), (x, height * 1.12), ha="center", fontsize=8)
    style = "<->" if ways > 1 else "<-" if back else "->"
    ax.annotate("", (0.25 * length, height / 2), (0.55 * length, height / 2), arrowprops={"arrowstyle": style})
    ax.annotate("slides", (0.58 * length, height / 2), va="center", fontsize=8)
    ax.set_xlim(-0.25 * length, 1.25 * length)
    ax.set_ylim(-0.35 * height, 1.4 * height)
    ax.set_aspect("equal")
    ax.set(xlabel="x (mm)", ylabel="z (mm)")


def _describe_times(schedule) -> str:
    wait = f", {theme.format_decimal(schedule.wait)} s of waiting between" if schedule.wait else ""
    many = schedule.repetitions
    return f"{many} repetition{'s' if many > 1 else ''}{wait if many > 1 else ''}"
