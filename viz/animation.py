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
from flashtemp.viz import theme, views
from flashtemp.viz.animation_frame import DPI, SIZE, Screen, temperature_map

MOST = 80  # frames
SECONDS = 14.0  # of the whole animation, about
SHORTEST, LONGEST, REST = 80, 400, 1500  # ms of a frame, and of the last one
RATE = 25  # pictures per second of an MP4
COLOURS = ("black", theme.SPOT, theme.BLOCK)  # that fade into white where a line ends


def applies(run) -> bool:
    """Whether there are repetitions to follow."""
    return views.several(run)


@theme.styled
def draw(run, frame: int = -1) -> Figure:
    """One picture of the animation: frame `frame` of run.field, temperatures in degC, lengths in mm."""
    screen = Screen(run, frames(run))
    screen.show(range(len(run.frames))[frame])
    return screen.fig


@theme.styled
def write(run, path) -> Path:
    """Write the animation as .gif, or as .mp4 where ffmpeg is installed; BadInput for anything else."""
    path, kept = Path(path), frames(run)
    kind = path.suffix.lower()
    if kind not in (".gif", ".mp4"):
        raise BadInput(f"{path}: no animation can be written as '{path.suffix}'; name a file ending .gif or .mp4")
    if kind == ".mp4" and not shutil.which("ffmpeg"):
        raise BadInput(f"{path}: MP4 needs ffmpeg, which is not installed; install it or name a file ending .gif")
    (gif if kind == ".gif" else _mp4)(path, Screen(run, kept).pictures(kept), durations(run, kept))
    return path


def frames(run) -> list[int]:
    """Indices into run.field that are shown: all, or those of evenly chosen repetitions, at most MOST."""
    of = run.repetition[run.frames]
    numbers, counts = np.unique(of, return_counts=True)
    kept = numbers[theme.chosen(len(numbers), max(2, MOST // counts.max()))]
    found = np.arange(len(of)) if len(of) <= MOST else np.flatnonzero(np.isin(of, kept))
    return found[theme.chosen(len(found), MOST)].tolist()


def durations(run, kept: list[int]) -> list[int]:
    """Milliseconds of every frame: as the root of the time to the next, so that fast changes can be followed."""
    steps = np.sqrt(np.diff(run.time[run.frames[kept]]))
    ms = np.clip(1e3 * SECONDS * steps / steps.sum(), SHORTEST, LONGEST)
    return [*(10 * round(v / 10) for v in ms), REST]


def gif(path: Path, pictures, ms: list[int]) -> None:
    """A GIF that loops, in one palette without dithering: only what changes is stored."""
    from PIL import Image

    palette, found = _palette(), []
    nearest = Nearest(palette)
    for picture in pictures:
        found.append(Image.fromarray(nearest(picture), mode="P"))
        found[-1].putpalette(palette.ravel().tolist())
    found[0].save(path, save_all=True, append_images=found[1:], duration=ms, loop=0, optimize=False)


def _palette() -> np.ndarray:
    """Colours (n, 3) of 0 to 255: those of temperature, and lines and letters fading into white."""
    fade = np.linspace(0.0, 1.0, 30)[:, None]
    lines = [to_rgb(c) + fade * (1.0 - np.array(to_rgb(c))) for c in COLOURS]
    return np.rint(255 * np.concatenate([temperature_map().colors[:, :3], *lines])).astype(np.uint8)


class Nearest:
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


def _mp4(path: Path, pictures, ms: list[int]) -> None:
    """An MP4 of constant rate that every player shows; ffmpeg reads the pixels from a pipe."""
    width, height = (round(inches * DPI) for inches in SIZE)
    source = f"-f rawvideo -pix_fmt rgb24 -s {width}x{height} -r {RATE} -i -".split()
    target = ["-vf", "crop=trunc(iw/2)*2:trunc(ih/2)*2", "-pix_fmt", "yuv420p", str(path)]
    command = ["ffmpeg", "-loglevel", "error", "-y", *source, *target]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        pipe = cast(IO[bytes], process.stdin)
        with suppress(BrokenPipeError):  # ffmpeg has given up and says why
            for picture, duration in zip(pictures, ms, strict=True):
                pipe.write(picture.tobytes() * max(1, round(1e-3 * duration * RATE)))
        _, said = process.communicate()
    if process.returncode:
        words = said.decode(errors="replace").strip().splitlines() or ["it does not say why"]
        raise BadInput(f"{path}: ffmpeg could not write it: {words[-1]}")
