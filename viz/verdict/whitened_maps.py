"""Maps of the whitened difference averaged over frames (sigma), before and after the extension."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from flashtemp.viz import theme
from flashtemp.viz.measurement.residual_plots import draw_residuals
from flashtemp.viz.verdict import plot_helpers
from flashtemp.viz.verdict.plot_helpers import OUTLIER_SIGMA
from flashtemp.viz.verdict.residual_images import UPWARD_LABELS, draw_image

SIGMA_MAP = "PuOr_r"
MAX_COLOUR_SIGMA = 5.0  # sigma at the ends of the colour bar
SHORT_VIEW_LABELS = {"sidewall": "side wall", "wake": "wake", "profile": "profile"}
MAP_ROW_IN = 1.3  # inches


def select_imaged(verdict) -> list:
    """The selected conditions with recordings that have pixels: points have none to map."""
    groups = [[p for p in g if p.recording.places is None] for g in plot_helpers.select_recordings(verdict)]
    return [g for g in groups if g]


@theme.styled
def draw(verdict) -> Figure:
    """Means over all frames of the whitened difference (sigma), one row per condition, base left of extended."""
    groups = select_imaged(verdict)
    views = list(plot_helpers.group_by_view(groups))
    stages = ["base", "extended"] if any(p.after is not None for g in groups for p in g) else ["base"]
    columns = [(view, stage) for view in views for stage in stages]
    fig = plot_helpers.make_verdict_figure(
        verdict,
        plot_helpers.picture_heading(verdict, "not_noise"),
        plot_helpers.VERDICT_WIDTH_IN,
        0.95 + MAP_ROW_IN * len(groups),
    )
    axes = fig.subplots(len(groups), len(columns), squeeze=False)
    for row, group in zip(axes, groups, strict=True):
        for ax, (view, stage) in zip(row, columns, strict=True):
            pair = next((p for p in group if p.recording.view == view), None)
            result = pair and (pair.before if stage == "base" else pair.after)
            if result is None:
                ax.set_axis_off()
                continue
            _draw_map(ax, result, stage)
            if stage == stages[0]:
                ax.set_ylabel(UPWARD_LABELS.get(view, "mean (sigma)"))
            else:
                ax.tick_params(labelleft=view == "profile")
        plot_helpers.add_row_label(
            row[0], "\n".join(plot_helpers.wrap_label(part) for part in group[0].words.split(", "))
        )
    for ax in axes[-1]:
        ax.set_xlabel("x (mm)")
    pictures = [ax.images[0] for ax in axes.ravel() if ax.images]
    if pictures:
        label = f"mean over frames in sigma, colours end at ±{MAX_COLOUR_SIGMA:g} (–)"
        how = {"location": "bottom", "aspect": 60, "extend": "both", "pad": 0.02, "fraction": 0.04}
        theme.add_colour_bar(fig, pictures[0], axes, label, **how)
    return fig


def _draw_map(ax, result, stage: str) -> None:
    """One map with the fraction of pixels beyond 3 sigma; a profile as dots with its band."""
    r, values = result.view.recording, plot_helpers.whitened_means(result)
    fraction = plot_helpers.outlier_fraction(result)
    ax.set_title(
        f"{SHORT_VIEW_LABELS[r.view]}, {stage}\n{100 * fraction:.2g} % beyond ±{OUTLIER_SIGMA:g}", fontsize=7.0, pad=3
    )
    if r.view == "profile":
        draw_residuals(ax, 1e3 * r.u, values[0], np.full(len(r.u), OUTLIER_SIGMA))
        return
    draw_image(ax, result, values, Normalize(-MAX_COLOUR_SIGMA, MAX_COLOUR_SIGMA), SIGMA_MAP)
