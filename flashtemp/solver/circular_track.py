"""The circular track remembers: what each stretch of road left, and how it looks when it returns.

Road that leaves the window is kept as a few columns along the track, each as amplitudes of the
depth operator's eigenmodes, so that its cooling until the next pass is exact at any later time.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import eigh_tridiagonal


@dataclass
class Track:
    """Columns of road behind the block, by their place on the track (m, unwrapped).

    `lap` track length (m), `film` surface heat-transfer coefficient W/m2K, `lateral` time constant
    (s) with which a lane mixes with its surroundings (theory 1.5).
    """

    lap: float
    dz: np.ndarray  # deepest road cell first, m
    conductivity: float
    volumetric_capacity: float
    film: float
    lateral: float
    planes: int = 1  # across the direction of sliding
    place: list = field(default_factory=list)
    time: list = field(default_factory=list)
    mean: list = field(default_factory=list)  # modal amplitudes of the mean over lanes and gaps
    lane: list = field(default_factory=list)  # of the lanes' excess over that mean

    def __post_init__(self):
        half = self.dz / (2 * self.conductivity)
        g = 1.0 / (half[1:] + half[:-1])
        capacity = self.volumetric_capacity * self.dz
        diagonal = np.zeros(len(self.dz))
        diagonal[1:] += g
        diagonal[:-1] += g
        if self.film > 0:
            diagonal[-1] += 1.0 / (half[-1] + 1.0 / self.film)
        self.root = np.sqrt(capacity)
        self.rates, self.modes = eigh_tridiagonal(diagonal / capacity, -g / (self.root[1:] * self.root[:-1]))
        self.rates = np.maximum(self.rates, 0.0)

    def leave(self, t: float, place: float, column, entering, share: float) -> None:
        """Keep a column of rises that leaves at time t; lanes cover `share` of the width.

        `column` (n_road n_across,), deepest cells first.
        """
        excess = column - entering
        self.place.append(place)
        self.time.append(t)
        self.mean.append(self._amplitudes(entering + share * excess))
        self.lane.append(self._amplitudes((1 - share) * excess))

    def _amplitudes(self, column) -> np.ndarray:
        """Modal amplitudes (n_road, n_across) of a column."""
        return self.modes.T @ (self.root[:, None] * column.reshape(len(self.root), -1))

    def carried(self, t: float, place: float) -> np.ndarray:
        """Rise (n_road n_across,) in K of the road at `place` (m, unwrapped) coming round one lap later."""
        before = place - self.lap
        k = int(np.searchsorted(self.place, before, side="right"))
        if k == 0 or not self.place:
            return np.zeros(len(self.dz) * self.planes)
        if k == len(self.place):
            parts = ((k - 1, 1.0),)
        else:
            w = (before - self.place[k - 1]) / (self.place[k] - self.place[k - 1])
            parts = ((k - 1, 1.0 - w), (k, w))
        total = np.zeros((len(self.dz), self.planes))
        for j, weight in parts:
            age = max(t - self.time[j], 0.0)
            cooled = np.exp(-self.rates * age)[:, None]
            total += weight * cooled * (self.mean[j] + np.exp(-age / self.lateral) * self.lane[j])
        return (self.modes @ total / self.root[:, None]).ravel()
