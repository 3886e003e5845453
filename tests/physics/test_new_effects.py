"""Effects against what their laws say in closed form, one check each; all of them as small changes of the base."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from flashtemp.meshes.mesh import Mesh
from flashtemp.physics.effect import Heat, find_effect
from flashtemp.physics.effects.radiation import STEFAN_BOLTZMANN_W_M2K4
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.system import PhaseSystem

L, H = 0.025, 0.002
SMALL = {
    "block__height": H,
    "road__track_length": 0.15,
    "schedule__distance": 0.2,
    "schedule__repetitions": 2,
    "schedule__wait": 1.0,
    "numerics__cells": [8, 8, 8],
    "output__profiles": 6,
}
SWITCH = {
    "conductance_load": "resistance",
    "conductance_speed": "resistance",
    "conductivity_anisotropy": "excess",
    "evaporation": "coefficient",
    "friction_load": "exponent",
    "friction_speed": "exponent",
    "internal_heat": "loss",
    "pressure_crown": "c",
    "radiation": "emissivity",
    "third_body": "growth",
}
QUICK = ("evaporation", "internal_heat", "pressure_crown", "third_body")  # the others are `long`


def acting(name, **values):
    """An effect for `lab.scene`, defaults unless told."""
    return find_effect(name)(), values


def mesh(lines=8, length=L, height=H, levels=4):
    """A block on even lines, with road before and behind it."""
    step = length / lines
    return Mesh(
        np.arange(-2, lines + 7) * step, np.geomspace(1, 400, 9) * 1e-5 - 1e-5, np.linspace(0, height, levels + 1), 2,
        lines + 2,
    )  # fmt: skip


@pytest.fixture(scope="module")
def small(lab):
    """Run of SMALL with one effect, or without."""

    @cache
    def go(name="", **values):
        given = {f"{name}__{k}": v for k, v in values.items()}
        return lab.case(**SMALL, effects=[name] if name else [], numerics__rtol=1e-6, **given)

    return go


# --- all of them ---------------------------------------------------------------------------------
@pytest.mark.parametrize("name", [n if n in QUICK else pytest.param(n, marks=pytest.mark.long) for n in SWITCH])
@pytest.mark.sample("pressure_crown")
def test_a_small_change_of_the_base_is_in_proportion(small, name):
    key, base = SWITCH[name], small()
    size = find_effect(name).params()[key].value
    slopes = []
    for e in (0.1 * size, 0.05 * size):
        run = small(name, **{key: e})
        slopes.append(
            np.concatenate([np.ravel((getattr(run, a) - getattr(base, a)) / e) for a in ("T_spot", "T_wake")])
        )
    assert np.abs(slopes[0]).max() * size > 1e-3
    assert np.linalg.norm(slopes[0] - slopes[1]) < 0.02 * np.linalg.norm(slopes[1])


@pytest.mark.parametrize("name", SWITCH)
@pytest.mark.long
def test_costs_few_more_steps(small, name):
    assert small(name).statistics["steps"] < 1.3 * small().statistics["steps"]


@pytest.mark.parametrize(
    ("name", "wake", "spot"),
    [
        ("conductance_load", -1, 1),
        ("conductance_speed", -1, 1),
        ("evaporation", -1, 0),
        ("friction_load", -1, -1),  # pressed harder than the reference
        ("friction_speed", -1, -1),  # slower than the reference
        ("internal_heat", 1, 1),
        ("radiation", -1, -1),
        ("third_body", -1, 1),
    ],
)
@pytest.mark.sample("evaporation-*", "radiation-*", "third_body-*")
def test_sign(small, name, wake, spot):
    """What becomes warmer and what cooler, at the end of sliding: the road just behind the block, and the spots."""
    on, base = small(name), small()
    end = np.flatnonzero(base.sliding)[-1]
    change = [np.mean(getattr(on, a)[end] - getattr(base, a)[end]) for a in ("T_wake", "T_spot")]
    assert change[0] * wake > 1e-4
    assert change[1] * spot > (1e-4 if spot else -1.0)


# --- heat on the road and in the block -------------------------------------------------------------
@pytest.mark.long
def test_evaporation_is_a_film_that_dries(lab):
    """Road before the block is nearly as cold as the air: a film all over the free road draws the same heat."""
    h, n = 5.0, 1.5  # little: each repetition draws from the same heat
    film = Heat.film("road.free", lambda now, p: h * np.exp(-(now.repetition - 1) / n))
    wet = acting("evaporation", coefficient=h, repetitions=n)
    runs = [
        lab.slide(lab.scene(mesh(), lab.MU, part, rubber=lab.NO_BLOCK, wait=1.0), rtol=1e-8)[0] for part in (wet, film)
    ]
    run, heat = runs[0], [r.energy["lane_air"] for r in runs]
    lab.check("evaporation against a film", abs(heat[0][-1] / heat[1][-1] - 1), 5e-4)
    slid, waited = (np.flatnonzero((run.repetition == 1) & (run.sliding == on))[-1] for on in (True, False))
    first, second = heat[0][slid], heat[0][-1] - heat[0][waited]
    assert second / first == pytest.approx(np.exp(-1 / n), rel=1e-3)


@pytest.mark.parametrize("rise", [10.0, 0.0])
def test_evaporation_acts_behind_the_block_and_above_ambient(lab, rise):
    wet, dry = (lab.scene(mesh(), *parts) for parts in ([acting("evaporation")], []))
    balance = HeatBalance(wet)
    out, warm = np.zeros((2, balance.size)), np.zeros(balance.size)
    warm[: balance.n] = rise
    for made, o in zip((wet, dry), out, strict=True):
        PhaseSystem(HeatBalance(made), made.schedule.phases[0]).rate(0.5, warm, o)
    cell, area, half = wet.mesh.patches["road.free"]
    behind = wet.mesh.x_centre[wet.mesh.line[cell]] > L
    drawn = ((out[0] - out[1])[: balance.n] * balance.capacity)[cell] / area
    expected = -rise / (1 / 150.0 + half / wet.road.conductivity)
    assert np.all(drawn[~behind] == 0)
    np.testing.assert_allclose(drawn[behind], expected[behind], rtol=1e-9, atol=0)


def test_radiation_cools_a_body_as_the_fourth_power_says(lab):
    """dT/dt = -b (T^4 - T_0^4) of a body that conducts well; W = 50 mm."""
    iron = lab.Material(1e3, 1200.0, 1700.0)
    scene = lab.scene(
        mesh(), lab.APART, acting("radiation", emissivity=0.9), rubber=iron, road=lab.NO_ROAD, speed=0.01, time=2000.0
    )
    rise = lab.slide(scene, warm=150.0)[1][scene.mesh.block]
    b = 0.9 * STEFAN_BOLTZMANN_W_M2K4 * (2 / 0.05 + 2 / L) / iron.volumetric_capacity
    T, T0 = np.array([150.0, rise.mean()]) + scene.ambient, scene.ambient
    took = np.log((T - T0) / (T + T0)) / (4 * T0**3) - np.arctan(T / T0) / (2 * T0**3)
    assert rise.mean() < 120.0
    lab.check("radiation of a body, time", abs((took[0] - took[1]) / b / 2000.0 - 1), 1e-4)


def test_internal_heat_warms_an_insulated_block_evenly(lab):
    scene = lab.scene(mesh(), lab.APART, acting("internal_heat", loss=0.03), speed=0.2, pressure=2e5, time=5.0)
    run, rise = lab.slide(scene)
    power = 0.03 * 2e5 * 0.2
    expected = power * 5.0 / (scene.block.volumetric_capacity * H)
    np.testing.assert_allclose(rise[scene.mesh.block], expected, rtol=1e-6)
    assert run.energy["friction"][-1] == pytest.approx(power * 5.0 * L, rel=1e-9)
    assert run.budget["block"] == pytest.approx(run.budget["friction"], rel=1e-9)


def test_anisotropy_is_felt_along_the_block_only(lab):
    """A cosine along an insulated block decays by D (1 + excess) (pi/L)^2, one through its height by D (pi/H)^2."""
    length = height = 5e-3
    grid = mesh(40, length, height, 40)
    for excess in (-0.5, 0.0, 1.0):
        scene = lab.scene(grid, lab.APART, lab.MU, acting("conductivity_anisotropy", excess=excess), time=10.0)
        x, z = grid.x_centre[grid.line[grid.block]], grid.z_centre[grid.block]
        for place, factor in ((x / length, 1 + excess), (z / height, 1.0)):
            wave = np.cos(np.pi * place)
            rise = lab.slide(scene, warm=10.0 * (1.0 + wave))[1][grid.block]
            left = (rise * wave).sum() / (10.0 * wave**2).sum()
            rate = -np.log(left) / 10.0
            expected = factor * scene.block.diffusivity * (np.pi / length) ** 2
            lab.check(f"anisotropy {excess:g}", abs(rate / expected - 1), 1e-3)


# --- the contact ---------------------------------------------------------------------------------
def resistance(lab, *parts, **given):
    """Temperature jump over the flux into the road (lines,) at the end of the schedule, m2 K/W."""
    split = lab.number("contact.heat_split", 1.0)
    scene = lab.scene(mesh(), lab.MU, split, *parts, **given)
    out = lab.fluxes(scene, lab.slide(scene)[1])
    return (out.spot - out.lane) / out.into_road


def test_third_body_grows_by_the_distance_slid(lab):
    layer = acting("third_body", growth=2e-5)
    np.testing.assert_allclose(resistance(lab, layer), 2e-5, rtol=1e-9)
    np.testing.assert_allclose(resistance(lab, layer, wait=1.0), 4e-5, rtol=1e-9)
    scene = lab.scene(mesh(), layer, wait=1.0)
    law = HeatBalance(scene).laws
    grown = [
        law("contact.resistance", 0.0, None, scene.law_context(p, t))
        for p in scene.schedule.phases
        for t in (p.begin, p.end)
    ]
    np.testing.assert_allclose(grown, [0.0, 2e-5, 2e-5, 2e-5, 2e-5, 4e-5], rtol=1e-12)


@pytest.mark.parametrize(("speed", "times"), [(0.05, 2**0.5), (0.1, 1.0), (0.4, 0.5)])
def test_film_resists_less_at_speed(lab, speed, times):
    film = acting("conductance_speed", resistance=3e-5)
    np.testing.assert_allclose(resistance(lab, film, speed=speed), 3e-5 * times, rtol=1e-9)


def test_film_resists_less_under_local_load(lab):
    tilt, film = acting("pressure_tilt", a=0.6), acting("conductance_load", resistance=3e-5)
    p = 3e5 * (1 + 0.6 * (1 - 2 * mesh().x_block / L))
    np.testing.assert_allclose(resistance(lab, film, tilt, pressure=3e5), 3e-5 * (1.5e5 / p) ** 0.95, rtol=1e-9)


def test_film_under_an_edge_that_lifts_off(lab):
    """Where nothing presses, the resistance is held and the run goes on."""
    wear = acting("wear", rate=1e-9)
    scene = lab.scene(mesh(), lab.MU, wear, acting("pressure_tilt", a=1.0), acting("conductance_load"))
    run, rise = lab.slide(scene)
    assert np.all(np.isfinite(rise))
    assert run.pressure.min() >= 0.0


# --- friction and pressure -----------------------------------------------------------------------
def test_friction_follows_a_power_of_the_speed(small, lab):
    """Heat of a distance is mu p L s, whatever the time it takes."""
    heat = {
        v: lab.case(**SMALL, effects=["friction_speed"], schedule__speed=v).energy["friction"][-1] for v in (0.1, 0.4)
    }
    for v, found in heat.items():
        assert found == pytest.approx((v / 0.3) ** 0.1 * 1.5e5 * L * 0.4, rel=1e-6)
    started = lab.case(**SMALL, effects=["friction_speed"], schedule__speed=[[0.0, 0.0], [1.0, 0.3]])
    on = started.sliding & (started.time < 1.0) & (started.time > 1e-3)
    np.testing.assert_allclose(started.friction[on], started.time[on] ** 0.1, rtol=1e-9)
    assert np.nanmin(started.friction) == pytest.approx((1e-4 / 0.3) ** 0.1)


def test_friction_falls_with_the_local_load(lab):
    parts = lab.MU, acting("pressure_tilt", a=0.9), acting("friction_load", exponent=0.3)
    for mean in (1e5, 4e5):
        scene = lab.scene(mesh(), *parts, pressure=mean)
        run, rise = lab.slide(scene)
        p = mean * (1 + 0.9 * (1 - 2 * scene.mesh.x_block / L))
        mu = (p / 1e5) ** -0.3
        np.testing.assert_allclose(lab.fluxes(scene, rise).mu, mu, rtol=1e-12)
        assert run.friction[-1] == pytest.approx((mu * p).sum() / p.sum(), rel=1e-12)
        assert run.energy["friction"][-1] == pytest.approx((mu * p).mean() * 0.1 * L, rel=1e-6)


def test_crown_is_even_and_carries_the_load(small):
    on, base, edges = small("pressure_crown", c=0.4), small(), small().mesh.x
    u = 2 * edges[small().mesh.first : small().mesh.last + 1] / L - 1
    shape = 1 + 0.4 * (1 - (u[1:] ** 2 + u[1:] * u[:-1] + u[:-1] ** 2))
    p = on.pressure[on.last_sliding_index]
    np.testing.assert_allclose(p, 1.5e5 * shape, rtol=1e-9)
    assert p @ np.diff(u) == pytest.approx(2 * 1.5e5, rel=1e-12)
    rise = (on.T_block - base.T_block)[np.flatnonzero(on.sliding)[-1]]
    assert rise[len(rise) // 2] > 0.1
    assert max(rise[0], rise[-1]) < -0.1
