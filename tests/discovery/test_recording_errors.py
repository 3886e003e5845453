"""Recordings that are not what they are stated to be: mirrored, turned over, exchanged, misfiled, copied, far off."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from flashtemp.camera.image_placement import ImagePlacement
from flashtemp.comparison import campaign
from flashtemp.comparison.synthetic_campaign import SyntheticPlan, make_synthetic_campaign
from flashtemp.discovery import engine
from flashtemp.discovery.estimation import whitening
from flashtemp.discovery.estimation.nuisance_priors import all_derivatives
from flashtemp.discovery.estimation.outlier_rejection import reject_outliers
from flashtemp.discovery.measurement_errors import recording_fit
from flashtemp.discovery.measurement_errors.image_pose import ImagePose, register_image
from flashtemp.discovery.measurement_errors.initial_registration import register_images
from flashtemp.discovery.measurement_errors.recording_errors import (
    ErrorKind,
    correct_recordings,
    find_misassigned_recordings,
    find_recording_errors,
)
from flashtemp.discovery.measurement_errors.recording_fit import HypothesisEvidence, flip_recording
from flashtemp.discovery.prediction.prediction import predict_again, predict_condition
from flashtemp.discovery.prediction.problem import prepare_problem, replace_views
from flashtemp.model.case import load_case
from flashtemp.runs.results.worker_pool import call_safely

TINY = {
    "block.height": 0.005, "schedule.distance": 0.3, "schedule.repetitions": 1, "road.track_length": 0.3,
    "numerics.mesh": 0.4, "output.profiles": 20,
}  # fmt: skip
LENGTH = 0.025
FAINT_K = 1.8  # noise of an image that hardly shows which end is which
WALLS = ("condition1_sidewall.nc", "condition2_sidewall.nc")
WAKES = ("condition1_wake.nc", "condition2_wake.nc")


def run(tasks):
    return [call_safely(predict_condition, task) for task in tasks]


def campaign_problem(folder, hidden=(), conditions=2, views=("sidewall", "wake"), seed=41):
    """A small campaign of one speed and two pressures, made ready."""
    folder.mkdir()
    (folder / "case.toml").write_text("")
    lab = make_synthetic_campaign(
        load_case(folder / "case.toml", TINY), SyntheticPlan(hidden, seed, conditions, views, 4), folder / "lab"
    )
    return cropped(prepare_problem(campaign.load(lab), run), {"sidewall": (0, 16, 108), "wake": (50, 16, 40)})


def cropped(problem, cuts):
    """The problem with images cut to some rows and columns, {view: (first row, rows, columns)}: fewer pixels to fit."""
    views = []
    for view in problem.campaign.views:
        r, (first, rows, columns) = view.recording, cuts[view.recording.view]
        own = slice(first, first + rows)
        T = r.temperature[:, own, :columns]
        views.append(replace(view, recording=replace(r, temperature=T, u=r.u[:columns], v=r.v[own])))
    return replace_views(problem, views)


def predicted(problem):
    return problem.predict(problem.make_tasks(problem.stated_model, replace(all_derivatives(problem), fields=True)))


@pytest.fixture(autouse=True, scope="module")
def ideal_cameras():
    """Cameras here have no errors of their own; to look for them takes most of the time of small fits."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(whitening, "camera_columns", lambda *a: {})
        yield


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """Nothing hidden; and what the stated model predicts."""
    problem = campaign_problem(tmp_path_factory.mktemp("plain") / "lab")
    return problem, predicted(problem)


def images(problem):
    return {v.file: v.recording.temperature for v in problem.campaign.views}


def with_images(problem, changed):
    """The problem with other images in some recordings, {file: temperature}."""
    views = [v for v in problem.campaign.views if v.file in changed]
    return replace_views(
        problem, [replace(v, recording=replace(v.recording, temperature=changed[v.file])) for v in views]
    )


def condition_of(problem):
    return {v.file: n for n, c in enumerate(problem.conditions) for v in c.views}


# --- nothing is found where nothing is wrong -------------------------------------------------------------------------
def test_recordings_as_stated_are_left_as_they_are(plain):
    problem, first = plain
    assert find_recording_errors(problem, first) == ()
    assert find_misassigned_recordings(problem) == ()
    assert register_images(problem, first) is problem


def test_a_line_that_flickers_beside_the_edge_is_masked_before_recordings_are_tested(plain):
    """Where a mirrored prediction ends, the line would be out of sight, and mirroring would seem better."""
    problem, first = plain
    T = images(problem)[WAKES[0]].copy()
    T[:, :, -2] += np.resize([3.0, 0.0, 0.0, 3.0, 3.0, 0.0, 3.0], len(T))[:, None]
    shown = with_images(problem, {WAKES[0]: T})
    found = reject_outliers(shown, first, lines_only=True)
    before, after = (np.isfinite(images(p)[WAKES[0]]) for p in (shown, found))
    lost = np.unique(np.nonzero(before & ~after)[2])
    assert lost.tolist() == [T.shape[2] - 2]
    assert "1 flickering column" in found.screening[WAKES[0]]
    assert all(images(found)[file] is images(problem)[file] for file in (*WALLS, WAKES[1]))


def test_recordings_are_tested_without_lines_that_flicker(monkeypatch):
    tested = []
    monkeypatch.setattr(engine, "find_misassigned_recordings", lambda problem: ())
    monkeypatch.setattr(engine, "_predict_stated_model", lambda problem: "predictions")
    monkeypatch.setattr(engine, "reject_outliers", lambda problem, first, lines_only: ("masked", problem, lines_only))
    monkeypatch.setattr(engine, "find_recording_errors", lambda problem, first: tested.append(problem) or ())
    monkeypatch.setattr(engine, "register_images", lambda problem, first: problem)
    found = engine.correct_measurements("stated", lambda text: None)
    assert tested == [("masked", "stated", True)]
    assert found == (tested[0], (), "predictions")


def test_a_missing_effect_is_no_mirrored_image(tmp_path):
    """A strong pressure tilt reverses the profile along the block; free pressure shapes explain it as it is."""
    problem = campaign_problem(tmp_path / "tilt", ("pressure_tilt",), 1, ("sidewall",), 43)
    assert find_recording_errors(problem, predicted(problem)) == ()


@pytest.mark.parametrize(("chi2", "is_possible"), [(1.6, False), (1.4, True), (1.05, True)])
def test_a_hypothesis_that_describes_its_own_data_worse_is_impossible(monkeypatch, chi2, is_possible):
    """Turned over, an image may lie so that hardly anything that warms is predicted in both positions."""
    monkeypatch.setattr(recording_fit, "_joint_fit", lambda problem, fits, unaffected: (0.0, 1.0, 10))

    def fit(chi2):
        block, everywhere = SimpleNamespace(count=2000), np.ones((20, 10, 10), bool)
        return SimpleNamespace(
            block=block,
            chi2_per_datum=chi2,
            known=everywhere,
            known_in_file=everywhere,
            restrict_to=lambda common: None,
        )

    found = recording_fit.compare_fits(None, [fit(1.5)], [fit(chi2)])
    assert np.isfinite(found.ln_bayes) == is_possible


# --- what is wrong is found, and put right ---------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("kind", "file", "axes"),
    [
        pytest.param(ErrorKind.MIRRORED, WALLS[1], 2, marks=pytest.mark.long),  # test_laboratory.py mirrors a wall
        (ErrorKind.MIRRORED, WAKES[0], 2),
        (ErrorKind.ROTATED, WALLS[1], (1, 2)),
    ],
)
def test_images_that_are_turned_over_are_turned_back(plain, kind, file, axes):
    problem, first = plain
    right = images(problem)[file]
    wrong = with_images(problem, {file: np.flip(right, axes)})
    [error] = find_recording_errors(wrong, first)
    assert (error.kind, error.files) == (kind, (file,))
    assert file in error.words
    assert error.evidence.chi2_corrected < error.evidence.chi2_stated
    corrected = correct_recordings(wrong, [error])
    np.testing.assert_array_equal(images(corrected)[file], right)
    assert condition_of(corrected) == condition_of(problem)


def test_a_faint_image_goes_with_a_clear_one_of_the_same_view(plain):
    """Of two mirrored walls one has much noise: by itself it would stay, beside the clear one it is turned back too."""
    problem, first = plain
    right = images(problem)
    faint = right[WALLS[1]] + FAINT_K * np.random.default_rng(4).normal(size=right[WALLS[1]].shape)
    noisy = replace_views(problem, [replace(v, sigma_K=FAINT_K) for v in problem.campaign.views if v.file == WALLS[1]])

    def found(clear, faint):
        wrong = with_images(noisy, {WALLS[0]: clear, WALLS[1]: faint})
        return {file for e in find_recording_errors(wrong, first) for file in e.files}

    clear_mirrored, faint_mirrored = right[WALLS[0]][..., ::-1], faint[..., ::-1]
    assert found(right[WALLS[0]], faint_mirrored) == set()
    assert found(clear_mirrored, faint_mirrored) == set(WALLS)
    assert found(clear_mirrored, faint) == {WALLS[0]}


def test_recordings_that_are_exchanged_go_to_the_condition_of_the_other(plain):
    problem, first = plain
    files = WALLS
    T = images(problem)
    wrong = with_images(problem, {files[0]: T[files[1]], files[1]: T[files[0]]})
    [error] = find_recording_errors(wrong, first)
    assert (error.kind, set(error.files)) == (ErrorKind.EXCHANGED, set(files))
    corrected = correct_recordings(wrong, [error])
    assert [condition_of(corrected)[file] for file in files] == [1, 0]
    assert [v.given for c in corrected.conditions for v in c.views] == [
        c.given for c in corrected.conditions for _ in c.views
    ]
    assert {v.file: v.given for v in corrected.campaign.views}[files[0]] == problem.conditions[1].given


def test_a_recording_of_another_condition_is_moved_there(plain):
    """Two walls of one condition, with noise of their own, of which one is filed under the other."""
    problem, first = plain
    T = images(problem)
    noise = 0.05 * np.random.default_rng(1).normal(size=T[WALLS[1]].shape)
    wrong = with_images(problem, {WALLS[0]: T[WALLS[1]] + noise})
    [error] = find_recording_errors(wrong, first)
    assert (error.kind, error.files) == (ErrorKind.OTHER_CONDITION, (WALLS[0],))
    assert condition_of(correct_recordings(wrong, [error]))[WALLS[0]] == 1


def test_a_copy_is_left_out_where_it_does_not_belong(plain):
    problem, first = plain
    wrong = with_images(problem, {WALLS[0]: images(problem)[WALLS[1]]})
    [error] = find_recording_errors(wrong, first)
    assert (error.kind, error.left_out) == (ErrorKind.DUPLICATE, (WALLS[0],))
    left = correct_recordings(wrong, [error])
    assert set(images(left)) == {WALLS[1], *WAKES}
    assert len(left.conditions) == 2  # the wake is still there


def test_two_recordings_that_bear_the_view_of_each_other_are_told_apart(plain):
    """Wall and wake cut to images of one shape, each with the pixels and the view of the other."""
    problem, _ = plain
    condition = problem.conditions[0]
    alone = replace(
        problem, conditions=(condition,), mesh_overrides=problem.mesh_overrides[:1],
        campaign=replace(problem.campaign, views=condition.views, forces=condition.forces),
    )  # fmt: skip
    alone = cropped(alone, {"sidewall": (0, 16, 40), "wake": (0, 16, 40)})
    wall, wake = alone.campaign.views
    first = predicted(alone)
    wrong = with_images(alone, {wall.file: images(alone)[wake.file], wake.file: images(alone)[wall.file]})
    [error] = find_recording_errors(wrong, first)
    assert error.kind == ErrorKind.OTHER_VIEW
    right = {v.file: v.recording for v in correct_recordings(wrong, [error]).campaign.views}
    assert right[wall.file].view == "wake"
    np.testing.assert_array_equal(right[wall.file].u, wake.recording.u)


def test_frames_that_cannot_be_of_their_condition_tell_where_they_belong(plain):
    """Two speeds: the schedule of the fast one has no moment for the last frames of the slow one."""
    slow, fast = plain[0].conditions
    fast = replace(
        fast, given=fast.given | {"schedule.speed": 3.0 * fast.given["schedule.speed"]}, views=tuple(map(faster, fast.views))
    )  # fmt: skip
    stated = replace(
        plain[0], conditions=(slow, fast), campaign=replace(plain[0].campaign, views=slow.views + fast.views)
    )
    assert find_misassigned_recordings(stated) == ()
    conditions = (replace(slow, views=fast.views), replace(fast, views=slow.views))
    found = find_misassigned_recordings(wrong := replace(stated, conditions=conditions))
    assert [e.kind for e in found] == [ErrorKind.EXCHANGED, ErrorKind.EXCHANGED]
    assert all(e.evidence.ln_bayes == np.inf for e in found)
    assert condition_of(correct_recordings(wrong, found)) == condition_of(stated)


def test_a_schedule_that_is_stated_wrongly_is_no_misfiled_recording(plain):
    """All recordings of a condition end after its schedule, which no recording of another one shares."""
    slow, other = plain[0].conditions
    short = replace(slow, given=slow.given | {"schedule.distance": 0.2})
    views = tuple(faster(v, 0.5) for v in other.views)
    longer = replace(other, given=other.given | {"schedule.distance": 0.6}, views=views)
    assert find_misassigned_recordings(replace(plain[0], conditions=(short, longer))) == ()


def faster(view, factor=3.0):
    return replace(view, recording=replace(view.recording, time=view.recording.time / factor))


# --- images that lie far off -------------------------------------------------------------------------------------
def seen_in_pose(problem, first, pose):
    """The problem with the first wall as it would be seen in a pose, without errors of its own but noise."""
    view = problem.conditions[0].views[0]
    task = replace(problem.make_tasks(problem.stated_model, all_derivatives(problem))[0], views=(view,))
    seen = predict_again(task, first[0].full_run, view, pose.apply_to(problem.stated_model, view.file))
    noise = np.random.default_rng(2).normal(size=seen.values.shape) * 0.05
    return with_images(problem, {view.file: seen.values + noise})


def test_an_image_turned_about_its_far_corner_is_registered(plain):
    """Three degrees and three pixels: Gauss-Newton steps from the stated pose end nowhere."""
    problem, first = plain
    turn, shift = -0.05, (3.0, -2.0)
    moved = seen_in_pose(problem, first, ImagePose(ImagePlacement(turn=turn), shift))
    found = register_images(moved, first)
    assert set(found.placements) == {WALLS[0]}
    assert found.placements[WALLS[0]].turn == pytest.approx(turn, abs=3e-3)
    assert found.shifts[WALLS[0]] == pytest.approx(shift, abs=1.2)


def test_an_image_near_its_stated_place_is_left_to_the_alignment_of_fits(plain):
    problem, first = plain
    near = seen_in_pose(problem, first, ImagePose(ImagePlacement(turn=5e-3), (0.2, 0.0)))
    view = near.conditions[0].views[0]
    assert register_image(near, view.recording, first[0].observables[view.file]) is None


# --- the rule --------------------------------------------------------------------------------------------------------
def test_a_hypothesis_needs_evidence_and_half_of_the_misfit():
    """ln of 150 to 1 (5.0), of one handling error in a hundred (4.6) and of ten hypotheses (2.3): 11.9."""
    assert HypothesisEvidence(12.0, 1.2, 1.09).is_clear(10)
    assert not HypothesisEvidence(11.8, 1.2, 1.09).is_clear(10)
    assert HypothesisEvidence(11.8, 1.2, 1.09).is_clear(1)
    assert not HypothesisEvidence(1000.0, 1.2, 1.11).is_clear(10)  # smooth misfit, counted pixel by pixel
    assert HypothesisEvidence(12.0, 0.99, 0.98).is_clear(10)  # both within the noise: the evidence alone decides


def test_flipped_recordings_keep_their_pixels_or_the_ends_of_the_block(plain):
    r = plain[0].conditions[0].views[0].recording
    in_place, about_block = flip_recording(r, (2,), LENGTH)
    np.testing.assert_array_equal(in_place.temperature, r.temperature[..., ::-1])
    np.testing.assert_allclose(in_place.u, r.u, atol=1e-12)
    np.testing.assert_allclose(about_block.u, (LENGTH - r.u)[::-1], atol=1e-12)
    back = flip_recording(about_block, (2,), LENGTH)[1]
    np.testing.assert_array_equal(back.temperature, r.temperature)
    assert len(flip_recording(r, (1,), LENGTH)) == 1
