"""Thermocouples in the block: a little off their places, slow, with gains of their own; by modes and a convolution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SLIDING = tuple((np.arange(60) + 1.0) / 60)  # shares of a stretch at which the block's modes are asked for
RESTING = 10  # and every so many steps of a wait; between them temperatures are linear in time
AGES, WEIGHTS = np.polynomial.legendre.leggauss(24)


@dataclass(frozen=True)
class Wired:
    """Beads (n, 3): x, z (m) and time constant (s), as said and as they are; their `gains`; and how well that is known."""

    said: np.ndarray
    are: np.ndarray
    gains: np.ndarray
    known: str

    @classmethod
    def drawn(cls, test, drawn):
        """Of the beads of a programme; every one keeps its faults in all conditions."""
        e = drawn.errors
        said = np.array([(a * test.pair.length, b * test.pair.height, test.lag) for a, b in test.beads]).reshape(-1, 3)
        off = np.array([[drawn(e.place), drawn(e.place), drawn(e.lag)] for _ in test.beads]).reshape(-1, 3)
        known = f"place_sigma_m = {e.place}, lag_sigma_s = {e.lag}, gain_sigma = {e.sensor}"
        return cls(said, said + off, np.array([1.0 + drawn(e.sensor) for _ in test.beads]), known)

    def told(self, file, given, sigma):
        """Lines of campaign.toml."""
        points = [
            f'    {{ name = "bead {"abcdefgh"[n]}", x = {x:.6g}, z = {z:.6g}, lag_s = {lag:.6g}, {self.known} }},'
            for n, (x, z, lag) in enumerate(self.said)
        ]
        head = ["", "[[recording]]", 'view = "points"', f'file = "{file}"', given, f"sigma_K = {sigma}", "points = ["]
        return [*head, *points, "]"]

    def table(self, world, moments, drawn, late, air, interval=0.5):
        """Rows (readings, 1 + n): the clock's time (s), then degC."""
        pair, t = world.pair, np.array([0.0, *(m.t for m in moments)])
        read = np.arange(interval, t[-1], interval)
        rows = [[late(s, 1) for s in read]]
        for (x, z, slow), gain in zip(self.are, self.gains, strict=True):
            up, along = pair.above([z])[0], pair.along(np.array([x]))[0]
            rise = np.array([0.0, *(up @ m.state.T @ along for m in moments)])
            rows.append(air + gain * _slow(t, rise, read, max(slow, 1e-3)))
        noise = world.test.netd * drawn.rng.normal(size=(len(read), len(self.are)))
        return np.column_stack(rows) + np.column_stack([np.zeros(len(read)), noise])


def _slow(t, rise, read, slow):
    """Mean of what has been, weighed by exp(-age / slow), at the times `read`."""
    ages = 6.0 * slow * (AGES + 1.0)
    weight = WEIGHTS * np.exp(-ages / slow)
    return np.interp(read[:, None] - ages, t, rise, left=0.0) @ (weight / weight.sum())
