"""The home page: the four steps from camera files to a verdict, examples, recent results, and all files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from nicegui import ui

from flashtemp.display import format_count
from flashtemp.lab.camera_files import UploadArea
from flashtemp.lab.examples import Example, list_examples, start_example
from flashtemp.lab.jobs import JobList, command_text
from flashtemp.lab.page_layout import (
    MAX_NAMES_LISTED,
    STANDARD_FILES,
    action,
    card,
    chip,
    empty_state,
    heading,
    note,
    page_address,
    show_command,
    show_errors,
)
from flashtemp.lab.programs import AllowedPrograms
from flashtemp.lab.result_card import describe_result, list_recent_results, show_result_card
from flashtemp.lab.thermal_viewer import add_viewer_style
from flashtemp.lab.workspace import FolderListing, escape_control, list_folder

MAX_RECENT_RESULTS = 8
STATE_WORDS = {"done": ("done", "good"), "next": ("next step", "accent"), "later": ("not yet", "")}


@dataclass(frozen=True)
class Step:
    """One of the four steps: its `state` (done, next or later), what is there, what is missing, and where it leads."""

    title: str
    state: str
    there: str
    missing: str
    label: str
    target: str


def find_steps(listing: FolderListing, answer: str = "") -> list[Step]:
    """The four steps from camera files to a verdict; the first one that is not done is the next.

    `answer` is the first sentence of the newest verdict.
    """
    series, recordings, campaigns = listing.image_series, listing.recordings, listing.campaigns
    verdicts = [path for path, command in listing.results.items() if command == "discover"]
    first_series = next(iter(series), "")
    campaign = _without_standard_name(campaigns[0]) if campaigns else ""
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
            page_address("result", open=verdicts[0])
            if verdicts
            else page_address("runs", command="discover", of=campaign),
        ),
    ]  # fmt: skip
    n_done = next((k for k, row in enumerate(rows) if not row[1]), len(rows))
    # a later step can be done before an earlier one: recordings may come without their camera files
    states = ["done" if row[1] else "next" if k == n_done else "later" for k, row in enumerate(rows)]
    return [
        Step(title, state, there if done else "", "" if done else missing, labels[not done], target)
        for (title, done, there, missing, labels, target), state in zip(rows, states, strict=True)
    ]


def _without_standard_name(path: Path) -> Path:
    """A folder stands for its case.toml or campaign.toml in a command."""
    return path.parent if path.name in STANDARD_FILES and path.parent != Path() else path


class HomePage:
    """What the folder holds, and one button for the next step."""

    def __init__(self, folder: Path, jobs: JobList, allowed: AllowedPrograms):
        self.folder, self.jobs, self.allowed = folder, jobs, allowed

    def show(self) -> None:
        """Show the page."""
        listing = list_folder(self.folder)
        recent = list_recent_results(self.folder, listing.results)
        for sentence in listing.omissions:
            note(sentence, "warning")
        verdict = next((path for path, command in recent if command == "discover"), None)
        answer = "" if verdict is None else describe_result(self.folder, verdict, "discover")
        self._show_steps(find_steps(listing, answer))
        if not listing.images and not listing.recordings:
            add_viewer_style()  # has the style of the zone
            UploadArea(self.folder).show()
        if not listing.cases:
            with card("A case", "A case states block, road, load, speed and what heats. A campaign needs one."):
                action("New case", lambda: ui.navigate.to("/case"), "add").classes("self-start")
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
                    if step.state != "later":
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
            place = ui.column().classes("w-full")

            async def start() -> None:
                with place, show_errors(self.folder):
                    if await start_example(example, self.folder, self.jobs, self.allowed):
                        ui.navigate.to("/runs")

            action(f"Try: {example.title.lower()}", start, "play_arrow")

    def _show_files(self, listing: FolderListing) -> None:
        """All files of the folder by kind, with what can be done with each."""
        groups = _group_files(listing)
        if not any(groups.values()):
            return
        with card("All files"), ui.element("div").classes("ft-split"):
            for title, rows in groups.items():
                if rows:
                    _show_group(title, rows)


def _group_files(listing: FolderListing) -> dict[str, Sequence[tuple[Path | str, list[tuple[str, str]]]]]:
    """{kind: [(file, [(what can be done, address)])]}."""

    def campaign_links(campaign: Path) -> list[tuple[str, str]]:
        return [(c, _runs_link(c, campaign)) for c in ("compare", "discover", "plan")]

    return {
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


def _runs_link(command: str, of: Path) -> str:
    """The address of the page of runs with a command and its file."""
    return page_address("runs", command=command, of=_without_standard_name(of))


def _show_group(title: str, rows: Sequence[tuple[Path | str, list[tuple[str, str]]]]) -> None:
    """The files of one kind and their links."""
    with ui.column().classes("gap-1 w-full min-w-0"):
        heading(3, title)
        for path, links in rows[:MAX_NAMES_LISTED]:
            with ui.row().classes("items-center gap-3 w-full no-wrap"):
                name = escape_control(str(path))
                ui.label(name).classes("break-all grow ft-mono ft-small")
                for words, target in links:
                    ui.link(words, target).props["aria-label"] = f"{words}: {name}"
        if len(rows) > MAX_NAMES_LISTED:
            ui.label(f"and {len(rows) - MAX_NAMES_LISTED} more").classes("ft-muted")
