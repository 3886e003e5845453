"""Measured, computed and their difference as images, and T(x) near the contact with both models.

Temperatures in degC, differences in K (measured minus computed by the calibrated base); grey: not compared.
"""

from __future__ import annotations

import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import ScaledTranslation
from scipy.ndimage import uniform_filter

from flashtemp.viz import theme
from flashtemp.viz.measurement import point_series
from flashtemp.viz.measurement.residual_plots import BAND_SIGMA, VIEW_LABELS, draw_residuals, pixel_edges
from flashtemp.viz.verdict import plot_helpers

MASKED_COLOUR = "#A9A9A9"
DIFFERENCE_MAP = "RdBu_r"
CONTOUR_SIGMA = 3.0  # sigma
SMOOTHING_PX = 3  # pixels along a side, averaged before the contour
IMAGE_ROW_IN, VIEW_MARGIN_IN = 1.12, 0.95  # inches of a row, and around all rows of a view
UPWARD_LABELS = {"sidewall": "z (mm)", "wake": "y (mm)"}
COLUMN_TITLES = ("measured", "computed (base)", "measured − computed")
COLOUR_BAR_STEPS = 6  # steps of a colour bar of temperatures
TICK_SLACK_STEPS = 0.25  # steps by which a round tick may exceed the end of a colour bar
FIRST_REPETITION_COLOUR, LAST_REPETITION_COLOUR = theme.BLUE, theme.VERMILION


@theme.styled
def draw(verdict) -> Figure:
    """Images (degC) at the largest difference (K), their contour at 3 sigma, and T(x) of the first and last repetition.

    One scale of colour for all side walls and one for all wakes; at most four conditions.
    """
    views = plot_helpers.group_by_view(plot_helpers.select_recordings(verdict))
    heights = [IMAGE_ROW_IN * len(pairs) + VIEW_MARGIN_IN for pairs in views.values()]
    fig = plot_helpers.make_verdict_figure(
        verdict,
        plot_helpers.picture_heading(verdict, "what_is_wrong"),
        plot_helpers.VERDICT_WIDTH_IN,
        0.3 + sum(heights),
    )
    parts = fig.subfigures(len(views), 1, height_ratios=heights, squeeze=False)[:, 0]
    for part, (view, pairs) in zip(parts, views.items(), strict=True):
        if view == "points":
            point_series.draw_residual_panel(
                part, [p for g in plot_helpers.group_recordings(verdict) for p in g if p.recording.view == view]
            )
        else:
            _draw_profiles(part, pairs) if view == "profile" else _draw_images(part, view, pairs)
    return fig


def _draw_images(part, view: str, pairs: list) -> None:
    """All rows of one view with their colour bars."""
    part.suptitle(VIEW_LABELS[view], x=0.01, ha="left", fontsize=8.5)
    axes = part.subplots(len(pairs), 4, squeeze=False, width_ratios=[1, 1, 1, 1.15])
    frames = [_select_frame(p.before) for p in pairs]
    heat, off = _colour_norms(pairs, frames)
    for row, pair, k in zip(axes, pairs, frames, strict=True):
        good = np.isfinite(pair.before.residual[k])
        stack = [pair.recording.temperature[k], pair.before.predicted[k], pair.before.residual[k]]
        for ax, values, norm in zip(row, stack, (heat, heat, off), strict=False):
            draw_image(ax, pair.before, np.where(good, values, np.nan), norm, _colour_map(norm))
        _draw_contour(row[2], pair.before, k)
        _label_row(row[0], pair, k)
        row[0].set_ylabel(UPWARD_LABELS[view])
        draw_profile_curves(row[3], pair)
    for ax, words in zip(axes[0], COLUMN_TITLES, strict=False):
        ax.set_title(words, weight="bold")
    for ax in axes[:, 1:3].ravel():
        ax.tick_params(labelleft=False)
    for ax in axes[:-1].ravel():
        ax.tick_params(labelbottom=False)
    for ax in axes[-1]:
        ax.set_xlabel("x (mm)")
    for columns, picture, label in (
        (axes[:, :2], axes[0, 0].images[0], f"temperature ({theme.CELSIUS})"),
        (axes[:, 2], axes[0, 2].images[0], "difference (K)"),
    ):
        extend = _colour_bar_arrows([ax.images[0] for ax in np.ravel(columns)])
        how = {"location": "bottom", "aspect": 25, "pad": 0.02, "extend": extend}
        theme.add_colour_bar(part, picture, columns, label, **how).set_ticks(_inner_ticks(picture.norm))
    add_profile_legend(axes[-1, 3], pairs).set_in_layout(False)  # it is next to the colour bars


def _draw_profiles(part, pairs: list) -> None:
    """Profiles have no images: the difference with the band of noise of one pixel, and T(x)."""
    part.suptitle(VIEW_LABELS["profile"], x=0.01, ha="left", fontsize=8.5)
    grid = part.add_gridspec(len(pairs), 2, width_ratios=[1.6, 1.0])
    for i, pair in enumerate(pairs):
        left, right = part.add_subplot(grid[i, 0]), part.add_subplot(grid[i, 1])
        k, noise = _select_frame(pair.before), pair.before.noise
        x = 1e3 * pair.recording.u
        half = np.full(len(x), BAND_SIGMA * np.hypot(noise.white, noise.pattern))
        draw_residuals(left, x, pair.before.residual[k, 0], half)
        left.set_ylabel("measured −\ncomputed (K)")
        _label_row(left, pair, k)
        draw_profile_curves(right, pair)
    for ax in (left, right):
        ax.set_xlabel("x (mm)")
    add_profile_legend(right, pairs)


def _select_frame(result) -> int:
    """The frame of the largest difference; the hottest where no difference exceeds the noise."""
    time = result.view.recording.time
    if not plot_helpers.exceeds_noise(result):
        return plot_helpers.hottest_frame(result, np.arange(len(time)))
    return int(np.argmin(np.abs(time - result.largest.time)))


def _colour_norms(pairs: list, frames: list[int]) -> tuple[Normalize, Normalize]:
    """Colour limits of all temperatures and of all differences, the latter centred at zero."""
    temperatures, largest = [np.zeros(0)], 0.0
    for pair, k in zip(pairs, frames, strict=True):
        off = pair.before.residual[k]
        good = np.isfinite(off)
        if good.any():
            measured = pair.recording.temperature[k][good]
            # percentiles: a single bad pixel must not stretch the colours
            temperatures += [np.percentile(measured, (0.5, 99.5)), pair.before.predicted[k][good]]
            largest = max(largest, 3.0 * pair.before.noise.white, float(np.percentile(np.abs(off[good]), 99.5)))
    limit = theme.symmetric_limit(largest) if largest > 0 else 1.0
    ends = _round_ticks(theme.temperature_norm(*temperatures))
    return Normalize(ends[0], ends[-1]), Normalize(-limit, limit)


def _round_ticks(norm) -> np.ndarray:
    """Round numbers from one end of a colour bar to the other, or a little beyond it."""
    if norm.vmin == -norm.vmax:
        return theme.symmetric_ticks(norm.vmax)
    ticks = theme.round_values(norm.vmin, norm.vmax, COLOUR_BAR_STEPS)
    slack = TICK_SLACK_STEPS * (ticks[1] - ticks[0])
    return ticks[int(ticks[1] - norm.vmin < slack) : len(ticks) - int(norm.vmax - ticks[-2] < slack)]


def _inner_ticks(norm) -> np.ndarray:
    """The round ticks inside the limits: a tick outside would stretch the bar beyond its colours."""
    ticks, tolerance = _round_ticks(norm), 1e-9 * (norm.vmax - norm.vmin)
    return ticks[(ticks >= norm.vmin - tolerance) & (ticks <= norm.vmax + tolerance)]


def _colour_map(norm):
    """The colour map of differences where the limits are symmetric, else that of temperatures."""
    return DIFFERENCE_MAP if norm.vmin == -norm.vmax else theme.temperature_map()


def draw_image(ax, result, values: np.ndarray, norm, cmap) -> None:
    """One image that fills its axes, cropped to the compared pixels."""
    r = result.view.recording
    u, v = pixel_edges(r.u), pixel_edges(r.v)
    ax.set_facecolor(MASKED_COLOUR)
    ax.imshow(
        np.ma.masked_invalid(values), origin="lower", extent=(u[0], u[-1], v[0], v[-1]), aspect="auto",
        cmap=cmap, norm=norm, interpolation="nearest",
    )  # fmt: skip
    compared = np.isfinite(result.residual).any(axis=0)
    across, up = np.flatnonzero(compared.any(axis=0)), np.flatnonzero(compared.any(axis=1))
    if len(across):
        ax.set(xlim=(u[across[0]], u[across[-1] + 1]), ylim=(v[up[0]], v[up[-1] + 1]))
    ax.xaxis.set_major_locator(MaxNLocator(4, steps=list(theme.TICK_STEPS)))
    ax.yaxis.set_major_locator(MaxNLocator(3, steps=list(theme.TICK_STEPS)))


def _draw_contour(ax, result, k: int) -> None:
    """A contour around differences beyond 3 sigma, in means of 3 x 3 pixels so that noise gives few."""
    r, noise = result.view.recording, np.hypot(result.noise.white, result.noise.pattern)
    good = np.isfinite(result.residual[k])
    if min(good.shape) < 2:
        return
    weight = uniform_filter(good.astype(float), SMOOTHING_PX, mode="constant")
    total = uniform_filter(np.where(good, result.residual[k], 0.0), SMOOTHING_PX, mode="constant")
    sigma = np.where(good, np.abs(total) / np.sqrt(np.maximum(weight, 1e-9)) * SMOOTHING_PX / noise, 0.0)
    if sigma.max() > CONTOUR_SIGMA > sigma.min():
        ax.contour(1e3 * r.u, 1e3 * r.v, sigma, [CONTOUR_SIGMA], colors="black", linewidths=0.8)


def _label_row(ax, pair, k: int) -> None:
    """Condition, repetition and time at the left of a row."""
    r, view = pair.recording, pair.before.view
    lines = [*(plot_helpers.wrap_label(part) for part in pair.words.split(", ")), f"repetition {r.repetition[k]}"]
    lines += [f"t = {theme.format_decimal(r.time[k])} s", *(["held out"] if view.held_out else [])]
    plot_helpers.add_row_label(ax, "\n".join(lines))


def _colour_bar_arrows(pictures: list) -> str:
    """Which ends of a colour bar get an arrow because values exceed its limits."""
    norm = pictures[0].norm
    below = any(bool((p.get_array() < norm.vmin).any()) for p in pictures)
    above = any(bool((p.get_array() > norm.vmax).any()) for p in pictures)
    return {(0, 0): "neither", (1, 0): "min", (0, 1): "max", (1, 1): "both"}[below, above]


# --- T(x) -------------------------------------------------------------------------------------------
def draw_profile_curves(ax, pair) -> None:
    """T(x) (degC) of the first and last repetition: measured dots, base dashed, extended solid."""
    x = 1e3 * pair.recording.u
    for (_, k), colour in zip(
        plot_helpers.repetition_frames(pair.before).items(),
        (FIRST_REPETITION_COLOUR, LAST_REPETITION_COLOUR),
        strict=False,
    ):
        measured = plot_helpers.row_mean_profile(pair.before, pair.recording.temperature, k)
        ax.plot(x, measured, "o", color=colour, ms=2.2, mew=0, alpha=0.75)
        ax.plot(x, plot_helpers.row_mean_profile(pair.before, pair.before.predicted, k), "--", color=colour, lw=1.0)
        if pair.after is not None:
            ax.plot(x, plot_helpers.row_mean_profile(pair.before, pair.after.predicted, k), "-", color=colour, lw=1.0)
    ax.set_ylabel(f"T ({theme.CELSIUS})")
    ax.set_title(plot_helpers.describe_rows(pair.before), fontsize=7.0, pad=3)
    ax.xaxis.set_major_locator(MaxNLocator(4, steps=list(theme.TICK_STEPS)))
    ax.yaxis.set_major_locator(MaxNLocator(4, steps=list(theme.TICK_STEPS)))
    ax.grid(lw=0.3, color=theme.WAITING_COLOUR)


def add_profile_legend(ax, pairs: list):
    """The legend of T(x), below the lowest of its panels."""
    style = {"color": theme.AMBIENT_COLOUR, "lw": 1.0}
    items = [
        Line2D([], [], color=theme.AMBIENT_COLOUR, marker="o", ms=3, lw=0, label="measured"),
        Line2D([], [], ls="--", label="base", **style),
    ]
    if any(p.after is not None for p in pairs):
        items.append(Line2D([], [], label="extended", **style))
    numbers = sorted({n for p in pairs for n in plot_helpers.repetition_frames(p.before)})
    several = any(len(plot_helpers.repetition_frames(p.before)) > 1 for p in pairs)
    items.append(
        Line2D(
            [],
            [],
            color=FIRST_REPETITION_COLOUR,
            lw=3,
            label="first repetition" if several else f"repetition {numbers[0]}",
        )
    )
    if several:
        items.append(Line2D([], [], color=LAST_REPETITION_COLOUR, lw=3, label="last repetition"))
    below = ax.transAxes + ScaledTranslation(0.0, -32 / 72, ax.get_figure(root=True).dpi_scale_trans)
    return ax.legend(
        handles=items, loc="upper center", bbox_to_anchor=(0.45, 0.0), bbox_transform=below, ncols=2, fontsize=6.5,
        borderaxespad=0.0, handlelength=1.8, columnspacing=1.0, labelspacing=0.25,
    )  # fmt: skip
