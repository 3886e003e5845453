"""The zone of the campaign page in which files are dropped: each is stored, recognised, and led to where it belongs."""

from __future__ import annotations

import asyncio
import filecmp
from collections.abc import AsyncIterator, Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, Protocol

from nicegui import events, ui

from flashtemp.lab.file_recognition import (
    CAMERA,
    FRAME_TIMES,
    LOAD_CELL,
    RECORDING,
    TABLE,
    THERMOCOUPLES,
    RecognisedFile,
    recognise_file,
)
from flashtemp.lab.page_layout import PAGE_TITLES, action, chip, page_address, show_errors
from flashtemp.lab.recording_store import RecordingStore
from flashtemp.lab.saving import (
    MAX_UPLOAD_BYTES,
    MAX_UPLOAD_FILES,
    MEASUREMENT_SUFFIXES,
    UPLOAD_LIMIT,
    check_upload_name,
    write_upload,
)
from flashtemp.lab.workspace import CAMERA_SUFFIXES, escape_control, free_name
from flashtemp.model.file_kinds import CAMPAIGN_KIND, CASE_KIND, TEMPLATE_KIND

DROPPED_SUFFIXES: Final = frozenset({*MEASUREMENT_SUFFIXES, *CAMERA_SUFFIXES, ".toml"})
CAMERA_PAGE_KINDS: Final = (CAMERA, FRAME_TIMES)
TABLE_ACTIONS: Final = {"Add as load cell": "force", "Add as thermocouples": "recording"}  # label: kind of the entry
TABLE_ACTIONS_OF_KIND: Final = {
    LOAD_CELL: ("Add as load cell",), THERMOCOUPLES: ("Add as thermocouples",), TABLE: tuple(TABLE_ACTIONS),
}  # fmt: skip
TOML_PAGES: Final = {  # kind of a TOML file: page and key of the address that open it
    TEMPLATE_KIND: ("camera", "template"), CASE_KIND: ("case", "open"), CAMPAIGN_KIND: ("campaign", "open"),
}  # fmt: skip
CAMERA_FOLDER: Final = "camera"  # of several camera files dropped at once


class UploadedFile(Protocol):
    """A file that the browser sends."""

    name: str

    def iterate(self) -> AsyncIterator[bytes]: ...


class MeasurementDrop:
    """The zone; `add_table` is called with kind of entry and path of a table, `stored` with the recordings dropped."""

    def __init__(
        self,
        folder: Path,
        store: RecordingStore,
        add_table: Callable[[str, Path], Any],
        stored: Callable[[Sequence[Path]], Any],
    ):
        self.folder, self.store, self.add_table, self.stored = folder, store, add_table, stored

    def show(self) -> None:
        """Show the zone."""
        drop = ui.upload(
            multiple=True, auto_upload=True,
            on_multi_upload=self._store_files, max_total_size=MAX_UPLOAD_BYTES, max_files=MAX_UPLOAD_FILES,
        ).on_rejected(_notify_rejected)  # fmt: skip
        drop.classes("ft-drop-bare w-full").props("flat bordered")
        with drop.add_slot("list"), ui.row().classes("items-center gap-3"):
            ui.label("Drop recordings, tables or camera files here, or").classes("ft-muted")
            choose = ui.button("Choose files", icon="upload_file").props("outline no-caps")
            # in the browser itself: it opens a file dialog only during a click
            choose.on("click", js_handler=f"() => getElement({drop.id}).pickFiles()")
        drop.props["accept"] = ",".join(sorted(DROPPED_SUFFIXES))
        ui.label(
            "Each file is named as what it was recognised. Recordings (.nc) are added to the campaign; camera files, "
            "also as CSV, and templates lead to the camera page."
        ).classes("ft-muted ft-small")
        self.dropped = ui.column().classes("w-full gap-1 ft-optional").props("aria-live=polite")

    async def _store_files(self, event: events.MultiUploadEventArguments) -> None:
        """Store dropped files, say what each is, and add the recordings."""
        self.dropped.clear()
        with self.dropped, show_errors(self.folder):
            found = await store_measurements(self.folder, event.files, self.store)
            self._show_dropped(found)
            self.stored([file.path.relative_to(self.folder) for file in found if file.kind == RECORDING])

    def _show_dropped(self, found: Sequence[RecognisedFile]) -> None:
        """What each dropped file is, with what can be done with it."""
        for file in found:
            path, labels = file.path.relative_to(self.folder), TABLE_ACTIONS_OF_KIND.get(file.kind, ())
            with ui.element("div").classes("ft-offer w-full"):
                ui.label(escape_control(str(file))).classes("ft-small break-words grow")
                if file.kind == RECORDING:
                    chip("in the campaign", "good")
                for label in labels:
                    action(label, lambda kind=TABLE_ACTIONS[label], path=path: self.add_table(kind, path))
                if file.kind in TOML_PAGES:
                    page, key = TOML_PAGES[file.kind]
                    ui.link(f"Open on the page {PAGE_TITLES[page]}", page_address(page, **{key: path}))
        if images := [file.path.relative_to(self.folder) for file in found if file.kind == CAMERA]:
            place = images[0] if len(images) == 1 else images[0].parent
            action("Open them on the camera page", lambda: ui.navigate.to(page_address("camera", open=place)))
        elif any(file.kind == FRAME_TIMES for file in found):
            ui.link("The camera page uses them", page_address("camera"))


async def store_measurements(
    folder: Path, files: Sequence[UploadedFile], store: RecordingStore
) -> list[RecognisedFile]:
    """Store dropped files under new names in the folder, and say what each is.  Raises BadInput.

    Several camera files, and tables of their times, stay in a new folder, since they are one series.
    """
    names = [check_upload_name(file.name, DROPPED_SUFFIXES) for file in files]
    place = folder / free_name(folder, CAMERA_FOLDER)
    place.mkdir()
    try:
        for name, file in zip(names, files, strict=True):
            await write_upload(place, free_name(place, name), file.iterate(), DROPPED_SUFFIXES)
        return await asyncio.to_thread(_sort_files, folder, place, store)
    finally:
        if not any(place.iterdir()):
            place.rmdir()


def _sort_files(folder: Path, place: Path, store: RecordingStore) -> list[RecognisedFile]:
    """Recognise all files of a new folder; those that are no series of a camera move to the folder above.

    A file that the folder above has already, with the same name and content, is not stored again.
    """
    found = [recognise_file(path, store) for path in sorted(place.iterdir())]
    is_series = sum(file.kind in CAMERA_PAGE_KINDS for file in found) > 1
    for k, file in enumerate(found):
        if not (is_series and file.kind in CAMERA_PAGE_KINDS):
            target = folder / file.path.name
            if target.is_file() and filecmp.cmp(file.path, target, shallow=False):
                file.path.unlink()
            else:
                target = folder / free_name(folder, file.path.name)
                file.path.rename(target)
            found[k] = replace(file, path=target)
    return found


def _notify_rejected() -> None:
    accepted = " ".join(sorted(DROPPED_SUFFIXES))
    ui.notify(f"these files are not accepted, or too large ({UPLOAD_LIMIT}): {accepted}", type="negative")
