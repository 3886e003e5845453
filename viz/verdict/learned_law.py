"""A learned law: the curve with its band, over what it depends on."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from flashtemp.viz import theme
from flashtemp.viz.html import page
from flashtemp.viz.number_format import format_number

LAW_CAPTION = (
    "The learned law with its 95 % band. Points are the nodes of learned.py, with straight lines between them; a "
    "pressure is scaled to a mean of 1. The thin line is the case as stated."
)


def law_section(verdict, figures) -> list[tuple[str, str, list[str]]]:
    """Mark, heading and picture of a learned law for a report; nothing where none was learned."""
    if "law" not in figures:
        return []
    law = verdict.law
    over, unit = ("" if u == "1" else f" {u}" for u in (law.argument_unit, law.unit))
    first, last = (
        f"{format_number(law.curve[i])} ({format_number(law.low[i])} to {format_number(law.high[i])}){unit} at {format_number(law.at[i])}{over}"
        for i in (0, -1)
    )
    picture = page.embed_figure(figures["law"], f"{law.words}: {first}, {last}", LAW_CAPTION)
    return [("law", f"{law.words[0].upper()}{law.words[1:]}", [picture])]


@theme.styled
def draw(verdict) -> Figure:
    """The law of a verdict of kind "learned": a factor (1), or in the unit of its quantity."""
    law = verdict.law
    fig = theme.make_figure(verdict.title, theme.NARROW_FIGURE_IN, 3.0)
    ax = fig.add_subplot()
    ax.fill_between(law.at, law.low, law.high, color=theme.SPOT_COLOUR, alpha=0.2, lw=0)
    ax.axhline(1.0 if law.unit == "1" else 0.0, color=theme.AMBIENT_COLOUR, lw=0.8)
    ax.plot(law.at, law.curve, color=theme.SPOT_COLOUR, lw=1.8)
    nodes = np.array(law.nodes)
    ax.plot(
        nodes, np.interp(nodes, law.at, law.curve), "o", color=theme.SPOT_COLOUR, ms=5, mec="white", mew=0.8, zorder=4
    )
    over, unit = ("–" if u == "1" else u for u in (law.argument_unit, law.unit))
    ax.set(
        xlabel=f"{law.argument} ({over})", ylabel=f"{'factor on ' if law.unit == '1' else ''}{law.quantity} ({unit})"
    )
    ax.set_title(law.formula.partition(",")[0] if len(law.formula) < 60 else law.formula.partition(":")[0])
    return fig
