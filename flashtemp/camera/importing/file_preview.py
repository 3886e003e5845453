"""Preview of camera files: frames, pixels, clock, object parameters and ranges, before any option is stated."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.camera.importing import readers
from flashtemp.camera.importing.formats.raw_frames import UNSTATED_SCALE, RawFrames, ScaleMissing
from flashtemp.camera.importing.import_options import ImportOptions
from flashtemp.camera.importing.import_request import describe_order
from flashtemp.camera.importing.pixel_masks import MissingValues
from flashtemp.camera.radiometry import PlanckCalibration
from flashtemp.display import DisplayMixin, DisplayTable
from flashtemp.errors import BadInput

PREVIEW_FRAMES = 6  # frames that are shown
HISTOGRAM_BINS = 120
UNSCALED_COUNTS_NOTE = (
    "counts as the camera wrote them: import needs --scale and --offset, T = scale count + offset in degC"
)
READER_OPTION_NAMES = ("scale", "offset", "unit", "variable", "decimal", "below", "rows", "labels", "limit")


@dataclass(frozen=True, eq=False, repr=False)
class FilePreview(DisplayMixin):
    """Content of camera files: `images` (some, rows, columns) degC of the frames `shown` (some,), counted from 0.

    `mean` (frames,) degC of every frame; `clock` (frames,) s since 1970 on the camera's clock, or `time` (frames,) s if
    the file counts from a start; `said`: object parameters that the file states; `span`: lowest and highest value,
    degC; `counts`: histogram over `edges` degC; `outside`: number of values beyond the camera's range, without those
    of `dead` pixels (rows, columns), which have no value in any of several frames; `difference`: K of a lock-in result,
    not degC; `counted`: counts of unknown scale.
    """

    files: tuple[Path, ...]
    format: str
    camera: str
    images: np.ndarray
    shown: np.ndarray
    mean: np.ndarray
    clock: np.ndarray | None
    time: np.ndarray | None
    fps: float | None
    said: dict[str, float]
    span: tuple[float, float]
    counts: np.ndarray
    edges: np.ndarray
    outside: int
    dead: np.ndarray
    notes: tuple[str, ...]
    difference: bool = False
    counted: bool = False
    picture: Path | None = None

    @property
    def unit(self) -> str:
        """Unit of the images: degC, K for differences, counts if their scale is unknown."""
        return "counts" if self.counted else "K" if self.difference else "degC"

    @property
    def quantity(self) -> str:
        """Quantity of the images, in words."""
        return "counts" if self.counted else "difference" if self.difference else "temperature"

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers and text for JSON."""
        return {
            "files": [str(f) for f in self.files], "format": self.format, "camera": self.camera,
            "frames": len(self.mean), "rows": self.images.shape[1], "columns": self.images.shape[2],
            "counts" if self.counted else "temperature_degC": list(self.span),
            "begins": self._start_text(), "lasts_s": self._duration_s(), "fps": self.fps,
            "object_parameters": self.said, "outside_range_px": self.outside, "dead_px": int(self.dead.sum()),
            "notes": list(self.notes), "picture": self.picture and str(self.picture),
        }  # fmt: skip

    def _start_text(self) -> str | None:
        if self.clock is None or not np.isfinite(self.clock[0]):
            return None
        return datetime.fromtimestamp(float(self.clock[0]), UTC).replace(tzinfo=None).isoformat(" ", "milliseconds")

    def _duration_s(self) -> float | None:
        times = self.time if self.time is not None else self.clock
        if times is not None:
            return float(np.nanmax(times) - np.nanmin(times))
        return (len(self.mean) - 1) / self.fps if self.fps else None

    def describe_rows(self) -> list[tuple[str, str]]:
        """Names and values of the preview, as text."""
        (rows, columns), (low, high) = self.images.shape[1:], self.span
        begins, lasts = self._start_text(), self._duration_s()
        when = [f"begins {begins} on the camera's clock"] if begins else []
        when += [f"lasts {lasts:.6g} s"] if lasts else []
        when += [f"a camera of {self.fps:.4g} frames per second"] if self.fps else []
        object_ = ", ".join(f"{k.replace('_', ' ')} {v:g}" for k, v in self.said.items())
        return [
            ("kind", ", ".join(t for t in (self.format, self.camera) if t)),
            ("images", f"{len(self.mean)} of {columns} x {rows} pixels"),
            ("time", ", ".join(when) or "not in the file: --fps and --start, or --times"),
            (self.quantity, f"{low:.0f} to {high:.0f}" if self.counted else f"{low:.2f} to {high:.2f} {self.unit}"),
            ("computed with", object_ or "not in the file"),
            (
                "pixels left out",
                f"{int(self.dead.sum())} dead in all frames, {self.outside} values beyond the camera's range",
            ),
        ]

    def __str__(self) -> str:
        name = self.files[0].name if len(self.files) == 1 else f"{self.files[0].name} and {len(self.files) - 1} more"
        lines = [
            name,
            *(f"  {key}: {value}" for key, value in self.describe_rows()),
            *(f"  {note}" for note in self.notes),
        ]
        return "\n".join([*lines, *([f"  drawn in {self.picture}"] if self.picture else [])])

    def to_table(self) -> DisplayTable:
        return DisplayTable(self.files[0].name, rows=self.describe_rows(), notes=self.notes)


def preview_files(
    names: Sequence[Path],
    facts: ImportOptions = ImportOptions(),  # noqa: B008 (frozen)
    report_progress: Callable[[str], Any] = lambda text: None,
    receive_images: Callable[[np.ndarray], Any] = lambda images: None,
    counts: bool = False,
    report_share: Callable[[float], Any] = lambda share: None,
) -> FilePreview:
    """Preview of camera files, read a few frames at a time; of `facts` only the reader options are used.

    `report_progress` is called with lines of progress, `receive_images` with the images as they are read, and
    `report_share` with the part of the files that has been read, from 0 to 1.  With `counts`, counts of unknown scale
    stay counts.  Raises BadInput.
    """
    facts = _without_scale(names[:1], facts) if counts else facts
    means, clocks, times = [], [], []
    first: RawFrames | None = None
    missing = MissingValues()
    low, high, number, notes = np.inf, -np.inf, 0, list[str]()
    counted = _Histogram(1.0 if facts.scale is UNSTATED_SCALE else 0.01)
    kept = _FrameSample()
    for done, path in enumerate(names, 1):
        for frames in iter_frames(path, facts):
            first = first or frames
            readers.check_same_kind(names[0], first, path, frames)
            T = frames.temperature
            known = np.isfinite(T)
            means.append(np.where(known.any(axis=(1, 2)), _image_means(T, known), np.nan))
            clocks.append(frames.clock)
            times.append(frames.time)
            missing.add(frames)
            if known.any():
                low, high = min(low, float(T[known].min())), max(high, float(T[known].max()))
                counted.add(T[known])
            kept.add(T, number)
            report_share((done - 1 + frames.share_read) / len(names))
            receive_images(T)
            number += len(T)
            notes += [*frames.notes, *((UNSCALED_COUNTS_NOTE,) if frames.is_unscaled else ())]
        if done % 50 == 0:
            report_progress(f"{done} of {len(names)} files read")
    if first is None:
        raise BadInput("no camera files; give files or a folder of them")
    (shown, images), (bin_counts, edges) = kept.select_frames(), counted.binned_counts()
    return FilePreview(
        files=tuple(names),
        images=images,
        shown=shown,
        mean=np.concatenate(means),
        clock=_concatenate_if_complete(clocks),
        time=_concatenate_if_complete(times),
        span=(low, high),
        counts=bin_counts,
        edges=edges,
        outside=missing.outside,
        dead=missing.dead,
        notes=(*dict.fromkeys(notes), *describe_order(names)),
        **_file_facts(first),
    )


def _file_facts(first: RawFrames) -> dict[str, Any]:
    """Fields of the preview that the first frames state for all files."""
    return {
        "format": first.format,
        "camera": first.camera,
        "fps": first.fps,
        "said": dict(first.stated_parameters),
        "difference": first.difference,
        "counted": first.is_unscaled,
    }


def _without_scale(names: Sequence[Path], facts: ImportOptions) -> ImportOptions:
    """The facts, with counts left unscaled if only the user knows their scale."""
    try:
        for path in names:
            next(iter(iter_frames(path, facts)), None)
    except ScaleMissing:
        return replace(facts, scale=UNSTATED_SCALE, offset=0.0)
    return facts


def iter_frames(path: Path, facts: ImportOptions):
    """Frames of a file, a few at a time, with the object parameters that the file states."""
    planck = None if facts.planck is None else PlanckCalibration(*facts.planck)
    return readers.iter_frames(
        path, **{k: getattr(facts, k) for k in READER_OPTION_NAMES}, planck=planck, every=facts.every or 1
    )


def _image_means(T: np.ndarray, known: np.ndarray) -> np.ndarray:
    return np.sum(T, axis=(1, 2), where=known) / np.maximum(known.sum(axis=(1, 2)), 1)


def _concatenate_if_complete(parts: list[np.ndarray | None]) -> np.ndarray | None:
    found = [p for p in parts if p is not None]
    return np.concatenate(found) if found and len(found) == len(parts) else None


class _FrameSample:
    """Evenly spaced frames of a sequence of unknown length: the spacing doubles whenever there are too many."""

    def __init__(self) -> None:
        self.every, self.numbers, self.images = 1, list[int](), list[np.ndarray]()

    def add(self, images: np.ndarray, first: int) -> None:
        """Keep the frames, numbered from `first`, that fall on the spacing."""
        for number, image in enumerate(images, first):
            if number % self.every == 0:
                self.numbers.append(number)
                self.images.append(np.array(image))
            if len(self.numbers) > 4 * PREVIEW_FRAMES:
                self.every *= 2
                due = [k for k, n in enumerate(self.numbers) if n % self.every == 0]
                self.numbers, self.images = [self.numbers[k] for k in due], [self.images[k] for k in due]

    def select_frames(self) -> tuple[np.ndarray, np.ndarray]:
        """Numbers and images of at most PREVIEW_FRAMES frames."""
        at = np.unique(np.linspace(0, len(self.numbers) - 1, PREVIEW_FRAMES).round().astype(int))
        return np.array(self.numbers)[at], np.stack([self.images[k] for k in at])


class _Histogram:
    """Histogram in steps of 0.01 K, or of one count, whose bins are combined at the end."""

    COARSER = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000)  # steps per bin

    def __init__(self, step: float = 0.01) -> None:
        self.step, self.first, self.found = step, 0, np.zeros(0, int)

    def add(self, values: np.ndarray) -> None:
        """Count values, degC."""
        numbers = np.floor(values / self.step + 1e-6).astype(int)
        first, last = int(numbers.min()), int(numbers.max())
        if self.found.size:
            first, last = min(first, self.first), max(last, self.first + self.found.size - 1)
        counts = np.bincount((numbers - first).ravel(), minlength=last - first + 1)
        counts[self.first - first :][: self.found.size] += self.found
        self.first, self.found = first, counts

    def binned_counts(self) -> tuple[np.ndarray, np.ndarray]:
        """Counts (bins,) and edges (bins + 1,) degC."""
        coarse = next((c for c in self.COARSER if self.found.size <= HISTOGRAM_BINS * c), self.COARSER[-1])
        before = self.first % coarse
        after = -(before + self.found.size) % coarse
        counts = np.pad(self.found, (before, after)).reshape(-1, coarse).sum(axis=1)
        return counts, self.step * (self.first - before + coarse * np.arange(len(counts) + 1))
