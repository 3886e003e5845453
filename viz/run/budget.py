"""Heat budget of a run: heat in block, holder, air and road over time, and the final fractions."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from flashtemp.viz import theme
from flashtemp.viz.time_axis import repetition_axis

PICTURE = "budget"
PART_COLOURS = {
    "block": theme.BLOCK_COLOUR,
    "holder": theme.HOLDER_COLOUR,
    "air": theme.AIR_COLOUR,
    "road": theme.ROAD_COLOUR,
}
PART_LABELS = {"block": "kept in the block", "holder": "to the holder", "air": "to the air", "road": "into the road"}


@theme.styled
def draw(run) -> Figure:
    """Heat (J) in the block and to holder, air and road over time, stacked; final fractions in %.

    The black line is the friction heat; the areas add up to it except for the printed imbalance.
    """
    fig = theme.make_figure("Heat budget over time", run.title, theme.WIDE_FIGURE_IN, 3.4)
    over, last = fig.subplots(1, 2, width_ratios=[1.6, 1.0])
    size = max(abs(v).max() for v in (*heat_parts(run).values(), run.width * run.energy["friction"]))
    unit, scale = ("kJ", 1e-3) if size > 2e3 else ("J", 1.0)
    _draw_over_time(over, run, unit, scale)
    _draw_fractions(last, run, unit, scale)
    words = f"Energy imbalance of the whole run: {run.energy_imbalance:.1e} of the heat exchanged."
    theme.add_caption(fig, words)
    return fig


def heat_parts(run) -> dict[str, np.ndarray]:
    """{part: heat (J) over time} of block, holder, air and road; positive away from the contact."""
    e, nothing = run.energy, np.zeros(len(run.time))
    parts = {"block": e["block"], "holder": -e.get("holder", nothing), "air": -e.get("air", nothing)}
    return {k: run.width * v for k, v in (parts | {"road": e["into_road"]}).items()}


def _draw_over_time(ax, run, unit: str, scale: float) -> None:
    """Stacked areas, gains above zero and losses below, with the friction heat as a line."""
    when = repetition_axis(run)
    when.shade_waits(ax)
    time = when.to_axis_unit(run.time)
    above, below = np.zeros(len(time)), np.zeros(len(time))
    for name, heat in heat_parts(run).items():
        up, down = np.maximum(scale * heat, 0.0), np.minimum(scale * heat, 0.0)
        ax.fill_between(time, above, above + up, color=PART_COLOURS[name], lw=0, label=PART_LABELS[name])
        if down.any():
            ax.fill_between(time, below, below + down, color=PART_COLOURS[name], lw=0)
        above, below = above + up, below + down
    friction = scale * run.width * run.energy["friction"]
    ax.plot(time, friction, color="black", lw=1.0, label="friction heat")
    _set_limits(ax, above, below, friction)
    ax.set_ylabel(f"heat since the start ({unit})")
    when.set_axis(ax)
    handles, labels = ax.get_legend_handles_labels()
    ax.legend(handles[::-1], labels[::-1], loc="upper left", frameon=True, edgecolor="none", framealpha=0.85)


def _set_limits(ax, above: np.ndarray, below: np.ndarray, friction: np.ndarray) -> None:
    """Limits from zero, or the lowest loss, to the maximum; 0 to 1 where there is no heat."""
    high, low = max(above.max(), friction.max()), below.min()
    lowest = 1.05 * low if low < -1e-3 * high else 0.0
    ax.set_ylim(lowest, 1.05 * high if high > 1e-9 else lowest + 1.0)


def _draw_fractions(ax, run, unit: str, scale: float) -> None:
    """Final fractions of the friction heat in %, in the order of the stack."""
    total = run.budget["friction"]
    names = list(PART_COLOURS)[::-1]
    heat = [scale * run.width * run.budget[n] + 0.0 for n in names]
    percent = np.array([100 * run.budget[n] / total if total else 0.0 for n in names])
    ax.barh(np.arange(len(names)), percent, color=[PART_COLOURS[n] for n in names], height=0.55)
    for i, (s, q) in enumerate(zip(percent, heat, strict=True)):
        joules = f"{theme.format_decimal(q, 3)} {unit}"
        words = f"{s + 0.0:.2f} %\n{joules}" if total else joules
        ax.text(max(s, 0.0) + 2.0, i, words, va="center", linespacing=1.15)
    ax.set_yticks(np.arange(len(names)), [PART_LABELS[n] for n in names])
    low, high = min(0.0, percent.min()), max(100.0, percent.max())
    ax.set_xlim(low, high + 0.3 * (high - low))
    ax.set_xticks([t for t in range(-500, 501, 50) if low <= t <= high])
    ax.spines.bottom.set_bounds(low, high)
    ax.axvline(0.0, color="black", lw=0.6)
    ax.invert_yaxis()
    ax.tick_params(axis="y", length=0)
    ax.set_xlabel("fraction of the friction heat (%)")
    ax.set_title(f"at the end, t = {theme.format_decimal(run.time[-1])} s")
