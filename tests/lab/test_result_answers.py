"""The head of every kind of result is one sentence with its number, then a plot, then the next step."""

from __future__ import annotations

import json

import numpy as np
import pytest
from lab.browsing import CASE, page, served
from lab.test_accessibility import RULES

import flashtemp
from flashtemp.lab.campaign_lookup import find_campaign
from flashtemp.lab.result_card import describe_result
from flashtemp.lab.result_sentences import (
    SENTENCES,
    describe_comparison,
    describe_loads,
    describe_run,
    describe_tyre,
    grade_comparison,
)
from flashtemp.lab.workspace import list_folder

LAW = {
    "quantity": "block_capacity", "argument": "inside", "formula": "line: 1 + s",
    "words": "the heat capacity of the block changes with its own temperature", "beside": {},
    "curve": {"argument": [20.0, 60.0, 100.0], "value": [1.0, 1.5, 2.0], "unit": "1", "argument_unit": "degC"},
    "band": {"low": [0.9, 1.3, 1.6], "high": [1.1, 1.8, 2.4]},
}  # fmt: skip
LEARNED = {
    "title": "disc", "verdict": "learned", "says": ["A law was learned: it holds at 20 degC."], "law": LAW,
    "causes": [{"effect": "learned", "words": LAW["words"], "ln_bayes": 188.0, "consistent": 1.0,
                "parameters": {"learned.at_1": {"value": 0.08, "stderr": 0.08, "ci95": [-0.07, 0.24], "unit": "1"}}}],
    "base": {"rmse_K": 14.5, "chi2_per_dof": 530.0, "held_out_rmse_K": 5.99, "held_out_z": 8.8},
    "extended": {"rmse_K": 0.41, "chi2_per_dof": 0.42, "held_out_rmse_K": 0.568, "held_out_z": 0.8},
}  # fmt: skip
TREAD = {
    "maximum": {"slip": 0.07, "friction": 0.4887, "at_last": False}, "pressure_Pa": 3e5, "T0_degC": 20.0,
    "curve": {"slip": [0.01, 0.07, 0.5], "friction": [0.24, 0.49, 0.45]}, "remarks": ["contact fraction 0.2 (given)"],
    "slips": [{"slip": 0.01, "friction_law": 0.24, "friction": 0.24, "slid_m": 1e-4, "T_max_degC": 21.0}],
}  # fmt: skip
FRICTION = {
    "maximum": {"cold": None, "hot": {"speed": 2.57, "mu": 0.534}}, "not_modelled": "stick-slip",
    "signs": [{"sentence": "mu rises with load, +0.2 %"}],
    "curves": {"speed_m_s": [1e-3, 1.0], "mu_cold": [0.4, 0.6], "mu_hot": [0.4, 0.5], "T_hot_degC": [20.0, 50.0]},
}  # fmt: skip
LOADS = {
    "pressure_Pa": [1e5, 2e5], "speed_m_s": [0.5], "ln_change": [-0.0437], "leading": "heating", "acting": ["heating"],
    "ln_shares": {"heating": [-0.0437]}, "words": {"heating": "friction heats the contact"},
}  # fmt: skip
AREA = {"linear_up_to_p_over_E": 0.335, "area_there": 0.301, "saturated_from_p_over_E": 1.43, "p_over_E": [0.1, 1.0],
        "area": [0.09, 0.75], "linear": [0.09, 0.92]}  # fmt: skip
TYRE = {
    "maxima": [{"model": "brush", "law": "law", "load_N": load, "mu": mu, "angle_deg": 8.0}
               for load, mu in ((3000.0, 0.9), (7000.0, 0.8))],
    "fall": {"brush": 0.111}, "controls_hold": True, "loads_N": [3000.0, 7000.0], "angles_deg": [1.0, 8.0],
    "curves": {"brush, law": [[0.3, 0.9], [0.3, 0.8]], "rigid, cold": [[0.3, 1.0], [0.3, 1.0]]},
}  # fmt: skip
STORED = {"friction": FRICTION, "area": AREA, "loads": LOADS, "tread": TREAD, "tyre": TYRE, "verdict": LEARNED}


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with a campaign that a tilt makes misfit, its comparison, and one stored result of every other kind."""
    place = tmp_path_factory.mktemp("answers")
    (place / "case.toml").write_text(CASE)
    flashtemp.twin(
        place / "case.toml", hide=["pressure_tilt"], seed=1, out=place / "lab", conditions=1, views=["sidewall"]
    )
    flashtemp.compare(place / "lab", out=place / "results" / "compared")
    for name, content in STORED.items():
        (place / "results" / name).mkdir()
        (place / "results" / name / f"{name}.json").write_text(json.dumps(content))
    (place / "results" / "verdict" / "report.pdf").write_bytes(b"%PDF-1.4\n")
    return place


@pytest.fixture(scope="module")
def server(place):
    with served(place) as (address, _):
        yield address


# --- sentences -------------------------------------------------------------------------------------------------
def entry(name, chi2, white=True, **more):
    return {"file": name, "chi2_per_dof": chi2, "white": white, "rmse_K": 0.1 * (chi2 or 0.0), **more}


@pytest.mark.parametrize(
    ("recordings", "grade", "words"),
    [
        ([entry("a.nc", 1.0)], "good", "The model explains the recording: the difference, 0.1 K rms"),
        ([entry("a.nc", 1.0), entry("b.nc", 1.2, white=False)], "warning", "but the difference is not random"),
        ([entry("a.nc", 1.0), entry("b.nc", 16.0)], "error",
         "The model does not explain 1 of 2 recordings: it misses b.nc by 1.6 K rms, 4 times the noise."),
        ([entry("a.nc", 9.0, largest={"K": -2.0, "u": 1.0, "time": 3.0}, points=[{"name": "top"}, {"name": "back"}])],
         "error", "at the largest, 2 K colder than computed at point back, t = 3 s."),
        ([entry("a.nc", None)], "error", "The model does not explain"),
    ],
)  # fmt: skip
def test_a_comparison_says_how_well_the_model_explains_the_data(recordings, grade, words):
    data = {"recordings": recordings}
    assert grade_comparison(data) == grade
    assert words in describe_comparison(data)[0]


def test_a_load_cell_that_differs_is_a_misfit():
    data = {"recordings": [entry("a.nc", 1.0)], "forces": [{"file": "mu.csv", "chi2_per_dof": 90.0, "bias": -0.06}]}
    assert grade_comparison(data) == "error"
    assert describe_comparison(data)[1].endswith("in mu.csv it is measured 0.06 lower than computed.")


def test_a_run_says_where_the_block_warms_also_between_its_edges():
    rises = {"rise_leading_K": 5.13, "rise_middle_K": 23.54, "rise_trailing_K": 0.107}
    assert describe_run({"T_max_degC": 56.0} | rises) == [
        "The highest temperature is 56 °C; the block warms by 5.1 K at the leading edge, 23.5 K in the middle and 0.1 K "
        "at the trailing edge."
    ]
    assert describe_run({"T_max_degC": 56.0, "rise_trailing_K": 2.0})[0].endswith(
        "warms by 2.0 K at the trailing edge."
    )


def test_load_and_tyre_say_what_falls_and_why():
    assert describe_loads(LOADS) == [
        "From 0.1 to 0.2 MPa friction changes by -4.3 % at 0.5 m/s, mostly because friction heats the contact."
    ]
    assert describe_tyre(TYRE)[0] == (
        "From 3000 to 7000 N the highest side force changes from 0.9 to 0.8 of the load (brush model, -11.1 %)."
    )


@pytest.mark.parametrize("describe", SENTENCES.values())
@pytest.mark.parametrize("value", [None, 3, "x", [], [3], {"brush": "x"}, "inf"])
def test_a_sentence_survives_whatever_a_file_holds(describe, value):
    keys = (
        "says",
        "recordings",
        "forces",
        "effects",
        "experiments",
        "conclusions",
        "maximum",
        "signs",
        "maxima",
        "fall",
    )
    keys += ("linear_up_to_p_over_E", "ln_change", "speed_m_s", "pressure_Pa", "words", "no_maximum_up_to_deg")
    assert all(isinstance(text, str) for text in describe(dict.fromkeys(keys, value)))


def test_cards_say_the_same_as_the_pages(place):
    listing = list_folder(place).results
    assert {str(path): command for path, command in listing.items()} == {
        "results/compared": "compare", "results/verdict": "discover", "results/friction": "friction",
        "results/area": "friction", "results/loads": "loads", "results/tread": "tread", "results/tyre": "tyre",
    }  # fmt: skip
    for path in listing:
        assert describe_result(place, path), path


def test_the_campaign_of_a_result_is_found_by_its_recordings(place, tmp_path):
    files = ["condition1_sidewall.nc", "condition1_mu.csv"]
    assert str(find_campaign(place, files, "")) == "lab/campaign.toml"
    assert str(find_campaign(place, files[:1], "", with_forces=False)) == "lab/campaign.toml"
    assert find_campaign(place, files[:1], "") is None
    text = (place / "lab" / "campaign.toml").read_text()
    for name in ("a", "b"):
        (tmp_path / f"{name}.toml").write_text(text.replace('title = "', f'title = "{name} '))
    title = json.loads((place / "results" / "compared" / "compare.json").read_text())["title"]
    assert find_campaign(tmp_path, files, title) is None
    assert str(find_campaign(tmp_path, files, f"b {title}")) == "b.toml"


# --- files of a comparison -------------------------------------------------------------------------------------
def test_a_comparison_stores_the_profile_through_its_largest_difference(place):
    stored = json.loads((place / "results" / "compared" / "compare.json").read_text())["recordings"][0]
    profile, peak = stored["profile"], stored["largest"]
    difference = np.subtract(profile["measured_degC"], profile["computed_degC"])
    at = int(np.argmin(np.abs(np.array(profile["at"]) - 1e3 * peak["u"])))
    assert profile["over"] == "x_mm"
    assert profile["time_s"] == pytest.approx(peak["time"])
    assert difference[at] * peak["K"] > 0
    assert abs(difference[at]) > 0.4 * abs(peak["K"])
    assert (place / "results" / "compared" / "what_is_wrong.png").stat().st_size > 1000


def test_the_report_of_a_comparison_names_its_campaign(place, monkeypatch):
    monkeypatch.chdir(place / "lab")
    loaded = flashtemp.open_campaign("campaign.toml")
    assert str(loaded.path) == "campaign.toml"
    assert str(flashtemp.open_campaign(place / "lab").path) == str(place / "lab")


# --- in the browser --------------------------------------------------------------------------------------------
def open_result_page(seen, server, name):
    seen.goto(server.split("/?")[0] + f"/result?open=results/{name}")
    seen.get_by_role("heading", level=1).wait_for()
    seen.wait_for_timeout(300)
    seen.wait_for_function("!document.querySelector('.q-spinner')")


def find_barriers(seen):
    from axe_playwright_python.sync_playwright import Axe

    found = Axe().run(seen, context=".ft-main", options=RULES).response["violations"]
    return [f"{v['id']}: {n['html'][:160]} {n['failureSummary'][:200]}" for v in found for n in v["nodes"]]


def test_a_comparison_answers_shows_and_asks_what_is_missing(browser, server, place):
    with page(browser, server) as seen:
        open_result_page(seen, server, "compared")
        answer = seen.get_by_role("region", name="answer")
        answer.get_by_text("The model does not explain the recording").wait_for()
        state = answer.get_by_text("the model does not explain the data", exact=True)
        assert state.bounding_box()["width"] < answer.bounding_box()["width"] / 2
        seen.get_by_role("img", name="temperature measured and computed").wait_for()
        seen.get_by_text("flashtemp discover lab --out results/lab-discover").wait_for()
        assert find_barriers(seen) == []
        seen.get_by_role("link", name="Options of discover").click()
        seen.wait_for_url("**/runs?command=discover&of=lab")
        open_result_page(seen, server, "compared")
        seen.get_by_role("button", name="Ask what is missing").dblclick()
        seen.wait_for_url("**/runs?job=*-discover")
        seen.get_by_role("button", name="Stop").click()
        seen.get_by_text("stopped", exact=True).wait_for(timeout=60_000)
    assert len(list((place / ".flashtemp-lab").glob("*-discover.log"))) == 1


def test_a_learned_law_is_drawn_with_its_band_and_units(browser, server):
    with page(browser, server, 800) as seen:
        open_result_page(seen, server, "verdict")
        seen.get_by_text("A law was learned: it holds at 20 °C.").wait_for()
        answer = seen.get_by_role("region", name="answer").inner_text()
        assert "Factor at 100 °C\n2\n95 %: 1.6 to 2.4" in answer
        law = seen.get_by_role("img", name="the learned law with its 95 % band")
        law.get_by_text("factor on the heat capacity of the block (–)").wait_for()
        law.get_by_text("its own temperature (°C)").wait_for()
        seen.get_by_text("5.99 K without the extension").wait_for()
        assert seen.get_by_role("link", name="PDF for printing").get_attribute("href").endswith("/verdict/report.pdf")
        assert find_barriers(seen) == []
        assert seen.evaluate("document.documentElement.scrollWidth") <= 800


@pytest.mark.parametrize(
    ("name", "words", "plot"),
    [
        ("friction", "0.534 at 2.57 m/s", "friction over speed, cold and hot"),
        ("area", "proportional to the load up to p/E = 0.335", "contact area over pressure"),
        ("loads", "mostly because friction heats the contact", "change of friction by process"),
        ("tread", "highest at a slip of 0.07: 0.489", "friction over slip"),
        ("tyre", "so the flash temperature causes the fall", "side force over slip angle for every load"),
    ],
)
@pytest.mark.sample("friction-*", "loads-*")
def test_results_of_friction_theory_have_an_answer_and_a_plot(browser, server, name, words, plot):
    with page(browser, server, 800) as seen:
        open_result_page(seen, server, name)
        seen.get_by_role("region", name="answer").get_by_text(words).wait_for()
        seen.get_by_role("img", name=plot).wait_for()
        assert not seen.get_by_role("alert").count()
        assert find_barriers(seen) == []
        assert seen.evaluate("document.documentElement.scrollWidth") <= 800
