"""Live pictures of a watched test: whether the data suffice, the latest frame, and the evidence as frames arrive."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from nicegui import ui

from flashtemp.discovery.criteria import CRITERIA
from flashtemp.display import format_count
from flashtemp.lab.charts import chart_options, line_series, show_chart, update_chart
from flashtemp.lab.heat_image import DIFFERENCE_PALETTE, HeatImage, find_limits, read_field
from flashtemp.lab.live_state import LiveState, number_list
from flashtemp.lab.live_table import LiveTable
from flashtemp.lab.workspace import escape_control

MAX_EFFECTS_DRAWN, MAX_EFFECTS_LISTED, MAX_FILES_NAMED = 4, 10, 3
LEAST_DIFFERENCE_K = 0.1  # half width of the colour scale of differences, at least
IMAGES = {"measured": "Measured", "computed": "Computed by the stated model", "difference": "Measured − computed"}
HEADINGS = ("hypothesis", "ln Bayes factor so far", "expected so far, if it acts", "expected in the end")
NO_FRAME = "No frame has been compared yet: the watch waits for the first camera file."
DECIDED_NOTE, UNDECIDED_NOTE = "ft-note good", "ft-note warning"


class LiveWatchPanel:
    """The answer, the images, two charts and a table that `update` draws anew."""

    def __init__(self) -> None:
        self.answer = ui.label(NO_FRAME).classes(UNDECIDED_NOTE).props("role=status")
        self.facts = ui.label().classes("ft-muted ft-small")
        self.files = ui.label().classes("ft-small ft-optional")
        self.caption = ui.label().classes("ft-small text-weight-medium")
        with ui.element("div").classes("ft-images") as self.images:
            self.pictures = {key: self._add_image(key, words) for key, words in IMAGES.items()}
        with ui.element("div").classes("ft-split") as self.charts:
            with ui.element("div").classes("min-w-0"):
                self.line_caption = ui.label().classes("ft-small")
                about = "measured and computed temperature of the latest frame"
                self.lines = show_chart(chart_options([], "", ""), "latest_frame", about)
            with ui.element("div").classes("min-w-0"):
                ui.label("Evidence as frames arrive, against the stated model").classes("ft-small")
                about = "ln Bayes factor of the leading hypotheses over the number of frames"
                self.evidence = show_chart(chart_options([], "", ""), "evidence", about)
        self.table = LiveTable()

    def _add_image(self, key: str, words: str) -> HeatImage:
        """One of the three images with its caption."""
        with ui.element("div").classes("min-w-0"):
            ui.label(words).classes("ft-small")
            if key == "difference":
                return HeatImage("measured minus computed temperature", DIFFERENCE_PALETTE, "K")
            return HeatImage(f"{key} temperature of the latest frame")

    def update(self, state: LiveState) -> None:
        """Draw the state of a watch."""
        watch = LiveState({"watch": state.find_value("watch")})
        is_decided = watch.find_value("watch", "decided") is True
        self.answer.text = describe_answer(watch)
        self.answer.classes(replace=DECIDED_NOTE if is_decided else UNDECIDED_NOTE)
        self.facts.text = describe_watch(watch)
        self.files.text = describe_left_files(watch)
        self.files.set_visibility(bool(self.files.text))
        self.charts.set_visibility(bool(watch.rows("watch", "history")))
        self._update_images(watch)
        self._update_lines(watch)
        self._update_evidence(watch)
        self.table.show_rows(HEADINGS, hypothesis_cells(watch))

    def _update_images(self, watch: LiveState) -> None:
        """Draw the latest frame; recordings of one row have lines only."""
        self.caption.text = describe_frame(watch)
        fields = {key: read_field(watch.find_value("watch", "latest", key)) for key in IMAGES}
        measured, computed, difference = fields.values()
        if measured is None or computed is None or difference is None:
            self.images.set_visibility(False)
            return
        self.images.set_visibility(True)
        size = watch.number("watch", "latest", "length"), watch.number("watch", "latest", "height")
        both = find_limits(measured, computed)
        half = round_up(max(LEAST_DIFFERENCE_K, float(np.nanpercentile(np.abs(difference), 99.5))))
        for key, field, limits in (
            ("measured", measured, both), ("computed", computed, both), ("difference", difference, (-half, half)),
        ):  # fmt: skip
            self.pictures[key].show(field, limits, size)

    def _update_lines(self, watch: LiveState) -> None:
        """Draw measured values as dots and computed ones as lines."""
        is_image = watch.number("watch", "latest", "height") is not None
        self.line_caption.text = "Lowest compared row of the image" if is_image else "Latest values"
        series = []
        for k, row in enumerate(watch.rows("watch", "latest", "lines")):
            x, name = number_list(row.get("x")), str(row.get("name") or "")
            words = {key: f"{name}, {key}" if name else key for key in ("measured", "computed")}
            for key, more in (
                ("measured", {"showSymbol": True, "symbolSize": 4, "lineStyle": {"opacity": 0}}), ("computed", {}),
            ):  # fmt: skip
                y = number_list(row.get(key))
                n = min(len(x), len(y))
                # dots and line of one image differ in colour; those of a sensor share it
                number = k if name else int(key == "computed")
                series.append(line_series(words[key], x[:n], y[:n], number, **more))
        axis = escape_control(watch.text("watch", "latest", "axis"))
        update_chart(self.lines, chart_options(series, axis, "temperature (°C)"))

    def _update_evidence(self, watch: LiveState) -> None:
        """Draw ln Bayes factors over the number of frames, with the value at which an effect is named."""
        series = evidence_series(watch)
        if series:
            threshold = {"symbol": "none", "silent": True, "data": [{"yAxis": CRITERIA.ln_bayes_named}]}
            style = {"lineStyle": {"color": "var(--text)", "type": "dashed"}, "label": {"show": False}}
            series[0]["markLine"] = threshold | style
        label = "ln Bayes factor (dashed: an effect is named)"
        options = chart_options(series, "frames so far", label)
        options["xAxis"]["minInterval"] = 1
        update_chart(self.evidence, options)


def round_up(value: float) -> float:
    """The smallest 1, 2 or 5 times a power of ten that is at least a value above 0.

    >>> round_up(0.63), round_up(0.1), round_up(21.0)
    (1.0, 0.1, 50.0)
    """
    size = 10.0 ** math.floor(math.log10(value) + 1e-9)
    return next(size * step for step in (1.0, 2.0, 5.0, 10.0) if size * step >= value * (1.0 - 1e-9))


def evidence_series(watch: LiveState) -> list[dict[str, Any]]:
    """Lines of the leading hypotheses: ln Bayes factor over the number of frames."""
    history = watch.rows("watch", "history")
    ranked = [h for h in watch.rows("watch", "hypotheses") if not h.get("reason")][:MAX_EFFECTS_DRAWN]
    frames = number_list([entry.get("frames") for entry in history])
    out = []
    for k, name in enumerate(str(h.get("effect")) for h in ranked):
        factors = [e.get("ln_bayes") for e in history]
        values = number_list([f.get(name) if isinstance(f, dict) else None for f in factors])
        out.append(line_series(name, frames, values, k, showSymbol=True, symbolSize=6))
    return out


def describe_answer(watch: LiveState) -> str:
    """Whether the data suffice, as a sentence."""
    says = watch.text("watch", "says")
    if not watch.rows("watch", "history") or not says:
        return NO_FRAME
    return escape_control(says[0].upper() + says[1:] + ".")


def describe_watch(watch: LiveState) -> str:
    """How many files and frames have been imported, and which hypothesis leads."""
    recordings = watch.rows("watch", "recordings")
    frames = _sum_numbers(r.get("frames") for r in recordings)
    files = sum(len(r["files"]) for r in recordings if isinstance(r.get("files"), list))
    counts = [format_count(n, what) for n, what in ((files, "camera file"), (frames, "frame"))]
    words = [f"{counts[0]} imported, {counts[1]} in {format_count(len(recordings), 'recording')}"]
    if leader := watch.text("watch", "leader", "hypothesis"):
        factor = watch.number("watch", "leader", "ln_bayes")
        words.append(f"leading: {escape_control(leader)}" + ("" if not factor else f", ln Bayes factor {factor:.1f}"))
    if watch.text("watch", "state") not in ("", "watching"):
        words.append("the watch has ended")
    return " · ".join(words)


def _sum_numbers(values: Any) -> int:
    return int(sum(v for v in number_list(list(values)) if math.isfinite(v)))


def describe_left_files(watch: LiveState) -> str:
    """Camera files that are not imported, with the reason of each."""
    words = []
    for row in watch.rows("watch", "recordings"):
        for state in ("waiting", "refused"):
            reasons = row.get(state)
            for name, reason in list(reasons.items())[:MAX_FILES_NAMED] if isinstance(reasons, dict) else ():
                words.append(f"{name} is {state}: {reason}")
    return escape_control(" · ".join(words))


def describe_frame(watch: LiveState) -> str:
    """Which frame is shown, and how far it is from the stated model."""
    name = watch.text("watch", "latest", "recording")
    if not name:
        return ""
    time, number = watch.number("watch", "latest", "time_s"), watch.number("watch", "latest", "repetition")
    words = [f"Latest frame of {name}"]
    if time is not None and number is not None:
        words.append(f"repetition {number:.0f}, t = {time:.4g} s")
    row = next((r for r in watch.rows("watch", "recordings") if r.get("file") == name), {})
    rms = LiveState(row)
    if (plain := rms.number("rmse_K")) is not None:
        words.append(f"all frames differ by {plain:.3g} K rms from the stated model")
    if (fitted := rms.number("calibrated_rmse_K")) is not None:
        words.append(f"{fitted:.3g} K with all nuisance parameters estimated")
    return escape_control(" · ".join(words))


def hypothesis_cells(watch: LiveState) -> list[list[str]]:
    """Cells of the table of hypotheses, the most probable first; those that cannot be tested say why."""
    out = []
    for row in watch.rows("watch", "hypotheses")[:MAX_EFFECTS_LISTED]:
        state, reason = LiveState(row), row.get("reason")
        values = [state.number(key) for key in ("ln_bayes", "expected_now", "expected_in_the_end")]
        cells = ["" if v is None else f"{v:,.1f}" for v in values]
        out.append([str(row.get("effect")), *([str(reason), "", ""] if reason else cells)])
    return out
