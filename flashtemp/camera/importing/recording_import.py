"""Import of camera files as one Recording: reading, radiometry, rectification and times; reports missing options."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.camera.image_placement import check_block_in_view
from flashtemp.camera.importing import frame_times, readers, rectification, thermocouple_files
from flashtemp.camera.importing.formats.raw_frames import RawFrames
from flashtemp.camera.importing.frame_buffer import FrameBuffer
from flashtemp.camera.importing.import_options import ImportOptions, option_name
from flashtemp.camera.importing.import_request import describe_order
from flashtemp.camera.importing.pixel_masks import MissingValues, find_masked_pixels
from flashtemp.camera.radiometry import (
    LONG_WAVE,
    PARAMETER_NAMES,
    ObjectParameters,
    PlanckCalibration,
    recompute_temperature,
)
from flashtemp.camera.recording import Recording
from flashtemp.display import DisplayMixin, DisplayTable
from flashtemp.errors import BadInput, suggest_name

MM = 1e-3
CAMERA_ATTRIBUTES = {  # option: attribute of the recording
    "netd": "netd_K", "fixed_pattern": "fixed_pattern_K", "psf_sigma": "psf_sigma_px", "exposure": "exposure_s",
    "registration_sigma": "registration_sigma_px",
}  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class ImportResult(DisplayMixin):
    """An imported recording with `notes` on what was recognised and done, its files, and the block (m) if known.

    `saved` is the file of the recording, `picture` the file that shows its registration.  `file_numbers` (frames,):
    index in `files` of the file that each frame is from; None for tables of thermocouples.
    """

    recording: Recording
    notes: tuple[str, ...]
    files: tuple[Path, ...]
    block: tuple[float, float] | None = None
    saved: Path | None = None
    picture: Path | None = None
    file_numbers: np.ndarray | None = None

    def as_dict(self) -> dict:
        """Plain numbers and text for JSON."""
        r = self.recording
        low, high, count = r.span
        known = {f.name: v for f in fields(r) if isinstance(v := getattr(r, f.name), (int, float))}
        return (
            {
                "view": r.view,
                "files": [str(f) for f in self.files],
                "recognised": list(self.notes),
                "frames": r.frames,
                "pixels": [len(r.v), len(r.u)],
                "u_m": [float(r.u[0]), float(r.u[-1])],
                "v_m": [float(r.v[0]), float(r.v[-1])],
                "time_s": [float(r.time[0]), float(r.time[-1])],
                "repetitions": [int(r.repetition.min()), int(r.repetition.max())],
                "temperature_degC": [low, high],
                "dead_share": float(1 - count / r.temperature.size),
            }
            | known
            | {name: path and str(path) for name, path in self._written_files().items()}
        )

    def _written_files(self) -> dict[str, Path | None]:
        return {"recording": self.saved, "picture": self.picture}

    def __str__(self) -> str:
        if self.saved is None:
            return str(self.recording)
        drawn = "drawn" if self.recording.view == "points" else "registration"
        return f"{self.recording}\n  in {self.saved}" + (f", {drawn} in {self.picture}" if self.picture else "")

    def to_table(self) -> DisplayTable:
        written = [f"{name} in {path}" for name, path in self._written_files().items() if path]
        return replace(self.recording.to_table(), notes=[*self.notes, *written])


def import_recording(
    names: list[Path],
    facts: ImportOptions,
    report_progress: Callable[[str], Any] = lambda text: None,
    folder: Path | None = None,
) -> ImportResult:
    """The recording of camera files.  BadInput names the file or option and the remedy.

    Files are read a few frames at a time; many images are buffered in a file in `folder`.  `report_progress` is called
    with lines of progress.
    """
    _check_ranges(facts)
    if facts.view == "points":
        return ImportResult(*thermocouple_files.read_recording(names, facts), tuple(names), facts.block_outline)
    if facts.places is not None:
        raise BadInput("places: belong to thermocouples; give --view points with them")
    if facts.time_column is not None:
        raise BadInput("time_column: belongs to thermocouples; give --view points with it")
    return _import_images(thin_files(names, facts), facts, report_progress, folder)


def missing_options(names: list[Path], facts: ImportOptions) -> tuple[str, ...]:
    """Options that camera files need and that are missing: a line for each, as far as the first file shows."""
    _check_ranges(facts)
    if facts.view == "points":
        return ()
    frames, last = next(_iter_frames(names[0], facts))
    try:
        _check_options(names[0], frames, facts, last)
    except BadInput as fault:
        return fault.lines
    return ()


def _import_images(
    names: list[Path], facts: ImportOptions, report_progress: Callable[[str], Any], folder: Path | None
) -> ImportResult:
    images = ImageImport(facts, folder)
    for number, path in enumerate(names, 1):
        images.add_file(path)
        if number % 50 == 0:
            report_progress(f"{number} of {len(names)} files read")
    return images.make_recording()


class ImageImport:
    """The import of image files one after the other; the recording of the files so far can be made at any time.

    Place and masked pixels follow from the first file.  Many images are buffered in a file in `folder`.  After an error
    the import must not be continued, because frames before the damage may have been added already.
    """

    def __init__(self, facts: ImportOptions, folder: Path | None = None):
        self.facts = facts
        self._stack, self._notes, self._missing = FrameBuffer(folder), list[str](), MissingValues()
        self._seen: list[tuple[Path, frame_times.FrameTimestamps]] = []
        self._first: tuple[Path, RawFrames] | None = None
        self._place: FrameRectifier | None = None
        self._grid: rectification.RectifiedFrames | None = None

    def add_file(self, path: Path) -> None:
        """Read the frames of the next file.  BadInput names the file or option and the remedy."""
        stamps: list[frame_times.FrameTimestamps] = []
        for frames, last in _iter_frames(path, self.facts):
            self._add_frames(path, frames, last)
            stamps.append(frame_times.FrameTimestamps.from_pieces([frames]))
        self._seen.append((path, frame_times.FrameTimestamps.from_pieces(stamps)))

    def _add_frames(self, path: Path, frames: RawFrames, last: bool) -> None:
        if self._first is not None:
            readers.check_same_kind(*self._first, path, frames)
        else:
            _check_options(path, frames, self.facts, last)
            self._first = path, replace(frames, temperature=frames.temperature[:1], counts=None)
        try:
            T, radiometry_notes = apply_radiometry(frames, self.facts)
        except BadInput as fault:
            raise BadInput(*(f"{path}: {t}" for t in fault.lines)) from fault
        if self._place is None:
            self._place = FrameRectifier(frames, self.facts, T)
            self._notes += [f"{path}: {frames}", *frames.notes, *radiometry_notes, *self._place.notes]
        elif not self._seen:
            self._notes += [note for note in frames.notes if note not in self._notes]
        self._grid = self._place(T)
        self._stack.add(self._grid.temperature)
        self._missing.add(frames)

    def make_recording(self) -> ImportResult:
        """The recording of all files so far, at least one.  Raises BadInput."""
        seen, facts, notes = self._seen, self.facts, list(self._notes)
        first, place, grid = self._first, self._place, self._grid
        assert first is not None  # at least one file has been read
        assert place is not None
        assert grid is not None
        names = [path for path, _ in seen]
        if len(names) > 1:
            notes[0] = f"{len(names)} files, the first: {notes[0]}"
            notes += describe_order(names)
        elif seen[0][1].count > len(first[1].temperature):
            notes.append(f"{seen[0][1].count} frames in all")
        if outside := self._missing.outside:
            notes.append(f"{outside} values beyond the camera's range are left out; they are no dead pixels")
        time = frame_times.resolve_times(seen, facts)
        repetition = frame_times.resolve_repetitions(seen, time, facts)
        order = np.argsort(time, kind="stable")
        if np.any(np.diff(order) < 0):
            notes.append("frames put in order of time")
        recording = Recording(
            place.view, self._stack.ordered_images(order), time[order], repetition[order], grid.u, grid.v,
            source=f"{names[0].name} and {len(names) - 1} more" if len(names) > 1 else names[0].name,
            **_camera_attributes(first[1], facts),
        )  # fmt: skip
        check_block_in_view(recording, block := facts.block_outline)
        origin = np.repeat(np.arange(len(seen)), [stamps.count for _, stamps in seen])[order]
        return ImportResult(recording, tuple(notes), tuple(names), block, file_numbers=origin)


def _iter_frames(path: Path, facts: ImportOptions) -> Iterator[tuple[RawFrames, bool]]:
    """Frames of a file, a few at a time, and whether they are the last."""
    pieces = _open_frames(path, facts)
    piece = next(pieces, None)
    while piece is not None:
        following = next(pieces, None)
        yield piece, following is None
        piece = following


def thin_files(names: list[Path], facts: ImportOptions) -> list[Path]:
    """Every n-th file (`every`), if each holds one frame."""
    if (facts.every or 1) == 1 or len(names) == 1:
        return names
    first, last = next(_iter_frames(names[0], replace(facts, every=None)))
    if len(first.temperature) > 1 or not last:
        return names
    return names[:: facts.every]


def _check_options(path: Path, frames: RawFrames, facts: ImportOptions, whole: bool) -> None:
    """BadInput with one line for each missing option, as far as the first file shows."""
    seen = [(path, frame_times.FrameTimestamps.from_pieces([frames]))]
    lines: list[str] = []
    needs = [lambda: _required_view(frames, facts), lambda: frame_times.resolve_times(seen, facts)]
    needs.append(lambda: frame_times.resolve_repetitions(seen, np.zeros(len(frames.temperature)), facts))
    if _is_unplaced(frames, facts):
        needs.insert(1, lambda: pixel_to_metre_map(facts, frames.shape))
    if not whole and facts.times is not None:  # the number of its rows is checked against all frames
        needs = needs[:-2]
    for need in needs:
        try:
            need()
        except BadInput as fault:
            lines += fault.lines
    if lines:
        raise BadInput(*lines)


def _required_view(frames: RawFrames, facts: ImportOptions) -> str:
    view = facts.view or frames.view
    if view is None:
        raise BadInput("view: missing; give --view sidewall, wake, profile or points")
    return view


def _is_unplaced(frames: RawFrames, facts: ImportOptions) -> bool:
    return frames.u is None or facts.pixel is not None or facts.point is not None


def _check_ranges(facts: ImportOptions) -> None:
    for name in ("every", "repetition", "rows"):
        if (value := getattr(facts, name)) is not None and value < 1:
            raise BadInput(f"{name}: {value}; give a whole number from 1")
    for name in ("mm_per_pixel", "band", "limit"):
        if (value := getattr(facts, name)) is not None and not 0 < value < float("inf"):
            raise BadInput(f"{name}: {value:g}; give a number greater than zero")
    for key in facts.was or {}:
        if key not in PARAMETER_NAMES:
            raise BadInput(f"was.{key}: unknown{suggest_name(key, PARAMETER_NAMES)}")


def _user_parameters(facts: ImportOptions) -> dict[str, float]:
    """Object parameters that the user states."""
    return {n: v for n in PARAMETER_NAMES if (v := getattr(facts, n)) is not None}


def _open_frames(path: Path, facts: ImportOptions) -> Iterator[RawFrames]:
    names = ("scale", "offset", "unit", "variable", "decimal", "below", "rows", "labels", "limit")
    same = {k: getattr(facts, k) for k in names}
    planck = None if facts.planck is None else PlanckCalibration(*facts.planck)
    return readers.iter_frames(path, **same, parameters=_user_parameters(facts), planck=planck, every=facts.every or 1)


def apply_radiometry(frames: RawFrames, facts: ImportOptions) -> tuple[np.ndarray, list[str]]:
    """Temperatures, degC, with the object parameters that the user states, and notes on the changes."""
    if frames.difference:
        raise BadInput("holds differences (a lock-in result), not temperatures; export the temperature images instead")
    given = _user_parameters(facts)
    if frames.counts is not None:
        changed = [
            f"{k} {frames.stated_parameters[k]:g} -> {v:g}"
            for k, v in given.items()
            if frames.stated_parameters[k] != v
        ]
        notes = [str(frames.parameters)] + ([f"changed: {', '.join(changed)}"] if changed else [])
        return frames.temperature, notes
    if facts.planck is not None:
        raise BadInput("planck: the file holds no counts; leave --planck out, or give the camera's radiometric file")
    old = {**frames.stated_parameters, **(facts.was or {})}
    if not given:
        return frames.temperature, [f"computed with {k} {v:g}" for k, v in old.items()]
    ask = [k for k in given if k not in old]
    if "emissivity" in given and given["emissivity"] != old.get("emissivity") and "reflected" not in {*old, *ask}:
        ask.append("reflected")
    if ask:
        raise BadInput(
            f"{option_name(ask[0])}: the file holds temperatures and does not say which {ask[0]} they were computed"
            f" with; give {' and '.join(f'--was.{k}' for k in ask)} as well"
        )
    before = ObjectParameters(**old)
    band = LONG_WAVE if facts.band is None else PlanckCalibration(1.0, 1.0, facts.band)
    changed = [f"{k} {old[k]:g} -> {v:g}" for k, v in given.items() if old[k] != v]
    T = recompute_temperature(frames.temperature, before, before.with_values(given), band)
    return T, [f"changed: {', '.join(changed)}, in a band of B = {band.B:g} K"] if changed else []


class FrameRectifier:
    """Mask, orientation, scale and crop of the first images, applied to the images of every file."""

    def __init__(self, frames: RawFrames, facts: ImportOptions, T: np.ndarray):
        self.band = frames.planck or (LONG_WAVE if facts.band is None else PlanckCalibration(1.0, 1.0, facts.band))
        self.view = _required_view(frames, facts)
        self.crop = None if facts.crop is None else MM * np.asarray(facts.crop)
        self.pitch = None if facts.mm_per_pixel is None else (MM * facts.mm_per_pixel,) * 2
        self.mask, self.notes = find_masked_pixels(frames, facts, T)
        self.known = (frames.u, frames.v)
        self.M = None
        if _is_unplaced(frames, facts):
            self.M, note = pixel_to_metre_map(facts, frames.shape)
            self.notes += [note] if note else []

    def __call__(self, T: np.ndarray) -> rectification.RectifiedFrames:
        if self.mask.any():
            T = np.where(self.mask, np.nan, T)
        u, v = self.known
        if self.M is not None:
            placed = rectification.rectify_frames(T, self.M, self.crop, self.pitch, self.band)
        else:
            assert u is not None  # otherwise the images are unplaced
            assert v is not None
            placed = rectification.RectifiedFrames(T, u, v)
            placed = placed if self.crop is None else rectification.crop_frames(placed, self.crop)
        if self.view != "profile" or len(placed.v) == 1:
            return placed
        return rectification.RectifiedFrames(
            _row_mean(placed.temperature, self.band), placed.u, np.zeros(1), placed.note
        )


def _row_mean(T: np.ndarray, band: PlanckCalibration) -> np.ndarray:
    """Mean of the rows of images, averaged as radiance, for a profile: (frames, 1, nu)."""
    light = band.counts(T)
    known = np.isfinite(light)
    total = np.where(known, light, 0.0).sum(axis=1, keepdims=True)
    count = known.sum(axis=1, keepdims=True)
    return band.temperature(np.where(count > 0, total / np.maximum(count, 1), np.nan))


def pixel_to_metre_map(facts: ImportOptions, shape: tuple[int, int]) -> tuple[np.ndarray, str]:
    """Map from pixels to m, from marked points or from direction, origin and scale.  BadInput lists missing options."""
    if facts.point is not None:
        return rectification.map_from_points(facts.point)
    missing = [n for n in ("downstream", "pixel") if getattr(facts, n) is None]
    if facts.mm_per_pixel is None and facts.second is None:
        missing.append("mm_per_pixel")
    if missing:
        helps = {
            "downstream": "--downstream right, left, up or down",
            "pixel": "--pixel COLUMN ROW of the leading edge at the interface",
            "mm_per_pixel": "--mm-per-pixel (or a --second point)",
        }
        raise BadInput(
            f"{missing[0]}: missing; where the pixels lie is not in the file: give"
            f" {', '.join(helps[m] for m in missing)}, or four times --point COLUMN ROW U_MM V_MM"
        )
    turn, at = rectification.image_axes(facts.downstream or "", facts.up), facts.at or (0.0, 0.0)
    if facts.second is not None:
        return rectification.map_from_two_points(turn, facts.pixel, at, facts.second, shape)
    return rectification.map_from_scale(turn, facts.pixel, at, (facts.mm_per_pixel,) * 2), ""


def _camera_attributes(frames: RawFrames, facts: ImportOptions) -> dict[str, Any]:
    """Facts of camera and object, as attributes of the recording."""
    given = {
        to: v if (v := getattr(facts, name)) is not None else frames.camera_attributes.get(to)
        for name, to in CAMERA_ATTRIBUTES.items()
    }
    parameters = {**frames.stated_parameters, **(facts.was or {}), **_user_parameters(facts)}
    fps = facts.fps or frames.fps
    every = facts.every or 1
    return given | {
        "emissivity": parameters.get("emissivity"),
        "reflected_degC": parameters.get("reflected"),
        "fps": fps / every if fps and facts.fps else fps,
    }
