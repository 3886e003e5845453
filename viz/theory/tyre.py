"""Side force of a tyre over slip angle at several loads, its maxima, and controls without heat memory."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from flashtemp.physics.quantities import KELVIN
from flashtemp.viz import theme

MIN_CHANGE_PERCENT = 1.0  # smallest half-range of the axis of changes
CONTROL_COLOURS = {"cold": "#8A8A8A", "hot": "#B9B9B9"}
CONTROL_DASHES = {"cold": (0, (4, 2)), "hot": (0, (1, 1.5))}
MODEL_LABELS = {"rigid": "rigid bristles", "brush": "bristles that shear"}


@theme.styled
def draw(cornering, title: str) -> Figure:
    """Side force over load (1) against slip angle (deg) and its maximum against load (kN), rigid and brush.

    `cornering` is a CorneringResult.  Colours are loads; grey are the controls with two equal branches.
    """
    with_maxima = any(cornering.has_inner_peaks(m, n) for m in MODEL_LABELS for n in (*CONTROL_COLOURS, "law"))
    fig = theme.make_figure(
        "Side force of the tyre over the slip angle", title, theme.WIDE_FIGURE_IN, 5.4 if with_maxima else 3.6
    )
    fig.get_layout_engine().set(wspace=0.05, hspace=0.06)
    ratios = [1.45, 1.0] if with_maxima else [1.0]
    axes = fig.subplots(len(ratios), 2, squeeze=False, height_ratios=ratios, sharey="row")
    colours = theme.repetition_colours(len(cornering.loads))
    for column, model in enumerate(MODEL_LABELS):
        _draw_angles(axes[0, column], cornering, model, colours)
        if with_maxima:
            _draw_maxima(axes[1, column], cornering, model, colours)
    axes[0, 0].set_ylabel("side force / load (–)")
    axes[0, 0].set_ylim(0.0, 1.1 * max(values.max() for values in cornering.curves.values()))
    if with_maxima:
        axes[1, 0].set_ylabel("change of its maximum (%)")
        low, high = axes[1, 0].get_ylim()
        axes[1, 0].set_ylim(min(low, -MIN_CHANGE_PERCENT), max(high, MIN_CHANGE_PERCENT))
    for ax, handles in zip(axes[0], _legend_handles(cornering, colours), strict=True):
        ax.legend(handles=handles, loc="upper left")
    none = "" if with_maxima else f"  No side force has a maximum up to {_last_angle(cornering)} deg."
    theme.add_caption(fig, _describe_conditions(cornering) + none)
    return fig


def _last_angle(cornering) -> str:
    return theme.format_decimal(cornering.angles[-1], 3)


def _describe_conditions(cornering) -> str:
    b = cornering.bristle
    return (
        f"{theme.format_decimal(b.speed, 3)} m/s, {theme.format_decimal(b.pressure / 1e6, 3)} MPa at every load, "
        f"{theme.format_decimal(cornering.T0 - KELVIN, 3)} {theme.CELSIUS}, "
        f"footprint {theme.format_decimal(1e3 * cornering.tyre.width, 3)} mm wide, "
        f"r₀ = {cornering.law.memory_text} mm; "
        f"shear stiffness of the tread {theme.format_decimal(b.stiffness / 1e6, 3)} MPa/m.  Carcass rigid."
    )


def _legend_handles(cornering, colours) -> tuple[list, list]:
    """Legends of colours and markers, and of dashes."""
    loads = [
        Line2D([], [], color=c, lw=1.8, label=f"{theme.format_decimal(load / 1e3)} kN")
        for c, load in zip(colours, cornering.loads, strict=True)
    ]
    ends = {_describe_peak(p) for model in MODEL_LABELS for p in cornering.peaks[model, "law"]}
    marks = [Line2D([], [], ls="", **_peak_marker(end != "maximum"), label=end) for end in sorted(ends, reverse=True)]
    controls = [
        Line2D([], [], color=CONTROL_COLOURS[c], ls=CONTROL_DASHES[c], lw=1.2, label=f"control: both branches {c}")
        for c in CONTROL_COLOURS
    ]
    return [*loads, *marks], controls


def _describe_peak(peak) -> str:
    """Whether a highest point is a maximum or at an end of the curve, in words."""
    if peak.first and peak.last:
        return "the only angle"
    return "highest, already falling" if peak.first else "highest, still rising" if peak.last else "maximum"


def _peak_marker(edge: bool) -> dict:
    """Marker of a maximum (filled), or of a highest point at an end of the curve (hollow)."""
    face = "white" if edge else theme.SPOT_COLOUR
    return {
        "marker": "v",
        "ms": 5.5,
        "mfc": face,
        "mec": theme.SPOT_COLOUR if edge else "white",
        "mew": 1.0 if edge else 0.5,
    }


def _draw_angles(ax, cornering, model: str, colours) -> None:
    for control in CONTROL_COLOURS:
        for values in cornering.curves[model, control]:
            ax.plot(
                cornering.angles, values, color=CONTROL_COLOURS[control], ls=CONTROL_DASHES[control], lw=0.9, zorder=1
            )
    for values, best, colour in zip(
        cornering.curves[model, "law"], cornering.peaks[model, "law"], colours, strict=True
    ):
        ax.plot(cornering.angles, values, color=colour, lw=1.8, zorder=3)
        ax.plot(best.at, best.value, ls="", zorder=4, clip_on=False, **_peak_marker(best.is_at_edge))
    ax.set_xscale("log")
    first, last = cornering.angles[[0, -1]] if len(cornering.angles) > 1 else cornering.angles[0] * np.array([0.5, 2.0])
    ticks = [t for t in (0.01, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 45) if first <= t <= last]
    ax.set_xticks(ticks, [theme.format_decimal(t) for t in ticks])
    ax.minorticks_off()
    ax.set(xlabel="slip angle (deg)", xlim=(first, last), title=MODEL_LABELS[model])


def _draw_maxima(ax, cornering, model: str, colours) -> None:
    """Maximum side force over load, relative to the lowest load, where it is inside the range of angles."""
    kN = cornering.loads / 1e3
    if not cornering.has_inner_peaks(model):
        words = f"no maximum up to {_last_angle(cornering)} deg" if cornering.rising_up_to_deg(model) else "no maximum"
        ax.annotate(words, (0.5, 0.5), xycoords="axes fraction", ha="center", va="center", color=theme.SPOT_COLOUR)
        if not any(cornering.has_inner_peaks(model, n) for n in (*CONTROL_COLOURS, "law")):  # nothing to draw: no axes
            ax.set_axis_off()
            return
    for name in (n for n in (*CONTROL_COLOURS, "law") if cornering.has_inner_peaks(model, n)):
        best = np.array([p.value for p in cornering.peaks[model, name]])
        change = 100 * (best / best[0] - 1)
        if name == "law":
            ax.plot(kN, change, color="#222222", lw=1.0, zorder=2)
            ax.scatter(kN, change, c=colours, s=30, zorder=3, edgecolors="white", linewidths=0.6)
            words = f"{change[-1]:+.1f} %".replace("-", "\N{MINUS SIGN}")
            ax.annotate(words, (kN[-1], change[-1]), (7, 0), textcoords="offset points", va="center")
        else:
            ax.plot(kN, change, color=CONTROL_COLOURS[name], ls=CONTROL_DASHES[name], lw=1.2, zorder=1)
    ax.axhline(0.0, color=theme.AMBIENT_COLOUR, lw=0.4, zorder=0)
    ax.margins(x=0.16, y=0.15)
    ax.set_xticks(kN, [theme.format_decimal(x) for x in kN])
    ax.set(xlabel="load (kN)")
