"""Overview of a sweep: profiles coloured by the first key, temperature rises, and maps over two keys."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from flashtemp.viz import theme
from flashtemp.viz.key_labels import KeyLabel, describe_condition, describe_key

MAX_CURVES_DRAWN = 9
MAX_NUMBERED_CELLS = 36  # cells; a larger map has no numbers in its cells
EQUAL_VALUES_FRACTION = 1e-6  # relative; smaller differences count as none


@theme.styled
def draw(dataset) -> Figure:
    """Profiles at the end (degC) and temperature rises (K) over the first key; with a second key, maps over both.

    Further keys are fixed at their first value.
    """
    keys = [d for d in dataset.T_max_degC.dims]
    first = dataset.isel({k: 0 for k in keys[1:]})
    words = " and ".join(_coordinate_label(dataset[k]).words for k in keys[:2])
    height = 5.6 if len(keys) > 1 else 3.0
    fig = theme.make_figure(f"Temperature over {words}", dataset.attrs["title"], theme.WIDE_FIGURE_IN, height)
    axes = fig.subplots(2 if len(keys) > 1 else 1, 2, squeeze=False)
    _draw_profiles(axes[0, 0], first, keys[0])
    _draw_rises(axes[0, 1], first, keys[0])
    if len(keys) > 1:
        both = dataset.isel({k: 0 for k in keys[2:]})
        _draw_map(axes[1, 0], both.T_max_degC, keys, f"highest temperature ({theme.CELSIUS})")
        _draw_map(axes[1, 1], both.friction.isel(repetition=-1), keys, "friction, last repetition")
    fixed = describe_condition({k: dataset[k].values[0] for k in keys[1:]}) if keys[1:] else ""
    if fixed:
        theme.add_caption(fig, f"Above: {fixed}.")
    return fig


def _draw_profiles(ax, dataset, key: str) -> None:
    shown = theme.spread_indices(dataset.sizes[key], MAX_CURVES_DRAWN)
    for i, colour in zip(shown, theme.repetition_colours(len(shown)), strict=True):
        one = dataset.isel({key: int(i), "repetition": -1})
        ax.plot(
            dataset.place,
            one.T_spot,
            color=colour,
            label=_coordinate_label(dataset[key]).format_value(dataset[key].values[i]),
        )
    ax.set(
        xlabel="x/L along the block",
        ylabel=f"temperature ({theme.CELSIUS})",
        title="in the contact spots, end of the last repetition",
    )
    ax.legend(title=_coordinate_label(dataset[key]).label, title_fontsize=7.5)


def _draw_rises(ax, dataset, key: str) -> None:
    at, words = _axis_positions(dataset[key])
    for (name, colour), label in zip(theme.PLACE_COLOURS.items(), ("leading", "middle", "trailing"), strict=True):
        ax.plot(at, dataset[f"rise_{label}_K"], "o-", color=colour, ms=3, label=name)
    ax.set(
        xlabel=_coordinate_label(dataset[key]).label,
        ylabel="temperature rise (K)",
        title="surface of the block, end of the last repetition",
    )
    if words:
        ax.set_xticks(at, words)
    elif min(at) > 0 and max(at) > 20 * min(at):
        ax.set(xlim=(0.8 * min(at), 1.25 * max(at)), xscale="log")
    ax.set_ylim(bottom=min(0.0, ax.get_ylim()[0]))
    ax.legend()


def _draw_map(ax, values, keys: list[str], words: str) -> None:
    """A map with cells of equal size labelled by the values, since those of a sweep are rarely evenly spaced."""
    table = values.transpose(keys[0], keys[1]).values
    image = ax.imshow(table.T, origin="lower", aspect="auto", cmap=theme.temperature_map())
    for axis, key in ((ax.xaxis, keys[0]), (ax.yaxis, keys[1])):
        axis.set_ticks(
            range(values.sizes[key]), [_coordinate_label(values[key]).format_value(v) for v in values[key].values]
        )
        axis.set_label_text(_coordinate_label(values[key]).label)
        axis.set_tick_params(length=0)
    ax.spines[:].set_visible(False)
    if table.size <= MAX_NUMBERED_CELLS:
        for (i, j), value in np.ndenumerate(table):
            dark = sum(image.cmap(image.norm(value))[:3]) < 1.5
            ax.text(
                i,
                j,
                theme.format_decimal(value),
                ha="center",
                va="center",
                fontsize=7.5,
                color="white" if dark else "black",
            )
    known = table[np.isfinite(table)]
    if not known.size or np.ptp(known) <= EQUAL_VALUES_FRACTION * np.abs(known).max():
        ax.set_title(words)  # uniform: a colour bar would suggest a range
        return
    theme.add_colour_bar(ax.figure, image, ax, words, pad=0.02, aspect=25)


def _axis_positions(coordinate) -> tuple[np.ndarray, list[str]]:
    """Positions on an axis, and labels for values that are not numbers."""
    if np.issubdtype(coordinate.dtype, np.number):
        return _coordinate_label(coordinate).factor * coordinate.values, []
    return np.arange(coordinate.size), [str(v) for v in coordinate.values]


def _coordinate_label(coordinate) -> KeyLabel:
    return describe_key(str(coordinate.name), coordinate.attrs.get("units", "1"))
