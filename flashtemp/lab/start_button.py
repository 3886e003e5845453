"""Buttons that start a command at once; next to each stand its command line and a link to the form with its options."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from nicegui import ui

from flashtemp.errors import FlashtempError
from flashtemp.lab.job_result import choose_result_folder, free_result_folder
from flashtemp.lab.job_start import file_word, short_file_name, start_job
from flashtemp.lab.jobs import JobList, command_text
from flashtemp.lab.page_layout import action, escape_lines, page_address, relative_names, show_command, show_errors
from flashtemp.lab.programs import AllowedPrograms
from flashtemp.lab.workspace import escape_control

REPEAT_PAUSE_S = 3.0  # after a start, in which further clicks on the same button are taken for accidents
OPTIONS_LABEL = "Options"


def start_once(start: Callable[[], Awaitable[bool]]) -> Callable[[], Awaitable[None]]:
    """A handler of clicks that calls `start`; clicks while it works, and shortly after it was True, are ignored."""
    is_busy = False

    def release() -> None:
        nonlocal is_busy
        is_busy = False

    async def handle_click() -> None:
        nonlocal is_busy
        if is_busy:
            return
        is_busy, started = True, False
        try:
            started = await start()
        finally:
            # a second click may have been sent before the page could change
            asyncio.get_running_loop().call_later(REPEAT_PAUSE_S if started else 0.0, release)

    return handle_click


@dataclass(frozen=True)
class CommandStarter:
    """Starts commands on files of the folder and shows their live view."""

    folder: Path
    jobs: JobList
    allowed: AllowedPrograms

    def command_words(self, command: str, file: str | Path) -> list[str]:
        """A command on a file as it is, with a result folder that is free."""
        out = choose_result_folder(self.folder, command, file, self.jobs.all)
        return [command, file_word(short_file_name(file)), "--out", file_word(out)]

    async def start(self, words: Sequence[str]) -> bool:
        """Start a command, after consent where effect files would run, and open its live view; whether it was started.

        Raises BadInput.
        """
        if not await start_job(self.folder, self.jobs, self.allowed, list(words)):
            return False
        ui.navigate.to(page_address("runs", job=self.jobs.all[0].name))
        return True

    def repeat_words(self, command: str, result: Path, options: Sequence[str] = ()) -> list[str]:
        """The command that computes a result again from its case, with a result folder named after it."""
        out = free_result_folder(self.folder, str(result), self.jobs.all)
        return [command, file_word(short_file_name(result / "case.toml")), *options, "--out", file_word(out)]

    def show(
        self,
        label: str,
        command: str,
        file: str | Path,
        main: bool = False,
        words: Callable[[], list[str]] | None = None,
    ) -> None:
        """Show a command on a file, the button that starts it, and the link to its options.

        `words` gives the command where it is not the file alone.
        """
        find_words = words or partial(self.command_words, command, file)
        show_command(command_text(find_words()))
        with ui.row().classes("gap-3 items-center"):
            self.add_button(label, find_words, main)
            self.add_options_link(command, file)

    def add_button(self, label: str, find_words: Callable[[], list[str]], main: bool = False) -> None:
        """The button that starts a command; errors are shown next to it."""

        async def start() -> bool:
            place.clear()
            with place, show_errors(self.folder):
                return await self.start(find_words())
            return False

        action(label, start_once(start), icon="play_arrow", main=main)
        place = ui.column().classes("ft-optional")

    def add_small_button(self, label: str, find_words: Callable[[], list[str]], about: str) -> None:
        """A button in a list of files, with the command line as its tooltip; errors are shown as a notification."""

        async def start() -> bool:
            try:
                return await self.start(find_words())
            except (FlashtempError, OSError) as fault:
                ui.notify(escape_lines(relative_names(str(fault), self.folder)), type="negative")
                return False

        button = ui.button(label, on_click=start_once(start)).props("flat dense no-caps").classes("ft-small-start")
        button.props["aria-label"] = about
        button.tooltip(escape_control(command_text(find_words())))

    def add_options_link(self, command: str, file: str | Path) -> None:
        """The link to the form of a command, where its options are chosen first."""
        link = ui.link(OPTIONS_LABEL, options_address(command, file)).classes("ft-small")
        link.props["aria-label"] = f"{OPTIONS_LABEL} of {command}"


def options_address(command: str, file: str | Path) -> str:
    """The address of the form with a command and its file."""
    return page_address("runs", command=command, of=short_file_name(file))
