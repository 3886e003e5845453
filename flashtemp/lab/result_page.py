"""The page of a finished result: main numbers, plots, pictures, report and files, by the command that made it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from nicegui import ui

from flashtemp.errors import BadInput
from flashtemp.lab.conditions import show_conditions
from flashtemp.lab.page_layout import (
    chip,
    empty_state,
    file_address,
    heading,
    page_address,
    show_error,
    show_errors,
)
from flashtemp.lab.result_card import list_recent_results, show_result_card
from flashtemp.lab.result_files import (
    ResultFolder,
    describe_age,
    open_result,
    show_files,
    show_gallery,
    show_report,
)
from flashtemp.lab.result_parts import add_result_assets, load_later, refuse_unreadable, show_answer
from flashtemp.lab.result_sentences import describe_run
from flashtemp.lab.run_comparison import RunComparison
from flashtemp.lab.run_data import RunData, main_numbers, read_run
from flashtemp.lab.run_result import show_run_charts
from flashtemp.lab.scene_3d import show_scene
from flashtemp.lab.start_button import CommandStarter
from flashtemp.lab.study_results import show_study
from flashtemp.lab.workspace import RESULT_COMMANDS, escape_control, list_folder

MAX_OFFERED = 8  # results shown where none is chosen
KIND_WORDS = {
    "run": "Run", "discover": "Verdict", "compare": "Comparison", "plan": "Plan", "sweep": "Sweep",
    "sensitivity": "Sensitivity", "friction": "Friction", "loads": "Load dependence", "tread": "Tread block",
    "tyre": "Tyre",
}  # fmt: skip


def show_result(folder: Path, name: str, others: Sequence[str], starter: CommandStarter) -> None:
    """Show a result folder; a run beside the runs `others`, a discovery as its verdict.  Raises BadInput."""
    add_result_assets()
    if not name:
        heading(1, "Result")
        show_no_result(folder, "No result is chosen", "Choose one below, or start a command on the page Runs.")
        return
    try:
        result = open_result(folder, name)
    except BadInput as fault:
        heading(1, "Result")
        show_error(str(fault), folder)
        show_no_result(folder, "There is no such result", "Choose one below, or start a command on the page Runs.")
        return
    show_title(result)
    if result.command == "run":
        _show_run(result, others, starter)
    elif result.command == "discover":
        from flashtemp.lab.verdict_page import show_verdict_parts

        show_verdict_parts(result, starter)
    elif result.command:
        with show_errors(folder):
            show_study(result, starter)
    else:
        about = f"{result.name} holds no result of a command of flashtemp."
        show_no_result(folder, "Nothing to show here yet", about)
    with show_errors(folder):
        show_gallery(result, _verdict_captions() if result.command == "discover" else None)
    show_files(result)
    show_report(result)


def show_no_result(folder: Path, title: str, how: str) -> None:
    """Say that there is no result, and lead to the results of the folder and to where they come from."""
    with empty_state(title, how):
        ui.link("Home", "/")
        ui.link("Start a command", page_address("runs"))
    results = list_recent_results(folder, list_folder(folder).results)[:MAX_OFFERED]
    if results:
        with ui.element("div").classes("ft-grid"):
            for path, command in results:
                show_result_card(folder, path, command)


def show_title(result: ResultFolder) -> None:
    """The heading of the page with the kind, the folder and the age of the result."""
    title = f"{KIND_WORDS.get(result.command, 'Result')} {result.here.name}"
    heading(1, title)
    ui.page_title(f"{escape_control(title)} · flashtemp")
    with ui.row().classes("items-center gap-2"):
        if result.command:
            chip(f"flashtemp {result.command}", "accent")
        if age := describe_age(result, list(RESULT_COMMANDS)):
            chip(age)
        ui.label(result.name).classes("ft-muted ft-small break-all")
        for name, words in {"report.html": "Report", "report.pdf": "PDF for printing"}.items():
            if result.find_file(name) is not None:
                ui.link(words, file_address(result.here / name), new_tab=True).classes("ft-small")


def _verdict_captions() -> dict[str, str]:
    from flashtemp.viz.verdict.verdict_figures import PICTURE_CAPTIONS

    return {name: caption.partition(". ")[0].rstrip(".") + "." for name, caption in PICTURE_CAPTIONS.items()}


def _show_run(result: ResultFolder, others: Sequence[str], starter: CommandStarter) -> None:
    """Main numbers, plots, 3D view, comparison and conditions of a run."""
    summary: dict[str, Any] = {}
    values: dict[str, Any] = {}
    with show_errors(result.folder):
        summary = result.read_json("summary.json")
    with show_errors(result.folder):
        values = result.read_case()
    with show_errors(result.folder), refuse_unreadable(f"{result.name}/summary.json"):
        _show_summary(summary)
    if others:
        RunComparison(result).show(others)

    def show_charts(data: RunData) -> None:
        show_run_charts(data, summary)

    load_later(result.folder, "the profiles of run.nc", lambda: read_run(result), show_charts)
    show_scene(result, values.get("block.width"))
    if not others:
        RunComparison(result).show(others)
    if values:
        with show_errors(result.folder), refuse_unreadable(f"{result.name}/case.toml"):
            show_conditions(result, values, starter)


def _show_summary(summary: dict[str, Any]) -> None:
    """The main numbers of a run."""
    if summary:
        show_answer(describe_run(summary), main_numbers(summary))
