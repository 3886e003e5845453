"""What the case page shows where no case is chosen: cases of the folder, ready cases, and how to begin a new one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

from nicegui import ui

from flashtemp.api.templates import new
from flashtemp.errors import FlashtempError
from flashtemp.lab.effect_cards import listed_effects
from flashtemp.lab.page_layout import action, card, chip, empty_state, heading, note, page_address, show_command
from flashtemp.lab.saving import read_text
from flashtemp.lab.style import ASSETS
from flashtemp.lab.workspace import escape_control, list_folder
from flashtemp.model.case_file import list_effect_files, parse_toml
from flashtemp.model.file_kinds import CASE_KIND, detect_kind
from flashtemp.physics.units import FILE_NAME_PATTERN

CASES: Final = Path(__file__).resolve().parents[2] / "cases"  # in a copy of the repository
EXAMPLES: Final = ASSETS / "examples"
MAX_CASES_LISTED: Final = 60
MAX_TITLE_LETTERS: Final = 80
NEW_CASE_TEXT: Final = "It begins with the defaults, and is saved under the name that you choose when you press Save."
MINIMAL_CASE: Final = 'title = "my case"\neffects = []\n'
Open = Callable[[str, str], Any]  # called with the text of a new case and its file name


@dataclass(frozen=True)
class ReadyCase:
    """A case that comes with the package: its `name`, `title`, the `effects` it lists, and its `text`."""

    name: str
    title: str
    effects: tuple[str, ...]
    text: str


@cache
def find_ready_cases() -> tuple[ReadyCase, ...]:
    """Cases that need no other file: those beside the package, or else the examples inside it."""
    files = {file.parent.name: file for file in sorted(CASES.glob("*/case.toml"))}
    out = []
    for name, file in (files or {file.stem: file for file in sorted(EXAMPLES.glob("*.toml"))}).items():
        try:
            text = file.read_text(encoding="utf-8")
            raw = parse_toml(text)
        except (OSError, ValueError):
            continue
        if detect_kind(raw) == CASE_KIND and not _names_files(raw) and not list_effect_files(raw):
            out.append(ReadyCase(name, _title_of(raw), tuple(listed_effects(raw)), text))
    return tuple(out)


def _names_files(raw: Any) -> bool:
    """Whether a value of a case is the name of a file."""
    if isinstance(raw, dict):
        return any(_names_files(v) for k, v in raw.items() if k != "title")
    return isinstance(raw, str) and FILE_NAME_PATTERN.fullmatch(raw) is not None


def _title_of(raw: dict[str, Any]) -> str:
    title = raw.get("title")
    return escape_control(title)[:MAX_TITLE_LETTERS] if isinstance(title, str) else ""


class CaseList:
    """Cases of the folder, ready cases of the package, and templates; `open_new` begins one of them."""

    def __init__(self, folder: Path, open_new: Open):
        self.folder, self.open_new = folder, open_new

    def show(self) -> None:
        """Show the list."""
        heading(1, "Cases")
        if cases := list_folder(self.folder).cases:
            self._show_cases(cases)
            with card("New case", NEW_CASE_TEXT):
                self._show_templates()
        else:
            with empty_state("No case in this folder", f"A case says what is simulated. {NEW_CASE_TEXT}"):
                self._show_templates()
        self._show_ready_cases()

    def _show_cases(self, cases: list[Path]) -> None:
        with card("In this folder"), ui.element("div").classes("ft-grid"):
            for path in cases[:MAX_CASES_LISTED]:
                title, effects = self._describe_case(path)
                with ui.element("article").classes("ft-card"):
                    ui.link(escape_control(str(path)), page_address("case", open=path)).classes("break-all")
                    if title:
                        ui.label(title).classes("ft-muted break-words")
                    _show_effect_chips(effects)
        if len(cases) > MAX_CASES_LISTED:
            note(f"{len(cases) - MAX_CASES_LISTED} more cases are not listed; serve a smaller folder to see them.")

    def _describe_case(self, path: Path) -> tuple[str, list[str]]:
        """Title and effects of a case file; empty where it cannot be read."""
        try:
            raw = parse_toml(read_text(self.folder, str(path))[0])
            return _title_of(raw), listed_effects(raw)
        except (FlashtempError, OSError, ValueError, RecursionError):
            return "", []

    def _show_templates(self) -> None:
        """Buttons that begin a new case, and the command that does the same."""
        with ui.column().classes("w-full gap-3"):
            with ui.row().classes("gap-2"):
                action("New case", lambda: self.open_new(MINIMAL_CASE, "case.toml"), icon="add", main=True)
                action("New case with every key as a comment", lambda: self.open_new(new("case").text, "case.toml"))
            show_command("flashtemp new case --out case.toml")

    def _show_ready_cases(self) -> None:
        ready = find_ready_cases()
        if not ready:
            return
        about = "Cases of the documentation. A copy opens here, and is saved when you press Save."
        with card("Ready cases", about), ui.element("div").classes("ft-grid"):
            for case in ready:
                with ui.element("article").classes("ft-card"):
                    button = ui.button(case.name.replace("_", " ")).props("flat dense no-caps color=primary")
                    button.classes("self-start").props["aria-label"] = f"open a copy of {case.name}"
                    button.on("click", lambda _, c=case: self.open_new(c.text, f"{c.name}.toml"))
                    if case.title:
                        ui.label(case.title).classes("ft-muted break-words")
                    _show_effect_chips(case.effects)


def _show_effect_chips(effects: Any) -> None:
    """The effects of a case as chips."""
    if effects:
        with ui.element("div").classes("ft-chips"):
            for name in list(effects)[:8]:
                chip(name.replace("_", " "))
            if len(effects) > 8:
                chip(f"{len(effects) - 8} more")
