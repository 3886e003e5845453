"""Effects of the contact against small programs of their own: micro-contacts, debris, stones in the road, air."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.special import j0, jn_zeros, jv

from flashtemp.errors import BadInput
from flashtemp.meshes.grading import geometric
from flashtemp.meshes.mesh import Mesh
from flashtemp.model.case import assemble_case
from flashtemp.model.case_file import KeyLocations
from flashtemp.model.numerics import SolverSettings, choose_binding
from flashtemp.model.scene import ActiveEffect
from flashtemp.physics.effect import Effect, Factor, find_effect
from flashtemp.physics.material import LIBRARY
from flashtemp.physics.quantities import KELVIN
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.integration_state import IntegrationState
from flashtemp.solver.system import PhaseSystem
from flashtemp.solver.time_integration import integrate_schedule

RUBBER, ROAD, STONE = (LIBRARY[name] for name in ("tread_rubber", "asphalt", "granite"))
L, D, S = 0.025, 1e-5, 0.05
QUICK = {
    "block__height": 0.002, "road__track_length": 0.15, "schedule__distance": 0.2, "schedule__repetitions": 2,
    "schedule__wait": 1.0, "numerics__cells": [8, 8, 8], "output__profiles": 6,
}  # fmt: skip


def acting(name, **values):
    """An effect for `lab.scene`, defaults unless told."""
    return find_effect(name)(), values


def block_on_road(height=2e-3, levels=6, finest=2e-6):
    return Mesh(
        np.linspace(0, L, 13), geometric(6e-3, finest, 80), geometric(height, finest, 10 * levels), 0, 12
    )  # fmt: skip


def sides(lab, effect, speed=0.1):
    """What an effect adds to the rubber's side and to the road's, m2 K/W, by the laws alone."""
    scene = lab.scene(block_on_road(), effect, speed=speed)
    laws, now = HeatBalance(scene).laws, scene.law_context(scene.schedule.phases[0], scene.schedule.end_time)
    now = now._replace(x=np.zeros(1), local_pressure=np.full(1, 1e5))
    return tuple(laws(f"contact.{name}", 0.0, None, now) for name in ("micro_resistance", "resistance"))


def at_the_end(lab, scene):
    """Fluxes at the end of a slide and the worn depth (columns,) m, with all that the state says."""
    balance = HeatBalance(scene)
    y = balance.initial_state()
    state = IntegrationState(t=0.0, phase=0, y=y, removed_heat=-np.array(balance.stored_heat(y)))
    assert (
        integrate_schedule(scene, SolverSettings(choose_binding(None), 1e-7, profiles=4), state=state).energy_imbalance
        < lab.LEAK
    )
    system = PhaseSystem(balance, scene.schedule.phases[-1])
    return system.solve_contact(system.law_context(scene.schedule.end_time), state.y).flux, balance.worn_depth(state.y)


# --- what is asked once ------------------------------------------------------------------------------
class Warmed(Effect):
    """Contact that grows with the face's mean temperature, everywhere alike, and calls itself steady."""

    steady = True

    def heat(self, scene, p):
        yield Factor(
            "contact.spot_fraction",
            lambda T, now, p: 1.0 if now.face is None else 1.0 + 0.02 * np.ptp([293.0, *now.face]),
        )


@pytest.mark.parametrize("lifted", [True, False])
@pytest.mark.parametrize(
    "name",
    ["", "pressure_tilt", "edge_pressure", "interface_resistance", "spot_saturation", "conductance_speed", "warm"],
)
@pytest.mark.sample("-True", "edge_pressure-False", "spot_saturation-True", "conductance_speed-False", "warm-False")
def test_a_contact_that_is_asked_once_is_what_it_is_at_every_moment(monkeypatch, name, lifted):
    """To the bit, while speed and pressure change, at the start, at rest and lifted."""
    given = {k.replace("__", "."): v for k, v in QUICK.items()} | {"schedule.lifted": lifted, "output.profiles": 4}
    given |= {"schedule.speed": [[0.0, 0.1], [0.5, 0.1], [1.0, 0.3]], "contact.pressure": [[0.0, 1e5], [0.3, 2e5]]}
    made = assemble_case(
        {"effects": [name]} if name not in ("", "warm") else {}, given, KeyLocations("none"), Path(), "asked"
    )
    plain = made.scene
    if name == "warm":
        plain = replace(plain, acting=(*plain.acting, ActiveEffect("warmed", Warmed(), SimpleNamespace())))
    once = integrate_schedule(plain, made.settings)
    monkeypatch.setattr(HeatBalance, "is_contact_static", False)
    always = integrate_schedule(plain, made.settings)
    for what in ("time", "T_block", "T_spot", "T_road", "T_wake", "pressure", "friction"):
        np.testing.assert_array_equal(getattr(once, what), getattr(always, what), err_msg=what)


# --- a column of cells that nobody else has seen ---------------------------------------------------
def line(material, depth, cells, finest):
    """Cell sizes (cells,) m, growing from the face, and conductances between cells (cells - 1,) W/(m2 K)."""
    growth = np.roots([1.0, *[0.0] * (cells - 1), -depth / finest, depth / finest - 1.0])
    growth = max(g.real for g in growth if abs(g.imag) < 1e-9 and g.real > 1.0 + 1e-6)
    size = finest * growth ** np.arange(cells)
    return size, material.conductivity / (0.5 * (size[1:] + size[:-1]))


def conduction(bodies):
    """dT/dt = A T of insulated lines [(material, sizes, conductances)], and where the face cell of each stands."""
    n = sum(len(size) for _, size, _ in bodies)
    A, first, at = np.zeros((n, n)), [], 0
    for material, size, g in bodies:
        heat = material.volumetric_capacity * size
        for i, c in enumerate(g):
            a, b = at + i, at + i + 1
            A[a, a] -= c / heat[i]
            A[a, b] += c / heat[i]
            A[b, b] -= c / heat[i + 1]
            A[b, a] += c / heat[i + 1]
        first.append(at)
        at += len(size)
    return A, first


# --- micro-contacts --------------------------------------------------------------------------------
def moving_disc(v, d, body):
    """Mean rise of a disc heated by 1 W/m2 that a half-space passes at v m/s: the moving point source over the disc.

    From every place in the disc rays go to its edge; along each the point source integrates in closed form.
    """
    (r, weight), n, a = np.polynomial.legendre.leggauss(60), 720, 0.5 * d
    r, weight = 0.5 * (r + 1), 0.5 * weight
    place, ray = (2 * np.pi * (np.arange(k) + 0.5) / k for k in (72, n))
    along, x, y = np.broadcast_arrays(
        ray, (r[:, None] * np.cos(place))[..., None], (r[:, None] * np.sin(place))[..., None]
    )
    out = x * np.cos(along) + y * np.sin(along)
    reach = -out + np.sqrt(np.maximum(out**2 + 1.0 - x**2 - y**2, 0.0))
    turn = v * a / (2 * body.diffusivity) * (1.0 + np.cos(along))
    rise = np.where(turn > 1e-12, -np.expm1(-turn * reach) / np.maximum(turn, 1e-300), reach)
    return 2 * (weight * r) @ rise.mean(axis=(1, 2)) * a / body.conductivity


def test_the_moving_disc_of_the_test_knows_both_limits():
    assert moving_disc(0.0, D, RUBBER) == pytest.approx(4 * D / (3 * np.pi * RUBBER.conductivity), rel=1e-4)
    fast = 0.6885457813 * np.sqrt(D / 100.0) / RUBBER.effusivity  # V11
    assert moving_disc(100.0, D, RUBBER) == pytest.approx(fast, rel=4e-3)


@pytest.mark.parametrize("speed", [0.01, 0.1, 0.5, 1.0, 10.0])
def test_rubber_flows_past_micro_contacts(lab, speed):
    """The fit of the law is within 4 % of the integral."""
    rubber, _ = sides(lab, acting("micro_flash"), speed)
    assert rubber == pytest.approx((1 - S) / S * moving_disc(speed, D, RUBBER), rel=0.04)


@pytest.mark.parametrize("share", [0.02, 0.05, 0.1])
def test_road_rests_under_micro_contacts(lab, share):
    """An evenly heated disc at the end of an insulated cylinder, which its neighbours make: a series of Bessel."""
    _, road = sides(lab, acting("micro_flash", contact_share=share))
    a, e, root = 0.5 * D, np.sqrt(share), jn_zeros(1, 4000)
    series = 4 / e * (jv(1, root * e) ** 2 / (root**3 * j0(root) ** 2)).sum()
    assert road == pytest.approx(series * a / ROAD.conductivity / share, rel=2e-3)


def test_friction_feels_the_micro_contacts(lab):
    """Heat leaves the micro-contacts to both sides, each through its own discs; friction is that of their temperature."""
    rubber, road = sides(lab, acting("micro_flash"))
    soft = acting("friction_softening", b=0.02)
    scene = lab.scene(block_on_road(), lab.MU, lab.number("contact.heat_split", 1.0), soft, acting("micro_flash"))
    out = lab.fluxes(scene, lab.slide(scene)[1])
    np.testing.assert_allclose(out.touch - out.lane, road * out.into_road, rtol=1e-9)
    np.testing.assert_allclose(out.touch - out.spot, rubber * out.into_block, rtol=1e-9)
    np.testing.assert_allclose(out.into_block + out.into_road, out.heat, rtol=1e-12)
    assert np.all(out.touch > out.lane + 0.3)
    np.testing.assert_allclose(out.mu, np.exp(-0.02 * (out.touch - KELVIN - 20.0)), rtol=1e-9)


# --- debris ----------------------------------------------------------------------------------------
@pytest.mark.parametrize("split", [0.5, 1.0])
def test_debris_film_is_a_layer_that_conducts(lab, split):
    """The jump over the film is that of a layer of 200 cells, sheared all through or heated at the block's side."""
    film = acting("debris_film", thickness=2e-5, rate=1e-6, conductivity=0.15)  # saturated at once
    scene = lab.scene(block_on_road(), lab.MU, lab.number("contact.heat_split", split), film, time=0.5)
    out = lab.fluxes(scene, lab.slide(scene)[1])
    n, at = 400, -1
    g = 0.15 / (2e-5 / n)
    source = np.full(n, out.heat[at] / n) if split == 0.5 else np.zeros(n)
    if split == 1.0:
        source[0] = out.heat[at]
    A = 2.0 * g * np.eye(n) - g * np.eye(n, k=1) - g * np.eye(n, k=-1)
    A[0, 0], A[-1, -1] = g, 3.0 * g  # the road's side has a half cell to the lane
    source[0] -= out.into_block[at]  # which leaves by the rubber's side
    assert np.linalg.solve(A, source)[0] == pytest.approx(out.touch[at] - out.lane[at], rel=0.01)


def test_debris_film_follows_the_worn_depth_of_the_state(lab):
    """Thickness by marching the balance of feed and loss along the wear of every place."""
    given = [acting("wear", rate=2e-8, energy=0.0), acting("pressure_tilt", a=0.8), acting("debris_film", share=0.05)]
    scene = lab.scene(block_on_road(2e-3), lab.MU, lab.number("contact.heat_split", 1.0), *given, time=0.5)
    out, worn = at_the_end(lab, replace(scene, stiffness=1.4e9))  # springs give way more unevenly than elasticity
    h, steps = 0.0, 4000
    for _ in range(steps):
        h = h + 0.05 * (1 - h / 1e-5) * worn / steps
    assert 0.05 < h.min() / 1e-5 < 0.3 < h.max() / 1e-5 < 0.6
    np.testing.assert_allclose((out.touch - out.lane) / out.into_road, h / 0.2, rtol=1e-3)


def test_debris_film_without_wear_is_fed_by_its_own_rate(lab):
    """As with wear at that rate, in proportion to pressure."""
    film = {"debris_film__rate": 4e-9, "debris_film__share": 0.05}
    alone = lab.case(effects=["debris_film"], **film, **QUICK)
    worn = lab.case(effects=["debris_film", "wear"], wear__rate=4e-9, wear__energy=0.0, **film, **QUICK)
    plain = lab.case(**QUICK)
    assert np.all(alone.T_spot[alone.last_sliding_index] > plain.T_spot[plain.last_sliding_index] + 0.05)
    np.testing.assert_allclose(alone.T_spot[alone.last_sliding_index], worn.T_spot[worn.last_sliding_index], atol=0.01)


# --- stones ----------------------------------------------------------------------------------------
@pytest.mark.parametrize("share", [0.3, 1.0])
def test_stones_beside_mix_take_heat_side_by_side(lab, share):
    """Heat between rubber and two columns of road with one face temperature, all by the exponential of a matrix."""
    q, time = 1e5, 0.05
    scene = lab.scene(
        block_on_road(4e-3), lab.MU, acting("stone_tops", share=share, effusivity=STONE.effusivity), time=time,
        speed=0.02, pressure=q / 0.02,
    )  # fmt: skip
    out, _ = at_the_end(lab, scene)
    bodies = [(m, *line(m, 4e-3, 60, 2e-6)) for m in (RUBBER, STONE, ROAD)]
    weight = np.array([1.0, share, 1.0 - share])
    A, first = conduction(bodies)
    half = np.array([2 * m.conductivity / size[0] for m, size, _ in bodies])
    heat = np.array([m.volumetric_capacity * size[0] for m, size, _ in bodies])
    b = np.zeros(len(A))
    total = weight @ half  # the face has no capacity: total face = q + sum of weight half T
    for i, at in enumerate(first):
        A[at, at] -= half[i] / heat[i]
        for j, other in enumerate(first):
            A[at, other] += half[i] / heat[i] * weight[j] * half[j] / total
        b[at] = half[i] / heat[i] * q / total
    both = np.block([[A, b[:, None]], [np.zeros((1, len(A) + 1))]])
    T = expm(both * time)[:-1, -1]
    face = (q + sum(w * h * T[at] for w, h, at in zip(weight, half, first, strict=True))) / total
    found = out.spot[-3] - scene.ambient
    assert found == pytest.approx(face, rel=1e-3)
    plain = lab.scene(block_on_road(4e-3), lab.MU, time=time, speed=0.02, pressure=q / 0.02)
    assert found < 0.93 * (at_the_end(lab, plain)[0].spot[-3] - plain.ambient)


# --- air -------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("speed", "height"), [(0.1, 5e-4), (0.1, 5e-5), (1.0, 5e-5)])
def test_air_carries_heat_to_road_that_comes_in_cold(lab, speed, height):
    """Rubber beside air beside road, which is cold again each time that the block has moved on by its length."""
    phi, k, stay = 0.2, 0.026, 20
    time = stay * L / speed
    mesh = block_on_road(7e-3, 3, 2e-5)
    air = acting("air_gap", conductivity=k, height=height)
    scene = lab.scene(mesh, lab.APART, air, speed=speed, time=time, phi=phi)
    run, _ = lab.slide(scene, warm=30.0)
    lost = -run.energy["air"][-1] / L
    bodies = [(RUBBER, *line(RUBBER, 7e-3, 60, 2e-5)), (ROAD, *line(ROAD, 6e-3, 60, 2e-6))]
    A, first = conduction(bodies)
    halves = [size[0] / (2 * m.conductivity) for m, size, _ in bodies]
    heat = [m.volumetric_capacity * size[0] for m, size, _ in bodies]
    # of the face the share 1 - phi loses heat, by its own temperature: the half cell carries that share
    through = 1.0 / (halves[0] * (1 - phi) + height / k + halves[1])
    for i, (at, part) in enumerate(zip(first, (1 - phi, 1.0), strict=True)):
        A[at, first[i]] -= part * through / heat[i]
        A[at, first[1 - i]] += part * through / heat[i]
    once = expm(A * L / speed)
    T = np.r_[np.full(first[1], 30.0), np.zeros(len(A) - first[1])]
    for _ in range(stay):
        T[first[1] :] = 0.0
        T = once @ T
    left = RUBBER.volumetric_capacity * bodies[0][1] @ (30.0 - T[: first[1]])
    print(f"{lost:.1f} of {left:.1f} J/m2")
    assert lost == pytest.approx(left, rel=5e-3)


# --- wear ------------------------------------------------------------------------------------------
def test_wear_by_the_literature_is_fourfold_in_100_K(lab, tmp_path):
    """The worn depth of a block that slides at 100 K over ambient, over that of a cold one: no friction, no heat."""
    wear, values = acting("wear", rate=1e-9, energy=0.0, temperature="literature")
    values = wear.prepare({k: p.value for k, p in wear.params().items()} | values, tmp_path)
    scene = lab.scene(block_on_road(), lab.APART, lab.number("friction.mu", 0.0), (wear, values), time=0.5)
    balance = HeatBalance(scene)
    system, worn = PhaseSystem(balance, scene.schedule.phases[0]), []
    for warm in (0.0, 100.0):
        y, out = balance.initial_state(), np.zeros(balance.size)
        y[scene.mesh.block.ravel()] = warm
        system.rate(0.2, y, out)
        worn.append(out[balance.worn])
    np.testing.assert_allclose(worn[1] / worn[0], 4.0, rtol=1e-9)


def test_wear_knows_one_word_for_its_temperature(lab):
    with pytest.raises(BadInput, match=r'wear.temperature: \'hot\'; give a number \(1/K\) or "literature"'):
        lab.case(effects=["wear"], wear__temperature="hot")
    with pytest.raises(BadInput, match="wear.temperature"):
        lab.case(effects=["wear"], wear__temperature=0.5)
