"""Laws outside the catalogue in friction that is stated in closed form: found with their argument, or not learned."""

from __future__ import annotations

from dataclasses import replace
from functools import cache, partial
from types import SimpleNamespace

import numpy as np
import pytest

from flashtemp.comparison import campaign
from flashtemp.discovery import engine, law_identification
from flashtemp.discovery.criteria import CRITERIA
from flashtemp.discovery.diagnostics.cross_validation import cross_validate, heldout_excess, without_flexible_terms
from flashtemp.discovery.estimation.linear_gaussian import LinearSystem
from flashtemp.discovery.hypotheses.piecewise_linear_law import LEARNED_LAW_NAME
from flashtemp.discovery.law_identification import (
    CURVE_POINTS,
    FittedLaw,
    IdentifiedLaw,
    ScoredLaw,
    identify_law,
    list_possible_laws,
    ln_choice_odds,
    node_covariance,
    shortlist_laws,
)
from flashtemp.discovery.prediction.prediction import predict_condition
from flashtemp.discovery.prediction.problem import prepare_problem
from flashtemp.discovery.selection.forward_selection import select_effects

DISTANCE, WAIT, SIGMA = 0.2, 1.0, 0.005  # m, s, and the noise of the load cell
SPEEDS, READINGS = (0.1, 0.3), 120  # m/s, one condition each, and the readings of each
ARGUMENTS = {"temperature", "passed", "time"}  # of friction that are tried: more cost more
RUN_IN, FALL = 0.1, 0.3  # m and 1: friction falls as 1 + FALL exp(-distance / RUN_IN)
CASE = f"""
[block]
length = 0.025
[contact]
pressure = 1e5
[friction]
mu = 1.0
[schedule]
distance = {DISTANCE}
repetitions = 2
wait = {WAIT}
[road]
track_length = {DISTANCE}
[numerics]
mesh = 0.2
across = 1
"""


def write_campaign(folder, friction):
    """Load-cell traces of two speeds: `friction` (number of the condition, m slid in the whole test) -> mu."""
    (folder / "case.toml").write_text(CASE)
    lines = ['title = "closed form"', 'case = "case.toml"', 'free = ["friction.mu"]', "candidates = []"]
    rng = np.random.default_rng(3)
    for n, speed in enumerate(SPEEDS):
        once = np.linspace(0.02, 0.98, READINGS // 2) * DISTANCE
        slid = np.concatenate([once, once + DISTANCE])
        time = slid / speed + np.repeat([0.0, WAIT], len(once))
        table = np.column_stack([time, friction(n, slid) + SIGMA * rng.normal(size=READINGS)])
        np.savetxt(folder / f"mu{n}.csv", table, delimiter=",", header="time_s,mu", comments="", fmt="%.8g")
        lines += ["[[force]]", f'file = "mu{n}.csv"', f"sigma = {SIGMA}", f'with = {{ "schedule.speed" = {speed} }}']
    (folder / "campaign.toml").write_text("\n".join(lines) + "\n")
    return campaign.load(folder)


def run_in(n, slid):
    return 1.0 + FALL * np.exp(-slid / RUN_IN)


def constant(n, slid):
    return np.ones_like(slid)


def opposite(n, slid):
    """What falls at one speed and rises at the other: no law of one argument alone, and none that predicts."""
    return 1.0 + (-1) ** n * FALL * np.exp(-slid / RUN_IN)


def quiet(text):
    """Progress that nobody reads."""


@pytest.fixture(scope="module")
def identified(tmp_path_factory):
    """friction -> search, laws that were tried (a few: more cost more) and the identified one."""

    @cache
    def made(friction):
        problem = prepare_problem(
            write_campaign(tmp_path_factory.mktemp("law"), friction), lambda ts: [predict_condition(t) for t in ts]
        )
        problem, _, first = engine.correct_measurements(problem, quiet)
        search = select_effects(*engine.calibrate_base(problem, first, quiet), quiet)
        with pytest.MonkeyPatch.context() as patch:
            some = [
                w for w in list_possible_laws(search) if w.quantity.name == "friction" and w.regressor.name in ARGUMENTS
            ]
            patch.setattr(law_identification, "list_possible_laws", lambda search: some)
            return search, some, identify_law(search, quiet)

    return made


def test_a_law_outside_the_catalogue_is_found_with_its_argument(identified):
    _, laws, found = identified(run_in)
    assert {law.regressor.name for law in laws} == ARGUMENTS
    assert (found.law.quantity.name, found.law.regressor.name) == ("friction", "passed")
    assert found.alternatives == {}  # two speeds and a wait tell it from time
    assert found.ln_bayes > CRITERIA.ln_bayes_named


def test_the_curve_of_a_law_is_the_hidden_one(identified):
    """Only the shape counts: the mean friction is free.  Between two nodes a line errs by h^2 |f''| / 8 at most."""
    found = identified(run_in)[2]
    nodes, at = np.array(found.law.nodes), np.linspace(*found.law.domain, CURVE_POINTS)
    curve, true = found.law.hat_functions(at) @ np.array(found.law.values), np.log(run_in(0, at))
    steps = np.diff(nodes)
    bend = FALL * np.exp(-nodes[:-1] / RUN_IN) / RUN_IN**2  # f'' of ln(1 + y) with y = FALL exp(..): less than y''
    bound = np.max(steps**2 * bend) / 8.0 + 4.0 * SIGMA / np.sqrt(len(SPEEDS) * READINGS / len(nodes))
    assert np.max(np.abs((curve - curve.mean()) - (true - true.mean()))) < bound


def test_nodes_have_normal_priors_of_the_width_that_evidence_chose(identified):
    found = identified(run_in)[2]
    [nodes] = [c for c in found.search.problem.candidates if c.effect == LEARNED_LAW_NAME]
    far = {k: 100.0 * a for k, a in nodes.strengths.items()}
    assert nodes.parameter_priors(far) == nodes.parameter_priors()
    assert found.search.best.width_price == 0.0
    heavy = replace(nodes, has_heavy_tails=True).parameter_priors(far)
    assert all(heavy[p][1] > 50.0 * sd for p, (_, sd) in nodes.parameter_priors().items())


def excess_of(search):
    return heldout_excess(search.data, search.base, search.best)


def test_a_law_halves_the_misfit_of_left_out_data(identified):
    before, after = excess_of(identified(run_in)[2].search)
    assert after < 0.5 * before


def test_noise_that_is_stated_too_small_is_no_misfit_of_left_out_data(identified):
    """All residuals 10 % larger: chi2 has an excess over the number of data that no law can remove."""
    search = identified(run_in)[2].search
    louder = [replace(f, system=LinearSystem([b.with_residual(1.1 * b.r) for b in f.blocks]))
              for f in (search.base, search.best)]  # fmt: skip
    before, after = excess_of(replace(search, base=louder[0], best=louder[1]))
    counted = sum(b.count for b in search.base.blocks)
    assert cross_validate(search.data, louder[1]).chi2 - counted > 0.1 * counted
    assert (before, after) == pytest.approx(tuple(1.21 * e for e in excess_of(search)), rel=0.1, abs=5.0)
    assert after < 0.1 * before


def test_left_out_friction_is_not_fitted_away(identified):
    """A jump of friction in one condition is 5 of its prior standard deviations of 0.02: at most 3 may be fitted."""
    search, jump = identified(constant)[0], 0.1
    others, last = search.base.blocks[:-1], search.base.blocks[-1]
    moved = replace(search.base, system=LinearSystem([*others, last.with_residual(last.r + jump / SIGMA)]))
    left_out = cross_validate(search.data, without_flexible_terms(moved)).residuals[-last.count :]
    assert np.mean(left_out) == pytest.approx((jump - 3.0 * 0.02) / SIGMA, rel=0.1)


@pytest.mark.parametrize(("left", "kind"), [(0.4, "learned"), pytest.param(0.6, "unexplained", marks=pytest.mark.long)])
def test_a_law_is_learned_only_if_it_halves_the_misfit_of_left_out_data(identified, monkeypatch, left, kind):
    found = identified(run_in)[2]
    monkeypatch.setattr(engine, "excess_left", lambda search: left)
    judged = engine.judge_search(found.search, quiet, found)
    assert judged.kind == kind
    assert [c.effect for c in judged.causes] == [LEARNED_LAW_NAME]


def test_no_law_is_identified_where_nothing_is_hidden(identified):
    search, laws, found = identified(constant)
    assert len(laws) == len(ARGUMENTS)
    assert found is None
    assert search.base.chi2 == pytest.approx(
        search.base.solution.count, abs=4.0 * np.sqrt(2.0 * len(SPEEDS) * READINGS)
    )


@pytest.mark.long  # `decide` itself is tested with every change
def test_a_law_that_does_not_predict_is_not_learned_however_much_it_explains(identified):
    """Every law is wrong for one of the two speeds; the best gains a lot on the data that it has seen."""
    found = identified(opposite)[2]
    assert found.ln_bayes > CRITERIA.ln_bayes_named
    before, after = excess_of(found.search)
    assert after > CRITERIA.law_excess_left * before
    assert engine.judge_search(found.search, quiet, found).kind == "unexplained"


# --- which laws are fitted --------------------------------------------------------------------------------------
scored = partial(ScoredLaw, None, 1.0)


def test_a_law_must_be_worth_its_choice_among_all_that_are_scored():
    """ln Bayes factor that names a cause, and the prior odds against one of n laws beyond it (ln n)."""
    least = CRITERIA.ln_bayes_named + np.log(50.0)
    few = [scored(least + 0.1, ()), *[scored(0.0, ())] * 49]
    assert ln_choice_odds(few) == pytest.approx(np.log(50.0))
    assert shortlist_laws(few) == few[:1]
    assert shortlist_laws([scored(least - 0.1, ()), *few[1:]]) == []


def test_laws_far_behind_the_best_are_not_fitted():
    """A full fit gains at most twice its score, and one that is 30 behind is stopped."""
    strong, weak = ([scored(g, ()) for g in (*some, *[0.0] * 30)] for some in ((400.0, 190.0, 180.0), (30.0, 15.0)))
    assert [s.ln_bayes for s in shortlist_laws(strong)] == [400.0, 190.0]
    assert [s.ln_bayes for s in shortlist_laws(weak)] == [30.0, 15.0]


def test_laws_that_cannot_reach_the_catalogue_are_not_fitted():
    """A law must explain more than the catalogue does in the end; its full fit may gain as much as among laws."""
    some = [scored(g, ()) for g in (400.0, 190.0, *[0.0] * 30)]
    assert [s.ln_bayes for s in shortlist_laws(some, 300.0)] == [400.0, 190.0]
    assert [s.ln_bayes for s in shortlist_laws(some, 800.0)] == [400.0]
    assert shortlist_laws(some, 900.0) == []
    assert [s.ln_bayes for s in shortlist_laws([scored(20.0, ()), *some[2:]], 39.0)] == [20.0]


def test_laws_are_simulated_together_as_memory_allows():
    """Batches are even; where data are many they are as small as they may be."""
    laws = [SimpleNamespace(nodes=(0.0,) * 5)] * 31
    per_law = 5 * 4
    assert law_identification.batch_size(laws, 1000) == 31
    many = int(law_identification.MAX_BATCH_BYTES / (20 * per_law))
    assert law_identification.batch_size(laws, many) == 16
    assert law_identification.batch_size(laws, 10**9) == 6


def test_laws_are_compared_by_full_fits_where_there_are_some():
    """The one with the larger score may fit worse; what was never fitted is compared by its score."""
    laws = [SimpleNamespace(name=n, description=n) for n in "abc"]
    some = [ScoredLaw(law, 1.0, gain, (), fitted) for law, gain, fitted in zip(
        laws, (90.0, 95.0, 88.0), (100.0, 60.0, None), strict=True)]  # fmt: skip
    search = SimpleNamespace(best=SimpleNamespace(ln_evidence=100.0), base=SimpleNamespace(ln_evidence=0.0))
    found = law_identification.IdentifiedLaw(laws[0], np.zeros((0, 0)), search, tuple(some))
    assert found.alternatives == {"c": 88.0}
    assert found.ln_bayes == pytest.approx(100.0 - np.log(3.0))


# --- nodes ------------------------------------------------------------------------------------------------------
def law_with_nodes(name, count, most=17):
    nodes = tuple(range(count))
    finer = nodes if count >= most else tuple(range(2 * count - 1))
    return SimpleNamespace(name=name, description=name, nodes=nodes, refined_nodes=finer)


@pytest.fixture
def identify_by_gains(monkeypatch):
    """{law: {nodes: ln Bayes factor}} -> the identified law, where every fit ends with that evidence."""

    def identify(gains):
        def fitted_law(name, count):
            some = ScoredLaw(law_with_nodes(name, count), 1.0, gains[name][5], ())
            return FittedLaw(some, None, SimpleNamespace(ln_evidence=gains[name][count]))

        def finish(search, found, scored, watch):
            best = SimpleNamespace(best=found.fit, base=search.base, problem=None)
            return IdentifiedLaw(found.scored.law, np.zeros((0, 0)), best, scored)

        laws = [fitted_law(name, 5) for name in gains]
        monkeypatch.setattr(law_identification, "list_possible_laws", lambda search: [f.scored.law for f in laws])
        monkeypatch.setattr(law_identification, "score_laws", lambda search, some: tuple(f.scored for f in laws))
        monkeypatch.setattr(law_identification, "_fit_laws", lambda search, likely, watch: laws)
        monkeypatch.setattr(law_identification, "_is_adequate", lambda problem, fit: True)
        monkeypatch.setattr(law_identification, "excess_left", lambda search: 0.0)
        monkeypatch.setattr(
            law_identification, "_fit_refined",
            lambda search, found, nodes, watch, least: fitted_law(found.scored.law.name, len(nodes)),
        )  # fmt: skip
        monkeypatch.setattr(law_identification, "_finish_law", finish)
        empty = SimpleNamespace(case=SimpleNamespace(effects=()))
        return identify_law(
            SimpleNamespace(problem=empty, fits={}, ranking=(), base=SimpleNamespace(ln_evidence=0.0)), quiet
        )

    return identify


def test_all_laws_get_more_nodes_where_the_best_one_needs_them(identify_by_gains):
    """A narrow groove looks most like a resistance at five nodes; with nodes enough friction explains it better."""
    found = identify_by_gains(
        {"resistance": {5: 79.0, 9: 161.0, 17: 162.0}, "friction": {5: 25.0, 9: 90.0, 17: 170.0},
         "pressure": {5: 20.0, 9: 80.0, 17: 166.0}}
    )  # fmt: skip
    assert (found.law.name, len(found.law.nodes)) == ("friction", 17)
    # both rivals are within the 80 that the last nodes gained: no curve with an edge is resolved by 17 nodes
    assert found.alternatives == {"resistance": 161.0, "pressure": 166.0}


def test_curves_that_nodes_resolve_are_compared_by_their_evidence(identify_by_gains):
    """17 nodes gain nothing more, so only what is less than 5 behind is as likely: 161 with enough nodes is 9 less."""
    found = identify_by_gains(
        {"resistance": {5: 79.0, 9: 161.0, 17: 162.0}, "friction": {5: 25.0, 9: 170.0, 17: 170.0},
         "pressure": {5: 20.0, 9: 166.0, 17: 166.0}}
    )  # fmt: skip
    assert (found.law.name, len(found.law.nodes)) == ("friction", 9)
    assert found.alternatives == {"pressure": 166.0}


def test_no_other_law_is_refined_where_five_nodes_suffice(identify_by_gains):
    """Refining costs a fit for each law, and finer nodes of a worse law are not even known here."""
    found = identify_by_gains({"resistance": {5: 79.0, 9: 80.0}, "friction": {5: 25.0}})
    assert (found.law.name, len(found.law.nodes)) == ("resistance", 5)
    assert found.alternatives == {}


def test_a_node_on_a_bound_has_a_band(identified):
    """Its standard error is that of the free node: within the bound, that far, the data allow other values."""
    found = identified(run_in)[2]
    fit, count = found.search.best, len(found.law.nodes)
    node = next(p for p in fit.solution.names if p.effect == LEARNED_LAW_NAME)
    free = node_covariance(fit, count)
    priors = {p: v for p, v in fit.priors.items() if p != node}
    on_bound = replace(fit, bound=frozenset({node}), solution=fit.system.solve(priors, fit.equations))
    np.testing.assert_allclose(node_covariance(on_bound, count), free, rtol=1e-6)
    assert np.all(np.diag(free) > 0.0)
