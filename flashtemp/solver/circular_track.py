"""Heat that the road of a circular track keeps from one pass to the next (theory.md, section 1.5).

Road that leaves the computed window is stored as columns along the track.  A stored column conducts heat in depth and
loses it to the air, both linear, so it is kept as amplitudes of the eigenmodes of the discrete depth operator.  Its
cooling until the next pass is then exact for any time, and costs one matrix product.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import eigh_tridiagonal

from flashtemp.meshes.mesh import Mesh
from flashtemp.model.scene import Scene
from flashtemp.physics.effect import Heat
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.system import InflowLaw, PhaseSystem, RoadInflow

TRACK_FIELDS = ("place", "time", "left", "own", "laid_place", "laid_time", "laid")  # fields that change during a run


@dataclass
class CircularTrack:
    """Stored columns of road by their place on the track (m, unwrapped): behind the block, and around its last start.

    `lap_length` is the length of the track (m), `film` the heat-transfer coefficient of the free road (W/m2K), `share`
    the fraction of the width that a column stands for.  A column keeps all heat that its lanes took; how far they have
    widened follows from its temperature over depth (theory.md, eq. (15c)).
    """

    lap_length: float
    dz: np.ndarray  # deepest road cell first, m
    conductivity: float
    volumetric_capacity: float
    film: float
    share: float = 1.0
    planes: int = 1  # across the direction of sliding
    min_spacing: float = 0.0  # m, smallest distance between stored columns
    is_endless: bool = False  # True: road never comes round
    place: list = field(default_factory=list)  # m, of the stored columns, increasing
    time: list = field(default_factory=list)  # s, when they left the window
    left: list = field(default_factory=list)  # modal amplitudes of the rise that all passes left
    own: list = field(default_factory=list)  # modal amplitudes of the part left since the block was last put down
    laid_place: list = field(default_factory=list)  # m, of columns around the block at its last start, increasing
    laid_time: list = field(default_factory=list)  # s, of that start
    laid: list = field(default_factory=list)  # modal amplitudes of the rise that all passes left there

    def __post_init__(self):
        # eigenmodes of C dT/dt = -G T; scaled with sqrt(C) the matrix is symmetric, and modes are orthogonal
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

    def store_column(self, t: float, place: float, own, before=0.0) -> None:
        """Store a column that leaves the window at time t.

        `own` (n_road n_across,) are the rises that this pass left, deepest cells first; `before` those that remain of
        earlier passes in full, whatever fraction of them `track_memory.strength` applies.
        """
        self.place.append(place)
        self.time.append(t)
        self.own.append(self._modal_amplitudes(own))
        self.left.append(self._modal_amplitudes(before + own))

    def clear(self) -> None:
        """Drop all stored columns: the block was lifted and starts on fresh road."""
        for name in TRACK_FIELDS:
            setattr(self, name, [])

    def store_initial_road(self, t: float, place: np.ndarray, left: np.ndarray) -> None:
        """Store the road around the block that starts at time t.

        `left` (places, n_road, n_across) are the rises that all passes left; `place` (places,) decreases, in the order
        of the depth lines.
        """
        self.laid_place, self.laid_time = list(place[::-1]), [t] * len(place)
        self.laid = [self._modal_amplitudes(column) for column in left[::-1]]

    def incoming_road(self, t: float, places) -> RoadInflow:
        """The road that enters at `places` (m, unwrapped; a number or (places, 1)) at time t.

        Near the start of a repetition it is the road that lay around the block, later the road stored a lap ago.
        """
        if not self.laid or np.min(places) > self.laid_place[-1]:
            return RoadInflow(self.stored_rise(t, places))
        initial = self.initial_road_rise(t, places)
        if np.max(places) <= self.laid_place[-1]:
            return RoadInflow(initial)
        return RoadInflow(np.where(places <= self.laid_place[-1], initial, self.stored_rise(t, places)))

    def initial_road_rise(self, t: float, places) -> np.ndarray:
        """Rise (n_road n_across,) K of road around the block at its start; `places` as in `incoming_road`."""
        positions, last = np.ravel(places).tolist(), len(self.laid) - 1
        after = [min(max(bisect_left(self.laid_place, position), 1), last) for position in positions]
        before = [k - 1 for k in after]
        low, high = (np.array([self.laid_place[k] for k in at]) for at in (before, after))
        w = np.minimum(np.maximum((positions - low) / (high - low), 0.0), 1.0)[:, None, None]
        age = np.maximum(t - np.array([self.laid_time[k] for k in after]), 0.0)
        total = (1.0 - w) * _stack_columns(self.laid, before) + w * _stack_columns(self.laid, after)
        # modes of conduction in depth decay each by itself, so a rest of any length is one product
        total = np.exp(-self.rates * age[:, None])[:, :, None] * total
        rise: np.ndarray = self.share * (self.modes @ total) / self.root[:, None]
        return rise.reshape(*np.shape(places)[:1], -1)

    def _modal_amplitudes(self, column) -> np.ndarray:
        """Modal amplitudes (n_road, n_across) of a column."""
        return self.modes.T @ (self.root[:, None] * column.reshape(len(self.root), -1))

    def stored_rise(self, t: float, places) -> np.ndarray:
        """Rise (n_road n_across,) K, averaged over lanes and gaps, of road stored a lap before `places` (m, unwrapped).

        For `places` (places, 1) the result has that many rows.
        """
        return self._interpolated_rise(t, places, lambda at: self.share * _stack_columns(self.left, at))

    def revisited_road(self, t: float, place: float, since: float, turned: float) -> RoadInflow:
        """The road at `place` (m, unwrapped) for a block that slides back over road of its own pass.

        Columns stored between the times `since` and `turned` (s) hold heat of this pass.  It is returned as `own_rise`,
        because effects such as `track_memory` act on earlier passes only.
        """

        def own_amplitudes(at: tuple[int, ...]) -> np.ndarray:
            here = np.array([since <= self.time[j] <= turned for j in at])[:, None, None]
            return np.where(here, _stack_columns(self.own, at), 0.0)

        def earlier_amplitudes(at: tuple[int, ...]) -> np.ndarray:
            return self.share * (_stack_columns(self.left, at) - own_amplitudes(at))

        return RoadInflow(*(self._interpolated_rise(t, place, law) for law in (earlier_amplitudes, own_amplitudes)))

    def _interpolated_rise(self, t: float, places, amplitude: Callable[[tuple[int, ...]], np.ndarray]) -> np.ndarray:
        """Rise at time t and at `places` one lap later, linear between the two nearest stored columns.

        `amplitude` returns the modal amplitudes (columns, n_road, n_across) of columns by number.
        """
        if not self.place:
            return np.zeros((*np.shape(places)[:1], len(self.dz) * self.planes))
        before, after = zip(
            *(self._neighbour_weights(place - self.lap_length) for place in np.ravel(places).tolist()), strict=True
        )
        at, weight = zip(*before, *after, strict=True)
        age = np.maximum(t - np.array([self.time[j] for j in at]), 0.0)
        # each neighbour has cooled since it left the window, so the weights apply after the decay of its modes
        decay = np.array(weight)[:, None] * np.exp(-self.rates * age[:, None])
        parts = decay[:, :, None] * amplitude(at)
        rise: np.ndarray = self.modes @ (parts[: len(before)] + parts[len(before) :]) / self.root[:, None]
        return rise.reshape(*np.shape(places)[:1], -1)

    def _neighbour_weights(self, place: float) -> tuple[tuple[int, float], tuple[int, float]]:
        """(number, weight) of the stored columns before and after a place; weights are 0 before any road has passed."""
        k, last = bisect_right(self.place, place), len(self.place) - 1
        if k == 0:
            return (0, 0.0), (0, 0.0)
        if k > last:
            return (last, 1.0), (last, 0.0)
        w = (place - self.place[k - 1]) / (self.place[k] - self.place[k - 1])
        return (k - 1, 1.0 - w), (k, w)

    def reverse_direction(self, slid: float, mesh: Mesh) -> None:
        """Mirror the track when the block, after `slid` (m) in all, reverses: the column stored last enters first.

        The block then meets its own road as if it came round a lap later, so places are shifted by a lap.
        """
        ends = mesh.x[mesh.first] + mesh.x[mesh.last]
        place = [2.0 * slid - ends - s - self.lap_length for s in reversed(self.place)]
        self.laid_place = [2.0 * slid - ends - s for s in reversed(self.laid_place)]
        self.laid_time, self.laid = self.laid_time[::-1], self.laid[::-1]
        kept = {name: getattr(self, name)[::-1] for name in ("time", "left", "own")}
        around = slid - mesh.x[-1]  # where the road around the block begins
        n, tiny = int(np.searchsorted(place, around)), 1e-6 * self.min_spacing
        self.place = place[:n]
        for name, values in kept.items():
            setattr(self, name, values[:n])
        if n:  # no column is stored for the road about to leave: the last stored one stands for it
            first = self.laid_place[-1] if self.laid_place else slid - mesh.x[0]
            self.place[0] = min(place[0], first - self.lap_length)
        if 0 < n == len(place) and around - place[-1] > 3.0 * tiny:  # beyond lies road without heat: add cold columns
            for s in (place[-1] + tiny, around - tiny):
                self.place.append(s)
                self.time.append(self.time[n - 1])
                self.left.append(0.0 * self.left[n - 1])
                self.own.append(0.0 * self.own[n - 1])


def _stack_columns(columns: list, at: Iterable[int]) -> np.ndarray:
    """Modal amplitudes (columns, n_road, n_across) of the stored columns with the numbers `at`."""
    return np.array([columns[j] for j in at])


def has_road_memory(scene: Scene) -> bool:
    """Whether road that left the window may enter again: round the track, or where the block slides back."""
    return scene.schedule.lap is not None or scene.schedule.has_return_pass


def build_track(balance: HeatBalance, lap: float | None) -> CircularTrack:
    """The empty track of a scene; without a `lap` length (m) the road is endless and never comes round."""
    scene = balance.scene
    heats = [(c, a.p) for a in scene.acting for c in a.contributions(scene) if isinstance(c, Heat)]
    start = scene.law_context(scene.schedule.phases[0], 0.0)
    film = sum(c.law(start, p) for c, p in heats if c.site == "road.free" and c.kind == "film")
    whole, around = scene.schedule.distance * scene.schedule.repetitions, scene.mesh.x[-1] - scene.mesh.x[0]
    endless, lap = lap is None, lap or 1.0 + whole + 2.0 * around
    spacing = 0.1 * scene.length if endless or len(scene.schedule.directions) > 1 else lap / 400
    dz = scene.mesh.thickness[: scene.mesh.n_road]
    road, planes = scene.road, scene.mesh.n_across
    return CircularTrack(
        lap, dz, road.conductivity, road.volumetric_capacity, film, balance.share, planes, spacing, endless
    )


def build_inflow(balance: HeatBalance, phase, track: CircularTrack | None) -> InflowLaw | None:
    """The function of the moment that returns the entering road during a phase; None without a track.

    Road over which the block slides back within one pass is as hot as the block left it, whatever effects act.
    """
    if track is None:
        return None
    scene = balance.scene
    since = phase.start if scene.schedule.lifted else 0.0

    def road_inflow(now):
        place = now.passed - scene.mesh.x[0]
        if phase.turned < since:
            return track.incoming_road(now.t, place)
        return track.revisited_road(now.t, place, since, phase.turned)

    return road_inflow


def store_leaving_column(
    system: PhaseSystem, t: float, y: np.ndarray, track: CircularTrack, min_spacing: float | None = None
) -> None:
    """Store the column that leaves the window at a state y: at most 400 per lap, or ten per length of the block."""
    b, scene, now = system.b, system.b.scene, system.law_context(t)
    y = system.to_block_frame(now, y)
    place = now.passed - scene.mesh.x[-1]
    if b.road_frame is not None:  # road in its own frame leaves by whole columns
        place = b.road_frame.line_offset(now.passed)[0] * b.road_frame.dx - scene.mesh.x_centre[-1]
    if track.place and place - track.place[-1] < (track.min_spacing if min_spacing is None else min_spacing):
        return
    last = scene.mesh.everywhere(scene.mesh.road[-1]).ravel()
    at = scene.mesh.x_centre[-1:] - scene.mesh.x[0]
    track.store_column(
        t,
        place,
        b.temperature_rise(y[: b.n])[last] - system.undisturbed_road(now, at)[0, 0],
        system.earlier_pass_rise(now, at)[0],
    )
    system.cache.invalidate()


def store_passed_road(
    system: PhaseSystem, step_start: float, t: float, state_at: Callable[[float], np.ndarray], track: CircularTrack
) -> None:
    """Store the road that left the window during a step from `step_start` to t; `state_at` interpolates the state.

    Columns are stored at whole multiples of the track's spacing, so results do not depend on where steps happen to end.
    Within a long step further columns are stored, one per length of the block or per ten spacings if that is more.
    """
    if system.b.road_frame is not None or not track.place:
        store_leaving_column(system, t, state_at(t), track)
        return
    scene = system.b.scene
    was, place = (
        scene.schedule.total_slid_distance(system.phase, moment) - scene.mesh.x[-1] for moment in (step_start, t)
    )
    due, wide = (
        track.min_spacing * np.floor(place / track.min_spacing),
        track.min_spacing * max(10, round(scene.length / track.min_spacing)),
    )
    if due > (since := max(was, track.place[-1])):
        for position in (*(wide * np.arange(np.floor(since / wide) + 1.0, np.ceil(due / wide))), due):
            moment = step_start + (t - step_start) * (position - was) / (place - was)
            store_leaving_column(system, moment, state_at(moment), track, 0.5 * track.min_spacing)
