"""Cards of commands: one that runs, with live pictures, and one of the past, with its result and ways to repeat it."""

from __future__ import annotations

import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from nicegui import ui

from flashtemp.lab.job_record import STATE_KINDS, LoggedJob, format_duration
from flashtemp.lab.job_result import JobResult, find_result, result_name
from flashtemp.lab.job_start import file_word
from flashtemp.lab.jobs import WATCH_COMMAND, command_text
from flashtemp.lab.live_view import LiveView
from flashtemp.lab.page_layout import action, chip, escape_lines, file_address, page_address, show_command, show_errors
from flashtemp.lab.start_button import start_once
from flashtemp.lab.workspace import escape_control, list_folder

StartJob = Callable[[list[str]], Awaitable[bool]]  # whether it was started
PAST_ICONS = {"failed": "error_outline", "killed": "error_outline", "stopped": "pause_circle", "running": "sync"}


class JobCard:
    """The card of a job: command line, state, progress, live pictures, log, and the result with the next steps."""

    def __init__(self, folder: Path, job: LoggedJob, start: StartJob, alone: bool = False):
        self.folder, self.job, self.start, self.alone, self.ended = folder, job, start, alone, False
        with ui.element("section").classes("ft-card ft-job") as self.card:
            self.card.props["aria-label"] = escape_control(command_text(job.words))
            with ui.element("div").classes("ft-job-head"):
                if not alone:
                    ui.label(escape_control(command_text(job.words))).classes("ft-mono")
                self.state = chip("")
                self.state.props('data-is="state"')
                self.clock = ui.label().classes("ft-muted ft-small")
                if not alone:
                    ui.link("Details", page_address("runs", job=job.name)).classes("ft-small")
                self.stop = ui.button("Stop", icon="stop", on_click=job.stop).props("flat dense no-caps")
            self.bar = ui.linear_progress(0.0, show_value=False).props('instant-feedback aria-label="progress"')
            self.progress_line = ui.label("").classes("ft-muted ft-small break-all")
            self.result = ui.column().classes("w-full gap-2")
            self.live = LiveView(job)
            self.log_fold = ui.expansion("Log", value=alone and not job.is_unfinished).classes("w-full").props("dense")
            with self.log_fold:
                self.log = ui.label("").classes("ft-mono ft-log").props("tabindex=0 role=region aria-label=log")
        self.refresh()

    def refresh(self) -> None:
        """Update the progress and the pictures; at the end of the job, show the result."""
        if self.ended:
            return
        state = self.job.state
        fraction, line = self.job.progress()
        self.progress_line.text = escape_control(line) or _waiting_words(state)
        self.log.text = escape_lines("\n".join(self.job.log_lines())) or "Nothing is printed yet."
        self.state.text = state
        self.state.classes(replace=f"ft-chip {STATE_KINDS.get(state, 'error')}")
        seconds = self.job.seconds
        self.clock.text = "" if seconds is None else format_duration(seconds)
        self.live.update()
        self.bar.value = fraction or 0.0
        is_unknown = fraction is None and state == "running"
        self.bar.props("indeterminate") if is_unknown else self.bar.props(remove="indeterminate")
        if not self.job.is_unfinished:
            self._finish(state)

    def _finish(self, state: str) -> None:
        """Show the result and the next steps, and remove what belongs to a running command."""
        self.ended = True
        self.bar.set_visibility(False)
        self.stop.set_visibility(False)
        if state == "done":
            self.progress_line.set_visibility(False)
            # the result of a run says more; the details keep the pictures
            self.live.place.set_visibility(self.alone or self.job.words[0] == WATCH_COMMAND)
        with self.result, show_errors(self.folder):
            result = find_result(self.folder, self.job)
            if result is not None:
                show_outcome(result)
            self._show_ways(result)

    def _show_ways(self, result: JobResult | None) -> None:
        """Links to the result, and buttons to resume or repeat the command."""
        with ui.row().classes("gap-2 items-center"):
            for k, (words, address) in enumerate(result.links if result else ()):
                ui.link(words, address).classes("ft-chip accent" if k == 0 else "ft-chip")
            for words, command in result.starts if result else ():
                add_start_button(words, list(command), self.start, self.result, self.folder)
            if again := resume_words(self.folder, self.job):
                add_start_button("Resume", again, self.start, self.result, self.folder)
            show_repeat_buttons(self.folder, self.job, self.start, self.result)


def show_outcome(result: JobResult) -> None:
    """The main picture of a result beside its sentence and its main numbers."""
    if not (result.picture or result.numbers or result.sentence):
        return
    with ui.element("div").classes("ft-outcome" if result.picture else "ft-outcome plain"):
        if result.picture:
            address = file_address(result.picture)
            with ui.link(target=address, new_tab=True).props('aria-label="the main picture in full size"'):
                image = ui.element("img").props("loading=lazy")
                image.props["src"], image.props["alt"] = address, f"main picture of {escape_control(result.path)}"
        with ui.column().classes("gap-2 min-w-0"):
            if result.sentence:
                ui.label(escape_control(result.sentence)).classes("text-weight-medium break-words")
            for name, value in result.numbers:
                with ui.column().classes("gap-0"):
                    ui.label(name).classes("ft-muted ft-small")
                    ui.label(escape_control(value)).classes("ft-figure" if len(value) < 24 else "text-weight-medium")


def resume_words(folder: Path, job: LoggedJob) -> list[str]:
    """The command that continues a job that was stopped or killed; [] where there is nothing to continue."""
    if job.state not in ("stopped", "killed"):
        return []
    out = result_name(job.words)
    if job.words[0] == "run":
        begun = list_folder(folder).begun.items()
        found = next((p for p, o in begun if out and o.out == Path(out).name and o.command == "run"), None)
        return ["run", "--resume", file_word(str(found))] if found is not None else []
    return list(job.words) if job.words[0] in ("sweep", "sensitivity") else []


def add_start_button(words: str, command: list[str], start: StartJob, place: Any, folder: Path) -> None:
    """A button that starts a command; errors are shown in `place`."""

    async def start_again() -> bool:
        with place, show_errors(folder):
            return await start(command)
        return False

    action(words, start_once(start_again), icon="play_arrow").props("dense")


def show_repeat_buttons(folder: Path, job: LoggedJob, start: StartJob, place: Any) -> None:
    """Buttons to run a command again with a new result folder, and to change it first."""
    again = page_address("runs", again=job.name)

    async def repeat() -> bool:
        with place, show_errors(folder):
            if await start([*job.words]):
                return True
            ui.navigate.to(again)
        return False

    ui.button("Run again", icon="replay", on_click=start_once(repeat)).props("flat dense no-caps")
    ui.button("Change and run", icon="edit", on_click=lambda: ui.navigate.to(again)).props("flat dense no-caps")


def show_past_job(folder: Path, job: LoggedJob, start: StartJob) -> None:
    """One row of the history: picture, command line, state, time, and ways to see and repeat it."""
    state, result = job.state, find_result(folder, job)
    with ui.element("div").classes("ft-past"):
        with ui.link(target=page_address("runs", job=job.name)).classes("thumb").props("tabindex=-1 aria-hidden=true"):
            if result is not None and result.picture:
                image = ui.element("img").props('loading=lazy alt=""')
                image.props["src"] = file_address(result.picture)
            else:
                ui.icon(PAST_ICONS.get(state.split(",")[0], "terminal"), size="28px")
        with ui.column().classes("gap-1 min-w-0"):
            ui.link(escape_control(command_text(job.words)), page_address("runs", job=job.name)).classes("ft-mono")
            with ui.row().classes("gap-2 items-center"):
                chip(state, STATE_KINDS.get(state, "error"))
                ui.label(_when_words(job)).classes("ft-muted ft-small")
            words = _short_outcome(result) if result is not None else (job.log_lines(1) or [""])[-1]
            if words:
                ui.label(escape_control(words)).classes("ft-small break-words")
            place = ui.column().classes("w-full gap-1")
        with ui.row().classes("acts gap-1 items-center"):
            for words, address in (result.links if result else ())[:1]:
                ui.link(words, address).classes("ft-chip accent")
            show_repeat_buttons(folder, job, start, place)


def show_job_heading(job: LoggedJob) -> None:
    """The command line of a job, copyable, and when it was started."""
    show_command(command_text(job.words))
    ui.label(_when_words(job)).classes("ft-muted")


def _short_outcome(result: JobResult) -> str:
    """The sentence of a result, or its first numbers."""
    return result.sentence or " · ".join(f"{name} {value}" for name, value in result.numbers[:2])


def _when_words(job: LoggedJob) -> str:
    """When a job began and how long it took."""
    began, seconds = job.began, job.seconds
    words = time.strftime("%d %b %Y, %H:%M", time.localtime(began)) if 0.0 < began < 1e11 else "time unknown"
    return words if seconds is None else f"{words} · {format_duration(seconds)}"


def _waiting_words(state: str) -> str:
    """What a job without a line of output is doing."""
    return {
        "waiting": "Waits until a running command ends.",
        "running": "Starting.",
        "killed": "Ended without a word: it was killed, or the computer went down.",
        "not started": "The server ended before its turn came.",
        "unknown": "Its end was not recorded.",
    }.get(state, "")
