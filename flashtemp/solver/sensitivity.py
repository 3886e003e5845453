"""Sensitivities of a run: the derivative of everything that it records with respect to parameters.

For every parameter a perturbed run with the parameter changed by `step` is followed by its difference quotient
s = (y_perturbed - y)/step, which obeys ds/dt = [f_perturbed(t, y + step s) - f(t, y)]/step.  Each segment of the run is
integrated first; s follows by BDF2 in sqrt(t), with one Newton correction per step.  All perturbed runs use the run's
linearisation and preconditioner, so one of them costs a fraction of a run.
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
from flashtemp.solver.circular_track import (
    TRACK_FIELDS,
    build_inflow,
    build_track,
    has_road_memory,
    store_leaving_column,
)
from flashtemp.solver.conjugate_residuals import solve_shifted_system
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.integration_state import IntegrationState
from flashtemp.solver.mesh_mapping import corresponding_phase, stretch_mesh
from flashtemp.solver.phase_transitions import remap_road, start_phase
from flashtemp.solver.recorder import build_run, record_state
from flashtemp.solver.run import Run
from flashtemp.solver.system import PhaseSystem
from flashtemp.solver.time_integration import StepHistory, integrate_schedule

FIRST_STEP_U, MAX_STEP_U = 0.03, 0.1  # first and longest step in u = sqrt(fraction of the segment)
MIN_STEP_U = 1e-4  # a shorter step is not repeated
CORRECTION_RATIO = 0.2  # target of Newton's correction over the largest change in the segment: it sets the next step
FINE_CORRECTION_RATIO = 0.015  # the same while the front of the road that the block met first is visible
FINE_STEP_WINDOWS = 4.0  # slid distance for which it may be visible, in lengths of the window
MAX_STEP_GROWTH = 2.0  # BDF2 is stable up to 2.4
NEGLIGIBLE_CHANGE_K = 1e-7  # K, smallest change that limits the length of steps


@dataclass(frozen=True)
class Perturbation:
    """A scene with one parameter changed by `step`; nothing differs before the time `start_s` (s).

    With `is_stretched` block and schedule may be longer or shorter than those of the run.  Cells and records then
    correspond by the fraction of the block's length and height, and by the fraction of each repetition and wait.
    """

    scene: Scene
    step: float
    start_s: float = 0.0
    is_stretched: bool = False


ParameterName = TypeVar("ParameterName", bound=Hashable)


@dataclass(frozen=True)
class RunWithSensitivities(Generic[ParameterName]):
    """A run, and one perturbed run per parameter, linear in its step.

    `reference` is the run recorded like the perturbed runs, at the same times: take differences from it.
    """

    run: Run
    reference: Run | None
    perturbed: dict[ParameterName, Run]
    steps: dict[ParameterName, float]

    def derivative_of(self, observe, name: ParameterName) -> np.ndarray:
        """d(observe(run))/d(parameter) for any function of a run that returns an array."""
        return (observe(self.perturbed[name]) - observe(self.reference)) / self.steps[name]


def run_with_sensitivities(
    scene: Scene,
    settings: SolverSettings,
    perturbations: dict[ParameterName, Perturbation],
    title: str = "",
    at=(),
    dense: bool = False,
) -> RunWithSensitivities[ParameterName]:
    """Run a scene together with perturbed runs.

    Perturbed runs are recorded at those times `at` (s) at which `settings` records the run too; with `dense` also at
    every fifth of the other recorded times.  Perturbed scenes need the run's mesh and schedule unless they are
    stretched.  Raises SolverFailure, ValueError.
    """
    integrator = SensitivityIntegrator(scene, perturbations, frozenset(at), dense)
    run = integrate_schedule(scene, settings, title, sensitivities=integrator)
    reference, *perturbed = (one.to_run(title) for one in integrator.perturbed_runs)
    runs = dict(zip(perturbations, perturbed, strict=True))
    return RunWithSensitivities(run, reference, runs, {k: m.step for k, m in perturbations.items()})


class _PerturbedRun:
    """One perturbed scene: its difference quotient `s` (cells, worn depth, ledger) per unit of the parameter.

    Only the first `m` entries of `s` count: without the ledger, if the perturbed scene has other ledger entries.
    """

    def __init__(self, base: HeatBalance, perturbation: Perturbation):
        scene, plain = perturbation.scene, base.scene
        mesh = stretch_mesh(plain, scene) if perturbation.is_stretched else _shared_mesh(plain, scene)
        self.scene = replace(scene, mesh=mesh, schedule=replace(scene.schedule, lap=plain.schedule.lap))
        self.base_schedule, self.shares_clock = plain.schedule, not perturbation.is_stretched
        self.balance, self.step, self.start_s = HeatBalance(self.scene), perturbation.step, perturbation.start_s
        start, own, m = base.initial_state(), self.balance.initial_state(), base.worn.stop
        self.m, self.s = base.size if self.balance.ledger == base.ledger else m, np.zeros(m)
        if self.step:
            self.s = (own[:m] - start[:m]) / self.step
        self.s = np.append(self.s, np.zeros(base.size - m))
        self.integration_state = IntegrationState(y=own, removed_heat=np.zeros(2), track=None)
        if has_road_memory(scene):
            self.integration_state.track = build_track(self.balance, scene.schedule.lap)

    @property
    def has_track(self) -> bool:
        """Whether road that leaves the window is stored, to enter it again."""
        return self.integration_state.track is not None

    def own_state(self, y: np.ndarray, s: np.ndarray) -> np.ndarray:
        """State y + step s of the perturbed run; its ledger is zero if it has other entries than the run's."""
        own, m = np.zeros(self.balance.size), self.m
        own[:m] = y[:m] + self.step * s[:m]
        return own

    def own_phase(self, phase: Phase) -> Phase:
        """The phase of the perturbed schedule that corresponds to a phase of the run."""
        return phase if self.shares_clock else corresponding_phase(phase, self.base_schedule, self.scene.schedule)

    def own_system(self, phase: Phase, leg: int) -> PhaseSystem:
        """The perturbed system during a phase of its own schedule, or during one leg of it."""
        return PhaseSystem(self.balance, phase, build_inflow(self.balance, phase, self.integration_state.track), leg)

    def remap_road(self, phase: Phase, leg: int, y, s) -> np.ndarray:
        """State of the perturbed run after its road was shifted back on the mesh."""
        self.integration_state.y = self.own_state(y, s)
        remap_road(self.own_system(self.own_phase(phase), leg), self.integration_state)
        return self.integration_state.y[: self.m]

    def phase_segment(self, phase: Phase, leg: int = 0) -> _PhaseSegment:
        """The perturbed run during one phase of the run's schedule, or during one leg of it."""
        own = self.own_phase(phase)
        clock_rate = 1.0 if self.shares_clock else (own.end - own.begin) / (phase.end - phase.begin)
        return _PhaseSegment(self, self.own_system(own, leg), np.zeros(self.balance.size), phase.begin, clock_rate)

    def start_phase(self, before: Phase, phase: Phase, y, s) -> np.ndarray:
        """State of the perturbed run after a new repetition began, or the block reversed."""
        self.integration_state.y = self.own_state(y, s)
        start_phase(self.balance, self.own_phase(before), self.own_phase(phase), self.integration_state)
        return self.integration_state.y[: self.m]

    def to_run(self, title: str) -> Run:
        return build_run(self.balance, self.integration_state, title)


def _shared_mesh(plain: Scene, scene: Scene) -> Mesh:
    """The run's mesh, for a perturbed scene with the same mesh and schedule.  Raises ValueError."""
    if not all(np.array_equal(getattr(scene.mesh, k), getattr(plain.mesh, k)) for k in ("x", "thickness")):
        raise ValueError("a perturbed scene needs the mesh of the run")
    if scene.schedule.end_time != plain.schedule.end_time:
        raise ValueError("a perturbed scene needs the schedule of the run")
    return plain.mesh


@dataclass(frozen=True)
class _PhaseSegment:
    """A perturbed run during one phase: its clock runs `clock_rate` times as fast as the run's from `begin` (s) on.

    `rate_buffer` (size,) is reused by every evaluation of the rate.
    """

    perturbed_run: _PerturbedRun
    system: PhaseSystem
    rate_buffer: np.ndarray
    begin: float
    clock_rate: float

    @cached_property
    def _difference_weights(self) -> np.ndarray:
        """Weights of the differences of cells and worn depth in the step control.

        Heat that comes round is stored in the columns of the lanes; averaged over the width it is a fraction of that.
        """
        b = self.system.b
        out = np.ones(b.worn.stop)
        if b.laws.has_law("road.inflow"):
            out[b.scene.mesh.everywhere(b.scene.mesh.road)] = b.share
        return out

    def largest_difference(self, s: np.ndarray) -> float:
        """Largest weighted difference of cells (K) and worn depth per unit of the parameter."""
        return float(np.abs(self._difference_weights * s[: len(self._difference_weights)]).max())

    def own_time(self, t: float) -> float:
        """Time (s) on the clock of the perturbed run."""
        return t if self.perturbed_run.shares_clock else self.system.phase.begin + self.clock_rate * (t - self.begin)

    def own_rate(self, t: float, y: np.ndarray, s: np.ndarray) -> np.ndarray:
        """Rates of cells, worn depth and ledger per unit of the run's time; valid until the next call."""
        self.system.rate(self.own_time(t), self.perturbed_run.own_state(y, s), self.rate_buffer)
        if not self.perturbed_run.shares_clock:
            self.rate_buffer[:] *= self.clock_rate
        return self.rate_buffer[: self.perturbed_run.m]

    def record_own(self, t, y, s, frame: bool) -> None:
        record_state(
            self.system,
            self.own_time(t),
            self.perturbed_run.own_state(y, s),
            self.perturbed_run.integration_state,
            frame,
            float,
        )

    def store_own_column(self, t, y, s) -> None:
        if self.perturbed_run.integration_state.track is not None:
            store_leaving_column(
                self.system,
                self.own_time(t),
                self.perturbed_run.own_state(y, s),
                self.perturbed_run.integration_state.track,
            )


class SensitivityIntegrator:
    """All perturbed runs of a run.

    `integrate_schedule` calls `integrate_segment` after each segment, `start_phase` at each repetition or reversal, and
    `remap_road` when road in its own frame is shifted back on the mesh.  The first entry of `perturbed_runs` has the
    step 0: it is the reference, evaluated by the same code as the others.
    """

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
        """Start a new repetition, or reverse the block, from the run's state `old`."""
        reference, *perturbed = self.perturbed_runs
        zero = reference.start_phase(before, phase, old, reference.s)
        for one in perturbed:
            if one.start_s < before.end:
                one.s[: one.m] = (one.start_phase(before, phase, old, one.s) - zero[: one.m]) / one.step

    def remap_road(self, phase, leg: int, old: np.ndarray) -> None:
        """Shift the road in its own frame back on the mesh, from the run's state `old`."""
        reference, *perturbed = self.perturbed_runs
        zero = reference.remap_road(phase, leg, old, reference.s)
        for one in perturbed:
            if one.start_s < phase.begin:
                one.s[: one.m] = (one.remap_road(phase, leg, old, one.s) - zero[: one.m]) / one.step

    def integrate_segment(self, phase, path, records, leg: int = 0) -> None:
        """Integrate the differences over a segment in which the run took the steps `path`."""
        reference, *perturbed = self.perturbed_runs
        times = self._record_times(phase, records)
        active = [one for one in perturbed if one.start_s < phase.end]
        unchanged = [one for one in perturbed if one.start_s >= phase.end]
        base_track = reference.integration_state.track
        for one in active:  # until its first difference a perturbed run has the track of the reference
            if phase.begin <= one.start_s and one.integration_state.track is not None and base_track is not None:
                stored: dict[str, Any] = {k: list(getattr(base_track, k)) for k in TRACK_FIELDS}
                one.integration_state.track = replace(one.integration_state.track, **stored)
        interpolant, base = StateInterpolant(path), reference.phase_segment(phase, leg)
        for t, frame in times:
            base.record_own(t, interpolant(t), reference.s, frame)
        # road that comes round only in some runs changes them abruptly: their short steps must not hold up the others
        revisiting = {id(one) for one in active if one.has_track and not reference.has_track}
        for group in ([o for o in active if id(o) not in revisiting], [o for o in active if id(o) in revisiting]):
            if not group:
                continue
            S = np.array([one.s for one in group])
            segments = [one.phase_segment(phase, leg) for one in group]
            S = _integrate_differences(phase, interpolant, base, segments, S, times)
            for k, one in enumerate(group):
                one.s = S[k]
        for one in unchanged:  # they have the records of the reference
            _copy_records(reference.integration_state, one.integration_state, phase)

    def _record_times(self, phase, records) -> list[tuple[float, bool]]:
        """Times (s) at which perturbed runs are recorded in a segment, and whether with all cells."""
        recorded = [t for t in records["time"] if phase.begin < t <= phase.end or t == phase.begin == 0.0]
        other = [t for t in recorded if t not in self.requested_times]
        extra = set(other[4::5]) if self.dense else set()
        extra |= {recorded[-1]} | ({0.0} & set(recorded))
        return [(t, t in self.requested_times or t == 0.0) for t in recorded if t in self.requested_times or t in extra]


def _integrate_differences(
    phase, path: StateInterpolant, reference: _PhaseSegment, perturbed: list[_PhaseSegment], S, times
) -> np.ndarray:
    """Differences (k, cells + worn depth + ledger) at the end of a segment from those at its start, S.

    Steps are taken in u with t = begin + span u^2, because temperatures grow as sqrt(t) when heat begins to flow, and
    BDF2 is exact for parabolas in u.  The ledger does not influence the length of steps.  Until the first field of all
    cells is recorded the tolerance is larger, inversely proportional to the time since the start of the segment.
    """
    m = reference.system.b.worn.stop
    # road that comes round enters with a temperature that changes all the time: shorter steps resolve it
    longest = 0.5 * MAX_STEP_U if reference.system.b.laws.has_law("road.inflow") else MAX_STEP_U
    begin, size = S, np.array([0.05 * one.largest_difference(s) for one, s in zip(perturbed, S, strict=True)])
    size = np.maximum(size, [NEGLIGIBLE_CHANGE_K / abs(one.perturbed_run.step) for one in perturbed])
    old, before = S, 0.0
    span, fine_until = phase.end - phase.begin, _fine_step_distance(phase, reference, times)
    first_field = next((at for at, frame in times if frame and at > phase.begin), phase.end)
    u, h, times = 0.0, FIRST_STEP_U, list(times)
    # the front of road that comes round may enter within one step, which is then repeated
    may_meet_front = phase.sliding and any(one.perturbed_run.has_track for one in perturbed)
    if times and times[0][0] <= phase.begin:
        _record_all(path, perturbed, times.pop(0), S)
    while u < 1.0:
        new = 1.0 if 1.0 - u < 1.5 * h else u + h
        h = new - u
        t = phase.end if new == 1.0 else phase.begin + span * new**2
        after, change = _bdf2_step(path(t), t, 2.0 * new * span, (h, before), (old, S), reference, perturbed)
        reached = [one.largest_difference(s) for one, s in zip(perturbed, after - begin, strict=True)]
        moved = np.abs(change[:, :m]).max(axis=1, initial=0.0) / np.maximum(size, reached)
        # heat spreads, so errors of early steps have decayed when the first field is recorded
        early = min(1.0, (t - phase.begin) / (first_field - phase.begin))
        error = early * float(np.sqrt(np.mean(moved**2)))
        is_fine = fine_until and reference.system.law_context(t).slid < fine_until
        close = FINE_CORRECTION_RATIO if is_fine else CORRECTION_RATIO
        if error > close and h > MIN_STEP_U and may_meet_front:
            h *= 0.5
            continue
        while times and times[0][0] <= t * (1 + 1e-12):
            at = times.pop(0)
            where = float(np.sqrt((at[0] - phase.begin) / span))
            _record_all(path, perturbed, at, interpolate_quadratic(where, (u - before, u, new), (old, S, after)))
        old, S, before, u = S, after, h, new
        if phase.sliding:
            y = path(t)
            reference.store_own_column(t, y, reference.perturbed_run.s)
            for one, s in zip(perturbed, S, strict=True):
                one.store_own_column(t, y, s)
        size = np.maximum(size, reached)
        h = min(h * float(np.clip(np.sqrt(close / max(error, 1e-12)), 0.5, MAX_STEP_GROWTH)), longest)
    return S


def _fine_step_distance(phase, reference: _PhaseSegment, times) -> float:
    """Slid distance (m) with fine steps: while the front of the road that the block met first is in the window.

    Long steps would smear that front.  The distance is 0 if no field of all cells is recorded within it.
    """
    reach = FINE_STEP_WINDOWS * float(reference.system.b.scene.mesh.x[-1])
    is_recorded = phase.sliding and any(frame and reference.system.law_context(t).slid < reach for t, frame in times)
    return reach if is_recorded else 0.0


def _bdf2_step(
    y,
    t: float,
    dt_du: float,
    steps: tuple[float, float],
    last,
    reference: _PhaseSegment,
    perturbed: list[_PhaseSegment],
):
    """Differences after a step of BDF2 to time t (s), where the run's state is y, and Newton's correction.

    `steps` are the lengths in u of this step and of the one before; a 0 for the latter makes it an implicit Euler step.
    `dt_du` is in s; `last` are the differences before and after the previous step.  The predictor is linear.
    """
    (h, before), (old, S) = steps, last
    w = h / before if before else 0.0
    gamma = dt_du * h * (1 + w) / (1 + 2 * w)
    predicted = S + w * (S - old) if before else S
    history = ((1 + w) ** 2 * S - w * w * old) / (1 + 2 * w) if before else S
    # a difference of two rates over the step is the derivative along s, with every law and the ledger in it
    start = reference.own_rate(t, y, reference.perturbed_run.s)
    R = np.empty_like(S)
    for k, one in enumerate(perturbed):
        n = one.perturbed_run.m
        R[k] = history[k] - predicted[k]
        R[k, :n] = (
            history[k, :n]
            + gamma * (one.own_rate(t, y, predicted[k]) - start[:n]) / one.perturbed_run.step
            - predicted[k, :n]
        )
    b = reference.system.b
    change = solve_shifted_system(
        reference.system.linearise(t, reference.perturbed_run.own_state(y, reference.perturbed_run.s), gamma),
        b.size,
        b.worn.stop,
        R,
    )
    return predicted + change, change


def _record_all(path: StateInterpolant, perturbed: list[_PhaseSegment], at, S) -> None:
    t, frame = at
    y = path(t)
    for one, s in zip(perturbed, S, strict=True):
        one.record_own(t, y, s, frame)


def _copy_records(source: IntegrationState, target: IntegrationState, phase) -> None:
    """Copy the records of a segment in which a perturbed run does not differ from the reference yet."""
    target.records.setdefault("ledger", source.records["ledger"])
    time, frames = source.records["time"], source.records["frames"]
    for i, t in enumerate(time):
        if phase.begin < t <= phase.end or t == phase.begin == 0.0:
            if i in frames:
                target.records.setdefault("frames", []).append(len(target.records.get("time", [])))
                target.frames.append(source.frames.read_row(frames.index(i)))
            for name in source.records.keys() - {"ledger", "frames"}:
                target.records.setdefault(name, []).append(source.records[name][i])


class StateInterpolant:
    """State of a run at any time of a segment, linear between the steps of the integrator."""

    def __init__(self, path: StepHistory):
        self.t, self.y = np.array([t for t, _ in path]), [y for _, y in path]

    def __call__(self, t: float) -> np.ndarray:
        k = int(np.clip(np.searchsorted(self.t, t), 1, len(self.t) - 1))
        w = (t - self.t[k - 1]) / (self.t[k] - self.t[k - 1])
        return (1.0 - w) * self.y[k - 1] + w * self.y[k]


def interpolate_quadratic(u: float, at, S) -> np.ndarray:
    """Value at `u` of the parabola through three steps (`at`, S), or of the line through the last two.

    The line is used if the first two places are equal, as after the first step.
    """
    (a, b, c), (A, B, C) = at, S
    if a == b:
        return B + (u - b) / (c - b) * (C - B)
    first, second = (B - A) / (b - a), (C - B) / (c - b)
    return B + (u - b) * (second + (u - c) * (second - first) / (c - a))
