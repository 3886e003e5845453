"""The result page: report, pictures and numbers; for a run also T(x) with a time slider and a 3D scene."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from nicegui import ui

from flashtemp.errors import BadInput
from flashtemp.lab.page_layout import file_address, refuse_damaged, show_errors
from flashtemp.lab.workspace import escape_control, resolve_inside

MAX_PROFILE_BYTES = 512 * 2**20  # of arrays that the page loads at once
MAX_JSON_BYTES = 32 * 2**20
MAX_PICTURES = 200
PICTURE_SUFFIXES = (".png", ".gif", ".svg")
CURVE_LABELS = {"T_spot": "in the contact spots", "T_block": "block, averaged across y", "T_road": "road"}


def show_result(folder: Path, name: str) -> None:
    """Show the content of a result folder.  Raises BadInput."""
    path = resolve_inside(folder, name)
    if not path.is_dir():
        raise BadInput(f"{escape_control(name)}: no such result; choose one on the folder page")
    here = path.relative_to(folder.resolve())
    ui.label(escape_control(str(here))).classes("text-xl")
    with show_errors(folder):
        if (file := _own_file(folder, here / "run.nc")) is not None:
            _show_profiles(file)
            _show_in_space(folder, here)
    if _own_file(folder, here / "report.html") is not None:
        _show_report(file_address(here / "report.html"))
    with show_errors(folder):
        _show_numbers(folder, here)
    _show_pictures(folder, path, here)


def _own_file(folder: Path, name: Path) -> Path | None:
    """A regular file of the folder; None where there is none or a link leads out of the folder."""
    try:
        path = resolve_inside(folder, str(name))
        return path if path.is_file() else None
    except BadInput:
        return None


def _show_report(address: str) -> None:
    """Show a report in a sandboxed frame without scripts, since its author is unknown."""
    ui.link("open the report in a new tab", address, new_tab=True)
    frame = ui.element("iframe").style("width:100%;height:80vh;border:1px solid #ccc")
    for key, value in {"src": address, "title": "report", "sandbox": "", "referrerpolicy": "no-referrer"}.items():
        frame.props[key] = value


def _show_pictures(folder: Path, path: Path, here: Path) -> None:
    names = sorted(p.name for p in path.iterdir() if p.suffix in PICTURE_SUFFIXES and escape_control(p.name) == p.name)
    pictures = [name for name in names[:MAX_PICTURES] if _own_file(folder, here / name) is not None]
    with ui.row().classes("w-full gap-4"):
        for name in pictures:
            address = file_address(here / name)
            with ui.link(target=address, new_tab=True):
                ui.image(address).classes("w-96").props["alt"] = Path(name).stem
    if len(names) > MAX_PICTURES:
        ui.label(f"and {len(names) - MAX_PICTURES} more pictures in {escape_control(str(here))}")


def _show_profiles(file: Path) -> None:
    """Chart of T(x) at the stored times, with a time slider."""
    import xarray

    with refuse_damaged(file), xarray.open_dataset(file) as run:
        names = [k for k in CURVE_LABELS if k in run]
        n_bytes = sum(run[k].nbytes for k in ("time", "x", *names))
        if n_bytes > MAX_PROFILE_BYTES:
            raise BadInput(f"{file}: holds {n_bytes / 2**20:.0f} MiB of profiles; open it with xarray")
        time, x = run["time"].values.astype(float), 1e3 * run["x"].values.astype(float)
        curves = {k: run[k].transpose("time", "x").values.astype(float) for k in names}
        if not curves or not len(time) or not any(np.isfinite(v).any() for v in curves.values()):
            raise BadInput(f"{file}: has no temperatures over time and x; it is not a run of flashtemp")
    ambient = min(float(np.nanmin(v)) for v in curves.values())
    warmest = max(float(np.nanmax(v)) for v in curves.values())
    chart = ui.echart({
        "animation": False, "tooltip": {"trigger": "axis"}, "legend": {},
        "xAxis": {"type": "value", "name": "x (mm)", "nameLocation": "middle", "nameGap": 28},
        "yAxis": {"type": "value", "name": "temperature (°C)", "min": round(ambient, 1), "max": round(warmest, 1)},
        "series": [{"type": "line", "name": CURVE_LABELS[k], "showSymbol": False, "data": []} for k in curves],
    }).classes("w-full h-80")  # fmt: skip
    label = ui.label()

    def show_time(k: int) -> None:
        label.text = f"t = {time[k]:.4g} s"
        for series, values in zip(chart.options["series"], curves.values(), strict=True):
            series["data"] = [[float(a), float(b)] for a, b in zip(x, values[k], strict=True) if np.isfinite(b)]
        chart.update()

    slider = ui.slider(min=0, max=len(time) - 1, value=len(time) - 1, on_change=lambda e: show_time(int(e.value)))
    slider.props('aria-label="time"')
    show_time(len(time) - 1)


def _show_in_space(folder: Path, here: Path) -> None:
    """A 3D scene of the last stored field that can be rotated with the mouse."""
    from flashtemp.api.simulation import open_fields
    from flashtemp.viz.run.point_cloud import surface_points

    if (file := _own_file(folder, here / "fields.vtkhdf")) is None:
        return
    try:
        with refuse_damaged(file):
            positions, colours = surface_points(open_fields(file.parent))
    except BadInput:
        return
    with ui.expansion("3D view").classes("w-full"), ui.scene(width=900, height=480, grid=False) as scene:
        scene.point_cloud(positions.tolist(), colours.tolist(), point_size=0.12)
        scene.move_camera(x=0.0, y=-14.0, z=8.0, look_at_x=0.0, look_at_y=0.0, look_at_z=0.0)


def _show_numbers(folder: Path, here: Path) -> None:
    """Table of the numbers of the result.  Raises BadInput for a damaged file."""
    files = (_own_file(folder, here / n) for n in ("summary.json", "verdict.json", "compare.json"))
    if (file := next(filter(None, files), None)) is None:
        return
    with refuse_damaged(file):
        if file.stat().st_size > MAX_JSON_BYTES:
            raise BadInput(f"{file}: larger than {MAX_JSON_BYTES // 2**20} MiB; open it with a text editor")
        numbers: dict[str, Any] = dict(json.loads(file.read_text(encoding="utf-8")))
    rows = [
        {"key": escape_control(k), "value": f"{v:.6g}" if isinstance(v, float) else escape_control(str(v))}
        for k, v in numbers.items()
        if _is_short(v)
    ]
    with ui.expansion("numbers").classes("w-full"):
        ui.table(rows=rows, columns=[{"name": k, "label": k, "field": k, "align": "left"} for k in ("key", "value")])


def _is_short(value: Any) -> bool:
    return isinstance(value, (int, float, str)) and len(str(value)) < 200
