"""The schedule of a test: repetitions of sliding with waits between them, speed and pressure over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from flashtemp.physics.arrays import Array, Value


@dataclass(frozen=True)
class TimeSeries:
    """A quantity over time since the start of a repetition: linear between rows, constant outside.

    >>> s = TimeSeries((0.0, 2.0), (1.0, 3.0))
    >>> s(1.0), s(9.0), s.integral(2.0)
    (2.0, 3.0, 4.0)
    """

    time: tuple[float, ...]
    value: tuple[float, ...]

    @cached_property
    def _arrays(self) -> tuple[Array, Array, Array]:
        """Times, values and the integral from 0 to every row."""
        t, v = np.asarray(self.time, dtype=float), np.asarray(self.value, dtype=float)
        steps = np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t))
        return t, v, v[0] * t[0] + np.concatenate([[0.0], steps])

    @property
    def range(self) -> tuple[float, float]:
        """Lowest and highest value; the lowest is at least 1e-4 of the highest, as a speed may start at 0."""
        return max(min(self.value), 1e-4 * max(self.value)), max(self.value)

    def __call__(self, t: float) -> float:
        if len(self.value) == 1:
            return self.value[0]
        return float(np.interp(t, *self._arrays[:2]))

    def integral(self, t: float) -> float:
        """Integral from 0 to t, exact for the piecewise linear function."""
        if len(self.value) == 1 or t <= self.time[0]:
            return self.value[0] * t
        times, values, area = self._arrays
        k = int(np.searchsorted(times, t)) - 1
        return float(area[k] + 0.5 * (values[k] + self(t)) * (t - times[k]))

    def time_at_integral(self, area: Value) -> Value:
        """Time at which the integral first equals `area` (number or array); inf when it never does."""
        target = np.asarray(area, dtype=float)
        t, v, sums = self._arrays
        rounded = (target > sums[-1]) & (target <= sums[-1] * (1 + 1e-12))  # the block stops just at the end
        target = np.where(rounded, sums[-1], target)
        k = np.searchsorted(sums, target)
        last = np.maximum(k - 1, 0)
        t0, s0, v0 = np.where(k == 0, 0.0, t[last]), np.where(k == 0, 0.0, sums[last]), np.where(k == 0, v[0], v[last])
        inside = (k > 0) & (k < len(t))
        after = np.minimum(k, len(t) - 1)
        slope = np.where(inside, (v[after] - v0) / np.where(inside, t[after] - t0, 1.0), 0.0)
        # within a row v**2 = v0**2 + 2 slope (s - s0); the mean of v0 and v gives the time
        root = v0 * v0 + 2 * slope * (target - s0)
        root = np.where(np.abs(root) < 1e-12 * v0 * v0, 0.0, root)  # the block stops just there
        speed = v0 + np.sqrt(np.maximum(root, 0.0))
        possible = (root >= 0) & (speed > 0)
        time = np.where(possible, t0 + 2 * (target - s0) / np.where(possible, speed, 1.0), np.inf)
        time = np.where(target <= 0, 0.0, time)
        return time if np.ndim(area) else float(time)

    def travel_time(self, t: float, x: Value) -> Value:
        """Time (s) since the road now at x (m, number or array) passed x = 0; t if it was inside at the start."""
        if len(self.value) == 1:
            return np.minimum(x / self.value[0], t)
        return t - self.time_at_integral(self.integral(t) - x)


def constant_series(value: float) -> TimeSeries:
    """A constant quantity as a time series."""
    return TimeSeries((0.0,), (float(value),))


@dataclass(frozen=True)
class SpeedProfile:
    """Magnitude of the sliding speed, initial direction (`heading` 1, or -1: back) and times of reversal (`turns`, s).

    >>> SpeedProfile.from_signed_speeds((0.0, 2.0, 4.0), (0.1, 0.1, -0.1))
    SpeedProfile(speed=TimeSeries(time=(0.0, 2.0, 3.0, 4.0), value=(0.1, 0.1, 0.0, 0.1)), heading=1, turns=(3.0,))
    """

    speed: TimeSeries
    heading: int = 1
    turns: tuple[float, ...] = ()

    @classmethod
    def from_signed_speeds(cls, time: Sequence[float], value: Sequence[float]) -> SpeedProfile:
        """The profile of signed speeds (m/s) at times (s), not all of them zero."""
        rows: list[tuple[float, float]] = []
        turns, sign = [], 0.0
        for t, v in zip(time, value, strict=True):
            if v * sign < 0:
                a, u = rows[-1]
                at = a if u == 0 else a + (t - a) * u / (u + abs(v))
                turns.append(at)
                if at > a:
                    rows.append((at, 0.0))
            sign = sign if v == 0 else v
            rows.append((t, abs(v)))
        first = next(v for v in value if v)
        return cls(TimeSeries(*zip(*rows, strict=True)), 1 if first > 0 else -1, tuple(turns))


@dataclass(frozen=True)
class Phase:
    """An interval between events: `sliding` or waiting, from `begin` to `end` (s)."""

    repetition: int
    sliding: bool
    begin: float
    end: float
    start: float  # when this repetition began to slide, s
    slid_before: float  # distance slid in all repetitions before this one, m
    direction: int = 1  # -1: back, the edge at x = L leads
    leg_before: float = 0.0  # distance slid in this repetition before the last reversal, m
    turned: float = -np.inf  # time of the last reversal since the block was put on the road, s


@dataclass(frozen=True)
class Schedule:
    """Repetitions of sliding over `distance` (m) with `wait` (s) between them.

    `speed` (m/s) and `pressure` (nominal contact pressure, Pa) are functions of the time since the start of each
    repetition.  `lifted`: the block leaves the road while waiting.  `speed` is a magnitude: `heading` is the initial
    direction of a repetition (-1: back), `turns` (s since its start) are the times of reversal, and `turn` > 0 is the
    number of repetitions after which the direction also reverses.  With `alone` there is one phase without contact.

    >>> s = Schedule(constant_series(0.1), constant_series(1.5e5), distance=3.5, repetitions=2, wait=10.0)
    >>> [(p.repetition, p.sliding, p.begin, p.end) for p in s.phases]
    [(1, True, 0.0, 35.0), (1, False, 35.0, 45.0), (2, True, 45.0, 80.0)]
    """

    speed: TimeSeries
    pressure: TimeSeries
    distance: float
    repetitions: int = 1
    wait: float = 0.0
    lifted: bool = True
    lap: float | None = None  # track length, m: the end of each lap is an event
    heading: int = 1
    turns: tuple[float, ...] = ()
    turn: int = 0
    alone: float = 0.0  # s that the block is off the road, instead of sliding

    @cached_property
    def slide_time(self) -> float:
        """Duration of one repetition of sliding, or of the block alone, s."""
        return self.alone or float(self.speed.time_at_integral(self.distance))

    @cached_property
    def _turn_times(self) -> tuple[float, ...]:
        """Times (s) within a repetition at which the sliding direction reverses."""
        tiny = 1e-9 * self.slide_time
        return tuple(t for t in self.turns if tiny < t < self.slide_time - tiny)

    def _initial_direction(self, repetition: int) -> int:
        """Initial sliding direction of a repetition (1-based)."""
        legs = (repetition - 1) // self.turn if self.turn else 0
        return -self.heading if legs % 2 else self.heading

    @property
    def directions(self) -> frozenset[int]:
        """Sliding directions that occur: 1, -1 or both."""
        headings = {self._initial_direction(r + 1) for r in range(min(self.repetitions, 2 * self.turn or 1))}
        return frozenset(headings | {-h for h in headings} if self._turn_times else headings)

    @property
    def has_return_pass(self) -> bool:
        """Whether the block slides back over the road that it has just heated, without being lifted."""
        return bool(self._turn_times) or (not self.lifted and len(self.directions) > 1)

    def _event_times(self, slid_before: float) -> list[float]:
        """Times (s) of events within a repetition, after `slid_before` (m) in all earlier ones.

        Events are kinks of speed and pressure (unless a series has many), ends of laps, and reversals.
        """
        events: set[float] = set()
        for series in (self.speed, self.pressure):
            if 1 < len(series.time) <= 40:
                events |= {k for k in series.time if 0 < k < self.slide_time}
        if self.lap:
            laps = range(int(slid_before / self.lap) + 1, int((slid_before + self.distance) / self.lap) + 1)
            events |= {self.speed.time_at_integral(n * self.lap - slid_before) for n in laps}
        tiny = 1e-9 * self.slide_time
        inner = sorted(c for c in events if tiny < c < self.slide_time - tiny)
        if self._turn_times:
            inner = sorted([*self._turn_times, *(c for c in inner if min(abs(c - t) for t in self._turn_times) > tiny)])
        return [0.0, *(c for k, c in enumerate(inner) if k == 0 or c - inner[k - 1] > tiny), self.slide_time]

    @cached_property
    def phases(self) -> tuple[Phase, ...]:
        """All intervals between events in order of time."""
        out: list[Phase] = []
        t, turned = 0.0, -np.inf
        for r in range(self.repetitions):
            before, leg, direction = r * self.distance, 0.0, self._initial_direction(r + 1)
            if self.lifted:
                turned = -np.inf
            elif out and out[-1].direction != direction:
                turned = t
            for a, b in pairwise(self._event_times(before)):
                if a in self._turn_times:
                    direction, leg, turned = -direction, self.speed.integral(a), t + a
                out.append(Phase(r + 1, True, t + a, t + b, t, before, direction, leg, turned))
            begin = t
            t += self.slide_time
            if self.wait > 0 and r + 1 < self.repetitions:
                out.append(Phase(r + 1, False, t, t + self.wait, begin, before, direction, leg, turned))
                t += self.wait
        return tuple(out)

    def phase_at(self, t: float) -> Phase:
        """The phase at time t (s); an event belongs to the phase that it ends.  Outside: the first or last phase."""
        k = int(np.searchsorted([p.end for p in self.phases], t))
        return self.phases[min(k, len(self.phases) - 1)]

    @property
    def end_time(self) -> float:
        """Total time, s."""
        return self.phases[-1].end

    def slid_distance(self, phase: Phase, t: float) -> float:
        """Distance slid since the start of the repetition, m."""
        if self.alone:
            return 0.0
        return self.speed.integral(t - phase.start) if phase.sliding else self.distance

    def total_slid_distance(self, phase: Phase, t: float) -> float:
        """Distance slid since the first start of all repetitions, m."""
        return phase.slid_before + self.slid_distance(phase, t)

    def last_speed(self) -> float:
        """Speed just before a stop, m/s."""
        return 0.0 if self.alone else self.speed(self.slide_time)

    def __str__(self) -> str:
        if self.alone:
            return f"Schedule block alone for {self.alone:g} s"
        v = self.speed
        speed = f"{v.value[0]:g}" if len(v.value) == 1 else f"{min(v.value):g}..{max(v.value):g}"
        if self.directions == {-1}:
            speed = f"-{speed}" if len(v.value) == 1 else f"-({speed})"
        elif len(self.directions) > 1:
            speed = f"+-{speed}" if len(v.value) == 1 else f"+-({speed})"
        return (
            f"Schedule {self.repetitions} x {self.distance:g} m at {speed} m/s, wait {self.wait:g} s, "
            f"block {'lifted' if self.lifted else 'in contact'} while waiting, {self.end_time:g} s in all"
        )
