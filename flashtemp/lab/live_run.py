"""Live pictures of a run: the temperature along the block, its course over time, and the field of the block."""

from __future__ import annotations

from typing import Any

import numpy as np
from nicegui import ui

from flashtemp.lab.charts import chart_options, line_series, show_chart
from flashtemp.lab.heat_image import HeatImage, find_limits, read_field
from flashtemp.lab.live_state import LiveState

COURSES = {"leading": "leading edge", "middle": "middle", "trailing": "trailing edge"}
PROFILES = {"T_block": "block face", "T_spot": "contact spots"}


class LiveRunPanel:
    """Three pictures that `update` draws anew."""

    def __init__(self) -> None:
        self.facts = ui.label().classes("ft-muted")
        with ui.element("div").classes("ft-split"):
            with ui.element("div").classes("min-w-0"):
                self.caption = ui.label("Section of the block").classes("ft-small")
                self.section = HeatImage("temperature in the section of the block")
                profile = [line_series(words, [], [], k) for k, words in enumerate(PROFILES.values())]
                options = chart_options(profile, "x from the leading edge (mm)", "temperature (°C)")
                self.profile = show_chart(options, "profile", "temperature along the block at the latest recorded time")
            with ui.element("div").classes("min-w-0"):
                ui.label("Block face over time").classes("ft-small")
                course = [line_series(words, [], [], k) for k, words in enumerate(COURSES.values())]
                options = chart_options(course, "time (s)", "temperature (°C)")
                self.course = show_chart(options, "course", "temperature of the block's face over time at three places")

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
        self.section.show(field, find_limits(field), (length, height))


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
