"""`flashtemp draw`: pictures again from a finished result, the same to the byte, in PNG, SVG and PDF."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import numpy as np
import pytest

import flashtemp
from flashtemp.__main__ import main
from flashtemp.errors import IncompleteResult
from flashtemp.runs.load_run import open_run

CASE = """title = "small"
effects = ["wear"]
[block]
height = 0.005
[road]
depth = 0.01
[schedule]
distance = 0.05
repetitions = 2
wait = 1.0
[numerics]
mesh = 0.3
[output]
profiles = 6
fields = 3
"""


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    folder = tmp_path_factory.mktemp("case")
    (folder / "case.toml").write_text(CASE)
    return folder


@pytest.fixture(scope="module")
def result(case, tmp_path_factory):
    """A finished run with its folder."""
    out = tmp_path_factory.mktemp("result") / "a"
    return flashtemp.simulate(case, out=out, pvd=True), out


@pytest.mark.parametrize("more", [{}, {"numerics.across": 6}, {"schedule.turn": 1}], ids=["2D", "3D", "back"])
def test_what_is_read_back_is_the_run(case, tmp_path, more):
    out = tmp_path / "a"
    run = flashtemp.simulate(case, {"output.pictures": False} | more, out=out)
    _, again = open_run(out)
    assert again.statistics.keys() == run.statistics.keys()
    assert again.summary == json.loads((out / "summary.json").read_text())
    for name in (
        "time",
        "repetition",
        "T_spot",
        "T_wake",
        "pressure",
        "worn",
        "tilt",
        "friction",
        "frames",
        "field",
        "sliding",
    ):
        np.testing.assert_array_equal(getattr(again, name), getattr(run, name), err_msg=name)
    for name in ("direction", "T_ahead"):
        assert (getattr(run, name) is None) == ("schedule.turn" not in more)
        np.testing.assert_array_equal(getattr(again, name), getattr(run, name))
    for name in ("maps", "energy"):
        assert getattr(again, name).keys() == getattr(run, name).keys()
        for key, values in getattr(run, name).items():
            np.testing.assert_array_equal(getattr(again, name)[key], values)


def test_pictures_come_again_to_the_byte(result):
    _, out = result
    before = {p.name: p.read_bytes() for p in out.iterdir() if p.suffix in (".png", ".gif")}
    assert {"profile.png", "field.png", "run_in.png", "run_in.gif"} <= before.keys()
    for name in before:
        (out / name).unlink()
    drawn = flashtemp.draw(out)
    assert {p.name: p.read_bytes() for p in drawn.files} == before
    assert drawn.as_dict()["files"] == [p.name for p in drawn.files]


def temperatures(out) -> dict[str, list]:
    """Temperatures of every file of a series for ParaView."""
    import pyvista as pv

    return {p.name: pv.read(p)["T_degC"].tolist() for p in (out / "pvd").glob("*.vtr")}


@pytest.mark.long
def test_for_print_and_for_older_paraview(result, capsys):
    _, out = result
    series = temperatures(out)
    assert main(["draw", str(out), "--pvd"]) == 2
    assert "pvd exists" in capsys.readouterr().err
    for file in (out / "pvd").iterdir():
        file.unlink()
    (out / "pvd").rmdir()
    assert main(["draw", str(out), "--format", "svg,pdf", "--pvd", "--json"]) == 0
    assert "profile.pdf" in json.loads(capsys.readouterr().out)["files"]
    assert b"<svg" in (out / "profile.svg").read_bytes()[:1000]
    assert (out / "field.pdf").read_bytes().startswith(b"%PDF")
    assert temperatures(out) == series


def test_without_fields_the_other_pictures_are_drawn(case, tmp_path, capsys):
    flashtemp.simulate(case, {"output.vtk": False, "output.pictures": False}, out=tmp_path / "a")
    assert main(["draw", str(tmp_path / "a")]) == 1
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert "field.png" in said
    assert "profile.png" not in said
    assert "output.vtk = false" in said
    assert (tmp_path / "a" / "profile.png").is_file()


@pytest.mark.long
def test_fields_of_a_run_whose_pictures_failed_lie_beside_its_checkpoint(case, tmp_path, monkeypatch):
    """Also where output.vtk = false keeps none in a result that is whole."""
    with monkeypatch.context() as m:
        m.setattr(
            "flashtemp.runs.results.processes.cores", lambda: 1
        )  # a second process would know nothing of what follows
        m.setattr("flashtemp.viz.run.field.draw", lambda run: 1 / 0)
        with pytest.raises(IncompleteResult, match=r"missing in .*field.png \(ZeroDivisionError: division by zero\)"):
            flashtemp.simulate(case, {"output.vtk": False, "output.animation": False}, out=tmp_path / "a")
    assert not (tmp_path / "a" / "field.png").exists()
    assert tmp_path / "a" / "field.png" in flashtemp.draw(tmp_path / "a").files


@pytest.mark.long
def test_a_backend_that_does_not_exist(case, tmp_path):
    """The real thing: matplotlib itself refuses to load; the march is there all the same."""
    command = [sys.executable, "-m", "flashtemp"]
    words = ["run", str(case), "output.animation=false", "--out", str(tmp_path / "a")]
    done = subprocess.run(
        [*command, *words], env=os.environ | {"MPLBACKEND": "nonsense"}, capture_output=True, text=True
    )
    assert done.returncode == 1
    assert done.stderr.strip().splitlines()[-1].startswith(f"missing in {tmp_path / 'a'}: profile.png, map.png")
    assert done.stderr.strip().endswith(f"draw again with: flashtemp draw {tmp_path / 'a'}")
    assert "Traceback" not in done.stderr
    assert {"run.nc", "checkpoint.h5", "frames.bin"} <= {p.name for p in (tmp_path / "a").iterdir()}
    assert main(["draw", str(tmp_path / "a")]) == 0
    assert (tmp_path / "a" / "budget.png").is_file()


def test_a_sweep_is_drawn_again(case, tmp_path):
    flashtemp.sweep(case, {"friction.mu": [0.5, 0.6]}, out=tmp_path / "a", workers=1)
    before = (tmp_path / "a" / "sweep.png").read_bytes()
    (tmp_path / "a" / "sweep.png").unlink()
    flashtemp.draw(tmp_path / "a", format="png,pdf")
    assert (tmp_path / "a" / "sweep.png").read_bytes() == before
    assert (tmp_path / "a" / "sweep.pdf").is_file()


@pytest.mark.parametrize(
    ("spoil", "words", "says"),
    [
        (None, ["--format", "bmp"], "--format: 'bmp'; give one or more of png, svg, pdf"),
        ("run.nc", [], "damaged"),
        ("summary.json", [], "damaged"),
        ("fields.vtkhdf", [], "fields"),
        ("", [], "not a result of flashtemp run"),
    ],
)
def test_what_cannot_be_drawn_is_told_in_one_line(case, tmp_path, capsys, spoil, words, says):
    out = tmp_path / "a"
    if spoil == "":
        out.mkdir()
    else:
        flashtemp.simulate(case, {"output.pictures": False}, out=out)
    if spoil:
        (out / spoil).write_bytes((out / spoil).read_bytes()[: (out / spoil).stat().st_size // 2])
    assert main(["draw", str(out), *words]) == 2
    said = capsys.readouterr().err.strip()
    assert says in said
    assert "\n" not in said
