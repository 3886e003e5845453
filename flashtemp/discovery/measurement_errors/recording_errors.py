"""Handling errors of recordings: mirrored, upside down, exchanged, of another condition, of another view, copies.

One rule decides all of them.  Every hypothesis about a recording is fitted with all freedom of a calibration, including
free pressure shapes, so that a missing effect explains as much as it can under each.  A hypothesis is accepted if its
ln Bayes factor against the recording as stated is very strong (including the prior odds of a handling error and the
number of hypotheses), and if at most half of the excess misfit remains.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property

import numpy as np

from flashtemp.camera.recording import Recording
from flashtemp.comparison.campaign import RecordingEntry
from flashtemp.comparison.noise import NoiseLevels
from flashtemp.discovery.criteria import CRITERIA
from flashtemp.discovery.estimation.nuisance_priors import all_derivatives
from flashtemp.discovery.measurement_errors.image_pose import MAX_RISE_FACTOR, STATED_POSE, ImagePose, with_poses
from flashtemp.discovery.measurement_errors.recording_fit import (
    NO_UNAFFECTED_DATA,
    HypothesisEvidence,
    RecordingFit,
    RecordingHypothesis,
    UnaffectedData,
    compare_fits,
    fit_recording,
    fit_traces,
    flip_recording,
    has_same_times,
    is_schedule_possible,
    predict_hypothesis,
    resample_images,
)
from flashtemp.discovery.prediction.prediction import Observable, Prediction, PredictionTask
from flashtemp.discovery.prediction.problem import Problem, pin_mesh
from flashtemp.errors import FlashtempError
from flashtemp.model.scene import Scene

# A hypothesis is fitted only if its image misfit is below this multiple of the stated one.  This saves cost and decides
# nothing: with a missing effect, the misfit of a correct recording may be that much larger than that of a flipped one.
SCREENING_RATIO = 2.0
MIN_SHARED_FRACTION = 0.5  # of the pixels of two recordings that must be valid in both to compare them
END_TIME_TOLERANCE = 0.05  # relative difference of the last frames of two cameras that record the same test


class ErrorKind(StrEnum):
    """The kind of a handling error."""

    MIRRORED = "mirrored"
    UPSIDE_DOWN = "upside_down"
    ROTATED = "rotated_180"
    OTHER_CONDITION = "other_condition"
    EXCHANGED = "exchanged"
    OTHER_VIEW = "other_view"
    DUPLICATE = "duplicate"


FLIP_AXES = {ErrorKind.MIRRORED: (2,), ErrorKind.UPSIDE_DOWN: (1,), ErrorKind.ROTATED: (1, 2)}
FLIP_WORDS = {
    ErrorKind.MIRRORED: "is mirrored: its leading and trailing end are exchanged",
    ErrorKind.UPSIDE_DOWN: "is upside down",
    ErrorKind.ROTATED: "is rotated by 180 degrees",
}
IMPOSSIBLE_EVIDENCE = HypothesisEvidence(np.inf)


@dataclass(frozen=True)
class RecordingError:
    """One handling error of some `files`: a sentence in `words`, and the `evidence` against the recordings as stated.

    `corrected` {file: (condition number, corrected recording)}; `left_out`: files that are not used; `poses`: positions
    of the images of corrected recordings.
    """

    kind: ErrorKind
    files: tuple[str, ...]
    words: str
    evidence: HypothesisEvidence
    corrected: dict[str, tuple[int, RecordingEntry]] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()
    poses: dict[str, ImagePose] = field(default_factory=dict)


# --- errors that the schedules show, before any simulation -------------------------------------------------------
def find_misassigned_recordings(problem: Problem) -> tuple[RecordingError, ...]:
    """Recordings whose frames contradict the schedule of their condition but match that of another one.

    Two recordings are exchanged if each fits the condition of the other and no third one does.  One is moved if only
    one condition is possible and its frames end like those of a recording there.
    """
    scenes = _condition_scenes(problem)
    entries = [(n, v) for n, c in enumerate(problem.conditions) for v in c.views]
    possible_conditions = {
        v.file: [n for n, scene in enumerate(scenes) if is_schedule_possible(v, scene)] for _, v in entries
    }
    impossible = [(n, v) for n, v in entries if n not in possible_conditions[v.file]]
    out: list[RecordingError] = []
    for number, view in impossible:
        if any(view.file in e.files for e in out):
            continue
        possible = possible_conditions[view.file]
        partners = [
            (n, v)
            for n, v in entries
            if _has_same_view(v, view) and n in possible and number in possible_conditions[v.file]
        ]
        # an exchange makes both impossible where they stand, so such pairs come first; where the other recording is
        # possible in both conditions, only this one shows the exchange
        partners = [pair for pair in partners if pair in impossible] or partners
        if len(partners) == 1:
            [(their_condition, their_view)] = partners
            out.append(_exchange_error((view, their_condition), (their_view, number), IMPOSSIBLE_EVIDENCE))
        elif not partners and len(possible) == 1 and _has_same_end(problem, view, possible[0]):
            out.append(_moved_error(problem, view, possible[0], IMPOSSIBLE_EVIDENCE))
    return tuple(out)


def _has_same_end(problem: Problem, view: RecordingEntry, number: int) -> bool:
    """Whether a recording of a condition ends when this one does; if none does, the schedule itself may be wrong."""
    end = view.recording.time[-1]
    others = (v.recording for v in problem.conditions[number].views if v.file != view.file)
    return any(abs(r.time[-1] - end) <= END_TIME_TOLERANCE * end for r in others)


def _condition_scenes(problem: Problem) -> list[Scene]:
    """The scene of every condition."""
    pairs = zip(problem.conditions, problem.mesh_overrides, strict=True)
    return [problem.case.with_values(c.given | pins).scene for c, pins in pairs]


# --- errors that the evidence shows ------------------------------------------------------------------------------
def find_recording_errors(problem: Problem, predictions: Sequence[Prediction]) -> tuple[RecordingError, ...]:
    """All recordings that are clearly not what they are stated to be: one error for each, the clearest first.

    Errors whose correction is adequate come before those that only reduce the misfit.

    `predictions`: of the stated model, with all nuisances and fields (`replace(all_derivatives(problem),
    fields=True)`).  A condition is simulated again only for a recording that is not adequate as stated and whose frames
    are at other times than those of that condition.
    """
    search = _ErrorSearch(problem, tuple(predictions))
    errors: list[RecordingError] = []
    for find in (_find_duplicates, _find_exchanged_views, _find_flipped, _find_misplaced):
        explained = {file for e in errors if e.evidence.is_adequate for file in e.files}
        errors += find(search, tuple(e for e in search.entries if e.view.file not in explained))
    return tuple(_best_for_each_file(errors))


def _best_for_each_file(errors: Sequence[RecordingError]) -> list[RecordingError]:
    """The clearest error of each recording; those with an adequate correction come first."""
    out: list[RecordingError] = []
    for error in sorted(errors, key=lambda e: (not e.evidence.is_adequate, -e.evidence.ln_bayes)):
        if not any(set(error.files) & set(other.files) for other in out):
            out.append(error)
    return out


def correct_recordings(problem: Problem, errors: Sequence[RecordingError]) -> Problem:
    """The problem with corrected recordings: moved to their conditions, images flipped back, copies left out.

    Conditions keep their order; those without any recording left are removed.
    """
    moved = {file: place for e in errors for file, place in e.corrected.items()}
    left_out = {file for e in errors for file in e.left_out}
    conditions, pins = [], []
    for number, (c, own) in enumerate(zip(problem.conditions, problem.mesh_overrides, strict=True)):
        stay = [moved.get(v.file, (number, v)) for v in c.views if v.file not in left_out]
        come = [place for file, place in moved.items() if all(v.file != file for v in c.views)]
        views = tuple(replace(v, given=c.given) for n, v in (*stay, *come) if n == number)
        new = replace(c, views=views)
        if new.entries:
            conditions.append(new)
            pins.append(own if views == c.views else pin_mesh(problem.campaign, new, list(problem.candidates)))
    kept = {v.file: v for c in conditions for v in c.views}
    views = tuple(kept[v.file] for v in problem.campaign.views if v.file in kept)
    poses = {file: pose for e in errors for file, pose in e.poses.items()}
    corrected = replace(
        problem,
        conditions=tuple(conditions),
        mesh_overrides=tuple(pins),
        campaign=replace(problem.campaign, views=views),
    )
    return with_poses(corrected, poses)


# --- fits of single recordings, with a cache --------------------------------------------------------------------
@dataclass(frozen=True)
class _StatedRecording:
    """A recording as stated: its condition `number` and its prediction there."""

    number: int
    view: RecordingEntry
    predicted: Observable


@dataclass(frozen=True)
class _ErrorSearch:
    """The stated problem with its predictions, and fits of its recordings under hypotheses."""

    problem: Problem
    predictions: tuple[Prediction, ...]

    @cached_property
    def tasks(self) -> list[PredictionTask]:
        return self.problem.make_tasks(self.problem.stated_model, replace(all_derivatives(self.problem), fields=True))

    @cached_property
    def entries(self) -> tuple[_StatedRecording, ...]:
        pairs = enumerate(zip(self.problem.conditions, self.predictions, strict=True))
        return tuple(_StatedRecording(n, v, made.observables[v.file]) for n, (c, made) in pairs for v in c.views)

    @cached_property
    def scenes(self) -> list[Scene]:
        return _condition_scenes(self.problem)

    @cached_property
    def _fit_cache(self) -> dict[tuple[str, bool], RecordingFit]:
        return {}

    def stated_fit(self, e: _StatedRecording) -> RecordingFit:
        """The linearised fit of a recording as stated."""
        key = e.view.file, False
        if key not in self._fit_cache:
            self._fit_cache[key] = self.fit_stated(e)
        return self._fit_cache[key]

    def fit_stated(self, e: _StatedRecording, noise: NoiseLevels | None = None) -> RecordingFit:
        hypothesis = RecordingHypothesis(e.view, e.number)
        return fit_recording(self.problem, self.tasks[e.number], self.predictions[e.number], hypothesis, noise)

    def aligned_stated_fit(self, e: _StatedRecording) -> RecordingFit:
        """The fit of a recording as stated, with its image aligned."""
        key = e.view.file, True
        if key not in self._fit_cache:
            self._fit_cache[key] = self.stated_fit(e).with_aligned_image()
        return self._fit_cache[key]

    def fit_under_hypothesis(
        self, e: _StatedRecording, hypothesis: RecordingHypothesis, source: RecordingEntry
    ) -> RecordingFit | None:
        """The fit of a recording under a hypothesis, from the fields of `source`; None if it cannot be predicted."""
        n = hypothesis.condition
        try:
            hypothesis, made = predict_hypothesis(self.problem, self.tasks[n], self.predictions[n], source, hypothesis)
            return fit_recording(self.problem, self.tasks[n], made, hypothesis, self.stated_fit(e).noise)
        except FlashtempError:  # under this hypothesis no pixel would be valid
            return None

    def image_misfit(self, view: RecordingEntry, predicted: np.ndarray) -> float:
        """Residual (rms, K) against predicted images (frames, nv, nu), scaled by a factor that friction may explain."""
        ambient = self.problem.case["ambient.temperature"]
        measured, rise = view.recording.temperature - ambient, predicted - ambient
        known = np.isfinite(measured) & np.isfinite(rise)
        if not known.any():
            return float("inf")
        own, rise = measured[known], rise[known]
        factor = np.clip(own @ rise / max(float(rise @ rise), 1e-300), 1.0 / MAX_RISE_FACTOR, MAX_RISE_FACTOR)
        return float(np.sqrt(np.mean((own - factor * rise) ** 2)))

    def stated_misfit(self, e: _StatedRecording) -> float:
        return self.image_misfit(e.view, np.where(e.predicted.inside, e.predicted.values, np.nan))

    def count_hypotheses(self, e: _StatedRecording) -> int:
        """Number of hypotheses about a recording."""
        return len(_possible_flips(e.view)) + len(self.problem.conditions) - 1

    def evidence_if_clear(
        self, recordings: Sequence[_StatedRecording], fits: Sequence[RecordingFit], is_expected: bool = False
    ) -> HypothesisEvidence | None:
        """Evidence of joint hypotheses about recordings against these as stated; None if it is not clear.

        `is_expected`: the same error was found in another recording, so that it has even prior odds.

        Images are aligned only if the linearised fits are better, because alignment under a wrong hypothesis is slow.
        """
        if compare_fits(self.problem, [self.stated_fit(a) for a in recordings], fits).ln_bayes <= 0.0:
            return None
        try:
            stated, aligned = (
                [self.aligned_stated_fit(a) for a in recordings],
                [fit.with_aligned_image() for fit in fits],
            )
            evidence = compare_fits(self.problem, stated, aligned, self._find_unaffected_data(recordings, fits))
        except FlashtempError:
            return None
        if is_expected and evidence.ln_bayes > CRITERIA.ln_bayes_distinct:
            return evidence
        return evidence if evidence.is_clear(self.count_hypotheses(recordings[0])) else None

    def _find_unaffected_data(
        self, recordings: Sequence[_StatedRecording], fits: Sequence[RecordingFit]
    ) -> UnaffectedData:
        """All other data of the conditions between which recordings may have to be moved."""
        numbers = {a.number for a in recordings} | {fit.hypothesis.condition for fit in fits}
        if all(a.number == fit.hypothesis.condition for a, fit in zip(recordings, fits, strict=True)):
            return NO_UNAFFECTED_DATA
        files = {a.view.file for a in recordings}
        others = tuple(o for o in self.entries if o.number in numbers and o.view.file not in files)
        traces = (fit_traces(self.problem, self.predictions[n], n) for n in sorted(numbers))
        return UnaffectedData(tuple(map(self.aligned_stated_fit, others)), tuple(b for found in traces for b in found))


# --- copies ------------------------------------------------------------------------------------------------------
def _find_duplicates(search: _ErrorSearch, entries: Sequence[_StatedRecording]) -> Iterator[RecordingError]:
    """Copies: recordings with the same values, noise included.  The one that fits worse is left out."""
    for k, second in enumerate(entries):
        first = next((e for e in entries[:k] if _has_same_values(e.view, second.view)), None)
        if first is None:
            continue
        other = search.stated_fit(second)
        if other.noise != (noise := search.stated_fit(first).noise):  # the same values have the same noise
            other = search.fit_stated(second, noise)
        fits = {second.view.file: other, first.view.file: search.stated_fit(first)}
        wrong, right = sorted(fits, key=lambda file: fits[file].ln_evidence)
        evidence = HypothesisEvidence(np.inf, fits[wrong].chi2_per_datum, fits[right].chi2_per_datum)
        words = f"{wrong} has the same values as {right}"
        yield RecordingError(ErrorKind.DUPLICATE, (wrong, right), words, evidence, left_out=(wrong,))


def _has_same_values(a: RecordingEntry, b: RecordingEntry) -> bool:
    """Whether all values that are valid in both recordings are equal, and not all the same."""
    first, second = a.recording.temperature, b.recording.temperature
    if first.shape != second.shape:
        return False
    known = np.isfinite(first) & np.isfinite(second)
    is_enough = np.count_nonzero(known) >= MIN_SHARED_FRACTION * np.count_nonzero(
        np.isfinite(first) | np.isfinite(second)
    )
    return bool(
        known.any() and is_enough and np.array_equal(first[known], second[known]) and np.ptp(first[known]) > 0.0
    )


# --- flipped images ---------------------------------------------------------------------------------------------
def _possible_flips(view: RecordingEntry) -> list[ErrorKind]:
    """Ways in which the images of a recording may be flipped; a wake is symmetric up and down."""
    r = view.recording
    if r.places is not None or len(r.u) < 2:
        return []
    has_rows = r.view == "sidewall" and len(r.v) > 1
    return [ErrorKind.MIRRORED, *((ErrorKind.UPSIDE_DOWN, ErrorKind.ROTATED) if has_rows else ())]


def _find_flipped(search: _ErrorSearch, entries: Sequence[_StatedRecording]) -> Iterator[RecordingError]:
    """Images that are clearly flipped, and those of the same view that are more likely flipped likewise than not.

    All images of a camera are usually exported in the same way, so a second flip of a view has even prior odds.
    """
    found = [e for entry in entries for kind in _possible_flips(entry.view) if (e := _flip_error(search, entry, kind))]
    yield from found
    views = {e.view.file: e.view.recording.view for e in entries}
    happened = {(views[e.files[0]], e.kind) for e in _best_for_each_file(found)}
    concerned = {e.files[0] for e in found}
    for entry in entries:
        for kind in _possible_flips(entry.view):
            if entry.view.file not in concerned and (entry.view.recording.view, kind) in happened:
                yield from filter(None, [_flip_error(search, entry, kind, True)])


def _flip_error(
    search: _ErrorSearch, e: _StatedRecording, kind: ErrorKind, is_expected: bool = False
) -> RecordingError | None:
    """The error that a recording is flipped, if the evidence is clear."""
    length = search.problem.case["block.length"]
    views = [replace(e.view, recording=r) for r in flip_recording(e.view.recording, FLIP_AXES[kind], length)]
    misfits = [search.image_misfit(v, resample_images(e.predicted, e.view, v)) for v in views]
    best = int(np.argmin(misfits))
    if not is_expected and not misfits[best] < SCREENING_RATIO * search.stated_misfit(e):
        return None
    hypothesis = RecordingHypothesis(views[best], e.number, FLIP_AXES[kind])
    fit = search.fit_under_hypothesis(e, hypothesis, e.view)
    evidence = fit and search.evidence_if_clear([e], [fit], is_expected)
    if not fit or not evidence:
        return None
    file = e.view.file
    poses = {} if fit.pose == STATED_POSE else {file: fit.pose}
    corrected = {file: (e.number, views[best])}
    return RecordingError(kind, (file,), f"{file} {FLIP_WORDS[kind]}", evidence, corrected, poses=poses)


# --- recordings of another condition -----------------------------------------------------------------------------
def _find_misplaced(search: _ErrorSearch, entries: Sequence[_StatedRecording]) -> Iterator[RecordingError]:
    """Recordings that belong to another condition, and pairs that are exchanged."""
    for e in entries:
        host = _find_likeliest_host(search, e)
        visit = None if host is None else _fit_at_host(search, e, host)
        if host is None or visit is None:
            continue
        back = _fit_at_host(search, host, e)
        if back is not None and (found := search.evidence_if_clear([e, host], [visit, back])):
            yield _exchange_error((e.view, host.number), (host.view, e.number), found)
        if found := search.evidence_if_clear([e], [visit]):
            yield _moved_error(search.problem, e.view, host.number, found)


def _find_likeliest_host(search: _ErrorSearch, e: _StatedRecording) -> _StatedRecording | None:
    """The recording of another condition whose predicted images fit this one best, if better than its own."""
    others = [o for o in search.entries if o.number != e.number and _has_same_view(e.view, o.view)]
    found = [(search.image_misfit(e.view, resample_images(o.predicted, o.view, e.view)), o) for o in others]
    best = min(found, key=lambda pair: pair[0], default=None)
    return best[1] if best and best[0] < search.stated_misfit(e) else None


def _has_same_view(a: RecordingEntry, b: RecordingEntry) -> bool:
    """Whether two recordings are of the same view, and for points of the same positions."""
    first, second = a.recording, b.recording
    if first.view != second.view:
        return False
    if first.places is None or second.places is None:
        return True
    a_places, b_places = (np.stack([p.x, p.y, p.z]) for p in (first.places, second.places))
    return np.array_equal(a_places, b_places)


def _fit_at_host(search: _ErrorSearch, e: _StatedRecording, host: _StatedRecording) -> RecordingFit | None:
    """The fit of a recording under the condition of another one; None if it cannot belong there.

    If their frames are at other times, the condition is simulated again, but only for a recording that is not adequate
    as stated.
    """
    if not is_schedule_possible(e.view, search.scenes[host.number]):
        return None
    hypothesis = RecordingHypothesis(e.view, host.number)
    if has_same_times(e.view, host.view):
        return search.fit_under_hypothesis(e, hypothesis, host.view)
    if search.aligned_stated_fit(e).is_adequate:
        return None
    task = replace(search.tasks[host.number], views=(e.view,), forces=())
    [made] = search.problem.run([task])
    if isinstance(made, FlashtempError):
        return None
    try:
        return fit_recording(search.problem, task, made, hypothesis, search.stated_fit(e).noise)
    except FlashtempError:
        return None


def _find_exchanged_views(search: _ErrorSearch, entries: Sequence[_StatedRecording]) -> Iterator[RecordingError]:
    """Pairs of recordings of one condition whose images have the view and pixel positions of each other."""
    for k, a in enumerate(entries):
        for b in entries[k + 1 :]:
            shapes = a.view.recording.temperature.shape, b.view.recording.temperature.shape
            views = {a.view.recording.view, b.view.recording.view}
            if a.number != b.number or len(views) < 2 or "points" in views or shapes[0] != shapes[1]:
                continue
            if not has_same_times(a.view, b.view):
                continue
            if error := _view_error(search, a, b):
                yield error


def _view_error(search: _ErrorSearch, a: _StatedRecording, b: _StatedRecording) -> RecordingError | None:
    """The error that two recordings have each other's view, if the evidence is clear."""
    pairs = (a, b), (b, a)
    views = [replace(e.view, recording=place_images(o.view.recording, e.view.recording)) for e, o in pairs]
    before = [search.stated_misfit(e) for e in (a, b)]
    after = [search.image_misfit(v, o.predicted.values) for v, (_, o) in zip(views, pairs, strict=True)]
    if not sum(x**2 for x in after) < sum(x**2 for x in before):
        return None
    fits = []
    for view, (e, other) in zip(views, pairs, strict=True):
        made = replace(search.predictions[e.number], observables={view.file: other.predicted})
        hypothesis = RecordingHypothesis(view, e.number)
        try:
            fits.append(
                fit_recording(search.problem, search.tasks[e.number], made, hypothesis, search.stated_fit(e).noise)
            )
        except FlashtempError:
            return None
    evidence = search.evidence_if_clear([a, b], fits)
    if not evidence:
        return None
    files = a.view.file, b.view.file
    words = f"{files[0]} and {files[1]} are stated with each other's view: {files[0]} is a {views[0].recording.view}"
    corrected = {v.file: (a.number, v) for v in views}
    return RecordingError(ErrorKind.OTHER_VIEW, files, words, evidence, corrected)


def place_images(pixels: Recording, images: Recording) -> Recording:
    """The images of one recording with the view and pixel positions of another."""
    return replace(images, view=pixels.view, u=pixels.u, v=pixels.v)


def _moved_error(problem: Problem, view: RecordingEntry, to: int, evidence: HypothesisEvidence) -> RecordingError:
    words = f"{view.file} belongs to another condition: {problem.conditions[to].words}"
    return RecordingError(ErrorKind.OTHER_CONDITION, (view.file,), words, evidence, {view.file: (to, view)})


def _exchange_error(
    first: tuple[RecordingEntry, int], second: tuple[RecordingEntry, int], evidence: HypothesisEvidence
) -> RecordingError:
    """The error of two exchanged recordings, each given with the condition that it belongs to."""
    (a, to), (b, back) = first, second
    words = f"{a.file} and {b.file} are exchanged: each belongs to the condition of the other"
    return RecordingError(ErrorKind.EXCHANGED, (a.file, b.file), words, evidence, {a.file: (to, a), b.file: (back, b)})
