"""Shared by all pages: header, addresses, the equivalent command line, error messages and questions."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlencode

from nicegui import ui

from flashtemp.errors import BadInput, FlashtempError
from flashtemp.lab.programs import AllowedPrograms
from flashtemp.lab.saving import ReplacesFile, TextVersion, write_text
from flashtemp.lab.workspace import escape_control

FILES_ADDRESS = "/files"  # the files of the folder
MAX_NAMES_LISTED = 40
STANDARD_FILES = ("case.toml", "campaign.toml")  # a folder with one of them stands for it in a command
PAGE_ADDRESSES = {"folder": "/", "camera": "/camera", "case": "/case", "campaign": "/campaign", "work": "/work"}


@contextmanager
def page_frame(here: str, folder: Path) -> Iterator[None]:
    """Context manager: the header of a page with links to the others, and a column for its content."""
    ui.colors(primary="#8C2D04")
    ui.add_css("svg { max-width: 100%; height: auto }")
    ui.page_title("flashtemp")
    with ui.header().classes("items-center gap-6 py-2"):
        ui.label("flashtemp").classes("text-xl font-semibold")
        for name, target in PAGE_ADDRESSES.items():
            ui.link(name, target).classes(f"text-white no-underline {'font-bold underline' if name == here else ''}")
        ui.space()
        ui.label(escape_control(folder.name)).classes("text-sm opacity-80 break-all").tooltip(
            escape_control(str(folder))
        )
    with ui.column().classes("w-full max-w-screen-2xl mx-auto gap-4 p-2"):
        yield


def page_address(page: str, **query: Any) -> str:
    """The address of a page with its query parameters."""
    return f"{PAGE_ADDRESSES.get(page, '/' + page)}?{urlencode({k: str(v) for k, v in query.items()})}"


def file_address(path: Path) -> str:
    """The address of a file by its path in the folder."""
    return f"{FILES_ADDRESS}/{quote(path.as_posix())}"


def show_command(words: str) -> None:
    """Show the equivalent command line."""
    with ui.row().classes("w-full items-center bg-gray-100 rounded px-3 py-1"):
        ui.label(escape_control(words)).classes("font-mono text-sm break-all").props('data-is="command"')


async def save_text(folder: Path, name: str, text: str, opened: TextVersion | None) -> TextVersion | None:
    """Write a TOML file like `write_text`; asks before it replaces another file.  None if the user declines."""
    try:
        return write_text(folder, name, text, opened)
    except ReplacesFile:
        question = f"{escape_control(name)} exists and was not opened by this page."
        if not await ask_consent([question], "Replace it"):
            return None
        return write_text(folder, name, text, opened, replace=True)


async def ask_consent(lines: Sequence[str], consent: str) -> bool:
    """Ask in a dialog: True only after a click on the button labelled `consent`."""
    with ui.dialog() as dialog, ui.card().props("role=alertdialog"):
        for line in lines:
            ui.label(line).classes("break-all")
        with ui.row().classes("w-full justify-end"):
            ui.button("Cancel", on_click=lambda: dialog.submit(False)).props("flat no-caps autofocus")
            ui.button(on_click=lambda: dialog.submit(True)).props("outline no-caps").set_text(consent)
    answer = await dialog
    dialog.delete()
    return answer is True


async def ask_to_run(programs: Sequence[Path], allowed: AllowedPrograms, trust: bool = False) -> bool:
    """Ask whether effect files may run: those that are new or changed, or all with `--trust`."""
    unconfirmed = list(programs) if trust else allowed.unconfirmed_files(programs)
    if not unconfirmed and not trust:
        return True
    consent = "Run as a program" if len(unconfirmed) < 2 else "Run these programs"
    if not await ask_consent(program_lines(unconfirmed, trust), consent):
        return False
    allowed.allow(unconfirmed)
    return True


def program_lines(programs: Sequence[Path], trust: bool = False) -> list[str]:
    """What a user must know before effect files run, in lines."""
    head = "With --trust these effect files run, whoever wrote them." if trust else "These effect files would run."
    none = "The case lists no effect file now. With --trust, any file that it lists at the start would run."
    rule = "Each is a Python program and can do anything that you can do on this computer. Read it first."
    return [head, *(escape_control(str(file)) for file in programs), rule] if programs else [none, rule]


@contextmanager
def show_errors(folder: Path | None = None) -> Iterator[None]:
    """Context manager: show errors of files and keys in place, with file names relative to `folder`."""
    try:
        yield
    except (FlashtempError, OSError) as fault:
        show_error(str(fault), folder)


@contextmanager
def refuse_damaged(file: Path) -> Iterator[None]:
    """Context manager: any exception of a library that reads a damaged or hostile file becomes BadInput."""
    try:
        yield
    except FlashtempError:
        raise
    except Exception as fault:  # readers of NetCDF, HDF5 and images raise exceptions of many types
        raise BadInput(f"{file}: cannot be read ({type(fault).__name__}); create it again or remove it") from fault


def escape_lines(text: str) -> str:
    """Escape control characters in every line of a text; only its line ends remain."""
    return "\n".join(map(escape_control, text.splitlines()))


def relative_names(text: str, folder: Path | None) -> str:
    """A text with file names relative to `folder`."""
    return text if folder is None else text.replace(f"{folder}{os.sep}", "")


def show_error(text: str, folder: Path | None = None) -> None:
    """Show an error message."""
    with ui.column().classes("w-full bg-red-50 border-l-4 border-red-700 px-3 py-2 gap-0").props("role=alert"):
        for line in relative_names(text, folder).splitlines():
            ui.label(escape_control(line)).classes("text-red-900 break-all")
