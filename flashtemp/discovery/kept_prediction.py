"""Predictions kept while frames arrive: a condition is simulated once for all frames that it is likely to have.

The frames to come follow from the table of times of a recording, from its frame rate, or from the times of the frames
in earlier repetitions.  A condition is simulated again only if frames come that none of this foretold.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from flashtemp.camera.recording import Recording
from flashtemp.comparison.campaign import RecordingEntry
from flashtemp.discovery.estimation.nuisance_priors import all_derivatives
from flashtemp.discovery.parameters import ParameterId, ParameterKind
from flashtemp.discovery.prediction.mesh_extrapolation import coarser_mesh_factors
from flashtemp.discovery.prediction.prediction import (
    CLOCK_STEP_S,
    DerivativeRequest,
    Observable,
    Prediction,
)
from flashtemp.discovery.prediction.problem import Problem
from flashtemp.model.schedule import Schedule

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
MAX_COMPARED_VALUES = 500_000  # values of all recordings that are compared: frames are thinned above it, for speed
MAX_STEP_SCATTER = 0.25  # relative difference between steps of time, up to which frames are evenly spaced
MIN_MATCHED_FRACTION = 0.5  # of the frames that thinning leaves, below which a condition is simulated again
CLOCK = ParameterId(ParameterKind.CLOCK)


def foresee_times(recording: Recording, schedule: Schedule, stated: Array | None, max_frames: int) -> tuple[Array, int]:
    """Times (s) of the frames that a recording has and of those that it is likely to have in the end, increasing.

    `stated`: times of all frames, if a table states them.  If there are more than `max_frames`, every n-th is left;
    n is the second value.
    """
    known, end = recording.time, schedule.end_time
    if stated is not None:
        coming = stated
    elif step := _frame_interval(recording):
        coming = np.arange(known[-1] + step, end + 1e-6 * step, step)
    else:  # the same instants of later repetitions
        starts = np.array(sorted({p.start for p in schedule.phases}))
        later = [
            known[recording.repetition == r + 1] + (later_start - start)
            for r, start in enumerate(starts)
            for later_start in starts[r + 1 :]
        ]
        coming = np.concatenate([np.zeros(0), *later])
    is_new = np.min(np.abs(coming[:, None] - known), axis=1, initial=np.inf) > 0.5 * CLOCK_STEP_S
    times = np.sort(np.concatenate([known, coming[is_new & (coming <= end)]]))
    every = -(-len(times) // max(max_frames, 2))
    return times[::every], every


def _frame_interval(recording: Recording) -> float | None:
    """Time between frames (s), of a single one by its frame rate; None where they are not evenly spaced.

    Snapshots state the rate of the camera too, so the times of frames count more than the rate.
    """
    if recording.frames == 1:
        return 1.0 / recording.fps if recording.fps else None
    steps = np.diff(recording.time)
    usual = float(np.median(steps)) if len(steps) else 0.0
    is_even = usual > 0.0 and np.all(np.abs(steps - usual) <= MAX_STEP_SCATTER * usual)
    return usual if is_even else None


def match_frames(time: Array, predicted: Array) -> tuple[Indices, Indices]:
    """Indices of frames with `time` (s) and of the `predicted` frames that belong to them, one each, in order.

    >>> match_frames(np.array([0.0, 0.501, 0.7]), np.array([0.0, 0.5, 1.0]))
    (array([0, 1]), array([0, 1]))
    """
    if not len(predicted):
        return np.zeros(0, int), np.zeros(0, int)
    edges = 0.5 * (predicted[1:] + predicted[:-1])
    nearest = np.searchsorted(edges, time)
    distance = np.abs(time - predicted[nearest])
    best: dict[int, int] = {}
    for frame in np.flatnonzero(distance <= CLOCK_STEP_S):
        k = int(nearest[frame])
        if k not in best or distance[frame] < distance[best[k]]:
            best[k] = int(frame)
    return np.array(list(best.values()), int), np.array(list(best), int)


@dataclass(frozen=True)
class KeptCondition:
    """The prediction of a condition for the foreseen frames of `views`, on its mesh and on `coarser` ones.

    `every` {recording: n}: one frame of n is predicted.
    """

    views: dict[str, RecordingEntry]
    every: dict[str, int]
    fine: Prediction
    coarser: tuple[Prediction, ...]

    def covers(self, views: tuple[RecordingEntry, ...]) -> bool:
        """Whether it has the frames of some recordings: all of them, or half of those that thinning leaves."""
        for view in views:
            frames, _ = match_frames(view.recording.time, self.views[view.file].recording.time)
            every = self.every[view.file]
            if len(frames) < view.recording.frames * (MIN_MATCHED_FRACTION / every if every > 1 else 1.0):
                return False
        return True

    def select_frames(self, views: tuple[RecordingEntry, ...]) -> tuple[tuple[RecordingEntry, ...], list[Prediction]]:
        """The recordings with the frames that are compared, and the predictions of these frames."""
        chosen, matched = [], {}
        for view in views:
            kept = self.views[view.file].recording
            frames, predicted = match_frames(view.recording.time, kept.time)
            late = view.recording.time[frames] - kept.time[predicted]
            matched[view.file] = predicted, late
            chosen.append(replace(view, recording=view.recording.select_frames(frames)))
        clocks = {f: o.columns.get(CLOCK) for f, o in self.fine.observables.items()}
        return tuple(chosen), [_select_prediction(p, matched, clocks) for p in (self.fine, *self.coarser)]


def _select_prediction(
    prediction: Prediction,
    matched: Mapping[str, tuple[Indices, Array]],
    clocks: Mapping[str, npt.NDArray[np.float32] | None],
) -> Prediction:
    out = dict(prediction.observables)
    for file, (frames, late) in matched.items():
        out[file] = _select_frames(out[file], frames, late, clocks[file])
    return replace(prediction, observables=out)


def _select_frames(
    observable: Observable, frames: Indices, late: Array, clock: npt.NDArray[np.float32] | None
) -> Observable:
    """Some frames, to first order at times that are `late` (s) against those of the prediction.

    The derivative by the `clock` is that by a late stamp, so it has the opposite sign.
    """
    values = observable.values[frames]
    if clock is not None:
        values[:, observable.inside] -= late[:, None] * clock[frames]
    return Observable(values, observable.inside, {p: c[frames] for p, c in observable.columns.items()})


def predict_foreseen(
    problem: Problem, numbers: list[int], stated_times: Mapping[str, Array]
) -> dict[int, KeptCondition]:
    """Predict conditions, by their numbers, for all foreseen frames, with derivatives by all that may be unknown.

    `stated_times` {recording: s}: times of all its frames, where a table states them.  Raises BadInput, SolverFailure.
    """
    total = sum(v.recording.temperature[0].size for v in problem.campaign.views)
    max_frames = max(2, MAX_COMPARED_VALUES // total)
    views: dict[int, dict[str, RecordingEntry]] = {n: {} for n in numbers}
    every: dict[str, int] = {}
    for n in numbers:
        schedule = problem.campaign.load(problem.conditions[n].given).scene.schedule
        for v in problem.conditions[n].views:
            times, every[v.file] = foresee_times(v.recording, schedule, stated_times.get(v.file), max_frames)
            views[n][v.file] = _blank_entry(v, schedule, times)
    wanted = replace(all_derivatives(problem), candidates=problem.candidates)
    model = problem.stated_model
    meshes = [problem.make_tasks(model, wanted)]
    meshes += [problem.make_tasks(model, DerivativeRequest(), cells) for cells in coarser_mesh_factors(problem.case)]
    tasks = [replace(mesh[n], views=tuple(views[n].values())) for n in numbers for mesh in meshes]
    answers = iter(problem.predict(tasks))
    out = {}
    for n in numbers:
        fine, *coarser = (next(answers) for _ in meshes)
        out[n] = KeptCondition(views[n], {file: every[file] for file in views[n]}, fine, tuple(coarser))
    return out


def _blank_entry(view: RecordingEntry, schedule: Schedule, times: Array) -> RecordingEntry:
    """A recording with its foreseen frames at `times` (s), whose temperatures mean nothing."""
    r = view.recording
    stated_repetition = dict(zip(r.time.tolist(), r.repetition.tolist(), strict=True))
    repetition = np.array([stated_repetition.get(t, schedule.phase_at(t).repetition) for t in times.tolist()])
    blank = np.zeros((len(times), len(r.v), len(r.u)), np.float32)
    return replace(view, recording=replace(r, temperature=blank, time=times, repetition=repetition))
