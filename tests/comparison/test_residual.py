"""Noise, whitening and structure of residuals, on residuals of which everything is known."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from flashtemp.comparison.frame_means import AveragedFrames
from flashtemp.comparison.noise import (
    NoiseLevels,
    estimate_noise,
    lag1_autocorrelation,
    largest_structured_residual,
)
from flashtemp.comparison.noise_whitening import NoiseWhitening, whiten_residual
from flashtemp.discovery.prediction.frame_averaging import group_frames

SHAPE = (12, 30, 80)


def residual(seed, white=0.05, pattern=0.03, shape=SHAPE, masked=0.0):
    rng = np.random.default_rng(seed)
    out = white * rng.normal(size=shape) + pattern * rng.normal(size=shape[1:])
    out[:, rng.random(shape[1:]) < masked] = np.nan
    out[:, :3] = np.nan  # a rim
    return out


@pytest.mark.parametrize("pattern", [0.0, 0.03, 0.1])
def test_noise_is_estimated_from_the_data(pattern):
    found = estimate_noise(residual(1, pattern=pattern, masked=0.01), None, None)
    assert found.white == pytest.approx(0.05, rel=0.03)
    assert found.pattern == pytest.approx(pattern, abs=0.006)
    assert found.estimated == ("white", "pattern")


def test_smooth_structure_counts_for_neither_noise():
    wave = 2.0 * np.sin(np.linspace(0, 6, 80)) * np.cos(np.linspace(0, 3, 30))[:, None]
    found = estimate_noise(residual(2) + wave, None, None)
    assert found.white == pytest.approx(0.05, rel=0.03)
    assert found.pattern == pytest.approx(0.03, rel=0.15)


def test_given_noise_is_kept():
    assert estimate_noise(residual(3), 0.07, 0.02) == NoiseLevels(0.07, 0.02, ())


def test_whitened_residuals_are_independent_and_of_unit_variance():
    found = NoiseLevels(0.05, 0.03)
    w = np.stack([whiten_residual(residual(s), found)[:, 3:] for s in range(8)])
    assert np.mean(w**2) == pytest.approx(1.0, abs=4 * np.sqrt(2 / w.size))
    for a, b in ((0, 1), (3, 11)):  # frames of one pixel share its pattern before, nothing after
        raw = np.stack([residual(s)[:, 3:] for s in range(8)])
        assert abs(np.mean(w[:, a] * w[:, b])) < 4 / np.sqrt(w[:, a].size)
        assert np.mean(raw[:, a] * raw[:, b]) / 0.03**2 == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("averaged", [None, (1, 2, 5, 20, 50, 50, 7, 3, 9, 4, 30, 2)])
def test_whitening_can_be_undone(averaged):
    found, there = NoiseLevels(0.05, 0.03, (), averaged), residual(5, masked=0.1)
    there[3, 10, 20] = np.nan
    np.testing.assert_allclose(
        NoiseWhitening.from_known(np.isfinite(there), found).restore_residual(whiten_residual(there, found)),
        there,
        rtol=1e-10,
        atol=1e-14,
    )


@pytest.mark.parametrize("pattern", [0.0, 0.03])
def test_means_of_frames_say_as_much_as_the_frames(pattern):
    """Of what is even within the groups: products of whitened columns, and the noise estimated."""
    rng, counts = np.random.default_rng(3), (1, 2, 5, 20, 50, 50, 7)
    starts = np.append(0, np.cumsum(counts)[:-1])
    even = np.repeat(rng.normal(size=(len(counts), 60, 80)), counts, axis=0)
    frames = rng.normal(0, 0.05, even.shape) + rng.normal(0, pattern, even.shape[1:])

    def means(images):
        return np.add.reduceat(images, starts) / np.array(counts)[:, None, None]

    raw, short = NoiseLevels(0.05, pattern), NoiseLevels(0.05, pattern, (), counts)
    assert estimate_noise(means(frames), None, None, counts).white == pytest.approx(0.05, rel=0.05)
    for one, other in ((even, even), (even, frames)):
        whole = (whiten_residual(one, raw) * whiten_residual(other, raw)).sum()
        assert (whiten_residual(means(one), short) * whiten_residual(means(other), short)).sum() == pytest.approx(
            whole, rel=1e-12
        )


def test_frames_are_taken_together_where_little_changes():
    """The root of the time since an event is, in the mean over a group, that of its middle; no group holds an event."""
    time = np.arange(0.0, 30.0, 0.01)
    starts = group_frames(time, np.ones(len(time), int), np.array([0.0, 20.0]), 30.0)
    counts = np.diff([*starts, len(time)])
    assert len(starts) < 0.04 * len(time)
    mine = np.split(time, starts[1:])
    assert not any(m[0] < 20.0 <= m[-1] for m in mine)
    middle, part = np.array([m.mean() for m in mine]), np.array([int(m[0] >= 20.0) for m in mine])
    means = AveragedFrames(tuple(counts), tuple(m.std() for m in mine), tuple(part))
    for rises in (np.sqrt, lambda t: np.sqrt(t) * np.exp(-t / 20.0)):
        frames = rises(time - 20.0 * (time >= 20.0))
        true = np.array([f.mean() for f in np.split(frames, starts[1:])])
        told = means.time_mean(middle, rises(middle - 20.0 * part))
        np.testing.assert_allclose(told, true, rtol=1e-4)


def test_correlation_of_white_noise_is_within_its_error():
    z = np.array(
        [
            [lag1_autocorrelation(whiten_residual(residual(s), NoiseLevels(0.05, 0.03)), a)[1] for a in (0, 1, 2)]
            for s in range(60)
        ]
    )
    assert np.abs(z).max() < 4.5
    assert np.std(z) == pytest.approx(1.0, abs=0.2)


def test_correlation_finds_structure():
    wave = 0.05 * np.sin(np.linspace(0, 12, 80))
    w = whiten_residual(residual(5) + wave, NoiseLevels(0.05, 0.03))
    assert lag1_autocorrelation(w, 2)[1] > 10
    assert lag1_autocorrelation(w[:, :, :2], 2)[1] == pytest.approx(0.0, abs=8)


def test_the_largest_structure_is_found_where_it_is():
    values = residual(6)
    values[7, 10:15, 40:45] += 0.4
    values[2, 20, 20] += 3.0  # a single hot pixel of one frame is less than a spot of 5 x 5
    where = SimpleNamespace(u=np.arange(80.0), v=np.arange(30.0), time=np.arange(12.0), repetition=np.full(12, 3))
    place = largest_structured_residual(values, NoiseLevels(0.05, 0.03), where)
    assert (place.u, place.v, place.time, place.repetition) == (42.0, 12.0, 7.0, 3)
    assert pytest.approx(0.4, abs=0.05) == place.K
    assert place.sigma > 20


def test_nothing_to_compare_is_no_structure():
    empty = np.full(SHAPE, np.nan)
    assert largest_structured_residual(empty, NoiseLevels(0.05, 0.0), None) is None
    assert lag1_autocorrelation(empty, 0) == (0.0, 0.0)
