"""The web application: the pages with their addresses, and the start page of the folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fastapi import FastAPI
from nicegui import ui

from flashtemp.display import format_count
from flashtemp.lab.camera_page import CameraPage
from flashtemp.lab.campaign_page import CampaignPage
from flashtemp.lab.case_page import CasePage
from flashtemp.lab.folder_files import FolderFiles
from flashtemp.lab.jobs import JobList
from flashtemp.lab.jobs_page import JobsPage
from flashtemp.lab.page_layout import (
    FILES_ADDRESS,
    MAX_NAMES_LISTED,
    STANDARD_FILES,
    page_address,
    page_frame,
    show_errors,
)
from flashtemp.lab.programs import AllowedPrograms
from flashtemp.lab.result_page import show_result
from flashtemp.lab.workspace import escape_control, list_folder


def make_application(folder: Path) -> tuple[Any, JobList]:
    """The application for a folder, and its list of jobs."""
    jobs, allowed = JobList(folder), AllowedPrograms()
    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    app.mount(FILES_ADDRESS, FolderFiles(folder))

    @ui.page("/")
    def files() -> None:
        with page_frame("home", folder):
            _show_folder(folder)

    @ui.page("/camera")
    async def camera(open: str = "", template: str = "") -> None:  # noqa: A002 (key of the address)
        with page_frame("camera", folder):
            await CameraPage(folder).show(open, template)

    @ui.page("/case")
    def case(open: str = "") -> None:  # noqa: A002
        with page_frame("case", folder):
            CasePage(folder, allowed).show(open)

    @ui.page("/campaign")
    def campaign(open: str = "") -> None:  # noqa: A002
        with page_frame("campaign", folder):
            CampaignPage(folder, allowed).show(open)

    @ui.page("/runs")
    def runs(command: str = "run", of: str = "") -> None:
        with page_frame("runs", folder):
            JobsPage(folder, jobs, allowed).show(command, of)

    @ui.page("/result")
    def result(open: str = "") -> None:  # noqa: A002
        with page_frame("", folder), show_errors(folder):
            show_result(folder, open)

    ui.run_with(app, title="flashtemp", favicon="🔥", dark=None, show_welcome_message=False)
    return app, jobs


def _show_folder(folder: Path) -> None:
    """List the files of the folder by kind, with links to what can be done with each."""
    listing = list_folder(folder)

    def campaign_links(campaign: Path) -> list[tuple[str, str]]:
        return [(c, _runs_link(c, campaign)) for c in ("compare", "discover", "plan")]

    groups: dict[str, Sequence[tuple[Path | str, list[tuple[str, str]]]]] = {
        "Cases": [(p, [("open", page_address("case", open=p)), ("run", _runs_link("run", p))]) for p in listing.cases],
        "Camera files": [
            (p, [(f"view {format_count(n, 'file')}", page_address("camera", open=p))])
            for p, n in listing.image_series.items()
        ],
        "Recording templates": [(p, [("open", page_address("camera", template=p))]) for p in listing.templates],
        "Recordings": [(p, [("view", page_address("camera", open=p))]) for p in listing.recordings],
        "Campaigns": [(p, [("open", page_address("campaign", open=p)), *campaign_links(p)]) for p in listing.campaigns],
        "Results": [(p, [("open", page_address("result", open=p))]) for p in listing.results],
        "Unfinished runs": [(p, [("resume", _runs_link(o.command, p))]) for p, o in listing.begun.items()],
    }  # fmt: skip
    for sentence in listing.omissions:
        ui.label(sentence).classes("text-amber-900")
    if not any(groups.values()):
        ui.label("No files yet: create a case, or drop camera files on the camera page.")
    with ui.row().classes("w-full gap-6 items-start"):
        for title, rows in groups.items():
            if rows:
                _show_group(title, rows)
    with ui.row():
        ui.button("New case", on_click=lambda: ui.navigate.to("/case")).props("outline")
        ui.button("New campaign", on_click=lambda: ui.navigate.to("/campaign")).props("outline")
        ui.button("Camera files", on_click=lambda: ui.navigate.to("/camera")).props("outline")


def _runs_link(command: str, of: Path) -> str:
    """The address of the page of runs with a command and its file; a standard file goes by the name of its folder."""
    return page_address(
        "runs", command=command, of=of.parent if of.name in STANDARD_FILES and of.parent != Path() else of
    )


def _show_group(title: str, rows: Sequence[tuple[Path | str, list[tuple[str, str]]]]) -> None:
    """A card with the files of one kind and their links."""
    with ui.card().classes("min-w-72 max-w-full"):
        ui.label(title).classes("text-lg font-medium")
        for path, links in rows[:MAX_NAMES_LISTED]:
            with ui.row().classes("items-center gap-3 w-full no-wrap"):
                ui.label(escape_control(str(path))).classes("break-all grow")
                for words, target in links:
                    ui.link(words, target)
        if len(rows) > MAX_NAMES_LISTED:
            ui.label(f"and {len(rows) - MAX_NAMES_LISTED} more")
