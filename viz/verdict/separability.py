"""Which effects planned measurements can distinguish: correlation of signatures, and remaining signal."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from flashtemp.viz import theme

MAX_EFFECTS_DRAWN = 28
SEPARABLE_COLOUR, MIN_SEPARABLE_SIGMA = "#1FA37A", 5.0


@theme.styled
def draw(report) -> Figure:
    """Matrix of correlations, and bars of the signal-to-noise ratio orthogonal to all other effects."""
    prospects = [p for p in report.prospects if p.z > 0.1][:MAX_EFFECTS_DRAWN]
    names = [p.effect for p in prospects]
    at = [report.separability.names.index(n) for n in names]
    rho = report.separability.rho[np.ix_(at, at)]
    size = 1.6 + 0.2 * len(names)
    fig = theme.make_figure("Correlation and signal of the candidate effects", report.title, size + 4.2, size + 0.6)
    left, right = fig.subplots(1, 2, width_ratios=[size, 2.4])
    shown = left.imshow(rho, cmap="RdBu_r", vmin=-1, vmax=1, interpolation="nearest", aspect="auto")
    left.set_xticks(range(len(names)), [_effect_label(n) for n in names], rotation=90)
    left.set_yticks(range(len(names)), [_effect_label(n) for n in names])
    left.set_title("correlation of signatures after calibration")
    theme.add_colour_bar(fig, shown, left, "correlation (–)", location="bottom", shrink=0.5, aspect=30)
    z = [max(p.z_left, 1e-2) for p in prospects]
    right.barh(
        range(len(names)), z, color=[SEPARABLE_COLOUR if p.is_separable else theme.WAITING_COLOUR for p in prospects]
    )
    right.axvline(MIN_SEPARABLE_SIGMA, color="black", lw=0.8)
    right.set_xscale("log")
    right.set_xlim(0.1, 2.0 * max([*z, MIN_SEPARABLE_SIGMA]))
    right.set_ylim(len(names) - 0.5, -0.5)
    right.set_yticks([])
    right.set_title("signal that no other effect imitates")
    words = f"signal-to-noise ratio at typical strength (–)\ngreen: distinguishable, above {MIN_SEPARABLE_SIGMA:g}"
    right.set_xlabel(words)
    return fig


def _effect_label(name: str) -> str:
    return name.replace("_", " ")
