"""Preview of camera files before import: frames, mean over time, histogram; and PNG encoding of frames."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import ListedColormap, Normalize, to_rgba
from matplotlib.figure import Figure

from flashtemp.viz import theme

IMAGES_PER_ROW, CHARTS_HEIGHT_IN = 3, 2.1
OUT_OF_RANGE_COLOUR = "#D0D0D0"  # pixels outside the camera's range
DEAD_PIXEL_COLOUR = "#00D5D5"  # pixels without a value in any frame


@theme.styled
def draw(look) -> Figure:
    """Images of a FilePreview over column and row (px) in one colour scale; below, mean over time and histogram."""
    n, (high, wide) = len(look.images), look.images.shape[1:]
    columns, rows = min(n, IMAGES_PER_ROW), -(-n // IMAGES_PER_ROW)
    tall = rows * (np.clip(high / wide, 0.2, 1.4) * theme.WIDE_FIGURE_IN / max(columns, 1.6) + 0.35) + 0.3
    height = 0.4 + tall + CHARTS_HEIGHT_IN
    fig = theme.make_figure("Images as recorded", str(look).splitlines()[0], theme.WIDE_FIGURE_IN, height)
    above, below = fig.subfigures(2, 1, height_ratios=[tall, CHARTS_HEIGHT_IN], squeeze=False)[:, 0]
    plain_range = look.difference or look.counted
    norm = Normalize(*theme.padded_limits(look.images, least=1e-3, margin=0.0)) if plain_range else None
    norm = norm or theme.temperature_norm(look.images)
    words = {"K": "difference of temperatures (K)", "counts": "counts of the camera"}
    label = words.get(look.unit, f"temperature ({theme.CELSIUS})")
    axes = above.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
    for ax, image, number in zip(axes, look.images, look.shown, strict=False):
        shown = ax.imshow(image, cmap=theme.temperature_map(), norm=norm, interpolation="nearest")
        ax.set_facecolor(OUT_OF_RANGE_COLOUR)
        ax.imshow(np.where(look.dead, 1.0, np.nan), cmap=ListedColormap([DEAD_PIXEL_COLOUR]), interpolation="nearest")
        ax.set_title(_describe_time(look, int(number)))
    for ax in axes[n:]:
        ax.remove()
    axes[0].set_ylabel("row (px)")
    for ax in axes[max(0, n - columns) : n]:
        ax.set_xlabel("column (px)")
    theme.add_colour_bar(above, shown, list(axes[:n]), label, fraction=0.04)
    *left, right = below.subplots(1, 2, width_ratios=[1.5, 1.0]) if len(look.mean) > 1 else [below.subplots()]
    for ax in left:  # one value makes no curve
        _draw_mean_over_time(ax, look)
    right.stairs(look.counts, look.edges, fill=True, color=theme.BLOCK_COLOUR)
    right.set(xlabel=label, ylabel="values", yscale="log")
    return fig


def _describe_time(look, number: int) -> str:
    """Number and time of a frame, as far as the file gives it."""
    if len(look.mean) == 1:
        return "the only frame"
    if look.time is not None:
        return f"frame {number}, {theme.format_decimal(look.time[number])} s"
    if look.clock is not None:
        return f"frame {number}, {theme.format_decimal(look.clock[number] - look.clock[0])} s after the first"
    return f"frame {number}"


def _draw_mean_over_time(ax, look) -> None:
    """Mean of every frame over the time in the file, or over the frame number."""
    x, label = np.arange(len(look.mean)), "frame"
    if look.time is not None:
        x, label = look.time, "time (s)"
    elif look.clock is not None:
        x, label = look.clock - look.clock[0], "time after the first frame (s)"
    ax.plot(x, look.mean, "o" if len(x) < 60 else "-", ms=3, color="#2B2B2B")
    ax.set(xlabel=label, ylabel=f"mean of the image ({theme.CELSIUS if look.unit == 'degC' else look.unit})")


def encode_png(image: np.ndarray, low: float, high: float, zoom: int = 1, dead: np.ndarray | None = None) -> bytes:
    """One image (rows, columns) in degC as PNG in the colours of temperature, every pixel magnified to `zoom` x `zoom`.

    Pixels without a value are grey, or cyan where they are `dead` (rows, columns).
    """
    from io import BytesIO

    from matplotlib.image import imsave

    colours = theme.temperature_map()((image - low) / max(high - low, 1e-9), bytes=True)
    colours[~np.isfinite(image)] = [round(255 * c) for c in to_rgba(OUT_OF_RANGE_COLOUR)]
    if dead is not None:
        colours[dead] = [round(255 * c) for c in to_rgba(DEAD_PIXEL_COLOUR)]
    out = BytesIO()
    imsave(out, np.repeat(np.repeat(colours, zoom, axis=0), zoom, axis=1), format="png")
    return out.getvalue()
