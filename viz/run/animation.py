"""Animation of the run-in over the stored frames of a run, as GIF or, with ffmpeg, as MP4."""

from __future__ import annotations

import shutil
import subprocess
from contextlib import suppress
from pathlib import Path
from typing import IO, cast

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

from flashtemp.errors import BadInput
from flashtemp.viz import theme
from flashtemp.viz.run import run_views
from flashtemp.viz.run.animation_frame import ANIMATION_DPI, ANIMATION_SIZE_IN, AnimationFigure, reduced_temperature_map

ANIMATION = "run_in"
MAX_ANIMATION_FRAMES = 80  # frames
ANIMATION_LENGTH_S = 14.0  # approximate length of the whole animation
MIN_FRAME_MS, MAX_FRAME_MS, LAST_FRAME_MS = 80, 400, 1500  # of a frame, and of the last one
MP4_FRAMES_PER_S = 25  # constant rate of an MP4
FADING_COLOURS = (
    "black",
    theme.SPOT_COLOUR,
    theme.BLOCK_COLOUR,
)  # anti-aliased lines and letters fade from these into white


def applies(run) -> bool:
    """Whether there are several repetitions."""
    return run_views.has_fields(run) and run_views.has_repetitions(run)


@theme.styled
def draw(run, frame: int = -1) -> Figure:
    """One frame of the animation, `frame` of run.field: temperatures in degC, lengths in mm."""
    animated = AnimationFigure(run, select_frames(run))
    animated.show_frame(range(len(run.frames))[frame])
    return animated.fig


@theme.styled
def write(run, path) -> Path:
    """Write the animation as .gif, or as .mp4 where ffmpeg is installed; BadInput for anything else."""
    path, kept = Path(path), select_frames(run)
    kind = path.suffix.lower()
    if kind not in (".gif", ".mp4"):
        raise BadInput(f"{path}: no animation can be written as '{path.suffix}'; name a file ending .gif or .mp4")
    if kind == ".mp4" and not shutil.which("ffmpeg"):
        raise BadInput(f"{path}: MP4 needs ffmpeg, which is not installed; install it or name a file ending .gif")
    (write_gif if kind == ".gif" else _write_mp4)(
        path, AnimationFigure(run, kept).render_frames(kept), frame_durations(run, kept)
    )
    return path


def select_frames(run) -> list[int]:
    """Indices into run.field: all frames, or at most MAX_ANIMATION_FRAMES of evenly spread repetitions."""
    repetition = run.repetition[run.frames]
    numbers, counts = np.unique(repetition, return_counts=True)
    kept = numbers[theme.spread_indices(len(numbers), max(2, MAX_ANIMATION_FRAMES // counts.max()))]
    few = len(repetition) <= MAX_ANIMATION_FRAMES
    frames = np.arange(len(repetition)) if few else np.flatnonzero(np.isin(repetition, kept))
    return frames[theme.spread_indices(len(frames), MAX_ANIMATION_FRAMES)].tolist()


def frame_durations(run, kept: list[int]) -> list[int]:
    """Durations (ms): proportional to the square root of the time to the next frame, so that fast changes show."""
    steps = np.sqrt(np.diff(run.time[run.frames[kept]]))
    ms = np.clip(1e3 * ANIMATION_LENGTH_S * steps / steps.sum(), MIN_FRAME_MS, MAX_FRAME_MS)
    return [*(10 * round(v / 10) for v in ms), LAST_FRAME_MS]


def write_gif(path: Path, pictures, durations_ms: list[int]) -> None:
    """Write a looping GIF with one palette and no dithering, so that only changed pixels are stored."""
    from PIL import Image

    palette, images = _make_palette(), []
    nearest = NearestColours(palette)
    for picture in pictures:
        images.append(Image.fromarray(nearest(picture), mode="P"))
        images[-1].putpalette(palette.ravel().tolist())
    images[0].save(path, save_all=True, append_images=images[1:], duration=durations_ms, loop=0, optimize=False)


def _make_palette() -> np.ndarray:
    """Colours (n, 3), 0 to 255: those of temperature, and of lines and letters fading into white."""
    fade = np.linspace(0.0, 1.0, 30)[:, None]
    lines = [to_rgb(c) + fade * (1.0 - np.array(to_rgb(c))) for c in FADING_COLOURS]
    return np.rint(255 * np.concatenate([reduced_temperature_map().colors[:, :3], *lines])).astype(np.uint8)


class NearestColours:
    """Indices of the nearest colours of a palette (n, 3); the result for every colour is cached."""

    def __init__(self, palette: np.ndarray):
        self.tree = cKDTree(palette.astype(float))
        self.number = np.full(256**3, -1, dtype=np.int16)

    def __call__(self, pixels: np.ndarray) -> np.ndarray:
        """Palette indices (height, width) of pixels (height, width, 3)."""
        red, green, blue = (pixels[..., k].astype(np.int32) for k in range(3))
        code = red << 16 | green << 8 | blue
        nearest = self.number[code]
        if len(new := np.unique(code[nearest < 0])):
            self.number[new] = self.tree.query(np.stack([new >> 16, new >> 8 & 255, new & 255], axis=-1))[1]
            nearest = self.number[code]
        return nearest.astype(np.uint8)


def _write_mp4(path: Path, pictures, durations_ms: list[int]) -> None:
    """Write an MP4 of constant rate; ffmpeg reads the pixels from a pipe."""
    width, height = (round(inches * ANIMATION_DPI) for inches in ANIMATION_SIZE_IN)
    source = f"-f rawvideo -pix_fmt rgb24 -s {width}x{height} -r {MP4_FRAMES_PER_S} -i -".split()
    target = ["-vf", "crop=trunc(iw/2)*2:trunc(ih/2)*2", "-pix_fmt", "yuv420p", str(path)]
    command = ["ffmpeg", "-loglevel", "error", "-y", *source, *target]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        pipe = cast(IO[bytes], process.stdin)
        with suppress(BrokenPipeError):  # ffmpeg has failed; its reason is on stderr
            for picture, duration in zip(pictures, durations_ms, strict=True):
                pipe.write(picture.tobytes() * max(1, round(1e-3 * duration * MP4_FRAMES_PER_S)))
        _, stderr = process.communicate()
    if process.returncode:
        words = stderr.decode(errors="replace").strip().splitlines() or ["no reason given"]
        raise BadInput(f"{path}: ffmpeg could not write it: {words[-1]}")
