"""What no result may pass: temperatures beyond sense, and books that do not balance."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from flashtemp.__main__ import main
from flashtemp.camera.image_validation import MAX_CAMERA_DEGC
from flashtemp.camera.recording import Recording
from flashtemp.errors import BadInput, EnergyBalanceError, SolverFailure
from flashtemp.model.case import load_case
from flashtemp.physics.quantities import KELVIN
from flashtemp.solver import sanity_checks
from flashtemp.solver.contact_flux import ContactState
from flashtemp.solver.interface import ContactInterface
from flashtemp.solver.time_integration import integrate_schedule

SMALL = {
    "schedule.distance": 0.02, "numerics.mesh": "coarse", "output.pictures": False, "output.vtk": False,
}  # fmt: skip
SPRAY = """
from flashtemp.physics import Effect, Heat, Param

class Spray(Effect):
    cause, source, tells = "cold water cools the holder's side", "own", ("cooler",)
    power = Param(1e8, "W/m3", "heat drawn from the block", low=0.0, high=1e9, off=0.0)

    def heat(self, scene, p):
        yield Heat.zone("block", lambda T, now, p: -p.power + 0.0 * T)
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "case.toml").write_text('title = "limits"\n', encoding="utf-8")
    return tmp_path


def run(folder, **given):
    case = load_case(folder, SMALL | {k.replace("__", "."): v for k, v in given.items()}, trust=True)
    return integrate_schedule(case.scene, case.settings)


def test_a_run_that_gets_too_hot_fails_with_time_and_place(folder, capsys):
    words = [f"{k}={json.dumps(v)}" for k, v in SMALL.items()]
    hot = ["contact.pressure=1e7", "friction.mu=2"]
    assert main(["run", str(folder), *words, *hot, "--out", str(folder / "out")]) == 1
    said = capsys.readouterr().err
    assert "above limits.temperature = 600 degC" in said
    assert " at t = " in said
    assert not (folder / "out").exists()
    assert main(["run", str(folder), *words, *hot, "limits.temperature=1e5", "--out", str(folder / "out")]) == 0
    remark = "rubber ages above 200 degC and chars above 300 degC"
    assert remark in capsys.readouterr().out
    assert any(remark in r for r in json.loads((folder / "out" / "summary.json").read_text())["remarks"])


def test_a_run_that_stays_below_200_has_no_remark(folder, capsys):
    words = [f"{k}={json.dumps(v)}" for k, v in SMALL.items()]
    assert main(["run", str(folder), *words, "--out", str(folder / "out")]) == 0
    assert "remarks" not in json.loads((folder / "out" / "summary.json").read_text())


def test_spots_count_where_no_cell_is_as_hot(folder):
    cool = run(folder, contact__flash_factor=0.0)
    limit = float(np.max(cool.field)) + 1.0
    assert run(folder, contact__flash_factor=0.0, limits__temperature=limit)
    with pytest.raises(SolverFailure, match=r"limits\.temperature"):
        run(folder, limits__temperature=limit)


def test_colder_than_all_that_cools_is_a_failure(folder, monkeypatch):
    contact = ContactInterface.contact_state

    def drawing(self, now, local, T=None):
        state = contact(self, now, local, T)
        return state._replace(heat_per_mu=-state.heat_per_mu)  # friction that takes heat away

    monkeypatch.setattr(ContactInterface, "contact_state", drawing)
    with pytest.raises(SolverFailure, match="below everything that cools, 20 degC"):
        run(folder)


def test_a_loose_tolerance_may_leave_the_front_of_a_start_colder():
    """`cases/run_in` on 1760 cells at 0.05 MPa: 1.85 K below at rtol 3e-3, 0.01 K at 1e-3, 0.02 K at BDF order 1."""
    scene = SimpleNamespace(ambient=20.0 + KELVIN)
    system = SimpleNamespace(b=SimpleNamespace(scene=scene, n=1760), coldest_rise=lambda t: 0.0)
    rises = np.array([14.5, -1.85])
    sanity_checks.check_temperatures(system, 0.48, rises, hottest=900.0, atol=3e-2)
    with pytest.raises(SolverFailure, match="below everything that cools, 20 degC"):
        sanity_checks.check_temperatures(system, 0.48, rises, hottest=900.0, atol=1e-3)


def test_what_a_law_cools_may_be_cold(folder):
    (folder / "spray.py").write_text(SPRAY, encoding="utf-8")
    assert np.min(run(folder, effects=["./spray.py"]).field) < 15.0
    cold = {"holder_sink__temperature": -60.0, "holder_sink__coefficient": 1e5, "schedule__distance": 0.3}
    assert np.min(run(folder, effects=["holder_sink"], **cold).field) < 10.0


@pytest.mark.parametrize(("lost", "name"), [(1e-5, "energy_imbalance"), (2e-3, "energy_imbalance")])
def test_heat_that_is_lost_on_the_way_fails(folder, monkeypatch, capsys, lost, name):
    built = ContactState

    def leaky(**values):
        return built(**values | {"road_coverage": (1.0 - lost) * values["road_coverage"]})

    monkeypatch.setattr("flashtemp.solver.contact_flux.ContactState", leaky)
    with pytest.raises(EnergyBalanceError, match=name) as fault:
        run(folder)
    assert fault.value.run.energy_imbalance > 1e-6
    words = [f"{k}={json.dumps(v)}" for k, v in SMALL.items()]
    assert main(["run", str(folder), *words, "--out", str(folder / "out")]) == 1
    assert "out.failed" in capsys.readouterr().err
    assert not (folder / "out").exists()
    assert name in json.loads((folder / "out.failed" / "summary.json").read_text())["failed"]
    assert (folder / "out.failed" / "run.nc").is_file()


@pytest.mark.parametrize("lost", [1e-12, 1e-3])
def test_every_imbalance_that_is_shown_is_that_of_the_books(folder, lost):
    """The number of summary.json and of the text follows heat that is taken out of the books of a run."""
    whole = run(folder)
    books = whole.energy | {"block": whole.energy["block"] - lost * whole.energy["friction"]}
    short = replace(whole, energy=books)
    moved = max(abs(values[-1]) for name, values in books.items() if name != "share")
    expected = lost * whole.energy["friction"][-1] / moved
    assert short.energy_imbalance == pytest.approx(expected, rel=1e-2)
    assert short.summary["energy_imbalance"] == short.energy_imbalance
    assert f"energy imbalance {short.energy_imbalance:.1e}" in str(short)


def recording(degC):
    """Three frames of one temperature."""
    return Recording(
        "sidewall", np.full((3, 3, 4), degC), np.arange(3.0), np.ones(3, int), np.arange(4.0), np.arange(3.0)
    )


@pytest.mark.parametrize("degC", [-273.0, 20.0, MAX_CAMERA_DEGC])
def test_recordings_up_to_what_cameras_measure_are_taken(degC):
    assert recording(degC).temperature[0, 0, 0] == degC


@pytest.mark.parametrize("degC", [MAX_CAMERA_DEGC + 1.0, 1e6, -273.2, -1e6])
def test_recordings_hotter_or_colder_than_any_camera_measures_are_refused(degC):
    with pytest.raises(BadInput, match="hotter than any camera" if degC > 0 else "absolute zero"):
        recording(degC)
