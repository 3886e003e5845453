"""Sensitivity of a prediction: change by each input, with its fraction of the variance."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from flashtemp.viz import theme
from flashtemp.viz.key_labels import describe_key
from flashtemp.viz.number_format import format_number

MAX_INPUTS_DRAWN = 10
SIGMA_95 = 1.96
OUTPUT_PANELS = {
    "T_spot_L": ("spots, trailing edge (K)", theme.SPOT_COLOUR, f" {theme.CELSIUS}"),
    "T_block_L": ("block, trailing edge (K)", theme.BLOCK_COLOUR, f" {theme.CELSIUS}"),
    "mu": ("friction coefficient (–)", theme.ROAD_COLOUR, ""),
}


@theme.styled
def draw(result) -> Figure:
    """Bars: the change by +1.96 sd of an input, from its slope, for the inputs with the largest total fractions.

    Next to them: first-order and total fraction of the variance, in per cent.
    """
    shown = result.ranked_inputs[:MAX_INPUTS_DRAWN][::-1]
    title, height = "Change of the prediction by each input", 1.3 + 0.24 * len(shown)
    fig = theme.make_figure(title, result.case.title, theme.WIDE_FIGURE_IN, height)
    axes = fig.subplots(1, len(OUTPUT_PANELS), sharey=True)
    at = np.arange(len(shown))
    for ax, (name, (words, colour, unit)) in zip(axes, OUTPUT_PANELS.items(), strict=True):
        number = result.numbers[name]
        change = SIGMA_95 * number.slopes[shown]
        ax.barh(at, change, color=colour, height=0.62)
        ax.axvline(0.0, color=theme.AMBIENT_COLOUR, lw=0.6)
        reach = 2.4 * max(float(np.abs(change).max()), 1e-12)
        ax.set(xlim=(-reach, reach), xlabel=words)
        for y, c, first, total in zip(at, change, number.first[shown], number.total[shown], strict=True):
            if total >= 0.005:
                ax.text(
                    c + np.copysign(0.04 * reach, c or 1.0), y, f"{100 * first:.0f}/{100 * total:.0f} %",
                    ha="left" if c >= 0 else "right", va="center", fontsize=6.5,
                )  # fmt: skip
        ax.set_title(f"95 %: {format_number(number.low)} to {format_number(number.high)}{unit}")
    axes[0].set_yticks(at, [describe_key(result.inputs[k].key).words for k in shown])
    words = "Bars: change by +1.96 sd of the input. Numbers: first-order and total fraction of the variance."
    theme.add_caption(fig, words)
    return fig
