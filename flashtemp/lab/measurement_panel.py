"""Measurements on the camera page: table for the shown frame, curves over all frames, profiles along lines, export."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from nicegui import run, ui

from flashtemp.camera.importing.rectification import apply_homography
from flashtemp.lab import measurements as measuring
from flashtemp.lab.charts import chart_options, line_series, show_chart
from flashtemp.lab.measurements import KIND_POINTS, MAX_NAME_LENGTH, STATISTICS, Measurement
from flashtemp.lab.opened_frames import OpenedFrames
from flashtemp.lab.page_layout import action, card
from flashtemp.lab.thermal_viewer import ThermalViewer
from flashtemp.lab.workspace import escape_control

MAX_MEASUREMENTS = 30
HOW = (
    "Choose Spot, Box or Line above the image, then click or drag.  Drag a measurement to move it.  By keys: Enter on "
    "the image places one, and the table takes other places and names."
)


class MeasurementPanel:
    """The measurements of a viewer; `find_map` gives the map from pixels to m where the block is marked.

    With the names of `axes`, places are shown and entered in mm along them, else as columns and rows.
    """

    def __init__(
        self, viewer: ThermalViewer, opened: OpenedFrames, find_map: Callable[[], np.ndarray | None],
        axes: tuple[str, str] | None = None,
    ):  # fmt: skip
        self.viewer, self.opened, self.find_map = viewer, opened, find_map
        self.place_names = ("column", "row") if axes is None else axes
        to_metres = None if axes is None else find_map()
        self.to_places = np.eye(3) if to_metres is None else np.diag([1e3, 1e3, 1.0]) @ to_metres
        self.decimals = 1 if to_metres is None else 2
        self.measurements: dict[str, Measurement] = {}
        self.curves: dict[str, dict[str, Any]] = {}
        self.frame, self.number = 0, 0
        viewer.on_measure(self._change)

    def show(self) -> None:
        """Show the card with table, charts and export."""
        with card("Measurements") as self.card:
            self.empty = ui.label(HOW).classes("ft-muted")
            self.table = ui.element("div").classes("ft-scroll")
            self.charts = ui.element("div").classes("ft-split")
            with self.charts:
                with ui.column().classes("gap-1 min-w-0 w-full") as self.course_column:
                    self.course = self._add_chart("Over all frames", self.opened.time_label, "measurements_over_time")
                with ui.column().classes("gap-1 min-w-0 w-full") as self.profile_column:
                    self.profile = self._add_chart("Along the lines, this frame", "px", "profile_along_lines")
            with ui.row().classes("gap-2") as self.exports:
                action("Table as CSV", self._export_table, icon="download")
                action("Curves as CSV", self._export_curves, icon="download")
        self._rebuild()

    def _add_chart(self, title: str, x_label: str, name: str) -> Any:
        ui.label(title).classes("ft-muted ft-small")
        return show_chart(chart_options([], x_label, self.opened.unit), name, title)

    def show_frame(self, frame: int) -> None:
        """Show the values of another frame."""
        self.frame = frame
        if self.measurements:
            self._fill_table()
            self._draw_profiles()

    async def _change(self, key: str | None, kind: str, points: tuple[tuple[float, float], ...]) -> None:
        """Add, move or delete a measurement."""
        if not kind:
            self.delete(str(key))
            return
        if key not in self.measurements:
            if len(self.measurements) >= MAX_MEASUREMENTS:
                ui.notify(f"at most {MAX_MEASUREMENTS} measurements; delete one first")
                return
            self.number += 1
            key = f"m{self.number}"
            self.measurements[key] = Measurement(f"{kind} {self.number}".capitalize(), kind, points)
            self._rebuild()
        else:
            self.measurements[key] = replace(self.measurements[key], points=points)
            self.places[key].value = self._describe_place(self.measurements[key])
            self._show_changed()
        self._keep()
        await self._measure(key)

    async def _measure(self, key: str) -> None:
        """Draw the curve of a measurement over all frames."""
        measurement = self.measurements[key]
        curve = await run.io_bound(measuring.measure_frames, self.opened.frames, measurement)
        if self.measurements.get(key) == measurement:
            self.curves[key] = curve
            self._draw_curves()

    async def _move_typed(self, key: str, text: str) -> None:
        """Move a measurement to typed columns and rows."""
        numbers = [float(word) for word in re.findall(r"-?\d+(?:\.\d+)?", text)]
        kind = self.measurements[key].kind
        if len(numbers) == 2 * KIND_POINTS[kind]:
            at = apply_homography(np.linalg.inv(self.to_places), np.reshape(numbers, (-1, 2)))
            await self._change(key, kind, tuple((float(c), float(r)) for c, r in at))
        else:
            ui.notify(f"enter {2 * KIND_POINTS[kind]} numbers: {', '.join(self.place_names)}", type="negative")

    def _rename(self, key: str, name: str) -> None:
        """Give a measurement another name, in all places."""
        m = self.measurements[key]
        self.measurements[key] = replace(m, name=escape_control(name.strip())[:MAX_NAME_LENGTH] or m.name)
        self._label_row(key)
        self._keep()
        self._show_changed()
        self._draw_curves()

    def delete(self, key: str) -> None:
        """Delete a measurement."""
        self.measurements.pop(key, None)
        self.curves.pop(key, None)
        self._keep()
        self._rebuild()
        self._draw_curves()

    def update_scale(self) -> None:
        """Draw the profiles anew after the marks have moved."""
        self._draw_profiles()

    # --- what the browser keeps -----------------------------------------------------------------------------------
    def _keep(self) -> None:
        kept = [
            {"name": m.name, "kind": m.kind, "points": [list(p) for p in m.points]} for m in self.measurements.values()
        ]
        self.viewer.keep("measurements", kept)

    async def restore(self, kept: Any) -> None:
        """Show measurements that the browser has kept; those that do not fit the image are left out."""
        rows, columns = self.opened.frames.shape[1:]
        for m in measuring.read_measurements(kept, (rows, columns), MAX_MEASUREMENTS):
            self.number += 1
            self.measurements[f"m{self.number}"] = Measurement(escape_control(m.name), m.kind, m.points)
        self._rebuild()
        for key in list(self.measurements):
            await self._measure(key)

    # --- table ------------------------------------------------------------------------------------------------------
    def _rebuild(self) -> None:
        """Show the rows of all measurements, and the charts that have something to show."""
        some = bool(self.measurements)
        self.empty.set_visibility(not some)
        for element in (self.table, self.exports):
            element.set_visibility(some)
        self.course_column.set_visibility(some and len(self.opened.frames) > 1)
        self.profile_column.set_visibility(any(m.kind == "line" for m in self.measurements.values()))
        is_pair = self.course_column.visible and self.profile_column.visible
        self.charts.classes(replace="ft-split" if is_pair else "w-full")
        self.charts.set_visibility(some and (len(self.opened.frames) > 1 or self.profile_column.visible))
        self.table.clear()
        self.cells: dict[str, list[Any]] = {}
        self.names: dict[str, Any] = {}
        self.places: dict[str, Any] = {}
        self.deletes: dict[str, Any] = {}
        with self.table, ui.element("table").classes("ft-table"):
            with ui.element("tr"):
                for words in ("name", self._place_heading(), *STATISTICS):
                    with ui.element("th").props("scope=col"):
                        ui.label(f"{words}, {self.opened.unit}" if words in STATISTICS else words)
                ui.element("td")  # above the buttons
            for key, m in self.measurements.items():
                self._add_row(key, m)
        self._show_changed()

    def _show_changed(self) -> None:
        """Show names, places and values of the measurements in image, table and profiles."""
        self.viewer.show_measurements(self.measurements)
        self._fill_table()
        self._draw_profiles()

    def _label_row(self, key: str) -> None:
        """Name the controls of a row for screen readers after its measurement."""
        name = self.measurements[key].name
        words = (f"name of {name}", f"{name}: {self._place_heading()}", f"delete {name}")
        for element, label in zip((self.names[key], self.places[key], self.deletes[key]), words, strict=True):
            element.props["aria-label"] = label
            element.update()

    def _add_row(self, key: str, m: Measurement) -> None:
        with ui.element("tr"):
            with ui.element("td"):
                name = ui.input(value=m.name).props("dense borderless").classes("tv-name")
                name.on("change", lambda: self._rename(key, str(name.value)))
            with ui.element("td"):
                place = ui.input(value=self._describe_place(m)).props("dense borderless").classes("tv-place")
                place.on("change", lambda: self._move_typed(key, str(place.value)))
            self.cells[key] = []
            for _ in STATISTICS:
                with ui.element("td"):
                    self.cells[key].append(ui.label())
            with ui.element("td"):
                button = ui.button(icon="delete", on_click=lambda: self.delete(key)).props("flat dense round size=sm")
        self.names[key], self.places[key], self.deletes[key] = name, place, button
        self._label_row(key)

    def _place_heading(self) -> str:
        return ", ".join(self.place_names) + (", mm" if self.decimals > 1 else "")

    def _locate(self, m: Measurement) -> np.ndarray:
        """Points (n, 2) of a measurement along the axes of the table."""
        return apply_homography(self.to_places, np.array(m.points))

    def _describe_place(self, m: Measurement) -> str:
        return " to ".join(f"{a:.{self.decimals}f}, {b:.{self.decimals}f}" for a, b in self._locate(m))

    def _frame_values(self) -> dict[str, dict[str, float]]:
        frame = self.opened.frames[self.frame][None]
        found = {key: measuring.summarise_values(m.pixels_of(frame)) for key, m in self.measurements.items()}
        return {key: {name: float(value[0]) for name, value in values.items()} for key, values in found.items()}

    def _fill_table(self) -> None:
        """Write the values of the shown frame; a spot has one value."""
        for key, values in self._frame_values().items():
            spot = self.measurements[key].kind == "spot"
            for cell, name in zip(self.cells[key], STATISTICS, strict=True):
                known = np.isfinite(values[name]) and (not spot or name == "mean")
                cell.text = f"{values[name]:.2f}" if known else "" if spot and name != "mean" else "no value"

    # --- charts -----------------------------------------------------------------------------------------------------
    def _draw_curves(self) -> None:
        """Draw the value of each spot and the mean of each box and line over time."""
        series = [
            line_series(self.measurements[key].name, self.opened.time, curve["mean"], number)
            for number, (key, curve) in enumerate(self.curves.items())
        ]
        _set_series(self.course, series)

    def _draw_profiles(self) -> None:
        """Draw the temperature along each line in the shown frame."""
        lines = [m for m in self.measurements.values() if m.kind == "line"]
        if not lines:
            return
        to_metres = self.find_map()
        frame = self.opened.frames[self.frame]
        series = [
            line_series(m.name, *measuring.profile_along(frame, m, to_metres), number) for number, m in enumerate(lines)
        ]
        self.profile.options["xAxis"]["name"] = f"distance, {'px' if to_metres is None else 'mm'}"
        _set_series(self.profile, series)

    # --- export -----------------------------------------------------------------------------------------------------
    def _export_table(self) -> None:
        """Offer the table of the shown frame as CSV."""
        values, unit = self._frame_values(), self.opened.unit
        places = {key: self._locate(m).round(4) for key, m in self.measurements.items()}
        rows = [
            [m.name, self.frame, *places[key][0], *places[key][-1], *values[key].values()]
            for key, m in self.measurements.items()
        ]
        mm = ", mm" if self.decimals > 1 else ""
        ends = [f"{name} {k}{mm}" for k in (1, 2) for name in self.place_names]
        names = ["name", "frame", *ends, *(f"{n}, {unit}" for n in STATISTICS)]
        _offer_csv(measuring.write_table(names, rows), f"measurements_frame_{self.frame}.csv")

    async def _export_curves(self) -> None:
        """Offer the curves over all frames as CSV."""
        chosen = [(m, self.curves[key]) for key, m in self.measurements.items() if key in self.curves]
        text = await run.io_bound(
            measuring.curves_table, [m for m, _ in chosen], [c for _, c in chosen], self.opened.time, self.opened.unit
        )
        _offer_csv(text, "measurements_over_time.csv")


def _set_series(chart: Any, series: list[dict[str, Any]]) -> None:
    """Draw other lines in a chart, with a legend where there are several."""
    chart.options["series"] = series
    chart.options["legend"]["show"] = len(series) > 1
    chart.options["grid"]["top"] = 40 if len(series) > 1 else 16
    chart.update()


def _offer_csv(text: str, name: str) -> None:
    ui.download(text.encode("utf-8-sig"), name, "text/csv")  # the mark of UTF-8 lets spreadsheets read the unit
