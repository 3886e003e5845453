"""The time axis of a run: repetitions, waits, and compression of waits that would fill the picture."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from flashtemp.physics.interpolation import interpolate_linear
from flashtemp.viz import theme

DOMINANT_WAIT_RATIO = 2.5  # waits longer than this many times the sliding are drawn compressed
COMPRESSED_WAIT_FRACTION = 0.5  # ... to this fraction of the time spent sliding
TIME_UNITS = (("s", 1.0, 1800.0), ("min", 60.0, 4 * 3600.0), ("h", 3600.0, np.inf))


@dataclass(frozen=True)
class RepetitionAxis:
    """`repetition` numbers (r,), `start` and `end` (r,) of their sliding (s), and `stop`, the end of the run (s)."""

    repetition: np.ndarray
    start: np.ndarray
    end: np.ndarray
    stop: float

    @cached_property
    def waits(self) -> list[tuple[float, float]]:
        """Begin and end (s) of every wait of non-zero length."""
        until = np.append(self.start[1:], self.stop)
        return [(float(a), float(b)) for a, b in zip(self.end, until, strict=True) if b > a]

    @cached_property
    def unit(self) -> tuple[str, float]:
        """Unit of the axis and its value in s."""
        return next((name, size) for name, size, longest in TIME_UNITS if self.stop < longest)

    @cached_property
    def is_compressed(self) -> bool:
        """Whether waits are drawn compressed."""
        waited = sum(b - a for a, b in self.waits)
        return waited > DOMINANT_WAIT_RATIO * (self.stop - self.start[0] - waited)

    @cached_property
    def label(self) -> str:
        """Label of the axis with its unit."""
        return f"time ({self.unit[0]})" + ("; waits drawn compressed" if self.is_compressed else "")

    def to_axis_unit(self, seconds):
        """Seconds in the unit of the axis."""
        return np.asarray(seconds) / self.unit[1]

    @cached_property
    def axis_knots(self) -> tuple[np.ndarray, np.ndarray]:
        """Times (s) and their positions on the axis; the axis is linear between them."""
        t = np.unique(np.concatenate([[self.start[0]], *self.waits, [self.stop]]))
        step = np.diff(t)
        waiting = np.isin(t[:-1], [a for a, _ in self.waits])
        if self.is_compressed:
            step[waiting] *= COMPRESSED_WAIT_FRACTION * step[~waiting].sum() / step[waiting].sum()
        return t, np.concatenate([[0.0], np.cumsum(step)])

    def column_edges(self, count: int) -> np.ndarray:
        """Times (s) of the edges (count + 1,) of `count` columns of equal width on the axis."""
        t, place = self.axis_knots
        return np.interp(np.linspace(0.0, place[-1], count + 1), place, t)

    def set_axis(self, ax) -> None:
        """Apply limits, label and, where waits dominate, the compressed scale to an axes."""
        if self.is_compressed:
            t, place = self.to_axis_unit(self.axis_knots[0]), self.axis_knots[1]
            ax.set_xscale("function", functions=(lambda v: np.interp(v, t, place), lambda p: np.interp(p, place, t)))
            ticks = self.to_axis_unit(np.append(self.start, self.stop))
            ticks = ticks[theme.spread_indices(len(ticks), 9)]
            decimals = 2 if ticks[-1] < 10 else 1 if ticks[-1] < 100 else 0
            ax.set_xticks(ticks, [f"{v:.{decimals}f}" for v in ticks])
        ax.set_xlim(*self.to_axis_unit([self.start[0], self.stop]))
        ax.set_xlabel(self.label)

    def shade_waits(self, ax) -> None:
        """Mark every wait by a pale band."""
        for a, b in self.waits:
            ax.axvspan(*self.to_axis_unit([a, b]), color=theme.WAITING_COLOUR, lw=0, zorder=0)


def repetition_axis(run) -> RepetitionAxis:
    """The time axis of a run."""
    numbers = np.unique(run.repetition[run.sliding])
    first = np.array([np.flatnonzero(run.sliding & (run.repetition == r))[0] for r in numbers])
    # a repetition starts at the record before its first sliding one: the end of the wait
    return RepetitionAxis(numbers, run.time[np.maximum(first - 1, 0)], run.time[sliding_ends(run)], float(run.time[-1]))


def sliding_ends(run) -> np.ndarray:
    """Indices (r,) into run.time of the end of sliding of every repetition."""
    records = np.flatnonzero(run.sliding)
    return records[np.flatnonzero(np.diff(run.repetition[records], append=-1))]


def interval_means(values: np.ndarray, time: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Mean over each interval between `edges` (s) of records (n, k), linear between their times (s).

    >>> interval_means(np.array([[0.0], [2.0]]), np.array([0.0, 2.0]), np.array([0.0, 1.0, 2.0])).ravel().tolist()
    [0.5, 1.5]
    """
    step = np.diff(time)[:, None]
    area = np.concatenate([0 * values[:1], np.cumsum(0.5 * step * (values[1:] + values[:-1]), axis=0)])
    k = np.clip(np.searchsorted(time, edges, side="right") - 1, 0, len(time) - 1)
    rest = 0.5 * (edges - time[k])[:, None] * (values[k] + interpolate_linear(values, time, edges))
    return np.diff(area[k] + rest, axis=0) / np.diff(edges)[:, None]
