"""Block and road in 3D, in a VTK window or a picture; half of the block is cut away to show its section."""

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

VIEW_TITLE = "Temperature of block and road"
ROAD_SHOWN_MM = 3.0  # mm
WINDOW_SIZE_PX = (1500, 900)
PAPER_COLOUR, INK_COLOUR, EDGE_COLOUR = "white", "#222222", "#5A5A5A"
KEY_HELP = """left, right: previous or next stored field
drag: turn    shift + drag: move    wheel: zoom
drag the plane or its arrow: move the section
r: reset view    s, w: surface, wireframe    q: close"""


def read_bodies(fields, t: float) -> dict[str, tuple]:
    """{body: (x, y, z edges in mm, T (nx, ny, nz) in degC)} of block and road at the stored time nearest to t.

    A 2D run is extended to the width of the block.
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
    """Colour limits (degC): from the coolest cell at t to the hottest contact of all stored times."""
    low = min(float(fields.T(body, t).min()) for body in ("block", "road"))
    faces = ("T_block_degC", "T_road_degC")
    high = max(float(fields.cells("contact", face, each).max()) for face in faces for each in fields.times)
    return low, max(high, low + 1.0)


def colour_bar_ticks(low: float, high: float) -> tuple[np.ndarray, str]:
    """Evenly spaced round ticks (degC) from end to end of a colour bar, and their number format.

    >>> colour_bar_ticks(20.0, 47.6)[0].tolist(), colour_bar_ticks(20.0, 21.0)[1]
    ([20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0], '%.1f')
    """
    marks = theme.round_values(low, high)
    digits = next(d for d in range(9) if np.allclose(marks, np.round(marks, d), rtol=0.0, atol=1e-9))
    return marks, f"%.{digits}f"


def _make_grid(x, y, z, T):
    """A pyvista grid (mm) with temperatures at its points."""
    import pyvista as pv

    grid = pv.RectilinearGrid(x, y, z)
    grid.cell_data["T"] = T.transpose(2, 1, 0).ravel()
    return grid.cell_data_to_point_data()


def _rear_half(x, y, z, T) -> tuple:
    """The half y > 0 of a body; a body of one cell across is cut at y = 0."""
    if len(y) == 2:
        return x, np.array([0.0, y[1]]), z, T
    first = int(np.searchsorted(y, 0.0))
    return x, y[first:], z, T[:, first:]


def make_plotter(fields, t: float, off: bool = True):
    """A pyvista Plotter of the stored time nearest to t; with a time slider and a section plane unless `off` screen."""
    import pyvista as pv

    bodies = read_bodies(fields, t)
    ticks, tick_format = colour_bar_ticks(*temperature_limits(fields, t))
    style = {"scalars": "T", "cmap": theme.temperature_map(), "clim": ticks[[0, -1]].tolist(), "lighting": False}
    bar: Any = {
        "title": f"temperature ({theme.CELSIUS})",
        "vertical": True,
        "color": INK_COLOUR,
        "n_labels": len(ticks),
        "fmt": tick_format,
        "position_x": 0.92,
        "position_y": 0.2,
        "height": 0.6,
        "width": 0.04,
        "title_font_size": 20,
        "label_font_size": 18,
    }
    plot: Any = pv.Plotter(
        off_screen=off, window_size=list(WINDOW_SIZE_PX), title=f"{replace_unprintable(fields.title)} - flashtemp"
    )
    plot.set_background(PAPER_COLOUR)
    road, whole = _make_grid(*bodies["road"]), _make_grid(*bodies["block"])
    plot.add_mesh(road, **style, scalar_bar_args=bar)
    plot.scalar_bar.SetVerticalTitleSeparation(12)
    plot.add_mesh(road.outline(), color=EDGE_COLOUR)
    if off:
        plot.add_mesh(_make_grid(*_rear_half(*bodies["block"])), **style, show_scalar_bar=False)
    else:
        plot.add_mesh_clip_plane(  # removes the half in front of the plane, so that the section is visible
            whole, normal="y", outline_opacity=0.0, **style, show_scalar_bar=False
        )
    plot.add_mesh(whole.outline(), color=EDGE_COLOUR, line_width=2)
    _add_labels(plot, fields, bodies, t)
    if not off:
        plot.add_text(KEY_HELP, position="lower_right", font_size=9, color=EDGE_COLOUR)
        if len(fields.times) > 1:
            _add_time_slider(plot, fields, t, {"road": road, "block": whole})
    _set_camera(plot, bodies)
    return plot


def _add_labels(plot, fields, bodies, t: float) -> None:
    """Title, time, edges of the block and its size."""
    x, y, z, _ = bodies["block"]
    moment = fields.times[int(np.argmin(np.abs(fields.times - t)))]
    plot.add_text(
        escape_mathematics(replace_unprintable(f"{VIEW_TITLE}, {fields.title}")),
        position="upper_left",
        font_size=15,
        color=INK_COLOUR,
    )
    plot.add_text(_time_label(float(moment)), position="lower_left", font_size=11, color=INK_COLOUR, name="time")
    under, far = -ROAD_SHOWN_MM - 2.0, bodies["road"][0][-1]
    names = ("x = 0", "x = L", "road") if fields.slides_back else ("leading edge", "trailing edge", "wake")
    labels = {  # below the road and above the block, on the white background
        (x[0], y[0], under): names[0], (x[-1], y[0], under): names[1],
        (0.35 * x[0] + 0.65 * x[-1], y[-1], z[-1] + 2.5): f"block {x[-1]:.3g} x {np.ptp(y):.3g} x {z[-1]:.3g} mm",
    }  # fmt: skip
    if far > x[-1]:
        labels[(far, y[0], under)] = names[2]
    plot.add_point_labels(
        np.array(list(labels)),
        list(labels.values()),
        shape=None,
        show_points=False,
        font_size=20,
        text_color=INK_COLOUR,
        always_visible=True,
        bold=False,
    )


def _time_label(t: float) -> str:
    return f"t = {theme.format_decimal(t)} s\nroad: in the heated tracks"


def _add_time_slider(plot, fields, t: float, grids: dict) -> None:
    """A time slider; the arrow keys step from one stored field to the next."""

    shown = None

    def show(moment: float) -> None:
        nonlocal shown
        t = fields.times[int(np.argmin(np.abs(fields.times - moment)))]
        if t == shown:  # the slider reports every pixel of its motion
            return
        shown = t
        bodies = read_bodies(fields, t)
        for name, grid in grids.items():
            grid.point_data["T"][:] = _make_grid(*bodies[name]).point_data["T"]
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


def _set_camera(plot, bodies) -> None:
    """Look from the front and above at the side where the block is cut open."""
    x, y, z = (bodies["road"][i][[0, -1]] for i in range(3))
    centre = np.array([x.mean() + 0.06 * np.ptp(x), y.mean(), 0.5 * bodies["block"][2][-1] - 0.5 * ROAD_SHOWN_MM])
    reach = float(np.hypot(np.ptp(x), np.ptp(y)))
    plot.camera_position = [centre + reach * np.array([-0.35, -1.25, 0.85]), centre, (0, 0, 1)]
    plot.reset_camera()
    plot.camera.zoom(1.2)


def save_screenshot(fields, t: float, file: Path) -> None:
    """Draw off screen into a PNG file, at the stored time nearest to t."""
    plot = make_plotter(fields, t)
    plot.screenshot(file)
    plot.close()


def open_window(fields, t: float) -> None:
    """Open an interactive window at the stored time nearest to t."""
    make_plotter(fields, t, off=False).show()


# --- without a VTK window ----------------------------------------------------------------------------
@theme.styled
def draw_without_vtk(fields, t: float) -> Figure:
    """The same view by matplotlib alone: road surface and section of the block, lengths in mm."""
    ticks, _ = colour_bar_ticks(*temperature_limits(fields, t))
    bodies, norm = read_bodies(fields, t), theme.temperature_norm(ticks)
    colour = theme.temperature_map()
    fig = theme.make_figure(VIEW_TITLE, fields.title, theme.WIDE_FIGURE_IN, 4.6, layout=None)
    ax = fig.add_subplot(projection="3d", computed_zorder=False)
    x, y, z, T = bodies["road"]
    surface = T[:, :, -1]
    X, Y = np.meshgrid(x, y, indexing="ij")
    kind = {"shade": False, "rstride": 1, "cstride": 1, "linewidth": 0, "antialiased": False}
    ax.plot_surface(X, Y, 0 * X, facecolors=colour(norm(surface)), **kind)
    x, y, z, T = _rear_half(*bodies["block"])
    X, Z = np.meshgrid(x, z, indexing="ij")
    ax.plot_surface(X, 0 * X, Z, facecolors=colour(norm(T[:, 0])), **kind)
    Y, Z = np.meshgrid(y, z, indexing="ij")
    ax.plot_surface(0 * Y + x[0], Y, Z, facecolors=colour(norm(T[0])), **kind)
    X, Y = np.meshgrid(x, y, indexing="ij")
    ax.plot_surface(X, Y, 0 * X + z[-1], facecolors=colour(norm(T[:, :, -1])), **kind)
    ax.set(xlabel="x (mm)", ylabel="y (mm)", zlabel="z (mm)")
    ax.set_box_aspect((np.ptp(bodies["road"][0]), np.ptp(bodies["road"][1]), z[-1]), zoom=1.25)
    ax.view_init(32, -70)
    moment = fields.times[int(np.argmin(np.abs(fields.times - t)))]
    fig.text(0.02, 0.03, f"t = {theme.format_decimal(float(moment))} s")
    label = f"temperature ({theme.CELSIUS})"
    fig.colorbar(ScalarMappable(norm, colour), ax=ax, label=label, ticks=ticks, shrink=0.6, pad=0.05, location="left")
    return fig
