"""What pages share: the frame around each, links, the command line that does the same, faults in words."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlencode

from nicegui import ui

from flashtemp.errors import FlashtempError
from flashtemp.lab.folder import inside

FILES = "/files"  # address of the folder
NAMES = 40  # that a list shows
STANDARD = ("case.toml", "campaign.toml")  # a folder is named by them
PAGES = {"folder": "/", "camera": "/camera", "case": "/case", "campaign": "/campaign", "work": "/work"}


@contextmanager
def frame(here: str, folder: Path) -> Iterator[None]:
    """The head of a page with the ways to the others; below it what follows."""
    ui.colors(primary="#8C2D04")
    ui.add_css("svg { max-width: 100%; height: auto }")
    ui.page_title("flashtemp")
    with ui.header().classes("items-center gap-6 py-2"):
        ui.label("flashtemp").classes("text-xl font-semibold")
        for name, target in PAGES.items():
            ui.link(name, target).classes(f"text-white no-underline {'font-bold underline' if name == here else ''}")
        ui.space()
        ui.label(folder.name).classes("text-sm opacity-80 break-all").tooltip(str(folder))
    with ui.column().classes("w-full max-w-screen-2xl mx-auto gap-4 p-2"):
        yield


def link(page: str, **asked: Any) -> str:
    """The address of a page with what it is to open."""
    return f"{PAGES.get(page, '/' + page)}?{urlencode({k: str(v) for k, v in asked.items()})}"


def file_address(path: Path) -> str:
    """The address of a file in the folder, by its path there."""
    return f"{FILES}/{quote(path.as_posix())}"


def command_line(words: str) -> None:
    """The command line that does the same."""
    with ui.row().classes("w-full items-center bg-gray-100 rounded px-3 py-1"):
        ui.label(words).classes("font-mono text-sm break-all").props('data-is="command"')


def saved(folder: Path, name: str, text: str) -> Path:
    """A text written to a file of the folder, whole or not at all.  Raises BadInput."""
    path = inside(folder, name)
    path.parent.mkdir(parents=True, exist_ok=True)
    whole = path.with_name(f".{path.name}.new")
    whole.write_text(text, encoding="utf-8")
    whole.replace(path)
    return path


@contextmanager
def when_it_fails(folder: Path | None = None) -> Iterator[None]:
    """What is wrong with a file or a key is told where it was asked for, files by their names in the `folder`."""
    try:
        yield
    except (FlashtempError, OSError) as fault:
        told(str(fault), folder)


def named(text: str, folder: Path | None) -> str:
    """A text in which files of the folder go by their names there."""
    return text if folder is None else text.replace(f"{folder}{os.sep}", "")


def told(text: str, folder: Path | None = None) -> None:
    """A fault in words."""
    with ui.column().classes("w-full bg-red-50 border-l-4 border-red-700 px-3 py-2 gap-0").props("role=alert"):
        for line in named(text, folder).splitlines():
            ui.label(line).classes("text-red-900 break-all")
