"""A sweep at a glance: profiles coloured by the swept key, and what becomes of temperature and friction."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from flashtemp.viz import theme
from flashtemp.viz.key_words import Spoken, spoken
from flashtemp.viz.residuals import condition

MOST = 9  # curves
WRITTEN = 36  # cells of a map that hold their number
EVEN = 1e-6  # of a value: what differs less is the same


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
    held = condition({k: found[k].values[0] for k in keys[1:]}) if keys[1:] else ""
    if held:
        fig.supxlabel(f"Above: {held}.", x=0.01, ha="left", fontsize=7.0)
    return fig


def _profiles(ax, found, key: str) -> None:
    shown = theme.chosen(found.sizes[key], MOST)
    for i, colour in zip(shown, theme.repetitions(len(shown)), strict=True):
        one = found.isel({key: int(i), "repetition": -1})
        ax.plot(found.place, one.T_spot, color=colour, label=_spoken(found[key]).value(found[key].values[i]))
    ax.set(xlabel="x/L along the block", ylabel=f"in the spots ({theme.DEGREE})", title="end of the last repetition")
    ax.legend(title=_spoken(found[key]).label, title_fontsize=7.5)


def _numbers(ax, found, key: str) -> None:
    at, words = _axis(found[key])
    for (name, colour), label in zip(theme.PLACES.items(), ("leading", "middle", "trailing"), strict=True):
        ax.plot(at, found[f"rise_{label}_K"], "o-", color=colour, ms=3, label=name)
    ax.set(
        xlabel=_spoken(found[key]).label, ylabel="rise of the block's surface (K)", title="end of the last repetition"
    )
    if words:
        ax.set_xticks(at, words)
    elif min(at) > 0 and max(at) > 20 * min(at):
        ax.set(xlim=(0.8 * min(at), 1.25 * max(at)), xscale="log")
    ax.set_ylim(bottom=min(0.0, ax.get_ylim()[0]))
    ax.legend()


def _map(ax, values, keys: list[str], words: str) -> None:
    """Cells of equal size, labelled by the values: a sweep is seldom even."""
    table = values.transpose(keys[0], keys[1]).values
    image = ax.imshow(table.T, origin="lower", aspect="auto", cmap=theme.temperature_map())
    for axis, key in ((ax.xaxis, keys[0]), (ax.yaxis, keys[1])):
        axis.set_ticks(range(values.sizes[key]), [_spoken(values[key]).value(v) for v in values[key].values])
        axis.set_label_text(_spoken(values[key]).label)
        axis.set_tick_params(length=0)
    ax.spines[:].set_visible(False)
    if table.size <= WRITTEN:
        for (i, j), value in np.ndenumerate(table):
            dark = sum(image.cmap(image.norm(value))[:3]) < 1.5
            ax.text(
                i, j, theme.number(value), ha="center", va="center", fontsize=7.5, color="white" if dark else "black"
            )
    known = table[np.isfinite(table)]
    if not known.size or np.ptp(known) <= EVEN * np.abs(known).max():
        ax.set_title(words)  # one value everywhere: a bar would invent a range
        return
    bar = ax.figure.colorbar(image, ax=ax, label=words, pad=0.02, aspect=25)
    bar.outline.set_linewidth(0.4)


def _axis(coordinate) -> tuple[np.ndarray, list[str]]:
    """Places on an axis, and words for values that are no numbers."""
    if np.issubdtype(coordinate.dtype, np.number):
        return _spoken(coordinate).factor * coordinate.values, []
    return np.arange(coordinate.size), [str(v) for v in coordinate.values]


def _spoken(coordinate) -> Spoken:
    return spoken(str(coordinate.name), coordinate.attrs.get("units", "1"))
