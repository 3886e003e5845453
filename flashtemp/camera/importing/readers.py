"""Reads the frames of any camera file, whose format is recognised by its first bytes, not by its name."""

from __future__ import annotations

import importlib
import pkgutil
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.camera.image_validation import check_memory
from flashtemp.camera.importing import formats
from flashtemp.camera.importing.formats import text
from flashtemp.camera.importing.formats.byte_reader import ByteReader
from flashtemp.camera.importing.formats.camera_file import (
    COLOUR_IMAGE_REMEDY,
    SIGNATURE_BYTES,
    CameraFile,
    ReaderOptions,
)
from flashtemp.camera.importing.formats.raw_frames import RawFrames, concatenate_frames
from flashtemp.errors import BadInput, shorten_text
from flashtemp.physics.quantities import KELVIN

FLIR_EXPORT_REMEDY = (
    "open it in ResearchIR or Research Studio, export TIFF (with scale and offset), CSV or MAT, and give that"
)
CLOSED_FORMATS = {  # extension: format and what to export instead
    ".ats": ("FLIR ATS", FLIR_EXPORT_REMEDY),
    ".ptw": ("FLIR PTW", FLIR_EXPORT_REMEDY),
    ".sfmov": ("FLIR SFMOV", FLIR_EXPORT_REMEDY),
    ".ravi": ("Optris RAVI", "export CSV or TIFF from PIX Connect and give that"),
    ".is2": ("Fluke IS2", "export CSV from SmartView and give that"),
    ".is3": ("Fluke IS3", "export CSV from SmartView and give that"),
    ".bmt": ("Testo BMT", "export the temperatures as CSV from IRSoft and give that"),
}
FOREIGN_SIGNATURES = {  # first bytes: what the file is, and the remedy
    b"GIF8": "GIF" + COLOUR_IMAGE_REMEDY,
    b"BM": "a bitmap" + COLOUR_IMAGE_REMEDY,
    b"RIFF": "AVI" + COLOUR_IMAGE_REMEDY,
    b"\x1aE\xdf\xa3": "Matroska film" + COLOUR_IMAGE_REMEDY,
    b"PK\x03\x04": "a ZIP archive (XLSX, IS2, ...); save or export it as CSV and give that",
    b"\x1f\x8b": "a gzip archive; unpack it and give what is inside",
    b"%PDF": "PDF; give the camera's own file",
    b"CEDIP": f"FLIR PTW, which only the maker's closed kit reads; {FLIR_EXPORT_REMEDY}",
}
Reader = Callable[[CameraFile], Iterator[RawFrames]]
MIN_SCENE_DEGC = -150.0  # degC: colder than any median of an image
MAX_EMPTY_PIECES = 50  # groups of frames without any temperature at the beginning of a file


def read_frames(path: str | Path, **options: Any) -> RawFrames:
    """All frames of a camera file at once; `options` are the fields of `ReaderOptions`.

    Raises BadInput in one line that begins with the file's name, also if the frames exceed the memory `limit`.
    """
    kept: list[RawFrames] = []
    for piece in iter_frames(path, **options):
        kept.append(piece)
        pixels = sum(p.temperature.size for p in kept)
        with _name_file_in_errors(Path(path)):
            check_memory(
                pixels, ReaderOptions(**options).limit, f"{pixels // kept[0].temperature[0].size} frames at once"
            )
    return concatenate_frames(kept)


def iter_frames(path: str | Path, **options: Any) -> Iterator[RawFrames]:
    """Frames of a camera file, a few at a time if it is a long sequence.  Raises BadInput as `read_frames` does."""
    path, reader_options = Path(path), ReaderOptions(**options)
    waiting: list[RawFrames] = []  # frames without any temperature: a file of them alone is refused
    has_temperature = False
    with _name_file_in_errors(path):
        for frames in _read_by_magic(path, reader_options):
            waiting.append(frames)
            has_temperature = has_temperature or bool(np.isfinite(frames.temperature).any())
            if has_temperature:
                yield from waiting
                waiting = []
            elif len(waiting) > MAX_EMPTY_PIECES:
                break
        if not has_temperature:
            raise BadInput("no pixel holds a temperature; choose another file or repair its parameters")


@contextmanager
def _name_file_in_errors(path: Path) -> Iterator[None]:
    """Any fault of a file as BadInput that begins with its name."""
    try:
        yield
    except BadInput as fault:
        name = str(path)
        raise type(fault)(*(t if t.startswith(name) else f"{name}: {t}" for t in fault.lines)) from fault
    except MemoryError as fault:
        raise BadInput(f"{path}: more than the memory holds; give a part of it, or copy it again if damaged") from fault
    except OSError as fault:
        raise BadInput(f"{path}: cannot be read ({fault.strerror or fault}); give a file that can") from fault
    except (struct.error, ValueError, IndexError, OverflowError, RecursionError) as fault:
        raise BadInput(
            f"{path}: damaged ({shorten_text(' '.join(str(fault).split()))}); copy it again or export it anew"
        ) from fault


def check_same_kind(first: Path, one: RawFrames, path: Path, other: RawFrames) -> None:
    """BadInput if the frames `other` of a file differ in format, size or unit from those of the `first` file."""
    if one.format != other.format:
        raise BadInput(f"{path}: {other.format}, but {first.name} is {one.format}; give files of one kind at once")
    (rows, columns), (high, wide) = one.shape, other.shape
    if (rows, columns) != (high, wide):
        raise BadInput(
            f"{path}: {wide} x {high} pixels, but {first.name} has {columns} x {rows}; give files of one size at once"
        )
    if one.counts is None and other.counts is None:
        was, now = (_median_value(frames.temperature[0]) for frames in (one, other))
        if min(was, now) < MIN_SCENE_DEGC < max(was, now) - KELVIN / 2:
            raise BadInput(
                f"{path}: values around {now:.4g} degC, but {first.name} has {was:.4g}: one is in degC and the other in"
                " kelvin; give files of one unit at once"
            )


def _median_value(image: np.ndarray) -> float:
    """Median of the values of an image, 0 if all are missing."""
    known = image[np.isfinite(image)]
    return float(np.median(known)) if known.size else 0.0


@lru_cache(maxsize=8)
def find_formats(folders: tuple[str, ...]) -> tuple[tuple[bytes, Reader], ...]:
    """First bytes and reading function of every format module in the folders, the longest first bytes first.

    A format module defines `MAGIC`, a tuple of first bytes, and `read`; modules without `MAGIC` help such modules.
    """
    found: list[tuple[bytes, Reader]] = []
    for module_info in pkgutil.iter_modules(folders, f"{formats.__name__}."):
        module = importlib.import_module(module_info.name)
        found += [(magic, module.read) for magic in getattr(module, "MAGIC", ())]
    return tuple(sorted(found, key=lambda pair: -len(pair[0])))


def _read_by_magic(path: Path, options: ReaderOptions) -> Iterator[RawFrames]:
    """Frames by the reader that knows the first bytes; text, which has none, comes last."""
    if not path.is_file():
        raise BadInput("no such file; give camera files, a folder of them or a recording template (.toml)")
    with ByteReader(path) as source:
        if not len(source):
            raise BadInput("the file is empty; copy it again or choose another")
        file = CameraFile(path, source, source[0:SIGNATURE_BYTES], options)
        for magic, read in find_formats(tuple(formats.__path__)):
            if file.start.startswith(magic):
                yield from read(file)
                return
        _refuse_unsupported(path, file.start)
        yield from text.read(file)


def _refuse_unsupported(path: Path, data: bytes) -> None:
    """BadInput for closed formats and for pictures that hold colours instead of temperatures."""
    if whose := CLOSED_FORMATS.get(path.suffix.lower()):
        raise BadInput(f"{whose[0]}, which only the maker's closed kit reads; {whose[1]}")
    if data[4:8] == b"ftyp":
        raise BadInput("MP4" + COLOUR_IMAGE_REMEDY)
    for magic, what in FOREIGN_SIGNATURES.items():
        if data.startswith(magic):
            raise BadInput(what)
