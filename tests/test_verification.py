"""The solver against closed forms: every bound is at most twice the error measured here.

`pytest -s tests/test_verification.py` prints error and bound of each comparison (docs/verification.md).
Every run also has to conserve energy to rounding.
"""

from __future__ import annotations

import json
from itertools import pairwise
from math import inf, log2
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, PchipInterpolator

from flashtemp import cvode, exact
from flashtemp.balance import Balance
from flashtemp.case import assemble, build, settings
from flashtemp.effect import Deposit, Effect, Factor, Heat, Term
from flashtemp.effects.convection import Convection
from flashtemp.effects.flash import Flash
from flashtemp.effects.holder_sink import HolderSink
from flashtemp.effects.lanes import Lanes
from flashtemp.keys import Places
from flashtemp.march import Progress, Settings, march
from flashtemp.material import LIBRARY, Material
from flashtemp.mesh import Mesh
from flashtemp.meshes import block_on_road
from flashtemp.meshes.grading import geometric, two_sided
from flashtemp.scene import KELVIN, Acting, Scene
from flashtemp.schedule import Schedule, constant
from flashtemp.stage import Stage

RUBBER, ROAD, L = LIBRARY["tread_rubber"], LIBRARY["asphalt"], 0.025
# the same effusivity with 1e-4 of the diffusivity: V8 and V15 neglect conduction along x, here it is negligible
THIN_ROAD = Material(1e-2 * ROAD.conductivity, 1e2 * ROAD.density, ROAD.heat_capacity)
THIN_RUBBER = Material(1e-2 * RUBBER.conductivity, 1e2 * RUBBER.density, RUBBER.heat_capacity)
NO_BLOCK, NO_ROAD = Material(1e-12, 1200.0, 1700.0), Material(1e-12, 2300.0, 950.0)  # take no heat
LEAK = 1e-11  # relative energy imbalance that rounding may leave


def hold(label: str, error: float, bound: float) -> None:
    """An error and its bound, printed for the table of docs/verification.md."""
    print(f"{label}: {error:.3g} <= {bound:.3g}")
    assert error <= bound, label


class Given(Effect):
    """Contributions that a test states itself."""

    def __init__(self, *parts):
        self.parts = parts

    def heat(self, scene, p):
        yield Heat.film("block.holder", lambda now, p: 0.0)
        yield from self.parts


def number(target: str, value: float) -> Term:
    return Term(target, lambda T, now, p: value)


APART, MU = number("contact.resistance", 1e30), number("friction.mu", 1.0)


def scene(mesh, *parts, rubber=RUBBER, road=ROAD, speed=0.1, pressure=1e5, time=1.0, wait=0.0, lifted=True, phi=1.0):
    """Only what `parts` state acts: effects as (Effect, {parameter: value}), everything else as contributions."""
    effects = [
        (e, {k: v.value for k, v in e.params().items()} | own) for e, own in (p for p in parts if type(p) is tuple)
    ]
    own = Given(number("contact.spot_fraction", phi), *(p for p in parts if type(p) is not tuple))
    acting = [Acting(type(e).__name__, e, SimpleNamespace(**values)) for e, values in [(own, {}), *effects]]
    plan = Schedule(constant(speed), constant(pressure), speed * time, 2 if wait else 1, wait, lifted)
    return Scene(
        mesh=mesh, block=rubber, road=road, schedule=plan, acting=tuple(acting), ambient=KELVIN,
        length=float(mesh.x[mesh.last]), height=float(mesh.height[-1]), width=0.05, spot_diameter=3e-3,
    )  # fmt: skip


def slide(scene, warm=0.0, rtol=1e-7, phase=0, profiles=4):
    """March from a block that is `warm` (K) above ambient; the Run and the cells' final rises."""
    balance = Balance(scene)
    y = np.zeros(balance.size)
    y[scene.mesh.block] = warm
    start = scene.schedule.phases[phase].begin
    state = Progress(t=start, phase=phase, y=y, left=-np.array(balance.stored(y)))
    run = march(scene, Settings(cvode.choose(None), rtol, profiles=profiles), state=state)
    assert run.energy_imbalance < LEAK
    return run, state.y[: balance.n]


def fluxes(scene, rise):
    """Fluxes and temperatures of the contact at the end of the schedule."""
    stage = Stage(Balance(scene), scene.schedule.phases[-1])
    now = stage.moment(scene.schedule.end)
    T_in = stage.entering(now)
    return stage.contact_fluxes(stage.contact_state(now), now, rise, T_in, stage.b.ones)


def column(cells, height, first, refine=1):
    """Block without ends (1 km), so that all is one-dimensional; the road below is a dummy."""
    return Mesh(np.array([0.0, 500.0, 1000.0]), geometric(1e-3, 1e-4, 4), geometric(height, first, cells, refine), 0, 2)


def orders(errors):
    """Observed orders of accuracy between meshes that double."""
    return [log2(a / b) for a, b in pairwise(errors)]


def second_order(label, errors, bound):
    print(f"{label}: observed order", ", ".join(f"{p:.3f}" for p in orders(errors)))
    assert orders(errors) == pytest.approx([2.0] * (len(errors) - 1), abs=0.1)
    hold(label, errors[-1], bound)


def heated(cells, height, first, refine, flux, time):
    """V1, V13: block heated through its face: places, rises and the surface value."""
    mesh = column(cells, height, first, refine)
    _, rise = slide(scene(mesh, APART, Heat.patch("block.face", lambda T, now, p: flux + 0.0 * T), time=time))
    T, z = rise[mesh.block[0]], mesh.z_centre[mesh.block[0]]
    return z, T, T[0] + flux * z[0] / RUBBER.conductivity


# --- half-spaces and slabs: V1, V2, V3, V13, V14 ----------------------------------------------------


def test_V1_constant_flux():
    z, T, surface = heated(24, 12e-3, 2e-5, 4, 1e4, 3.5)
    hold("V1 surface, K of 29.55997", abs(surface - 29.559970), 1.2e-2)
    hold("V1 at 1 mm, K of 5.292016", abs(CubicSpline(z, T)(1e-3) - 5.292016), 1e-2)
    hold("V1 profile, K", np.abs(T - exact.constant_flux(RUBBER, 1e4, 3.5, z)).max(), 1.2e-2)


def test_V2_pulse_with_the_events_of_the_schedule():
    mesh = Mesh(np.array([0.0, 500.0, 1000.0]), geometric(6e-3, 1e-5, 24, 4), geometric(7e-3, 1e-3, 4), 0, 2)
    pulse = Heat.patch("road.under", lambda T, now, p: (7.5e4 if now.waited == 0 else 0.0) + 0.0 * T)
    run, _ = slide(scene(mesh, APART, pulse, time=0.25, wait=1.0, lifted=False, speed=1e-9))
    rise = run.T_road[np.flatnonzero(run.time == 1.25)[0], 0]
    hold("V2, K of 6.757681", abs(rise - 6.757681), 2e-3)


@pytest.mark.parametrize(("depth", "bound"), [(5e-4, 1e-3), (5e-5, 1e-3)])
def test_V3_volumetric_source_and_order_in_depth(depth, bound):
    errors = []
    for refine in (1, 2, 4):
        mesh = column(24, 12e-3, 2e-5, refine)
        _, rise = slide(scene(mesh, APART, MU, Deposit(1.0, depth), pressure=1e5, time=0.03))
        z = mesh.z_centre[mesh.block[0]]
        errors.append(np.abs(rise[mesh.block[0]] - exact.deep_source(RUBBER, 1e4, depth, 0.03, z)).max())
    second_order(f"V3 depth {depth:g} m, K", errors, bound)


def test_V13_slab_and_order():
    errors = []
    for refine in (1, 2, 4):
        z, T, surface = heated(16, 7e-3, 2e-4, refine, 1e3, 100.0)
        errors.append(np.abs(T - exact.slab(RUBBER, 7e-3, 1e3, 100.0, z)).max())
    second_order("V13 profile, K", errors, 1.0)
    hold("V13 heated face, K of 15.855354", abs(surface - 15.8553540), 1.0)
    hold("V13 back, K of 2.8167688", abs(T[-1] - 2.8167688), 1.0)


def test_V14_face_of_a_lifted_block_cools_by_convection():
    mesh = column(24, 12e-3, 2e-5, 2)
    run, _ = slide(scene(mesh, APART, (Convection(), {"convection": 15.0}), wait=10.0), warm=1.0, phase=1)
    left = run.T_block[np.flatnonzero(run.time == 11.0)[0], 0]
    hold("V14 half-space, of 0.92925248", abs(left - 0.92925248), 1.0)


def test_V14_slab_cools_to_the_holder_and_order():
    errors = []
    for refine in (1, 2, 4):
        mesh = column(16, 7e-3, 4e-4, refine)
        world = scene(mesh, APART, (HolderSink(), {"coefficient": 20.0}), time=400.0)
        _, rise = slide(world, warm=1.0, rtol=1e-9)
        z = mesh.z_centre[mesh.block[0]]
        errors.append(np.abs(rise[mesh.block[0]] - exact.slab_cooling(RUBBER, 7e-3, 20.0, 400.0, 7e-3 - z)).max())
    second_order("V14 slab, of 1", errors, 1.0)


# --- two half-spaces in contact: V5, V6, V7 ---------------------------------------------------------


def touch(refine, alpha, time, surface=0.0, deep=0.0, depth=1e-4, difference=0.0):
    """Road slides below the block, but far from the edge all is at rest: what V5-V7 describe."""
    mesh = Mesh(np.linspace(0, L, 13), geometric(6e-3, 2e-6, 30, refine), geometric(4e-3, 2e-6, 30, refine), 0, 12)
    parts = [number("contact.resistance", 1 / alpha), number("contact.heat_split", 1.0)]
    heat = surface + deep
    parts += [MU, Deposit(deep / heat, depth)] if heat else []
    world = scene(mesh, *parts, speed=0.02, pressure=max(heat, 1.0) / 0.02, time=time)
    _, rise = slide(world, warm=difference)
    found = fluxes(world, rise)
    return found.into_road[-3], found.spot[-3] - KELVIN, found.lane[-3] - KELVIN


def test_V5_touching_half_spaces_and_order():
    errors = [abs(touch(r, 1e4, 0.01, difference=40.0)[0] / 98973.7762 - 1) for r in (1, 2, 4)]
    second_order("V5 alpha = 1e4, flux relative to 98973.7762", errors, 1.0)
    J, spot, lane = touch(4, inf, 0.01, difference=40.0)
    hold("V5 alpha = inf, flux relative to 108665.688", abs(J / 108665.688 - 1), 1.0)
    hold("V5 alpha = inf, interface, K of 13.029917", max(abs(spot - 13.0299170), abs(lane - 13.0299170)), 1.0)


def test_V6_source_at_the_interface():
    J, spot, lane = touch(4, 1e4, 0.05, surface=1e5)
    hold("V6 alpha = 1e4, flux relative to 59411.6287", abs(J / 59411.6287 - 1), 1.0)
    hold("V6 alpha = 1e4, T_S, K of 9.57365315", abs(lane - 9.57365315), 1.0)
    hold("V6 alpha = 1e4, T_R, K of 15.514816", abs(spot - 15.5148160), 1.0)
    J, spot, lane = touch(4, inf, 0.05, surface=1e5)
    hold("V6 alpha = inf, road share relative to 0.674252074", abs(J / 67425.2074 - 1), 1.0)
    hold("V6 alpha = inf, K of 11.5089746", max(abs(spot - 11.5089746), abs(lane - 11.5089746)), 1.0)


@pytest.mark.parametrize(("m", "joined", "resisted"), [(2e4, 49696.5773, 42549.1842), (2e5, 64735.4675, 55934.7523)])
def test_V7_sources_at_and_above_the_interface(m, joined, resisted):
    J, spot, _ = touch(4, inf, 0.01, surface=5e4, deep=5e4, depth=1 / m)
    hold(f"V7 m = {m:g}/m, alpha = inf, flux relative", abs(J / joined - 1), 1.0)
    rise = exact.shared_deep_rise(RUBBER, ROAD, 5e4, 5e4, 1 / m, 0.01)
    hold(f"V7 m = {m:g}/m, alpha = inf, K of {rise:.8g}", abs(spot - rise), 1.0)
    J, _, _ = touch(4, 2e4, 0.01, surface=5e4, deep=5e4, depth=1 / m)
    hold(f"V7 m = {m:g}/m, alpha = 2e4, flux relative", abs(J / resisted - 1), 1.0)


# --- road sliding past: V8, V9, V19, V23 ------------------------------------------------------------


def roll(*parts, refine=2, mean=7.5e4, time=0.4, cells=(40, 4, 30), first=(2e-5, 4e-4, 2e-8), depth=2.2e-5, **more):
    """Road at 0.1 m/s below a source of `mean` W/m2 from which the block takes nothing: line places and rises."""
    mesh = block_on_road.build(L, 7e-3, depth, cells, first[0], first[1], 1e-4, first[2], refine=refine)
    run, _ = slide(
        scene(mesh, MU, *parts, **{"rubber": NO_BLOCK, "road": THIN_ROAD} | more, pressure=mean / 0.1, time=time)
    )
    return run.x, run.T_road[-1], mesh


def test_V8_uniform_flux():
    x, T, _ = roll()
    hold("V8 uniform at L/2, K of 20.241636", abs(PchipInterpolator(x, T)(L / 2) - 20.241636), 1.0)
    hold("V8 uniform, K of 28.625996", np.abs(T - exact.road_rise(ROAD, 0.1, 7.5e4, x)).max(), 1.0)


def test_V8_linear_flux_peaks_in_the_middle():
    x, T, _ = roll(Term("contact.pressure", lambda T, now, p: 1.0 - 2.0 * now.x / L), mean=7.5e4 / 2)
    top = CubicSpline(x, T)
    peak = top.derivative().roots(extrapolate=False)
    hold("V8 linear, place of the peak, m of 0.0125", abs(peak[-1] - L / 2), 1.0)
    hold("V8 linear, peak, K of 13.494424", abs(top(peak[-1]) - 13.494424), 1.0)
    hold("V8 linear, K", np.abs(T - exact.road_rise_linear(ROAD, 0.1, 7.5e4, L, x)).max(), 1.0)


def test_V8_exponential_flux():
    decay = 5e-3
    mean = 7.5e4 * decay * (1 - np.exp(-L / decay)) / L
    x, T, _ = roll(Factor("contact.pressure", lambda T, now, p: np.exp(-now.x / decay)), mean=mean)
    top = CubicSpline(x, T)
    peak = top.derivative().roots(extrapolate=False)[0]
    hold("V8 exponential, place of the peak, m of 4.27016e-3", abs(peak - 4.27016e-3), 1.0)
    hold("V8 exponential, peak, K of 6.926413", abs(top(peak) - 6.926413), 1.0)
    hold("V8 exponential, K", np.abs(T - exact.road_rise_exponential(ROAD, 0.1, 7.5e4, decay, x)).max(), 1.0)


def test_V8_wake_behind_the_block():
    x = np.concatenate([two_sided(L, 2e-5, 2e-4, 60), L + geometric(0.11, 2e-4, 160)[1:]])
    mesh = Mesh(x, geometric(5e-5, 5e-8, 40), geometric(7e-3, 1e-3, 3), 0, 60)
    run, rise = slide(scene(mesh, MU, rubber=NO_BLOCK, road=THIN_ROAD, pressure=7.5e5, time=1.6))
    place, T = mesh.x_centre, rise[mesh.road[:, -1]]
    hold("V8 wake 0.1 m behind, K of 6.757681", abs(PchipInterpolator(place, T)(L + 0.1) - 6.757681), 1.0)
    far = place > L + 2e-3
    closed = exact.road_wake(ROAD, 0.1, 7.5e4, L, place[far])
    hold("V8 wake from 2 mm behind, K", np.abs(T[far] - closed).max(), 1.0)


def test_V8_isothermal_wall():
    mesh = block_on_road.build(L, 1e-4, 2.2e-5, (40, 4, 30), 2e-6, 4e-4, 2e-5, 5e-9, refine=2)
    copper = Material(1e6, 1200.0, 1700.0)
    wall = Heat.film("block.holder", lambda now, p: inf, far=lambda now, p: KELVIN + 1.0)
    world = scene(mesh, wall, rubber=copper, road=THIN_ROAD, pressure=1.0, time=0.4)
    run, rise = slide(world)
    J = fluxes(world, rise).into_road
    hold("V8 wall, mean flux relative to 3335.8827 W/m2K", abs((J * mesh.dx_block).sum() / L / 3335.8827 - 1), 1.0)
    law = ROAD.effusivity * np.sqrt(0.1 / (np.pi * run.x))
    hold("V8 wall, local flux from 1 mm on, relative", np.abs(J / law - 1)[run.x > 1e-3].max(), 1.0)


@pytest.mark.parametrize(
    ("peclet", "around", "time", "lines", "bounds"),
    [
        (10.0, 3, 3.0, 12, (1.0, 1.0, 1.0)),
        (1.0, 12, 20.0, 12, (1.0, 1.0, 1.0)),
        (0.1, 100, 2000.0, 16, (1.0, 1.0, 1.0)),
    ],
)
def test_V9_jaeger_strip(peclet, around, time, lines, bounds):
    b, n, first = L / 2, 48, 1e-4
    reach = geometric(around * b, first, 2 * lines)
    x = np.concatenate([-reach[:0:-1], two_sided(L, first, first, n), L + reach[1:]])
    mesh = Mesh(x, geometric(around * b, first, 48), geometric(7e-3, 1e-3, 3), 2 * lines, 2 * lines + n)
    v = 2 * ROAD.diffusivity * peclet / b
    world = scene(mesh, MU, rubber=NO_BLOCK, speed=v, pressure=1e3 / v, time=time * b * b / ROAD.diffusivity)
    run, _ = slide(world, rtol=1e-6)
    theta = np.pi * ROAD.conductivity * v * run.T_road[-1] / (2 * ROAD.diffusivity * 1e3)
    X = 1 - run.x / b  # the strip moves towards the road that comes
    top = CubicSpline(run.x, theta)
    roots = top.derivative().roots(extrapolate=False)
    peak = roots[np.argmax(top(roots))]
    hold(f"V9 Pe = {peclet:g}, middle", abs(top(b) - exact.jaeger(peclet, 0.0)), bounds[0])
    hold(f"V9 Pe = {peclet:g}, peak", abs(top(peak) - exact.jaeger(peclet, exact.jaeger_peak(peclet))), bounds[1])
    hold(f"V9 Pe = {peclet:g}, place of the peak X", abs(1 - peak / b - exact.jaeger_peak(peclet)), bounds[2])
    hold(
        f"V9 Pe = {peclet:g}, profile relative to the peak",
        np.abs(theta - exact.jaeger(peclet, X)).max() / theta.max(),
        1.0,
    )


def test_V19_conveyor_converges_on_a_uniform_mesh():
    errors = []
    for refine in (1, 2, 4):
        x, T, mesh = roll(refine=refine, cells=(25, 4, 24), first=(1.0, 1.0, 4e-8))
        error = np.abs(T - exact.road_rise(ROAD, 0.1, 7.5e4, x))
        errors.append((error * mesh.dx_block).sum() / L)
    print("V19 mean error, K", errors, orders(errors))
    assert min(orders(errors)) > 0.9
    hold("V19 100 uniform lines, mean error, K of 19.083997", errors[-1], 1.0)


def test_V19_order_along_x_for_a_smooth_flux():
    def flux(x):
        return 1.5e5 * np.sin(np.pi * x / L) ** 2

    errors = []
    for refine in (1, 2, 4):
        smooth = Factor("contact.pressure", lambda T, now, p: flux(now.x))
        x, T, _ = roll(smooth, refine=refine, cells=(16, 4, 16), first=(1e-3, 1e-3, 2e-7), depth=3e-5)
        errors.append(max(abs(t - exact.road_rise_any(ROAD, 0.1, flux, at)) for t, at in zip(T, x, strict=True)))
    second_order("V19 smooth flux along x, K of 31", errors, 1.0)


def test_V23_lanes_widen():
    x, T, _ = roll((Lanes(), {}), road=ROAD, phi=0.2, mean=1.5e4, depth=2.2e-3, first=(2e-5, 1e-4, 2e-6))
    at_exit = T[-1] / exact.road_rise(ROAD, 0.1, 7.5e4, x[-1])
    hold("V23 factor at the exit", abs(at_exit - exact.lane_factor(ROAD.diffusivity, 3e-3, x[-1] / 0.1)), 1.0)
    inside = x > 2e-3
    rise = exact.road_rise(ROAD, 0.1, 7.5e4, x) * [exact.lane_factor(ROAD.diffusivity, 3e-3, s / 0.1) for s in x]
    hold("V23 profile from 2 mm on, K", np.abs(T - rise)[inside].max(), 1.0)


# --- spots, scaling, energy: V10, V11, V15, V16, V18 ------------------------------------------------


@pytest.mark.parametrize(("speed", "full"), [(0.1, 1.669969), (1.0, 0.528091)])
@pytest.mark.parametrize(("slid", "built"), [(0.1, 0.49625100), (0.3, 0.78405522), (2.0, 1.0)])
def test_V10_V11_gap_between_spot_and_block(speed, full, slid, built):
    world = scene(
        column(12, 7e-3, 1e-5), MU, (Flash(), {}), road=NO_ROAD, phi=0.2, speed=speed,
        pressure=1e4 * 0.2 / speed, time=slid * 3e-3 / speed,
    )  # fmt: skip
    run, _ = slide(world)
    gap = (run.T_spot - run.T_block)[-1] / 0.8
    assert gap == pytest.approx([full * built] * 2, abs=6e-7)


def test_V11_gap_of_a_deep_source():
    world = scene(
        column(12, 7e-3, 1e-5), MU, Deposit(1.0, 5e-5), (Flash(), {}), road=NO_ROAD, phi=0.2,
        pressure=2e4, time=0.06,
    )  # fmt: skip
    run, _ = slide(world)
    gap = (run.T_spot - run.T_block)[-1] / 0.8
    assert gap == pytest.approx([exact.spot_flash_deep(RUBBER, 1e4, 5e-5, 3e-3, 0.1)] * 2, rel=1e-7)


def test_V15_everything_scales_with_the_root_of_speed():
    profiles = {}
    for v in (0.1, 0.5, 1.0):
        s = 1 / exact.scaling(v, 0.1)  # depths reached at the same slid distance
        mesh = block_on_road.build(L, s * 7e-4, s * 2.2e-4, (24, 16, 24), 1e-4, 1e-3, s * 1e-6, s * 3e-7)
        world = scene(mesh, MU, (Flash(), {}), rubber=THIN_RUBBER, road=THIN_ROAD, speed=v, phi=0.2, time=3.5 / v)
        run, _ = slide(world, rtol=1e-9)
        profiles[v] = run.T_spot[-1], run.T_block[-1]
    for v, ratio in ((0.5, 2.236068), (1.0, 3.162278)):
        for name, fast, slow in zip(("T_spot", "T_block"), profiles[v], profiles[0.1], strict=True):
            hold(f"V15 {name} at {v} m/s over 0.1 m/s, relative to {ratio}", np.abs(fast / slow / ratio - 1).max(), 1.0)


def case(**given):
    """A case assembled from overrides alone, table__key=value, and its run."""
    made = assemble({}, {k.replace("__", "."): v for k, v in given.items()}, Places("none"), Path(), "verification")
    run = march(build(made), settings(made))
    assert run.energy_imbalance < LEAK
    return run


BARE = {"ambient__convection": 0.0, "contact__lane_widening": 0.0}


def test_V15_V16_V18_default_case():
    share = {}
    for v in (0.1, 1.0):
        run = case(schedule__speed=v, contact__flash_factor=0.0, **BARE)
        dx = run.mesh.dx_block
        final = (exact.road_rise(ROAD, v, 1.5e5 * v / 0.2, run.x) * dx).sum()
        rise = run.T_block[-1] - 20.0
        share[v] = (rise * dx).sum() / final, run.at_x(rise, L / 2)
        given = 1.5e5 * 3.5 * L
        hold(f"V18 {v} m/s, friction heat relative to mu p s L", abs(run.budget["friction"] / given - 1), 1e-10)
        kept = run.budget["block"] + 0.2 * (run.energy["lanes"][-1] + run.energy["lane_out"][-1])
        hold(f"V18 {v} m/s, block and road gain, relative", abs(kept / given - 1), 1e-10)
    hold("V15 case, rise at L/2, ratio relative to 3.162278", abs(share[1.0][1] / share[0.1][1] / 3.162278 - 1), 1.0)
    guide = exact.road_driven(RUBBER, ROAD, L, 0.2, 3.5)
    hold("V16 share of the final rise against its guide 0.8995", abs(share[0.1][0] - guide), 1.0)
    hold("V16 the share depends on distance alone", abs(share[1.0][0] - share[0.1][0]), 1.0)


# --- time -------------------------------------------------------------------------------------------


def test_error_in_time_follows_the_tolerance():
    def run(rtol):
        return case(numerics__mesh="coarse", numerics__rtol=rtol, **BARE).T_block

    true = run(1e-8)
    errors = [np.sqrt(np.square(run(rtol) - true).mean()) for rtol in (1e-3, 1e-4, 1e-5)]
    print("time errors, K", errors)
    for rtol, error in zip((1e-3, 1e-4, 1e-5), errors, strict=True):
        hold(f"time, rtol = {rtol:g}: rms error over rtol times the largest rise", error / rtol / np.ptp(true), 1.0)
    assert errors[0] / errors[1] > 5
    assert errors[1] / errors[2] > 5


# --- the benchmark ----------------------------------------------------------------------------------

SLIDE = {
    "block.material": "rubber", "road.material": "stone", "road.depth": 0.01, "road.upstream": 0.005,
    "road.downstream": 0.01, "contact.pressure": 1e6, "contact.spot_fraction": 1.0, "contact.alpha": 2e5,
    "contact.heat_split": 0.5, "contact.lane_widening": 0.0, "friction.volumetric_share": 0.5, "friction.depth": 1e-4,
    "ambient.convection": 20.0, "effects": ["holder_sink"], "holder_sink.coefficient": 20.0,
    "materials.rubber.conductivity": 0.23, "materials.rubber.density": 1200.0, "materials.rubber.heat_capacity": 1700.0,
    "materials.stone.conductivity": 1.2, "materials.stone.density": 2400.0, "materials.stone.heat_capacity": 900.0,
}  # fmt: skip


@pytest.mark.parametrize(
    ("cells", "first", "most", "percent"),
    [
        ([60, 30, 60], (4e-5, 4e-5, 5e-6, 5e-6), 12000, 0.1),
        ([28, 11, 48], (2.7e-4, 6.11e-4, 1.07e-5, 2.15e-5), 2500, 0.1),
        ([24, 16, 26], (1e-4, 1e-4, 1e-5, 1e-5), 1500, 1.0),
        ([10, 6, 16], (4.2e-4, 2e-3, 3e-5, 3e-5), 320, 1.0),
    ],
)
def test_slide2d_agrees_with_the_reference(cells, first, most, percent):
    reference = json.loads((Path(__file__).parent / "data" / "slide2d_reference.json").read_text(encoding="utf-8"))
    names = ("first_x", "last_x", "first_block", "first_road")
    mesh = {f"numerics.{k}": v for k, v in zip(names, first, strict=True)} | {
        "numerics.cells": cells,
        "numerics.rtol": 1e-3,
    }
    run = case(**SLIDE, **mesh)
    assert run.mesh.n_cells <= most
    rise = run.T_block - 20.0
    along = PchipInterpolator(run.x, rise[-1])(np.array(reference["x"])) - reference["TR_rise"]
    middle = PchipInterpolator(run.time, PchipInterpolator(run.x, rise, axis=1)(L / 2))(reference["t_mid"])
    scale = 100 / reference["max_rise_TR"]
    label = f"slide2d {run.mesh.n_cells} cells"
    hold(f"{label}, along x at 35 s, %", scale * np.abs(along).max(), percent)
    hold(f"{label}, middle in time, %", scale * np.abs(middle - reference["TR_mid_rise"]).max(), percent)
