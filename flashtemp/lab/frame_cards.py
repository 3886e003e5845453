"""Cards below an image of temperatures: mean over time, histogram, facts of the files, defects of the camera."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from nicegui import run, ui

from flashtemp.lab.charts import chart_options, line_series, show_chart
from flashtemp.lab.frame_server import FrameServer
from flashtemp.lab.opened_frames import OpenedFrames
from flashtemp.lab.page_fields import name_page_fields, show_file_errors
from flashtemp.lab.page_layout import card, refuse_damaged
from flashtemp.lab.thermal_viewer import ThermalViewer
from flashtemp.lab.workspace import escape_control

MAX_LISTED_PIXELS = 200  # bad pixels that are listed with their places


def show_mean(opened: OpenedFrames, about: str = "", on_point_click: Callable[[Any], Any] | None = None) -> Any:
    """Show the mean of the image over time, and return its chart."""
    with card("Mean of the image", about):
        line = line_series("mean", opened.time, opened.mean, showSymbol=True, symbolSize=7)
        return show_chart(
            chart_options([line], opened.time_label, f"mean, {opened.unit}"), "mean_of_image",
            "mean temperature of the image over time", on_point_click=on_point_click,
        )  # fmt: skip


def show_histogram(opened: OpenedFrames) -> None:
    """Show the number of values by temperature, folded."""
    look = opened.preview
    with card(), ui.expansion("Histogram of all values").classes("w-full"):
        middle = 0.5 * (look.edges[1:] + look.edges[:-1])
        counts = np.where(look.counts > 0, look.counts, np.nan)
        bars = line_series("values", middle, counts, step="middle", areaStyle={"opacity": 0.3})
        options = chart_options([bars], f"temperature, {opened.unit}", "number of values")
        options["yAxis"] |= {"type": "log", "scale": False}
        show_chart(options, "histogram", "number of values by temperature")


def show_facts(rows: Sequence[tuple[str, str]], label: str) -> None:
    """Show facts as a table of two columns."""
    with ui.element("table").classes("ft-table") as table:
        table.props["aria-label"] = label
        for key, words in rows:
            with ui.element("tr"):
                with ui.element("th").props("scope=row"):
                    ui.label(escape_control(key))
                with ui.element("td"):
                    ui.label(escape_control(words)).classes("break-words")


class DefectList:
    """The bad pixels, shutter events and frozen frames of shown frames, which are searched once the page is open."""

    def __init__(self, folder: Path, opened: OpenedFrames, viewer: ThermalViewer, server: FrameServer, address: str):
        self.folder, self.opened, self.viewer, self.server, self.address = folder, opened, viewer, server, address

    def show_card(self, title: str) -> None:
        """Show what the files say of themselves, and the defects as soon as they are found."""
        with card(title):
            rows = self.opened.preview.describe_rows()
            show_facts([(key, name_page_fields(words).replace(" degC", " °C")) for key, words in rows], title)
            for remark in self.opened.preview.notes:
                ui.label(escape_control(name_page_fields(remark))).classes("ft-muted ft-small break-words")
            self.show()

    def show(self) -> None:
        """Show the defects as soon as they are found."""
        self.place = ui.column().classes("w-full gap-1")
        with self.place:
            ui.label("Searching for bad pixels and shutter events ...").classes("ft-muted")
        ui.timer(0.1, self._search, once=True)

    async def _search(self) -> None:
        """Search defects of the camera outside the event loop, then mark and list them."""
        with self.place, show_file_errors(self.folder):
            with refuse_damaged(self.opened.files[0]):
                screened = await run.io_bound(self.opened.with_screening)
                legend = await run.io_bound(lambda: self.opened.legend)
            if screened is None or screened.screened is None:
                return
            self.server.replace(self.address, screened)
            self.viewer.show_screening(screened)
            self.place.clear()
            ui.label(f"Found: {screened.screened.summary}.")
            if legend:
                ui.label(legend).classes("ft-muted ft-small")
            _list_defects(screened)


def _list_defects(screened: OpenedFrames) -> None:
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
