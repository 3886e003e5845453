"""It is not noise: frame-mean maps of the whitened difference, before and after the extension, in sigma."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from flashtemp.viz import theme, verdict_parts
from flashtemp.viz.difference import AXIS, image
from flashtemp.viz.residuals import against
from flashtemp.viz.verdict_parts import BEYOND

SIGMA = "PuOr_r"
CLIP = 5.0  # sigma where the colours end
VIEW = {"sidewall": "side wall", "wake": "wake", "profile": "profile"}
ROW = 1.15  # inches


def imaged(verdict) -> list:
    """Conditions with recordings that have pixels: points have none to map."""
    groups = [[p for p in g if p.recording.places is None] for g in verdict_parts.shown(verdict)]
    return [g for g in groups if g]


@theme.styled
def draw(verdict) -> Figure:
    """Means over all frames of the whitened difference (sigma), one row per condition, base beside extended."""
    groups = imaged(verdict)
    views = list(verdict_parts.by_view(groups))
    stages = ["base", "extended"] if any(p.after is not None for g in groups for p in g) else ["base"]
    columns = [(view, stage) for view in views for stage in stages]
    fig = verdict_parts.titled(
        verdict, verdict_parts.head(verdict, "not_noise"), verdict_parts.WIDTH, 0.95 + ROW * len(groups)
    )
    axes = fig.subplots(len(groups), len(columns), squeeze=False)
    for row, group in zip(axes, groups, strict=True):
        for ax, (view, stage) in zip(row, columns, strict=True):
            pair = next((p for p in group if p.recording.view == view), None)
            seeing = pair and (pair.before if stage == "base" else pair.after)
            if seeing is None:
                ax.set_axis_off()
                continue
            _map(ax, seeing, stage)
            if stage == stages[0]:
                ax.set_ylabel(AXIS.get(view, "mean (sigma)"))
            else:
                ax.tick_params(labelleft=view == "profile")
        verdict_parts.beside(row[0], "\n".join(verdict_parts.narrow(part) for part in group[0].words.split(", ")))
    for ax in axes[-1]:
        ax.set_xlabel("x (mm)")
    pictures = [ax.images[0] for ax in axes.ravel() if ax.images]
    if pictures:
        bar = fig.colorbar(
            pictures[0], ax=axes, label=f"mean over frames in sigma, colours end at ±{CLIP:g} (–)", location="bottom",
            aspect=60, extend="both", pad=0.02, fraction=0.04,
        )  # fmt: skip
        bar.outline.set_linewidth(0.4)
    return fig


def _map(ax, seeing, stage: str) -> None:
    """One map with the share of pixels beyond 3 sigma; a profile as dots with its band."""
    r, values = seeing.view.recording, verdict_parts.means(seeing)
    share = verdict_parts.beyond(seeing)
    ax.set_title(f"{VIEW[r.view]}, {stage}: {100 * share:.2g} % beyond ±{BEYOND:g}", fontsize=7.0, pad=3)
    if r.view == "profile":
        against(ax, 1e3 * r.u, values[0], np.full(len(r.u), BEYOND))
        return
    image(ax, seeing, values, Normalize(-CLIP, CLIP), SIGMA)
