"""Cells across: 3D against 2D, against closed forms, and against finite volumes of other hands."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import csc_matrix, diags
from scipy.sparse.linalg import splu

from flashtemp.camera.prediction.observation import observe
from flashtemp.camera.prediction.wall_temperature.side_wall_temperature import wall_deficit_length
from flashtemp.camera.recording import Recording
from flashtemp.meshes import block_on_road
from flashtemp.model.case import assemble_case
from flashtemp.model.case_file import KeyLocations
from flashtemp.physics.effect import Factor, Heat
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.system import PhaseSystem
from flashtemp.solver.time_integration import integrate_schedule

W = 0.02
SMALL = {
    "block__width": W, "block__height": 0.004, "numerics__mesh": 0.4, "schedule__distance": 0.15,
    "output__profiles": 8, "output__fields": 3, "numerics__rtol": 1e-6,
}  # fmt: skip
ROLLED = {"effects": ["pressure_profile"], "pressure_profile__across": [[-0.01, 0.5], [0.0, 1.5], [0.01, 0.5]]}


def test_width_without_anything_across_is_2d(lab):
    """Insulated side walls and an even pressure: every plane is the plane of 2D."""
    still = SMALL | {"ambient__convection": 0.0}
    flat, wide = lab.case(**still), lab.case(**still, numerics__across=16, numerics__first_y=1e-3)
    assert wide.mesh.n_across == 6
    rise = flat.T_block[-1].max() - flat.ambient_degC
    for name in ("T_block", "T_spot", "T_road", "T_wake"):
        lab.check(f"3D against 2D, {name}", np.abs(getattr(wide, name) - getattr(flat, name)).max() / rise, 1e-5)
        assert np.ptp(wide.maps[name], axis=2).max() < 1e-5 * rise
    assert wide.friction == pytest.approx(flat.friction, rel=1e-9)


@pytest.mark.parametrize("first", [None, 1.4e-3])
def test_cosine_across_decays_by_conduction_and_order(lab, first):
    """An insulated block at cos(2 pi y/W): exp(-D (2 pi/W)^2 t), with even cells and with fine ones at the walls."""
    errors, time, k = [], 30.0, 2 * np.pi / W
    for refine in (1, 2, 4) if first is None else (4, 8):  # graded cells come later to their order
        sized = block_on_road.build(0.1, 0.1, 0.1, width=W, across=12, first_y=first, refine_y=refine)
        mesh = replace(lab.column(3, 0.004, 1e-3), y=sized.y)
        edges = np.sin(k * mesh.y) / k
        start = np.diff(edges) / np.diff(mesh.y)
        warmed = Heat.zone("block", lambda T, now, p: 1e4 + 0.0 * T)  # the audit needs heat that moves
        _, rise = lab.slide(lab.scene(mesh, lab.APART, warmed, time=time), warm=start)
        block = mesh.planes(rise)[mesh.block] - 1e4 * time / lab.RUBBER.volumetric_capacity
        decay = np.exp(-lab.RUBBER.diffusivity * k * k * time)
        errors.append(np.abs(block - start * decay).max())
    lab.check_second_order("cosine across", errors, 2e-3)


def test_pressure_across_against_the_plane_with_a_sink(lab):
    """One cosine of heat across an insulated block obeys the plane's balance with a sink k (2 pi/W)^2 T: scipy's.

    Everything of the plane is taken from the rates themselves, unit vector by unit vector, so that only what lies
    across is under test: the planes share matrices, sources scale with the cosine.
    """
    n, k, time = 24, 2 * np.pi / W, 1.0
    law = Factor("contact.pressure", lambda T, now, p: 1.0 + 0.4 * np.cos(k * now.y))
    sizes = {"length": 0.01, "height": 2e-3, "depth": 3e-3, "cells": (6, 5, 6), "first_x": 1e-3, "last_x": 1e-3,
             "first_block": 5e-5, "first_road": 5e-5}  # fmt: skip
    flat = lab.scene(block_on_road.build(**sizes), lab.MU, time=time)
    wide = lab.scene(block_on_road.build(**sizes, width=W, across=n), lab.MU, law, time=time)
    _, rise = lab.slide(wide, rtol=1e-8)
    planes = wide.mesh.planes(rise)
    y = wide.mesh.y_centre
    found = planes @ np.cos(k * y) * 2 / n
    # the plane by itself: C dT/dt = A T + b, then with the sink of the discrete cosine
    balance = HeatBalance(flat)
    system, size = PhaseSystem(balance, flat.schedule.phases[0]), balance.n
    system.__dict__[
        "undershoot_floor"
    ] = -np.inf  # unit vectors are no states: at them the bound of advection would act
    at, out = np.zeros(balance.size), np.zeros(balance.size)
    system.rate(0.5, at, out)
    b = out[:size].copy()
    rows = []
    for c in range(size):
        at[:] = 0.0
        at[c] = 1.0
        system.rate(0.5, at, out)
        rows.append(out[:size] - b)
    mesh = flat.mesh
    D = np.where(mesh.level < mesh.n_road, flat.road.diffusivity, flat.block.diffusivity)
    sink = D * (2 - 2 * np.cos(k * W / n)) / (W / n) ** 2
    A = csc_matrix(np.array(rows).T) - diags(sink)
    T, steps = np.zeros(size), 4000
    h = time / steps
    solve = splu((diags(np.ones(size)) - 0.5 * h * A).tocsc()).solve
    for _ in range(steps):
        T = solve(T + 0.5 * h * (A @ T) + h * 0.4 * b)
    cosine = np.sin(k * W / n / 2) / (k * W / n / 2)  # cell means of the cosine
    lab.check("cosine of pressure against a plane with a sink", np.abs(found - T * cosine).max() / T.max(), 2e-4)


COOLED = {
    "numerics.mesh": 0.5, "numerics.above": 10, "ambient.convection": 25.0, "contact.spot_fraction": 0.1,
    "contact.spot_diameter": 1.6e-3, "schedule.speed": 0.06, "schedule.distance": 0.48, "schedule.repetitions": 3,
    "schedule.wait": 7.0,
}  # fmt: skip


def rises(view, times, u, v, **more):
    """What a sharp camera sees in 2D, the same as if no air cooled the walls, and in 3D: rises (frames, v, u) in K."""
    images = []
    for across in ({}, {"numerics.across": 60, "numerics.first_y": 3e-5}):
        made = assemble_case({}, COOLED | across | more, KeyLocations("none"), Path(), "wall")
        run = integrate_schedule(made.scene, replace(made.settings, times=tuple(times)))
        images.append(observe(run, made.scene, seen(view, times, u, v)).temperature - run.ambient_degC)
        if not across:
            bare = replace(made.scene, acting=tuple(a for a in made.scene.acting if a.name != "convection"))
            images.append(observe(run, bare, seen(view, times, u, v)).temperature - run.ambient_degC)
    return images


KINDS = {
    "waits in the air": {}, "waits in contact": {"schedule.lifted": False},
    "air that warms": {"effects": ["ambient_drift"], "ambient_drift.rate": 0.05},
    "films that come and go": {"effects": ["side_cooling"], "side_cooling.gain": 100.0},
    "walls that radiate": {"effects": ["radiation"], "ambient.convection": 15.0},
    "rubber that conducts more where it is warm": {
        "effects": ["conductivity_slope", "conductivity_anisotropy"], "conductivity_slope.block": 0.006,
        "conductivity_anisotropy.excess": 1.0,
    },
}  # fmt: skip


@pytest.mark.sample("waits in the air")
@pytest.mark.parametrize("kind", KINDS)
def test_wall_that_2d_tells_is_the_one_that_3d_resolves(lab, kind):
    """Three repetitions, however the block waits and the air behaves: 25 W/m2K draw 9 % of the rise from the wall."""
    times = np.array([2.0, 7.9, 8.5, 14.9, 15.5, 18.0, 22.9, 29.9, 30.5, 34.0, 37.9])
    x, z = np.linspace(5e-4, 0.0245, 25), np.linspace(3e-4, 6.5e-3, 25)
    guess, without, wall = rises("sidewall", times, x, z, **KINDS[kind])
    rise = wall.max(axis=(1, 2), keepdims=True)
    off, drawn = (np.abs(image - wall) / rise for image in (guess, without))
    assert drawn[-1].max() > 0.05
    lab.check("wall that 2D tells, share of the rise", off.max(), 0.002)
    lab.check("wall that 2D tells, share of its cooling", (off.max(axis=(1, 2)) / drawn.max(axis=(1, 2))).max(), 0.02)


def test_wake_that_2d_tells_is_the_one_that_3d_resolves(lab):
    """The road behind, up to its edges."""
    times, x = np.array([2.0, 7.9, 18.0, 22.9, 34.0, 37.9]), 0.025 + np.array([5e-4, 1e-3, 2e-3, 4e-3, 8e-3])
    guess, without, wake = rises("wake", times, x, np.array([3e-4, 1e-3, 2e-3, 4e-3, 8e-3, 0.024]) - 0.025)
    assert np.abs(without - wake).max() > 0.006 * wake.max()
    lab.check("wake that 2D tells, share of the rise", np.abs(guess - wake).max() / wake.max(), 0.0015)


@pytest.mark.long
def test_camera_sees_the_wall_near_the_contact(lab):
    """Cells of 1 mm across and a strong film, from the wall's cells to the wall: against cells of 20 um there."""
    given = {
        "block.width": W, "block.height": 0.004, "schedule.distance": 1.0, "ambient.convection": 60.0,
        "output.profiles": 4, "output.fields": 2, "numerics.rtol": 1e-5, "numerics.cells": [16, 24, 16],
    }  # fmt: skip
    z, walls = np.arange(1, 21) * 2e-5, []
    for sized in ({"numerics.across": 20}, {"numerics.across": 60, "numerics.first_y": 2e-5}):
        made = assemble_case({}, given | sized, KeyLocations("none"), Path(), "wall")
        scene = made.scene
        run = integrate_schedule(scene, made.settings)
        image = observe(run, scene, seen("sidewall", run.time[-1:], np.array([0.0125]), z)).temperature
        walls.append(image[0, :, 0] - run.ambient_degC)
    near, fine = walls
    half, film = 0.5 * W / 20, 60.0 / lab.RUBBER.conductivity
    straight = near * (1 + film * wall_deficit_length(z, half)) / (1 + film * half)
    off, without = (np.abs(values - fine).mean() / fine[0] for values in (near, straight))
    lab.check("wall near the contact, cells of 1 mm, share of the rise", off, 0.02)
    assert off < 0.5 * without


def test_profiles_are_means_of_maps(lab):
    run = lab.case(**SMALL, **ROLLED, numerics__across=20)
    assert np.ptp(run.maps["T_block"][-1], axis=1).max() > 1.0
    for name in ("T_block", "T_spot", "T_road", "pressure", "worn"):
        np.testing.assert_allclose(
            run.maps[name] @ run.mesh.share, getattr(run, name)[run.frames], rtol=1e-5, atol=1e-4
        )
    load = run.maps["pressure"][-1] @ run.mesh.share @ run.mesh.dx_block / run.mesh.dx_block.sum()
    assert load == pytest.approx(1.5e5, rel=1e-6)


def test_pressure_follows_a_map_of_x_and_y(lab):
    """Bilinear between its nodes, held beyond its edge at y = 5 mm, an edge of cells."""
    rows = [[x, y, 1.0 + 20.0 * x + 80.0 * y] for x in (0.0, 0.025) for y in (-0.01, 0.005)]
    run = lab.case(**SMALL, numerics__across=20, effects=["pressure_profile"], pressure_profile__map=rows)
    shape = 1.0 + 20.0 * run.x[:, None] + 80.0 * np.minimum(run.mesh.y_centre, 0.005)
    expected = 1.5e5 * shape / (shape @ run.mesh.share @ run.mesh.dx_block / run.mesh.dx_block.sum())
    np.testing.assert_allclose(run.maps["pressure"][-1], expected, rtol=1e-5)


def test_symmetric_pressure_gives_a_symmetric_field(lab):
    run = lab.case(**SMALL, **ROLLED, numerics__across=20)
    cells = run.mesh.planes(run.field[-1])
    np.testing.assert_allclose(cells, cells[:, ::-1], atol=2e-4)


def test_roll_moves_heat_to_its_side(lab):
    """1.5 times the mean pressure at one side wall and half of it at the other: so is the rise of the face, about."""
    run = lab.case(**SMALL, numerics__across=20, effects=["pressure_roll"], pressure_roll__a=0.5)
    rise = run.maps["T_block"][-1].mean(axis=0) - run.ambient_degC
    assert rise[-1] / rise[0] == pytest.approx(1.45 / 0.55, rel=0.15)
    assert np.all(np.diff(rise) > 0)


def test_camera_sees_the_wall_and_the_width(lab):
    """A block that leans to y > 0: the camera at y < 0 sees the colder wall, and a wake that rises across."""
    given = SMALL | {"schedule__distance": 0.3, "numerics__behind": 1.1}
    made = assemble_case({}, {k.replace("__", "."): v for k, v in given.items()} | {
        "numerics.across": 20, "effects": ["pressure_roll"], "pressure_roll.a": 0.5}, KeyLocations("none"), Path(), "seen")  # fmt: skip
    scene = made.scene
    run = integrate_schedule(scene, made.settings)
    mesh = run.mesh
    end = np.array([run.time[-1]])
    u, v = (np.arange(10) + 0.5) * 2e-3, (np.arange(12) + 0.5) * 3e-4
    wall = observe(run, scene, seen("sidewall", end, u, v)).temperature[0]
    z = 0.5 * (mesh.height[1:] + mesh.height[:-1])
    cells = mesh.planes(run.field[-1].astype(float))[mesh.block][..., 0]
    expected = np.array([np.interp(v, z, row) for row in np.array([np.interp(u, run.x, c) for c in cells.T]).T]).T
    lab.check("side wall seen in 3D, K", np.abs(wall - expected)[1:-1, 1:-1].max(), 0.4)
    x, y = 0.026 + np.arange(6) * 1e-3, (np.arange(15) - 7) * 1.2e-3
    wake = observe(run, scene, seen("wake", end, x, y)).temperature[0]
    assert np.all(np.diff(wake[1:-1, 2]) > 0)
    low, high = (np.interp(x[2], run.x_wake, run.maps["T_wake"][-1][:, j]) for j in (0, -1))
    assert low < wake[1, 2] < wake[-2, 2] < high


def seen(view, time, u, v):
    """A sharp camera without noise."""
    return Recording(
        view=view, temperature=np.zeros((len(time), len(v), len(u))), time=time, repetition=np.ones(len(time), int),
        u=u, v=v, emissivity=0.95,
    )  # fmt: skip
