"""benchmarks/criteria_replay.py: stored evidence gives its verdict again, and what half and double of a criterion change."""

from __future__ import annotations

from dataclasses import fields, replace
from types import SimpleNamespace

import numpy as np
import pytest

from flashtemp.discovery.criteria import CRITERIA, Criteria
from flashtemp.discovery.decision import EffectSize
from flashtemp.discovery.diagnostics.setup_errors import ReducedFit
from flashtemp.discovery.estimation.linearised_fit import FitStatus
from flashtemp.discovery.estimation.nuisance_priors import NUISANCE_SD
from flashtemp.discovery.parameters import ParameterId, ParameterKind

TESTS = ("amplitude", "heat of", "pressure of", "calibrated", "camera and", "noise left")
LARGE = EffectSize(rise_fraction=0.05, change_K=0.1)
LENGTH = ParameterId(ParameterKind.SIZE, name="block.length")


@pytest.fixture
def search(discovery_benchmark):
    """A maker of stored searches."""
    s = discovery_benchmark.stored

    def fit(*effects, gain=0.0, probability=1.0, size=LARGE, chi2=100.0, misfit=0.0, away=None, setup=None):
        free = {ParameterId.of_effect(e, "a"): (0.0, 1.0) for e in effects}
        return s.StoredFit(
            model=s.StoredModel(dict.fromkeys(effects)), status=FitStatus.CONVERGED, ln_evidence=-50.0 + gain, promise=0.0,
            chi2=chi2, count=100, effect_priors=free, bound=frozenset(),
            largest={frozenset(): -50.0, frozenset(free): -50.0 + gain},
            probabilities={e: ((probability,), (probability,)) for e in effects},
            adequacy=dict.fromkeys(TESTS, 0.0) | (away or {}), misfits=((100.0 * (1.0 + misfit), 100),),
            heldout=(0.1 * gain, 0.1 * gain), is_held_out=False, size=size if effects else None,
            setup=setup or s.StoredSetup(None, None, {}),
        )  # fmt: skip

    def made(*fits, scores=None, kind="single", **more):
        base = fit(setup=more.pop("setup", None))
        scores = scores or [(e, f.ln_evidence + 50.0) for f in fits for e in f.model.effects]
        ranked = tuple(s.StoredScore(e, gain) for e, gain in sorted(scores, key=lambda x: -x[1]))
        truth = {"name": "made", "kind": kind, "hidden": {"wear": {"a": 1.0}} if kind == "single" else {}, "setup": {}}
        record = truth | {"verdict": "named", "effects": ["wear"], "inputs": [], "group": []} | more.pop("record", {})
        return s.StoredSearch(
            record=record, base=frozenset(), fits={frozenset(f.model.effects): f for f in (base, *fits)},
            rankings=(ranked,), pair=None, unfitted={}, inputs=(), recording_errors=(), recordings={}, **more,
        )  # fmt: skip

    return SimpleNamespace(made=made, fit=fit)


def replayed(discovery_benchmark, search, **values):
    """Kind and effects of a verdict with other criteria."""
    with discovery_benchmark.stored.criteria_changed(**values):
        found = discovery_benchmark.replay.replay(search)
    return found.record["verdict"], found.record["effects"]


def test_criteria_are_changed_for_a_while_in_all_of_discovery(discovery_benchmark):
    from flashtemp.discovery import engine

    before = CRITERIA.ln_bayes_named
    with discovery_benchmark.stored.criteria_changed(ln_bayes_named=3.0):
        assert engine.CRITERIA.ln_bayes_named == 3.0
    assert before == CRITERIA.ln_bayes_named == Criteria().ln_bayes_named


def test_a_cause_is_named_weak_or_none_as_the_criterion_has_it(discovery_benchmark, search):
    stored = search.made(search.fit("wear", gain=12.0))
    assert replayed(discovery_benchmark, stored) == ("named", ["wear"])
    assert replayed(discovery_benchmark, stored, ln_bayes_named=16.0) == ("weak", ["wear"])
    assert replayed(discovery_benchmark, stored, ln_bayes_named=16.0, ln_bayes_hint=15.0) == ("none_needed", [])


@pytest.mark.parametrize(
    ("criterion", "value", "kind"),
    [
        ("visible_fraction", 0.1, "weak"),
        ("heldout_against", 3.0, "weak"),
        ("noise_sd_uncertainty", 0.01, "unexplained"),
        ("ln_bayes_unnamed_heat", 1.0, "unexplained"),
        ("pressure_modes_chi2", 1.0, "unexplained"),
        ("pull_adequate", 1.0, "unexplained"),
        ("pull_nuisance", 1.0, "unexplained"),
        ("condition_scatter", 0.5, "unexplained"),
        ("max_causes", 0.0, "none_needed"),
    ],
)
def test_every_criterion_of_a_cause_acts_in_a_replay(discovery_benchmark, search, criterion, value, kind):
    away = dict.fromkeys(TESTS[1:5], 2.0) | {TESTS[0]: 1.0}
    stored = search.made(search.fit("wear", gain=12.0, probability=0.1, misfit=0.2, away=away))
    with discovery_benchmark.stored.criteria_changed(adequacy_standard_errors=1.0):
        assert replayed(discovery_benchmark, stored)[0] == "named"
        assert replayed(discovery_benchmark, stored, **{criterion: value})[0] == kind


def test_a_hint_that_is_too_small_is_none(discovery_benchmark, search):
    stored = search.made(search.fit("wear", gain=7.0, size=EffectSize(4e-3, change_K=0.1)))
    assert replayed(discovery_benchmark, stored)[0] == "weak"
    assert replayed(discovery_benchmark, stored, hint_fraction=6e-3)[0] == "none_needed"


def test_an_alternative_is_told_apart_or_not(discovery_benchmark, search):
    stored = search.made(search.fit("wear", gain=12.0), search.fit("blur", gain=5.5))
    assert replayed(discovery_benchmark, stored)[0] == "named"
    assert replayed(discovery_benchmark, stored, ln_bayes_distinct=10.0)[0] == "group"


def test_errors_of_the_setup_are_judged_anew(discovery_benchmark, search):
    """A length that is off by three of its usual sizes, and by six to seven of its standard errors."""
    usual = NUISANCE_SD[ParameterKind.SIZE]
    found = ReducedFit((LENGTH,), np.array([15.0 / usual]), np.array([[4.0 / usual**2]]), np.array([usual]))
    stored = search.made(setup=discovery_benchmark.stored.StoredSetup(found, found, {}), kind="null")
    assert discovery_benchmark.replay.replay(stored).record["inputs"] == ["block_length"]
    with discovery_benchmark.stored.criteria_changed(setup_standard_errors=8.0):
        assert discovery_benchmark.replay.replay(stored).record["verdict"] == "none_needed"
    with discovery_benchmark.stored.criteria_changed(ln_bayes_named=100.0):
        assert discovery_benchmark.replay.replay(stored).record["inputs"] == []
    with discovery_benchmark.stored.criteria_changed(pull_setup=4.0):
        assert discovery_benchmark.replay.replay(stored).record["inputs"] == []


@pytest.mark.parametrize(("limit", "kind"), [(0.5, "learned"), (0.25, "unexplained")])
def test_a_law_is_learned_while_it_leaves_less_than_the_criterion(discovery_benchmark, search, limit, kind):
    law = discovery_benchmark.stored.StoredLaw(search.fit("learned_law", gain=90.0), 90.0, 0.0, 3.0, (200.0, 80.0))
    bad = search.fit("wear", gain=12.0, misfit=2.0)
    stored = search.made(bad, law=law, law_was_tried=True)
    assert replayed(discovery_benchmark, stored, law_excess_left=limit)[0] == kind


def test_fits_that_nobody_made_are_counted(discovery_benchmark, search):
    scores = [("wear", 40.0), ("blur", 18.0), ("lag", 9.0), ("gap", 7.0)]
    made = [search.fit("wear", gain=40.0), search.fit("blur", gain=2.0), search.fit("lag", gain=1.0)]
    report = discovery_benchmark.replay.replay_all([search.made(*made, scores=scores)])["criteria"]
    assert report["shortlist"]["fits"] == {"half": [0, 1], "double": [1, 0]}
    assert report["shortlist"]["not_fitted"] == {"half": 0, "double": 1}
    assert report["shortlist"]["decides"] == "cost"


def test_a_criterion_that_changes_nothing_shows_as_such(discovery_benchmark, search):
    stored = [search.made(search.fit("wear", gain=g)) for g in (12.0, 90.0)]
    report = discovery_benchmark.replay.replay_all(stored)["criteria"]
    assert list(report) == [f.name for f in fields(Criteria)]
    assert report["ln_bayes_named"]["decides"] == "verdicts"
    assert report["ln_bayes_named"]["double"] == {"right": -1, "weak": 1}
    assert report["pull_nuisance"]["decides"] == "nothing"
    assert all(row["campaigns"] == 2 for row in report.values())


def test_a_replay_that_is_not_the_stored_verdict_is_reported(discovery_benchmark, search, tmp_path):
    good = search.made(search.fit("wear", gain=12.0))
    bad = replace(good, record=good.record | {"verdict": "weak"})
    discovery_benchmark.stored.write_evidence(bad, tmp_path / "bad.pkl.xz")
    [line] = discovery_benchmark.replay.list_not_reproduced(
        [good, discovery_benchmark.stored.read_evidence(tmp_path / "bad.pkl.xz")]
    )
    assert "weak wear" in line
    assert "replayed named wear" in line


def test_reports_of_two_sets_add_up_to_that_of_both(discovery_benchmark, search):
    scores = [("wear", 40.0), ("blur", 18.0), ("lag", 6.0)]
    fits = search.fit("wear", gain=40.0), search.fit("blur", gain=2.0)
    sets = [
        search.made(*(search.fit("wear", gain=g) for g in [gain]), record={"name": f"gain {gain:g}"})
        for gain in (12.0, 90.0)
    ] + [search.made(*fits, scores=scores, record={"name": "three"})]
    replay = discovery_benchmark.replay
    parts = [replay.replay_all(sets[:1]), replay.replay_all(sets[1:])]
    assert replay.add_reports(*parts) == replay.replay_all(sets)
    with pytest.raises(ValueError, match="gain 12: in the report already"):
        replay.add_reports(parts[0], parts[0])
    with discovery_benchmark.stored.criteria_changed(ln_bayes_named=9.0):
        other = replay.replay_all(sets[1:])
    with pytest.raises(ValueError, match="ln_bayes_named: had other values"):
        replay.add_reports(parts[0], other)
