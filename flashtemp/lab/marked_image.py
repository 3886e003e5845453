"""The image on which the edges of the block are marked by clicking, dragging or typing, with a magnifier."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from nicegui import ui

from flashtemp.camera.importing.import_options import ImportOptions
from flashtemp.camera.importing.recording_import import pixel_to_metre_map
from flashtemp.errors import BadInput
from flashtemp.lab.image_marks import CORNER_NAMES, IMAGE_DIRECTIONS, BlockMarks
from flashtemp.lab.measurements import read_numbers
from flashtemp.lab.opened_frames import OpenedFrames
from flashtemp.lab.page_layout import card
from flashtemp.lab.thermal_viewer import ThermalViewer

MARK_COLOURS = dict(zip(CORNER_NAMES, ("#00E5FF", "#FFD600", "#76FF03", "#FF4081"), strict=True))
DEFAULT_LENGTH_MM, DEFAULT_HEIGHT_MM = 25.0, 7.0  # of a block, until its size is entered
IMAGE_ID, MAGNIFIER_ID = "image", "magnifier"  # of the elements in the page
NO_MARK = "The surroundings of the pointer and of the last mark appear here, magnified."
HOW_TO_MARK = (
    "Click the leading and the trailing edge at the interface, or all four corners.  To correct a mark, drag it, click "
    "in the magnifier or type its coordinates."
)


class MarkedImage:
    """Frames of camera files with marks; `changed` is called when a mark or the size of the block has changed."""

    def __init__(self, opened: OpenedFrames, address: str, facts: ImportOptions, changed: Callable[[], Any]):
        self.opened, self.address, self.facts, self.changed = opened, address, facts, changed
        self.points: dict[str, tuple[float, float]] = {}
        self.boxes: dict[tuple[str, int], Any] = {}
        self.sizes: dict[str, Any] = {}
        if facts.point is not None and len(facts.point) == len(CORNER_NAMES):
            self.points = {n: (p[0], p[1]) for n, p in zip(CORNER_NAMES, facts.point, strict=True)}
        elif facts.pixel is not None and facts.second is not None:
            self.points = {CORNER_NAMES[0]: facts.pixel, CORNER_NAMES[1]: (facts.second[0], facts.second[1])}

    @property
    def marks(self) -> BlockMarks:
        """The marks with the size of the block."""
        length, height = (float(box.value or 1.0) for box in (self.sizes["length"], self.sizes["height"]))
        return BlockMarks(dict(self.points), length, height, str(self.up.value))

    def find_map(self) -> np.ndarray | None:
        """The map (3, 3) from pixels to m that the marks give; None without enough marks."""
        try:
            return pixel_to_metre_map(self.marks.to_options(), self.opened.frames.shape[1:])[0]
        except BadInput:
            return None

    # --- image and controls -----------------------------------------------------------------------------------
    def show(self, title: str = "") -> None:
        """Show the viewer of the frames."""
        self.viewer = ThermalViewer(self.opened, self.address, title, image_id=IMAGE_ID)
        self.viewer.use_magnifier(MAGNIFIER_ID)
        self.viewer.on_mark(self._handle_mark)

    def show_controls(self) -> None:
        """Show the choice of the next mark, the magnifier, the coordinates, and the size of the block."""
        with card("Position of the block", HOW_TO_MARK):
            self.next = ui.toggle(
                list(CORNER_NAMES), value=CORNER_NAMES[min(len(self.points), 1)], on_change=self.draw_marks
            ).props("dense no-caps unelevated spread")
            self.next.classes("w-full").props["aria-label"] = "mark that the next click sets"
            with ui.row().classes("no-wrap items-start w-full gap-4"):
                with ui.element("div").classes("w-full"):
                    magnifier = ui.element("canvas").classes("tv-magnifier").props("role=img width=270 height=270")
                    magnifier.props["aria-label"] = "magnified surroundings of a mark"
                    magnifier.props["id"], magnifier.props["data-empty"] = MAGNIFIER_ID, "true"
                    ui.label(NO_MARK).classes("tv-no-mark")
                with ui.column().classes("gap-2 min-w-0"):
                    self._add_sizes()
            with ui.grid(columns="minmax(8rem, auto) 1fr 1fr").classes("items-center gap-2 w-full"):
                for n in CORNER_NAMES:
                    self._add_coordinates(n)
            ui.button("Clear marks", on_click=self.clear_marks).props("flat dense no-caps").classes("self-start")
        self._fill_boxes()

    def _add_sizes(self) -> None:
        """Fields for the size of the block and its direction in the image."""
        second, block = self.facts.second, self.facts.block
        length, height = block or (second[2] if second else DEFAULT_LENGTH_MM, DEFAULT_HEIGHT_MM)
        for name, value in (("length", length), ("height", height)):
            box = ui.number(f"block {name}, mm", value=value, min=0.1, on_change=self._marks_changed)
            self.sizes[name] = box.props("outlined dense")
        self.up = ui.select(
            list(IMAGE_DIRECTIONS), value=self.facts.up or "up", label="up is", on_change=self._marks_changed
        ).classes("w-full")
        self.up.props("outlined dense").tooltip("where away from the road points in the image")

    def _add_coordinates(self, name: str) -> None:
        """Fields for column and row of a mark."""
        ui.label(name).style(f"border-left: 6px solid {MARK_COLOURS[name]}; padding-left: 6px").classes("ft-small")
        for axis, word in enumerate(("column", "row")):
            box = ui.number(word, step=0.1, format="%.2f").props("outlined dense")
            box.props["aria-label"] = f"{name}, {word}"
            box.on("change", lambda name=name: self._place_typed(name))
            self.boxes[name, axis] = box

    def draw_marks(self) -> None:
        """Draw marks and the outline of the block, the same over all frames."""
        marks = [(n, c, r, MARK_COLOURS[n]) for n, (c, r) in self.points.items()]
        self.viewer.show_marks(marks, self.marks.block_outline(), str(self.next.value), self.find_map())

    # --- marks ---------------------------------------------------------------------------------------------
    def _handle_mark(self, name: str, column: float, row: float, released: bool) -> None:
        """Set or move a mark; after the mouse has been released, the next mark is the first that is missing."""
        if name not in CORNER_NAMES:
            return
        self.points[name] = (column, row)
        self._fill_boxes()
        if released:
            self.next.value = next((n for n in CORNER_NAMES if n not in self.points), name)
            self._marks_changed()
        else:
            self.draw_marks()

    def _marks_changed(self) -> None:
        self.draw_marks()
        self.changed()

    def clear_marks(self) -> None:
        """Remove all marks."""
        self.points.clear()
        for box in self.boxes.values():
            box.value = None
        self.next.value = CORNER_NAMES[0]
        self._marks_changed()

    def kept_values(self) -> dict[str, Any]:
        """Marks and size of the block, as the browser keeps them."""
        sizes = {name: box.value for name, box in self.sizes.items()}
        return {"points": {name: list(place) for name, place in self.points.items()}, **sizes, "up": self.up.value}

    def restore(self, kept: Any) -> None:
        """Show marks and size that the browser has kept; what is no mark of this image is left out."""
        if not isinstance(kept, dict):
            return
        points = kept.get("points")
        rows, columns = self.opened.frames.shape[1:]
        for name, place in points.items() if isinstance(points, dict) else ():
            numbers = read_numbers(place, 2)
            if name in CORNER_NAMES and numbers and -1 <= numbers[0] <= columns and -1 <= numbers[1] <= rows:
                self.points[name] = (numbers[0], numbers[1])
        for name, box in self.sizes.items():
            if (size := read_numbers([kept.get(name)], 1)) and size[0] > 0:
                box.value = size[0]
        if kept.get("up") in IMAGE_DIRECTIONS:
            self.up.value = kept["up"]
        self._fill_boxes()
        self.next.value = next((n for n in CORNER_NAMES if n not in self.points), CORNER_NAMES[0])
        self._marks_changed()

    def _fill_boxes(self) -> None:
        for n, place in self.points.items():
            for axis in (0, 1):
                self.boxes[n, axis].value = round(place[axis], 2)

    def _place_typed(self, name: str) -> None:
        """Set a mark from its typed coordinates."""
        column, row = (self.boxes[name, axis].value for axis in (0, 1))
        if column is not None and row is not None:
            self.points[name] = (float(column), float(row))
            self._marks_changed()
