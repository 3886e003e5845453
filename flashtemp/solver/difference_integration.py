"""Time integration of differences between perturbed runs and a run: BDF2 in sqrt(t), one Newton correction per step.

All perturbed runs use the linearisation and preconditioner of the run.  Most of them take their steps together; those
whose differences change much faster take shorter ones of their own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flashtemp.model.schedule import Phase
from flashtemp.solver.conjugate_residuals import solve_shifted_system
from flashtemp.solver.perturbed_run import PhaseSegment
from flashtemp.solver.time_integration import StepHistory

FIRST_STEP_U, MAX_STEP_U = 0.03, 0.1  # first and longest step in u = sqrt(fraction of the segment)
FADED_FRACTION = 0.03  # of its largest change so far, to which a fading change is resolved; 0.1 doubles the error
MIN_STEP_U = 1e-4  # a shorter step is not repeated
TOO_LONG_RATIO = 4.0  # times the target: with such a correction a step is over twice as long as it may be (order 2)
CORRECTION_RATIO = 0.2  # target of Newton's correction over the largest change in the segment: it sets the next step
FINE_CORRECTION_RATIO = 0.015  # the same while the front of the road that the block met first is visible
FINE_STEP_WINDOWS = 4.0  # slid distance for which it may be visible, in lengths of the window
MAX_STEP_GROWTH = 2.0  # BDF2 is stable up to 2.4
NEGLIGIBLE_CHANGE_K = 1e-7  # K, smallest change that limits the length of steps


def integrate_differences(
    phase, path: StateInterpolant, reference: PhaseSegment, perturbed: list[PhaseSegment], S, times
) -> np.ndarray:
    """Differences (k, cells + worn depth + ledger) at the end of a segment from those at its start, S.

    Steps are taken in u with t = begin + span u^2, because temperatures grow as sqrt(t) when heat begins to flow, and
    BDF2 is exact for parabolas in u.  The ledger does not influence the length of steps.
    """
    size = np.array([0.05 * one.largest_difference(s) for one, s in zip(perturbed, S, strict=True)])
    size = np.maximum(size, [NEGLIGIBLE_CHANGE_K / abs(one.perturbed_run.step) for one in perturbed])
    fine_until, times = _fine_step_distance(phase, reference, times), list(times)
    if times and times[0][0] <= phase.begin:
        _record_all(path, perturbed, times.pop(0), S)
    # the front of road that comes round may enter within one step
    is_abrupt = phase.sliding and any(one.perturbed_run.has_track for one in perturbed)
    first_field = next((at for at, frame in times if frame), phase.end)
    integrator = _GroupIntegrator(phase, path, reference, fine_until, first_field)
    return integrator.integrate_group(perturbed, _GroupState(0.0, FIRST_STEP_U, 0.0, S, S, S, size), times, is_abrupt)


@dataclass(frozen=True)
class _GroupState:
    """Perturbed runs that take their steps together, at `u`, with the next step `h` and the one `before`.

    Differences (k, cells + worn depth + ledger) there, `S`, one step earlier, `old`, and when the segment began,
    `begin`; `size` (k,): their largest change so far.
    """

    u: float
    h: float
    before: float
    old: np.ndarray
    S: np.ndarray
    begin: np.ndarray
    size: np.ndarray

    def select_members(self, members: np.ndarray) -> _GroupState:
        """The state of some of the runs; `members` (k,) is a mask."""
        return replace(
            self, old=self.old[members], S=self.S[members], begin=self.begin[members], size=self.size[members]
        )


@dataclass(frozen=True)
class _GroupIntegrator:
    """Integration of groups of perturbed runs over one segment.

    Steps are fine up to the slid distance `fine_until` (m).  `first_field`: time (s) of the first field of all cells
    that is recorded after the start.
    """

    phase: Phase
    path: StateInterpolant
    reference: PhaseSegment
    fine_until: float
    first_field: float

    def integrate_group(
        self, perturbed: list[PhaseSegment], now: _GroupState, times: list[tuple[float, bool]], is_abrupt: bool
    ) -> np.ndarray:
        """Differences (k, ...) at the end of the segment.

        Runs for which a step is much too long continue by themselves, as a group that `is_abrupt`: there, a step with a
        correction above the target is repeated with half its length.  Where no road comes round, changes may fade, as
        after a source has passed: corrections are compared with what is left of a change.
        """
        out, members = np.empty_like(now.S), np.arange(len(perturbed))
        times = list(times)
        while now.u < 1.0:
            new = 1.0 if 1.0 - now.u < 1.5 * now.h else now.u + now.h
            h = new - now.u
            t = self.phase.end if new == 1.0 else self.phase.begin + self._segment_span * new**2
            after, change = _bdf2_step(
                self.path(t),
                t,
                2.0 * new * self._segment_span,
                (h, now.before),
                (now.old, now.S),
                self.reference,
                perturbed,
            )
            reached = [one.largest_difference(s) for one, s in zip(perturbed, after - now.begin, strict=True)]
            size = np.maximum(now.size, reached)
            has_track = any(one.perturbed_run.has_track for one in perturbed)
            present = size if has_track else np.maximum(reached, FADED_FRACTION * size)
            target, errors = self._correction_target(t), self._relative_corrections(t, change, present)
            error = float(np.sqrt(np.mean(errors**2)))
            if is_abrupt and error > target and h > MIN_STEP_U:
                now = replace(now, h=0.5 * h)
                continue
            faster = errors > TOO_LONG_RATIO * target
            if not is_abrupt and faster.any() and not faster.all():
                split = [perturbed[k] for k in np.flatnonzero(faster)]
                out[members[faster]] = self.integrate_group(split, now.select_members(faster), times, True)
                perturbed = [perturbed[k] for k in np.flatnonzero(~faster)]
                now, members = now.select_members(~faster), members[~faster]
                continue
            self._record_step(perturbed, now, times, (t, new), after)
            ratio = float(np.clip(np.sqrt(target / max(error, 1e-12)), 0.5, MAX_STEP_GROWTH))
            now = replace(now, u=new, h=min(h * ratio, self._longest_step), before=h, old=now.S, S=after, size=size)
        out[members] = now.S
        return out

    @property
    def _segment_span(self) -> float:
        return self.phase.end - self.phase.begin

    @property
    def _longest_step(self) -> float:
        # road that comes round enters with a temperature that changes all the time: shorter steps resolve it
        return 0.5 * MAX_STEP_U if self.reference.system.b.laws.has_law("road.inflow") else MAX_STEP_U

    def _correction_target(self, t: float) -> float:
        is_fine = self.fine_until and self.reference.system.law_context(t).slid < self.fine_until
        return FINE_CORRECTION_RATIO if is_fine else CORRECTION_RATIO

    def _relative_corrections(self, t: float, change: np.ndarray, size: np.ndarray) -> np.ndarray:
        """Newton's corrections (k,) over the change `size` (k,) of each run.

        Heat spreads, so errors of early steps have decayed when the first field of all cells is recorded: until then
        they count in proportion to the time since the start of the segment.
        """
        m, begin = self.reference.system.b.worn.stop, self.phase.begin
        early = min(1.0, (t - begin) / (self.first_field - begin))
        moved: np.ndarray = early * np.abs(change[:, :m]).max(axis=1, initial=0.0) / size
        return moved

    def _record_step(
        self, perturbed: list[PhaseSegment], now: _GroupState, times: list, end: tuple[float, float], after
    ):
        """Record the runs at all `times` within a step that ends at the time and the u of `end`."""
        t, new = end
        while times and times[0][0] <= t * (1 + 1e-12):
            at = times.pop(0)
            u = float(np.sqrt((at[0] - self.phase.begin) / self._segment_span))
            values = interpolate_quadratic(u, (now.u - now.before, now.u, new), (now.old, now.S, after))
            _record_all(self.path, perturbed, at, values)
        if self.phase.sliding:
            y = self.path(t)
            self.reference.store_own_column(t, y, self.reference.perturbed_run.s)
            for one, s in zip(perturbed, after, strict=True):
                one.store_own_column(t, y, s)


def _fine_step_distance(phase, reference: PhaseSegment, times) -> float:
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
    reference: PhaseSegment,
    perturbed: list[PhaseSegment],
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


def _record_all(path: StateInterpolant, perturbed: list[PhaseSegment], at, S) -> None:
    t, frame = at
    y = path(t)
    for one, s in zip(perturbed, S, strict=True):
        one.record_own(t, y, s, frame)


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
