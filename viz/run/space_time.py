"""Map of the block's surface temperature T(x, t) over all repetitions, and its time series at three places."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from flashtemp.physics.interpolation import interpolate_linear
from flashtemp.viz import theme
from flashtemp.viz.time_axis import RepetitionAxis, interval_means, repetition_axis

PICTURE = "map"
MAX_THICK_REPETITIONS = 16  # more repetitions are drawn with thinner lines
MAP_COLUMNS, MAP_ROWS = 1200, 300  # pixels of the map: finer than those at 160 dpi


@theme.styled
def draw(run) -> Figure:
    """Surface temperature averaged across y (degC) over time and distance from the leading edge (mm).

    Above the map: a strip of repetitions and waits.  Below: leading edge, middle and trailing edge over time, waits
    shaded.  Records are drawn at their true times.
    """
    axis = repetition_axis(run)
    strip = len(axis.start) > 1 or bool(axis.waits)
    fig = theme.make_figure(
        "Surface temperature of the block over time", run.title, theme.WIDE_FIGURE_IN, 4.9 if strip else 4.6
    )
    rows = fig.add_gridspec(3 if strip else 2, 1, height_ratios=[0.09, 1.35, 1.0][0 if strip else 1 :])
    lines = fig.add_subplot(rows[-1])
    map_axes = fig.add_subplot(rows[-2])
    _draw_lines(lines, run, axis)
    _draw_map(fig, map_axes, run, axis)
    if strip:
        _draw_strip(fig.add_subplot(rows[0]), axis)
    return fig


def _draw_map(fig, ax, run, axis: RepetitionAxis) -> None:
    """The map: means over the time of each column, linear between records and between places."""
    time = axis.column_edges(MAP_COLUMNS)
    x = np.linspace(0.0, run.mesh.x[run.mesh.last], MAP_ROWS + 1)
    values = interval_means(run.T_block, run.time, time)
    values = interpolate_linear(values.T, run.x, 0.5 * (x[1:] + x[:-1]))
    image = ax.pcolormesh(
        axis.to_axis_unit(time), 1e3 * x, values, rasterized=True,
        cmap=theme.temperature_map(), norm=theme.temperature_norm(run.T_block),
    )  # fmt: skip
    axis.set_axis(ax)
    ax.set(xlabel="", ylim=(0.0, 1e3 * x[-1]), ylabel=theme.x_axis_label(run))
    ax.tick_params(labelbottom=False)
    theme.add_colour_bar(fig, image, ax, f"mean across y ({theme.CELSIUS})", pad=0.01, aspect=14)


def _draw_lines(ax, run, axis: RepetitionAxis) -> None:
    """Block surface at leading edge, middle and trailing edge."""
    axis.shade_waits(ax)
    many = len(axis.start) > MAX_THICK_REPETITIONS
    columns = (0, int(np.argmin(abs(run.x - 0.5 * (run.x[0] + run.x[-1])))), len(run.x) - 1)
    time, records = run.time, run.T_block
    names = theme.PLACE_COLOURS if run.direction is None else ("x = 0", "middle", "x = L")
    for name, colour, i in zip(names, theme.PLACE_COLOURS.values(), columns, strict=True):
        ax.plot(axis.to_axis_unit(time), records[:, i], color=colour, lw=0.5 if many else 1.1, label=name)
    ax.axhline(run.ambient_degC, color=theme.AMBIENT_COLOUR, lw=0.8, ls=":", label="ambient")
    ax.set_ylim(*theme.padded_limits(run.T_block[:, columns], run.ambient_degC, least=1.0))
    ax.set_ylabel(f"block surface ({theme.CELSIUS})")
    ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, borderaxespad=0.1)
    axis.set_axis(ax)


def _draw_strip(ax, axis: RepetitionAxis) -> None:
    """Sliding dark, waits pale; as many repetitions numbered as there is space for."""
    begin, end = axis.to_axis_unit(axis.start), axis.to_axis_unit(axis.end)
    ax.bar(begin, 1.0, end - begin, align="edge", color=theme.SLIDING_COLOUR, edgecolor="white", lw=0.4)
    for a, b in axis.waits:
        ax.axvspan(*axis.to_axis_unit([a, b]), facecolor=theme.WAITING_COLOUR, edgecolor="white", lw=0.4)
    axis.set_axis(ax)
    numbered = _numbered_repetitions(len(begin))
    ax.set_xticks(0.5 * (begin + end)[numbered], [str(r) for r in axis.repetition[numbered]])
    ax.set(xlabel="", ylim=(0.0, 1.0), yticks=[])
    ax.tick_params(top=True, labeltop=True, bottom=False, labelbottom=False, length=0, pad=1)
    ax.set_title("sliding (dark, numbered by repetition)" + (" and waits (pale)" if axis.waits else ""))
    ax.spines[:].set_visible(False)


def _numbered_repetitions(count: int) -> np.ndarray:
    """Indices of the numbered repetitions: all, or every 2nd, 5th, 10th ..., at most 25."""
    step = next(s * 10**p for p in range(9) for s in (1, 2, 5) if count <= 25 * s * 10**p)
    return np.arange(count) if step == 1 else np.arange(step - 1, count, step)
