"""T(x) at the end of the last repetition: in the contact regions and averaged across y."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from flashtemp.viz import theme
from flashtemp.viz.time_axis import sliding_ends

PICTURE = "profile"
MAX_EARLIER_CURVES = 4  # faint curves


@theme.styled
def draw(run, road: bool | None = None, bands=None) -> Figure:
    """Temperature (degC) against distance from the leading edge (mm) at the end of the last repetition.

    Red: in the macroasperity contact regions; green: averaged across y; faint: ends of earlier repetitions.
    `road`: whether to draw the road in the heated tracks, by default where it differs from the spots.
    `bands` {"T_spot", "T_block": 95 % band over (time, x)}: shaded.
    """
    fig = theme.make_figure("Surface temperature along the block", run.title, theme.NARROW_FIGURE_IN, 4.0)
    ax = fig.add_subplot()
    x, k = 1e3 * run.x, run.last_sliding_index
    earlier = sliding_ends(run)[:-1]
    earlier = earlier[theme.spread_indices(len(earlier), MAX_EARLIER_CURVES)]
    for i in earlier:
        ax.plot(x, run.T_spot[i], color=theme.SPOT_COLOUR, lw=0.6, alpha=0.35)
        ax.plot(x, run.T_block[i], color=theme.BLOCK_COLOUR, lw=0.6, alpha=0.45)
    ax.plot(x, run.T_spot[k], color=theme.SPOT_COLOUR, label="temperature in the macroasperity contact regions")
    ax.plot(x, run.T_block[k], color=theme.BLOCK_COLOUR, label="averaged across y")
    shown = [run.T_spot[[*earlier, k]], run.T_block[[*earlier, k]], run.ambient_degC]
    if road or (road is None and _road_differs(run, k)):
        ax.plot(x, run.T_road[k], color=theme.ROAD_COLOUR, lw=0.8, ls="--", label="road in the heated tracks")
        shown.append(run.T_road[k])
    for name, colour in (("T_spot", theme.SPOT_COLOUR), ("T_block", theme.BLOCK_COLOUR)) if bands else ():
        band = bands[name]
        ax.fill_between(x, band.low[k], band.high[k], color=colour, alpha=0.18, lw=0, label="95 % band")
        shown += [band.low[k], band.high[k]]
    if len(earlier):
        ax.plot([], [], color=theme.AMBIENT_COLOUR, lw=0.6, alpha=0.6, label=_earlier_label(run, earlier))
    ambient = f"ambient, {theme.format_decimal(run.ambient_degC)} {theme.CELSIUS}"
    ax.axhline(run.ambient_degC, color=theme.AMBIENT_COLOUR, lw=0.8, ls=":", label=ambient)
    ax.set(xlim=(0.0, 1e3 * _block_length(run)), ylim=theme.padded_limits(*shown, least=1.0))
    edge = "leading edge" if run.direction is None else "edge that leads when sliding forward"
    ax.set(xlabel=f"distance from the {edge}, x (mm)", ylabel=f"temperature ({theme.CELSIUS})")
    fig.legend(loc="outside lower left", ncols=2)
    when = f"t = {theme.format_decimal(run.time[k])} s, slid {theme.format_decimal(run.slid[k])} m"
    ax.set_title(f"end of repetition {run.repetition[k]}: {when}", pad=20)
    _mark_edges(ax, run.leading_line_index(k) != 0)
    return fig


def _road_differs(run, k: int) -> bool:
    """Whether road and spots differ visibly in temperature, as with a finite contact conductance."""
    scale = max(1e-9, float(np.ptp(run.T_spot[k])))
    return bool(np.abs(run.T_road[k] - run.T_spot[k]).max() > 0.005 * scale)


def _block_length(run) -> float:
    """Length of the block, m."""
    return float(run.mesh.x[run.mesh.last])


def _earlier_label(run, earlier: np.ndarray) -> str:
    numbers = [str(r) for r in run.repetition[earlier]]
    return f"end{'s' if len(numbers) > 1 else ''} of repetition {', '.join(numbers)}"


def _mark_edges(ax, back: bool) -> None:
    """Label the edges above the axes, with an arrow in the direction of sliding."""
    names, arrow = ("leading edge", "trailing edge"), {"xy": (0.33, 1.045), "xytext": (0.455, 1.045)}
    if back:
        names, arrow = names[::-1], {"xy": (0.455, 1.045), "xytext": (0.33, 1.045)}
    ax.text(0.0, 1.02, names[0], transform=ax.transAxes, ha="left", va="bottom")
    ax.text(1.0, 1.02, names[1], transform=ax.transAxes, ha="right", va="bottom")
    ax.text(0.47, 1.02, "the block slides this way", transform=ax.transAxes, ha="left", va="bottom")
    ax.annotate(
        "", **arrow, xycoords="axes fraction",
        arrowprops={"arrowstyle": "-|>", "lw": 0.8, "color": "black", "shrinkA": 0, "shrinkB": 0},
    )  # fmt: skip
