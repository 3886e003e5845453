"""Errors of uncooled cameras in the independent laboratory have the statistics that they are told to have.

Bounds of statistics are five standard errors; everything else holds to rounding.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from reference import uncooled_camera as camera
from reference.laboratory import MeasurementProgramme, continuous_frames, write_campaign
from reference.uncooled_camera import IDEAL, CameraErrors, draw_errors, record_frames

SHAPE = (24, 60)
TIME = np.linspace(0.0, 30.0, 61)
SMALL = MeasurementProgramme(
    0.3,
    repetitions=1,
    columns=30,
    mesh=1.2,
    conditions=((1.5e5, 0.3),),
    pitch={"sidewall": 1e-3},
    **continuous_frames(8, 1),
)


def drawn(seed):
    return np.random.default_rng([seed, 1]), np.random.default_rng([seed, 2])


# --- lens -----------------------------------------------------------------------------------------------------
def test_an_ideal_camera_writes_what_it_is_given():
    T = np.random.default_rng(1).normal(25.0, 3.0, (5, *SHAPE))
    np.testing.assert_allclose(record_frames(T, TIME[:5], IDEAL, *drawn(1)), T, atol=1e-12)


@pytest.mark.parametrize("width", [5.0, 9.3, 15.0])
def test_the_halo_keeps_energy_and_has_the_width_that_it_is_told(width):
    kernel = camera.halo_kernel(width)
    place = np.arange(len(kernel)) - len(kernel) // 2
    assert kernel.sum() == pytest.approx(1.0, abs=1e-12)
    assert np.sqrt(kernel @ place**2) == pytest.approx(
        width, rel=2e-3
    )  # beyond four widths lie 1e-3 of the second moment
    T = np.zeros((1, 151, 151))
    T[0, 75, 75] = 1.0
    seen = camera.spread_halo(T, replace(IDEAL, halo=0.02, halo_width=width))
    assert seen.sum() == pytest.approx(1.0, abs=1e-12)
    assert seen[0, 75, 75] == pytest.approx(0.98 + 0.02 * kernel.max() ** 2)


@pytest.mark.parametrize("depth", [0.003, 0.01])
def test_vignetting_takes_its_share_in_the_farthest_corner_by_the_law_of_cos4(depth):
    gain = camera.draw_vignetting(SHAPE, replace(IDEAL, vignetting=depth), drawn(2)[0])
    corners = gain[[0, 0, -1, -1], [0, -1, 0, -1]]
    assert corners.min() == pytest.approx(1.0 - depth, rel=1e-12)
    assert gain.min() == corners.min()
    assert gain.max() <= 1.0
    assert gain.max() > 1.0 - 1e-3 * depth  # a pixel near the axis
    errors = replace(IDEAL, vignetting=depth, housing=30.0)
    for value in (30.0, 25.0):  # what is as warm as the housing has no contrast to lose
        seen = record_frames(np.full((1, *SHAPE), value), TIME[:1], errors, *drawn(2))[0]
        np.testing.assert_allclose(seen, 30.0 + gain * (value - 30.0), atol=1e-12)


def test_a_lamp_is_as_bright_at_its_middle_as_told_and_narcissus_is_a_ring():
    lamp = camera.draw_static_map((101, 101), replace(IDEAL, reflection=0.25, reflection_width=0.3), drawn(3)[0])
    assert lamp.max() == pytest.approx(0.25, rel=1e-3)
    ring = camera.draw_static_map((101, 101), replace(IDEAL, narcissus=0.03, reflection=0.0), drawn(3)[0])
    assert ring.min() == pytest.approx(-0.03, rel=0.02)  # a pixel may lie half a pitch off the ring
    assert ring[40:61, 40:61].max() > ring.min() / 2.0  # dark around the axis, not on it


# --- bolometers -----------------------------------------------------------------------------------------------
@pytest.mark.parametrize("length", [0.3, 2.0, -4.5])
def test_an_edge_is_late_by_speed_times_time_constant(length):
    """The mean delay of a first-order response is its time constant, so an edge is late by v tau along the motion."""
    u = np.arange(200.0)
    edge = np.clip((u - 99.5) / 4.0, 0.0, 1.0)
    late = camera.smear_motion(edge[None, None], length)[0, 0]
    assert (edge - late).sum() == pytest.approx(-length, rel=1e-9)
    steep = camera.smear_motion(u[None, None], length)[0, 0][60:140]
    np.testing.assert_allclose(steep - u[60:140], length, atol=1e-5 * abs(length))


def test_only_frames_in_which_the_scene_moves_are_smeared():
    T = np.random.default_rng(4).normal(25.0, 3.0, (2, *SHAPE))
    errors = replace(IDEAL, unfollowed=0.2, tau=0.01)
    seen = record_frames(T, TIME[:2], errors, *drawn(4), motion=np.array([0.0, 400.0]))
    np.testing.assert_allclose(seen[0], T[0], atol=1e-12)
    np.testing.assert_allclose(seen[1], camera.smear_motion(T[1], 0.8), atol=1e-12)
    assert np.abs(seen[1] - T[1]).max() > 0.1


# --- readout --------------------------------------------------------------------------------------------------
def test_noise_has_the_components_of_the_three_dimensional_model():
    """D'Agostino & Webb: variances by means over frames, rows and columns."""
    shape, frames = (120, 150), 60
    sizes = {"rows": 0.05, "columns": 0.03, "row_flicker": 0.02, "column_flicker": 0.01}
    errors = replace(IDEAL, **sizes)
    noise = camera.draw_readout_noise(np.arange(frames) * 0.1, shape, np.zeros(0), errors, *drawn(5))
    fixed = noise.mean(axis=0)
    found = {
        "rows": fixed.mean(axis=1), "columns": fixed.mean(axis=0),
        "row_flicker": (noise - fixed).mean(axis=2), "column_flicker": (noise - fixed).mean(axis=1),
    }  # fmt: skip
    for name, part in found.items():
        assert part.std() == pytest.approx(sizes[name], rel=5.0 / np.sqrt(2.0 * part.size) + 0.01), name
    left = noise - fixed - (noise - fixed).mean(axis=2, keepdims=True) - (noise - fixed).mean(axis=1, keepdims=True)
    assert np.abs(left - left.mean(axis=(1, 2), keepdims=True)).max() < 1e-12  # nothing of single pixels


def test_the_shutter_draws_a_part_of_fixed_rows_again():
    errors = replace(IDEAL, rows=1.0, renewed=0.3)
    time, events = np.arange(200.0), np.arange(0.5, 199.0)
    rows = camera.draw_readout_noise(time, (400, 2), events, errors, *drawn(6))[:, :, 0]
    assert rows.mean(axis=0).var() == pytest.approx(0.7, rel=5.0 * np.sqrt(2.0 / 400))
    assert rows.var(axis=0).mean() == pytest.approx(0.3, rel=5.0 * np.sqrt(2.0 / (400 * 200)) + 1.0 / 200)


def test_dead_pixels_are_as_many_as_told_and_stuck_at_a_number():
    shape = (200, 300)
    errors = replace(IDEAL, dead=0.002, clustered=0.5, flickering=0.0)
    where = camera.draw_dead_pixels(shape, errors, drawn(7)[0])
    assert 100 < where.sum() <= 120  # a few may coincide
    blocks = where[:-1, :-1] & where[1:, :-1] & where[:-1, 1:] & where[1:, 1:]
    assert blocks.sum() >= 14  # of fifteen
    seen = camera.spoil_pixels(np.random.default_rng(7).normal(25.0, 3.0, (6, *shape)), errors, *drawn(7))
    assert np.isfinite(seen).all()
    np.testing.assert_array_equal(np.ptp(seen, axis=0) == 0.0, where)


def test_dead_rows_and_columns_are_stuck_and_flickering_ones_come_and_go():
    T = np.random.default_rng(8).normal(25.0, 1.0, (40, *SHAPE))
    errors = replace(IDEAL, dead_rows=2, dead_columns=1, flickering=0.0)
    still = np.ptp(record_frames(T, TIME[:40], errors, *drawn(8)), axis=0) == 0.0
    assert (still.all(axis=1).sum(), still.all(axis=0).sum()) == (2, 1)
    assert still.sum() == 2 * SHAPE[1] + SHAPE[0] - 2
    off = record_frames(T, TIME[:40], replace(errors, flickering=1.0, dead_columns=0), *drawn(8)) - T
    states = off[:, (off != 0.0).any(axis=(0, 2))]
    assert states.shape[1] == 2
    for row in states.transpose(1, 0, 2):
        assert 0 < (row[:, 0] != 0.0).sum() < 40
        assert (np.ptp(row, axis=1) < 1e-12).all()  # the whole row at once
        assert len(np.unique(row[:, 0].round(9))) == 2


# --- offset and output ----------------------------------------------------------------------------------------
def test_the_offset_walks_between_shutter_events_and_jumps_at_them():
    """Var(t) = jump^2 + walk^2 (t - t_event); increments within an interval are walk^2 dt, independent of each other."""
    errors, count = replace(IDEAL, walk=0.02, jump=0.1), 1500
    events, rng = np.array([10.25, 20.25]), np.random.default_rng(9)
    paths = np.array([camera.draw_offset(TIME, events, errors, rng) for _ in range(count)])
    age = TIME - np.concatenate([[0.0], events])[np.searchsorted(events, TIME)]
    bound = 5.0 * np.sqrt(2.0 / count)
    np.testing.assert_allclose(paths.var(axis=0), 0.1**2 + 0.02**2 * age, rtol=bound)
    steps, dt = np.diff(paths, axis=1), TIME[1]
    within = np.diff(age) > 0.0
    np.testing.assert_allclose(steps[:, within].var(axis=0), 0.02**2 * dt, rtol=bound)
    assert (steps[:, ~within].var(axis=0) > 0.1**2).all()
    assert abs(np.corrcoef(paths[:, 5], paths[:, 30])[0, 1]) < 5.0 / np.sqrt(count)  # the shutter forgets


@pytest.mark.parametrize("tau", [np.inf, 8.0])
def test_drift_goes_from_nothing_to_its_size_as_its_law_says(tau):
    errors = replace(IDEAL, drift=0.2, drift_time=tau, unevenness=0.1)
    found = camera.draw_drift(TIME, (25, 61), errors, drawn(10)[0])
    assert np.abs(found[0]).max() == 0.0
    law = TIME / 30.0 if np.isinf(tau) else (1.0 - np.exp(-TIME / tau)) / (1.0 - np.exp(-30.0 / tau))
    np.testing.assert_allclose(found[:, 12, 30], 0.2 * law, atol=1e-12)
    assert 1.1 * 0.2 <= found[-1].max() <= 0.2 * (1.0 + 0.1 * np.sqrt(2.0))


def test_frames_after_a_shutter_event_repeat_the_last_one_before_it():
    T = np.random.default_rng(11).normal(25.0, 1.0, (len(TIME), *SHAPE))
    errors = replace(IDEAL, period=7.0, frozen=3, step=0.02, walk=0.02, jump=0.1)
    seen = record_frames(T, TIME, errors, *drawn(11))
    events = camera.draw_shutter_events(TIME, errors, drawn(11)[1])
    assert len(events) >= 3
    assert np.diff(events) == pytest.approx(7.0)
    same = (seen[1:] == seen[:-1]).all(axis=(1, 2))
    wanted = np.zeros(len(TIME) - 1, bool)
    for k in np.searchsorted(TIME, events):
        wanted[k - 1 : k + 2] = k > 0
    np.testing.assert_array_equal(same, wanted)


def test_values_are_whole_counts_within_the_range():
    T = np.random.default_rng(12).normal(25.0, 200.0, (4, *SHAPE))
    seen = record_frames(T, TIME[:4], replace(IDEAL, step=0.04, low=-20.0, high=100.0), *drawn(12))
    assert (seen.min(), seen.max()) == (-20.0, 100.0)
    np.testing.assert_allclose(seen / 0.04, np.round(seen / 0.04), atol=1e-6)
    inside = (T > -19.9) & (T < 99.9)
    assert np.abs(seen - T)[inside].max() <= 0.02 + 1e-9


# --- the camera as a whole ------------------------------------------------------------------------------------
def test_a_seed_gives_the_same_recording_and_the_device_the_same_pixels_in_another():
    T = np.random.default_rng(13).normal(25.0, 1.0, (len(TIME), *SHAPE))
    errors = replace(CameraErrors(), flickering=0.0, dead_rows=1)
    first, again = (record_frames(T, TIME, errors, *drawn(13)) for _ in range(2))
    np.testing.assert_array_equal(first, again)
    other = record_frames(T, TIME, errors, drawn(13)[0], np.random.default_rng(99))
    stuck = [np.ptp(seen, axis=0) == 0.0 for seen in (first, other)]
    np.testing.assert_array_equal(*stuck)
    np.testing.assert_array_equal(first[0][stuck[0]], other[0][stuck[0]])
    assert (first != other).mean() > 0.5


def test_random_cameras_keep_within_published_magnitudes():
    cameras = [draw_errors(np.random.default_rng(seed)) for seed in range(300)]
    spans = {
        "drift": (0.1, 0.3), "reflection": (0.1, 0.5), "vignetting": (0.003, 0.01), "rows": (0.02, 0.05),
        "columns": (0.02, 0.05), "row_flicker": (0.01, 0.02), "column_flicker": (0.01, 0.02), "dead": (5e-4, 2e-3),
        "tau": (0.008, 0.012), "halo": (0.01, 0.03), "halo_width": (5.0, 15.0), "step": (0.01, 0.04), "frozen": (1, 3),
        "dead_rows": (0, 2), "dead_columns": (0, 2),
    }  # fmt: skip
    for name, (low, high) in spans.items():
        values = np.abs([getattr(c, name) for c in cameras])
        assert low <= values.min() < low + 0.1 * (high - low) + 1e-12, name
        assert high - 0.1 * (high - low) - 1e-12 < values.max() <= high, name
    assert 0.35 < np.mean([c.unfollowed == 0.0 for c in cameras]) < 0.65


def test_the_laboratory_writes_recordings_of_uncooled_cameras(tmp_path):
    """The same campaign with and without: other images, the same clock and load cell, and numbers in every pixel."""
    import xarray as xr

    files, truths = [], []
    for name, uncooled in (("ideal", False), ("real", True)):
        truths.append(write_campaign(tmp_path / name, {}, 5, test=SMALL, views=("sidewall",), uncooled=uncooled))
        files.append(xr.load_dataset(tmp_path / name / "condition1_sidewall.nc", engine="h5netcdf"))
    ideal, real = files
    np.testing.assert_array_equal(ideal.time, real.time)
    assert len(real.time) == 8
    assert bool(np.isfinite(real.temperature).all())
    off = np.median(np.abs(real.temperature - ideal.temperature))
    assert 0.02 < off < 1.0
    assert "camera" not in truths[0]["recordings"]["condition1_sidewall.nc"]
    assert truths[1]["recordings"]["condition1_sidewall.nc"]["camera"]["tau"] >= 0.008
    mu = [(tmp_path / name / "condition1_mu.csv").read_text() for name in ("ideal", "real")]
    assert mu[0] == mu[1]
