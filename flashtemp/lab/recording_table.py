"""The table of a campaign's measurements: picture, conditions, noise, camera and use of each; cells edit the text."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from nicegui import ui

from flashtemp.camera.camera_classes import CAMERA_CLASSES
from flashtemp.display import format_count
from flashtemp.lab.campaign_checks import CampaignCheck
from flashtemp.lab.campaign_document import CampaignDocument, format_cell, parse_cell
from flashtemp.lab.key_units import (
    convert_to_key_unit,
    describe_value,
    find_param,
    natural_unit,
    read_number,
    show_number,
    unit_label,
)
from flashtemp.lab.page_layout import chip, page_address, set_prop, show_fault_lines
from flashtemp.lab.recording_store import RecordingBrief, RecordingStore
from flashtemp.lab.toml_tables import Table, change_entry, remove_entry
from flashtemp.lab.workspace import escape_control
from flashtemp.model.case import Case

USUAL_CONDITIONS: Final = ("contact.pressure", "schedule.speed")  # columns that are always there
CURVE_SIZE: Final = (160, 64)  # of a small curve, in its own units
NOISE_KEYS: Final = {"recording": "sigma_K", "force": "sigma"}
BRIEF: Final = "brief"  # among what a row shows
BY_RECORDING: Final = ""  # the camera class that the recording states


@dataclass
class EntryRow:
    """The controls of one entry, by column; `written` is what each last showed."""

    kind: str
    number: int
    fields: dict[str, Any] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)  # of the numbers in the fields of conditions
    written: dict[str, Any] = field(default_factory=dict)
    picture: Any = None
    facts: Any = None
    view: Any = None
    faults: Any = None
    fault_row: Any = None


MAX_ROWS, MAX_COLUMNS = 200, 40  # that are shown; each cell is a control of the page


class RecordingTable:
    """All entries of a campaign in one table; `duplicate` is called with kind and number of an entry."""

    def __init__(self, document: CampaignDocument, store: RecordingStore, duplicate: Callable[[str, int], Any]):
        self.document, self.store, self.duplicate = document, store, duplicate
        self.rows: list[EntryRow] = []
        self.more_columns: list[str] = []  # conditions that the user has added and no entry states yet
        self.case: Case | None = None
        self.signature: Any = None

    def show(self) -> None:
        """Show the table."""
        self.body = ui.element("div").classes("ft-scroll")
        with ui.row().classes("items-center gap-2 w-full"):
            self.column = ui.select([], label="add a condition", with_input=True, on_change=lambda: self._add_column())
            self.column.props("outlined dense").classes("w-72")
            ui.label("An empty cell takes the value of the case, shown in grey.").classes("ft-muted ft-small")
        self.update_values()

    # --- what the text says ------------------------------------------------------------------------------
    def update_values(self) -> None:
        """Show the text as it stands; controls that already show it stay as they are."""
        entries = [(kind, n, e) for kind in NOISE_KEYS for n, e in enumerate(self.document.list_entries(kind), 1)]
        left_out, entries = len(entries) - MAX_ROWS, entries[:MAX_ROWS]
        columns = self._list_columns([entry for _, _, entry in entries])[:MAX_COLUMNS]
        signature = (tuple((kind, n, str(e.get("file")), str(e.get("view"))) for kind, n, e in entries), columns)
        if signature != self.signature:
            self.signature = signature
            self._build_rows(entries, columns)
            if left_out > 0:
                with self.body:
                    ui.label(f"and {left_out} more; they are in the text below").classes("ft-muted")
        for row, (_, _, entry) in zip(self.rows, entries, strict=True):
            self._fill_row(row, entry)

    def _list_columns(self, entries: list[Table]) -> tuple[str, ...]:
        stated = [key for entry in entries for key in _conditions_of(entry)]
        return tuple(dict.fromkeys([*USUAL_CONDITIONS, *stated, *self.more_columns]))

    def _build_rows(self, entries: list[tuple[str, int, Table]], columns: tuple[str, ...]) -> None:
        self.body.clear()
        self.rows = []
        with self.body:
            if not entries:
                nothing = "No measurement in this campaign yet. Add recordings below."
                damaged = "The text is not valid TOML. Repair it below; its table then appears here."
                ui.label(damaged if self.document.raw is None else nothing).classes("ft-muted")
                return
            with ui.element("table").classes("ft-table ft-recordings"):
                with ui.element("thead"), ui.element("tr"):
                    for words in ("picture", "file"):
                        _head(words)
                    for key in columns:
                        _head(key, unit_label(self._natural_unit(key)))
                    for words in ("frames", "noise (1 sd)", "camera", "held out", "change"):
                        _head(words)
                with ui.element("tbody"):
                    for kind, number, entry in entries:
                        self._build_row(EntryRow(kind, number), entry, columns)

    def _build_row(self, row: EntryRow, entry: Table, columns: tuple[str, ...]) -> None:
        name = _name_of(row.kind, row.number, entry)
        with ui.element("tr"):
            with ui.element("td"):
                self._add_picture(row, entry, name)
            with ui.element("td").classes("ft-file"):
                ui.label(name).classes("ft-mono ft-small break-all")
                row.view = ui.element("div")
            for key in columns:
                with _cell(key):
                    self._add_field(row, key, f"{key} of {name}")
            with _cell("frames"):
                row.facts = ui.column().classes("gap-0 ft-small whitespace-nowrap")
            with _cell("noise (1 sd)"):
                self._add_field(row, NOISE_KEYS[row.kind], f"noise of {name}")
            with _cell("camera" if row.kind == "recording" else ""):
                if row.kind == "recording":
                    self._add_camera(row, name)
            with _cell("held out"):
                held = ui.switch(on_change=lambda: self._choice_changed(row, "held_out"))
                held.props["aria-label"] = f"hold {name} out of the fit"
                row.fields["held_out"] = held
            with _cell("change"), ui.row().classes("no-wrap gap-0"):
                self._add_buttons(row, name)
        with ui.element("tr") as row.fault_row, _wide_cell(len(columns) + 7):
            row.faults = ui.column().classes("ft-note error gap-0").props("role=alert")
        row.fault_row.set_visibility(False)
        self.rows.append(row)

    def _add_picture(self, row: EntryRow, entry: Table, name: str) -> None:
        path = self.document.find_file(entry.get("file"))
        is_image = row.kind == "recording" and path is not None and path.suffix == ".nc"
        if is_image and path is not None:
            target = page_address("camera", open=path.relative_to(self.document.folder.resolve()))
            with ui.link(target=target, new_tab=True).classes("ft-small-picture") as row.picture:
                ui.spinner(size="sm")
            row.picture.props["aria-label"] = f"view {name}"
        else:
            row.picture = ui.element("div").classes("ft-small-picture")

    def _add_field(self, row: EntryRow, key: str, label: str) -> None:
        box = ui.input().props("outlined dense hide-bottom-space").classes("ft-cell")
        box.props["aria-label"] = label
        box.on("change", lambda: self._cell_changed(row, key))
        row.fields[key] = box

    def _add_camera(self, row: EntryRow, name: str) -> None:
        choices = {BY_RECORDING: "as recorded", **{c: c for c in CAMERA_CLASSES}}
        box = ui.select(choices, value=BY_RECORDING, on_change=lambda: self._choice_changed(row, "camera"))
        box.props("outlined dense options-dense").classes("ft-cell wide")
        box.props["aria-label"] = f"camera of {name}"
        row.fields["camera"] = box

    def _add_buttons(self, row: EntryRow, name: str) -> None:
        for icon, words, act in (
            ("content_copy", "another one with the conditions of", lambda: self.duplicate(row.kind, row.number)),
            ("delete_outline", "remove", lambda: self._remove(row)),
        ):
            button = ui.button(icon=icon, on_click=act).props("flat round dense color=primary")
            button.props["aria-label"] = f"{words} {name}"
            button.tooltip(f"{words} {name}")

    def _fill_row(self, row: EntryRow, entry: Table) -> None:
        """Show the values of an entry, each only where it is another than the one last shown."""
        given = _conditions_of(entry)
        for key, box in row.fields.items():
            if key == "held_out":
                value: Any = entry.get("held_out") is True
            elif key == "camera":
                value = entry.get("camera") if entry.get("camera") in CAMERA_CLASSES else BY_RECORDING
            else:
                stated = entry.get(key) if key in NOISE_KEYS.values() else given.get(key)
                value, unit = self._show_value(key, stated)
                row.units[key] = unit
                is_text = isinstance(stated, (str, bool, type(None))) and value == format_cell(stated)
                set_prop(box, "suffix", "" if is_text else unit_label(unit))
            if row.written.get(key) != value:
                row.written[key] = value
                box.value = value

    def _show_value(self, key: str, stated: Any) -> tuple[str, str]:
        """The text of a cell and the unit of its number: one unit for the whole column."""
        if (param := find_param(self.case, key)) is None:
            return format_cell(stated), "K" if key == "sigma_K" else ""
        return show_number(convert_to_key_unit(stated, param), param, natural_unit(param))

    def _natural_unit(self, key: str) -> str:
        param = find_param(self.case, key)
        return "" if param is None else natural_unit(param)

    # --- what the controls change -----------------------------------------------------------------------------
    def _change(self, row: EntryRow, changed: Mapping[str, Any]) -> None:
        self.document.apply_edit(lambda text: change_entry(text, row.kind, row.number, changed))

    def _cell_changed(self, row: EntryRow, key: str) -> None:
        typed, param = row.fields[key].value, find_param(self.case, key)
        value = parse_cell(typed, row.units[key]) if param is None else read_number(typed, param, row.units[key])
        row.written.pop(key, None)
        if key in NOISE_KEYS.values():
            self._change(row, {key: value})
        else:
            entry = self.document.list_entries(row.kind)[row.number - 1]
            given = {k: v for k, v in {**_conditions_of(entry), key: value}.items() if v is not None}
            self._change(row, {"with": given})
        self.update_values()

    def _choice_changed(self, row: EntryRow, key: str) -> None:
        """Write the camera, or whether the entry is held out."""
        value = row.fields[key].value
        if row.written.get(key) != value:
            row.written[key] = value
            self._change(row, {key: value or None})

    def _remove(self, row: EntryRow) -> None:
        self.document.apply_edit(lambda text: remove_entry(text, row.kind, row.number))

    def _add_column(self) -> None:
        if self.column.value:
            self.more_columns.append(self.column.value)
            self.column.value = None
            self.update_values()
            self._show_defaults()

    # --- what the check says ------------------------------------------------------------------------------
    def update_check(self, check: CampaignCheck) -> None:
        """Show the errors of every entry, values of the case in empty cells, and pictures and facts."""
        self.case = check.case or self.case
        self._show_defaults()
        self._offer_columns()
        for row in self.rows:
            entries = self.document.list_entries(row.kind)
            if row.number > len(entries):  # the text is not TOML at the moment
                continue
            entry = entries[row.number - 1]
            show_fault_lines(row.faults, check.entry_faults(row.kind, row.number), self.document.folder)
            row.fault_row.set_visibility(row.faults.visible)
            if (path := self.document.find_file(entry.get("file"))) is not None:
                self._show_brief(row, self.store.find_brief(path))

    def _show_defaults(self) -> None:
        if self.case is None:
            return
        for row in self.rows:
            for key, box in row.fields.items():
                if (param := find_param(self.case, key)) is not None:
                    table, _, name = key.rpartition(".")
                    value = self.case.values.get(table, {}).get(name)
                    set_prop(box, "placeholder", "" if value is None else describe_value(value, param))

    def _offer_columns(self) -> None:
        if self.case is not None:
            shown = {*self._list_columns([e for kind in NOISE_KEYS for e in self.document.list_entries(kind)])}
            keys = [f"{t}.{k}" for t in self.case.values for k in self.case.declared_params(t)]
            self.column.set_options([k for k in keys if k not in shown and not k.startswith(("numerics", "output"))])

    def _show_brief(self, row: EntryRow, brief: RecordingBrief | None) -> None:
        if row.written.get(BRIEF, ...) == brief:
            return
        row.written[BRIEF] = brief
        row.picture.clear()
        row.facts.clear()
        row.view.clear()
        if brief is None:
            with row.picture:
                ui.icon("broken_image").classes("ft-muted").props("aria-hidden=true")
            return
        with row.view:
            chip(brief.view)
        if brief.picture:
            with row.picture:
                picture = ui.element("img").props('alt=""')
                picture.props["src"] = brief.picture
            size = f"{brief.pixels[0]} × {brief.pixels[1]} px"
        else:
            with row.picture:
                draw_curve(brief.curve)
            size = format_count(brief.pixels[0], "sensor")
        with row.facts:
            if row.kind == "force":
                ui.label(format_count(brief.frames, "reading"))
                ui.label(f"{brief.span[0]:.3g} to {brief.span[1]:.3g}").classes("ft-muted")
                return
            ui.label(format_count(brief.frames, "frame"))
            ui.label(size).classes("ft-muted")
            ui.label(f"{brief.span[0]:.1f} to {brief.span[1]:.1f} °C").classes("ft-muted")
        if choice := row.fields.get("camera"):
            choice.options[BY_RECORDING] = f"{brief.camera} (file)"
            choice.update()
        if box := row.fields.get("sigma_K"):
            stated = f"{brief.netd_K:.3g} K" if brief.netd_K is not None else ""
            measured = f"measured {brief.noise_K:.2g} K" if brief.noise_K is not None else ""
            box.props("bottom-slots")
            set_prop(box, "placeholder", stated or measured or "estimated")
            set_prop(box, "hint", measured)


def draw_curve(curve: tuple[tuple[float, float], ...]) -> None:
    """Draw a small line without axes."""
    if len(curve) < 2:
        ui.icon("show_chart").classes("ft-muted").props("aria-hidden=true")
        return
    (t0, t1), (v0, v1) = ((min(a), max(a)) for a in zip(*curve, strict=True))
    wide, high = CURVE_SIZE
    points = [
        f"{wide * (t - t0) / max(t1 - t0, 1e-12):.1f},{4 + (high - 8) * (1 - (v - v0) / max(v1 - v0, 1e-12)):.1f}"
        for t, v in curve
    ]
    with ui.element("svg").props("aria-hidden=true preserveAspectRatio=none") as drawing:
        drawing.props["viewBox"] = f"0 0 {wide} {high}"
        ui.element("polyline").props["points"] = " ".join(points)


def _head(words: str, unit: str = "") -> None:
    with ui.element("th").props("scope=col"):
        ui.label(words)
        if unit:
            ui.label(unit).classes("ft-small")


def _cell(label: str) -> Any:
    """A cell, with the words that a narrow page shows above it."""
    cell = ui.element("td")
    if label:
        cell.props["data-label"] = label
    return cell


def _wide_cell(columns: int) -> Any:
    cell = ui.element("td").classes("ft-wide")
    cell.props["colspan"] = columns
    return cell


def _conditions_of(entry: Table) -> dict[str, Any]:
    given = entry.get("with")
    return given if isinstance(given, dict) else {}


def _name_of(kind: str, number: int, entry: Table) -> str:
    """What a row is called."""
    if isinstance(entry.get("file"), str):
        return escape_control(entry["file"])
    return f"planned {escape_control(str(entry['view']))}" if "view" in entry else f"{kind} {number}"
