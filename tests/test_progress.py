"""What long work tells where no terminal shows a bar."""

from __future__ import annotations

import re

import numpy as np
import pytest

from flashtemp.__main__ import main
from flashtemp.cli import terminal
from flashtemp.discovery import discover


@pytest.fixture
def clock(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(terminal.time, "monotonic", lambda: now[0])
    return now


def lines(clock, capsys, seconds):
    watch = terminal.Lines("run_in")
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
    watch = terminal.Lines("spots")
    for second in range(130):
        clock[0] = float(second)
        watch(second, 30000.0)
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 3
    assert all(re.fullmatch(r"spots: 0 %, about 29[89]\d\d s left", line) for line in told), told


def test_first_tiny_steps_say_nothing_of_the_time_left(clock, capsys, monkeypatch):
    """While loops are compiled a run has done 1e-12 of its time: the pace would promise thousands of years."""
    monkeypatch.delenv("FLASHTEMP_PROGRESS", raising=False)
    watch = terminal.Lines("run")
    clock[0] = 7.0
    watch(1e-9, 440.0)
    assert capsys.readouterr().err == "run: 0 %\n"


@pytest.mark.parametrize("first", [1e-3, 5.0])
def test_time_left_follows_the_pace_of_late_not_that_of_the_first_steps(clock, capsys, monkeypatch, first):
    """The first steps of an integration are short, and a resumed run begins far from zero."""
    monkeypatch.delenv("FLASHTEMP_PROGRESS", raising=False)
    watch, done = terminal.Lines("run"), 0.0
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
    """From its first look on; what is left falls while a stage lasts, and what comes after it is never forgotten."""
    now, told = [0.0], []
    monkeypatch.setattr(discover.time, "monotonic", lambda: now[0])
    say = discover._timed(told.append)
    for at, text in (
        (0.0, "calibrating the model"), (15.0, "going to the best point"), (18.0, "  round 2"), (60.0, "  round 3"),
        (60.0, "traces of the candidates"), (100.0, "fitting tilt"), (100.0, "traces of the candidates"),
        (120.0, "judging"), (120.0, "looking for a law"), (150.0, "fitting: a law"),
    ):  # fmt: skip
        now[0] = at
        say(text)
    left = [re.search(r"about (\d+) s left", t) for t in told]
    assert left[0] is None
    assert [int(m[1]) for m in left[1:]] == [85, 82, 140, 140, 100, 33, 6, 180, 150]


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
