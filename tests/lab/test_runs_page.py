"""The page of runs: what commands tell while they work, their history in the folder, and the form of the command line."""

from __future__ import annotations

import json
import os
import re
import time
from types import SimpleNamespace

import numpy as np
import pytest
from lab.browsing import COARSE, page, served
from lab.test_accessibility import RULES

from flashtemp.__main__ import main
from flashtemp.cli.web_app import describe_commands
from flashtemp.discovery import engine
from flashtemp.display import ProgressMessage
from flashtemp.errors import BadInput
from flashtemp.lab.command_form import estimate_time
from flashtemp.lab.command_options import fill_form, find_risky_words, option_words, sort_commands
from flashtemp.lab.heat_image import draw_field, read_field
from flashtemp.lab.job_cards import resume_words
from flashtemp.lab.job_record import LOG_FOLDER, find_past_job, list_past_jobs, read_job
from flashtemp.lab.job_result import find_result, free_result_folder
from flashtemp.lab.job_start import check_job_words
from flashtemp.lab.jobs import JobList
from flashtemp.lab.live_discovery import collect_evidence, current_stage, describe_discovery, evidence_cells
from flashtemp.lab.live_run import describe_run
from flashtemp.lab.live_state import LiveState, read_live_state
from flashtemp.lab.live_table import cells_of_rows

COMMANDS = sort_commands(describe_commands())


# --- what commands tell ----------------------------------------------------------------------------------------
def test_a_run_that_is_watched_is_the_same_run_and_tells_where_it_is(tmp_path, monkeypatch, capsys):
    import xarray

    (tmp_path / "case.toml").write_text(COARSE.replace("mesh = 0.3", "mesh = 1.5"))  # the lowest cells are thin
    monkeypatch.delenv("FLASHTEMP_LIVE", raising=False)
    assert main(["run", str(tmp_path / "case.toml"), "--out", str(tmp_path / "plain")]) == 0
    monkeypatch.setenv("FLASHTEMP_LIVE", str(tmp_path / "live.json"))
    assert main(["run", str(tmp_path / "case.toml"), "--out", str(tmp_path / "watched")]) == 0
    with (
        xarray.open_dataset(tmp_path / "plain" / "run.nc") as a,
        xarray.open_dataset(tmp_path / "watched" / "run.nc") as b,
    ):
        for name in ("time", "T_block", "T_spot"):
            np.testing.assert_array_equal(a[name], b[name])
        last = a["T_block"].values[-1]
    live = read_live_state(tmp_path / "live.json")
    assert live.number("end", "exit_code") == 0
    assert live.number("progress", "done") == live.number("progress", "total") == live.number("run", "end")
    np.testing.assert_allclose(live.numbers("run", "T_block"), last, atol=1e-3)
    assert live.numbers("run", "history", "leading")[-1] == pytest.approx(last[0], abs=1e-3)
    field = read_field(live.find_value("run", "field", "T"))
    assert field.min() >= 20.0 - 0.01, "nothing is colder than the air"
    assert field.max() <= last.max(), "the face is the hottest"
    face = np.interp(25.0 * (np.arange(120) + 0.5) / 120, live.numbers("run", "x"), last)
    np.testing.assert_allclose(field[-1], face, atol=2.0, err_msg="the lowest row is just above the face")
    assert field[0].mean() < field[-1].mean() - 5.0
    assert not list(tmp_path.glob(".*live")), "no file of a write that is not complete"


def test_a_command_that_fails_tells_its_exit_code(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("FLASHTEMP_LIVE", str(tmp_path / "live.json"))
    assert main(["run", str(tmp_path / "nothing.toml")]) == 2
    assert read_live_state(tmp_path / "live.json").number("end", "exit_code") == 2
    monkeypatch.setenv("FLASHTEMP_LIVE", str(tmp_path / "no folder" / "live.json"))
    assert main(["run", str(tmp_path / "nothing.toml")]) == 2, "a state that cannot be written is no fault"


def test_a_sweep_tells_each_run_that_is_done(tmp_path, monkeypatch, capsys):
    (tmp_path / "case.toml").write_text(COARSE)
    monkeypatch.setenv("FLASHTEMP_LIVE", str(tmp_path / "live.json"))
    words = ["sweep", str(tmp_path / "case.toml"), "friction.mu=0.5,1.0", "--workers", "1"]
    assert main([*words, "--out", str(tmp_path / "out")]) == 0
    rows = read_live_state(tmp_path / "live.json").rows("stage", "rows")
    assert [row["friction.mu"] for row in rows] == [0.5, 1.0]
    assert rows[0]["highest temperature (°C)"] < rows[1]["highest temperature (°C)"]
    assert "1 of 2 runs" not in capsys.readouterr().err
    assert [cells[0] for cells in cells_of_rows(rows)[1]] == ["0.5", "1"]


def test_messages_of_a_discovery_keep_their_details_and_gain_the_time_left():
    told = []
    say = engine._with_time_left(told.append)
    say("simulating the stated model")
    say(ProgressMessage("fitting wear", fitting=[["wear"]]))
    assert told[0].details["left_s"] is None
    assert told[1].details["fitting"] == [["wear"]]
    assert told[1].details["stage"] == "fitting wear"
    assert told[1].details["fraction_done"] == engine.STAGE_START_FRACTIONS["fitting"]
    assert re.fullmatch(r"fitting wear \(0 s, about 0 s left\)", told[1])


# --- live pictures ---------------------------------------------------------------------------------------------
STAGE = {
    "message": "  evaluation 3 (461 s, about 377 s left)",
    "stage": {
        "candidates": [{"effect": "pressure_tilt", "score": 32.2}, {"effect": "time_lag", "score": 9.6}, {"effect": "blur"}],
        "ln_evidence_base": -1000.0, "fitting": [["pressure_tilt"], ["pressure_tilt", "time_lag"]],
        "running": [{"effects": ["pressure_tilt"], "ln_evidence": -960.0, "state": "converged"},
                    {"effects": ["pressure_tilt", "time_lag"], "ln_evidence": -955.0, "state": "fitting"}],
        "failed": [{"effects": ["blur"], "reason": "no"}],
    },
}  # fmt: skip


def test_evidence_so_far_is_the_gain_over_the_stated_model():
    found = collect_evidence(LiveState(STAGE))
    assert [(one.effects, one.fit) for one in found[:2]] == [
        ("pressure_tilt + time_lag", 45.0),
        ("pressure_tilt", 40.0),
    ]
    assert [one.state for one in found] == ["being fitted", "fitted", "scored", "could not be simulated"]
    assert current_stage(LiveState(STAGE)) == 4
    words = describe_discovery(LiveState(STAGE))
    assert words.startswith("3 candidates, 2 scored · 2 full fits done, 1 under way")


@pytest.mark.parametrize(
    "value",
    [None, 7, "<script>", [1, 2], {"candidates": 3}, {"fits": [{"effects": "x"}]}, {"fitting": 5, "running": {}}],
)
def test_a_state_that_a_stranger_wrote_is_no_danger(tmp_path, value):
    file = tmp_path / "a.json"
    file.write_text(json.dumps({"stage": value, "run": value, "end": value, "progress": value, "message": value}))
    live = read_live_state(file)
    assert isinstance(describe_discovery(live) + describe_run(live), str)
    assert all(isinstance(cell, str) for row in evidence_cells(collect_evidence(live)) for cell in row)
    assert live.number("run", "time") is None
    assert live.numbers("run", "x") == []


@pytest.mark.parametrize("rows", [None, [], [[]], [[1.0], [1.0, 2.0]], [["a"]], [[None]], "x", [1, 2]])
def test_a_field_that_is_no_table_is_not_drawn(rows):
    assert read_field(rows) is None


def test_a_field_is_drawn_with_its_hottest_place_brightest():
    from base64 import b64decode
    from io import BytesIO

    from PIL import Image

    field = np.full((4, 6), 20.0)
    field[3, 2] = 60.0
    picture = Image.open(BytesIO(b64decode(draw_field(field).split(",")[1])))
    assert picture.size == (6, 4)
    bright = np.asarray(picture, float).sum(axis=2)
    assert np.unravel_index(bright.argmax(), bright.shape) == (3, 2)


# --- history ---------------------------------------------------------------------------------------------------
def write_job(folder, name, line, **sections):
    logs = folder / LOG_FOLDER
    logs.mkdir(exist_ok=True)
    (logs / f"{name}.log").write_text(f"{line}\nfirst\nlast\n")
    if sections:
        (logs / f"{name}.json").write_text(json.dumps(sections))
    return logs / f"{name}.log"


def test_jobs_of_earlier_servers_are_known_with_state_and_duration(tmp_path):
    names = [f"20260101-10000{k}-1-run" for k in range(6)]
    write_job(tmp_path, names[0], "$ flashtemp run a.toml --out x", began=10.0, end={"exit_code": 0, "time": 52.0})
    write_job(tmp_path, names[1], "$ flashtemp run a.toml", began=10.0, end={"exit_code": 130, "time": 11.0})
    write_job(tmp_path, names[2], "$ flashtemp run a.toml", began=10.0, pid=os.getpid())
    write_job(tmp_path, names[3], "$ flashtemp run a.toml", queued=10.0)
    write_job(tmp_path, names[4], "$ flashtemp run a.toml", began=1.0, end={"exit_code": -9, "time": 2.0})
    write_job(tmp_path, names[5], "$ flashtemp run 'a b.toml'")
    past = {job.name: job for job in list_past_jobs(tmp_path, set(), 20)}
    assert [*past] == names[::-1]
    assert [past[n].state for n in names] == ["done", "stopped", "killed", "not started", "killed", "unknown"]
    assert past[names[0]].seconds == 42.0
    assert past[names[0]].log_lines() == ["first", "last"]
    assert past[names[5]].words == ("run", "a b.toml")
    assert [job.name for job in list_past_jobs(tmp_path, {names[5]}, 2)] == names[4:2:-1]
    assert estimate_time(["run", "a.toml", "--out", "y"], [*past.values()]) == "Took 42 s last time."
    assert "other arguments" in estimate_time(["run", "a.toml", "friction.mu=1"], [*past.values()])
    past[names[2]].stop()  # this process does not write that log: it is not stopped


@pytest.mark.parametrize("name", ["../secret", "20260101-100000-1-run/../x", "", "20260101-100000-1-run\0", "x"])
def test_the_name_of_a_job_is_no_path(tmp_path, name):
    assert find_past_job(tmp_path, name) is None


def test_odd_files_among_the_logs_are_no_jobs(tmp_path):
    log = write_job(tmp_path, "20260101-100000-1-run", "$ rm -rf x")
    assert read_job(log) is None
    assert read_job(write_job(tmp_path, "20260101-100001-1-run", "$ flashtemp run 'a")) is None
    logs = tmp_path / LOG_FOLDER
    (tmp_path / "secret").write_text("$ flashtemp run secret\n")
    (logs / "20260101-100002-1-run.log").symlink_to(tmp_path / "secret")
    os.mkfifo(logs / "20260101-100003-1-run.log")
    (logs / "20260101-100004-1-run.log").write_bytes(b"$ flashtemp run \xff\n")
    assert list_past_jobs(tmp_path, set(), 20) == []
    write_job(tmp_path, "20260101-100005-1-run", "$ flashtemp run a.toml")
    os.mkfifo(logs / "20260101-100005-1-run.json")
    assert [job.state for job in list_past_jobs(tmp_path, set(), 20)] == ["unknown"]
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / LOG_FOLDER).symlink_to(logs)
    assert list_past_jobs(tmp_path / "other", set(), 20) == []


def test_a_folder_that_was_there_is_not_the_result_of_a_job_that_failed(tmp_path):
    (tmp_path / "x").mkdir()
    (tmp_path / "x" / "summary.json").write_text('{"T_max_degC": 63.21, "friction_per_repetition": [0.5, 0.6]}')
    (tmp_path / "x" / "run.nc").touch()
    log = write_job(
        tmp_path, "20260101-100000-1-run", "$ flashtemp run a.toml --out x", end={"exit_code": 0, "time": 1}
    )
    result = find_result(tmp_path, read_job(log))
    assert dict(result.numbers)["highest temperature"] == "63.2 °C"
    assert dict(result.numbers)["friction coefficient"] == "0.60 (0.50 in the first repetition)"
    assert result.sentence == ""  # without the rise of temperature
    assert result.links[0] == ("Open the result", "/result?open=x")
    write_job(tmp_path, "20260101-100000-1-run", "$ flashtemp run a.toml --out x", end={"exit_code": 2, "time": 1})
    assert find_result(tmp_path, read_job(log)) is None
    log = write_job(tmp_path, "20260101-100000-1-run", "$ flashtemp run a --out ../y", end={"exit_code": 0, "time": 1})
    assert find_result(tmp_path, read_job(log)) is None


def test_a_verdict_is_named_as_on_its_page(tmp_path):
    (tmp_path / "x").mkdir()
    verdict = {
        "verdict": "held_key",
        "says": ["The load differs."],
        "base": {"rmse_K": 0.2},
        "extended": {"rmse_K": 0.1},
    }
    (tmp_path / "x" / "verdict.json").write_text(json.dumps(verdict))
    log = write_job(
        tmp_path, "20260101-100000-1-discover", "$ flashtemp discover lab --out x", end={"exit_code": 0, "time": 1}
    )
    assert dict(find_result(tmp_path, read_job(log)).numbers) == {
        "verdict": "A stated input differs from what the data require",
        "rms difference, calibrated case → extended model": "0.2 → 0.1 K",  # the comparison has that of the stated case
    }


def test_a_comparison_that_misfits_asks_what_is_missing(tmp_path):
    (tmp_path / "x").mkdir()
    log = write_job(
        tmp_path, "20260101-100000-1-compare", "$ flashtemp compare lab --out x", end={"exit_code": 0, "time": 1}
    )
    for chi2, starts in (
        (1.0, ()),
        (9.0, (("Ask what is missing", ("discover", "lab", "--out", "results/lab-discover")),)),
    ):
        entry = {"file": "a.nc", "rmse_K": 0.3, "chi2_per_dof": chi2, "white": True}
        (tmp_path / "x" / "compare.json").write_text(json.dumps({"recordings": [entry]}))
        result = find_result(tmp_path, read_job(log))
        assert result.starts == starts
        assert result.sentence.startswith("The model ")


def wait_until(holds, seconds=120.0):
    for _ in range(int(20 * seconds)):
        if holds():
            return True
        time.sleep(0.05)
    return False


def test_jobs_beyond_the_cores_wait_for_their_turn_and_an_earlier_servers_job_can_be_stopped(tmp_path):
    (tmp_path / "case.toml").write_text(COARSE.replace("repetitions = 2", "repetitions = 4000"))
    jobs = JobList(tmp_path, most_at_once=1)
    first, second, third = (jobs.start(["run", "case.toml", "--out", name]) for name in "abc")
    assert (first.state, second.state, third.state) == ("running", "waiting", "waiting")
    assert free_result_folder(tmp_path, "b", jobs.all) == "b-2"
    second.stop()
    assert wait_until(lambda: find_past_job(tmp_path, first.name).live.number("run", "time"))
    earlier = find_past_job(tmp_path, first.name)  # as a server that is started later sees it
    assert earlier.state == "running"
    earlier.stop()
    assert wait_until(lambda: first.state == "stopped")
    assert resume_words(tmp_path, earlier)[:2] == ["run", "--resume"]
    assert wait_until(lambda: third.state == "running")
    assert (second.state, second.process) == ("stopped", None)
    jobs.stop_all()
    assert wait_until(lambda: find_past_job(tmp_path, third.name).state == "stopped")
    assert find_past_job(tmp_path, second.name).state == "stopped"


# --- the form --------------------------------------------------------------------------------------------------
def test_the_form_offers_what_the_command_line_declares():
    assert [*COMMANDS][:6] == ["run", "compare", "discover", "plan", "sweep", "sensitivity"]
    assert "twin" in COMMANDS
    twin = {option.name: option for option in COMMANDS["twin"].fields}
    assert (twin["seed"].required, twin["conditions"].default, twin["hide"].kind) == (True, "4", "text")
    assert "Effects to hide" in twin["hide"].help
    limit = next(option for option in COMMANDS["discover"].fields if option.name == "limit")
    assert (limit.label, limit.hint) == ("Memory limit for reading one recording (GB)", "1 when not given")
    for option in (option for command in COMMANDS.values() for option in command.fields):
        assert len(option.label) < 60, option.label
        assert option.label.replace(" ", "_") != option.name, "no help text"
    assert {option.name for option in COMMANDS["run"].fields} == {"overwrite", "pvd"}
    assert all(c.sentence and c.file_kind in ("case", "campaign") for c in COMMANDS.values())


@pytest.mark.parametrize(
    "words",
    [
        ["run", "a.toml", "friction.mu=0.8", "--pvd", "--out", "b"],
        ["twin", "a", "numerics.mesh=0.5", "--hide", "wear", "--seed", "1", "--out", "c"],
        ["sweep", "a b.toml", "contact.pressure=1e5,2e5", "--workers", "2", "--out", "d"],
        ["discover", "c", "--limit", "2.5", "--out", "e"],
    ],
)
def test_a_command_is_repeated_as_it_was(words):
    form = fill_form(words, COMMANDS)
    again = [form.command, form.file, *form.words.split(), *option_words(COMMANDS[form.command].fields, form.values)]
    assert [*again, "--out", form.out] == words
    assert form.more == ""
    assert find_risky_words(words, COMMANDS) == []


@pytest.mark.parametrize(
    "words",
    [
        ["run", "a.toml", "--log", "x"], ["run", "a.toml", "--trust"], ["run", "/etc/a.toml"], ["run", "../a.toml"],
        ["run", "a.toml", "--out", "../b"], ["run", "a.toml", "--out=/b"], ["discover", "c", "--scheduler", "tcp://evil:1"],
        ["discover", "c", "--scheduler=evil"], ["lab", "."], ["run", "--trust", "a.toml"], ["run", "a.toml", "effects=../b.py"],
        ["run", "a.toml", "contact.pressure=~/p.csv"], [],
    ],
)  # fmt: skip
def test_a_command_of_a_strangers_log_that_could_do_harm_does_not_run_by_one_click(words):
    assert find_risky_words(words, COMMANDS)


@pytest.mark.parametrize(
    "words", [["run", "a", "--log", "b"], ["run", "a", "--log=b"], ["run", "../a"], ["run", "a", "--out=../b"],
              ["run", "a", "--out", "/b"], ["run", "--resume", "../a"], ["run", "a", "--out", ".hidden"]],
)  # fmt: skip
def test_no_command_reads_or_writes_outside_the_folder(tmp_path, words):
    with pytest.raises(BadInput):
        check_job_words(tmp_path, words)


@pytest.mark.parametrize("command", ["compare", "discover", "plan", "watch"])
@pytest.mark.parametrize(
    "text", ['case = "../secret.toml"', '[[recording]]\nfile = "../a.nc"', '[[force]]\nfile = "/f.csv"']
)
def test_no_command_starts_on_a_campaign_that_names_files_outside_the_folder(tmp_path, command, text):
    (tmp_path / "campaign.toml").write_text(text + "\n")
    with pytest.raises(BadInput, match="outside the folder"):
        check_job_words(tmp_path, [command, *["."] * (command == "watch"), "campaign.toml"])


# --- in the browser --------------------------------------------------------------------------------------------
def find_barriers(seen):
    """What axe-core finds in the cards of a page."""
    from axe_playwright_python.sync_playwright import Axe

    found = Axe().run(seen, context=".ft-card", options=RULES).response["violations"]
    return [f"{v['id']}: {n['html'][:160]} {n['failureSummary'][:200]}" for v in found for n in v["nodes"]]


def test_a_run_is_set_up_watched_and_found_in_the_history(browser, tmp_path):
    (tmp_path / "case.toml").write_text(COARSE)
    with served(tmp_path) as (address, _), page(browser, address) as seen:
        base = address.split("/?")[0]
        seen.goto(base + "/runs?command=run&of=case.toml")
        seen.get_by_label("Keys of the case to change").fill("friction.mu=0.8")
        seen.get_by_label("Keys of the case to change").press("Tab")
        seen.get_by_role("checkbox", name="Also write a .pvd series").click()
        seen.get_by_text("flashtemp run case.toml friction.mu=0.8 --pvd --out results/case-run").wait_for()
        seen.get_by_role("button", name="Start").click()
        seen.get_by_text("highest temperature").first.wait_for(timeout=120_000)
        seen.get_by_role("link", name="Details").click()
        seen.get_by_role("heading", name="run case.toml").wait_for()
        seen.get_by_alt_text("temperature in the section of the block").wait_for()
        assert seen.get_by_alt_text("temperature in the section").get_attribute("src").startswith("data:image/png")
        seen.get_by_text("repetition 2 of 2").wait_for()
        assert find_barriers(seen) == []
    assert json.loads((tmp_path / "results" / "case-run" / "summary.json").read_text())["T_max_degC"] > 20.0
    with served(tmp_path) as (address, _), page(browser, address, 800) as seen:  # another server of the same folder
        seen.goto(address.split("/?")[0] + "/runs")
        seen.get_by_role("link", name="flashtemp run case.toml friction.mu=0.8").wait_for()
        assert find_barriers(seen) == []
        assert seen.evaluate("document.documentElement.scrollWidth") <= 800
        seen.get_by_role("button", name="Change and run").click()
        seen.get_by_text("friction.mu=0.8 --pvd --out results/case-run-2").wait_for()
        assert seen.get_by_role("checkbox", name="Also write a .pvd series").is_checked()
        seen.goto(address.split("/?")[0] + "/runs")
        seen.get_by_role("button", name="Run again").click()
        seen.get_by_text("friction.mu=0.8 --pvd --out results/case-run-2").first.wait_for()
    assert len(list((tmp_path / LOG_FOLDER).glob("*.log"))) == 2


def test_an_empty_folder_says_what_to_run_and_gives_an_example(browser, tmp_path):
    with served(tmp_path) as (address, _), page(browser, address) as seen:
        seen.goto(address.split("/?")[0] + "/runs")
        seen.get_by_text("This folder has no case yet").wait_for()
        seen.get_by_role("radio", name="discover").click()
        seen.get_by_text("This folder has no campaign yet").wait_for()
        seen.get_by_role("radio", name="run").first.click()
        seen.get_by_role("button", name="Write an example").click()
        seen.get_by_text("flashtemp run examples/run_in.toml schedule.repetitions=3 numerics.mesh=0.6").wait_for()
        seen.get_by_text("No earlier command in this folder").wait_for()
    assert main(["check", str(tmp_path / "examples" / "run_in.toml")]) == 0


def test_the_title_of_the_page_is_the_progress(tmp_path, monkeypatch):
    from flashtemp.lab import jobs_page

    sent = []
    monkeypatch.setattr(jobs_page.ui, "run_javascript", sent.append)
    shown = jobs_page.JobsPage(tmp_path, JobList(tmp_path), None)
    job = SimpleNamespace(words=("run", "cases/run_in"), progress=lambda: (0.42, ""))
    shown._show_title(job)
    shown._show_title(job)
    shown._show_title(None)
    assert [json.loads(line.partition("= ")[2]) for line in sent] == ["42 % · run_in", "Runs · flashtemp"]
