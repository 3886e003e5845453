"""Thermocouples in the block: a little off their places, slow, with gains of their own; by modes and a convolution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SLIDING = tuple((np.arange(60) + 1.0) / 60)  # shares of a stretch at which the block's modes are asked for
RESTING = 10  # and every so many steps of a wait; between them temperatures are linear in time
AGES, WEIGHTS = np.polynomial.legendre.leggauss(24)


@dataclass(frozen=True)
class ThermocoupleSet:
    """Beads (n, 3): x, z (m) and time constant (s), `stated` and `actual`; their `gains`; and their `stated_errors`."""

    stated: np.ndarray
    actual: np.ndarray
    gains: np.ndarray
    stated_errors: str

    @classmethod
    def draw(cls, test, draw):
        """Of the beads of a programme; every one keeps its faults in all conditions."""
        e = draw.errors
        stated = np.array([(a * test.pair.length, b * test.pair.height, test.lag) for a, b in test.sensors]).reshape(
            -1, 3
        )
        off = np.array([[draw(e.place), draw(e.place), draw(e.lag)] for _ in test.sensors]).reshape(-1, 3)
        stated_errors = f"place_sigma_m = {e.place}, lag_sigma_s = {e.lag}, gain_sigma = {e.sensor}"
        return cls(stated, stated + off, np.array([1.0 + draw(e.sensor) for _ in test.sensors]), stated_errors)

    def campaign_lines(self, file, given, sigma):
        """Lines of campaign.toml."""
        points = [
            f'    {{ name = "bead {"abcdefgh"[n]}", x = {x:.6g}, z = {z:.6g}, lag_s = {lag:.6g}, {self.stated_errors} }},'
            for n, (x, z, lag) in enumerate(self.stated)
        ]
        head = ["", "[[recording]]", 'view = "points"', f'file = "{file}"', given, f"sigma_K = {sigma}", "points = ["]
        return [*head, *points, "]"]

    def table(self, condition, moments, draw, camera_clock, air, interval=0.5):
        """Rows (readings, 1 + n): the clock's time (s), then degC."""
        pair, t = condition.pair, np.array([0.0, *(m.t for m in moments)])
        reading_times = np.arange(interval, t[-1], interval)
        rows = [[camera_clock(s, 1) for s in reading_times]]
        for (x, z, time_constant), gain in zip(self.actual, self.gains, strict=True):
            up, along = pair.evaluate_height_modes([z])[0], pair.evaluate_length_modes(np.array([x]))[0]
            rise = np.array([0.0, *(up @ m.state.T @ along for m in moments)])
            rows.append(air + gain * _lagged_rise(t, rise, reading_times, max(time_constant, 1e-3)))
        noise = condition.test.netd * draw.rng.normal(size=(len(reading_times), len(self.actual)))
        return np.column_stack(rows) + np.column_stack([np.zeros(len(reading_times)), noise])


def _lagged_rise(t, rise, reading_times, time_constant):
    """Mean of what has been, weighed by exp(-age / time_constant), at the times `reading_times`."""
    ages = 6.0 * time_constant * (AGES + 1.0)
    weight = WEIGHTS * np.exp(-ages / time_constant)
    return np.interp(reading_times[:, None] - ages, t, rise, left=0.0) @ (weight / weight.sum())
