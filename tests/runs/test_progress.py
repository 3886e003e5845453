"""What long work tells where no terminal shows a bar."""

from __future__ import annotations

import itertools
import re

import numpy as np
import pytest

from flashtemp.__main__ import main
from flashtemp.cli import terminal
from flashtemp.discovery import engine


@pytest.fixture
def clock(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(terminal.time, "monotonic", lambda: now[0])
    return now


def lines(clock, capsys, seconds):
    watch = terminal.ProgressLines("run_in")
    for k in range(seconds):
        clock[0] = float(k)
        watch(k, seconds)
    return capsys.readouterr().err.splitlines()


def test_a_log_gets_a_line_soon_and_then_one_a_minute(clock, capsys, monkeypatch):
    monkeypatch.delenv("FLASHTEMP_PROGRESS", raising=False)
    told = lines(clock, capsys, 301)
    assert len(told) == 5
    percent, left = zip(
        *(map(int, re.fullmatch(r"run_in: (\d+) %, about (\d+) s left", t).groups()) for t in told), strict=True
    )
    assert left[0] == 301 - 7  # after a tenth of a minute
    assert all(abs(p / 100 * 301 + s - 301) < 2 for p, s in zip(percent, left, strict=True))


def test_slow_work_says_how_long_it_takes_from_the_first_line_on(clock, capsys, monkeypatch):
    """Also where a minute does less than a hundredth of it, as 3 m of resolved spots in 3D."""
    monkeypatch.delenv("FLASHTEMP_PROGRESS", raising=False)
    watch = terminal.ProgressLines("spots")
    for second in range(130):
        clock[0] = float(second)
        watch(second, 30000.0)
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 3
    assert all(re.fullmatch(r"spots: 0 %, about 29[89]\d\d s left", line) for line in told), told


def test_first_tiny_steps_say_nothing_of_the_time_left(clock, capsys, monkeypatch):
    """While loops are compiled a run has done 1e-12 of its time: the pace would promise thousands of years."""
    monkeypatch.delenv("FLASHTEMP_PROGRESS", raising=False)
    watch = terminal.ProgressLines("run")
    clock[0] = 7.0
    watch(1e-9, 440.0)
    assert capsys.readouterr().err == "run: 0 %\n"


@pytest.mark.parametrize("first", [1e-3, 5.0])
def test_time_left_follows_the_pace_of_late_not_that_of_the_first_steps(clock, capsys, monkeypatch, first):
    """The first steps of an integration are short, and a resumed run begins far from zero."""
    monkeypatch.delenv("FLASHTEMP_PROGRESS", raising=False)
    watch, done = terminal.ProgressLines("run"), 0.0
    for second in range(200):
        clock[0] = float(second)
        done += first if second < 20 else 1.0
        watch(done, 1000.0)
    left = int(re.search(r"about (\d+) s left", capsys.readouterr().err.splitlines()[-1])[1])
    at = int(np.floor(3 * 60 + 0.1 * 60)) + 1
    assert left == pytest.approx(1000.0 - 20 * first - (at - 20), rel=0.01)


def test_who_reads_along_may_ask_for_more(clock, capsys, monkeypatch):
    monkeypatch.setenv("FLASHTEMP_PROGRESS", "2")
    assert len(lines(clock, capsys, 301)) > 140


def test_discovery_says_how_long_it_takes_as_soon_as_it_can(monkeypatch):
    """From its first simulations on; a new stage sets the estimate, which falls between them.  A law is a new stage: it
    takes three times as long as all before."""
    now, told = [0.0], []
    monkeypatch.setattr(engine.time, "monotonic", lambda: now[0])
    say = engine._with_time_left(told.append)
    for at, text in (
        (0.0, "simulating the stated model"), (10.0, "simulating coarser meshes"), (30.0, "calibrating the stated model"),
        (35.0, "  evaluation 1"), (60.0, "sensitivities of 8 candidates"), (80.0, "fitting tilt"), (85.0, "judging"),
        (90.0, "checking 22 stated inputs"), (90.0, "identifying a law: 20 are scored"), (95.0, "judging"),
    ):  # fmt: skip
        now[0] = at
        say(text)
    left = [re.search(r"about (\d+) s left", t) for t in told]
    assert left[:2] == [None, None]
    parts = [
        engine.STAGE_START_FRACTIONS[stage]
        for stage in ("calibrating", "sensitivities", "fitting", "judging", "checking")
    ]
    assert parts == sorted(parts)
    begins = [t * (1.0 / p - 1.0) for t, p in zip((30.0, 60.0, 80.0, 85.0, 90.0), parts, strict=True)]
    expected = [
        begins[0],
        begins[0] ** 2 / (begins[0] + 5.0),
        *begins[1:],
        270.0,
        270.0**2 / (270.0 + 5.0),
    ]
    assert [int(m[1]) for m in left[2:]] == [round(t) for t in expected]


def test_time_left_of_a_discovery_falls_while_stages_repeat(monkeypatch):
    """Many fits and inputs tried again: the estimate falls, and the part done grows, until a new stage begins."""
    now, told = [0.0], []
    monkeypatch.setattr(engine.time, "monotonic", lambda: now[0])
    say = engine._with_time_left(told.append)
    repeated = ["calibrating", "  evaluation 1", "sensitivities of 8 candidates", "fitting tilt", "  evaluation 2"]
    for at, text in enumerate([*repeated, *repeated * 20]):
        now[0] = 10.0 + 3.0 * at
        say(text)
    details = [t.details for t in told[3:]]  # from the last new stage on
    left, done = ([d[key] for d in details] for key in ("left_s", "fraction_done"))
    assert all(0.0 < later < earlier for earlier, later in itertools.pairwise(left))
    assert all(earlier < later < 1.0 for earlier, later in itertools.pairwise(done))
    now[0] += 3.0
    say("judging")
    assert told[-1].details["fraction_done"] == engine.STAGE_START_FRACTIONS["judging"]


def test_what_is_short_says_nothing(clock, capsys):
    assert lines(clock, capsys, 5) == []


def test_everything_said_goes_to_a_log_too(tmp_path, capsys):
    (tmp_path / "case.toml").write_text("")
    log = tmp_path / "all.log"
    assert main(["check", str(tmp_path), "--log", str(log)]) == 0
    assert main(["check", str(tmp_path), "contact.pressure=-1", f"--log={log}"]) == 2
    said = capsys.readouterr()
    text = log.read_text()
    assert text.count("# 20") == 2
    for line in (*said.out.splitlines(), *said.err.splitlines()):
        assert line in text
    assert "contact.pressure" in said.err


@pytest.mark.parametrize(
    ("words", "told"),
    [(["check", ".", "--log"], "--log: missing"), (["check", ".", "--log", "/no/such/a.log"], "No such file")],
)
def test_a_log_that_cannot_be_written_is_told(capsys, words, told):
    assert main(words) == 2
    assert told in capsys.readouterr().err
