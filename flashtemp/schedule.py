"""What the tester does: repetitions of sliding with waits between them, speed and pressure in time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np


@dataclass(frozen=True)
class Series:
    """A quantity against time since the start of a repetition, linear between rows, held outside.

    >>> s = Series((0.0, 2.0), (1.0, 3.0))
    >>> s(1.0), s(9.0), s.integral(2.0)
    (2.0, 3.0, 4.0)
    """

    time: tuple[float, ...]
    value: tuple[float, ...]

    @cached_property
    def _area(self) -> np.ndarray:
        t, v = np.asarray(self.time), np.asarray(self.value)
        return np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t))])

    def __call__(self, t: float) -> float:
        if len(self.value) == 1:
            return self.value[0]
        return float(np.interp(t, self.time, self.value))

    def integral(self, t: float) -> float:
        """Integral from 0 to t, exact for the broken line."""
        if len(self.value) == 1:
            return self.value[0] * t
        if t <= self.time[0]:
            return self.value[0] * t
        k = min(int(np.searchsorted(self.time, t)), len(self.time)) - 1
        rest = 0.5 * (self.value[k] + self(t)) * (t - self.time[k])
        return float(self.value[0] * self.time[0] + self._area[k] + rest)

    def reach(self, area: float) -> float:
        """Time at which the integral first equals `area`; inf when it never does."""
        if area <= 0:
            return 0.0
        if len(self.value) == 1:
            return area / self.value[0] if self.value[0] > 0 else np.inf
        knots = np.asarray(self.time)
        sums = np.array([self.integral(t) for t in knots])
        k = int(np.searchsorted(sums, area))
        t0, s0, v0 = (0.0, 0.0, self.value[0]) if k == 0 else (knots[k - 1], sums[k - 1], self.value[k - 1])
        slope = 0.0
        if 0 < k < len(knots):
            slope = (self.value[k] - v0) / (knots[k] - t0)
        root = v0 * v0 + 2 * slope * (area - s0)
        root = 0.0 if abs(root) < 1e-12 * v0 * v0 else root  # comes to rest just there
        if root < 0 or v0 + np.sqrt(root) <= 0:
            return np.inf
        return float(t0 + 2 * (area - s0) / (v0 + np.sqrt(root)))


def constant(value: float) -> Series:
    """A quantity that does not change."""
    return Series((0.0,), (float(value),))


@dataclass(frozen=True)
class Phase:
    """One stretch between events: `sliding` or waiting, from `begin` to `end` (s)."""

    repetition: int
    sliding: bool
    begin: float
    end: float
    start: float  # when this repetition began to slide, s
    slid_before: float  # distance slid in all repetitions before this one, m


@dataclass(frozen=True)
class Schedule:
    """Repetitions of sliding over `distance` (m) with `wait` (s) between them.

    `speed` (m/s) and `pressure` (nominal contact pressure, Pa) count time from the start of each
    repetition; `lifted`: the block leaves the road while waiting.

    >>> s = Schedule(constant(0.1), constant(1.5e5), distance=3.5, repetitions=2, wait=10.0)
    >>> [(p.repetition, p.sliding, p.begin, p.end) for p in s.phases]
    [(1, True, 0.0, 35.0), (1, False, 35.0, 45.0), (2, True, 45.0, 80.0)]
    """

    speed: Series
    pressure: Series
    distance: float
    repetitions: int = 1
    wait: float = 0.0
    lifted: bool = True
    lap: float | None = None  # track length, m: each lap completed is an event

    @cached_property
    def slide_time(self) -> float:
        """Duration of one repetition of sliding, s."""
        return self.speed.reach(self.distance)

    @cached_property
    def phases(self) -> tuple[Phase, ...]:
        """All stretches between events in order of time."""
        out, t = [], 0.0
        for r in range(self.repetitions):
            before = r * self.distance
            cuts: set[float] = set()
            for series in (self.speed, self.pressure):
                if 1 < len(series.time) <= 40:
                    cuts |= {k for k in series.time if 0 < k < self.slide_time}
            if self.lap:
                laps = range(int(before / self.lap) + 1, int((before + self.distance) / self.lap) + 1)
                cuts |= {self.speed.reach(n * self.lap - before) for n in laps}
            tiny = 1e-9 * self.slide_time
            inner = sorted(c for c in cuts if tiny < c < self.slide_time - tiny)
            cuts = [0.0, *(c for k, c in enumerate(inner) if k == 0 or c - inner[k - 1] > tiny), self.slide_time]
            for a, b in zip(cuts, cuts[1:], strict=False):
                out.append(Phase(r + 1, True, t + a, t + b, t, before))
            begin = t
            t += self.slide_time
            if self.wait > 0 and r + 1 < self.repetitions:
                out.append(Phase(r + 1, False, t, t + self.wait, begin, before))
                t += self.wait
        return tuple(out)

    @property
    def end(self) -> float:
        """Total time, s."""
        return self.phases[-1].end

    def slid(self, phase: Phase, t: float) -> float:
        """Distance slid since the start of the repetition, m."""
        return self.speed.integral(t - phase.start) if phase.sliding else self.distance

    def last_speed(self) -> float:
        """Speed just before a stop, m/s."""
        return self.speed(self.slide_time)

    def __str__(self) -> str:
        v = self.speed
        speed = f"{v.value[0]:g}" if len(v.value) == 1 else f"{min(v.value):g}..{max(v.value):g}"
        return (
            f"Schedule {self.repetitions} x {self.distance:g} m at {speed} m/s, wait {self.wait:g} s, "
            f"block {'lifted' if self.lifted else 'in contact'} while waiting, {self.end:g} s in all"
        )
