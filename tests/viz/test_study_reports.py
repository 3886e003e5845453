"""Reports of sweep, sensitivity and plan: answer, numbers with units, picture, conditions, and how to run it again."""

from __future__ import annotations

import json
import re
import shlex
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
import xarray as xr

import flashtemp
from flashtemp.__main__ import main
from flashtemp.errors import BadInput
from flashtemp.viz.html import study_report
from flashtemp.viz.html.page import table

CASE = """title = "small block"
[schedule]
distance = 0.05
repetitions = 1
[numerics]
mesh = 0.5
[output]
animation = false
vtk = false
"""
PNG = b"\x89PNG\r\n\x1a\n"


def text_of(folder):
    html = (folder / "report.html").read_text(encoding="utf-8")
    return " ".join(re.sub(r"<style>.*?</style>|<[^>]+>", " ", html, flags=re.DOTALL).split())


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    folder = tmp_path_factory.mktemp("swept")
    (folder / "case.toml").write_text(CASE)
    axes = {"contact.pressure": [1e5, 2e5], "schedule.speed": [0.05, 0.1]}
    flashtemp.sweep(folder / "case.toml", axes, out=folder / "sweep", workers=1)
    return folder / "sweep"


def test_the_report_of_a_sweep_takes_no_data_of_a_file_outside_of_its_folder(tmp_path):
    (tmp_path / "secret.bin").write_bytes(np.full(2, 4711.0).tobytes())
    (tmp_path / "r").mkdir()
    (tmp_path / "r" / "case.toml").write_text(CASE)
    with h5py.File(tmp_path / "r" / "sweep.nc", "w") as out:
        out.create_dataset("T_max_degC", (2,), "f8", external=[(str(tmp_path / "secret.bin"), 0, 16)])
    with pytest.raises(BadInput, match="keeps its data in another file"):
        flashtemp.report(tmp_path / "r")


def test_the_report_of_a_sweep_has_its_numbers_conditions_and_command(swept):
    assert main(["report", str(swept)]) == 0
    said, data = text_of(swept), xr.load_dataset(swept / "sweep.nc", engine="h5netcdf")
    hottest = data.T_max_degC
    assert f"{float(hottest.max()):.3g} °C at contact pressure 0.2 MPa, speed 0.1 m/s" in said
    assert "contact pressure 0.1, 0.2 MPa" in said
    for value in (*hottest.values.ravel(), *data.rise_trailing_K.values.ravel()):
        assert f" {value:.3g} " in said
    command = re.search(r"flashtemp sweep (\S+) (contact.pressure=\S+) (schedule.speed=\S+)", said)
    assert [float(v) for v in command[2].split("=")[1].split(",")] == [1e5, 2e5]
    html = (swept / "report.html").read_text()
    assert html.count("<img") == 1
    assert "<script" not in html


def test_simulations_of_a_sweep_that_failed_are_counted():
    points = [{"schedule.speed": 0.1}, {"schedule.speed": 0.2}]
    answer, failed = study_report._summarise_sweep(np.array([30.0, np.nan]), points)
    assert "30 °C at speed 0.1 m/s" in answer[0]
    assert failed.startswith("1 simulation failed")
    assert study_report._summarise_sweep(np.full(2, np.nan), points)[0] == ["All 2 simulations failed."]


NUMBER = {"words": "T_spot", "unit": "degC", "value": 40.26, "sd": 1.958, "band95": [36.42, 44.1],
          "per_sd": {"friction.mu": 1.013, "contact.pressure": 0.405},
          "first_order": {"friction.mu": 0.75, "contact.pressure": 0.2},
          "total": {"friction.mu": 0.8, "contact.pressure": 0.25}}  # fmt: skip
SENSITIVITY = {
    "mode": "linear", "check": {}, "left_out": ["block.density"],
    "inputs": [{"key": "friction.mu", "value": 1.0, "sd": 0.05, "unit": "1", "reason": "load cell"},
               {"key": "contact.pressure", "value": 1.5e5, "sd": 3e3, "unit": "Pa", "reason": "dead weight"}],
    "numbers": {"T_spot_L": NUMBER}, "conclusions": ["T_spot: 40, 95 % band 36 to 44", "the accuracy was not checked"],
}  # fmt: skip


@pytest.fixture
def studied(tmp_path):
    (tmp_path / "case.toml").write_text(CASE)
    (tmp_path / "sensitivity.json").write_text(json.dumps(SENSITIVITY))
    (tmp_path / "sensitivity.png").write_bytes(PNG + b"rest")
    return tmp_path


def test_the_report_of_a_sensitivity_study_has_bands_inputs_and_shares(studied):
    assert main(["report", str(studied)]) == 0
    said = text_of(studied)
    assert "contact spots at the trailing edge is 40.3 °C, 95 % band 36.4 to 44.1 °C; 80 % of its variance" in said
    assert "contact pressure MPa 0.15 0.003 dead weight" in said
    assert "friction mu 1.01 75 80" in said
    assert "The accuracy was not checked." in said
    assert "Without a standard deviation, so fixed: block density." in said
    assert (
        shlex.join(
            ["flashtemp", "sensitivity", str(studied / "case.toml"), "friction.mu", "contact.pressure", "--linear"]
        )
        in said
    )
    assert "The result folder has no picture profile.png." in said


PLAN = {
    "title": "planned <b>", "experiments": [{"words": "at half the pressure", "helps": ["wear"]}], "sensors": [],
    "effects": [
        {"effect": "wear", "z": 4.0, "z_left": 2.0, "detectable": None, "unit": "m", "nearest": "none", "rho": 0.0,
         "separable": False},
        {"effect": "pressure_tilt", "z": 27.0, "z_left": 10.0, "detectable": 0.0927, "unit": "1", "nearest": "air_gap",
         "rho": 0.755, "separable": True},
    ],
}  # fmt: skip


def test_the_report_of_a_plan_says_what_can_be_distinguished_and_what_to_add(tmp_path):
    (tmp_path / "plan.json").write_text(json.dumps(PLAN))
    assert main(["report", str(tmp_path)]) == 0
    said = text_of(tmp_path)
    assert "can distinguish 1 of 2 effects from all others: pressure tilt." in said
    assert "One more condition or sensor, at half the pressure, also distinguishes wear." in said
    assert "pressure tilt yes 27 10 0.0927 air gap (0.755)" in said
    assert "wear no 4 2 never none" in said
    assert "planned &lt;b&gt;" in said
    assert main(["report", str(tmp_path)]) == 2, "it is kept: add --pdf"


def test_a_plan_writes_its_report_with_conditions_and_command(tmp_path, monkeypatch):
    from flashtemp.api import campaigns
    from flashtemp.comparison.campaign import load

    (tmp_path / "case.toml").write_text(CASE)
    (tmp_path / "campaign.toml").write_text('[[recording]]\nview = "sidewall"\nwith = { "schedule.speed" = 0.2 }\n')
    design = SimpleNamespace(as_dict=lambda: PLAN)
    monkeypatch.setattr(campaigns.experiment_design, "assess_design", lambda *a: design)
    monkeypatch.setattr(campaigns, "prepare_problem", lambda *a: None)
    monkeypatch.setattr("flashtemp.viz.verdict.separability.draw", lambda d: None)
    monkeypatch.setattr("flashtemp.viz.theme.save_figure", lambda figure, path: path)
    campaigns.plan(load(tmp_path, planned=True), out=tmp_path / "plan")
    said = text_of(tmp_path / "plan")
    assert f"flashtemp plan {tmp_path}" in said
    assert "speed 0.2 m/s" in said


@pytest.mark.parametrize("value", [None, 7, [], {}, {"T_spot_L": {}}, {"T_spot_L": NUMBER | {"total": 3}}])
def test_damaged_numbers_are_refused_in_one_line(studied, value):
    (studied / "sensitivity.json").write_text(json.dumps(SENSITIVITY | {"numbers": value}))
    if value in ([], {}):
        flashtemp.report(studied)  # no number is no damage
        return
    with pytest.raises(BadInput, match="sensitivity.json: damaged"):
        flashtemp.report(studied)


@pytest.mark.parametrize("content", ["", "[1]", "{", '{"effects": 3}', '{"effects": [{}]}'])
def test_a_damaged_plan_is_refused_in_one_line(tmp_path, content):
    (tmp_path / "plan.json").write_text(content)
    with pytest.raises(BadInput, match=r"plan\.json"):
        flashtemp.report(tmp_path)


def test_columns_of_words_are_aligned_left():
    html = table(["effect", "named", "z"], [["wear", "yes", "4.0"], ["tilt", "no", "–"]])
    assert html.count('class="word"') == 6, "heads and cells of the first two"


def test_a_run_without_saved_fields_has_a_report_with_the_pictures_of_its_folder(swept, tmp_path):
    flashtemp.simulate(swept.parent / "case.toml", out=tmp_path / "run")
    assert main(["report", str(tmp_path / "run")]) == 0
    html = (tmp_path / "run" / "report.html").read_text()
    assert 'id="picture-field"' in html
    (tmp_path / "run" / "field.png").unlink()
    assert main(["report", str(tmp_path / "run")]) == 0
    assert 'id="picture-field"' not in (tmp_path / "run" / "report.html").read_text()
