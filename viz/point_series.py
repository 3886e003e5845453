"""Recordings without an image, measured and computed: thermocouples against time, profiles along the block."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from flashtemp.viz import theme
from flashtemp.viz.residuals import BAND, COMPUTED, MEASURED, SURE, against, figure, plain

COLOURS = ("#2B2B2B", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00")
WIDTH = 9.6  # inches
MANY = 12  # points that are drawn


@theme.styled
def picture(seeing) -> Figure:
    """Temperatures (degC) of up to twelve points over time (s), measured as dots and computed as lines; below, K."""
    r, fig = seeing.view.recording, figure(seeing.view, WIDTH, 4.6)
    above, below = fig.subplots(2, 1, sharex=True, height_ratios=[1.6, 1.0])
    for j, name in enumerate(r.places.names[:MANY]):
        colour = COLOURS[j % len(COLOURS)]
        above.plot(r.time, r.temperature[:, 0, j], "o", color=colour, ms=2.4, mew=0, label=plain(name))
        above.plot(r.time, seeing.predicted[:, 0, j], color=colour, lw=0.9)
        below.plot(r.time, seeing.residual[:, 0, j], "-o", color=colour, lw=0.7, ms=1.8, mew=0)
    _band(below, r.time, seeing)
    above.set_ylabel(f"temperature ({theme.DEGREE})")
    above.legend(title="dots measured, lines computed", ncols=3)
    below.set(xlabel="time (s)", ylabel="measured −\ncomputed (K)")
    fig.supxlabel("blue band: noise of one reading alone, two standard deviations", fontsize=7.5)
    return fig


@theme.styled
def measured(recording, block=None) -> Figure:
    """Temperatures (degC) of a recording of points over time (s), and where they sit (mm); `block` (length, height in
    m) is drawn where it is known."""
    fig = Figure(figsize=(WIDTH, 3.6), layout="constrained", facecolor="white")
    fig.suptitle(plain(recording.source or "thermocouples"), x=0.01, ha="left")
    left, right = fig.subplots(1, 2, width_ratios=[1.6, 1.0])
    places, many = recording.places, range(min(len(recording.places), MANY))
    for j in many:
        colour = COLOURS[j % len(COLOURS)]
        dashes = "-" if j < len(COLOURS) else "--"
        left.plot(
            recording.time, recording.temperature[:, 0, j], dashes, color=colour, lw=0.9, label=plain(places.names[j])
        )
        at = 1e3 * places.x[j], 1e3 * places.z[j]
        right.plot(*at, "o", color=colour, mfc=colour if dashes == "-" else "white")
        right.annotate(plain(places.names[j]), at, (3, 3), textcoords="offset points", fontsize=7)
    if block is not None:
        right.add_patch(Rectangle((0, 0), 1e3 * block[0], 1e3 * block[1], fill=False, ec=theme.AMBIENT, lw=1.2))
    right.axhline(0.0, color=theme.AMBIENT, lw=0.8, ls="--")
    right.margins(0.15)
    left.set(xlabel="time from the first start of sliding (s)", ylabel=f"temperature ({theme.DEGREE})")
    right.set(xlabel="x from the leading edge (mm)", ylabel="z above the face (mm)")
    left.legend(ncols=2 if len(many) > 4 else 1)
    return fig


def panel(part, own: list) -> None:
    """Differences (K) over time (s) of all points of recordings, before and, where there is one, after."""
    part.suptitle("thermocouples", x=0.01, ha="left", fontsize=8.5)
    stages = ["base", "extended"] if any(p.after is not None for p in own) else ["base"]
    axes = part.subplots(1, len(stages), sharex=True, sharey=True, squeeze=False)[0]
    for ax, stage in zip(axes, stages, strict=True):
        names: dict[str, str] = {}
        for pair in own:
            seeing = pair.before if stage == "base" else pair.after
            if seeing is None:
                continue
            r = seeing.view.recording
            _band(ax, r.time, seeing)
            for j, name in enumerate(r.places.names[:MANY]):
                fresh = name not in names
                colour = names.setdefault(name, COLOURS[len(names) % len(COLOURS)])
                ax.plot(
                    r.time, seeing.residual[:, 0, j], "o", color=colour, ms=2.4, mew=0.5,
                    mfc="white" if seeing.view.held_out else colour, label=plain(name) if fresh else None,
                )  # fmt: skip
        ax.axhline(0.0, color=theme.AMBIENT, lw=0.5)
        ax.set(xlabel="time (s), open dots: left out of the fit", title=stage)
    axes[0].set_ylabel("measured −\ncomputed (K)")
    axes[-1].legend()


def _band(ax, time: np.ndarray, seeing) -> None:
    """Two standard deviations of one reading."""
    half = SURE * float(np.hypot(seeing.noise.white, seeing.noise.pattern))
    ax.fill_between([time[0], time[-1]], -half, half, color=BAND, lw=0, zorder=0)


def profile(seeing, chosen: dict[int, str]) -> Figure:
    """A profile: curves in degC above their difference in K with the noise of one pixel, against x in mm."""
    r, shown = seeing.view.recording, list(chosen)
    x, noise = 1e3 * r.u, np.hypot(seeing.noise.white, seeing.noise.pattern)
    fig = figure(seeing.view, WIDTH if len(shown) > 1 else theme.NARROW, 4.4)
    axes = fig.subplots(2, len(shown), sharex=True, sharey="row", squeeze=False, height_ratios=[1.6, 1.0])
    for k, above, below in zip(shown, *axes, strict=True):
        seen = np.where(np.isfinite(seeing.residual[k, 0]), r.temperature[k, 0], np.nan)
        above.plot(x, seen, "o", color=MEASURED, ms=2.2, mew=0, label="measured")
        above.plot(x, seeing.predicted[k, 0], color=COMPUTED, label="computed")
        words = chosen[k].replace("\n", " ")
        above.set_title(f"repetition {r.repetition[k]}, t = {theme.number(r.time[k])} s\n{words}")
        against(below, x, seeing.residual[k, 0], np.full(len(x), SURE * noise))
        below.set_xlabel("x (mm)")
    off = seeing.residual[shown]
    axes[1, 0].set_ylim(theme.span(off, [-SURE * noise, SURE * noise], least=1e-6, margin=0.08))
    axes[0, 0].set_ylabel(f"temperature ({theme.DEGREE})")
    axes[0, 0].legend()
    axes[1, 0].set_ylabel("measured −\ncomputed (K)")
    fig.supxlabel("blue band: noise of one pixel alone, two standard deviations; red: beyond it", fontsize=7.5)
    return fig
