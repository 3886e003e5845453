"""Recordings without images, measured and computed: thermocouples over time, profiles along the block."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from flashtemp.viz import theme
from flashtemp.viz.literal_text import escape_mathematics
from flashtemp.viz.measurement.residual_plots import (
    BAND_COLOUR,
    BAND_SIGMA,
    COMPUTED_COLOUR,
    MEASURED_COLOUR,
    draw_residuals,
    make_recording_figure,
)

POINT_COLOURS = ("#2B2B2B", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00")
POINT_FIGURE_WIDTH_IN = 8.4  # inches
MAX_POINTS_DRAWN = 12


@theme.styled
def draw_points(result) -> Figure:
    """Temperatures (degC) of up to twelve points over time (s), measured as dots and computed as lines; below, K."""
    r, fig = result.view.recording, _measured_and_computed(result, POINT_FIGURE_WIDTH_IN, 4.6)
    above, below = fig.subplots(2, 1, sharex=True, height_ratios=[1.6, 1.0])
    for j, name in enumerate(r.places.names[:MAX_POINTS_DRAWN]):
        colour = POINT_COLOURS[j % len(POINT_COLOURS)]
        above.plot(r.time, r.temperature[:, 0, j], "o", color=colour, ms=2.4, mew=0, label=escape_mathematics(name))
        above.plot(r.time, result.predicted[:, 0, j], color=colour, lw=0.9)
        below.plot(r.time, result.residual[:, 0, j], "-o", color=colour, lw=0.7, ms=1.8, mew=0)
    _draw_noise_band(below, r.time, result)
    above.set_ylabel(f"temperature ({theme.CELSIUS})")
    above.legend(title="dots measured, lines computed", ncols=3)
    below.set(xlabel="time (s)", ylabel="measured −\ncomputed (K)")
    theme.add_caption(fig, "Blue band: two standard deviations of the noise of one reading.")
    return fig


def _measured_and_computed(result, width: float, height: float) -> Figure:
    return make_recording_figure("Measured and computed temperature", result.view, width, height)


@theme.styled
def draw_recording(recording, block=None) -> Figure:
    """Temperatures (degC) of a recording of points over time (s), and the positions of the points (mm).

    `block` (length, height in m) is outlined if given.
    """
    fig = theme.make_figure(
        "Temperature of the points", recording.source or "thermocouples", POINT_FIGURE_WIDTH_IN, 3.6
    )
    left, right = fig.subplots(1, 2, width_ratios=[1.6, 1.0])
    places, many = recording.places, range(min(len(recording.places), MAX_POINTS_DRAWN))
    for j in many:
        colour = POINT_COLOURS[j % len(POINT_COLOURS)]
        dashes = "-" if j < len(POINT_COLOURS) else "--"
        left.plot(
            recording.time,
            recording.temperature[:, 0, j],
            dashes,
            color=colour,
            lw=0.9,
            label=escape_mathematics(places.names[j]),
        )
        at = 1e3 * places.x[j], 1e3 * places.z[j]
        right.plot(*at, "o", color=colour, mfc=colour if dashes == "-" else "white")
        right.annotate(escape_mathematics(places.names[j]), at, (3, 3), textcoords="offset points", fontsize=7)
    if block is not None:
        right.add_patch(Rectangle((0, 0), 1e3 * block[0], 1e3 * block[1], fill=False, ec=theme.AMBIENT_COLOUR, lw=1.2))
    right.axhline(0.0, color=theme.AMBIENT_COLOUR, lw=0.8, ls="--")
    right.margins(0.15)
    left.set(xlabel="time from the first start of sliding (s)", ylabel=f"temperature ({theme.CELSIUS})")
    right.set(xlabel="x from the leading edge (mm)", ylabel="z above the interface (mm)")
    left.legend(ncols=2 if len(many) > 4 else 1)
    return fig


def draw_residual_panel(part, own: list) -> None:
    """Differences (K) over time (s) of all points, with the base and, where there is one, the extended model."""
    part.suptitle("thermocouples", x=0.01, ha="left", fontsize=8.5)
    stages = ["base", "extended"] if any(p.after is not None for p in own) else ["base"]
    axes = part.subplots(1, len(stages), sharex=True, sharey=True, squeeze=False)[0]
    for ax, stage in zip(axes, stages, strict=True):
        names: dict[str, str] = {}
        for pair in own:
            result = pair.before if stage == "base" else pair.after
            if result is None:
                continue
            r = result.view.recording
            _draw_noise_band(ax, r.time, result)
            for j, name in enumerate(r.places.names[:MAX_POINTS_DRAWN]):
                is_new = name not in names
                colour = names.setdefault(name, POINT_COLOURS[len(names) % len(POINT_COLOURS)])
                ax.plot(
                    r.time, result.residual[:, 0, j], "o", color=colour, ms=2.4, mew=0.5,
                    mfc="white" if result.view.held_out else colour, label=escape_mathematics(name) if is_new else None,
                )  # fmt: skip
        ax.axhline(0.0, color=theme.AMBIENT_COLOUR, lw=0.5)
        ax.set(xlabel="time (s), open dots: left out of the fit", title=stage)
    axes[0].set_ylabel("measured −\ncomputed (K)")
    # outside the panels, where it covers no data
    axes[-1].legend(loc="center left", bbox_to_anchor=(1.0, 0.5), ncols=2 if len(names) > 6 else 1)


def _draw_noise_band(ax, time: np.ndarray, result) -> None:
    """The band of two standard deviations of one reading."""
    half = BAND_SIGMA * float(np.hypot(result.noise.white, result.noise.pattern))
    ax.fill_between([time[0], time[-1]], -half, half, color=BAND_COLOUR, lw=0, zorder=0)


def draw_profile(result, chosen: dict[int, str]) -> Figure:
    """A profile over x (mm): curves (degC), and below their difference (K) with the noise band of one pixel."""
    r, shown = result.view.recording, list(chosen)
    x, noise = 1e3 * r.u, np.hypot(result.noise.white, result.noise.pattern)
    fig = _measured_and_computed(result, POINT_FIGURE_WIDTH_IN if len(shown) > 1 else theme.NARROW_FIGURE_IN, 4.4)
    axes = fig.subplots(2, len(shown), sharex=True, sharey="row", squeeze=False, height_ratios=[1.6, 1.0])
    for k, above, below in zip(shown, *axes, strict=True):
        measured = np.where(np.isfinite(result.residual[k, 0]), r.temperature[k, 0], np.nan)
        above.plot(x, measured, "o", color=MEASURED_COLOUR, ms=2.2, mew=0, label="measured")
        above.plot(x, result.predicted[k, 0], color=COMPUTED_COLOUR, label="computed")
        words = chosen[k].replace("\n", " ")
        above.set_title(f"repetition {r.repetition[k]}, t = {theme.format_decimal(r.time[k])} s\n{words}")
        draw_residuals(below, x, result.residual[k, 0], np.full(len(x), BAND_SIGMA * noise))
        below.set_xlabel("x (mm)")
    off = result.residual[shown]
    axes[1, 0].set_ylim(theme.padded_limits(off, [-BAND_SIGMA * noise, BAND_SIGMA * noise], least=1e-6, margin=0.08))
    axes[0, 0].set_ylabel(f"temperature ({theme.CELSIUS})")
    axes[0, 0].legend()
    axes[1, 0].set_ylabel("measured −\ncomputed (K)")
    theme.add_caption(fig, "Blue band: two standard deviations of the noise of one pixel. Red: outside.")
    return fig
