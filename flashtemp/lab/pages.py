"""The web application: its pages and their addresses."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fastapi import FastAPI, Request
from nicegui import ui

from flashtemp.lab.camera_page import CameraPage
from flashtemp.lab.campaign_page import CampaignPage
from flashtemp.lab.case_page import CasePage
from flashtemp.lab.command_options import CommandDescription
from flashtemp.lab.folder_files import FolderFiles
from flashtemp.lab.frame_server import FrameServer
from flashtemp.lab.home_page import HomePage
from flashtemp.lab.jobs import JobList
from flashtemp.lab.jobs_page import JobsPage
from flashtemp.lab.page_layout import FILES_ADDRESS, page_frame, show_errors
from flashtemp.lab.programs import AllowedPrograms
from flashtemp.lab.recording_store import RecordingStore
from flashtemp.lab.result_page import show_result

RECONNECT_TIMEOUT_S = 30.0  # a busy computer may interrupt the connection; a page that is made anew loses its form


def make_application(folder: Path, commands: Sequence[CommandDescription] = ()) -> tuple[Any, JobList]:
    """The application for a folder, and its list of jobs; `commands` are those of the page of runs."""
    jobs, allowed, store = JobList(folder), AllowedPrograms(), RecordingStore(folder)
    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    app.mount(FILES_ADDRESS, FolderFiles(folder))
    frames = FrameServer()
    frames.add_route(app)

    @ui.page("/")
    def home() -> None:
        with page_frame("home", folder, "Where the heat goes, and what the model lacks"):
            HomePage(folder, jobs, allowed).show()

    @ui.page("/camera")
    async def camera(open: str = "", template: str = "") -> None:  # noqa: A002 (key of the address)
        with page_frame("camera", folder, "Camera"):
            await CameraPage(folder, frames).show(open, template)

    @ui.page("/case")
    def case(open: str = "") -> None:  # noqa: A002
        with page_frame("case", folder):
            CasePage(folder, allowed).show(open)

    @ui.page("/campaign")
    def campaign(open: str = "", new: str = "") -> None:  # noqa: A002
        with page_frame("campaign", folder, "Campaign" if open or new else "Campaigns"):
            CampaignPage(folder, allowed, store, jobs).show(open, bool(new))

    @ui.page("/runs")
    async def runs(command: str = "", of: str = "", job: str = "", again: str = "") -> None:
        with page_frame("runs", folder, "" if job else "Runs"):
            await JobsPage(folder, jobs, allowed, commands).show(command, of, job, again)

    @ui.page("/result")
    @ui.page("/verdict")
    def result(request: Request, open: str = "") -> None:  # noqa: A002
        with page_frame("", folder), show_errors(folder):
            show_result(folder, open, request.query_params.getlist("with"), jobs, allowed)

    ui.run_with(
        app, title="flashtemp", favicon="🔥", language="en-US", dark=None, show_welcome_message=False,
        reconnect_timeout=RECONNECT_TIMEOUT_S,
    )  # fmt: skip
    return app, jobs
