"""Resolved spots: what they cover, what they heat, and how far the averaged model is from them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from flashtemp.__main__ import main
from flashtemp.errors import BadInput
from flashtemp.meshes.grading import geometric
from flashtemp.meshes.mesh import Mesh
from flashtemp.physics.effects.resolved_spots import ResolvedSpots
from flashtemp.physics.friction.spot_patterns import ContactMap, DiscPattern, place_discs, read_contact_map
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.system import PhaseSystem

D, PHI = 3e-3, 0.2


# --- geometry ----------------------------------------------------------------------------------------
@pytest.mark.parametrize(("pattern", "phi"), [("random", 0.05), ("random", 0.3), ("regular", 0.2), ("regular", 0.6)])
def test_discs_cover_their_share_and_do_not_overlap(pattern, phi):
    road = place_discs(pattern, D, phi, 0.02, 0.06, 3)
    repeat, centres = road.repeat, road.centres
    assert len(centres) * np.pi * D**2 / 4 / (repeat * 0.02) == pytest.approx(phi, rel=1e-12)
    apart = np.abs(centres[:, None] - centres[None])
    apart = np.minimum(apart, np.array([repeat, 0.02]) - apart)
    far = np.hypot(apart[..., 0], apart[..., 1])[~np.eye(len(centres), dtype=bool)]
    assert far.min() >= D * (1 - 1e-9)
    area = road.cumulative_cover(np.linspace(-0.01, 0.01, 37), 0.02)
    assert area[:, -1].mean() / repeat == pytest.approx(phi, rel=1e-3)


def test_the_seed_decides():
    first, again, other = (place_discs("random", D, PHI, 0.02, 0.06, seed).centres for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_too_many_discs_are_refused():
    with pytest.raises(BadInput, match="at random"):
        place_discs("random", D, 0.8, 0.02, 0.06, 1)


def even(n, length, height=3e-3, first=1e-5, cells=24, planes=1, width=0.02):
    """Even cells along and across, fine ones above and below the contact; half as many lines of road before it."""
    y, front = width * (np.arange(planes + 1) / planes - 0.5), n // 2 + 1
    x = length / n * (np.arange(front + n + 2) - front)
    return Mesh(x, geometric(2e-3, first, cells), geometric(height, first, cells), front, front + n, y)


def resolved(lab, mesh, phi=PHI, road=None, time=1.0, speed=0.1, **given):
    values = {"pattern": "random", "contact_map": None} | given
    scene = lab.scene(mesh, lab.MU, (ResolvedSpots(), values), road=road or lab.ROAD, phi=phi, time=time, speed=speed)
    return replace(scene, spot_fraction=phi)


def cover_at(scene, slid):
    law = next(
        c.law for a in scene.acting for c in a.contributions(scene) if getattr(c, "target", "") == "contact.cover"
    )
    return law(None, SimpleNamespace(slid=slid, lead=None), None)


def test_cover_moves_with_the_road_without_steps(lab):
    """The covered area changes by what crosses the edges only: no staircase as spots pass from cell to cell."""
    scene = resolved(lab, even(40, 0.02, planes=30), repeat=0.02)
    area = scene.mesh.column_area
    repeat = place_discs("random", D, PHI, scene.width, 0.02, 1).repeat
    whole = np.array([cover_at(scene, s) @ area for s in np.linspace(0.0, repeat, 400, endpoint=False)])
    assert cover_at(scene, 0.0).max() == pytest.approx(1.0, abs=1e-9)
    assert whole.mean() / area.sum() == pytest.approx(PHI, rel=1e-3)
    # what leaves in a step is at most the chord across all planes at both ends
    most = 2 * repeat / 400 * 1.0
    assert np.abs(np.diff(whole)).max() <= most
    moved = cover_at(scene, 5e-4).reshape(40, 30)
    np.testing.assert_allclose(moved[1:], cover_at(scene, 0.0).reshape(40, 30)[:-1], atol=1e-9)  # by one cell
    np.testing.assert_allclose(cover_at(scene, repeat), cover_at(scene, 0.0), atol=1e-9)


def test_a_map_covers_what_its_pixels_do(tmp_path, lab):
    """Rows and cells of any size, the map repeated along and across."""
    rng = np.random.default_rng(5)
    covered = (rng.uniform(size=(50, 30)) < 0.3).astype(float)
    road = ContactMap(covered, (4e-4, 5e-4))
    area = road.cumulative_cover(np.linspace(-0.0075, 0.0075, 31), 0.015)
    np.testing.assert_allclose(np.diff(area, axis=1) / 4e-4, covered.T, atol=1e-12)
    wide = road.cumulative_cover(np.linspace(-0.015, 0.015, 41), 0.03)
    assert wide[:, -1].mean() / road.repeat == pytest.approx(covered.mean(), rel=1e-12)
    np.testing.assert_allclose(wide[:20, -1], wide[20:, -1], rtol=1e-12)
    file = tmp_path / "map.npz"
    np.savez(file, covered=covered, pixel_m=[4e-4, 5e-4])
    scene = resolved(lab, even(40, 0.02, planes=12, cells=8), contact_map=read_contact_map(file, "k"), time=0.02)
    assert cover_at(scene, 0.0) @ scene.mesh.column_area == pytest.approx(covered.mean() * 0.02, rel=0.2)
    lab.slide(scene, rtol=1e-3)


@pytest.mark.parametrize(
    "held", [{}, {"covered": np.ones(3), "pixel_m": [1, 1]}, {"covered": 2 * np.ones((3, 3)), "pixel_m": [1, 1]}]
)
def test_a_file_that_is_no_map_is_refused(tmp_path, held):
    np.savez(tmp_path / "map.npz", **held)
    with pytest.raises(BadInput, match="flashtemp spots"):
        read_contact_map(tmp_path / "map.npz", "resolved_spots.contact_map")


# --- heat --------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("phi", "excess"),
    [
        pytest.param(0.2, 0.17201627, marks=pytest.mark.long),
        pytest.param(0.3, 0.16615538, marks=pytest.mark.long),
        (0.5, 0.12625818),
    ],
)
@pytest.mark.long
def test_V12_stripes_heat_on_and_off(lab, phi, excess):
    """Mean excess in the on-phase over the period mean, in units of q sqrt(P)/e; the road takes no heat."""
    length, speed, time = D / phi, 0.5, 0.5
    mesh = even(round(length / D * 32), length, first=5e-6)
    scene = resolved(lab, mesh, phi, lab.NO_ROAD, time, speed, pattern="stripes")
    run, rise = lab.slide(scene, rtol=1e-4)
    system = PhaseSystem(HeatBalance(scene), scene.schedule.phases[-1])
    now = system.law_context(scene.schedule.end_time)
    state, _, flux, _ = system.interface.solve_contact(now, 0.0, rise, system.incoming_road(now), system.b.ones)
    spot = np.sum(state.phi * flux.spot) / np.sum(state.phi) - scene.ambient
    mean = np.mean(run.T_block[-1]) - run.ambient_degC
    q, period = 1e5 * speed / phi, D / phi / speed
    found = (spot - mean) / (q * np.sqrt(period) / lab.RUBBER.effusivity)
    lab.check(f"V12 stripes, phi = {phi:g}, relative", abs(found / excess - 1), 0.03)


@pytest.mark.parametrize("n", [8, 16])
@pytest.mark.sample("8")
def test_V11_one_disc_on_fresh_rubber(lab, n):
    """Mean over a disc of `n` cells that has moved by two diameters: 0.6885 q sqrt(D/v)/e; the road takes no heat."""
    speed, length, width = 0.1, 0.016, 0.006
    road = DiscPattern(D, 1.0, np.array([[0.005, 0.0]]))
    mesh = even(round(length / D * n), length, height=2e-3, cells=16, planes=round(width / D * n), width=width)
    scene = resolved(lab, mesh, road=lab.NO_ROAD, time=2 * D / speed, speed=speed, contact_map=road)
    run, _ = lab.slide(scene, rtol=1e-3)
    cover, spot = run.maps["cover"][-1], run.maps["T_spot"][-1] - run.ambient_degC
    q = 1e5 * speed * length * width / (np.pi * D**2 / 4)
    exact = 0.6885457813 * q * np.sqrt(D / speed) / lab.RUBBER.effusivity
    lab.check(f"V11 one disc of {n} cells, relative", abs((cover * spot).sum() / cover.sum() / exact - 1), 0.015)


def test_load_is_carried_by_the_spots_that_are_there(lab):
    """Whatever is covered at the moment: heat mu p v of the whole block, at every time."""
    scene = resolved(lab, even(24, 0.02, planes=12, cells=10), time=0.05, repeat=0.03)
    run, _ = lab.slide(scene, rtol=1e-4, profiles=8)
    power = np.diff(run.energy["friction"]) / np.diff(run.time)
    np.testing.assert_allclose(power, 1e5 * 0.1 * 0.02, rtol=1e-9)
    assert np.ptp(run.maps["cover"].mean(axis=(1, 2))) > 0.005  # though the cover changes


@pytest.mark.long
def test_spots_draw_tracks_that_stay(lab):
    """Rubber is warm where spots passed, and cold between; spots are hotter than their tracks."""
    scene = resolved(lab, even(40, 0.02, planes=30, cells=14), time=0.2, pattern="regular", repeat=0.02)
    run, _ = lab.slide(scene, rtol=1e-3)
    face, cover = run.maps["T_block"][-1] - run.ambient_degC, run.maps["cover"][-1]
    lanes = face[-8:].mean(axis=0)
    assert lanes.max() > 3 * max(lanes.min(), 1e-3)
    assert face[cover > 0.9].mean() > 1.3 * face.mean()


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ("contact.spot_fraction=0.7", "at random"),
        ("resolved_spots.pattern=hexagonal", "give random, regular, stripes"),
        ("resolved_spots.contact_map=none.npz", "not a contact map"),
    ],
)
def test_a_case_whose_spots_cannot_be_is_refused_before_it_runs(given, says, capsys):
    case = Path(__file__).parents[2] / "cases" / "resolved_spots"
    assert main(["check", str(case), given]) == 2
    said = capsys.readouterr().err.strip()
    assert says in said
    assert "\n" not in said
