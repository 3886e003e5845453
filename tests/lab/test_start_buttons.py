"""Buttons that start a command at once: one job per click, however fast the clicks follow, and a way to its options."""

from __future__ import annotations

import asyncio
import re

import pytest
from lab.browsing import COARSE, page, served

from flashtemp.lab.job_record import LOG_FOLDER
from flashtemp.lab.jobs import JobList
from flashtemp.lab.start_button import CommandStarter, start_once


def test_a_second_click_starts_nothing_and_a_refused_start_can_be_tried_again():
    answers, calls = [False, True, True], []

    async def click_often():
        async def start():
            calls.append(answers[len(calls)])
            await asyncio.sleep(0.01)
            return calls[-1]

        handle = start_once(start)
        await asyncio.gather(handle(), handle())
        await asyncio.sleep(0.01)
        await asyncio.gather(handle(), handle())
        await handle()

    asyncio.run(click_often())
    assert calls == [False, True]


@pytest.mark.parametrize(
    ("file", "words"),
    [
        ("lab/campaign.toml", ["compare", "lab", "--out", "results/lab-compare"]),
        ("campaign.toml", ["compare", "campaign.toml", "--out", "results/campaign-compare-2"]),
        ("--trust", ["compare", "./--trust", "--out", "results/--trust-compare"]),
    ],
)
def test_a_command_names_its_file_and_a_free_folder(tmp_path, file, words):
    (tmp_path / "results" / "campaign-compare").mkdir(parents=True)
    assert CommandStarter(tmp_path, JobList(tmp_path), None).command_words("compare", file) == words


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with a case and a campaign whose recording is damaged: its commands start, and end at once."""
    place = tmp_path_factory.mktemp("start")
    (place / "case.toml").write_text(COARSE)
    (place / "side.nc").write_bytes(b"")
    (place / "campaign.toml").write_text('case = "case.toml"\n[[recording]]\nfile = "side.nc"\n')
    return place


@pytest.fixture(scope="module")
def server(place):
    with served(place) as (address, _):
        yield address


def started(place):
    return sorted(log.read_text().splitlines()[0] for log in (place / LOG_FOLDER).glob("*.log"))


def test_two_clicks_on_run_it_start_one_run_and_show_it(browser, server, place):
    with page(browser, server) as seen:
        seen.goto(server.split("/?")[0] + "/case?open=case.toml")
        seen.get_by_text("ready to run").wait_for()
        seen.get_by_text("flashtemp run case.toml --out results/case-run").wait_for()
        seen.get_by_role("button", name="Run it").dblclick()
        seen.wait_for_url("**/runs?job=*-run")
        seen.get_by_role("link", name="Open the result").wait_for(timeout=120_000)
        seen.goto(server.split("/?")[0] + "/case?open=case.toml")
        seen.get_by_role("link", name="Options of run").click()
        seen.wait_for_url("**/runs?command=run&of=case.toml")
        seen.get_by_text("--out results/case-run-2").wait_for()
    assert started(place) == ["$ flashtemp run case.toml --out results/case-run"]


@pytest.mark.long  # test_lab_page.py saves from a page that was overtaken
def test_a_case_that_another_tab_has_changed_is_not_run_unseen(browser, server, place):
    before = started(place)
    (place / "other.toml").write_text(COARSE)
    with page(browser, server) as seen:
        seen.goto(server.split("/?")[0] + "/case?open=other.toml")
        seen.get_by_text("ready to run").wait_for()
        (place / "other.toml").write_text(COARSE.replace("mesh = 0.3", "mesh = 0.5"))
        seen.get_by_role("button", name="Run it").click()
        seen.get_by_text("changed on disk since it was opened").wait_for()
    assert started(place) == before
    assert "mesh = 0.5" in (place / "other.toml").read_text()


@pytest.mark.long  # test_case_page.py asks about unsaved changes
def test_no_question_about_unsaved_changes_comes_from_a_start_that_saves_them(browser, server, place):
    asked = []
    with page(browser, server) as seen:
        seen.on("dialog", lambda dialog: (asked.append(dialog.type), dialog.accept()))
        seen.goto(server.split("/?")[0] + "/case?open=case.toml")
        seen.get_by_text("ready to run").wait_for()
        title = seen.get_by_role("textbox", name=re.compile("^title"))
        title.fill("changed")
        title.press("Tab")
        seen.get_by_text("unsaved changes").wait_for()
        seen.get_by_role("button", name="Run it").click()
        seen.wait_for_url("**/runs?job=*-run")
    assert asked == []


@pytest.mark.long  # the buttons of a case and of the form are pressed with every change
def test_the_home_page_asks_what_is_missing_and_lists_starts(browser, server, place):
    with page(browser, server, 800, path="/") as seen:
        seen.get_by_text("flashtemp discover campaign.toml --out results/campaign-discover").wait_for()
        seen.get_by_role("button", name="Ask what is missing").dblclick()
        seen.wait_for_url(re.compile("/runs.job=.*-discover"))
        seen.get_by_text("failed").first.wait_for(timeout=60_000)
        seen.goto(server.split("/?")[0])
        seen.get_by_role("button", name="compare: campaign.toml").dblclick()
        seen.wait_for_url(re.compile("/runs.job=.*-compare"))
        seen.goto(server.split("/?")[0])
        seen.get_by_role("link", name="options: campaign.toml").click()
        seen.wait_for_url("**/runs?command=compare&of=campaign.toml")
    lines = started(place)
    assert lines.count("$ flashtemp discover campaign.toml --out results/campaign-discover") == 1
    assert lines.count("$ flashtemp compare campaign.toml --out results/campaign-compare") == 1


@pytest.mark.long  # its button is one of those above
def test_two_clicks_on_the_start_of_the_form_start_one_run(browser, server, place):
    before = len(started(place))
    with page(browser, server) as seen:
        seen.goto(server.split("/?")[0] + "/runs?command=run&of=case.toml")
        seen.get_by_role("button", name="Start").dblclick()
        seen.get_by_role("button", name="Stop").first.wait_for()
        seen.wait_for_timeout(500)
    assert len(started(place)) == before + 1
