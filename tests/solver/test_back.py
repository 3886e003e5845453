"""Sliding back: the mirror image, the turn held to a program of its own, what remembers, what is seen."""

from __future__ import annotations

import os
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy.linalg import lu_factor, lu_solve
from scipy.special import i0e, i1e

import flashtemp
from flashtemp.api.simulation import resume, simulate
from flashtemp.camera.prediction.observation import observe
from flashtemp.camera.recording import Recording
from flashtemp.errors import BadInput
from flashtemp.model.case import assemble_case
from flashtemp.model.case_file import KeyLocations
from flashtemp.model.priors import find_uncertain_inputs
from flashtemp.model.schedule import Schedule, SpeedProfile, constant_series
from flashtemp.runs.checks.inactive_effects import describe_inactive_effects
from flashtemp.runs.studies.convergence import watched_values
from flashtemp.runs.studies.sensitivity_result import OUTPUT_SPECS

L, P, V = 0.025, 1.5e5, 0.1
SMALL = {"numerics__mesh": 0.5, "schedule__distance": 0.3}
RICH = {
    "effects": ["edge_pressure", "wear", "friction_softening", "track_memory", "friction_moment"],
    "road__track_length": 0.2, "schedule__repetitions": 2, "schedule__wait": 1.0,
}  # fmt: skip
BARE = {
    "ambient__convection": 0.0, "contact__flash_factor": 0.0, "friction__mu": 1.0, "numerics__mesh": 1.4,
    "output__fields": 2,
}  # fmt: skip


def shuttle(way, back, ramp=1e-4):
    """Speed in rows: `way` (m) forward and `back` (m) back, the turn within 2 `ramp` (s); the distance of both."""
    t = way / V - ramp / 2
    return [[0.0, V], [t, V], [t + 2 * ramp, -V], [t + 9.0, -V]], way + back


# --- mirror symmetry -------------------------------------------------------------------------------------
@pytest.mark.parametrize("more", [{}, RICH, {"numerics__across": 6}], ids=["bare", "rich", "3D"])
@pytest.mark.sample("rich")
def test_sliding_back_is_the_mirror_image_bit_for_bit(lab, more):
    forward, back = (lab.case(**SMALL, **more, schedule__speed=v) for v in (V, -V))
    for name in ("T_block", "T_spot", "T_road", "pressure", "worn"):
        np.testing.assert_array_equal(getattr(back, name)[:, ::-1], getattr(forward, name), name)
    for name in ("T_wake", "friction", "time", "x_wake"):
        np.testing.assert_array_equal(getattr(back, name), getattr(forward, name), name)
    np.testing.assert_array_equal(back.tilt, -forward.tilt)
    np.testing.assert_allclose(back.x, L - forward.x[::-1], rtol=1e-13)
    cells = forward.mesh.planes(forward.field[-1])[forward.mesh.mirror].ravel()
    np.testing.assert_array_equal(back.field[-1], cells)
    assert back.mesh.mirrored().line.tolist() == forward.mesh.line.tolist()
    for name, values in forward.maps.items():
        seen = back.maps[name] if name == "T_wake" else back.maps[name][:, ::-1]
        np.testing.assert_array_equal(seen, values, name)
    for key in ("rise_leading_K", "rise_trailing_K", "worn_leading_m"):
        assert back.summary[key] == forward.summary[key]


def test_what_acts_behind_the_block_acts_behind_it_whichever_way_it_slides(lab):
    """Moisture evaporates from the road that is warm, not from what is still to come."""
    wet = SMALL | {"effects": ["evaporation"], "evaporation__coefficient": 2000.0}
    forward, back, dry = (lab.case(**given, schedule__speed=v) for given, v in ((wet, V), (wet, -V), (SMALL, -V)))
    np.testing.assert_array_equal(back.T_wake, forward.T_wake)
    assert (dry.T_wake[-1] - back.T_wake[-1]).max() > 0.3


def test_numbers_of_the_edges_follow_the_edge_that_leads(lab):
    forward, back = (lab.case(**SMALL, schedule__speed=v) for v in (V, -V))
    for about in OUTPUT_SPECS.values():
        assert about.evaluate(back) == pytest.approx(about.evaluate(forward), rel=1e-12)
    np.testing.assert_allclose(watched_values(back), watched_values(forward), rtol=1e-9)
    assert watched_values(back)[0] < watched_values(back)[2]


def test_the_prior_of_a_speed_does_not_turn_the_block():
    case = assemble_case({}, {"schedule.speed": -V}, KeyLocations("none"), Path(), "back")
    [speed] = find_uncertain_inputs(case, ("schedule.speed",))[0]
    assert (speed.low, speed.high, speed.is_near_bound) == (-1000.0, -5e-324, False)
    assert speed.value_at(np.linspace(-3.0, 3.0, 7)) == pytest.approx(-V * (1.0 - 0.01 * np.linspace(-3.0, 3.0, 7)))


@pytest.mark.parametrize(("turn", "said"), [(1, 0), (0, 1)])
def test_track_memory_is_called_idle_only_where_road_never_comes_again(turn, said):
    given = {"schedule.repetitions": 3, "schedule.turn": turn, "schedule.distance": 0.2, "numerics.mesh": 0.4}
    assert (
        len(
            describe_inactive_effects(
                assemble_case({}, given | {"effects": ["track_memory"]}, KeyLocations("none"), Path(), "shuttle")
            )
        )
        == said
    )


def test_what_belongs_to_the_block_stays_where_it_is(lab):
    """A tilt that presses x = 0 presses the trailing edge of a block that slides back."""
    given = SMALL | {"effects": ["pressure_tilt"], "schedule__speed": -V, "pressure_tilt__a": 0.6}
    back, other = lab.case(**given), lab.case(**given | {"schedule__speed": V, "pressure_tilt__a": -0.6})
    np.testing.assert_allclose(back.pressure[-1], P * (1 + 0.6 * (1 - 2 * back.x / L)), rtol=1e-12)
    np.testing.assert_allclose(back.T_block[:, ::-1], other.T_block, atol=1e-6)


def test_the_peak_is_at_the_edge_that_leads(lab):
    back = lab.case(**SMALL, effects=["edge_pressure"], schedule__speed=-V)
    np.testing.assert_array_equal(np.argmax(back.pressure, axis=1), len(back.x) - 1)


# --- the turn --------------------------------------------------------------------------------------------
def independent(way, back, fraction, columns=100, modes=300):
    """Rises (columns,) in K of the block's face after `way` m forward and `back` m back, and the places (columns,).

    Every stretch of road remembers all it received, in the road's own frame, and keeps of it what eq. (15b) says; the
    block is a sum of cosines.  Nothing here knows of a leading edge.
    """
    dx, dt, height, k, rc = L / columns, L / columns / V, 0.007, 0.25, 1200.0 * 1700.0
    e, D = np.sqrt(1.0 * 2300.0 * 950.0), 1.0 / (2300.0 * 950.0)
    x, m, z = (np.arange(columns) + 0.5) * dx, np.arange(columns), np.arange(modes)
    cosines = np.cos(np.pi * np.outer(x, m) / L)
    forward = np.where(m > 0, 2.0, 1.0)[:, None] * cosines.T / columns
    along = (np.pi * m / L)[:, None] ** 2
    decay = k / rc * (along + (np.pi * z / height) ** 2)
    held = np.exp(-decay * dt)
    moved = np.where(decay > 0, (1.0 - held) / np.where(decay > 0, decay, 1.0), dt)
    moved *= np.where(z > 0, 2.0, 1.0) / (rc * height)
    far = np.arange(modes, 40 * modes)
    at_once = 2.0 / (k * height) * (1.0 / (along + (np.pi * far / height) ** 2)).sum(axis=1)
    at_once += 2.0 * height / (k * np.pi**2 * far[-1])
    response = fraction * cosines @ ((moved.sum(axis=1) + at_once)[:, None] * forward)

    ages = np.concatenate([[0.0], (np.arange(round((way + back) / dx) + 1) + 0.5) * dt])
    nodes, weights = np.polynomial.legendre.leggauss(12)
    a, b = np.sqrt(ages[:-1])[:, None], np.sqrt(ages[1:])[:, None]
    root = 0.5 * (a + b) + 0.5 * (b - a) * nodes
    X = 1.5e-3**2 / (2 * D * root**2)
    kept = 1.0 if fraction == 1.0 else np.maximum(1.0 - i0e(X) - i1e(X), fraction)
    memory = (0.5 * (b - a) * weights * 2.0 * kept / (e * np.sqrt(np.pi))).sum(axis=1)

    steps = [*range(round(way / dx)), *range(round(way / dx) - 1, round(way / dx) - 1 - round(back / dx), -1)]
    lu, q = lu_factor(response + memory[0] * np.eye(columns)), P * V / fraction
    taken = np.zeros((len(steps), columns + max(steps) + 1))
    amplitudes = np.zeros((columns, modes))
    for n, shift in enumerate(steps):
        under = slice(max(steps) - shift, max(steps) - shift + columns)
        past = memory[n:0:-1] @ taken[:n, under]
        amplitudes *= held
        face = cosines @ amplitudes.sum(axis=1)
        J = lu_solve(lu, memory[0] * q + past - face)
        amplitudes += moved * (forward @ (fraction * J))[:, None]
        taken[n, under] = q - J
    return face + response @ J, x


@pytest.mark.parametrize("fraction", [1.0, 0.2], ids=["even", "lanes"])
@pytest.mark.parametrize("back", [0.01, 0.06])
@pytest.mark.sample("0.06-lanes")
def test_forward_and_back_against_a_road_that_remembers_all(lab, back, fraction):
    """Back within the wake that is simulated, and beyond, where the track carries it."""
    rise, x = independent(0.15, back, fraction)
    speed, distance = shuttle(0.15, back)
    run = lab.case(**BARE, contact__spot_fraction=fraction, schedule__speed=speed, schedule__distance=distance)
    error = np.interp(x, run.x, run.T_block[-1] - 20.0) - rise
    inside = (x > 1e-3) & (x < L - 1e-3)
    print(f"largest difference {100 * np.abs(error[inside]).max() / rise.max():.2f} % of {rise.max():.2f} K")
    assert np.abs(error[inside]).max() < 0.008 * rise.max()


@pytest.mark.long
def test_the_turn_keeps_every_joule(lab):
    """The road that comes back in: out of the wake, off the track and round the lap, with all that feeds back."""
    speed, distance = shuttle(0.15, 0.12)
    for lifted in (True, False):
        given = RICH | {"schedule__speed": speed, "schedule__distance": distance, "schedule__lifted": lifted}
        run = lab.case(**given, numerics__mesh=0.4, schedule__turn=1)  # asserts that no heat is made or lost
        assert sorted({*run.direction.tolist()}) == [-1, 1]
        assert run.direction[[0, -1]].tolist() == [1, 1]  # the second repetition begins back, and ends forward
        assert np.all(np.diff(run.worn, axis=0) > -1e-12)


def test_what_a_turn_takes_along_is_continuous(lab):
    """Block, road in the lanes, worn depth just before and just after a slow turn."""
    speed, distance = shuttle(0.15, 0.05, ramp=0.25)
    given = {"effects": ["edge_pressure", "wear"], "schedule.speed": speed, "schedule.distance": distance}
    made = lab.assemble_case({}, given | {"numerics.mesh": 0.4}, lab.KeyLocations("none"), lab.Path(), "")
    [turn] = made.scene.schedule.turns
    run = lab.integrate_schedule(made.scene, replace(made.settings, rtol=1e-6, times=(turn + 1e-4,)))
    k = int(np.flatnonzero(run.direction > 0)[-1])
    assert run.time[k : k + 2].tolist() == [turn, turn + 1e-4]
    for name, atol in (("T_block", 0.05), ("T_road", 0.05), ("worn", 1e-9)):
        before, after = getattr(run, name)[k : k + 2]
        np.testing.assert_allclose(after, before, atol=atol, err_msg=name)
    assert np.ptp(run.T_block[k]) > 2.0  # the wrong way round it would show
    np.testing.assert_allclose(run.T_wake[k], run.T_ahead[k + 1][::-1], atol=0.05)


def test_road_that_comes_again_is_as_smooth_where_the_window_ended_as_elsewhere(lab):
    """Lifted and slid back at once, again and again: the older the wake, the colder, and what two passes left counts
    alike on the mesh and on the track."""
    given = {"effects": ["track_memory"], "track_memory__strength": 0.6, "road__track_length": 3.5}
    turns = {"schedule__turn": 1, "schedule__repetitions": 4, "schedule__wait": 0.0, "schedule__distance": 0.1}
    run = lab.case(**given, **turns, schedule__speed=V, numerics__mesh=0.5, output__profiles=200)
    for repetition in (2, 3, 4):
        one = run.repetition == repetition
        comes = np.interp(np.linspace(1e-3, 0.06, 60), run.slid[one] - run.slid[one][0], run.T_ahead[one][:, 0])
        assert comes[0] - 20.0 > 0.8 + 0.2 * repetition
        assert np.all(np.diff(comes) < 0.0), repetition


def test_where_the_window_ends_does_not_matter_to_lanes_that_come_back_at_once(lab):
    """They widen on the track as they do within the window."""
    given = {
        "effects": ["track_memory"],
        "road__track_length": 3.5,
        "contact__spot_fraction": 0.2,
        "schedule__speed": V,
    }
    turns = {"schedule__turn": 1, "schedule__repetitions": 3, "schedule__wait": 0.0, "schedule__distance": 0.1}
    near, far = (lab.case(**given, **turns, numerics__mesh=1.0, road__downstream=way) for way in (0.01, 0.035))
    rise = near.T_spot.max() - 20.0
    print(f"{np.abs(near.T_spot - far.T_spot).max():.3f} K of {rise:.2f} K")
    np.testing.assert_allclose(near.T_spot, far.T_spot, atol=0.03 * rise)


def test_a_run_in_block_that_is_slid_back_is_that_block_turned_round(lab):
    """Pressure at the start of sliding back on the profile that sliding forward has worn."""
    given = {
        "effects": ["edge_pressure", "wear"], "edge_pressure__B": 6.0, "edge_pressure__length": 4e-3, "wear__rate": 4e-10,
        "numerics__mesh": 0.5, "schedule__distance": 0.3,
    }  # fmt: skip
    both = lab.case(**given, schedule__repetitions=2, schedule__wait=60.0, schedule__turn=1)
    start = int(np.flatnonzero(both.sliding & (both.repetition == 2))[0])
    rows = np.column_stack([both.x, both.worn[start]]).tolist()
    turned = lab.case(**given, wear__profile=rows, wear__turned=True)
    there = np.interp(turned.x, np.sort(L - both.x), both.pressure[start][::-1])
    np.testing.assert_allclose(turned.pressure[0], there, atol=0.01 * there.max())
    assert both.pressure[start][-1] > 2.0 * both.pressure[start][0]


# --- going on, being seen, being told ----------------------------------------------------------------------
@pytest.mark.parametrize("share", [0.4, 0.8], ids=["before", "after"])
def test_a_run_goes_on_across_a_turn(lab, tmp_path, share):
    speed, distance = shuttle(0.15, 0.12)
    given = {"numerics.mesh": 0.4, "numerics.rtol": 1e-5, "schedule.speed": speed, "schedule.distance": distance,
             "output.pictures": False, "output.vtk": False}  # fmt: skip
    (tmp_path / "case.toml").write_text("")
    made = flashtemp.load(tmp_path / "case.toml", given)
    whole, out = simulate(made), tmp_path / "out"

    def stop(progress, end):
        if progress.t > share * end:
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(flashtemp.errors.UserInterrupt):
        simulate(made, out=out, watch=stop)
    run = resume(out)
    rise = np.abs(whole.T_block - 20.0).max()
    np.testing.assert_allclose(run.T_block, whole.T_block, atol=1e-3 * rise)
    np.testing.assert_array_equal(run.direction, whole.direction)
    assert run.energy_imbalance < 1e-10
    with xr.open_dataset(out / "run.nc") as ds:
        np.testing.assert_array_equal(ds["direction"], run.direction)
        assert ds["T_ahead"].dims == ("time", "x_ahead")
        assert float(ds["x_ahead"].max()) < 0.0 < L < float(ds["x_wake"].min())


def camera(u, time):
    """A camera above the road at these places (m)."""
    n = len(time)
    return Recording(
        temperature=np.zeros((n, 3, len(u))), time=np.asarray(time, float), repetition=np.ones(n, int), u=u,
        v=np.array([-1e-3, 0.0, 1e-3]), view="wake",
    )  # fmt: skip


def test_cameras_see_the_wake_on_the_side_where_it_is(lab):
    made = [lab.assemble_case({}, {k.replace("__", "."): v for k, v in (SMALL | {"schedule__speed": w}).items()},
                         lab.KeyLocations("none"), lab.Path(), "") for w in (V, -V)]  # fmt: skip
    forward, back = (lab.integrate_schedule(m.scene, m.settings) for m in made)
    u, time = np.linspace(0.0265, 0.0335, 15), [1.0, 3.0]
    seen = observe(forward, made[0].scene, camera(u, time)).temperature
    mirrored = observe(back, made[1].scene, camera(np.sort(L - u), time)).temperature
    np.testing.assert_allclose(mirrored[..., ::-1], seen, atol=1e-9)
    cold = observe(back, made[1].scene, camera(np.linspace(0.0262, 0.0275, 5), time)).temperature
    assert np.abs(cold - 20.0).max() < 0.2 < np.abs(seen - 20.0).max()  # the road that comes


def test_a_turn_divides_the_repetition():
    course = SpeedProfile.from_signed_speeds((0.0, 1.0, 3.0, 4.0), (0.1, 0.1, -0.1, -0.1))
    plan = Schedule(
        course.speed, constant_series(1e5), 0.25, 4, 5.0, heading=course.heading, turns=course.turns, turn=2
    )
    assert course.turns == (2.0,)
    assert [p.direction for p in plan.phases if p.sliding] == [
        1, 1, -1, -1, 1, 1, -1, -1, -1, -1, 1, 1, -1, -1, 1, 1
    ]  # fmt: skip
    assert plan.has_return_pass
    assert plan.directions == {1, -1}
    for p in plan.phases:
        if p.sliding and p.leg_before:
            assert p.leg_before == pytest.approx(0.15)  # 1 s at 0.1 m/s and 1 s down to rest
            assert p.turned == p.start + 2.0


def test_resting_between_forward_and_back_turns_once(lab):
    course = SpeedProfile.from_signed_speeds((0.0, 1.0, 2.0, 3.0, 4.0), (-0.1, 0.0, 0.0, 0.1, 0.1))
    assert (course.heading, course.turns) == (-1, (2.0,))
    run = lab.case(
        schedule__speed=[[0.0, 0.0], [0.1, 0.1], [1.0, 0.1], [1.1, 0.0], [1.5, 0.0], [1.6, -0.1], [3.0, -0.1]],
        schedule__distance=0.2, numerics__mesh=0.3,
    )  # fmt: skip
    assert {*run.direction.tolist()} == {1, -1}


def test_spots_that_are_followed_one_by_one_refuse_to_go_back(lab):
    with pytest.raises(BadInput, match=r"schedule\.speed.*resolved_spots"):
        lab.case(effects=["resolved_spots"], schedule__speed=-0.1, numerics__across=8)
