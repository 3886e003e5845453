"""The command watch: camera files that arrive while it runs, the state that it keeps, and how it ends."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from runs.arriving_frames import make_campaign, measure_frames

import flashtemp
from flashtemp.__main__ import main
from flashtemp.camera import recording
from flashtemp.errors import BadInput, UserInterrupt

LONGEST_S = 240.0  # s until a command has done its work, on a busy machine
FAST = ("--interval", "0.2", "--workers", "1")


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """A synthetic side wall with a hidden tilt, and its frames as text images."""
    return measure_frames(tmp_path_factory.mktemp("measured"))


@pytest.fixture
def lab(measured, tmp_path):
    """The folder of a campaign before its measurement, with the folder in which camera files arrive."""
    return make_campaign(measured, tmp_path / "lab")


def put(measured, lab, *numbers):
    for k in numbers:
        shutil.copyfile(measured / "frames" / f"img{k}.csv", lab / "incoming" / f"img{k}.csv")


def start(lab, out, *words):
    command = [sys.executable, "-m", "flashtemp", "watch", str(lab / "incoming"), str(lab), "--out", str(out), *FAST]
    return subprocess.Popen([*command, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def wait_for(condition):
    end = time.monotonic() + LONGEST_S
    while not condition():
        assert time.monotonic() < end, "the command has not done it in time"
        time.sleep(0.1)


def state(out) -> dict:
    return json.loads((out / "watch.json").read_text())


def is_complete_picture(path) -> bool:
    data = path.read_bytes()
    return data.startswith(b"\x89PNG") and data.endswith(b"IEND\xaeB`\x82")


def test_files_that_arrive_one_by_one_are_compared_until_the_data_suffice(measured, lab, tmp_path):
    out = tmp_path / "out"
    with start(lab, out, "--until-decided") as process:
        for k in range(8):
            if process.poll() is not None:
                break
            put(measured, lab, k)
            wait_for(
                lambda k=k: (
                    process.poll() is not None or (out / "watch.json").is_file() and len(state(out)["history"]) > k
                )
            )
        output, messages = process.communicate(timeout=LONGEST_S)
    assert process.returncode == 0, messages
    found, lines = state(out), output.splitlines()
    assert messages.count("predicting condition") == 1 == found["simulations"]
    assert [line.split(": ")[0].split(" ", 1)[1] for line in lines if "->" in line] == [
        f"img{k}.csv -> condition1_sidewall.nc" for k in range(found["recordings"][0]["frames"])
    ]
    assert any("decided: the data suffice: pressure_tilt" in line for line in lines)
    assert (found["state"], found["decided"], found["leader"]["hypothesis"]) == ("ended", True, "pressure_tilt")
    assert [h["frames"] for h in found["history"]] == list(range(1, len(found["history"]) + 1))
    events = [e for e in found["events"] if e["kind"] == "imported"]
    assert all(e["rmse_K"] > e["calibrated_rmse_K"] > 0.0 for e in events)
    assert is_complete_picture(out / found["picture"])
    assert sorted(p.name for p in out.iterdir()) == ["watch.json", "watch.png"]
    assert is_complete_picture(lab / "condition1_sidewall.png")


def test_the_recording_is_that_of_an_import_of_all_files(measured, lab, tmp_path, monkeypatch):
    put(measured, lab, 0, 1, 2)
    assert main(["watch", str(lab / "incoming"), str(lab), "--out", str(tmp_path / "out"), "--once", *FAST]) == 0
    watched = recording.load(lab / "condition1_sidewall.nc")
    imported = flashtemp.import_recording(lab / "side.toml", overwrite=True).recording
    for name in ("temperature", "time", "repetition", "u", "v"):
        np.testing.assert_array_equal(getattr(watched, name), getattr(imported, name))


def test_once_refuses_a_damaged_file_in_one_line_and_compares_the_others(measured, lab, tmp_path, capsys):
    put(measured, lab, 0, 1)
    (lab / "incoming" / "img2.csv").write_text("no numbers\n")
    (lab / "incoming" / "img3.csv").write_bytes((measured / "frames" / "img0.csv").read_bytes())
    out = tmp_path / "out"
    assert main(["watch", str(lab / "incoming"), str(lab), "--out", str(out), "--once", "--json", *FAST]) == 2
    found = json.loads(capsys.readouterr().out)
    [side] = [r for r in found["recordings"] if r["file"] == "condition1_sidewall.nc"]
    assert (side["frames"], side["files"], side["repeated"]) == (2, ["img0.csv", "img1.csv"], ["img3.csv"])
    [(name, reason)] = side["refused"].items()
    assert name == "img2.csv"
    assert "no matrix of numbers" in reason
    assert "\n" not in reason
    assert found == state(out) | {"out": str(out)}


@pytest.mark.long  # test_job.py interrupts a command; below, a watch is interrupted between two events
def test_ctrl_c_ends_with_130_and_complete_files_and_a_restart_goes_on(measured, lab, tmp_path, capsys):
    out = tmp_path / "out"
    put(measured, lab, 0)
    with start(lab, out) as process:
        wait_for(lambda: (out / "watch.json").is_file() and state(out)["history"])
        process.send_signal(signal.SIGINT)
        _, messages = process.communicate(timeout=LONGEST_S)
    assert process.returncode == 130
    assert messages.splitlines()[-1].startswith("interrupted; recordings and state saved in ")
    assert state(out)["state"] == "interrupted"
    assert is_complete_picture(out / "watch.png")
    put(measured, lab, 1)
    assert main(["watch", str(lab / "incoming"), str(lab), "--out", str(out), "--once", *FAST]) == 0
    assert "img1.csv -> condition1_sidewall.nc: 1 frame;" in capsys.readouterr().out
    assert recording.load(lab / "condition1_sidewall.nc").frames == 2


def test_ctrl_c_between_two_events_keeps_the_state(lab, tmp_path):
    watched = flashtemp.watch(lab / "incoming", lab, out=tmp_path / "out", interval=0.1, workers=1)
    with pytest.raises(UserInterrupt, match="continue with: the same command"):
        raise watched.interrupt_watch()
    assert state(tmp_path / "out")["state"] == "interrupted"


@pytest.mark.long  # an import of all files above is its sibling
def test_frames_of_an_earlier_recording_are_not_lost(measured, lab, tmp_path):
    put(measured, lab, 0, 1)
    words = ["watch", str(lab / "incoming"), str(lab), "--once", *FAST]
    assert main([*words, "--out", str(tmp_path / "a")]) == 0
    (lab / "incoming" / "img0.csv").unlink()
    assert main([*words, "--out", str(tmp_path / "b")]) == 2
    assert recording.load(lab / "condition1_sidewall.nc").frames == 2
    [problem] = [e for e in state(tmp_path / "b")["events"] if e["kind"] == "problem"]
    assert "has frames that the camera files" in problem["words"]
    assert state(tmp_path / "b")["history"], "the earlier recording is still assessed"
    assert main([*words, "--out", str(tmp_path / "c"), "--overwrite"]) == 0
    assert recording.load(lab / "condition1_sidewall.nc").frames == 1


def test_frames_that_do_not_fit_the_schedule_are_a_problem_and_the_watch_goes_on(measured, lab, tmp_path):
    put(measured, lab, 0)
    (lab / "times.csv").write_text("file,time,repetition\nimg0.csv,99,1\n")
    out = tmp_path / "out"
    assert main(["watch", str(lab / "incoming"), str(lab), "--out", str(out), "--once", *FAST]) == 2
    [problem] = [e for e in state(out)["events"] if e["kind"] == "problem"]
    assert "the schedule of its condition ends" in problem["words"]
    assert state(out)["says"] == "no frame has been compared yet"


def test_nothing_there_is_no_error(lab, tmp_path):
    out = tmp_path / "out"
    assert main(["watch", str(lab / "incoming"), str(lab), "--out", str(out), "--once", *FAST]) == 0
    found = state(out)
    assert (found["events"], found["picture"], found["leader"]) == ([], None, None)
    assert [r["frames"] for r in found["recordings"]] == [0]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("{lab}/none", "{lab}"), "none: No such file or directory; give the folder in which camera files arrive"),
        (("{lab}/incoming", "{lab}/none"), "none"),
        (("{lab}/incoming", "{lab}", "--interval", "0"), "interval: 0; give 0.05 to 3600 s"),
        (("{lab}/incoming", "{lab}", "--patience", "-1"), "patience: -1; give s, at least 0"),
        (("{lab}/incoming", "{lab}", "--once", "--until-decided"), "give one of them"),
        (("{lab}/incoming", "{lab}", "--workers", "0"), "--workers: 0; give at least 1"),
        (("{lab}/incoming", "{lab}", "--out", "{lab}"), "exists and holds no watch.json; choose another folder"),
        (("{lab}/incoming", "{lab}", "--out", "{lab}/case.toml"), "case.toml"),
    ],
)
def test_bad_input_is_one_line(lab, words, says, capsys):
    assert main(["watch", *(word.format(lab=lab) for word in words)]) == 2
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1


def test_a_campaign_without_a_template_is_bad_input(lab):
    (lab / "side.toml").unlink()
    with pytest.raises(BadInput, match="no recording template whose out is a recording of the campaign"):
        flashtemp.watch(lab / "incoming", lab)


def test_two_templates_of_one_recording_are_bad_input(lab):
    shutil.copy(lab / "side.toml", lab / "same.toml")
    with pytest.raises(BadInput, match=r"side\.toml: out: condition1_sidewall\.nc is also made by .*same\.toml"):
        flashtemp.watch(lab / "incoming", lab)
