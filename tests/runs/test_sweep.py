"""Sweeps: every combination once, in one dataset, whatever is killed between."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
import xarray as xr

from flashtemp.__main__ import main
from flashtemp.errors import SolverFailure
from flashtemp.model.case import load_case
from flashtemp.runs.results import resumable_batch
from flashtemp.runs.results.worker_pool import stream_results
from flashtemp.runs.studies import sweep
from flashtemp.solver.time_integration import integrate_schedule
from flashtemp.viz.studies import sweep as picture

CASE = """title = "small"
[block]
height = 0.005
[schedule]
distance = 0.1
repetitions = 2
wait = 1.0
[numerics]
mesh = 0.3
[output]
profiles = 8
"""
AXES = ["contact.pressure=1e5,2e5", "schedule.speed=0.1,0.2,0.4"]


@pytest.fixture
def case(tmp_path):
    folder = tmp_path / "case"
    folder.mkdir()
    (folder / "case.toml").write_text(CASE)
    return folder


def carried(case, out, *given, **how):
    asked = sweep.plan_sweep(case, *sweep.parse_axes(list(given)))
    with sweep.open_sweep_folder(out, asked) as work:
        found = sweep.run_sweep(asked, work, **how)
        found.save(work)
    return found.dataset, found.failed


def test_every_combination_is_the_run_itself(case, tmp_path):
    found, failed = carried(case, tmp_path / "out", *AXES, "friction.mu=0.8", workers=2)
    assert failed == {}
    assert found.T_block.dims == ("contact.pressure", "schedule.speed", "repetition", "place")
    assert found["contact.pressure"].attrs["units"] == "Pa"
    given = {"contact.pressure": 2e5, "schedule.speed": 0.2, "friction.mu": 0.8}
    made = load_case(case, given)
    run = integrate_schedule(made.scene, made.settings)
    one = found.sel({"contact.pressure": 2e5, "schedule.speed": 0.2})
    assert float(one.rise_trailing_K) == run.summary["rise_trailing_K"]
    last = np.interp(found.place * 0.025, run.x, run.T_spot[run.last_sliding_index])
    np.testing.assert_array_equal(one.T_spot.isel(repetition=-1), last)
    kept = xr.load_dataset(tmp_path / "out" / "sweep.nc")
    xr.testing.assert_identical(kept, found)
    rows = (tmp_path / "out" / "sweep.csv").read_text().splitlines()
    assert len(rows) == 7
    assert not (tmp_path / "out.partial").exists()


def test_places_count_from_the_edge_that_leads_forward(case, tmp_path):
    found, _ = carried(case, tmp_path / "out", "schedule.speed=0.1,-0.1", workers=1)
    forward, back = found.T_spot.isel(repetition=-1)
    np.testing.assert_allclose(back[::-1], forward, rtol=1e-9)
    assert found.place.attrs["long_name"] == "x/L from the edge that leads while the block slides forward"


def test_an_interrupted_sweep_goes_on(case, tmp_path, monkeypatch):
    """What was finished before is not marched again."""
    out, marched = tmp_path / "out", []

    def stop(done, total):
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        carried(case, out, *AXES, workers=1, watch=stop)
    assert not out.exists()
    whole = sweep.compute_point
    monkeypatch.setattr(sweep, "compute_point", lambda c: (marched.append(c), whole(c))[1])
    found, failed = carried(case, out, *AXES, workers=1)
    assert len(marched) == 4
    assert failed == {}
    assert np.isfinite(found.T_max_degC).all()
    fresh, _ = carried(case, tmp_path / "fresh", *AXES, workers=1)
    xr.testing.assert_identical(found.drop_vars("wall_s"), fresh.drop_vars("wall_s"))


def test_a_changed_file_is_another_point(case, tmp_path):
    (case / "p.csv").write_text("0.0,1.5\n0.025,0.5\n")
    given = ["effects=pressure_profile", "pressure_profile.profile=p.csv"]
    first = sweep.plan_sweep(case, *sweep.parse_axes([*given, "schedule.speed=0.1,0.2"])).points[0]
    name = resumable_batch._hash_case(first)
    (case / "p.csv").write_text("0.0,0.5\n0.025,1.5\n")
    assert resumable_batch._hash_case(first) != name


def test_a_point_that_fails_is_told_and_the_rest_stays(case, tmp_path, capsys):
    """Wear right through the block under the higher load."""
    values = ["contact.pressure=1e5,1e7", "effects=wear", "wear.rate=1e-7", "schedule.speed=1.0", "friction.mu=0.1"]
    out = tmp_path / "out"
    assert main(["sweep", str(case), *values, "--out", str(out), "--json", "--workers", "1"]) == 1
    said = json.loads(capsys.readouterr().out)
    assert len(said["failed"]) == 1
    assert "worn through" in said["failed"][0]
    found = xr.load_dataset(out / "sweep.nc")
    assert np.isfinite(found.T_max_degC).values.tolist() == [True, False]
    assert "worn through" in (out / "sweep.csv").read_text()
    assert (out / "sweep.png").stat().st_size > 10000


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ([], "nothing to sweep"),
        (["friction.mu=0.8"], "nothing to sweep"),
        (["friction.mu=0.8,0.8"], "twice"),
        (["friction.mo=0.8,0.9"], "did you mean 'friction.mu'"),
        (["friction.mu=0.8,-1"], "friction.mu"),
        (["schedule.repetitions=1,2"], "cannot be swept"),
    ],
)
def test_bad_sweeps_are_told_in_one_line(case, tmp_path, capsys, given, says):
    assert main(["sweep", str(case), *given, "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err.strip()
    assert says in said
    assert "\n" not in said
    assert not (tmp_path / "out.partial").exists()


def test_another_sweep_does_not_touch_what_is_there(case, tmp_path, capsys):
    out = tmp_path / "out"

    def stop(done, total):
        if done:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        carried(case, out, *AXES, workers=1, watch=stop)
    before = sorted(tmp_path.rglob("*"))
    assert main(["sweep", str(case), "friction.mu=0.5,0.6", "--out", str(out)]) == 2
    assert "holds an interrupted sweep; continue with 'the same command'" in capsys.readouterr().err
    assert main(["run", str(case), "--out", str(out)]) == 2
    assert "holds an interrupted sweep" in capsys.readouterr().err
    assert sorted(tmp_path.rglob("*")) == before


def test_words_may_be_swept_and_are_drawn(case, tmp_path):
    """Even the title, which the picture then takes from the case."""
    found, failed = carried(case, tmp_path / "out", "title=first,second", workers=1)
    assert failed == {}
    fig = picture.draw(found)
    fig.canvas.draw()
    assert fig.get_suptitle() == "Temperature over title, small"
    assert [t.get_text() for t in fig.axes[0].get_legend().get_texts()] == ["first", "second"]


# --- hands -------------------------------------------------------------------------------------------
def slow(task):
    """A task that writes down who did it; the one that finds a trap kills its own process, once."""
    folder, k, trap = task
    time.sleep(0.05)
    if trap and k == 3:
        try:
            os.unlink(trap)
        except FileNotFoundError:
            pass
        else:
            os.kill(os.getpid(), signal.SIGKILL)
    with open(os.path.join(folder, f"{k}-{time.time_ns()}"), "w"):
        return k * k


@pytest.mark.long
def test_a_killed_process_loses_nothing(tmp_path):
    trap = tmp_path / "trap"
    trap.write_text("")
    tasks = [(str(tmp_path), k, str(trap)) for k in range(8)]
    got = list(stream_results(slow, tasks, 2))
    assert sorted(got) == [(k, k * k) for k in range(8)]


def test_processes_that_are_always_killed_end_it():
    with pytest.raises(SolverFailure, match="fewer --workers"):
        list(stream_results(signal.raise_signal, [signal.SIGKILL, signal.SIGKILL], 2))


@pytest.mark.long
def test_a_worker_of_a_real_cluster_is_killed(case, tmp_path):
    """Two workers, one killed in the middle: the sweep finishes, nothing lost, nothing doubled."""
    distributed = pytest.importorskip("distributed", reason="dask.distributed is not installed")
    values = [f"friction.mu={','.join(f'{0.5 + 0.01 * k:.2f}' for k in range(24))}"]
    seen, out = [], tmp_path / "out"
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        victim = next(iter(cluster.workers.values())).pid

        def watch(done, total):
            seen.append(done)
            if done == 8:
                threading.Thread(target=os.kill, args=(victim, signal.SIGKILL)).start()

        found, failed = carried(case, out, *values, scheduler=cluster.scheduler_address, watch=watch)
    assert failed == {}
    assert seen == list(range(25))
    rises = found.rise_trailing_K.values
    np.testing.assert_allclose(rises / found["friction.mu"].values, rises[0] / 0.5, rtol=1e-3)
    assert len(list((out / "points").iterdir())) == 24


@pytest.mark.long
def test_ctrl_c_leaves_points_to_go_on_from(case, tmp_path):
    """The command itself, stopped as a person would."""
    out = tmp_path / "out"
    slow = [f"friction.mu={','.join(f'{0.5 + 0.01 * k:.2f}' for k in range(60))}", "numerics.rtol=1e-6"]
    command = [sys.executable, "-m", "flashtemp", "sweep", str(case), *slow, "--out", str(out), "--workers", "1"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        points = tmp_path / "out.partial" / "points"
        while process.poll() is None and not (points.is_dir() and any(points.iterdir())):
            time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 130
        said = process.stderr.read().strip()
    assert said.startswith("interrupted; ")
    assert said.endswith("continue with: the same command")
    assert not out.exists()
    before = len(list(points.glob("*.npz")))
    assert 0 < before < 60
