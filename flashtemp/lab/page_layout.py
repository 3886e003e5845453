"""Shared by all pages: frame, addresses, cards, states, the equivalent command line, error messages and questions."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlencode

from nicegui import ui
from nicegui.elements.mixins.text_element import TextElement

from flashtemp.errors import BadInput, FlashtempError
from flashtemp.lab.key_units import describe_overrides
from flashtemp.lab.programs import AllowedPrograms
from flashtemp.lab.saving import ReplacesFile, TextVersion, write_text
from flashtemp.lab.style import read_asset, style_sheet
from flashtemp.lab.workspace import escape_control

FILES_ADDRESS = "/files"  # the files of the folder
MAX_NAMES_LISTED = 40
STANDARD_FILES = ("case.toml", "campaign.toml")  # a folder with one of them stands for it in a command
PAGE_ADDRESSES = {"home": "/", "camera": "/camera", "case": "/case", "campaign": "/campaign", "runs": "/runs"}
PAGE_TITLES = {"home": "Home", "camera": "Camera", "case": "Case", "campaign": "Campaign", "runs": "Runs"}


@contextmanager
def page_frame(here: str, folder: Path, title: str = "") -> Iterator[None]:
    """Context manager: the frame of a page with links to the others, and the main column for its content.

    `here` is the key of the page in PAGE_ADDRESSES that is marked in the navigation ("" for none); `title` is the
    heading of the page, shown where it is not empty.
    """
    ui.add_css(style_sheet())
    add_script("scheme.js")
    ui.page_title(f"{title or PAGE_TITLES.get(here, 'Result')} · flashtemp")
    with ui.header().classes("ft-header items-center gap-4 py-2 px-4"):
        ui.link("Skip to the content", "#content").classes("ft-skip")
        ui.link("flashtemp", "/").classes("ft-brand")
        with ui.element("nav").classes("ft-nav").props('aria-label="pages"'):
            for name, target in PAGE_ADDRESSES.items():
                link = ui.link(PAGE_TITLES[name], target)
                if name == here:
                    link.props("aria-current=page")
        ui.space()
        ui.label(escape_control(folder.name)).classes("ft-muted ft-small break-all").tooltip(
            escape_control(str(folder))
        )
        switch = ui.button(icon="contrast").props('flat dense round color=primary aria-label="light or dark"')
        switch.on("click", js_handler="() => switchScheme()").tooltip("light or dark")
    with ui.element("div").classes("ft-main").props("id=content tabindex=-1"):
        if title:
            heading(1, title)
        yield


def page_address(page: str, **query: Any) -> str:
    """The address of a page with its query parameters."""
    words = urlencode({k: str(v) for k, v in query.items()})
    return PAGE_ADDRESSES.get(page, f"/{page}") + (f"?{words}" if words else "")


def file_address(path: Path) -> str:
    """The address of a file by its path in the folder."""
    return f"{FILES_ADDRESS}/{quote(path.as_posix())}"


def add_script(name: str) -> None:
    """Load a script of the assets; values of the user never become part of a script."""
    ui.add_head_html(f"<script>{read_asset(name)}</script>")


def script_literal(value: str) -> str:
    r"""A text as a literal of JavaScript, in which no tag can begin.

    >>> script_literal("a'b</script>")
    '"a\'b\\u003c/script>"'
    """
    return json.dumps(value).replace("<", "\\u003c")


def heading(level: int, text: str) -> Any:
    """A heading of level 1 (page), 2 (card) or 3; the page shows the text as it is."""
    return TextElement(tag=f"h{level}", text=escape_control(text))


@contextmanager
def card(title: str = "", about: str = "") -> Iterator[Any]:
    """Context manager: a card with a heading and, below it, a sentence of second rank."""
    with ui.element("section").classes("ft-card") as element:
        if title:
            heading(2, title)
            element.props["aria-label"] = escape_control(title)
        if about:
            ui.label(escape_control(about)).classes("ft-muted")
        yield element


@contextmanager
def empty_state(title: str, how: str) -> Iterator[Any]:
    """Context manager: what belongs here and how to get it; the content are the buttons that lead there."""
    with ui.element("section").classes("ft-card ft-empty") as element:
        heading(2, title)
        ui.label(how)
        with ui.row().classes("gap-2"):
            yield element


def set_prop(element: Any, name: str, value: Any) -> None:
    """Set a property only where it changes: the browser gets all of them anew, also while the user is typing."""
    if element.props.get(name) != value:
        element.props[name] = value


def show_fault_lines(place: Any, faults: Sequence[str], folder: Path | None = None) -> None:
    """Show errors in a place that is hidden without any."""
    place.clear()
    with place:
        for text in faults:
            ui.label(escape_control(relative_names(text, folder))).classes("break-words")
    place.set_visibility(bool(faults))


def action(label: str, on_click: Any, icon: str | None = None, main: bool = False) -> Any:
    """A button; a page has one `main` action, which leads to the next step."""
    button = ui.button(label, icon=icon, on_click=on_click).props("no-caps")
    return button.props("unelevated text-color=on-accent") if main else button.props("outline")


def chip(text: str, kind: str = "") -> Any:
    """A short state in a word: `kind` is "", "good", "warning", "error" or "accent"."""
    return ui.label(escape_control(text)).classes(f"ft-chip {kind}")


def note(text: str, kind: str = "") -> None:
    """One remark in a box: `kind` is "", "good" or "warning"; errors are shown by `show_error`."""
    ui.label(escape_control(text)).classes(f"ft-note {kind}")


def show_command(words: str) -> None:
    """Show the equivalent command line, with a button that copies it, and the units of the numbers in it."""
    with ui.element("div").classes("ft-command"):
        ui.label(escape_control(words)).classes("ft-mono").props('data-is="command"')
        copy = ui.button(icon="content_copy").props('flat dense round size=sm aria-label="copy the command"')
        copy.on("click", js_handler=f"() => navigator.clipboard.writeText({script_literal(words)})").tooltip("copy")
    if values := describe_overrides(words):
        ui.label(values).classes("ft-muted ft-small")


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
def refuse_damaged(file: Path, *allowed: type[Exception]) -> Iterator[None]:
    """Context manager: any exception of a library that reads a damaged or hostile file becomes BadInput.

    Exceptions of the types `allowed` stay as they are.
    """
    try:
        yield
    except Exception as fault:  # readers of NetCDF, HDF5 and images raise exceptions of many types
        if isinstance(fault, (FlashtempError, *allowed)):
            raise
        raise BadInput(f"{file}: cannot be read ({type(fault).__name__}); create it again or remove it") from fault


def escape_lines(text: str) -> str:
    """Escape control characters in every line of a text; only its line ends remain."""
    return "\n".join(map(escape_control, text.splitlines()))


def relative_names(text: str, folder: Path | None) -> str:
    """A text with file names relative to `folder`."""
    return text if folder is None else text.replace(f"{folder}{os.sep}", "")


def show_error(text: str, folder: Path | None = None) -> None:
    """Show an error message."""
    with ui.column().classes("ft-note error gap-0").props("role=alert"):
        for line in relative_names(text, folder).splitlines():
            ui.label(escape_control(line)).classes("break-all")
