"""Block and road in space: half of the block cut away, so that its section and the hot road below are seen."""

from __future__ import annotations

import tomllib
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure

from flashtemp.viz import theme
from flashtemp.viz.literal_text import escape_mathematics, replace_unprintable

ROAD_SHOWN_MM = 3.0  # mm
WINDOW_SIZE_PX = (1500, 900)
PAPER_COLOUR, INK_COLOUR, EDGE_COLOUR = "white", "#222222", "#5A5A5A"
KEY_HELP = """left, right: time, one kept field back or on
drag: turn    shift + drag: move    wheel: zoom
drag the plane or its arrow: cut elsewhere
r: see all    s, w: surface, wires    q: close"""


def read_bodies(fields, t: float) -> dict[str, tuple]:
    """Block and road at the kept time nearest to t: edges x, y, z in mm, T (nx, ny, nz) degC.

    A run in 2D is drawn out to its width.
    """
    width = 1e3 * tomllib.loads(fields.case)["block"]["width"]
    out = {}
    for name in ("block", "road"):
        x, y, z, T = fields.tensor(name, t)
        y = 1e3 * y if len(y) > 1 else np.array([-0.5, 0.5]) * width
        x, z = 1e3 * x, 1e3 * z
        keep = max(0, int(np.searchsorted(z, -ROAD_SHOWN_MM, side="right")) - 1) if name == "road" else 0
        out[name] = (x, y, z[keep:], T[:, :, keep:])
    return out


def temperature_limits(fields, t: float) -> tuple[float, float]:
    """What is coloured (degC): from the coolest cell to the hottest contact of all kept times."""
    low = min(float(fields.T(body, t).min()) for body in ("block", "road"))
    faces = ("T_block_degC", "T_road_degC")
    high = max(float(fields.cells("contact", face, each).max()) for face in faces for each in fields.times)
    return low, max(high, low + 1.0)


def colour_bar_ticks(low: float, high: float) -> tuple[np.ndarray, str]:
    """Evenly spaced round numbers (degC) that a colour bar goes from and to, and how they are written.

    >>> colour_bar_ticks(20.0, 47.6)[0].tolist(), colour_bar_ticks(20.0, 21.0)[1]
    ([20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0], '%.1f')
    """
    from matplotlib.ticker import MaxNLocator

    marks = np.asarray(MaxNLocator(6, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high))
    digits = next(d for d in range(9) if np.allclose(marks, np.round(marks, d), rtol=0.0, atol=1e-9))
    return marks, f"%.{digits}f"


def _make_grid(x, y, z, T):
    """A pyvista grid with temperatures at its points, m to mm done before."""
    import pyvista as pv

    grid = pv.RectilinearGrid(x, y, z)
    grid.cell_data["T"] = T.transpose(2, 1, 0).ravel()
    return grid.cell_data_to_point_data()


def _rear_half(x, y, z, T) -> tuple:
    """The half behind the middle of the width; all of it where it is one cell wide."""
    if len(y) == 2:
        return x, np.array([0.0, y[1]]), z, T
    first = int(np.searchsorted(y, 0.0))
    return x, y[first:], z, T[:, first:]


def make_plotter(fields, t: float, off: bool = True):
    """A pyvista Plotter of the kept time nearest to t; without `off` with a slider of time and a plane to cut with."""
    import pyvista as pv

    seen = read_bodies(fields, t)
    marks, form = colour_bar_ticks(*temperature_limits(fields, t))
    style = {"scalars": "T", "cmap": theme.temperature_map(), "clim": marks[[0, -1]].tolist(), "lighting": False}
    bar: Any = {
        "title": f"temperature ({theme.CELSIUS})", "vertical": True, "color": INK_COLOUR, "n_labels": len(marks), "fmt": form,
        "position_x": 0.92, "position_y": 0.2, "height": 0.6, "width": 0.04,
        "title_font_size": 20, "label_font_size": 18,
    }  # fmt: skip
    plot: Any = pv.Plotter(
        off_screen=off, window_size=list(WINDOW_SIZE_PX), title=f"{replace_unprintable(fields.title)} - flashtemp"
    )
    plot.set_background(PAPER_COLOUR)
    road, whole = _make_grid(*seen["road"]), _make_grid(*seen["block"])
    plot.add_mesh(road, **style, scalar_bar_args=bar)
    plot.scalar_bar.SetVerticalTitleSeparation(12)
    plot.add_mesh(road.outline(), color=EDGE_COLOUR)
    if off:
        plot.add_mesh(_make_grid(*_rear_half(*seen["block"])), **style, show_scalar_bar=False)
    else:
        plot.add_mesh_clip_plane(  # what lies before it goes: the section faces the eye
            whole, normal="y", outline_opacity=0.0, **style, show_scalar_bar=False
        )
    plot.add_mesh(whole.outline(), color=EDGE_COLOUR, line_width=2)
    _add_labels(plot, fields, seen, t)
    if not off:
        plot.add_text(KEY_HELP, position="lower_right", font_size=9, color=EDGE_COLOUR)
        if len(fields.times) > 1:
            _add_time_slider(plot, fields, t, {"road": road, "block": whole})
    _set_camera(plot, seen)
    return plot


def _add_labels(plot, fields, seen, t: float) -> None:
    x, y, z, _ = seen["block"]
    moment = fields.times[int(np.argmin(np.abs(fields.times - t)))]
    plot.add_text(
        escape_mathematics(replace_unprintable(fields.title)), position="upper_left", font_size=15, color=INK_COLOUR
    )
    plot.add_text(_time_label(float(moment)), position="lower_left", font_size=11, color=INK_COLOUR, name="time")
    under, far = -ROAD_SHOWN_MM - 2.0, seen["road"][0][-1]
    names = ("x = 0", "x = L", "road") if fields.slides_back else ("leading edge", "trailing edge", "wake")
    marks = {  # below the road and above the block: nothing dark behind
        (x[0], y[0], under): names[0], (x[-1], y[0], under): names[1],
        (0.35 * x[0] + 0.65 * x[-1], y[-1], z[-1] + 2.5): f"block {x[-1]:.3g} x {np.ptp(y):.3g} x {z[-1]:.3g} mm",
    }  # fmt: skip
    if far > x[-1]:
        marks[(far, y[0], under)] = names[2]
    plot.add_point_labels(
        np.array(list(marks)), list(marks.values()), shape=None, show_points=False, font_size=20, text_color=INK_COLOUR,
        always_visible=True, bold=False,
    )  # fmt: skip


def _time_label(t: float) -> str:
    return f"t = {theme.format_decimal(t)} s\nroad: in the spots' lanes"


def _add_time_slider(plot, fields, t: float, grids: dict) -> None:
    """Time by a slider, and by the arrow keys from one kept field to the next."""

    shown = None

    def show(moment: float) -> None:
        nonlocal shown
        t = fields.times[int(np.argmin(np.abs(fields.times - moment)))]
        if t == shown:  # the slider tells every pixel that it moves
            return
        shown = t
        seen = read_bodies(fields, t)
        for name, grid in grids.items():
            grid.point_data["T"][:] = _make_grid(*seen[name]).point_data["T"]
        plot.add_text(_time_label(float(t)), position="lower_left", font_size=11, color=INK_COLOUR, name="time")

    slider = plot.add_slider_widget(
        show, fields.times[[0, -1]], value=t, title="time (s)", fmt="%.3g", color=INK_COLOUR, style="modern",
        pointa=(0.6, 0.92), pointb=(0.95, 0.92), interaction_event="always",
    )  # fmt: skip

    def step(by: int) -> None:
        now = slider.GetRepresentation().GetValue()
        index = int(np.clip(np.argmin(np.abs(fields.times - now)) + by, 0, len(fields.times) - 1))
        slider.GetRepresentation().SetValue(fields.times[index])
        show(fields.times[index])
        plot.render()

    for key, by in (("Right", 1), ("Left", -1)):
        plot.add_key_event(key, partial(step, by))


def _set_camera(plot, seen) -> None:
    """From before and above the side where the block is cut open."""
    x, y, z = (seen["road"][i][[0, -1]] for i in range(3))
    centre = np.array([x.mean() + 0.06 * np.ptp(x), y.mean(), 0.5 * seen["block"][2][-1] - 0.5 * ROAD_SHOWN_MM])
    reach = float(np.hypot(np.ptp(x), np.ptp(y)))
    plot.camera_position = [centre + reach * np.array([-0.35, -1.25, 0.85]), centre, (0, 0, 1)]
    plot.reset_camera()
    plot.camera.zoom(1.2)


def save_screenshot(fields, t: float, file: Path) -> None:
    """Draw off screen into a PNG file."""
    plot = make_plotter(fields, t)
    plot.screenshot(file)
    plot.close()


def open_window(fields, t: float) -> None:
    """Open a window."""
    make_plotter(fields, t, off=False).show()


# --- without VTK's windows ----------------------------------------------------------------------------
@theme.styled
def draw_without_vtk(fields, t: float) -> Figure:
    """The same faces by matplotlib alone: road from above, section of the block, lengths in mm."""
    marks, _ = colour_bar_ticks(*temperature_limits(fields, t))
    seen, norm = read_bodies(fields, t), theme.temperature_norm(marks)
    colour = theme.temperature_map()
    fig = Figure(figsize=(7.2, 4.6), facecolor="white")
    ax = fig.add_subplot(projection="3d", computed_zorder=False)
    x, y, z, T = seen["road"]
    surface = T[:, :, -1]
    X, Y = np.meshgrid(x, y, indexing="ij")
    kind = {"shade": False, "rstride": 1, "cstride": 1, "linewidth": 0, "antialiased": False}
    ax.plot_surface(X, Y, 0 * X, facecolors=colour(norm(surface)), **kind)
    x, y, z, T = _rear_half(*seen["block"])
    X, Z = np.meshgrid(x, z, indexing="ij")
    ax.plot_surface(X, 0 * X, Z, facecolors=colour(norm(T[:, 0])), **kind)
    Y, Z = np.meshgrid(y, z, indexing="ij")
    ax.plot_surface(0 * Y + x[0], Y, Z, facecolors=colour(norm(T[0])), **kind)
    X, Y = np.meshgrid(x, y, indexing="ij")
    ax.plot_surface(X, Y, 0 * X + z[-1], facecolors=colour(norm(T[:, :, -1])), **kind)
    ax.set(xlabel="x (mm)", ylabel="y (mm)", zlabel="z (mm)", title=fields.title)
    ax.set_box_aspect((np.ptp(seen["road"][0]), np.ptp(seen["road"][1]), z[-1]), zoom=1.25)
    ax.view_init(32, -70)
    moment = fields.times[int(np.argmin(np.abs(fields.times - t)))]
    fig.text(0.02, 0.03, f"t = {theme.format_decimal(float(moment))} s")
    label = f"temperature ({theme.CELSIUS})"
    fig.colorbar(ScalarMappable(norm, colour), ax=ax, label=label, ticks=marks, shrink=0.6, pad=0.05, location="left")
    return fig
