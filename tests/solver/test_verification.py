"""The solver against closed forms: no bound is more than twice the error measured.

`pytest -s tests/solver/test_verification.py` prints error and bound of each comparison (docs/explanation/verification.md).
Every run also has to conserve energy to rounding.
"""

from __future__ import annotations

from math import inf

import numpy as np
import pytest
from reference import analytical_solutions
from scipy.interpolate import CubicSpline, PchipInterpolator

from flashtemp.meshes import block_on_road
from flashtemp.meshes.grading import geometric, two_sided
from flashtemp.meshes.mesh import Mesh
from flashtemp.physics.effect import Deposit, Factor, Heat, Term
from flashtemp.physics.effects.convection import Convection
from flashtemp.physics.effects.flash import Flash
from flashtemp.physics.effects.holder_sink import HolderSink
from flashtemp.physics.effects.lanes import Lanes
from flashtemp.physics.material import LIBRARY, Material
from flashtemp.physics.quantities import KELVIN

RUBBER, ROAD, L = LIBRARY["tread_rubber"], LIBRARY["asphalt"], 0.025


def heated(lab, cells, height, first, refine, flux, time):
    """V1, V13: block heated through its face: places, rises and the surface value."""
    mesh = lab.column(cells, height, first, refine)
    _, rise = lab.slide(
        lab.scene(mesh, lab.APART, Heat.patch("block.face", lambda T, now, p: flux + 0.0 * T), time=time)
    )
    T, z = rise[mesh.block[0]], mesh.z_centre[mesh.block[0]]
    return z, T, T[0] + flux * z[0] / RUBBER.conductivity


# --- half-spaces and slabs: V1, V2, V3, V13, V14 ----------------------------------------------------


def test_V1_constant_flux(lab):
    z, T, surface = heated(lab, 24, 12e-3, 2e-5, 4, 1e4, 3.5)
    lab.check("V1 surface, K of 29.55997", abs(surface - 29.559970), 0.01)
    lab.check("V1 at 1 mm, K of 5.292016", abs(CubicSpline(z, T)(1e-3) - 5.292016), 0.0006)
    lab.check("V1 profile, K", np.abs(T - analytical_solutions.constant_flux(RUBBER, 1e4, 3.5, z)).max(), 0.01)


def test_V2_pulse_with_the_events_of_the_schedule(lab):
    mesh = Mesh(np.array([0.0, 500.0, 1000.0]), geometric(6e-3, 1e-5, 24, 4), geometric(7e-3, 1e-3, 4), 0, 2)
    pulse = Heat.patch("road.under", lambda T, now, p: (7.5e4 if now.waited == 0 else 0.0) + 0.0 * T)
    run, _ = lab.slide(lab.scene(mesh, lab.APART, pulse, time=0.25, wait=1.0, lifted=False, speed=1e-9))
    rise = run.T_road[np.flatnonzero(run.time == 1.25)[0], 0]
    lab.check("V2, K of 6.757681", abs(rise - 6.757681), 0.002)


@pytest.mark.parametrize(("depth", "bound"), [(5e-4, 4e-5), (5e-5, 5e-4)])
def test_V3_volumetric_source_and_order_in_depth(lab, depth, bound):
    errors = []
    for refine in (1, 2, 4):
        mesh = lab.column(24, 12e-3, 2e-5, refine)
        _, rise = lab.slide(lab.scene(mesh, lab.APART, lab.MU, Deposit(1.0, depth), pressure=1e5, time=0.03))
        z = mesh.z_centre[mesh.block[0]]
        errors.append(np.abs(rise[mesh.block[0]] - analytical_solutions.deep_source(RUBBER, 1e4, depth, 0.03, z)).max())
    lab.check_second_order(f"V3 depth {depth:g} m, K", errors, bound)


def test_V13_slab_and_order(lab):
    errors = []
    for refine in (1, 2, 4):
        z, T, surface = heated(lab, 16, 7e-3, 2e-4, refine, 1e3, 100.0)
        errors.append(np.abs(T - analytical_solutions.slab_heating(RUBBER, 7e-3, 1e3, 100.0, z)).max())
    lab.check_second_order("V13 profile, K", errors, 0.002)
    lab.check("V13 heated face, K of 15.855354", abs(surface - 15.8553540), 0.0025)
    lab.check("V13 back, K of 2.8167688", abs(T[-1] - 2.8167688), 0.003)


def test_V14_face_of_a_lifted_block_cools_by_convection(lab):
    mesh = lab.column(24, 12e-3, 2e-5, 2)
    run, _ = lab.slide(lab.scene(mesh, lab.APART, (Convection(), {"convection": 15.0}), wait=10.0), warm=1.0, phase=1)
    left = run.T_block[np.flatnonzero(run.time == 11.0)[0], 0]
    lab.check("V14 half-space, of 0.92925248", abs(left - 0.92925248), 0.0004)


@pytest.mark.long
def test_V14_slab_cools_to_the_holder_and_order(lab):
    errors = []
    for refine in (1, 2, 4):
        mesh = lab.column(16, 7e-3, 4e-4, refine)
        world = lab.scene(mesh, lab.APART, (HolderSink(), {"coefficient": 20.0}), time=400.0)
        _, rise = lab.slide(world, warm=1.0, rtol=1e-9)
        z = mesh.z_centre[mesh.block[0]]
        errors.append(
            np.abs(rise[mesh.block[0]] - analytical_solutions.slab_cooling(RUBBER, 7e-3, 20.0, 400.0, 7e-3 - z)).max()
        )
    lab.check_second_order("V14 slab, of 1", errors, 1e-5)


# --- two half-spaces in contact: V5, V6, V7 ---------------------------------------------------------


def touch(lab, refine, alpha, time, surface=0.0, deep=0.0, depth=1e-4, difference=0.0):
    """Road slides below the block, but far from the edge all is at rest: what V5-V7 describe."""
    mesh = Mesh(np.linspace(0, L, 13), geometric(6e-3, 2e-6, 30, refine), geometric(4e-3, 2e-6, 30, refine), 0, 12)
    parts = [lab.number("contact.resistance", 1 / alpha), lab.number("contact.heat_split", 1.0)]
    heat = surface + deep
    parts += [lab.MU, Deposit(deep / heat, depth)] if heat else []
    world = lab.scene(mesh, *parts, speed=0.02, pressure=max(heat, 1.0) / 0.02, time=time)
    _, rise = lab.slide(world, warm=difference)
    found = lab.fluxes(world, rise)
    return found.into_road[-3], found.spot[-3] - KELVIN, found.lane[-3] - KELVIN


def test_V5_touching_half_spaces_and_order(lab):
    errors = [abs(touch(lab, r, 1e4, 0.01, difference=40.0)[0] / 98973.7762 - 1) for r in (1, 2, 4)]
    lab.check_second_order("V5 alpha = 1e4, flux relative to 98973.7762", errors, 0.0003)
    J, spot, lane = touch(lab, 4, inf, 0.01, difference=40.0)
    lab.check("V5 alpha = inf, flux relative to 108665.688", abs(J / 108665.688 - 1), 0.0003)
    lab.check("V5 alpha = inf, interface, K of 13.029917", max(abs(spot - 13.0299170), abs(lane - 13.0299170)), 0.0001)


def test_V6_source_at_the_interface(lab):
    J, spot, lane = touch(lab, 4, 1e4, 0.05, surface=1e5)
    lab.check("V6 alpha = 1e4, flux relative to 59411.6287", abs(J / 59411.6287 - 1), 3e-5)
    lab.check("V6 alpha = 1e4, T_S, K of 9.57365315", abs(lane - 9.57365315), 0.004)
    lab.check("V6 alpha = 1e4, T_R, K of 15.514816", abs(spot - 15.5148160), 0.004)
    J, spot, lane = touch(lab, 4, inf, 0.05, surface=1e5)
    lab.check("V6 alpha = inf, road share relative to 0.674252074", abs(J / 67425.2074 - 1), 1e-5)
    lab.check("V6 alpha = inf, K of 11.5089746", max(abs(spot - 11.5089746), abs(lane - 11.5089746)), 0.004)


@pytest.mark.parametrize(("m", "joined", "resisted"), [(2e4, 49696.5773, 42549.1842), (2e5, 64735.4675, 55934.7523)])
@pytest.mark.sample("200000.0-64735.4675-55934.7523")
def test_V7_sources_at_and_above_the_interface(lab, m, joined, resisted):
    J, spot, _ = touch(lab, 4, inf, 0.01, surface=5e4, deep=5e4, depth=1 / m)
    lab.check(f"V7 m = {m:g}/m, alpha = inf, flux relative", abs(J / joined - 1), 0.00015)
    rise = analytical_solutions.shared_deep_rise(RUBBER, ROAD, 5e4, 5e4, 1 / m, 0.01)
    lab.check(f"V7 m = {m:g}/m, alpha = inf, K of {rise:.8g}", abs(spot - rise), 0.001)
    J, _, _ = touch(lab, 4, 2e4, 0.01, surface=5e4, deep=5e4, depth=1 / m)
    lab.check(f"V7 m = {m:g}/m, alpha = 2e4, flux relative", abs(J / resisted - 1), 0.0001)


# --- road sliding past: V8, V9, V19, V23 ------------------------------------------------------------


def roll(
    lab, *parts, refine=2, mean=7.5e4, time=0.4, cells=(40, 4, 30), first=(2e-5, 4e-4, 2e-8), depth=2.2e-5, **more
):
    """Road at 0.1 m/s below a source of `mean` W/m2 from which the block takes nothing: line places and rises."""
    mesh = block_on_road.build(L, 7e-3, depth, cells, first[0], first[1], 1e-4, first[2], refine=refine)
    run, _ = lab.slide(
        lab.scene(
            mesh,
            lab.MU,
            *parts,
            **{"rubber": lab.NO_BLOCK, "road": lab.THIN_ROAD} | more,
            pressure=mean / 0.1,
            time=time,
        )
    )
    return run.x, run.T_road[-1], mesh


def test_V8_uniform_flux(lab):
    x, T, _ = roll(lab)
    lab.check("V8 uniform at L/2, K of 20.241636", abs(PchipInterpolator(x, T)(L / 2) - 20.241636), 0.012)
    lab.check("V8 uniform, K of 28.625996", np.abs(T - analytical_solutions.road_rise(ROAD, 0.1, 7.5e4, x)).max(), 0.07)


def test_V8_linear_flux_peaks_in_the_middle(lab):
    x, T, _ = roll(lab, Term("contact.pressure", lambda T, now, p: 1.0 - 2.0 * now.x / L), mean=7.5e4 / 2)
    top = CubicSpline(x, T)
    peak = top.derivative().roots(extrapolate=False)
    lab.check("V8 linear, place of the peak, m of 0.0125", abs(peak[-1] - L / 2), 0.0001)
    lab.check("V8 linear, peak, K of 13.494424", abs(top(peak[-1]) - 13.494424), 0.008)
    lab.check("V8 linear, K", np.abs(T - analytical_solutions.road_rise_linear(ROAD, 0.1, 7.5e4, L, x)).max(), 0.07)


@pytest.mark.long
def test_V8_exponential_flux(lab):
    decay = 5e-3
    mean = 7.5e4 * decay * (1 - np.exp(-L / decay)) / L
    x, T, _ = roll(lab, Factor("contact.pressure", lambda T, now, p: np.exp(-now.x / decay)), mean=mean)
    top = CubicSpline(x, T)
    peak = top.derivative().roots(extrapolate=False)[0]
    lab.check("V8 exponential, place of the peak, m of 4.27016e-3", abs(peak - 4.27016e-3), 2.5e-6)
    lab.check("V8 exponential, peak, K of 6.926413", abs(top(peak) - 6.926413), 0.008)
    lab.check(
        "V8 exponential, K",
        np.abs(T - analytical_solutions.road_rise_exponential(ROAD, 0.1, 7.5e4, decay, x)).max(),
        0.07,
    )


def test_V8_wake_behind_the_block(lab):
    x = np.concatenate([two_sided(L, 2e-5, 2e-4, 60), L + geometric(0.11, 2e-4, 160)[1:]])
    mesh = Mesh(x, geometric(5e-5, 5e-8, 40), geometric(7e-3, 1e-3, 3), 0, 60)
    run, rise = lab.slide(lab.scene(mesh, lab.MU, rubber=lab.NO_BLOCK, road=lab.THIN_ROAD, pressure=7.5e5, time=1.6))
    place, T = mesh.x_centre, rise[mesh.road[:, -1]]
    lab.check("V8 wake 0.1 m behind, K of 6.757681", abs(PchipInterpolator(place, T)(L + 0.1) - 6.757681), 0.012)
    far = place > L + 2e-3
    closed = analytical_solutions.road_wake(ROAD, 0.1, 7.5e4, L, place[far])
    lab.check("V8 wake from 2 mm behind, K", np.abs(T[far] - closed).max(), 0.05)


@pytest.mark.long
def test_V8_isothermal_wall(lab):
    mesh = block_on_road.build(L, 1e-4, 2.2e-5, (40, 4, 30), 2e-6, 4e-4, 2e-5, 5e-9, refine=2)
    copper = Material(1e6, 1200.0, 1700.0)
    wall = Heat.film("block.holder", lambda now, p: inf, far=lambda now, p: KELVIN + 1.0)
    world = lab.scene(mesh, wall, rubber=copper, road=lab.THIN_ROAD, pressure=1.0, time=0.4)
    run, rise = lab.slide(world)
    J = lab.fluxes(world, rise).into_road
    lab.check(
        "V8 wall, mean flux relative to 3335.8827 W/m2K", abs((J * mesh.dx_block).sum() / L / 3335.8827 - 1), 0.0015
    )
    law = ROAD.effusivity * np.sqrt(0.1 / (np.pi * run.x))
    lab.check("V8 wall, local flux from 1 mm on, relative", np.abs(J / law - 1)[run.x > 1e-3].max(), 0.004)


@pytest.mark.parametrize(
    ("peclet", "around", "time", "lines", "bounds"),
    [
        (10.0, 3, 3.0, 12, (1.2e-3, 8e-3, 6e-4, 6e-3)),
        (1.0, 12, 20.0, 12, (2e-3, 6e-3, 2e-3, 4e-3)),
        (0.1, 100, 2000.0, 16, (3e-3, 3e-3, 4e-4, 5e-3)),
    ],
)
@pytest.mark.sample("10.0-3-3.0-12-bounds0", "1.0-12-20.0-12-bounds1")
def test_V9_jaeger_strip(lab, peclet, around, time, lines, bounds):
    b, n, first = L / 2, 48, 1e-4
    reach = geometric(around * b, first, 2 * lines)
    x = np.concatenate([-reach[:0:-1], two_sided(L, first, first, n), L + reach[1:]])
    mesh = Mesh(x, geometric(around * b, first, 48), geometric(7e-3, 1e-3, 3), 2 * lines, 2 * lines + n)
    v = 2 * ROAD.diffusivity * peclet / b
    world = lab.scene(
        mesh, lab.MU, rubber=lab.NO_BLOCK, speed=v, pressure=1e3 / v, time=time * b * b / ROAD.diffusivity
    )
    run, _ = lab.slide(world, rtol=1e-6)
    theta = np.pi * ROAD.conductivity * v * run.T_road[-1] / (2 * ROAD.diffusivity * 1e3)
    X = 1 - run.x / b  # the strip moves towards the road that comes
    top = CubicSpline(run.x, theta)
    roots = top.derivative().roots(extrapolate=False)
    peak = roots[np.argmax(top(roots))]
    lab.check(f"V9 Pe = {peclet:g}, middle", abs(top(b) - analytical_solutions.jaeger_strip(peclet, 0.0)), bounds[0])
    lab.check(
        f"V9 Pe = {peclet:g}, peak",
        abs(top(peak) - analytical_solutions.jaeger_strip(peclet, analytical_solutions.jaeger_strip_peak(peclet))),
        bounds[1],
    )
    lab.check(
        f"V9 Pe = {peclet:g}, place of the peak X",
        abs(1 - peak / b - analytical_solutions.jaeger_strip_peak(peclet)),
        bounds[2],
    )
    lab.check(
        f"V9 Pe = {peclet:g}, profile relative to the peak",
        np.abs(theta - analytical_solutions.jaeger_strip(peclet, X)).max() / theta.max(),
        bounds[3],
    )


@pytest.mark.long
def test_V19_conveyor_converges_on_a_uniform_mesh(lab):
    errors = []
    for refine in (1, 2, 4):
        x, T, mesh = roll(lab, refine=refine, cells=(25, 4, 24), first=(1.0, 1.0, 4e-8))
        error = np.abs(T - analytical_solutions.road_rise(ROAD, 0.1, 7.5e4, x))
        errors.append((error * mesh.dx_block).sum() / L)
    print("V19 mean error, K", errors, lab.orders(errors))
    assert min(lab.orders(errors)) > 0.9
    lab.check("V19 100 uniform lines, mean error, K of 19.083997", errors[-1], 0.012)


def test_V19_order_along_x_for_a_smooth_flux(lab):
    def flux(x):
        return 1.5e5 * np.sin(np.pi * x / L) ** 2

    errors = []
    for refine in (1, 2, 4):
        smooth = Factor("contact.pressure", lambda T, now, p: flux(now.x))
        x, T, _ = roll(lab, smooth, refine=refine, cells=(16, 4, 16), first=(1e-3, 1e-3, 2e-7), depth=3e-5)
        errors.append(
            max(
                abs(t - analytical_solutions.road_rise_by_quadrature(ROAD, 0.1, flux, at))
                for t, at in zip(T, x, strict=True)
            )
        )
    lab.check_second_order("V19 smooth flux along x, K of 31", errors, 0.04)


def test_V23_lanes_widen(lab):
    x, T, _ = roll(lab, (Lanes(), {}), road=ROAD, phi=0.2, mean=1.5e4, depth=2.2e-3, first=(2e-5, 1e-4, 2e-6))
    at_exit = T[-1] / analytical_solutions.road_rise(ROAD, 0.1, 7.5e4, x[-1])
    lab.check(
        "V23 factor at the exit",
        abs(at_exit - analytical_solutions.lane_factor(ROAD.diffusivity, 3e-3, x[-1] / 0.1)),
        0.0009,
    )
    inside = x > 2e-3
    rise = analytical_solutions.road_rise(ROAD, 0.1, 7.5e4, x) * [
        analytical_solutions.lane_factor(ROAD.diffusivity, 3e-3, s / 0.1) for s in x
    ]
    lab.check("V23 profile from 2 mm on, K", np.abs(T - rise)[inside].max(), 0.025)


# --- spots, scaling, energy: V10, V11, V15, V16, V18 ------------------------------------------------


@pytest.mark.parametrize(("speed", "full"), [(0.1, 1.669969), (1.0, 0.528091)])
@pytest.mark.parametrize(("slid", "built"), [(0.1, 0.49625100), (0.3, 0.78405522), (2.0, 1.0)])
def test_V10_V11_gap_between_spot_and_block(lab, speed, full, slid, built):
    world = lab.scene(
        lab.column(12, 7e-3, 1e-5), lab.MU, (Flash(), {}), road=lab.NO_ROAD, phi=0.2, speed=speed,
        pressure=1e4 * 0.2 / speed, time=slid * 3e-3 / speed,
    )  # fmt: skip
    run, _ = lab.slide(world)
    gap = (run.T_spot - run.T_block)[-1] / 0.8
    assert gap == pytest.approx([full * built] * 2, abs=6e-7)


def test_V11_gap_of_a_deep_source(lab):
    world = lab.scene(
        lab.column(12, 7e-3, 1e-5), lab.MU, Deposit(1.0, 5e-5), (Flash(), {}), road=lab.NO_ROAD, phi=0.2,
        pressure=2e4, time=0.06,
    )  # fmt: skip
    run, _ = lab.slide(world)
    gap = (run.T_spot - run.T_block)[-1] / 0.8
    assert gap == pytest.approx([analytical_solutions.spot_flash_deep(RUBBER, 1e4, 5e-5, 3e-3, 0.1)] * 2, rel=1e-7)


@pytest.mark.long
def test_V15_everything_scales_with_the_root_of_speed(lab):
    profiles = {}
    for v in (0.1, 0.5, 1.0):
        s = 1 / analytical_solutions.speed_scaling(v, 0.1)  # depths reached at the same slid distance
        mesh = block_on_road.build(L, s * 7e-6, s * 2.2e-6, (24, 16, 24), 1e-4, 1e-3, s * 1e-8, s * 3e-9)
        world = lab.scene(
            mesh, lab.MU, (Flash(), {}), rubber=lab.FILM_RUBBER, road=lab.FILM_ROAD, speed=v, phi=0.2, time=3.5 / v
        )
        run, _ = lab.slide(world, rtol=1e-9)
        profiles[v] = run.T_spot[-1], run.T_block[-1]
    for v, ratio in ((0.5, 2.236068), (1.0, 3.162278)):
        for name, fast, slow in zip(("T_spot", "T_block"), profiles[v], profiles[0.1], strict=True):
            lab.check(
                f"V15 {name} at {v} m/s over 0.1 m/s, relative to {ratio}", np.abs(fast / slow / ratio - 1).max(), 4e-7
            )


BARE = {"ambient__convection": 0.0, "contact__lane_widening": 0.0}


def test_V15_V16_V18_default_case(lab):
    share = {}
    for v in (0.1, 1.0):
        run = lab.case(schedule__speed=v, contact__flash_factor=0.0, **BARE)
        dx = run.mesh.dx_block
        final = (analytical_solutions.road_rise(ROAD, v, 1.5e5 * v / 0.2, run.x) * dx).sum()
        rise = run.T_block[-1] - 20.0
        share[v] = (rise * dx).sum() / final, run.at_x(rise, L / 2)
        given = 1.5e5 * 3.5 * L
        lab.check(f"V18 {v} m/s, friction heat relative to mu p s L", abs(run.budget["friction"] / given - 1), 1e-12)
        kept = run.budget["block"] + 0.2 * (run.energy["lanes"][-1] + run.energy["lane_out"][-1])
        lab.check(f"V18 {v} m/s, block and road gain, relative", abs(kept / given - 1), 1e-12)
    lab.check(
        "V15 case, rise at L/2, ratio relative to 3.162278", abs(share[1.0][1] / share[0.1][1] / 3.162278 - 1), 0.00018
    )
    guide = analytical_solutions.approach_to_final_temperature(RUBBER, ROAD, L, 0.2, 3.5)
    lab.check("V16 share of the final rise against its guide 0.8995", abs(share[0.1][0] - guide), 0.04)
    lab.check("V16 the share depends on distance alone", abs(share[1.0][0] - share[0.1][0]), 0.001)
