"""The figure of the animation: views of the block, T(x), p(x) and friction, with artists that follow the frames.

A panel draws its static artists once and returns the moving ones with a function that sets them to a frame.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import ListedColormap

from flashtemp.viz import theme
from flashtemp.viz.run import run_views
from flashtemp.viz.time_axis import repetition_axis, sliding_ends

ANIMATION_SIZE_IN, ANIMATION_DPI = (8.0, 4.7), 120  # inches, and dots per inch
N_TEMPERATURE_COLOURS = 160  # the rest of the 256 colours of a GIF is for lines and letters
LIFT_FRACTION = 0.14  # lift of a raised block, in heights of the block
GHOST_STYLE = {"color": "#B0B0B0", "lw": 1.0, "ls": (0, (4, 2))}
MIN_FRICTION_SPAN = 0.02  # smallest range of the friction axis


class MovingPanel(NamedTuple):
    """The moving artists of an axes, and the function that sets them to a frame."""

    artists: list
    show: Callable[[int], None]


class AnimationFigure:
    """The figure of a run for the frames `kept` (indices into run.field)."""

    def __init__(self, run, kept: list[int]):
        self.fig = theme.make_figure("Temperature and friction over time", run.title, *ANIMATION_SIZE_IN)
        self.fig.set_dpi(ANIMATION_DPI)
        self.fig.get_layout_engine().set(wspace=0.03, hspace=0.04)
        axes = self.fig.subplots(2, 2, width_ratios=[1.5, 1.0], height_ratios=[1.0, 0.95])
        self.panels = [
            panel(axes[place], run, kept)
            for place, panel in (
                ((0, 0), _add_block),
                ((0, 1), _add_temperature),
                ((1, 0), _add_friction),
                ((1, 1), _add_pressure),
            )
        ]
        self.show_frame(kept[0])

    def show_frame(self, frame: int) -> None:
        """Set every panel to a frame."""
        for panel in self.panels:
            panel.show(frame)

    def render_frames(self, kept: list[int]) -> Iterator[np.ndarray]:
        """Pixels (height, width, 3) of every frame in `kept`."""
        canvas = FigureCanvasAgg(self.fig)
        self.fig.draw_without_rendering()
        self.fig.set_layout_engine("none")
        # static artists are drawn once and blitted below the moving ones
        moving = [artist for panel in self.panels for artist in panel.artists]
        for artist in moving:
            artist.set_animated(True)
        canvas.draw()
        background = canvas.copy_from_bbox(self.fig.bbox)
        for frame in kept:
            canvas.restore_region(background)
            self.show_frame(frame)
            for artist in moving:
                artist.axes.draw_artist(artist)
            yield np.array(canvas.buffer_rgba())[..., :3]


def reduced_temperature_map() -> ListedColormap:
    """The temperature map reduced to N_TEMPERATURE_COLOURS colours."""
    return ListedColormap(theme.temperature_map()(np.linspace(0.0, 1.0, N_TEMPERATURE_COLOURS)), name="animation")


def _add_block(ax, run, kept) -> MovingPanel:
    """Side wall, contact and wake; a lifted block is drawn above the road."""
    norm = theme.temperature_norm(run_views.temperature_extremes(run, kept))
    images = run_views.draw_views(ax, run, kept[0], norm, reduced_temperature_map())
    theme.add_colour_bar(ax.figure, images[0], ax, f"temperature ({theme.CELSIUS})", pad=0.01, aspect=18)
    height = 1e3 * run.mesh.height[-1]
    ax.set(
        xlabel=theme.x_axis_label(run),
        ylabel="side wall, z (mm)",
        ylim=(ax.get_ylim()[0], (1 + LIFT_FRACTION) * height),
    )
    titles = [ax.set_title(" ", fontweight="bold"), ax.set_title(" ", loc="right")]
    left, right, *_ = images[0].get_extent()
    apart = ax.text(0.5 * right, ax.get_yticks()[0], "no contact", color=theme.AMBIENT_COLOUR, ha="center", va="center")

    def show(frame):
        k = run.frames[frame]
        up = 0.0 if run.pressure[k].any() else LIFT_FRACTION * height
        run_views.update_views(images, run, frame)
        images[0].set_extent((left, right, up, up + height))
        apart.set_visible(up > 0.0)
        for title, text in zip(titles, describe_state(run, k), strict=True):
            title.set_text(text)

    return MovingPanel([*images, *ax.collections, apart, *titles], show)


def describe_state(run, k: int) -> tuple[str, str]:
    """Repetition and state of the block at record k, and its time, in words."""
    resting = "waiting in contact" if run.pressure[k].any() else "waiting, lifted"
    unit, size = repetition_axis(run).unit
    state = f"repetition {run.repetition[k]} of {run.repetition[-1]}: {'sliding' if run.sliding[k] else resting}"
    return state, f"t = {run.time[k] / size:.{1 if size == 1 else 2}f} {unit}"


def _add_temperature(ax, run, kept) -> MovingPanel:
    """T(x) in the spots and averaged across y; dashed: the end of the first repetition."""
    x, first = 1e3 * run.x, sliding_ends(run)[0]
    spots = np.where(run.pressure > 0, run.T_spot, np.nan)
    (spot,) = ax.plot(x, spots[first], color=theme.SPOT_COLOUR, label="in the spots")
    (block,) = ax.plot(x, run.T_block[first], color=theme.BLOCK_COLOUR, label="mean across y", zorder=1.9)
    ax.plot(x, spots[first], **GHOST_STYLE, zorder=1, label=f"in the spots, repetition {run.repetition[first]}")
    at = run.frames[kept]
    ax.set(xlim=(0.0, 1e3 * run.mesh.x[run.mesh.last]), ylabel=f"temperature ({theme.CELSIUS})")
    ax.set_ylim(*theme.padded_limits(spots[at], run.T_block[at], run.ambient_degC, least=1.0))
    ax.tick_params(labelbottom=False)
    ax.legend(loc="lower right", bbox_to_anchor=(1.03, 1.0), ncols=2, columnspacing=1.0, handlelength=1.5)

    def show(frame):
        spot.set_ydata(spots[run.frames[frame]])
        block.set_ydata(run.T_block[run.frames[frame]])

    return MovingPanel([spot, block], show)


def _add_pressure(ax, run, kept) -> MovingPanel:
    """Nominal contact pressure p(x); dashed: the first one."""
    at = run.frames[kept]
    start = int(np.argmax(run.pressure.any(axis=1)))
    x, p = 1e3 * run.x, 1e-6 * run.pressure
    (line,) = ax.plot(x, p[start], color="black", label="now")
    ax.plot(x, p[start], **GHOST_STYLE, zorder=1, label="at the start")
    ax.set(xlim=(0.0, 1e3 * run.mesh.x[run.mesh.last]), ylim=(0.0, max(1e-6, 1.06 * p[[start, *at]].max())))
    ax.set(xlabel=theme.x_axis_label(run), ylabel="pressure, nominal (MPa)")
    ax.legend(loc="upper right")
    return MovingPanel([line], lambda frame: line.set_ydata(p[run.frames[frame]]))


def _add_friction(ax, run, kept) -> MovingPanel:
    """Friction over the slid distance: grey ahead, black behind, a dot at the present."""
    mu = np.where(run.sliding, run.friction, np.nan)
    ax.plot(run.slid, mu, color=GHOST_STYLE["color"], lw=0.8)
    (past,) = ax.plot([], [], color="black", lw=1.2)
    (now,) = ax.plot([], [], "o", color=theme.SPOT_COLOUR, ms=5.0)
    ax.set(xlim=(run.slid[0], 1.02 * run.slid[-1]), ylim=theme.padded_limits(mu, least=MIN_FRICTION_SPAN, margin=0.08))
    ax.set(xlabel="slid distance (m)", ylabel="friction coefficient (–)")

    def show(frame):
        k = run.frames[frame]
        last = np.flatnonzero(np.isfinite(mu[: k + 1]))[-1:]
        past.set_data(run.slid[: k + 1], mu[: k + 1])
        now.set_data(run.slid[last], mu[last])

    return MovingPanel([past, now], show)
