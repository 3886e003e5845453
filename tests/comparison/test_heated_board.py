"""The measured board of cases/heated_board: what its commands print, and the cause that discovery names."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import flashtemp
from flashtemp.comparison import campaign
from flashtemp.comparison.compare import compare
from flashtemp.discovery.diagnostics.adequacy_tests import unnamed_heat_evidence
from flashtemp.discovery.parameters import ParameterId, ParameterKind
from flashtemp.discovery.prediction.prediction import DerivativeRequest, predict_condition
from flashtemp.discovery.prediction.problem import prepare_problem

BOARD = Path(__file__).parents[2] / "cases" / "heated_board"
PEERS = (6.2, 6.5, 10.6)  # K rms: best published submissions at 5.72, 11.44, 17.16 mm


def test_the_stack_from_the_heater_is_nearer_than_the_best_submissions():
    """Nothing is fitted to the stack: conductivity is that found between the outer thermocouples."""
    [seeing] = compare(campaign.load(BOARD / "stack_campaign.toml")).recordings
    found = [p["rmse_K"] for p in seeing.point_statistics]
    assert all(f < p for f, p in zip(found, PEERS, strict=True)), found


def test_the_copper_disc_on_the_board_is_predicted_within_what_the_heater_is_known_to():
    """Two layers and their contact, nothing fitted: half of the heater's 3.2 % (two standard deviations) is 3.8 K rms here."""
    [seeing] = compare(campaign.load(BOARD / "copper_campaign.toml")).recordings
    assert np.ptp(seeing.view.recording.temperature) > 290.0
    assert seeing.rmse_K < 3.8


def test_what_is_left_in_the_first_120_s_is_told():
    [seeing] = compare(campaign.load(BOARD / "first_120_s.toml")).recordings
    assert 3.0 < seeing.rmse_K < 6.0
    assert 7.0 < np.abs(seeing.residual).max() < 9.0


def test_no_row_of_the_thinned_copy_is_changed():
    """Rows of two files that hold the same thermocouple agree, and the face is the hottest of three."""
    tables = {f.stem: np.genfromtxt(f, delimiter=",", skip_header=1) for f in (BOARD / "measured").glob("*.csv")}
    stack, face = tables["stack"], tables["face"]
    both = np.isin(face[:, 0], stack[:, 0])
    assert np.array_equal(face[both, 1], stack[:, 1])
    middle = np.vstack([tables[f"middle_{part}"] for part in ("0_120", "120_600", "600_1200")])
    assert np.array_equal(middle[:, 1], stack[:, 2])
    assert len(stack) == 121


@pytest.mark.parametrize("pictures", [False, pytest.param(True, marks=pytest.mark.long)])
def test_a_block_alone_leaves_a_whole_result(tmp_path, pictures):
    """Nothing slides: no friction to tell, no stick-slip to warn of, and every picture that applies."""
    given = {"output.pictures": pictures, "output.vtk": False, "numerics.rtol": 1e-3}
    run = flashtemp.simulate(BOARD, given, out=tmp_path / "board")
    assert run.friction_per_repetition == []
    assert "548 degC" in str(run)
    assert run.to_table().rows
    assert (tmp_path / "board" / "profile.png").is_file() == pictures


FEW = ("conductivity_slope", "capacity_slope", "track_memory")  # enough for every part of discovery to be asked


@pytest.mark.long  # test_discover.py names an effect with every change
@pytest.mark.parametrize("candidates", [None, FEW])
def test_discovery_names_the_slope_of_the_conductivity(candidates):
    """120 to 600 s are fitted; 600 to 1200 s, held out, are predicted to 1.2 K rms, by constant k to more than 6 K."""
    board = campaign.load(BOARD)
    verdict = flashtemp.discover(replace(board, candidates=candidates) if candidates else board, workers=1)
    assert verdict.kind == "named"
    assert [c.effect for c in verdict.causes] == ["conductivity_slope"]
    assert verdict.extended.held_out_rmse_K < 1.2
    assert verdict.base.held_out_rmse_K > 6.0


def test_where_nothing_slides_no_heat_of_any_shape_is_asked_for():
    """Nor where only data that are held out feel it."""
    problem = prepare_problem(campaign.load(BOARD), lambda tasks: [predict_condition(t) for t in tasks])
    tasks = problem.make_tasks(
        problem.stated_model, DerivativeRequest(problem.free_keys, scatter=True, modes=2, trends=True)
    )
    [made] = problem.predict(tasks[:1])
    kinds = {p.kind for o in made.observables.values() for p in o.columns}
    assert not kinds & {ParameterKind.MODE, ParameterKind.TREND, ParameterKind.SCATTER}
    flux, asked = ParameterId(ParameterKind.FLUX, (1,), condition=0), []

    def solved(problem, more, equations):
        asked.append(more)
        return SimpleNamespace(solution=SimpleNamespace(ln_evidence=1e-14 * len(asked)))

    for names, seen in (
        ([ParameterId(ParameterKind.GAIN)], []),
        ([flux], [flux]),
        ([flux], []),
    ):  # felt by none, or by data held out
        system = SimpleNamespace(names=names, fitted_columns=frozenset(seen))
        fit = SimpleNamespace(solve_with=solved, effect_priors={}, bound=(), equations=None, system=system)
        assert abs(unnamed_heat_evidence(None, fit)) < 1e-9
    assert [*asked[-1]] == [flux]
    assert len(asked) == 2
