"""Nothing that was there is lost: folders beside, interrupted runs, full disks, damaged checkpoints, pictures that fail."""

from __future__ import annotations

import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest

import flashtemp
from flashtemp.__main__ import main
from flashtemp.api.simulation import resume, simulate
from flashtemp.errors import IncompleteResult, SystemFailure, UserInterrupt
from flashtemp.runs import job
from flashtemp.runs.results import checkpoint, result_folder
from flashtemp.runs.results.checkpoint import CHECKPOINT_FILE, FRAMES_FILE

CASE = """title = "small"
effects = ["track_memory", "friction_softening"]
[block]
height = 0.005
[road]
track_length = 0.06
[schedule]
distance = 0.1
repetitions = 2
wait = 1.0
[numerics]
mesh = 0.3
[output]
profiles = 8
fields = 4
pictures = false
"""
MINE = "years of work"


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    folder = tmp_path_factory.mktemp("case")
    (folder / "speed.csv").write_text("time_s,speed_m_s\n0,0.1\n2,0.1\n")
    (folder / "case.toml").write_text(CASE.replace("distance", 'speed = "speed.csv"\ndistance'))
    return folder


@pytest.fixture(scope="module")
def whole(case):
    """The Run that nothing disturbed."""
    return simulate(case)


@pytest.fixture(scope="module")
def campaign(case, tmp_path_factory):
    folder = tmp_path_factory.mktemp("lab") / "campaign"
    flashtemp.twin(
        case, {"schedule.speed": 0.1}, hide=[], seed=1, out=folder, conditions=1, views=["profile"], nuisance=0.0
    )
    return folder


@pytest.fixture
def beside(tmp_path):
    """Names that a user may well have given, with work inside; some are links to folders elsewhere."""
    place, elsewhere = tmp_path / "place", tmp_path / "elsewhere"
    for folder in (place / "a.old", place / "a.partial-2", place / "a.replaced", elsewhere):
        (folder / "deep").mkdir(parents=True)
        (folder / "deep" / "thesis.txt").write_text(MINE)
    (place / "a.partial").symlink_to(elsewhere)
    (place / "a.partial-3").write_text(MINE)
    (place / "a.failed").symlink_to(tmp_path / "nowhere")
    return place


def seen(folder: Path) -> dict[str, bytes]:
    """Everything below a folder but the result place/a: its content, or where it leads."""
    return {
        str(p.relative_to(folder)): os.readlink(p).encode()
        if p.is_symlink()
        else p.read_bytes()
        if p.is_file()
        else b""
        for p in folder.rglob("*")
        if p.relative_to(folder).parts[:2] != ("place", "a")
    }


def stopped(case, out, share=0.5, **how):
    """An interrupted run into `out`."""
    done = []

    def stop(progress, end):
        if progress.t >= share * end and not done:
            done.append(progress.t)
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(UserInterrupt) as said:
        simulate(case, out=out, watch=stop, **how)
    return said.value.path


def check_same(run, whole):
    """A run that was interrupted is the one that was not, within what a restart of CVODE changes."""
    np.testing.assert_array_equal(run.time, whole.time)
    rise = np.abs(whole.T_spot - 20.0).max()
    np.testing.assert_allclose(run.T_block, whole.T_block, atol=2e-3 * rise)
    np.testing.assert_allclose(run.field, whole.field, atol=2e-3 * rise)
    assert run.energy_imbalance < 1e-10


@pytest.fixture(scope="module")
def waiting(case, tmp_path_factory):
    """The working folder of an interrupted run."""
    return stopped(case, tmp_path_factory.mktemp("waiting") / "a", 0.6)


# --- 1: what lies beside a result ---------------------------------------------------------------------
def test_what_lies_beside_stays(case, beside):
    """Also where a name of it is the one that a working folder would take, and where the result is replaced."""
    before = seen(beside.parent)
    simulate(case, out=beside / "a")
    simulate(case, {"friction.mu": 0.5}, out=beside / "a", overwrite=True)
    assert seen(beside.parent) == before
    assert json.loads((beside / "a" / "summary.json").read_text())["friction_per_repetition"][0] < 0.6


@pytest.mark.parametrize("command", ["compare", "discover", "plan", "twin", "sweep", "friction", "run"])
def test_a_waiting_checkpoint_is_touched_by_no_command(case, campaign, waiting, tmp_path, capsys, command):
    work = Path(shutil.copytree(waiting, tmp_path / "a.partial"))
    before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    source = {"compare": campaign, "discover": campaign, "plan": campaign}.get(command, case)
    more = {"twin": ["schedule.speed=0.1", "--hide", "none", "--seed", "1"], "sweep": ["friction.mu=0.5,0.6"]}.get(
        command, []
    )
    assert main([command, str(source), *more, "--out", str(tmp_path / "a")]) == 2
    assert f"--out: {work} holds an interrupted run; continue with 'flashtemp run --resume " in capsys.readouterr().err
    assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == before


def test_a_failure_removes_only_what_it_made(case, beside, capsys):
    before = seen(beside.parent)
    worn = ["effects=wear", "wear.rate=1e-7", "schedule.speed=1.0", "contact.pressure=1e7"]
    assert main(["run", str(case), *worn, "--out", str(beside / "a")]) == 1
    assert seen(beside.parent) == before
    assert not (beside / "a").exists()


def test_a_name_that_is_taken_meanwhile_is_left_alone(case, tmp_path):
    """Somebody makes the folder while the run goes on: theirs stays, the result lies beside and says so."""

    def intrude(progress, end):
        (tmp_path / "a").mkdir(exist_ok=True)
        (tmp_path / "a" / "thesis.txt").write_text(MINE)

    with pytest.raises(
        IncompleteResult, match="was created by another program meanwhile; the complete result is in .*a-2"
    ):
        simulate(case, out=tmp_path / "a", watch=intrude)
    assert (tmp_path / "a" / "thesis.txt").read_text() == MINE
    assert (tmp_path / "a-2" / "run.nc").is_file()


def test_a_link_is_not_overwritten(case, tmp_path, capsys):
    simulate(case, out=tmp_path / "real")
    (tmp_path / "a").symlink_to(tmp_path / "real")
    (tmp_path / "b").symlink_to(tmp_path / "nowhere")
    for name in ("a", "b"):
        assert main(["run", str(case), "--out", str(tmp_path / name), "--overwrite"]) == 2
        assert "is a link" in capsys.readouterr().err
    assert main(["compare", str(case), "--out", str(tmp_path / "b")]) == 2
    assert (tmp_path / "real" / "run.nc").is_file()


# --- 2: pictures that fail ----------------------------------------------------------------------------
def test_a_picture_that_fails_costs_the_picture(case, tmp_path, monkeypatch, capsys):
    def broken(run):
        raise RuntimeError("no ink")

    pictures = {"profile": "profile", "budget": "budget", "friction": "friction"}
    monkeypatch.setattr("flashtemp.viz.list_pictures", lambda: pictures)
    with monkeypatch.context() as m:
        m.setattr(
            "flashtemp.runs.results.processes.cores", lambda: 1
        )  # a second process would know nothing of what follows
        m.setattr("flashtemp.viz.run.budget.draw", broken)
        assert (
            main(["run", str(case), "output.pictures=true", "output.animation=false", "--out", str(tmp_path / "a")])
            == 1
        )
    said = capsys.readouterr()
    assert said.err.strip().splitlines()[-1] == (
        f"missing in {tmp_path / 'a'}: budget.png (RuntimeError: no ink); draw again with: flashtemp draw {tmp_path / 'a'}"
    )
    assert "rise at the block's surface" in said.out
    names = {p.name for p in (tmp_path / "a").iterdir()}
    assert {
        "run.nc",
        "summary.json",
        "fields.vtkhdf",
        "profile.png",
        "friction.png",
        CHECKPOINT_FILE,
        FRAMES_FILE,
    } <= names
    assert "budget.png" not in names


def test_a_result_outlives_its_report(campaign, tmp_path, monkeypatch, capsys):
    def full(path, text):
        raise OSError(28, "No space left on device", "report.html")

    monkeypatch.setattr("flashtemp.viz.html.comparison_report.write_report", full)
    assert main(["compare", str(campaign), "--out", str(tmp_path / "a")]) == 1
    assert "missing in" in capsys.readouterr().err
    assert json.loads((tmp_path / "a" / "compare.json").read_text())["recordings"]


# --- 3: full disks ------------------------------------------------------------------------------------
@contextmanager
def files_up_to(size: int):
    """No file of this process may grow beyond a size in bytes: the error of a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("rows", [0, 3])
@pytest.mark.sample("3")
def test_a_full_disk_leaves_the_march(case, whole, tmp_path, monkeypatch, rows):
    """While fields are streamed: what was marched is kept, and the run goes on when there is room."""
    real = job.FieldStore.append

    def append(self, row):
        if len(self) == rows:
            raise OSError(28, "No space left on device", "frames.bin")
        real(self, row)

    monkeypatch.setattr(job.FieldStore, "append", append)
    with pytest.raises(SystemFailure, match=r"^No space left on device: frames.bin; checkpoint saved"):
        simulate(case, out=tmp_path / "a")
    monkeypatch.undo()
    check_same(resume(tmp_path / "a"), whole)


@pytest.mark.parametrize("size", [2_000, 60_000, 150_000])
@pytest.mark.sample("60000")
def test_files_that_cannot_grow_leave_something_to_go_on_from(case, whole, tmp_path, size):
    """The kernel's own refusal, at a checkpoint, at run.nc or at the fields."""
    with pytest.raises((SystemFailure, OSError)) as said, files_up_to(size):
        simulate(case, out=tmp_path / "a")
    if isinstance(said.value, SystemFailure):
        check_same(resume(tmp_path / "a"), whole)
    else:
        assert size < 10_000  # not even a checkpoint has room
        assert list(tmp_path.iterdir()) == []


def test_room_for_a_checkpoint_is_kept_and_given_up(case, tmp_path):
    work = stopped(case, tmp_path / "a")
    kept = work / checkpoint.RESERVE_FILE
    assert kept.stat().st_size > (work / CHECKPOINT_FILE).stat().st_size
    resume(tmp_path / "a")
    assert not (tmp_path / "a" / checkpoint.RESERVE_FILE).exists()


# --- 4: interrupts at the wrong moment ----------------------------------------------------------------
@pytest.mark.parametrize("share", [0.0, 1.0])
def test_an_interrupt_at_any_step_can_be_gone_on_from(case, whole, tmp_path, share):
    """At the very last one too, when no field is left to be kept."""
    stopped(case, tmp_path / "a", share)
    check_same(resume(tmp_path / "a"), whole)
    assert [p.name for p in tmp_path.iterdir()] == ["a"]


def test_a_run_is_gone_on_with_from_inside_its_folder(case, whole, tmp_path, monkeypatch):
    monkeypatch.chdir(stopped(case, tmp_path / "a", 0.5))
    check_same(resume("."), whole)
    assert [p.name for p in tmp_path.iterdir()] == ["a"]


def test_what_a_killed_process_was_writing_is_no_part_of_the_result(case, whole, tmp_path):
    """Half a picture under a name of its own, beside the checkpoint; somebody's own hidden file stays."""
    work = stopped(case, tmp_path / "a", 0.5)
    (work / f".{16 * 'a'}.png").write_bytes(b"half")
    (work / ".mine").write_text("years of work")
    check_same(resume(tmp_path / "a"), whole)
    assert [p.name for p in (tmp_path / "a").iterdir() if p.name.startswith(".")] == [".mine"]


# --- 5: damaged checkpoints ---------------------------------------------------------------------------
def damaged(file: Path, rng, kind: str) -> None:
    data = bytearray(file.read_bytes())
    if kind == "bytes":
        for at in rng.integers(0, len(data), 5):
            data[at] ^= int(rng.integers(1, 256))
    else:
        del data[int(rng.integers(0, len(data))) :]
    file.write_bytes(data)


@pytest.mark.parametrize("seed", range(60))
def test_damage_is_refused_in_one_line(waiting, tmp_path, capsys, seed):
    rng = np.random.default_rng(seed)
    name = [CHECKPOINT_FILE, FRAMES_FILE, "case.toml", next((waiting / "inputs").iterdir()).relative_to(waiting)][
        seed % 4
    ]
    work = Path(shutil.copytree(waiting, tmp_path / "a.partial"))
    kind = ["bytes", "cut", "gone"][seed // 4 % 3]
    if kind == "gone":
        (work / name).unlink()
    else:
        damaged(work / name, rng, kind)
    assert main(["run", "--resume", str(tmp_path / "a")]) == 2
    said = capsys.readouterr().err.strip()
    assert said.startswith("--resume: ")
    assert "\n" not in said
    assert not (tmp_path / "a").exists()


def test_a_checkpoint_counts_only_when_its_fields_are_on_disk(waiting, tmp_path, monkeypatch):
    """Fields first, then the checkpoint under another name, then its name, each waited for."""
    order = []
    real = os.fsync
    monkeypatch.setattr(os, "fsync", lambda n: (order.append(Path(os.readlink(f"/proc/self/fd/{n}")).name), real(n))[1])
    work = Path(shutil.copytree(waiting, tmp_path / "a.partial"))
    checkpoint.save_checkpoint(work, checkpoint.load_checkpoint(work))
    assert order == [FRAMES_FILE, f"{CHECKPOINT_FILE}.new", "a.partial"]


# --- 6: those who work together -----------------------------------------------------------------------
CREW = """
import os, sys, time
from pathlib import Path
from flashtemp.runs.results.worker_pool import open_worker_pool

def follow(folder):
    Path(folder, str(os.getpid())).touch()
    time.sleep(60)

if __name__ == "__main__":
    with open_worker_pool(follow, 2) as run:
        run(sys.argv[1:] * 2)
"""


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def until(true, seconds=20.0):
    end = time.monotonic() + seconds
    while not true() and time.monotonic() < end:
        time.sleep(0.05)
    return true()


@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.long)])
def test_a_signal_while_python_ends_does_not_change_how_a_command_ended(tmp_path, number):
    """The work is done and its exit code known; by default the process would end by the signal instead."""
    (tmp_path / "case.toml").write_text("")
    program = (
        "import atexit, os, sys; from flashtemp.__main__ import main;"
        f"atexit.register(lambda: os.kill(os.getpid(), {int(number)}));"
        "sys.argv = ['flashtemp', 'check', 'case.toml']; sys.exit(main())"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("number", [signal.SIGKILL, pytest.param(signal.SIGTERM, marks=pytest.mark.long)])
def test_workers_end_with_the_command(tmp_path, number):
    script, crowd = tmp_path / "lead.py", tmp_path / "crowd"
    script.write_text(CREW)
    crowd.mkdir()
    with subprocess.Popen([sys.executable, script, crowd]) as leader:
        assert until(lambda: len(list(crowd.iterdir())) == 2)
        leader.send_signal(number)
    workers = [int(p.name) for p in crowd.iterdir()]
    assert until(lambda: not any(map(alive, workers)), 5.0)


@pytest.mark.parametrize("command", ["compare", "sweep", "run"])
def test_two_commands_into_one_folder_do_not_meet(case, campaign, tmp_path, capsys, command):
    out, mine = tmp_path / "a", result_folder.OwnerMarker("a", "compare")
    source = campaign if command == "compare" else case
    more = ["friction.mu=0.5,0.6"] if command == "sweep" else []
    with result_folder.reserve_folder(out, mine) as work:
        (work / "note").write_text(MINE)
        assert main([command, str(source), *more, "--out", str(out)]) == 2
        said = capsys.readouterr().err.strip()
        assert said.endswith(f"--out: another run is writing {work}; wait for it or choose another folder")
        assert (work / "note").read_text() == MINE


def answers(pid: int) -> bool:
    """Whether a process has taken Ctrl-C into its own hands: before, it is Python that starts."""
    with suppress(OSError):
        caught = re.search(r"SigCgt:\s+(\w+)", Path(f"/proc/{pid}/status").read_text())
        return bool(int(caught[1], 16) >> (signal.SIGALRM - 1) & 1)
    return False


@pytest.mark.parametrize("delay", [0.0, 0.1, 0.4, 1.0])
@pytest.mark.sample("0.4")
def test_ctrl_c_while_modules_load(case, tmp_path, delay):
    words = [str(case), "schedule.repetitions=300", "--out", str(tmp_path / "a")]  # longer than any delay
    command = [sys.executable, "-m", "flashtemp", "run", *words]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert until(lambda: answers(process.pid))
        time.sleep(delay)
        process.send_signal(signal.SIGINT)
        said = process.communicate(timeout=60)[1].strip()
    assert "Traceback" not in said
    assert (process.returncode, said.startswith("interrupted")) == (130, True)
