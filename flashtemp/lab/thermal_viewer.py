"""The viewer of frames in the browser: palette, range, isotherm, zoom, playback, marks, measurements."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from typing import Any

import numpy as np
from nicegui import events, ui

from flashtemp.lab.measurements import KIND_POINTS, Measurement
from flashtemp.lab.opened_frames import OpenedFrames
from flashtemp.lab.palettes import labelled_palettes
from flashtemp.lab.style import read_asset
from flashtemp.lab.workspace import escape_control

Points = tuple[tuple[float, float], ...]  # columns and rows
VIEWER_GROUP = "frames"  # viewers of one page follow each other
RECORDING_AXES = {"sidewall": ("x", "z"), "wake": ("x", "y")}  # of u and v


def add_viewer_style() -> None:
    """Add the style sheet of viewers to the page."""
    ui.add_css(read_asset("thermal_viewer.css"))


class ThermalViewer(ui.element, component="assets/thermal_viewer.js"):  # type: ignore[call-arg]
    """Frames at an `address` of the frame server; a `compact` viewer follows the first one of its group."""

    def __init__(self, opened: OpenedFrames, address: str, title: str = "", compact: bool = False, image_id: str = ""):
        super().__init__()
        rows, columns = opened.frames.shape[1:]
        low, high = opened.preview.span
        values = {
            "address": address, "count": len(opened.frames), "rows": rows, "columns": columns,
            "times": [round(float(t), 6) for t in opened.time], "hasTimes": opened.has_times, "unit": opened.unit,
            "span": [low, max(high, low + 0.01)], "percentiles": list(opened.percentile_range),
            "palettes": labelled_palettes(), "marks": [], "outline": [], "measurements": [], "screened": {"version": 0},
            "toMillimetres": [], "title": title, "imageId": image_id, "magnifierId": "", "group": VIEWER_GROUP,
            "compact": compact, "nextMark": "", "missingWords": opened.missing_words, "axes": [], "frameLabels": [],
            "storageKey": "", "kept": {}, "fileLabel": _label_files(opened),
        }  # fmt: skip
        for name, value in values.items():
            self._props[name] = value
        if (known := opened.recording) is not None and (to_metres := opened.find_map()) is not None:
            self._props["toMillimetres"] = _millimetre_map(to_metres)
            self._props["axes"] = list(RECORDING_AXES[known.view])
            if known.view == "sidewall":  # the interface
                self._props["outline"] = _find_level(to_metres, columns, rows)
        if known is not None:
            self._props["frameLabels"] = [f"repetition {n}" for n in known.repetition]
        if opened.screened is not None:
            self.show_screening(opened)

    def set_title(self, title: str) -> None:
        """Show a title above the image."""
        self._props["title"] = title
        self.update()

    def use_magnifier(self, element_id: str) -> None:
        """Show the surroundings of the pointer and of marks in the canvas of that id."""
        self._props["magnifierId"] = element_id

    def show_marks(
        self, marks: Sequence[tuple[str, float, float, str]], outline: Sequence[tuple[float, float]], next_mark: str,
        to_metres: np.ndarray | None,
    ) -> None:  # fmt: skip
        """Draw marks (name, column, row, colour) and an outline; positions are shown in mm with a map to m."""
        names = ("name", "column", "row", "colour")
        self._props["marks"] = [dict(zip(names, mark, strict=True)) for mark in marks]
        self._props["outline"] = [list(point) for point in outline]
        self._props["nextMark"] = next_mark
        self._props["toMillimetres"] = [] if to_metres is None else _millimetre_map(to_metres)
        self.update()

    def show_measurements(self, measurements: dict[str, Measurement]) -> None:
        """Draw measurements by their keys."""
        self._props["measurements"] = [
            {"id": key, "kind": m.kind, "name": m.name, "points": [list(p) for p in m.points]}
            for key, m in measurements.items()
        ]
        self.update()

    def show_screening(self, opened: OpenedFrames) -> None:
        """Mark bad pixels on the image, and shutter events and frozen frames on the time axis."""
        found = opened.screened
        if found is not None:
            self._props["screened"] = {"version": 1, "shutter": list(found.shutter), "frozen": list(found.frozen)}
            self.update()

    # --- what a reload of the page keeps ------------------------------------------------------------------------
    def keep_in(self, key: str, on_restore: Callable[[dict[str, Any]], Any]) -> None:
        """Let the browser keep what `keep` is given under a key; after a reload, call with what it has kept."""
        self._props["storageKey"] = key
        self.on("restore", lambda event: on_restore(event.args if isinstance(event.args, dict) else {}))

    def keep(self, name: str, value: Any) -> None:
        """Keep a value of plain numbers, texts and lists until the tab of the browser is closed."""
        self._props["kept"] = {**self._props["kept"], name: value}
        self.update()

    # --- what the user does -------------------------------------------------------------------------------------
    def on_frame(self, handler: Callable[[int], Any]) -> None:
        """Call with the number of a frame that is shown; several times a second while the frames are played."""
        self.on("frame", lambda event: handler(int(event.args["frame"])))

    def on_mark(self, handler: Callable[[str, float, float, bool], Any]) -> None:
        """Call with name, column and row of a mark, and whether the mouse has been released."""

        def answer(event: events.GenericEventArguments) -> None:
            told = event.args
            handler(str(told["name"]), float(told["column"]), float(told["row"]), bool(told["done"]))

        self.on("mark", answer)

    def on_measure(self, handler: Callable[[str | None, str, Points], Awaitable[None]]) -> None:
        """Call with key (None for a new one), kind ("" to delete) and points of a measurement."""

        async def answer(event: events.GenericEventArguments) -> None:
            kind = str(event.args["kind"])
            points = tuple((float(c), float(r)) for c, r in event.args["points"])
            if len(points) == KIND_POINTS.get(kind, 0):
                await handler(event.args["id"], kind, points)

        self.on("measure", answer)


def _label_files(opened: OpenedFrames) -> str:
    """What stands in a saved image: the name of the file, or of the first of several."""
    name, more = escape_control(opened.files[0].name), len(opened.files) - 1
    return f"{name} and {more} more" if more else name


def _millimetre_map(to_metres: np.ndarray) -> list[float]:
    """The nine numbers of a map from pixels to mm, row by row."""
    return [float(v) for v in np.ravel(np.diag([1e3, 1e3, 1.0]) @ to_metres)]


def _find_level(to_metres: np.ndarray, columns: int, rows: int) -> list[list[float]]:
    """The ends (column, row) of the line v = 0 of a recording; [] where the image does not show it."""
    row = -float(to_metres[1, 2] / to_metres[1, 1])
    return [[-0.5, row], [columns - 0.5, row]] if -0.5 <= row <= rows - 0.5 else []
