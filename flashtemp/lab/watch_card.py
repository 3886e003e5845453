"""The card of a campaign that watches a running test: which folder, which templates, start, live pictures, stop."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, Final

from nicegui import run, ui

from flashtemp.camera.importing.growing_recording import RecordingTemplate
from flashtemp.discovery.watched_test import find_templates
from flashtemp.errors import BadInput
from flashtemp.lab.camera_files import check_stated_files
from flashtemp.lab.campaign_document import CampaignDocument
from flashtemp.lab.job_record import STATE_KINDS, LoggedJob, format_duration
from flashtemp.lab.job_result import free_result_folder, usual_result_folder
from flashtemp.lab.job_start import file_word, short_file_name, start_job
from flashtemp.lab.jobs import WATCH_COMMAND, JobList, command_text
from flashtemp.lab.live_state import finite_number
from flashtemp.lab.live_view import LiveView
from flashtemp.lab.page_layout import action, card, chip, note, page_address, show_command, show_errors
from flashtemp.lab.programs import AllowedPrograms
from flashtemp.lab.start_button import start_once
from flashtemp.lab.workspace import (
    escape_control,
    find_own_file,
    list_image_folders,
    read_json_quietly,
    resolve_inside,
)

REFRESH_INTERVAL_S: Final = 0.5
MAX_PAST_JOBS: Final = 20  # among which a watch of an earlier server is sought
ABOUT: Final = (
    "Each camera file that arrives is imported and compared with the prediction, and you learn when the data suffice."
)
NO_FOLDER: Final = "Choose the folder in which the camera puts its files."
MISSING_TEMPLATE: Final = (
    "To import files by itself, a watch needs a recording template. Mark the block in a first image on the camera page "
    "and save recording and template with the name of a recording of this campaign."
)


class WatchCard:
    """The card on the page of a campaign; `save` saves its text and says whether that was done."""

    def __init__(
        self, document: CampaignDocument, jobs: JobList, allowed: AllowedPrograms, save: Callable[[], Awaitable[bool]]
    ):
        self.document, self.jobs, self.allowed, self.save = document, jobs, allowed, save
        self.folder = document.folder
        self.imported: Callable[[], Any] = lambda: None  # called when a first frame of a recording is imported
        self.n_recordings = 0
        self.job: LoggedJob | None = None
        self.live: LiveView | None = None

    def show(self) -> None:
        """Show the card; a watch that runs is shown with its pictures."""
        with card("Watch a test live", ABOUT):
            self.setup = ui.column().classes("w-full gap-2")
            with self.setup:
                self._add_choices()
            self.faults = ui.column().classes("w-full gap-1 ft-optional")
            self.command = ui.column().classes("w-full ft-optional")
            with ui.row().classes("items-center gap-3"):
                self.start = action("Start watching", start_once(self._start), "sensors")
                self.stop = action("Stop watching", self._stop, "stop")
                self.state = chip("")
                self.clock = ui.label().classes("ft-muted ft-small")
                self.details = ui.link("Details", page_address("runs")).classes("ft-small")
            self.place = ui.column().classes("w-full gap-2 ft-optional")
        self.job = self._find_job()
        self._show_job()
        self._choose_folder()
        self.shown = self._choice_state()
        ui.timer(REFRESH_INTERVAL_S, self._refresh)

    def update_choices(self) -> None:
        """Show templates and command again where the name or the recordings of the campaign have changed."""
        if self.document.raw is None or (state := self._choice_state()) == self.shown:
            return
        self.shown = state
        if self.arrivals.value is None:
            self.arrivals.value = self._likely_folder(list(self.arrivals.options))
        self._choose_folder()

    def _choice_state(self) -> tuple[str, list[str]]:
        """What decides on templates and command, besides the choices of the card."""
        return self.document.name, [str(entry.get("file")) for entry in self.document.list_entries("recording")]

    def _add_choices(self) -> None:
        """The folder of the camera files, and whether the watch ends by itself."""
        names = {name: escape_control(name) for name in list_image_folders(self.folder)}
        with ui.element("div").classes("ft-fields"):
            likely = self._likely_folder(list(names))
            self.arrivals = ui.select(names, value=likely, label="folder in which camera files arrive", with_input=True)
            self.arrivals.props("outlined dense").classes("wide").on_value_change(self._choose_folder)
            self.until_decided = ui.switch("end when the data suffice", on_change=self._choose_folder)
        self.found = ui.column().classes("w-full gap-1").props("aria-live=polite")

    def _likely_folder(self, names: list[str]) -> str | None:
        """The first folder with a template of a recording of the campaign whose files would be there."""
        for name in names:
            try:
                templates = self.find_templates(name)
            except (BadInput, OSError):
                continue
            place = (self.folder / name).resolve()
            if any(pattern.parent == place or pattern == place for t in templates.values() for pattern in t.patterns):
                return name
        return None

    def find_templates(self, arrivals: str) -> dict[str, RecordingTemplate]:
        """The templates of recordings of the campaign for files in a folder.  Raises BadInput."""
        home, place = self.document.path.parent, resolve_inside(self.folder, arrivals)
        for file in (file for at in (home, place) for file in at.glob("[!.]*.toml")):
            if find_own_file(self.folder, file.relative_to(self.folder.resolve())) is None:
                raise BadInput(f"{file}: not a file of this folder; remove the link before you watch")
        names = [e["file"] for e in self.document.list_entries("recording") if isinstance(e.get("file"), str)]
        found = find_templates(place, home, names)
        for template in found.values():
            check_stated_files(self.folder, template.facts)
        return found

    # --- before the start -------------------------------------------------------------------------------------
    def _choose_folder(self) -> None:
        """Show the templates and the command for the chosen folder."""
        self.found.clear()
        self.faults.clear()
        self.command.clear()
        is_ready = False
        with self.found:
            if not self.arrivals.value:
                note(NO_FOLDER)
            else:
                is_ready = self._show_templates(self.arrivals.value)
        self.start.set_enabled(is_ready)
        if is_ready and self.job is None:
            with self.command:
                show_command(command_text(self.command_words()))

    def _show_templates(self, arrivals: str) -> bool:
        """List which template makes which recording; whether there is one."""
        try:
            templates = self.find_templates(arrivals)
        except (BadInput, OSError) as fault:
            if "no recording template" not in str(fault):
                with show_errors(self.folder):
                    raise
                return False
            note(MISSING_TEMPLATE)
            action("Open the camera page", lambda: ui.navigate.to(page_address("camera", open=arrivals)))
            return False
        for name, template in templates.items():
            shown = ", ".join(dict.fromkeys(p.name for p in template.patterns))
            with ui.row().classes("items-center gap-2"):
                ui.icon("check_circle").props("aria-hidden=true").style("color: var(--good)")
                words = f"{template.path.name} makes {name} of files {shown}"
                ui.label(escape_control(words)).classes("ft-small")
        return True

    def command_words(self) -> list[str]:
        """The command line without `flashtemp`; the result folder of an earlier watch is used again."""
        out = usual_result_folder(WATCH_COMMAND, self.document.name)
        earlier = read_json_quietly(self.folder, Path(out) / "watch.json").get("folder")
        if earlier is None or earlier != str(Path(self.arrivals.value or "")):  # none, or the watch of another test
            out = free_result_folder(self.folder, out, self.jobs.all)
        end = ["--until-decided"] if self.until_decided.value else []
        of = file_word(short_file_name(self.document.name))
        return [WATCH_COMMAND, file_word(self.arrivals.value or ""), of, *end, "--out", out]

    async def _start(self) -> bool:
        """Save the campaign and start its watch, unless one runs; whether it was started."""
        self.faults.clear()
        with self.faults, show_errors(self.folder):
            if not await self.save():
                return False
            if (running := self._find_job()) is not None:  # started by another tab of the browser
                self.job = running
                self._show_job()
                return False
            before = {job.name for job in self.jobs.all}
            if await start_job(self.folder, self.jobs, self.allowed, self.command_words()):
                self.job = next((job for job in self.jobs.all if job.name not in before), None)
                self.command.clear()
                self._show_job()
                return True
        return False

    async def _stop(self) -> None:
        if self.job is not None:
            await run.io_bound(self.job.stop)

    # --- while it runs ----------------------------------------------------------------------------------------
    def _find_job(self) -> LoggedJob | None:
        """The watch of this campaign that runs, also one of an earlier server."""
        for job in [*self.jobs.all, *self.jobs.list_past(MAX_PAST_JOBS)]:
            if (
                job.words[0] == WATCH_COMMAND
                and len(job.words) > 2
                and job.is_unfinished
                and self._is_own(job.words[2])
            ):
                return job
        return None

    def _is_own(self, of: str) -> bool:
        """Whether a command names this campaign."""
        try:
            path = resolve_inside(self.folder, of)
            return self.document.path in (path, path / "campaign.toml")
        except BadInput:
            return False

    def _show_job(self) -> None:
        """Show the pictures of the watch that has just been started, or the choices where there is none."""
        self.place.clear()
        self.live = None
        if self.job is not None:
            with self.place:
                show_command(command_text(self.job.words))
                self.live = LiveView(self.job)
            self.details.props["href"] = page_address("runs", job=self.job.name)
            self.details.update()
        self._refresh()

    def _refresh(self) -> None:
        """Update the state and the pictures; after the end, the watch can be started again."""
        job = self.job
        is_running = job is not None and job.is_unfinished
        self.setup.set_visibility(not is_running)
        self.start.set_visibility(not is_running)
        self.stop.set_visibility(is_running)
        for element in (self.state, self.clock, self.details):
            element.set_visibility(job is not None)
        if job is None or self.live is None:
            return
        state, seconds = job.state, job.seconds
        self.state.text = "watching" if state == "running" else state
        self.state.classes(replace=f"ft-chip {STATE_KINDS.get(state, 'error')}")
        self.clock.text = "" if seconds is None else format_duration(seconds)
        has_pictures = self.live.update()
        n_recordings = sum(bool(finite_number(r.get("frames"))) for r in job.live.rows("watch", "recordings"))
        if n_recordings != self.n_recordings:
            self.n_recordings = n_recordings
            self.imported()
        if not is_running and not has_pictures:
            self._show_failure(job)

    def _show_failure(self, job: LoggedJob) -> None:
        """Show the last line of a watch that ended before it compared anything."""
        lines = job.log_lines(1)
        self.job = None
        self.faults.clear()
        with self.faults, show_errors(self.folder):
            raise BadInput(lines[-1] if lines else "The watch ended without a word; see its log on the page of runs.")
