"""The results of comparisons, plans, sweeps and sensitivity studies: main numbers, plots and tables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from nicegui import ui

from flashtemp.errors import BadInput
from flashtemp.lab.charts import bar_options, bar_series, chart_options, line_series, show_chart, update_chart
from flashtemp.lab.comparison_result import show_comparison
from flashtemp.lab.conditions import show_conditions
from flashtemp.lab.friction_results import FILES, show_friction_result
from flashtemp.lab.page_layout import card, page_address, refuse_damaged, show_errors
from flashtemp.lab.result_files import ResultFolder, open_dataset
from flashtemp.lab.result_parts import (
    MAX_ROWS,
    MainNumber,
    folded_part,
    load_later,
    number_text,
    record_list,
    refuse_unreadable,
    show_answer,
    show_table,
    stored_number,
)
from flashtemp.lab.result_sentences import describe_plan, describe_sensitivity
from flashtemp.lab.start_button import CommandStarter
from flashtemp.lab.workspace import escape_control

MAX_SWEEP_BYTES = 256 * 2**20
MAX_SERIES = 12
MAX_AXIS_LABEL = 40  # characters that fit along the height of a chart
MIN_SIGNAL = 0.1  # signal-to-noise ratio; smaller ones are drawn as this
DETECTION_LIMIT = 5.0  # signal-to-noise ratio from which an effect counts as distinguished


def show_study(result: ResultFolder, starter: CommandStarter) -> None:
    """Show the result of a study by the command that made it.  Raises BadInput for a damaged file."""
    shown: dict[str, Callable[[ResultFolder, dict[str, Any]], None]] = {
        "compare": partial(show_comparison, starter=starter), "plan": show_plan, "sensitivity": show_sensitivity,
    }  # fmt: skip
    if result.command in FILES:
        with refuse_damaged(result.path):
            show_friction_result(result)
    show = shown.get(result.command)
    if show is not None:
        file = f"{result.command}.json"
        data = result.read_json(file)
        with refuse_damaged(result.path / file):
            show(result, data)
    elif result.command == "sweep":
        load_later(result.folder, "the sweep", lambda: read_sweep(result), lambda stored: SweepCharts(stored).show())
    with show_errors(result.folder), refuse_unreadable(f"{result.name}/case.toml"):
        values = result.read_case()
        if values:
            show_conditions(result, values, starter)


# --- plan --------------------------------------------------------------------------------------------------
def show_plan(result: ResultFolder, data: dict[str, Any]) -> None:
    """Show which effects planned data can tell apart, and which measurement to add."""
    effects = sorted(record_list(data.get("effects")), key=lambda e: -stored_number(e.get("z_left")))
    proposals = [*record_list(data.get("experiments")), *record_list(data.get("sensors"))]
    good = [e for e in effects if e.get("separable")]
    helpful = [p for p in proposals if p.get("helps")]
    remark = str(helpful[0].get("words", "")) if helpful else "no single addition tells more effects apart"
    show_answer(describe_plan(data), [
        MainNumber("Can be told apart", f"{len(good)} of {len(effects)}", "effects"),
        MainNumber("Additions that help", f"{len(helpful)} of {len(proposals)}", "proposals", remark),
    ])  # fmt: skip
    if effects:
        with card(
            "Signal of every effect", "Signal-to-noise ratio with all others free; from 5 an effect is told apart."
        ):
            _show_signals(effects)
            with folded_part("All numbers"):
                head = (
                    "effect",
                    "signal alone",
                    "with all others free",
                    "detectable at 5 sigma",
                    "nearest",
                    "correlation",
                )
                rows = [
                    (_effect_text(e.get("effect")), number_text(e.get("z")), number_text(e.get("z_left")),
                     f"{number_text(e.get('detectable'))} {e.get('unit') if e.get('unit') != '1' else ''}",
                     _effect_text(e.get("nearest")), number_text(e.get("rho")))
                    for e in effects
                ]  # fmt: skip
                show_table(head, rows, "effects", numbers=(1, 2, 3, 5))
    with card("What to measure in addition", "The proposals, the most useful first."):
        additions = [
            (str(p.get("words")), ", ".join(map(_effect_text, p.get("helps") or ())) or "nothing more")
            for p in proposals
        ]
        if additions:
            show_table(("one more condition or sensor", "then told apart"), additions, "proposals")
        else:
            ui.label("Nothing further would tell more effects apart.").classes("ft-muted")
        ui.link("Open the campaigns", page_address("campaign"))


def _show_signals(effects: Sequence[dict[str, Any]]) -> None:
    """Bars of the signal of every effect on a logarithmic axis, with the limit of detection."""
    labels = [_effect_text(e.get("effect")) for e in effects]
    values = [max(stored_number(e.get("z_left")), MIN_SIGNAL) for e in effects]
    line = {"symbol": "none", "silent": True, "lineStyle": {"color": "var(--text)", "type": "dashed"},
            "data": [{"xAxis": DETECTION_LIMIT}], "label": {"color": "var(--text)", "formatter": "5"}}  # fmt: skip
    series = [bar_series("signal-to-noise ratio", labels, values, 1, markLine=line)]
    options = bar_options(series, labels, "signal-to-noise ratio with all other effects free", 200)
    options["xAxis"] |= {"type": "log", "min": MIN_SIGNAL, "startValue": MIN_SIGNAL}
    chart = show_chart(options, "signals", "signal-to-noise ratio of every effect")
    chart.style(f"height: {100 + 22 * len(labels)}px")


def _effect_text(name: Any) -> str:
    return escape_control(str(name)).replace("_", " ")


# --- sensitivity -------------------------------------------------------------------------------------------
def show_sensitivity(result: ResultFolder, data: dict[str, Any]) -> None:
    """Show the predicted numbers with their 95 % bands, and which input decides each."""
    named = list(dict(data.get("numbers") or {}).items())[:MAX_ROWS]
    numbers = {str(k): v for k, v in named if isinstance(v, dict)}
    show_answer(describe_sensitivity(data), [_band_number(n) for n in list(numbers.values())[:6]])
    if not numbers:
        raise BadInput(f"{result.name}/sensitivity.json: holds no numbers; run `flashtemp sensitivity` again")
    with card(
        "What every input does", "Share of the variance of the chosen number, and its change per standard deviation."
    ):
        labels = {name: escape_control(str(n.get("words", name))) for name, n in numbers.items()}
        place = ui.column().classes("w-full items-stretch")

        def draw(name: str) -> None:
            place.clear()
            with place, show_errors(result.folder), refuse_damaged(result.path / "sensitivity.json"):
                _show_shares(numbers[name], record_list(data.get("inputs")))

        choice = ui.select(labels, value=next(iter(labels)), label="number", on_change=lambda e: draw(e.value))
        choice.props("outlined dense").classes("w-96 max-w-full").move(target_index=2)
        draw(next(iter(labels)))
    if result.find_file("run.nc") is not None:
        from flashtemp.lab.run_data import read_run
        from flashtemp.lab.run_result import ProfileChart

        load_later(result.folder, "the profiles", lambda: read_run(result), lambda run: ProfileChart(run).show())


def _band_number(n: dict[str, Any]) -> MainNumber:
    low, high = (list(n.get("band95") or ()) + [None, None])[:2]
    unit = str(n.get("unit", "")).replace("degC", "°C")
    return MainNumber(str(n.get("words", "")), number_text(n.get("value")), "" if unit == "1" else unit,
                      f"95 %: {number_text(low)} to {number_text(high)}")  # fmt: skip


def _show_shares(number: dict[str, Any], inputs: Sequence[dict[str, Any]]) -> None:
    """Bars of the first-order and total share of the variance of a number, the largest first."""
    total, first, slopes = (dict(number.get(k) or {}) for k in ("total", "first_order", "per_sd"))
    keys = sorted((str(i.get("key")) for i in inputs), key=lambda k: -stored_number(total.get(k)))[:20]
    series = [
        bar_series("total", keys, [100 * stored_number(total.get(k)) for k in keys], 0),
        bar_series("first order", keys, [100 * stored_number(first.get(k)) for k in keys], 1),
    ]
    chart = show_chart(
        bar_options(series, keys, "share of the variance (%)", 200), "sensitivity", "shares of the variance"
    )
    chart.style(f"height: {110 + 36 * len(keys)}px")
    about = {str(i.get("key")): i for i in inputs}
    unit = "" if number.get("unit") == "1" else f" {str(number.get('unit')).replace('degC', 'K')}"
    rows = [
        (k, number_text(about[k].get("value")), number_text(about[k].get("sd")), str(about[k].get("unit", "")),
         f"{number_text(slopes.get(k))}{unit}", str(about[k].get("reason", "")))
        for k in keys
    ]  # fmt: skip
    show_table(("input", "value", "sd", "unit", "change per sd", "why this sd"), rows, "inputs", numbers=(1, 2, 4))


# --- sweep -------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class SweepData:
    """A sweep: `axes` {key: values}, `numbers` {label with unit: values over all axes}, `profiles` {label: values over
    all axes, repetitions and places}."""

    title: str
    axes: dict[str, np.ndarray]
    numbers: dict[str, np.ndarray]
    profiles: dict[str, np.ndarray]


def read_sweep(result: ResultFolder) -> SweepData:
    """The content of sweep.nc.  Raises BadInput for a damaged file."""
    file = result.find_file("sweep.nc")
    if file is None:
        raise BadInput(f"{result.name}: has no sweep.nc")
    with open_dataset(file, MAX_SWEEP_BYTES) as data:
        keys = [str(d) for d in data["T_max_degC"].dims]
        axes = {key: np.asarray(data[key].values) for key in keys}
        numbers, profiles = {}, {}
        for name in map(str, data.data_vars):
            unit = str(data[name].attrs.get("units", "")).replace("degC", "°C")
            words = str(data[name].attrs.get("long_name", name)).replace("_", " ")
            label = escape_control(f"{words} ({unit})" if unit not in ("", "1") else words)
            dims = [str(d) for d in data[name].dims]
            if dims == keys:
                numbers[label] = np.asarray(data[name].values, float)
            elif dims == [*keys, "repetition"]:
                numbers[f"{label}, last repetition"] = np.asarray(data[name].values[..., -1], float)
            elif dims == [*keys, "repetition", "place"]:
                profiles[label] = np.asarray(data[name].values, float)
        return SweepData(escape_control(str(data.attrs.get("title", ""))), axes, numbers, profiles)


class SweepCharts:
    """Numbers of a sweep over its first key, a line per value of the second, and the profiles along the block."""

    def __init__(self, data: SweepData):
        self.data = data
        self.keys = list(data.axes)

    def show(self) -> None:
        """Show the main numbers, then both charts with their choices."""
        data = self.data
        numbers = self._main_numbers()
        extremes = " and ".join(f"{n.value} {n.unit} at {n.remark}" for n in numbers[1:3] if n.unit)
        show_answer([f"The highest temperature is between {extremes}."] if extremes else [], numbers)
        with card("Numbers over the swept keys"), ui.row().classes("items-center gap-3 w-full"):
            names = list(data.numbers)
            number = ui.select(names, value=names[0], label="number", on_change=lambda e: self._draw_numbers(e.value))
            number.props("outlined dense").classes("w-96 max-w-full")
            with ui.element("div").classes("w-full"):
                self.numbers = show_chart(self._number_options(names[0]), "sweep", "a number over the swept keys")
        if data.profiles:
            with card("Profiles", "At the end of the last repetition."), ui.row().classes("items-center gap-3 w-full"):
                names = list(data.profiles)
                profile = ui.select(
                    names, value=names[0], label="quantity", on_change=lambda e: self._draw_profiles(e.value)
                )
                profile.props("outlined dense").classes("w-96 max-w-full")
                with ui.element("div").classes("w-full"):
                    self.profiles = show_chart(
                        self._profile_options(names[0]), "sweep_profiles", "profiles of the sweep"
                    )

    def _main_numbers(self) -> list[MainNumber]:
        hottest = next(iter(self.data.numbers.values()))
        out = [MainNumber("Combinations", str(hottest.size), "", " × ".join(self.keys))]
        if np.isfinite(hottest).any():
            for words, at in (("Hottest", np.nanargmax(hottest)), ("Coolest", np.nanargmin(hottest))):
                where = self._point_text(np.unravel_index(int(at), hottest.shape))
                out.append(MainNumber(words, number_text(float(hottest.flat[int(at)])), "°C", where))
        failed = int((~np.isfinite(hottest)).sum())
        return [*out, MainNumber("Failed", str(failed), "", "see sweep.csv")] if failed else out

    def _point_text(self, index: Sequence[Any]) -> str:
        from flashtemp.viz.key_labels import describe_key

        parts = [describe_key(key).describe_value(_plain_value(self.data.axes[key][i]))
                 for key, i in zip(self.keys, index, strict=True)]  # fmt: skip
        return escape_control(", ".join(parts))

    def _number_options(self, name: str) -> dict[str, Any]:
        from flashtemp.viz.key_labels import describe_key

        values, label = self.data.numbers[name], describe_key(self.keys[0])
        x = self.data.axes[self.keys[0]]
        is_number = np.issubdtype(x.dtype, np.number)
        places = label.factor * x.astype(float) if is_number else np.arange(len(x), dtype=float)
        lines = values.reshape(len(x), -1)[:, :MAX_SERIES]
        symbols = {"showSymbol": True, "symbolSize": 7}
        series = [
            line_series(self._other_text(k, values.shape[1:]) or name, places, lines[:, k], k, **symbols)
            for k in range(lines.shape[1])
        ]
        options = chart_options(series, label.label, _axis_label(name))
        if not is_number:
            options["xAxis"] |= {"type": "category", "data": [escape_control(str(v)) for v in x]}
        return options

    def _other_text(self, k: int, shape: tuple[int, ...]) -> str:
        """The values of all keys but the first at flat index k."""
        from flashtemp.viz.key_labels import describe_key

        index = np.unravel_index(k, shape) if shape else ()
        parts = [describe_key(key).describe_value(_plain_value(self.data.axes[key][i]))
                 for key, i in zip(self.keys[1:], index, strict=True)]  # fmt: skip
        return escape_control(", ".join(parts))

    def _profile_options(self, name: str) -> dict[str, Any]:
        values = self.data.profiles[name][..., -1, :]
        shape, flat = values.shape[:-1], values.reshape(-1, values.shape[-1])[:MAX_SERIES]
        places = np.linspace(0.0, 1.0, values.shape[-1])
        series = [
            line_series(self._point_text(np.unravel_index(k, shape)), places, row, k) for k, row in enumerate(flat)
        ]
        return chart_options(series, "position along the block, x/L", _axis_label(name))

    def _draw_numbers(self, name: str) -> None:
        update_chart(self.numbers, self._number_options(name))

    def _draw_profiles(self, name: str) -> None:
        update_chart(self.profiles, self._profile_options(name))


def _axis_label(name: str) -> str:
    """The name of an axis: that of the quantity, or what its unit measures where that is too long.

    >>> _axis_label("cells"), _axis_label("block surface, averaged across y, at the end of each repetition (°C)")
    ('cells', 'temperature (°C)')
    """
    if len(name) <= MAX_AXIS_LABEL:
        return name
    unit = name.rpartition("(")[2].rstrip(")") if name.endswith(")") else ""
    return {"°C": "temperature (°C)", "K": "temperature rise (K)", "Pa": "pressure (Pa)"}.get(
        unit, name[:MAX_AXIS_LABEL]
    )


def _plain_value(value: Any) -> Any:
    return value.item() if hasattr(value, "item") else value
