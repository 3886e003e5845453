"""Load dependence of friction by process: curves of each process alone, and the change that each causes."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from flashtemp.viz import theme

PROCESS_COLOURS = {
    "saturation": theme.BLUE, "softening": "#CC79A7", "skewness": theme.HOLDER_COLOUR, "adhesion": theme.BLOCK_COLOUR,
    "heating": theme.SPOT_COLOUR,
}  # fmt: skip
MAX_SPEED_PANELS = 4


@theme.styled
def draw(study) -> Figure:
    """mu over load (MPa) at each speed, the change by each process at each speed, and local slopes."""
    shown = theme.spread_indices(len(study.speed), MAX_SPEED_PANELS)
    fig = theme.make_figure("Friction coefficient over load, by process", study.title, theme.WIDE_FIGURE_IN, 5.4)
    upper, lower = fig.subfigures(2, 1, height_ratios=[1.15, 1.0])
    axes = upper.subplots(1, len(shown), sharey=True, squeeze=False)[0]
    for ax, i in zip(axes, shown, strict=True):
        _draw_curves(ax, study, int(i))
    axes[0].set_ylabel("friction coefficient (–)")
    handles, labels = axes[0].get_legend_handles_labels()
    upper.legend(
        handles,
        labels,
        loc="outside lower center",
        ncols=len(labels),
        fontsize=6.6,
        handlelength=1.5,
        columnspacing=1.2,
    )
    bars, steps = lower.subplots(1, 2, width_ratios=[1.5, 1.0])
    _draw_bars(bars, study)
    _draw_local_slopes(steps, study)
    if len(study.acting) < len(PROCESS_COLOURS):
        words = "Dotted and hollow: not in the case, computed with typical values."
        lower.supxlabel(words, x=0.01, ha="left", fontsize=7.0)
    return fig


def _draw_curves(ax, study, i: int) -> None:
    """mu over load at speed `i`: without processes, each alone, and the case."""
    p = study.pressure / 1e6
    ax.plot(p, study.without_processes[i], color="#B5B5B5", lw=2.4, label="none")
    for name, mu in study.one_process.items():
        style = "o-" if name in study.acting else "o:"  # dotted: not in the case
        ax.plot(p, mu[i], style, ms=2.5, lw=1.1, color=PROCESS_COLOURS[name], label=f"{name} alone")
    ax.plot(p, study.all_processes[i], "ko-", ms=3.5, lw=2.2, label="the case")
    ax.set(xscale="log", xlabel="nominal contact pressure (MPa)", title=f"{study.speed[i]:g} m/s")
    ax.set_xticks(p, [f"{v:g}" for v in p])
    ax.minorticks_off()


def _draw_bars(ax, study) -> None:
    """Change of friction (%) over the loads by each process (Shapley shares), at each speed."""
    shares, alone = study.shapley_shares(), study.lone_changes()
    width = 0.8 / len(shares)
    for k, (name, share) in enumerate(shares.items()):
        at = np.arange(len(study.speed)) + (k - 0.5 * (len(shares) - 1)) * width
        fill = PROCESS_COLOURS[name] if name in study.acting else "white"  # hollow: not in the case
        ax.bar(at, 100 * np.expm1(share), 0.92 * width, color=fill, edgecolor=PROCESS_COLOURS[name], lw=0.8)
        ax.plot(at, 100 * np.expm1(alone[name]), "D", ms=2.8, mfc="white", mec="black", mew=0.6)
    total = 100 * np.expm1(study.log_change(study.all_processes))
    ax.plot(np.arange(len(study.speed)), total, "k_", ms=34, mew=1.8)
    ax.annotate("the case", (0, total[0]), (-18, 3), textcoords="offset points", ha="left", fontsize=7.0)
    ax.axhline(0.0, color="black", lw=0.6)
    ax.set_xticks(np.arange(len(study.speed)), [f"{v:g} m/s" for v in study.speed])
    low, high = study.pressure[[0, -1]] / 1e6
    ax.set(ylabel="change of friction (%)", title=f"change by each from {low:g} to {high:g} MPa; diamonds: alone")


def _draw_local_slopes(ax, study) -> None:
    """d ln mu / d ln p by each process between neighbouring loads, at the highest speed."""
    local = study.stepwise_shares()
    middle = np.sqrt(study.pressure[1:] * study.pressure[:-1]) / 1e6
    for name, share in local.items():
        style = "o-" if name in study.acting else "o:"
        ax.plot(middle, share[-1] / np.diff(np.log(study.pressure)), style, ms=3, color=PROCESS_COLOURS[name])
    ax.axhline(0.0, color="black", lw=0.6)
    ax.set(xscale="log", xlabel="nominal contact pressure (MPa)", ylabel="d ln μ / d ln p (–)")
    ax.set_title(f"between loads at {study.speed[-1]:g} m/s")
    ax.set_xticks(middle, [theme.format_decimal(v, 2) for v in middle])
    ax.minorticks_off()
