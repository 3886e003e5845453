"""The camera page: values, colours, measurements, playback and defects in the browser are those of the frames."""

from __future__ import annotations

import csv
import io
from types import SimpleNamespace

import numpy as np
import pytest
from lab.browsing import page, served

from flashtemp.camera.importing.import_options import ImportOptions
from flashtemp.lab import frame_screening
from flashtemp.lab.camera_files import draw_thumbnail, write_example
from flashtemp.lab.frame_server import FrameServer
from flashtemp.lab.measurements import (
    STATISTICS,
    Measurement,
    curves_table,
    measure_frames,
    profile_along,
    summarise_values,
)
from flashtemp.lab.opened_frames import open_frames
from flashtemp.lab.palettes import PALETTE_TABLES, palette_colours

ROWS, COLUMNS, FRAMES = 90, 120, 24
DEAD_PIXEL = (30, 20)  # column, row
IMAGE = np.arange(20.0, 40.0, 0.125).reshape(10, 16)


# --- measurements ----------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def frames():
    """Frames that rise by 1 K per frame, 0.1 K per column and 0.01 K per row."""
    k, r, c = np.mgrid[:5, :20, :30]
    return 20.0 + k + 0.1 * c + 0.01 * r


def test_a_box_counts_the_pixels_under_it_with_both_corners(frames):
    found = measure_frames(frames, Measurement("Box 1", "box", ((10.2, 8.4), (3.8, 5.0))))
    inside = frames[:, 5:9, 4:11]
    for name, expected in zip(STATISTICS, (np.mean, np.min, np.max, np.std), strict=True):
        np.testing.assert_allclose(found[name], expected(inside, axis=(1, 2)), rtol=1e-12)


def test_a_spot_is_the_nearest_pixel_and_a_line_is_linear_between_pixels(frames):
    spot = measure_frames(frames, Measurement("Spot 1", "spot", ((6.4, 3.6),)))
    np.testing.assert_allclose(spot["mean"], frames[:, 4, 6])
    distance, T = profile_along(frames[2], Measurement("Line 1", "line", ((2.0, 3.0), (18.0, 15.0))))
    np.testing.assert_allclose(distance, np.linspace(0.0, 20.0, 21))
    np.testing.assert_allclose(T, 22.0 + 0.1 * (2.0 + 0.8 * distance) + 0.01 * (3.0 + 0.6 * distance))


def test_a_profile_is_in_mm_where_the_marks_give_a_scale(frames):
    distance, _ = profile_along(
        frames[0], Measurement("Line 1", "line", ((2.0, 3.0), (18.0, 15.0))), np.diag([2e-4, 2e-4, 1.0])
    )
    assert distance[-1] == pytest.approx(20 * 0.2)


def test_unknown_pixels_count_nowhere():
    found = summarise_values(np.array([[1.0, np.nan, 3.0], [np.nan] * 3]))
    assert [found[name][0] for name in STATISTICS] == [2.0, 1.0, 3.0, 1.0]
    assert all(np.isnan(found[name][1]) for name in STATISTICS)


def test_curves_are_exported_with_units_and_empty_cells(frames):
    some = [Measurement("Spot 1", "spot", ((0.0, 0.0),)), Measurement("Box 2", "box", ((0.0, 0.0), (1.0, 0.0)))]
    curves = [measure_frames(frames, m) for m in some]
    curves[0]["mean"][1] = np.nan
    rows = list(csv.reader(io.StringIO(curves_table(some, curves, np.arange(5) / 2, "°C"))))
    assert rows[0][:4] == ["frame", "time, s", "Spot 1, °C", "Box 2 mean, °C"]
    assert rows[2][:3] == ["1", "0.5", ""]
    assert float(rows[3][3]) == pytest.approx(22.05)


@pytest.mark.parametrize("name", PALETTE_TABLES)
def test_palettes_are_those_of_matplotlib(name):
    """Between the entries of a table the page interpolates, which is off by less than 3 % of full brightness."""
    from matplotlib import colormaps

    table = np.array([[int(c[k : k + 2], 16) for k in (1, 3, 5)] for c in palette_colours(name)]) / 255.0
    at = np.linspace(0.0, 1.0, 256)
    mixed = np.stack([np.interp(at, np.linspace(0.0, 1.0, len(table)), part) for part in table.T], axis=1)
    np.testing.assert_allclose(mixed, colormaps[name](at)[:, :3], atol=0.03)


# --- frames over HTTP ------------------------------------------------------------------------------------------
def request(server, key, name, step="1"):
    """The answer of a frame server."""
    return server.answer(SimpleNamespace(path_params={"key": key, "name": name}, query_params={"step": step}))


def test_frames_are_served_only_with_their_key_until_they_are_withdrawn(tmp_path):
    np.savetxt(tmp_path / "a.csv", IMAGE, delimiter="\t")
    server, opened = FrameServer(), open_frames([tmp_path / "a.csv"])
    address = server.share(opened)
    key = address.removeprefix("/frames/")
    assert len(key) >= 24
    assert address != server.share(opened)
    answer = request(server, key, "0")
    np.testing.assert_array_equal(np.frombuffer(answer.body, "<f4"), IMAGE.ravel())
    assert answer.headers["cache-control"] == "no-store"
    np.testing.assert_array_equal(np.frombuffer(request(server, key, "0", "2").body, "<f4"), IMAGE[::2, ::2].ravel())
    for name, step in (("1", "1"), ("-1", "1"), ("0", "0"), ("0", "65"), ("..", "1"), ("²", "1"), ("9" * 20, "1")):
        assert request(server, key, name, step).status_code == 404
    assert request(server, "other", "0").status_code == 404
    server.withdraw(address)
    assert request(server, key, "0").status_code == 404


def test_frames_are_read_once_while_a_page_shows_them_and_again_after_a_change(tmp_path):
    file, counted = tmp_path / "a.csv", []
    np.savetxt(file, IMAGE, delimiter="\t")
    server = FrameServer()
    first = server.read([file], ImportOptions(), counted.append)
    assert server.read([file], ImportOptions(), counted.append) is first
    server.replace(server.share(first), screened := first.with_screening())
    assert server.read([file], ImportOptions(), counted.append) is screened
    np.savetxt(file, IMAGE + 1.0, fmt="%.5f", delimiter="\t")
    assert server.read([file], ImportOptions(), counted.append).frames[0, 0, 0] == 21.0
    assert counted == [1, 1]


# --- defects of the camera -------------------------------------------------------------------------------------
def test_a_stuck_pixel_a_frozen_frame_and_a_shutter_event_are_found():
    rng = np.random.default_rng(1)
    T = 20.0 + 0.05 * rng.normal(size=(40, 60, 80))
    T[:, 10, 20] = 27.0
    T[25:] += 0.6
    T[12] = T[11]
    found = frame_screening.screen_frames(T, np.arange(40.0), np.zeros((60, 80), bool))
    assert found.list_pixels(9) == [(20, 10, "differs from its neighbours or does not change")]
    assert found.shutter == (25,)
    assert found.frozen == (12,)


def test_many_frames_are_screened_in_parts(monkeypatch):
    """Of more values than the limit, events are still found in every frame, and pixels at every place."""
    monkeypatch.setattr(frame_screening, "MAX_PIXEL_VALUES", 30_000)
    monkeypatch.setattr(frame_screening, "MAX_EVENT_VALUES", 30_000)
    test_a_stuck_pixel_a_frozen_frame_and_a_shutter_event_are_found()


def test_a_thumbnail_of_what_is_no_image_says_so(tmp_path):
    (tmp_path / "notes.csv").write_text("no numbers\n")
    assert draw_thumbnail(tmp_path, "notes.csv").startswith("No preview: notes.csv")
    assert draw_thumbnail(tmp_path, "../a.csv").startswith("No preview")
    np.savetxt(tmp_path / "a.csv", IMAGE, delimiter="\t")
    assert draw_thumbnail(tmp_path, "a.csv").startswith("data:image/png;base64,")


# --- in the browser --------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with two series of one block; the second is 2 K warmer and has a dead pixel."""
    place = tmp_path_factory.mktemp("camera")
    rng = np.random.default_rng(0)
    r, c = np.mgrid[:ROWS, :COLUMNS]
    for name, warmer in (("cold", 0.0), ("warm", 2.0)):
        (place / name).mkdir()
        for k in range(FRAMES):
            T = 20.0 + warmer + 0.1 * c + 0.02 * rng.normal(size=r.shape) + (0.5 if k >= 15 else 0.0)
            T[DEAD_PIXEL[::-1]] = 45.0
            np.savetxt(place / name / f"img{k:02d}.csv", T, fmt="%.3f", delimiter="\t")
    return place


@pytest.fixture(scope="module")
def server(place):
    with served(place) as (address, _):
        yield address


def at(seen, column, row):
    """Where a pixel of the camera is on the page."""
    box = seen.locator("#image").bounding_box()
    return box["x"] + (column + 0.5) / COLUMNS * box["width"], box["y"] + (row + 0.5) / ROWS * box["height"]


def colour(seen, column, row):
    """The colour (red, green, blue) of the canvas at a pixel of the camera."""
    return seen.evaluate(
        """([c, r]) => { const a = document.getElementById("image");
        return [...a.getContext("2d").getImageData(c * a.width, r * a.height, 1, 1).data].slice(0, 3) }""",
        [(column + 0.5) / COLUMNS, (row + 0.5) / ROWS],
    )


def open_series(seen, server, name="cold"):
    seen.goto(f"{server.split('/?')[0]}/camera?open={name}")
    seen.locator(".tv[data-frame]").wait_for()
    seen.get_by_text("Found:").wait_for()
    seen.locator("#image").scroll_into_view_if_needed()


def drag(seen, a, b):
    """Press at one pixel, move to another, release."""
    seen.mouse.move(*at(seen, *a))
    seen.mouse.down()
    seen.mouse.move(*at(seen, *b), steps=4)
    seen.mouse.up()


def test_measurements_stay_move_and_are_listed_with_their_values(browser, server):
    with page(browser, server) as seen:
        open_series(seen, server)
        seen.get_by_role("radio", name="Spot").click()
        seen.mouse.click(*at(seen, 50, 40))
        row = seen.get_by_role("row").filter(has=seen.get_by_label("name of Spot 1"))
        row.wait_for()
        assert float(row.get_by_role("cell").nth(2).inner_text()) == pytest.approx(25.0, abs=0.15)
        seen.get_by_role("radio", name="Box").click()
        drag(seen, (60, 60), (80, 70))
        box = seen.get_by_role("row").filter(has=seen.get_by_label("name of Box 2"))
        box.wait_for()
        told = [float(box.get_by_role("cell").nth(k).inner_text()) for k in (2, 3, 4)]
        np.testing.assert_allclose(told, [27.0, 26.0, 28.0], atol=0.15)
        drag(seen, (50, 40), (20, 40))
        seen.wait_for_function("Math.abs(document.querySelector('td:nth-child(3)').innerText - 22) < 0.15")
        seen.get_by_role("slider", name="frame").press("End")
        seen.wait_for_function("Math.abs(document.querySelector('td:nth-child(3)').innerText - 22.5) < 0.15")
        with seen.expect_download() as told:
            seen.get_by_role("button", name="Curves as CSV").click()
        lines = told.value.path().read_text("utf-8-sig").splitlines()
        assert len(lines) == FRAMES + 1
        assert lines[0].startswith("frame,")
        seen.get_by_role("button", name="delete Spot 1").click()
        row.wait_for(state="detached")
        assert box.is_visible()


def test_colours_follow_range_palette_isotherm_and_defects(browser, server):
    with page(browser, server) as seen:
        open_series(seen, server)
        seen.mouse.move(5, 5)
        assert colour(seen, *DEAD_PIXEL) == [0, 213, 213]
        seen.get_by_role("switch", name="bad pixels").click()
        seen.get_by_label("palette").click()
        seen.get_by_role("option", name="grey", exact=True).click()
        for label, value in (("from, °C", "20"), ("to, °C", "30")):
            seen.get_by_label(label).fill(value)
            seen.get_by_label(label).press("Enter")
            seen.get_by_label(label).press("Tab")
        seen.wait_for_timeout(300)
        np.testing.assert_allclose(colour(seen, 60, 40), 0.6 * 255, atol=4)
        assert colour(seen, *DEAD_PIXEL) == [255, 255, 255]
        assert seen.locator(".tv-tick").all_inner_texts() == ["20", "22", "24", "26", "28", "30"]
        seen.get_by_label("isotherm").click()
        seen.get_by_role("option", name="above").click()
        seen.get_by_label("above, °C").fill("25")
        seen.get_by_label("above, °C").press("Enter")
        seen.get_by_label("above, °C").press("Tab")
        seen.wait_for_timeout(300)
        assert colour(seen, 60, 40) == [0, 230, 118]
        assert colour(seen, 40, 40) != [0, 230, 118]
        assert seen.locator(".tv-event.shutter").get_attribute("title") == "shutter event, frame 15"


def test_a_frame_is_saved_with_its_scale_and_as_a_table(browser, server, place):
    from PIL import Image

    with page(browser, server) as seen:
        open_series(seen, server)
        files = []
        for words in ("Image with scale (PNG)", "Temperatures of this frame (CSV)"):
            seen.get_by_role("button", name="save the image").click()
            with seen.expect_download() as told:
                seen.get_by_text(words).click()
            files.append(told.value.path())
        picture = Image.open(files[0]).convert("RGB")
        shown = seen.locator("#image").bounding_box()
        assert picture.width > shown["width"] + 60
        bar = [picture.getpixel((int(12 + shown["width"] + 20), 34 + int(y))) for y in (5, shown["height"] - 5)]
        assert sum(bar[0]) > 600 > 60 > sum(bar[1])  # from the brightest colour of the palette to the darkest
        np.testing.assert_allclose(
            np.genfromtxt(files[1], delimiter=","), np.loadtxt(place / "cold" / "img00.csv"), atol=1e-3
        )


def test_a_box_marks_its_hottest_pixel_and_the_scale_is_dragged(browser, server):
    with page(browser, server) as seen:
        open_series(seen, server)
        seen.get_by_role("radio", name="Box").click()
        drag(seen, (25, 12), (40, 30))
        seen.get_by_label("name of Box 1").wait_for()
        seen.mouse.move(5, 5)
        assert colour(seen, *DEAD_PIXEL) == [255, 82, 82]
        scale, upper = seen.locator(".tv-scale").bounding_box(), seen.get_by_label("to, °C")
        before = float(upper.input_value())
        seen.mouse.move(scale["x"] + 8, scale["y"] + 10)
        seen.mouse.down()
        seen.mouse.move(scale["x"] + 8, scale["y"] + 10 + scale["height"] / 5, steps=4)
        seen.mouse.up()
        seen.wait_for_function(
            "v => Number(document.querySelector('[aria-label=\"to, °C\"]').value) < v", arg=before - 2
        )


def test_frames_play_zoom_and_compare_with_another_series(browser, server):
    with page(browser, server) as seen:
        open_series(seen, server)
        seen.get_by_label("compare with").click()
        seen.get_by_role("option", name="warm", exact=True).click()
        other = seen.locator(".tv").nth(1)
        other.locator("canvas").first.wait_for()
        seen.wait_for_function("document.querySelectorAll('.tv[data-frame]').length === 2")
        seen.mouse.move(*at(seen, 50, 40))
        values = [float(v.inner_text().split(": ")[1].split()[0]) for v in seen.locator(".tv-read").all()]
        np.testing.assert_allclose(values, [25.0, 27.0], atol=0.15)
        seen.get_by_role("button", name="zoom in").click()
        seen.locator(".tv-zoom").get_by_text("200 %").wait_for()
        seen.mouse.move(*at(seen, 0, 0))
        assert float(seen.locator(".tv-read").first.inner_text().split()[1].strip(",")) == pytest.approx(29.75, abs=0.5)
        seen.locator("#image").focus()
        seen.keyboard.press("0")
        seen.keyboard.press("ArrowRight")
        seen.wait_for_function("[...document.querySelectorAll('.tv')].every(v => v.dataset.frame === '1')")
        seen.keyboard.press("Space")
        seen.wait_for_function("Number(document.querySelector('.tv').dataset.drawn) > 6")
        seen.keyboard.press("Space")
        seen.get_by_role("button", name=f"frame {FRAMES - 1}, ").click()
        seen.wait_for_function(f"[...document.querySelectorAll('.tv')].every(v => v.dataset.frame === '{FRAMES - 1}')")


def test_the_empty_page_says_what_belongs_there_and_the_example_opens(browser, tmp_path):
    with served(tmp_path) as (address, _), page(browser, address) as seen:
        seen.goto(address.split("/?")[0] + "/camera")
        seen.get_by_text("Drop camera files here or choose them").wait_for()
        assert seen.get_by_text("0.0B").count() == 0
        seen.get_by_role("button", name="Try an example").click()
        seen.locator(".tv[data-frame]").wait_for()
        seen.get_by_text("Enter the frame rate.").wait_for()
        seen.get_by_label("frame rate (fps), 1/s", exact=True).fill("2")
        seen.get_by_role("button", name="Find starts").click()
        seen.get_by_text("Enter the frame rate.").wait_for(state="detached")
        seen.get_by_text("Mark the leading and the trailing edge").wait_for()


def test_the_example_has_no_defects(tmp_path):
    opened = open_frames(sorted((tmp_path / write_example(tmp_path)).iterdir()))
    assert opened.with_screening().screened.summary == "no bad pixels, shutter events or frozen frames"


@pytest.mark.long  # test_lab.py sorts the files of a folder
def test_camera_files_beside_no_others_are_called_this_folder(browser, tmp_path):
    np.savetxt(tmp_path / "a1.csv", IMAGE, delimiter="\t")
    np.savetxt(tmp_path / "a2.csv", IMAGE, delimiter="\t")
    with served(tmp_path) as (address, _), page(browser, address, path="/") as seen:
        seen.get_by_text("this folder", exact=True).wait_for()
        seen.get_by_role("link", name="view 2 files").click()
        seen.locator(".tv[data-frame]").wait_for()
        assert seen.get_by_label("camera files", exact=True).input_value() == "this folder"


@pytest.mark.long  # the home page leads to them in test_lab.py
def test_cards_of_files_lead_to_them(browser, server):
    with page(browser, server) as seen:
        seen.goto(f"{server.split('/?')[0]}/camera")
        seen.wait_for_function("document.querySelectorAll('img.ft-thumbnail').length === 2")
        seen.get_by_role("link", name="warm").click()
        seen.locator(".tv[data-frame]").wait_for()
