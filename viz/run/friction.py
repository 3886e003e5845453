"""Friction coefficient over the slid distance of each repetition, and its mean per repetition."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from flashtemp.viz import theme

PICTURE = "friction"
MIN_FRICTION_SPAN = 0.02  # smallest range of the friction axis, so that rounding does not look like a trend
MAX_LABELLED_REPETITIONS = 6  # more repetitions get a colour bar


def applies(run) -> bool:
    """Whether any record has a friction coefficient."""
    return bool(np.isfinite(run.friction).any())


@theme.styled
def draw(run) -> Figure:
    """Load-weighted friction coefficient (1) over the slid distance (m) of each repetition.

    With several repetitions a second panel shows the mean of each over the slid distance.
    """
    numbers = np.unique(run.repetition[run.sliding])
    several = len(numbers) > 1
    width = theme.WIDE_FIGURE_IN if several else theme.NARROW_FIGURE_IN
    fig = theme.make_figure("Friction coefficient over the distance slid", run.title, width, 3.1)
    axes = fig.subplots(1, 2, width_ratios=[1.5, 1.0]) if several else [fig.add_subplot()]
    fig.get_layout_engine().set(wspace=0.04)
    colours = theme.repetition_colours(len(numbers))
    _draw_curves(fig, axes[0], run, numbers, colours)
    if several:
        _draw_means(axes[1], run, numbers, colours)
    return fig


def repetition_friction(run, repetition: int) -> tuple[np.ndarray, np.ndarray]:
    """Slid distance since the start of a repetition (m) and friction coefficient (1) of its records."""
    on = run.sliding & (run.repetition == repetition) & np.isfinite(run.friction)
    before = np.flatnonzero(on)[:1] - 1
    start = run.slid[np.maximum(before, 0)]  # slid distance at the end of the previous repetition
    return run.slid[on] - start, run.friction[on]


def _draw_curves(fig, ax, run, numbers, colours) -> None:
    """One line per repetition over the distance slid in it."""
    for r, colour in zip(numbers, colours, strict=True):
        s, mu = repetition_friction(run, r)
        ax.plot(
            s, mu, color=colour, lw=1.4 if len(numbers) <= MAX_LABELLED_REPETITIONS else 0.9, label=f"repetition {r}"
        )
    ax.set(xlabel="slid distance in the repetition (m)", ylabel="friction coefficient, load-weighted (–)")
    ax.set_xlim(left=0.0)
    ax.set_ylim(*theme.padded_limits(run.friction[run.sliding], least=MIN_FRICTION_SPAN, margin=0.08))
    if len(numbers) > MAX_LABELLED_REPETITIONS:
        _add_colour_bar(fig, ax, numbers, colours)
    elif len(numbers) > 1:
        ax.legend(loc="best")


def _add_colour_bar(fig, ax, numbers, colours) -> None:
    """Colour bar of repetition numbers."""
    from matplotlib.cm import ScalarMappable

    norm = BoundaryNorm(np.append(numbers, numbers[-1] + 1) - 0.5, len(numbers))
    labelled = numbers[theme.spread_indices(len(numbers), 10)]
    picture = ScalarMappable(norm, ListedColormap(colours))
    bar = theme.add_colour_bar(fig, picture, ax, "repetition (–)", ticks=labelled, pad=0.01, aspect=25)
    bar.ax.tick_params(length=0)
    bar.ax.minorticks_off()


def _draw_means(ax, run, numbers, colours) -> None:
    """Mean over the slid distance of every repetition."""
    ax.plot(numbers, run.friction_per_repetition, color=theme.AMBIENT_COLOUR, lw=0.6, zorder=1)
    ax.scatter(numbers, run.friction_per_repetition, c=colours, s=22 if len(numbers) <= 25 else 8, zorder=2)
    ax.xaxis.set_major_locator(MaxNLocator(integer=True, nbins=8))
    ax.set(xlabel="repetition (–)", xlim=(numbers[0] - 0.5, numbers[-1] + 0.5))
    ax.set_ylim(*theme.padded_limits(run.friction_per_repetition, least=MIN_FRICTION_SPAN, margin=0.08))
    ax.set_ylabel("mean over the slid distance (–)")
