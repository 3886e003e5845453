"""The results of friction theory: friction over speed, contact area, load dependence, tread block and tyre."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from nicegui import ui

from flashtemp.lab.charts import bar_options, bar_series, chart_options, line_series, show_chart, update_chart
from flashtemp.lab.page_layout import card
from flashtemp.lab.result_files import ResultFolder
from flashtemp.lab.result_parts import (
    MainNumber,
    folded_part,
    number_text,
    percent_change,
    record_list,
    show_answer,
    show_list,
    show_table,
    stored_number,
    text_list,
)
from flashtemp.lab.result_sentences import SENTENCES
from flashtemp.lab.workspace import escape_control

FILES = {
    "friction": ("friction.json", "area.json"),
    "loads": ("loads.json",),
    "tread": ("tread.json",),
    "tyre": ("tyre.json",),
}
DOTS = {"showSymbol": True, "symbolSize": 8, "lineStyle": {"width": 0}}
MAX_LINEAR_AREA = 1.5  # of the linear law that is drawn, as a fraction of the nominal area
CONTROL_WORDS = {"law": "cold-hot law", "cold": "both cold", "hot": "both hot"}


def show_friction_result(result: ResultFolder) -> None:
    """Show the answer, the plots and the remarks of a result of friction theory.  Raises BadInput."""
    file = next((name for name in FILES[result.command] if result.find_file(name) is not None), "")
    data = result.read_json(file) if file else {}
    show_answer(SENTENCES[file](data) if file else [], _main_numbers(data))
    plots: dict[str, Callable[[Mapping[str, Any]], None]] = {
        "friction.json": _show_curves,
        "area.json": _show_area,
        "loads.json": _show_load_dependence,
        "tread.json": _show_tread,
        "tyre.json": _show_tyre,
    }
    if file:
        plots[file](data)
    remarks = [
        *text_list(data.get("remarks")),
        *([f"not modelled: {data['not_modelled']}"] if data.get("not_modelled") else []),
    ]
    if remarks:
        with card("Remarks"):
            show_list([text[:1].upper() + text[1:] + "." for text in remarks])


def _main_numbers(data: Mapping[str, Any]) -> list[MainNumber]:
    """The conditions that these results share, those that are stored."""
    rows = (
        ("Temperature", "T0_degC", 1.0, "°C"),
        ("Nominal pressure", "pressure_Pa", 1e-6, "MPa"),
        ("Contact region", "spot_diameter_m", 1e3, "mm"),
        ("Rms slope of the road", "rms_slope", 1.0, ""),
        ("Modulus at rest", "modulus_Pa", 1e-6, "MPa"),
        ("Time in contact", "contact_time_s", 1e3, "ms"),
    )
    return [
        MainNumber(label, number_text(factor * stored_number(data.get(key))), unit)
        for label, key, factor, unit in rows
        if math.isfinite(stored_number(data.get(key)))
    ]


def _log_axis(options: dict[str, Any]) -> dict[str, Any]:
    """The options with a logarithmic x axis."""
    options["xAxis"] |= {"type": "log"}
    return options


def _show_curves(data: Mapping[str, Any]) -> None:
    """Friction and the highest temperature over speed."""
    curves = dict(data.get("curves") or {})
    speed = curves.get("speed_m_s") or []
    names = {
        "mu_cold": "cold",
        "mu_hot": "hot",
        "viscous_hot": "hot, viscoelastic part",
        "adhesive_hot": "hot, adhesive part",
    }
    with ui.element("div").classes("ft-split ft-even"):
        with card("Friction over speed", "Cold: without the heat of the contact. Hot: in the steady state with it."):
            series = [
                line_series(words, speed, curves[key], k)
                for k, (key, words) in enumerate(names.items())
                if key in curves
            ]
            options = _log_axis(chart_options(series, "sliding speed (m/s)", "friction coefficient"))
            show_chart(options, "friction", "friction over speed, cold and hot")
        with card("Temperature of the contact", "Highest temperature of a contact region, hot."):
            series = [line_series("highest temperature", speed, curves.get("T_hot_degC") or [])]
            options = _log_axis(chart_options(series, "sliding speed (m/s)", "temperature (°C)"))
            show_chart(options, "contact_temperature", "highest temperature over speed")


def _show_area(data: Mapping[str, Any]) -> None:
    """The contact area over pressure, and its linear law."""
    with card("Contact area over pressure", "Elastic contact on this road, and the linear law of light contact."):
        at, found = data.get("p_over_E") or [], map(stored_number, data.get("linear") or [])
        linear = [v if v <= MAX_LINEAR_AREA else math.nan for v in found]  # beyond it the law says nothing
        series = [
            line_series("area in contact", at, data.get("area") or [], 0),
            line_series("linear law", at, linear, 1),
        ]
        options = chart_options(series, "nominal pressure over modulus, p/E", "fraction of the area in contact")
        show_chart(_log_axis(options), "contact_area", "contact area over pressure")


def _show_load_dependence(data: Mapping[str, Any]) -> None:
    """Which process changes friction from the lowest to the highest load, at every speed."""
    shares, words = dict(data.get("ln_shares") or {}), dict(data.get("words") or {})
    acting = [str(name) for name in text_list(data.get("acting")) if name in shares]
    speeds = [number_text(v) for v in data.get("speed_m_s") or []]
    labels = [escape_control(str(words.get(name, name))) for name in acting]
    with card("What makes friction depend on load", "Change from the lowest to the highest load, by process."):
        series = [
            bar_series(f"at {v} m/s", labels, [percent_change(stored_number(shares[n][k])) for n in acting], k)
            for k, v in enumerate(speeds)
        ]
        chart = show_chart(
            bar_options(series, labels, "change of friction (%)", 230), "loads", "change of friction by process"
        )
        chart.style(f"height: {110 + 30 * len(labels) * max(len(speeds), 1)}px")


def _show_tread(data: Mapping[str, Any]) -> None:
    """Friction of the footprint over slip, and the passage at the slips that are listed."""
    curve, slips = dict(data.get("curve") or {}), record_list(data.get("slips"))
    with card("Friction over slip", "Mean of the footprint; dots: slips of the table below."):
        series = [
            line_series("friction", curve.get("slip") or [], curve.get("friction") or [], 0),
            line_series(
                "slips of the table",
                [stored_number(s.get("slip")) for s in slips],
                [stored_number(s.get("friction_law")) for s in slips],
                1,
            )
            | DOTS,
        ]
        show_chart(chart_options(series, "slip", "friction of the footprint"), "tread", "friction over slip")
        head = (
            "slip",
            "slides (mm)",
            "speed at exit (m/s)",
            "friction at exit",
            "cold 0 to hot 1",
            "highest T (°C)",
            "mean friction",
        )
        keys = (
            ("slip", 1.0),
            ("slid_m", 1e3),
            ("speed_at_exit_m_s", 1.0),
            ("mu_at_exit", 1.0),
            ("from_cold_to_hot", 1.0),
            ("T_max_degC", 1.0),
            ("friction", 1.0),
        )
        rows = [tuple(number_text(f * stored_number(s.get(key))) for key, f in keys) for s in slips]
        show_table(head, rows, "slips", numbers=range(len(head)))


def _show_tyre(data: Mapping[str, Any]) -> None:
    """Side force over slip angle for every load, by the chosen model, and the highest forces."""
    curves, loads = dict(data.get("curves") or {}), [number_text(v) for v in data.get("loads_N") or []]
    names = {name: _curve_words(str(name)) for name in curves}
    angles = data.get("angles_deg") or []

    def options_of(name: str) -> dict[str, Any]:
        series = [
            line_series(f"{load} N", angles, row, k)
            for k, (load, row) in enumerate(zip(loads, curves[name], strict=False))
        ]
        return _log_axis(chart_options(series, "slip angle (°)", "side force over load"))

    if not names:
        return
    with card("Side force over slip angle", "A line for every load."):
        first = next((name for name in names if name == "brush, law"), next(iter(names)))
        choice = ui.select(names, value=first, label="model").props("outlined dense").classes("w-80 max-w-full")
        chart = show_chart(options_of(first), "tyre", "side force over slip angle for every load")
        choice.on_value_change(lambda e: update_chart(chart, options_of(e.value)))
        with folded_part("Highest side forces"):
            _show_maxima(record_list(data.get("maxima")))


def _show_maxima(maxima: Sequence[Mapping[str, Any]]) -> None:
    rows = [
        (
            _curve_words(f"{m.get('model')}, {m.get('law')}"),
            number_text(m.get("load_N")),
            number_text(m.get("mu")),
            f"{number_text(m.get('angle_deg'))}{' (still rising)' if m.get('at_last') else ''}",
        )
        for m in maxima
    ]
    show_table(
        ("model", "load (N)", "side force over load", "slip angle (°)"), rows, "highest forces", numbers=(1, 2, 3)
    )


def _curve_words(name: str) -> str:
    """The name of a curve in words.

    >>> _curve_words("brush, law"), _curve_words("rigid, cold")
    ('brush model, cold-hot law', 'rigid model, both cold')
    """
    model, _, law = name.partition(", ")
    return escape_control(f"{model} model, {CONTROL_WORDS.get(law, law)}")
