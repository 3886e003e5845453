"""What pictures of measured against computed share: names, means of differences with their noise, and bands."""

from __future__ import annotations

import textwrap

import numpy as np
from matplotlib.figure import Figure

from flashtemp.viz import theme

def condition(given: dict) -> str:
    """The overrides of an entry for people, with units.

    >>> condition({"contact.pressure": 1.5e5, "schedule.speed": 0.1}), condition({})
    ('contact pressure 0.15 MPa, speed 0.1 m/s', 'as in the case')
    """
    return ", ".join(_quantity(key, value) for key, value in given.items()) or "as in the case"


def _quantity(key: str, value) -> str:
    """One override, in MPa where it is a large pressure."""
    from flashtemp.keys import TABLES

    table, _, name = key.rpartition(".")
    unit = getattr(TABLES.get(table, {}).get(name), "unit", "")
    words = (name if table == "schedule" else key).replace(".", " ").replace("_", " ")
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return f"{words} {value}"
    if unit == "Pa" and value >= 1e4:
        value, unit = 1e-6 * value, "MPa"
    unit = {"degC": theme.DEGREE, "1": ""}.get(unit, unit)
    return f"{words} {theme.number(value)} {unit}".rstrip()


def sliding(time: np.ndarray, run) -> np.ndarray:
    """Whether the block slides at times (s) of frames: up to and with the end of each repetition."""
    at = np.searchsorted(run.time, time - 1e-9 * max(run.time[-1], 1.0))
    return run.sliding[np.minimum(at, len(run.time) - 1)]


def mean(residual: np.ndarray, noise, kept: int | None) -> tuple[np.ndarray, np.ndarray]:
    """Mean (K) of residuals (frames, nv, nu) along the `kept` axis, or of all, and its standard error (K).

    The error is that of noise alone: white noise averages over all values, the pattern only over pixels.
    """
    good, others = np.isfinite(residual), tuple(a for a in range(3) if a != kept)
    count = np.maximum(good.sum(axis=others), 1)
    repeats = good.sum(axis=0, keepdims=True) ** 2 if kept != 0 else good
    shared = repeats.sum(axis=others)
    error = np.sqrt(noise.white**2 / count + noise.pattern**2 * shared / count**2)
    known = good.any(axis=others)
    return np.where(known, np.nansum(residual, axis=others) / count, np.nan), np.where(known, error, np.nan)


def _beyond(values, error) -> str:
    """How many means lie beyond the band, against the share that noise alone would put there."""
    good = np.isfinite(values)
    out = int((np.abs(values[good]) > SURE * error[good]).sum())
    return f"{out} of {int(good.sum())} beyond noise"


def _against(ax, x, values, half) -> None:
    """Differences at x as dots, red beyond the band of half width `half` around nothing."""
    good = np.isfinite(values)
    out = good & (np.abs(values) > half)
    if len(x) > 1:
        low, high = x[0] - 0.5 * (x[1] - x[0]), x[-1] + 0.5 * (x[-1] - x[-2])
        ax.fill_between([low, *x, high], *_padded(half), color=BAND, lw=0, zorder=1)
        ax.set_xlim(low, high)
    else:
        ax.fill_between([x[0] - 0.5, x[0] + 0.5], [-half[0]] * 2, [half[0]] * 2, color=BAND, lw=0, zorder=1)
    ax.axhline(0.0, color=theme.AMBIENT, lw=0.6, zorder=1.5)
    ax.plot(x, values, color=theme.AMBIENT, lw=0.7, zorder=2)
    size = 4.0 if len(x) <= 40 else 2.4
    ax.plot(x[good & ~out], values[good & ~out], "o", color=theme.AMBIENT, ms=size, mew=0, zorder=3)
    ax.plot(x[out], values[out], "o", color=BEYOND, ms=size, mew=0, zorder=3)
    ax.set_ylim(theme.span(values[good], half[np.isfinite(half)], -half[np.isfinite(half)], least=1e-6, margin=0.1))


def _padded(half) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper edge of a band, its ends repeated; nothing where nothing is known."""
    full = np.concatenate([half[:1], half, half[-1:]])
    return -full, full


def _figure(entry, width: float, height: float, layout: str = "constrained") -> Figure:
    """An empty figure (inches) that names a recording or a trace and its condition."""
    fig = Figure(figsize=(width, height), layout=layout, facecolor="white")
    what = VIEWS[entry.recording.view] if hasattr(entry, "recording") else "friction"
    fig.suptitle(_short(f"{entry.file}: {what}, {condition(entry.given)}"), x=0.01, ha="left")
    return fig


def _short(text: str, most: int = 120) -> str:
    """A title that fits, with nothing in it that matplotlib would take for mathematics."""
    return textwrap.shorten(str(text), most, placeholder=" ...").replace("$", r"\$")


def _edges(centres: np.ndarray) -> np.ndarray:
    """Edges (n + 1,) in mm of pixels with centres (n,) in m; a single one is 1 mm wide."""
    step = 1e3 * (centres[1] - centres[0]) if len(centres) > 1 else 1.0
    return 1e3 * centres[0] + step * (np.arange(len(centres) + 1) - 0.5)
