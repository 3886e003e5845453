"""Evidence while a test runs: predictions are kept, and the data suffice by the criteria of discovery."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flashtemp.comparison import campaign as campaigns
from flashtemp.comparison.synthetic_campaign import SyntheticPlan, make_synthetic_campaign
from flashtemp.discovery.criteria import CRITERIA
from flashtemp.discovery.engine import predict_coarser_meshes
from flashtemp.discovery.estimation.hyperparameters import maximise_evidence
from flashtemp.discovery.estimation.linear_gaussian import LinearSystem
from flashtemp.discovery.estimation.linearised_fit import FitStatus, LinearisedFit
from flashtemp.discovery.estimation.nuisance_priors import all_derivatives
from flashtemp.discovery.estimation.whitening import WhitenedData
from flashtemp.discovery.kept_prediction import foresee_times, match_frames
from flashtemp.discovery.live_evidence import (
    STATED_MODEL,
    HypothesisEvidence,
    LiveEvidence,
    decide_leader,
    expected_ln_bayes,
)
from flashtemp.discovery.prediction.prediction import predict_condition
from flashtemp.discovery.prediction.problem import prepare_problem
from flashtemp.discovery.selection.scores import score_candidates
from flashtemp.model.case import load_case
from flashtemp.runs.results.worker_pool import call_safely

NAMED, DISTINCT = CRITERIA.ln_bayes_named, CRITERIA.ln_bayes_distinct
CASE = "cases/uniform_pressure"
SHORT = {"schedule.distance": 0.2, "schedule.repetitions": 2, "numerics.mesh": 0.25}
TRIED = 'candidates = ["pressure_tilt", "heat_depth"]\n'


def run(tasks):
    return [call_safely(predict_condition, task) for task in tasks]


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """A side wall under one condition with a hidden tilt, of which two candidates are tried."""
    folder = tmp_path_factory.mktemp("lab") / "twin"
    plan = SyntheticPlan(("pressure_tilt",), 1, 1, ("sidewall",))
    make_synthetic_campaign(load_case(CASE, SHORT), plan, folder)
    file = folder / "campaign.toml"
    file.write_text(TRIED + file.read_text())
    return campaigns.load(folder)


@pytest.fixture(scope="module")
def without_candidates(campaign):
    """The same where only the predictions matter."""
    return replace(campaign, candidates=())


def first_frames(campaign, count):
    views = tuple(replace(v, recording=v.recording.select_frames(np.arange(count))) for v in campaign.views)
    return replace(campaign, views=views)


@pytest.fixture(scope="module")
def assessments(campaign):
    """The evidence after every frame, and how many conditions had been simulated by then."""
    live, times = LiveEvidence(run), {v.file: v.recording.time for v in campaign.views}
    counts = range(1, campaign.views[0].recording.frames + 1)
    return [(live.assess(first_frames(campaign, n), times), live.simulations) for n in counts]


# --- predictions are kept ---------------------------------------------------------------------------
def test_a_condition_is_simulated_once_for_all_its_frames(assessments):
    assert [count for _, count in assessments] == [1] * len(assessments)


def test_the_evidence_of_all_frames_is_that_of_the_first_step_of_a_discovery(campaign, assessments):
    problem = prepare_problem(campaign, run)
    model = problem.stated_model
    fine = problem.predict(problem.make_tasks(model, replace(all_derivatives(problem), candidates=problem.candidates)))
    data = WhitenedData.from_predictions(problem, fine, predict_coarser_meshes(problem))
    system = LinearSystem(data.make_blocks(fine))
    at = maximise_evidence(problem, system, model, {})
    fit = LinearisedFit(model, tuple(fine), system, at.solution, at.priors, at.hyper, FitStatus.CONVERGED)
    wanted = {s.effect: s.ln_bayes for s in score_candidates(problem, fit, problem.candidates)}
    found = {h.effect: h.ln_bayes for h in assessments[-1][0].hypotheses}
    assert found == pytest.approx(wanted, rel=1e-6)


def test_the_hidden_effect_leads_and_the_data_suffice_in_the_end(assessments):
    last = assessments[-1][0]
    assert last.decision.leader == "pressure_tilt"
    assert last.decision.is_decided
    [compared] = last.recordings.values()
    assert compared.calibrated_rmse_K < 0.5 * compared.rmse_K


def test_frames_add_to_what_the_data_are_expected_to_show(assessments):
    expected = [{h.effect: h for h in a.hypotheses}["pressure_tilt"].expected_now for a, _ in assessments]
    assert np.all(np.diff(expected) > 0.0)
    end = {h.effect: h for h in assessments[0][0].hypotheses}["pressure_tilt"].expected_in_the_end
    assert end == pytest.approx(expected[-1], rel=0.1)  # the noise of one frame is not that of all


def test_frames_at_slightly_other_times_need_no_further_simulation(without_candidates):
    """At a frame that is late by half a step of the clock, the kept prediction errs in second order only.

    A rise with sqrt(t) changes by late/(2 t) of itself to first order and by late^2/(8 t^2) to second.
    """
    campaign, late = without_candidates, 0.01
    [view] = campaign.views
    moved = replace(view, recording=replace(view.recording, time=view.recording.time + late))
    moved = replace(moved, recording=moved.recording.select_frames(np.array([1, 2])))
    kept, exact = LiveEvidence(run), LiveEvidence(run)
    plain = kept.assess(campaign, {}).recordings[view.file].predicted[1:3]
    found = kept.assess(replace(campaign, views=(moved,)), {}).recordings[view.file].predicted
    compared = exact.assess(replace(campaign, views=(moved,)), {}).recordings[view.file]
    wanted = np.where(np.isfinite(compared.residual), compared.predicted, np.nan)
    assert kept.simulations == exact.simulations == 1
    second_to_first = late / (4.0 * view.recording.time[1])
    assert np.nanmax(np.abs(found - wanted)) < 10.0 * second_to_first * np.nanmax(np.abs(plain - wanted))


def test_frames_that_nothing_foretold_are_simulated_anew(without_candidates):
    live, [view] = LiveEvidence(run), without_candidates.views
    without_rate = replace(without_candidates, views=(replace(view, recording=replace(view.recording, fps=None)),))
    for count in (1, 2):
        live.assess(first_frames(without_rate, count), {})
    assert live.simulations == 2


# --- frames to come ---------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def schedule():
    return load_case(CASE, {"schedule.distance": 0.4, "schedule.speed": 0.1, "schedule.repetitions": 3}).scene.schedule


def recorded(campaign, time, fps=None):
    r = campaign.views[0].recording.select_frames(np.zeros(len(time), int))
    return replace(r, time=np.array(time), repetition=1 + (np.array(time) / 4.0).astype(int), fps=fps)


def test_times_of_a_table_are_foreseen(campaign, schedule):
    stated = np.array([0.1, 0.7, 1.9, 8.2, 99.0])
    assert list(foresee_times(recorded(campaign, [0.7]), schedule, stated, 100)[0]) == [0.1, 0.7, 1.9, 8.2]


def test_frames_at_a_rate_go_on_to_the_end(campaign, schedule):
    for found, _ in (
        foresee_times(recorded(campaign, [0.5], fps=2.0), schedule, None, 100),
        foresee_times(recorded(campaign, [0.5, 1.0], fps=30.0), schedule, None, 100),
    ):
        np.testing.assert_allclose(found, np.arange(1, 25) * 0.5)


def test_uneven_frames_are_foreseen_in_later_repetitions(campaign, schedule):
    found, _ = foresee_times(recorded(campaign, [0.2, 0.9, 3.5]), schedule, None, 100)
    np.testing.assert_allclose(found, [0.2, 0.9, 3.5, 4.2, 4.9, 7.5, 8.2, 8.9, 11.5])


def test_many_frames_are_thinned(campaign, schedule):
    found, every = foresee_times(recorded(campaign, [0.0], fps=50.0), schedule, None, 100)
    assert len(found) <= 100
    assert every == 7
    np.testing.assert_allclose(np.diff(found), 0.14)


def test_every_predicted_frame_has_the_nearest_frame():
    frames, predicted = match_frames(np.array([0.0, 0.495, 0.501, 0.9]), np.array([0.0, 0.5, 1.0]))
    assert (list(frames), list(predicted)) == ([0, 2], [0, 1])


# --- decisions --------------------------------------------------------------------------------------
def shown(effect, ln_bayes, now=50.0, end=50.0, reason=""):
    return HypothesisEvidence(effect, ln_bayes, now, end, reason)


@pytest.mark.parametrize(
    ("found", "secured", "leader", "is_decided", "words"),
    [
        ([shown("a", NAMED), shown("b", NAMED - DISTINCT)], 99.0, "a", True, "the data suffice: a"),
        ([shown("a", NAMED - 0.1), shown("b", -1.0)], 99.0, "a", False, "must reach 8"),
        ([shown("a", NAMED), shown("b", -1.0)], NAMED - 0.1, "a", False, "smooth error of the model"),
        ([shown("b", NAMED + 1.0), shown("a", NAMED + 5.9)], 99.0, "a", False, "must exceed b by 5"),
        ([shown("a", -1.0), shown("b", -2.0)], 0.0, STATED_MODEL, True, "none of 2 effects"),
        ([shown("a", CRITERIA.ln_bayes_hint - 0.1)], 99.0, STATED_MODEL, False, "a explains the data a little better"),
        ([shown("a", -1.0), shown("b", -2.0, NAMED - 0.1)], 0.0, STATED_MODEL, False, "would not show b"),
        ([shown("a", -1.0), shown("b", 4.0, 1.0, 1.0)], 0.0, STATED_MODEL, True, "none of 1 effects"),
        ([shown("a", -1.0), shown("b", 0.0, 0.0, 0.0, "no effect")], 0.0, STATED_MODEL, True, "none of 1 effects"),
        ([shown("a", -1.0, 1.0, NAMED - 0.1)], 0.0, STATED_MODEL, False, "even in the end"),
        ([], 0.0, STATED_MODEL, False, "even in the end"),
    ],
)
def test_the_data_suffice_by_the_criteria_of_discovery(found, secured, leader, is_decided, words):
    decision = decide_leader(tuple(found), secured)
    assert (decision.leader, decision.is_decided) == (leader, is_decided)
    assert words in decision.words


def test_the_runner_up_of_an_effect_is_the_stated_model_where_nothing_else_explains_more():
    decision = decide_leader((shown("a", 20.0), shown("b", -3.0)), 20.0)
    assert (decision.runner_up, decision.margin) == (STATED_MODEL, 20.0)


@pytest.mark.parametrize("z", [0.5, 2.0, 5.0])
def test_the_expected_factor_is_the_mean_over_repeated_measurements(z):
    """The estimate of a strength a with the prior N(0, a^2) is a + noise of a/z; evidences are normal densities."""
    x = np.random.default_rng(1).normal(1.0, 1.0 / z, 200_000)  # estimate over a
    with_effect, without = 1.0 + z**-2, z**-2  # variances of the estimate
    ln_bayes = -0.5 * (x**2 / with_effect + np.log(with_effect)) + 0.5 * (x**2 / without + np.log(without))
    error = 5.0 * np.std(ln_bayes) / np.sqrt(len(x))
    assert expected_ln_bayes(z) == pytest.approx(np.mean(ln_bayes), abs=error)
