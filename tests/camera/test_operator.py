"""What a camera would have seen: pixel averages, radiance, wall and wake, against integrals done by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import erfc
from scipy.stats import norm

from flashtemp.camera.image_placement import ImagePlacement
from flashtemp.camera.prediction import observation
from flashtemp.camera.prediction.camera_model import CameraModel
from flashtemp.camera.prediction.image_registration import align_image
from flashtemp.camera.prediction.observation import observe
from flashtemp.camera.prediction.pixel_sampling import PixelAxis, axis_weights, sample_rotated
from flashtemp.camera.prediction.wall_temperature.contact_conductance import effective_contact_conductance
from flashtemp.camera.prediction.wall_temperature.side_wall_temperature import (
    FaceHistory,
    WallFilmCoefficients,
    corner_step_times,
    side_wall_rise,
)
from flashtemp.camera.radiometry import LONG_WAVE
from flashtemp.camera.recording import Recording
from flashtemp.meshes.mesh import Mesh
from flashtemp.model.case import assemble_case
from flashtemp.model.case_file import KeyLocations
from flashtemp.model.scene import ActiveEffect
from flashtemp.physics.effect import Term, find_effect
from flashtemp.solver.perturbed_run import Perturbation
from flashtemp.solver.sensitivity import run_with_sensitivities
from flashtemp.solver.time_integration import integrate_schedule

L, H, W = 0.025, 0.007, 0.05


def recording(view="sidewall", pitch=5e-4, times=(1.0,), margin=0.0, **told):
    """An empty recording over the whole of a body."""

    def pixels(low, high):
        return np.arange(low - margin + 0.5 * pitch, high + margin, pitch)

    u = pixels(L, L + 8e-3) if view == "wake" else pixels(0.0, L)
    v = {"wake": pixels(-0.5 * W, 0.5 * W), "profile": np.zeros(1)}.get(view, pixels(0.0, H))
    n = len(times)
    empty = np.full((n, len(v), len(u)), 20.0)
    return Recording(view, empty, np.array(times), np.ones(n, dtype=int), u, v, **told)


def acting(name, **p):
    return ActiveEffect(name, find_effect(name)(), SimpleNamespace(**p))


STANDING = {"ambient_degC": 20.0, "sliding": np.array([False]), "energy": {"into_road": np.zeros(1)}}  # of a run


@pytest.fixture(scope="module")
def slid(lab):
    """A short slide with its scene, fields kept at 1 s."""
    case = lab.assemble_case(
        {}, {"schedule.distance": 0.1, "ambient.convection": 0.0}, lab.KeyLocations("none"), lab.Path(), "x"
    )
    scene = case.scene
    return scene, integrate_schedule(scene, replace(case.settings, times=(0.5, 1.0)))


# --- pixels -----------------------------------------------------------------------------------------
@pytest.mark.parametrize("sigma", [0.0, 2e-4, 1e-3])
def test_weights_are_the_integrals_of_pixel_and_point_spread(sigma):
    rng = np.random.default_rng(1)
    nodes = np.sort(rng.uniform(0, L, 14))
    values, pitch, centres = rng.normal(size=14), 6e-4, np.array([-1e-3, 2e-3, 0.011, 0.0249])

    def kernel(x):
        if sigma == 0:
            return float(abs(x) < 0.5 * pitch) / pitch
        return (norm.cdf((x + 0.5 * pitch) / sigma) - norm.cdf((x - 0.5 * pitch) / sigma)) / pitch

    for centre, got in zip(centres, axis_weights(PixelAxis(centres, pitch, sigma), nodes)[0] @ values, strict=True):
        cuts = [*nodes, *(c for c in (centre - 0.5 * pitch, centre + 0.5 * pitch) if nodes[0] < c < nodes[-1])]
        cuts = sorted(cuts)
        parts = [
            quad(lambda x, c=centre: np.interp(x, nodes, values) * kernel(c - x), a, b, epsabs=1e-13, limit=200)[0]
            for a, b in zip(cuts[:-1], cuts[1:], strict=True)
        ]
        assert got == pytest.approx(sum(parts), abs=1e-9)


def test_weights_of_pixels_inside_sum_to_one_and_keep_a_slope():
    nodes = np.sort(np.random.default_rng(2).uniform(0, L, 20))
    centres = np.linspace(nodes[0] + 3e-3, nodes[-1] - 3e-3, 9)
    for sigma in (0.0, 3e-4):
        [seen] = axis_weights(PixelAxis(centres, 5e-4, sigma), nodes)
        np.testing.assert_allclose(seen.sum(axis=1), 1.0, atol=1e-12)
        np.testing.assert_allclose(seen @ nodes, centres, atol=1e-12)


@pytest.mark.parametrize("sigma", [0.0, 3e-4])
@pytest.mark.parametrize("quantity", ["centre", "size"])
def test_weights_bring_their_slopes_along(quantity, sigma):
    nodes, at = np.linspace(0, L, 11), np.array([3.3e-3, 0.012])

    def moved(h, slopes=False):
        shift, grown = (h, 1.0) if quantity == "centre" else (0.0, 1.0 + h)
        return axis_weights(PixelAxis(at + shift, 5e-4 * grown, sigma * grown), nodes, slopes)

    h = {"centre": 1e-8, "size": 1e-5}[quantity]
    slope = moved(0.0, True)[{"centre": 1, "size": 2}[quantity]]
    np.testing.assert_allclose(slope, (moved(h)[0] - moved(-h)[0]) / (2 * h), atol=1e-6 * np.abs(slope).max() + 1e-8)


def test_error_against_an_analytic_field_falls_with_the_square_of_the_cells(slid):
    """A smooth field on the cells of ever finer meshes, seen by pixels smaller and larger than the cells."""
    scene, run = slid
    for pitch in (2.5e-4, 2e-3):
        told = recording(pitch=pitch, times=(0.0,), emissivity=1.0)
        errors = []
        for n in (12, 24, 48):
            mesh = Mesh(np.linspace(0, L, n + 1), np.linspace(0, 1e-3, 3), np.linspace(0, H, n + 1), 0, n)

            def T(x, z):
                return 40.0 + 20.0 * np.sin(2 * np.pi * x / L) * np.exp(-z / 3e-3)

            field = np.zeros((1, mesh.n_cells))
            field[0, mesh.block] = T(mesh.x_block[:, None], 0.5 * (mesh.height[1:] + mesh.height[:-1]))
            flat = SimpleNamespace(
                mesh=mesh, x=mesh.x_block, time=np.array([0.0]), frames=np.array([0]), field=field,
                T_block=T(mesh.x_block, 0.0)[None], **STANDING,
            )  # fmt: skip
            seen = observe(flat, scene, told)
            fine = ((np.arange(60) + 0.5) / 60 - 0.5) * pitch
            exact = LONG_WAVE.temperature(LONG_WAVE.counts(_grid(T, told, fine)).mean(axis=(2, 3)))
            errors.append(np.abs(seen.temperature[0] - exact)[seen.inside].max())
        assert errors[0] / errors[1] > 3.3, pitch
        assert errors[1] / errors[2] > 3.3, pitch
        assert errors[2] < 0.06


def _grid(T, told, fine):
    """T at a fine grid of points in every pixel (nv, nu, points, points)."""
    x = (told.u[:, None] + fine)[None, :, None, :]
    z = (told.v[:, None] + fine)[:, None, :, None]
    return T(x, z)


# --- radiance ---------------------------------------------------------------------------------------
def test_cells_that_are_left_of_a_coarse_block_do(slid):
    """Fewer than three cells a direction: the ends follow a line, or the one value there is."""
    scene, _ = slid
    told = recording(pitch=1e-3, times=(0.0,), emissivity=1.0)
    for n, m in ((3, 2), (2, 1), (1, 1)):
        mesh = Mesh(np.linspace(0, L, n + 1), np.linspace(0, 1e-3, 3), np.linspace(0, H, m + 1), 0, n)
        field = np.full((1, mesh.n_cells), 40.0)
        flat = SimpleNamespace(mesh=mesh, x=mesh.x_block, time=np.array([0.0]), frames=np.array([0]), field=field,
                               T_block=np.full((1, n), 40.0), **STANDING)  # fmt: skip
        seen = observe(flat, scene, told)
        assert np.ptp(seen.temperature[:, seen.inside][0]) < 1.0, (n, m)  # but for the wall's own cooling


def test_pixels_average_radiance_not_kelvin():
    """Half of the pixel at 50, half at 150 degC reads 106 degC, not 100."""
    mean = LONG_WAVE.temperature(0.5 * (LONG_WAVE.counts(50.0) + LONG_WAVE.counts(150.0)))
    assert mean == pytest.approx(106.3, abs=0.3)


@pytest.mark.parametrize(("T", "off"), [(40.0, 0.39), (80.0, 1.05), (120.0, 1.63)])
def test_an_emissivity_set_too_low_reads_too_hot(T, off):
    """0.93 told where 0.95 is true, 20 degC reflected: figures of a FLIR E60."""
    S = 0.95 * LONG_WAVE.counts(T) + 0.05 * LONG_WAVE.counts(20.0)
    assert LONG_WAVE.temperature((S - 0.07 * LONG_WAVE.counts(20.0)) / 0.93) - T == pytest.approx(off, rel=0.04)


def test_a_camera_that_is_told_the_truth_reports_it(slid):
    scene, run = slid
    black, grey = (observe(run, scene, recording(emissivity=e, reflected_degC=35.0)) for e in (1.0, 0.9))
    np.testing.assert_allclose(black.temperature, grey.temperature, atol=1e-9)


# --- instrument effects -----------------------------------------------------------------------------
OFF = {
    "emissivity": {"change": 0.0}, "reflection": {"excess": 0.0}, "blur": {"sigma": 0.0}, "time_lag": {"lag": 0.0},
    "registration": {"du": 0.0, "dv": 0.0}, "camera_offset": {"offset": 0.0, "drift": 0.0},
}  # fmt: skip
ON = {
    "emissivity": {"change": -0.05}, "reflection": {"excess": 20.0}, "blur": {"sigma": 1.0}, "time_lag": {"lag": 0.5},
    "registration": {"du": 0.3, "dv": -0.2}, "camera_offset": {"offset": 0.1, "drift": 0.0},
}  # fmt: skip


@pytest.mark.parametrize("name", OFF)
def test_instrument_effects_are_off_bit_for_bit_and_act_otherwise(slid, name):
    scene, run = slid
    told = recording(emissivity=0.95, psf_sigma_px=0.5)
    base = observe(run, scene, told).temperature
    np.testing.assert_array_equal(observe(run, scene, told, (acting(name, **OFF[name]),)).temperature, base)
    changed = observe(run, scene, told, (acting(name, **ON[name]),)).temperature
    assert np.abs(changed - base).max() > 0.05


def test_a_shift_shows_what_lies_one_pixel_on(slid):
    scene, run = slid
    told = recording(pitch=5e-4, emissivity=0.95)
    base = observe(run, scene, told).temperature
    moved = observe(run, scene, told, (acting("registration", du=1.0, dv=0.0),)).temperature
    np.testing.assert_allclose(moved[:, :, 3:-4], base[:, :, 4:-3], atol=1e-10)


def test_a_lag_and_an_exposure_show_an_earlier_time(slid):
    scene, run = slid
    told = recording(times=(1.0,))
    assert CameraModel(told, (acting("time_lag", lag=0.5),)).observed_times() == pytest.approx([0.5])
    late = observe(run, scene, told, (acting("time_lag", lag=0.5),)).temperature
    np.testing.assert_allclose(late, observe(run, scene, recording(times=(0.5,))).temperature, atol=1e-12)
    assert CameraModel(replace(told, exposure_s=0.2)).observed_times() == pytest.approx([0.9])


@pytest.mark.parametrize("view", ["sidewall", "profile", "wake"])
@pytest.mark.parametrize("place", [ImagePlacement(), ImagePlacement(0.01, 0.03)], ids=["as told", "turned"])
@pytest.mark.parametrize("name", ["shift_u", "shift_v", "scale", "turn", "gain", "spread"])
@pytest.mark.parametrize("psf", [0.2, 0.7])
def test_slopes_are_those_of_images_that_lie_otherwise(slid, view, place, name, psf):
    """All by differences of images, with an effect that blurs and one that shifts."""
    scene, run = slid
    told = recording(view, emissivity=0.95, psf_sigma_px=psf, times=(0.3, 1.0))
    seeing = acting("blur", sigma=0.1), acting("registration", du=0.3, dv=-0.2)

    def image(h):
        wider = replace(told, psf_sigma_px=psf * (1.0 + h * (name == "spread")))
        shift, change = (h * (name == "shift_u"), h * (name == "shift_v")), h * (name == "gain")
        there = replace(place, scale=place.scale + h * (name == "scale"), turn=place.turn + h * (name == "turn"))
        return observe(run, scene, wider, seeing, shift, change, there).temperature

    slope = observe(run, scene, told, seeing, place=place, slopes=True).slopes[name]
    h = {"shift_u": 1e-3, "shift_v": 1e-3, "scale": 1e-4, "turn": 1e-4, "gain": 1e-5, "spread": 1e-4}[name]
    wanted = (image(h) - image(-h)) / (2 * h)
    near = np.broadcast_to(observe(run, scene, told, seeing).inside, wanted.shape)
    rough = {0.2: 1e-2, 0.7: 3e-3}[psf] if name == "turn" else 1e-4  # two shears leave a little of the pixels
    np.testing.assert_allclose(slope[near], wanted[near], atol=rough * np.abs(wanted).max() + 1e-6)


def test_oblong_pixels_turn_with_their_image():
    """A hill that is a Gaussian, seen through another one that is three times as long along v: in closed form."""
    u, v = (PixelAxis(np.arange(0.005, 0.02, 2.5e-4), 2.5e-5, sigma) for sigma in (2e-4, 6e-4))
    nodes = np.linspace(0.0, 0.025, 801)
    hill = np.exp(-0.5 * ((nodes[None] - 0.0125) ** 2 + (nodes[:, None] - 0.0125) ** 2) / 8e-4**2)[None]
    for turn, rough in ((0.009, 3e-4), (0.09, 3e-3)):
        seen = sample_rotated(hill, (nodes, nodes), (u, v), turn, (0.0125, 0.0)).seen[0]
        c, s, wide = np.cos(turn), np.sin(turn), 8e-4**2
        x, y = u.centres[None] - 0.0125, v.centres[:, None]  # turned about v = 0
        place = np.stack([c * x - s * y, s * x + c * y - 0.0125])
        R = np.array([[c, -s], [s, c]])
        C = wide * np.eye(2) + R @ np.diag([u.variance, v.variance]) @ R.T
        far = np.einsum("i...,ij,j...->...", place, np.linalg.inv(C), place)
        np.testing.assert_allclose(seen, wide / np.sqrt(np.linalg.det(C)) * np.exp(-0.5 * far), atol=rough)


def test_a_blur_that_follows_the_optics_spreads_with_them(slid):
    """A law may see the recording: what the optics blur more, it does too."""
    scene, run = slid
    told = recording(emissivity=0.95, psf_sigma_px=0.7)
    law = Term("camera.blur", lambda T, now, p: p.sigma * now.recording.psf_sigma_px)
    seeing = (SimpleNamespace(effect=SimpleNamespace(see=lambda p: [law]), p=SimpleNamespace(sigma=1.0)),)
    slope = observe(run, scene, told, seeing, slopes=True).slopes["spread"]
    plain = observe(run, scene, replace(told, psf_sigma_px=1.4), slopes=True).slopes["spread"]
    np.testing.assert_allclose(slope, plain, rtol=1e-6, atol=1e-9)


def test_points_lie_where_they_were_put():
    """No image, nothing to align, whatever a file says of its registration."""
    points, plain = SimpleNamespace(u=np.zeros(2), v=np.zeros(1), view="points", places=object()), object()
    found = align_image(None, SimpleNamespace(acting=()), points, plain, None, 0.5)
    assert found.shift == (0.0, 0.0)
    assert found.seen is plain


@pytest.mark.parametrize("view", ["sidewall", "profile", "wake"])
def test_many_frames_are_seen_a_few_at_a_time_and_alike(slid, monkeypatch, view):
    scene, run = slid
    told = recording(view, times=(0.0, 0.13, 0.2, 0.5, 0.77, 0.9, 1.0))
    whole = observe(run, scene, told)
    monkeypatch.setattr(observation, "BATCH", 2)
    parts = observe(run, scene, told)
    np.testing.assert_allclose(parts.temperature, whole.temperature, rtol=0.0, atol=1e-11)
    np.testing.assert_array_equal(parts.inside, whole.inside)


# --- wake and profile -------------------------------------------------------------------------------
def test_the_wake_holds_the_heat_of_lanes_and_gaps(lab):
    """Averaged across y the wake carries phi times the rise of a lane that keeps its width."""
    given = {"schedule.distance": 0.5, "contact.lane_widening": 0.0}
    case = lab.assemble_case({}, given, lab.KeyLocations("none"), lab.Path(), "x")
    scene = case.scene
    run = integrate_schedule(scene, case.settings)
    k, mesh = len(run.frames) - 1, run.mesh
    lanes = run.field[k][mesh.road[mesh.last :, -1]] - run.ambient_degC
    np.testing.assert_allclose(run.T_wake[run.frames[k]] - run.ambient_degC, 0.2 * lanes, rtol=1e-4, atol=1e-4)
    told = recording("wake", pitch=5e-4, times=(run.time[-1],), margin=3e-3)
    rise = observe(run, scene, told).temperature[0] - run.ambient_degC
    across = rise.sum(axis=0)[10:-10] * 5e-4 / W
    np.testing.assert_allclose(across, np.interp(told.u[10:-10], run.x_wake, run.T_wake[-1]) - 20.0, rtol=0.03)


def test_a_profile_is_the_block_surface_averaged_over_pixels(slid):
    scene, run = slid
    told = recording("profile", pitch=1e-3)
    seen = observe(run, scene, told)
    k = int(np.argmin(np.abs(run.time - 1.0)))
    fine = np.interp(told.u[:, None] + np.linspace(-5e-4, 5e-4, 201), run.x, run.T_block[k]).mean(axis=1)
    np.testing.assert_allclose(seen.temperature[0, 0], fine, atol=0.01)


@pytest.mark.parametrize("name", ["emissivity", "camera_offset", "blur", "registration"])
def test_a_profile_passes_through_the_camera_too(slid, name):
    scene, run = slid
    told = recording("profile", pitch=1e-3, emissivity=0.95, psf_sigma_px=0.5)
    base = observe(run, scene, told).temperature
    np.testing.assert_array_equal(observe(run, scene, told, (acting(name, **OFF[name]),)).temperature, base)
    assert np.abs(observe(run, scene, told, (acting(name, **ON[name]),)).temperature - base).max() > 0.05


def test_rims_are_left_out(slid):
    scene, run = slid
    inside = observe(run, scene, recording(pitch=5e-4, margin=2e-3)).inside
    u = recording(pitch=5e-4, margin=2e-3).u
    assert not inside[:, u < 7.4e-4].any()
    assert inside[:, (u > 7.6e-4) & (u < L - 7.6e-4)].any()
    assert not inside[0].any()


@pytest.mark.parametrize("spread", [0.0, 0.7])
def test_where_the_sides_of_a_wake_may_show_is_left_out(slid, spread):
    """A block 1 % narrower than told changes no pixel that is compared: the tails of its sides lie outside."""
    scene, run = slid
    told = recording("wake", pitch=2.5e-4, psf_sigma_px=spread)
    seen = observe(run, scene, told, ruler=(L, W))
    assert seen.inside.any()
    narrower = replace(scene, mesh=replace(scene.mesh, y=0.99 * scene.mesh.y))
    moved = observe(run, narrower, told, ruler=(L, W))
    assert np.array_equal(moved.inside, seen.inside)
    change = np.abs(moved.temperature - seen.temperature)
    assert change[:, seen.inside].max() < 1e-3 * np.ptp(seen.temperature)
    assert change.max() > 0.02 * np.ptp(seen.temperature)


# --- the wall in 2D ---------------------------------------------------------------------------------
STILL = np.array([0.0, 1e6]), np.zeros(2)  # air that does not warm


@pytest.mark.parametrize(("film", "time"), [(10.0, 5.0), (10.0, 35.0), (20.0, 440.0)])
def test_wall_against_the_corner_problem(lab, film, time):
    """Section (y, z) with a hot face, an insulated back and a film on the wall, by finite volumes."""
    z, wall, middle = corner((film, time))
    found = wall_of(lab, z, middle, [(0.0, film)], time)
    off = np.abs(wall - found)[z > 2e-4].max() / (middle - wall).max()
    lab.check(f"wall cooler than the section, h = {film:g}, {time:g} s, over its cooling", off, 0.01)


def wall_of(lab, z, section, films, time, face=None):
    """The camera's wall (z,) in front of a section whose face has been at 1 since t = 0, or as given; it is held."""
    scene = lab.scene(replace(lab.column(8, H, 1e-4), y=np.array([-W / 2, W / 2])))
    times, rise = face or (np.array([0.0, 1e-9, time]), np.array([0.0, 1.0, 1.0]))
    begun, values = map(np.array, zip(*films, strict=True))
    films = WallFilmCoefficients(begun, values, 0.0 * values, STILL)
    return side_wall_rise(scene, films, z, np.array([time]), section[None, None], along(times, rise, 1e6, films))[0, 0]


def along(times, rise, held, films):
    """A block's face, alike in both columns of `lab.column`, held by as much (W/m2K) all the time or in each step."""
    two = np.ones(2)
    none = np.zeros((len(times), 2))
    conductance = np.outer(np.broadcast_to(held, len(times) - 1), two)
    return FaceHistory(
        np.outer(rise, two), times, conductance, none, none, corner_step_times(times, conductance, films)
    )


def test_the_wall_in_air_that_warms_changes_by_as_much_beside_a_run_as_in_a_run_of_its_own():
    """Other time steps of the corner model made the wall's derivative two to three times as large as it is."""
    given = {"schedule.repetitions": 2, "schedule.distance": 0.4, "schedule.wait": 4.0, "numerics.mesh": 0.5}

    def drifting(rate):
        return assemble_case(
            {}, given | {"effects": ["ambient_drift"], "ambient_drift.rate": rate}, KeyLocations("none"), Path(), "air"
        )

    plain = assemble_case({}, given, KeyLocations("none"), Path(), "air")
    told, (step, rate) = recording(times=(4.0, 8.0, 12.0)), (5e-5, 2e-2)
    settings = replace(plain.settings, times=tuple(told.time), fields=2)
    hood = run_with_sensitivities(
        plain.scene, settings, {"drift": Perturbation(drifting(step).scene, step)}, "", tuple(told.time)
    )
    face = FaceHistory.from_run(hood.run, plain.scene)
    scenes, runs = (plain.scene, drifting(step).scene), (hood.reference, hood.perturbed["drift"])
    level, moved = (
        observe(run, scene, told, face=face.for_perturbed_run(run, hood.reference, scene))
        for run, scene in zip(runs, scenes, strict=True)
    )
    found = (moved.temperature - level.temperature)[:, level.inside] / step
    still, warm = (
        observe(integrate_schedule(one.scene, replace(one.settings, times=tuple(told.time), fields=2)), one.scene, told)
        for one in (drifting(0.0), drifting(rate))
    )
    expected = (warm.temperature - still.temperature)[:, still.inside] / rate
    assert np.sqrt(np.mean((found - expected) ** 2)) < 0.1 * np.sqrt(np.mean(expected**2))


@pytest.mark.parametrize("tilted", [False, True])
def test_the_contact_holds_the_face_as_firmly_as_a_run_finds(tilted):
    """J = q - H T: while a block warms in its second repetition, what it takes falls by H for every kelvin of its face."""
    given = {"schedule.repetitions": 2, "schedule.distance": 2.0, "schedule.wait": 8.0, "numerics.mesh": 0.5,
             "output.profiles": 40, "ambient.convection": 0.0}  # fmt: skip
    if tilted:
        given |= {"effects": ["pressure_tilt"], "pressure_tilt.a": 0.5}
    made = assemble_case({}, given, KeyLocations("none"), Path(), "hold")
    run = integrate_schedule(made.scene, made.settings)
    rise, size = run.T_block.astype(float) - run.ambient_degC, run.mesh.dx_block / run.mesh.dx_block.sum()
    hold = effective_contact_conductance(made.scene, run.time, rise, run.pressure, run.worn)
    mid = 0.5 * (run.time[1:] + run.time[:-1])
    warming = (run.repetition[1:] == 2) & run.sliding[1:] & (mid > 29.0)
    taken = np.diff(run.energy["block"]) / np.diff(run.time) / made.scene.length
    mean = 0.5 * (rise[1:] + rise[:-1])
    slope = np.polyfit((mean @ size)[warming], taken[warming], 1)[0]
    told = ((hold * mean) @ size / (mean @ size))[warming].mean()
    assert -slope == pytest.approx(told, rel=0.05)
    waiting = (run.repetition[1:] == 1) & ~run.sliding[1:]
    assert not hold[waiting].any()


def test_a_film_that_the_section_feels_cools_the_wall_below_it(lab):
    """An even block, insulated at its face, that stands in the air: its wall cools as a plate's does, Bi = h W/2k, and
    so does its mean, which the section is but for a part in ten (it cools as if the wall were as warm)."""
    scene = lab.scene(replace(lab.column(8, H, 1e-4), y=np.array([-W / 2, W / 2])))
    z, film, k = np.array([5e-4, 3e-3]), 10.0, scene.block.conductivity
    begin, time = 600.0, 1800.0
    rate = 2.0 * film * scene.block.diffusivity / (k * W)
    t = np.concatenate([[0.0], begin + np.linspace(1e-3, time, 400)])
    even = np.exp(-rate * (t - begin)) * (t > 0)
    still = WallFilmCoefficients(np.array([0.0, begin]), np.array([0.0, film]), np.array([0.0, film]), STILL)
    face = along(t, even, np.where(t[1:] < begin + 1e-2, 1e6, 0.0), still)
    found = side_wall_rise(scene, still, z, t[-1:], np.full((1, 1, 2), even[-1]), face)[0, 0]
    angle = brentq(lambda a: a * np.tan(a) - film * 0.5 * W / k, 0.1, 1.5)
    size = 4.0 * np.sin(angle) / (2.0 * angle + np.sin(2.0 * angle))
    exact = size * np.cos(angle) * np.exp(-((angle / (0.5 * W)) ** 2) * scene.block.diffusivity * time)
    lab.check("wall of a block that stands in the air, over Heisler's", np.abs(found / exact - 1.0).max(), 0.02)


def test_the_wall_of_a_face_that_warms_slowly(lab):
    """A flux from the face since t = 0, so that nothing is even, neither along z nor in time: half-space, closed form."""
    D, film, time = 0.25 / (1200 * 1700.0), 1.0, 20.0
    z, t = np.linspace(1e-4, 5e-3, 40), np.linspace(0.0, 1.0, 400) ** 2 * time
    depth = 2.0 * np.sqrt(D * t[1:])

    def warm(z, t):  # a flux of 1 K k/m
        d = 2.0 * np.sqrt(D * t)
        return d * (np.exp(-((z / d) ** 2)) / np.sqrt(np.pi) - z / d * erfc(z / d))

    scene = lab.scene(replace(lab.column(8, 0.05, 1e-4), y=np.array([-0.5, 0.5])))
    films = WallFilmCoefficients(np.zeros(1), np.array([film]), np.zeros(1), STILL)
    face = along(t, np.append(0.0, depth / np.sqrt(np.pi)), 1e6, films)
    found = side_wall_rise(scene, films, z, t[-1:], warm(z, time)[None, None], face)[0, 0]
    ages, weights = np.polynomial.legendre.leggauss(60)
    root = 0.5 * np.sqrt(time) * (ages + 1.0)  # of the age of what was drawn
    source, share = np.polynomial.legendre.leggauss(400)
    at = 0.5 * 0.02 * (source + 1.0)
    drawn = np.zeros(len(z))
    for s, w in zip(root**2, weights, strict=True):
        spread = np.exp(-((z[:, None] - at) ** 2) / (4 * D * s)) - np.exp(-((z[:, None] + at) ** 2) / (4 * D * s))
        left = spread @ (0.5 * 0.02 * share * warm(at, max(time - s, 1e-12))) / np.sqrt(4 * np.pi * D * s)
        drawn += w * np.sqrt(time) * film / 0.25 * np.sqrt(D / np.pi) * left
    seen = warm(z, time) > 0.05 * warm(0.0, time)
    off = np.abs(warm(z, time) - found - drawn)[seen] / drawn[seen].max()
    lab.check("wall of a face that warms slowly, share of its cooling", off.max(), 0.02)


@pytest.mark.parametrize("after", [3.0, 8.0, 20.0, 35.0])
def test_the_wall_remembers_ten_repetitions(lab, after):
    """35 s hot and 10 s held at the air's, nine times, then hot again: the older the swings, the closer they are."""
    film, hot, cold = 20.0, 35.0, 10.0
    z, wall, middle = corner(*[(film, hot), (film, cold, 0.0)] * 9, (film, after), steps=60)
    begins = (hot + cold) * np.arange(10)
    times = np.sort(np.concatenate([begins, begins + 1e-6, begins[1:] - cold, begins[1:] - cold + 1e-6, [500.0]]))
    rise = np.where((times % (hot + cold) > 5e-7) & (times % (hot + cold) < hot + 5e-7), 1.0, 0.0)
    found = wall_of(lab, z, middle, [(0.0, film)], begins[-1] + after, (times, rise))
    depth = (z > 2e-4) & (z < 6e-3)
    off = np.abs(found - wall)[depth].max() / (middle - wall)[depth].max()
    lab.check(f"wall of ten repetitions, {after:g} s into the last, over its cooling", off, 0.01)


@pytest.mark.parametrize("after", [0.3, 8.0])
def test_the_wall_remembers_the_film_that_it_had(lab, after):
    """30 W/m2K for 20 s, then 2: the wall warms up again as heat reaches it, not at once."""
    before = corner((30.0, 20.0))
    z, wall, middle = corner((30.0, 20.0), (2.0, after))
    at = 20.0 + after
    depth = (z > 2e-4) & (z < 6e-3)
    largest = (1 - before[1] / before[2])[depth].max()

    def off(*films):
        return np.abs(wall_of(lab, z, middle, films, at) / middle - wall / middle)[depth].max() / largest

    lab.check(f"wall {after:g} s after the film fell, over its cooling before", off((0.0, 30.0), (20.0, 2.0)), 0.04)
    assert off((0.0, 2.0)) > 0.35  # the film of the moment alone


def corner(*stages, n=44, steps=120):
    """Heights z, rise of the wall and in the middle (n,) after stages (film, time, rise of the face if not 1)."""
    from scipy.sparse import csc_matrix, diags
    from scipy.sparse.linalg import splu

    k, rc = 0.25, 1200 * 1700.0
    y, z = (np.concatenate([[0.0], np.geomspace(a, b, n)]) for a, b in ((8e-5, W / 2), (5e-5, H)))
    dy, dz = np.diff(y), np.diff(z)
    entries, source = [], np.zeros((n, n))
    index = np.arange(n * n).reshape(n, n)
    for a, b, g in (
        (index[:-1], index[1:], k * dz[None] / (0.5 * (dy[1:] + dy[:-1]))[:, None]),
        (index[:, :-1], index[:, 1:], k * dy[:, None] / (0.5 * (dz[1:] + dz[:-1]))[None]),
    ):
        for i, j in ((a, b), (b, a)):
            entries += [(i.ravel(), j.ravel(), g.ravel()), (i.ravel(), i.ravel(), -g.ravel())]
    source[:, 0] = dy / (dz[0] / (2 * k))
    rows, cols, values = (np.concatenate(part) for part in zip(*entries, strict=True))
    T, C = np.zeros(n * n), rc * np.outer(dy, dz).ravel()
    for film, time, *face in stages:
        sink, dt = source.copy(), time / steps
        sink[0] += dz / (dy[0] / (2 * k) + 1 / film)
        A = csc_matrix((values, (rows, cols)), (n * n, n * n)) - diags(sink.ravel(), format="csc")
        solve = splu((diags(C / dt) - A).tocsc()).solve
        for _ in range(steps):
            T = solve(C / dt * T + source.ravel() * (face[0] if face else 1.0))
    T = T.reshape(n, n)
    inner = dy[0] / (2 * k)
    return 0.5 * (z[1:] + z[:-1]), T[0] / (1 + inner * film), T[-1]


# --- odd cases ------------------------------------------------------------------------------------
ODD = {
    "a narrow block": {"block.width": 0.02},
    "a block that comes to rest": {"schedule.speed": [[0.0, 0.0], [1.0, 0.1], [2.0, 0.1], [3.0, 0.0]]},
    "waits in contact": {"schedule.lifted": False},
    "air that cools down": {"effects": ["ambient_drift"], "ambient_drift.rate": -0.2},
    "a block that slides back": {"schedule.turn": 1},
}


@pytest.mark.parametrize("name", ODD)
def test_walls_and_wakes_of_odd_cases_are_a_little_cooler(name):
    """By some per cent of how warm they are above the air, at any time: before sliding too, and long after."""
    given = {"numerics.mesh": 0.3, "schedule.distance": 0.2, "schedule.repetitions": 2, "schedule.wait": 5.0}
    made = assemble_case({}, given | ODD[name], KeyLocations("none"), Path(), "odd")
    end = made.scene.schedule.end_time
    times = np.array([0.0, 0.01, 0.3, 0.5, 0.97, 1.0]) * end
    run = integrate_schedule(made.scene, replace(made.settings, times=tuple(times)))
    bare = replace(made.scene, acting=tuple(a for a in made.scene.acting if a.name != "convection"))
    half = 0.5 * made.scene.width
    for view, u, v in (("sidewall", [0.005, 0.02], [5e-4, 2e-3]), ("wake", [0.026, 0.03], [1e-3 - half, 0.0])):
        told = Recording(
            view=view, temperature=np.zeros((6, 2, 2)), time=times, repetition=np.ones(6, int), u=np.array(u),
            v=np.array(v), emissivity=0.95,
        )  # fmt: skip
        seen, plain = (observe(run, scene, told).temperature for scene in (made.scene, bare))
        first = observe(run, made.scene, replace(told, temperature=told.temperature[:1], time=times[:1] - 1.0,
                                                 repetition=np.ones(1, int))).temperature  # fmt: skip
        assert np.all(np.isfinite(seen))
        np.testing.assert_allclose(first, 20.0, atol=1e-6)
        warm = np.abs(plain - 20.0).max()
        assert np.abs(seen - plain).max() < (0.1 * warm + 0.2 if view == "sidewall" else 0.02 * warm)
        assert np.all(seen <= plain + 1e-3) or name == "air that cools down"


def test_a_wake_that_is_stamped_at_the_end_of_a_slide_never_shows_the_lifted_block():
    """A clock 20 ms early changed such frames by 0.13 K, and no step of a fit could succeed."""
    phases = [SimpleNamespace(end=end) for end in (4.0, 12.0, 16.0)]
    scene = SimpleNamespace(schedule=SimpleNamespace(phases=phases))
    stamped = np.array([1.4, 3.99, 4.0, 4.0000005, 4.01, 12.0, 16.1])
    expected = [np.inf, np.inf, 4.0, 4.0000005, np.inf, 12.0, np.inf]
    assert observation._latest_times(scene, stamped).tolist() == expected
