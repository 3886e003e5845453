"""Columns of errors in every fit: of the mesh, of road that the block covered at its start, of smear in the camera."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from reference.uncooled_camera import smear_motion

from flashtemp.camera.camera_classes import CAMERA_CLASSES, UNCOOLED
from flashtemp.camera.image_placement import ImagePlacement
from flashtemp.comparison import campaign
from flashtemp.comparison.synthetic_campaign import SyntheticPlan, make_synthetic_campaign
from flashtemp.discovery.engine import _place_images, predict_coarser_meshes
from flashtemp.discovery.estimation import whitening
from flashtemp.discovery.estimation.camera_error_columns import MAX_UNTRACKED_FRACTION, smear_modes
from flashtemp.discovery.estimation.nuisance_priors import nuisance_priors
from flashtemp.discovery.parameters import ParameterKind
from flashtemp.discovery.prediction.mesh_extrapolation import (
    coarser_mesh_factors,
    coarser_mesh_keys,
    error_per_difference,
)
from flashtemp.discovery.prediction.prediction import DerivativeRequest, predict_condition
from flashtemp.discovery.prediction.problem import prepare_problem
from flashtemp.model.case import load_case

COARSE, FINE = 0.5, 1.5
SHORT = {
    "block.height": 0.005, "schedule.distance": 0.2, "numerics.rtol": 1e-5, "numerics.mesh": COARSE, "output.profiles": 20,
}  # fmt: skip


# --- mesh -------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("factor", [0.5, 0.6, 0.8])
def test_an_error_of_second_order_is_known_exactly(factor):
    values = {cells: 7.0 + 3.0 * cells**-2.0 for cells in (40.0, 40.0 * factor)}
    difference = values[40.0] - values[40.0 * factor]
    fraction = error_per_difference(cells_of_a_case(), (1.0, factor, 1.0))
    assert difference * fraction == pytest.approx(7.0 - values[40.0], rel=1e-9)


def cells_of_a_case(across=1, finer=1.0):
    return {"numerics.finer": [finer] * 3, "numerics.across": across, "numerics.first_y": 1e-4}


@pytest.mark.parametrize(("across", "fraction"), [(2, 0.0), (3, 1.0 / 1.25), (4, 1.0 / 3.0), (60, 1.0 / 3.0)])
def test_few_cells_across_are_compared_with_as_many_as_there_can_be(across, fraction):
    case, factors = cells_of_a_case(across), (1.0, 1.0, 1.0, 0.5)
    assert error_per_difference(case, factors) == pytest.approx(fraction)
    keys = coarser_mesh_keys(case, *factors)
    assert keys["numerics.across"] * keys["numerics.first_y"] == pytest.approx(across * 1e-4)  # a similar mesh


def test_a_mesh_that_can_hardly_be_coarser_has_the_factor_that_is_left():
    assert error_per_difference(cells_of_a_case(finer=0.125), (0.6, 1.0, 1.0)) == pytest.approx(1.0 / (1.25**2 - 1.0))
    assert error_per_difference(cells_of_a_case(finer=0.1), (0.6, 1.0, 1.0)) == 0.0


@pytest.fixture(scope="module")
def meshes(tmp_path_factory):
    """Predictions of the same stated case on a coarse and a fine mesh, the coarse one with its coarser meshes."""
    folder = tmp_path_factory.mktemp("mesh")
    (folder / "case.toml").write_text("")
    plan = SyntheticPlan((), 3, 1, ("sidewall", "wake"), sliding=4)
    lab = make_synthetic_campaign(load_case(folder / "case.toml", SHORT), plan, folder / "lab")
    coarse = prepare_problem(campaign.load(lab), lambda tasks: [predict_condition(task) for task in tasks])
    fine = replace(coarse, case=coarse.case.with_values({"numerics.mesh": FINE}))
    first, exact = (p.predict(p.make_tasks(p.stated_model, DerivativeRequest(fields=True))) for p in (coarse, fine))
    return SimpleNamespace(problem=coarse, first=first, exact=exact, coarser=predict_coarser_meshes(coarse))


@pytest.mark.parametrize("view", ["sidewall", "wake"])
def test_extrapolation_removes_most_of_the_error_of_a_mesh(meshes, view):
    """Against a mesh with 9 times as many cells of a plane, with the coefficients that the prior expects."""
    [entry] = [v for v in meshes.problem.campaign.views if v.recording.view == view]
    seen, exact = (p[0].observables[entry.file] for p in (meshes.first, meshes.exact))
    coarser = [other[0].observables[entry.file] for other in meshes.coarser]
    columns = whitening._mesh_errors(meshes.problem, seen, coarser)
    assert len(columns) == len(coarser_mesh_factors(meshes.problem.case)) == 3
    priors = nuisance_priors(meshes.problem, columns, meshes.problem.stated_model)
    used = ~whitening._is_starting_road(entry, seen, meshes.first[0].run)
    error = (exact.values - seen.values)[:, seen.inside][used]
    left = error - sum(priors[p][0] * column[used] for p, column in columns.items())
    rms = [float(np.sqrt(np.mean(a**2))) for a in (error, left)]
    assert rms[0] > 1e-3
    assert rms[1] < rms[0] / 3.0


def test_the_error_of_a_mesh_is_known_where_an_image_lies(meshes):
    """A wall that is rotated by 5 degrees and lies 1 px higher shows other depths of the block in each column."""
    stated = meshes.problem.stated_model
    [entry] = [v for v in meshes.problem.campaign.views if v.recording.view == "sidewall"]
    moved = replace(
        stated, placements={entry.file: ImagePlacement(turn=np.radians(5.0))}, shifts={entry.file: (0.0, 1.0)}
    )
    factors = (None, *coarser_mesh_factors(meshes.problem.case))
    placed = [
        _place_images(meshes.problem, runs, f, moved)
        for f, runs in zip(factors, (meshes.first, *meshes.coarser), strict=True)
    ]
    fine = replace(meshes.problem, case=meshes.problem.case.with_values({"numerics.mesh": FINE}))
    [exact] = _place_images(fine, meshes.exact, None, moved)
    seen = placed[0][0].observables[entry.file]
    error = (exact.observables[entry.file].values - seen.values)[:, seen.inside]
    data = whitening.WhitenedData.from_predictions(meshes.problem, meshes.first, meshes.coarser)

    def left_over(of):
        """Root mean square of the error less what the prior expects, in standard deviations of the noise."""
        fixed = of.fixed[entry.file]
        columns = {p: F for p, F in zip(fixed.names, fixed.F.T, strict=True) if p.kind is ParameterKind.MESH}
        priors = nuisance_priors(meshes.problem, columns, stated)
        left = of._whiten_values(entry, error) - sum(priors[p][0] * F for p, F in columns.items())
        return float(np.sqrt(np.mean(left**2)))

    kept, wide = (runs[0].full_run.frames for runs in (meshes.coarser[0], meshes.first))
    assert len(kept) < 0.6 * len(wide)  # the stated clocks alone: memory counts where campaigns are long
    there = data.with_image_errors_of(placed[0], placed)
    assert left_over(there) < left_over(data) / 3.0
    assert sum(p.kind is ParameterKind.MESH for p in there.fixed[entry.file].names) == len(factors) - 1


def test_camera_errors_of_the_same_prediction_are_the_same(meshes):
    data = whitening.WhitenedData.from_predictions(meshes.problem, meshes.first, meshes.coarser)
    again = data.with_image_errors_of([prediction.without_columns for prediction in meshes.first])
    for file, fixed in data.fixed.items():
        assert sorted(map(str, again.fixed[file].names)) == sorted(map(str, fixed.names))
        order = [again.fixed[file].names.index(p) for p in fixed.names]
        np.testing.assert_allclose(again.fixed[file].F[:, order], fixed.F, rtol=0.0, atol=1e-6)


# --- road that the block covered when it began to slide -----------------------------------------------------------
LENGTH = 0.02  # m, of the block
NODES = np.concatenate([np.linspace(-0.005, LENGTH, 26), LENGTH + 0.001 * np.arange(1, 41)])  # cells of 1 mm


def sliding_run(time, slid, **more):
    run = {"sliding": np.ones(len(time), bool), "repetition": np.ones(len(time), int), "direction": None} | more
    mesh = SimpleNamespace(x=NODES, first=5, last=25)
    return SimpleNamespace(time=np.array(time, float), slid=np.array(slid, float), mesh=mesh, **run)


def left_out(view, times, behind, run):
    """Which pixels (frames, pixels) at distances `behind` the block are left out."""
    u = LENGTH + np.array(behind)
    recording = SimpleNamespace(
        view=view, time=np.array(times, float), frames=len(times), u=u, psf_sigma_px=0.5, pitch=(1e-3, 1e-3)
    )
    seen = SimpleNamespace(inside=np.ones((1, len(u)), bool))
    return whitening._is_starting_road(SimpleNamespace(recording=recording), seen, run)


def test_road_that_was_under_the_block_at_the_start_is_left_out():
    """Slid by 0.05 m, the block has left road of 0.03 m that it met on its way; two cells and the blur belong to it."""
    run = sliding_run([0.0, 1.0], [0.0, 0.1])
    out = left_out("wake", [0.5, 0.99], [0.005, 0.0255, 0.0265, 0.035], run)
    assert out.tolist() == [[False, False, True, True], [False] * 4]


def test_every_repetition_has_its_own_start():
    run = sliding_run([0.0, 1.0, 3.0, 4.0], [0.0, 0.1, 0.1, 0.2], repetition=np.array([1, 1, 2, 2]))
    out = left_out("wake", [0.9, 3.4], [0.01, 0.03], run)
    assert out.tolist() == [[False, False], [False, True]]


def test_a_block_that_comes_back_meets_the_road_of_its_start_again():
    """After 0.1 m and 0.02 m back, road of 0.06 m is left that the block met on its way."""
    run = sliding_run([0.0, 1.0, 2.0], [0.0, 0.1, 0.2], direction=np.array([1, 1, -1]))
    out = left_out("wake", [1.2, 1.5, 1.9], [0.005, 0.0255, 0.0265, 0.0395], run)
    assert out.tolist() == [[False] * 4, [False, False, True, True], [True] * 4]


def test_a_block_at_rest_has_no_start():
    run = sliding_run([0.0, 1.0], [0.0, 0.0], sliding=np.zeros(2, bool))
    assert not left_out("wake", [0.5], [0.005, 0.03], run).any()


def test_all_that_there_is_stays():
    run = sliding_run([0.0, 1.0], [0.0, 0.1])
    assert not left_out("wake", [0.15], [0.005, 0.01], run).any()
    assert not left_out("sidewall", [0.15, 0.9], [-0.01, -0.005], run).any()  # a wall has no front


@pytest.mark.parametrize(
    ("times", "expected"),
    [((1.4, 4.0, 11.95, 12.0, 12.05, 12.07), (11.95, 12.0, 12.05)), ((0.0, 0.05, 0.07), (0.0, 0.05))],
)
@pytest.mark.parametrize("kind", ["with a wait", "without", "turning"])
def test_frames_of_a_wake_that_a_clock_cannot_tell_from_its_start_are_left_out(times, expected, kind):
    time, slid = [0.0, 2.0, 4.0, 8.0, 12.0, 12.3, 16.0], np.array([-90.0, 0.0, 90.0, 90.0, 90.0, 180.0, 270.0])
    more = {
        "with a wait": {
            "sliding": np.array([1, 1, 1, 0, 0, 1, 1], bool),
            "repetition": np.array([1, 1, 1, 1, 1, 2, 2]),
        },
        "without": {"repetition": np.array([1, 1, 1, 1, 1, 2, 2])},
        "turning": {"direction": np.array([1, 1, 1, 1, 1, -1, -1])},
    }[kind]
    slid[1:5] = np.linspace(50.0, 90.0, 4)
    out = left_out("wake", times, [0.005], sliding_run(time, slid, **more))
    assert tuple(np.array(times)[out[:, 0]]) == expected


# --- smear --------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("share", [0.03, 0.1, 0.22, 0.37])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_any_part_of_the_motion_that_a_camera_misses_is_among_the_modes_of_smear(share, sign):
    """A wall with steep ends; the independent program smears it, and 1 % of the largest smear is left at most."""
    assert share < MAX_UNTRACKED_FRACTION
    u, pitch, speed, sizes = np.arange(120.0), 2e-4, np.array([0.3, 0.0, 0.2]), CAMERA_CLASSES[UNCOOLED]
    ends = 1.0 / ((1.0 + np.exp(-(u - 20.0) / 0.7)) * (1.0 + np.exp((u - 100.0) / 0.7)))
    values = 20.0 + 8.0 * (ends * (1.0 + u / 60.0))[None, None] * np.array([1.0, 1.5])[None, :, None] * np.ones(
        (3, 1, 1)
    )
    inside = np.zeros(values.shape[1:], bool)
    inside[:, 23:97] = True
    recording = SimpleNamespace(u=u * pitch, pitch=(pitch, pitch))
    modes = smear_modes(recording, SimpleNamespace(values=values, inside=inside), sizes, speed)
    length = sign * share * speed * sizes.smear_s / pitch
    change, largest = (
        np.stack([smear_motion(image, far) - image for image, far in zip(values, scale * length, strict=True)])[
            :, inside
        ]
        for scale in (1.0, MAX_UNTRACKED_FRACTION / share)
    )
    C = np.stack([mode.ravel() for mode in modes], axis=1).astype(float)
    amplitude = np.linalg.lstsq(C, change.ravel(), rcond=None)[0]
    left = change.ravel() - C @ amplitude
    assert np.sqrt(np.mean(left**2)) < 0.01 * np.sqrt(np.mean(largest**2))
    assert np.abs(amplitude).max() < 6.0


def test_a_camera_at_rest_has_no_smear():
    recording, seen = SimpleNamespace(u=np.arange(5.0), pitch=(1.0, 1.0)), SimpleNamespace(values=np.ones((2, 3, 5)))
    assert smear_modes(recording, seen, CAMERA_CLASSES[UNCOOLED], np.zeros(2)) == []
