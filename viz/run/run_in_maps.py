"""The run-in, one panel per repetition: side wall of the block, temperature in its contact, wake on the road."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from flashtemp.viz import theme
from flashtemp.viz.run import run_views
from flashtemp.viz.time_axis import sliding_ends

PICTURE = "run_in"
MAX_PANELS = 12
PANEL_COLUMNS = 2  # read downwards, so that the motion of the hot spot along x is visible
PANEL_WIDTH_IN = 2.75  # approximate
MIN_HOT_SPOT_K = 0.05  # smallest temperature range of the contact with a marked hot spot


def applies(run) -> bool:
    """Whether there are several repetitions."""
    return run_views.has_fields(run) and run_views.has_repetitions(run)


@theme.styled
def draw(run) -> Figure:
    """Temperatures (degC) at the end of every repetition, over x and z (mm), in one colour scale.

    Each panel: the side wall, and below it a strip with the contact (in the spots) and the road surface behind the
    block.  At most MAX_PANELS repetitions, spread evenly and including first and last.
    """
    frames = list(run_views.last_frames(run).items())
    frames = [frames[i] for i in theme.spread_indices(len(frames), MAX_PANELS)]
    rows = -(-len(frames) // PANEL_COLUMNS)
    height = 1.15 + rows * (0.24 + _panel_height(run))
    fig = theme.make_figure("Temperature at the end of each repetition", run.title, theme.WIDE_FIGURE_IN, height)
    axes = fig.subplots(rows, PANEL_COLUMNS, squeeze=False, sharex=True, sharey=True)
    fig.get_layout_engine().set(hspace=0.03, wspace=0.04)
    norm = theme.temperature_norm(run_views.temperature_extremes(run, [i for _, i in frames]))
    panels = axes.T.ravel()
    for ax, (repetition, frame) in zip(panels, frames, strict=False):
        picture = run_views.draw_views(ax, run, frame, norm)[0]
        _label_panel(ax, run, repetition, frame)
    for ax in panels[len(frames) :]:
        ax.set_axis_off()
    _label_axes(axes, run, len(frames))
    theme.add_colour_bar(fig, picture, axes, f"temperature ({theme.CELSIUS})", pad=0.015, aspect=9 * rows)
    theme.add_caption(fig, _run_in_caption(run, [i for _, i in frames]))
    return fig


def _label_panel(ax, run, repetition: int, frame: int) -> None:
    """Label the repetition; mark and label the hottest place of the contact."""
    ax.set_title(f"repetition {repetition}", fontweight="bold", pad=3)
    T = np.where(run.pressure[run.frames[frame]] > 0, run.T_spot[run.frames[frame]], np.nan)
    if np.isfinite(T).any() and np.nanmax(T) - np.nanmin(T) > MIN_HOT_SPOT_K:
        i = int(np.nanargmax(T))
        ax.set_title(f"hottest {T[i]:.1f} {theme.CELSIUS} at {1e3 * run.x[i]:.1f} mm", loc="right", pad=3)
        ax.plot(1e3 * run.x[i], ax.get_ylim()[0], "^", color="black", ms=4.0, clip_on=False, zorder=5)


def _label_axes(axes, run, count: int) -> None:
    """Axis labels at the left, and below the lowest panel of every column."""
    rows = len(axes)
    for row, column in np.ndindex(axes.shape):
        ax, number = axes[row, column], column * rows + row
        lowest = number == count - 1 or (row == rows - 1 and number < count)
        ax.tick_params(axis="x", bottom=lowest, labelbottom=lowest, pad=4)
        ax.xaxis.set_in_layout(row == rows - 1)  # labels above an empty panel use its space
        if lowest:
            ax.set_xlabel(theme.x_axis_label(run))
        if column == 0:
            ax.set_ylabel("side wall\nz (mm)")


def _panel_height(run) -> float:
    """Height (inches) of a panel: to scale, within legible limits."""
    ratio = (1.0 + run_views.STRIP_GAP_RATIO + run_views.STRIP_HEIGHT_RATIO) * run.mesh.height[-1] / run.mesh.x[-1]
    return float(np.clip(PANEL_WIDTH_IN * ratio, 0.6, 1.6))


def _run_in_caption(run, frames: list[int]) -> str:
    """Explanation of the panels, from top to bottom."""
    ended = np.isin(run.frames[frames], sliding_ends(run)).all()
    words = ["At the end of sliding." if ended else "At the last stored field of sliding."]
    words.append("Side wall: in 2D the section of the block.")
    words.append("Contact: in the macroasperity contact regions, hottest at the triangle.")
    if run_views.has_wake(run):
        shown = 1e3 * (run.mesh.x[-1] - run.mesh.x[run.mesh.last])
        road, side = ("Wake", "behind") if run.direction is None else ("Road", "next to")
        surface = f"{road}: surface of the road averaged across y, over heated tracks and gaps"
        words.append(f"{surface}, {theme.format_decimal(shown, 3)} mm {side} the block.")
    if any(np.isnan(run_views.contact_strip(run, i)).any() for i in frames):
        words.append("White: no contact.")
    directions = {"left" if run.leading_line_index(k) == 0 else "right" for k in run.frames[frames]}
    return " ".join([*words, f"The block slides to the {' or the '.join(sorted(directions))}."])
