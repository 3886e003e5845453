"""The interactive plots of a run: profiles over x with a choice of time, and what changes over time and repetitions."""

from __future__ import annotations

from typing import Any

import numpy as np
from nicegui import ui

from flashtemp.lab.charts import bar_options, bar_series, chart_options, line_series, show_chart, update_chart
from flashtemp.lab.page_layout import card
from flashtemp.lab.run_data import PLACES, TEMPERATURES, RunData, heat_shares

PLAY_INTERVAL_S = 0.15
MAX_REPETITION_BUTTONS = 12
TIME_LABEL, DISTANCE_LABEL, REPETITION_LABEL = "time (s)", "distance slid (m)", "repetition"


def show_run_charts(data: RunData, summary: dict[str, Any]) -> None:
    """Show all plots of a run."""
    ProfileChart(data).show()
    with ui.element("div").classes("ft-split ft-even"):
        PlacesChart(data).show()
        show_friction(data)
    with ui.element("div").classes("ft-split ft-even"):
        show_run_in(data, summary)
        show_energy(data, summary)


class ProfileChart:
    """Quantities over x at a time that is chosen by a slider, by repetition, or by playing all times."""

    def __init__(self, data: RunData):
        self.data = data
        self.chosen = data.quantities[0]

    def show(self) -> None:
        """Show the chart with its controls."""
        data, last = self.data, len(self.data.time) - 1
        with card("Profile along x", "Drag or use the arrow keys on the slider; scroll in the chart to zoom."):
            with ui.row().classes("items-center gap-4 w-full"):
                names = [q.name for q in data.quantities]
                if len(names) > 1:
                    choice = ui.select(names, value=names[0], label="quantity", on_change=self._choose_quantity)
                    choice.props("outlined dense").classes("w-80 max-w-full")
                self._show_repetitions()
            self.chart = show_chart(self._chart_options(), "profile", "profile along the block at the chosen time")
            with ui.row().classes("items-center gap-3 w-full no-wrap"):
                self.play = ui.button(icon="play_arrow", on_click=self._switch_play)
                self.play.props('flat dense round color=primary aria-label="play all times"')
                self.slider = ui.slider(min=0, max=max(last, 1), value=last, on_change=lambda: self._draw_time())
                self.slider.props('aria-label="time"').set_enabled(last > 0)
                self.label = ui.label().classes("ft-mono ft-small whitespace-nowrap").props("aria-live=polite")
            self.timer = ui.timer(PLAY_INTERVAL_S, self._play_step, active=False)
            self._draw_time()

    def _show_repetitions(self) -> None:
        """Buttons that go to the end of sliding of a repetition."""
        repetitions = self.data.repetitions
        if len(repetitions) < 2:
            return
        ui.label("end of repetition").classes("ft-muted ft-small")
        if len(repetitions) > MAX_REPETITION_BUTTONS:
            chooser = ui.number("repetition", value=repetitions[-1], min=repetitions[0], max=repetitions[-1], step=1)
            chooser.props("outlined dense").classes("w-32")
            chooser.on_value_change(lambda e: self._go_to(int(e.value)) if e.value in repetitions else None)
            return
        with ui.button_group().props("flat").classes("ft-choice"):
            for r in repetitions:
                button = ui.button(str(r), on_click=lambda r=r: self._go_to(r)).props("flat dense")
                button.props["aria-label"] = f"end of repetition {r}"

    def _go_to(self, repetition: int) -> None:
        self.slider.value = self.data.last_index(repetition)

    def _choose_quantity(self, event: Any) -> None:
        self.chosen = self.data.find_quantity(event.value) or self.data.quantities[0]
        update_chart(self.chart, self._chart_options())
        self._draw_time()

    def _chart_options(self) -> dict[str, Any]:
        series = [line_series(label, [], [], k) for k, label in enumerate(self.chosen.curves)]
        return chart_options(series, "x from the leading edge (mm)", self.chosen.axis_label, self.chosen.limits)

    def _draw_time(self) -> None:
        k = int(self.slider.value)
        t, r = self.data.time[k], self.data.repetition[k]
        waits = "" if self.data.sliding[k] else ", not sliding"
        self.label.text = f"t = {t:.4g} s, repetition {r}{waits}"
        for number, (label, (x, values)) in enumerate(self.chosen.curves.items()):
            self.chart.options["series"][number] = line_series(label, x, values[k], number)
        self.chart.update()

    def _switch_play(self) -> None:
        self.timer.active = not self.timer.active
        if self.timer.active and self.slider.value >= len(self.data.time) - 1:
            self.slider.value = 0
        self._draw_play_button()

    def _play_step(self) -> None:
        if self.slider.value >= len(self.data.time) - 1:
            self.timer.active = False
            self._draw_play_button()
        else:
            self.slider.value = self.slider.value + 1

    def _draw_play_button(self) -> None:
        self.play.props["icon"] = "pause" if self.timer.active else "play_arrow"
        self.play.props["aria-label"] = "pause" if self.timer.active else "play all times"


class PlacesChart:
    """Temperature at the edges and in the middle of the block over time, for a curve that is chosen."""

    def __init__(self, data: RunData):
        self.data = data
        temperatures = data.find_quantity(TEMPERATURES)
        x_block = next(iter(temperatures.curves.values()))[0] if temperatures else np.zeros(0)
        curves = temperatures.curves if temperatures else {}
        self.labels = [label for label, (x, _) in curves.items() if np.array_equal(x, x_block)]

    def show(self) -> None:
        """Show the chart with the choice of the curve."""
        with card("Temperature over time", "Grey: not sliding. Dashed lines: a repetition begins."):
            first = self.labels[1 if len(self.labels) > 1 else 0]
            toggle = ui.toggle(self.labels, value=first, on_change=lambda e: self._choose_curve(e.value))
            toggle.props("no-caps dense unelevated toggle-text-color=on-accent").classes("ft-choice")
            self.chart = show_chart(self._chart_options(first), "temperature_over_time",
                                    "temperature at the leading edge, middle and trailing edge over time")  # fmt: skip

    def _choose_curve(self, label: str) -> None:
        update_chart(self.chart, self._chart_options(label))

    def _chart_options(self, label: str) -> dict[str, Any]:
        series = [
            line_series(place, self.data.time, values, k)
            for k, (place, values) in enumerate(self.data.curve_at_places(label).items())
        ]
        mark_repetitions(series, self.data)
        return chart_options(series, TIME_LABEL, "temperature (°C)")


def mark_repetitions(series: list[dict[str, Any]], data: RunData) -> None:
    """Mark the begin of every repetition and the times without sliding in the first series of a chart over time."""
    if not series:
        return
    line = {"lineStyle": {"color": "var(--muted)", "type": "dashed", "width": 1}}
    label = {"formatter": "{b}", "color": "var(--muted)", "fontSize": 11, "position": "end", "distance": 3}
    begins = data.first_times()[1:]
    words = str if len(begins) > 5 else "repetition {}".format
    series[0]["markLine"] = {
        "symbol": "none", "silent": True, "animation": False, **line, "label": label,
        "data": [{"xAxis": t, "name": words(r)} for r, t in begins],
    }  # fmt: skip
    series[0]["markArea"] = {
        "silent": True, "itemStyle": {"color": "var(--sunken)"},
        "data": [[{"xAxis": a}, {"xAxis": b}] for a, b in data.waits()],
    }  # fmt: skip


def show_friction(data: RunData) -> None:
    """Show friction over the distance slid."""
    with card("Friction", "Load-weighted friction coefficient while sliding."):
        on = data.sliding & np.isfinite(data.friction)
        if not on.any():
            ui.label("This run stores no friction.").classes("ft-muted")
            return
        series = [
            line_series(f"repetition {r}", *_relative_distance(data, on & (data.repetition == r)), k)
            for k, r in enumerate(data.repetitions)
        ]
        low, high = float(data.friction[on].min()), float(data.friction[on].max())
        limits = (round(low - 0.1, 1), round(high + 0.1, 1)) if high - low < 1e-3 else None
        options = chart_options(series, "distance in the repetition (m)", "friction coefficient", limits)
        show_chart(options, "friction", "friction over the distance slid in each repetition")


def _relative_distance(data: RunData, inside: Any) -> tuple[Any, Any]:
    """Distance since the begin of a repetition, and friction, of its stored times."""
    slid = data.slid[inside]
    return (slid - slid[0] if len(slid) else slid), data.friction[inside]


def show_run_in(data: RunData, summary: dict[str, Any]) -> None:
    """Show how the end of each repetition changes from repetition to repetition."""
    with card("Run-in", "Block surface at the end of sliding of each repetition."):
        repetitions = data.repetitions
        if len(repetitions) < 2:
            ui.label("One repetition only; give schedule.repetitions = 2 or more to see the run-in.").classes(
                "ft-muted"
            )
            return
        at = [data.last_index(r) for r in repetitions]
        temperatures = data.find_quantity(TEMPERATURES)
        label = list(temperatures.curves)[min(1, len(temperatures.curves) - 1)] if temperatures else ""
        series = [
            line_series(place, repetitions, values[at], k, showSymbol=True, symbolSize=7)
            for k, (place, values) in enumerate(data.curve_at_places(label).items())
        ]
        options = chart_options(series, REPETITION_LABEL, "temperature (°C)")
        options["xAxis"] |= {"minInterval": 1}
        show_chart(options, "run_in", f"temperature at the end of each repetition, {', '.join(PLACES)}")


def show_energy(data: RunData, summary: dict[str, Any]) -> None:
    """Show where the friction heat went, at the end and over time."""
    with card("Energy budget", "Where the friction heat went."):
        shares = heat_shares(summary)
        total = sum(v for v in shares.values() if np.isfinite(v))
        with ui.tabs().props("no-caps dense align=left active-color=primary") as tabs:
            at_end, over_time = (ui.tab(name) for name in ("at the end", "over time"))
        with ui.tab_panels(tabs, value=at_end if total > 0 else over_time).classes("w-full bg-transparent"):
            with ui.tab_panel(at_end).classes("p-0"):
                _show_shares(shares, total)
            with ui.tab_panel(over_time).classes("p-0"):
                series = [line_series(label, data.time, v, k) for k, (label, v) in enumerate(data.ledger.items())]
                mark_repetitions(series, data)
                show_chart(chart_options(series, TIME_LABEL, "heat (kJ per m of width)"), "energy", "heat over time")


def _show_shares(shares: dict[str, float], total: float) -> None:
    if not total > 0:
        ui.label("summary.json of this run holds no energy.").classes("ft-muted")
        return
    percent = {label: 100.0 * value / total for label, value in shares.items()}
    text = {
        "show": True,
        "position": "right",
        "color": "var(--text)",
        ":formatter": "p => p.value[0].toFixed(1) + ' %'",
    }
    series = bar_series("share of the friction heat", list(percent), list(percent.values()), label=text)
    options = bar_options([series], list(percent), "share of the friction heat (%)", 110)
    options["xAxis"] |= {"max": 100, "min": 0, "interval": 20}
    options["grid"] |= {"right": 70}
    show_chart(options, "energy_budget", "shares of the friction heat: " + _list_shares(percent))


def _list_shares(percent: dict[str, float]) -> str:
    return ", ".join(f"{label} {value:.1f} %" for label, value in percent.items())
