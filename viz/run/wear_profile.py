"""The worn face of the block before and after, as a laser profile, and the contact pressure."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from flashtemp.viz import theme
from flashtemp.viz.time_axis import sliding_ends

PICTURE = "worn"
MAX_WEAR_CURVES = 4  # repetitions
MIN_PRESSURE_CHANGE = 1e-3  # smaller changes of p(x)/mean(p) do not count
WORN_COLOUR, RUBBER_COLOUR = "#F7DDD6", "#EDEDED"
BEFORE_STYLE = {"color": "black", "ls": (0, (4, 2)), "lw": 1.1}


def applies(run) -> bool:
    """Whether the block was worn, or the shape of its pressure changed."""
    p = run.pressure[run.sliding & run.pressure.any(axis=1)]
    shape = p / (p @ run.mesh.dx_block / run.mesh.dx_block.sum())[:, None]
    return bool((run.worn[-1] > run.worn[0]).any() or (len(p) and np.ptp(shape, axis=0).max() > MIN_PRESSURE_CHANGE))


@theme.styled
def draw(run) -> Figure:
    """Height of the face -w(x) (um) and nominal contact pressure p(x) (MPa) over x (mm).

    Black, dashed: before, and at the start of sliding.  Coloured as in the friction picture: at the ends of at most
    MAX_WEAR_CURVES repetitions.
    """
    fig = theme.make_figure("Wear and contact pressure", run.title, theme.NARROW_FIGURE_IN, 5.2)
    fig.get_layout_engine().set(hspace=0.05)
    face, press = fig.subplots(2, 1, sharex=True, height_ratios=[1.2, 1.0])
    last = sliding_ends(run)
    shown, colours = theme.spread_indices(len(last), MAX_WEAR_CURVES), theme.repetition_colours(len(last))
    curves = [(k, {"color": c}) for k, c in zip(last[shown], colours[shown], strict=True)]
    _draw_face(face, run, curves)
    _draw_pressure(press, run, curves)
    handles = [*press.get_legend_handles_labels()[0], *face.get_legend_handles_labels()[0]]
    words = [f"{run.repetition[k]}" for k, _ in curves]
    words = ["before", f"after repetition {words[0]}", *words[1:], "worn off"]
    fig.legend(handles, words, loc="outside lower left", ncols=len(words), columnspacing=1.1, handlelength=1.6)
    return fig


def _draw_face(ax, run, curves) -> None:
    """The face as in a scan: rubber below, worn-off volume shaded."""
    x, before, after = 1e3 * run.x, -1e6 * run.worn[0], -1e6 * run.worn[curves[-1][0]]
    low, high = theme.padded_limits(before, after, least=1.0, margin=0.12)
    ax.fill_between(x, after, before, color=WORN_COLOUR, lw=0, label="worn off")
    ax.fill_between(x, low, after, color=RUBBER_COLOUR, lw=0)
    ax.plot(x, before, **BEFORE_STYLE)
    for k, style in curves:
        ax.plot(x, -1e6 * run.worn[k], **style)
    mean, largest = run.at_mean(run.worn[-1] - run.worn[0]), (run.worn[-1] - run.worn[0]).max()
    ax.set(xlim=(0.0, 1e3 * run.mesh.x[run.mesh.last]), ylim=(low, high), ylabel="height of the block's face (µm)")
    ax.text(0.985, 0.02, "rubber", transform=ax.transAxes, ha="right", va="bottom", color=theme.AMBIENT_COLOUR)
    mean, largest, volume = (theme.format_decimal(v, 3) for v in (1e6 * mean, 1e6 * largest, 1e9 * run.worn_volume))
    ax.set_title(f"worn off: {mean} µm on average, {largest} µm at most, {volume} mm³")


def _draw_pressure(ax, run, curves) -> None:
    """Nominal contact pressure at the first loaded record of sliding, and at the ends of the repetitions."""
    start = int(np.argmax(run.sliding & run.pressure.any(axis=1)))
    for k, style in [(start, BEFORE_STYLE), *curves]:
        ax.plot(1e3 * run.x, 1e-6 * run.pressure[k], **style, label=f"{k}")
    top = 1.06e-6 * max(run.pressure[k].max() for k in (start, *(k for k, _ in curves)))
    ax.set(ylim=(0.0, max(top, 1e-6)), ylabel="contact pressure, nominal (MPa)", xlabel=theme.x_axis_label(run))
