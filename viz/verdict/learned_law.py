"""Picture of a learned law: its curve with the 95 % band over its argument."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from flashtemp.viz import theme
from flashtemp.viz.number_format import law_axis_labels


@theme.styled
def draw(verdict) -> Figure:
    """The law of a verdict of kind "learned": a factor (1), or in the unit of its quantity."""
    law = verdict.law
    fig = theme.make_figure(
        f"Learned law: {law.quantity} over {law.argument}", verdict.title, theme.NARROW_FIGURE_IN, 3.0
    )
    ax = fig.add_subplot()
    ax.fill_between(law.at, law.low, law.high, color=theme.SPOT_COLOUR, alpha=0.2, lw=0)
    ax.axhline(1.0 if law.unit == "1" else 0.0, color=theme.AMBIENT_COLOUR, lw=0.8)
    ax.plot(law.at, law.curve, color=theme.SPOT_COLOUR, lw=1.8)
    nodes = np.array(law.nodes)
    ax.plot(
        nodes, np.interp(nodes, law.at, law.curve), "o", color=theme.SPOT_COLOUR, ms=5, mec="white", mew=0.8, zorder=4
    )
    x_label, y_label = law_axis_labels(law.words, law.argument_unit, law.unit)
    ax.set(xlabel=x_label, ylabel="\n(".join(y_label.rsplit(" (", 1)))
    ax.set_title(law.formula.partition(",")[0] if len(law.formula) < 60 else law.formula.partition(":")[0])
    return fig
