"""A mesh coarser than verified is told, with the error that was measured on such a mesh."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from flashtemp.__main__ import main
from flashtemp.model.case import load_case
from flashtemp.runs.checks import mesh_error
from flashtemp.runs.checks.mesh_error import FACE_ERROR_PERCENT, estimate_face_error
from flashtemp.solver.time_integration import integrate_schedule

ROOT = Path(__file__).parents[2]
CASE = ROOT / "cases" / "uniform_pressure"
SHORT = {"schedule.distance": 0.5, "output.profiles": 2, "output.fields": 2}
QUIET = ("output.pictures=false", "output.vtk=false", "output.profiles=2", "schedule.distance=0.05")


def warnings(**numerics) -> list[str]:
    return mesh_error.warn_of_coarse_mesh(load_case(CASE, {f"numerics.{k}": v for k, v in numerics.items()}))


@pytest.mark.parametrize(
    ("numerics", "said"),
    [
        ({"mesh": 0.2}, "0.2 times the cells per direction; the error of the face temperature is about 5 %"),
        ({"mesh": 0.49}, "0.49 times"),
        ({"mesh": 1.0, "finer": [1, 0.3, 1]}, "0.3 times"),
        ({"mesh": 0.2, "finer": [3, 3, 3]}, None),
        ({"mesh": "coarse"}, None),
        ({"mesh": 0.5}, None),
        ({}, None),
    ],
)
def test_a_coarse_mesh_is_told(numerics, said):
    found = warnings(**numerics)
    assert len(found) == (said is not None)
    if said is not None:
        assert said in found[0]
        assert "give a finer numerics.mesh" in found[0]


def test_check_terminal_and_summary_tell(tmp_path, capsys):
    words = [str(CASE), "numerics.mesh=0.2", *QUIET]
    assert main(["check", *words, "--json"]) == 0
    [said] = json.loads(capsys.readouterr().out)["remarks"]
    assert said.startswith("mesh coarser than verified")
    assert main(["run", *words, "--out", str(tmp_path / "out")]) == 0
    assert said in capsys.readouterr().out
    assert said in json.loads((tmp_path / "out" / "summary.json").read_text())["remarks"]


def test_a_block_that_does_not_slide_is_not_judged():
    """The errors were measured on sliding blocks."""
    alone = load_case(CASE, {"numerics.mesh": 0.2, "schedule.alone": 10.0})
    assert mesh_error.warn_of_coarse_mesh(alone) == []


def test_the_estimate_is_what_was_measured():
    """Every stated error is the largest one measured, to two digits; between them it falls as the mesh gets finer."""
    worst = json.loads((ROOT / "benchmarks" / "results" / "mesh_error.json").read_text())["worst"]
    for factor, percent in FACE_ERROR_PERCENT.items():
        assert percent == pytest.approx(float(f"{worst[f'{factor:g}']:.2g}"), abs=0.051)
        assert estimate_face_error(factor) == pytest.approx(percent)
    assert np.all(np.diff([estimate_face_error(f) for f in np.geomspace(0.05, 1.0, 40)]) < 0)


def test_a_run_at_the_mesh_it_warns_of_is_so_far_off():
    """The estimate of 0.2 times the cells, against a run that is ten times as fine."""
    coarse, fine = (
        integrate_schedule(c.scene, c.settings)
        for c in (load_case(CASE, SHORT | {"numerics.mesh": m}) for m in (0.2, 2.0))
    )
    k = coarse.last_sliding_index
    length = 0.025
    inner = (coarse.x > 0.05 * length) & (coarse.x < 0.95 * length)
    off = coarse.T_block[k] - np.interp(coarse.x, fine.x, fine.T_block[k])
    percent = 100 * np.abs(off[inner]).max() / (fine.T_block[k].max() - 20.0)
    assert 0.5 * estimate_face_error(0.2) < percent < 1.1 * estimate_face_error(0.2)
