"""Resolved spots on a road that takes heat: its columns keep their heat in the road's own frame.

Held to the closed form of a disc that heats a road alone, and to a program that shares no solver: block and road are
half-spaces whose Green's functions are waves along the interface, and remember every flux of one disc since its start.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import lu_factor, lu_solve
from scipy.special import i0e, i1e

from flashtemp.meshes.grading import geometric
from flashtemp.meshes.mesh import Mesh
from flashtemp.model.numerics import SolverSettings, choose_binding
from flashtemp.physics.effects.resolved_spots import ResolvedSpots
from flashtemp.physics.friction.spot_patterns import DiscPattern
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.integration_state import IntegrationState
from flashtemp.solver.system import PhaseSystem
from flashtemp.solver.time_integration import integrate_schedule, remap_road

D, SPEED, LENGTH, WIDTH, WAY = 3e-3, 0.1, 0.0255, 0.0045, 6  # the disc moves by so many diameters
WAVES = 1.172e-4  # K m2/W, mean rise of the disc between block and road over its heat: waves, 36 pixels, 96 steps


def one_disc(lab, n, rubber=None, first=1e-5, cells=16, place=0.005, **more):
    """A block over one disc of n cells, which begins at `place` (m)."""
    road = DiscPattern(D, 1.0, np.array([[place, 0.0]]))
    lines, planes = round(LENGTH / D * n), round(WIDTH / D * n)
    x, y = LENGTH / lines * np.arange(-(lines // 2) - 1, lines + 2), WIDTH * (np.arange(planes + 1) / planes - 0.5)
    depth = geometric(2e-3, first, cells)
    mesh = Mesh(x, depth, depth, lines // 2 + 1, lines + lines // 2 + 1, y)
    values = {"pattern": "random", "contact_map": road}
    given = {"rubber": rubber or lab.RUBBER, "road": lab.ROAD, "phi": 0.2, "speed": SPEED, "time": WAY * D / SPEED}
    return replace(lab.scene(mesh, lab.MU, (ResolvedSpots(), values), **given | more), spot_fraction=0.2)


def mean_rise(run):
    """Of the spots over the friction heat per area, m2 K/W."""
    cover, spot = run.maps["cover"][-1], run.maps["T_spot"][-1] - run.ambient_degC
    heat = 1e5 * SPEED * LENGTH * WIDTH / (np.pi * D**2 / 4)
    return (cover * spot).sum() / cover.sum() / heat


# --- a road alone ---------------------------------------------------------------------------------
def alone(material, time):
    """Mean rise of a disc that heats a half-space evenly, over its flux: 1D less what has gone sideways."""

    def grows(root):
        X = (D / 2) ** 2 / (2 * material.diffusivity * root**2)
        return 2.0 * (1.0 - i0e(X) - i1e(X)) / np.sqrt(np.pi) / material.effusivity

    return quad(grows, 1e-9, np.sqrt(time), limit=200)[0]


@pytest.mark.parametrize("n", [6, 9, 12])
@pytest.mark.parametrize("place", [0.005, 0.00512])
@pytest.mark.sample("0.00512-6")
def test_a_disc_heats_its_road(lab, n, place):
    """The block takes no heat; the disc lies on cells as it happens to.  Fixed cells were 21, 12.5 and 7.7 % off."""
    run, _ = lab.slide(one_disc(lab, n, lab.NO_BLOCK, first=3e-6, cells=36, place=place), rtol=1e-3)
    error = mean_rise(run) / alone(lab.ROAD, WAY * D / SPEED) - 1
    lab.check(f"disc of {n} cells on its road alone, relative", abs(error), 0.008)


# --- block and road -------------------------------------------------------------------------------
def kernel(material, kx, ky, v, step, dt):
    """Rise over a flux that acted `step` to `step` + 1 times `dt` ago on a surface that has moved on by v since then."""
    nodes, weights = np.polynomial.legendre.leggauss(6)
    a, b = np.sqrt(step * dt), np.sqrt((step + 1) * dt)
    rate = material.diffusivity * (kx**2 + ky**2) - 1j * kx * v
    parts = [w * np.exp(-rate * (0.5 * (a + b) + 0.5 * (b - a) * s) ** 2) for s, w in zip(nodes, weights, strict=True)]
    return (b - a) * sum(parts) / (np.sqrt(np.pi) * material.effusivity)


def one_disc_by_waves(rubber, road, n, steps):
    """Mean rise over the heat of a disc of about n pixels across, of its true area, in perfect contact."""
    c = (np.arange(2 * n) - n + 0.5) / n
    h = D * np.sqrt(np.pi / 4 / np.count_nonzero(c[:, None] ** 2 + c**2 <= 0.25))
    nx, ny = (WAY + 2) * n, round(1.6 * n)
    x, y = (h * (np.arange(k) - k // 2 + 0.5) for k in (nx, ny))
    disc = x[:, None] ** 2 + y**2 <= (n * h / 2) ** 2
    kx, ky = 2 * np.pi * np.fft.fftfreq(nx, h)[:, None], 2 * np.pi * np.fft.fftfreq(ny, h)
    dt = WAY * D / SPEED / steps
    up = [kernel(rubber, kx, ky, SPEED, k, dt) for k in range(steps)]
    down = [kernel(road, kx, ky, 0.0, k, dt) for k in range(steps)]
    own = np.fft.ifft2(up[0] + down[0]).real
    i, j = np.nonzero(disc)
    lu = lu_factor(own[(i[:, None] - i) % nx, (j[:, None] - j) % ny])
    q, into_block = np.fft.fft2(disc), []
    for now in range(steps):
        past = sum((up[now - t] + down[now - t]) * into_block[t] for t in range(now))
        flux = np.zeros((nx, ny))
        flux[disc] = lu_solve(lu, np.fft.ifft2(q * sum(down[: now + 1]) - past).real[disc])
        into_block.append(np.fft.fft2(flux))
    rise = np.fft.ifft2(sum(up[-1 - t] * into_block[t] for t in range(steps))).real
    return rise[disc].mean()


def test_the_program_of_waves_agrees_with_itself_and_with_a_road_alone(lab):
    """Pixels and steps change nothing by more than 0.3 %; where the block takes no heat the closed form stands."""
    coarse, fine = (one_disc_by_waves(lab.RUBBER, lab.ROAD, n, steps) for n, steps in ((16, 36), (24, 48)))
    assert coarse == pytest.approx(fine, rel=5e-3)
    assert fine == pytest.approx(WAVES, rel=2e-3)
    found = one_disc_by_waves(lab.NO_BLOCK, lab.ROAD, 24, 48)
    assert found == pytest.approx(alone(lab.ROAD, WAY * D / SPEED), rel=5e-3)


@pytest.mark.long  # a disc that heats its road alone is its quicker sibling
@pytest.mark.parametrize("n", [6, 9, 12])
def test_a_disc_heats_block_and_road(lab, n):
    """Perfect contact.  On cells of n = 6 and 9 to the diameter the rims that they only hold in part count."""
    run, _ = lab.slide(one_disc(lab, n, first=5e-6, cells=24), rtol=1e-3)
    error = mean_rise(run) / one_disc_by_waves(lab.RUBBER, lab.ROAD, 24, 48) - 1
    lab.check(f"disc of {n} cells, block and road, relative", abs(error), 0.02)


# --- the road's frame -----------------------------------------------------------------------------
@pytest.fixture
def small(lab):
    return one_disc(lab, 3, cells=8)


def test_the_road_as_it_lies_under_the_block_and_back(small):
    """Whole columns move, what is in front is fresh, and what comes back lies in memory as before."""
    b = HeatBalance(small)
    frame, mesh = b.road_frame, small.mesh
    y = np.random.default_rng(1).uniform(size=b.size)
    moved = frame.to_block_frame(y, 3, 7.0)
    road, was = mesh.planes(moved[: b.n])[mesh.road], mesh.planes(y[: b.n])[mesh.road]
    np.testing.assert_array_equal(road[3:], was[:-3])
    assert np.all(road[:3] == 7.0)
    np.testing.assert_array_equal(mesh.planes(moved[: b.n])[mesh.block], mesh.planes(y[: b.n])[mesh.block])
    out = np.empty(b.size)
    front = frame.to_memory_frame(moved, 3, out, y[: b.n])
    np.testing.assert_array_equal(out, y)
    assert np.all(front == 7.0)


@pytest.mark.parametrize("passed", [0.0, 2.3e-3, 4.8e-3, 5.4e-3])
def test_rates_slopes_and_preconditioner_conserve_heat(small, passed):
    """Whatever has passed: what cells gain is what the ledger says, for rates, J v and P^-1 r."""
    b = HeatBalance(small)
    phase, frame = small.schedule.phases[0], b.road_frame
    t = passed / SPEED
    leg = next(n for n, part in frame.split_phase(small.schedule, phase) if part.begin <= t <= part.end)
    system = PhaseSystem(b, phase, leg=leg)
    rng = np.random.default_rng(2)
    y, v = rng.uniform(0, 30, b.size), rng.normal(size=b.size)

    def missing(a):
        held = sum(b.stored_heat(a))
        booked = sum(b.ledger_weight(name) * a[i] for name, i in b.ledger_index.items())
        return held - booked, np.abs(a[: b.n] * np.repeat(b.capacity, small.mesh.n_across)).sum()

    out = np.empty(b.size)
    system.rate(t, y, out)
    at = system.linearise(t, y, 1e-3)
    amount, scale = missing(out)
    assert abs(amount) < 1e-12 * scale
    at.apply_jacobian(v, out)
    amount, scale = missing(out)
    assert abs(amount) < 1e-12 * scale
    at.solve(v, out)
    assert abs(missing(out)[0] - missing(v)[0]) < 1e-12 * (missing(out)[1] + missing(v)[1])


@pytest.mark.parametrize("passed", [2.3e-3, 4.8e-3])
def test_the_jacobian_is_that_of_the_rate(small, passed):
    b = HeatBalance(small)
    system = PhaseSystem(b, small.schedule.phases[0])
    rng = np.random.default_rng(3)
    y, v = rng.uniform(0, 30, b.size), rng.normal(size=b.size)
    y[b.worn] = v[b.worn] = 0.0  # nothing wears
    t, h = passed / SPEED, 1e-30
    moved, out = np.empty(b.size, dtype=complex), np.empty(b.size)
    system.rate(t, y + 1j * h * v, moved)
    system.linearise(t, y, 1e-3).apply_jacobian(v, out)
    np.testing.assert_allclose(out, moved.imag / h, rtol=1e-9, atol=1e-9 * np.abs(out).max())


def test_legs_are_counted_through_repetitions_and_waits(lab):
    """Each leg ends where the road has passed by another `passing` lines; a wait belongs to the leg before it."""
    scene = one_disc(lab, 3, cells=8, time=0.2, wait=1.0)
    frame = HeatBalance(scene).road_frame
    way, before = frame.leg_lines * frame.dx, -1
    for phase in scene.schedule.phases:
        legs = frame.split_phase(scene.schedule, phase)
        assert legs[0][1].begin == phase.begin
        assert legs[-1][1].end == phase.end
        for leg, part in legs:
            assert leg - before in (0, 1)
            if part.sliding:
                for t in (part.begin, part.end):
                    passed = scene.law_context(part, t).passed
                    assert leg * way - 1e-9 <= passed <= (leg + 1) * way + 1e-9
            before = leg


def test_road_that_goes_takes_its_heat_along(small):
    """When the road is put back on the mesh nothing is lost: what goes is booked."""
    b = HeatBalance(small)
    legs = b.road_frame.split_phase(small.schedule, small.schedule.phases[0])
    leg, part = legs[1]
    now = IntegrationState(y=np.random.default_rng(4).uniform(0, 30, b.size), removed_heat=np.zeros(2))
    before, out = b.stored_heat(now.y), now.y[b.ledger_index["lane_out"]]
    remap_road(PhaseSystem(b, part, leg=leg), now)
    after = b.stored_heat(now.y)
    assert after[0] == before[0]
    assert before[1] - after[1] == pytest.approx(now.y[b.ledger_index["lane_out"]] - out, rel=1e-12)
    assert before[1] > after[1]


@pytest.mark.long
def test_an_integration_goes_on_where_it_was_cut_off(lab, small):
    """Cut off in the second leg and gone on: as in one go."""
    settings = SolverSettings(choose_binding(None), 1e-6, profiles=4)
    whole, state = integrate_schedule(small, settings), IntegrationState()

    def enough(now):
        return now.t > 0.6 * small.schedule.end_time

    with pytest.raises(KeyboardInterrupt):
        integrate_schedule(small, settings, state=state, watch=enough)
    rest = integrate_schedule(small, settings, state=state)
    np.testing.assert_array_equal(rest.time, whole.time)
    np.testing.assert_allclose(rest.T_spot[-1], whole.T_spot[-1], atol=2e-3)
    assert rest.energy_imbalance < lab.LEAK


@pytest.mark.long
def test_spots_wait_and_slide_again(lab):
    """Lifted or not, over more legs than one: heat is kept."""
    for lifted in (True, False):
        scene = one_disc(lab, 3, cells=8, time=0.15, wait=0.5, lifted=lifted)
        run = integrate_schedule(scene, SolverSettings(choose_binding(None), 1e-4, profiles=4))
        assert run.energy_imbalance < lab.LEAK
