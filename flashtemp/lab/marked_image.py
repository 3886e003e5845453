"""The image on which the edges of the block are marked by clicking, dragging or typing, with a magnifier."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import events, ui

from flashtemp.camera.importing.import_options import ImportOptions
from flashtemp.lab.image_marks import CORNER_NAMES, IMAGE_DIRECTIONS, BlockMarks
from flashtemp.lab.opened_frames import OpenedFrames

GRIP_PX = 12.0  # width of a mark that can be dragged, pixels of the page
MAGNIFIER_HALF_PX, MAGNIFIER_ZOOM = 7, 18  # camera pixels each way from the centre, and their magnification
MARK_COLOURS = dict(zip(CORNER_NAMES, ("#00E5FF", "#FFD600", "#76FF03", "#FF4081"), strict=True))
DEFAULT_LENGTH_MM, DEFAULT_HEIGHT_MM = 25.0, 7.0  # of a block, until its size is entered


class MarkedImage:
    """Frames of camera files with marks; `changed` is called when a mark or the size of the block changes."""

    def __init__(self, opened: OpenedFrames, facts: ImportOptions, changed: Callable[[], Any]):
        self.opened, self.facts, self.changed = opened, facts, changed
        self.points: dict[str, tuple[float, float]] = {}
        self.dragged: str | None = None
        self.near, self.middle = CORNER_NAMES[0], (0, 0)
        self.boxes: dict[tuple[str, int], Any] = {}
        if facts.point is not None and len(facts.point) == len(CORNER_NAMES):
            self.points = {n: (p[0], p[1]) for n, p in zip(CORNER_NAMES, facts.point, strict=True)}
        elif facts.pixel is not None and facts.second is not None:
            self.points = {CORNER_NAMES[0]: facts.pixel, CORNER_NAMES[1]: (facts.second[0], facts.second[1])}

    @property
    def marks(self) -> BlockMarks:
        """The marks with the size of the block."""
        length, height = (float(box.value or 1.0) for box in (self.length, self.height))
        return BlockMarks(dict(self.points), length, height, str(self.up.value))

    # --- image and controls -----------------------------------------------------------------------------------
    def show(self) -> None:
        """Show the image with the sliders for frame and colours."""
        low, high = self.opened.preview.span
        rows, columns = self.opened.frames.shape[1:]
        zoom, last = self.opened.zoom, len(self.opened.frames) - 1
        self.value = ui.label("move the mouse over the image to read temperatures").classes("font-mono text-sm")
        self.image = ui.interactive_image(
            self.opened.encode_frame(0, low, high), size=(columns * zoom, rows * zoom), on_mouse=self._handle_mouse,
            events=["mousedown", "mousemove", "mouseup"], cross=True, sanitize=False,
        ).classes("w-full").props('id="image"')  # fmt: skip
        with ui.row().classes("w-full items-center no-wrap"):
            ui.label("frame").classes("w-16")
            self.frame = ui.slider(min=0, max=max(last, 1), value=0, on_change=lambda: self.update_image())
            self.frame.props('aria-label="frame"').set_enabled(last > 0)
            self.when = ui.label().classes("w-64")
        with ui.row().classes("w-full items-center no-wrap"):
            ui.label("colours").classes("w-16")
            step = max(0.01, round((high - low) / 200, 3))
            self.span = ui.range(min=low, max=high, step=step, value={"min": low, "max": high})
            self.span.on_value_change(lambda: self.update_image())
            self.range = ui.label().classes("w-64")
        if words := self.opened.legend:
            ui.label(words).classes("text-sm")

    def show_controls(self) -> None:
        """Show the choice of the next mark, the magnifier, the coordinates, and the size of the block."""
        second, block = self.facts.second, self.facts.block
        ui.label("Position of the block").classes("text-lg font-medium")
        ui.label(
            "Click the leading and the trailing edge at the interface, or all four corners. "
            "To correct a mark, drag it, click in the magnifier or type its coordinates."
        ).classes("text-sm")
        self.next = ui.toggle(list(CORNER_NAMES), value=CORNER_NAMES[min(len(self.points), 1)]).props("dense no-caps")
        with ui.row().classes("no-wrap items-start"):
            side = (2 * MAGNIFIER_HALF_PX + 1) * MAGNIFIER_ZOOM
            self.magnifier = ui.interactive_image(
                "", size=(side, side), on_mouse=self._magnifier_clicked, events=["mousedown"], sanitize=False
            ).classes("w-48 bg-gray-200").props('id="magnifier"')  # fmt: skip
            with ui.column().classes("gap-1"):
                length, height = block or (second[2] if second else DEFAULT_LENGTH_MM, DEFAULT_HEIGHT_MM)
                self.length = ui.number(
                    "block length, mm", value=length, min=0.1, on_change=lambda: self._marks_changed()
                )
                self.height = ui.number(
                    "block height, mm", value=height, min=0.1, on_change=lambda: self._marks_changed()
                )
                self.up = ui.select(
                    list(IMAGE_DIRECTIONS),
                    value=self.facts.up or "up",
                    label="up is",
                    on_change=lambda: self._marks_changed(),
                ).classes("w-32")
        with ui.grid(columns=3).classes("items-center gap-x-2 gap-y-0"):
            for n in CORNER_NAMES:
                ui.label(n).style(f"border-left: 6px solid {MARK_COLOURS[n]}; padding-left: 6px").classes("text-sm")
                for axis, name in enumerate(("column", "row")):
                    box = ui.number(name, step=0.1, format="%.2f").props("dense stack-label")
                    box.props["aria-label"] = f"{n}, {name}"
                    box.on("change", lambda n=n: self._place_typed(n))
                    self.boxes[n, axis] = box
        self._fill_boxes()

    def update_image(self) -> None:
        """Draw the selected frame with marks and outline."""
        k, low, high = int(self.frame.value), *self._colour_range()
        self.image.set_source(self.opened.encode_frame(k, low, high))
        count = len(self.opened.time)
        self.when.text = (
            f"{k}: {self.opened.time[k]:.4g} s after the first" if self.opened.has_times else f"{k} of 0 to {count - 1}"
        )
        self.range.text = f"{low:.2f} to {high:.2f} °C"
        self._draw_overlay()

    def _colour_range(self) -> tuple[float, float]:
        return float(self.span.value["min"]), float(self.span.value["max"])

    def _draw_overlay(self) -> None:
        """Draw marks and the outline of the block, the same over all frames."""

        def at(place: tuple[float, float]) -> tuple[float, float]:
            return (place[0] + 0.5) * self.opened.zoom, (place[1] + 0.5) * self.opened.zoom

        ring = " ".join(f"{x:.2f},{y:.2f}" for x, y in map(at, self.marks.block_outline()))
        parts = (
            [f'<polygon points="{ring}" fill="none" stroke="white" stroke-width="2" stroke-dasharray="8 5"/>']
            if ring
            else []
        )
        for n, place in self.points.items():
            x, y = at(place)
            centre, colour = f'cx="{x:.2f}" cy="{y:.2f}"', MARK_COLOURS[n]
            parts.append(f'<circle {centre} r="{GRIP_PX / 2}" fill="none" stroke="{colour}" stroke-width="2"/>')
            parts.append(f'<circle {centre} r="1" fill="{colour}"/>')
        self.image.content = "".join(parts)

    # --- marks ---------------------------------------------------------------------------------------------
    def _handle_mouse(self, event: events.MouseEventArguments) -> None:
        """Set, grab, move or release a mark, and show the temperature under the cursor."""
        zoom = self.opened.zoom
        c, r = event.image_x / zoom - 0.5, event.image_y / zoom - 0.5
        self.value.text = f"column {c:.1f}, row {r:.1f}: {self.opened.describe_pixel(int(self.frame.value), c, r)}"
        if event.type == "mousedown":
            grips = [n for n, (a, b) in self.points.items() if max(abs(a - c), abs(b - r)) * zoom < GRIP_PX]
            self.dragged = grips[0] if grips else str(self.next.value)
            if not grips:
                self._set_mark(self.dragged, c, r)
        elif event.type == "mousemove" and self.dragged and event.buttons:
            self._set_mark(self.dragged, c, r)
        elif event.type == "mouseup" and self.dragged:
            self.next.value = next((n for n in CORNER_NAMES if n not in self.points), self.dragged)
            self.dragged = None

    def _set_mark(self, name: str, column: float, row: float) -> None:
        self.points[name] = (column, row)
        self._fill_boxes()
        self._show_magnified(name)
        self._marks_changed()

    def _marks_changed(self) -> None:
        self._draw_overlay()
        self.changed()

    def clear_marks(self) -> None:
        """Remove all marks."""
        self.points.clear()
        for box in self.boxes.values():
            box.value = None
        self.next.value = CORNER_NAMES[0]
        self._marks_changed()

    def _fill_boxes(self) -> None:
        for n, place in self.points.items():
            for axis in (0, 1):
                self.boxes[n, axis].value = round(place[axis], 2)

    def _place_typed(self, name: str) -> None:
        """Set a mark from its typed coordinates."""
        column, row = (self.boxes[name, axis].value for axis in (0, 1))
        if column is not None and row is not None:
            self._set_mark(name, float(column), float(row))

    def _show_magnified(self, name: str) -> None:
        """Show the surroundings of a mark in the magnifier."""
        self.near, (c, r) = name, self.points[name]
        self.middle = round(c), round(r)
        self.magnifier.set_source(
            self.opened.encode_detail(
                int(self.frame.value), c, r, *self._colour_range(), MAGNIFIER_HALF_PX, MAGNIFIER_ZOOM
            )
        )
        x, y = ((a - m + MAGNIFIER_HALF_PX + 0.5) * MAGNIFIER_ZOOM for a, m in zip((c, r), self.middle, strict=True))
        side = (2 * MAGNIFIER_HALF_PX + 1) * MAGNIFIER_ZOOM
        self.magnifier.content = (
            f'<path d="M {x:.1f} 0 V {side} M 0 {y:.1f} H {side}" stroke="{MARK_COLOURS[name]}" fill="none"/>'
        )

    def _magnifier_clicked(self, event: events.MouseEventArguments) -> None:
        """Move the magnified mark to a click in the magnifier."""
        if self.near in self.points:
            c, r = ((at / MAGNIFIER_ZOOM - 0.5 - MAGNIFIER_HALF_PX) for at in (event.image_x, event.image_y))
            self._set_mark(self.near, c + self.middle[0], r + self.middle[1])
