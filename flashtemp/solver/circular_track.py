"""The circular track remembers: what each stretch of road left, and how it looks when it returns.

Road that leaves the window is kept as a few columns along the track, each as amplitudes of the
depth operator's eigenmodes, so that its cooling until the next pass is exact at any later time.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import eigh_tridiagonal

from flashtemp.model.scene import Scene
from flashtemp.physics.effect import Heat
from flashtemp.solver import lanes
from flashtemp.solver.system import Inflow, System


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

    def leave(self, t: float, place: float, column, entering, share: float, lane=1.0) -> None:
        """Keep a column of rises that leaves at time t; it stands for `share` of the width.

        `column` (n_road n_across,), deepest cells first; in lanes its excess is `lane` times as large.
        """
        excess = column - entering
        self.place.append(place)
        self.time.append(t)
        self.mean.append(self._amplitudes(entering + share * excess))
        self.lane.append(self._amplitudes((lane - share) * excess))

    def _amplitudes(self, column) -> np.ndarray:
        """Modal amplitudes (n_road, n_across) of a column."""
        return self.modes.T @ (self.root[:, None] * column.reshape(len(self.root), -1))

    def carried(self, t: float, place: float) -> np.ndarray:
        """Rise (n_road n_across,) in K of the road at `place` (m, unwrapped) coming round one lap later."""
        before = place - self.lap
        k = int(np.searchsorted(self.place, before, side="right"))
        if k == 0 or not self.place:
            return np.zeros(len(self.dz) * self.planes)
        parts = [(k - 1, 1.0)]
        if k < len(self.place):
            w = (before - self.place[k - 1]) / (self.place[k] - self.place[k - 1])
            parts = [(k - 1, 1.0 - w), (k, w)]
        total = np.zeros((len(self.dz), self.planes))
        for j, weight in parts:
            age = max(t - self.time[j], 0.0)
            cooled = np.exp(-self.rates * age)[:, None]
            total += weight * cooled * (self.mean[j] + np.exp(-age / self.lateral) * self.lane[j])
        return (self.modes @ total / self.root[:, None]).ravel()


def track_of(scene: Scene) -> Track:
    """The track of a scene that remembers, still empty."""
    heats = [(c, a.p) for a in scene.acting for c in a.contributions(scene) if isinstance(c, Heat)]
    start = scene.moment(scene.schedule.phases[0], 0.0)
    film = sum(c.law(start, p) for c, p in heats if c.site == "road.free" and c.kind == "film")
    assert scene.track_length is not None
    lateral = (scene.spot_diameter / 2) ** 2 / (5.78 * scene.road.diffusivity)
    dz = scene.mesh.thickness[: scene.mesh.n_road]
    road, planes = scene.road, scene.mesh.n_across
    return Track(scene.track_length, dz, road.conductivity, road.volumetric_capacity, film, lateral, planes)


def inflow(scene: Scene, phase, track: Track | None) -> Inflow | None:
    """What the track carries into the window during a phase; None without a track."""
    if track is None:
        return None

    def carried(now):
        slid = phase.slid_before + now.slid
        return track.carried(now.t, slid - scene.mesh.x[0])

    return carried


def leave(system: System, t: float, y: np.ndarray, track: Track) -> None:
    """Keep the column that leaves the window at a state y, at most 400 per lap."""
    b, scene, now = system.b, system.b.scene, system.moment(t)
    place = system.phase.slid_before + now.slid - scene.mesh.x[-1]
    if track.place and place - track.place[-1] < track.lap / 400:
        return
    last = scene.mesh.everywhere(scene.mesh.road[-1]).ravel()
    column, drift = b.rise(y[: b.n])[last], now.ambient - scene.ambient
    lane = np.tile(lanes.everywhere(scene.mesh, system.contact(now, y).state.lane)[-1], scene.mesh.n_road)
    track.leave(t, place, column - drift, system.entering(now) - drift, b.share, lane)
