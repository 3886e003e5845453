"""Speed and pressure in time, and the stretches between events."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from flashtemp.model.schedule import Schedule, TimeSeries, constant_series

steady = settings(max_examples=150, deadline=None, derandomize=True)
values = st.floats(0.0, 5.0).map(lambda v: round(v, 3))
lengths = st.integers(1, 40).map(lambda n: n / 20)


@st.composite
def series(draw):
    """A broken line that may start late, rest and stop."""
    n = draw(st.integers(1, 6))
    gaps = draw(st.lists(st.floats(0.01, 3.0), min_size=n, max_size=n))
    begin = draw(st.sampled_from([0.0, 0.5]))
    time = begin + np.cumsum([0.0, *gaps[1:]])
    return TimeSeries(tuple(time.tolist()), tuple(draw(st.lists(values, min_size=n, max_size=n))))


@steady
@given(series(), st.floats(0.0, 12.0))
def test_integral_is_that_of_the_line(s, t):
    knots = np.unique(np.clip([0.0, t, *s.time], 0.0, t))
    line = [s(k) for k in knots]
    assert s.integral(t) == pytest.approx(np.trapezoid(line, knots), rel=1e-12, abs=1e-12)


@steady
@given(series(), st.floats(0.0, 1.0))
def test_reach_inverts_the_integral(s, share):
    end = s.time[-1] + 1.0
    area = share * s.integral(end)
    t = s.time_at_integral(area)
    assert 0.0 <= t <= end * (1 + 1e-6) or s.integral(end) == 0.0
    if math.isfinite(t):
        assert s.integral(t) == pytest.approx(area, rel=1e-9, abs=1e-9)


@steady
@given(series())
def test_reach_is_the_first_time(s):
    """At every knot: the time found is not later, though the line may rest or end at zero there."""
    for t in s.time:
        assert s.time_at_integral(s.integral(t)) <= t * (1 + 1e-6) + 1e-6


@steady
@given(series())
def test_reach_beyond_a_stop_is_never(s):
    end = s.time[-1]
    beyond = s.time_at_integral(s.integral(end) + 1.0)
    if s.value[-1] == 0.0:
        assert beyond == math.inf
    else:
        assert beyond == pytest.approx(end + 1.0 / s.value[-1])


def test_nothing_is_slid_at_once():
    assert constant_series(0.1).time_at_integral(0.0) == 0.0
    assert TimeSeries((0.0, 1.0), (0.0, 1.0)).time_at_integral(0.0) == 0.0


def test_constant_has_no_end():
    s = constant_series(0.25)
    assert (s(0.0), s(1e6), s.integral(8.0), s.time_at_integral(2.0)) == (0.25, 0.25, 2.0, 8.0)
    assert constant_series(0.0).time_at_integral(1.0) == math.inf


def test_stop_exactly_at_the_distance():
    """v = 3 m/s braked to rest: the whole of the braking distance is slid, in the braking time."""
    for time in (1.0, 1.7, 1.726342886347258, 0.3):
        brake = TimeSeries((0.0, time), (3.0, 0.0))
        assert brake.time_at_integral(brake.integral(time)) == pytest.approx(time, rel=1e-6)


# --- phases --------------------------------------------------------------------------------------
# three laps of 0.05 m are 0.15 m but for the last digit
LAP_ENDS_WITH_REPETITION = Schedule(constant_series(0.1), constant_series(1e5), 0.15, 4, 1.0, True, 0.05)


def schedules():
    speed = st.sampled_from([constant_series(0.1), constant_series(0.3), TimeSeries((0.0, 1.0, 4.0), (0.05, 0.2, 0.1))])
    pressure = st.sampled_from([constant_series(1e5), TimeSeries((0.0, 2.0), (1e5, 2e5))])
    wait = st.sampled_from([0.0, 1.0, 10.0])
    lap = st.one_of(st.none(), lengths)
    return st.builds(Schedule, speed, pressure, lengths, st.integers(1, 6), wait, st.booleans(), lap)


@steady
@given(schedules())
@example(LAP_ENDS_WITH_REPETITION)
def test_phases_fill_the_time(s):
    assert s.phases[0].begin == 0.0
    for a, b in zip(s.phases, s.phases[1:], strict=False):
        assert a.end == b.begin
    assert all(p.end - p.begin > 1e-9 for p in s.phases)
    total = s.repetitions * s.slide_time + (s.repetitions - 1) * s.wait
    assert s.end_time == pytest.approx(total)


@steady
@given(schedules())
@example(LAP_ENDS_WITH_REPETITION)
def test_repetition_begins_at_its_start(s):
    """The march recognises a new repetition by begin == start; laps must not blur that."""
    for r in range(1, s.repetitions + 1):
        sliding = [p for p in s.phases if p.repetition == r and p.sliding]
        assert sliding[0].begin == sliding[0].start
        assert {p.start for p in sliding} == {sliding[0].start}
        assert {p.slid_before for p in sliding} == {(r - 1) * s.distance}
        assert s.slid_distance(sliding[-1], sliding[-1].end) == pytest.approx(s.distance)
    waits = [p for p in s.phases if not p.sliding]
    assert len(waits) == (s.repetitions - 1 if s.wait > 0 else 0)


@steady
@given(schedules())
@example(LAP_ENDS_WITH_REPETITION)
def test_laps_and_corners_are_events(s):
    ends = [(p.start, p.end) for p in s.phases if p.sliding]
    if s.lap:
        for n in range(1, int(s.repetitions * s.distance / s.lap * (1 - 1e-9)) + 1):
            before = int(n * s.lap / s.distance * (1 - 1e-12)) * s.distance
            into = s.speed.time_at_integral(n * s.lap - before)
            assert any(abs(end - start - into) < 1e-6 for start, end in ends)
    for corner in (1.0, 4.0) if len(s.speed.value) > 1 else ():
        if corner < s.slide_time - 1e-6:
            assert any(abs(end - start - corner) < 1e-9 for start, end in ends)


def test_waiting_counts_as_slid_to_the_end():
    s = Schedule(constant_series(0.1), constant_series(1e5), distance=0.5, repetitions=2, wait=3.0)
    slide, wait, again = s.phases
    assert (slide.sliding, wait.sliding, again.sliding) == (True, False, True)
    assert s.slid_distance(slide, 2.0) == pytest.approx(0.2)
    assert s.slid_distance(wait, 7.0) == 0.5
    assert again.slid_before == 0.5
    assert s.last_speed() == 0.1


def test_prints_as_a_sentence():
    s = Schedule(
        TimeSeries((0.0, 9.0), (0.1, 0.2)), constant_series(1e5), distance=0.5, repetitions=2, wait=3.0, lifted=False
    )
    assert str(s).startswith("Schedule 2 x 0.5 m at 0.1..0.2 m/s, wait 3 s, block in contact while waiting")


def test_coming_to_rest_just_at_the_end_is_reached():
    """A sum rounded upwards must not make the last row unreachable."""
    s = TimeSeries((0.5, 1.5, 2.5), (1.0, 0.562, 0.0))
    assert s.time_at_integral(s.integral(2.5)) == pytest.approx(2.5)
