"""Remarks before a run: a wrong unit is beyond the usual range, and a mesh too large for the memory is told."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from flashtemp.__main__ import main
from flashtemp.comparison.campaign import load as load_campaign
from flashtemp.comparison.condition_remarks import remark_on_conditions
from flashtemp.model.case import load_case
from flashtemp.runs.checks import case_remarks

CASES = Path(__file__).parents[2] / "cases"
CASE = CASES / "uniform_pressure"


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("contact.pressure", 150.0, "150 Pa is unusual"), ("schedule.speed", -360.0, "-360 m/s is unusual"),
        ("friction.mu", 8.0, "8 is unusual"), ("ambient.temperature", 293.15, "293.15 degC is unusual"),
        ("contact.pressure", 0.075, 'unit, or write "0.075 MPa" if that is meant'),
        ("contact.pressure", 150.0, '"150 kPa"'), ("schedule.speed", 250.0, '"250 mm/s"'),
        ("ambient.temperature", 293.15, '"293.15 K"'),
        ("contact.pressure", 4e5, ""), ("schedule.speed", -1.0, ""),
    ],
)  # fmt: skip
def test_a_value_in_a_wrong_unit_is_remarked(key, value, said):
    found = case_remarks.remark_on_values(load_case(CASE, {key: value}))
    assert [(r.key, said in r.text) for r in found] == ([(key, True)] if said else [])


def test_no_case_of_the_documentation_is_unusual():
    for folder in sorted(CASES.glob("*/case.toml")):
        if folder.parent.name in ("uniform_pressure", "run_in", "tyre", "face_milling", "slide2d"):
            case = load_case(folder.parent)
            assert case_remarks.remark_on_values(case) + case_remarks.remark_on_memory(case) == []


ROD = {"block.length": 0.0254, "block.width": 0.0254, "schedule.alone": 3600.0, "ambient.convection": 10.0}


@pytest.mark.parametrize(
    ("changed", "percent"),
    [
        ({}, "100 %"), ({"block.width": 0.05}, "51 %"), ({"block.width": 0.1}, ""), ({"ambient.convection": 0.0}, ""),
        ({"numerics.across": 3}, ""), ({"schedule.alone": 10.0}, ""),
    ],
)  # fmt: skip
def test_side_walls_that_2d_leaves_out_are_remarked(changed, percent):
    found = case_remarks.remark_on_side_walls(load_case(CASE, ROD | changed))
    assert [r.key for r in found] == ["ambient.convection"] * bool(percent)
    for remark in found:
        assert f"leaves out the walls at the sides, {percent} of" in remark.text
        assert "give numerics.across = 3" in remark.text


def test_check_and_campaigns_tell_the_side_walls_left_out(capsys, tmp_path):
    given = [f"{key}={value}" for key, value in ROD.items()]
    assert main(["check", str(CASE), *given, "--json"]) == 0
    assert any("walls at the sides" in line for line in json.loads(capsys.readouterr().out)["remarks"])
    (tmp_path / "case.toml").write_text("[schedule]\nalone = 3600.0\n[block]\nlength = 0.02\nwidth = 0.02\n")
    (tmp_path / "t.csv").write_text("time (s),T1 (degC)\n0,20\n10,21\n")
    (tmp_path / "campaign.toml").write_text('[[recording]]\nfile = "t.csv"\npoints = [{ name = "T1", z = 0.001 }]\n')
    [line] = remark_on_conditions(load_campaign(tmp_path))
    assert "case.toml: ambient.convection: in 2D" in line


def test_a_mesh_that_takes_much_memory_is_remarked(monkeypatch):
    monkeypatch.setattr(case_remarks, "_memory_bytes", lambda: 1e9)
    case = load_case(CASE, {"numerics.mesh": 16.0})
    [found] = case_remarks.remark_on_memory(case)
    assert found.key == "numerics.mesh"
    assert f"{case.scene.mesh.n_cells:,} cells take about 0.9" in found.text
    assert case_remarks.remark_on_memory(load_case(CASE)) == []
    monkeypatch.setattr(case_remarks, "_memory_bytes", lambda: None)
    assert case_remarks.remark_on_memory(case) == []


def test_check_prints_the_remarks_with_their_keys(capsys):
    assert main(["check", str(CASE), "contact.pressure=150", "--json"]) == 0
    [said] = json.loads(capsys.readouterr().out)["remarks"]
    assert said.startswith("contact.pressure: 150 Pa is unusual")
