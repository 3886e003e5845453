"""Stated inputs that explain the data as well as an effect, or better."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import pytest

from flashtemp.comparison import campaign
from flashtemp.comparison.synthetic_campaign import SEALED_TRUTH, SyntheticPlan, make_synthetic_campaign
from flashtemp.discovery import engine
from flashtemp.discovery.criteria import CRITERIA
from flashtemp.discovery.diagnostics.stated_inputs import list_stated_inputs
from flashtemp.discovery.input_alternatives import can_be_freed, free_input
from flashtemp.discovery.prediction.problem import prepare_problem
from flashtemp.discovery.selection.forward_selection import InputAlternative
from flashtemp.model.case import load_case

TINY = {
    "block.height": 0.005, "schedule.distance": 0.15, "schedule.repetitions": 1, "road.track_length": 0.15,
    "numerics.mesh": 0.8,
}  # fmt: skip


@pytest.fixture(scope="module")
def misstated(tmp_path_factory):
    """A campaign of one speed whose case states the friction 30 % too low."""
    folder = tmp_path_factory.mktemp("misstated")
    (folder / "case.toml").write_text("")
    plan = SyntheticPlan((), 13, conditions=1, sliding=3, views=("wake",))
    lab = make_synthetic_campaign(load_case(folder / "case.toml", TINY | {"friction.mu": 1.0}), plan, folder / "lab")
    for file, old, new in (("case.toml", "mu = 1.0", "mu = 0.7"), ("campaign.toml", '    "friction.mu",\n', "")):
        text = (lab / file).read_text()
        assert old in text
        (lab / file).write_text(text.replace(old, new, 1))
    return replace(campaign.load(lab), candidates=("friction_speed",))


def test_an_input_that_may_be_stated_wrongly_is_an_alternative_to_an_effect(misstated):
    """At one speed a law of the speed is nothing but another friction coefficient."""
    verdict, search = engine.discover(misstated, workers=1)
    assert verdict.kind == "group", verdict.says
    assert set(verdict.group) == {"friction_speed", "friction.mu"}
    assert verdict.says[0].startswith("Either an effect is missing or a stated input is wrong")
    [found] = search.input_alternatives
    assert found.is_key
    truth = json.loads((misstated.folder / SEALED_TRUTH).read_text())
    jitter = truth["recordings"]["condition1"]["friction_jitter"]
    assert found.value == pytest.approx(truth["nuisance"]["friction.mu"] * jitter, abs=4.0 * found.stderr)
    assert found.stderr < 0.1
    assert f"friction.mu is {found.value:.4g} +- " in verdict.says[0]
    assert "instead of 0.7" in verdict.says[0]
    assert (
        abs(found.deficit_against(search.best)) < 3.0
    )  # the same model with the same prior, but another starting point


def test_only_a_number_that_all_conditions_share_can_be_estimated(misstated):
    problem = prepare_problem(misstated, list)
    listed = {i.key: i for i in list_stated_inputs(problem)}
    can = {key: can_be_freed(problem, i) for key, i in listed.items()}
    assert can["friction.mu"]
    assert can["contact.spot_diameter"]
    assert not can["contact.pressure"]  # each condition states its own
    assert not can["schedule.distance"]  # other frames would be of sliding
    assert not can["ambient.temperature"]  # no ratio
    assert not can["wake.emissivity"]  # of the camera


def test_a_freed_input_stays_an_input(misstated):
    """It is estimated with its own prior, and still compared with its stated value."""
    problem = free_input(prepare_problem(misstated, list), "friction.mu", 0.1)
    assert problem.campaign.free[-1] == "friction.mu"
    assert problem.campaign.priors["friction.mu"] == 0.1
    assert "friction.mu" in {i.key for i in list_stated_inputs(problem)}


def test_an_input_in_place_of_two_effects_saves_the_price_of_one():
    accepted = SimpleNamespace(model=SimpleNamespace(effects={"a": {}, "b": {}}), ln_evidence=-100.0)
    alone = InputAlternative("friction.mu", frozenset(), -104.0, 0.1, True)
    beside = InputAlternative("friction.mu", frozenset("a"), -104.0, 0.1, True)
    assert alone.deficit_against(accepted) == 4.0 - CRITERIA.ln_bayes_named
    assert beside.deficit_against(accepted) == 4.0
    assert beside.cause_names == {"a", "friction.mu"}


@pytest.mark.parametrize(("deficit", "is_key", "freed"), [
    (-6.0, True, ["friction.mu"]), (-4.0, True, []), (-6.0, False, []), (6.0, True, []),
])  # fmt: skip
def test_the_selection_is_repeated_where_an_input_explains_clearly_more(monkeypatch, deficit, is_key, freed):
    """Clearly: by the ln Bayes factor that distinguishes causes."""
    best = SimpleNamespace(model=SimpleNamespace(effects={"a": {}}), ln_evidence=0.0)
    found = [(InputAlternative("friction.mu", frozenset(), -deficit, 0.1, is_key),), ()]
    calls = []
    monkeypatch.setattr(engine, "select_effects", lambda problem, *_: SearchStub(best, problem))
    monkeypatch.setattr(engine, "find_input_alternatives", lambda search, watch: found.pop(0))
    monkeypatch.setattr(engine, "free_input", lambda problem, key, sd: calls.append(key) or f"{problem} with {key}")
    monkeypatch.setattr(engine, "_predict_stated_model", lambda problem: [])
    monkeypatch.setattr(engine, "calibrate_base", lambda problem, first, watch: (problem, None, None))
    monkeypatch.setattr(engine, "replace", lambda search, **more: SearchStub(search.best, search.problem, **more))
    search = engine.select_with_inputs("problem", None, None, lambda text: None)
    assert calls == freed
    assert search.problem == ("problem with friction.mu" if freed else "problem")


class SearchStub(SimpleNamespace):
    def __init__(self, best, problem, **more):
        super().__init__(best=best, problem=problem, **more)
