"""The shortest wait between repetitions: verified by marching, or an honest no."""

from __future__ import annotations

import json
from math import exp, log, sqrt

import pytest

from flashtemp import simulate
from flashtemp.__main__ import main
from flashtemp.errors import BadInput
from flashtemp.model.case import load_case
from flashtemp.runs.studies.wait_time import (
    MAX_MARCHES,
    TEMPERATURE_TOLERANCE_K,
    WAIT_TOLERANCE,
    PeakTemperature,
    find_minimum_wait,
    format_duration,
)

SMALL = {  # a thin block on a cold holder: seconds of waiting count
    "effects": ["holder_sink"],
    "holder_sink.coefficient": 2000.0,
    "block.height": 0.002,
    "road.depth": 0.01,
    "schedule.distance": 0.2,
    "schedule.repetitions": 2,
    "numerics.cells": [8, 8, 8],
    "output.profiles": 6,
}


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("case") / "case.toml"
    path.write_text("")
    return path


@pytest.fixture(scope="module")
def case(file):
    return lambda **given: load_case(file, SMALL | {k.replace("__", "."): v for k, v in given.items()})


def highest(case, curve: str = "T_block") -> float:
    """Highest temperature of a case, by the way of every run."""
    return float(getattr(simulate(case), curve).max())


def arguments(file, *more: str) -> list[str]:
    return ["wait", str(file), *(f"{k}={json.dumps(v)}" for k, v in SMALL.items()), *more]


@pytest.mark.parametrize(("of", "curve", "share"), [("block", "T_block", 0.5), ("spot", "T_spot", 0.6)])
@pytest.mark.sample("spot-T_spot-0.6")
def test_answer_is_long_enough_and_a_tenth_less_is_not(case, file, capsys, of, curve, share):
    none, long = highest(case(), curve), highest(case(schedule__wait=100.0), curve)
    below = round(long + share * (none - long), 2)
    assert main(arguments(file, "--below", str(below), "--of", of, "--json")) == 0
    out, err = capsys.readouterr()
    assert err == ""
    answer = json.loads(out)
    assert highest(case(schedule__wait=answer["wait"]), curve) == pytest.approx(answer["reached"], abs=1e-9)
    assert answer["reached"] <= below
    assert highest(case(schedule__wait=0.9 * answer["wait"]), curve) > below
    assert answer["too_short"] < answer["wait"]
    near = (
        answer["reached"] > below - TEMPERATURE_TOLERANCE_K
        or answer["wait"] < answer["too_short"] * (1 + WAIT_TOLERANCE) + WAIT_TOLERANCE
    )
    assert near
    assert len(answer["tried"]) <= MAX_MARCHES + 3
    assert answer["total"] == pytest.approx(2 * 2.0 + answer["wait"])


def test_text_and_progress(file, capsys, monkeypatch):
    """The printed wait is rounded up; every march is told on stderr."""
    monkeypatch.setattr(
        "flashtemp.runs.studies.wait_time._simulate_with_wait",
        lambda case, wait, of: PeakTemperature(wait, 30 + 20 / (1 + wait / 7), 3, 29, 9000),
    )
    assert main(arguments(file, "--below", "40")) == 0
    out, err = capsys.readouterr()
    lines = out.splitlines()
    wait = float(lines[0].split()[1])
    assert lines[0] == f"wait {wait:g} s between repetitions to keep the block's surface below 40 degC"
    assert 7.0 <= wait < 7.2
    assert "in repetition 3; the test takes 2.5 h" in lines[1]
    assert "too short" in lines[2]
    assert err.splitlines()[0] == "wait 0 s: 50.00 degC in repetition 3"


@pytest.mark.parametrize("constant", [1.0, 30.0, 1000.0])
@pytest.mark.parametrize("level", [0.05, 0.3, 0.9])
def test_few_marches_suffice(case, monkeypatch, constant, level):
    """Cooling like exp(-sqrt(wait/constant)), hot by 20 K: within the tolerance in at most 12 marches."""
    monkeypatch.setattr(
        "flashtemp.runs.studies.wait_time._simulate_with_wait",
        lambda case, wait, of: PeakTemperature(wait, 40 + 20 * exp(-sqrt(wait / constant)), 3, 40, 0),
    )
    below, exact = 40 + 20 * level, constant * log(level) ** 2
    answer = find_minimum_wait(case(), below)
    assert len(answer.tried) <= 12
    assert exact <= answer.wait <= float(str(answer).split()[1])
    assert (
        answer.reached > below - TEMPERATURE_TOLERANCE_K or answer.wait <= exact * (1 + WAIT_TOLERANCE) + WAIT_TOLERANCE
    )


def test_no_wait_is_needed(case):
    answer = find_minimum_wait(case(), 90.0)
    assert (answer.wait, len(answer.tried), answer.too_short) == (0.0, 1, None)
    assert "no wait is needed" in str(answer)


def test_first_repetition_alone_is_too_hot(case):
    answer = find_minimum_wait(case(), 25.0)
    assert (answer.wait, len(answer.tried)) == (None, 1)
    first = highest(case(schedule__repetitions=1))
    assert f"the first repetition alone reaches {first:.2f} degC" in str(answer)
    for key in ("contact.pressure", "schedule.speed"):
        assert key in str(answer)


@pytest.mark.long
def test_six_hours_do_not_help(case):
    """An insulated block keeps its heat; waiting only spreads it."""
    warm = case(holder_sink__coefficient=0.0, ambient__convection=0.0)
    kept = highest(case(holder_sink__coefficient=0.0, ambient__convection=0.0, schedule__wait=600.0))
    answer = find_minimum_wait(warm, kept - 0.5)
    assert answer.wait is None
    assert [peak.wait for peak in answer.tried] == pytest.approx([0.0, 600.0, 21600.0])
    assert answer.too_short == pytest.approx(21600.0)
    assert answer.reached == pytest.approx(kept, abs=0.2)
    assert answer.tried[0].first < answer.below < answer.reached
    assert "even with 6 h of it" in str(answer)
    assert "the temperature rise must decrease by" in str(answer)


@pytest.mark.parametrize(
    ("more", "says"),
    [
        (["--below", "20"], "--below: 20 degC; give more than ambient.temperature = 20"),
        (["--below", "nan"], "--below: nan degC; give more"),
        (["--below", "inf"], "--below: inf degC; give"),
        (["--below", "45", "schedule.repetitions=1"], "case.toml: schedule.repetitions: 1 leaves nothing to wait for; give 2"),
        (["--below", "45", "schedule.wait=-1"], "schedule.wait (command line): -1"),
        (["--below", "45", "--of", "road"], "--of"),
        ([], "--below"),
        (["--below", "hot"], "hot"),
    ],
    ids=str,
)  # fmt: skip
def test_one_line_that_helps(file, capsys, more, says):
    assert main(arguments(file, *more)) == 2
    out, err = capsys.readouterr()
    assert out == ""
    [line] = err.splitlines()
    assert says in line


def test_of_what_from_python(case):
    with pytest.raises(BadInput, match="--of: 'road'; give block or spot"):
        find_minimum_wait(case(), 50.0, "road")


def test_failure_is_an_exit_code_of_its_own(file, capsys):
    """Friction that rises with temperature without bound ends the march, not the program."""
    runaway = ["effects=friction_softening", "friction_softening.b=-0.05", "friction.mu=2.0", "--below", "45"]
    arguments = ["wait", str(file), "schedule.distance=0.2", "schedule.repetitions=2", "numerics.cells=[8, 8, 8]"]
    assert main([*arguments, *runaway]) == 1
    assert "the computation failed" in capsys.readouterr().err


def test_clock():
    assert [format_duration(s) for s in (8.0, 440.0, 21600.0)] == ["8 s", "7.33 min", "6 h"]
