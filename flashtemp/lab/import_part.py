"""The import of camera files: mark the block, enter missing information, save recording and template."""

from __future__ import annotations

import os
import re
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import tomli_w
from nicegui import background_tasks, run, ui

from flashtemp.api.camera import import_recording
from flashtemp.camera.importing.import_options import ImportOptions
from flashtemp.camera.importing.import_request import ImportRequest
from flashtemp.camera.importing.recording_import import ImportResult, missing_options
from flashtemp.errors import BadInput
from flashtemp.lab.camera_files import find_camera_files, find_time_tables
from flashtemp.lab.frame_cards import DefectList, show_histogram, show_mean
from flashtemp.lab.frame_server import FrameServer
from flashtemp.lab.import_form import ImportForm
from flashtemp.lab.jobs import command_text
from flashtemp.lab.marked_image import MarkedImage
from flashtemp.lab.measurement_panel import MeasurementPanel
from flashtemp.lab.opened_frames import OpenedFrames
from flashtemp.lab.page_fields import name_page_fields, show_file_errors
from flashtemp.lab.page_layout import (
    action,
    ask_consent,
    card,
    escape_lines,
    file_address,
    page_address,
    refuse_damaged,
    relative_names,
    show_command,
)
from flashtemp.lab.saving import TextVersion, write_text
from flashtemp.lab.thermal_viewer import ThermalViewer
from flashtemp.lab.workspace import escape_control, free_name, resolve_inside


class ImportPart:
    """The part of the camera page that makes a recording of opened camera files `names`.

    `inherited` are the marks and values of a template, whose recording has the name `out`.
    """

    def __init__(
        self, folder: Path, server: FrameServer, names: list[str], opened: OpenedFrames, inherited: ImportOptions,
        out: str = "",
    ):  # fmt: skip
        self.folder, self.server, self.names, self.opened, self.inherited = folder, server, names, opened, inherited
        self.out_name = out or free_recording_name(folder, names[0])
        self.saved: dict[Path, TextVersion] = {}  # recordings written by this page: their templates
        self.is_checking = self.is_checked = False

    def show(self, address: str, storage_key: str) -> Any:
        """Show image, measurements, marks and form; returns the element for frames to compare with."""
        self.marked = MarkedImage(self.opened, address, self.inherited, self._values_changed)
        self.form = ImportForm(self.opened, self.inherited, self._values_changed, find_time_tables(self.folder))
        self.mean_chart = None
        with ui.element("div").classes("ft-split side tv-part"):
            with card(), ui.element("div").classes("w-full") as pair:
                self.marked.show()
            with ui.column().classes("min-w-0 gap-4 w-full items-stretch"):
                self.marked.show_controls()
                self.form.show()
                self._add_output()
            with ui.column().classes("min-w-0 gap-4 w-full items-stretch"):
                self.panel = MeasurementPanel(self.marked.viewer, self.opened, self.marked.find_map)
                self.panel.show()
                if len(self.opened.time) > 1:
                    about = "Click a start of sliding to add it; click it again to remove it."
                    self.mean_chart = show_mean(self.opened, about, lambda e: self.form.toggle_start(float(e.data[0])))
                show_histogram(self.opened)
                DefectList(self.folder, self.opened, self.marked.viewer, self.server, address).show_card("Files")
        self.report = ui.column().classes("w-full")
        self.marked.viewer.on_frame(self.panel.show_frame)
        self.marked.viewer.keep_in(storage_key, self._restore)
        self.form.on_starts = self._draw_starts
        self.marked.draw_marks()
        self._draw_starts()
        self._update()
        return pair

    async def _restore(self, kept: dict[str, Any]) -> None:
        """Show marks, values and measurements as they were before the page was loaded again."""
        self.form.restore(kept.get("form"))
        self.marked.restore(kept.get("marks"))
        self._draw_starts()
        await self.panel.restore(kept.get("measurements"))

    def _draw_starts(self) -> None:
        """Draw the starts of sliding in the curve of the mean."""
        if self.mean_chart is None:
            return
        lines = [{"xAxis": t * self.form.frame_rate} for t in self.form.starts]
        style = {"color": "var(--series-2)", "type": "dashed", "width": 2}
        mark = {"symbol": "none", "data": lines, "label": {"show": False}, "lineStyle": style, "silent": True}
        self.mean_chart.options["series"][0]["markLine"] = mark
        self.mean_chart.update()

    @property
    def viewer(self) -> ThermalViewer:
        """The viewer of the frames."""
        return self.marked.viewer

    # --- output ---------------------------------------------------------------------------------------------------
    def _add_output(self) -> None:
        """The name of the recording, its command line, and the button that saves it."""
        with card("Recording"):
            self.out = ui.input("recording", value=self.out_name, on_change=self._show_command)
            self.out.classes("w-full").props("outlined dense hint='a new NetCDF file (.nc) of this folder'")
            action("Save recording and template", self._save, icon="save", main=True).classes("w-full")
            self.line = ui.column().classes("w-full")

    def _values_changed(self) -> None:
        """Keep the values, and show what follows from them, after a mark or a value has changed."""
        self.marked.viewer.keep("marks", self.marked.kept_values())
        self.marked.viewer.keep("form", self.form.kept_values())
        self._update()

    def _update(self) -> None:
        """Show command line, scale of profiles, and what is missing."""
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
                files, options = find_camera_files(self.folder, self.names), self.collect_options()
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
        # frames of a table of times may belong to several repetitions: the table or the user says to which
        says_repetition = facts.starts or facts.case or facts.repetition or facts.times
        return facts if says_repetition else replace(facts, repetition=1)

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
        with self.report, show_file_errors(self.folder):
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
        home, sources = self.folder.resolve(), [file.resolve() for file in find_camera_files(self.folder, self.names)]
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
                saved = page_address("camera", open=Path(self.out.value).as_posix())
                action("View the recording", lambda: ui.navigate.to(saved), icon="visibility")
                action("To the campaigns", lambda: ui.navigate.to("/campaign"), icon="arrow_forward")

    def _show_result(self, result: ImportResult) -> None:
        text = escape_lines(name_page_fields(relative_names(str(result), self.folder)))
        ui.label(text).classes("whitespace-pre-wrap font-mono text-sm")
        for note in result.notes:
            ui.label(escape_control(name_page_fields(relative_names(note, self.folder)))).classes("text-xs")
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


def free_recording_name(folder: Path, files: str) -> str:
    """A name for the recording of camera files for which no recording, picture or template exists."""
    name = Path(files)
    stem = re.sub(r"\[0-9\]|[*?\[\]]", "", name.stem if name.suffix else name.name).strip(" ()_-.") or "recording"
    free, n = free_name(folder, f"{stem}.nc"), 1
    while any(os.path.lexists((folder / free).with_suffix(end)) for end in (".png", ".toml")):
        n += 1
        free = free_name(folder, f"{stem}-{n}.nc")
    return free


def _relative_path(path: Path, folder: Path) -> str:
    """A path relative to `folder` if it is inside, else unchanged."""
    return str(path.relative_to(folder)) if path.is_relative_to(folder) else str(path)


def _tuples_to_lists(value: Any) -> Any:
    """Tuples as lists, which TOML can write."""
    return [_tuples_to_lists(v) for v in value] if isinstance(value, tuple) else value
