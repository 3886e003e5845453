"""The camera page: view frames, measure, mark the block, enter missing information, save recording and template."""

from __future__ import annotations

import os
import re
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from nicegui import background_tasks, run, ui

from flashtemp.api.camera import import_recording
from flashtemp.camera.importing.formats.raw_frames import ScaleMissing
from flashtemp.camera.importing.import_options import ImportOptions, load_template
from flashtemp.camera.importing.import_request import ImportRequest
from flashtemp.camera.importing.recording_import import ImportResult, missing_options
from flashtemp.errors import BadInput
from flashtemp.lab.camera_files import (
    UploadArea,
    find_camera_files,
    find_time_tables,
    show_example_button,
    show_file_cards,
)
from flashtemp.lab.charts import chart_options, line_series, show_chart
from flashtemp.lab.frame_server import FrameServer
from flashtemp.lab.import_form import ImportForm
from flashtemp.lab.jobs import command_text
from flashtemp.lab.marked_image import MarkedImage
from flashtemp.lab.measurement_panel import MeasurementPanel
from flashtemp.lab.opened_frames import OpenedFrames
from flashtemp.lab.page_layout import (
    action,
    add_script,
    ask_consent,
    card,
    empty_state,
    escape_lines,
    file_address,
    page_address,
    refuse_damaged,
    relative_names,
    show_command,
    show_errors,
)
from flashtemp.lab.saving import TextVersion, read_text, write_text
from flashtemp.lab.thermal_viewer import ThermalViewer, add_viewer_style
from flashtemp.lab.workspace import escape_control, free_name, list_folder, resolve_inside

TOGGLE_EXPANDED = """(event) => {
    const button = event.currentTarget;
    button.setAttribute("aria-expanded", String(button.getAttribute("aria-expanded") !== "true"));
}"""
USUAL_SCALE, USUAL_OFFSET_DEGC = 0.04, -273.15
HOW_TO_SCALE = (
    "The temperature is scale times count plus offset.  The camera's program states both; usual scales are 0.01, 0.04, "
    "0.1 and 0.4 °C."
)
MAX_LISTED_PIXELS = 200  # bad pixels that are listed with their places
CAMERA_QUESTION = (
    "The frames of an infrared camera, as the camera or its program saved them: one file, a series whose names differ "
    "in numbers, or a folder.  You see them here, measure in them, mark the block and save them as a recording."
)


class CameraPage:
    """Import of camera files into a recording: marks and entered values, and the equivalent command line."""

    def __init__(self, folder: Path, server: FrameServer | None = None):
        self.folder, self.server = folder, server or FrameServer()
        self.names: list[str] = []
        self.n_read = 0  # frames that have been read, while files are opened
        self.compared = ""  # address of the frames beside the first
        self.inherited = ImportOptions()
        self.saved: dict[Path, TextVersion] = {}  # recordings written by this page: their templates
        self.is_checking = self.is_checked = False

    async def show(self, name: str, template: str) -> None:
        """Show a camera file, a folder of camera files, or the files of a recording template."""
        add_viewer_style()
        add_script("charts.js")  # scripts are not run in a page that has been sent
        if not name and not template:
            await self._show_choice()
            return
        self._show_header(name)
        self.body = ui.column().classes("w-full gap-4 items-stretch")
        with self.body:
            waiting = self._show_reading()
        await ui.context.client.connected()
        opened: OpenedFrames | None = None
        with self.body, show_errors(self.folder):
            if template:
                read_text(self.folder, template)  # checks that it is a short regular file before it is parsed
                names, _, self.inherited = load_template(resolve_inside(self.folder, template))
                self.names = [name] if name else [str(Path(template).parent / n) for n in names]
            else:
                self.names = [name]
            try:
                opened = await self._open(self.names)
            except ScaleMissing:
                self._ask_scale()
                raise
            finally:
                waiting.delete()
        if opened is not None:
            with self.body:
                self._build_page(opened)

    async def _open(self, names: list[str]) -> OpenedFrames | None:
        """Read the frames of files outside the event loop.  Raises BadInput."""
        files = find_camera_files(self.folder, names)
        self.n_read = 0

        def count(number: int) -> None:
            self.n_read += number

        def read() -> OpenedFrames:
            with refuse_damaged(files[0]):
                return self.server.read(files, self.inherited, count)

        return await run.io_bound(read)

    def _show_reading(self) -> Any:
        """A spinner with the number of frames that have been read."""
        with ui.row().classes("items-center gap-3").props("role=status") as waiting:
            ui.spinner(size="lg")
            words = ui.label("Reading the frames ...").classes("ft-muted")
            ui.timer(0.5, lambda: words.set_text(f"Reading the frames: {self.n_read} so far"))
        return waiting

    def _find_files(self) -> list[Path]:
        return find_camera_files(self.folder, self.names)

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
            if name and like:
                self.like = ui.select(
                    like, label="use marks of template", on_change=lambda: self._open_with_template(name)
                ).props("outlined dense clearable")  # fmt: skip
            choices = [choice for choice in self._file_choices("") if choice != name]
            if choices:
                self.other = ui.select(choices, label="compare with", with_input=True, on_change=self._compare).props(
                    "outlined dense clearable"
                )
            more = action("Add files", self._toggle_zone, icon="upload_file")
            more.classes("justify-self-start").props["aria-expanded"] = "false"
            more.on("click", js_handler=TOGGLE_EXPANDED)
        with ui.element("div").classes("w-full") as self.zone:
            UploadArea(self.folder).show()
        self.zone.set_visibility(False)

    def _toggle_zone(self) -> None:
        self.zone.set_visibility(not self.zone.visible)

    def _add_choice(self, name: str) -> None:
        choices = self._file_choices(name)
        self.choice = ui.select(choices, value=name or None, label="camera files", with_input=True)
        self.choice.props("outlined dense").classes("w-full").set_visibility(bool(choices))
        self.choice.on_value_change(lambda: ui.navigate.to(page_address("camera", open=self.choice.value)))

    def _file_choices(self, name: str) -> list[str]:
        listing = list_folder(self.folder)
        names = [*map(str, listing.image_series), *map(str, listing.images), *map(str, listing.recordings)]
        return list(dict.fromkeys([*([name] if name else []), *names]))

    def _open_with_template(self, name: str) -> None:
        """Open the same files with the marks and values of a template."""
        if self.like.value:
            ui.navigate.to(page_address("camera", open=name, template=self.like.value))

    def _ask_scale(self, scale: float = USUAL_SCALE, offset: float = USUAL_OFFSET_DEGC) -> None:
        """Ask for the scale of counts, which some files do not state, and open the files with it."""
        with card("Scale of the counts", HOW_TO_SCALE):
            with ui.row().classes("gap-3"):
                entered = [
                    ui.number(label, value=value).props("outlined dense")
                    for label, value in (("scale, °C per count", scale), ("offset, °C of count 0", offset))
                ]
            action("Open with this scale", lambda: self._open_scaled(*(box.value for box in entered)), main=True)

    async def _open_scaled(self, scale: float | None, offset: float | None) -> None:
        """Open the files with a scale, and ask again where it gives no possible temperatures."""
        if scale is None or offset is None:
            ui.notify("enter scale and offset", type="negative")
            return
        self.inherited = replace(self.inherited, scale=float(scale), offset=float(offset))
        opened = None
        self.body.clear()
        with self.body, show_errors(self.folder):
            try:
                opened = await self._open(self.names)
            except BadInput:
                self._ask_scale(scale, offset)
                raise
        if opened is not None:
            with self.body:
                self._build_page(opened)

    async def _compare(self) -> None:
        """Show a second set of frames beside the first, with its range, zoom, frame and cursor."""
        self.beside.clear()
        self.pair.classes(remove="tv-pair")
        self.marked.viewer.set_title("")
        self.server.withdraw(self.compared)
        name = self.other.value
        if not name:
            return
        with self.beside:
            waiting = self._show_reading()
        with self.beside, show_errors(self.folder):
            opened = await self._open([name])
            if opened is not None:
                self.pair.classes("tv-pair")
                self.compared = self._share(opened)
                self.marked.viewer.set_title(escape_control(", ".join(self.names)))
                ThermalViewer(opened, self.compared, escape_control(name), compact=True)
        waiting.delete()

    def _share(self, opened: OpenedFrames) -> str:
        """The address of the frames, served until this page is closed."""
        address = self.server.share(opened)
        ui.context.client.on_delete(lambda: self.server.withdraw(address))
        return address

    # --- images and charts ---------------------------------------------------------------------------------
    def _build_page(self, opened: OpenedFrames) -> None:
        self.opened, self.frame = opened, 0
        self.marked = MarkedImage(opened, self._share(opened), self.inherited, self._values_changed)
        self.form = ImportForm(opened, self.inherited, self._values_changed, find_time_tables(self.folder))
        with ui.element("div").classes("ft-split side"):
            with ui.column().classes("min-w-0 gap-4 w-full items-stretch"):
                with card(), ui.element("div").classes("w-full") as self.pair:
                    self.marked.show()
                    self.beside = ui.element("div").classes("w-full min-w-0")
                self.panel = MeasurementPanel(self.marked.viewer, opened, self.marked.find_map)
                self.panel.show()
                self._add_charts()
                self._add_facts()
            with ui.column().classes("min-w-0 gap-4 w-full items-stretch"):
                self.marked.show_controls()
                self.form.show()
                self._add_output()
        self.report = ui.column().classes("w-full")
        self.marked.viewer.on_frame(self.panel.show_frame)
        self.form.on_starts = self._draw_starts
        self.marked.draw_marks()
        self._draw_starts()
        self._values_changed()
        ui.timer(0.1, self._screen, once=True)

    def _add_charts(self) -> None:
        """Mean of the image over time, in which starts of sliding are clicked, and the histogram."""
        look = self.opened.preview
        self.mean_chart = None
        if len(self.opened.time) > 1:
            with card("Mean of the image", "Click a start of sliding to add it; click it again to remove it."):
                line = line_series("mean", self.opened.time, self.opened.mean, showSymbol=True, symbolSize=7)
                words = "time after the first frame, s" if self.opened.has_times else "frame"
                self.mean_chart = show_chart(
                    chart_options([line], words, f"mean, {self.opened.unit}"), "mean_of_image",
                    "mean temperature of the image over time",
                    on_point_click=lambda e: self.form.toggle_start(float(e.data[0])),
                )  # fmt: skip
        with card(), ui.expansion("Histogram of all values").classes("w-full"):
            middle = 0.5 * (look.edges[1:] + look.edges[:-1])
            counts = np.where(look.counts > 0, look.counts, np.nan)
            bars = line_series("values", middle, counts, step="middle", areaStyle={"opacity": 0.3})
            options = chart_options([bars], f"temperature, {self.opened.unit}", "number of values")
            options["yAxis"] |= {"type": "log", "scale": False}
            show_chart(options, "histogram", "number of values by temperature")

    def _add_facts(self) -> None:
        """What the files say of themselves, and the defects of the camera."""
        with card("Files"):
            with ui.element("table").classes("ft-table"):
                for key, words in self.opened.preview.describe_rows():
                    with ui.element("tr"):
                        with ui.element("th").props("scope=row"):
                            ui.label(key)
                        with ui.element("td"):
                            ui.label(escape_control(words)).classes("break-words")
            self.defects = ui.column().classes("w-full gap-1")
            with self.defects:
                ui.label("Searching for bad pixels and shutter events ...").classes("ft-muted")

    async def _screen(self) -> None:
        """Search defects of the camera outside the event loop, then mark and list them."""
        with self.defects, show_errors(self.folder):
            with refuse_damaged(self.opened.files[0]):
                screened = await run.io_bound(self.opened.with_screening)
                legend = await run.io_bound(lambda: self.opened.legend)
            if screened is None or screened.screened is None:
                return
            self.server.replace(self.marked.address, screened)
            self.marked.viewer.show_screening(screened)
            self.defects.clear()
            found = screened.screened
            ui.label(f"Found: {found.summary}.")
            if legend:
                ui.label(legend).classes("ft-muted ft-small")
            self._list_defects(screened)

    def _list_defects(self, screened: OpenedFrames) -> None:
        found = screened.screened
        assert found is not None
        for words, frames in (("Shutter events", found.shutter), ("Frozen frames", found.frozen)):
            if frames:
                ui.label(f"{words}: {', '.join(screened.frame_name(k) for k in frames[:MAX_LISTED_PIXELS])}")
        if found.classes.any():
            with ui.expansion("List of bad pixels").classes("w-full"), ui.element("table").classes("ft-table"):
                with ui.element("tr"):
                    for words in ("column", "row", "defect"):
                        with ui.element("th").props("scope=col"):
                            ui.label(words)
                for row in found.list_pixels(MAX_LISTED_PIXELS):
                    with ui.element("tr"):
                        for value in row:
                            with ui.element("td"):
                                ui.label(str(value))

    def _draw_starts(self) -> None:
        """Draw the starts of sliding in the curve of the mean."""
        if self.mean_chart is None:
            return
        lines = [{"xAxis": t * self.form.frame_rate} for t in self.form.starts]
        style = {"color": "var(--series-2)", "type": "dashed", "width": 2}
        mark = {"symbol": "none", "data": lines, "label": {"show": False}, "lineStyle": style, "silent": True}
        self.mean_chart.options["series"][0]["markLine"] = mark
        self.mean_chart.update()

    # --- output ---------------------------------------------------------------------------------------------------
    def _add_output(self) -> None:
        """The name of the recording, its command line, and the button that saves it."""
        with card("Recording"):
            self.out = ui.input("recording", value=self._free_recording_name(), on_change=self._show_command)
            self.out.classes("w-full").props("outlined dense hint='a new NetCDF file (.nc) of this folder'")
            action("Save recording and template", self._save, icon="save", main=True).classes("w-full")
            self.line = ui.column().classes("w-full")

    def _free_recording_name(self) -> str:
        """A name for the recording for which no recording, picture or template exists."""
        name = Path(self.names[0])
        stem = re.sub(r"\[0-9\]|[*?\[\]]", "", name.stem if name.suffix else name.name).strip(" ()_-.") or "recording"
        free, n = free_name(self.folder, f"{stem}.nc"), 1
        while any(os.path.lexists((self.folder / free).with_suffix(end)) for end in (".png", ".toml")):
            n += 1
            free = free_name(self.folder, f"{stem}-{n}.nc")
        return free

    def _values_changed(self) -> None:
        """Show command line, scale of profiles, and what is missing, after a mark or a value has changed."""
        self._show_command()
        self.panel.update_scale()
        self.is_checked = False
        if not self.is_checking:
            background_tasks.create(self._check_missing())

    async def _check_missing(self) -> None:
        """List what is missing, outside the event loop, because the first file is read."""
        self.is_checking = True
        try:
            while not self.is_checked:  # values may change while the files are read
                self.is_checked = True
                files, options = self._find_files(), self.collect_options()
                lines = await run.io_bound(_list_missing, files, options)
                self.form.show_missing(lines or ())
        except (BadInput, OSError):
            pass  # said when the recording is saved
        finally:
            self.is_checking = False

    # --- options and command ----------------------------------------------------------------------------------------
    def collect_options(self) -> ImportOptions:
        """The import options from marks and entered values."""
        marks = self.marked.marks
        unplaced = replace(self.inherited, point=None, pixel=None, second=None, at=None, mm_per_pixel=None)
        stated = self.form.stated_options((marks.length, marks.height))
        facts = marks.to_options().merged_over(stated.merged_over(unplaced))
        return facts if facts.starts or facts.case or facts.repetition else replace(facts, repetition=1)

    def template_text(self) -> str:
        """The equivalent recording template as TOML."""
        template_folder = (self.folder / self.out.value).parent
        rows: dict[str, Any] = {
            "files": [_relative_path(self.folder / n, template_folder) for n in self.names],
            "out": Path(self.out.value).name,
        }
        for f in fields(ImportOptions):
            if (value := getattr(self.collect_options(), f.name)) is not None:
                rows[f.name] = (
                    _relative_path(value, template_folder.resolve())
                    if isinstance(value, Path)
                    else _tuples_to_lists(value)
                )
        return tomli_w.dumps(rows)

    def _show_command(self) -> None:
        """Show the equivalent command line."""
        self.line.clear()
        with self.line:
            show_command(command_text(["import", str(Path(self.out.value or "recording.nc").with_suffix(".toml"))]))

    async def _save(self) -> None:
        """Write template and recording, by the same code as the command line."""
        self.report.clear()
        with self.report, show_errors(self.folder):
            out, template = self._claim_names()
            existing = [p.name for p in (out, out.with_suffix(".png"), template) if p.exists()]
            if out not in self.saved and existing:
                lines = ["These files exist and were not written by this page:", *map(escape_control, existing)]
                if not await ask_consent(lines, "Replace them"):
                    return
            name, last = str(template.relative_to(self.folder.resolve())), self.saved.get(out)
            self.saved[out] = write_text(self.folder, name, self.template_text(), last, replace=True)
            if (result := await run.io_bound(lambda: _import_template(template))) is not None:
                self._show_saved(result)
        self._scroll_to_report()

    def _claim_names(self) -> tuple[Path, Path]:
        """Paths of recording and template; neither they nor the picture may replace a camera file.  Raises BadInput."""
        name = self.out.value or ""
        out = resolve_inside(self.folder, name)
        if out.suffix != ".nc":
            raise BadInput(f"{escape_control(name)}: recordings are NetCDF files; give a name that ends in .nc")
        home, sources = self.folder.resolve(), [file.resolve() for file in self._find_files()]
        template, picture = (
            resolve_inside(self.folder, str(out.with_suffix(end).relative_to(home))) for end in (".toml", ".png")
        )
        if overwritten := next((p for p in (out, picture) if p in sources), None):
            raise BadInput(f"{overwritten.name}: is a camera file of this recording; give the recording another name")
        return out, template

    def _show_saved(self, result: ImportResult) -> None:
        """Show the saved recording with its picture, and where to go from there."""
        with card("Saved", "Is the outline on the block?  If not, correct the marks and save again."):
            self._show_result(result)
            with ui.row().classes("gap-2"):
                action("Other camera files", lambda: ui.navigate.to("/camera"))
                action("To the campaigns", lambda: ui.navigate.to("/campaign"), icon="arrow_forward")

    def _show_result(self, result: ImportResult) -> None:
        text = escape_lines(relative_names(str(result), self.folder))
        ui.label(text).classes("whitespace-pre-wrap font-mono text-sm")
        for note in result.notes:
            ui.label(escape_control(relative_names(note, self.folder))).classes("text-xs")
        if result.picture is not None:
            ui.image(file_address(result.picture.relative_to(self.folder))).classes("w-full max-w-4xl")

    def _scroll_to_report(self) -> None:
        """Scroll to the report of a save, which is at the bottom of the page."""
        ui.run_javascript(f"getHtmlElement({self.report.id}).scrollIntoView({{block: 'nearest'}})")


def _import_template(template: Path) -> ImportResult:
    return import_recording(ImportRequest.from_files([str(template)], ImportOptions()), overwrite=True)


def _list_missing(files: list[Path], options: ImportOptions) -> tuple[str, ...]:
    """What the import of the files lacks, a line each; faults of the values in their own words."""
    try:
        with refuse_damaged(files[0]):
            return missing_options(files, options)
    except BadInput as fault:
        return fault.lines


def _relative_path(path: Path, folder: Path) -> str:
    """A path relative to `folder` if it is inside, else unchanged."""
    return str(path.relative_to(folder)) if path.is_relative_to(folder) else str(path)


def _tuples_to_lists(value: Any) -> Any:
    """Tuples as lists, which TOML can write."""
    return [_tuples_to_lists(v) for v in value] if isinstance(value, tuple) else value
