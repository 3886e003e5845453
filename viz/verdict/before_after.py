"""Gain of the extension: differences before and after, parameter changes, and T(x) of left-out recordings."""

from __future__ import annotations

import itertools
import math

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullLocator

from flashtemp.viz import theme
from flashtemp.viz.verdict import plot_helpers
from flashtemp.viz.verdict.residual_images import add_profile_legend, draw_profile_curves

BASE_COLOUR, EXTENDED_COLOUR = theme.VERMILION, theme.BLUE
RMSE_LABELS = (
    ("rmse_K", "all that was fitted"),
    ("mean_map_rmse_K", "means over frames"),
    ("near_contact_rmse_K", "near the contact"),
    ("held_out_rmse_K", "held out"),
)
SIGMA_95 = 1.96
MAX_SHIFTS_DRAWN = 16
TICK_ROOM_FRACTION = 0.13  # of the axis length, for one tick label
MAX_HELD_OUT_DRAWN = 3  # left-out recordings


def rmse_pairs(verdict) -> list[tuple[str, float, float]]:
    """(label, base, extended) of the root mean square differences (K) that are known for both models."""
    if verdict.base is None or verdict.extended is None:
        return []
    pairs = [(words, getattr(verdict.base, key), getattr(verdict.extended, key)) for key, words in RMSE_LABELS]
    return [f for f in pairs if np.isfinite(f[1]) and np.isfinite(f[2]) and min(f[1:]) > 0]


def parameter_shifts(verdict) -> list[tuple[str, float, float]]:
    """(name, change, standard error) of the free parameters, in % of the base value, largest change first."""
    shifts = [(n, 100 * (a - b) / abs(b), 100 * s / abs(b)) for n, b, a, s in verdict.shifts if b]
    return sorted(shifts, key=lambda f: -abs(f[1]))[:MAX_SHIFTS_DRAWN]


def has_changes(verdict) -> bool:
    """Whether there are differences or parameters to compare."""
    return bool(rmse_pairs(verdict) or parameter_shifts(verdict))


@theme.styled
def draw(verdict) -> Figure:
    """Differences (K) before and after, parameter changes (%), and T(x) of left-out recordings."""
    first, second = rmse_pairs(verdict), parameter_shifts(verdict)
    left_out = [
        p for g in plot_helpers.group_recordings(verdict) for p in g if p.before.view.held_out and p.after is not None
    ]
    left_out = [p for p in left_out if p.recording.places is None]  # points have no T(x)
    left_out = sorted(left_out, key=lambda p: -plot_helpers.largest_difference(p))[:MAX_HELD_OUT_DRAWN]
    top = 0.7 + 0.24 * max(len(first), len(second), 4)
    heights = [top, *([2.3] if left_out else [])]
    fig = plot_helpers.make_verdict_figure(
        verdict, plot_helpers.picture_heading(verdict, "gained"), plot_helpers.VERDICT_WIDTH_IN, 0.5 + sum(heights)
    )
    parts = fig.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
    panels = [(d, v) for d, v in ((_draw_dumbbells, first), (_draw_shifts, second)) if v]
    axes = parts[0].subplots(1, len(panels), squeeze=False)[0]
    for ax, (draw_one, values) in zip(axes, panels, strict=True):
        draw_one(ax, values)
    if left_out:
        _draw_held_out(parts[1], left_out)
    return fig


def _draw_dumbbells(ax, values: list) -> None:
    """Each difference before and after on a logarithmic axis, with its numbers."""
    for i, (_, before, after) in enumerate(values):
        ax.plot([before, after], [i, i], color=theme.WAITING_COLOUR, lw=3, zorder=1)
        ax.plot(before, i, "s", ms=5, color=BASE_COLOUR, label="base" if not i else None)
        ax.plot(after, i, "o", ms=5.5, color=EXTENDED_COLOUR, label="extended" if not i else None)
        words = f"{theme.format_decimal(before, 3)} → {theme.format_decimal(after, 3)}"
        ax.annotate(words, (1.0, i), (4, 0), xycoords=("axes fraction", "data"), textcoords="offset points",
                    va="center", fontsize=7.0)  # fmt: skip
    ax.set_xscale("log")
    numbers = np.array([v[1:] for v in values])
    ax.set_xlim(numbers.min() / 1.4, numbers.max() * 1.4)
    ax.xaxis.set_major_formatter(FuncFormatter(lambda v, _: theme.format_decimal(v, 3)))
    ax.set_xticks(_log_ticks(*ax.get_xlim()))
    ax.xaxis.set_minor_locator(NullLocator())
    ax.set_yticks(range(len(values)), [v[0] for v in values])
    ax.set_ylim(len(values) - 0.5, -0.7)
    ax.set_xlabel("root mean square difference (K)")
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, 1.16), ncols=2)


def _log_ticks(low: float, high: float) -> list[float]:
    """Round numbers of a logarithmic axis, as many as there is room for.

    >>> _log_ticks(0.021, 0.14), _log_ticks(0.5, 9000.0)
    ([0.03, 0.05, 0.1], [1.0, 10.0, 100.0, 1000.0])
    """
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    for digits in ((1, 1.5, 2, 3, 4, 5, 7), (1, 2, 3, 5), (1, 2, 5), (1, 3), (1,)):
        ticks = [v for p in powers for d in digits if low <= (v := float(f"{d}e{p}")) <= high]
        if all(b > a * (high / low) ** TICK_ROOM_FRACTION for a, b in itertools.pairwise(ticks)):
            break
    return ticks


def _draw_shifts(ax, values: list) -> None:
    """Changes of the base parameters once the cause is in the model."""
    ax.axvline(0.0, color=theme.AMBIENT_COLOUR, lw=0.6)
    for i, (_, change, error) in enumerate(values):
        ax.errorbar(change, i, xerr=SIGMA_95 * error, fmt="o", ms=4, color=EXTENDED_COLOUR, lw=1.0, capsize=2)
    ax.set_yticks(range(len(values)), [plot_helpers.plot_label(v[0]) for v in values])
    ax.set_ylim(len(values) - 0.5, -0.7)
    reach = [v[1] + s * SIGMA_95 * v[2] for v in values for s in (1, -1)]
    ax.set_xlim(theme.padded_limits(reach, [0.0], least=1.0, margin=0.08))
    ax.set_xlabel("parameter change (%), bars: 95 %")


def _draw_held_out(part, left_out: list) -> None:
    """T(x) of recordings that no fit has used."""
    part.suptitle("recordings left out of the fit", x=0.01, ha="left", fontsize=8.5)
    axes = part.subplots(1, len(left_out), squeeze=False)[0]
    for ax, pair in zip(axes, left_out, strict=True):
        draw_profile_curves(ax, pair)
        ax.set_xlabel("x (mm)")
        ax.set_title(f"{plot_helpers.wrap_label(pair.words, 42)}\n{ax.get_title(loc='left')}", fontsize=7.0)
    add_profile_legend(axes[0], left_out)
