"""Command lines that nobody should write: each ends with its code and one line, never with a traceback."""

from __future__ import annotations

import os
import signal
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
        (["check", "uniform_pressure", "contact.alpha=" + "1" * 400], "more than 64 bits"),
        (["check", "uniform_pressure", f"contact.alpha={LONG}"], "contact.alpha"),
        (["check", "uniform_pressure", f"effects={LONG}"], "effects"),
        (["run", "uniform_pressure", "--out", LONG], "too long"),
        (["check", LONG], "too long"),
        (["view", "uniform_pressure/case.toml"], "not a field file of flashtemp"),
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


# --- names that no file of a user has ------------------------------------------------------------------
ODD = (
    "a\0b", "n" * 5000, "/".join(["n" * 200] * 30), "", ".", "..", "/", "/dev/null", "/dev/zero", "fifo", "loop", "folder",
    "file.txt", "file.txt/x", "none/there.toml", "a\nb", "\x1b[31mred", "caf\udce9", "\u009b2J", "a\rb",
)  # fmt: skip
READS = {  # commands with @ where a name of something to be read stands
    "check": "check @", "run": "run @", "view": "view @", "draw": "draw @", "report": "report @", "paged": "report @ --pdf", "sweep": "sweep @ friction.mu=0.5,0.6",
    "converge": "converge @", "sensitivity": "sensitivity @", "import": "import @ --out r.nc", "look": "import @ --look",
    "second": "import table.csv @ --out r.nc", "compare": "compare @", "discover": "discover @", "plan": "plan @",
    "twin": "twin @ --hide wear --seed 1 --out t", "repetitions": "repetitions @", "wait": "wait @",
    "effects": "effects --check @", "friction": "friction @", "loads": "loads @", "tread": "tread @", "tyre": "tyre @",
    "spots": "spots @ --cutoff 1e-3 --out m.npz", "spectrum": "spectrum @ --out s.csv", "resume": "run --resume @",
    "value": "check c @", "pressure": "check c contact.pressure=@", "speed": "check c schedule.speed=@",
    "map": "check c effects=resolved_spots resolved_spots.contact_map=@", "material": "check c block.material=@",
    "curve": "check c effects=persson_friction persson_friction.master_curve=@", "own": "check c effects=@.py",
    "option": "check c --x@", "command": "@", "kind": "new @",
}  # fmt: skip
WRITES = {  # and where something new is to be written
    "run": "run c --out @", "sweep": "sweep c friction.mu=0.5,0.6 --out @", "import": "import table.csv --out @",
    "look": "import table.csv --look --out @", "compare": "compare c --out @", "discover": "discover c --out @",
    "twin": "twin c --hide wear --seed 1 --out @", "friction": "friction c --out @", "loads": "loads c --out @",
    "tread": "tread c --out @", "view": "view c --screenshot @", "spots": "spots --synthetic --cutoff 1e-3 --out @",
    "spectrum": "spectrum table.csv --out @", "new": "new case @", "log": "check c --log @",
}  # fmt: skip
NEW = ("none/there.toml",)  # commands make the folders that lack
SOON_S = 10


@pytest.fixture
def here(tmp_path, monkeypatch):
    """An ordinary folder with one of everything in it, in which commands are given."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "case.toml").write_text('title = "x"\n', encoding="utf-8")
    (tmp_path / "file.txt").write_text("hello\n", encoding="utf-8")
    (tmp_path / "table.csv").write_text("0,1e5\n1,2e5\n", encoding="utf-8")
    (tmp_path / "folder").mkdir()
    (tmp_path / "loop").symlink_to("loop")
    os.mkfifo(tmp_path / "fifo")

    def late(*_):
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, late)
    yield tmp_path
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def check_each(here, capsys, line: str, names) -> None:
    """A command with each of the names ends soon with 2 and one short line, and leaves nothing behind."""
    before = sorted(here.rglob("*"))
    for name in names:
        signal.alarm(SOON_S)
        code, told = said(capsys, *(word.replace("@", name) for word in line.split(" ")))
        signal.alarm(0)
        shown = ascii(name)[:40]
        assert code == 2, f"{shown}: {code}: {told}"
        assert 0 < len(told) < 900, f"{shown}: {told}"
        assert told.isprintable(), f"{shown}: {told!r}"
    assert sorted(here.rglob("*")) == before


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes with names")
@pytest.mark.parametrize("line", READS.values(), ids=READS)
def test_a_name_of_nothing_that_can_be_read_is_one_line(line, here, capsys):
    absent = [] if line.startswith("effects") else ["x" * 40]
    names = [*(n for n in ODD if not (n == "" and line.endswith(("=@", "--x@")))), *absent]
    check_each(here, capsys, line, names)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes with names")
@pytest.mark.parametrize("line", WRITES.values(), ids=WRITES)
def test_a_name_under_which_nothing_can_be_written_is_one_line(line, here, capsys):
    can = {*NEW, *({"file.txt"} if "--log" in line else ())}
    check_each(here, capsys, line, [name for name in ODD if name not in can])


def test_a_value_over_several_lines_is_a_value(here, capsys):
    assert main(["check", "c", "contact.pressure=[[0, 1e5],\n\t[1, 2e5]]"]) == 0
    code, line = said(capsys, "check", "c", "contact.pressure=[[0, 1e5],\n\t[1, -2e5]]")
    assert (code, "contact.pressure" in line) == (2, True)


def test_a_result_may_have_any_name_that_can_be_read(here):
    """Also one that begins with ~, which libraries take for a home."""
    assert main(["new", "case", "~nobody.toml"]) == 0
    assert main(["new", "case", "mit Blank é.toml"]) == 0
    assert (here / "~nobody.toml").is_file()
    assert (here / "mit Blank é.toml").is_file()
