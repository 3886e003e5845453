"""The laboratory's page: what it writes by clicks is what the command line reads, in a real browser and behind a token."""

from __future__ import annotations

import base64
import json
import os
import re
import shutil
import signal
import time
import tomllib
import urllib.error
import urllib.request
from pathlib import Path

import numpy as np
import pytest
from lab.browsing import CASE, COARSE, page, served, served_by_command
from lab.test_accessibility import check_page

import flashtemp
from flashtemp.camera import recording
from flashtemp.camera.importing.import_request import expand_patterns
from flashtemp.errors import BadInput
from flashtemp.lab import workspace as folders
from flashtemp.lab.campaign_list import new_campaign_text
from flashtemp.lab.image_marks import CORNER_NAMES, BlockMarks, find_onsets
from flashtemp.lab.import_part import free_recording_name
from flashtemp.lab.jobs import Job, JobList
from flashtemp.lab.toml_editing import set_toml_key
from flashtemp.model.toml_format import value_text

# --- marks -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("trailing", "up", "downstream", "top"),
    [
        ((130.0, 90.0), "up", "right", (130.0, 62.0)),
        ((30.0, 10.0), "left", "up", (2.0, 10.0)),
        ((-70.0, 90.0), "down", "left", (-70.0, 118.0)),
    ],
)
def test_two_marks_give_scale_direction_and_outline(trailing, up, downstream, top):
    marks = BlockMarks({CORNER_NAMES[0]: (30.0, 90.0), CORNER_NAMES[1]: trailing}, 25.0, 7.0, up)
    side = np.hypot(*np.subtract(trailing, (30.0, 90.0)))
    expected = np.array(trailing) + (np.array(top) - trailing) * side / 100.0
    np.testing.assert_allclose(marks.block_outline()[2], expected, atol=1e-9)
    facts = marks.to_options()
    assert (facts.downstream, facts.up) == (downstream, up)
    assert facts.pixel == (30.0, 90.0)
    assert facts.second == (*trailing, 25.0, 0.0)


def test_four_marks_give_the_map_of_a_view_at_an_angle():
    at = ((30.127, 90.0), (130.0, 92.0), (128.0, 60.0), (31.0, 61.0))
    marks = BlockMarks(dict(zip(CORNER_NAMES, at, strict=True)), 25.0, 7.0)
    assert marks.to_options().point[0] == (30.13, 90.0, 0.0, 0.0)
    assert marks.to_options().point[2] == (128.0, 60.0, 25.0, 7.0)
    assert marks.block_outline() == list(at)


def test_too_few_marks_say_nothing():
    marks = BlockMarks({CORNER_NAMES[0]: (1.0, 2.0)}, 25.0, 7.0)
    assert marks.block_outline() == []
    assert marks.to_options() == type(marks.to_options())()


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_starts_of_sliding_are_found_in_the_mean_of_the_images(noise):
    t = np.arange(0.0, 120.0, 0.25)
    since = t % 40.0 - 10.0
    rise = np.where(
        since < 0, 0.0, np.where(since < 12, np.sqrt(np.maximum(since, 0)), 3.46 * np.exp(-(since - 12) / 4))
    )
    found = find_onsets(t, rise + noise * np.random.default_rng(1).normal(size=len(t)))
    np.testing.assert_allclose(found, [10.0, 50.0, 90.0], atol=0.5)


def test_noise_alone_has_no_start():
    t = np.arange(0.0, 60.0, 0.5)
    assert find_onsets(t, 20.0 + 0.05 * np.random.default_rng(2).normal(size=len(t))) == []


# --- text ------------------------------------------------------------------------------------------------------
TEXT = """# mine
title = "a # b"
effects = [
    "wear",  # why
]

[block]
length = 0.02   # m

[friction]
mu = 1.0
[materials.own]
density = 1e3
"""


@pytest.mark.parametrize(
    ("table", "key", "value"),
    [
        ("", "title", "other"), ("", "effects", ["track_memory"]), ("", "free", ["friction.mu"]), ("block", "length", 0.03),
        ("block", "height", 1.4e-3), ("contact", "pressure", 2e5), ("friction", "mu", None), ("", "effects", None),
        ("schedule", "speed", [[0.0, 0.1], [1.0, 0.2]]),
    ],
)  # fmt: skip
def test_a_key_is_set_and_all_else_stays(table, key, value):
    before, after = tomllib.loads(TEXT), tomllib.loads(set_toml_key(TEXT, table, key, value))
    at = before if not table else before.setdefault(table, {})
    if value is None:
        at.pop(key, None)
    else:
        at[key] = value
    assert after == before
    assert "# mine" in set_toml_key(TEXT, table, key, value)


def test_a_comment_behind_a_value_stays():
    assert "length = 0.5   # m\n" in set_toml_key(TEXT, "block", "length", 0.5)


@pytest.mark.parametrize("value", [150000.0, 1.4e9, 123456.789, -3e7, 0.1, 7, True, "a", [1.5e6, 2], {"a.b": 1.0}])
def test_values_read_back_as_they_were(value):
    assert tomllib.loads(f"v = {value_text(value)}")["v"] == value


# --- the folder ------------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with a case and camera files: a block from column 30.3 to 130.3, the interface at row 90.6."""
    place = tmp_path_factory.mktemp("lab")
    (place / "case.toml").write_text(CASE)
    (place / "cam").mkdir()
    rng = np.random.default_rng(0)
    x, z = (np.arange(160)[None] - 30.3) / 100, (90.6 - np.arange(120)[:, None]) / 4
    for k in range(24):
        since = 0.5 * k - 4.0
        rise = 2.5 * np.sqrt(max(since, 0.0))
        T = np.where((x > 0) & (x < 1) & (z > 0) & (z < 7), 24 + rise * np.exp(-z / 1.5) * (0.3 + x), 20.0)
        T += 0.03 * rng.normal(size=T.shape)
        np.savetxt(place / "cam" / f"img{k + 1:02d}.csv", T, fmt="%.3f", delimiter="\t")
    return place


def test_the_folder_is_sorted_by_what_files_are(tmp_path):
    (tmp_path / "case.toml").write_text(CASE)
    (tmp_path / "campaign.toml").write_text('case = "case.toml"\n[[recording]]\nfile = "side.nc"\n')
    (tmp_path / "template.toml").write_text('files = ["*.jpg"]\n')
    (tmp_path / "expected.toml").write_text("[[check]]\nclaim = 1\n")
    (tmp_path / "img.csv").write_text("1\t2\n")
    (tmp_path / ".hidden").mkdir()
    (tmp_path / ".hidden" / "img.csv").write_text("1\t2\n")
    (tmp_path / "results" / "a").mkdir(parents=True)
    (tmp_path / "results" / "a" / "run.nc").write_bytes(b"")
    (tmp_path / "results" / "a" / "case.toml").write_text(CASE)
    found = folders.list_folder(tmp_path)
    assert [*map(str, found.cases)] == ["case.toml"]
    assert [*map(str, found.campaigns)] == ["campaign.toml"]
    assert [*map(str, found.templates)] == ["template.toml"]
    assert [*map(str, found.images)] == ["img.csv"]
    assert {str(k): v for k, v in found.results.items()} == {"results/a": "run"}


def test_files_of_one_series_belong_together_and_no_others(tmp_path):
    """What a folder of camera files and loggers offers to look at is what `import` takes."""
    for name in (
        "T (1).csv",
        "T (2).csv",
        "T (10).csv",
        "log.csv",
        "car.jpg",
        "even/img1.csv",
        "even/img2.csv",
        "[x] 1.csv",
        "[x] 2.csv",
    ):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("1\t2\n")
    series = folders.list_folder(tmp_path).image_series
    assert series == {"T (*).csv": 3, "[[]x] *.csv": 2, "log.csv": 1, "car.jpg": 1, "even": 2}
    taken = {name: [p.name for p in expand_patterns([str(folders.resolve_inside(tmp_path, name))])] for name in series}
    assert taken["T (*).csv"] == ["T (1).csv", "T (2).csv", "T (10).csv"]
    assert {name: len(some) for name, some in taken.items()} == series
    for name, free in {"T (*).csv": "T.nc", "even": "even.nc", "car.jpg": "car.nc", ".": "recording.nc"}.items():
        assert free_recording_name(tmp_path, name) == free


def test_a_new_campaign_believes_the_case_that_there_is(tmp_path):
    for name, case in {"b.toml": "b.toml", "a.toml": "a.toml", "case.toml": "case.toml"}.items():
        (tmp_path / name).write_text(CASE)
        assert tomllib.loads(new_campaign_text(folders.list_folder(tmp_path)))["case"] == case


@pytest.mark.parametrize("name", ["../outside.toml", "/etc/passwd", "a/../../b"])
def test_nothing_outside_the_folder_is_touched(tmp_path, name):
    with pytest.raises(BadInput, match="outside the folder"):
        folders.resolve_inside(tmp_path, name)


# --- commands that it starts -----------------------------------------------------------------------------------
def ended(job: Job, seconds: float = 120.0) -> Job:
    job.process.wait(seconds)
    return job


def test_a_command_is_started_stopped_and_gone_on_with(tmp_path):
    longer = COARSE.replace("repetitions = 2", "repetitions = 12")  # not over before it is stopped
    (tmp_path / "case.toml").write_text(longer)
    jobs = JobList(tmp_path)
    job = jobs.start(["run", "case.toml", "--out", "a"])
    assert job.state == "running"
    for _ in range(1200):
        if folders.list_folder(tmp_path).begun and job.progress()[0]:
            break
        time.sleep(0.05)
    share, line = job.progress()
    assert 0.0 <= share < 1.0
    assert line.startswith(tmp_path.name)
    job.stop()
    assert ended(job).state == "stopped"
    [(begun, owner)] = folders.list_folder(tmp_path).begun.items()
    assert owner.command == "run"
    assert ended(jobs.start(["run", "--resume", str(begun)])).state == "done"
    assert (tmp_path / "a" / "run.nc").is_file()
    assert job.log.read_text().startswith("$ flashtemp run case.toml --out a\n")
    assert ended(jobs.start(["run", "nothing.toml"])).state == "failed, exit code 2"


# --- the server ------------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def server(place):
    with served_by_command(place) as (address, _):
        yield address


class _Stay(urllib.request.HTTPRedirectHandler):
    def redirect_request(self, *args):
        return None


def asked(address, **headers):
    """Status and headers of a plain request."""
    request = urllib.request.Request(address, headers=headers)
    try:
        with urllib.request.build_opener(_Stay).open(request, timeout=20) as answer:
            return answer.status, answer.headers
    except urllib.error.HTTPError as fault:
        with fault:
            return fault.code, fault.headers


def test_only_who_has_the_token_gets_in(server):
    base, _, token = server.partition("/?token=")
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+", base)
    assert asked(base + "/")[0] == 403
    assert asked(f"{base}/?token={token[:-1]}{'y' if token[-1] == 'x' else 'x'}")[0] == 403
    assert asked(f"{base}/files/case.toml")[0] == 403
    status, headers = asked(f"{base}/case?open=case.toml&token={token}")
    assert (status, headers["location"]) == (303, "/case?open=case.toml")
    assert "HttpOnly" in headers["set-cookie"]
    assert "SameSite=Strict" in headers["set-cookie"]
    cookie = headers["set-cookie"].split(";")[0]
    assert asked(f"{base}/files/case.toml", Cookie=cookie)[0] == 200
    assert asked(f"{base}//evil.example/?token={token}")[1]["location"].startswith("/evil.example")


def test_no_other_site_can_stand_for_the_page(server):
    base, _, token = server.partition("/?token=")
    cookie = asked(server)[1]["set-cookie"].split(";")[0]
    assert asked(base + "/", Cookie=cookie, Host="evil.example")[0] == 403
    assert asked(server, Host="evil.example")[0] == 403
    assert asked(base + "/", Cookie=cookie, Origin="http://evil.example")[0] == 403
    assert asked(base + "/files/..%2f..%2fetc%2fpasswd", Cookie=cookie)[0] in (400, 404)


# --- in the browser --------------------------------------------------------------------------------------------
def at(seen, column, row, zoom=6, columns=160):
    """Where a pixel of the camera is on the page."""
    box = seen.locator("#image").bounding_box()
    scale = box["width"] / (columns * zoom)
    return box["x"] + (column + 0.5) * zoom * scale, box["y"] + (row + 0.5) * zoom * scale


@pytest.mark.parametrize("width", [1280, pytest.param(800, marks=pytest.mark.long)])
def test_clicks_make_the_recording_that_the_command_line_makes(browser, server, place, width, tmp_path):
    name = f"side{width}"
    with page(browser, server, width, path="/") as seen:
        check_page(seen)
        seen.get_by_role("link", name="view 24 files").click()
        seen.locator("#image").wait_for()
        check_page(seen)
        seen.get_by_label("frame rate (fps), 1/s", exact=True).wait_for()
        seen.locator("#image").scroll_into_view_if_needed()
        for column, row in ((30.3, 90.6), (130.3, 90.6)):
            seen.mouse.move(*at(seen, column, row))
            seen.mouse.down()
            seen.mouse.up()
            seen.wait_for_timeout(300)
        typed = [
            float(seen.get_by_label(f"{n}, {axis}", exact=True).input_value())
            for n in CORNER_NAMES[:2]
            for axis in ("column", "row")
        ]
        np.testing.assert_allclose(typed, [30.3, 90.6, 130.3, 90.6], atol=0.3)
        seen.get_by_label("frame rate (fps), 1/s", exact=True).fill("2")
        seen.get_by_role("button", name="Find starts").click()
        seen.get_by_label("recording", exact=True).fill(f"{name}.nc")
        seen.get_by_label("recording", exact=True).press("Tab")
        seen.get_by_text(f"flashtemp import {name}.toml").wait_for()
        seen.get_by_role("button", name="Save recording and template").click()
        seen.get_by_text("Recording 'sidewall' of 24 frames").wait_for()
    told = recording.load(place / f"{name}.nc")
    assert told.time[0] == pytest.approx(-4.0, abs=0.5)
    assert told.pitch[0] == pytest.approx(25e-3 / 100, rel=0.005)
    again = flashtemp.import_recording(place / f"{name}.toml", out=tmp_path / "again.nc").recording
    np.testing.assert_array_equal(again.temperature, told.temperature)
    assert again.u.tolist() == told.u.tolist()


DROP = """([uploader, files]) => {
    const all = new DataTransfer();
    for (const [name, bytes] of files)
        all.items.add(new File([Uint8Array.from(atob(bytes), c => c.charCodeAt(0))], name));
    const at = document.querySelector(uploader);
    at.dispatchEvent(new DragEvent("dragover", {bubbles: true, cancelable: true, dataTransfer: all}));
    setTimeout(() => at.querySelector(".q-uploader__dnd").dispatchEvent(
        new DragEvent("drop", {bubbles: true, cancelable: true, dataTransfer: all})), 100);
}"""


@pytest.mark.long  # the clicks above, and drops in test_dropped_files.py, are its parts
@pytest.mark.parametrize("several", [False, True])
def test_a_flir_image_is_dropped_marked_and_saved(browser, tmp_path, several):
    """A camera's own file, dragged onto the page from outside: what it says itself is not asked for."""
    image = base64.b64encode((Path(__file__).parents[1] / "data" / "flir_linear_load.jpg").read_bytes()).decode()
    files = [["load.jpg", image], ["load2.jpg", image]] if several else [["load.jpg", image], ["notes.pdf", image]]
    with served(tmp_path) as (address, _), page(browser, address) as seen:
        seen.goto(address.split("/?")[0] + "/camera")
        seen.locator(".q-uploader").wait_for()
        seen.wait_for_timeout(500)  # the page's own connection
        seen.evaluate(DROP, [".q-uploader", files])
        seen.locator("#image").wait_for()
        seen.get_by_text("emissivity 0.96, reflected 20").wait_for()
        seen.locator("#image").scroll_into_view_if_needed()
        for column in (20.0, 100.0):
            seen.mouse.click(*at(seen, column, 90.0, columns=120))
            seen.wait_for_timeout(300)
        name = "camera.nc" if several else "load.nc"
        assert seen.get_by_label("recording", exact=True).input_value() == name
        if several:
            seen.get_by_label("frame rate (fps), 1/s", exact=True).fill("9")
        seen.get_by_label("time of the first frame (start), s", exact=True).fill("1")
        seen.get_by_role("button", name="Save recording and template").click()
        seen.get_by_text("Recording 'sidewall'").wait_for()
    told = recording.load(tmp_path / name)
    assert told.temperature.shape[0] == len(files) - (not several)
    assert told.emissivity == pytest.approx(0.96)
    assert np.nanmax(told.temperature) == pytest.approx(89.11, abs=0.1)
    assert told.pitch[0] == pytest.approx(25e-3 / 80, rel=0.01)
    assert not (tmp_path / "notes.pdf").exists()


@pytest.mark.long  # test_start_buttons.py starts a run from a case
def test_a_case_is_written_run_and_seen(browser, server, place):
    """By keys alone: a field of the form, the text beside it, a fault, a run with its result."""
    with page(browser, server) as seen:
        seen.goto(server.split("/?")[0] + "/case?open=case.toml")
        field = seen.get_by_label("schedule.distance")
        field.wait_for()
        field.fill("far")
        field.press("Tab")
        seen.get_by_role("alert").get_by_text("schedule.distance").first.wait_for()
        field.fill("0.3")
        field.press("Tab")
        seen.wait_for_function("() => !document.querySelector('[role=alert]')")
        seen.get_by_role("button", name="Save").press("Enter")
        seen.get_by_text("case.toml is saved").wait_for()
        assert tomllib.loads((place / "case.toml").read_text())["schedule"]["distance"] == 0.3
        seen.goto(server.split("/?")[0] + "/runs?command=run&of=case.toml")
        seen.get_by_text("flashtemp run case.toml --out results/case-run").wait_for()
        seen.get_by_role("button", name="Start").press("Enter")
        seen.get_by_role("link", name="open the result").click(timeout=120_000)
        seen.get_by_text("t = ").wait_for()
        slider = seen.get_by_role("slider", name="time")
        before = seen.get_by_text("t = ").inner_text()
        slider.locator("[tabindex]").press("ArrowLeft")
        seen.wait_for_function("was => !document.body.innerText.includes(was)", arg=before)
    assert (place / "results" / "case-run" / "run.nc").is_file()


@pytest.mark.long  # the clicks and the case above are its parts
def test_from_a_folder_to_a_verdict(browser, tmp_path):
    """Recordings of a synthetic campaign and its case: a campaign by clicks, discover, the verdict on the page."""
    place = tmp_path / "folder"
    place.mkdir()
    (place / "case.toml").write_text(CASE.replace("mesh = 0.3", "mesh = 0.6"))
    flashtemp.twin(place / "case.toml", hide=[], seed=3, out=tmp_path / "twin", conditions=1, views=["sidewall"])
    shutil.copy(next((tmp_path / "twin").glob("*sidewall.nc")), place / "side.nc")
    with served(place) as (address, _), page(browser, address, path="/") as seen:
        seen.get_by_role("button", name="Put it together").click()
        seen.get_by_role("button", name="New campaign").click()
        seen.get_by_text("One condition").wait_for()
        assert seen.get_by_label("case of the base model").input_value() == "case.toml"
        seen.get_by_text("side.nc").first.wait_for()
        for key in ("contact.spot_fraction", "ambient.convection"):  # what the twin draws anew
            seen.get_by_label("add a free key").fill(key)
            seen.get_by_role("option", name=key).first.click()
            seen.get_by_label(f"prior of {key}").wait_for()
        seen.get_by_role("button", name="Ask what is missing").click()
        seen.get_by_text("flashtemp discover campaign.toml").first.wait_for()
        seen.get_by_role("link", name="open the result").click(timeout=300_000)
        verdict = json.loads((place / "results" / "campaign-discover" / "verdict.json").read_text())
        answer = seen.frame_locator("iframe").get_by_text(verdict["says"][0]).first
        answer.wait_for()
        assert answer.is_visible()
    assert verdict["verdict"] == "none_needed", "nothing was hidden"


@pytest.mark.long  # starting and stopping above is its part
def test_two_pages_see_the_same_and_a_killed_server_loses_nothing(browser, tmp_path):
    """The run goes on to its end, and the next server of the folder shows it."""
    (tmp_path / "case.toml").write_text(CASE)
    with served(tmp_path) as (address, process), page(browser, address) as one, page(browser, address) as two:
        for seen in (one, two):
            seen.goto(address.split("/?")[0] + "/runs?command=run&of=case.toml")
        one.get_by_role("button", name="Start").click()
        for seen in (one, two):
            seen.get_by_text(re.compile("running|done")).first.wait_for()
        os.kill(process.pid, signal.SIGKILL)
    result = tmp_path / "results" / "case-run" / "run.nc"
    for _ in range(600):
        if result.is_file():
            break
        time.sleep(0.1)
    assert result.is_file()
    assert [*map(str, folders.list_folder(tmp_path).results)] == ["results/case-run"]
