"""Variation across the width: contact and wake from above, pressure, and the block at its wall and middle."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from flashtemp.meshes.mesh import centres
from flashtemp.physics.interpolation import interpolate_linear
from flashtemp.viz import theme
from flashtemp.viz.run import run_views
from flashtemp.viz.run.run_views import VIEW_COLUMNS, VIEW_ROWS, has_wake

PICTURE = "width"
PRESSURE_MAP = "cividis"
EVEN_PRESSURE_FRACTION = 1e-3  # of the pressure; smaller differences count as uniform


def applies(run) -> bool:
    """Whether the run has cells across."""
    return run_views.has_fields(run) and run.mesh.n_across > 1


@theme.styled
def draw(run) -> Figure:
    """Maps at the end of the last sliding: contact and wake from above, pressure, wall y < 0, middle (degC, mm)."""
    mesh = run.mesh
    frame = int(np.argmin(np.abs(run.frames - run.last_sliding_index)))
    y, z = 1e3 * mesh.y[[0, -1]], 1e3 * mesh.height[[0, -1]]
    L, far = 1e3 * mesh.x[mesh.last], 1e3 * mesh.x[-1]
    contact = np.where(run.maps["pressure"][frame] > 0, run.maps["T_spot"][frame], np.nan)
    top = _resample_evenly(contact, run.x, mesh.y_centre, (0.0, mesh.x[mesh.last]), mesh.y[[0, -1]])
    behind = []
    if has_wake(run):
        wake = run.maps["T_wake"][frame]
        behind = [_resample_evenly(wake, run.x_wake, mesh.y_centre, mesh.x[[mesh.last, -1]], mesh.y[[0, -1]])]
    up = centres(mesh.height)
    sides = [
        _resample_evenly(cells[mesh.block], run.x, up, (0.0, mesh.x[mesh.last]), mesh.height[[0, -1]])
        for cells in (run.section(frame, 0), run.section(frame))
    ]
    press = _resample_evenly(
        run.maps["pressure"][frame], run.x, mesh.y_centre, (0.0, mesh.x[mesh.last]), mesh.y[[0, -1]]
    )
    wide, deep = float(np.clip(4.2 * np.ptp(y) / far, 0.9, 3.2)), float(np.clip(4.2 * z[1] / far, 0.6, 1.6))
    shown = "Temperature and pressure across the width"
    fig = theme.make_figure(shown, run.title, theme.WIDE_FIGURE_IN, 1.9 + wide + 2 * deep)
    grid = fig.add_gridspec(3, 2, height_ratios=[wide, deep, deep], width_ratios=[far / L, 0.75])
    norm = theme.temperature_norm(top, *behind, *sides)
    style = {"cmap": theme.temperature_map(), "norm": norm, "origin": "lower", "aspect": "auto"}
    above, pressed = fig.add_subplot(grid[0, 0]), fig.add_subplot(grid[0, 1])
    picture = above.imshow(top, extent=(0.0, L, *y), **style)
    for image in behind:
        above.imshow(image, extent=(L, far, *y), **style)
        above.axvline(L, color="white", lw=1.0)
        above.text(far, y[1], "wake ", ha="right", va="top", color="white", fontsize=7.5)
    title = "contact seen from above: spots" + (", and the wake" if behind else "")
    above.set(xlim=(0.0, far), ylim=y, ylabel="y (mm)", title=title)
    force = pressed.imshow(
        1e-3 * press,
        extent=(0.0, L, *y),
        cmap=PRESSURE_MAP,
        origin="lower",
        aspect="auto",
        norm=_pressure_norm(1e-3 * press),
    )
    pressed.set(title="nominal contact pressure")
    walls = [fig.add_subplot(grid[1 + i, 0], sharex=above) for i in range(2)]
    for ax, values, words in zip(walls, sides, ("at the side wall y < 0", "in the middle of the width"), strict=True):
        ax.imshow(values, extent=(0.0, L, *z), **style)
        ax.set(title=f"block {words}", xlim=(0.0, far), ylabel="z (mm)")
    for ax in (pressed, walls[1]):
        ax.set_xlabel(theme.x_axis_label(run))
    for ax in (above, pressed, *walls):
        ax.spines[:].set_visible(False)
    temperature = f"temperature ({theme.CELSIUS})"
    for image, axes, label in ((picture, [above, *walls], temperature), (force, [pressed], "pressure (kPa)")):
        theme.add_colour_bar(fig, image, axes, label, pad=0.02, aspect=25)
    t = theme.format_decimal(run.time[run.frames[frame]])
    averaged = " Wake: road surface, averaged over heated tracks and gaps." if behind else ""
    theme.add_caption(fig, f"At the end of sliding, t = {t} s.{averaged}")
    return fig


def _pressure_norm(press: np.ndarray) -> Normalize:
    """Colour limits (kPa): those of the pressure, or from zero where it is uniform."""
    low, high = float(np.nanmin(press)), float(np.nanmax(press))
    return Normalize(low, high) if high - low > EVEN_PRESSURE_FRACTION * abs(high) else Normalize(0.0, max(high, 1.0))


def _resample_evenly(values, x, v, x_ends, v_ends) -> np.ndarray:
    """Values (len(x), len(v)) on evenly spaced pixels (VIEW_ROWS, VIEW_COLUMNS), linear between cell centres."""
    along = interpolate_linear(
        np.asarray(values, dtype=float), x, centres(np.linspace(x_ends[0], x_ends[1], VIEW_COLUMNS + 1))
    )
    return interpolate_linear(along.T, v, centres(np.linspace(v_ends[0], v_ends[1], VIEW_ROWS + 1)))
