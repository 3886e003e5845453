"""A sweep at a glance: profiles coloured by the swept key, and what becomes of temperature and friction."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from flashtemp.viz import theme

MOST = 9  # curves


@theme.styled
def draw(found) -> Figure:
    """Along the contact at the end (degC) and against the first key; with a second key, maps over both.

    Further keys stay at their first value.
    """
    keys = [d for d in found.T_max_degC.dims]
    first = found.isel({k: 0 for k in keys[1:]})
    fig = theme.figure(found.attrs["title"], theme.WIDE, 5.6 if len(keys) > 1 else 3.0)
    axes = fig.subplots(2 if len(keys) > 1 else 1, 2, squeeze=False)
    _profiles(axes[0, 0], first, keys[0])
    _numbers(axes[0, 1], first, keys[0])
    if len(keys) > 1:
        both = found.isel({k: 0 for k in keys[2:]})
        _map(axes[1, 0], both.T_max_degC, keys, f"highest temperature ({theme.DEGREE})")
        _map(axes[1, 1], both.friction.isel(repetition=-1), keys, "friction, last repetition")
    held = ", ".join(f"{k} = {_word(found[k].values[0])}" for k in keys[1:])
    if held:
        fig.supxlabel(f"Above: {held}.", x=0.01, ha="left", fontsize=7.0)
    return fig


def _profiles(ax, found, key: str) -> None:
    shown = theme.chosen(found.sizes[key], MOST)
    for i, colour in zip(shown, theme.repetitions(len(shown)), strict=True):
        one = found.isel({key: int(i), "repetition": -1})
        ax.plot(found.place, one.T_spot, color=colour, label=_word(found[key].values[i]))
    ax.set(xlabel="x/L from leading edge", ylabel=f"in the spots ({theme.DEGREE})", title="end of the last repetition")
    ax.legend(title=_label(found[key]), title_fontsize=7.5)


def _numbers(ax, found, key: str) -> None:
    at, words = _axis(found[key].values)
    for (name, colour), label in zip(theme.PLACES.items(), ("leading", "middle", "trailing"), strict=True):
        ax.plot(at, found[f"rise_{label}_K"], "o-", color=colour, ms=3, label=name)
    ax.set(xlabel=_label(found[key]), ylabel="rise of the block's surface (K)", title="end of the last repetition")
    if words:
        ax.set_xticks(at, words)
    elif min(at) > 0 and max(at) > 20 * min(at):
        ax.set_xscale("log")
    ax.set_ylim(bottom=min(0.0, ax.get_ylim()[0]))
    ax.legend()


def _map(ax, values, keys: list[str], words: str) -> None:
    """Cells of equal size, labelled by the values: a sweep is seldom even."""
    table = values.transpose(keys[0], keys[1]).values
    image = ax.imshow(table.T, origin="lower", aspect="auto", cmap=theme.temperature_map())
    for axis, key in ((ax.xaxis, keys[0]), (ax.yaxis, keys[1])):
        axis.set_ticks(range(values.sizes[key]), [_word(v) for v in values[key].values])
        axis.set_label_text(_label(values[key]))
        axis.set_tick_params(length=0)
    ax.spines[:].set_visible(False)
    bar = ax.figure.colorbar(image, ax=ax, label=words, pad=0.02, aspect=25)
    bar.outline.set_linewidth(0.4)


def _axis(values) -> tuple[np.ndarray, list[str]]:
    """Places on an axis, and words for those that are no numbers."""
    if np.issubdtype(values.dtype, np.number):
        return values, []
    return np.arange(len(values)), [str(v) for v in values]


def _label(coordinate) -> str:
    unit = coordinate.attrs.get("units", "1")
    return coordinate.name if unit in ("1", "") else f"{coordinate.name} ({unit})"


def _word(value) -> str:
    return f"{value:g}" if isinstance(value, (float, np.floating)) else str(value)
