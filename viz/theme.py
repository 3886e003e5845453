"""Colours, fonts and sizes of all pictures, and helpers for a uniform look.

Nothing is set globally: `styled` wraps every `draw`, so that the settings apply inside it only and the user's own
matplotlibrc has no effect.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable
from functools import wraps
from importlib import import_module
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure

from flashtemp.display import atomic_write
from flashtemp.viz.literal_text import show_as_text

SPOT_COLOUR = "#B2182B"  # in the macroasperity contact regions
BLOCK_COLOUR = "#1FA37A"  # block, averaged across y
ROAD_COLOUR = "#6E7F8D"
HOLDER_COLOUR = "#E69F00"
AIR_COLOUR = "#56B4E9"
AMBIENT_COLOUR = "#5A5A5A"
BLUE, VERMILION = "#0072B2", "#D55E00"  # a pair that colour-blind readers distinguish (Okabe and Ito 2008)
PLACE_COLOURS = {"leading edge": BLUE, "middle": "#4D4D4D", "trailing edge": VERMILION}
SLIDING_COLOUR, WAITING_COLOUR = "#4D4D4D", "#E4E4E4"

TEMPERATURE_MAP_NAME = "inferno"
REPETITION_MAP_NAME = "viridis"
CELSIUS = "°C"
FIGURE_DPI = 160
TITLE_LETTERS_PER_IN, CAPTION_LETTERS_PER_IN = 11, 17.5  # letters of a title or caption in an inch
TICK_STEPS = (1, 2, 5, 10)  # times a power of ten: the steps between ticks
FigureLayout = Literal["constrained", "compressed", "tight"]
WIDE_FIGURE_IN, NARROW_FIGURE_IN = 7.2, 5.2  # inches
MATPLOTLIB_STYLE = {
    "font.size": 8.0,
    "axes.titlesize": 8.0,
    "axes.titlelocation": "left",
    "axes.labelsize": 8.0,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "lines.linewidth": 1.4,
    "legend.fontsize": 7.5,
    "legend.frameon": False,
    "figure.titlesize": 9.5,
    "figure.titleweight": "bold",
    "savefig.dpi": FIGURE_DPI,
    "hatch.linewidth": 0.5,
}


def styled(draw: Callable[..., Figure]) -> Callable[..., Figure]:
    """Decorator: `draw` runs under this theme, and matplotlib's settings are restored afterwards.

    Titles and labels of the figure are shown as plain text, never as mathematics, and ticks are round numbers.
    """

    @wraps(draw)
    def wrapped(*args, **kwargs) -> Figure:
        with import_module("matplotlib.style").context(["default", MATPLOTLIB_STYLE]):
            result = draw(*args, **kwargs)
            if isinstance(result, Figure):  # a writer of animations returns a path
                show_as_text(result)
                round_ticks(result)
            return result

    return wrapped


def make_figure(
    shown: str, subject: str, width: float, height: float, layout: FigureLayout | None = "constrained"
) -> Figure:
    """An empty figure of `width` x `height` inches; its title says what is `shown` and of which `subject`."""
    fig = Figure(figsize=(width, height), layout=layout, facecolor="white")
    fig.suptitle(compose_title(shown, subject, width), x=0.01, ha="left", parse_math=False)
    return fig


def compose_title(shown: str, subject: str, width: float) -> str:
    """The title of a picture `width` inches wide, in one or two lines; what is longer is cut.

    >>> compose_title("Heat budget", "run-in", 7.2), compose_title("Heat budget", "a block that slides", 2.0)
    ('Heat budget, run-in', 'Heat budget, a block\\nthat slides')
    """
    text, letters = f"{shown}, {subject}" if subject.strip() else shown, round(TITLE_LETTERS_PER_IN * width)
    lines = text.splitlines()
    rest = 1 if len(lines) > 1 else 2  # a subject in two lines keeps them
    return "\n".join(textwrap.fill(line, letters, max_lines=rest, placeholder=" ...") for line in lines[:2])


def add_caption(figure: Figure, text: str) -> None:
    """Small text below a figure, wrapped to its width; line ends stay."""
    width = round(CAPTION_LETTERS_PER_IN * figure.get_figwidth())
    lines = [textwrap.fill(line, width) for line in text.splitlines()]
    figure.supxlabel("\n".join(lines), x=0.01, ha="left", fontsize=7.0)


def round_ticks(figure: Figure) -> None:
    """Ticks of all linear axes and colour bars in steps of 1, 2 or 5, where matplotlib chose them."""
    from matplotlib.ticker import AutoLocator

    for ax in figure.axes:
        for axis in (ax.xaxis, ax.yaxis):
            locator = axis.get_major_locator()
            if type(locator) is AutoLocator:
                locator.set_params(steps=list(TICK_STEPS))


def round_values(low: float, high: float, max_steps: int = 6) -> np.ndarray:
    """Values in steps of 1, 2 or 5 from the last one below `low` to the first one above `high`.

    >>> round_values(20.0, 47.6).tolist(), round_values(-1.0, 1.0, 4).tolist()
    ([20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0], [-1.0, -0.5, 0.0, 0.5, 1.0])
    """
    from matplotlib.ticker import MaxNLocator

    return np.asarray(MaxNLocator(max_steps, steps=list(TICK_STEPS)).tick_values(low, high))


def add_colour_bar(figure: Any, picture: Any, axes: Any, label: str, **how: Any) -> Any:
    """A colour bar with a thin outline; around zero, it is labelled at its ends, at zero and between them."""
    bar = figure.colorbar(picture, ax=axes, label=label, **how)
    bar.outline.set_linewidth(0.4)
    if bar.norm.vmin == -bar.norm.vmax:
        bar.set_ticks(symmetric_ticks(bar.norm.vmax))
    return bar


def symmetric_ticks(limit: float) -> np.ndarray:
    """Round ticks from -limit to limit, which is a value of `symmetric_limit`.

    >>> symmetric_ticks(0.4).tolist(), symmetric_ticks(5.0).tolist()
    ([-0.4, -0.2, 0.0, 0.2, 0.4], [-5.0, 0.0, 5.0])
    """
    return limit * np.linspace(-1.0, 1.0, 3 if f"{limit:e}".startswith("5") else 5)


def symmetric_limit(value: float) -> float:
    """The smallest 1, 2, 4, 5 or 10 times a power of ten that is at least `value` (> 0).

    >>> symmetric_limit(0.23), symmetric_limit(1.7), symmetric_limit(5.1)
    (0.4, 2.0, 10.0)
    """
    power = 10.0 ** np.floor(np.log10(value))
    step = next(s for s in (1, 2, 4, 5, 10) if s * power >= value * (1 - 1e-9))
    return float(f"{step * power:.6g}")


def save_figure(figure: Figure, path: Path, dpi: int = FIGURE_DPI) -> Path:
    """Write a figure atomically in the format of the suffix of `path`; returns the path."""
    with atomic_write(path) as unfinished:
        figure.savefig(unfinished, dpi=dpi)
    return path


def x_axis_label(run) -> str:
    """Label of the x axis: from the leading edge, or along the block if it also slides back or `run` is None."""
    return "x along the block (mm)" if run is None or run.direction is not None else "x from leading edge (mm)"


def temperature_map() -> ListedColormap:
    """The colour map of all temperatures: perceptually uniform, without the black and white ends."""
    from matplotlib import colormaps

    return ListedColormap(colormaps[TEMPERATURE_MAP_NAME](np.linspace(0.04, 0.97, 256)), name="temperature")


def temperature_norm(*values: np.ndarray) -> Normalize:
    """Colour limits (degC) over all values, at least 1 K wide so that a constant can be drawn."""
    low, high = padded_limits(*values, least=0.0, margin=0.0)
    return Normalize(low, max(high, low + 1.0))


def repetition_colours(count: int) -> np.ndarray:
    """One colour (RGBA) per repetition, from dark to light green-yellow."""
    from matplotlib import colormaps

    return colormaps[REPETITION_MAP_NAME](np.linspace(0.0, 0.88, count))


def padded_limits(*values, least: float, margin: float = 0.05) -> tuple[float, float]:
    """Lowest and highest of all finite values, at least `least` apart, widened by the fraction `margin`."""
    flat = np.concatenate([np.ravel(v) for v in values])
    flat = flat[np.isfinite(flat)]
    low, high = (flat.min(), flat.max()) if len(flat) else (0.0, 0.0)
    widening = max(0.0, least - (high - low))
    low, high = low - 0.5 * widening, high + 0.5 * widening
    extra = margin * (high - low)
    return float(low - extra), float(high + extra)


def format_decimal(value: float, digits: int = 4) -> str:
    """A number for a label, without exponent.

    >>> format_decimal(17504.0, 3), format_decimal(0.0416), format_decimal(35.0)
    ('17500', '0.0416', '35')
    """
    return np.format_float_positional(float(f"{value:.{digits}g}"), trim="-")


def nice_ceil(value: float) -> float:
    """The smallest 1, 2, 3 or 5 times a power of ten that is at least `value` (> 0).

    >>> nice_ceil(0.23), nice_ceil(1.7), nice_ceil(5.1)
    (0.3, 2.0, 10.0)
    """
    power = 10.0 ** np.floor(np.log10(value))
    step = next(s for s in (1, 2, 3, 5, 10) if s * power >= value * (1 - 1e-9))
    return float(f"{step * power:.6g}")


def spread_indices(count: int, max_count: int) -> np.ndarray:
    """At most `max_count` indices spread evenly over range(count), including both ends.

    >>> spread_indices(3, 5).tolist(), spread_indices(9, 3).tolist()
    ([0, 1, 2], [0, 4, 8])
    """
    if count <= max_count:
        return np.arange(count)
    return np.unique(np.linspace(0, count - 1, max_count).round().astype(int))
