"""Stated numbers that the data may question: which there are, how well known, their columns and the verdicts on them."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from flashtemp.camera.recording import Recording
from flashtemp.comparison import campaign
from flashtemp.comparison.known_inputs import read_known
from flashtemp.comparison.synthetic_campaign import SyntheticPlan, make_synthetic_campaign
from flashtemp.discovery import assessment
from flashtemp.discovery.criteria import CRITERIA
from flashtemp.discovery.diagnostics.effect_size import change_per_unit
from flashtemp.discovery.diagnostics.input_checks import InputVerdict, compare_inputs_with_data, group_inputs
from flashtemp.discovery.diagnostics.stated_inputs import INPUT_CELL_FACTORS, add_input_columns, list_stated_inputs
from flashtemp.discovery.engine import discover
from flashtemp.discovery.estimation.linear_gaussian import LinearSystem
from flashtemp.discovery.estimation.nuisance_priors import NUISANCE_SD, nuisance_priors
from flashtemp.discovery.estimation.whitening import WhitenedData
from flashtemp.discovery.hypotheses.candidates import DEFAULT_KEY_PRIOR_SD, KEY_PRIOR_SD
from flashtemp.discovery.hypotheses.input_kinds import INPUT_KINDS, LAW_PARAMETER, exemption_reason, input_kind
from flashtemp.discovery.parameters import ParameterId, ParameterKind
from flashtemp.discovery.prediction.prediction import DerivativeRequest, Observable, Prediction, predict_condition
from flashtemp.discovery.prediction.problem import prepare_problem
from flashtemp.errors import BadInput
from flashtemp.model import priors
from flashtemp.model.case import load_case
from flashtemp.model.schema import COMMAND_TABLES, COMPUTATION_TABLES
from flashtemp.runs.results.worker_pool import open_worker_pool

ROOT = Path(__file__).parents[2]
SMALL = {
    "block.height": 0.005, "schedule.distance": 0.4, "numerics.mesh": 0.7, "numerics.rtol": 1e-4, "output.profiles": 20,
}  # fmt: skip
COMPARED = (
    "contact.pressure", "schedule.speed", "materials.tread_rubber.density", "ambient.temperature", "block.length",
)  # fmt: skip
WRONG_LOAD = 1.15  # stated over true
COLUMN_ERROR = 0.05  # of a column: what is three standard deviations off is then told within 0.15
LEAST_COLUMN_K = 0.1  # per ln: what changes by less than 1 mK for 1 % shows in no camera


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A small campaign of one condition in which nothing is hidden and nothing drawn, and how to prepare it."""
    folder = tmp_path_factory.mktemp("inputs")
    (folder / "case.toml").write_text("")
    plan = SyntheticPlan((), 3, conditions=1, views=("sidewall", "wake"), sliding=12, nuisance=0.0)
    read = campaign.load(make_synthetic_campaign(load_case(folder / "case.toml", SMALL), plan, folder / "lab"))
    with open_worker_pool(predict_condition, 1) as run:
        yield SimpleNamespace(campaign=read, prepare=lambda **changed: prepare_problem(replace(read, **changed), run))


def checked(made, factor, keys):
    """Checks and groups of some inputs where the load is told wrong by a factor.

    With the load cell; and without it but with friction that is the same in all tests, or nothing can check the load.
    """

    def wrong(entry):
        return replace(entry, given=entry.given | {"contact.pressure": factor * entry.given["contact.pressure"]})

    views, forces = (tuple(map(wrong, own)) for own in (made.campaign.views, made.campaign.forces))
    problem = made.prepare(views=views, forces=forces, free=("ambient.convection",))
    inputs = tuple(i for i in list_stated_inputs(problem) if i.key in keys)
    asked = DerivativeRequest(problem.free_keys, scatter=True, modes=2, optics=True, block_sizes=True)
    first = problem.predict(problem.make_tasks(problem.stated_model, asked))
    first = add_input_columns(problem, problem.stated_model, first, inputs)
    data = WhitenedData.from_predictions(problem, first)
    system = LinearSystem(data.make_blocks(first))
    changes = partial(change_per_unit, data, first, system)
    all_known = nuisance_priors(problem, system.names, problem.stated_model)
    steady = {p: v for p, v in all_known.items() if p.kind not in (ParameterKind.LEVEL, ParameterKind.SCATTER)}
    out = {}
    without_cell = system.normal_equations(lambda block: not block.label.endswith(".csv"))
    for cell, total, known in ((True, None, all_known), (False, without_cell, steady)):
        checks = {c.input.key: c for c in compare_inputs_with_data(system, known, total, inputs, changes)}
        groups = [{i.key for i in g} for g in group_inputs(system, known, total, inputs)]
        faint = compare_inputs_with_data(system, known, total, inputs, lambda p: 1e-3 * changes(p))
        faint = {c.input.key: c for c in faint}
        out[cell] = SimpleNamespace(checks=checks, groups=groups, changes=changes, faint=faint)
    return out


# --- which there are, and how well they are known ---------------------------------------------------------
def problem_of(case, tmp_path, view="profile", emissivity=None):
    """A problem of a case with one recording, whose values do not matter."""
    (tmp_path / "case.toml").write_text(case.toml(case.copy_files(tmp_path)))
    u = np.linspace(0.002, 0.02, 5)
    known = {"emissivity": emissivity, "reflected_degC": 20.0}
    if view == "wake":
        u = u + case["block.length"]
    v = np.zeros(1) if view == "profile" else np.linspace(-0.002, 0.002, 3)
    T = np.full((1, len(v), 5), 25.0)
    Recording(view, T, np.array([0.5]), np.array([1]), u, v, **known).save(tmp_path / "a.nc")
    (tmp_path / "campaign.toml").write_text('free = ["friction.mu"]\ncandidates = []\n[[recording]]\nfile = "a.nc"\n')
    return prepare_problem(campaign.load(tmp_path), list)


EXEMPT = {  # physical keys of the two cases that are no measured inputs, with the word that says why
    "road.depth": "extent", "road.upstream": "extent", "road.downstream": "extent",
    "contact.heat_split": "choice", "contact.flash_factor": "choice", "contact.lane_widening": "choice",
    "contact.reference_pressure": "reference", "pressure_profile.weight": "switch",
    "schedule.repetitions": "count", "schedule.turn": "count",
}  # fmt: skip


@pytest.mark.parametrize("name", ["uniform_pressure", "slide3d"])
def test_every_physical_number_of_a_case_is_an_input_or_exempt_with_a_reason(name, tmp_path):
    problem = problem_of(load_case(ROOT / "cases" / name), tmp_path)
    listed = {i.key: i for i in list_stated_inputs(problem)}
    full = priors.expand_materials(problem.case)
    for table, own in full.values.items():
        for key, value in own.items():
            dotted, number = f"{table}.{key}", isinstance(value, (int, float)) and not isinstance(value, bool)
            if table in (*COMPUTATION_TABLES, *COMMAND_TABLES) or dotted in problem.campaign.free:
                assert dotted not in listed
            elif dotted in EXEMPT:
                assert EXEMPT[dotted] in exemption_reason(full, dotted)
                assert dotted not in listed
            elif number and np.isfinite(value) and (value or dotted == "ambient.temperature"):
                assert (listed[dotted].value, listed[dotted].sd > 0) == (value, True)
            else:
                assert dotted not in listed


def test_cameras_state_emissivity_and_reflected_temperature(tmp_path):
    listed = {
        i.key: i
        for i in list_stated_inputs(problem_of(load_case(ROOT / "cases" / "uniform_pressure"), tmp_path, "wake", 0.9))
    }
    assert (listed["wake.emissivity"].value, listed["wake.emissivity"].sd) == (0.9, 0.05)
    assert (listed["wake.reflected_temperature"].value, listed["wake.reflected_temperature"].sd) == (20.0, 2.0)
    assert not any(key.startswith("sidewall") for key in listed)


def test_kinds_agree_with_what_calibration_and_sensitivity_use():
    for key, sd in KEY_PRIOR_SD.items():
        assert input_kind(key, "1").sd == sd, key
    assert INPUT_KINDS[LAW_PARAMETER].sd == DEFAULT_KEY_PRIOR_SD
    assert INPUT_KINDS["geometry"].sd == NUISANCE_SD[ParameterKind.SIZE]
    for name, (sd, relative, _) in (priors.USUAL_MATERIAL_SD | priors.USUAL_LAYER_SD).items():
        found = input_kind(f"materials.any.{name}", "")
        assert (found.sd, found.relative) == (sd, relative), name
    for key in ("contact.pressure", "schedule.speed", "contact.spot_diameter", "wear.rate"):
        assert (input_kind(key, "").sd, input_kind(key, "").relative) == priors.USUAL_SD[key][:2], key
    assert all(k.reason and k.sd > 0 for k in INPUT_KINDS.values())


def test_the_docs_list_every_kind_with_its_standard_deviation():
    page = (ROOT / "docs" / "reference" / "file_formats.md").read_text()
    for kind in INPUT_KINDS.values():
        absolute = {"emissivity": "", "Poisson's ratio": "", "insulated surface": " W/m2K"}
        unit = " %" if kind.relative else absolute.get(kind.name, " K")
        assert f"| {kind.name} | {(100 if kind.relative else 1) * kind.sd:g}{unit} | {kind.reason} |" in page


# --- what a campaign states of them ------------------------------------------------------------------------
def read_with(made, tmp_path, known):
    """The small campaign with a table `known`."""
    lines = (made.campaign.folder / "campaign.toml").read_text()
    for file in made.campaign.folder.iterdir():
        if file.suffix in (".nc", ".csv") or file.name == "case.toml":
            (tmp_path / file.name).symlink_to(file)
    (tmp_path / "campaign.toml").write_text(f"known = {known}\n" + lines)
    return campaign.load(tmp_path)


def test_a_campaign_states_how_well_its_inputs_are_known(made, tmp_path):
    told = """{ "contact.pressure" = 0.005, "ambient.temperature" = "0.2 K", block.length = "0.1 mm", \
"schedule.speed" = "3 %", "sidewall.emissivity" = "0.01 ", "materials.asphalt.density" = "23 kg/m3" }"""
    read = read_with(made, tmp_path, told.replace('"0.01 "', "0.02"))
    listed = {i.key: i for i in list_stated_inputs(made.prepare(known=read.known))}
    expected = {
        "contact.pressure": 0.005, "ambient.temperature": 0.2, "block.length": 0.004, "schedule.speed": 0.03,
        "sidewall.emissivity": 0.02 * 0.95, "materials.asphalt.density": 0.01,
    }  # fmt: skip
    assert {k: listed[k].sd for k in expected} == pytest.approx(expected)
    assert {i.source for k, i in listed.items() if k in expected} == {"stated"}
    assert listed["block.width"].source == "by kind"


@pytest.mark.parametrize(
    ("told", "said"),
    [
        ('{ "contact.presure" = 0.02 }', "did you mean 'contact.pressure'"),
        ('{ "materials.asfalt.density" = 0.02 }', "did you mean 'materials.asphalt.density'"),
        ('{ "sidewal.emissivity" = 0.02 }', "did you mean 'sidewall.emissivity'"),
        ('{ "numerics.mesh" = 0.02 }', "is no number of this case"),
        ('{ "contact.spot_fraction" = 0.02 }', "is free; say there how well it is known"),
        ('{ "ambient.temperature" = 0.02 }', 'give it with its unit, "0.5 K"'),
        ('{ "contact.pressure" = "0.3 K" }', "not a quantity in Pa"),
        ('{ "ambient.temperature" = "0.3 m" }', "'0.3 m' is not a quantity in K"),
        ('{ "contact.pressure" = "well" }', "give a relative standard deviation"),
        ('{ "contact.pressure" = true }', "give a relative standard deviation"),
        ('{ "contact.pressure" = 0 }', "above 0"),
        ('{ "contact.pressure" = -0.02 }', "above 0"),
        ('{ "contact.pressure" = "-2 kPa" }', "above 0"),
        ('{ "contact.pressure" = nan }', "above 0"),
        ('{ "contact.pressure" = 5 }', "at most 3 of the value"),
        ('["contact.pressure"]', "write known = {"),
        ('{ "ambient.road_sides" = "5 W/m2K" }', "states 0, which switches it off; leave it out of known"),
    ],
)
def test_a_wrong_statement_is_refused_in_one_line(made, tmp_path, told, said):
    with pytest.raises(BadInput) as fault:
        read_with(made, tmp_path, told)
    [line] = fault.value.lines
    assert "campaign.toml:1: known: " in line
    assert said in line


@pytest.mark.parametrize(
    ("key", "said"),
    [
        ("road.upstream", "extent"),
        ("contact.alpha", "infinite"),
        ("profile.emissivity", "no recording"),
    ],
)
def test_a_statement_about_what_is_no_input_is_refused(made, tmp_path, key, said):
    read = read_with(made, tmp_path, f'{{ "{key}" = 0.02 }}')
    with pytest.raises(BadInput, match=f"known: {key}: .*{said}"):
        list_stated_inputs(made.prepare(known=read.known))


def test_zero_in_the_case_may_be_known_where_a_recording_states_another_value(made, tmp_path):
    known = {"ambient.road_sides": "5 W/m2K"}
    for overrides in ([{"ambient.road_sides": 8.0}, {}], [{"ambient": {"road_sides": "8 W/m2K"}}]):
        assert read_known(known, made.campaign.load({}), (), overrides)[1] == ()
    assert len(read_known(known, made.campaign.load({}), (), [{"ambient.road_sides": 0.0}, {}])[1]) == 1
    assert read_known({"ambient.temperature": "1 K"}, made.campaign.load({"ambient.temperature": 0.0}), ())[1] == ()


def test_a_statement_about_what_is_no_input_is_refused_before_anything_is_computed(made, tmp_path):
    read = read_with(made, tmp_path, '{ "road.upstream" = 0.02 }')
    messages = []
    with pytest.raises(BadInput, match="known: road.upstream: extent"):
        discover(read, messages.append, workers=1)
    assert messages == []


# --- columns --------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def columns(made):
    """The prediction at the stated point with all columns that are compared, and its task with a tight tolerance."""
    problem = made.prepare()
    asked = DerivativeRequest(inputs=tuple(ParameterId.of_input(key) for key in COMPARED))
    [task] = problem.make_tasks(problem.stated_model, asked)
    task = replace(task, mesh_overrides=task.mesh_overrides | {"numerics.mesh": 0.4})
    fine = replace(task, mesh_overrides=task.mesh_overrides | {"numerics.rtol": 1e-6}, derivatives=DerivativeRequest())
    return SimpleNamespace(seen=predict_condition(task), fine=fine, still=predict_condition(fine))


@pytest.mark.parametrize("key", COMPARED)
def test_columns_agree_with_differences_of_whole_runs(columns, key):
    """Of the case built anew with the input moved; the longer schedule of two, so that no frame comes after its end."""
    case = priors.expand_materials(columns.fine.case.with_values(columns.fine.given))
    step = -0.004 if key == "schedule.speed" else 0.004
    value, step = (
        (case[key] + 10 * step, 10 * step) if key == "ambient.temperature" else (case[key] * np.exp(step), step)
    )
    moved = case.with_values({key: float(value)})
    given = {k: v for k, v in columns.fine.given.items() if k != key}
    run = predict_condition(replace(columns.fine, case=moved, given=given))
    for file, now in columns.still.observables.items():
        column, other = columns.seen.observables[file].columns[ParameterId.of_input(key)], run.observables[file]
        change = (other.values - now.values) / step
        if now.values.ndim == 3:
            both = now.inside & other.inside
            change, column = change[:, both], column[:, both[now.inside]]
        else:
            change, column = change[now.inside], column[now.inside]
        size = max(np.sqrt(np.mean(change**2)), LEAST_COLUMN_K)
        assert np.sqrt(np.mean((change - column) ** 2)) < COLUMN_ERROR * size, file


def test_inputs_of_a_view_have_columns_and_a_size_of_the_block_has_one_column_only(made):
    """The column of emissivity is the slope that the camera model knows analytically."""
    problem = made.prepare()
    asked = tuple(map(ParameterId.of_input, ("sidewall.emissivity", "sidewall.reflected_temperature", "block.length")))
    [seen] = problem.predict(
        problem.make_tasks(problem.stated_model, DerivativeRequest(optics=True, block_sizes=True, inputs=asked))
    )
    wall, wake = (seen.observables[v.file].columns for v in problem.campaign.views)
    gain = wall[ParameterId(ParameterKind.GAIN)]
    assert np.abs(wall[asked[0]] - gain).max() < 0.02 * np.abs(gain).max()
    mirrored = wall[asked[1]]  # (1 - emissivity)/emissivity at the reflected temperature, less where it is hotter
    assert 0.03 < mirrored.min() < mirrored.max() < 1.01 * 0.05 / 0.95
    assert asked[0] not in wake
    assert asked[2] not in wall  # the laboratory's column of the same number serves


# --- verdicts -------------------------------------------------------------------------------------------
KEYS = (
    "contact.pressure", "friction.mu", "block.length", "block.modulus", "block.height", "ambient.temperature",
)  # fmt: skip


@pytest.fixture(scope="module")
def wrong_load(made):
    """The load is told ten percent too high, five prior standard deviations."""
    return checked(made, WRONG_LOAD, KEYS)


def test_a_load_that_is_told_wrong_is_contradicted_by_as_much(wrong_load):
    """The load cell says that friction is right."""
    checks, groups = wrong_load[True].checks, wrong_load[True].groups
    found = checks["contact.pressure"]
    true = found.input.value / WRONG_LOAD
    assert found.verdict is InputVerdict.CONTRADICTED
    assert abs(found.estimate - true) < 4 * found.sd
    assert found.shift == pytest.approx(np.log(1 / WRONG_LOAD) / 0.02, abs=4 * found.sd / true / 0.02)
    assert found.ln_bayes == max(c.ln_bayes for c in checks.values()) > 5
    assert "data require" in found.summary_line
    assert all(c.verdict is not InputVerdict.CONTRADICTED for k, c in checks.items() if k != "contact.pressure")
    assert not any("contact.pressure" in g for g in groups)


def test_an_input_that_does_not_act_cannot_be_checked(wrong_load):
    """Nothing presses unevenly in this case, so the block's modulus does nothing."""
    found = wrong_load[True].checks["block.modulus"]
    assert (found.verdict, found.influence) == (InputVerdict.NOT_CHECKABLE, pytest.approx(0.0, abs=0.1))
    assert found.ln_bayes == pytest.approx(0.0, abs=1e-6)
    assert "hardly depend" in found.summary_line


def test_an_input_that_would_change_less_than_the_model_may_err_is_not_contradicted(wrong_load):
    """However many standard errors: friction moves its trace by as much, the height of a block that stays cool nothing."""
    made = wrong_load[True]
    assert made.changes(ParameterId.of_input("friction.mu")) == pytest.approx(1.0, abs=0.1)
    height = made.changes(ParameterId.of_input("block.height"))
    assert 0.03 * height < CRITERIA.visible_fraction < 0.095 * made.changes(ParameterId.of_input("contact.pressure"))
    plain, faint = made.checks["contact.pressure"], made.faint["contact.pressure"]
    assert (plain.verdict, faint.verdict) == (InputVerdict.CONTRADICTED, InputVerdict.NOT_CHECKABLE)
    assert faint.pull == plain.pull
    assert "hardly depend" in faint.summary_line


@pytest.mark.parametrize(
    ("contradicted", "meshes"), [(("block.height",), [INPUT_CELL_FACTORS, None]), ((), [INPUT_CELL_FACTORS])]
)
def test_inputs_that_data_contradict_are_asked_again_on_the_mesh_of_the_data(monkeypatch, contradicted, meshes):
    """A coarse mesh makes up a column of what changes next to nothing; the exact one replaces it, others stay."""
    height, mu = (ParameterId.of_input(key) for key in ("block.height", "friction.mu"))
    keys, asked, shown = {"block.height": height, "friction.mu": mu}, [], []

    def add(problem, model, predictions, inputs, cells=INPUT_CELL_FACTORS):
        asked.append((tuple(inputs), cells))
        seen = Observable(
            np.zeros(2), np.ones(2, bool), {keys[key]: np.full(2, 1.0 if cells else 0.0) for key in inputs}
        )
        return [Prediction({"a": seen}, None, {})]

    def question(search, final, inputs, predictions):
        shown.append(predictions[0].observables["a"].columns)
        checks = tuple(SimpleNamespace(input=key, is_contradicted=key in contradicted) for key in inputs)
        return assessment.InputAssessment(checks, (), None)

    for name, answer in (("list_stated_inputs", lambda problem: tuple(keys)), ("add_input_columns", add)):
        monkeypatch.setattr(assessment, name, answer)
    monkeypatch.setattr(assessment, "_assess_with_sensitivities", question)
    final = SimpleNamespace(model=None, predictions=())
    assessment.assess_inputs(SimpleNamespace(problem=None), final, lambda text: None)
    assert asked == list(zip((tuple(keys), contradicted), meshes, strict=False))
    assert shown[0][height].tolist() == shown[-1][mu].tolist() == [1.0, 1.0]
    assert shown[-1][height].tolist() == ([0.0, 0.0] if contradicted else [1.0, 1.0])


def test_load_and_friction_are_told_together_where_only_their_product_matters(wrong_load):
    """Without the load cell; the more plausible of the two, friction, has the larger evidence."""
    checks, groups = wrong_load[False].checks, wrong_load[False].groups
    assert {"contact.pressure", "friction.mu"} in groups
    assert checks["friction.mu"].ln_bayes > checks["contact.pressure"].ln_bayes
    assert checks["friction.mu"].verdict is InputVerdict.CONSISTENT


def test_right_inputs_are_not_contradicted(made):
    found = checked(made, 1.0, KEYS)
    for case in found.values():
        assert {c.verdict for c in case.checks.values()} <= {InputVerdict.CONSISTENT, InputVerdict.NOT_CHECKABLE}


def _reduced_set():
    """Errors of set-up: two small ones (0, 1) that one (2) does alone, and one that nothing needs (3)."""
    from flashtemp.discovery.diagnostics.setup_errors import ReducedFit

    act = np.array([[30.0, 0.0, 30.0, 0.1], [0.0, 30.0, 30.0, -0.1]])  # on two data in sigma
    data = act[:, 2]
    names = tuple(ParameterId.of_input(f"key.{k}") for k in range(4))
    return ReducedFit(names, act.T @ data, act.T @ act, np.ones(4))


def test_one_error_of_the_set_up_is_preferred_to_two_that_do_the_same():
    from flashtemp.discovery.diagnostics.setup_errors import _select_stepwise

    sets = _select_stepwise(_reduced_set(), 8.0)
    assert max(sets, key=lambda s: sets[s]) == (2,)
    assert (0, 1) not in sets or sets[(0, 1)] < sets[(2,)]


def test_alternatives_of_a_set_up_error_are_the_best_and_the_fewest(monkeypatch):
    from flashtemp.discovery.diagnostics import setup_errors

    monkeypatch.setattr(setup_errors, "_name_and_words", lambda problem, known, p, value: (p.name, p.name))
    monkeypatch.setattr(setup_errors, "MAX_LISTED_ALTERNATIVES", 1)
    others = [(0, 3), (0,), (3,), (2,)]  # the best first; the last has nothing in place of it
    found = setup_errors._list_alternatives(None, {}, _reduced_set(), (2,), others)
    assert found == (("key.0", "key.0"),)


def test_an_error_of_many_usual_sizes_is_not_shrunk_towards_zero():
    """A clock of 0.138 s that all walls share, seven usual sizes of 0.02 s, was told as 0.12 s +- 0.0077 s."""
    from flashtemp.discovery.diagnostics.setup_errors import ReducedFit

    information = np.diag([0.0077**-2.0, 0.0077**-2.0])
    clocks = (ParameterId(ParameterKind.CLOCK, name="sidewall"), ParameterId(ParameterKind.CLOCK, name="wake"))
    found = ReducedFit(clocks, information @ [0.138, 0.01], information, np.array([0.02, 0.02]))
    assert found.solve((0, 1))[1] == pytest.approx([0.1202, 0.0087], abs=1e-4)
    wide = found.with_local_widths((0, 1))
    assert wide.solve((0, 1))[1] == pytest.approx([0.138, 0.0087], abs=2e-3)  # a usual one is shrunk as before
    assert wide.sd == pytest.approx([0.068, 0.02], abs=2e-3)
    assert found.with_local_widths((1,)).sd == pytest.approx([0.02, 0.02])
