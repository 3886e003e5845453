"""The run-in as an animation over the kept frames of a run, a GIF or, with ffmpeg, an MP4."""

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
ANIMATION_LENGTH_S = 14.0  # of the whole animation, about
MIN_FRAME_MS, MAX_FRAME_MS, LAST_FRAME_MS = 80, 400, 1500  # ms of a frame, and of the last one
MP4_FRAMES_PER_S = 25  # pictures per second of an MP4
FADING_COLOURS = ("black", theme.SPOT_COLOUR, theme.BLOCK_COLOUR)  # that fade into white where a line ends


def applies(run) -> bool:
    """Whether there are repetitions to follow."""
    return run_views.has_repetitions(run)


@theme.styled
def draw(run, frame: int = -1) -> Figure:
    """One picture of the animation: frame `frame` of run.field, temperatures in degC, lengths in mm."""
    screen = AnimationFigure(run, select_frames(run))
    screen.show_frame(range(len(run.frames))[frame])
    return screen.fig


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
    """Indices into run.field that are shown: all, or those of evenly chosen repetitions, at most MAX_ANIMATION_FRAMES."""
    of = run.repetition[run.frames]
    numbers, counts = np.unique(of, return_counts=True)
    kept = numbers[theme.spread_indices(len(numbers), max(2, MAX_ANIMATION_FRAMES // counts.max()))]
    found = np.arange(len(of)) if len(of) <= MAX_ANIMATION_FRAMES else np.flatnonzero(np.isin(of, kept))
    return found[theme.spread_indices(len(found), MAX_ANIMATION_FRAMES)].tolist()


def frame_durations(run, kept: list[int]) -> list[int]:
    """Milliseconds of every frame: as the root of the time to the next, so that fast changes can be followed."""
    steps = np.sqrt(np.diff(run.time[run.frames[kept]]))
    ms = np.clip(1e3 * ANIMATION_LENGTH_S * steps / steps.sum(), MIN_FRAME_MS, MAX_FRAME_MS)
    return [*(10 * round(v / 10) for v in ms), LAST_FRAME_MS]


def write_gif(path: Path, pictures, durations_ms: list[int]) -> None:
    """A GIF that loops, in one palette without dithering: only what changes is stored."""
    from PIL import Image

    palette, found = _make_palette(), []
    nearest = NearestColours(palette)
    for picture in pictures:
        found.append(Image.fromarray(nearest(picture), mode="P"))
        found[-1].putpalette(palette.ravel().tolist())
    found[0].save(path, save_all=True, append_images=found[1:], duration=durations_ms, loop=0, optimize=False)


def _make_palette() -> np.ndarray:
    """Colours (n, 3) of 0 to 255: those of temperature, and lines and letters fading into white."""
    fade = np.linspace(0.0, 1.0, 30)[:, None]
    lines = [to_rgb(c) + fade * (1.0 - np.array(to_rgb(c))) for c in FADING_COLOURS]
    return np.rint(255 * np.concatenate([reduced_temperature_map().colors[:, :3], *lines])).astype(np.uint8)


class NearestColours:
    """Numbers of the nearest colours of a palette (n, 3); every colour is looked for once."""

    def __init__(self, palette: np.ndarray):
        self.tree = cKDTree(palette.astype(float))
        self.number = np.full(256**3, -1, dtype=np.int16)

    def __call__(self, pixels: np.ndarray) -> np.ndarray:
        """Numbers (height, width) of pixels (height, width, 3)."""
        red, green, blue = (pixels[..., k].astype(np.int32) for k in range(3))
        code = red << 16 | green << 8 | blue
        found = self.number[code]
        if len(new := np.unique(code[found < 0])):
            self.number[new] = self.tree.query(np.stack([new >> 16, new >> 8 & 255, new & 255], axis=-1))[1]
            found = self.number[code]
        return found.astype(np.uint8)


def _write_mp4(path: Path, pictures, durations_ms: list[int]) -> None:
    """An MP4 of constant rate that every player shows; ffmpeg reads the pixels from a pipe."""
    width, height = (round(inches * ANIMATION_DPI) for inches in ANIMATION_SIZE_IN)
    source = f"-f rawvideo -pix_fmt rgb24 -s {width}x{height} -r {MP4_FRAMES_PER_S} -i -".split()
    target = ["-vf", "crop=trunc(iw/2)*2:trunc(ih/2)*2", "-pix_fmt", "yuv420p", str(path)]
    command = ["ffmpeg", "-loglevel", "error", "-y", *source, *target]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        pipe = cast(IO[bytes], process.stdin)
        with suppress(BrokenPipeError):  # ffmpeg has given up and says why
            for picture, duration in zip(pictures, durations_ms, strict=True):
                pipe.write(picture.tobytes() * max(1, round(1e-3 * duration * MP4_FRAMES_PER_S)))
        _, said = process.communicate()
    if process.returncode:
        words = said.decode(errors="replace").strip().splitlines() or ["it does not say why"]
        raise BadInput(f"{path}: ffmpeg could not write it: {words[-1]}")
