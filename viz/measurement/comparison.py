"""Measured against computed: images, mean differences along each direction, friction, and an overview.

Temperatures in degC, differences (measured minus computed) in K and in sigma.  Grey: dead or not compared.
"""

from __future__ import annotations

import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import FuncFormatter, MaxNLocator

from flashtemp.viz import theme
from flashtemp.viz.literal_text import escape_mathematics
from flashtemp.viz.measurement import point_series
from flashtemp.viz.measurement.residual_plots import (
    BAND_COLOUR,
    BAND_SIGMA,
    BEYOND_COLOUR,
    COMPUTED_COLOUR,
    MEASURED_COLOUR,
    count_beyond_noise,
    draw_residuals,
    make_recording_figure,
    mean_residual,
    pixel_edges,
    sliding_mask,
)
from flashtemp.viz.time_axis import repetition_axis

COMPARISON_WIDTH_IN = 8.4  # four images side by side
MASKED_COLOUR = "#A9A9A9"
KELVIN_MAP, SIGMA_MAP = "RdBu_r", "PuOr_r"
MAX_COLOUR_SIGMA = 5.0  # sigma at the ends of the colour bar
MARGIN_PX = 2  # pixels drawn around the compared ones
STRUCTURE_SIZE_PX = 5  # side of the square that counts as one structure
MAX_DOTS_DRAWN = 1500  # readings of a load cell
UPWARD_AXES = {
    "sidewall": ("z", "above the interface"),
    "wake": ("y", "from the centre line"),
    "profile": ("", ""),
    "points": ("", ""),
}
IMAGE_TITLES = ("measured", "computed", "measured − computed", "difference in sigma")


# --- images -----------------------------------------------------------------------------------------
def choose_frames(result, run=None) -> dict[int, str]:
    """{frame: reason}: end of sliding of the first and last repetition, and the largest difference.

    Without the `run` of the condition, the frame of a repetition with the hottest prediction.
    """
    r, reasons = result.view.recording, {}
    is_sliding = None if run is None else sliding_mask(r.time, run)
    compared = np.isfinite(result.residual).any(axis=0)
    heat = np.sum(result.predicted, axis=(1, 2), where=compared)
    for number in np.unique(r.repetition)[[0, -1]]:
        frames = np.flatnonzero(r.repetition == number)
        sliding = frames[is_sliding[frames]] if is_sliding is not None else frames[:0]
        if len(sliding):
            reasons[int(sliding[-1])] = "last frame of sliding"
        else:
            reasons[int(frames[np.argmax(heat[frames])])] = "hottest frame"
    if result.largest is not None:
        k = _largest_residual_frame(result)
        reasons[k] = f"{reasons[k]},\nlargest difference" if k in reasons else "largest difference"
    return dict(sorted(reasons.items()))


def _largest_residual_frame(result) -> int:
    """The frame of the largest structured difference."""
    return int(np.argmin(np.abs(result.view.recording.time - result.largest.time)))


@theme.styled
def draw_images(result, run=None, only: bool = False) -> Figure:
    """Measured, computed and their difference in K and in sigma for up to three frames; x, z, y in mm.

    With `only`, the frame of the largest difference alone.  A profile is drawn as lines (degC), with its difference (K)
    and the noise band of one pixel.
    """
    if result.view.recording.places is not None:
        return point_series.draw_points(result)
    chosen = choose_frames(result, run)
    if only:
        worst = _largest_residual_frame(result) if result.largest is not None else max(chosen)
        chosen = {worst: chosen[worst]}
    if result.view.recording.view == "profile":
        return point_series.draw_profile(result, chosen)
    r, shown = result.view.recording, list(chosen)
    u, v = pixel_edges(r.u), pixel_edges(r.v)
    across, up = _compared_limits(result, u, 1), _compared_limits(result, v, 0)
    tall = np.clip((up[1] - up[0]) / (across[1] - across[0]), 0.2, 1.3)
    height = 1.3 + len(shown) * (0.16 + 1.8 * max(tall, 0.28))
    fig = make_recording_figure(
        "Measured and computed temperature", result.view, COMPARISON_WIDTH_IN, height, layout="compressed"
    )
    axes = fig.subplots(len(shown), 4, sharex=True, sharey=True, squeeze=False)
    stacks, norms = _image_columns(result, shown), _colour_norms(result, shown)
    for row, k in enumerate(shown):
        for ax, (cmap, values), norm in zip(axes[row], stacks, norms, strict=True):
            ax.set_facecolor(MASKED_COLOUR)
            ax.imshow(
                np.ma.masked_invalid(values[row]), origin="lower", extent=(u[0], u[-1], v[0], v[-1]), cmap=cmap,
                norm=norm, interpolation="nearest",
            )  # fmt: skip
        words = f"repetition {r.repetition[k]}\nt = {theme.format_decimal(r.time[k])} s\n{chosen[k]}"
        axes[row, 0].annotate(
            words, (0.0, 0.5), (-42, 0), xycoords="axes fraction", textcoords="offset points", ha="right", va="center"
        )
        axes[row, 0].set_ylabel(f"{UPWARD_AXES[r.view][0]} (mm)")
        if result.largest is not None and k == _largest_residual_frame(result):
            _mark_largest(axes[row, 2:], result)
    axes[0, 0].set(xlim=across, ylim=up)
    axes[0, 0].xaxis.set_major_locator(MaxNLocator(4, steps=list(theme.TICK_STEPS)))
    for ax, title in zip(axes[0], IMAGE_TITLES, strict=True):
        ax.set_title(title, weight="bold")
    for ax in axes[-1]:
        ax.set_xlabel("x (mm)")
    _add_colour_bars(fig, axes)
    return fig


def _compared_limits(result, ends: np.ndarray, other: int) -> tuple[float, float]:
    """Limits (mm) of the compared pixels along one direction, with a margin; of all pixels where none is compared."""
    known = np.flatnonzero(np.isfinite(result.residual).any(axis=0).any(axis=1 - other if other == 0 else 0))
    first, last = (known[0], known[-1]) if len(known) else (0, len(ends) - 2)
    return float(ends[max(first - MARGIN_PX, 0)]), float(ends[min(last + 1 + MARGIN_PX, len(ends) - 1)])


def _image_columns(result, shown: list[int]) -> list[tuple]:
    """(colour map, values (rows, nv, nu)) of the four columns, NaN where nothing is compared."""
    compared = np.isfinite(result.residual[shown])
    heat = theme.temperature_map()
    measured = np.where(compared, result.view.recording.temperature[shown], np.nan)
    computed = np.where(compared, result.predicted[shown], np.nan)
    return [
        (heat, measured),
        (heat, computed),
        (KELVIN_MAP, result.residual[shown]),
        (SIGMA_MAP, result.sigma_residual[shown]),
    ]


def _colour_norms(result, shown: list[int]) -> list:
    """Colour limits of the four columns: common ones for the two in degC, differences centred at zero."""
    (_, measured), (_, computed), (_, off), _ = _image_columns(result, shown)
    if not np.isfinite(off).any():
        off, measured, computed = np.zeros(1), np.zeros(1), np.zeros(1)
    usual = np.nanpercentile(measured, (0.5, 99.5))  # a single bad pixel must not stretch the colours
    heat = theme.temperature_norm(usual, computed)
    largest = max(3.0 * result.noise.white, np.nanpercentile(np.abs(off), 99.5))
    if result.largest is not None:
        largest = max(largest, abs(result.largest.K))
    limit = theme.symmetric_limit(largest)
    return [heat, heat, Normalize(-limit, limit), Normalize(-MAX_COLOUR_SIGMA, MAX_COLOUR_SIGMA)]


def _add_colour_bars(fig, axes) -> None:
    """A colour bar below the columns that it describes."""
    pad = 0.16 / fig.get_figheight()
    spans = [
        (axes[:, :2], f"temperature ({theme.CELSIUS})", 40),
        (axes[:, 2], "difference (K)", 20),
        (axes[:, 3], f"sigma, colours end at ±{MAX_COLOUR_SIGMA:g} (–)", 20),
    ]
    for columns, label, aspect in spans:
        shown = [ax.images[0] for ax in columns.ravel()]
        norm = shown[0].norm
        below = any((i.get_array() < norm.vmin).any() for i in shown)
        above = any((i.get_array() > norm.vmax).any() for i in shown)
        extend = {(0, 0): "neither", (1, 0): "min", (0, 1): "max", (1, 1): "both"}[below, above]
        theme.add_colour_bar(
            fig, shown[0], columns, label, aspect=aspect, extend=extend, location="bottom", pad=pad,
            fraction=min(0.12, 0.17 / len(axes)),
        )  # fmt: skip


def _mark_largest(axes, result) -> None:
    """A square around the pixels of the largest structured difference (mm)."""
    r, peak = result.view.recording, result.largest
    du, dv = (STRUCTURE_SIZE_PX * 1e3 * p if np.isfinite(p) else 1.0 for p in r.pitch)
    for ax in axes:
        ax.add_patch(Rectangle((1e3 * peak.u - du / 2, 1e3 * peak.v - dv / 2), du, dv, fill=False, ec="black", lw=0.9))


# --- along x, z, time and repetition ----------------------------------------------------------------
@theme.styled
def draw_mean_residuals(result, run=None) -> Figure:
    """Mean difference (K) along x, z or y (mm), over time (s) and per repetition, with the band of noise alone.

    The band is two standard errors of the mean.  With the `run` of the condition, waits are shaded.
    """
    r, level = result.view.recording, result.noise
    up, where = UPWARD_AXES.get(r.view, ("", ""))
    fig = make_recording_figure("Mean of measured minus computed", result.view, COMPARISON_WIDTH_IN, 5.0)
    grid = fig.add_gridspec(2, 2)
    first = fig.add_subplot(grid[0, 0] if up else grid[0, :])
    _draw_curve(first, 1e3 * r.u, mean_residual(result.residual, level, 2), "along x", theme.x_axis_label(run))
    if up:
        second = fig.add_subplot(grid[0, 1])
        _draw_curve(second, 1e3 * r.v, mean_residual(result.residual, level, 1), f"along {up}", f"{up} {where} (mm)")
    several = len(np.unique(r.repetition)) > 1  # one mean makes no curve
    _draw_over_time(fig.add_subplot(grid[1, 0] if several else grid[1, :]), result, run)
    if several:
        _draw_per_repetition(fig.add_subplot(grid[1, 1]), result)
    fig.supylabel("mean of measured − computed (K)", fontsize=8.0)
    theme.add_caption(fig, "Blue band: two standard errors of the mean due to noise alone. Red: outside.")
    return fig


def _draw_curve(ax, x, means, title: str, label: str) -> None:
    """One direction: `means` (values, standard errors) with the noise band, from the first to the last finite one."""
    values, error = means
    known = np.flatnonzero(np.isfinite(values))
    part = slice(known[0], known[-1] + 1) if len(known) else slice(None)
    draw_residuals(ax, x[part], values[part], BAND_SIGMA * error[part])
    ax.set(xlabel=label)
    ax.set_title(f"{title}: {count_beyond_noise(values, error)}")


def _draw_over_time(ax, result, run) -> None:
    """Mean of every frame over time, waits shaded where the run is known."""
    time = result.view.recording.time
    values, error = mean_residual(result.residual, result.noise, 0)
    if run is None:
        _draw_curve(ax, time, (values, error), "frame by frame", "time (s)")
        return
    axis = repetition_axis(run)
    _draw_curve(ax, axis.to_axis_unit(time), (values, error), "frame by frame", "")
    axis.shade_waits(ax)
    axis.set_axis(ax)
    if axis.waits:
        ax.set_xlabel(f"{ax.get_xlabel()}, grey: waiting")


def _draw_per_repetition(ax, result) -> None:
    """Mean of every repetition."""
    repetition = result.view.recording.repetition
    numbers = np.unique(repetition)
    pairs = [mean_residual(result.residual[repetition == n], result.noise, None) for n in numbers]
    values, error = np.array(pairs).T
    _draw_curve(ax, numbers, (values, error), "repetition by repetition", "repetition (–)")
    ax.xaxis.set_major_locator(MaxNLocator(integer=True, nbins=8))


# --- friction ---------------------------------------------------------------------------------------
@theme.styled
def draw_friction(force_result) -> Figure:
    """Friction coefficient (1) measured and computed over the sliding time (s), and their difference."""
    s, on, starts = sliding_time(force_result)
    mu, computed, off = np.array(force_result.force.mu)[on], force_result.predicted[on], force_result.residual[on]
    fig = make_recording_figure("Measured and computed friction", force_result.force, COMPARISON_WIDTH_IN, 4.2)
    above, below = fig.subplots(2, 1, sharex=True, height_ratios=[1.6, 1.0])
    part, half = slice(None, None, max(1, -(-len(s) // MAX_DOTS_DRAWN))), BAND_SIGMA * force_result.sigma
    above.plot(s[part], mu[part], "o", color=MEASURED_COLOUR, ms=2.2, mew=0, label="measured")
    for n, stretch in enumerate(np.split(np.arange(len(s)), starts)):
        above.plot(s[stretch], computed[stretch], color=COMPUTED_COLOUR, label=None if n else "computed")
    above.set_ylim(theme.padded_limits(mu, computed, least=0.02, margin=0.08))
    above.set_ylabel("friction coefficient (–)")
    above.legend(loc="best", ncols=2)
    below.axhspan(-half, half, color=BAND_COLOUR, lw=0, zorder=0)
    below.axhline(0.0, color=theme.AMBIENT_COLOUR, lw=0.5)
    out = np.abs(off[part]) > half
    for keep, colour in ((~out, theme.AMBIENT_COLOUR), (out, BEYOND_COLOUR)):
        below.plot(s[part][keep], off[part][keep], "o", color=colour, ms=2.2, mew=0)
    below.set_ylim(theme.padded_limits(off, [-half, half], least=1e-6, margin=0.1))
    below.set(xlabel="sliding time (s), without waits", ylabel="measured −\ncomputed (–)")
    for ax in (above, below):
        for k in starts:
            ax.axvline(0.5 * (s[k - 1] + s[k]), color=theme.WAITING_COLOUR, lw=1.2, zorder=0)
        ax.set_xlim(0.0, s[-1] if len(s) and s[-1] > 0 else 1.0)
    note = "Blue band: two standard deviations of the noise of one reading. Red: outside."
    theme.add_caption(fig, note + (" Grey lines: waits." if len(starts) else ""))
    return fig


def sliding_time(force_result) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sliding time (s) of the compared readings, their mask (n,), and the indices where sliding starts again.

    A gap of more than three usual steps is a wait and counts as one step.
    """
    on = np.isfinite(force_result.residual)
    step = np.diff(np.array(force_result.force.time)[on])
    usual = float(np.median(step)) if len(step) else 0.0
    waits = step > 3.0 * usual
    return np.cumsum(np.append(0.0, np.where(waits, usual, step)))[: on.sum()], on, np.flatnonzero(waits) + 1


# --- overview ---------------------------------------------------------------------------------------
@theme.styled
def draw_summary(comparison) -> Figure:
    """RMSE and bias (K; 1 for friction) and chi2/dof of every recording and load-cell file."""
    blocks = [(comparison.recordings, "recordings", "K"), (comparison.forces, "friction", "–")]
    blocks = [b for b in blocks if b[0]]
    rows = [max(len(results), 2) for results, _, _ in blocks]
    height = 0.6 + 0.75 * len(blocks) + 0.26 * sum(rows)
    fig = theme.make_figure(
        "Size of the differences of every recording", comparison.campaign.title, COMPARISON_WIDTH_IN, height
    )
    axes = fig.subplots(len(blocks), 2, squeeze=False, height_ratios=rows, width_ratios=[1.3, 1.0])
    for (left, right), (results, title, unit) in zip(axes, blocks, strict=True):
        _draw_sizes(left, results, title, unit)
        _draw_chi2(right, results)
    reach = np.array([ax.get_xlim() for ax in axes[:, 1]])
    for ax in axes[:, 1]:
        ax.set_xlim(reach[:, 0].min(), reach[:, 1].max())
    axes[0, 0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.1, handletextpad=0.3)
    return fig


def _draw_sizes(ax, results, title: str, unit: str) -> None:
    """Root mean square and mean of the differences of one kind, with the noise of one value."""
    y, kelvin = np.arange(len(results)), unit == "K"
    rms = np.array([s.rmse_K if kelvin else s.rmse for s in results])
    bias = np.array([s.bias_K if kelvin else s.bias for s in results])
    noise = np.array([np.hypot(s.noise.white, s.noise.pattern) if kelvin else s.sigma for s in results])
    ax.axvline(0.0, color=theme.AMBIENT_COLOUR, lw=0.6, zorder=1)
    ax.hlines(y, np.minimum(0.0, bias), rms, color=theme.WAITING_COLOUR, lw=1.0, zorder=1)
    ax.plot(rms, y, "o", color=MEASURED_COLOUR, ms=5.0, label="RMSE")
    ax.plot(bias, y, "D", color=COMPUTED_COLOUR, ms=4.0, label="bias")
    ax.plot(noise, y, "|", color=BEYOND_COLOUR, ms=11.0, mew=1.6, label="noise of one value")
    entries = [s.view if kelvin else s.force for s in results]
    ax.set_yticks(y, [escape_mathematics(e.file)[-40:] + (" (held out)" if e.held_out else "") for e in entries])
    ax.set(ylim=(len(results) - 0.4, -0.6), xlabel=f"measured − computed ({unit})")
    ax.set_title(title, weight="bold")
    ax.tick_params(axis="y", length=0)


def _draw_chi2(ax, results) -> None:
    """chi2/dof, the mean square of the differences in sigma: 1 where noise explains them."""
    y, value = np.arange(len(results)), np.array([s.chi2_per_dof for s in results])
    ax.axvline(1.0, color=COMPUTED_COLOUR, lw=1.2, zorder=1)
    ax.hlines(y, 1.0, value, color=theme.WAITING_COLOUR, lw=1.0, zorder=1)
    ax.plot(value, y, "o", color=MEASURED_COLOUR, ms=5.0)
    for at, v in zip(y, value, strict=True):
        if v > 0:
            ax.annotate(
                theme.format_decimal(v, 3), (v, at), (6, 0), textcoords="offset points", va="center", fontsize=7.5
            )
    known = value[value > 0]
    ax.set_xscale("log")
    ax.xaxis.set_major_formatter(FuncFormatter(lambda v, _: theme.format_decimal(v)))
    ax.set(xlim=(min(0.5, 0.7 * known.min(initial=1.0)), max(3.0, 4.0 * known.max(initial=1.0))))
    ax.set(ylim=(len(results) - 0.4, -0.6), yticks=[], xlabel="chi2/dof (–); blue line: noise explains everything")
