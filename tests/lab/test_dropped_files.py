"""Dropped camera files of several conditions: each condition is a series, and a table gives the times of frames."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest
from lab.browsing import page, served

from flashtemp.camera.importing.import_request import expand_patterns
from flashtemp.lab.camera_files import find_time_tables
from flashtemp.lab.workspace import list_folder

LOADS = ("75kPa_0.1ms", "150kPa_0.1ms")
TIMES = (0.5, 1.25, 4.0)  # s, at no constant rate


@pytest.fixture
def dropped(tmp_path):
    """Three frames of two loads with a table of their times each."""
    place = tmp_path / "from_camera"
    place.mkdir()
    rng = np.random.default_rng(0)
    for load in LOADS:
        rows = ["file,time,repetition"]
        for k, time in enumerate(TIMES):
            name = f"{load}_{k:02d}.csv"
            np.savetxt(place / name, 20.0 + k + rng.normal(size=(30, 40)), fmt="%.3f", delimiter=";")
            rows.append(f"{name},{time},{1 + k // 2}")
        (place / f"{load}_times.csv").write_text("\n".join(rows) + "\n")
    return place


def test_a_load_in_the_names_divides_series_and_tables_are_in_none(dropped):
    series = list_folder(dropped).image_series
    taken = {name: [p.name for p in expand_patterns([str(dropped / name)])] for name in series}
    for load in LOADS:
        assert taken[f"{load}_[0-9]*.csv"] == [f"{load}_{k:02d}.csv" for k in range(3)]
    assert {name: len(some) for name, some in taken.items()} == series


def test_times_in_names_divide_nothing(tmp_path):
    for name in ("at_100ms.csv", "at_200ms.csv", "at_300ms.csv", "other.txt"):
        (tmp_path / name).write_text("1\t2\n")
    assert list_folder(tmp_path).image_series == {"at_*ms.csv": 3, "other.txt": 1}


def test_tables_of_times_are_told_from_images_and_stay_in_the_folder(dropped):
    (dropped / "leads_out.csv").symlink_to(dropped.parent / "secret.csv")
    (dropped.parent / "secret.csv").write_text("file,time\na.csv,1\n")
    assert sorted(find_time_tables(dropped)) == sorted(f"{load}_times.csv" for load in LOADS)


def test_tables_of_times_are_no_camera_files(dropped):
    """Only what is certainly a table is left out: another text with the same first line stays in the list."""
    (dropped / "notes.csv").write_text("file,time\nnot_there.csv,1\n")
    listing = list_folder(dropped)
    assert [str(p) for p in listing.tables] == [f"{load}_times.csv" for load in sorted(LOADS)]
    assert {"notes.csv", *(f"{load}_[0-9]*.csv" for load in LOADS)} == set(listing.image_series)
    (alone := dropped / "alone").mkdir()
    for k in range(3):
        (alone / f"a{k}.csv").write_text("1;2\n3;4\n")
    (alone / "times.csv").write_text("file;time (s)\na0.csv;0,5\n")
    assert [n for n in list_folder(dropped).image_series if n.startswith("alone")] == ["alone/a*.csv"]


def test_files_of_two_loads_become_a_recording_with_the_times_of_the_table(browser, dropped, tmp_path):
    place = tmp_path / "place"
    place.mkdir()
    with served(place) as (address, _), page(browser, address, path="/") as seen:
        seen.get_by_text("Drop camera files here or choose them").wait_for()  # on the home page
        seen.locator("input[type=file]").set_input_files(sorted(dropped.iterdir()))
        seen.get_by_role("link", name="camera/150kPa_0.1ms_[0-9]*.csv").click()
        seen.get_by_text("Found:").wait_for()
        for mark, column in (("leading edge", 5.0), ("trailing edge", 30.0)):
            for word, value in (("column", column), ("row", 25.0)):
                box = seen.get_by_label(f"{mark}, {word}", exact=True)
                box.fill(str(value))
                box.press("Tab")
        for label in ("frame rate (fps), 1/s", "time of the first frame (start), s"):
            seen.get_by_text(f"{label} *", exact=True).wait_for()
        seen.get_by_label("table of times").click()
        seen.get_by_role("option", name="camera/150kPa_0.1ms_times.csv").click()
        seen.get_by_text("Nothing is missing.").wait_for()
        assert seen.locator(".q-field__label").filter(has_text="*").all_inner_texts() == ["view *"]
        assert seen.get_by_label("recording", exact=True).input_value() == "150kPa_0.1ms.nc"
        seen.get_by_role("button", name="Save recording and template").click()
        seen.get_by_role("button", name="To the campaigns").wait_for()
        seen.get_by_text("time 0.5 to 4 s, repetitions 1 to 2").wait_for()
    assert tomllib.loads((place / "150kPa_0.1ms.toml").read_text())["times"] == "camera/150kPa_0.1ms_times.csv"


def test_an_emissivity_of_exported_temperatures_asks_for_the_one_of_the_export(browser, tmp_path):
    (tmp_path / "frame.csv").write_text("\n".join(",".join(f"{20 + r + c:.1f}" for c in range(40)) for r in range(30)))
    with served(tmp_path) as (address, _), page(browser, address) as seen:
        seen.goto(address.split("/?")[0] + "/camera?open=frame.csv")
        field = seen.get_by_label("emissivity", exact=True)
        field.wait_for()
        field.fill("0.9")
        field.press("Tab")
        seen.get_by_text("Enter the emissivity in the export").wait_for()
        for label, value in {"emissivity in the export": "1", "reflected temperature in the export, °C": "20"}.items():
            seen.get_by_label(label, exact=True).fill(value)
            seen.get_by_label(label, exact=True).press("Tab")
        seen.get_by_text("Enter the emissivity in the export").wait_for(state="detached")
