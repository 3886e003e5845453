"""Free-form laws: the file of each, where its nodes are, its runs and derivatives, and the heat capacity they may move."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad

from flashtemp.__main__ import main
from flashtemp.discovery.hypotheses import piecewise_linear_law as laws_module
from flashtemp.discovery.hypotheses.formula_fit import fit_simplest_formula
from flashtemp.discovery.hypotheses.piecewise_linear_law import (
    LEARNABLE_QUANTITIES,
    REGRESSORS,
    PiecewiseLinearLaw,
    candidate_laws,
    effect_source,
    graded_nodes,
    node_positions,
)
from flashtemp.errors import SolverFailure
from flashtemp.model.case import assemble_case, load_case
from flashtemp.model.case_file import KeyLocations
from flashtemp.physics.effects.radiation import STEFAN_BOLTZMANN_W_M2K4
from flashtemp.physics.quantities import KELVIN
from flashtemp.physics.user_effects import read_effect
from flashtemp.runs.checks.effect_check import law_checks, run_checks
from flashtemp.runs.checks.effect_check.fixtures import EffectUnderTest, SceneCache
from flashtemp.runs.load_run import open_run
from flashtemp.solver.enthalpy import CapacityTable, TabulatedCapacity
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.perturbed_run import Perturbation
from flashtemp.solver.sensitivity import run_with_sensitivities
from flashtemp.solver.time_integration import integrate_schedule

TINY = {
    "numerics.mesh": 0.25, "schedule.distance": 0.2, "schedule.repetitions": 2, "schedule.wait": 2.0,
    "road.track_length": 0.2, "output.profiles": 10,
}  # fmt: skip
LAYERED = """
[materials.hard]
conductivity = 15.0
density = 1000.0
heat_capacity = 3900.0
[materials.soft]
conductivity = 0.3
density = 1000.0
heat_capacity = 1500.0
[layers.disc]
material = "hard"
thickness = 0.002
[layers."back board"]
material = "soft"
thickness = 0.006
"""
QUANTITIES = {q.name: q for q in LEARNABLE_QUANTITIES}
PAIRS = [(q.name, r) for q in LEARNABLE_QUANTITIES for r in q.regressors]
REACHED = {
    "temperature": (20.0, 80.0), "inside": (20.0, 60.0), "wall": (20.0, 50.0), "speed": (0.05, 0.8),
    "pressure": (5e4, 2e5), "place": (0.0, 0.025), "track": (0.0, 0.16), "slid": (0.0, 2.0), "passed": (0.0, 9.0),
    "time": (0.0, 30.0), "repetition": (1.0, 10.0),
}  # fmt: skip
SINCE = [  # laws that the engine came to know last: of each way into it one
    ("block_capacity", "inside"), ("road_capacity", "inside"), ("walls", "wall"), ("holder", "wall"),
    ("friction", "track"), ("resistance", "repetition"),
]  # fmt: skip


def law(quantity, regressor, shares=(0.9, 0.2, 0.5, 0.7, 0.4)):
    """A law over what a test reaches, its values shares of what is typical; over a track it closes."""
    q = QUANTITIES[quantity]
    nodes = graded_nodes(*REACHED[regressor], len(shares))
    period = 0.2 if regressor == "track" else None
    return PiecewiseLinearLaw(q, REGRESSORS[regressor], nodes, tuple(q.typical_size * v for v in shares), period)


def case(folder, *some, given=None, text=""):
    """A case in a folder with the files of some laws, each named as a candidate is."""
    for one in some:
        (folder / f"{one.name}.py").write_text(effect_source(one))
    listed = ", ".join(f'"./{one.name}.py"' for one in some)
    (folder / "case.toml").write_text(f"effects = [{listed}]\n{text}")
    return load_case(folder / "case.toml", TINY | (given or {}), trust=True)


def plain_case(given=None):
    """The case without any law."""
    return assemble_case({}, TINY | (given or {}), KeyLocations("none"), Path(), "plain")


@cache
def plain_run():
    """Its run."""
    made = plain_case()
    return integrate_schedule(made.scene, made.settings)


# --- the file -----------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("pair", PAIRS, ids="-".join)
def test_the_file_states_the_law(pair, tmp_path):
    """Every law of the file is numpy's interpolation between the nodes, at what the engine hands over."""
    made = law(*pair)
    (tmp_path / "learned.py").write_text(effect_source(made))
    effect = read_effect(tmp_path / "learned.py")
    p = SimpleNamespace(**{k: v.value for k, v in effect.params().items()})
    low, high = made.domain
    at = np.linspace(low - 0.1 * (high - low), high + 0.1 * (high - low), 29)
    now = SimpleNamespace(speed=at, local_pressure=at, x=at, slid=at, passed=at, t=at, repetition=at, ambient=KELVIN)
    expected = np.interp(at, made.nodes, made.values, period=made.period)
    parts = list(effect().heat(None, p))
    assert [getattr(part, "site", None) or part.target for part in parts] == list(made.quantity.targets)
    for part in parts:
        got = part.law(now, p) if getattr(part, "kind", "") == "film" else part.law(at + KELVIN, now, p)
        if pair[1] == "wall":
            expected_here = -expected * at  # W/m2 into the body, the air being at 0 degC
        else:
            expected_here = np.exp(expected) if made.quantity.action == "factor" else expected
        np.testing.assert_allclose(got, expected_here, rtol=1e-4, atol=1e-12)


@pytest.mark.parametrize("pair", SINCE[:5], ids="-".join)
def test_the_file_reads_like_one_of_the_catalogue(pair, tmp_path):
    """Words, units, bounds, example, and laws point by point: the battery without its runs."""
    (tmp_path / "learned.py").write_text(effect_source(law(*pair)))
    trial, bench = EffectUnderTest("learned", read_effect(tmp_path / "learned.py"), {}), SceneCache()
    found = [look(trial) for look in run_checks.FILE_CHECKS] + law_checks.check_laws(bench, trial)
    assert [f.says for f in found if not f.ok] == []
    assert {"example", "derivatives", "pointwise", "ends"} <= {f.name for f in found}
    assert law_checks.find_laws_not_off(bench, trial) == []


@pytest.mark.parametrize("name", ["disc", "back board", 'a "b" \\ é {x}'])
def test_the_file_of_a_layer_names_it_whatever_its_name(name, tmp_path):
    quantity = replace(QUANTITIES["block"], layer=name)
    (tmp_path / "learned.py").write_text(effect_source(replace(law("block", "inside"), quantity=quantity)))
    effect = read_effect(tmp_path / "learned.py")
    scene = SimpleNamespace(layers=[SimpleNamespace(name=name)], in_layer=lambda asked: 1.0 * np.array([asked == name]))
    p = SimpleNamespace(**{k: v.value for k, v in effect.params().items()})
    [part] = effect().heat(scene, p)
    assert part.law(np.array([[[293.15]]]), None, p).item() == pytest.approx(np.exp(0.27))
    assert all(f.ok for f in [look(EffectUnderTest("learned", effect, {})) for look in run_checks.FILE_CHECKS])


# --- which laws are offered -----------------------------------------------------------------------------------------
def offered(made, run=None):
    """{(quantity, regressor): law} of what a campaign of one condition offers."""
    run = run or integrate_schedule(made.scene, made.settings)
    return {(w.quantity.name, w.regressor.name): w for w in candidate_laws([run], [made.scene])}


def test_places_on_the_track_are_offered_only_where_the_block_comes_round_again():
    again = offered(plain_case(), plain_run())
    assert {q for q, r in again if r == "track"} == {"friction", "spot_fraction", "resistance"}
    assert again["friction", "track"].period == 0.2
    assert np.diff(again["friction", "track"].nodes) == pytest.approx(0.04)
    scene = plain_case().scene

    def nodes(*scenes):
        return node_positions(QUANTITIES["friction"], "track", [plain_run()] * 2, scenes)

    assert nodes(scene, scene)
    assert nodes(replace(scene, track_length=0.4), replace(scene, track_length=0.4)) == ()  # just round
    assert nodes(scene, replace(scene, track_length=0.15)) == ()  # whose track?
    back = replace(scene, schedule=replace(scene.schedule, turn=1))
    assert nodes(back, back) == ()  # places do not follow from the distance


def test_properties_and_walls_are_offered_where_their_temperature_varies():
    warm, cold = offered(plain_case(), plain_run()), offered(plain_case({"friction.mu": 0.02}))
    for pair in (("block_capacity", "inside"), ("road_capacity", "inside"), ("walls", "wall")):
        assert pair in warm
        assert pair not in cold
    run = plain_run()
    assert warm["block_capacity", "inside"].nodes == warm["block", "inside"].nodes
    assert warm["walls", "wall"].nodes[-1] == pytest.approx(run.T_block.max(), abs=0.5)
    assert ("holder", "wall") not in warm  # heat has not come so far


def test_repetitions_are_offered_where_there_are_several():
    several, one = offered(plain_case(), plain_run()), offered(plain_case({"schedule.repetitions": 1}))
    assert {q for q, r in several if r == "repetition"} == {"friction", "spot_fraction", "resistance"}
    assert {q for q, r in one if r == "repetition"} == set()


def test_layers_have_laws_of_their_own_in_place_of_the_block(tmp_path):
    made = offered(case(tmp_path, given={"schedule.wait": 20.0}, text=LAYERED))
    names = {q for q, _ in made}
    assert {"layer_1_conductivity", "layer_1_capacity", "layer_2_conductivity", "layer_2_capacity"} <= names
    assert not names & {"block", "block_capacity"}
    assert made["layer_2_capacity", "inside"].description == (
        "the heat capacity of layer back board changes with its own temperature"
    )
    first, second = (made[f"layer_{n}_capacity", "inside"].nodes[-1] for n in (1, 2))
    assert second <= first + 0.01  # farther from the contact


def test_a_block_by_itself_has_no_laws_of_the_contact():
    made = offered(plain_case({"schedule.alone": 20.0, "effects": ["heated_face"]}))
    targets = {t for w in made.values() for t in w.quantity.targets}
    assert not any(t.startswith(("friction.", "contact.")) for t in targets)
    assert {"block.heat_capacity", "block.conductivity", "block.leading"} <= targets


def test_nodes_around_a_track_are_refined_around_it():
    made = law("friction", "track")
    nodes = graded_nodes(0.0, 0.2, 6)[:-1]
    finer = replace(made, nodes=nodes).refined_nodes
    assert len(finer) == 10
    assert np.diff([*finer, 0.2]) == pytest.approx(0.02)


# --- its runs -------------------------------------------------------------------------------------------------------
def test_a_case_with_the_files_runs(tmp_path, capsys):
    """Laws of all new kinds at once, and no heat is lost."""
    case(tmp_path, *(law(*pair) for pair in SINCE))
    quick = {"numerics.mesh": 0.15, "output.pictures": "false", "output.vtk": "false"}
    keys = [f"{k}={v}" for k, v in (TINY | quick).items()]
    out = tmp_path / "out"
    assert main(["run", str(tmp_path / "case.toml"), *keys, "--trust", "--out", str(out)]) == 0, capsys.readouterr()
    told, run = open_run(out, trust=True)
    assert set(told.effects) == {law(*pair).name for pair in SINCE}
    assert abs(run.energy_imbalance) < 1e-12


@pytest.mark.parametrize("pair", SINCE, ids="-".join)
def test_a_law_of_zeros_changes_nothing(pair, tmp_path):
    """A factor of 1, a term or film of 0: cells that no law moves keep their state to the last bit."""
    off = case(tmp_path, law(*pair, shares=(0.0,) * 5))
    run, same = plain_run(), integrate_schedule(off.scene, off.settings)
    if pair[1] == "wall":  # heat of a patch is summed beside that of films
        np.testing.assert_allclose(same.T_block, run.T_block, rtol=1e-9)
    else:
        np.testing.assert_array_equal(same.T_block, run.T_block)


NODE = {("walls", "wall"): 2, ("friction", "track"): 2}  # that is moved, where it is not the first


@pytest.mark.parametrize("pair", [SINCE[n] for n in (0, 1, 2, 4)], ids="-".join)
def test_derivatives_by_nodes_are_those_of_full_marches(pair, tmp_path):
    """Sensitivities beside one run with the law at work, against central differences of full marches.

    Sensitivities take steps of a tenth of the sliding (in the root of time): a few per cent of a hat function in time.
    """
    own, size = law(*pair, shares=(0.9, 0.2, 0.5)), QUANTITIES[pair[0]].typical_size
    made = case(tmp_path, own, given={"schedule.repetitions": 1})
    key, times = (
        f"{own.name}.at_{NODE.get(pair, 1)}",
        tuple(s * made.scene.schedule.end_time for s in (0.65, 0.8, 1.0)),
    )
    settings = replace(made.settings, times=times)

    def moved(step):
        return made.with_values({key: made[key] + step}).scene

    def at_times(run):
        return run.T_block[[int(np.flatnonzero(run.time == t)[0]) for t in times]]

    hood = run_with_sensitivities(
        made.scene, settings, {pair: Perturbation(moved(0.01 * size), 0.01 * size)}, "", times, True
    )
    up, down = (
        at_times(integrate_schedule(moved(s * size), replace(settings, rtol=1e-5, atol=1e-4))) for s in (0.1, -0.1)
    )
    slope = (up - down) / (0.2 * size)
    assert np.abs(slope).max() * size > 0.05  # K: it is seen at all
    assert np.sqrt(np.mean((hood.derivative_of(at_times, pair) - slope) ** 2)) < 0.05 * np.sqrt(np.mean(slope**2))


# --- what the catalogue says in another way ---------------------------------------------------------------------------
def imitation(quantity, regressor, curve, low=20.0, high=80.0, count=17):
    """A law whose values at nodes are those of a curve, and the largest error of the line between them."""
    q, nodes = QUANTITIES[quantity], graded_nodes(low, high, count)
    at = np.linspace(low, high, 2001)
    values = curve(np.array(nodes))
    error = float(np.abs(np.interp(at, nodes, values) - curve(at)).max())
    return PiecewiseLinearLaw(q, REGRESSORS[regressor], nodes, tuple(map(float, values))), error


@pytest.mark.parametrize(
    ("quantity", "key", "slope"),
    [
        ("block", "conductivity_slope.block", -0.004), ("road", "conductivity_slope.road", 0.01),
        ("block_capacity", "capacity_slope.block", 0.01), ("road_capacity", "capacity_slope.road", 0.02),
    ],
)  # fmt: skip
@pytest.mark.sample("block-*", "road_capacity-*")
def test_a_law_that_equals_an_effect_of_the_catalogue_gives_its_temperatures(quantity, key, slope, tmp_path):
    """A relative error e of k or c moves a rise by at most e of it: rises go as (k c)^-1/2, at fixed heat as c^-1."""
    made, error = imitation(quantity, "inside", lambda T: np.log(1.0 + slope * (T - 20.0)))
    effect = key.split(".")[0]
    alone = {f"{effect}.block": 0.0, f"{effect}.road": 0.0} | {key: slope}
    other = case(tmp_path, given={"effects": [effect], "numerics.rtol": 1e-5} | alone)
    own = case(tmp_path, made, given={"numerics.rtol": 1e-5})
    run, imitated = (integrate_schedule(c.scene, c.settings) for c in (other, own))
    rise = run.T_block.max() - 20.0
    moved = np.abs(run.T_block - plain_run().T_block).max()
    rounding = 1e-4  # of values written with five digits, and of the integrator
    assert np.abs(imitated.T_block - run.T_block).max() < (error + rounding) * rise
    assert moved > 10.0 * (error + rounding) * rise


def test_a_film_over_the_temperature_of_the_wall_radiates(tmp_path):
    """Films of eps sigma (T^2 + T_a^2)(T + T_a): the walls lose what radiation takes, which grows as T^4."""
    Ta = 20.0 + KELVIN

    def film(T):
        return 0.95 * STEFAN_BOLTZMANN_W_M2K4 * ((T + KELVIN) ** 2 + Ta**2) * (T + KELVIN + Ta)

    made, error = imitation("walls", "wall", film, 20.0, 320.0)
    alone = {
        "schedule.alone": 400.0, "heated_face.irradiance": 3e3, "ambient.convection": 0.0, "limits.temperature": 600.0,
        "numerics.rtol": 1e-5,
    }  # fmt: skip
    own = case(tmp_path, made, given={"numerics.rtol": 1e-5}).with_values(
        {"effects": [made.name, "heated_face"]} | alone
    )
    others = (case(tmp_path, given=alone | {"effects": ["heated_face", *e]}) for e in (["radiation"], []))
    run, radiating, insulated = (integrate_schedule(c.scene, c.settings) for c in (own, *others))
    lost = insulated.T_block.max() - radiating.T_block.max()
    assert lost > 5.0
    # an error of the film moves what is lost by its share
    assert np.abs(run.T_block - radiating.T_block).max() < (error / film(20.0) + 1e-3) * lost


# --- the heat capacity that laws move ---------------------------------------------------------------------------------
def wavy(rise):
    """c/c0 with a bend, a peak and a fall: none of it a line."""
    return 1.0 + 0.004 * rise + 0.5 * np.exp(-0.5 * ((rise - 60.0) / 8.0) ** 2) - 1e-6 * rise**2


def test_enthalpy_is_the_integral_of_the_heat_capacity():
    """Against adaptive quadrature; trapezia of 0.5 K err by h^2/12 c'' over the range, c'' below 0.5/8^2."""
    rises = np.arange(-150.0, 400.5, 0.5)
    table = CapacityTable.tabulate(rises, wavy(rises))
    for rise in (-40.0, 0.0, 0.3, 59.9, 61.24, 200.0):
        exact = quad(wavy, 0.0, rise, points=[60.0] if rise > 60.0 else None, epsabs=1e-10)[0]
        assert table.enthalpy_rise(np.array([rise])).item() == pytest.approx(
            exact, abs=0.5**2 / 12 * 0.5 / 8.0**2 * 200.0
        )
    at = np.linspace(-140.0, 390.0, 999)
    np.testing.assert_allclose(table.temperature_rise(table.enthalpy_rise(at)), at, atol=1e-11)
    eps = 1e-30
    np.testing.assert_allclose(table.enthalpy_rise(at + 1j * eps).imag / eps, table.interpolate_ratio(at), rtol=1e-12)


def test_a_heat_capacity_that_ends_is_told():
    rises = np.arange(-150.0, 400.5, 0.5)
    table = CapacityTable.tabulate(rises, 1.0 - rises / 100.0)
    assert table.temperature_rise(np.array([10.0])).item() == pytest.approx(100.0 * (1.0 - np.sqrt(0.8)), abs=1e-9)
    with pytest.raises(SolverFailure, match="heat capacity fell to zero"):
        table.temperature_rise(np.array([51.0]))  # the integral to the end is 50 K
    with pytest.raises(SolverFailure, match="heat capacity fell to zero"):
        CapacityTable.tabulate(rises, rises / 100.0)


def test_each_layer_has_the_heat_capacity_of_its_own_law(tmp_path):
    quantity = replace(QUANTITIES["block_capacity"], name="layer_2_capacity", layer="back board")
    made = case(tmp_path, replace(law("block_capacity", "inside"), quantity=quantity), text=LAYERED)
    balance = HeatBalance(made.scene)
    assert isinstance(balance.heat_capacity, TabulatedCapacity)
    mesh = made.scene.mesh
    rise = np.full(balance.n, 10.0)
    relative = mesh.planes(balance.capacity_ratio(rise))[..., 0]
    hard, soft = mesh.layers
    expected = np.exp(
        np.interp(30.0, *map(np.array, (law("block_capacity", "inside").nodes, law("block_capacity", "inside").values)))
    )
    np.testing.assert_array_equal(relative[mesh.block[:, hard]], 1.0)
    np.testing.assert_allclose(relative[mesh.block[:, soft]], expected, rtol=1e-4)
    np.testing.assert_array_equal(relative[mesh.road], 1.0)
    run = integrate_schedule(made.scene, made.settings)
    assert abs(run.energy_imbalance) < 1e-12


# --- a formula around a track ---------------------------------------------------------------------------------------
def test_a_wave_around_the_track_is_told_as_one():
    made = law("friction", "track")
    nodes = graded_nodes(0.0, 0.2, 11)[:-1]
    share = np.array(nodes) / 0.2
    values = np.log(1.1 * (1.0 + 0.2 * np.cos(2.0 * np.pi * (share - 0.3))))
    found = fit_simplest_formula(replace(made, nodes=nodes, values=tuple(values)), 1e-4 * np.eye(10))
    assert found is not None
    assert found.name == "harmonic"
    assert found.numbers[0] == pytest.approx(1.1, abs=0.02)
    assert abs(found.numbers[1]) == pytest.approx(0.2, abs=0.02)


def test_every_regressor_has_nodes():
    assert set(laws_module._POSITIONS) == set(REGRESSORS)
    assert {r for q in LEARNABLE_QUANTITIES for r in q.regressors} == set(REGRESSORS)


def test_laws_of_the_block_name_no_material_that_it_need_not_have():
    assert not any("rubber" in f"{q.name} {q.description}" for q in LEARNABLE_QUANTITIES)
    assert QUANTITIES["block_capacity"].description == "the heat capacity of the block"
