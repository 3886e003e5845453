"""Views of a stored frame: side wall of the block, its contact, and the wake on the road behind it.

Images in degC on evenly spaced pixels, linear between cell centres.
"""

from __future__ import annotations

import numpy as np

from flashtemp.meshes.mesh import centres
from flashtemp.physics.interpolation import interpolate_linear
from flashtemp.viz import theme
from flashtemp.viz.time_axis import sliding_ends

VIEW_COLUMNS, VIEW_ROWS = 400, 112  # pixels along and up the block: finer than those of every picture
STRIP_HEIGHT_RATIO, STRIP_GAP_RATIO = (
    0.24,
    0.06,
)  # height of the strip and its distance from the block, in heights of the block
MAX_BLOCK_FRACTION_LABELLED = 0.85  # the wake is labelled where the block takes less of the axis


def side_wall(run, frame: int) -> np.ndarray:
    """Block temperature (VIEW_ROWS, VIEW_COLUMNS) over z and x at the side wall y < 0; in 2D the section."""
    mesh = run.mesh
    T = interpolate_linear(
        run.section(frame, 0)[mesh.block], run.x, _pixel_centres(0.0, mesh.x[mesh.last], VIEW_COLUMNS)
    )
    return interpolate_linear(T.T, centres(mesh.height), _pixel_centres(0.0, mesh.height[-1], VIEW_ROWS))


def contact_strip(run, frame: int) -> np.ndarray:
    """Temperature in the spots (1, VIEW_COLUMNS) along the block, nan where the block does not touch the road."""
    mesh, k = run.mesh, run.frames[frame]
    x = _pixel_centres(0.0, mesh.x[mesh.last], VIEW_COLUMNS)
    spots = interpolate_linear(run.T_spot[k][:, None], run.x, x).T
    line = np.searchsorted(mesh.x[mesh.first : mesh.last + 1], x, side="right") - 1
    return np.where(run.pressure[k][line] > 0, spots, np.nan)


def wake_strip(run, frame: int) -> np.ndarray:
    """Road surface (1, VIEW_COLUMNS) from the trailing edge to the end of the road shown, averaged across y."""
    mesh = run.mesh
    x = _pixel_centres(mesh.x[mesh.last], mesh.x[-1], VIEW_COLUMNS)
    return interpolate_linear(road_surface(run, frame)[:, None], mesh.x_centre[mesh.last :], x).T


def road_surface(run, frame: int) -> np.ndarray:
    """Road surface beyond x = L (lines,) in degC, averaged across y as by a camera: wake, or road ahead."""
    k = run.frames[frame]
    back = run.direction is not None and run.direction[k] < 0
    return run.T_ahead[k][::-1] if back else run.T_wake[k]


def has_wake(run) -> bool:
    """Whether any road behind the block was simulated."""
    return run.mesh.last < run.mesh.n_lines


def temperature_extremes(run, frames) -> np.ndarray:
    """Lowest and highest temperature (degC) in the three views of these frames."""
    values = [run.section(i, 0)[run.mesh.block] for i in frames]
    values.append(np.where(run.pressure[run.frames[frames]] > 0, run.T_spot[run.frames[frames]], np.nan))
    values.extend(road_surface(run, i) for i in frames)
    flat = np.concatenate([np.ravel(v) for v in values])
    return np.array([np.nanmin(flat), np.nanmax(flat)])


def draw_views(ax, run, frame: int, norm, cmap=None) -> list:
    """Draw the side wall above a strip of contact and wake (mm); returns their images in this order."""
    length, height, far = 1e3 * np.array([run.mesh.x[run.mesh.last], run.mesh.height[-1], run.mesh.x[-1]])
    strip = (-(STRIP_GAP_RATIO + STRIP_HEIGHT_RATIO) * height, -STRIP_GAP_RATIO * height)
    extents = {
        side_wall: (0.0, length, 0.0, height),
        contact_strip: (0.0, length, *strip),
        wake_strip: (length, far, *strip),
    }
    if not has_wake(run):
        del extents[wake_strip]
    style = {"cmap": cmap or theme.temperature_map(), "norm": norm, "origin": "lower", "interpolation": "nearest"}
    images = [ax.imshow(view(run, frame), extent=e, aspect="auto", **style) for view, e in extents.items()]
    ax.vlines(length, *strip, color="white", lw=1.0)
    if length < MAX_BLOCK_FRACTION_LABELLED * far:
        ax.text(far, 0.0, "wake" if run.direction is None else "road", ha="right", fontsize=7.5)
    ax.set(xlim=(0.0, far), ylim=(strip[0], height))
    ax.set_yticks([np.mean(strip), 0.0, height], ["contact", "0", theme.format_decimal(height)])
    ax.yaxis.get_major_ticks()[1].label1.set_verticalalignment("bottom")  # clear of the label below
    ax.tick_params(axis="y", length=0)
    ax.spines[["left", "bottom"]].set_visible(False)
    return images


def update_views(images: list, run, frame: int) -> None:
    """Set the images of `draw_views` to another frame."""
    for image, view in zip(images, (side_wall, contact_strip, wake_strip), strict=False):
        image.set_data(view(run, frame))


def last_frames(run) -> dict[int, int]:
    """The last frame of sliding of every repetition, {repetition: index into run.field}."""
    sliding = np.flatnonzero(run.sliding[run.frames])
    return {int(run.repetition[run.frames[i]]): int(i) for i in sliding}


def has_fields(run) -> bool:
    """Whether the run has temperature fields, which a finished run has only if it saved them."""
    return len(run.frames) > 0


def has_repetitions(run) -> bool:
    """Whether a run has more than one repetition to compare."""
    return len(sliding_ends(run)) > 1


def _pixel_centres(low: float, high: float, count: int) -> np.ndarray:
    """Centres (count,) of evenly spaced pixels from `low` to `high` (m)."""
    return centres(np.linspace(low, high, count + 1))
