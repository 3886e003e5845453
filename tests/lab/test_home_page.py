"""The home page leads from an empty folder to a verdict: one next step, examples that run, results with a picture."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import pytest
from lab.browsing import COARSE, page, served

from flashtemp.lab import examples
from flashtemp.lab.home_page import find_steps
from flashtemp.lab.result_card import describe_result, find_main_picture, list_recent_results
from flashtemp.lab.workspace import FolderListing, list_folder

CASES = Path(__file__).parents[2] / "cases"
IMAGES, RECORDINGS, CAMPAIGNS = [Path("cam/a1.csv"), Path("cam/a2.csv")], [Path("side.nc")], [Path("campaign.toml")]


@pytest.mark.parametrize(
    ("listing", "states"),
    [
        (FolderListing(), ["next", "later", "later", "later"]),
        (FolderListing(images=IMAGES), ["done", "next", "later", "later"]),
        (FolderListing(recordings=RECORDINGS), ["done", "done", "next", "later"]),
        (FolderListing(images=IMAGES, recordings=RECORDINGS, campaigns=CAMPAIGNS), ["done", "done", "done", "next"]),
        (
            FolderListing(recordings=RECORDINGS, campaigns=CAMPAIGNS, results={Path("results/v"): "discover"}),
            ["done"] * 4,
        ),
    ],
)
def test_one_step_is_the_next(listing, states):
    steps = find_steps(listing)
    assert [step.state for step in steps] == states
    for step in steps:
        assert bool(step.there) == (step.state == "done")
        assert bool(step.missing) == (step.state != "done")


def test_a_campaign_in_its_folder_is_the_next_verdict():
    [*_, verdict] = find_steps(FolderListing(recordings=RECORDINGS, campaigns=[Path("lab/campaign.toml")]))
    assert verdict.target == "/runs?command=discover&of=lab"


def test_examples_are_the_ready_cases_and_their_commands_are_free(tmp_path):
    for example in examples.list_examples():
        ready = CASES / Path(example.file).stem / "case.toml"
        assert examples.read_asset(f"examples/{example.file}") == ready.read_text(encoding="utf-8")
        out = Path(example.command_words(tmp_path)[-1])
        (tmp_path / out).mkdir(parents=True)
        assert example.command_words(tmp_path)[-1] == f"{out}-2"


def test_a_result_has_its_picture_its_answer_and_its_place_in_time(tmp_path):
    for name, age in {"old": 100.0, "new": 200.0}.items():
        result = tmp_path / "results" / name
        result.mkdir(parents=True)
        (result / "verdict.json").write_text(json.dumps({"says": [f"The answer of {name}.", "More."]}))
        (result / "a.png").write_bytes(b"")

        os.utime(result / "verdict.json", (age, age))
    listing = list_folder(tmp_path)
    recent = list_recent_results(tmp_path, listing.results)
    assert [path.name for path, _ in recent] == ["new", "old"]
    assert describe_result(tmp_path, recent[0][0]) == "The answer of new."
    assert find_main_picture(tmp_path, recent[0][0], "discover") == Path("results/new/a.png")
    (tmp_path / "results" / "new" / "verdict.json").write_text("[1, 2")
    assert describe_result(tmp_path, recent[0][0]) == ""


def test_load_cell_traces_are_not_camera_files(tmp_path):
    (tmp_path / "lab").mkdir()
    for name in ("mu.csv", "frame1.csv"):
        (tmp_path / "lab" / name).write_text("1,2\n")
    (tmp_path / "lab" / "campaign.toml").write_text('case = "case.toml"\n[[force]]\nfile = "mu.csv"\n')
    assert list_folder(tmp_path).images == [Path("lab/frame1.csv")]


@pytest.mark.long  # test_start_buttons.py runs a case, and the empty page of runs gives an example
def test_an_empty_folder_says_what_belongs_there_and_an_example_runs(browser, tmp_path):
    with served(tmp_path) as (address, _), page(browser, address, path="/") as seen:
        seen.get_by_role("button", name="Add camera files").wait_for()
        assert seen.get_by_text("next step").count() == 1
        seen.get_by_text("No results yet").wait_for()
        (tmp_path / "examples").mkdir()
        (tmp_path / "examples" / "run_in.toml").write_text(COARSE)  # the user's own file of that name stays
        seen.get_by_role("button", name="Try: a run-in").click()
        seen.wait_for_url(re.compile("/runs"))
        seen.get_by_role("link", name="Open the result").first.wait_for(timeout=120_000)
        assert (tmp_path / "examples" / "run_in.toml").read_text() == COARSE
        seen.goto(address.split("/?")[0])
        seen.get_by_role("link", name="open results/run_in-run").wait_for()
        seen.get_by_text("highest").wait_for()
