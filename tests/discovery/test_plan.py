"""Before measuring: what planned views and conditions can tell apart, and which experiment would help."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from flashtemp.__main__ import main
from flashtemp.comparison import campaign
from flashtemp.comparison.synthetic_campaign import SyntheticPlan, make_synthetic_campaign
from flashtemp.discovery import experiment_design
from flashtemp.discovery.experiment_design import DETECTION_Z, ProposedExperiment, assess_design, suggest_experiment
from flashtemp.discovery.hypotheses.candidates import find_candidates
from flashtemp.discovery.parameters import ParameterId
from flashtemp.discovery.prediction.prediction import DerivativeRequest, predict_condition
from flashtemp.discovery.prediction.problem import Problem, prepare_problem
from flashtemp.discovery.selection.scores import Separability
from flashtemp.model.case import load_case
from flashtemp.physics.effect import catalogue
from flashtemp.runs.results.worker_pool import open_worker_pool

CASE = """
[block]
height = 0.005
[schedule]
distance = 0.75
repetitions = 2
[road]
track_length = 0.75
[numerics]
mesh = 0.3
rtol = 1e-3
"""
ALIKE = ("conductance_load", "conductance_speed")
OTHER = '{ "contact.pressure" = 7.5e4, "schedule.speed" = 0.3 }'


def planned(*conditions: str, views=("sidewall", "wake"), candidates=ALIKE) -> str:
    """A campaign without files."""
    free = '"friction.mu", "contact.spot_fraction", "ambient.convection"'
    head = "[[recording]]\ncamera = 'cooled'"  # with the drift of an uncooled one the second condition is not enough
    rows = [f"{head}\nview = '{view}'\nwith = {given}\n" for given in conditions for view in views]
    return "\n".join([f"free = [{free}]", f"candidates = {list(candidates)}", *rows])


@pytest.fixture
def written(tmp_path):
    """A folder with a planned campaign."""

    def write(text: str):
        (tmp_path / "case.toml").write_text(CASE)
        (tmp_path / "campaign.toml").write_text(text)
        return tmp_path

    return write


def outlook(told):
    with open_worker_pool(predict_condition, 1) as run:
        return assess_design(prepare_problem(told, run))


@pytest.fixture(scope="module")
def outlooks(tmp_path_factory):
    """One condition, and two that differ in load and speed."""
    out = []
    for conditions in (("{}",), ("{}", OTHER)):
        folder = tmp_path_factory.mktemp("plan")
        (folder / "case.toml").write_text(CASE)
        (folder / "campaign.toml").write_text(planned(*conditions))
        out.append(outlook(campaign.load(folder, planned=True)))
    return out


def by_name(found):
    return {p.effect: p for p in found.prospects}


def test_one_condition_cannot_tell_load_from_speed(outlooks):
    """Uniform pressure and one speed: both are a constant resistance, so their traces are parallel."""
    one = by_name(outlooks[0])
    for name, other in zip(ALIKE, ALIKE[::-1], strict=True):
        assert one[name].z > DETECTION_Z  # it is seen
        assert not one[name].is_separable
        assert (one[name].nearest, abs(one[name].rho)) == (other, pytest.approx(1.0, abs=1e-6))


def test_what_is_never_seen_is_like_nothing():
    rho = np.array([[1.0, -0.9, 0.0], [-0.9, 1.0, 0.0], [0.0, 0.0, 1.0]])
    three = Separability(("wear", "spots", "blur"), rho, np.array([3.0, 4.0, 0.0]))
    assert [three.nearest_rival(name) for name in three.names] == [("spots", -0.9), ("wear", -0.9), ("none", 0.0)]


def test_two_conditions_tell_them_apart(outlooks):
    one, two = map(by_name, outlooks)
    for name in ALIKE:
        assert two[name].is_separable
        assert abs(two[name].rho) < 0.99
        assert two[name].z_left > 3 * one[name].z_left


def test_numbers_hang_together(outlooks):
    for found in outlooks:
        np.testing.assert_allclose(np.diag(found.separability.rho), 1.0)
        np.testing.assert_allclose(found.separability.rho, found.separability.rho.T, atol=1e-9)
        for p in found.prospects:
            assert 0 <= p.z_left <= p.z * (1 + 1e-9)  # free rivals only take
            kind = catalogue()[p.effect].params()[p.parameter.split(".")[1]]
            assert p.detectable * p.z == pytest.approx(DETECTION_Z * abs(kind.value - kind.off), rel=1e-9)
            assert p.unit == kind.unit


def test_more_data_never_tell_less(outlooks):
    one, two = map(by_name, outlooks)
    for name in one:
        assert two[name].z > one[name].z * (1 - 1e-6)
        assert two[name].z_left > one[name].z_left * (1 - 1e-6)


def test_the_experiment_to_add_separates_what_one_condition_cannot(outlooks):
    """The advice of one condition names both effects, and a measurement with another load or speed."""
    first = outlooks[0].experiments[0]
    assert set(ALIKE) <= set(first.helps)
    assert min(first.z_left[e] for e in ALIKE) >= DETECTION_Z
    assert first.words.split()[-1] in ("speed", "pressure")
    scores = [(len(e.helps), min(e.z_left.values())) for e in outlooks[0].experiments]
    assert scores == sorted(scores, reverse=True)
    by_words = {e.words: e for e in outlooks[0].experiments}
    assert by_words["with the laboratory 20 K warmer"].helps == ()  # changes neither load nor speed


@pytest.mark.long
def test_an_experiment_is_found_where_a_trace_failed(written, monkeypatch):
    """What the data at hand cannot trace counts as unseen; the next experiment may show it."""
    whole, asked = experiment_design._remaining_z, []

    def without(problem, fit, effects):
        left = whole(problem, fit, effects)
        if asked:  # first all effects are weighed, then the experiments
            left.pop(ALIKE[0], None)
        asked.append(effects)
        return left

    monkeypatch.setattr(experiment_design, "_remaining_z", without)
    found = outlook(campaign.load(written(planned("{}")), planned=True)).experiments
    assert found
    assert all(ALIKE[0] not in e.z_left and ALIKE[0] not in e.helps for e in found)


def test_the_advice_comes_true(outlooks, tmp_path_factory):
    """Planning the advised condition beside the first gives about the signal to noise that was promised."""
    best = outlooks[0].experiments[0]
    folder = tmp_path_factory.mktemp("advised")
    (folder / "case.toml").write_text(CASE)
    rows = ", ".join(f'"{k}" = {v}' for k, v in best.given.items())
    (folder / "campaign.toml").write_text(planned("{}", f"{{ {rows} }}"))
    found = by_name(outlook(campaign.load(folder, planned=True)))
    for name in ALIKE:
        assert found[name].is_separable
        assert found[name].z_left == pytest.approx(best.z_left[name], rel=0.35)


MEMBERS = ("interface_resistance", "heat_depth", "conductance_load")


@pytest.fixture
def suggest(monkeypatch):
    """z of each member -> the suggestion for a group, and the candidates that compete; `wear` is certain."""

    def suggest_with(*z):
        case = load_case(Path(__file__).parents[2] / "cases" / "uniform_pressure" / "case.toml")
        some = find_candidates(case, (*MEMBERS, "wear", "radiation"))[0]
        asked = []

        def rank(problem, fit, effects):
            asked.extend(problem.candidates)
            return (ProposedExperiment("at half the pressure", {}, dict(zip(effects, z, strict=True)), ()),)

        monkeypatch.setattr(experiment_design, "rank_experiments", rank)
        problem = Problem(None, (), (), tuple(some), {}, None, case)
        fit = SimpleNamespace(model=SimpleNamespace(effects={"wear": {}, MEMBERS[0]: {}}))
        return suggest_experiment(problem, fit, MEMBERS, {MEMBERS[1]: 3e-4}), asked

    return suggest_with


def test_only_effects_that_the_data_allow_compete_with_the_strengths_that_they_need(suggest):
    """A rejected effect may not hide what tells two others apart."""
    asked = {c.effect: c for c in suggest(4.0, 5.0, 6.0)[1]}
    assert set(asked) == {*MEMBERS, "wear"}
    assert asked[MEMBERS[1]].leading_strength[1] == 3e-4


def test_no_experiment_is_suggested_that_would_tell_nothing(suggest):
    suggested = suggest(4.0, 5.0, 6.0)[0]
    assert suggested.startswith("measure one more condition at half the pressure")
    assert suggested.endswith(f"tell {' and '.join(MEMBERS)} apart by 4 sigma")
    useless = suggest(0.1, 0.3, 0.2)[0]
    assert "measure one more condition" not in useless
    assert "none of the conditions that were tried would do (at half the pressure)" in useless
    assert "at most 0.3 sigma" in useless


def test_an_experiment_that_tells_one_of_three_apart_is_suggested_as_such(suggest):
    first, *rest = MEMBERS
    assert suggest(4.0, 0.2, 0.2)[0].endswith(
        f"it would tell {first} apart from {' and '.join(rest)} by 4 sigma, but not these from each other"
    )


@pytest.mark.long
def test_what_is_measured_already_can_be_planned_on(tmp_path):
    """Recordings as files: nothing of their values matters but the noise that they tell."""
    (tmp_path / "case.toml").write_text(CASE)
    out = make_synthetic_campaign(
        load_case(tmp_path / "case.toml"), SyntheticPlan((), 3, 1, ("sidewall",), 2), tmp_path / "lab"
    )
    told = replace(campaign.load(out), candidates=("heat_depth", "pressure_tilt"))
    [view] = told.views
    warm = replace(view, recording=replace(view.recording, temperature=view.recording.temperature + 3.0))
    first, second = (by_name(outlook(replace(told, views=(v,)))) for v in (view, warm))
    for name, p in first.items():
        assert p.z == pytest.approx(second[name].z, rel=1e-9)
    loud = replace(view, sigma_K=10 * view.sigma_K)
    third = by_name(outlook(replace(told, views=(loud,))))
    assert third["pressure_tilt"].z < 0.7 * first["pressure_tilt"].z  # not a tenth: nuisances limit it


@pytest.mark.long
def test_the_command_writes_numbers_and_a_picture(written, tmp_path, capsys):
    folder, out = written(planned("{}", views=("profile",))), tmp_path / "out"
    assert main(["plan", str(folder), "--out", str(out), "--workers", "1"]) == 0
    text = capsys.readouterr().out
    assert "effects can be distinguished from all others" in text
    assert sorted(p.name for p in out.iterdir()) == ["plan.json", "report.html", "separability.png"]
    assert (out / "separability.png").read_bytes().startswith(b"\x89PNG")
    found = json.loads((out / "plan.json").read_text())
    assert {e["effect"] for e in found["effects"]} == set(ALIKE)
    for e in found["effects"]:
        assert isinstance(e["separable"], bool)
        assert e["effect"] in text
    n = len(found["separability"]["effects"])
    assert np.shape(found["separability"]["rho"]) == (n, n)
    assert found["experiments"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (planned("{}", views=("sidewal",)), ("campaign.toml", "view: 'sidewal'", "sidewall, wake, profile")),
        (planned("{}", candidates=("pressure_tillt",)), ("pressure_tillt", "did you mean 'pressure_tilt'")),
        (planned('{ "contact.presure" = 1.0 }', views=("wake",)), ("contact.presure", "did you mean")),
        ("", ("no [[recording]]",)),
    ],
)
def test_bad_plans_are_told_in_one_line(written, capsys, text, said):
    assert main(["plan", str(written(text))]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    for part in said:
        assert part in lines[0]


def test_what_is_only_planned_cannot_be_discovered(written, tmp_path, capsys):
    """`discover` needs files; nothing is written."""
    assert main(["discover", str(written(planned("{}"))), "--out", str(tmp_path / "out")]) == 2
    assert "flashtemp plan" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


FAST = """
[block]
height = 0.005
[schedule]
speed = 3.0
distance = 0.5
[road]
material = "stone"
[materials.stone]
conductivity = 2.0
density = 2300.0
heat_capacity = 950.0
[numerics]
mesh = 0.4
"""


def test_a_key_that_the_default_mesh_follows_may_move(tmp_path):
    """Above 1 m/s the first cell of the road follows speed and diffusivity; a condition keeps its mesh all the same."""
    key = "materials.stone.conductivity"
    text = planned("{}", '{ "schedule.speed" = 9.0 }', views=("sidewall",)).replace("friction.mu", key)
    (tmp_path / "case.toml").write_text(FAST)
    (tmp_path / "campaign.toml").write_text(text)
    with open_worker_pool(predict_condition, 1) as run:
        problem = prepare_problem(campaign.load(tmp_path, planned=True), run)
        slow, fast = problem.make_tasks(problem.stated_model, DerivativeRequest(model_parameters=problem.free_keys))
        for task in (slow, fast):
            base = task.case.with_values(task.given | task.mesh_overrides)
            moved = problem.stated_model.with_step(ParameterId.of_key(key), 0.1).apply_to(base)
            np.testing.assert_array_equal(moved.scene.mesh.depth, base.scene.mesh.depth)
        [shown] = problem.predict([fast])
    [seen] = shown.observables.values()
    assert np.abs(seen.columns[ParameterId.of_key(key)]).max() > 0.1
