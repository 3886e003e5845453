"""The track's memory: heat is kept, spreads as it should, and comes round after one lap."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from reference.asperities import retained_fraction

from flashtemp.meshes.grading import geometric
from flashtemp.model.case import load_case
from flashtemp.solver import contact_lanes
from flashtemp.solver.circular_track import CircularTrack, build_inflow, build_track
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.integration_state import IntegrationState
from flashtemp.solver.system import PhaseSystem, RoadInflow
from flashtemp.solver.time_integration import integrate_schedule

CASES = Path(__file__).parents[2] / "cases"

K, RC = 1.0, 2300 * 950.0
EDGES = geometric(0.3, 1e-5, 90)
DZ = np.diff(EDGES)[::-1]


def track(film=0.0, share=1.0) -> CircularTrack:
    return CircularTrack(3.5, DZ, K, RC, film, share)


def heat(column) -> float:
    """J/m2 of a column of rises."""
    return float(RC * (DZ * column).sum())


@pytest.mark.parametrize("share", [0.1, 0.5, 1.0])
def test_mean_heat_is_kept_until_the_next_pass(share):
    depth = 0.5 * (EDGES[1:] + EDGES[:-1])[::-1]
    column = 30.0 * np.exp(-depth / 3e-4)
    for age in (20.0, 100.0, 1000.0):
        t = track(share=share)
        t.store_column(5.0, 0.2, column)
        back = t.stored_rise(5.0 + age, 3.7)
        assert heat(back) == pytest.approx(share * heat(column), rel=1e-9)


def test_old_heat_spreads_like_a_plane_source():
    """E/(e sqrt(pi t)) exp(-z^2/(4 D t)) once all depths of the column are forgotten."""
    depth = 0.5 * (EDGES[1:] + EDGES[:-1])[::-1]
    column = 30.0 * np.exp(-depth / 1e-4)
    t = track(share=0.2)
    t.store_column(0.0, 0.0, column)
    age = 45.0
    exact = 0.2 * heat(column) / np.sqrt(K * RC * np.pi * age) * np.exp(-(depth**2) * RC / (4 * K * age))
    np.testing.assert_allclose(t.stored_rise(age, 3.5), exact, atol=1e-3 * exact.max())


@pytest.mark.parametrize("rtol", [1e-3, 1e-4])
def test_columns_stand_where_no_step_ends(rtol):
    """On whole multiples of the track's spacing but for the first: else another sequence of steps would show a lap later."""
    case = load_case(
        CASES / "chosen_peak",
        {"schedule.repetitions": 1, "schedule.distance": 1.0, "numerics.mesh": 0.4, "numerics.rtol": rtol},
    )
    now = IntegrationState()
    integrate_schedule(case.scene, case.settings, state=now)
    places, spacing = np.array(now.track.place[1:]), now.track.min_spacing
    assert len(places) > 10
    np.testing.assert_allclose(places / spacing, np.rint(places / spacing), atol=1e-6)
    assert np.all(np.diff(places) > 0.9 * spacing)
    assert np.all(np.diff(places) < max(case.scene.length, 10.0 * spacing) + 1.1 * spacing)  # however long steps are


@pytest.mark.parametrize("fraction", [0.1, 0.2])
def test_lanes_mix_with_their_surroundings(fraction):
    """Heat that came in at once, against discs thrown at random on a plane, whose heat spreads between them."""
    given = {"numerics.mesh": 1.0, "contact.spot_fraction": fraction, "ambient.convection": 0.0}
    case = load_case(CASES / "chosen_peak", given)
    b, diameter, D = HeatBalance(case.scene), case.scene.spot_diameter, case.scene.road.diffusivity
    mesh, t = case.scene.mesh, build_track(b, 3.5)
    phase = case.scene.schedule.phases[0]
    depth, young = 0.5 * (mesh.depth[1:] + mesh.depth[:-1])[::-1], 1e-2
    t.store_column(0.0, 0.0, 100.0 * np.exp(-(depth**2) / (4 * D * young)))
    asked = PhaseSystem(b, phase, lambda now: RoadInflow(t.stored_rise(now.t, 3.5)))
    for age in (0.5, 1.0, 3.0, 10.0, 30.0):
        now = asked.law_context(phase.begin)._replace(t=age)
        road = asked.incoming_road(now)
        state = asked.interface.contact_state(now, np.full(len(b.cell_road), now.pressure))
        T = np.zeros(b.n)
        mesh.planes(T)[mesh.road] = road[0].reshape(mesh.n_road, 1)
        found = contact_lanes.lane_rises(b, state, T, road)
        at_depth = contact_lanes.incoming_lane_rises(b, asked.interface.spreading_loss_at_depth(state, now), road)
        share, rise = retained_fraction(fraction, diameter, D, age + young), road[1, -1]
        print(
            f"{age:g} s: {found[0] / rise:.4f}, of discs {share:.4f}; at half the first cell {at_depth[-1, 0] / rise:.4f}"
        )
        assert abs(found[0] / rise - share) < 0.02 * (1.0 - fraction)
        assert abs(at_depth[-1, 0] / rise - share) < 0.02 * (1.0 - fraction)


def test_air_takes_heat_from_the_open_road():
    column = np.full(len(DZ), 8.0)
    t = track(film=20.0)
    t.store_column(0.0, 0.0, column)
    kept = [heat(t.stored_rise(age, 3.5)) for age in (0.0, 10.0, 100.0)]
    assert kept[0] > kept[1] > kept[2] > 0
    assert heat(column) - kept[1] == pytest.approx(20.0 * 8.0 * 10.0, rel=0.1)


def test_only_what_has_passed_comes_round():
    column = np.full(len(DZ), 8.0)
    t = track()
    t.store_column(0.0, 1.0, column)
    t.store_column(1.0, 1.1, column, before=column)
    assert not t.stored_rise(5.0, 3.5 + 0.9).any()
    assert t.stored_rise(1.0, 3.5 + 1.05)[0] == pytest.approx(12.0)
    assert not t.stored_rise(5.0, 1.05).any()


def slid_in(parts: int, tmp_path):
    """0.12 m slid over in a number of repetitions without a wait between them, spots everywhere, no flash."""
    (tmp_path / "case.toml").write_text('effects = ["track_memory"]\n', encoding="utf-8")
    given = {
        "contact.spot_fraction": 1.0, "contact.flash_factor": 0.0, "schedule.repetitions": parts,
        "schedule.distance": 0.12 / parts, "numerics.mesh": "coarse", "numerics.rtol": 1e-6,
    }  # fmt: skip
    case = load_case(tmp_path, given)
    return integrate_schedule(case.scene, case.settings)


def test_a_new_start_without_a_wait_changes_nothing(tmp_path):
    """The block is lifted and set down again in no time: the road around it is as it was, and all of its heat."""
    one, two = (slid_in(parts, tmp_path) for parts in (1, 2))
    rise = np.ptp(one.T_block)
    np.testing.assert_allclose(two.T_block[-1], one.T_block[-1], atol=1e-3 * rise)
    np.testing.assert_allclose(two.T_wake[-1], one.T_wake[-1], atol=1e-3 * rise)
    np.testing.assert_allclose(two.field[-1], one.field[-1], atol=1e-3 * rise)
    kept = [run.energy["lanes"][-1] + run.energy["lane_out"][-1] for run in (one, two)]
    assert kept[1] == pytest.approx(kept[0], rel=1e-3)


def test_a_track_that_remembers_needs_no_road_behind_the_block(lab):
    """With no wake simulated nothing is asked of it; the block is as with one."""
    given = {"effects": ["track_memory"], "schedule__distance": 0.1, "schedule__repetitions": 2, "numerics__mesh": 0.4}
    none, some = (lab.case(**given, road__track_length=0.2, road__downstream=far) for far in (0.0, 0.01))
    assert none.T_wake.shape[1] == 0
    assert some.T_wake.shape[1] > 0
    rise = some.T_block[-1].max() - some.ambient_degC  # what leaves the window is followed by the track's closure
    assert np.abs(none.T_block[-1] - some.T_block[-1]).max() < 0.01 * rise


def test_road_that_enters_is_that_of_its_own_moment():
    """A system answers the same whatever it was asked before, of one place and of many."""
    case = load_case(CASES / "chosen_peak", {"numerics.mesh": 0.4})
    b, phase = HeatBalance(case.scene), case.scene.schedule.phases[2]
    t = replace(build_track(b, 3.5), place=[0.3, 0.9, 1.6], time=[3.0, 9.0, 16.0])
    t.left = list(np.random.default_rng(0).normal(0.0, 1e3, (3, len(t.dz), 1)))
    asked = PhaseSystem(b, phase, build_inflow(b, phase, t))
    for at in (46.0, 55.0, 46.0, 62.0):
        fresh = PhaseSystem(b, phase, build_inflow(b, phase, t))
        assert np.array_equal(asked.incoming_rise(asked.law_context(at)), fresh.incoming_rise(fresh.law_context(at)))
    now, behind = asked.law_context(62.0), np.array([0.0, 0.011, 0.03, 0.5, 1.1])
    rows = [asked.incoming_rise(now._replace(passed=now.passed - way)) for way in behind]
    np.testing.assert_allclose(asked.undisturbed_road(now, behind)[:, 0], rows, rtol=1e-14)
    assert np.ptp(rows, axis=0).max() > 0.1
