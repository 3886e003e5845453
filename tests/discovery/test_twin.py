"""Synthetic campaigns: made by another discretisation, sealed, and null campaigns compare to chi2/dof = 1."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from reference import uncooled_camera

from flashtemp.__main__ import main
from flashtemp.camera.camera_classes import COOLED, UNCOOLED
from flashtemp.camera.prediction import synthetic_camera_errors as camera_errors
from flashtemp.camera.prediction.observation import SIDE_WALL_CELLS, WAKE_CELL_GROWTH
from flashtemp.camera.prediction.synthetic_camera_errors import SyntheticCamera
from flashtemp.camera.recording import load as recording
from flashtemp.comparison import campaign
from flashtemp.comparison.compare import compare, summary_line
from flashtemp.comparison.synthetic_campaign import (
    SEALED_TRUTH,
    SyntheticPlan,
    _allowed_factor,
    draw_discretisation,
    draw_effect_parameters,
    make_synthetic_campaign,
)
from flashtemp.errors import BadInput
from flashtemp.model.case import load_case
from flashtemp.model.schema import find_value_fault
from flashtemp.physics.effect import catalogue

CASES = Path(__file__).parents[2] / "cases"
SHORT = {"schedule.distance": 0.35, "schedule.repetitions": 2, "schedule.wait": 5.0, "numerics.mesh": 0.6}


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    file = tmp_path_factory.mktemp("believed") / "case.toml"
    file.write_text('effects = ["friction_softening"]\n')
    return load_case(file, SHORT)


@pytest.fixture(scope="module")
def made(case, tmp_path_factory):
    def make(*hidden, seed=1, **given):
        folder = tmp_path_factory.mktemp("twin") / "campaign"
        plan = SyntheticPlan(hidden, seed, **{"conditions": 1, "nuisance": 0.0} | given)
        return make_synthetic_campaign(case, plan, folder)

    return make


@pytest.fixture(scope="module")
def null(made):
    return made()


def sealed(folder) -> dict:
    return json.loads((folder / SEALED_TRUTH).read_text())


@pytest.mark.parametrize("name", [n for n, e in catalogue().items() if not e.base])
def test_drawn_parameters_of_a_hidden_effect_are_values_that_a_case_accepts(case, name):
    params = catalogue()[name].params()
    for seed in range(3):
        for key, value in draw_effect_parameters(name, case, np.random.default_rng(seed)).items():
            assert (type(value) is int) == ("whole" in params[key].kinds), key
            assert find_value_fault(params[key], value) is None, key


def test_hidden_spots_keep_the_seed_of_their_pattern():
    spots = load_case(CASES / "resolved_spots")
    drawn = draw_effect_parameters("resolved_spots", spots, np.random.default_rng(1))
    assert drawn["seed"] == spots["resolved_spots.seed"]
    assert (
        spots.with_values({f"resolved_spots.{k}": v for k, v in drawn.items()})["resolved_spots.seed"] == drawn["seed"]
    )


# --- what a twin is -----------------------------------------------------------------------------------
@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.long)])
def test_nothing_hidden_compares_to_one_within_its_statistics(made, null, seed):
    """Noise of 0.05 K and a fixed pattern, estimated; five standard errors of chi2/dof."""
    folder = null if seed == 1 else made(seed=seed)
    found = compare(campaign.load(folder))
    for s in found.recordings:
        assert abs(s.chi2_per_dof - 1) < 5 * np.sqrt(2 / s.pixels), str(found)
        assert s.is_white, str(found)
        assert s.rmse_K < 0.08
        truth = sealed(folder)["recordings"]["condition1"][s.view.recording.view]
        assert s.noise.pattern == pytest.approx(truth["pattern_K"], rel=0.1)
    for p in found.forces:
        assert abs(p.chi2_per_dof - 1) < 5 * np.sqrt(2 / len(p.residual))


@pytest.mark.parametrize(
    "name",
    ["emissivity", *(pytest.param(n, marks=pytest.mark.long) for n in ("pressure_tilt", "interface_resistance"))],
)
@pytest.mark.long
def test_what_is_hidden_is_seen(made, name):
    found = compare(campaign.load(made(name, views=("sidewall",))))
    [s] = found.recordings
    assert s.chi2_per_dof > 1 + 3 * np.sqrt(2 / s.pixels)
    assert not s.is_white
    assert "sigma" in str(found)


@pytest.mark.long
def test_the_image_is_found_where_it_is(made):
    """Pixels that stand 0.15 px off are moved back by as much."""
    told = campaign.load(made(seed=5, views=("sidewall",)))
    [view] = told.views
    r = view.recording
    off = replace(view, recording=replace(r, u=r.u + 0.15 * r.pitch[0]))
    shift = [compare(replace(told, views=(v,), forces=())).recordings[0].shift[0] for v in (view, off)]
    assert shift[1] - shift[0] == pytest.approx(-0.15, abs=0.03)


@pytest.mark.long
def test_a_shift_beyond_what_is_known_is_refused(made):
    told = campaign.load(made(seed=5, views=("sidewall",)))
    [view] = told.views
    r = view.recording
    off = replace(view, recording=replace(r, u=r.u + 2.0 * r.pitch[0]))
    [s] = compare(replace(told, views=(off,), forces=())).recordings
    assert s.shift == (0.0, 0.0)
    assert s.shift_refused[0] == pytest.approx(-2.0, abs=0.1)
    assert "not applied" in summary_line(s)


def test_the_truth_is_made_by_another_discretisation(case, null):
    """At least 1.7 times the cells in every direction, also behind the block; other grading, tolerance and order."""
    seen = {"road.downstream": 0.042, "numerics.behind": WAKE_CELL_GROWTH, "numerics.above": SIDE_WALL_CELLS}
    wide, truth = seen, sealed(null)["numerics"]
    believed = load_case(null / "case.toml", wide)
    fine, coarse = (c.scene.mesh for c in (load_case(null / "case.toml", wide | truth), believed))
    for count in (lambda m: m.last - m.first, lambda m: m.n_road, lambda m: m.n_block, lambda m: m.n_lines - m.last):
        assert count(fine) >= 1.7 * count(coarse) - 1
    assert np.diff(fine.x)[fine.first] < np.diff(coarse.x)[coarse.first] / 1.75  # graded more than the factor makes it
    assert truth["numerics.rtol"] < believed["numerics.rtol"]
    assert truth["numerics.order"] != believed["numerics.order"]


def test_the_truth_of_a_fast_block_has_finer_first_cells(case):
    """Where the default mesh follows speed and time of sliding, the truth's follows its fastest condition."""
    given = {"schedule.speed": 4.0, "schedule.distance": 0.02, "numerics.mesh": 1.0}
    quick = case.with_values(given)
    told = draw_discretisation(quick, np.random.default_rng(1))
    truth, believed = quick.with_values(told).scene.mesh, quick.scene.mesh
    assert truth.height[1] < believed.height[1] / 1.75
    assert truth.depth[1] < believed.depth[1] / 1.75


@pytest.mark.long
def test_the_truth_is_sealed(made, tmp_path):
    """Nothing but the sealed file names what is hidden, and comparing does not read it."""
    folder = tmp_path / "copy"
    shutil.copytree(made("pressure_tilt", nuisance=1.0, views=("sidewall",)), folder)
    for file in [f for f in folder.rglob("*") if f.is_file() and f != folder / SEALED_TRUTH]:
        assert b"pressure_tilt" not in file.read_bytes(), file
    before = str(compare(campaign.load(folder)))
    shutil.rmtree(folder / "sealed")
    assert str(compare(campaign.load(folder))) == before


@pytest.mark.long
def test_an_effect_of_the_case_can_be_hidden(made):
    folder = made("friction_softening")
    assert load_case(folder / "case.toml").effects == ()
    assert sealed(folder)["hidden"]["friction_softening"]["b"] != 0


@pytest.mark.long
def test_same_seed_same_campaign_other_seed_another(made, null):
    def images(folder):
        return recording(folder / "condition1_sidewall.nc").temperature

    np.testing.assert_array_equal(images(null), images(made()))
    assert not np.array_equal(images(null), images(made(seed=2)), equal_nan=True)


def test_recordings_are_as_a_laboratory_hands_them_over(null):
    r = recording(null / "condition1_sidewall.nc")
    assert (r.netd_K, r.emissivity, r.registration_sigma_px) == (0.05, 0.95, 0.2)
    assert r.fixed_pattern_K is None
    dead = ~np.isfinite(r.temperature).any(axis=0)
    assert 0 < dead.sum() < 0.01 * dead.size
    assert sorted(set(r.repetition)) == [1, 2]


@pytest.mark.parametrize(
    ("change", "said"), [({"time": 1e3}, "ends at"), ({"repetition": 1}, "where the schedule of its condition is in")]
)
def test_frames_of_another_schedule_are_refused(null, change, said):
    told = campaign.load(null)
    r = told.views[0].recording
    moved = replace(r, **{k: getattr(r, k) + v for k, v in change.items()})
    with pytest.raises(BadInput, match=f"condition1_sidewall.nc: .*{said}"):
        compare(replace(told, views=(replace(told.views[0], recording=moved),)))


def test_what_cannot_be_compared_is_refused(null):
    """No pixel on the body; load-cell readings beyond the schedule; none while the block slides."""
    told = campaign.load(null)
    [view, _], [force] = told.views, told.forces
    far = replace(view, recording=replace(view.recording, v=view.recording.v + 0.1))
    late = replace(force, time=tuple(t + 1e3 for t in force.time))
    still = replace(force, time=(4.0, 5.0), mu=(0.8, 0.8))
    for views, forces, said in (((far,), (), "no pixel"), ((), (late,), "ends at"), ((), (still,), "no reading")):
        with pytest.raises(BadInput, match=said):
            compare(replace(told, views=views, forces=forces))


def test_the_wake_is_not_shifted_across(null):
    found = {s.view.recording.view: s for s in compare(campaign.load(null)).recordings}
    assert found["wake"].shift[1] == 0.0
    assert found["sidewall"].shift[1] != 0.0


@pytest.mark.long
def test_a_profile_can_be_the_view(case, tmp_path):
    """The mesh is fine enough for its error to stay below the noise of a profile, whose pixels see the hottest cells."""
    plan = SyntheticPlan((), 1, conditions=1, nuisance=0.0, views=("profile",))
    found = compare(
        campaign.load(make_synthetic_campaign(case.with_values({"numerics.mesh": 1.0}), plan, tmp_path / "c"))
    )
    assert abs(found.recordings[0].chi2_per_dof - 1) < 0.1


# --- cameras with errors of their own ------------------------------------------------------------------
def camera_with(seed=(1, 0), camera_class=UNCOOLED, **errors):
    camera = SyntheticCamera.draw_random(camera_class, seed)
    return replace(camera, errors=replace(camera.errors, **errors))


@pytest.mark.parametrize("length", [0.4, 3.0, -2.0])
def test_lag_and_stray_light_agree_with_the_independent_laboratory(length):
    """Two programs, one law: a first-order response, and a share of the light in a Gaussian."""
    T = np.random.default_rng(1).normal(25.0, 3.0, (2, 30, 70))
    lagged = np.array([camera_errors._apply_pixel_lag(image, length) for image in T])
    np.testing.assert_allclose(lagged, uncooled_camera.smear_motion(T, length), atol=1e-12)
    own = camera_with(vignetting=0.0, stray_light=0.02, stray_sigma_px=6.0, untracked_speed=0.0)
    other = replace(uncooled_camera.IDEAL, halo=0.02, halo_width=6.0)
    np.testing.assert_allclose(own.distort(T, np.zeros(2)), uncooled_camera.spread_halo(T, other), atol=1e-9)


def test_vignetting_takes_its_share_of_the_contrast_in_the_corners():
    images = np.full((1, 31, 71), 20.0)
    seen = camera_with(vignetting=0.008, housing_degC=30.0, untracked_speed=0.0).distort(images, np.zeros(1))[0]
    corners = seen[[0, 0, -1, -1], [0, -1, 0, -1]]
    np.testing.assert_allclose(corners, 30.0 - 10.0 * (1.0 - 0.008), rtol=1e-12)
    assert seen[15, 35] == pytest.approx(20.0, abs=1e-12)


def test_the_offset_wanders_as_a_wiener_process_that_the_shutter_ends():
    time, closings, rng = np.linspace(0.0, 20.0, 41), np.array([8.2]), np.random.default_rng(2)
    errors = camera_with(offset_sd_K=0.1, wander_K_per_sqrt_s=0.02).errors
    paths = np.array([camera_errors._draw_offset_drift(time, closings, errors, rng) for _ in range(2000)])
    age = np.where(time < 8.2, time, time - 8.2)
    np.testing.assert_allclose(paths.var(axis=0), 0.1**2 + 0.02**2 * age, rtol=5.0 * np.sqrt(2.0 / 2000))
    assert abs(np.corrcoef(paths[:, 5], paths[:, 30])[0, 1]) < 5.0 / np.sqrt(2000)


def test_a_closing_of_the_shutter_renews_its_share_of_rows_and_columns_alone():
    """Of their variance; within an interval, and in what stays, nothing changes."""
    time, closings = np.linspace(0.0, 20.0, 20), np.array([8.2])
    camera = camera_with(renewed_pattern=0.3, row_pattern_K=0.04, column_pattern_K=0.03)
    own = camera._renewed_lines(time, closings, (200, 300), np.random.default_rng(4))
    assert np.ptp(own[:8], axis=0).max() == np.ptp(own[8:], axis=0).max() == 0.0
    change = own[8] - own[7]
    sizes = change.mean(axis=1).std(), change.mean(axis=0).std()
    assert sizes == pytest.approx((np.sqrt(2 * 0.3) * 0.04, np.sqrt(2 * 0.3) * 0.03), rel=0.2)
    steady = replace(camera, errors=replace(camera.errors, renewed_pattern=0.0))
    assert not steady._renewed_lines(time, closings, (5, 6), np.random.default_rng(4)).any()
    bare = {"lamp_K": 0.0, "narcissus_K": 0.0}
    kept = [replace(c, errors=replace(c.errors, **bare))._static_offset((200, 300)) for c in (camera, steady)]
    np.testing.assert_allclose(kept[0], np.sqrt(0.7) * kept[1], rtol=1e-12)


@pytest.mark.parametrize("camera_class", [UNCOOLED, COOLED])
def test_a_camera_writes_counts_with_bad_pixels_that_stay_and_frames_that_repeat(camera_class):
    T, time = np.random.default_rng(3).normal(25.0, 1.0, (60, 24, 80)), np.linspace(0.0, 30.0, 60)
    camera = camera_with((3, 1), camera_class, shutter_interval_s=10.0, repeated_frames=2.0, bad_rows=1.5)
    first, again, other = (camera.degrade(T, time, np.random.default_rng(k)) for k in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    counts = first / camera.errors.count_K
    np.testing.assert_allclose(counts, np.rint(counts), atol=1e-6)
    same = (first[1:] == first[:-1]).all(axis=(1, 2))
    assert same.sum() in (4, 6)  # two or three closings in thirty seconds
    bad = np.any(camera.bad_pixels(T.shape[1:]), axis=0)
    assert bad.all(axis=1).sum() == 1
    stuck = [np.ptp(images, axis=0) == 0.0 for images in (first, other)]
    np.testing.assert_array_equal(*stuck)
    assert not (stuck[0] & ~bad).any()
    np.testing.assert_array_equal(first[0][stuck[0]], other[0][stuck[0]])


@pytest.mark.parametrize("camera_class", [UNCOOLED, pytest.param(COOLED, marks=pytest.mark.long)])
def test_a_twin_with_cameras_that_err_seals_their_errors(case, tmp_path, camera_class):
    """More frames, a number in every pixel, and one camera per view in all conditions."""
    quick = case.with_values({"schedule.distance": 0.05, "schedule.wait": 0.5, "numerics.mesh": 0.3})
    plan = SyntheticPlan((), 7, 2, ("sidewall",), nuisance=0.0, camera=camera_class)
    folder = make_synthetic_campaign(quick, plan, tmp_path / "lab")
    r = recording(folder / "condition1_sidewall.nc")
    assert r.camera == camera_class
    assert r.frames == 2 * 24 + 4
    assert np.isfinite(r.temperature).all()
    np.testing.assert_allclose(np.diff(r.time[:24]), np.diff(r.time[:2])[0], rtol=1e-9)
    made = [sealed(folder)["recordings"][f"condition{n}"]["sidewall"]["camera"] for n in (1, 2)]
    assert made[0] == made[1]
    low, high = camera_errors.ERROR_RANGES["response_s"][[UNCOOLED, COOLED].index(camera_class)]
    assert low <= made[0]["response_s"] <= high
    found = campaign.load(folder).views[0].recording.temperature
    np.testing.assert_array_equal(found, r.temperature)


# --- commands -----------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["--hide", "friction"], "always acts"),
        (
            ["--hide", "pressure_tillt"],
            "--hide: effect 'pressure_tillt' is not in the catalogue; did you mean 'pressure_tilt'",
        ),
        (["--hide", "wear,wear"], "named twice"),
        (["--hide", "none", "--views", "above"], "sidewall, wake, profile"),
        (
            ["--hide", "none", "--views", "points", "--points", "x=0.5,z=0.002"],
            "x = 0.5 m lies outside what is simulated",
        ),
        (["--hide", "none", "--conditions", "9"], "give 1 to 4"),
        (["--hide", "none", "--nuisance", "-1"], "from 0 to 3"),
        (["--hide", "none", "--camera", "warm"], "--camera: 'warm'; give ideal, uncooled or cooled"),
    ],
)
def test_bad_input(case, tmp_path, capsys, given, said):
    file = tmp_path / "case.toml"
    file.write_text(case.toml())
    assert main(["twin", str(file), "--seed", "1", "--out", str(tmp_path / "out"), *given]) == 2
    assert said in capsys.readouterr().err
    assert [p.name for p in tmp_path.iterdir()] == ["case.toml"]


@pytest.mark.long
def test_from_twin_to_report(case, tmp_path, capsys):
    file = tmp_path / "case.toml"
    file.write_text(case.toml())
    out, report = tmp_path / "lab", tmp_path / "report"
    args = ["--hide", "none", "--seed", "4", "--conditions", "1", "--views", "sidewall", "--out", str(out)]
    assert main(["twin", str(file), *args]) == 0
    capsys.readouterr()
    assert main(["compare", str(out), "--out", str(report), "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert (
        shown["recordings"][0]["rmse_K"] == json.loads((report / "compare.json").read_text())["recordings"][0]["rmse_K"]
    )
    assert "<html" in (report / "report.html").read_text()[:200].lower()
    assert main(["compare", str(out), "--out", str(report)]) == 2
    assert "exists" in capsys.readouterr().err


@pytest.mark.long
def test_from_a_folder_of_images_to_the_comparison(case, made, tmp_path, capsys):
    """What a user does: text matrices with decimal commas, a table of times, one import, one campaign file."""
    source = made(seed=6, views=("sidewall",))
    r = recording(source / "condition1_sidewall.nc")
    (tmp_path / "side").mkdir()
    rows = ["file,time,repetition"]
    for k, (t, n) in enumerate(zip(r.time, r.repetition, strict=True)):
        lines = [
            ";".join("--" if np.isnan(v) else f"{v:.3f}".replace(".", ",") for v in row)
            for row in r.temperature[k][::-1]
        ]
        (tmp_path / "side" / f"{k:03d}.csv").write_text("\n".join(lines) + "\n")
        rows.append(f"{k:03d}.csv,{float(t)!r},{n}")
    (tmp_path / "times.csv").write_text("\n".join(rows) + "\n")
    (tmp_path / "case.toml").write_text((source / "case.toml").read_text())
    given = [
        "--view", "sidewall", "--downstream", "right", "--pixel", str(-r.u[0] / r.pitch[0]),
        str(len(r.v) - 1 + r.v[0] / r.pitch[1]), "--mm-per-pixel", "0.25", "--times", str(tmp_path / "times.csv"),
        "--was.emissivity", "0.95", "--was.reflected", "20", "--psf-sigma", "0.7", "--registration-sigma", "0.2",
    ]  # fmt: skip
    files = sorted(str(f) for f in (tmp_path / "side").iterdir())
    assert main(["import", *files, "--out", str(tmp_path / "side.nc"), *given]) == 0
    assert (tmp_path / "side.png").is_file()
    back = recording(tmp_path / "side.nc")
    np.testing.assert_allclose(back.u, r.u, atol=1e-12)
    np.testing.assert_allclose(back.temperature, r.temperature, atol=6e-4)  # three decimals of the text
    conditions = '{ "contact.pressure" = 1.5e5, "schedule.speed" = 0.1 }'
    text = f'case = "case.toml"\n[[recording]]\nfile = "side.nc"\nwith = {conditions}\n'
    (tmp_path / "campaign.toml").write_text(text)
    [s] = compare(campaign.load(tmp_path)).recordings
    assert s.noise.estimated == ("white", "pattern")
    assert s.chi2_per_dof == pytest.approx(1.0, abs=0.05)
    assert s.is_white


@pytest.mark.parametrize(("key", "value", "factor", "allowed"), [
    ("contact.spot_fraction", 1.0, 1.25, 0.8), ("contact.spot_fraction", 1.0, 0.9, 0.9), ("contact.spot_fraction", 0.2, 1.25, 1.25),
    ("friction.mu", 1.0, 1.25, 1.25),
])  # fmt: skip
def test_what_is_drawn_stays_within_the_bounds_of_its_key(key, value, factor, allowed):
    """A truth outside of them could not be found: a fit stays within."""
    case = load_case(CASES / "uniform_pressure", {key: value})
    assert _allowed_factor(case, key, factor) == pytest.approx(allowed)
