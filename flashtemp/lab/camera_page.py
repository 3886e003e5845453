"""The camera page: choose and read camera files, then import them or, if they are a recording, view it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from nicegui import ui

from flashtemp.camera.importing.import_options import ImportOptions, load_template
from flashtemp.errors import BadInput
from flashtemp.lab.camera_files import (
    UploadArea,
    check_stated_files,
    describe_place,
    find_camera_files,
    find_templates_of,
    show_example_button,
    show_file_cards,
)
from flashtemp.lab.frame_reading import FrameReading
from flashtemp.lab.frame_server import FrameServer
from flashtemp.lab.import_part import ImportPart
from flashtemp.lab.opened_frames import OpenedFrames
from flashtemp.lab.page_fields import show_file_errors
from flashtemp.lab.page_layout import action, add_script, card, empty_state, page_address
from flashtemp.lab.reader_form import show_reader_form
from flashtemp.lab.recording_part import RecordingPart
from flashtemp.lab.saving import read_text
from flashtemp.lab.thermal_viewer import ThermalViewer, add_viewer_style
from flashtemp.lab.workspace import escape_control, list_folder, resolve_inside

TOGGLE_EXPANDED = """(event) => {
    const button = event.currentTarget;
    button.setAttribute("aria-expanded", String(button.getAttribute("aria-expanded") !== "true"));
}"""
CAMERA_QUESTION = (
    "The frames of an infrared camera, as the camera or its program saved them: one file, a series whose names differ "
    "in numbers, or a folder.  You see them here, measure in them, mark the block and save them as a recording."
)


class CameraPage:
    """The choice of camera files and of frames to compare them with; a part shows what has been opened."""

    def __init__(self, folder: Path, server: FrameServer | None = None):
        self.folder, self.server = folder, server or FrameServer()
        self.names: list[str] = []
        self.address: dict[str, str] = {}  # of this page: what is opened
        self.version = ""  # of the template
        self.out_name = ""  # of the recording that the template makes
        self.viewer: ThermalViewer | None = None
        self.other: Any = None  # choice of frames to compare with
        self.compared = ""  # address of the frames beside the first
        self.inherited = ImportOptions()

    async def show(self, name: str, template: str, beside: str = "") -> None:
        """Show a camera file, a folder of camera files, or the files of a recording template, with others beside."""
        add_viewer_style()
        add_script("charts.js")  # scripts are not run in a page that has been sent
        if not name and not template:
            await self._show_choice()
            return
        self.address = {key: value for key, value in (("open", name), ("template", template)) if value}
        self._show_header(name)
        self.body = ui.column().classes("w-full gap-4 items-stretch")
        await ui.context.client.connected()
        with self.body, show_file_errors(self.folder):
            if template:
                self._load_template(template)
            self.names = [name] if name else self.names
            await self._open_with(self.inherited)
            if self.viewer is not None and self.other is not None and beside in self.other.options:
                self.other.value = beside

    async def _open_with(self, facts: ImportOptions) -> None:
        """Open the files with what a template or the user states; ask for what their reader needs besides."""
        self.inherited = facts
        self.body.clear()
        with self.body, show_file_errors(self.folder):
            try:
                opened = await self._open(self.names)
            except BadInput as fault:
                show_reader_form(str(fault), facts, self._open_with)
                raise
            if opened is not None:
                self._show_opened(opened)

    def _load_template(self, template: str) -> None:
        """Take files, marks and values of a template.  Raises BadInput."""
        _, version = read_text(self.folder, template)  # checks that it is a short regular file before it is parsed
        path = resolve_inside(self.folder, template)
        names, out, facts = load_template(path)
        check_stated_files(self.folder, facts)
        self.inherited = facts
        place = Path(template).parent
        self.names, self.version = [str(place / n) for n in names], version.digest
        made = Path(out or path.with_suffix(".nc")).resolve()
        if "open" not in self.address and made.is_relative_to(self.folder.resolve()):
            self.out_name = made.relative_to(self.folder.resolve()).as_posix()  # what the template makes

    async def _open(self, names: list[str], on_cancel: Any = None) -> OpenedFrames | None:
        """Read the frames of files outside the event loop; None where the user cancels it.  Raises BadInput."""
        leave = on_cancel or (lambda: ui.navigate.to("/camera"))
        return await FrameReading(self.server, find_camera_files(self.folder, names), self.inherited, leave).read()

    def _show_opened(self, opened: OpenedFrames) -> None:
        """Show a recording, or camera files with what makes a recording of them."""
        address, key = self._share(opened), f"{self.folder}:{self.names}:{self.version}"
        part: ImportPart | RecordingPart
        if opened.recording is not None:
            part = RecordingPart(self.folder, self.server, self.names[0], opened)
        else:
            part = ImportPart(self.folder, self.server, self.names, opened, self.inherited, self.out_name)
        self.pair = part.show(address, key)
        self.viewer = part.viewer
        if self.other is not None:
            self.other.set_visibility(self.pair is not None)
        if self.pair is not None:
            with self.pair:
                self.beside = ui.element("div").classes("w-full min-w-0")

    # --- choice of files ------------------------------------------------------------------------------------------
    async def _show_choice(self) -> None:
        """Show what belongs on the page: drop zone, the camera files of the folder, an example."""
        with empty_state("Open camera files", CAMERA_QUESTION):
            show_example_button(self.folder)
        UploadArea(self.folder).show()
        self._add_choice("")
        cards = ui.column().classes("w-full gap-3 items-stretch")
        await ui.context.client.connected()
        with cards:
            await show_file_cards(self.folder)

    def _show_header(self, name: str) -> None:
        """Show the choice of files, of a template, and of files to compare; below, the folded drop zone."""
        with card(), ui.element("div").classes("ft-grid items-center"):
            self._add_choice(name)
            like = [str(p) for p in list_folder(self.folder).templates]
            if name and like and not name.endswith(".nc"):  # a recording is marked already
                self.like = ui.select(
                    like, label="use marks of template", on_change=lambda: self._open_with_template(name)
                ).props("outlined dense clearable")  # fmt: skip
            choices = {choice: describe_place(choice) for choice in self._file_choices("") if choice != name}
            if choices:
                self.other = ui.select(choices, label="compare with", with_input=True, on_change=self._compare).props(
                    "outlined dense clearable"
                )
            more = action("Add files", self._toggle_zone, icon="upload_file")
            more.classes("justify-self-start").props["aria-expanded"] = "false"
            more.on("click", js_handler=TOGGLE_EXPANDED)
        if "template" not in self.address and name and not name.endswith(".nc"):
            for template in find_templates_of(self.folder, name, like):
                with card(), ui.row().classes("items-center gap-3"):
                    ui.label(f"{escape_control(template)} has marks and values for these files.")
                    target = page_address("camera", open=name, template=template)
                    action("Use them", lambda target=target: ui.navigate.to(target), "edit_location")
        with ui.element("div").classes("w-full") as self.zone:
            UploadArea(self.folder).show()
        self.zone.set_visibility(False)

    def _toggle_zone(self) -> None:
        self.zone.set_visibility(not self.zone.visible)

    def _add_choice(self, name: str) -> None:
        choices = {choice: describe_place(choice) for choice in self._file_choices(name)}
        self.choice = ui.select(choices, value=name or None, label="camera files", with_input=True)
        self.choice.props("outlined dense").classes("w-full").set_visibility(bool(choices))
        self.choice.on_value_change(lambda: ui.navigate.to(page_address("camera", open=self.choice.value)))

    def _file_choices(self, name: str) -> list[str]:
        listing = list_folder(self.folder)
        names = [*map(str, listing.image_series), *map(str, listing.recordings), *map(str, listing.images)]
        return list(dict.fromkeys([*([name] if name else []), *names]))

    def _open_with_template(self, name: str) -> None:
        """Open the same files with the marks and values of a template."""
        if self.like.value:
            ui.navigate.to(page_address("camera", open=name, template=self.like.value))

    async def _compare(self) -> None:
        """Show a second set of frames beside the first, with its range, zoom, frame and cursor."""
        name = self.other.value
        more = {"beside": name} if name else {}
        ui.navigate.history.replace(page_address("camera", **self.address, **more))
        if self.viewer is None:  # files that cannot be read, or sensors
            return
        self.beside.clear()
        self.pair.classes(remove="tv-pair")
        self.viewer.set_title("")
        self.server.withdraw(self.compared)
        if not name:
            return
        with self.beside, show_file_errors(self.folder):
            opened = await self._open([name], lambda: self.other.set_value(None))
            if opened is not None and self.other.value == name:
                self.pair.classes("tv-pair")
                self.compared = self._share(opened)
                self.viewer.set_title(escape_control(", ".join(self.names)))
                ThermalViewer(opened, self.compared, escape_control(name), compact=True)

    def _share(self, opened: OpenedFrames) -> str:
        """The address of the frames, served until this page is closed."""
        address = self.server.share(opened)
        ui.context.client.on_delete(lambda: self.server.withdraw(address))
        return address
