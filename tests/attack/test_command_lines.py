"""Command lines that nobody should write: each ends with its code and one line, never with a traceback."""

from __future__ import annotations

from pathlib import Path

import pytest

from flashtemp.__main__ import main
from flashtemp.cli import commands

CASES = Path(__file__).parents[2] / "cases"
LONG = "x" * 300
FAN = """
import numpy as np
from flashtemp.physics import Effect, Heat, Param

class Fan(Effect):
    cause, source, tells = "a fan blows", "own", ("cooler",)
    h = Param(10.0, "W/m2K", "film", low=0.0, high=1e3, off=0.0)

    def heat(self, scene, p):
        yield Heat.film("road.free", lambda now, p: FILM)
"""


def said(capsys, *words: str) -> tuple[int, str]:
    """Exit code of a command, and its one line on stderr."""
    code = main([str(word) for word in words])
    shown = capsys.readouterr()
    assert "Traceback" not in shown.err + shown.out
    assert shown.err.strip().count("\n") == 0, shown.err
    return code, shown.err.strip()


@pytest.mark.parametrize(
    ("words", "tells"),
    [
        (["check", "resolved_spots", "resolved_spots.contact_map=0"], "resolved_spots.contact_map"),
        (["check", "slope_tester", "persson_friction.wlf=0"], "persson_friction.wlf"),
        (["check", "uniform_pressure", "contact.pressure=" + "1" * 5000], "contact.pressure"),
        (["check", "uniform_pressure", "contact.pressure=" + "[" * 3000], "nested too deep"),
        (["check", "uniform_pressure", "contact.alpha=" + "1" * 400], "at most 1.8e+308"),
        (["check", "uniform_pressure", f"contact.alpha={LONG}"], "contact.alpha"),
        (["check", "uniform_pressure", f"effects={LONG}"], "effects"),
        (["run", "uniform_pressure", "--out", LONG], "too long"),
        (["check", LONG], "too long"),
        (["view", "uniform_pressure/case.toml"], "no fields that flashtemp wrote"),
    ],
    ids=lambda value: "",
)
def test_bad_words_end_with_2_and_one_line(words, tells, capsys):
    command, case, *rest = words
    code, line = said(capsys, command, case if case == LONG else CASES / case, *rest)
    assert code == 2
    assert tells in line
    assert len(line) < 600


@pytest.mark.parametrize(
    ("film", "code", "tells"),
    [
        ("p.h * np.ones(4)", 2, "a film is one number"),
        ("p.h * now.nothing", 1, "effect 'fan'"),
    ],
)
def test_a_film_that_cannot_be_names_its_effect(film, code, tells, tmp_path, capsys):
    (tmp_path / "fan.py").write_text(FAN.replace("FILM", film), encoding="utf-8")
    (tmp_path / "case.toml").write_text('effects = ["./fan.py"]\n', encoding="utf-8")
    ended, line = said(capsys, "run", tmp_path, "--out", tmp_path / "out", "--trust")
    assert ended == code
    assert tells in line


@pytest.mark.long
def test_a_holder_that_hardly_gives_is_rigid(tmp_path, capsys):
    (tmp_path / "case.toml").write_text('effects = ["friction_moment"]\n', encoding="utf-8")
    small = ["schedule.distance=0.01", "numerics.mesh=coarse", "output.pictures=false", "output.vtk=false"]
    for give in ("5e-324", "0"):
        words = [f"friction_moment.compliance={give}", *small, "--out", str(tmp_path / give)]
        assert main(["run", str(tmp_path), *words]) == 0
    small, rigid = ((tmp_path / give / "profiles.csv").read_text() for give in ("5e-324", "0"))
    assert small == rigid


def test_a_fault_of_the_program_is_one_line_and_a_traceback_only_if_asked(monkeypatch, capsys):
    def broken(*args, **kwargs):
        raise ZeroDivisionError("two\nlines")

    monkeypatch.setattr(commands, "app", broken)
    code, line = said(capsys, "check")
    assert code == 1
    assert line == "the program failed: ZeroDivisionError: two lines; the same command with --debug shows where"
    assert main(["check", "--debug"]) == 1
    assert "Traceback" in capsys.readouterr().err
