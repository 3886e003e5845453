"""The form of what camera files do not say: view, times and surface, each with its meaning and where it is found."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from nicegui import ui

from flashtemp.camera.importing.import_options import ImportOptions
from flashtemp.lab.image_marks import find_onsets
from flashtemp.lab.measurements import read_numbers
from flashtemp.lab.opened_frames import OpenedFrames
from flashtemp.lab.page_fields import name_page_fields
from flashtemp.lab.page_layout import card, heading
from flashtemp.lab.workspace import escape_control

VIEW_LABELS: Final = {
    "sidewall": "sidewall: the side of the block, seen across the direction of sliding",
    "wake": "wake: the road behind the block",
    "profile": "profile: the temperature along the block, in one line",
}


@dataclass(frozen=True)
class StatedField:
    """A number that the user states: `key` of the import options, label with unit, and where it is found."""

    key: str
    label: str
    about: str


TIME_FIELDS: Final = (
    StatedField(
        "fps", "frame rate (fps), 1/s",
        "Frames per second.  It stands in the recording settings of the camera; needed where the files have no times.",
    ),
    StatedField(
        "start", "time of the first frame (start), s",
        "From the first start of sliding; negative if the camera ran before.  The starts below fill it in.",
    ),
)  # fmt: skip
SURFACE_FIELDS: Final = (
    StatedField(
        "emissivity", "emissivity",
        "Of the surface, 0 to 1: rubber about 0.95.  In the camera: object parameters, Emissivity.  Empty keeps the "
        "value of the file.",
    ),
    StatedField(
        "reflected", "reflected temperature, °C",
        "Apparent temperature of what the surface reflects.  In the camera: object parameters, T refl.  Measure it "
        "with crumpled aluminium foil at emissivity 1.",
    ),
    StatedField(
        "netd", "noise of one pixel (netd), K",
        "Noise equivalent temperature difference.  In the data sheet: NETD, often 0.03 to 0.05 K.  Empty: estimated "
        "from the frames.",
    ),
)  # fmt: skip
FILE_FIELDS: Final = (  # with what the temperatures of an export were computed
    StatedField(
        "emissivity", "emissivity in the export",
        "The emissivity with which the camera's program computed the temperatures of these files; 1 if it corrected "
        "nothing.  Needed to compute them anew with the emissivity above.",
    ),
    StatedField(
        "reflected", "reflected temperature in the export, °C",
        "The reflected temperature with which the camera's program computed them; any value if the emissivity was 1.",
    ),
)  # fmt: skip
MISSING_REMEDIES: Final = {  # key of the first missing option: what to do on this page
    "view": "Choose the view.",
    "downstream": "Mark the leading and the trailing edge of the block on the image.",
    "start": "Enter the time of the first frame, or find the starts of sliding.",
    "fps": "Enter the frame rate.",
}


class ImportForm:
    """Entered values of an import; `changed` is called when one of them has changed.

    `tables` are the text files of the folder that may state the time of every frame, by their names.
    """

    def __init__(
        self, opened: OpenedFrames, facts: ImportOptions, changed: Callable[[], Any], tables: Mapping[str, Path]
    ):
        self.opened, self.facts, self.changed, self.tables = opened, facts, changed, tables
        self.starts = [t - (facts.start or 0.0) for t in facts.starts or ()]
        self.values: dict[str, Any] = {}
        self.file_values: dict[str, Any] = {}
        self.required: dict[str, str] = {}  # labels of fields that a table of times replaces
        self.on_starts: Callable[[], Any] = lambda: None

    def show(self) -> None:
        """Show the fields in groups, and what is missing."""
        with card("Information missing in the file", "Fields marked with * are required for these files."):
            self.missing = ui.column().classes("w-full gap-0").props("role=status")
            heading(3, "View and times")
            self.view = ui.select(
                VIEW_LABELS, value=self.facts.view or "sidewall", label="view *", on_change=self._notify
            ).classes("w-full").props("outlined dense")  # fmt: skip
            self._add_times()
            for field in TIME_FIELDS:
                self._add_field(field, required=field.key == "start" or not self.opened.has_times)
            self._mark_required()
            self.starting = ui.input("starts of sliding, s after the first frame", value=format_times(self.starts))
            self.starting.classes("w-full").props("outlined dense").on("change", self._read_starts)
            with ui.row().classes("gap-2"):
                ui.button("Find starts", on_click=self.find_starts).props("outline no-caps")
            heading(3, "Surface and camera")
            for field in SURFACE_FIELDS:
                self._add_field(field, required=False)
            for field in FILE_FIELDS:
                if self._file_value(field.key) is None:
                    self._add_file_field(field)
            self._list_file_values()

    def _add_times(self) -> None:
        """The choice of a table with the time of every frame."""
        chosen = next((name for name, path in self.tables.items() if path == self.facts.times), None)
        self.times = ui.select(list(self.tables), value=chosen, label="table of times", on_change=self._times_chosen)
        self.times.classes("w-full").props("outlined dense clearable")
        self.times.props["hint"] = "columns file, time (s), repetition; instead of frame rate and starts"
        self.times.set_visibility(bool(self.tables))

    def _times_chosen(self) -> None:
        self._mark_required()
        self.changed()

    def _mark_required(self) -> None:
        """Mark the fields of the times as required, unless a table states the times."""
        for key, label in self.required.items():
            self.values[key].props["label"] = label if self.times.value else f"{label} *"
            self.values[key].update()

    def _add_field(self, field: StatedField, required: bool) -> None:
        """A number with its help, and the value that the file states."""
        file_value = self._file_value(field.key)
        with ui.element("div").classes("ft-field"):
            box = ui.number(
                field.label,
                value=getattr(self.facts, field.key), on_change=self._notify,
            ).classes("grow").props("outlined dense clearable")  # fmt: skip
            box.props["aria-label"] = field.label
            if required and file_value is None:
                self.required[field.key] = field.label
            if file_value is not None:
                box.props["placeholder"] = f"{file_value:g}"
                box.props["stack-label"] = True
                box.props["hint"] = f"from the file: {file_value:g}"
            self.values[field.key] = box
            _add_help(field)

    def _add_file_field(self, field: StatedField) -> None:
        """A number that the camera's program used, which these files do not state."""
        with ui.element("div").classes("ft-field"):
            box = ui.number(field.label, value=(self.facts.was or {}).get(field.key), on_change=self._notify)
            box.classes("grow").props("outlined dense clearable").props["aria-label"] = field.label
            self.file_values[field.key] = box
            _add_help(field)

    def _file_value(self, key: str) -> float | None:
        """The value of a field that the files state themselves."""
        preview = self.opened.preview
        return preview.fps if key == "fps" else preview.said.get(key)

    def _list_file_values(self) -> None:
        """List the values that the file states and the form does not ask for."""
        shown = {field.key for field in SURFACE_FIELDS}
        rest = {key: value for key, value in self.opened.preview.said.items() if key not in shown}
        if rest:
            words = ", ".join(f"{key.replace('_', ' ')} {value:g}" for key, value in rest.items())
            ui.label(escape_control(f"Also from the file: {words}")).classes("ft-muted ft-small")

    # --- starts of sliding ----------------------------------------------------------------------------------------
    @property
    def frame_rate(self) -> float:
        """Frames per second by which frame numbers are divided; 1 where the files have times."""
        return 1.0 if self.opened.has_times else float(self.values["fps"].value or 1.0)

    def find_starts(self) -> None:
        """Find the starts of sliding in the mean of the frames."""
        self.starts = [round(t, 4) for t in find_onsets(self.opened.time / self.frame_rate, self.opened.mean)]
        self.update_starts()
        if not self.starts:
            ui.notify("no start found; click on the curve of the mean")

    def toggle_start(self, position: float) -> None:
        """Add a start of sliding at a position on the curve of the mean, or remove the one there."""
        t = round(position / self.frame_rate, 4)
        self.starts = [s for s in self.starts if s != t] if t in self.starts else sorted([*self.starts, t])
        self.update_starts()

    def _read_starts(self) -> None:
        words = str(self.starting.value or "").replace(";", ",").split(",")
        try:
            self.starts = sorted(float(v) for v in words if v.strip())
        except ValueError:
            ui.notify("enter times in s, separated by commas", type="negative")
        self.update_starts()

    def update_starts(self) -> None:
        """Show changed starts in all places."""
        self.starting.value = format_times(self.starts)
        if self.starts:
            self.values["start"].value = round(-self.starts[0], 4)
        self.on_starts()
        self.changed()

    # --- what the browser keeps -----------------------------------------------------------------------------------
    def kept_values(self) -> dict[str, Any]:
        """The entered values, as the browser keeps them."""
        numbers = {key: box.value for key, box in self.values.items()}
        used = {key: box.value for key, box in self.file_values.items()}
        return {"numbers": numbers, "used": used, "view": self.view.value, "times": self.times.value,
                "starts": list(self.starts)}  # fmt: skip

    def restore(self, kept: Any) -> None:
        """Show values that the browser has kept; what is no value of a field is left out."""
        if not isinstance(kept, dict):
            return
        for name, boxes in (("numbers", self.values), ("used", self.file_values)):
            numbers = kept.get(name)
            for key, box in boxes.items():
                value = numbers.get(key) if isinstance(numbers, dict) else None
                box.value = next(iter(read_numbers([value], 1)), None)
        if kept.get("view") in VIEW_LABELS:
            self.view.value = kept["view"]
        self.times.value = kept.get("times") if kept.get("times") in self.tables else None
        starts = kept.get("starts")
        self.starts = read_numbers(starts, len(starts)) if isinstance(starts, list) else []
        self.starting.value = format_times(self.starts)

    # --- values -----------------------------------------------------------------------------------------------------
    def _notify(self) -> None:
        self.changed()

    def stated_options(self, block: tuple[float, float]) -> ImportOptions:
        """The entered values with the size of the block, mm."""
        entered: dict[str, Any] = {k: float(box.value) for k, box in self.values.items() if box.value is not None}
        if used := {key: float(box.value) for key, box in self.file_values.items() if box.value is not None}:
            entered["was"] = used
        if self.times.value:
            entered["times"] = self.tables[self.times.value]
        if self.starts:
            entered["starts"] = tuple(round(t - self.starts[0], 4) for t in self.starts)
        return ImportOptions(view=self.view.value, block=block, **entered)

    def _missing_file_values(self) -> list[str]:
        """What is needed to compute exported temperatures anew, where an emissivity or a reflection is entered."""
        if all(self.values[key].value is None for key in ("emissivity", "reflected")):
            return []
        empty = [f.label for f in FILE_FIELDS if f.key in self.file_values and self.file_values[f.key].value is None]
        return (
            [f"Enter the {' and the '.join(empty)}, or leave emissivity and reflected temperature empty."]
            if empty
            else []
        )

    def show_missing(self, lines: tuple[str, ...]) -> None:
        """List what is missing before the files can be saved as a recording; `lines` are those of the import."""
        remedies = [MISSING_REMEDIES.get(line.partition(":")[0], name_page_fields(line)) for line in lines]
        is_timed = self.opened.has_times or bool(self.times.value)
        if not is_timed and len(self.opened.time) > 1 and not self.values["fps"].value:
            remedies.append(MISSING_REMEDIES["fps"] + (" Or choose a table of times." if self.tables else ""))
        remedies += self._missing_file_values()
        self.missing.clear()
        with self.missing:
            if not remedies:
                ui.label("Nothing is missing.").classes("ft-note good")
                return
            with ui.column().classes("ft-note warning gap-0"):
                ui.label("Still missing:")
                for remedy in dict.fromkeys(remedies):
                    ui.label(escape_control(remedy))


def _add_help(field: StatedField) -> None:
    """A button that says what a field means and where it is found."""
    help_button = ui.button(icon="help_outline").props("flat round dense size=sm color=primary")
    help_button.props["aria-label"] = f"help on {field.label}"
    with help_button, ui.menu().props("max-width=22rem"):
        ui.label(field.about).classes("p-3 ft-small")
    help_button.tooltip(field.about)


def format_times(values: list[float] | np.ndarray) -> str:
    """Times in s, separated by commas."""
    return ", ".join(f"{v:g}" for v in values)
