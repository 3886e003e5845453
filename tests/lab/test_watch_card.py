"""A test is watched from the page of its campaign: template found, files imported, evidence shown, stopped."""

from __future__ import annotations

import asyncio
import json
import shutil
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import pytest
from lab.browsing import page, served
from lab.test_runs_page import COMMANDS, find_barriers, write_job
from nicegui.client import Client
from nicegui.page import page as page_of_client
from runs.arriving_frames import make_campaign, measure_frames

from flashtemp.errors import BadInput
from flashtemp.lab.camera_page import CameraPage
from flashtemp.lab.campaign_document import CampaignDocument
from flashtemp.lab.command_options import fill_form, find_risky_words
from flashtemp.lab.job_record import read_job
from flashtemp.lab.job_result import find_result
from flashtemp.lab.job_start import check_job_words
from flashtemp.lab.jobs import JobList
from flashtemp.lab.live_state import LiveState
from flashtemp.lab.live_watch import (
    describe_answer,
    describe_frame,
    describe_left_files,
    describe_watch,
    evidence_series,
    hypothesis_cells,
)
from flashtemp.lab.programs import AllowedPrograms
from flashtemp.lab.watch_card import WatchCard
from flashtemp.lab.workspace import list_image_folders

LONGEST_MS = 120_000  # until a file has been compared, on a busy machine
WATCH = {
    "state": "watching", "decided": False, "says": "not yet: tilt must exceed wear",
    "leader": {"hypothesis": "tilt", "ln_bayes": 6.25},
    "hypotheses": [{"effect": "tilt", "ln_bayes": 6.25, "expected_now": 9.0, "expected_in_the_end": 30.0, "reason": ""},
                   {"effect": "idle", "ln_bayes": 0.0, "reason": "has no effect"}],
    "recordings": [{"file": "a.nc", "frames": 2, "files": ["a0.csv", "a1.csv"], "rmse_K": 0.2, "calibrated_rmse_K": 0.05,
                    "waiting": {"a2.csv": "is\u202ebeing written"}, "refused": {}}],
    "history": [{"frames": 1, "ln_bayes": {"tilt": 1.0}}, {"frames": 2, "ln_bayes": {"tilt": 6.25}}],
    "latest": {"recording": "a.nc", "time_s": 1.5, "repetition": 2},
}  # fmt: skip


@pytest.mark.long  # tests/runs/test_watch.py has the watch, the tests below the card
def test_a_watch_is_started_followed_and_stopped_on_the_page_of_its_campaign(browser, tmp_path):
    (tmp_path / "measured").mkdir()
    measured, place = measure_frames(tmp_path / "measured"), tmp_path / "laboratory"
    rig = make_campaign(measured, place / "rig")
    with served(place) as (address, _), page(browser, address) as seen:
        seen.goto(address.split("/?")[0] + "/campaign?open=rig/campaign.toml")
        seen.get_by_text("side.toml makes condition1_sidewall.nc of files img*.csv").wait_for()
        seen.get_by_text("flashtemp watch rig/incoming rig --out results/rig-watch").wait_for()
        seen.get_by_role("button", name="Start watching").click()
        seen.get_by_text("No frame has been compared yet").wait_for(timeout=LONGEST_MS)
        for k, words in enumerate(("1 camera file imported, 1 frame", "2 camera files imported, 2 frames")):
            shutil.copyfile(measured / "frames" / f"img{k}.csv", rig / "incoming" / f"img{k}.csv")
            seen.get_by_text(words).wait_for(timeout=LONGEST_MS)
        seen.get_by_text("Not yet: the ln Bayes factor of pressure_tilt must reach 8").wait_for()
        image = seen.get_by_alt_text("measured minus computed temperature")
        assert image.get_attribute("src").startswith("data:image/png")
        seen.get_by_role("cell", name="pressure_tilt").wait_for()
        seen.get_by_text("no file 'condition1_sidewall.nc'").wait_for(state="detached")  # it is checked again
        assert find_barriers(seen) == []
        seen.set_viewport_size({"width": 800, "height": 900})
        assert seen.evaluate("document.documentElement.scrollWidth") <= 800
        seen.reload()  # a page that is opened later shows the same watch
        seen.get_by_text("2 camera files imported, 2 frames").wait_for()
        seen.get_by_role("button", name="Stop watching").click()
        seen.get_by_text("the watch has ended").wait_for(timeout=LONGEST_MS)
        seen.get_by_role("button", name="Start watching").wait_for()
        seen.goto(address.split("/?")[0] + "/runs")
        seen.get_by_text("Not yet: the ln Bayes factor of pressure_tilt").wait_for()
        seen.get_by_role("button", name="Change and run").click()
        seen.get_by_label("folder of camera files (required)").wait_for()
        seen.get_by_text("flashtemp watch rig/incoming rig --out results/rig-watch-2").wait_for()
    assert json.loads((place / "results" / "rig-watch" / "watch.json").read_text())["state"] == "interrupted"


def test_a_watch_is_described_in_words():
    watch = LiveState({"watch": WATCH})
    assert describe_answer(watch) == "Not yet: tilt must exceed wear."
    assert describe_watch(watch) == (
        "2 camera files imported, 2 frames in 1 recording · leading: tilt, ln Bayes factor 6.2"
    )
    assert describe_left_files(watch) == r"a2.csv is waiting: is\u202ebeing written"
    assert describe_frame(watch).startswith(
        "Latest frame of a.nc · repetition 2, t = 1.5 s · all frames differ by 0.2 K"
    )
    assert [s["data"] for s in evidence_series(watch)] == [[[1.0, 1.0], [2.0, 6.25]]]
    assert hypothesis_cells(watch) == [["tilt", "6.2", "9.0", "30.0"], ["idle", "has no effect", "", ""]]


@pytest.mark.parametrize("key", [*WATCH, "all"])
@pytest.mark.parametrize("value", [None, 7, "<script>", [1, [2]], {"a": {"b": 1}}, [{"a": 1}]])
def test_a_state_of_a_watch_that_a_stranger_wrote_is_no_danger(key, value):
    watch = LiveState({"watch": value if key == "all" else WATCH | {key: value}})
    words = (describe_answer(watch), describe_watch(watch), describe_left_files(watch), describe_frame(watch))
    assert all(isinstance(text, str) for text in words)
    assert all(isinstance(cell, str) for row in hypothesis_cells(watch) for cell in row)
    assert isinstance(evidence_series(watch), list)


def test_a_template_that_leads_out_of_the_folder_is_not_read(tmp_path):
    place = tmp_path / "place"
    (place / "in").mkdir(parents=True)
    text = '[[recording]]\nfile = "a.nc"\n'
    (tmp_path / "secret.toml").write_text('files = ["in/*.csv"]\nout = "a.nc"\n')
    card = WatchCard(CampaignDocument(place, "campaign.toml", text), JobList(place), AllowedPrograms(), None)
    with pytest.raises(BadInput, match="no recording template"):
        card.find_templates("in")
    shutil.copy(tmp_path / "secret.toml", place / "side.toml")
    (place / "._side.toml").symlink_to(tmp_path / "secret.toml")  # hidden
    assert list(card.find_templates("in")) == ["a.nc"]
    (place / "other.toml").symlink_to(tmp_path / "secret.toml")
    with pytest.raises(BadInput, match="not a file of this folder"):
        card.find_templates("in")
    with pytest.raises(BadInput, match="outside the folder"):
        card.find_templates("../in")
    (place / "other.toml").unlink()
    for key in ("times", "mask", "places", "case"):
        (place / "side.toml").write_text(f'files = ["in/*.csv"]\nout = "a.nc"\n{key} = "../secret.toml"\n')
        with pytest.raises(BadInput, match="outside the folder"):
            card.find_templates("in")
        with pytest.raises(BadInput, match="outside the folder"):
            CameraPage(place)._load_template("side.toml")


@pytest.mark.parametrize(("folder", "out"), [("in", "w-watch"), ("other", "w-watch-2")])
def test_a_watch_replaces_no_result_of_the_watch_of_another_test(tmp_path, folder, out):
    (tmp_path / "results" / "w-watch").mkdir(parents=True)
    (tmp_path / "results" / "w-watch" / "watch.json").write_text(json.dumps({"folder": folder}))
    card = WatchCard(CampaignDocument(tmp_path, "w/campaign.toml", ""), JobList(tmp_path), AllowedPrograms(), None)
    card.arrivals, card.until_decided = SimpleNamespace(value="in"), SimpleNamespace(value=False)
    assert card.command_words() == ["watch", "in", "w", "--out", f"results/{out}"]


def test_a_recording_that_is_added_on_the_page_can_be_watched_at_once(tmp_path):
    (tmp_path / "in").mkdir()
    (tmp_path / "side.toml").write_text('files = ["in/*.csv"]\nout = "a.nc"\n')
    document = CampaignDocument(tmp_path, "campaign.toml", "")
    with Client(page_of_client("/watch"), request=None):
        card = WatchCard(document, JobList(tmp_path), AllowedPrograms(), None)
        card.show()
        assert not card.start.enabled
        document.text = '[[recording]]\nfile = "a.nc"\n'
        card.update_choices()
        assert card.start.enabled
        assert card.command_words()[1:3] == ["in", "campaign.toml"]


def test_a_second_click_and_a_second_tab_start_no_second_watch(tmp_path, monkeypatch):
    monkeypatch.setattr(JobList, "_start_process", lambda self, job: SimpleNamespace(poll=lambda: None, wait=lambda: 0))
    monkeypatch.setattr(JobList, "_await_end", lambda self, process, job: None)
    (tmp_path / "in").mkdir()
    (tmp_path / "campaign.toml").write_text(text := '[[recording]]\nfile = "a.nc"\n')
    (tmp_path / "side.toml").write_text('files = ["in/*.csv"]\nout = "a.nc"\n')
    jobs, document = JobList(tmp_path), CampaignDocument(tmp_path, "campaign.toml", text)

    async def save():
        await asyncio.sleep(0.01)
        return True

    async def start(card):
        with client:
            return await card._start()

    async def start_often():
        with client:
            tabs = [WatchCard(document, jobs, AllowedPrograms(), save) for _ in range(2)]
            for tab in tabs:
                tab.show()
        return await asyncio.gather(start(tabs[0]), start(tabs[0]), start(tabs[1]))

    with Client(page_of_client("/watch"), request=None) as client:
        ThreadPoolExecutor(1).submit(lambda: asyncio.run(start_often())).result()  # the browser has its own loop here
    assert len(jobs.all) == 1


def test_the_form_of_runs_has_a_field_for_the_watched_folder():
    words = ["watch", "rig/incoming", "rig", "--until-decided", "--out", "w"]
    form = fill_form(words, COMMANDS)
    assert (form.arrivals, form.file, form.values, form.out, form.more) == (
        "rig/incoming", "rig", {"until_decided": True}, "w", "",
    )  # fmt: skip
    assert find_risky_words(words, COMMANDS) == []
    assert find_risky_words(["watch", "../elsewhere", "rig"], COMMANDS)
    assert find_risky_words(["watch", "--trust", "rig"], COMMANDS)


@pytest.mark.parametrize("words", [["watch", "../in", "rig"], ["watch", "in", "../rig"], ["watch", "in", "/rig"]])
def test_no_watch_reads_outside_the_folder(tmp_path, words):
    with pytest.raises(BadInput):
        check_job_words(tmp_path, words)


def test_camera_folders_are_offered_and_results_are_not(tmp_path):
    for name in ("incoming", "cam", "results/run", "notes"):
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / "cam" / "a.csv").touch()
    (tmp_path / "notes" / "a.md").touch()
    (tmp_path / "results" / "run" / "run.nc").touch()
    assert list_image_folders(tmp_path) == ["cam", "incoming", "results", "notes"]


def test_a_stopped_watch_has_its_answer_as_result(tmp_path):
    (tmp_path / "w").mkdir()
    (tmp_path / "w" / "watch.json").write_text(json.dumps({"says": "not yet: wait"}))
    log = write_job(
        tmp_path, "20260101-100000-1-watch", "$ flashtemp watch in rig --out w", end={"exit_code": 130, "time": 1}
    )
    result = find_result(tmp_path, read_job(log))
    assert result.sentence == "Not yet: wait"
    assert result.starts == (("Ask what is missing", ("discover", "rig", "--out", "results/rig-discover")),)


def test_a_watch_does_not_wait_for_its_turn(tmp_path):
    jobs = JobList(tmp_path)
    jobs.most_at_once = 0  # as if every core were busy
    watch, other = jobs.start(["watch", "nothing", "nothing"]), jobs.start(["run", "nothing"])
    assert (watch.process is not None, other.process is not None) == (True, False)
    jobs.stop_all()
