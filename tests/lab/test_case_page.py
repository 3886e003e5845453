"""The case page: the drawing is to scale and follows the keys, form and cards write what the command line reads."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import pytest
from lab.browsing import page, served
from lab.test_accessibility import check_page

import flashtemp
from flashtemp.api.inputs import parse_case
from flashtemp.errors import BadInput
from flashtemp.lab import case_cost, case_list, case_sketch_view
from flashtemp.lab.effect_cards import describe_conflict, find_same_signature
from flashtemp.lab.effect_places import OTHER_PLACE, PLACES, draw_places, find_effect_places
from flashtemp.lab.key_groups import list_group_keys
from flashtemp.lab.key_units import (
    UNIT_CHOICES,
    convert_to_key_unit,
    is_default,
    natural_unit,
    read_number,
    show_number,
)
from flashtemp.lab.toml_editing import add_toml_table, remove_empty_table, remove_toml_table, set_toml_key
from flashtemp.lab.toml_editor import read_faults
from flashtemp.model.schema import CASE_TABLES, declared_params
from flashtemp.physics.effect import catalogue
from flashtemp.physics.units import find_conversion

HOSTILE = "<img src=x onerror=window.name_ran=1>"
LAYERED = f"""[layers.'{HOSTILE}']
material = "granite"
thickness = 0.002
[layers.rubber]
material = "tread_rubber"
thickness = 0.005
"""


def case_of(text):
    return parse_case(text, Path("/nowhere/case.toml"))


# --- units and keys --------------------------------------------------------------------------------------------
def test_every_unit_to_choose_converts_as_the_case_file_converts_it():
    for unit, choices in UNIT_CHOICES.items():
        for name, line in choices.items():
            assert line == pytest.approx(find_conversion(name, unit), rel=1e-12), (name, unit)


@pytest.mark.parametrize(
    ("table", "key", "typed", "unit", "value"),
    [
        ("block", "length", "30", "mm", 0.03), ("block", "length", "0.03", "m", 0.03),
        ("block", "length", "3 cm", "mm", 0.03), ("contact", "pressure", "0.3", "MPa", 3e5),
        ("contact", "pressure", "2", "bar", 2e5), ("schedule", "speed", "3.6", "km/h", 1.0),
        ("ambient", "temperature", "68", "degF", 20.0), ("schedule", "wait", "2", "min", 120.0),
    ],
)  # fmt: skip
def test_a_number_typed_in_a_unit_is_that_number_in_the_case(table, key, typed, unit, value):
    param = declared_params(table)[key]
    written = read_number(typed, param, unit)
    assert case_of(set_toml_key("", table, key, written))[f"{table}.{key}"] == pytest.approx(value, rel=1e-12)
    assert convert_to_key_unit(written, param) == pytest.approx(value, rel=1e-12) or typed.endswith("cm")
    shown, in_unit = show_number(value, param, unit)
    assert convert_to_key_unit(read_number(shown, param, in_unit), param) == pytest.approx(value, rel=1e-9)


def test_a_default_in_another_unit_is_no_change():
    param = declared_params("contact")["pressure"]
    assert [is_default(v, param) for v in (150000, "150 kPa", "0.15 MPa", "1.5 bar")] == [True] * 4
    assert not is_default("150 Pa", param)
    assert not is_default(1, declared_params("schedule")["lifted"])
    assert natural_unit(param) == "kPa"


def test_every_key_of_a_case_stands_in_one_group():
    listed = [key.dotted for keys in list_group_keys().values() for key in keys]
    assert sorted(listed) == sorted(f"{t}.{k}" for t in CASE_TABLES for k in declared_params(t))
    for group, keys in list_group_keys().items():
        assert [key.dotted for key in keys if not {key.table, key.dotted} & set(group.keys)] == []


# --- text ------------------------------------------------------------------------------------------------------
TEXT = 'effects = ["wear"]\n\n[wear] # mine\nrate = 1e-10\n\n# how it slides\n[schedule]\nspeed = 0.2\n'


def test_the_table_of_an_effect_leaves_and_comes_back_with_its_comments():
    kept, removed = remove_toml_table(TEXT, "wear")
    assert tomllib.loads(kept) == {"effects": ["wear"], "schedule": {"speed": 0.2}}
    assert "# how it slides\n[schedule]" in kept
    again = add_toml_table(kept, removed)
    assert tomllib.loads(again) == tomllib.loads(TEXT)
    assert "# mine" in again


def test_only_an_empty_table_is_removed():
    assert remove_empty_table("[block]\n\n[road]\ndepth = 0.1\n", "block") == "[road]\ndepth = 0.1\n"
    for text in ("[block]\nlength = 0.1\n", "[block]\n# a remark\n", "[block] # a remark\n"):
        assert "[block]" in remove_empty_table(text, "block")


def test_a_layer_with_an_odd_name_is_edited_in_its_place():
    text = set_toml_key(LAYERED, f"layers.{HOSTILE}", "thickness", 0.003)
    text = set_toml_key(text, f"layers.{HOSTILE}", "cells", 7)
    text = set_toml_key(text, "layers.top layer", "thickness", 0.001)
    layers = tomllib.loads(text)["layers"]
    assert layers[HOSTILE] == {"material": "granite", "thickness": 0.003, "cells": 7}
    assert layers["top layer"] == {"thickness": 0.001}


def test_errors_are_read_back_with_line_and_key():
    file = Path("/nowhere/case.toml")
    with pytest.raises(BadInput) as caught:
        parse_case('[block]\nlength = "far"\nheigth = 1.0\n', file)
    assert {(f.line, f.key) for f in read_faults(caught.value, file)} == {(2, "block.length"), (3, "block.heigth")}
    with pytest.raises(BadInput) as caught:
        parse_case("[block]\nlength =\n", file)
    [fault] = read_faults(caught.value, file)
    assert (fault.line, fault.key) == (2, "")
    assert str(file) not in fault.text


# --- drawings --------------------------------------------------------------------------------------------------
def shapes_of(case, kind, draw=case_sketch_view.draw_block):
    return [s for s in draw(case)[0] if s.get("class") == kind]


@pytest.mark.parametrize(("length", "height"), [(0.025, 0.007), (0.05, 0.04), (0.3, 0.1)])
def test_the_block_and_its_road_are_drawn_to_scale(length, height):
    case = case_of(f"[block]\nlength = {length}\nheight = {height}\n")
    [block], [road] = shapes_of(case, "ft-d-block"), shapes_of(case, "ft-d-road-near")
    assert block["width"] / block["height"] == pytest.approx(length / height, rel=1e-3)
    assert road["width"] / block["width"] == pytest.approx((length + 0.013) / length, rel=1e-3)
    texts = {s["text"] for s in case_sketch_view.draw_block(case)[0] if "text" in s}
    assert {case_sketch_view.format_length(length), case_sketch_view.format_length(height), "150 kPa"} <= texts


def test_the_arrow_points_to_the_edge_that_leads():
    tips = []
    for speed in (0.1, -0.1):
        case = case_of(f"[schedule]\nspeed = {speed}\n")
        [block] = shapes_of(case, "ft-d-block")
        [shaft] = shapes_of(case, "ft-d-speed")
        tips.append((shaft["x2"] < shaft["x1"], shaft["x2"] < block["x"]))
    assert tips == [(True, True), (False, False)]


def test_a_lifted_block_carries_nothing_while_it_waits():
    for lifted, rests in ((True, 0), (False, 3)):
        text = f"[schedule]\nrepetitions = 4\nwait = 10.0\nlifted = {str(lifted).lower()}\n"
        speed, load = (
            shapes_of(case_of(text), f"{kind} ft-d-curve", case_sketch_view.draw_schedule)[0]["d"]
            for kind in ("ft-d-speed", "ft-d-load")
        )
        levels = [[float(p.split()[1]) for p in re.split("[ML]", path)[1:]] for path in (speed, load)]
        assert len(levels[0]) == 4 * 2 + 3 * 2
        assert max(levels[0]) == levels[0][2] == levels[0][3]  # at rest
        assert (levels[1][2] == levels[1][0]) == bool(rests)


def test_a_block_alone_and_a_schedule_in_a_file_are_drawn(tmp_path):
    assert "alone" in case_sketch_view.draw_schedule(case_of("[schedule]\nalone = 30.0\n"))[1]
    (tmp_path / "v.csv").write_text("time,speed\n0,0.1\n10,0.3\n20,-0.2\n")
    case = parse_case('[schedule]\nspeed = "v.csv"\ndistance = 2.0\n', tmp_path / "case.toml")
    [curve] = shapes_of(case, "ft-d-speed ft-d-curve", case_sketch_view.draw_schedule)
    assert curve["d"].count("L") > 20


# --- effects ---------------------------------------------------------------------------------------------------
def test_every_effect_of_the_catalogue_has_a_place_with_a_picture():
    effects = {name: effect for name, effect in catalogue().items() if not effect.base}
    places = {name: find_effect_places(effect) for name, effect in effects.items()}
    assert [name for name, found in places.items() if OTHER_PLACE in found] == []
    assert {place.title for found in places.values() for place in found} == {place.title for place in PLACES}
    plain = draw_places([])
    assert all(draw_places([place]) != plain for place in PLACES)


def test_the_page_names_no_effect():
    text = "".join(f.read_text() for f in Path(flashtemp.lab.__file__).parent.glob("*.py"))
    quoted = set(re.findall(r'"(\w+)"', text))
    assert quoted & {name for name in catalogue() if "_" in name} == set()


def test_what_excludes_an_effect_is_explained():
    uniform = next(e for e in catalogue().values() if e.uniform)
    assert "one material" in describe_conflict(uniform, has_layers=True)
    assert describe_conflict(uniform, has_layers=False) == ""
    name, effect = next((n, e) for n, e in catalogue().items() if e.alike)
    assert find_same_signature(name, [name, effect.alike], catalogue()) == [effect.alike]
    assert find_same_signature(effect.alike, [name, effect.alike], catalogue()) == [name]


# --- cost ------------------------------------------------------------------------------------------------------
def test_the_estimate_grows_with_cells_and_repetitions_and_follows_measured_runs(tmp_path):
    short, long = (case_cost.estimate_cost(case_of(f"[schedule]\nrepetitions = {n}\n")) for n in (1, 50))
    fine = case_cost.estimate_cost(case_of('[numerics]\nmesh = "fine"\n'))
    assert long.seconds == pytest.approx(50 * short.seconds)
    assert fine.cells > 3 * short.cells
    assert fine.seconds > short.seconds
    step = case_cost.STEP_S + 5000 * case_cost.CELL_STEP_S
    files = []
    texts = [json.dumps({"wall_s": k * 1000 * step, "steps": 1000, "cells": 5000}) for k in (2.0, 3.0, 9.0)]
    texts.append(json.dumps({"wall_s": 6.5, "steps": 273, "cells": 1216}))  # the first, short run: compiling
    for n, text in enumerate(
        [*texts, "{", "[]", '{"wall_s": "x"}', '{"wall_s": 1, "steps": 0, "cells": 0}', "[" * 9999]
    ):
        files.append(tmp_path / f"{n}.json")
        files[-1].write_text(text)
    assert case_cost.measure_pace([*files, tmp_path / "none.json"]) == pytest.approx(3.0)
    assert case_cost.measure_pace(files[3:]) == 1.0  # of the short run: 53


# --- ready cases -----------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    "is_installed",
    [pytest.param(False, id="repository", marks=pytest.mark.long), pytest.param(True, id="package alone")],
)
def test_every_ready_case_can_be_opened_in_another_folder(tmp_path, monkeypatch, is_installed):
    if is_installed:
        monkeypatch.setattr(case_list, "CASES", tmp_path / "none")
    ready = case_list.find_ready_cases.__wrapped__()
    assert {"uniform_pressure", "run_in"} <= {case.name for case in ready}
    for case in ready:
        parse_case(case.text, tmp_path / f"{case.name}.toml")


# --- in the browser --------------------------------------------------------------------------------------------
CASE = 'title = "mine"\n\n[contact]\npressure = 2e5\n'


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    place = tmp_path_factory.mktemp("cases")
    (place / "mine.toml").write_text(CASE)
    (place / "layers.toml").write_text(f'title = "{HOSTILE}"\neffects = []\n{LAYERED}')
    return place


@pytest.fixture(scope="module")
def server(place):
    with served(place) as (address, _):
        yield address


def test_the_drawing_follows_the_keys_and_the_last_valid_one_stays(browser, server, place):
    base = server.split("/?")[0]
    with page(browser, server) as seen:
        seen.goto(f"{base}/case?open=mine.toml")
        seen.get_by_text("ready to run").wait_for()
        check_page(seen)
        assert seen.get_by_label("contact.pressure").input_value() == "200"
        length, drawing = seen.get_by_label("block.length"), seen.locator("svg.ft-drawing").first
        length.fill("40")
        drawing.get_by_text("40 mm").wait_for()
        seen.get_by_text("length (default 25 mm)").wait_for()
        seen.get_by_role("button", name=re.compile(r"block.length 40 mm")).wait_for()
        length.fill("far")
        seen.get_by_text("1 error").wait_for()
        seen.get_by_text("give a number (m)", exact=False).first.wait_for()
        assert drawing.get_by_text("40 mm").is_visible()
        assert seen.locator(".ft-stale svg").count() == 2
        assert seen.get_by_role("button", name="Run it").is_disabled()
        seen.get_by_label("reset length").click()
        drawing.get_by_text("25 mm").wait_for()
        seen.get_by_text("ready to run").wait_for()
        seen.get_by_label("title, in plots and reports").fill("at 200 kPa")
        seen.locator(".cm-content").get_by_text("at 200 kPa").wait_for()
        seen.get_by_label("Search keys and their descriptions").fill("young modulus")
        seen.get_by_label("block.modulus", exact=True).wait_for()
        seen.get_by_label("block.length").wait_for(state="hidden")
        seen.get_by_label("unit of modulus", exact=True).select_option("kPa")
        seen.get_by_label("block.modulus", exact=True).fill("6000")
        seen.get_by_text("2 keys changed").wait_for()
        seen.get_by_role("button", name="Run it").click()
        seen.wait_for_url("**/runs?job=*-run")
    assert tomllib.loads((place / "mine.toml").read_text()) == {
        "title": "at 200 kPa", "contact": {"pressure": 2e5}, "block": {"modulus": "6000 kPa"},
    }  # fmt: skip


def test_an_effect_is_switched_with_its_parameters(browser, server, place):
    base = server.split("/?")[0]
    with page(browser, server, 800) as seen:
        seen.goto(f"{base}/case")
        assert seen.get_by_role("button", name="New case", exact=True).count() == 1
        seen.get_by_role("button", name="New case", exact=True).click()
        seen.get_by_text("not saved yet").wait_for()
        seen.get_by_text("ready to run").wait_for()
        seen.get_by_label("Search effects").fill("wears")
        switch = seen.get_by_label("switch on wear", exact=True)
        switch.press("Space")
        rate = seen.get_by_label("wear.rate")
        rate.fill("1e-10")
        seen.get_by_role("button", name=re.compile(r"wear.rate 1e-10")).wait_for()
        seen.get_by_text("unsaved changes").wait_for()
        assert seen.evaluate("!!window.onbeforeunload")
        seen.get_by_label("switch off wear", exact=True).press("Space")
        rate.wait_for(state="detached")
        seen.get_by_text("No effect is on.").wait_for()
        switch.press("Space")
        rate.wait_for()
        assert rate.input_value() == "1e-10"
        seen.get_by_role("button", name="Save").click()
        seen.get_by_text("case.toml is saved").wait_for()
        seen.wait_for_url("**/case?open=case.toml")
        assert not seen.evaluate("!!window.onbeforeunload")
        seen.reload()
        seen.get_by_text("1 effect on:").wait_for()
    written = tomllib.loads((place / "case.toml").read_text())
    assert (written["effects"], written["wear"]) == (["wear"], {"rate": 1e-10})


def test_remarks_follow_the_keys_and_lead_to_them(browser, server, place):
    (place / "odd.toml").write_text('effects = ["wear"]\n[wear]\nrate = 0.0\n[contact]\npressure = 150.0\n')
    with page(browser, server) as seen:
        seen.goto(f"{server.split('/?')[0]}/case?open=odd.toml")
        remark = seen.get_by_role("button", name="contact.pressure: 150 Pa is unusual")
        remark.click()
        pressure = seen.get_by_label("contact.pressure", exact=True)
        seen.wait_for_function("field => field === document.activeElement", arg=pressure.element_handle())
        pressure.fill("150")
        seen.get_by_label("unit of pressure", exact=True).select_option("kPa")
        pressure.fill("151")
        remark.wait_for(state="detached")
        seen.get_by_role("button", name="Check that each effect acts").click()
        seen.get_by_role("button", name="wear: changes nothing: rate = 0 switches it off").click()
        rate = seen.get_by_label("wear.rate", exact=True)
        seen.wait_for_function("field => field === document.activeElement", arg=rate.element_handle())
        seen.get_by_role("button", name="Change effects").click()
        below_bar = "bar => bar.getBoundingClientRect().bottom <= [...document.querySelectorAll('h2')].find("
        below_bar += "h => h.innerText === 'Effects').getBoundingClientRect().top"
        seen.wait_for_function(below_bar, arg=seen.locator(".ft-stack > .ft-bar").element_handle())
        seen.get_by_label("Search keys and their descriptions").fill("mesh")
        seen.get_by_label("numerics.mesh", exact=True).fill("0.2")
        seen.get_by_role("button", name="numerics.mesh: coarse: the face temperature errs by about 5 %").wait_for()


def test_a_number_in_a_command_is_shown_with_its_unit(browser, server):
    with page(browser, server) as seen:
        seen.goto(f"{server.split('/?')[0]}/runs?command=run&of=mine.toml")
        seen.get_by_label("Keys of the case to change").fill("contact.pressure=150000")
        seen.get_by_text("contact.pressure is in Pa: 150 kPa").wait_for()


@pytest.mark.long  # test_lab_page.py opens a folder of hostile names
def test_names_in_a_case_are_shown_as_text(browser, server):
    base = server.split("/?")[0]
    with page(browser, server) as seen:
        seen.goto(f"{base}/case")
        seen.get_by_text(HOSTILE).first.wait_for()
        seen.goto(f"{base}/case?open=layers.toml")
        seen.get_by_text("ready to run").wait_for()
        seen.locator("svg.ft-drawing").get_by_text(HOSTILE).wait_for()
        seen.get_by_label(f"layers.{HOSTILE}.thickness").fill("3")
        seen.locator("svg.ft-drawing").get_by_text("8 mm", exact=True).wait_for()
        assert seen.evaluate("window.name_ran") is None
