"""A running test: camera files that arrive in a folder become recordings of a campaign, which are assessed at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.camera import recording
from flashtemp.camera.importing import growing_recording
from flashtemp.camera.importing.arriving_files import FileState, FolderScanner
from flashtemp.camera.importing.frame_times import read_stated_times
from flashtemp.camera.importing.growing_recording import FileNews, GrowingRecording, RecordingTemplate
from flashtemp.camera.importing.recording_import import ImportResult
from flashtemp.camera.recording import Recording
from flashtemp.comparison import campaign as campaigns
from flashtemp.discovery.live_evidence import ComparedRecording, LiveAssessment, LiveEvidence, root_mean_square
from flashtemp.errors import BadInput, FlashtempError, describe_exception

TIME_ROUNDING_S = 1e-6  # s, to which times of frames are equal
# kinds of events, besides the states of a camera file
DECIDED, UNDECIDED, RESUMED, PROBLEM = "decided", "undecided", "resumed", "problem"


@dataclass(frozen=True)
class WatchEvent:
    """What happened at a `time` (local, ISO 8601): `kind` is imported, waiting, refused or repeated for a camera
    `file`, decided or undecided for the evidence, resumed for recordings that existed before the watch, or problem.

    For an imported file: its `frames`, their `rmse_K` against the stated model and `calibrated_rmse_K` with all
    nuisances estimated, and the `leader` of the hypotheses with its `ln_bayes` against the stated model; None where not
    known.  `words`: the reason, or what the evidence says.
    """

    time: str
    kind: str
    file: str = ""
    recording: str = ""
    frames: int | None = None
    rmse_K: float | None = None
    calibrated_rmse_K: float | None = None
    leader: str = ""
    ln_bayes: float | None = None
    words: str = ""

    def as_dict(self) -> dict[str, Any]:
        """The fields as plain data."""
        return asdict(self)

    def __str__(self) -> str:
        place = f"{self.file} -> {self.recording}" if self.recording else self.file
        if self.kind == growing_recording.IMPORTED:
            parts = [f"{place}: {self.frames} frame{'' if self.frames == 1 else 's'}"]
            if self.rmse_K is not None:
                fitted = "" if self.calibrated_rmse_K is None else f", {self.calibrated_rmse_K:.3f} K calibrated"
                parts.append(f"{self.rmse_K:.3f} K rms{fitted}")
            if self.ln_bayes is not None:
                parts.append(f"{self.leader} leads, ln Bayes factor {self.ln_bayes:.1f}")
            text = "; ".join(parts)
        else:
            text = f"{place}: {self.kind}: {self.words}" if place else f"{self.kind}: {self.words}"
        line = text.replace("\n", "\\n")  # of a file name; each event is one line
        return f"{self.time[11:19]} {line}"


@dataclass(frozen=True)
class HistoryEntry:
    """The evidence at one `time`: number of `frames`, and ln Bayes factors against the stated model by effect."""

    time: str
    frames: int
    leader: str
    margin: float
    is_decided: bool
    ln_bayes: dict[str, float]
    rmse_K: dict[str, float]


def find_templates(folder: Path, home: Path, names: Sequence[str]) -> dict[str, RecordingTemplate]:
    """{recording: template} of the recordings `names` of a campaign in `home`, from templates there or in `folder`.

    `folder` is that of the camera files.  A template belongs to the recording that its `out` states.  Raises BadInput.
    """
    files = {(home / name).resolve(): name for name in names}
    places = dict.fromkeys((home.resolve(), folder.resolve()))
    found: dict[str, RecordingTemplate] = {}
    # hidden files are left out, as among camera files: some systems write one beside every file
    for path in (path for place in places for path in sorted(place.glob("[!.]*.toml"))):
        template = RecordingTemplate.from_file(path, folder)
        name = None if template is None else files.get(template.out)
        if template is None or name is None:
            continue
        if not any(template.out.is_relative_to(place) for place in places):
            raise BadInput(f"{path}: out: {name} lies outside of {home}; a watch writes recordings inside it")
        if name in found:
            raise BadInput(f"{path}: out: {name} is also made by {found[name].path}; keep one template of a recording")
        found[name] = template
    if not found:
        names = ", ".join(list(files.values())[:3]) or "a recording"
        raise BadInput(
            f"{home}: no recording template whose out is a recording of the campaign ({names}); write one"
            " with flashtemp new recording"
        )
    return found


@dataclass
class WatchedTest:
    """A campaign, in `path`, whose camera files arrive in `folder`.

    `overwrite`: a recording may lose frames that it had before the watch.  `history`: the evidence after every change;
    `events` since the start.  `limit`: GB of memory for reading one recording.  `on_recording` is called for every new
    recording with its import and its path.  `simulations`: conditions that were simulated.
    """

    folder: Path
    path: Path
    trust: bool = False
    limit: float | None = None
    overwrite: bool = False
    assessment: LiveAssessment | None = None
    latest: str = ""  # the recording that changed last
    history: list[HistoryEntry] = field(default_factory=list)
    events: list[WatchEvent] = field(default_factory=list)
    simulations: int = 0
    on_recording: Callable[[ImportResult, Path], Any] = lambda result, path: None
    _saved: set[str] = field(default_factory=set)
    _complete: dict[Path, FileState] = field(default_factory=dict)
    _unfinished: dict[Path, FileState] = field(default_factory=dict)
    _is_begun: bool = False

    def __post_init__(self) -> None:
        self.campaign = campaigns.load(self.path, trust=self.trust, limit=self.limit, may_miss=True)
        self._scanner = FolderScanner(self.folder.resolve())
        self._scanner.scan_files()
        home, names = self.campaign.folder, [*(v.file for v in self.campaign.views), *self.campaign.awaited]
        self.growing = {
            name: GrowingRecording(template, home)
            for name, template in find_templates(self.folder, home, names).items()
        }

    @property
    def is_decided(self) -> bool:
        """Whether the data so far suffice to tell the leading hypothesis from the others."""
        return self.assessment is not None and self.assessment.decision.is_decided

    def scan_folder(self) -> None:
        """Look which files are there and complete.  Raises BadInput where the folder is gone."""
        self._complete, self._unfinished = self._scanner.scan_files()

    def process_files(self, evidence: LiveEvidence, now: float, patience: float) -> list[WatchEvent]:
        """Import files that have arrived, assess the data by `evidence`, and say what happened.

        `now`, s of any clock; a file that stays bad for `patience` s is refused.
        """
        news = {
            name: growing.take_files(self._complete, self._unfinished, now, patience)
            for name, growing in self.growing.items()
        }
        events, changed = [], {}
        for name, some in news.items():
            imported = [n.file for n in some if n.state == growing_recording.IMPORTED]
            if imported and (fault := self._save_recording(name)):
                events.append(_make_event(PROBLEM, recording=name, words=fault))
            elif imported:
                changed[name] = imported
        before, is_first = self.assessment, not self._is_begun
        self._is_begun = True
        if is_first and self.campaign.views and not changed:
            count = len(self.campaign.views)
            events.append(_make_event(RESUMED, words=f"{count} recording{'s' * (count > 1)} from before this watch"))
        if changed or (is_first and self.campaign.views):
            self.latest = [*(v.file for v in self.campaign.views), *changed][-1]
            events += self._assess(evidence)
        events = [*self._describe_files(news, changed, self.assessment is not before), *events]
        self.events += events
        return events

    def _save_recording(self, name: str) -> str | None:
        """Replace the file of a recording by a complete one; the reason in one line where that is not possible."""
        result, path = self.growing[name].result, self.campaign.folder / name
        assert result is not None
        try:
            is_new = not path.exists()
            if not is_new and not self.overwrite and self._loses_frames(name, path, result.recording):
                return (
                    f"{path} has frames that the camera files in {self.folder} lack; it stays: move it away, or give"
                    " --overwrite"
                )
            result.recording.save(path)
            self._saved.add(name)
        except (BadInput, OSError) as fault:
            return describe_exception(fault)
        if is_new:
            self.on_recording(result, path)
        return None

    def _loses_frames(self, name: str, path: Path, new: Recording) -> bool:
        """Whether the file of a recording has frames that the new one lacks; of an own one only the number counts."""
        old = recording.load(path, self.limit)
        return new.frames < old.frames if name in self._saved else not bool(np.all(_are_among(old.time, new.time)))

    def _assess(self, evidence: LiveEvidence) -> list[WatchEvent]:
        """Assess the campaign as it is now; events where that fails or where the decision changes."""
        was_decided, leader = self.is_decided, self.assessment and self.assessment.decision.leader
        try:
            self.campaign = campaigns.load(self.path, trust=self.trust, limit=self.limit, may_miss=True)
            stated = {
                name: times
                for name, growing in self.growing.items()
                if (times := read_stated_times(growing.template.facts)) is not None
            }
            self.assessment = evidence.assess(self.campaign, stated)
        except (FlashtempError, ArithmeticError, np.linalg.LinAlgError) as fault:  # the test goes on
            return [_make_event(PROBLEM, words=describe_exception(fault).splitlines()[0])]
        finally:
            self.simulations = evidence.simulations
        decision = self.assessment.decision
        self.history.append(self._history_entry(self.assessment))
        if decision.is_decided and (not was_decided or decision.leader != leader):
            return [_make_event(DECIDED, leader=decision.leader, ln_bayes=decision.ln_bayes, words=decision.words)]
        if was_decided and not decision.is_decided:
            return [_make_event(UNDECIDED, leader=decision.leader, ln_bayes=decision.ln_bayes, words=decision.words)]
        return []

    def _history_entry(self, assessment: LiveAssessment) -> HistoryEntry:
        decision = assessment.decision
        return HistoryEntry(
            _clock(), sum(v.recording.frames for v in self.campaign.views), decision.leader, decision.margin,
            decision.is_decided, {h.effect: h.ln_bayes for h in assessment.hypotheses},
            {name: r.rmse_K for name, r in assessment.recordings.items()},
        )  # fmt: skip

    def _describe_files(
        self, news: dict[str, list[FileNews]], changed: dict[str, list[Path]], is_assessed: bool
    ) -> list[WatchEvent]:
        """One event for each camera file; figures of an assessment only if it includes the file."""
        events = []
        for name, some in news.items():
            for item in some:
                shown = self._relative_name(item.file)
                if item.state != growing_recording.IMPORTED:
                    events.append(
                        _make_event(
                            item.state, file=shown, recording=name, words=item.reason.removeprefix(f"{item.file}: ")
                        )
                    )
                    continue
                times = _frame_times(self.growing[name].result, item.file)
                about: dict[str, Any] = {"frames": len(times)}
                if is_assessed and name in changed and self.assessment is not None:
                    about |= _file_residuals(self.assessment.recordings[name], times)
                    decision = self.assessment.decision
                    about |= {"leader": decision.leader, "ln_bayes": decision.ln_bayes}
                events.append(_make_event(item.state, file=shown, recording=name, **about))
        return events

    def _relative_name(self, file: Path) -> str:
        return file.relative_to(self.folder.resolve()).as_posix()


def _make_event(kind: str, **about: Any) -> WatchEvent:
    return WatchEvent(_clock(), kind, **about)


def _clock() -> str:
    return datetime.now().astimezone().isoformat(timespec="seconds")


def _frame_times(result: ImportResult | None, file: Path) -> np.ndarray:
    """Times (frames,) s of the frames of one file; of all frames for a table of thermocouples."""
    assert result is not None
    time = result.recording.time
    return time if result.file_numbers is None else time[result.file_numbers == result.files.index(file)]


def _file_residuals(compared: ComparedRecording, times: np.ndarray) -> dict[str, float | None]:
    """Root mean squares (K) of the frames at some times (s); None if none of them is compared."""
    own = _are_among(compared.entry.recording.time, times)
    if not own.any():
        return {}
    plain, fitted = (root_mean_square(r[own]) for r in (compared.residual, compared.calibrated_residual))
    # frames of a wake near a start of sliding are not fitted
    return {"rmse_K": None if np.isnan(plain) else plain, "calibrated_rmse_K": None if np.isnan(fitted) else fitted}


def _are_among(time: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Whether each time (s) is one of the others."""
    return np.isin(np.round(time / TIME_ROUNDING_S), np.round(others / TIME_ROUNDING_S))


def as_names(files: Sequence[Path], folder: Path) -> list[str]:
    """Names of camera files, relative to their folder."""
    return [file.relative_to(folder.resolve()).as_posix() for file in files]
