"""Laws that no catalogue has: the file that holds one, its formula, nulls in which none is learned, and truths."""

from __future__ import annotations

import importlib.util
import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

import flashtemp
from flashtemp.comparison import campaign
from flashtemp.comparison.synthetic_campaign import SEALED_TRUTH, SyntheticPlan, make_synthetic_campaign
from flashtemp.discovery import engine, law_identification
from flashtemp.discovery.criteria import CRITERIA
from flashtemp.discovery.diagnostics.cross_validation import heldout_excess
from flashtemp.discovery.estimation.camera_error_columns import NO_CAMERA_ERRORS
from flashtemp.discovery.estimation.hyperparameters import Hyperparameters
from flashtemp.discovery.estimation.linear_gaussian import DataBlock, LinearSystem
from flashtemp.discovery.estimation.linearised_fit import FitStatus, LinearisedFit
from flashtemp.discovery.estimation.model_discrepancy import TYPICAL_DISCREPANCY
from flashtemp.discovery.estimation.per_condition import estimate_by_condition, estimate_effect_by_condition
from flashtemp.discovery.hypotheses.candidates import ModelPoint
from flashtemp.discovery.hypotheses.formula_fit import fit_simplest_formula
from flashtemp.discovery.hypotheses.piecewise_linear_law import (
    INITIAL_LAW_NODES,
    LEARNABLE_QUANTITIES,
    LEARNED_LAW_NAME,
    MAX_LAW_NODES,
    REGRESSORS,
    PiecewiseLinearLaw,
    graded_nodes,
    nodes_at_values,
)
from flashtemp.discovery.parameters import ParameterId, ParameterKind
from flashtemp.discovery.selection.forward_selection import EffectSearch
from flashtemp.model.case import load_case
from flashtemp.physics.quantities import KELVIN
from flashtemp.physics.user_effects import read_effect
from flashtemp.runs.checks.effect_check import heat_balance_checks, law_checks, run_checks
from flashtemp.runs.checks.effect_check.fixtures import EffectUnderTest, SceneCache
from flashtemp.runs.checks.effect_check.run_checks import run_all_checks
from flashtemp.solver.time_integration import integrate_schedule

BENCHMARK = Path(__file__).parents[2] / "benchmarks" / "learned_laws.py"
CASE = Path(__file__).parents[2] / "cases" / "uniform_pressure"
TINY = {"numerics.mesh": 0.3, "numerics.rtol": 1e-3, "schedule.distance": 0.1, "schedule.repetitions": 1}
REACHED = {"temperature": (20.0, 80.0), "inside": (20.0, 60.0), "speed": (0.05, 0.8), "pressure": (5e4, 2e5),
           "place": (0.0, 0.025), "slid": (0.0, 2.0), "passed": (0.0, 9.0), "time": (0.0, 30.0), "repetition": (1.0, 10.0)}  # fmt: skip
PAIRS = [(u, REGRESSORS[a]) for u in LEARNABLE_QUANTITIES for a in u.regressors]
KINDS = [("friction", "temperature"), ("resistance", "place"), ("walls", "speed")]  # a factor, a term, films
USUAL = (0.3, 0.25, 0.2, 0.1, 0.05)  # of its size, at nodes


def pair(quantity, argument):
    return next((u, a) for u, a in PAIRS if (u.name, a.name) == (quantity, argument))


def law(quantity, regressor, values=(0.9, 0.2, 0.5, 0.7, 0.4)):
    """A law over what a test reaches, of usual size."""
    nodes = graded_nodes(*REACHED[regressor.name], len(values))
    return PiecewiseLinearLaw(quantity, regressor, nodes, tuple(quantity.typical_size * v for v in values))


def trial(told, folder):
    """A law's file before the battery, and its bench."""
    (folder / "learned.py").write_text(told.as_effect().source)
    return EffectUnderTest(LEARNED_LAW_NAME, read_effect(folder / "learned.py"), {}), SceneCache()


# --- the file ------------------------------------------------------------------------------------------
@pytest.mark.long
@pytest.mark.parametrize("which", KINDS, ids="-".join)
def test_the_file_passes_the_battery(which, tmp_path):
    found = run_all_checks(*trial(law(*pair(*which), USUAL), tmp_path))
    assert [f.says for f in found if not f.ok] == []
    assert {"example", "derivatives", "off", "jacobian", "energy", "acts"} <= {f.name for f in found}


STEEP = {  # ln of factors on friction over temperature (degC): a measured peak, and a fall from the ambient on
    "peak": ((20.0, 25.7549, 31.5098, 37.2647, 43.0196), (-0.079298, -0.092578, 0.0063693, 0.17032, 0.091009)),
    "fall": ((20.0, 35.0, 50.0, 65.0, 80.0), (0.0, -0.225, -0.45, -0.675, -0.9)),
}


@pytest.mark.parametrize("which", STEEP)
def test_steep_friction_is_linearised_where_it_is_solved(which, tmp_path):
    """Newton's last slope is that of its last point, not of the one before: the difference was 3e-10 of J v."""
    told, bench = trial(PiecewiseLinearLaw(*pair("friction", "temperature"), *STEEP[which]), tmp_path)
    for shape in heat_balance_checks.SHAPE_WORDS:
        assert heat_balance_checks.linearisation(bench, told, shape).ok, shape


@pytest.mark.parametrize("which", KINDS, ids="-".join)
def test_the_file_reads_like_one_of_ours(which, tmp_path):
    """Words, units, bounds, example, and laws point by point: the battery without its runs."""
    told, bench = trial(law(*pair(*which), USUAL), tmp_path)
    found = [look(told) for look in run_checks.FILE_CHECKS] + law_checks.check_laws(bench, told)
    assert [f.says for f in found if not f.ok] == []
    assert {"example", "derivatives", "pointwise", "ends"} <= {f.name for f in found}


def test_the_file_can_be_edited(tmp_path):
    """A factor of 2 on friction, written by hand in the place of what was learned, doubles friction."""
    told = law(*pair("friction", "slid"), (0.0, 0.0))
    text = told.as_effect().source.replace("Param(0,", f"Param({np.log(2.0):.9f},")
    assert text.count("0.693") == 2
    (tmp_path / "learned.py").write_text(text)
    (tmp_path / "case.toml").write_text('effects = ["./learned.py"]\n')
    case = load_case(tmp_path, TINY)
    run, base = (integrate_schedule(c.scene, c.settings) for c in (case, load_case(tmp_path, TINY | {"effects": []})))
    np.testing.assert_allclose(run.friction[run.sliding], 2.0 * base.friction[base.sliding], rtol=1e-8)


# --- what may be one -------------------------------------------------------------------------------------
def searched(*conditions, held=()):
    """As much of a search as tells what varied under some conditions, of which some are `held` out."""
    case = load_case(CASE, TINY)
    runs = [integrate_schedule(c.scene, c.settings) for c in (case.with_values(given) for given in conditions)]
    entries = [[SimpleNamespace(held_out=n in held)] for n in range(len(conditions))]
    told = [SimpleNamespace(given=g, entries=e) for g, e in zip(conditions, entries, strict=True)]
    problem = SimpleNamespace(case=case, conditions=told, mesh_overrides=[{} for _ in conditions])
    return SimpleNamespace(base=SimpleNamespace(predictions=[SimpleNamespace(run=r) for r in runs]), problem=problem)


def test_nothing_depends_on_what_does_not_vary():
    one = {"schedule.speed": 0.1}
    names = {(w.quantity.name, w.regressor.name): w.nodes for w in law_identification.list_possible_laws(searched(one))}
    assert ("friction", "temperature") in names
    assert ("pressure", "place") in names
    assert not {a for _, a in names} & {"speed", "repetition", "pressure"}
    both = searched(one, {"schedule.speed": 0.4, "contact.pressure": 5e4})
    wider = {(w.quantity.name, w.regressor.name): w.nodes for w in law_identification.list_possible_laws(both)}
    assert wider["friction", "speed"] == pytest.approx((0.1, 0.4))
    assert len(wider["friction", "pressure"]) == 2
    reached = max(float(np.nanmax(p.run.T_spot)) for p in both.base.predictions)
    assert wider["friction", "temperature"][-1] == pytest.approx(reached, rel=1e-5)


def test_nodes_are_where_a_campaign_has_values():
    assert nodes_at_values([0.3, 0.1, 0.1]) == (0.1, 0.3)
    assert len(nodes_at_values(range(1, 11))) == INITIAL_LAW_NODES
    assert nodes_at_values(range(1, 11))[0] == 1
    assert nodes_at_values(range(1, 11))[-1] == 10


def test_walls_cool_at_rest_too():
    """A film over speed has a node at rest where the block waits between repetitions; friction has none there."""
    waits = {"schedule.repetitions": 2, "schedule.wait": 0.5, "schedule.distance": 0.02}
    found = {(w.quantity.name, w.regressor.name): w.nodes for w in
             law_identification.list_possible_laws(searched({"schedule.speed": 0.1} | waits, {"schedule.speed": 0.4} | waits))}  # fmt: skip
    assert found["walls", "speed"] == pytest.approx((0.0, 0.1, 0.4))
    assert found["friction", "speed"] == pytest.approx((0.1, 0.4))
    assert found["friction", "passed"][-1] == pytest.approx(0.04)
    assert found["friction", "slid"][-1] == pytest.approx(0.02)


@pytest.mark.parametrize(("known", "goes_on"), [(0.0, True), (280.0, True), (305.0, False)])
def test_a_law_counts_only_where_it_explains_more_than_the_catalogue_does(monkeypatch, known, goes_on):
    found = law(*pair("walls", "speed"))
    scored = law_identification.ScoredLaw(found, 1.0, 300.0, found.values)
    fitted = law_identification.FittedLaw(scored, None, SimpleNamespace(ln_evidence=300.0))
    monkeypatch.setattr(law_identification, "list_possible_laws", lambda search: [found])
    monkeypatch.setattr(law_identification, "score_laws", lambda search, laws: (scored,))
    monkeypatch.setattr(law_identification, "_fit_laws", lambda search, likely, watch: [fitted])
    monkeypatch.setattr(law_identification, "_refine_nodes", lambda search, best, watch: best)
    monkeypatch.setattr(law_identification, "_finish_law", lambda search, best, scored, watch: best)
    base, other = (
        SimpleNamespace(ln_evidence=0.0, is_comparable=True),
        SimpleNamespace(ln_evidence=known, is_comparable=True),
    )
    problem = SimpleNamespace(case=SimpleNamespace(effects=()))
    search = EffectSearch(problem, None, base, base, {frozenset(): base, frozenset({"side_cooling"}): other})
    assert (law_identification.identify_law(search, lambda text: None) is not None) is goes_on


# --- formulas -----------------------------------------------------------------------------------------
u = np.linspace(20.0, 80.0, 5)
v = np.linspace(0.05, 0.8, 5)
TRUE = {  # what holds, and over which argument: ln of the factor at the nodes
    "constant": ("temperature", np.full(5, 0.2)),
    "linear": ("temperature", np.log(0.9 * (1.0 + 0.008 * (u - 20.0)))),
    "power": ("speed", np.log(1.1 * v**-0.3)),
    "exponential": ("temperature", -0.012 * (u - 20.0)),
    "Arrhenius": ("temperature", 4000.0 * (1.0 / (u + KELVIN) - 1.0 / 323.15)),
    "saturating": ("slid", np.log(1.0 + 0.8 * -np.expm1(-np.linspace(0.0, 2.0, 5) / 0.4))),
    "peak": ("temperature", np.log(1.0 + 0.5 * np.exp(-0.5 * ((u - 50.0) / 15.0) ** 2))),
}


EXACT = Hyperparameters(1.0, TYPICAL_DISCREPANCY, NO_CAMERA_ERRORS)


def law_of(sizes, wobble=0.0, seed=3, held=()):
    """A fit of three nodes to two conditions of 400 data that show the law, `sizes` times as large; `wobble` moves one
    node of the second against its neighbour, and the law as a whole by nothing.  Conditions may be `held` out."""
    rng = np.random.default_rng(seed)
    nodes = [ParameterId.of_effect(LEARNED_LAW_NAME, f"at_{k + 1}") for k in range(3)]
    values, none, blocks = np.array([0.3, -0.2, 0.25]), (np.zeros((400, 0)), np.zeros((0, 0))), []
    C = 100.0 * rng.standard_normal((400, 3)) @ (np.eye(3) + 0.8 * rng.standard_normal((3, 3)))
    against, seen = np.array([1.0, -1.0, 0.0]), values @ C.T @ C
    against -= values * (seen @ against) / (seen @ values)
    for number, size in enumerate(sizes):
        own = size * values + number * wobble * against
        r = C @ own + rng.standard_normal(400)
        names = tuple((p, k) for k, p in enumerate(nodes))
        blocks.append(DataBlock("ab"[number], number, number in held, r, C, names, *none))
    priors = {p: (0.0, 0.3) for p in nodes}
    system = LinearSystem(blocks)
    model = ModelPoint({}, {LEARNED_LAW_NAME: {p.name: 0.0 for p in nodes}})
    fit = LinearisedFit(model, (), system, system.solve(priors), priors, EXACT, FitStatus.CONVERGED)
    return SimpleNamespace(conditions=[SimpleNamespace(words=f"{n}") for n in range(2)]), fit


@pytest.mark.parametrize("sizes", [(1.0, 1.0), (1.0, 1.1), (0.9, 1.2)])
def test_a_law_is_as_large_in_every_condition_as_each_alone_would_have_it(sizes):
    problem, fit = law_of(sizes)
    [found] = estimate_effect_by_condition(problem, fit, LEARNED_LAW_NAME)
    common = fit.solution.d @ np.array([0.3, -0.2, 0.25]) / np.sum(np.array([0.3, -0.2, 0.25]) ** 2)
    for own, size in zip(found.conditions, sizes, strict=True):
        assert own.value * common == pytest.approx(size, abs=5.0 * own.stderr)
    assert (found.probability > 1e-4) is (sizes[0] == sizes[1])


@pytest.mark.parametrize(("sizes", "agree"), [((1.0, 1.0), True), ((1.0, 1.2), False)])
def test_data_that_were_held_out_judge_whether_conditions_agree_and_fit_nothing(sizes, agree):
    problem, fit = law_of(sizes, held=(1,))
    [own] = estimate_effect_by_condition(problem, fit, LEARNED_LAW_NAME)
    assert [c.condition for c in own.conditions] == ["0"]
    assert own.probability == 1.0
    [every] = estimate_effect_by_condition(problem, fit, LEARNED_LAW_NAME, every=True)
    assert [c.condition for c in every.conditions] == ["0", "1"]
    assert (every.probability > 1e-4) is agree


def two_conditions(columns, values, names, priors, model):
    """A fit to two conditions of 400 data of noise 1 that show `columns` times `values`; one array of each for each."""
    rng, none, blocks = np.random.default_rng(5), (np.zeros((400, 0)), np.zeros((0, 0))), []
    for number, (C, value) in enumerate(zip(columns, values, strict=True)):
        own = tuple((p, k) for k, p in enumerate(names))
        blocks.append(DataBlock("ab"[number], number, False, C @ value + rng.standard_normal(400), C, own, *none))
    system, exact = LinearSystem(blocks), replace(EXACT, variances={"a": 1.0, "b": 1.0})
    return LinearisedFit(model, (), system, system.solve(priors), priors, exact, FitStatus.CONVERGED)


LEARNED_MODEL = ModelPoint({}, {LEARNED_LAW_NAME: {"at_1": 0.0, "at_2": 0.0}})
FOLDS = SimpleNamespace(noises={})


def test_pressure_shapes_that_a_wrong_base_needs_are_no_prediction():
    """The same columns, of free pressure shapes or of a law: the base is judged without them."""
    rng = np.random.default_rng(7)
    columns, values = 20.0 * rng.standard_normal((2, 400, 2)), [np.array([0.5, -0.5])] * 2
    modes = [ParameterId(ParameterKind.MODE, (n,)) for n in (1, 2)]
    nodes = [ParameterId.of_effect(LEARNED_LAW_NAME, f"at_{k}") for k in (1, 2)]
    base = two_conditions(columns, values, modes, dict.fromkeys(modes, (0.0, 0.3)), ModelPoint())
    best = two_conditions(columns, values, nodes, dict.fromkeys(nodes, (0.0, 0.3)), LEARNED_MODEL)
    before, after = heldout_excess(FOLDS, base, best)
    assert before > 1e4
    assert abs(after) < 50.0


@pytest.mark.parametrize(("second", "predicts"), [(-0.5, True), (-3.0, False)])
def test_an_unseen_range_is_predicted_within_the_prior_of_its_node(second, predicts):
    """Each condition shows one node; the other one is known to 0.3 a priori, so that 0.5 is likely and 3 is not."""
    rng = np.random.default_rng(7)
    columns = 20.0 * rng.standard_normal((2, 400, 2)) * np.eye(2)[:, None]
    nodes = [ParameterId.of_effect(LEARNED_LAW_NAME, f"at_{k}") for k in (1, 2)]
    values = [np.array([0.5, 0.0]), np.array([0.0, second])]
    best = two_conditions(columns, values, nodes, dict.fromkeys(nodes, (0.0, 0.3)), LEARNED_MODEL)
    base = replace(best, model=ModelPoint(), priors={}, solution=best.system.solve({}))
    before, after = heldout_excess(FOLDS, base, best)
    assert before > 1e4
    assert (after < 20.0) is predicts
    assert after > -50.0


def test_a_node_against_its_neighbour_is_no_other_size():
    """What conditions make of single nodes says little of a law: lines between nodes are not what they stand for."""
    problem, fit = law_of((1.0, 1.0), wobble=0.006)
    [found] = estimate_effect_by_condition(problem, fit, LEARNED_LAW_NAME)
    alone = [estimate_by_condition(problem, fit, p) for p in fit.effect_parameters]
    assert found.probability > 1e-4
    assert min(a.probability for a in alone) < 1e-4


def test_what_all_conditions_share_may_be_what_differs():
    """Of a hundred campaigns whose conditions agree, the stated share looks otherwise by chance: errors of what all
    share, and which one condition feels as the other does not, are in the errors of what each would have."""
    rng, p, shared = (
        np.random.default_rng(11),
        ParameterId.of_effect("edge_pressure", "B"),
        ParameterId(ParameterKind.MODE, (1,)),
    )
    none = np.zeros((60, 0), dtype=np.float32), np.zeros((0, 0))
    problem = SimpleNamespace(conditions=[SimpleNamespace(words=f"{n}") for n in range(2)])
    priors, model = {p: (0.0, 10.0), shared: (0.0, 1.0)}, ModelPoint({}, {"edge_pressure": {"B": 0.0}})
    found, off = [], []
    for _ in range(200):
        blocks, mode = [], rng.standard_normal()
        for number, way in enumerate((1.0, -1.0)):
            C = np.column_stack([rng.uniform(0.5, 1.0, 60), way * rng.uniform(0.5, 1.0, 60)]).astype(np.float32)
            r = C @ np.array([2.0, mode]) + rng.standard_normal(60)
            blocks.append(DataBlock("ab"[number], number, False, r, C, ((p, 0), (shared, 1)), *none))
        system = LinearSystem(blocks)
        fit = LinearisedFit(model, (), system, system.solve(priors), priors, EXACT, FitStatus.CONVERGED)
        sizes = estimate_by_condition(problem, fit, p)
        found.append(sizes.probability)
        off += [(c.value - 2.0) / c.stderr for c in sizes.conditions]
    assert np.mean(np.array(found) < 0.2) == pytest.approx(0.2, abs=0.1)
    assert np.std(off) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("name", TRUE)
def test_a_formula_is_found_where_it_holds(name):
    """Values known to 0.1 % at five nodes, scattered by as much; nothing simpler fits them."""
    argument, values = TRUE[name]
    covariance = np.eye(5) * 1e-6
    scattered = values + 1e-3 * np.random.default_rng(4).normal(size=5)
    told = replace(law(*pair("friction", argument)), values=tuple(scattered))
    found = fit_simplest_formula(told, covariance)
    assert found is not None
    assert found.name == name, found


def test_the_numbers_of_a_formula_give_its_curve():
    """A step between the first two nodes, written out again."""
    told = replace(law(*pair("friction", "slid")), values=(0.0, 0.5, 0.5, 0.5, 0.5))
    found = fit_simplest_formula(told, np.eye(5) * 1e-6)
    assert found is not None
    assert found.name == "saturating"
    a, b, w = found.numbers
    curve = a * (1.0 + b * -np.expm1(-np.linspace(0.0, 1.0, 5) / w))
    np.testing.assert_allclose(np.log(curve), told.values, atol=3e-3)


def test_a_power_may_begin_at_nothing():
    """Cooling as sqrt(v), nothing at rest; not so for a factor, which is one there."""
    nodes = (0.0, 0.1, 0.3)
    values = tuple(60.0 * np.sqrt(nodes))
    told = PiecewiseLinearLaw(*pair("walls", "speed"), nodes, values)
    found = fit_simplest_formula(told, np.diag([1.0, 0.3, 0.3]) ** 2)
    assert found is not None
    assert found.name == "power"
    assert found.numbers[1] == pytest.approx(0.5, abs=0.01)
    assert (
        fit_simplest_formula(PiecewiseLinearLaw(*pair("friction", "slid"), nodes, (0.3, 0.2, 0.1)), 1e-6 * np.eye(3))
        is None
    )


def test_a_formula_is_found_for_the_line_that_is_nearest_to_it():
    """What a fit gives a line over a bend: below the curve at its nodes, or above, by more than the errors."""
    nodes = graded_nodes(0.0, 1.2, decays=True)
    curve = PiecewiseLinearLaw(*pair("friction", "passed"), nodes, (0.0,) * 5)
    at = np.linspace(0.0, 1.2, 2000)
    values = np.linalg.lstsq(curve.hat_functions(at), np.log(1.0 + 0.2 * np.exp(-at / 0.15)), rcond=None)[0]
    assert np.abs(values - np.log(1.0 + 0.2 * np.exp(-np.array(nodes) / 0.15))).max() > 4e-3
    found = fit_simplest_formula(replace(curve, values=tuple(values)), 1e-6 * np.eye(5))
    assert found is not None
    assert found.name == "saturating"
    assert found.numbers[2] == pytest.approx(0.15 / 1.2, rel=0.2)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("argument", ["slid", "temperature"])
def test_a_search_for_a_formula_goes_where_no_number_is_so_large(argument):
    """And comes back, without a word: exp(b s) overflows on its way."""
    told = replace(law(*pair("friction", argument)), values=(-211.71, -69.64, 2.2, -74.62, 350.38))
    assert fit_simplest_formula(told, np.eye(5) * 1e-8) is None


def test_no_formula_is_given_where_none_fits():
    told = replace(law(*pair("pressure", "place")), values=(0.2, -0.25, 0.2, -0.25, 0.2))
    assert fit_simplest_formula(told, np.eye(5) * 1e-6) is None
    known = fit_simplest_formula(told, np.eye(5))  # known so badly that it may be anything
    assert known is not None
    assert known.name == "constant"


# --- nulls ----------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def benchmark():
    spec = importlib.util.spec_from_file_location("learned_laws", BENCHMARK)
    module = importlib.util.module_from_spec(spec)
    sys.modules["learned_laws"] = module  # dataclasses look their module up there
    spec.loader.exec_module(module)
    return module


def test_gains_of_laws_are_ratios_of_evidence(benchmark):
    """Against densities of the data themselves: noise of 1, with and without two columns of normal size."""
    rng = np.random.default_rng(2)
    C, size = rng.normal(size=(12, 3)), 0.4
    r = C @ np.array([0.5, -0.3, 0.0]) + rng.normal(size=12)
    found = benchmark.LawSignatures(C.T @ C, ((np.array([0, 2]), size),))
    widths = (0.5, 2.0)
    said = found.best_gains((C.T @ r)[:, None], widths)[0, 0]
    both = C[:, [0, 2]]
    wanted = [multivariate_normal(cov=np.eye(12) + (w * size) ** 2 * both @ both.T).logpdf(r) for w in widths]
    assert said == pytest.approx(max(wanted) - multivariate_normal(cov=np.eye(12)).logpdf(r) - np.log(2), abs=1e-9)


def test_noise_alone_seldom_speaks_for_a_law(benchmark):
    """Markov: of data without a law at most one in e^8 gives one of 20 laws a Bayes factor of 20 e^8 (mean 1 each)."""
    rng = np.random.default_rng(5)
    root = rng.normal(size=(100, 200))
    found = benchmark.LawSignatures(root @ root.T, tuple((np.arange(k, k + 5), 0.3) for k in range(0, 100, 5)))
    u = found.draw_scores(np.random.default_rng(6), 20_000)
    np.testing.assert_allclose(np.cov(u)[:5, :5], found.information[:5, :5], atol=0.05 * found.information[0, 0])
    gains = found.best_gains(u, law_identification.RELATIVE_WIDTHS)
    assert np.mean(gains.max(axis=0) > CRITERIA.ln_bayes_named + np.log(20)) < 0.005
    assert gains.max() > 0.0


@pytest.mark.long
def test_nothing_speaks_for_a_law_where_nothing_is_hidden(benchmark):
    """An independent laboratory with all its errors; about 100 CPU seconds."""
    found = benchmark.run_seed(7000)
    assert found["converged"]
    assert found["laws"] > 15
    assert found["best"][1] < found["threshold"]
    assert found["beyond"] <= 0.005 * found["draws"]


def test_a_law_reaches_over_what_is_fitted():
    """Walls cooled as sqrt(v), all of one speed held out: cooling fell to 0 at that speed, 0 to 47 W/m2K."""
    both = {"schedule.speed": 0.1}, {"schedule.speed": 0.4}
    every, one = (searched(*both, held=held) for held in ((), (1,)))
    assert {w.regressor.name for w in law_identification.list_possible_laws(every)} - {
        w.regressor.name for w in law_identification.list_possible_laws(one)
    } == {"speed"}


def test_nodes_between_nodes():
    law = PiecewiseLinearLaw(*pair("friction", "temperature"), graded_nodes(20, 60), (0.0, 1.0, 2.0, 3.0, 4.0))
    assert len(law.refined_nodes) == 9
    assert set(law.nodes) < set(law.refined_nodes)
    assert len(replace(law, nodes=graded_nodes(0, 1, MAX_LAW_NODES)).refined_nodes) == MAX_LAW_NODES
    assert PiecewiseLinearLaw(*pair("friction", "speed"), (0.1, 1.0), (0.0, 1.0)).refined_nodes == (0.1, 1.0)


@pytest.mark.parametrize(
    ("gains", "adequate", "kept", "finer"),
    [
        ((4.0, 2.0), (), 9, 17),  # evidence requires 9 nodes and not 17
        ((-1.0, 9.0), (), 5, 9),  # nothing is adequate, so the evidence decides at once
        ((-1.0, -1.0), (5, 9, 17), 5, 9),
        ((-1.0, -1.0), (9, 17), 9, 17),  # a chord misses the curve by less than the priors of its nodes cost
        ((-4.0, 9.0), (9, 17), 5, None),  # the evidence is against it
    ],
)
def test_nodes_are_added_for_evidence_or_for_adequacy(monkeypatch, gains, adequate, kept, finer):
    def law(nodes, evidence):
        shape = PiecewiseLinearLaw(*pair("pressure", "place"), nodes, (0.1,) * len(nodes))
        scored = law_identification.ScoredLaw(shape, 1.0, evidence, shape.values)
        return law_identification.FittedLaw(scored, None, SimpleNamespace(ln_evidence=evidence, nodes=len(nodes)))

    def fit_refined(search, found, nodes, watch, least):
        return law(nodes, found.fit.ln_evidence + gains[(len(nodes) - 1) // 8 - 1])

    monkeypatch.setattr(law_identification, "_fit_refined", fit_refined)
    monkeypatch.setattr(law_identification, "_is_adequate", lambda problem, fit: fit.nodes in adequate)
    found = law_identification._refine_nodes(None, law(graded_nodes(0.0, 1.0), 0.0), lambda text: None)
    assert len(found.scored.law.nodes) == kept
    assert (len(found.finer.scored.law.nodes) if found.finer else None) == finer


@pytest.mark.parametrize(
    ("adequate", "predicts", "kept"),
    [((5, 9), (5, 9), 5), ((9,), (5, 9), 9), ((5, 9), (9,), 9), ((5, 9), (), 5), ((), (5, 9), 5)],
)
def test_a_finer_law_counts_where_exact_derivatives_or_left_out_data_require_it(monkeypatch, adequate, predicts, kept):
    """The tests of adequacy that decided on the nodes used derivatives of another point, and all data."""
    found = law(*pair("walls", "speed"))
    scored = law_identification.ScoredLaw(found, 1.0, 300.0, found.values)

    def fitted(nodes, finer=None):
        fit = SimpleNamespace(ln_evidence=300.0, nodes=nodes)
        return law_identification.FittedLaw(scored, None, fit, finer)

    monkeypatch.setattr(law_identification, "list_possible_laws", lambda search: [found])
    monkeypatch.setattr(law_identification, "score_laws", lambda search, laws: (scored,))
    monkeypatch.setattr(law_identification, "_fit_laws", lambda search, likely, watch: [fitted(5)])
    monkeypatch.setattr(law_identification, "_refine_nodes", lambda search, best, watch: fitted(5, fitted(9)))
    monkeypatch.setattr(law_identification, "_is_adequate", lambda problem, fit: fit.nodes in adequate)
    monkeypatch.setattr(law_identification, "excess_left", lambda search: 1.0 - (search.best.nodes in predicts))
    monkeypatch.setattr(law_identification, "_finish_law",
                        lambda search, best, scored, watch: SimpleNamespace(search=SimpleNamespace(best=best.fit, problem=None)))  # fmt: skip
    base = SimpleNamespace(ln_evidence=0.0, is_comparable=True)
    problem = SimpleNamespace(case=SimpleNamespace(effects=()))
    search = EffectSearch(problem, None, base, base, {frozenset(): base})
    assert law_identification.identify_law(search, lambda text: None).search.best.nodes == kept


def test_of_a_pressure_only_the_shape_counts():
    law = PiecewiseLinearLaw(*pair("pressure", "place"), graded_nodes(0, 0.025), (0.3, 0.3, 0.3, 0.3, 0.5))
    level = np.full((5, 5), 0.04)  # all nodes together
    centred, covariance = law_identification._centre_pressure(law, level + 1e-4 * np.eye(5))
    at = np.linspace(0.0, 0.025, 1001)
    assert np.exp(centred.hat_functions(at) @ np.array(centred.values)).mean() == pytest.approx(1.0, abs=1e-3)
    assert np.diag(covariance).max() < 3e-4
    same = PiecewiseLinearLaw(*pair("friction", "place"), graded_nodes(0, 0.025), (0.3, 0.3, 0.3, 0.3, 0.5))
    assert law_identification._centre_pressure(same, level) == (same, level)


# --- learned from data ------------------------------------------------------------------------------------
HUMP = '''"""Friction has a maximum over temperature.

>>> 1 + 1
2
"""

from __future__ import annotations

import numpy as np

from flashtemp.physics.effect import Effect, Factor, Param
from flashtemp.physics.quantities import KELVIN


class Hump(Effect):
    """A maximum of friction."""

    cause = "friction has a maximum over temperature"
    source = "made up"
    tells = ("none",)

    height = Param(0.3, "1", "height", low=-0.9, high=3.0, off=0.0)
    middle = Param(38.0, "degC", "its place", low=-50.0, high=300.0)
    width = Param(5.0, "K", "its width", low=0.1, high=100.0)

    def heat(self, scene, p):
        """Multiplies mu."""
        yield Factor(
            "friction.mu",
            lambda T, now, p: 1 + p.height * np.exp(-0.5 * ((T - KELVIN - p.middle) / p.width) ** 2),
        )
'''


@pytest.fixture(scope="module")
def hump(tmp_path_factory):
    """A campaign of two conditions with a maximum of friction that no member of the catalogue has."""
    folder = tmp_path_factory.mktemp("hump")
    (folder / "hump.py").write_text(HUMP)
    (folder / "case.toml").write_text('effects = ["./hump.py"]\n')
    given = {
        "schedule.repetitions": 2, "schedule.distance": 0.4, "schedule.wait": 8.0, "road.track_length": 0.4,
        "numerics.mesh": 0.5, "numerics.rtol": 1e-3, "output.profiles": 10,
    }  # fmt: skip
    out = make_synthetic_campaign(
        load_case(folder, given, trust=True), SyntheticPlan(("hump",), 301, conditions=2, sliding=2), folder / "lab"
    )
    truth = json.loads((out / SEALED_TRUTH).read_text())["hidden"]["hump"]
    shutil.rmtree((out / SEALED_TRUTH).parent)
    verdict, search = engine.discover(campaign.load(out), workers=1)
    engine.write_extended(search, verdict, folder)
    return SimpleNamespace(truth=truth, verdict=verdict, folder=folder)


@pytest.mark.long
def test_a_maximum_of_friction_over_temperature_is_learned(hump):
    v = hump.verdict
    assert v.kind == "learned", v.says
    assert (v.law.quantity, v.law.argument) == ("friction", "temperature")
    true = 1 + hump.truth["height"] * np.exp(-0.5 * ((v.law.at - 38.0) / 5.0) ** 2)
    found = v.law.curve / v.law.curve[0]  # the level is friction's own
    assert abs(found - true / true[0]).max() < 0.05
    assert v.causes[0].held_out_gain > 0
    assert "learned from the data" in v.says[0]
    told = v.as_dict()["law"]
    assert len(told["curve"]["value"]) == len(told["band"]["low"]) == len(told["curve"]["argument"])


@pytest.mark.long
def test_what_was_learned_runs_and_reads_like_an_effect(hump):
    assert (hump.folder / "learned.py").is_file()
    assert '"./learned.py"' in (hump.folder / "extended.toml").read_text()
    case = load_case(hump.folder / "extended.toml", trust=True)
    assert LEARNED_LAW_NAME in case.effects
    told = np.log(np.interp(hump.verdict.law.nodes, hump.verdict.law.at, hump.verdict.law.curve))
    in_case = [case[f"{LEARNED_LAW_NAME}.at_{k + 1}"] for k in range(len(told))]
    np.testing.assert_allclose(told, in_case, atol=2e-3)  # the curve is told at 41 places, not at the nodes
    run = integrate_schedule(case.scene, case.settings)
    assert run.energy_imbalance < 1e-9
    report = flashtemp.check_effect(hump.folder / "learned.py")
    assert [f.says for f in report.findings if not f.ok] == []
