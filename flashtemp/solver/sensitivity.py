"""What a small change of each parameter does to everything that a run records.

The difference s = (y_moved - y)/step of a neighbouring run obeys ds/dt = [f_moved(t, y + step s) - f(t, y)]/step.
It is integrated behind the run by BDF2 in sqrt(t) with one Newton correction a step; all neighbours share
the run's linearisation and preconditioner, so that one costs a fraction of a run.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Generic, TypeVar

import numpy as np

from flashtemp.meshes.mesh import Mesh
from flashtemp.model.numerics import SolverSettings
from flashtemp.model.scene import Scene
from flashtemp.model.schedule import Phase
from flashtemp.solver.between import StateInterpolant, interpolate_quadratic
from flashtemp.solver.circular_track import (
    TRACK_FIELDS,
    build_inflow,
    build_track,
    has_road_memory,
    store_leaving_column,
)
from flashtemp.solver.conjugate_residuals import solve_shifted_system
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.march import march
from flashtemp.solver.march_state import MarchState
from flashtemp.solver.mesh_mapping import corresponding_phase, stretch_mesh
from flashtemp.solver.phase_transitions import remap_road, start_phase
from flashtemp.solver.recorder import build_run, record_state
from flashtemp.solver.run import Run
from flashtemp.solver.system import PhaseSystem

FIRST_STEP_U, MAX_STEP_U = 0.03, 0.1  # first and longest step, in roots of the share of a stretch
CORRECTION_RATIO = 0.2  # change by the correction over the change in the stretch, from which the next step follows
FINE_CORRECTION_RATIO, FINE_STEP_WINDOWS = (
    0.03,
    4.0,
)  # the same as long as what slid first may be seen, and for how many windows of sliding it may
MAX_STEP_GROWTH = 2.0  # BDF2 is stable up to 2.4
NEGLIGIBLE_CHANGE_K = 1e-7  # K: a change that need not be followed


@dataclass(frozen=True)
class Perturbation:
    """A scene with one parameter moved by `step`; nothing differs before the time `start_s` (s).

    `is_stretched`: block and schedule may be longer or shorter than the run's; cells and records are then those at the
    same share of the block's length and height, and of each repetition and wait.
    """

    scene: Scene
    step: float
    start_s: float = 0.0
    is_stretched: bool = False


ParameterName = TypeVar("ParameterName", bound=Hashable)


@dataclass(frozen=True)
class RunWithSensitivities(Generic[ParameterName]):
    """A run, and runs (linear in their `steps`) with one parameter moved each.

    `reference` is the run as the neighbours see it, on their own times: take differences against it.
    """

    run: Run
    reference: Run | None
    perturbed: dict[ParameterName, Run]
    steps: dict[ParameterName, float]

    def derivative_of(self, observe, name: ParameterName) -> np.ndarray:
        """d(see(run))/d(parameter) for any function of a run that returns an array."""
        return (observe(self.perturbed[name]) - observe(self.reference)) / self.steps[name]


def run_with_sensitivities(
    scene: Scene,
    settings: SolverSettings,
    perturbations: dict[ParameterName, Perturbation],
    title: str = "",
    at=(),
    dense: bool = False,
) -> RunWithSensitivities[ParameterName]:
    """March a scene with neighbours beside it.

    Neighbours are recorded at the times `at` (s) that `settings` asks for too, with `dense` at every fifth of
    the others besides.  Moves share mesh and schedule with the scene.  Raises SolverFailure, ValueError.
    """
    beside = SensitivityIntegrator(scene, perturbations, frozenset(at), dense)
    run = march(scene, settings, title, sensitivities=beside)
    level, *moved = (one.to_run(title) for one in beside.perturbed_runs)
    runs = dict(zip(perturbations, moved, strict=True))
    return RunWithSensitivities(run, level, runs, {k: m.step for k, m in perturbations.items()})


class _PerturbedRun:
    """One moved scene beside the run: its difference `s` (cells, worn depth, ledger) per unit of the parameter."""

    def __init__(self, base: HeatBalance, move: Perturbation):
        scene, plain = move.scene, base.scene
        mesh = stretch_mesh(plain, scene) if move.is_stretched else _shared_mesh(plain, scene)
        self.scene = replace(scene, mesh=mesh, schedule=replace(scene.schedule, lap=plain.schedule.lap))
        self.base_schedule, self.shares_clock = plain.schedule, not move.is_stretched
        self.balance, self.step, self.start_s = HeatBalance(self.scene), move.step, move.start_s
        start, own, m = base.initial_state(), self.balance.initial_state(), base.worn.stop
        self.m, self.s = base.size if self.balance.ledger == base.ledger else m, np.zeros(m)
        if self.step:
            self.s = (own[:m] - start[:m]) / self.step
        self.s = np.append(self.s, np.zeros(base.size - m))
        self.march_state = MarchState(y=own, removed_heat=np.zeros(2), track=None)
        if has_road_memory(scene):
            self.march_state.track = build_track(self.balance, scene.schedule.lap)

    def own_state(self, y: np.ndarray, s: np.ndarray) -> np.ndarray:
        """The neighbour's own state beside a state of the run; a ledger of other entries than the run's is not kept."""
        own, m = np.zeros(self.balance.size), self.m
        own[:m] = y[:m] + self.step * s[:m]
        return own

    def own_phase(self, phase: Phase) -> Phase:
        """The neighbour's own phase at the time of one of the run."""
        return phase if self.shares_clock else corresponding_phase(phase, self.base_schedule, self.scene.schedule)

    def own_system(self, phase: Phase, leg: int) -> PhaseSystem:
        """The neighbour's own system during a phase of its own, or one leg of it."""
        return PhaseSystem(self.balance, phase, build_inflow(self.balance, phase, self.march_state.track), leg)

    def remap_road(self, phase: Phase, leg: int, y, s) -> np.ndarray:
        """The state after the road was put back on the mesh."""
        self.march_state.y = self.own_state(y, s)
        remap_road(self.own_system(self.own_phase(phase), leg), self.march_state)
        return self.march_state.y[: self.m]

    def phase_segment(self, phase: Phase, leg: int = 0) -> _PhaseSegment:
        """The neighbour during one phase of the run's schedule, or one leg of it."""
        own = self.own_phase(phase)
        pace = 1.0 if self.shares_clock else (own.end - own.begin) / (phase.end - phase.begin)
        return _PhaseSegment(self, self.own_system(own, leg), np.zeros(self.balance.size), phase.begin, pace)

    def start_phase(self, before: Phase, phase: Phase, y, s) -> np.ndarray:
        """The state after the road was made new, or the block turned to slide back."""
        self.march_state.y = self.own_state(y, s)
        start_phase(self.balance, self.own_phase(before), self.own_phase(phase), self.march_state)
        return self.march_state.y[: self.m]

    def to_run(self, title: str) -> Run:
        return build_run(self.balance, self.march_state, title)


def _shared_mesh(plain: Scene, scene: Scene) -> Mesh:
    """The mesh of the run for a neighbour that has the same, and its schedule.  Raises ValueError."""
    if not all(np.array_equal(getattr(scene.mesh, k), getattr(plain.mesh, k)) for k in ("x", "thickness")):
        raise ValueError("a neighbour needs the mesh of the run")
    if scene.schedule.end_time != plain.schedule.end_time:
        raise ValueError("a neighbour needs the schedule of the run")
    return plain.mesh


@dataclass(frozen=True)
class _PhaseSegment:
    """A neighbour `perturbed_run` a run in one phase, with room `rate_buffer` for rates; its clock goes at `clock_rate` since `begin`."""

    perturbed_run: _PerturbedRun
    system: PhaseSystem
    rate_buffer: np.ndarray
    begin: float
    clock_rate: float

    @cached_property
    def _difference_weights(self) -> np.ndarray:
        """How differences of cells and worn depth count: heat that comes round lies in the columns of lanes, over the
        width it is a share of that."""
        b = self.system.b
        out = np.ones(b.worn.stop)
        if b.laws.has_law("road.inflow"):
            out[b.scene.mesh.everywhere(b.scene.mesh.road)] = b.share
        return out

    def largest_difference(self, s: np.ndarray) -> float:
        """Largest difference (K) of cells and worn depth `s`."""
        return float(np.abs(self._difference_weights * s[: len(self._difference_weights)]).max())

    def own_time(self, t: float) -> float:
        """The neighbour's own time (s)."""
        return t if self.perturbed_run.shares_clock else self.system.phase.begin + self.clock_rate * (t - self.begin)

    def own_rate(self, t: float, y: np.ndarray, s: np.ndarray) -> np.ndarray:
        """Rates of cells, worn depth and ledger, per time of the run."""
        self.system.rate(self.own_time(t), self.perturbed_run.own_state(y, s), self.rate_buffer)
        if not self.perturbed_run.shares_clock:
            self.rate_buffer[:] *= self.clock_rate
        return self.rate_buffer[: self.perturbed_run.m]

    def record_own(self, t, y, s, frame: bool) -> None:
        record_state(
            self.system,
            self.own_time(t),
            self.perturbed_run.own_state(y, s),
            self.perturbed_run.march_state,
            frame,
            float,
        )

    def store_own_column(self, t, y, s) -> None:
        if self.perturbed_run.march_state.track is not None:
            store_leaving_column(
                self.system, self.own_time(t), self.perturbed_run.own_state(y, s), self.perturbed_run.march_state.track
            )


class SensitivityIntegrator:
    """All neighbours of a run; `march` calls `integrate_segment` after each stretch and `start_phase` at each new start or turn."""

    def __init__(
        self, scene: Scene, perturbations: Mapping[Any, Perturbation], requested_times: frozenset[float], dense: bool
    ):
        base = HeatBalance(scene)
        self.requested_times, self.dense = requested_times, dense
        self.perturbed_runs = [
            _PerturbedRun(base, Perturbation(scene, 0.0)),
            *(_PerturbedRun(base, m) for m in perturbations.values()),
        ]

    def start_phase(self, before, phase, old: np.ndarray) -> None:
        """A new repetition begins or the block turns, out of the run's state `old`."""
        level, *moved = self.perturbed_runs
        zero = level.start_phase(before, phase, old, level.s)
        for one in moved:
            if one.start_s < before.end:
                one.s[: one.m] = (one.start_phase(before, phase, old, one.s) - zero[: one.m]) / one.step

    def remap_road(self, phase, leg: int, old: np.ndarray) -> None:
        """The road in its own frame is put back on the mesh, out of the run's state `old`."""
        level, *moved = self.perturbed_runs
        zero = level.remap_road(phase, leg, old, level.s)
        for one in moved:
            if one.start_s < phase.begin:
                one.s[: one.m] = (one.remap_road(phase, leg, old, one.s) - zero[: one.m]) / one.step

    def integrate_segment(self, phase, path, records, leg: int = 0) -> None:
        """Integrate the differences over a stretch of which the run took the steps `path`."""
        level, *moved = self.perturbed_runs
        times = self._record_times(phase, records)
        live = [one for one in moved if one.start_s < phase.end]
        idle = [one for one in moved if one.start_s >= phase.end]
        for one in live:
            if phase.begin <= one.start_s and one.march_state.track is not None and level.march_state.track is not None:
                kept: dict[str, Any] = {k: list(getattr(level.march_state.track, k)) for k in TRACK_FIELDS}
                one.march_state.track = replace(one.march_state.track, **kept)
        S = np.array([one.s for one in live]).reshape(len(live), len(level.s))
        S = _integrate_differences(
            phase,
            StateInterpolant(path),
            level.phase_segment(phase, leg),
            [one.phase_segment(phase, leg) for one in live],
            S,
            times,
        )
        for k, one in enumerate(live):
            one.s = S[k]
        for one in idle:  # what the run recorded holds for them too
            _copy_records(level.march_state, one.march_state, phase)

    def _record_times(self, phase, records) -> list[tuple[float, bool]]:
        """When neighbours are recorded in a stretch, and whether with all cells."""
        own = [t for t in records["time"] if phase.begin < t <= phase.end or t == phase.begin == 0.0]
        other = [t for t in own if t not in self.requested_times]
        kept = set(other[4::5]) if self.dense else set()
        kept |= {own[-1]} | ({0.0} & set(own))
        return [(t, t in self.requested_times or t == 0.0) for t in own if t in self.requested_times or t in kept]


def _integrate_differences(
    phase, path: StateInterpolant, level: _PhaseSegment, live: list[_PhaseSegment], S, times
) -> np.ndarray:
    """Differences (k, cells, worn depth, ledger) of live neighbours at the end of a stretch; S those at its start.

    Steps are taken in u, with t = begin + span u^2: heat that begins to flow goes as sqrt(t), and BDF2 is exact for
    parabolas of u.  The ledger follows the rest and has no say in the length of steps.
    """
    m = level.system.b.worn.stop
    longest = (
        0.5 * MAX_STEP_U if level.system.b.laws.has_law("road.inflow") else MAX_STEP_U
    )  # what comes round changes all the time
    begin, size = S, np.array([0.05 * one.largest_difference(s) for one, s in zip(live, S, strict=True)])
    size = np.maximum(size, [NEGLIGIBLE_CHANGE_K / abs(one.perturbed_run.step) for one in live])
    old, before = S, 0.0
    span, soon = phase.end - phase.begin, _fine_step_distance(phase, level, times)
    u, h, times = 0.0, FIRST_STEP_U, list(times)
    if times and times[0][0] <= phase.begin:
        _record_all(path, level, live, times.pop(0), S)
    while u < 1.0:
        new = 1.0 if 1.0 - u < 1.5 * h else u + h
        h = new - u
        t = phase.end if new == 1.0 else phase.begin + span * new**2
        after, change = _bdf2_step(path(t), t, 2.0 * new * span, (h, before), (old, S), level, live)
        while times and times[0][0] <= t * (1 + 1e-12):
            at = times.pop(0)
            reached = float(np.sqrt((at[0] - phase.begin) / span))
            _record_all(path, level, live, at, interpolate_quadratic(reached, (u - before, u, new), (old, S, after)))
        old, S, before, u = S, after, h, new
        if phase.sliding:
            y = path(t)
            level.store_own_column(t, y, level.perturbed_run.s)
            for one, s in zip(live, S, strict=True):
                one.store_own_column(t, y, s)
        size = np.maximum(size, [one.largest_difference(s) for one, s in zip(live, S - begin, strict=True)])
        moved = np.abs(change[:, :m]).max(axis=1, initial=0.0) / size
        error = float(np.sqrt(np.mean(moved**2))) if live else 0.0
        close = FINE_CORRECTION_RATIO if soon and level.system.moment(t).slid < soon else CORRECTION_RATIO
        h = min(h * float(np.clip(np.sqrt(close / max(error, 1e-12)), 0.5, MAX_STEP_GROWTH)), longest)
    return S


def _fine_step_distance(phase, level: _PhaseSegment, times) -> float:
    """How far (m) the block slides while the front of the road that it met first is in the window, or smeared by long
    steps, where one of the `times` asked for with all cells falls in; else 0."""
    reach = FINE_STEP_WINDOWS * float(level.system.b.scene.mesh.x[-1])
    seen = phase.sliding and any(frame and level.system.moment(t).slid < reach for t, frame in times)
    return reach if seen else 0.0


def _bdf2_step(
    y, t: float, pace: float, steps: tuple[float, float], last, level: _PhaseSegment, live: list[_PhaseSegment]
):
    """Differences after a step of BDF2 to the time t (s), where the run is at y, and Newton's correction.

    `steps` in u, this one and that before, of which the latter is 0 for the first: that is Euler's; `clock_rate` dt/du.
    `last` differences before and after the step before.
    """
    (h, before), (old, S) = steps, last
    w = h / before if before else 0.0
    gamma = pace * h * (1 + w) / (1 + 2 * w)
    guess = S + w * (S - old) if before else S
    known = ((1 + w) ** 2 * S - w * w * old) / (1 + 2 * w) if before else S
    start = level.own_rate(t, y, level.perturbed_run.s)
    R = np.empty_like(S)
    for k, one in enumerate(live):
        n = one.perturbed_run.m
        R[k] = known[k] - guess[k]
        R[k, :n] = (
            known[k, :n] + gamma * (one.own_rate(t, y, guess[k]) - start[:n]) / one.perturbed_run.step - guess[k, :n]
        )
    b = level.system.b
    change = solve_shifted_system(
        level.system.linearise(t, level.perturbed_run.own_state(y, level.perturbed_run.s), gamma),
        b.size,
        b.worn.stop,
        R,
    )
    return guess + change, change


def _record_all(path: StateInterpolant, level: _PhaseSegment, live: list[_PhaseSegment], at, S) -> None:
    t, frame = at
    y = path(t)
    level.record_own(t, y, level.perturbed_run.s, frame)
    for one, s in zip(live, S, strict=True):
        one.record_own(t, y, s, frame)


def _copy_records(source: MarchState, target: MarchState, phase) -> None:
    """Records of a stretch in which nothing differs yet."""
    target.records.setdefault("ledger", source.records["ledger"])
    time, frames = source.records["time"], source.records["frames"]
    for i, t in enumerate(time):
        if phase.begin < t <= phase.end or t == phase.begin == 0.0:
            if i in frames:
                target.records.setdefault("frames", []).append(len(target.records.get("time", [])))
                target.frames.append(source.frames.read_row(frames.index(i)))
            for name in source.records.keys() - {"ledger", "frames"}:
                target.records.setdefault(name, []).append(source.records[name][i])
