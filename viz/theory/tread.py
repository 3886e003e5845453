"""A tread block that passes the footprint: friction from the cold to the hot branch."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from flashtemp.physics.quantities import KELVIN
from flashtemp.viz import theme

COLD_COLOUR, HOT_COLOUR = theme.PLACE_COLOURS["leading edge"], theme.SPOT_COLOUR
MIN_SPEED_DRAWN_M_S = 2e-3  # the branches are drawn from here


@theme.styled
def draw(rolling, title: str) -> Figure:
    """Friction over sliding speed (m/s), over slid distance (spot diameters), and of the footprint over slip.

    `rolling` is a RollingResult.  Thick: kernel theory; thin and dark: cold-hot law.
    """
    fig = theme.make_figure("Friction coefficient of the tread block", title, theme.WIDE_FIGURE_IN, 5.6)
    fig.get_layout_engine().set(wspace=0.05, hspace=0.06)
    grid = fig.add_gridspec(2, 2, height_ratios=[1.35, 1.0])
    colours = theme.repetition_colours(len(rolling.slips))
    _draw_speeds(fig.add_subplot(grid[0, :]), rolling, colours)
    _draw_distances(fig.add_subplot(grid[1, 0]), rolling, colours)
    _draw_slips(fig.add_subplot(grid[1, 1]), rolling, colours)
    return fig


def _is_moving(path, j):
    """Mask of the times at which a block slides fast enough to be drawn."""
    return path.speed[:, j] > MIN_SPEED_DRAWN_M_S


def _draw_speeds(ax, rolling, colours) -> None:
    """Paths of the blocks between the two stationary branches."""
    fastest = max(10.0 * MIN_SPEED_DRAWN_M_S, 1.35 * max(float(p.speed.max()) for p, _ in rolling.kernel))
    v = np.geomspace(MIN_SPEED_DRAWN_M_S, fastest, 300)
    cold, hot = rolling.law.branch_friction(v)
    ax.fill_between(v, hot, cold, color=theme.WAITING_COLOUR, alpha=0.45, lw=0)
    ax.plot(v, cold, color=COLD_COLOUR, lw=1.6)
    ax.plot(v, hot, color=HOT_COLOUR, lw=1.6)
    for name, end, colour in (("cold", cold[-1], COLD_COLOUR), ("hot", hot[-1], HOT_COLOUR)):
        ax.annotate(name, (v[-1], end), (4, 0), textcoords="offset points", color=colour, va="center")
    for j, ((path, _), colour, slip) in enumerate(zip(rolling.kernel, colours, rolling.slips, strict=True)):
        on, thin = _is_moving(path, 0), _is_moving(rolling.path, j)
        ax.plot(path.speed[on, 0], path.mu[on, 0], color=colour, lw=2.6, label=f"{100 * slip:g} %", zorder=3)
        ax.plot(rolling.path.speed[thin, j], rolling.path.mu[thin, j], color="#222222", lw=0.6, zorder=4)
        if on.any():
            ax.plot(path.speed[-1, 0], path.mu[-1, 0], "o", color=colour, ms=5.5, mec="white", mew=0.8, zorder=5)
    ax.plot([], [], color="#222222", lw=0.6, label="cold-hot law")
    ax.set_xscale("log")
    ax.set(xlabel="sliding speed (m/s)", ylabel="friction coefficient (–)", xlim=(v[0], v[-1]))
    ax.set_title(f"{_describe_conditions(rolling)}; at the dots the block leaves the road")
    free = "lower left" if cold[0] > cold[-1] else "upper left"
    ax.legend(title="kernel theory, slip", title_fontsize=7.5, loc=free, alignment="left")


def _describe_conditions(rolling) -> str:
    t = rolling.tread
    return (
        f"{theme.format_decimal(t.speed, 3)} m/s over {theme.format_decimal(1e3 * t.footprint, 3)} mm, "
        f"{theme.format_decimal(t.pressure / 1e6, 3)} MPa, "
        f"{theme.format_decimal(rolling.T0 - KELVIN, 3)} {theme.CELSIUS}, "
        f"contact regions of {theme.format_decimal(1e3 * rolling.spots.diameter, 3)} mm"
    )


def _draw_distances(ax, rolling, colours) -> None:
    """The same friction over the slid distance since the block entered the footprint."""
    for j, ((path, _), colour) in enumerate(zip(rolling.kernel, colours, strict=True)):
        on, thin = _is_moving(path, 0), _is_moving(rolling.path, j)
        ax.plot(path.slid[on, 0] / rolling.spots.diameter, path.mu[on, 0], color=colour, lw=2.2)
        ax.plot(rolling.path.slid[thin, j] / rolling.spots.diameter, rolling.path.mu[thin, j], color="#222222", lw=0.5)
    memory = float(rolling.law.memory_distance(rolling.tread.speed * rolling.peak.at)) / rolling.spots.diameter
    ax.axvline(memory, color=theme.AMBIENT_COLOUR, lw=0.7, ls=(0, (4, 3)))
    ax.annotate(
        f"r₀ = {theme.format_decimal(memory, 2)} D", (memory, 0.04), (3, 0), xycoords=("data", "axes fraction"),
        textcoords="offset points", color=theme.AMBIENT_COLOUR,
    )  # fmt: skip
    ax.set(xlabel="slid distance / diameter D (–)", ylabel="friction coefficient (–)", title="over the slid distance")
    ax.set_xlim(left=0.0)
    ax.set_ylim(bottom=0.0)


def _draw_slips(ax, rolling, colours) -> None:
    """Mean friction over the footprint against slip."""
    from flashtemp.physics.friction import tread_block

    ax.plot(tread_block.SWEPT_SLIPS, rolling.friction, color="#222222", lw=0.9, label="cold-hot law")
    means = [tread_block.mean_traction(path)[0] for path, _ in rolling.kernel]
    ax.scatter(rolling.slips, means, c=colours, s=24, zorder=3, edgecolors="white", linewidths=0.6)
    ax.plot([], [], "o", color=theme.AMBIENT_COLOUR, ms=4.5, label="kernel theory")
    ratio = rolling.spots.diameter / rolling.tread.footprint
    ax.axvline(ratio, color=theme.AMBIENT_COLOUR, lw=0.7, ls=(0, (4, 3)))
    ax.annotate(
        "D/l", (ratio, 0.04), (3, 0), xycoords=("data", "axes fraction"), textcoords="offset points",
        color=theme.AMBIENT_COLOUR,
    )  # fmt: skip
    if not rolling.peak.is_at_edge:
        ax.plot(rolling.peak.at, rolling.peak.value, "v", color=theme.SPOT_COLOUR, ms=5, zorder=4)
        ax.annotate(
            "maximum", (rolling.peak.at, rolling.peak.value), (0, 5), textcoords="offset points", ha="center",
            color=theme.SPOT_COLOUR, fontsize=7.0,
        )  # fmt: skip
    ax.set_xscale("log")
    ax.set(xlabel="slip (–)", ylabel="mean over the footprint (–)", title="friction of the whole footprint")
    ax.set_ylim(0.0, 1.35 * max(rolling.friction.max(), max(means)))
    ax.legend(loc="upper left")
