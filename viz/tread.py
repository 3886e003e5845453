"""A tread block on its way from the cold to the hot branch of friction."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from flashtemp.physics.quantities import KELVIN
from flashtemp.viz import theme

COLD, HOT = theme.PLACES["leading edge"], theme.SPOT
SLOW = 2e-3  # m/s: the branches are drawn from here


@theme.styled
def draw(found, title: str) -> Figure:
    """Friction over sliding speed (m/s), over slid distance (spot diameters), and of the footprint over slip.

    `found` is friction.tread.Rolled.  Thick: kernel theory; thin and dark: cold-hot law.
    """
    fig = theme.figure(title, theme.WIDE, 5.6)
    fig.get_layout_engine().set(wspace=0.05, hspace=0.06)
    grid = fig.add_gridspec(2, 2, height_ratios=[1.35, 1.0])
    colours = theme.repetitions(len(found.slips))
    _speeds(fig.add_subplot(grid[0, :]), found, colours)
    _distances(fig.add_subplot(grid[1, 0]), found, colours)
    _slips(fig.add_subplot(grid[1, 1]), found, colours)
    return fig


def _moving(path, j):
    """Where a block slides fast enough to be seen."""
    return path.speed[:, j] > SLOW


def _speeds(ax, found, colours) -> None:
    """Trajectories between the two stationary curves."""
    fastest = max(10.0 * SLOW, 1.35 * max(float(p.speed.max()) for p, _ in found.kernel))
    v = np.geomspace(SLOW, fastest, 300)
    cold, hot = found.law.ends(v)
    ax.fill_between(v, hot, cold, color=theme.WAITING, alpha=0.45, lw=0)
    ax.plot(v, cold, color=COLD, lw=1.6)
    ax.plot(v, hot, color=HOT, lw=1.6)
    for name, end, colour in (("cold", cold[-1], COLD), ("hot", hot[-1], HOT)):
        ax.annotate(name, (v[-1], end), (4, 0), textcoords="offset points", color=colour, va="center")
    for j, ((path, _), colour, slip) in enumerate(zip(found.kernel, colours, found.slips, strict=True)):
        on, thin = _moving(path, 0), _moving(found.path, j)
        ax.plot(path.speed[on, 0], path.mu[on, 0], color=colour, lw=2.6, label=f"{100 * slip:g} %", zorder=3)
        ax.plot(found.path.speed[thin, j], found.path.mu[thin, j], color="#222222", lw=0.6, zorder=4)
        if on.any():
            ax.plot(path.speed[-1, 0], path.mu[-1, 0], "o", color=colour, ms=5.5, mec="white", mew=0.8, zorder=5)
    ax.plot([], [], color="#222222", lw=0.6, label="cold-hot law")
    ax.set_xscale("log")
    ax.set(xlabel="sliding speed (m/s)", ylabel="friction coefficient (–)", xlim=(v[0], v[-1]))
    ax.set_title(f"{_conditions(found)}; at the dots the block leaves the road")
    free = "lower left" if cold[0] > cold[-1] else "upper left"
    ax.legend(title="kernel theory, slip", title_fontsize=7.5, loc=free, alignment="left")


def _conditions(found) -> str:
    t = found.tread
    return (
        f"{theme.number(t.speed, 3)} m/s over {theme.number(1e3 * t.footprint, 3)} mm, "
        f"{theme.number(t.pressure / 1e6, 3)} MPa, {theme.number(found.T0 - KELVIN, 3)} {theme.DEGREE}, "
        f"contact regions of {theme.number(1e3 * found.spots.diameter, 3)} mm"
    )


def _distances(ax, found, colours) -> None:
    """The same friction over the distance slid since the block came down."""
    for j, ((path, _), colour) in enumerate(zip(found.kernel, colours, strict=True)):
        on, thin = _moving(path, 0), _moving(found.path, j)
        ax.plot(path.slid[on, 0] / found.spots.diameter, path.mu[on, 0], color=colour, lw=2.2)
        ax.plot(found.path.slid[thin, j] / found.spots.diameter, found.path.mu[thin, j], color="#222222", lw=0.5)
    memory = float(found.law.reach(found.tread.speed * found.best.at)) / found.spots.diameter
    ax.axvline(memory, color=theme.AMBIENT, lw=0.7, ls=(0, (4, 3)))
    ax.annotate(
        f"r₀ = {theme.number(memory, 2)} D", (memory, 0.04), (3, 0), xycoords=("data", "axes fraction"),
        textcoords="offset points", color=theme.AMBIENT,
    )  # fmt: skip
    ax.set(xlabel="slid distance / diameter D (–)", ylabel="friction coefficient (–)", title="over the slid distance")
    ax.set_xlim(left=0.0)
    ax.set_ylim(bottom=0.0)


def _slips(ax, found, colours) -> None:
    """Mean over the footprint against slip."""
    from flashtemp.physics.friction import tread_block

    ax.plot(tread_block.SWEPT, found.friction, color="#222222", lw=0.9, label="cold-hot law")
    means = [tread_block.mean_traction(path)[0] for path, _ in found.kernel]
    ax.scatter(found.slips, means, c=colours, s=24, zorder=3, edgecolors="white", linewidths=0.6)
    ax.plot([], [], "o", color=theme.AMBIENT, ms=4.5, label="kernel theory")
    ratio = found.spots.diameter / found.tread.footprint
    ax.axvline(ratio, color=theme.AMBIENT, lw=0.7, ls=(0, (4, 3)))
    ax.annotate(
        "D/l", (ratio, 0.04), (3, 0), xycoords=("data", "axes fraction"), textcoords="offset points",
        color=theme.AMBIENT,
    )  # fmt: skip
    if not found.best.edge:
        ax.plot(found.best.at, found.best.value, "v", color=theme.SPOT, ms=5, zorder=4)
        ax.annotate(
            "maximum", (found.best.at, found.best.value), (0, 5), textcoords="offset points", ha="center",
            color=theme.SPOT, fontsize=7.0,
        )  # fmt: skip
    ax.set_xscale("log")
    ax.set(xlabel="slip (–)", ylabel="mean over the footprint (–)", title="friction of the whole footprint")
    ax.set_ylim(0.0, 1.35 * max(found.friction.max(), max(means)))
    ax.legend(loc="upper left")
