"""Missing interface heat flux and the corresponding pressure along the contact, with 95 % bands."""

from __future__ import annotations

import textwrap

import numpy as np
from matplotlib.figure import Figure

from flashtemp.viz import theme
from flashtemp.viz.literal_text import escape_mathematics
from flashtemp.viz.verdict import plot_helpers
from flashtemp.viz.verdict.residual_images import FIRST_REPETITION_COLOUR, LAST_REPETITION_COLOUR

MIN_RESOLUTION = 0.2  # fraction of a local change that the data resolve; below it nothing is claimed
SIGMA_95 = 1.96
FLUX_ROW_IN = 2.0  # inches
MIN_SPAN = 0.01  # kW/m2, or fraction of the pressure: smallest range of an axis
UNRESOLVED_COLOUR = "#DDDDDD"


def select_conditions(verdict) -> list:
    """At most four conditions, those with the most significant missing flux."""

    def significance(m) -> float:
        known = np.atleast_1d(m.resolution) >= MIN_RESOLUTION
        flux, sd = np.atleast_2d(m.flux)[:, known], np.atleast_2d(m.flux_sd)[:, known]
        return float(np.max(np.abs(flux) / np.maximum(sd, 1e-30), initial=0.0))

    order = sorted(range(len(verdict.missing)), key=lambda i: -significance(verdict.missing[i]))
    return [verdict.missing[i] for i in sorted(order[: plot_helpers.MAX_CONDITIONS_DRAWN])]


@theme.styled
def draw(verdict) -> Figure:
    """Missing flux (kW/m2 of nominal area) of the first and last repetition and p(x)/p, with 95 % bands, per condition.

    Grey where the data resolve less than 0.2 of a local change.
    """
    conditions = select_conditions(verdict)
    fig = plot_helpers.make_verdict_figure(
        verdict,
        plot_helpers.picture_heading(verdict, "missing"),
        plot_helpers.VERDICT_WIDTH_IN,
        0.8 + FLUX_ROW_IN * len(conditions),
    )
    axes = fig.subplots(len(conditions), 2, squeeze=False, sharex="row")
    for row, m in zip(axes, conditions, strict=True):
        x = 1e3 * np.asarray(m.x)
        _draw_bands(row[0], x, 1e-3 * m.flux, 1e-3 * m.flux_sd, m.repetition)
        row[0].axhline(0.0, color=theme.AMBIENT_COLOUR, lw=0.6)
        row[0].set_ylabel("missing flux q′ (kW/m²)")
        condition = textwrap.fill(plot_helpers.reword_condition(m.condition), 60)
        row[0].set_title(escape_mathematics(condition), weight="bold")
        _draw_bands(row[1], x, m.pressure, m.pressure_sd, m.repetition)
        row[1].axhline(1.0, color=theme.AMBIENT_COLOUR, lw=0.6)
        row[1].set_ylabel("pressure p(x)/p (–)")
        for ax in row:
            _shade_unresolved(ax, x, np.asarray(m.resolution))
            ax.set_xlim(x[0], x[-1])
    for ax in axes[-1]:
        ax.set_xlabel("x from the edge that leads forward (mm)")
    for ax in axes[0]:
        if ax.get_legend_handles_labels()[0]:
            ax.legend(loc="best")
    theme.add_caption(fig, f"Bands: 95 %. Grey: the data resolve less than {MIN_RESOLUTION:g} of a local change.")
    return fig


def _draw_bands(ax, x, values, error, repetition) -> None:
    """The first and the last of the curves (n, x) with their 95 % bands, or the only one."""
    values, error = np.atleast_2d(values), np.atleast_2d(error)
    numbers = np.atleast_1d(repetition)
    several = len(values) > 1
    for i, colour in zip(
        [0, len(values) - 1][: 1 + several], (FIRST_REPETITION_COLOUR, LAST_REPETITION_COLOUR), strict=False
    ):
        colour = colour if several else theme.SPOT_COLOUR
        label = f"repetition {numbers[i]}" if several and i < len(numbers) else None
        ax.fill_between(
            x, values[i] - SIGMA_95 * error[i], values[i] + SIGMA_95 * error[i], color=colour, alpha=0.2, lw=0
        )
        ax.plot(x, values[i], color=colour, label=label)
    resolved = [values, values - SIGMA_95 * error, values + SIGMA_95 * error]
    ax.set_ylim(theme.padded_limits(*resolved, least=MIN_SPAN, margin=0.06))


def _shade_unresolved(ax, x, resolution) -> None:
    """Grey where the data do not resolve a local change."""
    unknown = resolution < MIN_RESOLUTION
    middles = 0.5 * (x[1:] + x[:-1])
    limits = np.concatenate([x[:1], middles, x[-1:]])
    for i in np.flatnonzero(unknown):
        ax.axvspan(limits[i], limits[i + 1], color=UNRESOLVED_COLOUR, lw=0, zorder=0)
