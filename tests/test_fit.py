"""Calibration of small synthetic campaigns: certificate, what was drawn, far starts, and bounds of effects."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from flashtemp.comparison import campaign
from flashtemp.comparison.twin import SEALED, Plan, twin
from flashtemp.discovery.calibration import ENOUGH, Descent, descend, extra
from flashtemp.discovery.hypothesis import Model
from flashtemp.discovery.prediction import look
from flashtemp.discovery.problem import Data, prepare
from flashtemp.discovery.search import Search
from flashtemp.model.case import load
from flashtemp.physics.effect import find
from flashtemp.runs.workers import crew

KNOWN_WELL = ("friction.mu", "contact.spot_fraction")  # what shows clearly in a few seconds of sliding
SMALL = {
    "block.height": 0.005, "schedule.distance": 0.3, "numerics.mesh": 0.4, "numerics.rtol": 1e-4, "output.profiles": 20,
}  # fmt: skip
FAR = {"friction.mu": 0.25, "contact.spot_fraction": -0.25, "ambient.convection": 0.6}  # 2 to 2.5 prior sd away


@pytest.fixture(scope="module")
def campaigns(tmp_path_factory):
    """A campaign calibrated: `hidden` effects in the truth, `believed` line of the case that is held to it."""

    def make(seed, hidden=(), believed=None, free=None, **plan):
        folder = tmp_path_factory.mktemp("fit")
        (folder / "case.toml").write_text("")
        settings = {"conditions": 1, "views": ("sidewall",), "sliding": 3, "nuisance": 0.5} | plan
        out = twin(load(folder / "case.toml", SMALL), Plan(tuple(hidden), seed, **settings), folder / "lab")
        if believed:
            rows = (out / "case.toml").read_text().splitlines()
            [at] = [i for i, row in enumerate(rows) if row.split(" = ")[0] == believed.split(" = ")[0]]
            rows[at] = believed
            (out / "case.toml").write_text("\n".join(rows))
        told = campaign.load(out)
        with crew(look, 1) as run:
            study = prepare(replace(told, free=free or told.free), run)
            search = Search(study, Data(study), lambda text: None)
            search.calibrate()
        return SimpleNamespace(study=study, search=search, truth=json.loads((out / SEALED).read_text()))

    return make


@pytest.fixture(scope="module")
def two(campaigns):
    """Two conditions, nothing hidden."""
    return campaigns(4, conditions=2, sliding=2)


def value(fit, key):
    """ln of the factor on a free key, last step included."""
    return fit.model.free[key] + fit.solution[key]


def candidate(made, name):
    [found] = (c for c in made.study.tried if c.effect == name)
    return found


def fitted(made, name, start):
    """Full fit of an effect from a start; every value that was looked at on the way."""
    c, seen = candidate(made, name), []

    class Watched(Descent):
        def take(self, looks):
            seen.append(dict(self.model.effects[name]))
            super().take(looks)

    model = made.search.base.model.with_effect(name, c.off() | start)
    descent = Watched(made.study, made.search.data, model, dict(made.search.base.shifts), extra([c]))
    descend(made.study, [descent])
    assert descent.failed == ""
    return descent, [*seen, descent.model.effects[name]]


# --- calibration -------------------------------------------------------------------------------------
def test_calibration_ends_with_its_certificate(two):
    fit = two.search.base
    assert fit.converged
    assert fit.history[-1] < ENOUGH
    assert fit.history[0] > 10 * ENOUGH
    assert fit.model.effects == {}
    assert len(fit.blocks) == 4
    for key in two.study.campaign.free:
        assert abs(fit.solution[key]) < ENOUGH * two.study.priors[key]


def test_what_was_drawn_is_found_again(two):
    """Within four standard errors; friction with its jitter from condition to condition."""
    fit = two.search.base
    for key, factor in two.truth["nuisance"].items():
        assert abs(value(fit, key) - np.log(factor)) < 4 * fit.solution.sd(key), key
        assert 0 < fit.solution.sd(key) < two.study.priors[key]
    for number, own in enumerate(two.truth["recordings"].values()):
        level = value(fit, "friction.mu") + fit.solution[f"level|{number}"]
        drawn = np.log(two.truth["nuisance"]["friction.mu"] * own["friction_jitter"])
        assert level == pytest.approx(drawn, abs=0.01)
    assert fit.solution.chi2 == pytest.approx(fit.solution.count, abs=5 * np.sqrt(2 * fit.solution.count))


def test_predictions_at_the_best_point_leave_noise(two):
    """Each recording by itself, with what its own nuisances explain."""
    from flashtemp.discovery.linear_gaussian import residual

    for block in two.search.base.blocks:
        left = residual(block, two.search.base.solution)
        assert np.mean(left**2) == pytest.approx(1.0, abs=5 * np.sqrt(2 / block.count)), block.label


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_far_start_ends_at_the_same_place(two, sign):
    best = two.search.base
    start = Model({k: sign * v for k, v in FAR.items()})
    descent = Descent(two.study, two.search.data, start, {})
    descend(two.study, [descent])
    assert descent.failed == ""
    assert descent.fit.history[0] > 1.0
    for key in FAR:
        assert abs(value(descent.fit, key) - value(best, key)) < 0.05 * two.study.priors[key], key
    assert descent.fit.ln_evidence == pytest.approx(best.ln_evidence, abs=0.1)


def test_steps_shrink_until_the_certificate(campaigns):
    """Gauss-Newton close to its end: a few looks, not a walk."""
    fit = campaigns(1).search.base
    assert fit.converged
    assert len(fit.history) <= 5


def test_several_descents_share_their_rounds(two):
    """Side by side they take the steps that each takes alone; one that is far behind goes no further."""
    best = two.search.base
    rounds = []
    pair = [Descent(two.study, two.search.data, Model(dict(m)), dict(best.shifts)) for m in (best.model.free, FAR)]
    descend(two.study, pair, rounds.append, hopeless=-1e9)
    assert pair[0].fit.converged
    assert len(pair[0].history) == 1  # it stands where it should
    assert pair[1].failed == "far behind the best"
    assert len(pair[1].history) == len(rounds) == 3


# --- effects -----------------------------------------------------------------------------------------
def inside(name, seen):
    for values in seen:
        for k, v in values.items():
            param = find(name).params()[k]
            assert param.low <= v <= param.high, (name, k, v)


@pytest.fixture(scope="module")
def resistive(campaigns):
    """A film resists in the truth, and nobody knows."""
    return campaigns(5, hidden=("interface_resistance",), free=KNOWN_WELL)


def test_a_hidden_strength_is_found(resistive):
    base = resistive.search.base
    truth = resistive.truth["hidden"]["interface_resistance"]["resistance"]
    found = []
    for start in (2e-6, 2e-4):
        descent, seen = fitted(resistive, "interface_resistance", {"resistance": start})
        inside("interface_resistance", seen)
        assert descent.fit.converged
        fit, name = descent.fit, "interface_resistance.resistance"
        assert not fit.bound
        assert fit.ln_evidence > base.ln_evidence + 8.0
        found.append(fit.model.effects["interface_resistance"]["resistance"] + fit.solution[name])
        assert abs(found[-1] - truth) < 4 * fit.solution.sd(name)
    assert found[0] == pytest.approx(found[1], abs=0.05 * 2e-5)


@pytest.fixture(scope="module")
def perfect(campaigns):
    """The case believes in a resistance that the truth has not: an additional one would have to be negative."""
    return campaigns(6, believed="alpha = 100000.0", free=KNOWN_WELL)


@pytest.mark.parametrize("start", [1e-6, 1e-4])
def test_a_strength_that_ought_to_be_negative_ends_at_off(perfect, start):
    name = "interface_resistance"
    descent, seen = fitted(perfect, name, {"resistance": start})
    inside(name, seen)
    assert descent.fit.model.effects[name]["resistance"] == 0.0
    assert descent.fit.bound == {f"{name}.resistance"}
    assert f"{name}.resistance" not in descent.fit.solution.names
    assert descent.fit.converged
    assert descent.fit.ln_evidence == pytest.approx(perfect.search.base.ln_evidence, abs=0.5)


def test_a_shape_stays_within_its_bounds(resistive):
    """Share and depth of heat released in the rubber: neither acts in this truth."""
    descent, seen = fitted(resistive, "heat_depth", {"share": 0.9, "depth": 4e-3})
    inside("heat_depth", seen)
    assert len(seen) == len(descent.history) + 1
