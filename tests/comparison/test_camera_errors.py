"""Errors of real cameras: what screening finds in images, noise of lines, and columns that discovery marginalises."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from flashtemp.camera import recording as recordings
from flashtemp.camera.camera_classes import CAMERA_CLASSES
from flashtemp.camera.image_screening import (
    find_flickering_lines,
    find_outlying_pixels,
    find_shutter_events,
    screen_recording,
    temporal_noise,
)
from flashtemp.camera.quantisation import quantisation_step
from flashtemp.camera.recording import Recording
from flashtemp.comparison import campaign
from flashtemp.comparison.campaign import RecordingEntry
from flashtemp.comparison.compare import screen_campaign
from flashtemp.comparison.line_noise import MAX_RENEWALS, LineNoise
from flashtemp.comparison.noise import NoiseLevels, estimate_noise, raise_stated_noise
from flashtemp.comparison.noise_whitening import NoiseWhitening, whiten_residual
from flashtemp.discovery.estimation.camera_error_columns import (
    CAMERA_ERROR_SCALES,
    NO_CAMERA_ERRORS,
    USUAL_CAMERA_ERRORS,
    camera_columns,
    smooth_maps,
    wiener_modes,
)
from flashtemp.discovery.estimation.linear_gaussian import DataBlock, LinearSystem, gram_matrices
from flashtemp.discovery.estimation.nuisance_priors import is_camera_gain, scale_priors
from flashtemp.discovery.parameters import ParameterId, ParameterKind
from flashtemp.discovery.prediction.prediction import Observable
from flashtemp.errors import BadInput

SIGMA = 0.05  # K
ROOT = Path(__file__).parents[2]


def scene(frames=12, nv=24, nu=60, contrast=20.0):
    """Temperatures (frames, nv, nu) of a hot block with sharp edges that warms up: hottest next to its lower edge."""
    y, x, t = (np.arange(n) / n for n in (nv, nu, frames))
    inside = (y[:, None] > 0.2) & (x > 0.1) & (x < 0.9)
    shape = np.exp(-np.maximum(y - 0.2, 0.0) / 0.2)[:, None] * (1.0 + 0.5 * x) * inside
    return 20.0 + contrast * np.sqrt(t + 0.1)[:, None, None] * shape


def recorded(T, rng, noisy=True, **known):
    """A recording of temperatures with noise of single pixels, fixed and from frame to frame."""
    if noisy:
        T = T + rng.normal(0.0, SIGMA, T.shape) + rng.normal(0.0, 0.5 * SIGMA, T.shape[1:])
    n, nv, nu = T.shape
    return Recording(
        "sidewall", T, 0.5 * np.arange(n), np.ones(n, int), 1e-3 * np.arange(nu), 1e-3 * np.arange(nv), **known
    )


# --- screening ------------------------------------------------------------------------------------------
def test_clean_recordings_raise_less_than_one_false_alarm_in_a_hundred_fields():
    """Sharp edges, a hot line next to them, coarse digits and few frames are no defects."""
    rng = np.random.default_rng(1)
    masked = 0
    for k in range(100):
        made = recorded(scene(*(int(rng.integers(*ends)) for ends in ((5, 20), (12, 30), (20, 60)))), rng)
        if k % 3 == 0:
            made = replace(made, temperature=np.round(made.temperature, 1))
        found = screen_recording(made)
        masked += int(found.bad_pixels.sum()) + int(found.frozen.sum()) + len(found.shutter_events)
    assert masked <= 4  # of 600 families of tests at a rate of 0.01 each, 12 would be nine standard deviations


def test_computed_frames_are_returned_as_they_are():
    made = recorded(scene(), None, noisy=False)
    found = screen_recording(made)
    assert found.summary == ""
    assert found.apply_to(made) is made


def test_points_are_no_image():
    places = SimpleNamespace()
    made = SimpleNamespace(temperature=np.zeros((5, 1, 3)), places=places)
    assert screen_recording(made).summary == ""


def test_stuck_flickering_and_off_level_pixels_are_masked_and_no_others():
    rng = np.random.default_rng(2)
    T = scene(20) + rng.normal(0.0, SIGMA, (20, 24, 60))
    stuck, off, flickering = (10, 20), (15, 40), (18, 12)
    T[:, 10, 20] = 31.0
    T[:, 15, 40] += 3.0
    T[:, 18, 12] += 2.0 * (np.arange(20) % 3 == 0)
    T[:, 12:14, 30:32] = 25.0  # a cluster
    found = screen_recording(recorded(T, rng, noisy=False))
    assert found.stuck[stuck]
    assert found.stuck[12:14, 30:32].all()
    assert found.off_level[off]
    assert found.flickering[flickering]
    assert found.bad_pixels.sum() == 7
    masked = found.apply_to(recorded(T, rng, noisy=False)).temperature
    assert np.isnan(masked[:, found.bad_pixels]).all()
    assert np.isfinite(masked[:, ~found.bad_pixels]).all()


@pytest.mark.parametrize(("step", "is_certain"), [(0.03, True), (0.2, False)])
def test_a_cluster_of_stuck_pixels_is_told_from_coarse_digits_in_ten_frames(step, is_certain):
    """In steps of 0.03 K ten values are equal with a probability of 5e-6, in steps of 0.2 K half of all pixels have ten
    equal values."""
    rng = np.random.default_rng(22)
    T = 20.0 + rng.normal(0.0, SIGMA, (10, 24, 60))
    T[:, 12:14, 30:32] = rng.uniform(15.0, 40.0, (2, 2))
    found = screen_recording(recorded(np.round(T / step) * step, rng, noisy=False))
    assert found.stuck.sum() == (4 if is_certain else 0)


@pytest.mark.parametrize("kind", ["stuck", "off level", "flickering"])
@pytest.mark.parametrize("axis", [1, 2])
def test_a_bad_line_is_masked_whole_and_alone(kind, axis):
    rng = np.random.default_rng(3)
    T = scene(20) + rng.normal(0.0, SIGMA, (20, 24, 60))
    line = np.moveaxis(T, axis, 0)[16]
    if kind == "stuck":
        line[:] = 27.0
    else:
        line += 2.0 if kind == "off level" else 2.0 * (rng.random(20) < 0.3)[:, None]
    found = screen_recording(recorded(T, rng, noisy=False))
    assert (found.rows, found.columns) == (((16,), ()) if axis == 1 else ((), (16,)))


def test_a_real_hot_spot_and_a_real_hot_line_stay():
    """What grows with the heat, or is as wide as the optics make a point, is no defect, however narrow it is."""
    rng = np.random.default_rng(14)
    j, i = np.mgrid[:24, :60]
    spot = np.exp(-0.5 * ((j - 12) ** 2 + (i - 30) ** 2) / 0.75**2)
    line = np.exp(-0.5 * (j - 18) ** 2 / 0.75**2)
    T = scene(20) + 5.0 * (spot + line) * np.sqrt(np.arange(20) / 20)[:, None, None]
    assert not screen_recording(recorded(T, rng, psf_sigma_px=0.7)).bad_pixels.any()


def test_repeated_frames_are_left_out_and_shutter_events_found():
    rng = np.random.default_rng(5)
    T = 20.0 + rng.normal(0.0, SIGMA, (20, 24, 60))
    T[9:] += 0.4
    T[8] = T[7]
    made = recorded(T, rng, noisy=False)
    found = screen_recording(made)
    assert np.flatnonzero(found.frozen).tolist() == [8]
    assert found.shutter_events == (9,)
    masked = found.apply_to(made)
    assert masked.frames == 19
    assert masked.frozen_times == (made.time[8],)
    assert masked.frames_after_frozen == (8,)  # the frame numbered 9 before
    assert masked.select_frames(np.arange(4, 19)).frames_after_frozen == (4,)
    assert masked.select_frames(np.arange(8, 19)).frames_after_frozen == ()


def test_frozen_frames_tell_where_the_offset_may_jump():
    """The offset is free from the frame after them on; what heat makes of the jump one frame later is no second one."""
    rng = np.random.default_rng(7)
    r = recorded(scene(20), rng)
    residual = rng.normal(0.0, SIGMA, r.temperature.shape)
    frozen = replace(r, frozen_times=(float(r.time[9]) - 0.1,))
    levels = CAMERA_CLASSES[r.camera].level_K

    def starts(recording, residual):
        own = [c for p, c in camera_columns(recording, shown(recording), residual).items() if p.kind.value == "offset"]
        flat = [c.mean(axis=1) for c in own]
        return {int(np.flatnonzero(c)[0]) for c in flat if np.allclose(c[c != 0.0], levels)}

    assert starts(r, residual) == {0}
    assert starts(frozen, residual) == {0, 9}
    late = residual.copy()
    late[10:] += 0.4
    assert starts(frozen, late) == {0, 9}
    later = residual.copy()
    later[14:] += 0.4
    assert starts(frozen, later) == {0, 9, 14}


def test_noise_of_whole_frames_is_no_shutter_event():
    """A few millikelvins of every frame exceed the drift between two frames; a jump of the offset exceeds both."""
    rng = np.random.default_rng(21)
    T = 20.0 + rng.normal(0.0, SIGMA, (60, 24, 60)) + 0.01 * rng.normal(size=(60, 1, 1))
    made = replace(recorded(T, rng, noisy=False), time=0.02 * np.arange(60))
    assert len(find_shutter_events(T, made, SIGMA)) == 0
    T[30:] += 0.3
    assert find_shutter_events(T, made, SIGMA).tolist() == [30]


def test_heat_that_sets_in_is_no_shutter_event():
    rng = np.random.default_rng(6)
    T = np.where(np.arange(20)[:, None, None] < 10, 20.0, scene(20)) + rng.normal(0.0, SIGMA, (20, 24, 60))
    assert len(find_shutter_events(T, recorded(T, rng, noisy=False), SIGMA)) == 0


@pytest.mark.parametrize("step", [0.02, 0.04, 0.1])
def test_coarse_digits_do_not_bias_the_noise_nor_make_shutter_events(step):
    """The median of rounded differences is a multiple of the step: 50 mK in steps of 40 mK would be 42 or 84 mK."""
    rng = np.random.default_rng(8)
    smooth = np.linspace(20.0, 20.3, 60)
    true = np.hypot(SIGMA, step / np.sqrt(12.0))
    for _ in range(3):
        T = np.round((smooth + rng.normal(0.0, SIGMA, (40, 24, 60))) / step) * step
        made, residual = recorded(T, rng, noisy=False), T - smooth
        assert quantisation_step(T) == pytest.approx(step)
        assert temporal_noise(T) == pytest.approx(true, rel=0.03)
        found = estimate_noise(residual, None, None, None, residual, digit_step=step)
        assert found.white == pytest.approx(true, rel=0.03)
        narrow = np.where(np.arange(24)[:, None] < 2, residual, np.nan)  # of two rows no second difference remains
        assert estimate_noise(narrow, None, None, digit_step=step).white == pytest.approx(true, rel=0.1)
        assert max(found.lines.rows, found.lines.columns, found.lines.frame_rows) < 0.05 * SIGMA
        assert screen_recording(made).shutter_events == ()
        assert estimate_noise(residual, SIGMA, 0.0, None, residual, digit_step=step).white == SIGMA


def test_a_flickering_pixel_of_a_small_image_is_found():
    """An image of 9 x 11 pixels has some 35 that neighbours surround."""
    rng, false = np.random.default_rng(9), 0
    for _ in range(50):
        residual = rng.normal(0.0, SIGMA, (30, 9, 11))
        false += int(find_outlying_pixels(residual).sum())
        residual[:, 2, 0] += rng.normal(0.0, 12 * SIGMA, 30)
        residual[:, 4, 5] += rng.normal(0.0, 12 * SIGMA, 30)
        assert find_outlying_pixels(residual)[[2, 4], [0, 5]].all()
    assert false <= 2


def test_outlying_residuals_are_rejected_and_what_a_model_misses_is_not():
    rng = np.random.default_rng(7)
    left = rng.normal(0.0, SIGMA, (10, 30, 60)) + 0.5 * np.exp(-np.arange(60) / 3.0)  # a peak along one edge
    assert not find_outlying_pixels(left).any()
    left[:, 10, 20] += 0.5
    left[::3, 20, 40] += 1.0
    assert np.argwhere(find_outlying_pixels(left)).tolist() == [[10, 20], [20, 40]]


def test_a_pixel_that_flickers_at_an_edge_of_the_image_is_rejected_and_growing_heat_is_not():
    rng = np.random.default_rng(8)
    grown = np.linspace(0.0, 1.0, 12)[:, None, None]
    left = rng.normal(0.0, SIGMA, (12, 30, 60)) + grown * np.exp(-np.arange(60) / 3.0)  # along the edge
    left += grown * np.exp(-np.hypot(np.arange(30)[:, None] - 29.0, np.arange(60) - 59.0) / 2.0)  # in a corner
    left[:, :3] = np.nan  # the body ends inside the image
    assert not find_outlying_pixels(left).any()
    left[2:9:3, 12, 59] += 1.0
    left[1:9:3, 3, 40] -= 1.0
    assert np.argwhere(find_outlying_pixels(left)).tolist() == [[3, 40], [12, 59]]


# --- the class of a camera ------------------------------------------------------------------------------
def test_class_of_the_camera_is_uncooled_unless_said_and_kept_in_files(tmp_path):
    made = recorded(scene(5), np.random.default_rng(8))
    assert made.camera == "uncooled"
    for camera in CAMERA_CLASSES:
        replace(made, camera=camera).save(tmp_path / "a.nc")
        assert recordings.load(tmp_path / "a.nc").camera == camera
    with pytest.raises(BadInput, match="camera: 'warm'; give uncooled or cooled"):
        replace(made, camera="warm")


def test_campaign_states_the_class_of_a_camera(tmp_path):
    recorded(scene(5), np.random.default_rng(8)).save(tmp_path / "wall.nc")
    (tmp_path / "case.toml").write_text((ROOT / "cases" / "uniform_pressure" / "case.toml").read_text())
    written = 'case = "case.toml"\n[[recording]]\nfile = "wall.nc"\ncamera = '
    for camera in CAMERA_CLASSES:
        (tmp_path / "campaign.toml").write_text(written + f'"{camera}"\n')
        assert campaign.load(tmp_path).views[0].recording.camera == camera
    (tmp_path / "campaign.toml").write_text(written + '"coled"\n')
    with pytest.raises(BadInput, match="camera: 'coled'; give \"uncooled\" or \"cooled\"; did you mean 'cooled'"):
        campaign.load(tmp_path)


def test_a_campaign_is_screened_and_says_so_in_one_line_per_recording():
    rng = np.random.default_rng(15)
    clean, T = recorded(scene(10), rng), scene(10) + rng.normal(0.0, SIGMA, (10, 24, 60))
    T[:, 12] = 25.0
    views = (RecordingEntry("clean.nc", clean), RecordingEntry("row.nc", recorded(T, rng, noisy=False)))
    made, found = screen_campaign(campaign.Campaign("", ROOT, (), views, (), ROOT))
    assert found == {"row.nc": "left out 1 bad row"}
    assert made.views[0] is views[0]
    assert np.isnan(made.views[1].recording.temperature[:, 12]).all()


# --- noise of lines ---------------------------------------------------------------------------------------
def covariance(known, n: NoiseLevels):
    """Of all known values, dense."""
    k, j, i = np.nonzero(known)
    same, row, column = ((a[:, None] == a).astype(float) for a in (k, j, i))
    interval = np.searchsorted(n.renewals, k, side="right")
    near = (interval[:, None] == interval).astype(float)
    return (
        n.white**2 * np.eye(len(k)) + (n.pattern**2 + n.renewed_pattern**2 * near) * row * column
        + (n.lines.rows**2 + n.lines.renewed_rows**2 * near + n.lines.frame_rows**2 * same) * row
        + (n.lines.columns**2 + n.lines.renewed_columns**2 * near + n.lines.frame_columns**2 * same) * column
        + n.lines.frames**2 * same
    )  # fmt: skip


LINES = [
    LineNoise(0.04, 0.0, 0.02, 0.0), LineNoise(0.0, 0.04, 0.0, 0.02), LineNoise(0.04),
    LineNoise(0.04, 0.0, 0.02, 0.0, 0.03, 0.0), LineNoise(0.0, 0.04, 0.0, 0.02, 0.0, 0.03),
]  # fmt: skip


@pytest.mark.parametrize(("renewals", "renewed"), [((), 0.0), ((2,), 0.02), ((1, 4), 0.05)])
@pytest.mark.parametrize("lines", LINES)
def test_noise_of_rows_or_columns_is_whitened_exactly_with_pixels_missing(lines, renewals, renewed):
    """Also where shutter events renew a part of it."""
    known = np.ones((5, 4, 5), bool)
    known[:, 1, 2] = known[:, 3] = known[:, 0, 0] = False
    check_whitening(known, NoiseLevels(SIGMA, 0.03, (), None, lines, renewed, renewals))


@pytest.mark.parametrize("lines", [LineNoise(0.0, 0.0, 0.02, 0.03), LineNoise(0.0, 0.0, 0.02, 0.03, 0.0, 0.0, 0.01)])
def test_noise_of_frames_with_rows_and_columns_is_whitened_exactly(lines):
    check_whitening(np.ones((3, 4, 5), bool), NoiseLevels(SIGMA, 0.0, (), None, lines))


def check_whitening(known, n):
    count = int(known.sum())
    W = np.empty((count, count))
    for k, unit in enumerate(np.eye(count)):
        values = np.full(known.shape, np.nan)
        values[known] = unit
        W[:, k] = whiten_residual(values, n)[known]
        assert NoiseWhitening.from_known(np.isfinite(values), n).restore_residual(whiten_residual(values, n))[
            known
        ] == pytest.approx(unit, abs=1e-12)
    assert np.abs(W @ covariance(known, n) @ W.T - np.eye(count)).max() < 1e-12


@pytest.mark.parametrize("renewed_pattern", [0.0, 0.04])
def test_renewals_of_lines_are_found_with_their_size_and_chance_makes_none(renewed_pattern):
    """Heat that grows, and an error of the model in a tenth of the image, renew nothing."""
    rng, shape = np.random.default_rng(11), (24, 40, 60)
    heat = (
        np.linspace(0.0, 1.0, 24)[:, None, None] * np.exp(-np.arange(40.0) / 8.0)[:, None] * np.linspace(0.5, 1.0, 60)
    )
    heat[12:, :4] += 0.1

    def field(renewed):
        interval = np.searchsorted((9, 16), np.arange(24), side="right")
        lines = (renewed * rng.normal(size=(3, *size))[interval] for size in ((40, 1), (1, 60)))
        pattern = (renewed > 0) * renewed_pattern * rng.normal(size=(3, 40, 60))[interval]
        flicker = 0.01 * rng.normal(size=(24, 40, 1))
        return heat + rng.normal(0.0, SIGMA, shape) + 0.03 * rng.normal(size=(40, 1)) + flicker + sum(lines) + pattern

    for _ in range(20):
        steady = field(0.0)
        assert estimate_noise(steady, SIGMA, 0.0, None, steady).renewals == ()
    changed = field(0.03)
    found = estimate_noise(changed, SIGMA, 0.0, None, changed)
    assert found.renewals == (9, 16)
    assert (found.lines.renewed_rows, found.lines.renewed_columns) == pytest.approx((0.03, 0.03), rel=0.5)
    assert found.renewed_pattern == pytest.approx(renewed_pattern, abs=0.1 * 0.04)
    assert estimate_noise(changed, SIGMA, 0.0).renewals == ()  # not searched for in a residual of no fit
    assert estimate_noise(changed, SIGMA, 0.0, None, changed, (3,)).renewals == (3, 9, 16)


def test_lines_that_drift_are_cut_into_a_few_parts():
    rng = np.random.default_rng(13)
    drift = np.cumsum(rng.normal(0.0, 0.02, (80, 30, 1)), axis=0)
    changed = drift + rng.normal(0.0, SIGMA, (80, 30, 40))
    found = estimate_noise(changed, SIGMA, 0.0, None, changed)
    assert 1 < len(found.renewals) <= MAX_RENEWALS
    assert np.diff(found.renewals).min() >= 2


@pytest.mark.parametrize("axis", [1, 2])
def test_renewals_of_rows_alone_or_of_columns_alone_are_found_where_they_are(axis):
    """However large they are, and with many more lines along the other axis."""
    rng = np.random.default_rng(12)
    shape = (40, 24, 72) if axis == 2 else (40, 72, 24)
    size = [1, *shape[1:]]
    size[axis] = 1
    for level in (0.03, 0.3):
        renewed = level * rng.normal(size=size) * (np.arange(40) >= 17)[:, None, None]
        changed = rng.normal(0.0, SIGMA, shape) + renewed
        found = estimate_noise(changed, SIGMA, 0.0, None, changed)
        assert found.renewals == (17,)
        sizes = (found.lines.renewed_rows, found.lines.renewed_columns)
        assert sizes[2 - axis] == pytest.approx(level / np.sqrt(2.0), rel=0.6)
        assert sizes[axis - 1] < 0.01


def test_noise_of_means_of_frames_is_that_of_a_frame():
    rng, counts = np.random.default_rng(15), np.repeat([1, 5, 20], [10, 10, 20])
    root = np.sqrt(counts)[:, None, None]
    changed = (SIGMA * rng.normal(size=(40, 60, 80)) + 0.3 * SIGMA * rng.normal(size=(40, 60, 1))) / root
    changed += 0.1 * SIGMA * rng.normal(size=(60, 1))
    changed += 0.2 * SIGMA * rng.normal(size=(1, 80)) * (np.arange(40)[:, None, None] >= 25)
    found = estimate_noise(changed, None, None, tuple(counts), changed)
    assert found.renewals == (25,)
    assert found.white == pytest.approx(SIGMA, rel=0.05)
    assert found.pattern < 0.05 * SIGMA
    sizes = np.array([found.lines.frame_rows, found.lines.rows, found.lines.renewed_columns]) / SIGMA
    assert sizes == pytest.approx([0.3, 0.1, 0.2 / np.sqrt(2.0)], rel=0.6)


def test_pixels_without_values_in_some_frames_renew_no_pattern():
    rng = np.random.default_rng(13)
    changed = rng.normal(0.0, SIGMA, (60, 40, 60)) + 0.3 * rng.normal(size=(40, 1)) * (
        np.arange(60)[:, None, None] >= 30
    )
    changed[3:30][:, rng.random((40, 60)) < 0.5] = np.nan
    found = estimate_noise(changed, SIGMA, 0.0, None, changed)
    assert found.renewals == (30,)
    assert found.renewed_pattern == 0.0


def test_levels_of_noise_contain_no_part_of_each_other():
    """White noise does not contain that of whole frames; the constant pattern not that which the shutter renews."""
    rng, after = np.random.default_rng(14), np.arange(60)[:, None, None] >= 30
    white = rng.normal(0.0, SIGMA, (60, 40, 60))
    frames = white + 4.0 * SIGMA * rng.normal(size=(60, 1, 1))
    found = estimate_noise(frames, None, 0.0, None, frames)
    assert found.white == pytest.approx(SIGMA, rel=0.05)
    assert found.lines.frames == pytest.approx(4.0 * SIGMA, rel=0.5)
    profile = frames[:, :1]
    assert estimate_noise(profile, None, 0.0, None, profile).white == pytest.approx(SIGMA, rel=0.1)
    patterns = [SIGMA * (rng.normal(size=(40, 60)) + rng.normal(size=(40, 1))) for _ in range(2)]
    renewed = white + np.where(after, *patterns)
    found = estimate_noise(renewed, None, None, None, renewed)
    assert found.renewals == (30,)
    assert found.renewed_pattern == pytest.approx(SIGMA, rel=0.2)
    assert found.pattern < 0.4 * SIGMA


def test_components_of_the_three_dimensional_noise_model_are_estimated_and_chance_is_none():
    rng = np.random.default_rng(9)
    shape = (20, 40, 60)

    def field(rows, columns, frame_rows, frame_columns):
        n, nv, nu = shape
        sizes = ((rows, (nv, 1)), (columns, (nu,)), (frame_rows, (n, nv, 1)), (frame_columns, (n, 1, nu)))
        return rng.normal(0.0, SIGMA, shape) + sum(s * rng.normal(size=where) for s, where in sizes)

    assert all(estimate_noise(field(0, 0, 0, 0), SIGMA, None).lines.is_none for _ in range(20))
    found = estimate_noise(field(0.04, 0.03, 0.02, 0.02), SIGMA, None).lines
    assert found.frames == 0.0
    sizes = [found.rows, found.columns, found.frame_rows, found.frame_columns]
    # a MAD of 38 rows scatters by 1/sqrt(2 * 0.37 * 38 / 2) = 27 %, of 20 times as many values by 6 %
    assert sizes[:2] == pytest.approx([0.04, 0.03], rel=0.8)
    assert sizes[2:] == pytest.approx([0.02, 0.02], rel=0.2)


def test_noise_of_whole_frames_is_estimated_and_neither_drift_nor_a_jump_is_taken_for_it():
    rng = np.random.default_rng(10)
    drift = np.linspace(0.0, 0.3, 40) ** 2 + 0.2 * (np.arange(40) > 17)
    plain = drift[:, None, None] + rng.normal(0.0, SIGMA, (40, 30, 50))
    assert estimate_noise(plain, SIGMA, 0.0).lines.frames == 0.0
    found = [estimate_noise(plain + 0.01 * rng.normal(size=(40, 1, 1)), SIGMA, 0.0).lines.frames for _ in range(10)]
    assert np.mean(found) == pytest.approx(0.01, rel=0.3)
    heat = 8.0 * np.sqrt(np.arange(40.0) / 40.0)  # of many pixels, so that the mean has hardly any noise
    assert estimate_noise(heat[:, None, None] + rng.normal(0.0, SIGMA, (40, 120, 160)), SIGMA, 0.0).lines.frames == 0.0


def test_stated_noise_is_raised_to_what_frames_show_and_by_coarse_digits():
    rng = np.random.default_rng(16)
    values = rng.normal(20.0, SIGMA, (20, 24, 60))
    made = recorded(values, rng, noisy=False)
    stated = NoiseLevels(SIGMA, 0.0)
    assert raise_stated_noise(stated, made, values - 20.0) == stated
    assert raise_stated_noise(replace(stated, white=0.03), made, values - 20.0).white == pytest.approx(SIGMA, rel=0.05)
    coarse = replace(made, temperature=np.round(values / 0.1) * 0.1)
    found = raise_stated_noise(stated, coarse, coarse.temperature - 20.0)
    assert found.white == pytest.approx(np.hypot(SIGMA, 0.1 / np.sqrt(12.0)), rel=1e-3)


# --- columns ----------------------------------------------------------------------------------------------
def shown(r: Recording) -> Observable:
    return Observable(r.temperature, np.ones(r.temperature.shape[1:], bool), {})


def test_modes_of_the_offset_add_up_to_the_covariance_of_a_wiener_process():
    time = np.array([0.0, 0.3, 1.0, 1.1, 4.0])
    modes = wiener_modes(time, 5)
    assert modes.T @ modes == pytest.approx(np.minimum.outer(time, time), abs=1e-12)


def test_vignetting_and_lamps_lie_in_the_smooth_maps():
    """cos^4 of the angle to any axis is matched to a thousandth of what it takes."""
    r = recorded(scene(4), np.random.default_rng(10))
    maps = np.stack([shape.ravel() for _, shape in smooth_maps(r, 4)], axis=1)
    j, i = np.mgrid[:24, :60]
    away = np.hypot(i - 33.0, j - 10.0)
    lost = 1.0 - np.cos(np.arctan(0.07 * away / away.max())) ** 4
    rest = lost.ravel() - maps @ np.linalg.lstsq(maps, lost.ravel(), rcond=None)[0]
    assert np.abs(rest).max() < 1e-3 * lost.max()


@pytest.mark.parametrize("kind", [ParameterKind.OFFSET, ParameterKind.STATIC, ParameterKind.MAP, ParameterKind.OPTICS])
def test_an_error_that_the_model_spans_is_absorbed_and_only_at_a_size_that_is_not_none(kind):
    """Against dense algebra: the evidence of the columns is that of their covariance."""
    rng = np.random.default_rng(11)
    r = recorded(scene(5, 8, 12), rng, noisy=False)
    own = camera_columns(r, shown(r), np.zeros(r.temperature.shape))
    names = [p for p in own if p.kind is kind]
    F = np.stack([own[p].ravel() for p in names], axis=1) / SIGMA
    size = 0.003 if kind is ParameterKind.MAP else 1.0
    error = F @ (size * rng.normal(size=F.shape[1]))
    block = DataBlock("a", 0, False, error, np.zeros((len(error), 0), np.float32),
                  tuple((p.with_scope(0, "a"), k) for k, p in enumerate(names)), F, gram_matrices([F])[0])  # fmt: skip
    system = LinearSystem([block])
    priors = {p: (0.0, size) for p in system.names}
    found = system.solve(priors)
    dense = np.eye(len(error)) + size**2 * F.astype(float) @ F.T.astype(float)
    free = system.solve({p: (0.0, 1e4 * size) for p in system.names})
    assert system.block_chi2(free)[0] < 1e-6 * float(error @ error)
    expected = -0.5 * (error @ np.linalg.solve(dense, error) + np.linalg.slogdet(dense)[1])
    assert found.ln_evidence == pytest.approx(expected, rel=1e-6)
    assert system.evidence_function(priors)(np.full(len(names), size)) == pytest.approx(expected, rel=1e-6)
    assert system.evidence_function(priors)(np.zeros(len(names))) == pytest.approx(-0.5 * error @ error)


def test_evidence_by_elimination_equals_that_of_the_whole_matrix():
    rng = np.random.default_rng(12)
    names = [ParameterId(ParameterKind.KEY, name="k"), *(ParameterId(ParameterKind.MAP, (m, 0)) for m in (1, 2, 3))]
    blocks = []
    for number, file in enumerate("abc"):
        C = rng.normal(size=(40, 4))
        own = tuple((p.with_scope(number, file), k) for k, p in enumerate(names))
        blocks.append(DataBlock(file, number, False, rng.normal(size=40), C, own, np.zeros((40, 0)), np.zeros((0, 0))))
    system = LinearSystem(blocks)
    priors = {p: (0.1, 0.5) for p in system.names}
    sd = np.array([priors[p][1] for p in system.known_columns(priors)])
    assert system.evidence_function(priors)(sd) == pytest.approx(system.solve(priors).ln_evidence, rel=1e-12)


def test_an_ideal_camera_has_the_priors_that_it_had():
    """None of a family leaves the slight gain map of every camera, and nothing else that only real cameras have."""
    file = {"file": "a"}
    names = [
        ParameterId(kind, (k,), **file)
        for kind in (ParameterKind.OFFSET, ParameterKind.STATIC, ParameterKind.OPTICS)
        for k in (1, 2)
    ]
    low, high = ParameterId(ParameterKind.MAP, (1, 1), **file), ParameterId(ParameterKind.MAP, (1, 1, 1), **file)
    priors = dict.fromkeys([*names, low, high], (0.0, 1.0))
    assert not is_camera_gain(low)
    assert is_camera_gain(high)
    assert scale_priors(priors, 1.0, 1e-3, NO_CAMERA_ERRORS) == {low: (0.0, 1.0)}
    assert scale_priors(priors, 1.0, 1e-3, USUAL_CAMERA_ERRORS).keys() == priors.keys()
    assert all(sizes[0] == 0.0 for sizes in CAMERA_ERROR_SCALES.values())


def _residual(rng, heat=0.0, flicker=0.0, slow=0.0):
    """Residuals (frames, nv, nu) K of 0.05 K noise: heat that comes and goes in row 4, a column 18 that flickers."""
    left = 0.05 * rng.normal(size=(40, 30, 20))
    at = rng.integers(0, 2, size=40)[:, None]
    left[:, 4] += heat * at
    left[:, 5] += 0.4 * heat * at  # optics spread it
    left[:, :, 18] += flicker * rng.integers(0, 2, size=40)[:, None]
    left[:, 10] += slow * np.sin(np.arange(40) / 8.0)[:, None]
    return left


@pytest.mark.parametrize("seed", range(5))
def test_a_line_that_flickers_is_found_at_the_edge_of_an_image_too(seed):
    left = _residual(np.random.default_rng(seed), flicker=1.4)
    assert find_flickering_lines(left, 2, 0.05) == (18,)
    assert find_flickering_lines(left, 1, 0.05) == ()


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("missed", [{}, {"heat": 1.4}, {"slow": 4.0}], ids=["noise", "heat", "slow"])
def test_what_a_model_misses_is_no_line_that_flickers(seed, missed):
    left = _residual(np.random.default_rng(seed), **missed)
    assert find_flickering_lines(left, 1, 0.05) == () == find_flickering_lines(left, 2, 0.05)
