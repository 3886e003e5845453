"""Picture of a running test: the latest image against the stated model, and the evidence as frames arrive."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from flashtemp.discovery.criteria import CRITERIA
from flashtemp.viz import theme
from flashtemp.viz.literal_text import escape_mathematics
from flashtemp.viz.measurement.comparison import KELVIN_MAP, MASKED_COLOUR, UPWARD_AXES
from flashtemp.viz.measurement.residual_plots import COMPUTED_COLOUR, MEASURED_COLOUR, VIEW_LABELS, pixel_edges

FIGURE_SIZE_IN = (9.6, 6.4)
MAX_EFFECTS_DRAWN = 4
EFFECT_COLOURS = ("#C8420B", "#0072B2", "#1FA37A", "#E69F00")
LEAST_DIFFERENCE_K = 0.1  # half width of the colour scale of differences, at least


@theme.styled
def draw(test) -> Figure:
    """Measured, computed and difference (degC, K) of the latest frame; below it ln Bayes factors and rms (K) by frames.

    `test` is a `discovery.watched_test.WatchedTest` with an assessment.
    """
    decision = test.assessment.decision
    subject = f"{test.campaign.title}\n{decision.words[:1].upper()}{decision.words[1:]}"
    fig = theme.make_figure("Latest frame and evidence so far", subject, *FIGURE_SIZE_IN)
    above, below = fig.subfigures(2, 1, height_ratios=[1.15, 1.0])
    name = test.latest if test.latest in test.assessment.recordings else next(iter(test.assessment.recordings))
    compared = test.assessment.recordings[name]
    if compared.entry.recording.is_single_row:
        _draw_row(above, compared)
    else:
        _draw_images(above, compared)
    left, right = below.subplots(1, 2, width_ratios=[1.5, 1.0])
    _draw_evidence(left, test)
    _draw_residuals(right, test.history)
    return fig


def _frame_title(compared) -> str:
    r = compared.entry.recording
    return (
        f"{compared.entry.file}: {VIEW_LABELS[r.view]}, repetition {r.repetition[-1]},"
        f" t = {theme.format_decimal(r.time[-1])} s; {compared.rmse_K:.3f} K rms,"
        f" {compared.calibrated_rmse_K:.3f} K with all nuisances calibrated"
    )


def _draw_images(fig, compared) -> None:
    r, residual = compared.entry.recording, compared.residual[-1]
    known = np.isfinite(residual)
    measured = np.where(known, r.temperature[-1], np.nan)
    computed = np.where(known, compared.predicted[-1], np.nan)
    u, v = pixel_edges(r.u), pixel_edges(r.v)
    heat = theme.temperature_norm(np.where(known, measured, np.nan), computed)
    size = np.nanpercentile(np.abs(residual), 99.5) if known.any() else 0.0
    limit = theme.nice_ceil(max(float(size), LEAST_DIFFERENCE_K))
    fig.suptitle(escape_mathematics(_frame_title(compared))[:150], x=0.01, ha="left", fontsize=8.0, weight="normal")
    axes = fig.subplots(1, 3, sharex=True, sharey=True)
    columns = (
        ("measured", measured, theme.temperature_map(), heat),
        ("computed", computed, theme.temperature_map(), heat),
        ("measured − computed", residual, KELVIN_MAP, Normalize(-limit, limit)),
    )
    for ax, (label, values, cmap, norm) in zip(axes, columns, strict=True):
        ax.set_facecolor(MASKED_COLOUR)
        ax.imshow(
            np.ma.masked_invalid(values), origin="lower", extent=(u[0], u[-1], v[0], v[-1]), cmap=cmap, norm=norm,
            interpolation="nearest",
        )  # fmt: skip
        ax.set_title(label, weight="bold")
        ax.set_xlabel("x (mm)")
    axes[0].set_ylabel(f"{UPWARD_AXES[r.view][0]} (mm)")
    place = {"location": "bottom", "shrink": 0.7}
    theme.add_colour_bar(fig, axes[0].images[0], axes[:2], f"temperature ({theme.CELSIUS})", aspect=50, **place)
    theme.add_colour_bar(fig, axes[2].images[0], axes[2], "difference (K)", aspect=25, **place)


def _draw_row(fig, compared) -> None:
    """The latest frame of a profile along x, or the time series of all points."""
    r = compared.entry.recording
    fig.suptitle(escape_mathematics(_frame_title(compared))[:150], x=0.01, ha="left", fontsize=8.0, weight="normal")
    above, below = fig.subplots(2, 1, sharex=True, height_ratios=[1.6, 1.0])
    if r.places is None:
        x, label, k = 1e3 * r.u, "x (mm)", np.index_exp[-1, 0]
    else:
        x, label, k = r.time, "time (s)", np.index_exp[:, 0]
    above.plot(x, r.temperature[k], ".", color=MEASURED_COLOUR, label="measured")
    above.plot(x, compared.predicted[k], color=COMPUTED_COLOUR, label="computed")
    handles = {label: handle for handle, label in zip(*above.get_legend_handles_labels(), strict=True)}
    above.legend(handles.values(), handles.keys())
    above.set_ylabel(f"temperature ({theme.CELSIUS})")
    below.plot(x, compared.residual[k], ".")
    below.axhline(0.0, color=theme.AMBIENT_COLOUR, lw=0.5)
    below.set(xlabel=label, ylabel="difference (K)")


def _draw_evidence(ax, test) -> None:
    """ln Bayes factors of the leading effects against the stated model, over the number of frames."""
    history = test.history
    frames = [entry.frames for entry in history]
    names = [h.effect for h in test.assessment.hypotheses if not h.reason][:MAX_EFFECTS_DRAWN]
    for name, colour in zip(names, EFFECT_COLOURS, strict=False):
        ax.plot(frames, [e.ln_bayes.get(name, np.nan) for e in history], "o-", ms=2.5, color=colour, label=name)
    ax.axhline(0.0, color=theme.AMBIENT_COLOUR, lw=0.8)
    ax.axhline(CRITERIA.ln_bayes_named, color=theme.AMBIENT_COLOUR, lw=0.8, ls="--", label="needed to name an effect")
    ax.set_title("evidence against the stated model", weight="bold")
    ax.set(xlabel="frames so far", ylabel="ln Bayes factor", xlim=(0.0, 1.05 * max(frames)))
    ax.xaxis.set_major_locator(MaxNLocator(6, integer=True, steps=list(theme.TICK_STEPS)))
    ax.legend(loc="best")


def _draw_residuals(ax, history) -> None:
    """Root mean square of measured minus computed of every recording, over the number of frames."""
    frames = [entry.frames for entry in history]
    for name in history[-1].rmse_K:
        ax.plot(frames, [e.rmse_K.get(name, np.nan) for e in history], "o-", ms=2.5, label=escape_mathematics(name))
    ax.set_ylim(bottom=0.0)
    ax.set_title("difference from the stated model", weight="bold")
    ax.set(xlabel="frames so far", ylabel="rms difference (K)", xlim=(0.0, 1.05 * max(frames)))
    ax.xaxis.set_major_locator(MaxNLocator(6, integer=True, steps=list(theme.TICK_STEPS)))
    ax.legend(loc="best")
