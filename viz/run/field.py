"""Temperature field of block and road: to scale, and with the layers next to the contact stretched in z."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from flashtemp.physics.interpolation import interpolate_linear
from flashtemp.viz import theme
from flashtemp.viz.run import run_views
from flashtemp.viz.time_axis import repetition_axis, sliding_ends

PICTURE = "field"
ROAD_SHOWN_M = 3e-3  # m of road drawn to scale
MAX_BLOCK_NEAR_M, MAX_ROAD_NEAR_M = 2e-3, 1e-3  # m; maximum reach of the stretched panels
MIN_RISE_FRACTION = 0.1  # of the maximum temperature rise; the stretched panels end below it
FIELD_COLUMNS, FIELD_ROWS = 400, 120  # of the image of a body: finer than its pixels at 160 dpi


def applies(run) -> bool:
    """Whether the run has saved temperature fields."""
    return run_views.has_fields(run)


@theme.styled
def draw(run) -> Figure:
    """Temperatures (degC) over x and z (mm): above to scale, below z stretched next to the contact.

    Columns: end of the first repetition, the wait after it, and end of the last repetition, as far as they exist.
    Road cells are means over the heated tracks.
    """
    frames = select_moments(run)
    shown = min(ROAD_SHOWN_M, float(run.mesh.depth[-1]))
    cells = {frame: run.section(frame) for frame in frames}
    near = _near_contact_reach(run, cells[min(frames)])
    width = theme.WIDE_FIGURE_IN if len(frames) > 1 else theme.NARROW_FIGURE_IN
    ratio = (run.mesh.height[-1] + shown) / float(np.ptp(run.mesh.x))
    tall = float(np.clip(1.1 * (width - 1.1) / len(frames) * ratio, 0.4, 4.0))
    fig = theme.make_figure("Temperature of block and road", run.title, width, 3.1 + tall)
    axes = fig.subplots(2, len(frames), squeeze=False, sharex=True, sharey="row", height_ratios=[tall, 1.7])
    norm = theme.temperature_norm(*cells.values(), run.ambient_degC)
    for (above, below), (frame, words) in zip(axes.T, frames.items(), strict=True):
        _draw_bodies(above, run, cells[frame], norm, run.mesh.height[-1], shown)
        picture = _draw_bodies(below, run, cells[frame], norm, *near)
        above.set_title(words)
        below.set_xlabel(theme.x_axis_label(run))
    axes[0, 0].set(ylabel="z (mm)", xlim=1e3 * run.mesh.x[[0, -1]])
    for ax in axes[0]:
        ax.set_aspect("equal", adjustable="box")
    for ax in axes[1]:
        _stretch_axis(ax, *(1e3 * np.array(near)))
    axes[1, 0].set_ylabel("z (mm), stretched")
    theme.add_colour_bar(fig, picture, axes, f"temperature ({theme.CELSIUS})", pad=0.01, aspect=25)
    theme.add_caption(fig, _field_caption(run, shown))
    return fig


def select_moments(run) -> dict[int, str]:
    """{index into run.field: title} of the frames: ends of the first and last repetition, wait after the first."""
    out, axis, last = {}, repetition_axis(run), sliding_ends(run)
    number = axis.repetition
    out[_nearest_frame(run, last[0])] = f"end of repetition {number[0]}"
    waiting = np.flatnonzero(~run.sliding[run.frames] & (run.repetition[run.frames] == number[0]))
    if len(waiting):
        k = run.frames[waiting[-1]]
        lifted = " (lifted)" if not run.pressure[k].any() else ""
        out[int(waiting[-1])] = f"after {theme.format_decimal(run.time[k] - axis.end[0], 3)} s of waiting{lifted}"
    out[_nearest_frame(run, last[-1])] = f"end of repetition {number[-1]}"
    return {i: f"t = {theme.format_decimal(run.time[run.frames[i]])} s\n{words}" for i, words in out.items()}


def _nearest_frame(run, k: int) -> int:
    """The frame closest to record k."""
    return int(np.argmin(np.abs(run.frames - k)))


def _draw_bodies(ax, run, cells: np.ndarray, norm, up: float, down: float):
    """Block up to `up` and road down to `down` (m), linear between cell centres, drawn in mm."""
    mesh = run.mesh
    half = 0.5 * np.diff(mesh.depth)
    _draw_body(ax, cells[mesh.road[:, ::-1]], mesh.x_centre, mesh.depth[:-1] + half, mesh.x[[0, -1]], -down, norm)
    half = 0.5 * np.diff(mesh.height)
    edges = mesh.x[[mesh.first, mesh.last]]
    picture = _draw_body(ax, cells[mesh.block], run.x, mesh.height[:-1] + half, edges, up, norm)
    ax.vlines(1e3 * edges, 0.0, 1e3 * up, color=theme.AMBIENT_COLOUR, lw=0.6)
    if up >= mesh.height[-1]:
        ax.hlines(1e3 * up, *(1e3 * edges), color=theme.AMBIENT_COLOUR, lw=0.6)
    return picture


def _draw_body(ax, values, x_cell, z_cell, x_ends, far: float, norm):
    """One body: `values` (lines, cells outwards from the contact), drawn to z = `far` (m), < 0 for the road."""
    x = np.linspace(x_ends[0], x_ends[1], FIELD_COLUMNS + 1)
    z = np.linspace(0.0, abs(far), FIELD_ROWS + 1)
    T = interpolate_linear(values, x_cell, 0.5 * (x[1:] + x[:-1]))
    T = interpolate_linear(T.T, z_cell, 0.5 * (z[1:] + z[:-1]))
    return ax.pcolormesh(
        1e3 * x, 1e3 * np.sign(far) * z, T, cmap=theme.temperature_map(), norm=norm, rasterized=True
    )  # fmt: skip


def _near_contact_reach(run, cells: np.ndarray) -> tuple[float, float]:
    """Reach (m) of the stretched panels into block and road: that of the heat, rounded up and limited."""
    mesh, out = run.mesh, []
    under = mesh.road[mesh.first : mesh.last, ::-1]
    for body, edges, limit in ((mesh.block, mesh.height, MAX_BLOCK_NEAR_M), (under, mesh.depth, MAX_ROAD_NEAR_M)):
        rise = np.abs(cells[body] - run.ambient_degC).max(axis=0)
        warm = np.flatnonzero(rise > MIN_RISE_FRACTION * max(rise[0], 1e-6))
        far = theme.nice_ceil(float(edges[warm[-1] + 1])) if len(warm) else limit
        out.append(min(far, limit, float(edges[-1])))
    return out[0], out[1]


def _stretch_axis(ax, block: float, road: float) -> None:
    """z linear on either side of the contact, with its own scale in block and road (mm)."""

    def to_scale(z):
        return np.where(z > 0, z / block, z / road)

    def from_scale(s):
        return np.where(s > 0, s * block, s * road)

    ax.set_yscale("function", functions=(to_scale, from_scale))
    ax.set_ylim(-road, block)
    ticks = [-road, -road / 2, 0.0, block / 2, block]
    ax.set_yticks(ticks, [f"{t:.3g}".replace("-", "\N{MINUS SIGN}") for t in ticks])
    ax.axhline(0.0, color="white", lw=0.6)


def _field_caption(run, shown: float) -> str:
    deep = float(run.mesh.depth[-1])
    crop = f", with {1e3 * shown:.3g} mm of the {1e3 * deep:.3g} mm deep road" if deep > shown else ""
    middle = " In the middle of the width." if run.mesh.n_across > 1 else ""
    return (
        f"Block z > 0, road z < 0 (in the heated tracks).{middle} Above: to scale{crop}. "
        "Below: the layers next to the contact, with different scales of z in block and road."
    )
