"""A recording is viewed the right way round in mm, and what is measured and entered outlives a reload of the page."""

from __future__ import annotations

import gc
import re
import tracemalloc

import numpy as np
import pytest
from lab.browsing import CASE, page, served

from flashtemp.camera.importing.frame_times import FrameTimestamps, resolve_repetitions
from flashtemp.camera.importing.import_options import ImportOptions
from flashtemp.camera.recording import Recording
from flashtemp.errors import BadInput
from flashtemp.lab.camera_files import find_camera_files, find_templates_of
from flashtemp.lab.frame_reading import ReadingCancelled
from flashtemp.lab.frame_server import FrameServer
from flashtemp.lab.measurements import read_measurements
from flashtemp.lab.opened_frames import open_frames
from flashtemp.lab.page_fields import name_page_fields
from flashtemp.lab.recording_facts import find_template, find_uses
from flashtemp.lab.workspace import list_folder

PITCH, ROWS, COLUMNS = 0.25e-3, 40, 104  # m, pixels
LEADING, INTERFACE = 4.0, 4.0  # columns before x = 0, rows below z = 0
CAMPAIGN = """case = "case.toml"
free = ["friction.mu"]
[[recording]]
file = "measured/side.nc"
with = { "contact.pressure" = 150000, "schedule.speed" = 0.1 }
sigma_K = 0.05
"""
TEMPLATE = """files = ["camera/frame_0.csv", "camera/frame_1.csv"]
out = "measured/side.nc"
view = "sidewall"
downstream = "right"
up = "up"
pixel = [4.0, 30.0]
second = [100.0, 30.0, 25.0, 0.0]
fps = 2.0
start = 0.0
repetition = 1
"""


def make_recording(view: str = "sidewall") -> Recording:
    """A side that is 30 degC at the interface and 20 degC far above, with a pixel that is dead in every frame."""
    u, v = (np.arange(COLUMNS) - LEADING) * PITCH, (np.arange(ROWS) - INTERFACE) * PITCH
    one = 20.0 + 10.0 * np.exp(-np.abs(v)[:, None] / 1e-3) * (1.0 + 0.0 * u)
    T = one + 0.05 * np.random.default_rng(0).normal(size=(6, ROWS, COLUMNS))
    T[:, 30, 50] = np.nan
    if view == "profile":
        T, v = T[:, :1], np.zeros(1)
    return Recording(view, T, np.arange(6.0) + 3.0, np.array([1, 1, 1, 2, 2, 2]), u, v, netd_K=0.05)


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with recordings, their campaign, and the template and camera files of one of them."""
    place = tmp_path_factory.mktemp("recordings")
    (place / "case.toml").write_text(CASE)
    (place / "campaign.toml").write_text(CAMPAIGN)
    (place / "template.toml").write_text(TEMPLATE)
    for name in ("measured", "camera"):
        (place / name).mkdir()
    make_recording().save(place / "measured" / "side.nc")
    make_recording("profile").save(place / "measured" / "150kPa.nc")
    for k in range(2):
        np.savetxt(place / "camera" / f"frame_{k}.csv", 20.0 + k + np.ones((ROWS, COLUMNS)), fmt="%.2f", delimiter=";")
    return place


@pytest.fixture(scope="module")
def server(place):
    with served(place) as (address, _):
        yield address


def address_of(server, name):
    """The address of the camera page with that file."""
    return f"{server.split('/?')[0]}/camera?open={name}"


def at(seen, x, z):
    """Where a place in mm is on the page."""
    box = seen.locator("#image").bounding_box()
    column, row = x * 1e-3 / PITCH + LEADING, ROWS - 1 - (z * 1e-3 / PITCH + INTERFACE)
    return box["x"] + (column + 0.5) / COLUMNS * box["width"], box["y"] + (row + 0.5) / ROWS * box["height"]


# --- what is opened ---------------------------------------------------------------------------------------------
def test_rows_of_a_recording_count_downwards_and_its_map_gives_mm(place):
    opened, known = open_frames([place / "measured" / "side.nc"]), make_recording()
    np.testing.assert_allclose(opened.frames[:, ::-1], known.temperature, atol=1e-4)
    np.testing.assert_allclose(opened.time, known.time)
    x, z, _ = opened.find_map() @ [LEADING, ROWS - 1 - INTERFACE, 1.0]
    assert (x, z) == (pytest.approx(0.0, abs=1e-9), pytest.approx(0.0, abs=1e-9))
    assert opened.pixel_classes[ROWS - 1 - 30, 50] == 1
    assert opened.with_screening().screened.classes[ROWS - 1 - 30, 50] == 1


def test_of_a_recording_one_frame_of_so_many_can_be_kept(place):
    opened = open_frames([place / "measured" / "side.nc"], ImportOptions(every=2))
    assert len(opened.frames) == len(opened.mean) == len(opened.time) == 3
    np.testing.assert_allclose(opened.mean, np.nanmean(make_recording().temperature[::2], axis=(1, 2)), atol=1e-4)


def test_uses_and_template_of_a_recording_are_found(place):
    listing, file = list_folder(place), place / "measured" / "side.nc"
    (use,) = find_uses(place, listing, file)
    assert str(use.campaign) == "campaign.toml"
    assert use.conditions == {"contact.pressure": 150000, "schedule.speed": 0.1}
    assert str(find_template(place, listing, file)) == "template.toml"
    other = place / "measured" / "150kPa.nc"
    assert (find_uses(place, listing, other), find_template(place, listing, other)) == ([], None)


def test_a_template_of_just_these_camera_files_is_offered(place):
    (place / "damaged.toml").write_text("files = [")
    templates = ["template.toml", "damaged.toml", "missing.toml"]
    assert find_templates_of(place, "camera", templates) == ["template.toml"]
    assert find_templates_of(place, "camera/frame_0.csv", templates) == []
    (place / "damaged.toml").unlink()


def test_messages_name_the_fields_of_the_page():
    text = "a.csv: does not say when its frames were taken; give --fps and --start, or --times FILE.csv"
    assert name_page_fields(text).endswith(
        "; enter the frame rate and the time of the first frame, or choose a table of times"
    )
    assert name_page_fields("give --crop u0 u1 v0 v1") == "give crop in the template u0 u1 v0 v1"
    assert name_page_fields("a -- b, a--b.csv") == "a -- b, a--b.csv"
    with pytest.raises(BadInput) as refused:
        resolve_repetitions([("a.csv", FrameTimestamps(2))], np.zeros(2), ImportOptions())
    assert "--" not in name_page_fields(str(refused.value))


def test_a_file_that_is_gone_is_named(place):
    with pytest.raises(BadInput, match=r"^gone.csv: no such file"):
        find_camera_files(place, ["gone.csv"])


def test_kept_measurements_that_do_not_fit_are_left_out():
    good = {"name": "Nose", "kind": "spot", "points": [[3.0, 4.0]]}
    wrong = [
        7, {"kind": "spot"}, {**good, "points": [[3.0, 400.0]]}, {**good, "points": [[3.0, float("nan")]]},
        {**good, "kind": "box"}, {**good, "points": "ab"}, {**good, "kind": []},
    ]  # fmt: skip
    assert [m.name for m in read_measurements([*wrong, good, good], (40, 60), 1)] == ["Nose"]
    assert read_measurements({"a": 1}, (40, 60), 9) == []


# --- reading ----------------------------------------------------------------------------------------------------
def test_a_cancelled_reading_leaves_nothing_behind(tmp_path, monkeypatch):
    """Neither the frames that were read stay in memory nor the temporary file of many frames."""
    from flashtemp.camera.importing import frame_buffer

    monkeypatch.setattr(frame_buffer, "MAX_BUFFER_BYTES", 10)
    monkeypatch.setattr(frame_buffer.tempfile, "tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    for k in range(6):
        np.savetxt(tmp_path / f"a{k}.csv", 20.0 + np.ones((400, 600)), fmt="%.2f", delimiter=";")
    files, server, shares = sorted(tmp_path.glob("*.csv")), FrameServer(), []

    def cancel_fourth(number):
        if len(shares) > 3:
            raise ReadingCancelled

    tracemalloc.start()
    with pytest.raises(ReadingCancelled):
        server.read(files, ImportOptions(), cancel_fourth, shares.append)
    gc.collect()
    held = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    np.testing.assert_allclose(shares, np.arange(1, 5) / 6)
    assert held < 400 * 600 * 4, "less than one frame"
    assert list((tmp_path / "temporary").iterdir()) == []
    assert not server._versions


def test_opening_many_files_shows_progress_and_can_be_cancelled(browser, tmp_path):
    (tmp_path / "many").mkdir()
    np.savetxt(first := tmp_path / "many" / "img0.csv", 20.0 + np.ones((240, 320)), fmt="%.2f", delimiter=";")
    for k in range(1, 400):
        (tmp_path / "many" / f"img{k}.csv").hardlink_to(first)
    with served(tmp_path) as (address, _), page(browser, address) as seen:
        seen.goto(address.split("/?")[0] + "/camera?open=many")
        seen.get_by_text("frames so far").wait_for()
        bar = seen.get_by_role("progressbar", name="part of the files")
        seen.wait_for_function("Number(document.querySelector('[role=progressbar]').getAttribute('aria-valuenow')) > 0")
        assert bar.is_visible()
        seen.get_by_role("button", name="Cancel").click()
        seen.get_by_text("Drop camera files here or choose them").wait_for()
        assert seen.url.endswith("/camera")


# --- in the browser ---------------------------------------------------------------------------------------------
def test_a_recording_is_shown_upright_in_mm_with_its_facts_and_the_next_step(browser, server):
    with page(browser, server) as seen:
        seen.goto(address_of(server, "measured/side.nc"))
        seen.get_by_text("Found: 1 bad pixel.").wait_for()
        assert seen.get_by_text("Position of the block").count() == seen.get_by_text("Save recording").count() == 0
        assert seen.get_by_role("radio", name="Edges").count() == 0
        seen.mouse.move(*at(seen, 10.0, 0.0))
        seen.locator(".tv-read").filter(has_text=re.compile(r"mm: (29\.[89]|30\.[012])")).wait_for()
        words = seen.locator(".tv-read").inner_text().replace(",", "").split()
        assert words[0] == "x"
        np.testing.assert_allclose([float(words[1]), float(words[4])], [10.0, 0.0], atol=0.15)
        assert seen.locator(".tv-ruler.across b").inner_text() == "x, mm"
        assert "0" in seen.locator(".tv-ruler.up span").all_inner_texts()
        assert seen.locator(".tv-time").inner_text() == "frame 0 of 5 · 3 s · repetition 1"
        for words in ("150 kPa", "0.05 K stated", "3 to 8 s from the first start of sliding"):
            seen.get_by_text(words).first.wait_for()
        assert "--" not in seen.locator(".ft-main").inner_text()
        seen.get_by_role("button", name="Correct the marks").click()
        seen.get_by_text("Position of the block").wait_for()
        assert seen.get_by_label("recording", exact=True).input_value() == "measured/side.nc"
        seen.go_back()
        seen.get_by_role("button", name="Open the campaign").click()
        seen.wait_for_url("**/campaign?open=campaign.toml")


def test_measurements_names_and_comparison_outlive_a_reload(browser, server):
    with page(browser, server) as seen:
        seen.goto(address_of(server, "measured/side.nc"))
        seen.get_by_text("Found:").wait_for()
        seen.mouse.click(*at(seen, 10.0, 2.0))
        place = seen.get_by_label("Spot 1: x, z, mm")
        place.wait_for()
        place.fill("12.5, 0.0")
        place.press("Tab")
        name = seen.get_by_label("name of Spot 1")
        name.fill("Nose")
        name.press("Tab")
        seen.get_by_label("Nose: x, z, mm").wait_for()
        seen.get_by_label("compare with").click()
        seen.get_by_role("option", name="camera", exact=True).click()
        seen.wait_for_function("document.querySelectorAll('.tv[data-frame]').length === 2")
        seen.reload()
        seen.wait_for_function("document.querySelectorAll('.tv[data-frame]').length === 2")
        assert seen.get_by_label("Nose: x, z, mm").input_value() == "12.50, 0.00"
        value = seen.get_by_role("row").filter(has=seen.get_by_label("name of Nose")).get_by_role("cell").nth(2)
        assert float(value.inner_text()) == pytest.approx(30.0, abs=0.3)


@pytest.mark.long  # as measurements above do
def test_marks_and_entered_values_outlive_a_reload(browser, server):
    with page(browser, server) as seen:
        seen.goto(address_of(server, "camera"))
        seen.get_by_text("Found:").wait_for()
        magnifier = seen.locator("#magnifier")
        assert not magnifier.is_visible()  # there is no mark whose surroundings it could show
        assert "--" not in seen.get_by_role("table", name="Files").inner_text()
        box = seen.locator("#image").bounding_box()
        seen.mouse.click(box["x"] + 0.2 * box["width"], box["y"] + 0.7 * box["height"])
        seen.wait_for_function("document.getElementById('magnifier').dataset.empty === 'false'")
        seen.get_by_label("frame rate (fps), 1/s", exact=True).fill("2.5")
        seen.get_by_label("frame rate (fps), 1/s", exact=True).press("Tab")
        seen.get_by_text("Enter the frame rate.").wait_for(state="detached")
        column = seen.get_by_label("leading edge, column", exact=True).input_value()
        seen.reload()
        seen.get_by_text("Found:").wait_for()
        seen.wait_for_function("document.querySelector('[aria-label=\"frame rate (fps), 1/s\"]').value === '2.5'")
        assert seen.get_by_label("leading edge, column", exact=True).input_value() == column != ""
        assert magnifier.is_visible()


def test_a_profile_is_shown_as_lines(browser, server):
    with page(browser, server) as seen:
        seen.goto(address_of(server, "measured/150kPa.nc"))
        seen.get_by_role("img", name="temperature along the block").wait_for()
        seen.get_by_text("Its name says 150 kPa.").wait_for()
        seen.get_by_text("104 of 0.25 mm").wait_for()


def test_what_the_reader_needs_is_asked_on_the_page(browser, tmp_path):
    from scipy.io import savemat

    savemat(tmp_path / "frames.mat", {"a": 300.0 + np.ones((30, 40)), "b": 310.0 + np.ones((30, 40))})
    with served(tmp_path) as (address, _), page(browser, address) as seen:
        seen.goto(address_of(address, "frames.mat"))
        field = seen.get_by_label("name of the array")
        field.fill("b")
        assert "--" not in seen.get_by_role("alert").inner_text()
        seen.get_by_role("button", name="Open again").click()
        seen.get_by_label("unit of the temperatures").click()
        seen.get_by_role("option", name="K", exact=True).click()
        seen.get_by_role("button", name="Open again").click()
        seen.get_by_text("37.85 to 37.85").wait_for()
