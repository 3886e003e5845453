"""Any camera file -> Frames: the kind is told by its first bytes, not by its name."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.camera.image_validation import BYTES_PER_PIXEL, check_memory
from flashtemp.camera.importing.formats import arrays, flir, foreign_jpeg, infratec_irb, text, tiff
from flashtemp.camera.importing.formats.byte_reader import ByteReader
from flashtemp.camera.importing.formats.raw_frames import RawFrames, concatenate_frames
from flashtemp.camera.radiometry import PlanckCalibration
from flashtemp.errors import BadInput, shorten_text
from flashtemp.physics.quantities import KELVIN

FLIR_EXPORT_REMEDY = (
    "open it in ResearchIR or Research Studio, export TIFF (with scale and offset), CSV or MAT, and give that"
)
CLOSED_FORMATS = {  # name ends: whose and what to ask for
    ".ats": ("FLIR ATS", FLIR_EXPORT_REMEDY), ".ptw": ("FLIR PTW", FLIR_EXPORT_REMEDY), ".sfmov": ("FLIR SFMOV", FLIR_EXPORT_REMEDY),
    ".ravi": ("Optris RAVI", "export CSV or TIFF from PIX Connect and give that"),
    ".is2": ("Fluke IS2", "export CSV from SmartView and give that"),
    ".is3": ("Fluke IS3", "export CSV from SmartView and give that"),
    ".bmt": ("Testo BMT", "export the temperatures as CSV from IRSoft and give that"),
}  # fmt: skip
COLOUR_IMAGE_REMEDY = (
    "; it holds colours or a film, not temperatures: give the radiometric file of the camera or its export as CSV"
)
FOREIGN_SIGNATURES = {  # first bytes: what it is
    b"GIF8": "GIF" + COLOUR_IMAGE_REMEDY,
    b"BM": "a bitmap" + COLOUR_IMAGE_REMEDY,
    b"RIFF": "AVI" + COLOUR_IMAGE_REMEDY,
    b"\x1aE\xdf\xa3": "Matroska film" + COLOUR_IMAGE_REMEDY,
    b"PK\x03\x04": "a ZIP archive (XLSX, IS2, ...); save or export it as CSV and give that",
    b"\x1f\x8b": "a gzip archive; unpack it and give what is inside",
    b"%PDF": "PDF; give the camera's own file",
    b"CEDIP": f"FLIR PTW, which only the maker's closed kit reads; {FLIR_EXPORT_REMEDY}",
}
MIN_SCENE_DEGC = -150.0  # degC: what no camera sees beside something warm
SIGNATURE_BYTES = 8192  # bytes that tell the kind of a file
MEMORY_PER_FILE_SIZE = 4  # times a file that is read whole must fit into the limit
MAX_EMPTY_PIECES = 50  # pieces without any temperature that may come first


@dataclass(frozen=True)
class ReaderOptions:
    """What a file may not say: `scale` and `offset` (degC) of counts, `unit`, `variable`, `decimal`, `below` (degC).

    `rows` of a text file that holds a part of an image, `labels` around it ("none", "columns", "rows", "both").
    `parameters` and `planck` go before what a radiometric file says itself; `every`: keep one frame of so many;
    `limit`: GB of memory that one file may take.
    """

    scale: float | None = None
    offset: float | None = None
    unit: str | None = None
    variable: str | None = None
    decimal: str | None = None
    below: float | None = None
    rows: int | None = None
    labels: str | None = None
    parameters: dict[str, float] = field(default_factory=dict)
    planck: PlanckCalibration | None = None
    every: int = 1
    limit: float | None = None


def read_frames(path: str | Path, **unsaid: Any) -> RawFrames:
    """All frames of a camera file at once; `unsaid` as in `ReaderOptions`.

    Raises BadInput in one line that begins with the file's name, also where they take more memory than `limit`.
    """
    kept: list[RawFrames] = []
    for piece in iter_frames(path, **unsaid):
        kept.append(piece)
        pixels = sum(p.temperature.size for p in kept)
        with _name_file_in_errors(Path(path)):
            check_memory(
                pixels, ReaderOptions(**unsaid).limit, f"{pixels // kept[0].temperature[0].size} frames at once"
            )
    return concatenate_frames(kept)


def iter_frames(path: str | Path, **unsaid: Any) -> Iterator[RawFrames]:
    """Frames of a camera file, a few at a time where it is a long sequence.  Raises as `read_frames` does."""
    path, known = Path(path), ReaderOptions(**unsaid)
    held: list[RawFrames] = []
    warm = False
    with _name_file_in_errors(path):
        for frames in _by_magic(path, known):
            held.append(frames)
            warm = warm or bool(np.isfinite(frames.temperature).any())
            if warm:
                yield from held
                held = []
            elif len(held) > MAX_EMPTY_PIECES:
                break
        if not warm:
            raise BadInput("no pixel holds a temperature; choose another file or repair its parameters")


@contextmanager
def _name_file_in_errors(path: Path) -> Iterator[None]:
    """Whatever is wrong with a file as BadInput that begins with its name."""
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
    """BadInput where a file is of another kind, size or unit than the first."""
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
    """Median of the values of an image, 0 where all are dead."""
    known = image[np.isfinite(image)]
    return float(np.median(known)) if known.size else 0.0


def _by_magic(path: Path, known: ReaderOptions) -> Iterator[RawFrames]:
    if not path.is_file():
        raise BadInput("no such file; give camera files, a folder of them or a recording template (.toml)")
    with ByteReader(path) as source:
        if not len(source):
            raise BadInput("the file is empty; copy it again or choose another")
        start = source[0:SIGNATURE_BYTES]
        linear = {"scale": known.scale, "offset": known.offset}
        if start.startswith(flir.MAGIC):
            yield from _read_flir_sequence(source, known)
        elif start.startswith(tiff.MAGIC):
            yield from tiff.read(path, unit=known.unit, every=known.every, limit=known.limit, **linear)
        elif start.startswith((arrays.HDF5, arrays.MATLAB, *arrays.NETCDF_CLASSIC)):
            data = b"" if arrays.is_hdf5(start) else _read_bytes(source, known)
            asked = {"unit": known.unit, "variable": known.variable, "every": known.every, "limit": known.limit}
            yield from arrays.read(path, start, data, **asked, **linear)
        else:
            for frames in _read_single(path, source, start, known, linear):
                yield frames if frames.counts is not None else frames.take_every(known.every)


def _read_single(
    path: Path, source: ByteReader, start: bytes, known: ReaderOptions, linear: dict
) -> Iterator[RawFrames]:
    """Frames of a file that is read whole."""
    if start.startswith(b"\xff\xd8"):
        data = _read_bytes(source, known)
        block = flir.join_jpeg_pieces(data)
        if not block:
            what = foreign_jpeg.describe_foreign_jpeg(data)
            raise BadInput(what if "give" in what else what + COLOUR_IMAGE_REMEDY)
        yield from flir.read(block, "FLIR radiometric JPEG", known.parameters, known.planck, limit=known.limit)
    elif start.startswith(infratec_irb.MAGIC):
        yield infratec_irb.read(_read_bytes(source, known), known.limit)
    elif start.startswith(tiff.PNG):
        yield tiff.read_png(_read_bytes(source, known), limit=known.limit, **linear)
    else:
        _refuse_unsupported(path, start)
        if not text.is_text(start):
            raise BadInput(text.NO_TEXT)
        said = {k: getattr(known, k) for k in ("unit", "below", "decimal", "rows", "labels")}
        yield text.read(_read_bytes(source, known, text.MEMORY_PER_TEXT_BYTE), **said, **linear)


def _read_flir_sequence(source: ByteReader, known: ReaderOptions) -> Iterator[RawFrames]:
    """Frames of one FFF block, or of many: a sequence."""
    found = flir.read(source, "FLIR FFF", known.parameters, known.planck, known.every, known.limit)
    first = next(found, None)
    second = next(found, None)
    for frames in (first, second):
        if frames is not None:
            many = second is not None or len(frames.temperature) > 1
            yield replace(frames, format="FLIR sequence") if many else frames
    for frames in found:
        yield replace(frames, format="FLIR sequence")


def _read_bytes(source: ByteReader, known: ReaderOptions, times: float = MEMORY_PER_FILE_SIZE) -> bytes:
    """All bytes of a file whose kind is read whole."""
    check_memory(times * len(source) / BYTES_PER_PIXEL, known.limit, f"{len(source) / 1e6:.0f} MB read at once")
    return source[0 : len(source)]


def _refuse_unsupported(path: Path, data: bytes) -> None:
    """BadInput for what only a maker's closed kit reads and for pictures with a colour bar."""
    if whose := CLOSED_FORMATS.get(path.suffix.lower()):
        raise BadInput(f"{whose[0]}, which only the maker's closed kit reads; {whose[1]}")
    if data[4:8] == b"ftyp":
        raise BadInput("MP4" + COLOUR_IMAGE_REMEDY)
    for magic, what in FOREIGN_SIGNATURES.items():
        if data.startswith(magic):
            raise BadInput(what)
