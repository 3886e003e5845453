"""A result in brief: its main picture, its answer in one sentence and when it was made."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

from nicegui import ui

from flashtemp.errors import BadInput
from flashtemp.lab.page_layout import chip, file_address, page_address
from flashtemp.lab.result_sentences import SENTENCES
from flashtemp.lab.workspace import RESULT_COMMANDS, escape_control, find_own_file, read_json_quietly, resolve_inside

MAX_SENTENCE_CHARACTERS = 1000
MAIN_PICTURES = {  # of a command's result, the first that exists
    "run": ("profile.png", "field.png"),
    "discover": ("what_is_wrong.png", "why.png"),
    "compare": ("what_is_wrong.png",),
}


def find_main_picture(folder: Path, result: Path, command: str) -> Path | None:
    """The picture that shows a result best, relative to the folder; None where there is none."""
    usual = [result / name for name in MAIN_PICTURES.get(command, ())]
    try:
        others = sorted(result / p.name for p in resolve_inside(folder, str(result)).iterdir() if p.suffix == ".png")
    except (OSError, BadInput):
        others = []
    shown = (name for name in [*usual, *others] if escape_control(name.name) == name.name)
    return next((name for name in shown if find_own_file(folder, name) is not None), None)


def describe_result(folder: Path, result: Path) -> str:
    """The answer of a result in one sentence, "" where its file does not say."""
    for name, describe in SENTENCES.items():
        if says := describe(read_json_quietly(folder, result / name)):
            return says[0][:MAX_SENTENCE_CHARACTERS]
    return ""


def show_result_card(folder: Path, result: Path, command: str) -> None:
    """A card with the main picture, the command, the time and the answer, which opens the result."""
    target = page_address("result", open=result)
    with ui.element("article").classes("ft-card ft-result"):
        with ui.link(target=target).classes("ft-thumbnail") as link:
            link.props["aria-label"] = f"open {escape_control(str(result))}"
            picture = find_main_picture(folder, result, command)
            if picture is not None:
                image = ui.element("img").props('alt=""')  # the link has the name
                image.props["src"] = file_address(picture)
            else:
                ui.icon("insights", size="48px").classes("ft-muted")
        with ui.row().classes("items-center gap-2 w-full no-wrap"):
            ui.link(escape_control(result.name), target).classes("font-semibold break-all grow")
            chip(command)
        if words := describe_result(folder, result):
            ui.label(escape_control(words)).classes("ft-small")
        if (made := _time_made(folder / result)) is not None:
            ui.label(f"{made:%Y-%m-%d %H:%M}").classes("ft-small ft-muted")


def list_recent_results(folder: Path, results: dict[Path, str]) -> list[tuple[Path, str]]:
    """Results with their commands, the newest first."""
    oldest = datetime.min
    return sorted(results.items(), key=lambda row: _time_made(folder / row[0]) or oldest, reverse=True)


def _time_made(result: Path) -> datetime | None:
    """When the file that every result of its kind has was written."""
    for name in RESULT_COMMANDS:
        try:
            return datetime.fromtimestamp((result / name).stat().st_mtime)
        except (OSError, ValueError, OverflowError):
            continue
    return None
