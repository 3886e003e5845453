"""Several runs in one plot, with the conditions and main numbers that differ; the address holds the choice."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from nicegui import run, ui

from flashtemp.errors import BadInput, FlashtempError
from flashtemp.lab.charts import chart_options, line_series, show_chart, update_chart
from flashtemp.lab.conditions import describe_values, different_keys
from flashtemp.lab.page_layout import PAGE_ADDRESSES, card, heading, show_error
from flashtemp.lab.result_files import ResultFolder, open_result
from flashtemp.lab.result_parts import show_table
from flashtemp.lab.run_data import RunData, main_numbers, read_run
from flashtemp.lab.workspace import escape_control, list_folder

MAX_CHOICES = 40  # runs offered for comparison
MAX_COMPARED = 8
KEY_SEPARATOR = " · "  # between the quantity and the curve
OVER_X, OVER_TIME, OVER_REPETITIONS = "along x, end of a repetition", "trailing edge over time", "over repetitions"
FRICTION_CURVE = "friction"


@dataclass(frozen=True)
class ComparedRun:
    """One run of the comparison: its profiles, the numbers of summary.json, and the keys of its case."""

    result: ResultFolder
    data: RunData
    summary: dict[str, Any]
    values: Mapping[str, Any]


def comparison_address(name: str, others: Sequence[str]) -> str:
    """The address of a run beside others."""
    first = PAGE_ADDRESSES.get("result", "/result")
    return f"{first}?open={quote(name)}" + "".join(f"&with={quote(other)}" for other in others)


def read_compared(folder: Path, name: str) -> ComparedRun:
    """One run with all that the comparison shows.  Raises BadInput."""
    result = open_result(folder, name)
    if result.command != "run":
        raise BadInput(f"{result.name}: not a run; choose results of `flashtemp run`")
    return ComparedRun(result, read_run(result), result.read_json("summary.json"), result.read_case())


class RunComparison:
    """A card with the runs of the folder to choose from, and what the chosen ones show side by side."""

    def __init__(self, result: ResultFolder):
        self.result = result
        self.runs: dict[str, ComparedRun] = {}
        self.chosen: list[str] = []

    def show(self, others: Sequence[str]) -> None:
        """Show the list of runs with `others` chosen."""
        found = [str(p) for p, command in list_folder(self.result.folder).results.items() if command == "run"]
        names = [name for name in found if name != str(self.result.here) and escape_control(name) == name]
        asked = [name for name in dict.fromkeys(others) if name != str(self.result.here)][:MAX_COMPARED]
        offered = list(dict.fromkeys([*asked, *names]))[:MAX_CHOICES]
        self.chosen = asked
        with card("Compare with other runs", "" if offered else "Further runs of this folder can be chosen here."):
            if offered:
                with ui.row().classes("gap-x-4 gap-y-0"):
                    for name in offered:
                        box = ui.checkbox(escape_control(name), value=name in asked)
                        box.on_value_change(lambda e, name=name: self._choose_run(name, bool(e.value)))
            if len(names) > MAX_CHOICES:
                ui.label(f"and {len(names) - MAX_CHOICES} more; add with=NAME to the address").classes("ft-muted")
            self.place = ui.column().classes("w-full items-stretch gap-4")
        if asked:
            ui.timer(0.05, self._draw_comparison, once=True)

    async def _choose_run(self, name: str, wanted: bool) -> None:
        self.chosen = [n for n in self.chosen if n != name] + ([name] if wanted else [])
        ui.navigate.history.replace(comparison_address(str(self.result.here), self.chosen))
        await self._draw_comparison()

    async def _draw_comparison(self) -> None:
        """Read the chosen runs that were not read yet, and draw all of them."""
        if len(self.chosen) > MAX_COMPARED:
            self._show_faults([f"At most {MAX_COMPARED} runs fit into one plot; clear a box."])
            return
        faults = []
        for name in ([str(self.result.here)] if self.chosen else []) + list(self.chosen):
            if name not in self.runs:
                try:
                    self.runs[name] = await run.io_bound(read_compared, self.result.folder, name)
                except (FlashtempError, OSError) as fault:
                    faults.append(str(fault))
        shown = [self.runs[n] for n in [str(self.result.here), *self.chosen] if n in self.runs]
        self._show_faults(faults)
        if self.chosen and len(shown) > 1:
            with self.place:
                ComparisonChart(shown).show()
                show_differences(shown)

    def _show_faults(self, faults: Sequence[str]) -> None:
        self.place.clear()
        with self.place:
            for fault in faults:
                show_error(fault, self.result.folder)


class ComparisonChart:
    """One quantity of several runs in one plot: along x, over time, or over the repetitions."""

    def __init__(self, runs: Sequence[ComparedRun]):
        self.runs = runs
        self.curves = list(
            dict.fromkeys(_curve_key(q.name, c) for r in runs for q in r.data.quantities for c in q.curves)
        )
        self.last = max(max(r.data.repetitions) for r in runs)

    def show(self) -> None:
        """Show the plot with its choices."""
        usual = next((c for c in self.curves if c.endswith("block, averaged across y")), self.curves[0])
        with ui.row().classes("items-center gap-3 w-full"):
            self.curve = ui.select([*self.curves, FRICTION_CURVE], value=usual, label="quantity", on_change=self._draw)
            self.curve.props("outlined dense").classes("w-80 max-w-full")
            self.over = ui.select(
                [OVER_X, OVER_TIME, OVER_REPETITIONS], value=OVER_X, label="plot", on_change=self._draw
            )
            self.over.props("outlined dense").classes("w-64")
            self.repetition = ui.number(
                "repetition", value=self.last, min=1, max=self.last, step=1, on_change=self._draw
            )
            self.repetition.props("outlined dense").classes("w-28")
        self.chart = show_chart(self._chart_options(), "comparison", "one quantity of several runs")

    def _draw(self) -> None:
        self.repetition.set_visibility(self.over.value == OVER_X and self.curve.value != FRICTION_CURVE)
        update_chart(self.chart, self._chart_options())

    def _chart_options(self) -> dict[str, Any]:
        quantity, _, curve = self.curve.value.partition(KEY_SEPARATOR)
        series, unit = [], ""
        for k, compared in enumerate(self.runs):
            points = self._curve_points(compared.data, quantity, curve)
            if points is not None:
                x, y, unit = points
                symbols = {"showSymbol": True, "symbolSize": 7} if len(x) < 30 and self.over.value != OVER_X else {}
                series.append(line_series(compared.result.name, x, y, k, **symbols))
        x_label = {OVER_X: "x from the leading edge (mm)", OVER_TIME: "time (s)", OVER_REPETITIONS: "repetition"}
        label = (
            x_label[self.over.value]
            if quantity != FRICTION_CURVE or self.over.value == OVER_REPETITIONS
            else "time (s)"
        )
        return chart_options(series, label, f"{curve or quantity} ({unit})" if unit else curve or quantity)

    def _curve_points(self, data: RunData, quantity: str, curve: str) -> tuple[Any, Any, str] | None:
        """x, y and unit of a curve of one run; None where the run does not have it."""
        ends = [data.last_index(r) for r in data.repetitions]
        if quantity == FRICTION_CURVE:
            if self.over.value != OVER_REPETITIONS:
                return data.time, np.where(data.sliding, data.friction, np.nan), ""
            return data.repetitions, [data.mean_friction(r) for r in data.repetitions], ""
        found = data.find_quantity(quantity)
        if found is None or curve not in found.curves:
            return None
        x, values = found.curves[curve]
        if self.over.value == OVER_TIME:
            return data.time, values[:, -1], found.unit
        if self.over.value == OVER_REPETITIONS:
            return data.repetitions, values[ends, -1], found.unit
        wanted = int(self.repetition.value or self.last)
        return x, values[data.last_index(wanted if wanted in data.repetitions else data.repetitions[-1])], found.unit


def _curve_key(quantity: str, curve: str) -> str:
    return f"{quantity}{KEY_SEPARATOR}{curve}"


def show_differences(runs: Sequence[ComparedRun]) -> None:
    """Tables of the conditions that differ between runs, and of their main numbers."""
    names = [compared.result.here.name for compared in runs]
    with ui.element("div").classes("ft-split"):
        with ui.column().classes("gap-2 items-stretch"):
            heading(3, "Conditions that differ")
            keys = different_keys([compared.values for compared in runs])
            described = [describe_values(compared.values) for compared in runs]
            rows = [[key, *(d[key].value if key in d else "–" for d in described)] for key in keys]
            if rows:
                show_table(["key", *names], rows, "conditions that differ", range(1, len(names) + 1))
            else:
                ui.label("All keys of the cases are equal.").classes("ft-muted")
        with ui.column().classes("gap-2 items-stretch"):
            heading(3, "Main numbers")
            numbers = [main_numbers(compared.summary) for compared in runs]
            rows = [
                [f"{row[0].label} ({row[0].unit})" if row[0].unit else row[0].label, *(n.value for n in row)]
                for row in zip(*numbers, strict=True)
            ]
            show_table(["number", *names], rows, "main numbers of the runs", range(1, len(names) + 1))
