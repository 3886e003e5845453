"""Pages of finished results: what they show are the numbers of the files, and damaged files are refused in place."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest
from lab.browsing import CASE, page, served

import flashtemp
from flashtemp.errors import BadInput
from flashtemp.lab import verdict_page, workspace
from flashtemp.lab.conditions import describe_values, different_keys
from flashtemp.lab.jobs import JobList
from flashtemp.lab.result_files import open_result
from flashtemp.lab.run_data import PLACES, TEMPERATURES, main_numbers, read_run
from flashtemp.lab.start_button import CommandStarter
from flashtemp.lab.study_results import read_sweep
from flashtemp.lab.verdict_data import read_verdict
from flashtemp.viz.run.body_faces import N_FACE_POINTS, sample_faces

SMALL = {"output.pictures": False, "schedule.distance": 0.2, "schedule.wait": 1.0}
RULES = [
    {"name": "the evidence is strong", "value": 58.0, "limit": 8.0, "passed": True, "consequence": ""},
    {"name": "it can be seen", "value": 0.0002, "limit": 0.001, "passed": False, "consequence": "too small to see"},
]
VERDICT = {
    "schema": "flashtemp.verdict/1", "title": "two loads", "verdict": "weak",
    "says": ["The pressure may be tilted.", "Measure at twice the speed."],
    "causes": [{"effect": "pressure_tilt", "words": "the pressure is tilted", "ln_bayes": 5.5, "delta_chi2": 12.0,
                "held_out_gain": 1.0, "distinctness": 0.8, "consistent": 1.0,
                "parameters": {"pressure_tilt.a": {"value": 0.4, "stderr": 0.1, "ci95": [0.2, 0.6], "unit": "1"}}}],
    "base": {"rmse_K": 0.5, "chi2_per_dof": 2.0, "held_out_rmse_K": 0.61, "held_out_z": 2.0, "mean_map_rmse_K": None},
    "extended": {"rmse_K": 0.3, "chi2_per_dof": 1.1, "held_out_rmse_K": 0.33, "held_out_z": 1.0},
    "candidates": [{"effect": "side_cooling", "score": 2.5, "distinctness": 0.3, "reason": "the data do not need it",
                    "parameter": "side_cooling.h", "amplitude": 30.0, "stderr": 9.0, "unit": "W/m2K",
                    "detectable": "inf"}],
    "recordings": {"before": [{"file": "fast.nc", "held_out": True, "rmse_K": 0.7},
                              {"file": "slow.nc", "held_out": False, "rmse_K": 0.4}],
                   "after": [{"file": "fast.nc", "held_out": True, "rmse_K": 0.35}]},
    "rules": RULES, "next_experiment": "measure at 0.3 m/s", "warnings": ["the camera drifts"], "seconds": 12.0,
    "inputs": [{"key": "contact.pressure", "words": "pressure", "stated": 1.5e5, "unit": "Pa", "sd": 0.02,
                "relative": True, "source": "usual", "estimate": 1.8e5, "stderr": 1e3, "pull": 4.5, "ln_bayes": 9.0,
                "verdict": "contradicted", "sentence": ""}],
}  # fmt: skip
NUMBER = {"words": "T(L)", "unit": "degC", "value": 40.0, "sd": 1.0, "band95": [38.0, 42.0], "unexplained": 0.0,
          "per_sd": {"friction.mu": 0.9}, "first_order": {"friction.mu": 0.8}, "total": {"friction.mu": 0.85}}  # fmt: skip
STUDIES = {
    "compare": {"title": "two loads", "energy_imbalance": 1e-16, "forces": [], "recordings": [
        {"file": "side.nc", "with": {"contact.pressure": 1.5e5}, "rmse_K": 0.33, "bias_K": -0.1, "chi2_per_dof": 19.0,
         "white": False, "largest": {"K": 1.6, "u": 0.005, "time": 8.0}}]},
    "plan": {"title": "two loads", "sensors": [], "experiments": [
        {"words": "at three times the speed", "helps": ["wear"], "z_left": {}}], "effects": [
        {"effect": "wear", "z": 9.0, "z_left": 2.0, "detectable": 0.1, "unit": "1", "nearest": "blur", "rho": 0.9,
         "separable": False}]},
    "sensitivity": {"title": "two loads", "numbers": {"T_block_L": NUMBER}, "conclusions": ["mu decides"], "inputs": [
        {"key": "friction.mu", "value": 1.0, "sd": 0.05, "unit": "1", "reason": "load cell"}]},
}  # fmt: skip


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with two runs that differ in speed, a verdict, three studies and damaged results."""
    place = tmp_path_factory.mktemp("results").resolve()
    (place / "case.toml").write_text(CASE)
    for name, speed in (("slow", 0.1), ("fast", 0.3)):
        flashtemp.simulate(place / "case.toml", SMALL | {"schedule.speed": speed}, out=place / name)
    (place / "slow" / "map.png").write_bytes(PNG)
    (place / "slow" / "own plot.png").write_bytes(PNG)
    for name, file, content in (("verdict", "verdict", VERDICT), *((k, k, v) for k, v in STUDIES.items())):
        (place / name).mkdir()
        (place / name / f"{file}.json").write_text(json.dumps(content))
    (place / "verdict" / "extended.toml").write_text('effects = ["./learned.py"]\n')
    (place / "verdict" / "learned.py").write_text("raise SystemExit\n")
    (place / "verdict" / "report.html").write_text("<!DOCTYPE html><title>report</title><p>all of it</p>")
    (place / "broken").mkdir()
    (place / "broken" / "run.nc").write_bytes(b"\x89HDF\r\n\x1a\n broken")
    (place / "broken" / "fields.vtkhdf").write_bytes(b"\x89HDF\r\n\x1a\n broken")
    (place / "broken" / "summary.json").write_text('{"T_max_degC": [1], "energy_J": 3, "friction_per_repetition": "x"}')
    (place / "huge").mkdir()
    (place / "huge" / "run.nc").write_bytes(b"")
    (place / "huge" / "summary.json").write_text(f'{{"T_max_degC": 1{"0" * 400}}}')
    (place / "huge" / "case.toml").write_text(f"[block]\nlength = 1{'0' * 400}\n")
    (place / "odd").mkdir()
    (place / "odd" / "verdict.json").write_text('{"says": 3, "causes": [5], "rules": [{}], "base": {"rmse_K": {}}}')
    return place


@pytest.fixture(scope="module")
def server(place):
    with served(place) as (address, _):
        yield address


PNG = bytes.fromhex(
    "89504e470d0a1a0a0000000d4948445200000001000000010802000000907753de0000000c49444154789c63f8cfc0000003010100c9fe92ef"
    "0000000049454e44ae426082"
)


# --- numbers ---------------------------------------------------------------------------------------------------
def test_profiles_of_the_page_are_those_of_the_run(place):
    import xarray

    data = read_run(open_result(place, "slow"))
    with xarray.open_dataset(place / "slow" / "run.nc") as run:
        x, values = data.find_quantity(TEMPERATURES).curves["block, averaged across y"]
        np.testing.assert_array_equal(values, run["T_block"])
        np.testing.assert_allclose(x, 1e3 * run["x"])
        pressure = data.find_quantity("nominal contact pressure")
        np.testing.assert_allclose(pressure.curves[pressure.name][1], 1e-6 * run["pressure"])
        at = data.last_index(1)
        assert run["repetition"][at] == 1
        assert run["slid"][at] == pytest.approx(0.2)
        [(begin, end)] = data.waits()
        np.testing.assert_allclose((begin, end), (2.0, 3.0), atol=1e-6)
        places = data.curve_at_places("block, averaged across y")
        np.testing.assert_array_equal(places[PLACES[2]], run["T_block"][:, -1])
        assert pressure.unit == "MPa"
        low, high = data.find_quantity(TEMPERATURES).limits
        assert low <= float(run["T_block"].min()) < float(run["T_block"].max()) <= high


def test_main_numbers_have_units_and_survive_a_damaged_summary():
    whole = {"T_max_degC": 43.55, "rise_leading_K": 2.5, "rise_middle_K": 17.2, "rise_trailing_K": 22.6,
             "friction_per_repetition": [1.0, 0.8], "energy_imbalance": 1e-16, "cells": 100, "steps": 9, "wall_s": 2.0}  # fmt: skip
    shown = {n.label: (n.value, n.unit) for n in main_numbers(whole)}
    assert shown["Highest temperature"] == ("43.5", "°C")
    assert shown["Mean friction"] == ("0.9", "")
    assert shown["Rise at the trailing edge"] == ("22.6", "K")
    odd = main_numbers({"T_max_degC": [1], "friction_per_repetition": {"a": 1}, "cells": "x"})
    assert [n.value for n in odd[:3]] == ["–", "–", "–"]


def test_only_keys_that_differ_are_compared(place):
    slow, fast = (open_result(place, name).read_case() for name in ("slow", "fast"))
    assert different_keys([slow, fast]) == ["schedule.speed"]
    assert different_keys([slow, slow]) == []
    shown = describe_values(slow)
    assert (shown["contact.pressure"].value, shown["contact.pressure"].is_changed) == ("150 kPa", False)
    assert shown["contact.spot_diameter"].value == "3 mm"
    assert shown["schedule.distance"].is_changed
    assert shown["numerics.mesh"].is_changed
    assert shown["schedule.lifted"].value == "yes"


def test_faces_of_the_3d_view_hold_the_field_between_the_cells():
    """A field linear in x, y and z is shown exactly between the centres of the outermost cells."""
    x, y, z = np.linspace(0.0, 0.02, 9) ** 1.0, np.linspace(-0.01, 0.01, 6), np.array([0.0, 0.001, 0.003, 0.007])
    cx, cy, cz = (0.5 * (a[1:] + a[:-1]) for a in (x, y, z))
    T = 20.0 + 1e3 * cx[:, None, None] + 2e3 * cy[None, :, None] - 3e2 * cz[None, None, :]
    fields = SimpleNamespace(tensor=lambda body, t: (x, y, z, T))
    top = next(f for f in sample_faces(fields, 0.0, 0.05) if (f.body, f.axis, f.side) == ("block", 2, 1))
    assert top.T.shape == N_FACE_POINTS[:2]
    u, v = (low + (np.arange(n) + 0.5) / n * (high - low)
            for low, high, n in zip(top.low[:2], top.high[:2], N_FACE_POINTS[:2], strict=True))  # fmt: skip
    inside = np.ix_((u >= cx[0]) & (u <= cx[-1]), (v >= cy[0]) & (v <= cy[-1]))
    expected = (20.0 + 1e3 * u[:, None] + 2e3 * v[None, :] - 3e2 * cz[-1])[inside]
    np.testing.assert_allclose(top.T[inside], expected, atol=1e-9)
    assert top.T.max() <= T.max()
    flat = SimpleNamespace(tensor=lambda body, t: (x, np.zeros(1), z, T[:, :1]))
    assert {(f.low[1], f.high[1]) for f in sample_faces(flat, 0.0, 0.05)} == {(-0.025, 0.025)}


def test_a_verdict_is_read_with_its_infinite_and_missing_numbers(place):
    stored = read_verdict(open_result(place, "verdict"))
    v = stored.verdict
    assert (v.kind, v.causes[0].effect, v.causes[0].ln_bayes) == ("weak", "pressure_tilt", 5.5)
    assert v.rivals[0].detectable == float("inf")
    assert np.isnan(v.base.mean_map_rmse_K)
    assert [(r.file, r.held_out, r.before_K) for r in stored.recordings] == [
        ("fast.nc", True, 0.7),
        ("slow.nc", False, 0.4),
    ]
    assert np.isnan(stored.recordings[1].after_K)
    with pytest.raises(BadInput, match="cannot be read"):
        read_verdict(open_result(place, "odd"))


def test_a_sweep_is_read_over_its_keys(tmp_path):
    (tmp_path / "case.toml").write_text(CASE)
    axes = {"friction.mu": [0.5, 1.0], "schedule.speed": [0.1, 0.2]}
    flashtemp.sweep(tmp_path / "case.toml", axes, SMALL, out=tmp_path / "s", workers=1)
    data = read_sweep(open_result(tmp_path, "s"))
    assert list(data.axes) == ["friction.mu", "schedule.speed"]
    hottest = data.numbers["highest temperature (°C)"]
    assert hottest.shape == (2, 2)
    assert hottest[1, 1] > hottest[0, 0]


def test_cards_and_pages_read_files_up_to_the_same_size(tmp_path, monkeypatch):
    """What a card of a result shows, its page shows too."""
    (tmp_path / "r").mkdir()
    file = tmp_path / "r" / "verdict.json"
    file.write_text(json.dumps(VERDICT))
    result = open_result(tmp_path, "r")
    monkeypatch.setattr(workspace, "MAX_JSON_BYTES", file.stat().st_size)
    assert result.read_json("verdict.json") == workspace.read_json_quietly(tmp_path, "r/verdict.json") == VERDICT
    monkeypatch.setattr(workspace, "MAX_JSON_BYTES", file.stat().st_size - 1)
    assert workspace.read_json_quietly(tmp_path, "r/verdict.json") == {}
    with pytest.raises(BadInput, match="verdict.json: larger than"):
        result.read_json("verdict.json")
    file.write_text("[1]")
    with pytest.raises(BadInput, match="verdict.json: cannot be read"):
        result.read_json("verdict.json")


@pytest.mark.parametrize("name", ["--trust", "a"])
def test_the_extended_case_is_no_option_and_gets_a_free_name(tmp_path, name):
    (tmp_path / "results" / f"{name}-extended").mkdir(parents=True)
    (tmp_path / name).mkdir()
    (tmp_path / name / "verdict.json").write_text(json.dumps(VERDICT))
    result = open_result(tmp_path, name)
    starter = CommandStarter(tmp_path, JobList(tmp_path), None)
    words = verdict_page.VerdictCards(result, starter, read_verdict(result))._extended_words()
    assert words[0] == "run"
    assert not words[1].startswith("-")
    assert words[2:] == ["--out", f"results/{name}-extended-2"]


# --- in the browser --------------------------------------------------------------------------------------------
SERIES = """(about) => {
    const figure = document.querySelector(`[aria-label="${about}"]`);
    return getElement(Number(figure.id.slice(1))).chart.getOption().series.map((s) => [s.name, s.data]);
}"""
PROFILE = "profile along the block at the chosen time"


def open_page(seen, server, address):
    """Open a page and wait until it has read all files."""
    seen.goto(server.split("/?")[0] + address)
    seen.get_by_role("heading", level=1).wait_for()
    seen.wait_for_timeout(300)
    seen.wait_for_function("!document.querySelector('.q-spinner')")


def test_a_run_is_shown_at_the_chosen_time_and_beside_another(browser, server, place, tmp_path):
    data = read_run(open_result(place, "slow"))
    with page(browser, server, 800) as seen:
        open_page(seen, server, "/result?open=slow")
        changed = seen.get_by_role("table", name="conditions", exact=True).get_by_role("row")
        assert changed.filter(has_text="numerics.mesh").count() == 1
        seen.get_by_role("button", name="end of repetition 1").click()
        at = data.last_index(1)
        seen.get_by_text(f"t = {data.time[at]:.4g} s, repetition 1").wait_for()
        seen.wait_for_timeout(300)
        shown = dict(seen.evaluate(SERIES, PROFILE))["block, averaged across y"]
        np.testing.assert_allclose(shown, np.column_stack([v if k == 0 else v[at] for k, v in enumerate(
            data.find_quantity(TEMPERATURES).curves["block, averaged across y"])]))  # fmt: skip
        with seen.expect_download() as download:
            seen.get_by_role("button", name="save profile as CSV").click()
        download.value.save_as(tmp_path / "profile.csv")
        saved = [line for line in (tmp_path / "profile.csv").read_text().splitlines() if line.startswith('"block')]
        np.testing.assert_allclose([[float(v) for v in line.split(",")[-2:]] for line in saved], shown)
        canvas = seen.locator(".ft-scene canvas")
        canvas.scroll_into_view_if_needed()
        box = canvas.bounding_box()
        seen.mouse.move(box["x"] + 0.45 * box["width"], box["y"] + 0.5 * box["height"])
        seen.get_by_text("°C at x =").wait_for()
        assert 19.0 < float(seen.locator(".ft-scene-readout").inner_text().split()[1]) < 100.0
        before = canvas.screenshot()
        canvas.press("ArrowLeft")
        assert canvas.screenshot() != before
        seen.get_by_role("checkbox", name="fast").click()
        seen.get_by_role("heading", name="Conditions that differ").wait_for()
        assert seen.url.endswith("/result?open=slow&with=fast")
        row = seen.get_by_role("row", name="schedule.speed")
        assert row.get_by_role("cell").all_inner_texts() == ["schedule.speed", "0.1 m/s", "0.3 m/s"]
        seen.get_by_role("button", name="enlarge: Own plot").click()
        seen.get_by_role("dialog").get_by_text("Own plot").wait_for()
        seen.get_by_role("button", name="last picture").press("ArrowLeft")
        seen.get_by_role("dialog").get_by_text("Temperature over position and time").wait_for()
        open_page(seen, server, "/result?open=slow&with=fast&with=nothing")
        seen.get_by_role("alert").get_by_text("nothing: no such result").wait_for()
        assert [name for name, _ in seen.evaluate(SERIES, "one quantity of several runs")] == ["slow", "fast"]


def test_a_verdict_answers_and_starts_its_extended_case_after_consent(browser, server, place):
    with page(browser, server) as seen:
        open_page(seen, server, "/verdict?open=verdict")
        seen.get_by_text("The pressure may be tilted.", exact=True).wait_for()
        seen.get_by_text("A missing effect is likely, but the evidence is weak").wait_for()
        seen.get_by_text("too small to see").first.wait_for()
        seen.get_by_text("measure at 0.3 m/s").wait_for()
        assert "0.61 K without the extension" in seen.get_by_role("region", name="What it changes").inner_text()
        bars = dict(seen.evaluate(SERIES, "rms difference of every recording before and after"))
        assert bars["case as stated, calibrated"] == [[0.61, "data that was not fitted"], [0.7, "fast.nc"]]
        assert bars["with the extension"] == [[0.33, "data that was not fitted"], [0.35, "fast.nc"]]
        row = seen.get_by_role("row", name="side cooling")
        assert row.get_by_role("cell").all_inner_texts()[1:4] == [
            "side_cooling.h = 30.0 ± 9.0 W/m²K",
            "2.5",
            "sensitivities",
        ]
        assert "180000" not in seen.get_by_role("row", name="contact.pressure").inner_text()
        assert "0.18" in seen.get_by_role("row", name="contact.pressure").inner_text()
        seen.frame_locator("iframe").get_by_text("all of it").wait_for()
        seen.get_by_role("button", name="Run the extended case").click()
        question = seen.get_by_role("alertdialog")
        question.get_by_text(str(place / "verdict" / "learned.py")).wait_for()
        question.get_by_role("button", name="Cancel").click()
        question.wait_for(state="detached")
        assert not (place / ".flashtemp-lab").exists(), "no job without consent"
        seen.get_by_role("button", name="Run the extended case").click()
        question.get_by_role("button", name="Run as a program").click()
        seen.wait_for_url("**/runs?job=*-run")
        [log] = (place / ".flashtemp-lab").glob("*-run.log")
        assert log.read_text().startswith("$ flashtemp run verdict/extended.toml --out results/verdict-extended")


def test_studies_are_shown_and_damage_is_reported_in_place(browser, server, place):
    with page(browser, server, 800) as seen:
        for name, words in {"compare": "contact pressure 150 kPa", "plan": "at three times the speed",
                            "sensitivity": "load cell"}.items():  # fmt: skip
            open_page(seen, server, f"/result?open={name}")
            seen.get_by_text(words).first.wait_for()
            assert not seen.get_by_role("alert").count(), name
            assert seen.title().endswith(f" {name} · flashtemp")
        open_page(seen, server, "/result?open=broken")
        alerts = seen.get_by_role("alert")
        alerts.nth(1).wait_for()
        assert "run.nc" in alerts.nth(0).inner_text()
        assert "fields.vtkhdf" in alerts.nth(1).inner_text()
        open_page(seen, server, "/result?open=huge")
        for file in ("summary.json", "run.nc", "case.toml"):
            alerts.get_by_text(f"huge/{file}: cannot be").wait_for()
        open_page(seen, server, "/result?open=odd")
        alerts.get_by_text("verdict.json: cannot be read").wait_for()
        open_page(seen, server, "/result?open=none")
        seen.get_by_text("There is no such result").wait_for()
        seen.get_by_role("link", name="open plan").wait_for()
