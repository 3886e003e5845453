"""Fields of temperature as pictures on a page: a palette, a picture of a field, and its scale of colours."""

from __future__ import annotations

from base64 import b64encode
from io import BytesIO
from typing import Any

import numpy as np
from nicegui import ui

from flashtemp.lab.live_state import MAX_ROWS, number_list

Palette = tuple[tuple[int, int, int], ...]
HEAT_PALETTE: Palette = (  # black to yellow in equal steps of lightness ("inferno")
    (0, 0, 4), (40, 11, 84), (101, 21, 110), (159, 42, 99), (212, 72, 66), (245, 125, 21), (250, 193, 39),
    (252, 255, 164),
)  # fmt: skip
DIFFERENCE_PALETTE: Palette = (  # blue to red with white at zero
    (33, 102, 172), (103, 169, 207), (209, 229, 240), (247, 247, 247), (253, 219, 199), (239, 138, 98), (178, 24, 43),
)  # fmt: skip
MAX_FIELD_SIDE = 1000  # rows and columns of a picture that is drawn


class HeatImage:
    """A picture of a field with its scale below; `about` is the text for screen readers."""

    def __init__(self, about: str, palette: Palette = HEAT_PALETTE, unit: str = "°C"):
        self.palette, self.unit = palette, unit
        with ui.element("figure").classes("ft-field") as self.figure:
            self.image = ui.element("img")
            self.image.props["alt"] = about
            with ui.element("div").classes("ft-field-scale"):
                self.lowest = ui.label()
                ui.element("div").classes("ft-field-bar").style(f"background:{_palette_gradient(palette)}")
                self.highest = ui.label()

    def show(self, field: np.ndarray, limits: tuple[float, float], size: tuple[float | None, float | None]) -> None:
        """Show a field (rows, columns) between limits; `size` is its length and height in any unit."""
        length, height = size
        self.image.props["src"] = draw_field(field, limits, self.palette)
        if length and height:
            self.image.style(f"aspect-ratio:{length:g}/{height:g}")
        self.image.update()
        self.lowest.text, self.highest.text = (f"{limit:.4g} {self.unit}" for limit in limits)


def read_field(rows: Any) -> np.ndarray | None:
    """A field (rows, columns) in degC, None where it is not a table of numbers."""
    if not isinstance(rows, list) or not rows or len(rows) > MAX_FIELD_SIDE:
        return None
    values = [number_list(row) for row in rows if isinstance(row, list)]
    width = len(values[0]) if values else 0
    is_table = 0 < width <= min(MAX_FIELD_SIDE, MAX_ROWS) and all(len(row) == width for row in values)
    field = np.array(values) if is_table else None
    return field if field is not None and np.isfinite(field).any() else None


def find_limits(*fields: np.ndarray) -> tuple[float, float]:
    """The lowest and the highest value of fields."""
    return min(float(np.nanmin(f)) for f in fields), max(float(np.nanmax(f)) for f in fields)


def draw_field(field: np.ndarray, limits: tuple[float, float] | None = None, palette: Palette = HEAT_PALETTE) -> str:
    """A picture of a field (rows, columns) as an address of its data; a pixel without a value is transparent."""
    from PIL import Image

    low, high = limits or find_limits(field)
    known = np.isfinite(field)
    fraction = np.clip(np.where(known, field - low, 0.0) / max(high - low, 1e-9), 0.0, 1.0)
    steps = np.linspace(0.0, 1.0, len(palette))
    colours = [np.interp(fraction, steps, channel) for channel in zip(*palette, strict=True)]
    data = BytesIO()
    picture = np.stack([*colours, 255.0 * known], axis=-1)
    Image.fromarray(picture.round().astype(np.uint8)).save(data, "PNG")
    return "data:image/png;base64," + b64encode(data.getvalue()).decode("ascii")


def _palette_gradient(palette: Palette) -> str:
    """The palette as a gradient of CSS."""
    return f"linear-gradient(90deg,{','.join(f'rgb{colour}' for colour in palette)})"
