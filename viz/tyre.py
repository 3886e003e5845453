"""Side force of a tyre over slip angle at several loads, its maxima, and the controls without flash temperature."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from flashtemp.physics.quantities import KELVIN
from flashtemp.viz import theme

LEAST = 1.0  # %: half the range of changes that is drawn at least
GREY = {"cold": "#8A8A8A", "hot": "#B9B9B9"}
DASH = {"cold": (0, (4, 2)), "hot": (0, (1, 1.5))}
WORDS = {"rigid": "rigid bristles", "brush": "bristles that shear"}


@theme.styled
def draw(found, title: str) -> Figure:
    """Side force over load (1) against slip angle (deg) and its maximum against load (kN), rigid and brush.

    `found` is friction.tyre.Cornering.  Colours are loads; grey are the controls with both branches alike.
    """
    fig = theme.figure(title, theme.WIDE, 5.4)
    fig.get_layout_engine().set(wspace=0.05, hspace=0.06)
    axes = fig.subplots(2, 2, height_ratios=[1.45, 1.0], sharey="row")
    colours = theme.repetitions(len(found.loads))
    for column, model in enumerate(WORDS):
        _angles(axes[0, column], found, model, colours)
        _maxima(axes[1, column], found, model, colours)
    axes[0, 0].set_ylabel("side force / load (–)")
    axes[1, 0].set_ylabel("change of its maximum (%)")
    low, high = axes[1, 0].get_ylim()
    axes[1, 0].set_ylim(min(low, -LEAST), max(high, LEAST))
    axes[0, 0].set_ylim(0.0, 1.1 * max(values.max() for values in found.curves.values()))
    for ax, handles in zip(axes[0], _key(found, colours), strict=True):
        ax.legend(handles=handles, loc="upper left")
    fig.supxlabel(_conditions(found), x=0.01, ha="left", fontsize=7.0)
    return fig


def _conditions(found) -> str:
    b = found.bristle
    return (
        f"{theme.number(b.speed, 3)} m/s, {theme.number(b.pressure / 1e6, 3)} MPa at every load, "
        f"{theme.number(found.T0 - KELVIN, 3)} {theme.DEGREE}, footprint {theme.number(1e3 * found.tyre.width, 3)} mm "
        f"wide, r₀ = {found.law.said} mm; shear stiffness of the tread "
        f"{theme.number(b.stiffness / 1e6, 3)} MPa/m.  Carcass rigid."
    )


def _key(found, colours) -> tuple[list, list]:
    """What colours and marks mean; what dashes mean."""
    loads = [
        Line2D([], [], color=c, lw=1.8, label=f"{theme.number(load / 1e3)} kN")
        for c, load in zip(colours, found.loads, strict=True)
    ]
    ends = {_end(p) for model in WORDS for p in found.peaks[model, "law"]}
    marks = [Line2D([], [], ls="", **_mark(end != "maximum"), label=end) for end in sorted(ends, reverse=True)]
    controls = [Line2D([], [], color=GREY[c], ls=DASH[c], lw=1.2, label=f"control: both branches {c}") for c in GREY]
    return [*loads, *marks], controls


def _end(peak) -> str:
    """What a highest point is, in words."""
    if peak.first and peak.last:
        return "the only angle"
    return "highest, already falling" if peak.first else "highest, still rising" if peak.last else "maximum"


def _mark(edge: bool) -> dict:
    """A maximum, or the highest point at an end of a curve."""
    face = "white" if edge else theme.SPOT
    return {"marker": "v", "ms": 5.5, "mfc": face, "mec": theme.SPOT if edge else "white", "mew": 1.0 if edge else 0.5}


def _angles(ax, found, model: str, colours) -> None:
    for control in GREY:
        for values in found.curves[model, control]:
            ax.plot(found.angles, values, color=GREY[control], ls=DASH[control], lw=0.9, zorder=1)
    for values, best, colour in zip(found.curves[model, "law"], found.peaks[model, "law"], colours, strict=True):
        ax.plot(found.angles, values, color=colour, lw=1.8, zorder=3)
        ax.plot(best.at, best.value, ls="", zorder=4, clip_on=False, **_mark(best.edge))
    ax.set_xscale("log")
    first, last = found.angles[[0, -1]] if len(found.angles) > 1 else found.angles[0] * np.array([0.5, 2.0])
    ticks = [t for t in (0.01, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 45) if first <= t <= last]
    ax.set_xticks(ticks, [theme.number(t) for t in ticks])
    ax.minorticks_off()
    ax.set(xlabel="slip angle (deg)", xlim=(first, last), title=WORDS[model])


def _maxima(ax, found, model: str, colours) -> None:
    """Highest side force over load, relative to that at the lowest load, where there is one inside the angles."""
    kN = found.loads / 1e3
    if not found.inside(model):
        words = f"no maximum up to {theme.number(found.angles[-1], 3)} deg" if found.no_maximum(model) else "no maximum"
        ax.annotate(words, (0.5, 0.5), xycoords="axes fraction", ha="center", va="center", color=theme.SPOT)
        if not any(found.inside(model, n) for n in (*GREY, "law")):  # no range is made up for nothing
            ax.set_axis_off()
            return
    for name in (n for n in (*GREY, "law") if found.inside(model, n)):
        best = np.array([p.value for p in found.peaks[model, name]])
        change = 100 * (best / best[0] - 1)
        if name == "law":
            ax.plot(kN, change, color="#222222", lw=1.0, zorder=2)
            ax.scatter(kN, change, c=colours, s=30, zorder=3, edgecolors="white", linewidths=0.6)
            words = f"{change[-1]:+.1f} %".replace("-", "\N{MINUS SIGN}")
            ax.annotate(words, (kN[-1], change[-1]), (7, 0), textcoords="offset points", va="center")
        else:
            ax.plot(kN, change, color=GREY[name], ls=DASH[name], lw=1.2, zorder=1)
    ax.axhline(0.0, color=theme.AMBIENT, lw=0.4, zorder=0)
    ax.margins(x=0.16, y=0.15)
    ax.set_xticks(kN, [theme.number(x) for x in kN])
    ax.set(xlabel="load (kN)")
