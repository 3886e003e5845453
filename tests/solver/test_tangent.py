"""Differences of neighbouring runs against central differences of full marches, and what they must leave alone."""

from __future__ import annotations

from dataclasses import fields, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from flashtemp.discovery.hypotheses.discrepancy_effects import add_friction_scatter
from flashtemp.model import numerics
from flashtemp.model.build import first_cells
from flashtemp.model.case import assemble_case, load_case
from flashtemp.model.case_file import KeyLocations
from flashtemp.solver.conjugate_residuals import MAX_RESIDUAL_RATIO, solve_shifted_system
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.mesh_mapping import stretch_mesh
from flashtemp.solver.perturbed_run import Perturbation
from flashtemp.solver.run import Run
from flashtemp.solver.sensitivity import run_with_sensitivities
from flashtemp.solver.system import PhaseSystem
from flashtemp.solver.time_integration import integrate_schedule

CASES = Path(__file__).parents[2] / "cases"
SMALL = {
    "block.height": 0.005, "road.depth": 0.01, "road.track_length": 0.1, "schedule.distance": 0.2,
    "schedule.repetitions": 2, "schedule.wait": 1.0, "numerics.mesh": 0.3, "numerics.first_block": 1e-5,
    "output.profiles": 20,
}  # fmt: skip
RESTING = {"schedule.lifted": False}
ROUND = {"effects": ["track_memory"], "track_memory.strength": 0.5}  # two laps in each repetition
EDGE = {"effects": ["edge_pressure"], "edge_pressure.B": 4.0}
WORN = EDGE | {"effects": ["edge_pressure", "wear"], "wear.rate": 6e-11, "block.stiffness": 1.4e9}
MOVES = {  # key: value of the base, step of the trace, step of the full marches
    "friction.mu": (1.0, 1e-3, 2e-2),
    "contact.spot_fraction": (0.2, 2e-4, 2e-3),
    "ambient.convection": (10.0, 1e-1, 5e-1),
    "contact.pressure": (1.5e5, 150.0, 1500.0),
    "block.stiffness": (1.4e9, 1.4e6, 1.4e7),
    "pressure_tilt.a": (0.0, 5e-3, 2e-2),
    "edge_pressure.B": (0.0, 4e-2, 1e-1),
    "friction_softening.b": (0.0, 6e-5, 3e-4),
    "interface_resistance.resistance": (0.0, 2e-7, 2e-6),
    "conductivity_slope.block": (0.0, -2e-5, 2e-4),
    "capacity_slope.block": (0.0, 3e-5, 4e-4),
    "heat_depth.share": (0.0, 2e-3, 2e-2),
    "ambient_drift.rate": (0.0, 5e-5, 5e-3),
    "track_memory.strength": (0.0, 1e-3, 1e-1),
    "wear.rate": (0.0, 6e-13, 3e-12),
    "conductivity_anisotropy.excess": (0.0, 3e-3, 3e-2),
}
ONE_SIDED = {  # below off there is nothing
    "interface_resistance.resistance", "capacity_slope.block", "heat_depth.share", "track_memory.strength", "wear.rate",
}  # fmt: skip
SHARES = (0.12, 0.35, 0.47, 0.6, 0.77, 0.93, 1.0)  # of the schedule: moments that are compared
BOUNDS = {"T_block": 0.01, "T_wake": 0.026, "field": 0.02, "friction": 0.003}  # relative, rms: twice what is found
FAINT = {"T_wake": 0.05, "field": 0.1}  # of the rms on the block's surface: what is smaller need not be as sure


@cache
def _case(given):
    given = {k: list(v) if isinstance(v, tuple) else v for k, v in given}
    return assemble_case({}, SMALL | given, KeyLocations("none"), Path(), "neighbours")


@cache
def _scene(given):
    return _case(given).scene


def frozen(given):
    return tuple((k, tuple(v) if isinstance(v, list) else v) for k, v in given.items())


def case(given):
    return _case(frozen(given))


def scene(given):
    return _scene(frozen(given))


def moved(given, key, value):
    """The case with one key changed, its effect added where it is not there yet."""
    effect, effects = key.split(".")[0], given.get("effects", [])
    if effect not in (*effects, "friction", "contact", "ambient", "block"):
        given = given | {"effects": [*effects, effect]}
    return given | {key: value}


def moments(given):
    return tuple(float(s * scene(given).schedule.end_time) for s in SHARES)


def asked(given, **changed):
    return replace(case(given).settings, times=moments(given), **changed)


@cache
def _exact(given):
    given = {k: list(v) if isinstance(v, tuple) else v for k, v in given}
    return integrate_schedule(scene(given), asked(given, rtol=1e-7, atol=1e-6, order=5))


def exact(given):
    return _exact(frozen(given))


def see(run, name, times):
    at = [int(np.flatnonzero(run.time == t)[0]) for t in times]
    if name == "field":
        return run.field[[int(np.flatnonzero(run.frames == i)[0]) for i in at]].astype(float)
    return getattr(run, name)[at]


def differences(given, key, times):
    """{name: d/d(key)} of full marches with tight tolerance."""
    base, _, step = MOVES[key]
    base = given.get(key, base)
    if key in ONE_SIDED and key not in given:
        runs, weights = [exact(moved(given, key, base + s * step)) for s in (0.0, 0.5, 1.0)], (-3.0, 4.0, -1.0)
    else:
        runs, weights = [exact(moved(given, key, base + s * step)) for s in (-1.0, 1.0)], (-0.5, 0.5)
    return {k: sum(w * see(r, k, times) for w, r in zip(weights, runs, strict=True)) / step for k in BOUNDS}


def traces(given, keys):
    """The neighbourhood of a case with these keys moved, all beside one run."""
    moves = {}
    for key in keys:
        base, step, _ = MOVES[key]
        moves[key] = Perturbation(scene(moved(given, key, given.get(key, base) + step)), step)
    return run_with_sensitivities(scene(given), asked(given), moves, "", moments(given), True)


def rms(values):
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else 0.0


def errors(hood, given, key):
    """{name: rms error of a trace over its rms} at the moments compared."""
    times = moments(given)
    truth, out = differences(given, key, times), {}
    for name, expected in truth.items():
        found = hood.derivative_of(lambda run, name=name: see(run, name, times), key)
        good = np.isfinite(expected)
        assert np.array_equal(good, np.isfinite(found))
        floor = FAINT.get(name, 0.0) * rms(truth["T_block"])
        out[name] = rms((found - expected)[good]) / max(rms(expected[good]), floor, 1e-9 / MOVES[key][2])
    return out


def check(hood, given, key, **bounds):
    found = errors(hood, given, key)
    print(key, {k: f"{v:.4f}" for k, v in found.items()})
    for name, error in found.items():
        assert error <= (BOUNDS | bounds)[name], f"{key}: {name}: {error:.4f}"


# --- traces against full marches ---------------------------------------------------------------------
BARE = [k for k in MOVES if k not in ("track_memory.strength", "wear.rate", "contact.pressure", "block.stiffness")]


@pytest.fixture(scope="module")
def bare():
    return traces({}, BARE)


@pytest.mark.parametrize("key", BARE)
@pytest.mark.sample("edge_pressure.B")
def test_trace_of_one_parameter(bare, key):
    check(bare, {}, key)


KEPT = ["friction.mu", "contact.spot_fraction", "pressure_tilt.a", "interface_resistance.resistance"]


@pytest.fixture(scope="module")
def resting():
    return traces(RESTING, KEPT)


@pytest.mark.parametrize("key", KEPT)
@pytest.mark.sample("friction.mu")
def test_trace_with_a_block_that_rests_on_the_road(resting, key):
    check(resting, RESTING, key)


@pytest.mark.parametrize(
    ("given", "keys"),
    [
        pytest.param(ROUND, ("friction.mu", "track_memory.strength"), id="laps", marks=pytest.mark.long),
        pytest.param(ROUND | RESTING, ("friction.mu",), id="laps-resting"),
        pytest.param(EDGE, ("wear.rate",), id="wear-begins"),
        pytest.param(
            WORN, ("friction.mu", "contact.pressure", "block.stiffness"), id="wear-goes-on", marks=pytest.mark.long
        ),
    ],
)
@pytest.mark.long  # traces of single parameters are quicker siblings
def test_trace_beside_effects_that_remember(given, keys):
    hood = traces(given, keys)
    for key in keys:
        check(hood, given, key)


def test_trace_of_what_slid_first_as_long_as_it_may_be_seen():
    """Long steps smear the front of the road that the block met first: its wake was 9 to 15 % off soon after a start."""
    key, plain = "contact.spot_fraction", scene({})
    base, step, apart = MOVES[key]
    times = tuple(d / plain.speeds[1] for d in (0.05, 0.08, 0.12))
    hood = run_with_sensitivities(
        plain,
        replace(case({}).settings, times=times),
        {key: Perturbation(scene(moved({}, key, base + step)), step)},
        "",
        times,
    )
    tight = replace(case({}).settings, times=times, rtol=1e-7, atol=1e-6, order=5)
    above, below = (
        see(integrate_schedule(scene(moved({}, key, base + s * apart)), tight), "T_wake", times) for s in (1.0, -1.0)
    )
    expected = (above - below) / (2.0 * apart)
    found = hood.derivative_of(lambda run: see(run, "T_wake", times), key)
    assert rms((found - expected)[np.isfinite(expected)]) < 0.02 * rms(expected[np.isfinite(expected)])


@pytest.mark.long
def test_trace_of_the_tracks_memory_from_nothing():
    """Coarser than others: where no heat comes round yet, the laps of the run are no events."""
    check(traces({}, ["track_memory.strength"]), {}, "track_memory.strength", T_block=0.05, T_wake=0.05, field=0.06)


@pytest.mark.parametrize("binding", numerics.installed_bindings())
def test_either_binding(binding):
    check(traces({"numerics.integrator": binding}, ["friction.mu"]), {}, "friction.mu")


def test_trace_of_friction_that_oscillates_beside_traces_that_do_not():
    """Steps that suit the others are longer than a period: its face was half off."""
    wave = {"effects": ["stick_slip"], "stick_slip.wavelength": 0.05}
    plain, others = scene({}), ("friction.mu", "contact.spot_fraction", "ambient.convection", "contact.pressure")
    perturbations = {
        key: Perturbation(scene(moved({}, key, MOVES[key][0] + MOVES[key][1])), MOVES[key][1]) for key in others
    } | {"stick_slip.amplitude": Perturbation(scene(wave | {"stick_slip.amplitude": 1e-3}), 1e-3)}
    hood = run_with_sensitivities(plain, asked({}), perturbations, "", moments({}))
    with_waves, without = exact(wave | {"stick_slip.amplitude": 0.1}), exact(wave | {"stick_slip.amplitude": 0.0})
    expected = (see(with_waves, "T_block", moments({})) - see(without, "T_block", moments({}))) / 0.1
    found = hood.derivative_of(lambda run: see(run, "T_block", moments({})), "stick_slip.amplitude")
    assert rms(found - expected) < 0.1 * rms(expected)
    check(hood, {}, "friction.mu")


@pytest.mark.long  # traces of a block that slides are quicker siblings
def test_trace_of_a_source_that_has_passed():
    """Its heat has spread, and is a hundredth of what it was under the source: half of the trace was wrong.

    Everything is linear, so that all of the rise goes with the strength of the source.
    """
    milled, times, key = load_case(CASES / "face_milling"), (5.0, 187.0), "moving_source.strength"
    moved_keys = (key, "moving_source.speed", "ambient.convection")
    moves = {k: Perturbation(milled.with_values({k: 1.001 * milled[k]}).scene, 0.001) for k in moved_keys}
    hood = run_with_sensitivities(milled.scene, replace(milled.settings, times=times), moves, "", times)
    rise = see(hood.run, "field", times[1:]) - milled["ambient.temperature"]
    found = hood.derivative_of(lambda run: see(run, "field", times[1:]), key)
    assert rms(found - rise) < 0.15 * rms(rise)


def test_trace_of_road_that_comes_round_as_a_slide_ends():
    """Its front enters within one long step, which smeared it over the wake: 0.13 K where 0.006 K is right."""
    key, given = "track_memory.strength", {"road.track_length": 0.2}
    plain, (base, step, apart) = scene(given), MOVES[key]
    times = tuple(phase.end for phase in plain.schedule.phases if phase.sliding)
    perturbation = Perturbation(scene(moved(given, key, base + step)), step)
    hood = run_with_sensitivities(plain, replace(case(given).settings, times=times), {key: perturbation}, "", times)
    tight = replace(case(given).settings, times=times, rtol=1e-7, atol=1e-6, order=5)
    with_heat, without = (
        see(integrate_schedule(scene(moved(given, key, value)), tight), "T_wake", times) for value in (apart, 0.0)
    )
    expected, found = (with_heat - without) / apart, hood.derivative_of(lambda run: see(run, "T_wake", times), key)
    assert np.abs((found - expected).mean(axis=1)).max() < 0.02 * np.abs(expected).max()


# --- what neighbours leave alone ---------------------------------------------------------------------
def arrays(run):
    out = {f.name: getattr(run, f.name) for f in fields(Run) if isinstance(getattr(run, f.name), np.ndarray)}
    return out | {f"energy {k}": v for k, v in run.energy.items()}


@pytest.mark.parametrize("given", [{}, ROUND | RESTING, WORN], ids=["bare", "laps", "wear"])
@pytest.mark.sample("laps")
def test_the_run_is_bit_for_bit_the_run_alone(given):
    hood = traces(given, ["friction.mu"])
    alone = integrate_schedule(scene(given), asked(given))
    for name, values in arrays(alone).items():
        np.testing.assert_array_equal(arrays(hood.run)[name], values, err_msg=name)
    for name in ("steps", "rhs_evaluations", "preconditioner_solves"):
        assert hood.run.statistics[name] == alone.statistics[name]


def test_level_is_the_run_at_the_times_that_both_keep(bare):
    both = np.isin(bare.run.time, bare.reference.time)
    assert both.sum() == len(bare.reference.time) > len(SHARES)
    np.testing.assert_allclose(bare.reference.T_block, bare.run.T_block[both], rtol=0, atol=0.05)
    np.testing.assert_allclose(
        see(bare.reference, "field", moments({})), see(bare.run, "field", moments({})), atol=0.05
    )
    for one in bare.perturbed.values():
        np.testing.assert_array_equal(one.time, bare.reference.time)
        np.testing.assert_array_equal(one.frames, bare.reference.frames)


def test_no_neighbours_at_all():
    hood = run_with_sensitivities(scene({}), asked({}), {}, "", moments({}))
    assert hood.perturbed == {}
    np.testing.assert_array_equal(hood.run.T_block, integrate_schedule(scene({}), asked({})).T_block)


def test_a_scene_that_is_not_moved_differs_by_nothing():
    hood = run_with_sensitivities(scene({}), asked({}), {"same": Perturbation(scene({}), 1e-3)}, "", moments({}), True)
    for name in BOUNDS:
        change = hood.derivative_of(lambda run, name=name: see(run, name, moments({})), "same")
        np.testing.assert_array_equal(change[np.isfinite(change)], 0.0)


def test_neighbours_do_not_meet(bare):
    """A trace is the same whoever is beside it, within what other steps change."""
    alone = traces({}, ["pressure_tilt.a"])
    many, one = (
        h.derivative_of(lambda run: see(run, "T_block", moments({})), "pressure_tilt.a") for h in (bare, alone)
    )
    assert rms(many - one) < 0.01 * rms(one)


def test_any_moment_may_be_asked_for():
    """Also those within the first step of a stretch, and its very ends."""
    phases = scene({}).schedule.phases
    times = tuple(sorted({p.begin + f * (p.end - p.begin) for p in phases for f in (0.0, 1e-9, 1e-6, 5e-5, 0.5, 1.0)}))
    step = MOVES["friction.mu"][1]
    own = replace(case({}).settings, times=times)
    hood = run_with_sensitivities(
        scene({}), own, {"mu": Perturbation(scene({"friction.mu": 1.0 + step}), step)}, "", times
    )
    assert np.isin(times, hood.perturbed["mu"].time).all()
    assert len(hood.perturbed["mu"].frames) == len(times)
    assert np.isfinite(hood.derivative_of(lambda run: run.T_block, "mu")).all()
    np.testing.assert_array_equal(hood.derivative_of(lambda run: run.T_block, "mu")[0], 0.0)


# --- neighbours that begin to differ late ------------------------------------------------------------
def late(given, repetition=2, size=1e-2):
    plain = scene(given)
    since = next(p.begin for p in plain.schedule.phases if p.repetition == repetition)
    other = add_friction_scatter(plain, repetition, size)
    moves = {"whole": Perturbation(other, size), "since": Perturbation(other, size, since)}
    return since, run_with_sensitivities(plain, asked(given), moves, "", moments(given), True)


def check_late(given):
    since, hood = late(given)
    for name in BOUNDS:
        whole, part = (
            hood.derivative_of(lambda run, name=name: see(run, name, moments(given)), k) for k in ("whole", "since")
        )
        np.testing.assert_allclose(part, whole, rtol=1e-9, atol=1e-9 * max(1.0, np.nanmax(np.abs(whole))), err_msg=name)
    before = hood.reference.time <= since
    assert before.sum() > 5
    np.testing.assert_array_equal(hood.perturbed["since"].T_block[before], hood.reference.T_block[before])
    np.testing.assert_array_equal(hood.perturbed["since"].time, hood.reference.time)
    np.testing.assert_array_equal(hood.perturbed["since"].frames, hood.reference.frames)


@pytest.mark.parametrize("given", [{}, RESTING, WORN], ids=["lifted", "resting", "wear"])
def test_nothing_changes_where_nothing_differs_yet(given):
    check_late(given)


@pytest.mark.parametrize("given", [ROUND, ROUND | RESTING], ids=["lifted", "resting"])
def test_late_neighbours_keep_what_the_track_remembers(given):
    check_late(given)


# --- what cannot be a neighbour ----------------------------------------------------------------------
@pytest.mark.parametrize(
    "other", [{"numerics.mesh": 0.35}, {"block.height": 0.0051}, {"road.depth": 0.0101}, {"block.length": 0.0251}]
)
def test_another_mesh_is_refused(other):
    with pytest.raises(ValueError, match="mesh"):
        run_with_sensitivities(scene({}), asked({}), {"other": Perturbation(scene(other), 1e-3)})


@pytest.mark.parametrize("other", [{"schedule.distance": 0.21}, {"schedule.speed": 0.11}, {"schedule.wait": 1.1}])
def test_another_schedule_is_refused(other):
    with pytest.raises(ValueError, match="schedule"):
        run_with_sensitivities(scene({}), asked({}), {"other": Perturbation(scene(other), 1e-3)})


# --- neighbours with a longer block, a slower test ---------------------------------------------------
STRETCHES = ("block.length", "block.height", "schedule.speed", "schedule.distance", "schedule.wait")
SHOWN = ("T_block", "T_spot", "friction")
LEAST = {"profiles": 1.0, "split": 0.02}  # K and share of the heat for a change by the key's own size: less is faint


def last(run):
    """What a run shows at its end, by share of the block's length, and where its heat went."""
    shown = [np.atleast_1d(getattr(run, name)[run.last_sliding_index]) for name in SHOWN]
    return np.concatenate([*shown, [run.budget[k] / run.budget["friction"] for k in ("block", "road", "air")]])


def check_stretched(given, keys, share, bound):
    """Traces against central differences of full marches on meshes that are stretched alike."""
    base = case(given)
    pins = first_cells(base.scene, base.values["numerics"]) | {"road.depth": 0.01}
    plain = base.with_values(pins)

    def other(key, factor):
        return plain.with_values({key: plain[key] * factor}).scene

    moves = {k: Perturbation(other(k, 1.001), 0.001, is_stretched=True) for k in keys}
    hood = run_with_sensitivities(plain.scene, plain.settings, moves, "", (), True)
    tight = replace(plain.settings, rtol=1e-7, atol=1e-6, order=5)
    for key in keys:
        scenes = [other(key, f) for f in (1 - share, 1 + share)]
        a, b = (last(integrate_schedule(replace(s, mesh=stretch_mesh(plain.scene, s)), tight)) for s in scenes)
        expected, found = (b - a) / (2 * share), hood.derivative_of(last, key)
        for what, at in (("profiles", slice(None, -4)), ("split", slice(-3, None))):
            error = rms(found[at] - expected[at]) / max(rms(expected[at]), LEAST[what])
            print(f"{key} {what}: {error:.4f}")
            assert error <= bound, f"{key}: {what}: {error:.4f}"


@pytest.mark.long
def test_trace_of_a_longer_block_and_a_slower_test():
    check_stretched({}, STRETCHES, 0.02, 0.03)


@pytest.mark.long
def test_trace_of_a_longer_test_with_laps_that_are_remembered():
    check_stretched(ROUND, ("schedule.speed", "schedule.distance"), 0.02, 0.05)


def test_another_number_of_cells_or_repetitions_is_no_neighbour():
    for other in ({"numerics.mesh": 0.35}, {"schedule.repetitions": 3}, {"schedule.wait": 0.0}):
        with pytest.raises(ValueError, match="perturbed scene needs"):
            run_with_sensitivities(scene({}), asked({}), {"other": Perturbation(scene(other), 1e-3, is_stretched=True)})


@pytest.mark.parametrize("gamma", [0.01, 3.0, 30.0])
def test_corrections_are_solved_whatever_the_step(gamma):
    """Judged by complex steps of the rate itself; from 3 s on one sweep leaves 0.13 to 0.28 of heat that begins to flow."""
    b = HeatBalance(scene({}))
    system, y = PhaseSystem(b, b.scene.schedule.phases[0]), b.initial_state()
    out, moved = np.empty(b.size), np.empty(b.size, dtype=complex)
    system.rate(1.0, y, out)
    R = gamma * out[None, : b.worn.stop]
    x = solve_shifted_system(system.linearise(1.0, y, gamma), b.size, b.worn.stop, R)[0]
    system.rate(1.0, y + 1e-30j * np.append(x, np.zeros(b.size - len(x))), moved)
    left = R[0] - x + gamma * moved[: len(x)].imag / 1e-30
    assert np.linalg.norm(left) < 1.01 * MAX_RESIDUAL_RATIO * np.linalg.norm(R)
