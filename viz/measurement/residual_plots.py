"""Shared by the pictures of measured against computed: figures, means of differences with noise, and bands."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from flashtemp.viz import theme
from flashtemp.viz.key_labels import describe_condition

MEASURED_COLOUR, COMPUTED_COLOUR = "#2B2B2B", theme.BLUE
BAND_COLOUR, BEYOND_COLOUR = "#C3D8E8", "#C8420B"
BAND_SIGMA = 2.0  # standard errors: half the width of the bands
VIEW_LABELS = {
    "sidewall": "side wall",
    "wake": "wake on the road",
    "profile": "profile along the block",
    "points": "points",
}


def make_recording_figure(
    shown: str, entry, width: float, height: float, layout: theme.FigureLayout = "constrained"
) -> Figure:
    """An empty figure (inches) titled by what is `shown` of a recording or load-cell file, and by its condition."""
    view = f" ({VIEW_LABELS[entry.recording.view]})" if hasattr(entry, "recording") else ""
    return theme.make_figure(shown, f"{entry.file}{view}\n{describe_condition(entry.given)}", width, height, layout)


# --- numbers ----------------------------------------------------------------------------------------
def sliding_mask(time: np.ndarray, run) -> np.ndarray:
    """Whether the block slides at the times (s) of frames, up to and including the end of each repetition."""
    at = np.searchsorted(run.time, time - 1e-9 * max(run.time[-1], 1.0))
    return run.sliding[np.minimum(at, len(run.time) - 1)]


def mean_residual(residual: np.ndarray, noise, kept_axis: int | None) -> tuple[np.ndarray, np.ndarray]:
    """Mean (K) of residuals (frames, nv, nu) over all axes but `kept_axis`, and its standard error (K).

    The error is that of noise alone: white noise averages over all values, the fixed pattern only over pixels.
    """
    good, others = np.isfinite(residual), tuple(a for a in range(3) if a != kept_axis)
    total = good.sum(axis=others)
    count = np.maximum(total, 1)
    # the pattern is the same in all n frames of a pixel: its variance enters the sum n^2 times
    repeated = total if kept_axis == 0 else (good.sum(axis=0, keepdims=True) ** 2).sum(axis=others)
    error = np.sqrt(noise.white**2 / count + noise.pattern**2 * repeated / count**2)
    return (
        np.where(total > 0, np.sum(residual, axis=others, where=good) / count, np.nan),
        np.where(total > 0, error, np.nan),
    )


def pixel_edges(centres: np.ndarray) -> np.ndarray:
    """Edges (n + 1,) in mm of evenly spaced pixels with centres (n,) in m; a single one is 1 mm wide."""
    step = 1e3 * (centres[-1] - centres[0]) / (len(centres) - 1) if len(centres) > 1 else 1.0
    return 1e3 * centres[0] + step * (np.arange(len(centres) + 1) - 0.5)


# --- differences with a noise band ------------------------------------------------------------------
def draw_residuals(ax, x, values, half_width, room_steps: float = 0.5) -> None:
    """Differences at x as dots, red outside the noise band of half-width `half_width` around zero.

    The band ends `room_steps` steps before the first and after the last x.
    """
    good = np.isfinite(values)
    out = good & (np.abs(values) > half_width)
    first, last = (x[1] - x[0], x[-1] - x[-2]) if np.ptp(x) > 0 else (1.0, 1.0)
    x_band = np.array([x[0] - room_steps * first, *x, x[-1] + room_steps * last])
    wide = np.concatenate([half_width[:1], half_width, half_width[-1:]])
    ax.fill_between(x_band, -wide, wide, color=BAND_COLOUR, lw=0, zorder=1)
    ax.axhline(0.0, color=theme.AMBIENT_COLOUR, lw=0.5, zorder=1.5)
    ax.plot(x, values, color=theme.AMBIENT_COLOUR, lw=0.7, zorder=2)
    size = 4.0 if len(x) <= 40 else 2.4
    for keep, colour in ((good & ~out, theme.AMBIENT_COLOUR), (out, BEYOND_COLOUR)):
        dots = ax.plot(x[keep], values[keep], "o", color=colour, ms=size, mew=0, zorder=3, clip_on=False)
        dots[0].set_in_layout(False)  # an empty unclipped artist would take space from the axes
    known = half_width[np.isfinite(half_width)]
    ax.set(xlim=(x_band[0], x_band[-1]), ylim=theme.padded_limits(values[good], known, -known, least=1e-6, margin=0.08))


def count_beyond_noise(values, error) -> str:
    """How many means are outside the band of BAND_SIGMA standard errors, in words.

    >>> count_beyond_noise(np.array([0.1, 3.0, np.nan]), np.ones(3))
    '1 of 2 beyond noise'
    """
    good = np.isfinite(values)
    return f"{int((np.abs(values[good]) > BAND_SIGMA * error[good]).sum())} of {int(good.sum())} beyond noise"
