"""Friction over speed and temperature by theory: branches, map, contact, and where the heat goes."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from flashtemp.physics.friction.curve_peak import highest
from flashtemp.physics.friction.friction_curves import held
from flashtemp.physics.quantities import KELVIN
from flashtemp.viz import theme

COLD, HOT = theme.PLACES["leading edge"], theme.SPOT
BRANCHES = {"cold": (COLD, "without flash temperature"), "hot": (HOT, "with flash temperature")}
WIDTH = {"cold": 3.2, "hot": 1.6}  # so that both are seen where they are one curve
FALLS = (0, (2.5, 1.5))
MU = "friction coefficient (–)"
SPEED = "sliding speed (m/s)"
JUMP = 1.0  # decades of speed by which a ridge may move between two temperatures


@theme.styled
def draw(found, title: str) -> Figure:
    """mu over speed (m/s) of both branches, mu over speed and temperature, contact, and depth of the heat.

    `found` is friction.curves.Curves.  Dashed is what a tester that sets the force cannot hold.
    """
    fig = theme.figure(title, theme.WIDE, 5.8)
    fig.get_layout_engine().set(wspace=0.06, hspace=0.07)
    grid = fig.add_gridspec(2, 2, height_ratios=[1.3, 1.0], width_ratios=[1.15, 1.0])
    _branches(fig.add_subplot(grid[0, 0]), found)
    _map(fig.add_subplot(grid[0, 1]), found)
    _contact(fig.add_subplot(grid[1, 0]), found)
    _depths(fig.add_subplot(grid[1, 1]), found)
    fig.supxlabel(_conditions(found), x=0.01, ha="left", fontsize=7.0)
    return fig


def _conditions(found) -> str:
    conditions = (
        f"{_degrees(found)}, {theme.number(found.p / 1e6, 3)} MPa, contact regions of "
        f"{theme.number(1e3 * found.spots.diameter, 3)} mm.  Map, contact and depths without flash temperature."
    )
    tops = {BRANCHES[name][1]: highest(b.speed, b.mu) for name, b in found.branches.items()}
    said = [f"{w} {theme.number(t.value, 3)} at {theme.number(t.at, 2)} m/s" for w, t in tops.items() if not t.edge]
    return conditions + (f"\nHighest friction: {', '.join(said)}." if said else "")


def _degrees(found) -> str:
    return f"{theme.number(found.T0 - KELVIN, 3)} {theme.DEGREE}"


def _speeds(ax, found) -> None:
    ax.set_xscale("log")
    ax.set(xlabel=SPEED, xlim=(found.speed[0], found.speed[-1]))


def _branches(ax, found) -> None:
    """Total friction thick, its viscoelastic part thin; what falls is dashed."""
    for name, (colour, _) in BRANCHES.items():
        b = found.branches[name]
        ax.plot(b.speed, b.viscous, color=colour, lw=0.9, alpha=0.75, zorder=2)
        ax.plot(b.speed, _part(b.mu, True), color=colour, lw=WIDTH[name], zorder=3, solid_capstyle="round")
        ax.plot(b.speed, _part(b.mu, False), color=colour, lw=1.2, ls=FALLS, zorder=3)
        if not (top := highest(b.speed, b.mu)).edge:
            ax.plot(top.at, top.value, "o", color=colour, mec="white", mew=0.7, ms=5.5, zorder=4)
    _speeds(ax, found)
    ax.set(ylabel=MU, title="friction against speed")
    ax.set_ylim(0.0, 1.36 * max(found.cold.mu.max(), found.hot.mu.max()))
    ax.legend(handles=_key(found), loc="upper left", ncols=2, columnspacing=1.2, handlelength=2.2)


def _part(mu: np.ndarray, rising: bool) -> np.ndarray:
    """mu where it can be held, or where it cannot, with the point at which that begins."""
    on = held(mu)
    if not rising:
        on = ~on | np.append(~on[1:], False)
    return np.where(on, mu, np.nan)


def _key(found) -> list:
    lines = [Line2D([], [], color=c, lw=WIDTH[name], label=words) for name, (c, words) in BRANCHES.items()]
    lines.append(Line2D([], [], color=theme.SLIDING, lw=0.9, label="viscoelastic part"))
    if not all(held(b.mu).all() for b in found.branches.values()):
        lines.append(Line2D([], [], color=theme.SLIDING, lw=1.2, ls=FALLS, label="no slope tester holds it"))
    return lines


def _map(ax, found) -> None:
    """mu over speed and temperature with the speed of its maximum."""
    image = ax.pcolormesh(
        found.speed, found.T - KELVIN, found.mu.T, cmap=theme.REPETITIONS, shading="gouraud", rasterized=True
    )
    ax.contour(found.speed, found.T - KELVIN, found.mu.T, levels=8, colors="white", linewidths=0.4, alpha=0.5)
    ridge = _ridge(found)
    if np.isfinite(ridge[0]).any():
        ax.plot(*ridge, color="white", lw=3.0, solid_capstyle="round")
        ax.plot(*ridge, color=HOT, lw=1.6, solid_capstyle="round", label="maximum")
    ax.axhline(found.T0 - KELVIN, color="white", lw=0.9, ls=FALLS, label=_degrees(found))
    ax.legend(
        loc="upper left", labelcolor="white", frameon=True, facecolor="#2A2A2A", framealpha=0.45, edgecolor="none"
    )
    _speeds(ax, found)
    ax.set(ylabel=f"temperature ({theme.DEGREE})", title="friction against speed and temperature")
    ax.set_ylim(found.T[0] - KELVIN, found.T[-1] - KELVIN)
    bar = ax.figure.colorbar(image, ax=ax, label=MU, pad=0.02, aspect=25)
    bar.outline.set_linewidth(0.4)


def _ridge(found) -> tuple[np.ndarray, np.ndarray]:
    """Speed and temperature (degC) of the maximum, broken where it leaps from one hump to another."""
    v, T = found.ridge(), found.T - KELVIN
    leaps = np.flatnonzero(np.abs(np.diff(np.log10(v))) > JUMP) + 1
    return np.insert(v, leaps, np.nan), np.insert(T, leaps, np.nan)


def _contact(ax, found) -> None:
    """Share of the nominal area in contact: in contact regions, and within them down to the shortest wave."""
    size = theme.number(1e3 * found.spots.diameter, 3)
    for values, colour, words, end, gap in (
        (found.phi, theme.BLOCK, f"in contact regions of {size} mm", 0, 5),
        (found.area, theme.SLIDING, "real contact A/A₀", -1, -6),
    ):  # both fall with speed: above the first and below the last of their points is room for words
        ax.plot(found.speed, values, color=colour, lw=1.8)
        ax.annotate(
            words, (found.speed[end], values[end]), (-6 if end else 6, gap), textcoords="offset points", color=colour,
            fontsize=7.5, ha="right" if end else "left", va="top" if end else "bottom",
        )  # fmt: skip
    ax.set_yscale("log")
    _speeds(ax, found)
    ax.set(ylabel="share of the nominal area (–)", title="contact")
    ax.set_ylim(0.15 * min(found.area.min(), found.phi.min()), 3.0)


def _depths(ax, found) -> None:
    """Share of the viscoelastic heat that is released deeper than a depth 1/(2q)."""
    d = found.depths
    for v, row, colour in zip(d.speed, d.deeper, theme.repetitions(len(d.speed)), strict=True):
        ax.plot(1e6 * d.depth, 100 * row, color=colour, lw=1.8, label=f"{theme.number(v, 2)} m/s")
        ax.plot(1e6 * d.at(v)[1], 50, "o", color=colour, ms=4.5, mec="white", mew=0.6)
    ax.set_xscale("log")
    ax.set(
        xlabel="depth (µm)",
        ylabel="released deeper (%)",
        ylim=(0, 100),
        title="depth of the viscoelastic heat, dots: half",
    )
    ax.set_xlim(1e6 * d.depth[-1], 1e6 * d.depth[0])
    ax.legend(loc="upper right")
