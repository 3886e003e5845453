"""The result of a comparison: how well the model explains the data, the plot that shows it, and the next step."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from nicegui import ui

from flashtemp.lab.campaign_lookup import find_campaign
from flashtemp.lab.charts import bar_options, bar_series, chart_options, line_series, show_chart, update_chart
from flashtemp.lab.key_units import describe_value, find_param
from flashtemp.lab.page_layout import card, note, page_address
from flashtemp.lab.result_files import ResultFolder
from flashtemp.lab.result_parts import (
    MainNumber,
    number_text,
    record_list,
    show_answer,
    show_table,
    stored_number,
    text_list,
)
from flashtemp.lab.result_sentences import describe_comparison, describe_peak, find_worst, grade_comparison, grade_entry
from flashtemp.lab.start_button import CommandStarter
from flashtemp.lab.workspace import escape_control

GRADE_WORDS = {
    "good": "the model explains the data",
    "warning": "small, but not random",
    "error": "the model does not explain the data",
}
AXES = {"x_mm": "x from the leading edge (mm)", "time_s": "time (s)"}


def show_comparison(result: ResultFolder, data: dict[str, Any], starter: CommandStarter) -> None:
    """Show the answer, the plot, the next step, and the numbers of every recording and load-cell series."""
    recordings, forces = record_list(data.get("recordings")), record_list(data.get("forces"))
    grade = grade_comparison(data)
    _show_answer(data, grade)
    profiles = {str(r.get("file")): r for r in recordings if isinstance(r.get("profile"), dict)}
    with ui.element("div").classes("ft-split side" if profiles else "ft-stack"):
        if profiles:
            ProfileCard(profiles, find_worst(recordings)).show()
        _show_next_step(result, data, grade, starter)
    if recordings:
        _show_recordings(recordings)
    if forces:
        with card("Load cell", "Friction coefficient measured and computed."):
            names = ("series", "rms", "mean", "chi2/dof")
            keys = ("rmse", "bias", "chi2_per_dof")
            show_table(names, [(str(f.get("file")), *(number_text(f.get(k)) for k in keys)) for f in forces],
                       "load-cell series", numbers=(1, 2, 3))  # fmt: skip


# --- answer ------------------------------------------------------------------------------------------------
def _show_answer(data: dict[str, Any], grade: str) -> None:
    recordings = record_list(data.get("recordings"))
    sentences = describe_comparison(data) or ["Nothing is compared in this result."]
    worst = find_worst(recordings)
    explained = sum(grade_entry(r) == "good" for r in recordings)
    numbers = [
        MainNumber("Largest misfit", number_text(worst.get("rmse_K")), "K rms", str(worst.get("file", ""))),
        MainNumber("Explained within the noise", f"{explained} of {len(recordings)}", "recordings"),
        MainNumber("Largest chi2/dof", number_text(worst.get("chi2_per_dof")), "", "1: noise explains everything"),
        MainNumber("Energy error", number_text(data.get("energy_imbalance")), "", "of all heat that moved"),
    ]
    show_answer(sentences, numbers, grade, GRADE_WORDS[grade])
    for line in text_list(data.get("warnings")):
        note(line, "warning")


# --- plot and next step ------------------------------------------------------------------------------------
class ProfileCard:
    """Temperature measured and computed where the chosen recording differs most."""

    def __init__(self, recordings: Mapping[str, dict[str, Any]], first: Mapping[str, Any]):
        self.recordings = recordings
        name = str(first.get("file"))
        self.chosen = name if name in recordings else next(iter(recordings))

    def show(self) -> None:
        """Show the chart with the choice of the recording."""
        with card("Measured and computed", "Through the largest difference; scroll in the chart to zoom."):
            if len(self.recordings) > 1:
                names = {name: escape_control(name) for name in self.recordings}
                choice = ui.select(
                    names, value=self.chosen, label="recording", on_change=lambda e: self._choose(e.value)
                )
                choice.props("outlined dense").classes("w-80 max-w-full")
            self.chart = show_chart(self._chart_options(), "measured_and_computed", "temperature measured and computed")
            self.place = ui.label(self._place_text()).classes("ft-muted ft-small").props("aria-live=polite")

    def _choose(self, name: str) -> None:
        self.chosen = name
        update_chart(self.chart, self._chart_options())
        self.place.set_text(self._place_text())

    def _chart_options(self) -> dict[str, Any]:
        profile = self.recordings[self.chosen]["profile"]
        at, measured, computed = (profile.get(key) for key in ("at", "measured_degC", "computed_degC"))
        dots = {"showSymbol": True, "symbolSize": 5, "lineStyle": {"width": 0}}
        series = [line_series("measured", at, measured, 0, **dots), line_series("computed", at, computed, 1)]
        return chart_options(series, AXES.get(str(profile.get("over")), ""), "temperature (°C)")

    def _place_text(self) -> str:
        profile = self.recordings[self.chosen]["profile"]
        if point := profile.get("point"):
            return escape_control(f"{self.chosen}, point {point}")
        parts = [(profile.get("v_mm"), {"wake": "y"}.get(str(self.recordings[self.chosen].get("view")), "z"), "mm"),
                 (profile.get("time_s"), "t", "s")]  # fmt: skip
        words = [f"{name} = {number_text(value)} {unit}" for value, name, unit in parts if value is not None]
        return escape_control(", ".join([self.chosen, *words]))


def _show_next_step(result: ResultFolder, data: dict[str, Any], grade: str, starter: CommandStarter) -> None:
    """What to do with this answer: ask what is missing, or nothing."""
    entries = [*record_list(data.get("recordings")), *record_list(data.get("forces"))]
    campaign = find_campaign(result.folder, [str(e.get("file")) for e in entries], str(data.get("title", "")))
    with card("What to do next"):
        if grade == "good":
            ui.label("There is nothing to explain: the case as stated agrees with these data.")
        else:
            ui.label("Find out which effect, or which stated input, explains the difference.")
        if campaign is None:
            ui.label("The campaign of this result is not in the folder.").classes("ft-muted")
            ui.link("All campaigns", page_address("campaign"))
            return
        if grade != "good":
            starter.show("Ask what is missing", "discover", campaign, main=True)
        with ui.row().classes("gap-4"):
            ui.link("Open the campaign", page_address("campaign", open=campaign))
            if grade == "good":
                ui.link("Plan a measurement", page_address("runs", command="plan", of=campaign))


# --- numbers -----------------------------------------------------------------------------------------------
def _show_recordings(recordings: list[dict[str, Any]]) -> None:
    """Bars and a table of the difference of every recording."""
    with card("Misfit of every recording", "Measured minus computed, for the case as stated."):
        files = [escape_control(str(r.get("file"))) for r in recordings]
        series = [
            bar_series("root mean square", files, [stored_number(r.get("rmse_K")) for r in recordings], 0),
            bar_series("mean", files, [stored_number(r.get("bias_K")) for r in recordings], 1),
        ]
        chart = show_chart(bar_options(series, files, "difference (K)", 210), "misfit", "misfit of every recording")
        chart.style(f"height: {110 + 44 * len(files)}px")
        head = ("recording", "conditions", "rms (K)", "mean (K)", "times the noise", "largest difference")
        rows = [
            (str(r.get("file")), _describe_conditions(r.get("with")), number_text(r.get("rmse_K")),
             number_text(r.get("bias_K")), number_text(math.sqrt(max(stored_number(r.get("chi2_per_dof")), 0.0))),
             describe_peak(r) or "–")
            for r in recordings
        ]  # fmt: skip
        show_table(head, rows, "recordings", numbers=(2, 3, 4))


def _describe_conditions(overrides: Any) -> str:
    """The conditions of a recording in words, with the units of the campaign page."""
    words = []
    for key, value in (overrides if isinstance(overrides, dict) else {}).items():
        param = find_param(None, key)
        text = str(value) if param is None else describe_value(value, param)
        words.append(f"{key.removeprefix('schedule.').replace('.', ' ').replace('_', ' ')} {text}")
    return ", ".join(words) or "as in the case"
