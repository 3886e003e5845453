"""Measured against computed: images side by side, differences along every direction, friction, and an overview.

Temperatures in degC, differences in K = measured - computed and in sigma.  Grey pixels are dead or not compared.
"""

from __future__ import annotations

import textwrap

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator

from flashtemp.viz import theme
from flashtemp.viz.clock import clock

WIDTH = 9.6  # inches; four images side by side need more than a column of print
MASKED = "#A9A9A9"
MEASURED, COMPUTED = "#2B2B2B", "#0072B2"
BAND, BEYOND = "#CBDDEA", "#C8420B"
KELVIN_MAP, SIGMA_MAP = "RdBu_r", "PuOr_r"
CLIP = 5.0  # sigma where the colours end
SURE = 2.0  # standard errors: half the width of the bands
MOST = 1500  # dots of a trace that are drawn
UPWARD = {"sidewall": ("z", "above the interface"), "wake": ("y", "from the centre line"), "profile": ("", "")}
VIEWS = {"sidewall": "side wall", "wake": "wake on the road", "profile": "profile along the block"}


# --- what is shown ---
def frames(seeing, run=None) -> dict[int, str]:
    """Frames worth a picture and why: end of sliding of the first and last repetition, largest difference.

    Without the `run` of the condition, the frame of a repetition that is computed to be hottest.
    """
    r, why = seeing.view.recording, {}
    on = np.full(r.frames, True) if run is None else sliding(r.time, run)
    heat = np.nanmean(np.where(np.isfinite(seeing.residual).any(axis=0), seeing.predicted, np.nan), axis=(1, 2))
    for number in np.unique(r.repetition)[[0, -1]]:
        own = np.flatnonzero(r.repetition == number)
        slid = own[on[own]]
        if run is not None and len(slid):
            why[int(slid[-1])] = ["last while sliding"]
        else:
            why[int(own[np.argmax(heat[own])])] = ["hottest"]
    if seeing.largest is not None:
        why.setdefault(_frame(seeing), []).append("largest difference")
    return {k: ",\n".join(why[k]) for k in sorted(why)}


def _frame(seeing) -> int:
    """The frame of the largest structured residual."""
    return int(np.argmin(np.abs(seeing.view.recording.time - seeing.largest.time)))


# --- images ---
@theme.styled
def images(seeing, run=None) -> Figure:
    """Measured, computed and their difference in K and in sigma for up to three frames; x, z, y in mm.

    A profile is drawn as lines in degC, its difference in K with the band of noise of one pixel.
    """
    chosen = frames(seeing, run)
    if seeing.view.recording.view == "profile":
        return _lines(seeing, chosen)
    r, shown = seeing.view.recording, list(chosen)
    u, v = _edges(r.u), _edges(r.v)
    tall = np.clip((v[-1] - v[0]) / (u[-1] - u[0]), 0.2, 1.3)
    fig = _figure(seeing.view, WIDTH, 1.35 + len(shown) * (0.22 + 1.86 * tall), layout="compressed")
    axes = fig.subplots(len(shown), 4, sharex=True, sharey=True, squeeze=False)
    stacks, norms = _stacks(seeing, shown), _norms(seeing, shown)
    for row, k in enumerate(shown):
        for ax, (cmap, values), norm in zip(axes[row], stacks, norms, strict=True):
            ax.set_facecolor(MASKED)
            ax.imshow(
                np.ma.masked_invalid(values[row]), origin="lower", extent=(u[0], u[-1], v[0], v[-1]), cmap=cmap,
                norm=norm, interpolation="nearest",
            )  # fmt: skip
        first = f"repetition {r.repetition[k]}, t = {theme.number(r.time[k])} s\n{chosen[k]}"
        axes[row, 0].text(-0.36, 0.5, first, transform=axes[row, 0].transAxes, ha="right", va="center")
        axes[row, 0].set_ylabel(f"{UPWARD[r.view][0]} (mm)")
        if seeing.largest is not None and k == _frame(seeing):
            _frame_largest(axes[row, 2:], seeing)
    for ax, title in zip(axes[0], ("measured", "computed", "measured − computed", "the same in sigma"), strict=True):
        ax.set_title(title, weight="bold")
    for ax in axes[-1]:
        ax.set_xlabel("x (mm)")
    _bars(fig, axes)
    return fig


def _stacks(seeing, shown: list[int]) -> list[tuple]:
    """Colour map and values (rows, nv, nu) of the four columns, NaN where nothing is compared."""
    apart = np.isfinite(seeing.residual[shown])
    heat = theme.temperature_map()
    measured = np.where(apart, seeing.view.recording.temperature[shown], np.nan)
    computed = np.where(apart, seeing.predicted[shown], np.nan)
    return [(heat, measured), (heat, computed), (KELVIN_MAP, seeing.residual[shown]), (SIGMA_MAP, seeing.sigmas[shown])]


def _norms(seeing, shown: list[int]) -> list:
    """Colour limits of the four columns: one in degC for two of them, both differences centred at nothing."""
    from matplotlib.colors import Normalize

    (_, measured), (_, computed), (_, off), _ = _stacks(seeing, shown)
    if not np.isfinite(off).any():
        off, measured, computed = np.zeros(1), np.zeros(1), np.zeros(1)
    low, high = np.nanpercentile(measured, (0.1, 99.9))  # a pixel gone mad would take all colours
    heat = theme.temperature_norm([low, high], computed)
    most = max(3.0 * seeing.noise.white, np.nanpercentile(np.abs(off), 99.5))
    if seeing.largest is not None:
        most = max(most, abs(seeing.largest.K))
    limit = theme.nice_ceil(most)
    return [heat, heat, Normalize(-limit, limit), Normalize(-CLIP, CLIP)]


def _bars(fig, axes) -> None:
    """One colour bar below the columns that it belongs to."""
    style = {"location": "bottom", "pad": 0.02, "fraction": 0.05}
    spans = [
        (axes[:, :2], f"temperature ({theme.DEGREE})", 40, "neither"),
        (axes[:, 2], "difference (K)", 20, "both"),
        (axes[:, 3], f"difference (sigma), colours end at ±{CLIP:g}", 20, "both"),
    ]
    for columns, label, aspect, extend in spans:
        image = columns.ravel()[0].images[0]
        bar = fig.colorbar(image, ax=columns, label=label, aspect=aspect, extend=extend, **style)
        bar.outline.set_linewidth(0.4)
        bar.ax.xaxis.set_major_locator(MaxNLocator(5 if aspect < 30 else 9))


def _frame_largest(axes, seeing) -> None:
    """A square around the five by five pixels of the largest structured residual, mm."""
    r, at = seeing.view.recording, seeing.largest
    du, dv = (1e3 * p if np.isfinite(p) else 1.0 for p in r.pitch)
    for ax in axes:
        ax.add_patch(
            Rectangle((1e3 * at.u - 2.5 * du, 1e3 * at.v - 2.5 * dv), 5 * du, 5 * dv, fill=False, ec="black", lw=0.9)
        )


def _lines(seeing, chosen: dict[int, str]) -> Figure:
    """A profile: curves in degC above their difference in K with the noise of one pixel, against x in mm."""
    r, shown = seeing.view.recording, list(chosen)
    x = 1e3 * r.u
    fig = _figure(seeing.view, max(theme.NARROW, 3.2 * len(shown)), 4.4)
    axes = fig.subplots(2, len(shown), sharex=True, sharey="row", squeeze=False, height_ratios=[1.6, 1.0])
    half = SURE * np.hypot(seeing.noise.white, seeing.noise.pattern)
    for k, above, below in zip(shown, *axes, strict=True):
        seen = np.where(np.isfinite(seeing.residual[k, 0]), r.temperature[k, 0], np.nan)
        above.plot(x, seen, ".", color=MEASURED, ms=3.0, label="measured")
        above.plot(x, seeing.predicted[k, 0], color=COMPUTED, label="computed")
        above.set_title(f"repetition {r.repetition[k]}, t = {theme.number(r.time[k])} s\n{_flat(chosen[k])}")
        _against(below, x, seeing.residual[k, 0], np.full(len(x), half))
        below.set_xlabel("x (mm)")
    axes[0, 0].set_ylabel(f"temperature ({theme.DEGREE})")
    axes[0, 0].legend()
    axes[1, 0].set_ylabel("measured −\ncomputed (K)")
    fig.supxlabel("pale band: noise of one pixel alone, two standard deviations; red: beyond it", fontsize=7.5)
    return fig


# --- along ---
@theme.styled
def along(seeing, run=None) -> Figure:
    """Mean difference (K) along x, z or y (mm), against time (s) and per repetition, with what noise alone gives.

    The band is two standard errors of the mean; with the `run` of the condition waits are shaded.
    """
    r, level = seeing.view.recording, seeing.noise
    up, where = UPWARD[r.view]
    fig = _figure(seeing.view, WIDTH, 5.0)
    axes = fig.subplots(2, 2).ravel()
    _curve(axes[0], 1e3 * r.u, *mean(seeing.residual, level, 2), "along x", "x from the leading edge (mm)")
    if up:
        _curve(axes[1], 1e3 * r.v, *mean(seeing.residual, level, 1), f"along {up}", f"{up} {where} (mm)")
    else:
        axes[1].remove()
    _over_time(axes[2], seeing, run)
    _per_repetition(axes[3], seeing)
    fig.supylabel("mean of measured − computed (K)", fontsize=8.0)
    note = "pale band: what noise alone would do to the mean, two standard errors; red: beyond it"
    fig.supxlabel(note, fontsize=7.5)
    return fig


def _curve(ax, x, values, error, title: str, label: str) -> None:
    """One direction: the mean difference with the band of noise."""
    _against(ax, x, values, SURE * error)
    ax.set(xlabel=label)
    ax.set_title(f"{title}: {_beyond(values, error)}")


def _over_time(ax, seeing, run) -> None:
    """Mean of every frame against time, waits shaded where they are known."""
    r = seeing.view.recording
    values, error = mean(seeing.residual, seeing.noise, 0)
    when = clock(run) if run is not None else None
    _curve(ax, r.time if when is None else when.of(r.time), values, error, "frame by frame", "time (s)")
    if when is not None:
        when.shade(ax)
        when.shape(ax)
        if when.waits:
            ax.set_xlabel(f"{ax.get_xlabel()}, grey: waiting")
    low, high = ax.get_xlim()
    ax.set_xlim(low - 0.02 * (high - low) if low <= r.time.min() else low, high)


def _per_repetition(ax, seeing) -> None:
    """Mean of every repetition."""
    r = seeing.view.recording
    numbers = np.unique(r.repetition)
    pairs = [mean(seeing.residual[r.repetition == n], seeing.noise, None) for n in numbers]
    values, error = np.array(pairs).T
    _curve(ax, numbers, values, error, "repetition by repetition", "repetition (–)")
    ax.set_xlim(numbers[0] - 0.6, numbers[-1] + 0.6)
    ax.xaxis.set_major_locator(MaxNLocator(integer=True, nbins=8))


# --- friction ---
@theme.styled
def force(pulling) -> Figure:
    """Friction coefficient (1) measured and computed against the time slid (s), and their difference."""
    s, on, starts = slid_time(pulling)
    mu, off = np.array(pulling.force.mu)[on], pulling.residual[on]
    fig = _figure(pulling.force, WIDTH, 4.2)
    above, below = fig.subplots(2, 1, sharex=True, height_ratios=[1.6, 1.0])
    every = max(1, -(-len(s) // MOST))
    above.plot(s[::every], mu[::every], ".", color=MEASURED, ms=2.5, label="measured")
    for part in np.split(np.arange(len(s)), starts):
        above.plot(s[part], pulling.predicted[on][part], color=COMPUTED, label=None if part[:1] else "computed")
    above.set_ylim(theme.span(mu, pulling.predicted[on], least=0.02, margin=0.08))
    above.legend(loc="best", ncols=2)
    above.set_ylabel("friction coefficient (–)")
    half = SURE * pulling.sigma
    below.axhspan(-half, half, color=BAND, lw=0, zorder=0)
    below.axhline(0.0, color=theme.AMBIENT, lw=0.6)
    out = np.abs(off) > half
    for keep, colour in ((~out, theme.AMBIENT), (out, BEYOND)):
        below.plot(s[keep][::every], off[keep][::every], ".", color=colour, ms=2.5)
    below.set_ylim(theme.span(off, [-half, half], least=1e-6, margin=0.1))
    below.set(xlabel="time slid (s), waits left out", ylabel="measured −\ncomputed (–)")
    for ax in (above, below):
        for k in starts:
            ax.axvline(0.5 * (s[k - 1] + s[k]), color=theme.WAITING, lw=1.2, zorder=0)
        ax.set_xlim(0.0, s[-1] if len(s) and s[-1] > 0 else 1.0)
    note = "pale band: noise of one reading, two standard deviations; red: beyond it"
    fig.supxlabel(note + ("; grey lines: waits" if len(starts) else ""), fontsize=7.5)
    return fig


def slid_time(pulling) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time slid (s) of the readings that are compared, their mask (n,), and where sliding starts again.

    A gap of more than three usual steps is a wait and counts as one step.
    """
    on = np.isfinite(pulling.residual)
    step = np.diff(np.array(pulling.force.time)[on])
    usual = float(np.median(step)) if len(step) else 0.0
    starts = np.flatnonzero(step > 3.0 * usual) + 1
    step = np.where(step > 3.0 * usual, usual, step)
    return np.concatenate([[0.0], np.cumsum(step)])[: int(on.sum())], on, starts


# --- overview ---
@theme.styled
def summary(comparison) -> Figure:
    """RMSE and bias (K; of friction 1) and chi2/dof of every recording and every load-cell trace."""
    blocks = [(comparison.seeings, "recordings", "K"), (comparison.pullings, "friction", "–")]
    blocks = [b for b in blocks if b[0]]
    rows = [max(len(found), 2) for found, _, _ in blocks]
    fig = Figure(figsize=(WIDTH, 1.0 + 0.75 * len(blocks) + 0.26 * sum(rows)), layout="constrained", facecolor="white")
    fig.suptitle(_short(comparison.campaign.title), x=0.01, ha="left")
    axes = fig.subplots(len(blocks), 2, squeeze=False, height_ratios=rows, sharex="col" if len(blocks) < 2 else False)
    for (left, right), (found, title, unit) in zip(axes, blocks, strict=True):
        _sizes(left, found, title, unit)
        _adequacy(right, found)
    reach = [ax.get_xlim() for ax in axes[:, 1]]
    for ax in axes[:, 1]:
        ax.set_xlim(min(low for low, _ in reach), max(high for _, high in reach))
    return fig


def _sizes(ax, found, title: str, unit: str) -> None:
    """Root mean square and mean of the differences of one kind, beside the noise of one value."""
    y = np.arange(len(found))
    rms = np.array([getattr(s, "rmse_K", getattr(s, "rmse", np.nan)) for s in found])
    bias = np.array([getattr(s, "bias_K", getattr(s, "bias", np.nan)) for s in found])
    noise = np.array([s.sigma if hasattr(s, "sigma") else np.hypot(s.noise.white, s.noise.pattern) for s in found])
    ax.hlines(y, np.minimum(0.0, bias), rms, color=theme.WAITING, lw=1.0, zorder=1)
    ax.plot(rms, y, "o", color=MEASURED, ms=5.0, label="root mean square")
    ax.plot(bias, y, "D", color=COMPUTED, ms=4.0, label="mean")
    ax.plot(noise, y, "|", color=BEYOND, ms=11.0, mew=1.6, label="noise of one value")
    ax.axvline(0.0, color=theme.AMBIENT, lw=0.6)
    files = [getattr(s, "view", None) or s.force for s in found]
    names = [_short(f.file, 38) + (" (held out)" if f.held_out else "") for f in files]
    ax.set_yticks(y, names)
    ax.set(ylim=(len(found) - 0.4, -0.6), xlabel=f"measured − computed ({unit})")
    ax.set_title(title, weight="bold")
    ax.tick_params(axis="y", length=0)
    ax.legend(loc="lower right", bbox_to_anchor=(1.02, 1.0), ncols=3, borderaxespad=0.1, handletextpad=0.3)


def _adequacy(ax, found) -> None:
    """Mean square of the differences in sigma: one where noise explains them all."""
    y = np.arange(len(found))
    value = np.array([max(s.chi2_per_dof, 1e-3) for s in found])
    ax.axvline(1.0, color=COMPUTED, lw=1.2)
    ax.hlines(y, 1.0, value, color=theme.WAITING, lw=1.0)
    ax.plot(value, y, "o", color=MEASURED, ms=5.0)
    for at, v in zip(y, value, strict=True):
        ax.annotate(theme.number(v, 3), (v, at), (6, 0), textcoords="offset points", va="center", fontsize=7.5)
    ax.set_xscale("log")
    known = value[np.isfinite(value)]
    ax.set(xlim=(min(0.5, 0.7 * known.min(initial=1.0)), max(3.0, 4.0 * known.max(initial=1.0))))
    ax.set(ylim=(len(found) - 0.4, -0.6), yticks=[], xlabel="chi2/dof (–); blue line: noise explains everything")


def _flat(text: str) -> str:
    return text.replace("\n", " ")


