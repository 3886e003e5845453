"""What can be added to a campaign: recordings of the folder, tables of load cells and loggers, dropped files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

from nicegui import run, ui

from flashtemp.camera.prediction.synthetic_recording import VIEW_GEOMETRY
from flashtemp.display import format_count
from flashtemp.lab.campaign_document import CampaignDocument
from flashtemp.lab.dropped_files import CAMERA_PAGE_KINDS, TABLE_ACTIONS, MeasurementDrop
from flashtemp.lab.file_name_conditions import suggest_conditions
from flashtemp.lab.file_recognition import TEXT_SUFFIXES, recognise_file
from flashtemp.lab.page_layout import action, heading, page_address
from flashtemp.lab.recording_store import RecordingStore
from flashtemp.lab.toml_tables import Table, add_entry, change_entry
from flashtemp.lab.workspace import FolderListing, escape_control, list_folder

MAX_SHOWN: Final = 40  # recordings that are offered
SENSOR_EXAMPLE: Final = [{"name": "a", "x": 0.01, "z": 0.002}]


class CampaignAdditions:
    """Offers of what can be added; every click edits the text.  `stored` is called after files have been dropped."""

    def __init__(self, document: CampaignDocument, store: RecordingStore, stored: Callable[[], Any]):
        self.document, self.store, self.stored = document, store, stored
        self.listing = FolderListing()
        self.dismissed: set[str] = set()  # files whose suggested conditions are not wanted
        self.shown: Any = None
        self.pictures: dict[Path, Any] = {}

    def show_suggestions(self) -> None:
        """Show the place for conditions that file names state."""
        self.suggestions = ui.element("div").classes("w-full ft-optional")

    def show(self) -> None:
        """Show the offers."""
        self.offers = ui.element("div").classes("w-full ft-optional")
        with ui.element("div").classes("ft-split"):
            with ui.column().classes("gap-2 min-w-0 w-full"):
                heading(3, "Tables and planned views")
                self._show_tables()
            with ui.column().classes("gap-2 min-w-0 w-full"):
                heading(3, "Add files from this computer")
                MeasurementDrop(self.document.folder, self.store, self._add_table, self._files_stored).show()
        self.update_offers()

    # --- recordings of the folder ---------------------------------------------------------------------------
    def list_missing(self) -> list[Path]:
        """Recordings of the folder that the campaign does not list."""
        home = self.document.folder.resolve()
        listed = {self.document.find_file(entry.get("file")) for entry in self.document.list_entries("recording")}
        return [path for path in self.listing.recordings if (home / path).resolve() not in listed]

    def update_offers(self) -> None:
        """Show the offers for the text as it stands."""
        self.listing = list_folder(self.document.folder)
        is_toml = self.document.raw is not None
        missing, suggested = self.list_missing() if is_toml else [], self._suggest()
        if self.shown == (missing, suggested, len(self.listing.images)):
            return
        self.shown = (missing, suggested, len(self.listing.images))
        self.offers.clear()
        self.pictures = {}
        with self.offers:
            self._show_missing(missing)
        self.suggestions.clear()
        with self.suggestions:
            self._show_suggestions(suggested)
        tables = [str(p) for p in self.listing.images if p.suffix.lower() in TEXT_SUFFIXES]
        self.table.set_options(tables, value=self.table.value if self.table.value in tables else None)

    def _show_missing(self, missing: list[Path]) -> None:
        if not missing:
            if not self.listing.recordings:
                with ui.column().classes("gap-2 items-start"):
                    ui.label(
                        "The folder holds no recording yet. Import camera files first: mark the block in one image."
                    )
                    action("Import camera files", lambda: ui.navigate.to(page_address("camera")), "photo_camera")
            return
        with ui.column().classes("gap-2 w-full"):
            with ui.row().classes("items-center gap-3"):
                heading(3, f"{format_count(len(missing), 'recording')} of the folder not in the campaign")
                if len(missing) > 1:
                    action(f"Add all {len(missing)}", lambda: self._add_recordings(missing), "playlist_add")
            with ui.element("div").classes("ft-offers"):
                for path in missing[:MAX_SHOWN]:
                    self._show_offer(path)
            if len(missing) > MAX_SHOWN:
                ui.label(f"and {len(missing) - MAX_SHOWN} more").classes("ft-muted")

    def _show_offer(self, path: Path) -> None:
        with ui.element("div").classes("ft-offer"):
            self.pictures[path] = ui.element("div").classes("ft-small-picture")
            ui.label(escape_control(str(path))).classes("ft-mono ft-small break-all grow")
            button = ui.button("Add", icon="add", on_click=lambda: self._add_recordings([path]))
            button.props("flat dense no-caps color=primary")
            button.props["aria-label"] = f"Add {escape_control(str(path))}"

    def update_pictures(self) -> None:
        """Show the pictures of offered recordings that have been read."""
        for path, place in self.pictures.items():
            brief = self.store.find_brief(self.document.folder / path)
            place.clear()
            with place:
                if brief is not None and brief.picture:
                    picture = ui.element("img").props('alt=""')
                    picture.props["src"] = brief.picture
                else:
                    icon = ui.icon("broken_image" if brief is None else "show_chart").classes("ft-muted")
                    if brief is None:
                        icon.tooltip("cannot be read; import its camera files again")

    def _add_recordings(self, paths: Sequence[Path]) -> None:
        def add_all(text: str) -> str:
            for path in paths:
                text = add_entry(text, "recording", {"file": self.document.relative_name(path)})
            return text

        self.document.apply_edit(add_all)

    def duplicate_entry(self, kind: str, number: int) -> None:
        """Add an entry with the conditions of another one: of the next recording that is not listed, if any."""
        entry = dict(self.document.list_entries(kind)[number - 1])
        missing = self.list_missing() if kind == "recording" and "file" in entry else []
        if missing:
            entry["file"] = self.document.relative_name(missing[0])
        self.document.apply_edit(lambda text: add_entry(text, kind, entry, after=number))

    # --- conditions that file names state -------------------------------------------------------------------
    def _suggest(self) -> dict[int, dict[str, str]]:
        entries = self.document.list_entries("recording")
        found = suggest_conditions(entries)
        return {n: given for n, given in found.items() if str(entries[n - 1].get("file")) not in self.dismissed}

    def _show_suggestions(self, suggested: dict[int, dict[str, str]]) -> None:
        if not suggested:
            return
        entries = self.document.list_entries("recording")
        with ui.column().classes("ft-note gap-1"):
            ui.label("Conditions read from the file names. Are they right?").classes("font-medium")
            for n, given in list(suggested.items())[:MAX_SHOWN]:
                words = ", ".join(f"{key} = {value}" for key, value in given.items())
                ui.label(escape_control(f"{entries[n - 1].get('file')}: {words}")).classes("ft-small break-all")
            with ui.row().classes("gap-2"):
                action("Use them", lambda: self._use_suggestions(suggested), "check")
                action("Ignore", lambda: self._dismiss_suggestions(suggested))

    def _use_suggestions(self, suggested: dict[int, dict[str, str]]) -> None:
        def use_all(text: str) -> str:
            for n, given in suggested.items():
                stated = self.document.list_entries("recording")[n - 1].get("with", {})
                text = change_entry(text, "recording", n, {"with": {**stated, **given}})
            return text

        self.document.apply_edit(use_all)

    def _dismiss_suggestions(self, suggested: dict[int, dict[str, str]]) -> None:
        entries = self.document.list_entries("recording")
        self.dismissed |= {str(entries[n - 1].get("file")) for n in suggested}
        self.update_offers()

    # --- tables and planned views ----------------------------------------------------------------------------
    def _show_tables(self) -> None:
        with ui.row().classes("items-center gap-2 w-full"):
            self.table = ui.select([], label="table of the folder (.csv, .txt)", with_input=True)
            self.table.props("outlined dense").classes("grow")
            for label, kind in TABLE_ACTIONS.items():
                action(label, lambda kind=kind: self._add_chosen_table(kind))
        ui.label(
            "A load-cell table has columns of time (s) and friction. The positions of thermocouples are in the text."
        ).classes("ft-muted ft-small")
        with ui.row().classes("items-center gap-2 w-full"):
            self.view = ui.select(list(VIEW_GEOMETRY), value=next(iter(VIEW_GEOMETRY)), label="planned view")
            self.view.props("outlined dense").classes("w-40")
            action("Add planned view", lambda: self._add_entry("recording", {"view": self.view.value}))
            ui.label("Only Plan uses it: a view before it is measured.").classes("ft-muted ft-small")

    async def _add_chosen_table(self, kind: str) -> None:
        """Add the chosen table, unless it is a camera image."""
        if not self.table.value:
            ui.notify("choose a table of the folder first")
            return
        file = self.document.folder / self.table.value
        found = await run.io_bound(recognise_file, file, self.store)
        if found is not None and found.kind in CAMERA_PAGE_KINDS:
            ui.notify(f"{escape_control(str(found))}; open it on the camera page", type="warning")
        else:
            self._add_table(kind, Path(self.table.value))

    def _add_table(self, kind: str, path: Path) -> None:
        """Add a table, by its path in the folder, as the trace of a load cell or as thermocouples."""
        entry: Table = {"file": self.document.relative_name(path)}
        if kind == "recording":
            entry |= {"view": "points", "points": SENSOR_EXAMPLE}
            ui.notify("Set the positions of the sensors in the text.")
        self._add_entry(kind, entry)

    def _add_entry(self, kind: str, entry: Table) -> None:
        self.document.apply_edit(lambda text: add_entry(text, kind, entry))

    def _files_stored(self, recordings: Sequence[Path]) -> None:
        """Offer the files that have been dropped, and add the recordings."""
        self.shown = None
        self.update_offers()
        if missing := [path for path in self.list_missing() if path in recordings]:
            self._add_recordings(missing)
        self.stored()
