"""Interactive line charts of all pages: values under the pointer, zoom, and export as PNG, SVG and CSV.

Charts are drawn as SVG with the colours of the style sheet, so that they follow the light or dark scheme.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from nicegui import ui

from flashtemp.lab.page_layout import add_script, script_literal
from flashtemp.lab.workspace import escape_control

N_SERIES_COLOURS = 5  # --series-1 ... --series-5 of the style sheet
MAX_CHART_POINTS = 5000  # of a line; longer ones are thinned to their extremes, so that no peak is lost
AXIS_STYLE: dict[str, Any] = {
    "type": "value",
    "scale": True,
    "nameLocation": "middle",
    "nameTextStyle": {"color": "var(--text)", "fontSize": 13},
    "axisLabel": {"color": "var(--muted)", "fontSize": 12},
    "axisLine": {"show": True, "lineStyle": {"color": "var(--line)"}},
    "splitLine": {"lineStyle": {"color": "var(--line)", "opacity": 0.6}},
}
EXPORTS = ("PNG", "SVG", "CSV")


def line_series(name: str, x: Any, y: Any, number: int = 0, **more: Any) -> dict[str, Any]:
    """A line through the finite points of x and y (n,), in the colour of that number; `more` are keys of ECharts."""
    colour = f"var(--series-{number % N_SERIES_COLOURS + 1})"
    style = {"lineStyle": {"color": colour, "width": 2}, "itemStyle": {"color": colour}}
    return {
        "type": "line",
        "name": escape_control(name),
        "showSymbol": False,
        "data": chart_points(x, y),
        **style,
        **more,
    }


def bar_series(name: str, labels: Sequence[str], values: Any, number: int = 0, **more: Any) -> dict[str, Any]:
    """A bar for the finite value (n,) of each label (n,), in the colour of that number; `more` are keys of ECharts."""
    values = np.asarray(values, float)
    data = [[escape_control(str(a)), float(b)] for a, b in zip(labels, values, strict=True) if np.isfinite(b)]
    colour = {"color": f"var(--series-{number % N_SERIES_COLOURS + 1})"}
    return {"type": "bar", "name": escape_control(name), "data": data, "itemStyle": colour, "barMaxWidth": 28, **more}


def chart_points(x: Any, y: Any) -> list[list[float]]:
    """Finite points (x, y) as a list; of more than MAX_CHART_POINTS the extremes of equal parts."""
    x, y = np.asarray(x, float), np.asarray(y, float)
    finite = np.isfinite(x) & np.isfinite(y)
    x, y = x[finite], y[finite]
    if len(x) > MAX_CHART_POINTS:
        parts = np.array_split(np.arange(len(x)), MAX_CHART_POINTS // 2)
        kept = np.unique([k for p in parts for k in (p[np.argmin(y[p])], p[np.argmax(y[p])])])
        x, y = x[kept], y[kept]
    return [[float(a), float(b)] for a, b in zip(x, y, strict=True)]


def chart_options(
    series: Sequence[dict[str, Any]], x_label: str, y_label: str, y_range: tuple[float, float] | None = None
) -> dict[str, Any]:
    """Options of ECharts for lines over common axes: labels with units, values under the pointer, zoom by dragging."""
    low, high = y_range or (None, None)
    return {
        "animation": False,
        "textStyle": {"fontFamily": "inherit", "color": "var(--text)"},
        "grid": {"left": 64, "right": 24, "top": 40 if len(series) > 1 else 16, "bottom": 52},
        "tooltip": {
            "trigger": "axis", "backgroundColor": "var(--surface)", "borderColor": "var(--line)",
            "textStyle": {"color": "var(--text)"}, "axisPointer": {"lineStyle": {"color": "var(--muted)"}},
            ":valueFormatter": "v => v === undefined ? '' : String(Number(Number(v).toPrecision(5)))",
        },
        "legend": {"show": len(series) > 1, "top": 4, "type": "scroll", "itemGap": 22,
                   "textStyle": {"color": "var(--text)", "padding": [0, 6, 0, 0]},
                   "pageTextStyle": {"color": "var(--text)"}},
        "xAxis": {"name": escape_control(x_label), "nameGap": 30, **AXIS_STYLE},
        "yAxis": {"name": escape_control(y_label), "nameGap": 46, "min": low, "max": high, **AXIS_STYLE},
        "dataZoom": [{"type": "inside", "filterMode": "none", axis: 0} for axis in ("xAxisIndex", "yAxisIndex")],
        "series": list(series),
    }  # fmt: skip


def bar_options(
    series: Sequence[dict[str, Any]], labels: Sequence[str], value_label: str, label_width: int = 180
) -> dict[str, Any]:
    """Options of ECharts for horizontal bars, the first label at the top; `label_width` is the room of labels in px."""
    options = chart_options([_swap_axes(s) for s in series], value_label, "")
    category = {
        "type": "category",
        "data": [escape_control(str(label)) for label in labels],
        "inverse": True,
        "nameGap": 12,
    }
    label_style = {**AXIS_STYLE["axisLabel"], "width": label_width, "overflow": "truncate"}
    options["yAxis"] = {**options["yAxis"], **category, "axisLabel": label_style, "splitLine": {"show": False}}
    options["xAxis"] = {**options["xAxis"], "scale": False}
    options["grid"] = {**options["grid"], "left": label_width + 20}
    options["dataZoom"] = []
    options["tooltip"] = {**options["tooltip"], "axisPointer": {"type": "none"}}
    return options


def _swap_axes(series: dict[str, Any]) -> dict[str, Any]:
    """A series with its points (y, x), for bars along x."""
    return series | {"data": [[b, a] for a, b in series["data"]]}


def update_chart(chart: Any, options: dict[str, Any]) -> None:
    """Draw a shown chart with other options."""
    chart.options.clear()
    chart.options.update(options)
    chart.update()


def show_chart(
    options: dict[str, Any], name: str, about: str, on_point_click: Callable[[Any], Any] | None = None,
    exports: Iterable[str] = EXPORTS,
) -> Any:  # fmt: skip
    """Show a chart with its export buttons; `name` is the stem of exported files, `about` the text for screen readers.

    Returns the chart: its `options` can be changed, `update()` then draws them.  A double click restores the zoom.
    """
    add_script("charts.js")
    with ui.element("figure").classes("w-full m-0"):
        chart = ui.echart(options, on_point_click=on_point_click, renderer="svg").classes("w-full h-80")
        chart.props["role"], chart.props["aria-label"] = "img", about
        chart.on("dblclick", js_handler=f"() => restoreZoom({chart.id})")
        with ui.row().classes("gap-1 justify-end w-full ft-noprint"):
            for kind in exports:
                button = ui.button(kind).props("flat dense size=sm color=primary")
                button.props["aria-label"] = f"save {name} as {kind}"
                button.on("click", js_handler=f"() => exportChart({chart.id}, '{kind}', {script_literal(name)})")
    return chart
