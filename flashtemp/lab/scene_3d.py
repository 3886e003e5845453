"""Block and road in 3D: surfaces coloured by temperature, turned by mouse or keyboard, at a time that is chosen."""

from __future__ import annotations

import base64
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from nicegui import run, ui
from nicegui.element import Element

from flashtemp.errors import BadInput
from flashtemp.lab.page_layout import card, refuse_damaged, show_errors
from flashtemp.lab.result_files import ResultFolder
from flashtemp.lab.result_parts import load_later

MAX_FIELD_BYTES = 8 * 2**30
MAX_FIELD_VALUES = 100_000_000  # numbers that are read at once
MAX_RAW = 65535  # temperatures are sent as 16-bit numbers
MAGNIFICATIONS = {1: "true to scale", 2: "height × 2", 4: "height × 4"}
LIFT_SHARE = 0.5  # of the block's height, by which it is lifted to show the contact
DEFAULT_WIDTH_M = 0.05


class SurfaceScene(Element, component="assets/surface_scene.js"):  # type: ignore[call-arg]
    """The 3D view; `show_faces`, `set_shape`, `reset_view` and `save_image` are methods of its script."""

    def __init__(self, about: str) -> None:
        super().__init__()
        self.props["about"] = about


@dataclass(frozen=True)
class StoredFields:
    """The temperature fields of a run: stored `times` (n,) s, colour limits `low` and `high` (degC).

    `width` (m) is drawn for a run in 2D (`is_flat`); `lift` (m) is how far the block is lifted to show the contact.
    """

    fields: Any
    times: np.ndarray
    low: float
    high: float
    width: float
    is_flat: bool
    lift: float

    def encode_faces(self, k: int) -> dict[str, Any]:
        """The faces at stored time number k as data for the script."""
        from flashtemp.viz import theme
        from flashtemp.viz.run.body_faces import sample_faces

        with refuse_damaged(self.fields.path):
            faces = sample_faces(self.fields, float(self.times[k]), self.width)
            colours = (255 * theme.temperature_map()(np.linspace(0.0, 1.0, 256))[:, :3]).round().astype(np.uint8)
            return {
                "low": self.low, "high": self.high, "colours": _encode_bytes(colours),
                "faces": [
                    {"body": f.body, "axis": f.axis, "side": f.side, "low": f.low, "high": f.high,
                     "shape": f.T.shape, "T": _encode_bytes(self._quantise(f.T))}
                    for f in faces
                ],
            }  # fmt: skip

    def _quantise(self, T: np.ndarray) -> np.ndarray:
        share = np.clip((np.nan_to_num(T, nan=self.low) - self.low) / (self.high - self.low), 0.0, 1.0)
        return (MAX_RAW * share).round().astype("<u2")


def read_fields(result: ResultFolder, width: Any) -> StoredFields | None:
    """The fields of a result; None where it has none.  Raises BadInput for a damaged file."""
    from flashtemp.api.simulation import open_fields
    from flashtemp.viz.run.body_faces import temperature_limits

    if (file := result.find_file("fields.vtkhdf")) is None:
        return None
    with refuse_damaged(file):
        if file.stat().st_size > MAX_FIELD_BYTES:
            raise BadInput(f"{file}: larger than {MAX_FIELD_BYTES // 2**30} GiB; open it with `flashtemp view`")
        _check_field_sizes(file)
        fields = open_fields(file.parent)
        _, y, z, _ = fields.tensor("block", float(fields.times[-1]))
        low, high = temperature_limits(fields)
        drawn = float(width) if isinstance(width, (int, float)) and 0 < width < 10 else DEFAULT_WIDTH_M
        return StoredFields(fields, fields.times, low, high, drawn, len(y) < 2, LIFT_SHARE * float(z[-1] - z[0]))


def _check_field_sizes(file: Path) -> None:
    """Check that one stored time fits into memory, whatever sizes a compressed file declares.  Raises BadInput."""
    import h5py

    from flashtemp.physics.safe_hdf5 import list_datasets

    with h5py.File(file) as content:
        found = list_datasets(content)
        sizes = [int(found["VTKHDF/block/Steps/Values"].size)]
        for body in ("block", "road"):
            group = f"VTKHDF/{body}"
            sizes += [int(found[f"{group}/Points"].size), int(found[f"{group}/NumberOfCells"][:1].max())]
        sizes += [math.prod(values.chunks) for values in found.values() if values.chunks]
    if max(sizes) > MAX_FIELD_VALUES:
        raise BadInput(f"{file}: too large for this page; open it with `flashtemp view`")


def _encode_bytes(values: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode()


def show_scene(result: ResultFolder, width: Any) -> None:
    """Show the card with the 3D view of a run; `width` (m) is drawn for a run in 2D."""
    with card("Block and road in 3D"):
        if result.find_file("fields.vtkhdf") is None:
            ui.label("This run stores no fields. Set output.vtk = true and run it again.").classes("ft-muted")
            return
        load_later(result.folder, "the temperature fields", lambda: read_fields(result, width), _start_view(result))


def _start_view(result: ResultFolder) -> Any:
    async def start(stored: StoredFields) -> None:
        await SceneView(result, stored).show()

    return start


class SceneView:
    """The 3D view with its controls: time, height, lifted block, picture."""

    def __init__(self, result: ResultFolder, stored: StoredFields):
        self.result, self.stored, self.wanted = result, stored, -1

    async def show(self) -> None:
        """Show view and controls, and draw the last stored time."""
        stored, last = self.stored, len(self.stored.times) - 1
        flat = " The run is in 2D: the temperature is even across the width." if stored.is_flat else ""
        ui.label(f"Surface temperatures of the stored fields.{flat}").classes("ft-muted")
        self.scene = SurfaceScene("Block and road, coloured by temperature. Arrow keys turn, plus and minus zoom.")
        self.scene.classes("w-full")
        with ui.row().classes("items-center gap-3 w-full no-wrap"):
            ui.label("time").classes("ft-muted ft-small")
            self.time = ui.slider(min=0, max=max(last, 1), value=last, on_change=self._draw_time)
            self.time.props('aria-label="stored field"').set_enabled(last > 0)
            self.label = ui.label().classes("ft-mono ft-small whitespace-nowrap")
        with ui.row().classes("items-center gap-4 w-full"):
            self.height = ui.toggle(MAGNIFICATIONS, value=1, on_change=self._set_shape)
            self.height.props("no-caps dense unelevated toggle-text-color=on-accent").classes("ft-choice")
            self.lifted = ui.switch("Lift the block", on_change=self._set_shape)
            ui.space()
            ui.button("Reset view", on_click=lambda: self.scene.run_method("reset_view")).props("flat dense no-caps")
            name = f"{self.result.here.name}_3d.png"
            save = ui.button("PNG", on_click=lambda: self.scene.run_method("save_image", name))
            save.props('flat dense size=sm aria-label="save the 3D view as PNG"')
        await self._draw_time()

    def _set_shape(self) -> None:
        stretch = int(self.height.value)
        self.scene.run_method("set_shape", stretch, stretch * self.stored.lift if self.lifted.value else 0.0)

    async def _draw_time(self) -> None:
        """Draw the chosen time; only the last of several choices in a row is drawn."""
        k = int(self.time.value)
        self.label.text = f"{self.stored.times[k]:.4g} s"
        if self.wanted >= 0:
            self.wanted = k
            return
        self.wanted = k
        drawn = -1
        try:
            while drawn != self.wanted:
                drawn = self.wanted
                with show_errors(self.result.folder):
                    self.scene.run_method("show_faces", await run.io_bound(self.stored.encode_faces, drawn))
        finally:
            self.wanted = -1
