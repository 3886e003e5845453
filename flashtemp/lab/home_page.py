"""The home page: the four steps from camera files to a verdict, examples, recent results, and all files."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from nicegui import ui

from flashtemp.display import format_count
from flashtemp.lab.camera_files import UploadArea, describe_place
from flashtemp.lab.examples import Example, list_examples, write_example
from flashtemp.lab.job_start import file_word, short_file_name
from flashtemp.lab.jobs import JobList, command_text
from flashtemp.lab.page_layout import (
    MAX_NAMES_LISTED,
    action,
    card,
    chip,
    empty_state,
    heading,
    note,
    page_address,
    show_command,
)
from flashtemp.lab.programs import AllowedPrograms
from flashtemp.lab.result_card import describe_result, list_recent_results, show_result_card
from flashtemp.lab.start_button import OPTIONS_LABEL, CommandStarter, options_address
from flashtemp.lab.thermal_viewer import add_viewer_style
from flashtemp.lab.workspace import FolderListing, escape_control, list_folder

MAX_RECENT_RESULTS = 8
STATE_WORDS = {"done": ("done", "good"), "next": ("next step", "accent"), "later": ("not yet", "")}


@dataclass(frozen=True)
class Step:
    """One of the four steps: its `state` (done, next or later), what is there, what is missing, and where it leads.

    `campaign` is the one that the step asks what is missing, "" for the other steps.
    """

    title: str
    state: str
    there: str
    missing: str
    label: str
    target: str
    campaign: str = ""


def find_steps(listing: FolderListing, answer: str = "") -> list[Step]:
    """The four steps from camera files to a verdict; the first one that is not done is the next.

    `answer` is the first sentence of the newest verdict.
    """
    series, recordings, campaigns = listing.image_series, listing.recordings, listing.campaigns
    verdicts = [path for path, command in listing.results.items() if command == "discover"]
    first_series = next(iter(series), "")
    campaign = short_file_name(campaigns[0]) if campaigns else ""
    rows = [
        (
            "Camera files", bool(series or recordings),
            f"{format_count(sum(series.values()), 'file')} in {len(series)} series" if series else "imported already",
            "Drop the files of the camera or of a data logger below, or copy them into the folder.",
            ("See them", "Add camera files"), page_address("camera", open=first_series) if series else "/camera",
        ),
        (
            "Recordings", bool(recordings), format_count(len(recordings), "recording"),
            "Mark the block in one image and state what the files do not say.",
            ("See them", "Mark the block"),
            page_address("camera", open=recordings[0]) if recordings else page_address("camera", open=first_series),
        ),
        (
            "Campaign", bool(campaigns), format_count(len(campaigns), "campaign"),
            "Say under which load and speed each recording was made, and which case should explain it.",
            ("Open it", "Put it together"), page_address("campaign", open=campaigns[0]) if campaigns else "/campaign",
        ),
        (
            "Verdict", bool(verdicts), answer or format_count(len(verdicts), "verdict"),
            "Compare measurement and model, and ask what the model lacks.",
            ("Read it", "Ask what is missing"),
            page_address("result", open=verdicts[0]) if verdicts else options_address("discover", campaign),
        ),
    ]  # fmt: skip
    n_done = next((k for k, row in enumerate(rows) if not row[1]), len(rows))
    # a later step can be done before an earlier one: recordings may come without their camera files
    states = ["done" if row[1] else "next" if k == n_done else "later" for k, row in enumerate(rows)]
    steps = [
        Step(title, state, there if done else "", "" if done else missing, labels[not done], target)
        for (title, done, there, missing, labels, target), state in zip(rows, states, strict=True)
    ]
    return [*steps[:-1], replace(steps[-1], campaign="" if verdicts else campaign)]


@dataclass(frozen=True)
class FileRow:
    """One file of the list: a `link` (text, address), `starts` {text: words of a command}, and where `options` are."""

    path: Path | str
    link: tuple[str, str] | None
    starts: Mapping[str, Callable[[], list[str]]]
    options: str = ""


class HomePage:
    """What the folder holds, and one button for the next step."""

    def __init__(self, folder: Path, jobs: JobList, allowed: AllowedPrograms):
        self.folder, self.starter = folder, CommandStarter(folder, jobs, allowed)

    def show(self) -> None:
        """Show the page."""
        listing = list_folder(self.folder)
        recent = list_recent_results(self.folder, listing.results)
        for sentence in listing.omissions:
            note(sentence, "warning")
        verdict = next((path for path, command in recent if command == "discover"), None)
        answer = "" if verdict is None else describe_result(self.folder, verdict)
        self._show_steps(find_steps(listing, answer))
        if not listing.images and not listing.recordings:
            add_viewer_style()  # has the style of the zone
            UploadArea(self.folder).show()
        if not listing.cases:
            with card("A case", "A case states block, road, load, speed and what heats. A campaign needs one."):
                action("Begin a case", lambda: ui.navigate.to("/case"), "add").classes("self-start")
        self._show_results(recent)
        self._show_examples()
        self._show_files(listing)

    def _show_steps(self, steps: Sequence[Step]) -> None:
        with ui.element("ol").classes("ft-steps").props('aria-label="from camera files to a verdict"'):
            for number, step in enumerate(steps, 1):
                words, kind = STATE_WORDS[step.state]
                with ui.element("li").classes(step.state), ui.element("div").classes(f"ft-card {step.state}"):
                    with ui.row().classes("items-center gap-2 no-wrap w-full"):
                        ui.label(str(number)).classes("ft-step-number").props("aria-hidden=true")
                        heading(2, step.title).classes("grow")
                        chip(words, kind)
                    ui.label(escape_control(step.there or step.missing)).classes(
                        "grow break-words" if step.there else "grow ft-muted"
                    )
                    if step.state == "next" and step.campaign:
                        self.starter.show(step.label, "discover", step.campaign, main=True)
                    elif step.state != "later":
                        open_target = lambda target=step.target: ui.navigate.to(target)  # noqa: E731
                        action(step.label, open_target, main=step.state == "next")

    def _show_results(self, recent: Sequence[tuple[Path, str]]) -> None:
        if not recent:
            with empty_state(
                "No results yet", "Runs, comparisons and verdicts appear here, each with its main picture."
            ):
                action("Start a run", lambda: ui.navigate.to("/runs"), "play_arrow")
            return
        with card("Recent results"), ui.element("div").classes("ft-grid"):
            for path, command in recent[:MAX_RECENT_RESULTS]:
                show_result_card(self.folder, path, command)

    def _show_examples(self) -> None:
        about = "Each writes its files into examples/ of this folder and starts a command."
        with card("Try an example", about), ui.element("div").classes("ft-split"):
            for example in list_examples():
                self._show_example(example)

    def _show_example(self, example: Example) -> None:
        with ui.column().classes("gap-2 min-w-0 w-full"):
            heading(3, example.title)
            ui.label(example.about).classes("ft-muted")
            show_command(command_text(example.command_words(self.folder)))

            def write_files() -> list[str]:
                write_example(example, self.folder)
                return example.command_words(self.folder)

            self.starter.add_button(f"Try: {example.title.lower()}", write_files)

    def _show_files(self, listing: FolderListing) -> None:
        """All files of the folder by kind, with what can be done with each."""
        groups = self._group_files(listing)
        if not any(groups.values()):
            return
        with card("All files"), ui.element("div").classes("ft-split"):
            for title, rows in groups.items():
                if rows:
                    self._show_group(title, rows)

    def _group_files(self, listing: FolderListing) -> dict[str, list[FileRow]]:
        """{kind: rows of its files}."""

        def row(path: Path | str, label: str, page: str, commands: Sequence[str] = (), key: str = "open") -> FileRow:
            starts = {c: partial(self.starter.command_words, c, path) for c in commands}
            options = options_address(commands[0], path) if commands else ""
            return FileRow(path, (label, page_address(page, **{key: path})), starts, options)

        def unfinished(path: Path, command: str) -> FileRow:
            if command != "run":
                return FileRow(path, ("resume", options_address(command, path)), {})
            return FileRow(path, None, {"resume": lambda: ["run", "--resume", file_word(str(path))]})

        return {
            "Cases": [row(p, "open", "case", ["run"]) for p in listing.cases],
            "Camera files": [
                row(p, f"view {format_count(n, 'file')}", "camera") for p, n in listing.image_series.items()
            ],
            "Recording templates": [row(p, "open", "camera", key="template") for p in listing.templates],
            "Recordings": [row(p, "view", "camera") for p in listing.recordings],
            "Campaigns": [row(p, "open", "campaign", ["compare", "discover", "plan"]) for p in listing.campaigns],
            "Results": [row(p, "open", "result") for p in listing.results],
            "Unfinished runs": [unfinished(p, o.command) for p, o in listing.begun.items()],
        }

    def _show_group(self, title: str, rows: Sequence[FileRow]) -> None:
        """The files of one kind, with links and buttons that start commands."""
        with ui.column().classes("gap-1 w-full min-w-0"):
            heading(3, title)
            for row in rows[:MAX_NAMES_LISTED]:
                with ui.row().classes("items-center gap-3 w-full no-wrap"):
                    name = escape_control(str(row.path))
                    ui.label(describe_place(str(row.path))).classes("break-all grow ft-mono ft-small")
                    if row.link is not None:
                        ui.link(*row.link).props["aria-label"] = f"{row.link[0]}: {name}"
                    for words, find_words in row.starts.items():
                        self.starter.add_small_button(words, find_words, f"{words}: {name}")
                    if row.options:
                        link = ui.link(OPTIONS_LABEL.lower(), row.options).classes("ft-small")
                        link.props["aria-label"] = f"options: {name}"
            if len(rows) > MAX_NAMES_LISTED:
                ui.label(f"and {len(rows) - MAX_NAMES_LISTED} more").classes("ft-muted")
