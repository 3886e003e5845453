"""The camera page: view frames, mark the block, enter missing information, save recording and template."""

from __future__ import annotations

import os
import re
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from nicegui import events, run, ui

from flashtemp.api.camera import import_recording
from flashtemp.camera.importing.import_options import ImportOptions, load_template
from flashtemp.camera.importing.import_request import ImportRequest, expand_patterns
from flashtemp.camera.importing.recording_import import ImportResult
from flashtemp.errors import BadInput
from flashtemp.lab.image_marks import find_onsets
from flashtemp.lab.jobs import command_text
from flashtemp.lab.marked_image import MarkedImage
from flashtemp.lab.opened_frames import OpenedFrames, open_frames
from flashtemp.lab.page_layout import (
    ask_consent,
    escape_lines,
    file_address,
    page_address,
    refuse_damaged,
    relative_names,
    show_command,
    show_errors,
)
from flashtemp.lab.saving import (
    MAX_UPLOAD_BYTES,
    MAX_UPLOAD_FILES,
    UPLOAD_LIMIT,
    TextVersion,
    check_upload_name,
    read_text,
    write_text,
    write_upload,
)
from flashtemp.lab.workspace import CAMERA_SUFFIXES, escape_control, free_name, list_folder, resolve_inside

STATED_VALUE_UNITS = {"emissivity": "", "reflected": "°C", "fps": "1/s", "start": "s, of the first frame", "netd": "K"}
RECORDING_VIEWS = ("sidewall", "wake", "profile")
UPLOAD_FOLDER = "camera"  # name of the folder for several files uploaded at once


class CameraPage:
    """Import of camera files into a recording: marks and entered values, and the equivalent command line."""

    def __init__(self, folder: Path):
        self.folder = folder
        self.names: list[str] = []
        self.starts: list[float] = []
        self.inherited = ImportOptions()
        self.saved: dict[Path, TextVersion] = {}  # recordings written by this page: their templates

    async def show(self, name: str, template: str) -> None:
        """Show a camera file, a folder of camera files, or the files of a recording template."""
        with ui.row().classes("w-full items-end"):
            self.choice = ui.select(self._file_choices(name), value=name or None, label="camera files", with_input=True)
            self.choice.classes("w-96").on_value_change(
                lambda: ui.navigate.to(page_address("camera", open=self.choice.value))
            )
            like = [str(p) for p in list_folder(self.folder).templates]
            if name and like:
                self.like = ui.select(
                    like, label="use marks of template", on_change=lambda: self._open_with_template(name)
                ).classes("w-72")
            drop = ui.upload(
                label="or drop files here", multiple=True, auto_upload=True, on_multi_upload=self._store_uploads,
                max_total_size=MAX_UPLOAD_BYTES, max_files=MAX_UPLOAD_FILES,
            ).on_rejected(_notify_rejected)  # fmt: skip
            drop.props["accept"] = ",".join(sorted(CAMERA_SUFFIXES))
        body = ui.column().classes("w-full")
        with body:
            waiting = ui.spinner(size="lg")
        await ui.context.client.connected()
        opened: OpenedFrames | None = None
        with body, show_errors(self.folder):
            if template:
                read_text(self.folder, template)  # checks that it is a short regular file before it is parsed
                names, _, self.inherited = load_template(resolve_inside(self.folder, template))
                self.names = [name] if name else [str(Path(template).parent / n) for n in names]
            elif name:
                self.names = [name]
            if self.names:
                files = self._find_files()
                with refuse_damaged(files[0]):
                    opened = await run.io_bound(lambda: open_frames(files, self.inherited))
        waiting.delete()
        if opened is not None:
            with body:
                self._build_page(opened)

    def _file_choices(self, name: str) -> list[str]:
        listing = list_folder(self.folder)
        names = [*map(str, listing.image_series), *map(str, listing.images), *map(str, listing.recordings)]
        return list(dict.fromkeys([*([name] if name else []), *names]))

    def _open_with_template(self, name: str) -> None:
        """Open the same files with the marks and values of a template."""
        ui.navigate.to(page_address("camera", open=name, template=self.like.value))

    def _find_files(self) -> list[Path]:
        """The camera files of this page; links must not lead out of the folder.  Raises BadInput."""
        files = expand_patterns([str(resolve_inside(self.folder, name)) for name in self.names])
        for file in files:
            name = str(file.relative_to(self.folder.resolve()))
            if (path := resolve_inside(self.folder, name)).exists() and not path.is_file():
                raise BadInput(f"{escape_control(name)}: neither a file nor a folder of files; give a camera file")
        return files

    async def _store_uploads(self, event: events.MultiUploadEventArguments) -> None:
        """Store uploaded files in the folder and open them: one under its own name, several in a new folder."""
        files = [f for f in event.files if Path(f.name).suffix.lower() in CAMERA_SUFFIXES]
        with show_errors(self.folder):
            names = [check_upload_name(file.name) for file in files]
            place = path = self.folder
            if len(files) > 1:
                place = path = self.folder / free_name(self.folder, UPLOAD_FOLDER)
                place.mkdir()
            for name, file in zip(names, files, strict=True):
                path = await write_upload(place, free_name(place, name), file.iterate())
            if files:
                ui.navigate.to(
                    page_address("camera", open=str((path if len(files) == 1 else place).relative_to(self.folder)))
                )

    # --- images and charts ---------------------------------------------------------------------------------
    def _build_page(self, opened: OpenedFrames) -> None:
        self.opened, self.starts = opened, [t - (self.inherited.start or 0.0) for t in self.inherited.starts or ()]
        self.marked = MarkedImage(opened, self.inherited, self._show_command)
        with ui.row().classes("w-full items-start no-wrap max-xl:flex-wrap"):
            with ui.column().classes("grow min-w-0 gap-1 max-xl:w-full"):
                self.marked.show()
                self._add_charts()
            with ui.column().classes("w-full xl:w-[28rem] xl:shrink-0 gap-2"):
                self.marked.show_controls()
                self._add_option_inputs()
        self.report = ui.column().classes("w-full")
        self.marked.update_image()
        self._show_command()

    def _add_charts(self) -> None:
        """Mean of the image over time, in which starts of sliding are clicked, and the histogram."""
        look, title = self.opened.preview, {"fontSize": 12}
        means = _finite_pairs(self.opened.time, self.opened.mean)
        with ui.row().classes("w-full no-wrap max-lg:flex-wrap"):
            self.trace = ui.echart({
                "animation": False, "grid": {"top": 28, "bottom": 36}, "tooltip": {"trigger": "axis"},
                "title": {"text": "mean of the image (°C); click a start of sliding", "textStyle": title},
                "xAxis": {"type": "value", "name": "s" if self.opened.has_times else "frame"},
                "yAxis": {"type": "value", "scale": True},
                "series": [{"type": "line", "symbolSize": 7, "data": means}],
            }, on_point_click=lambda e: self._start_clicked(float(e.data[0]))).classes("grow h-52 min-w-0")  # fmt: skip
            middle = 0.5 * (look.edges[1:] + look.edges[:-1])
            ui.echart({
                "animation": False, "grid": {"top": 44, "bottom": 36},
                "title": {"text": "number of values by temperature (°C)", "textStyle": title},
                "xAxis": {"type": "value", "scale": True},
                "yAxis": {"type": "log", "axisLabel": {":formatter": "v => v < 1000 ? v : '1e' + Math.log10(v)"}},
                "series": [{"type": "line", "step": "middle", "showSymbol": False, "areaStyle": {},
                            "data": [p for p in _finite_pairs(middle, look.counts) if p[1] > 0]}],
            }).classes("w-80 h-52")  # fmt: skip
        for key, words in look.describe_rows():
            ui.label(escape_control(f"{key}: {words}")).classes("text-xs text-gray-700")

    # --- information missing in the file ---------------------------------------------------------------------
    def _add_option_inputs(self) -> None:
        facts = self.inherited
        ui.label("Information missing in the file").classes("text-lg font-medium")
        self.view = ui.select(
            list(RECORDING_VIEWS),
            value=facts.view or RECORDING_VIEWS[0],
            label="view",
            on_change=lambda: self._show_command(),
        )
        self.view.classes("w-full")
        self.values: dict[str, Any] = {}
        for key, unit in STATED_VALUE_UNITS.items():
            words = f"{key}{f' ({unit})' if unit else ''}"
            self.values[key] = ui.number(words, value=getattr(facts, key), on_change=lambda: self._show_command())
            self.values[key].classes("w-full").props("dense")
        self.starting = ui.input("starts of sliding, s after the first frame", value=_format_times(self.starts))
        self.starting.classes("w-full").props("dense").on("change", lambda: self._starts_typed())
        with ui.row():
            ui.button("Find starts", on_click=self._find_starts).props("outline dense no-caps")
            ui.button("Clear marks", on_click=self.marked.clear_marks).props("outline dense no-caps")
        self.out = ui.input(
            "recording", value=self._free_recording_name(), on_change=lambda: self._show_command()
        ).classes("w-full")
        ui.button("Save recording and template", on_click=self._save).classes("w-full").props("no-caps")
        self.line = ui.column().classes("w-full")

    def _free_recording_name(self) -> str:
        """A name for the recording for which no recording, picture or template exists."""
        name = Path(self.names[0])
        stem = re.sub(r"[*?\[\]]", "", name.stem if name.suffix else name.name).strip(" ()_-.") or "recording"
        free, n = free_name(self.folder, f"{stem}.nc"), 1
        while any(os.path.lexists((self.folder / free).with_suffix(end)) for end in (".png", ".toml")):
            n += 1
            free = free_name(self.folder, f"{stem}-{n}.nc")
        return free

    def _find_starts(self) -> None:
        self.starts = [round(t, 4) for t in find_onsets(self._frame_times(), self.opened.mean)]
        self._update_starts()
        if not self.starts:
            ui.notify("no start found; click on the curve")

    def _frame_times(self) -> np.ndarray:
        """Times (s) after the first frame, from the entered frame rate where the files have no times."""
        rate = self.values["fps"].value
        return self.opened.time if self.opened.has_times or not rate else self.opened.time / float(rate)

    def _start_clicked(self, t: float) -> None:
        """Add a start of sliding at a click on the curve, or remove the one there."""
        t = round(t / float(self.values["fps"].value or 1.0) if not self.opened.has_times else t, 4)
        self.starts = [s for s in self.starts if s != t] if t in self.starts else sorted([*self.starts, t])
        self._update_starts()

    def _starts_typed(self) -> None:
        words = str(self.starting.value or "").replace(";", ",").split(",")
        try:
            self.starts = sorted(float(v) for v in words if v.strip())
        except ValueError:
            ui.notify("enter times in s, separated by commas", type="negative")
        self._update_starts()

    def _update_starts(self) -> None:
        self.starting.value = _format_times(self.starts)
        rate = 1.0 if self.opened.has_times else float(self.values["fps"].value or 1.0)
        lines = [{"xAxis": t * rate} for t in self.starts]
        self.trace.options["series"][0]["markLine"] = {"symbol": "none", "data": lines, "label": {"show": False}}
        self.trace.update()
        if self.starts:
            self.values["start"].value = round(-self.starts[0], 4)
        self._show_command()

    # --- options and command ----------------------------------------------------------------------------------------
    def collect_options(self) -> ImportOptions:
        """The import options from marks and entered values."""
        marks = self.marked.marks
        entered: dict[str, Any] = {k: float(box.value) for k, box in self.values.items() if box.value is not None}
        if self.starts:
            entered["starts"] = tuple(round(t - self.starts[0], 4) for t in self.starts)
        unplaced = replace(self.inherited, point=None, pixel=None, second=None, at=None, mm_per_pixel=None)
        stated = ImportOptions(view=self.view.value, block=(marks.length, marks.height), **entered)
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
                rows[f.name] = str(value) if isinstance(value, Path) else _tuples_to_lists(value)
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
        """Show the saved recording with its picture."""
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


def _notify_rejected() -> None:
    ui.notify(f"only camera files are accepted, {UPLOAD_LIMIT}: {' '.join(sorted(CAMERA_SUFFIXES))}", type="negative")


def _relative_path(path: Path, folder: Path) -> str:
    """A path relative to `folder` if it is inside, else unchanged."""
    return str(path.relative_to(folder)) if path.is_relative_to(folder) else str(path)


def _finite_pairs(x: np.ndarray, y: np.ndarray) -> list[list[float]]:
    return [[float(a), float(b)] for a, b in zip(x, y, strict=True) if np.isfinite(b)]


def _format_times(values: list[float]) -> str:
    return ", ".join(f"{v:g}" for v in values)


def _tuples_to_lists(value: Any) -> Any:
    """Tuples as lists, which TOML can write."""
    return [_tuples_to_lists(v) for v in value] if isinstance(value, tuple) else value
