"""Live pictures of a run: the temperature along the block, its course over time, and the field of the block."""

from __future__ import annotations

from base64 import b64encode
from io import BytesIO
from typing import Any

import numpy as np
from nicegui import ui

from flashtemp.lab.charts import chart_options, line_series, show_chart
from flashtemp.lab.live_state import MAX_ROWS, LiveState, number_list

HEAT_PALETTE = (  # black to yellow in equal steps of lightness ("inferno")
    (0, 0, 4), (40, 11, 84), (101, 21, 110), (159, 42, 99), (212, 72, 66), (245, 125, 21), (250, 193, 39),
    (252, 255, 164),
)  # fmt: skip
COURSES = {"leading": "leading edge", "middle": "middle", "trailing": "trailing edge"}
PROFILES = {"T_block": "block face", "T_spot": "contact spots"}
MAX_FIELD_SIDE = 1000  # rows and columns of a picture that is drawn


class LiveRunPanel:
    """Three pictures that `update` draws anew."""

    def __init__(self) -> None:
        self.facts = ui.label().classes("ft-muted")
        with ui.element("div").classes("ft-split"):
            with ui.element("div").classes("min-w-0"):
                self._show_field_place()
                profile = [line_series(words, [], [], k) for k, words in enumerate(PROFILES.values())]
                options = chart_options(profile, "x from the leading edge (mm)", "temperature (°C)")
                self.profile = show_chart(options, "profile", "temperature along the block at the latest recorded time")
            with ui.element("div").classes("min-w-0"):
                ui.label("Block face over time").classes("ft-small")
                course = [line_series(words, [], [], k) for k, words in enumerate(COURSES.values())]
                options = chart_options(course, "time (s)", "temperature (°C)")
                self.course = show_chart(options, "course", "temperature of the block's face over time at three places")

    def _show_field_place(self) -> None:
        """The place of the picture of the block, above the profile with the same x."""
        self.caption = ui.label("Section of the block").classes("ft-small")
        with ui.element("figure").classes("ft-field"):
            self.image = ui.element("img").props('alt="temperature in the section of the block"')
            with ui.element("div").classes("ft-field-scale"):
                self.coldest = ui.label()
                ui.element("div").classes("ft-field-bar").style(f"background:{_palette_gradient()}")
                self.hottest = ui.label()

    def update(self, state: LiveState) -> None:
        """Draw the state of a run."""
        run = LiveState({"run": state.find_value("run")})
        self.facts.text = describe_run(run)
        x = run.numbers("run", "x")
        self._set_lines(self.profile, [(x, run.numbers("run", name)) for name in PROFILES])
        time = run.numbers("run", "history", "time")
        self._set_lines(self.course, [(time, run.numbers("run", "history", name)) for name in COURSES])
        self._update_field(run)

    def _set_lines(self, chart: Any, lines: list[tuple[list[float], list[float]]]) -> None:
        for k, (x, y) in enumerate(lines):
            n = min(len(x), len(y))
            old = chart.options["series"][k]
            old["data"] = line_series("", x[:n], y[:n])["data"]
        chart.update()

    def _update_field(self, run: LiveState) -> None:
        field = read_field(run.find_value("run", "field", "T"))
        if field is None:
            return
        length, height = run.number("run", "field", "length"), run.number("run", "field", "height")
        size = f" ({length:g} mm x {height:g} mm)" if length and height else ""
        time = run.number("run", "time")
        self.caption.text = f"Section of the block{size} at t = {time or 0.0:.4g} s, and its face below"
        self.image.props["src"] = draw_field(field)
        if length and height:
            self.image.style(f"aspect-ratio:{length:g}/{height:g}")
        self.image.update()
        self.coldest.text, self.hottest.text = f"{np.nanmin(field):.1f} °C", f"{np.nanmax(field):.1f} °C"


def describe_run(run: LiveState) -> str:
    """Time, repetition and highest temperatures of a run in words."""
    t, end = run.number("run", "time"), run.number("run", "end")
    if t is None or end is None:
        return "The solver is being prepared."
    now, count = run.number("run", "repetition") or 0, run.number("run", "repetitions") or 0
    doing = "sliding" if run.find_value("run", "sliding") is True else "waiting"
    words = [f"t = {t:.4g} of {end:.4g} s", f"repetition {now:.0f} of {count:.0f}, {doing}"]
    spots = [v for v in run.numbers("run", "history", "spots") if np.isfinite(v)]
    if spots:
        words.append(f"hottest spot so far {max(spots):.1f} °C")
    if (steps := run.number("run", "steps")) is not None:
        words.append(f"{steps:.0f} time steps")
    return " · ".join(words)


def read_field(rows: Any) -> np.ndarray | None:
    """A field (rows, columns) in degC, None where it is not a table of numbers."""
    if not isinstance(rows, list) or not rows or len(rows) > MAX_FIELD_SIDE:
        return None
    values = [number_list(row) for row in rows if isinstance(row, list)]
    width = len(values[0]) if values else 0
    is_table = 0 < width <= min(MAX_FIELD_SIDE, MAX_ROWS) and all(len(row) == width for row in values)
    field = np.array(values) if is_table else None
    return field if field is not None and np.isfinite(field).any() else None


def draw_field(field: np.ndarray) -> str:
    """A picture of a field (rows, columns) as an address of its data."""
    from PIL import Image

    low, high = float(np.nanmin(field)), float(np.nanmax(field))
    share = np.nan_to_num((field - low) / max(high - low, 1e-9))
    steps = np.linspace(0.0, 1.0, len(HEAT_PALETTE))
    colours = np.stack([np.interp(share, steps, channel) for channel in zip(*HEAT_PALETTE, strict=True)], axis=-1)
    data = BytesIO()
    Image.fromarray(colours.round().astype(np.uint8)).save(data, "PNG")
    return "data:image/png;base64," + b64encode(data.getvalue()).decode("ascii")


def _palette_gradient() -> str:
    colours = ", ".join(f"rgb({r} {g} {b})" for r, g, b in HEAT_PALETTE)
    return f"linear-gradient(to right, {colours})"
