"""The page of a result: report and pictures; of a run T(x) over time with a slider, and the block in space."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from nicegui import ui

from flashtemp.errors import BadInput
from flashtemp.lab.folder import inside
from flashtemp.lab.shared import file_address

PICTURES = (".png", ".gif", ".svg")
CURVES = {"T_spot": "in the contact spots", "T_block": "block, averaged across y", "T_road": "road"}


def result_page(folder: Path, name: str) -> None:
    """What a result folder, or a recording, holds.  Raises BadInput."""
    path = inside(folder, name)
    if not path.is_dir():
        raise BadInput(f"{name}: no such result; choose one on the page of the folder")
    ui.label(name).classes("text-xl")
    if (path / "run.nc").is_file():
        _profiles(path / "run.nc")
        _in_space(path)
    if (path / "report.html").is_file():
        address = file_address(Path(name) / "report.html")
        ui.link("report in a tab of its own", address, new_tab=True)
        style = "width:100%;height:80vh;border:1px solid #ccc"
        ui.html(f'<iframe src="{address}" title="report" style="{style}"></iframe>', sanitize=False).classes("w-full")
    _numbers(path)
    pictures = sorted(p for p in path.iterdir() if p.suffix in PICTURES)
    with ui.row().classes("w-full gap-4"):
        for picture in pictures:
            with ui.link(target=file_address(Path(name) / picture.name), new_tab=True):
                ui.image(file_address(Path(name) / picture.name)).classes("w-96").props(f'alt="{picture.stem}"')


def _profiles(file: Path) -> None:
    """T(x) of the kept moments, with a slider over time."""
    import xarray

    with xarray.open_dataset(file) as run:
        time, x = run["time"].values, 1e3 * run["x"].values
        curves = {k: run[k].values for k in CURVES if k in run}
    ambient = min(float(np.nanmin(v)) for v in curves.values())
    warmest = max(float(np.nanmax(v)) for v in curves.values())
    chart = ui.echart({
        "animation": False, "tooltip": {"trigger": "axis"}, "legend": {},
        "xAxis": {"type": "value", "name": "x (mm)", "nameLocation": "middle", "nameGap": 28},
        "yAxis": {"type": "value", "name": "temperature (°C)", "min": round(ambient, 1), "max": round(warmest, 1)},
        "series": [{"type": "line", "name": CURVES[k], "showSymbol": False, "data": []} for k in curves],
    }).classes("w-full h-80")  # fmt: skip
    label = ui.label()

    def at(k: int) -> None:
        label.text = f"t = {time[k]:.4g} s"
        for series, values in zip(chart.options["series"], curves.values(), strict=True):
            series["data"] = [[float(a), float(b)] for a, b in zip(x, values[k], strict=True) if np.isfinite(b)]
        chart.update()

    slider = ui.slider(min=0, max=len(time) - 1, value=len(time) - 1, on_change=lambda e: at(int(e.value)))
    slider.props('aria-label="time"')
    at(len(time) - 1)


def _in_space(path: Path) -> None:
    """Cell centres of the last field in their colours, to be turned with the mouse."""
    from flashtemp.api.simulation import open_fields
    from flashtemp.viz.space_points import points

    if not (path / "fields.vtkhdf").is_file():
        return
    try:
        where, colours = points(open_fields(path))
    except BadInput:
        return
    with ui.expansion("in space").classes("w-full"), ui.scene(width=900, height=480, grid=False) as scene:
        scene.point_cloud(where.tolist(), colours.tolist(), point_size=0.12)
        scene.move_camera(x=0.0, y=-14.0, z=8.0, look_at_x=0.0, look_at_y=0.0, look_at_z=0.0)


def _numbers(path: Path) -> None:
    """The numbers of the result."""
    file = next((path / n for n in ("summary.json", "verdict.json", "compare.json") if (path / n).is_file()), None)
    if file is None:
        return
    try:
        told: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    except ValueError:
        return
    rows = [{"key": k, "value": f"{v:.6g}" if isinstance(v, float) else str(v)} for k, v in told.items() if _short(v)]
    with ui.expansion("numbers").classes("w-full"):
        ui.table(rows=rows, columns=[{"name": k, "label": k, "field": k, "align": "left"} for k in ("key", "value")])


def _short(value: Any) -> bool:
    return isinstance(value, (int, float, str)) and len(str(value)) < 200
