"""Watch a running test: import camera files as they arrive, compare them, and say when the data suffice."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from flashtemp.api.inputs import Say, ignore_message
from flashtemp.camera.importing.recording_import import ImportResult
from flashtemp.comparison.condition_remarks import remark_on_conditions
from flashtemp.discovery.criteria import CRITERIA
from flashtemp.discovery.latest_frame import describe_latest_frame
from flashtemp.discovery.live_evidence import LiveEvidence
from flashtemp.discovery.prediction.prediction import predict_condition
from flashtemp.discovery.watched_test import PROBLEM, WatchedTest, WatchEvent, as_names
from flashtemp.display import DisplayMixin, DisplayTable, write_json
from flashtemp.errors import BadInput, UserInterrupt, describe_exception
from flashtemp.runs.results.live_state import open_live_file
from flashtemp.runs.results.worker_pool import open_worker_pool

STATE_FILE, PICTURE_FILE = "watch.json", "watch.png"
MAX_EVENTS_STORED = 200  # latest events in watch.json
INTERVAL_LIMITS_S = (0.05, 3600.0)  # s between two looks into the folder
WATCHING, ENDED, INTERRUPTED = "watching", "ended", "interrupted"  # states of a watch


def watch(
    folder: str | Path,
    campaign: str | Path,
    *,
    out: str | Path | None = None,
    interval: float = 2.0,
    patience: float = 60.0,
    once: bool = False,
    until_decided: bool = False,
    overwrite: bool = False,
    workers: int | None = None,
    trust: bool = False,
    limit: float | None = None,
    say: Say = ignore_message,
) -> CampaignWatch:
    """Watch a folder in which camera files of a campaign arrive; iterate over the result for what happens.

    Each file is imported by the template of its recording and compared with the prediction.  `out`: folder for
    watch.json and watch.png, which are rewritten after every change.  `interval`, s between two looks; a file that
    stays bad for `patience` s is refused.  `once`: process what is there and end; `until_decided`: end when the data
    suffice.  `overwrite`: recordings may lose frames that they had before.  Raises BadInput.
    """
    low, high = INTERVAL_LIMITS_S
    if not low <= interval <= high:
        raise BadInput(f"interval: {interval:g}; give {low:g} to {high:g} s")
    if not 0.0 <= patience < math.inf:
        raise BadInput(f"patience: {patience:g}; give s, at least 0")
    if once and until_decided:
        raise BadInput("once: does not go with until_decided; give one of them")
    if workers is not None and workers < 1:
        raise BadInput(f"--workers: {workers}; give at least 1")
    test = WatchedTest(Path(folder), Path(campaign), trust=trust, limit=limit, overwrite=overwrite)
    target = None if out is None else _prepare_folder(Path(out))
    for remark in remark_on_conditions(test.campaign):
        say(remark)
    return CampaignWatch(test, target, interval, patience, once, until_decided, workers, say)


def _prepare_folder(out: Path) -> Path:
    """A new folder, or that of an earlier watch.  Raises BadInput for any other."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        is_strange = any(out.iterdir()) and not (out / STATE_FILE).is_file()
    except OSError as fault:
        raise BadInput(f"--out: {out}: {fault.strerror}; choose a writable folder") from fault
    if is_strange:
        raise BadInput(f"--out: {out} exists and holds no {STATE_FILE}; choose another folder")
    return out


@dataclass(eq=False, repr=False)
class CampaignWatch(DisplayMixin):
    """A watch of a campaign.  Iterating over it watches, and yields a `WatchEvent` for everything that happens.

    `test` has the recordings and the latest assessment; `state` is watching, ended or interrupted.
    """

    test: WatchedTest
    out: Path | None
    interval: float
    patience: float
    once: bool
    until_decided: bool
    workers: int | None
    say: Say
    state: str = WATCHING
    picture_fault: str = ""
    started: str = field(default_factory=lambda: datetime.now().astimezone().isoformat(timespec="seconds"))

    def __iter__(self) -> Iterator[WatchEvent]:
        try:
            with open_worker_pool(predict_condition, self.workers) as run:
                self.test.on_recording = self._draw_registration
                self.write_state()
                yield from self._watch_folder(LiveEvidence(run, self.say))
            self.end_watch(ENDED)
        except KeyboardInterrupt:
            raise self.interrupt_watch() from None

    def _watch_folder(self, evidence: LiveEvidence) -> Iterator[WatchEvent]:
        while True:
            time.sleep(self.interval)  # the first look was taken when the test was opened
            self.test.scan_folder()
            events = self.test.process_files(evidence, time.monotonic(), 0.0 if self.once else self.patience)
            if events:
                self.write_state()
                yield from events
            if self.once or (self.until_decided and self.test.is_decided):
                return

    def end_watch(self, state: str) -> None:
        """Write the last state."""
        self.state = state
        self._publish_state()
        if self.out is not None:
            write_json(self.as_dict(), self.out / STATE_FILE)

    def interrupt_watch(self) -> UserInterrupt:
        """End after Ctrl-C; returns the exception to raise."""
        self.end_watch(INTERRUPTED)
        saved = "recordings and state" if self.out is not None else "recordings"
        return UserInterrupt(self.out or self.test.campaign.folder, "the same command", saved)

    def write_state(self) -> None:
        """Rewrite picture and state; an error of the picture is reported and does not end the watch."""
        self._publish_state()
        if self.out is None:
            return
        if self.test.assessment is not None:
            from flashtemp.viz import theme
            from flashtemp.viz.measurement import watched_test

            try:
                theme.save_figure(watched_test.draw(self.test), self.out / PICTURE_FILE)
                self.picture_fault = ""
            except Exception as fault:
                self.picture_fault = describe_exception(fault)
                self.say(f"{PICTURE_FILE} cannot be drawn: {self.picture_fault}")
        write_json(self.as_dict(), self.out / STATE_FILE)

    def _publish_state(self) -> None:
        """Write the state and the latest frame where the web app reads them, if it started this command."""
        if (live := open_live_file()) is None:
            return
        latest = None
        if (assessment := self.test.assessment) is not None:
            known = assessment.recordings
            name = self.test.latest if self.test.latest in known else next(iter(known), None)
            latest = None if name is None else describe_latest_frame(name, known[name])
        live.write_sections(watch=self.as_dict() | {"latest": latest})

    def _draw_registration(self, result: ImportResult, path: Path) -> None:
        """Draw where a new recording has the block, next to it."""
        from flashtemp.api.camera import draw_registration

        try:
            picture = draw_registration(result, path)
        except Exception as fault:
            self.say(f"{path.with_suffix('.png')} cannot be drawn: {describe_exception(fault)}")
            return
        if picture is not None:
            self.say(f"look at {picture}: the block in the image")

    @property
    def has_faults(self) -> bool:
        """Whether camera files were refused, or something else could not be processed."""
        return any(g.refused_files for g in self.test.growing.values()) or any(
            e.kind == PROBLEM for e in self.test.events
        )

    def as_dict(self) -> dict[str, Any]:
        """The content of watch.json."""
        test, assessment = self.test, self.test.assessment
        decision = None if assessment is None else assessment.decision
        has_picture = self.out is not None and (self.out / PICTURE_FILE).is_file()
        return {
            "title": test.campaign.title,
            "case": test.campaign.case.name,
            "folder": str(test.folder),
            "state": self.state,
            "started": self.started,
            "updated": datetime.now().astimezone().isoformat(timespec="seconds"),
            "decided": test.is_decided,
            "says": decision.words if decision else "no frame has been compared yet",
            "leader": decision and {
                "hypothesis": decision.leader, "ln_bayes": decision.ln_bayes, "runner_up": decision.runner_up,
                "margin": decision.margin,
            },
            "criteria": {
                "ln_bayes_named": CRITERIA.ln_bayes_named, "ln_bayes_distinct": CRITERIA.ln_bayes_distinct,
            },
            "hypotheses": [asdict(h) for h in assessment.hypotheses] if assessment else [],
            "recordings": [self._describe_recording(name) for name in self._recording_names],
            "simulations": test.simulations,
            "history": [asdict(entry) for entry in test.history],
            "events": [event.as_dict() for event in test.events[-MAX_EVENTS_STORED:]],
            "picture": PICTURE_FILE if has_picture else None,
        }  # fmt: skip

    @property
    def _recording_names(self) -> list[str]:
        campaign = self.test.campaign
        return list(dict.fromkeys((*(v.file for v in campaign.views), *campaign.awaited)))

    def _describe_recording(self, name: str) -> dict[str, Any]:
        """A recording, or a load-cell file that does not exist yet, for watch.json."""
        test, growing = self.test, self.test.growing.get(name)
        view = next((v for v in test.campaign.views if v.file == name), None)
        compared = test.assessment.recordings.get(name) if test.assessment else None
        about: dict[str, Any] = {
            "file": name,
            "template": growing and growing.template.path.name,
            "frames": view.recording.frames if view else 0,
            "compared_frames": compared.entry.recording.frames if compared else 0,
            "time_s": float(view.recording.time[-1]) if view else None,
            "rmse_K": compared and compared.rmse_K,
            "calibrated_rmse_K": compared and compared.calibrated_rmse_K,
        }
        if growing:
            folder = test.folder
            about |= {
                "files": as_names(list(growing.taken), folder),
                "waiting": _name_reasons(growing.waiting_files, folder),
                "refused": _name_reasons(growing.refused_files, folder),
                "repeated": as_names(list(growing.repeated), folder),
                "unfinished": as_names(list(growing.unfinished), folder),
            }
        return about

    def to_table(self) -> DisplayTable:
        rows = [
            (r["file"], r["frames"], r["rmse_K"], r["calibrated_rmse_K"])
            for r in map(self._describe_recording, self._recording_names)
        ]
        head = ("recording", "frames", "rms (K)", "calibrated rms (K)")
        return DisplayTable(f"Watch of '{self.test.campaign.title}'", rows, head, [self.as_dict()["says"]])

    def __str__(self) -> str:
        frames = sum(v.recording.frames for v in self.test.campaign.views)
        return f"Watch of '{self.test.campaign.title}': {frames} frames; {self.as_dict()['says']}"


def _name_reasons(reasons: dict[Path, str], folder: Path) -> dict[str, str]:
    """Reasons why files wait or are refused, by their names in the watched folder."""
    shown = [reason.removeprefix(f"{file}: ") for file, reason in reasons.items()]
    return dict(zip(as_names(list(reasons), folder), shown, strict=True))
