"""Evidence for each candidate, and alternatives: scores, amplitudes, correlations and nuisance parameters."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator, NullLocator

from flashtemp.discovery.criteria import CRITERIA
from flashtemp.discovery.hypotheses.piecewise_linear_law import LEARNED_LAW_NAME
from flashtemp.viz import theme
from flashtemp.viz.literal_text import escape_mathematics
from flashtemp.viz.measurement.residual_plots import BAND_COLOUR
from flashtemp.viz.number_format import format_number
from flashtemp.viz.verdict import plot_helpers

LN_BAYES_ALARM = CRITERIA.ln_bayes_named  # above it a cause is named, for each of its effects
LN_BAYES_LINEAR_AXIS = 10.0  # ln Bayes factor up to which the axis is linear
ACCEPTED_COLOUR, AMBIGUOUS_COLOUR, REJECTED_COLOUR = theme.BLOCK_COLOUR, theme.HOLDER_COLOUR, "#B4B4B4"
BAR_HEIGHT_IN = 0.185  # inches
MIN_PRINTED_CORRELATION = 0.6  # smaller correlations are drawn without a number
MAX_NUISANCES_DRAWN = 24  # also: effects in the matrix whose cells still have room for numbers
SIGMA_95 = 1.96
COMMON_VALUE_COLOUR = theme.BLUE


def ranked_scores(verdict) -> list[tuple[str, float, str, bool]]:
    """(effect, ln Bayes factor, colour, whether refitted) of all candidates that were tried, best first."""
    accepted = {c.effect for c in verdict.causes}
    out = [(c.effect, c.ln_bayes, ACCEPTED_COLOUR, True) for c in verdict.causes]
    for r in verdict.rivals:
        if r.effect not in accepted and (r.refitted or r.stderr > 0):  # without an error it was not tried
            colour = AMBIGUOUS_COLOUR if r.effect in verdict.group else REJECTED_COLOUR
            out.append((r.effect, r.score, colour, r.refitted))
    return sorted((s for s in out if np.isfinite(s[1])), key=lambda s: -s[1])


@theme.styled
def draw_scores(verdict) -> Figure:
    """ln Bayes factors of all candidates, linear to 10 and logarithmic beyond, and amplitudes per condition."""
    bars = ranked_scores(verdict)
    causes = [c for c in verdict.causes if c.per_condition and c.parameters][:3]
    lines = sum(len(c.per_condition) + 4 for c in causes)
    height = 1.2 + max(BAR_HEIGHT_IN * len(bars), 0.2 * lines)
    fig = plot_helpers.make_verdict_figure(
        verdict, plot_helpers.picture_heading(verdict, "why"), plot_helpers.VERDICT_WIDTH_IN, max(height, 2.2)
    )
    grid = fig.add_gridspec(1, 2 if causes else 1, width_ratios=[1.25, 1.0] if causes else None)
    _draw_bars(fig.add_subplot(grid[0, 0]), bars, verdict)
    if causes:
        heights = [len(c.per_condition) + 2 for c in causes]
        spare = max(0.7 * len(bars) - sum(heights), 0.01)
        inner = grid[0, 1].subgridspec(len(causes) + 1, 1, height_ratios=[*heights, spare])
        for i, cause in enumerate(causes):
            _draw_amplitudes(fig.add_subplot(inner[i, 0]), cause)
    return fig


def _draw_bars(ax, bars: list, verdict) -> None:
    """One bar per candidate with its number; hatched where it was scored by its sensitivities alone."""
    values = np.array([v for _, v, _, _ in bars])
    at = np.arange(len(bars))
    low, high = min(values.min(), 0.0), max(values.max(), 2 * LN_BAYES_ALARM)
    ax.set_xscale("symlog", linthresh=LN_BAYES_LINEAR_AXIS, linscale=1.4)
    for i, (_, value, colour, refitted) in enumerate(bars):
        ax.barh(
            i, value, 0.72, color=colour if refitted else "white", ec=colour, lw=0.6, hatch="" if refitted else "//////"
        )
        ax.annotate(
            (f"{value:.0f}" if abs(value) >= 10 else f"{value:.1f}").replace("-", "−"), (max(value, 0.0), i), (3, 0),
            textcoords="offset points", va="center", fontsize=6.5,
        )  # fmt: skip
    ax.axvline(0.0, color=theme.AMBIENT_COLOUR, lw=0.6)
    ax.axvline(LN_BAYES_ALARM, color=theme.SPOT_COLOUR, lw=1.0, ls="--")
    ax.set_yticks(at, [plot_helpers.plot_label(n) for n, *_ in bars], fontsize=7.0)
    ax.set_ylim(len(bars) - 0.4, -0.6)
    ax.set_xlim(-_padded_end(-low) if low < 0 else -1.0, _padded_end(high))
    ticks = [s * t for t in (3, 10, 100, 1000, 1e4, 1e5, 1e6) for s in (1, -1)] + [0]
    ax.xaxis.set_major_locator(FixedLocator(sorted(ticks)))
    ax.xaxis.set_minor_locator(NullLocator())
    ax.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:.0f}".replace("-", "−")))
    ax.set_xlabel("ln Bayes factor against the base (–), logarithmic beyond ±10")
    kinds = {c: r for _, _, c, r in bars}
    items = [
        Patch(color=colour, label=label)
        for colour, label in (
            (ACCEPTED_COLOUR, "accepted"),
            (AMBIGUOUS_COLOUR, "not distinguishable"),
            (REJECTED_COLOUR, "not accepted"),
        )
        if colour in kinds
    ]
    if not all(r for *_, r in bars):
        items.append(
            Patch(fc="white", ec=theme.AMBIENT_COLOUR, hatch="//////", lw=0.6, label="scored by sensitivities only")
        )
    items.append(ax.lines[-1])
    ax.lines[-1].set_label(f"alarm level {LN_BAYES_ALARM:g}")
    ax.legend(handles=items, loc="lower right", frameon=True, framealpha=0.9, edgecolor="none")


def _padded_end(value: float) -> float:
    """The end of the axis, with room for a number next to the bar."""
    return value * 3.5 if value > LN_BAYES_LINEAR_AXIS else value + 6.0


def _draw_amplitudes(ax, cause) -> None:
    """The first parameter of a cause fitted to each condition alone, over the common value and its 95 % band.

    Of a learned law: the factor that each condition alone would give the whole law.
    """
    common, estimates = cause.parameters[0], cause.per_condition
    is_law = cause.effect == LEARNED_LAW_NAME
    at = np.arange(len(estimates))
    if not is_law:
        ax.axvspan(*common.ci95, color=BAND_COLOUR, lw=0)
    ax.axvline(1.0 if is_law else common.value, color=COMMON_VALUE_COLOUR, lw=1.0)
    for i, e in enumerate(estimates):
        ax.errorbar(
            e.value, i, xerr=SIGMA_95 * e.stderr, fmt="o", ms=3.5, color=theme.SLIDING_COLOUR, lw=1.0, capsize=2
        )
    words = [
        "\n".join(plot_helpers.wrap_label(part, 26) for part in plot_helpers.reword_condition(e.condition).split(", "))
        for e in estimates
    ]
    ax.set_yticks(at, words, fontsize=7.0)
    ax.set_ylim(len(estimates) - 0.4, -0.6)
    values = [e.value + s * SIGMA_95 * e.stderr for e in estimates for s in (1, -1)]
    ax.set_xlim(theme.padded_limits(values, [1.0] if is_law else [*common.ci95], least=1e-12, margin=0.08))
    unit = "–" if is_law or common.unit == "1" else escape_mathematics(common.unit)
    ax.set_xlabel(f"{'factor on the whole law' if is_law else plot_helpers.plot_label(common.name)} ({unit})")
    # aligned right, where a long title has the room of the labels
    scatter = f"probability of such scatter: {format_number(100 * cause.consistent)} %"
    ax.set_title(f"each condition alone\n{scatter}", loc="right")


# --- alternative explanations -----------------------------------------------------------------------
@theme.styled
def draw_alternatives(verdict) -> Figure:
    """Correlations between projected signatures, and deviations of nuisance parameters from their priors (sigma)."""
    both = verdict.separability is not None and bool(verdict.nuisance)
    names = verdict.separability[0] if verdict.separability is not None else ()
    pulls = sorted(verdict.nuisance, key=lambda p: -abs(p.pull))[:MAX_NUISANCES_DRAWN]
    height = 1.4 + max(0.2 * len(names) if names else 0.0, 0.17 * len(pulls), 1.4)
    fig = plot_helpers.make_verdict_figure(
        verdict, plot_helpers.picture_heading(verdict, "else"), plot_helpers.VERDICT_WIDTH_IN, height
    )
    grid = fig.add_gridspec(1, 1 + both, width_ratios=[1.2, 1.0] if both else None)
    if names:
        _draw_correlations(fig, fig.add_subplot(grid[0, 0]), verdict)
    if pulls:
        spare = max(1.1 * len(names) - len(pulls), 0.01)
        place = grid[0, -1].subgridspec(2, 1, height_ratios=[len(pulls) + 2, spare])[0]
        _draw_deviations(fig.add_subplot(place), pulls, len(verdict.nuisance))
    return fig


def _draw_correlations(fig, ax, verdict) -> None:
    """The lower half of the matrix; numbers from 0.6, accepted causes in bold."""
    names, matrix = verdict.separability
    n = len(names)
    values = np.ma.masked_where(np.triu(np.ones((n, n), bool), 1), np.asarray(matrix, float))
    picture = ax.imshow(values, cmap="RdBu_r", vmin=-1, vmax=1, aspect="auto")
    ax.set_xticks(range(n), [plot_helpers.plot_label(i) for i in names], rotation=90, fontsize=6.5)
    ax.set_yticks(range(n), [plot_helpers.plot_label(i) for i in names], fontsize=6.5)
    ax.tick_params(length=0)
    ax.spines[:].set_visible(False)
    emphasised = {c.effect for c in verdict.causes} | set(verdict.group)
    for label, key in [*zip(ax.get_xticklabels(), names, strict=True), *zip(ax.get_yticklabels(), names, strict=True)]:
        label.set_weight("bold" if key in emphasised else "normal")
    if n <= MAX_NUISANCES_DRAWN:
        for i in range(n):
            for j in range(i):
                if abs(matrix[i][j]) >= MIN_PRINTED_CORRELATION:
                    ax.text(j, i, f"{matrix[i][j]:.1f}".replace("-", "−"), ha="center", va="center", fontsize=5.5)
    ax.set_title("similarity of two effects after calibration")
    theme.add_colour_bar(fig, picture, ax, "correlation (–)", aspect=30, pad=0.01, fraction=0.03)


def _draw_deviations(ax, pulls: list, total: int) -> None:
    """Nuisance parameters in standard deviations of their priors."""
    at, values = np.arange(len(pulls)), np.array([p.pull for p in pulls])
    ax.axvspan(-1, 1, color=BAND_COLOUR, lw=0)
    for x in (-3, 3):
        ax.axvline(x, color=theme.SPOT_COLOUR, lw=0.9, ls="--")
    ax.axvline(0, color=theme.AMBIENT_COLOUR, lw=0.6)
    far = np.abs(values) > 3
    ax.plot(values[~far], at[~far], "o", ms=3.5, color=theme.SLIDING_COLOUR)
    ax.plot(values[far], at[far], "D", ms=4.0, color=theme.SPOT_COLOUR)
    ax.set_yticks(at, [plot_helpers.plot_label(p.name) for p in pulls], fontsize=6.5)
    ax.set_ylim(len(pulls) - 0.4, -0.6)
    reach = 1.1 * max(3.6, float(np.abs(values).max()))
    ax.set_xlim(-reach, reach)
    ax.set_xlabel("deviation from\nthe prior (sigma)")
    ax.xaxis.set_major_locator(MaxNLocator(7, integer=True))
    ax.set_title(f"nuisance parameters{f', {len(pulls)} of {total}' if total > len(pulls) else ''}", loc="right")
