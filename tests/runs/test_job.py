"""From case to result folder: contract of the files, interruption, resumption, the command line."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import flashtemp
from flashtemp.__main__ import main
from flashtemp.api.simulation import resume, simulate
from flashtemp.display import write_json
from flashtemp.model.case import load_case
from flashtemp.model.numerics import installed_bindings
from flashtemp.runs import job
from flashtemp.solver.cvode import BdfIntegrator, IntegratorSettings

SMALL = {
    "effects": ["track_memory", "friction_softening"],
    "schedule.repetitions": 2,
    "schedule.wait": 5.0,
    "schedule.distance": 0.5,
    "road.track_length": 0.3,
    "numerics.mesh": 0.4,
    "output.profiles": 10,
    "output.pictures": False,
}


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    """A case folder with a speed file beside it."""
    path = tmp_path_factory.mktemp("case")
    (path / "speed.csv").write_text("time_s,speed_m_s\n0,0.1\n2,0.2\n")
    (path / "case.toml").write_text('title = "small"\n[schedule]\nspeed = "speed.csv"\n')
    return path


@pytest.fixture(scope="session")
def result(folder, tmp_path_factory):
    """A whole result folder and its Run."""
    out = tmp_path_factory.mktemp("out") / "small"
    run = simulate(load_case(folder, SMALL), out=out, pvd=True)
    return out, run


def test_files_of_the_contract(result):
    out, run = result
    names = {p.name for p in out.iterdir()}
    assert names == {"case.toml", "run.nc", "summary.json", "profiles.csv", "fields.vtkhdf", "pvd", "inputs"}
    with xr.open_dataset(out / "run.nc") as ds:
        for name in ("T_block", "T_spot", "T_road", "pressure"):
            assert ds[name].dims == ("time", "x")
            assert ds[name].attrs["units"] == ("Pa" if name == "pressure" else "degC")
        for name in ("repetition", "slid", "friction"):
            assert ds[name].dims == ("time",)
        assert ds.time.attrs["units"] == "s"
        assert float(ds.time[0]) == 0.0
        assert np.all(np.diff(ds.time) > 0)
        np.testing.assert_array_equal(ds.T_block[0], 20.0)
        assert float(ds.slid[-1]) == pytest.approx(1.0)
        np.testing.assert_allclose(ds.T_block, run.T_block)
    summary = json.loads((out / "summary.json").read_text())
    for key in (
        "T_max_degC", "rise_leading_K", "rise_middle_K", "rise_trailing_K", "friction_per_repetition",
        "energy_imbalance", "cells", "steps", "rhs_evaluations", "wall_s", "versions",
    ):  # fmt: skip
        assert key in summary
    assert len(summary["friction_per_repetition"]) == 2
    assert summary["energy_imbalance"] < 1e-10
    assert summary["rise_leading_K"] < summary["rise_middle_K"] < summary["rise_trailing_K"]
    table = np.genfromtxt(out / "profiles.csv", delimiter=",", names=True)
    np.testing.assert_allclose(table["T_block_degC"], run.T_block[run.last_sliding_index], rtol=1e-7)


def test_result_can_be_run_again_from_what_it_holds(result, tmp_path):
    out, run = result
    again = simulate(load_case(out), out=tmp_path / "again")
    np.testing.assert_array_equal(again.T_block, run.T_block)


def test_vtk_offers_the_whole_series_in_metres(result):
    import vtk

    out, run = result
    fields = flashtemp.open_fields(out)
    np.testing.assert_array_equal(fields.times, run.time[run.frames])
    late = fields.times[-1]
    blocks = fields.grids_at(late)
    assert blocks.keys() == ["block", "road", "contact"]
    assert blocks["block"].bounds[:2] == pytest.approx((0.0, 0.025))
    assert blocks["block"].bounds[4:] == pytest.approx((0.0, 0.007))
    assert blocks["road"].bounds[5] == 0.0
    expected = run.field[-1][run.mesh.block].ravel()
    np.testing.assert_allclose(blocks["block"]["T_degC"], expected, rtol=1e-6)
    np.testing.assert_allclose(fields.T("block", late), expected, rtol=1e-6)
    centre = blocks["road"].cell_centers().points
    np.testing.assert_allclose(centre[:, 2], run.mesh.z_centre[run.mesh.road].ravel(), atol=1e-7)
    # the way ParaView asks: by time, through the pipeline
    reader = vtk.vtkHDFReader()
    reader.SetFileName(str(out / "fields.vtkhdf"))
    reader.UpdateInformation()
    steps = reader.GetOutputInformation(0).Length(vtk.vtkStreamingDemandDrivenPipeline.TIME_STEPS())
    assert steps == len(fields.times)
    reader.UpdateTimeStep(late)
    hottest = reader.GetOutputDataObject(0).GetBlock(0).GetCellData().GetArray("T_degC").GetRange()[1]
    assert hottest == pytest.approx(expected.max(), rel=1e-6)
    series = (out / "pvd" / "fields.pvd").read_text()
    assert series.count("<DataSet") == 3 * len(fields.times)


def test_vtk_follows_the_contact_along_the_block(result):
    import pyvista as pv

    out, run = result
    fields = flashtemp.open_fields(out)
    series = pv.get_reader(out / "pvd" / "fields.pvd")
    along = {"T_block_degC": run.T_block, "T_spot_degC": run.T_spot, "T_road_degC": run.T_road}
    along |= {"pressure_Pa": run.pressure, "worn_m": run.worn}
    for i, (k, t) in enumerate(zip(run.frames, fields.times, strict=True)):
        series.set_active_time_point(i)
        bodies, lines = fields.grids_at(t), series.read()[2]
        for name, values in along.items():
            np.testing.assert_allclose(bodies["contact"][name], values[k], rtol=1e-6)
            np.testing.assert_allclose(fields.cells("contact", name, t), values[k], rtol=1e-6)
            np.testing.assert_array_equal(lines[name], values[k])
        np.testing.assert_allclose(bodies["road"]["T_degC"], run.field[i][run.mesh.road].ravel())
    np.testing.assert_allclose(bodies["contact"].cell_centers().points, lines.cell_centers().points)
    np.testing.assert_allclose(lines.cell_centers().points[:, 0], run.x, atol=1e-8)
    assert set(bodies["contact"].celltypes) == {pv.CellType.LINE}
    assert not fields.cells("contact", "pressure_Pa", run.time[run.frames[np.argmin(run.sliding[run.frames])]]).any()
    with pytest.raises(flashtemp.BadInput, match="did you mean 'contact worn_m'"):
        fields.cells("contact", "wron_m", 0.0)


def test_existing_folder_is_refused_and_overwritten_on_request(folder, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "precious.txt").write_text("mine")
    with pytest.raises(flashtemp.BadInput, match="exists"):
        simulate(load_case(folder, SMALL), out=out)
    with pytest.raises(flashtemp.BadInput, match="not a result of flashtemp"):
        simulate(load_case(folder, SMALL), out=out, overwrite=True)
    assert (out / "precious.txt").read_text() == "mine"
    again = tmp_path / "again"
    simulate(load_case(folder, SMALL), out=again)
    (again / "note.txt").write_text("old")
    simulate(load_case(folder, SMALL), out=again, overwrite=True)
    assert (again / "run.nc").exists()
    assert not (again / "note.txt").exists()
    assert {p.name for p in tmp_path.iterdir()} == {"out", "again"}


def test_two_runs_into_one_folder_do_not_meet(folder, tmp_path):
    def intrude(progress, end):
        with pytest.raises(flashtemp.BadInput, match="another run"):
            simulate(load_case(folder, SMALL), out=tmp_path / "out", overwrite=True)
        watched.append(progress.t)

    watched = []
    short = SMALL | {"schedule.repetitions": 1, "schedule.distance": 0.01}
    simulate(load_case(folder, short), out=tmp_path / "out", watch=intrude)
    assert watched
    assert (tmp_path / "out" / "run.nc").exists()


def test_a_changed_or_damaged_checkpoint_is_refused(folder, tmp_path):
    def stop(progress, end):
        os.kill(os.getpid(), signal.SIGTERM)

    with pytest.raises(flashtemp.errors.UserInterrupt):
        simulate(load_case(folder, SMALL), out=tmp_path / "out", watch=stop)
    case = tmp_path / "out.partial" / "case.toml"
    text = case.read_text()
    case.write_text(text.replace("mesh = 0.4", "mesh = 0.5"))
    with pytest.raises(flashtemp.BadInput, match="was changed"):
        resume(tmp_path / "out")
    case.write_text(text)
    checkpoint = tmp_path / "out.partial" / job.CHECKPOINT_FILE
    whole = checkpoint.read_bytes()
    checkpoint.write_bytes(whole.replace(b"checkpoint 3", b"checkpoint 2", 1))
    with pytest.raises(flashtemp.BadInput, match="another version of flashtemp"):
        resume(tmp_path / "out")
    checkpoint.write_bytes(whole[:500])
    with pytest.raises(flashtemp.BadInput, match="damaged"):
        resume(tmp_path / "out")


def test_a_failure_of_the_march_leaves_nothing(folder, tmp_path):
    lost = {
        "effects": ["wear"],
        "wear.rate": 1e-7,
        "schedule.speed": 1.0,
        "contact.pressure": 1e7,
        "limits.temperature": 1e5,
    }
    with pytest.raises(flashtemp.SolverFailure, match="worn through"):
        simulate(load_case(folder, SMALL | lost), out=tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_a_failure_after_the_march_leaves_the_march(result, folder, tmp_path, monkeypatch):
    with monkeypatch.context() as m:
        m.setattr(job.vtk, "write_vtkhdf", lambda *a: 1 / 0)
        with pytest.raises(flashtemp.errors.SystemFailure, match="division by zero; checkpoint saved in"):
            simulate(load_case(folder, SMALL), out=tmp_path / "out")
    assert [p.name for p in tmp_path.iterdir()] == ["out.partial"]
    run = resume(tmp_path / "out", watch=lambda progress, end: pytest.fail("it was marched again"))
    np.testing.assert_array_equal(run.T_block, result[1].T_block)
    np.testing.assert_array_equal(run.field, result[1].field)
    assert {p.name for p in (tmp_path / "out").iterdir()} == {p.name for p in result[0].iterdir()} - {"pvd"}


@pytest.mark.parametrize("share", [0.1, 0.45, 0.8])
@pytest.mark.sample("0.45")
def test_stop_and_resume_give_the_same_answer(result, folder, tmp_path, share):
    _, whole = result
    out = tmp_path / "out"
    seen = 0

    def stop(progress, end):
        nonlocal seen
        seen += 1
        if progress.t > share * end and seen > 0:
            seen = -(10**9)
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(flashtemp.errors.UserInterrupt):
        simulate(load_case(folder, SMALL), out=out, watch=stop)
    assert not out.exists()
    assert (tmp_path / "out.partial" / job.CHECKPOINT_FILE).exists()
    with pytest.raises(flashtemp.BadInput, match="--resume"):
        simulate(load_case(folder, SMALL), out=out)
    run = resume(out)
    assert out.exists()
    assert not (tmp_path / "out.partial").exists()
    np.testing.assert_array_equal(run.time, whole.time)
    rise = np.abs(whole.T_block - 20.0).max()
    np.testing.assert_allclose(run.T_block, whole.T_block, atol=1e-3 * rise)
    np.testing.assert_allclose(run.friction_per_repetition, whole.friction_per_repetition, rtol=1e-5)
    assert run.energy_imbalance < 1e-10
    with pytest.raises(flashtemp.BadInput, match="the run is complete; draw missing pictures with: flashtemp draw"):
        resume(out)


def test_ctrl_c_at_the_command_line(folder, tmp_path):
    out = tmp_path / "out"
    command = [
        sys.executable,
        "-m",
        "flashtemp",
        "run",
        str(folder),
        "output.pictures=false",
        "schedule.repetitions=2000",
    ]
    process = subprocess.Popen([*command, "--out", str(out)], stderr=subprocess.PIPE, text=True, cwd=tmp_path)
    partial = Path(f"{out}.partial")
    for _ in range(600):
        if (partial / "case.toml").exists():
            break
        time.sleep(0.05)
    time.sleep(1.0)
    process.send_signal(signal.SIGINT)
    _, messages = process.communicate(timeout=60)
    assert process.returncode == 130
    assert f"--resume {out}" in messages
    assert "Traceback" not in messages
    assert (partial / job.CHECKPOINT_FILE).exists()
    assert not out.exists()


@pytest.mark.skipif(len(installed_bindings()) < 2, reason="one CVODE binding on this machine")
@pytest.mark.long
def test_both_bindings_give_the_same_answer(folder):
    first, second = (
        simulate(load_case(folder, SMALL | {"numerics.integrator": b, "numerics.rtol": 1e-6}))
        for b in installed_bindings()
    )
    rise = np.abs(first.T_block - 20.0).max()
    # columns of the track are kept at solver steps, linear between: 8e-5 whatever rtol is
    np.testing.assert_allclose(first.T_block, second.T_block, atol=1e-4 * rise)
    np.testing.assert_allclose(first.friction_per_repetition, second.friction_per_repetition, rtol=5e-6)


def test_json_is_all_that_stands_on_stdout(folder, tmp_path, capsys):
    args = [f"{k}={json.dumps(v)}" for k, v in SMALL.items()]
    assert main(["run", str(folder), *args, "--out", str(tmp_path / "out"), "--json"]) == 0
    shown = capsys.readouterr()
    assert json.loads(shown.out)["cells"] > 100
    assert main(["check", str(folder), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["ok"] is True
    assert main(["effects", "--json"]) == 0
    entries = json.loads(capsys.readouterr().out)
    assert {"friction", "track_memory"} <= {e["name"] for e in entries}
    assert main(["effects", "holder_sink"]) == 0
    assert "W/m2K" in capsys.readouterr().out
    assert main(["effects", "holder_snik"]) == 2
    assert "did you mean 'holder_sink'" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["discover", "plan", "sweep", "view"])
def test_later_commands_answer_help_and_say_so(command, capsys):
    assert main([command, "--help"]) == 0
    assert command in capsys.readouterr().out
    assert main([command, "something", "--out", "x", "--json"]) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert len(shown.err.strip().splitlines()) == 1


@pytest.mark.long
def test_converge_reports_second_order(folder, capsys):
    args = ["schedule.speed=0.1", "schedule.distance=0.2", "numerics.rtol=1e-5"]
    assert main(["converge", str(folder), *args, "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["cells"][1] == pytest.approx(4 * report["cells"][0], rel=0.05)
    middle = report["quantities"].index("rise at the middle")
    assert 1.6 < report["order"][middle] < 2.4
    assert report["space"][middle] < 0.01 * report["values"][1][middle]


@pytest.mark.long
def test_checkpoints_are_written_on_the_way(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(job, "CHECKPOINT_PERIOD_S", 0.0)
    kept = []

    def look(progress, end):
        kept.append((tmp_path / "out.partial" / job.CHECKPOINT_FILE).exists())

    simulate(load_case(folder, SMALL), out=tmp_path / "out", watch=look)
    assert any(kept)
    assert not (tmp_path / "out" / job.CHECKPOINT_FILE).exists()


@pytest.mark.parametrize("rtol", [1e-2, 1e-4])
def test_audit_closes_while_the_contact_fraction_changes(folder, rtol):
    change = {
        "contact.pressure": [[0.0, 0.0], [1.0, 3e5], [2.0, 1e5]],
        "contact.spot_exponent": 1.0,
        "numerics.rtol": rtol,
    }
    run = simulate(load_case(folder, SMALL | change))
    assert run.energy_imbalance < 1e-12
    assert 0 < run.partition_error < rtol


@pytest.mark.parametrize("binding", installed_bindings())
@pytest.mark.parametrize("end", [0.01, 0.1, 1.1, 35.0])
def test_integration_ends_exactly_where_it_should(binding, end):
    """Also where single precision cannot hold the end of a phase."""

    class Clock:
        def rate(self, t, y, out):
            out[:] = [-y[0], 1.0]

        def apply_jacobian(self, v, out):
            out[:] = [-v[0], 0.0]

        def linearise(self, t, y, gamma):
            self.gamma = gamma
            return self

        def solve(self, r, z):
            z[:] = [r[0] / (1 + self.gamma), r[1]]

    solver = BdfIntegrator(binding, Clock(), IntegratorSettings(1e-6, 1e-9, 5, end))
    solver.start(0.0, np.array([1.0, 0.0]), end)
    t = 0.0
    while end - t > 1e-9 * end:
        t, y = solver.step()
    assert t == end
    assert y[1] == pytest.approx(end, rel=1e-12)
    assert y[0] == pytest.approx(np.exp(-end), abs=1e-4)


def test_a_file_that_cannot_be_written_is_told_by_its_own_name(tmp_path):
    with pytest.raises(FileNotFoundError) as fault:
        write_json({}, tmp_path / "none" / "a.json")
    assert fault.value.filename == str(tmp_path / "none" / "a.json")
