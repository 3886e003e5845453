"""The work page: start a command, follow its progress, stop or resume it."""

from __future__ import annotations

import os
import shlex
from pathlib import Path
from typing import Any

from nicegui import ui

from flashtemp.errors import BadInput
from flashtemp.lab.jobs import LOG_FOLDER, Job, JobList, command_text
from flashtemp.lab.page_layout import (
    STANDARD_FILES,
    ask_to_run,
    escape_lines,
    page_address,
    program_lines,
    show_command,
    show_errors,
)
from flashtemp.lab.programs import AllowedPrograms, has_trust, programs_of_command
from flashtemp.lab.workspace import RESULT_COMMANDS, escape_control, free_name, list_folder, read_owner, resolve_inside

PAGE_COMMANDS = ("run", "compare", "discover", "plan", "sweep", "sensitivity")
REFRESH_INTERVAL_S = 0.5  # of the job cards


class JobsPage:
    """The form for a command, and the cards of all commands that this server has started."""

    def __init__(self, folder: Path, jobs: JobList, allowed: AllowedPrograms):
        self.folder, self.jobs, self.allowed = folder, jobs, allowed
        self.cards: dict[int, Any] = {}

    def show(self, command: str, of: str) -> None:
        """Show the page with a command and its file preselected."""
        owner = None
        if of:
            with show_errors(self.folder):
                owner = read_owner(resolve_inside(self.folder, of))
        self.resumed = of if owner is not None and owner.command == "run" else ""
        with ui.card().classes("w-full"):
            with ui.row().classes("w-full items-end"):
                chosen = command if command in PAGE_COMMANDS else "run"
                self.command = ui.select(
                    list(PAGE_COMMANDS), value=chosen, label="command", on_change=lambda: self._command_changed()
                ).classes("w-40")
                self.of = ui.select(
                    self._file_choices(chosen, of), value=of or None, label="file", with_input=True
                ).classes("w-80")
                self.of.on_value_change(lambda: self._show_command())
                self.more = ui.input(
                    "further arguments: table.key=value, options", on_change=lambda: self._show_command()
                )
                self.more.classes("grow")
                self.start = ui.button("Start", on_click=self._start)
            self.line = ui.column().classes("w-full")
        self.list = ui.column().classes("w-full gap-2")
        self._show_command()
        self._refresh_cards()
        ui.timer(REFRESH_INTERVAL_S, self._refresh_cards)

    def _file_choices(self, command: str, of: str) -> list[str]:
        """The files that the command accepts."""
        listing = list_folder(self.folder)
        kind = listing.campaigns if command in ("compare", "discover", "plan") else listing.cases
        names = [str(p.parent) if p.name in STANDARD_FILES and p.parent != Path() else str(p) for p in kind]
        return list(dict.fromkeys([*([of] if of else []), *names]))

    def _command_changed(self) -> None:
        """Offer the files of the newly selected command."""
        self.resumed = ""
        self.of.set_options(self._file_choices(self.command.value, ""), value=None)
        self._show_command()

    def command_words(self) -> list[str]:
        """The command line without `flashtemp`, with a free result folder where `--out` is not given."""
        if self.resumed and self.of.value == self.resumed:
            return ["run", "--resume", file_word(self.resumed)]
        command, of, more = self.command.value, file_word(self.of.value or ""), shlex.split(self.more.value or "")
        if not of:
            return []
        path = Path(of)
        name = ((path.parent.name if path.name in STANDARD_FILES else "") or path.stem).lstrip(".")
        out = [] if "--out" in more else ["--out", f"results/{free_name(self.folder / 'results', f'{name}-{command}')}"]
        return [command, of, *more, *out]

    def _show_command(self) -> None:
        """Show the command line and the effect files that it would run."""
        self.line.clear()
        with self.line, show_errors(self.folder):
            try:
                words = self.command_words()
            except ValueError as fault:  # an unclosed quote
                ui.label(str(fault))
                words = []
            self.start.set_enabled(bool(words))
            if words:
                resolve_inside(self.folder, words[2] if words[1] == "--resume" else words[1])
                show_command(command_text(words))
                self._show_programs(words)

    def _show_programs(self, words: list[str]) -> None:
        programs, trust = programs_of_command(words, self.folder), has_trust(words)
        for line in program_lines(programs, trust) if programs or trust else ():
            ui.label(line).classes("text-sm text-amber-900 break-all")

    async def _start(self) -> None:
        with self.line, show_errors(self.folder):
            if await start_job(self.folder, self.jobs, self.allowed, self.command_words()):
                self._show_command()
        self._refresh_cards()

    # --- job cards -------------------------------------------------------------------------------------
    def _refresh_cards(self) -> None:
        """Add cards of new jobs and update the progress of all."""
        for job in reversed(self.jobs.all):
            if id(job) not in self.cards:
                with self.list:
                    self.cards[id(job)] = JobCard(self.folder, self.jobs, self.allowed, job)
                self.cards[id(job)].card.move(target_index=0)
        for card in self.cards.values():
            card.refresh()


class JobCard:
    """The card of a job: command line, progress, log, and links to the next steps."""

    def __init__(self, folder: Path, jobs: JobList, allowed: AllowedPrograms, job: Job):
        self.folder, self.jobs, self.allowed, self.job, self.ended = folder, jobs, allowed, job, False
        with ui.card().classes("w-full gap-1") as self.card:
            with ui.row().classes("w-full items-center"):
                ui.label(escape_control(command_text(job.words))).classes("font-mono text-sm grow break-all")
                self.state = ui.badge("running").props('data-is="state"')
                self.stop = ui.button("Stop", on_click=job.stop).props("flat dense")
            self.bar = ui.linear_progress(0.0, show_value=False).props("instant-feedback")
            self.progress_line = ui.label("").classes("text-sm text-gray-700")
            with ui.expansion("log").classes("w-full"):
                self.log = ui.label("").classes("font-mono text-xs whitespace-pre-wrap")
            self.ways = ui.row()

    def refresh(self) -> None:
        """Update the progress; at the end of the job, show the next steps."""
        if self.ended:
            return
        fraction, line = self.job.progress()
        self.progress_line.text = escape_control(line)
        self.log.text = escape_lines("\n".join(self.job.log_lines()))
        self.state.text = self.job.state
        self.bar.value = fraction or 0.0
        self.bar.props(remove="indeterminate") if fraction is not None else self.bar.props("indeterminate")
        if self.job.exit_code is None:
            return
        self.ended = True
        self.bar.props(remove="indeterminate")
        self.bar.value = 1.0 if self.job.exit_code == 0 else self.bar.value
        self.stop.set_visibility(False)
        with self.ways:
            self._show_next_steps()

    def _show_next_steps(self) -> None:
        """A link to the result, or a button to resume a stopped command."""
        out = self._result_folder()
        if out and any((self.folder / out / name).exists() for name in RESULT_COMMANDS):
            ui.link("open the result", page_address("result", open=out))
        elif self.job.exit_code == 130 and self.job.words[0] == "run":
            begun = next(
                (p for p, o in list_folder(self.folder).begun.items() if out and o.out == Path(out).name), None
            )
            if begun is not None:
                self._add_resume_button(["run", "--resume", file_word(str(begun))])
        elif self.job.exit_code == 130:
            self._add_resume_button(list(self.job.words))

    def _add_resume_button(self, words: list[str]) -> None:
        async def start() -> None:
            with self.ways, show_errors(self.folder):
                await start_job(self.folder, self.jobs, self.allowed, words)

        ui.button("Resume", on_click=start).props("outline")

    def _result_folder(self) -> str:
        """The result folder named in the command line, "" where there is none."""
        words = self.job.words
        if "--resume" in words:
            begun = words[words.index("--resume") + 1]
            return begun.rsplit(".partial", 1)[0]
        return words[words.index("--out") + 1] if "--out" in words else ""


def file_word(name: str) -> str:
    """A file name as a command-line argument that cannot be mistaken for an option.

    >>> file_word("--trust"), file_word("case.toml"), file_word("")
    ('./--trust', 'case.toml', '')
    """
    return f"./{name}" if name.startswith("-") else name


async def start_job(folder: Path, jobs: JobList, allowed: AllowedPrograms, words: list[str]) -> bool:
    """Start a command, after consent where effect files would run; whether it was started.  Raises BadInput."""
    if not words or not await ask_to_run(programs_of_command(words, folder), allowed, has_trust(words)):
        return False
    for name in ("results", LOG_FOLDER):  # folders chosen by the page, not by the user
        if os.path.islink(folder / name):
            raise BadInput(f"{name}: is a link; replace it by a folder of that name")
    (folder / "results").mkdir(exist_ok=True)
    jobs.start(words)
    return True
