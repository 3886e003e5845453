"""A heat-transfer coefficient that a case states as zero: its prior, its sensitivity, its bound, and a leak that is found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flashtemp.comparison import campaign
from flashtemp.discovery import engine
from flashtemp.discovery.diagnostics.input_checks import compare_inputs_with_data
from flashtemp.discovery.diagnostics.setup_errors import ReducedFit
from flashtemp.discovery.diagnostics.stated_inputs import list_stated_inputs
from flashtemp.discovery.estimation.linear_gaussian import DataBlock, LinearSystem
from flashtemp.discovery.hypotheses.input_kinds import iter_stepped_cases
from flashtemp.discovery.parameters import ParameterId
from flashtemp.discovery.prediction.prediction import DerivativeRequest, predict_condition
from flashtemp.discovery.prediction.problem import prepare_problem
from flashtemp.errors import BadInput

KEY, LEAK, NOISE_K = "ambient.convection", 6.0, 0.05
COLUMN = ParameterId.of_input(KEY)
CASE = """
effects = ["driven_faces"]
[materials.steel]
conductivity = 16.2
density = 8000.0
heat_capacity = 500.0
[block]
material = "steel"
length = 0.02
width = 0.02
height = 0.08
[road]
depth = 0.001
upstream = 0.0
downstream = 0.0
[schedule]
alone = 2000.0
[ambient]
convection = CONVECTION
[driven_faces]
face = [[0.0, 80.0]]
back = [[0.0, 20.0]]
[numerics]
cells = [3, 20, 3]
first_x = 0.005
last_x = 0.005
first_block = 1e-3
"""


def write_campaign(folder, values=None, convection=0.0, more=""):
    """Three thermocouples whose zeros are known along a rod with held ends; the last readings are held out."""
    (folder / "case.toml").write_text(CASE.replace("CONVECTION", str(convection)))
    t, z = np.arange(100.0, 2000.0, 100.0), (0.02, 0.04, 0.06)
    values = np.full((len(t), 3), 20.0) if values is None else values
    points = ", ".join(f'{{ name = "z{n}", x = 0.01, z = {h}, zero_sigma_K = 0.0 }}' for n, h in enumerate(z))
    text = 'case = "case.toml"\ncandidates = ["radiation"]\n' + more
    for file, part, end in (("early.csv", slice(12), ""), ("late.csv", slice(12, None), "held_out = true\n")):
        np.savetxt(folder / file, np.column_stack([t, values])[part], delimiter=",")
        text += f'[[recording]]\nview = "points"\nfile = "{file}"\npoints = [{points}]\nsigma_K = {NOISE_K}\n{end}'
    (folder / "campaign.toml").write_text(text)
    return campaign.load(folder)


def prepare(made):
    return prepare_problem(made, lambda tasks: [predict_condition(t) for t in tasks])


def predict(made, request=None):
    problem = prepare(made)
    [seen] = problem.predict(problem.make_tasks(problem.stated_model, request or DerivativeRequest()))
    return np.concatenate([seen.observables[f].values[:, 0] for f in ("early.csv", "late.csv")]), seen


def stated(problem):
    return {i.key: i for i in list_stated_inputs(problem)}


def test_an_insulated_surface_has_a_prior_about_zero(tmp_path):
    found = stated(prepare(write_campaign(tmp_path)))[KEY]
    assert (found.value, found.sd, found.relative, found.from_zero) == (0.0, 5.0, False, True)
    assert found.changed_value(3.0, 0.5) == (3.0, 0.5)


def test_a_campaign_states_how_well_a_surface_is_insulated_in_its_unit(tmp_path):
    told = write_campaign(tmp_path, more=f'known = {{ "{KEY}" = "1 W/m2K" }}\n')
    assert stated(prepare(told))[KEY].sd == 1.0
    with pytest.raises(BadInput, match="a fraction of zero means nothing"):
        stated(prepare(write_campaign(tmp_path, more=f'known = {{ "{KEY}" = 0.1 }}\n')))


def test_a_surface_that_only_some_conditions_insulate_is_known_by_its_factor(tmp_path):
    """A factor leaves zero as it is, in the prior and in the derivative."""
    made = write_campaign(tmp_path, convection=10.0)
    first, second = made.views
    problem = prepare(replace(made, views=(first, replace(second, given={KEY: 0.0}))))
    found = stated(problem)[KEY]
    assert (found.values, found.relative, found.from_zero) == ((10.0,), True, False)
    [[case, _], *_] = iter_stepped_cases(problem.case.with_values({KEY: 0.0}), KEY)
    assert case[KEY] == 0.0


def test_the_derivative_at_zero_agrees_with_the_difference_of_two_runs(tmp_path):
    request = DerivativeRequest(inputs=(COLUMN,), zero_inputs=frozenset({COLUMN}))
    still, seen = predict(write_campaign(tmp_path), request)
    warm, _ = predict(write_campaign(tmp_path, convection=0.2))
    column = seen.observables["early.csv"].columns[COLUMN]
    difference = ((warm - still) / 0.2)[: len(column)]
    assert np.abs(difference).max() > 0.1  # K per W/m2K
    assert column == pytest.approx(difference, abs=0.02 * np.abs(difference).max())


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_leak_cannot_be_negative(tmp_path, sign):
    """Data that want less than nothing are no evidence for a leak."""
    found = stated(prepare(write_campaign(tmp_path)))[KEY]
    rng = np.random.default_rng(1)
    act = rng.normal(size=(40, 1))
    data = sign * 2.0 * act[:, 0] + 0.1 * rng.normal(size=40)
    system = LinearSystem([make_block(act, data)])
    [check] = compare_inputs_with_data(system, {}, None, [found], lambda p: 1.0)
    reduced = ReducedFit((COLUMN,), act.T @ data, act.T @ act, np.array([5.0]), frozenset({0}))
    ln_evidence, [value], _ = reduced.solve((0,))
    if sign > 0:
        assert (check.estimate, value) == pytest.approx((2.0, 2.0), abs=0.1)
        assert min(check.ln_bayes, ln_evidence) > 20.0
        assert "the data require 2" in check.summary_line
        assert "known to 5 W/m2K" in check.summary_line
    else:
        assert check.estimate == value == ln_evidence == 0.0
        assert check.ln_bayes < 0.0


def make_block(columns, data):
    empty = np.zeros((len(data), 0), np.float32)
    return DataBlock("a", 0, False, data, columns, ((COLUMN, 0),), empty, np.zeros((0, 0)))


@pytest.mark.long
def test_a_leak_through_insulation_competes_with_radiation(tmp_path):
    """Both cool the rod about alike: the verdict names both, with the coefficient that the data want."""
    values, _ = predict(write_campaign(tmp_path, convection=LEAK))
    values = values + NOISE_K * np.random.default_rng(4).normal(size=values.shape)
    verdict, search = engine.discover(write_campaign(tmp_path, values), workers=1)
    assert KEY in {a.key for a in search.input_alternatives}
    assert verdict.kind == "group", verdict.says
    assert set(verdict.group) == {"radiation", KEY}
