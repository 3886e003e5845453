"""Measurements on the camera page: table for the shown frame, curves over all frames, profiles along lines, export."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
from nicegui import run, ui

from flashtemp.lab import measurements as measuring
from flashtemp.lab.charts import chart_options, line_series, show_chart
from flashtemp.lab.measurements import KIND_POINTS, STATISTICS, Measurement
from flashtemp.lab.opened_frames import OpenedFrames
from flashtemp.lab.page_layout import action, card
from flashtemp.lab.thermal_viewer import ThermalViewer

MAX_MEASUREMENTS = 30
HEADINGS = ("name", "column, row", *STATISTICS)
HOW = (
    "Choose Spot, Box or Line above the image, then click or drag.  Drag a measurement to move it.  By keys: Enter on "
    "the image places one, and the table takes other columns and rows."
)


class MeasurementPanel:
    """The measurements of a viewer; `find_map` gives the map from pixels to m where the block is marked."""

    def __init__(self, viewer: ThermalViewer, opened: OpenedFrames, find_map: Callable[[], np.ndarray | None]):
        self.viewer, self.opened, self.find_map = viewer, opened, find_map
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
                    words = "time after the first frame, s" if self.opened.has_times else "frame"
                    self.course = self._add_chart("Over all frames", words, "measurements_over_time")
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
        else:
            self.measurements[key] = Measurement(self.measurements[key].name, self.measurements[key].kind, points)
        self._rebuild()
        measurement = self.measurements[key]
        curve = await run.io_bound(measuring.measure_frames, self.opened.frames, measurement)
        if self.measurements.get(key) == measurement:
            self.curves[key] = curve
            self._draw_curves()

    async def _move_typed(self, key: str, text: str) -> None:
        """Move a measurement to typed columns and rows."""
        numbers = [float(word) for word in re.findall(r"-?\d+(?:\.\d+)?", text)]
        points = tuple(zip(numbers[::2], numbers[1::2], strict=False))
        kind = self.measurements[key].kind
        if len(numbers) == 2 * KIND_POINTS[kind]:
            await self._change(key, kind, points)
        else:
            ui.notify(f"enter {2 * KIND_POINTS[kind]} numbers: column, row", type="negative")

    def delete(self, key: str) -> None:
        """Delete a measurement."""
        self.measurements.pop(key, None)
        self.curves.pop(key, None)
        self._rebuild()
        self._draw_curves()

    def update_scale(self) -> None:
        """Draw the profiles anew after the marks have moved."""
        self._draw_profiles()

    # --- table ------------------------------------------------------------------------------------------------------
    def _rebuild(self) -> None:
        """Show the rows of all measurements, and the charts that have something to show."""
        some = bool(self.measurements)
        self.empty.set_visibility(not some)
        for element in (self.table, self.exports):
            element.set_visibility(some)
        self.course_column.set_visibility(some and len(self.opened.frames) > 1)
        self.profile_column.set_visibility(any(m.kind == "line" for m in self.measurements.values()))
        self.charts.set_visibility(some and (len(self.opened.frames) > 1 or self.profile_column.visible))
        self.table.clear()
        self.cells: dict[str, list[Any]] = {}
        with self.table, ui.element("table").classes("ft-table"):
            with ui.element("tr"):
                for words in HEADINGS:
                    with ui.element("th").props("scope=col"):
                        ui.label(f"{words}, {self.opened.unit}" if words in STATISTICS else words)
                ui.element("td")  # above the buttons
            for key, m in self.measurements.items():
                self._add_row(key, m)
        self.viewer.show_measurements(self.measurements)
        self._fill_table()
        self._draw_profiles()

    def _add_row(self, key: str, m: Measurement) -> None:
        with ui.element("tr"):
            with ui.element("td"):
                ui.label(m.name)
            with ui.element("td"):
                place = ui.input(value=m.describe_place()).props("dense borderless").classes("tv-place")
                place.props["aria-label"] = f"{m.name}: column, row"
                place.on("change", lambda: self._move_typed(key, str(place.value)))
            self.cells[key] = []
            for _ in STATISTICS:
                with ui.element("td"):
                    self.cells[key].append(ui.label())
            with ui.element("td"):
                button = ui.button(icon="delete", on_click=lambda: self.delete(key)).props("flat dense round size=sm")
                button.props["aria-label"] = f"delete {m.name}"

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
        rows = [
            [m.name, self.frame, *(c for p in (m.points[0], m.points[-1]) for c in p), *values[key].values()]
            for key, m in self.measurements.items()
        ]
        names = ["name", "frame", "column 1", "row 1", "column 2", "row 2", *(f"{n}, {unit}" for n in STATISTICS)]
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
