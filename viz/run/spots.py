"""Resolved contact spots: the face of the block with their outlines, and T(x) in and between them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from flashtemp.viz import theme
from flashtemp.viz.run import run_views
from flashtemp.viz.run.animation import select_frames, write_gif

PICTURE = "spots"
ANIMATION = "spots"
SPOT_FRAME_MS, SPOT_LAST_FRAME_MS = 120, 1500  # of a frame, and of the last one


def applies(run) -> bool:
    """Whether the spots are resolved by the mesh."""
    return run_views.has_fields(run) and "cover" in run.maps


@theme.styled
def draw(run, frame: int = -1) -> Figure:
    """Face of the block (degC, mm) with the spots outlined; along x, T in the spots and the mean across y."""
    mesh, k = run.mesh, range(len(run.frames))[frame]
    face, cover = run.maps["T_block"][k].astype(float), run.maps["cover"][k]
    L, y = 1e3 * mesh.x[mesh.last], 1e3 * mesh.y[[0, -1]]
    fig = theme.make_figure("Temperature in the contact spots", run.title, theme.WIDE_FIGURE_IN, 3.9)
    fig.set_dpi(100)
    left, right = fig.subplots(1, 2, width_ratios=[1.25, 1.0])
    norm = theme.temperature_norm(run.maps["T_block"][-1], np.where(cover > 0.5, face, np.nan), run.ambient_degC)
    edges = 1e3 * mesh.x[mesh.first : mesh.last + 1], 1e3 * mesh.y
    image = left.pcolormesh(*edges, face.T, cmap=theme.temperature_map(), norm=norm, rasterized=True)
    if np.ptp(cover) > 0:
        left.contour(1e3 * run.x, 1e3 * mesh.y_centre, cover.T, [0.5], colors="white", linewidths=0.9)
    left.set(
        xlim=(0.0, L),
        ylim=y,
        xlabel="x from leading edge (mm)",
        ylabel="y (mm)",
        title="face of the block, spots outlined",
    )
    left.set_aspect("equal")
    left.spines[:].set_visible(False)
    theme.add_colour_bar(fig, image, left, f"temperature ({theme.CELSIUS})", pad=0.02, shrink=0.8)
    covered = run.maps["cover"]
    best = covered.max(axis=(1, 2), keepdims=True)  # coarse cells may be covered only in part
    inside = (covered >= 0.9 * best) & (covered > 0.0)
    x = np.repeat(1e3 * run.x[:, None], mesh.n_across, axis=1)
    hot = run.maps["T_spot"]
    right.plot(x[inside[k]], hot[k][inside[k]], ".", color=theme.SPOT_COLOUR, ms=1.5, alpha=0.35, label="in the spots")
    right.plot(1e3 * run.x, face @ mesh.share, color=theme.BLOCK_COLOUR, label="block, averaged across y")
    high = float(hot[inside].max(initial=run.ambient_degC))
    right.set(xlim=(0.0, L), ylim=(run.ambient_degC - 0.5, high + 0.5), xlabel="x from leading edge (mm)",
              ylabel=f"temperature ({theme.CELSIUS})", title="along the contact")  # fmt: skip
    right.legend(loc="upper left", markerscale=4)
    slid = 1e3 * run.slid[run.frames[k]]
    theme.add_caption(fig, f"t = {run.time[run.frames[k]]:.3f} s, slid {slid:.0f} mm")
    return fig


def write(run, path) -> Path:
    """Write the animation of the contact as .gif: the stored frames of sliding, at most MAX_ANIMATION_FRAMES."""
    kept = [k for k in select_frames(run) if run.sliding[run.frames[k]]]
    write_gif(
        Path(path),
        (_render_pixels(draw(run, k)) for k in kept),
        [SPOT_FRAME_MS] * (len(kept) - 1) + [SPOT_LAST_FRAME_MS],
    )
    return Path(path)


def _render_pixels(fig: Figure) -> np.ndarray:
    canvas = FigureCanvasAgg(fig)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3]
