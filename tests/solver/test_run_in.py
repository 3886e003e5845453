"""The block wears while it slides: relaxation, balance of load and moment, volume, audit, error in time."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace as N

import numpy as np
import pytest
from reference import analytical_solutions

from flashtemp.errors import BadInput, SolverFailure
from flashtemp.meshes import block_on_road
from flashtemp.model.case import load_case
from flashtemp.physics.effect import Term, find_effect
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.system import PhaseSystem
from flashtemp.solver.time_integration import integrate_schedule

CASES = Path(__file__).parents[2] / "cases"
L, W, K_N = 0.025, 0.05, 1.4e9
SHORT = {"numerics__cells": [20, 8, 8], "output__profiles": 8}
SPRINGS = {"block__stiffness": K_N}
EVENTS = {  # start, stop, lap, kinks of speed and pressure, lift-off at the trailing edge, a wait in contact
    "effects": ["friction_softening", "track_memory", "edge_pressure", "wear", "friction_moment"],
    "schedule__repetitions": 2, "schedule__distance": 1.0, "schedule__wait": 2.0, "schedule__lifted": False,
    "road__track_length": 0.7, "schedule__speed": [[0.0, 0.1], [2.0, 0.1], [3.0, 0.5]],
    "contact__pressure": [[0.0, 1e5], [1.5, 3e5]], "edge_pressure__B": 9.0, "edge_pressure__length": 4e-3,
    "wear__rate": 1e-9, "wear__temperature": 0.02, "friction_moment__compliance": 0.02,
}  # fmt: skip


def mean(run, values):
    """Mean over the block of profiles (n, lines)."""
    return values @ run.mesh.dx_block / run.mesh.dx_block.sum()


def xi(run):
    return 1 - 2 * run.x / L


# --- V17 --------------------------------------------------------------------------------------------
def archard(lab, pressure=2.5e5, speed=0.1):
    """A peaked block that wears in proportion to its pressure, 10 x 3.5 m."""
    return lab.case(
        effects=["edge_pressure", "wear"], wear__energy=0.0, wear__rate=6e-11, edge_pressure__B=4.0,
        contact__pressure=pressure, schedule__speed=speed, schedule__repetitions=10, schedule__wait=10.0,
        numerics__rtol=1e-6, **SPRINGS, **SHORT,
    )  # fmt: skip


@pytest.mark.parametrize("speed", [pytest.param(0.1, marks=pytest.mark.long), 1.0])
@pytest.mark.long
def test_V17_relaxation_and_mean_depth(lab, speed):
    run = archard(lab, speed=speed)
    start, p = run.pressure[0] - 2.5e5, run.pressure - 2.5e5
    for repetition, factor in ((1, 0.745276), (10, 0.0528657)):
        end = np.flatnonzero(run.sliding & (run.repetition == repetition))[-1]
        exactly = analytical_solutions.abrasion_relaxation(K_N, 6e-11, run.slid[end])
        assert exactly == pytest.approx(factor, rel=1e-6)
        error = np.abs(p[end] - exactly * start).max() / np.abs(start).max()
        lab.check(f"V17 relaxation after {run.slid[end]:g} m at {speed:g} m/s, of the first deviation", error, 5e-8)
    deep = 1e6 * mean(run, run.worn[-1])
    lab.check("V17 mean worn depth, um of 525", abs(deep - 525.0), 1e-8)


@pytest.mark.long
def test_relaxation_does_not_depend_on_the_load(lab):
    light, heavy = (archard(lab, pressure).pressure[-1] / pressure for pressure in (0.05e6, 0.3e6))
    np.testing.assert_allclose(light, heavy, atol=1e-5)


def test_tilting_holder_relaxes_more_slowly(lab):
    """Theory 7.1: amplitude a0 = (6 mu h/L) beta/(1+beta) and length s_w (1+beta), beta = k_n L^3 W/(12 K)."""
    compliance, arm = 0.01, 2e-3
    run = lab.case(
        effects=["wear", "friction_moment"], wear__energy=0.0, wear__rate=6e-11, schedule__distance=35.0,
        schedule__speed=1.0, friction_moment__compliance=compliance, friction_moment__arm=arm, numerics__rtol=1e-6,
        numerics__cells=[80, 6, 6], output__profiles=8, **SPRINGS,
    )  # fmt: skip
    beta = K_N * L**3 * W / 12 * compliance
    amplitude = np.polyfit(xi(run), run.pressure.T / 1.5e5, 1)[0]
    a0, s_w = 6 * arm / L * beta / (1 + beta), (1 + beta) / (K_N * 6e-11)
    error = np.abs(amplitude - a0 * np.exp(-run.slid / s_w)).max() / a0
    lab.check("tilt under a holder of 100 N m/rad, of its first amplitude", error, 3e-4)
    assert a0 > 0.2
    assert amplitude[-1] / amplitude[0] == pytest.approx(np.exp(-35.0 / s_w), rel=1e-3)


# --- balance at every instant -------------------------------------------------------------------------
@pytest.fixture(scope="module")
def eventful(lab):
    return lab.case(**EVENTS, **SHORT, numerics__rtol=1e-4)


def test_load_is_carried_at_every_instant(lab, eventful):
    run = eventful
    since = run.time - np.where(run.repetition > 1, run.time[np.argmax(run.repetition > 1)], 0.0)
    asked = np.interp(since, *np.transpose(EVENTS["contact__pressure"]))
    on = run.repetition == 1
    lab.check("load, relative", np.abs(mean(run, run.pressure) / asked - 1)[on & run.sliding].max(), 1e-10)
    assert run.pressure[on].min() == 0.0  # some of the block has lifted off
    assert run.pressure.min() >= 0.0


def test_moment_is_balanced_at_every_instant(lab, eventful):
    """turn = compliance (mu F h - moment of the pressure), from what run.nc holds."""
    run, on = eventful, eventful.sliding
    force = W * run.pressure @ run.mesh.dx_block
    moment = 0.5 * L * W * (run.pressure * xi(run)) @ run.mesh.dx_block
    turn = 0.02 * (run.friction * force * 7e-3 - moment)
    lab.check("moment, relative", np.abs(turn - run.tilt)[on].max() / np.abs(run.tilt).max(), 1e-10)
    assert np.ptp(run.friction[on]) > 0.05  # the moment moved


# --- volume -----------------------------------------------------------------------------------------
@pytest.mark.parametrize("softening", [[], ["friction_softening"]])
@pytest.mark.sample("softening0")
def test_worn_volume_is_the_integral_of_the_law(lab, softening):
    """Energy wear: volume = k times friction energy, to rounding, through stops, kinks and lift-off."""
    given = {k: v for k, v in EVENTS.items() if not k.startswith("friction_moment")}
    run = lab.case(**given | {"effects": [*softening, "edge_pressure", "wear"], "wear__temperature": 0.0}, **SHORT)
    worn = 1e-9 * run.energy["friction"] * W
    volumes = (run.worn - run.worn[0]) @ run.mesh.dx_block * W
    lab.check("worn volume against k times the friction energy", np.abs(volumes - worn).max() / worn[-1], 1e-12)
    assert run.worn_volume == pytest.approx(volumes[-1], rel=1e-14)


@pytest.mark.long
def test_worn_volume_with_a_rate_that_depends_on_temperature(lab):
    """k mu p exp(b dT) integrated over the records by the trapezoidal rule; 600 of them."""
    run = lab.case(
        effects=["friction_softening", "edge_pressure", "wear"], wear__rate=1e-9, wear__temperature=0.02,
        numerics__cells=[20, 8, 8], output__profiles=600, numerics__rtol=1e-6,
    )  # fmt: skip
    mu = np.exp(-0.006 * (run.T_spot - 20.0))
    rate = 0.1 * 1e-9 * mu * run.pressure * np.exp(0.02 * (run.T_spot - run.ambient_degC))
    expected = np.trapezoid(rate, run.time, axis=0)
    lab.check("worn depth with temperature, relative", np.abs(run.worn[-1] / expected - 1).max(), 2e-4)
    assert run.worn[-1][0] > 1.5 * 1e-9 * 1.5e5 * 3.5  # more than the mean pressure alone would wear


@pytest.mark.parametrize(("energy", "mu"), [(0.0, 1.0), (0.25, 0.625), (1.0, -0.5)])
def test_wear_by_pressure_by_energy_and_between(energy, mu):
    """k p (1 - e + e mu exp(b dT)): -0.5 stands for mu itself, 0.5."""
    rate, _ = find_effect("wear")().heat(N(ambient=290.0), None)
    p = N(rate=1e-10, energy=energy, temperature=0.01)
    now = N(
        local_pressure=2e5, friction=0.5 if mu < 0 else (mu - 1 + energy) / energy if energy else 9.0, ambient=300.0
    )
    assert rate.law(290.0, now, p) == pytest.approx(1e-10 * 2e5 * abs(mu))
    assert rate.law(300.0, now, p) == pytest.approx(1e-10 * 2e5 * abs(mu) * np.exp(0.1))


def test_where_the_block_lifts_off_it_exchanges_no_heat_with_the_road(lab):
    """A warm block on a cold road: only what is pressed gives its heat away."""
    mesh = block_on_road.build(L, 7e-3, 5e-3, cells=(20, 10, 10))
    scene = lab.scene(mesh, lab.MU, Term("contact.pressure", lambda T, now, p: 2.0 - 4.0 * now.x / L), phi=0.2)
    system = PhaseSystem(HeatBalance(scene), scene.schedule.phases[0])
    rise = np.zeros(system.b.n)
    rise[mesh.block] = 30.0
    met = system.interface.solve_contact(
        system.law_context(0.5), np.zeros(20), rise, np.zeros((2, mesh.n_road)), system.b.ones
    )
    lifted = met.pressure_solution.pressure == 0
    assert 3 < lifted.sum() < 17
    into_road = np.abs(met.flux.into_road)
    assert into_road[lifted].max() < 1e-4 * into_road[~lifted].min()


def test_friction_may_depend_on_the_local_pressure(lab):
    """Derivatives of heat with wear, by complex step and by differences, for mu(T, p)."""
    mesh = block_on_road.build(L, 7e-3, 5e-3, cells=(12, 8, 8))
    law = Term("friction.mu", lambda T, now, p: np.exp(-0.006 * (T - 293.15)) * (now.local_pressure / 1e5) ** -0.2)
    worn = Term("block.abrasion", lambda T, now, p: 1e-10 * now.local_pressure * now.friction)
    scene = lab.scene(mesh, law, worn, Term("contact.pressure", lambda T, now, p: 0.5 - now.x / L), phi=0.2)
    system = PhaseSystem(HeatBalance(scene), scene.schedule.phases[0])
    b, rng = system.b, np.random.default_rng(0)
    y, v = np.zeros(b.size), np.zeros(b.size)
    y[: b.n], v[b.worn] = 10.0, rng.normal(size=12)
    out, up, down = np.zeros(b.size, dtype=complex), np.zeros(b.size), np.zeros(b.size)
    system.rate(0.5, y + 1e-30j * v, out)
    system.rate(0.5, y + 1e-4 * v, up)
    system.rate(0.5, y - 1e-4 * v, down)
    slope = (up - down) / 2e-4
    for part in (slice(0, b.n), b.worn):
        np.testing.assert_allclose(out.imag[part] / 1e-30, slope[part], atol=1e-6 * np.abs(slope[part]).max())


def test_spots_that_cover_all_keep_the_contact_real(lab):
    """phi = 1 wherever it touches has no derivative: what was kept of a complex trial is not taken for the real one."""
    run = lab.case(
        effects=["wear", "edge_pressure", "friction_moment"], contact__spot_exponent=1.0, contact__pressure=2e6,
        edge_pressure__B=15.0, edge_pressure__length=5e-3, schedule__distance=0.2, **SHORT,
    )  # fmt: skip
    assert run.energy_imbalance < 1e-12


def test_a_lifted_block_presses_nowhere(lab):
    run = lab.case(effects=["wear"], schedule__repetitions=2, schedule__wait=1.0, schedule__distance=0.1, **SHORT)
    assert not run.pressure[~run.sliding].any()


def test_nothing_wears_while_the_block_rests(lab, eventful):
    run = eventful
    wait = np.flatnonzero(~run.sliding)
    assert len(wait) > 2
    np.testing.assert_array_equal(run.worn[wait], np.broadcast_to(run.worn[wait[0] - 1], run.worn[wait].shape))


# --- audit and error in time ------------------------------------------------------------------------
def test_energy_audit_with_everything_on(lab, eventful):
    lab.check("energy imbalance with everything on", eventful.energy_imbalance, 1e-14)


@pytest.mark.long
def test_error_in_time_follows_the_tolerance_through_all_events(lab):
    def run(rtol):
        made = lab.case(**EVENTS, **SHORT, numerics__rtol=rtol)
        return made.T_block, 1e6 * made.worn, 1e-5 * made.pressure

    tolerances, true = (1e-3, 1e-4, 1e-5), run(1e-8)
    found = [run(rtol) for rtol in tolerances]
    for name, exactly, *values in zip(("T, K", "worn depth, um", "pressure, bar"), true, *found, strict=True):
        errors = [float(np.sqrt(np.square(v - exactly).mean())) for v in values]
        print(f"{name}: rms errors {errors}")
        assert errors[0] / errors[2] > 30, name  # order 3 gives 32 over two decades
        lab.check(f"{name}: rms error at rtol 1e-5, of its range", errors[2] / np.ptp(exactly), 1e-5)


# --- cases ------------------------------------------------------------------------------------------
@pytest.mark.long
def test_worn_profile_of_backward_is_that_of_chosen_peak():
    """cases/backward begins where cases/chosen_peak ends: the file there is what the run writes."""
    case = load_case(CASES / "chosen_peak")
    run = integrate_schedule(case.scene, case.settings)
    kept = np.loadtxt(CASES / "backward" / "worn.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(kept, run.worn_profile, rtol=1e-4, atol=1e-9)


@pytest.fixture(scope="module")
def new_block():
    """One repetition of cases/run_in on a coarse mesh."""
    case = load_case(
        CASES / "run_in", {"schedule.repetitions": 1, "numerics.cells": [40, 10, 12], "output.profiles": 6}
    )
    return integrate_schedule(case.scene, case.settings)


def test_new_block_of_run_in_is_hottest_near_its_leading_edge(new_block):
    run = new_block
    assert run.x[np.argmax(run.T_block[run.last_sliding_index])] < 0.3 * L
    assert run.x[np.argmax(run.T_spot[run.last_sliding_index])] < 0.3 * L


def test_new_block_of_run_in_carries_its_load_and_moment(new_block):
    """turn = compliance (mu F h - moment of the pressure), with the compliance and the height that the case states."""
    run, on = new_block, new_block.sliding
    np.testing.assert_allclose(mean(run, run.pressure)[on], 1.5e5, rtol=1e-10)
    force, moment = 1.5e5 * L * W, 0.5 * L * W * (run.pressure * xi(run)) @ run.mesh.dx_block
    turn = 0.01 * (run.friction * force * 30e-3 - moment)
    np.testing.assert_allclose(run.tilt[on], turn[on], rtol=1e-8)
    assert run.pressure[run.last_sliding_index, -1] == 0.0


ELASTIC = {
    "effects": ["face_shape", "sheared_block", "friction_moment", "wear"], "friction_moment__compliance": 0.02,
    "friction_moment__arm": 14e-3, "face_shape__edge_radius": 5e-4, "wear__rate": 1e-9, "friction__mu": 0.8,
    "schedule__distance": 2.0, "schedule__speed": 1.0, "numerics__cells": [40, 8, 8], "output__profiles": 8,
}  # fmt: skip


@pytest.fixture(scope="module")
def elastic(lab):
    return {energy: lab.case(**ELASTIC, wear__energy=energy, numerics__rtol=1e-5) for energy in (0.0, 1.0)}


@pytest.mark.parametrize(("energy", "factor"), [(0.0, 1.0), (1.0, 0.8)])
def test_elastic_block_wears_by_archard_or_by_friction_energy(elastic, energy, factor):
    """Volume k P s and k mu P s for a load P, although the block has lifted off in part."""
    run = elastic[energy]
    assert run.pressure[1].min() == 0.0
    assert run.worn_volume == pytest.approx(factor * 1e-9 * 1.5e5 * 2.0 * L * W, rel=1e-9)


def test_wear_moves_the_pressure_of_the_elastic_block(elastic):
    """Wear by Archard's law goes further in the ratio of friction, and both even the pressure out."""
    first, archard, energy = (
        np.std(run.pressure[k]) for run, k in ((elastic[0.0], 0), (elastic[0.0], -1), (elastic[1.0], -1))
    )
    assert archard < energy < 0.8 * first


@pytest.mark.parametrize("key", ["face_shape__profile", "wear__profile"])
def test_worn_csv_of_a_result_is_the_face_of_the_next_block(lab, elastic, tmp_path, key):
    """The next block begins with the pressure at which the last one ended; worn.csv has the edge radius in it."""
    last = elastic[1.0]
    last.save(tmp_path)
    given = ELASTIC | {"face_shape__edge_radius": 0.0, "schedule__distance": 0.01, key: str(tmp_path / "worn.csv")}
    after = lab.case(**given)
    np.testing.assert_allclose(after.pressure[0], last.pressure[-1], atol=0.01 * 1.5e5)
    lowest = last.worn_profile[:, 1].min() if key == "face_shape__profile" else 0.0
    np.testing.assert_allclose(after.worn[0], last.worn[-1] - lowest, atol=3e-8)


def test_grooves_of_a_given_profile_carry_nothing(lab):
    """Two grooves 1 mm deep: what lies between them carries the load."""
    rows = [[0.0, 0.0]]
    for at in (8e-3, 16e-3):
        rows += [[at, 0.0], [at + 1e-5, 1e-3], [at + 1e-3, 1e-3], [at + 1.01e-3, 0.0]]
    run = lab.case(
        effects=["face_shape"], face_shape__profile=rows, schedule__distance=0.1, numerics__cells=[200, 8, 8]
    )
    inside = np.any([(run.x > at + 3e-4) & (run.x < at + 7e-4) for at in (8e-3, 16e-3)], axis=0)
    assert inside.sum() >= 2
    assert not run.pressure[:, inside].any()
    assert mean(run, run.pressure)[-1] == pytest.approx(1.5e5, rel=1e-9)


def test_start_profile_is_read_as_cell_means_and_can_be_turned(lab):
    profile = [[0.0, 1e-3], [L, 0.0]]
    made = {"effects": ["wear"], "wear__profile": profile, "schedule__distance": 0.01, **SHORT}
    forward, turned = lab.case(**made), lab.case(**made, wear__turned=True)
    np.testing.assert_allclose(forward.worn[0], 1e-3 * (1 - forward.x / L), rtol=1e-9)
    np.testing.assert_allclose(turned.worn[0], 1e-3 * turned.x / L, rtol=1e-9)
    assert 0 < forward.worn_volume < 1e-3 * 0.5e-3 * L * W  # what was worn before does not count


@pytest.mark.parametrize("turns", [[], ["friction_moment"]], ids=["guided", "turning"])
@pytest.mark.sample("guided")
def test_the_load_may_be_taken_off_while_it_slides(lab, turns):
    """Pressure 0 from 5 to 10 s: nothing is pressed, rubbed or worn there, and it goes on afterwards."""
    load = [[0.0, 1e5], [5.0, 0.0], [10.0, 0.0], [15.0, 2e5]]
    effects = ["friction_softening", "edge_pressure", "wear", *turns]
    run = lab.case(effects=effects, contact__pressure=load, schedule__distance=2.0, wear__rate=1e-9, **SHORT)
    off = (run.time >= 5.0) & (run.time <= 10.0)
    assert off.sum() > 1
    assert not run.pressure[off].any()
    assert np.ptp(run.worn[off], axis=0).max() < 1e-10
    assert run.worn[-1].min() > run.worn[off][-1].min()
    assert run.energy_imbalance < 1e-12


def test_uniform_pressure_stays_uniform(lab):
    run = lab.case(effects=["wear"], wear__rate=1e-9, **SHORT)
    assert np.ptp(run.pressure) < 1e-9 * 1.5e5


def test_a_holder_too_soft_for_its_moment_is_explained(lab):
    with pytest.raises(SolverFailure, match="tips the block over"):
        lab.case(effects=["friction_moment"], friction_moment__compliance=float("inf"), friction_moment__arm=0.014)


SOFT_HOLDER = {"friction_moment.compliance": 1.0, "numerics.mesh": 0.6, "output.profiles": 4, "schedule.repetitions": 1}


def test_a_block_under_a_soft_holder_is_pressed_from_the_start():
    """While its contact is sought, trials pull on columns."""
    case = load_case(CASES / "run_in", SOFT_HOLDER | {"friction_moment.arm": 0.015, "schedule.distance": 0.02})
    run = integrate_schedule(case.scene, case.settings)
    np.testing.assert_allclose(mean(run, run.pressure)[run.sliding], 1.5e5, rtol=1e-10)
    assert run.pressure.min() >= 0.0


def test_a_holder_that_snaps_over_is_explained():
    case = load_case(CASES / "run_in", SOFT_HOLDER | {"friction_moment.arm": 0.04, "wear.rate": 2.5e-10})
    with pytest.raises(SolverFailure, match="snaps over"):
        integrate_schedule(case.scene, case.settings)


def test_a_block_worn_through_is_a_failure_and_says_when(lab):
    with pytest.raises(SolverFailure, match="worn through.* t = "):
        lab.case(effects=["wear"], wear__rate=1e-7, **SHORT)


def test_the_edge_may_be_worn_through_while_the_rest_is_not(lab):
    profile = [[0.0, 6.9e-3], [L, 0.0]]
    with pytest.raises(SolverFailure, match="worn through"):
        lab.case(effects=["wear"], wear__profile=profile, wear__rate=1e-8, **SHORT)


def test_a_start_profile_deeper_than_the_block_is_bad_input(lab):
    with pytest.raises(BadInput, match="block.height: 0.007 m is not more than the 0.5 m worn off"):
        lab.case(effects=["wear"], wear__profile=[[0.0, 0.5]])


def test_state_starts_with_the_given_depth_at_ambient_temperature():
    case = load_case(CASES / "backward", {"numerics.cells": [12, 6, 6]})
    balance = HeatBalance(case.scene)
    y = balance.initial_state()
    assert balance.worn_depth(y).max() > 5e-4
    assert not y[: balance.n].any()
