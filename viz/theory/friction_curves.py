"""Friction curves of the theory: branches over speed, map over speed and temperature, contact, depth of the heat."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from flashtemp.physics.friction.curve_peak import find_peak
from flashtemp.physics.friction.friction_curves import is_steady_in_slope_tester
from flashtemp.physics.quantities import KELVIN
from flashtemp.viz import theme

COLD_COLOUR, HOT_COLOUR = theme.PLACE_COLOURS["leading edge"], theme.SPOT_COLOUR
BRANCH_STYLES = {"cold": (COLD_COLOUR, "without flash temperature"), "hot": (HOT_COLOUR, "with flash temperature")}
LINE_WIDTHS = {"cold": 3.2, "hot": 1.6}  # both branches stay visible where they coincide
FALLING_DASH = (0, (2.5, 1.5))
FRICTION_LABEL = "friction coefficient (–)"
SPEED_LABEL = "sliding speed (m/s)"
RIDGE_JUMP_DECADES = 1.0  # largest step of the ridge between two temperatures, in decades of speed


@theme.styled
def draw(curves, title: str) -> Figure:
    """mu over speed (m/s) of both branches, mu over speed and temperature, contact, and depth of the heat.

    `curves` is a FrictionCurves.  Dashed: falling friction, where a tester that sets the force is unstable.
    """
    fig = theme.make_figure("Friction coefficient of the rubber on the road", title, theme.WIDE_FIGURE_IN, 5.8)
    fig.get_layout_engine().set(wspace=0.06, hspace=0.07)
    grid = fig.add_gridspec(2, 2, height_ratios=[1.3, 1.0], width_ratios=[1.15, 1.0])
    _draw_branches(fig.add_subplot(grid[0, 0]), curves)
    _draw_map(fig.add_subplot(grid[0, 1]), curves)
    _draw_contact(fig.add_subplot(grid[1, 0]), curves)
    _draw_depths(fig.add_subplot(grid[1, 1]), curves)
    theme.add_caption(fig, _describe_conditions(curves))
    return fig


def _describe_conditions(curves) -> str:
    conditions = (
        f"{_format_temperature(curves)}, {theme.format_decimal(curves.p / 1e6, 3)} MPa, contact regions of "
        f"{theme.format_decimal(1e3 * curves.spots.diameter, 3)} mm.  "
        "Map, contact and depths without flash temperature."
    )
    peaks = {BRANCH_STYLES[name][1]: find_peak(b.speed, b.mu) for name, b in curves.branches.items()}
    maxima = [
        f"{w} {theme.format_decimal(t.value, 3)} at {theme.format_decimal(t.at, 2)} m/s"
        for w, t in peaks.items()
        if not t.is_at_edge
    ]
    return conditions + (f"\nHighest friction: {', '.join(maxima)}." if maxima else "")


def _format_temperature(curves) -> str:
    return f"{theme.format_decimal(curves.T0 - KELVIN, 3)} {theme.CELSIUS}"


def _set_speed_axis(ax, curves) -> None:
    ax.set_xscale("log")
    ax.set(xlabel=SPEED_LABEL, xlim=(curves.speed[0], curves.speed[-1]))


def _draw_branches(ax, curves) -> None:
    """Total friction thick, its viscoelastic part thin; falling parts are dashed."""
    for name, (colour, _) in BRANCH_STYLES.items():
        b = curves.branches[name]
        ax.plot(b.speed, b.viscous, color=colour, lw=0.9, alpha=0.75, zorder=2)
        ax.plot(b.speed, _stable_part(b.mu, True), color=colour, lw=LINE_WIDTHS[name], zorder=3, solid_capstyle="round")
        ax.plot(b.speed, _stable_part(b.mu, False), color=colour, lw=1.2, ls=FALLING_DASH, zorder=3)
        if not (top := find_peak(b.speed, b.mu)).is_at_edge:
            ax.plot(top.at, top.value, "o", color=colour, mec="white", mew=0.7, ms=5.5, zorder=4)
    _set_speed_axis(ax, curves)
    ax.set(ylabel=FRICTION_LABEL, title="friction against speed")
    ax.set_ylim(0.0, 1.36 * max(curves.cold.mu.max(), curves.hot.mu.max()))
    ax.legend(handles=_legend_lines(curves), loc="upper left", ncols=2, columnspacing=1.2, handlelength=2.2)


def _stable_part(mu: np.ndarray, rising: bool) -> np.ndarray:
    """mu where a slope tester is stable, or (not `rising`) where it is not, with the point where that begins."""
    on = is_steady_in_slope_tester(mu)
    if not rising:
        on = ~on | np.append(~on[1:], False)
    return np.where(on, mu, np.nan)


def _legend_lines(curves) -> list:
    lines = [Line2D([], [], color=c, lw=LINE_WIDTHS[name], label=words) for name, (c, words) in BRANCH_STYLES.items()]
    lines.append(Line2D([], [], color=theme.SLIDING_COLOUR, lw=0.9, label="viscoelastic part"))
    if not all(is_steady_in_slope_tester(b.mu).all() for b in curves.branches.values()):
        lines.append(
            Line2D([], [], color=theme.SLIDING_COLOUR, lw=1.2, ls=FALLING_DASH, label="unstable in a slope tester")
        )
    return lines


def _draw_map(ax, curves) -> None:
    """mu over speed and temperature with the speed of its maximum."""
    image = ax.pcolormesh(
        curves.speed, curves.T - KELVIN, curves.mu.T, cmap=theme.REPETITION_MAP_NAME, shading="gouraud", rasterized=True
    )
    ax.contour(curves.speed, curves.T - KELVIN, curves.mu.T, levels=8, colors="white", linewidths=0.4, alpha=0.5)
    ridge = _friction_ridge(curves)
    if np.isfinite(ridge[0]).any():
        ax.plot(*ridge, color="white", lw=3.0, solid_capstyle="round")
        ax.plot(*ridge, color=HOT_COLOUR, lw=1.6, solid_capstyle="round", label="maximum")
    ax.axhline(curves.T0 - KELVIN, color="white", lw=0.9, ls=FALLING_DASH, label=_format_temperature(curves))
    ax.legend(
        loc="upper left", labelcolor="white", frameon=True, facecolor="#2A2A2A", framealpha=0.45, edgecolor="none"
    )
    _set_speed_axis(ax, curves)
    ax.set(ylabel=f"temperature ({theme.CELSIUS})", title="friction against speed and temperature")
    ax.set_ylim(curves.T[0] - KELVIN, curves.T[-1] - KELVIN)
    theme.add_colour_bar(ax.figure, image, ax, FRICTION_LABEL, pad=0.02, aspect=25)


def _friction_ridge(curves) -> tuple[np.ndarray, np.ndarray]:
    """Speed and temperature (degC) of the maximum, broken by NaN where it jumps from one peak to another."""
    v, T = curves.peak_speeds(), curves.T - KELVIN
    jumps = np.flatnonzero(np.abs(np.diff(np.log10(v))) > RIDGE_JUMP_DECADES) + 1
    return np.insert(v, jumps, np.nan), np.insert(T, jumps, np.nan)


def _draw_contact(ax, curves) -> None:
    """Fraction of the nominal area in contact: in contact regions, and the real contact at full resolution."""
    size = theme.format_decimal(1e3 * curves.spots.diameter, 3)
    for values, colour, words, end, gap in (
        (curves.phi, theme.BLOCK_COLOUR, f"in contact regions of {size} mm", 0, 5),
        (curves.area, theme.SLIDING_COLOUR, "real contact A/A₀", -1, -6),
    ):  # both fall with speed: there is space above the first and below the last point
        ax.plot(curves.speed, values, color=colour, lw=1.8)
        ax.annotate(
            words, (curves.speed[end], values[end]), (-6 if end else 6, gap), textcoords="offset points", color=colour,
            fontsize=7.5, ha="right" if end else "left", va="top" if end else "bottom",
        )  # fmt: skip
    ax.set_yscale("log")
    _set_speed_axis(ax, curves)
    ax.set(ylabel="fraction of the nominal area (–)", title="contact")
    ax.set_ylim(0.15 * min(curves.area.min(), curves.phi.min()), 3.0)


def _draw_depths(ax, curves) -> None:
    """Fraction of the viscoelastic heat released deeper than a depth 1/(2q)."""
    d = curves.depths
    for v, row, colour in zip(d.speed, d.deeper, theme.repetition_colours(len(d.speed)), strict=True):
        ax.plot(1e6 * d.depth, 100 * row, color=colour, lw=1.8, label=f"{theme.format_decimal(v, 2)} m/s")
        ax.plot(1e6 * d.depths_at_speed(v)[1], 50, "o", color=colour, ms=4.5, mec="white", mew=0.6)
    ax.set_xscale("log")
    ax.set(
        xlabel="depth (µm)",
        ylabel="released deeper (%)",
        ylim=(0, 100),
        title="depth of the viscoelastic heat, dots: half",
    )
    ax.set_xlim(1e6 * d.depth[-1], 1e6 * d.depth[0])
    ax.legend(loc="upper right")
