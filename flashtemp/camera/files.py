"""Any camera file -> Frames: the kind is told by its first bytes, not by its name."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.camera.formats import arrays, flir, infratec, jpeg, text, tiff
from flashtemp.camera.plausible import PER_PIXEL, fits
from flashtemp.camera.radiometry import Planck
from flashtemp.camera.raw_frames import Frames, joined
from flashtemp.camera.source import Source
from flashtemp.errors import BadInput, short
from flashtemp.physics.quantities import KELVIN

SCIENCE = "open it in ResearchIR or Research Studio, export TIFF (with scale and offset), CSV or MAT, and give that"
CLOSED = {  # name ends: whose and what to ask for
    ".ats": ("FLIR ATS", SCIENCE), ".ptw": ("FLIR PTW", SCIENCE), ".sfmov": ("FLIR SFMOV", SCIENCE),
    ".ravi": ("Optris RAVI", "export CSV or TIFF from PIX Connect and give that"),
    ".is2": ("Fluke IS2", "export CSV from SmartView and give that"),
    ".is3": ("Fluke IS3", "export CSV from SmartView and give that"),
    ".bmt": ("Testo BMT", "export the temperatures as CSV from IRSoft and give that"),
}  # fmt: skip
COLOURS = "; it holds colours or a film, not temperatures: give the radiometric file of the camera or its export as CSV"
FOREIGN = {  # first bytes: what it is
    b"GIF8": "GIF" + COLOURS,
    b"BM": "a bitmap" + COLOURS,
    b"RIFF": "AVI" + COLOURS,
    b"\x1aE\xdf\xa3": "Matroska film" + COLOURS,
    b"PK\x03\x04": "a ZIP archive (XLSX, IS2, ...); save or export it as CSV and give that",
    b"\x1f\x8b": "a gzip archive; unpack it and give what is inside",
    b"%PDF": "PDF; give the camera's own file",
    b"CEDIP": f"FLIR PTW, which only the maker's closed kit reads; {SCIENCE}",
}
COLDEST = -150.0  # degC: what no camera sees beside something warm
START = 8192  # bytes that tell the kind of a file
WHOLE = 4  # times a file that is read whole must fit into the limit
LATER = 50  # pieces without any temperature that may come first


@dataclass(frozen=True)
class Unsaid:
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
    planck: Planck | None = None
    every: int = 1
    limit: float | None = None


def read(path: str | Path, **unsaid: Any) -> Frames:
    """All frames of a camera file at once; `unsaid` as in `Unsaid`.

    Raises BadInput in one line that begins with the file's name, also where they take more memory than `limit`.
    """
    kept: list[Frames] = []
    for piece in pieces(path, **unsaid):
        kept.append(piece)
        pixels = sum(p.temperature.size for p in kept)
        with _named(Path(path)):
            fits(pixels, Unsaid(**unsaid).limit, f"{pixels // kept[0].temperature[0].size} frames at once")
    return joined(kept)


def pieces(path: str | Path, **unsaid: Any) -> Iterator[Frames]:
    """Frames of a camera file, a few at a time where it is a long sequence.  Raises as `read` does."""
    path, known = Path(path), Unsaid(**unsaid)
    held: list[Frames] = []
    warm = False
    with _named(path):
        for frames in _by_magic(path, known):
            held.append(frames)
            warm = warm or bool(np.isfinite(frames.temperature).any())
            if warm:
                yield from held
                held = []
            elif len(held) > LATER:
                break
        if not warm:
            raise BadInput("no pixel holds a temperature; choose another file or repair its parameters")


@contextmanager
def _named(path: Path) -> Iterator[None]:
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
            f"{path}: damaged ({short(' '.join(str(fault).split()))}); copy it again or export it anew"
        ) from fault


def alike(first: Path, one: Frames, path: Path, other: Frames) -> None:
    """BadInput where a file is of another kind, size or unit than the first."""
    if one.format != other.format:
        raise BadInput(f"{path}: {other.format}, but {first.name} is {one.format}; give files of one kind at once")
    (rows, columns), (high, wide) = one.shape, other.shape
    if (rows, columns) != (high, wide):
        raise BadInput(
            f"{path}: {wide} x {high} pixels, but {first.name} has {columns} x {rows}; give files of one size at once"
        )
    if one.counts is None and other.counts is None:
        was, now = (_middle(frames.temperature[0]) for frames in (one, other))
        if min(was, now) < COLDEST < max(was, now) - KELVIN / 2:
            raise BadInput(
                f"{path}: values around {now:.4g} degC, but {first.name} has {was:.4g}: one is in degC and the other in"
                " kelvin; give files of one unit at once"
            )


def _middle(image: np.ndarray) -> float:
    """Median of the values of an image, 0 where all are dead."""
    known = image[np.isfinite(image)]
    return float(np.median(known)) if known.size else 0.0


def _by_magic(path: Path, known: Unsaid) -> Iterator[Frames]:
    if not path.is_file():
        raise BadInput("no such file; give camera files, a folder of them or a recording template (.toml)")
    with Source(path) as source:
        if not len(source):
            raise BadInput("the file is empty; copy it again or choose another")
        start = source[0:START]
        linear = {"scale": known.scale, "offset": known.offset}
        if start.startswith(flir.MAGIC):
            yield from _sequence(source, known)
        elif start.startswith(tiff.MAGIC):
            yield from tiff.read(path, unit=known.unit, every=known.every, limit=known.limit, **linear)
        elif start.startswith((arrays.HDF5, arrays.MATLAB, *arrays.CLASSIC)):
            data = b"" if arrays.is_hdf5(start) else _whole(source, known)
            asked = {"unit": known.unit, "variable": known.variable, "every": known.every, "limit": known.limit}
            yield from arrays.read(path, start, data, **asked, **linear)
        else:
            for frames in _in_one(path, source, start, known, linear):
                yield frames if frames.counts is not None else frames.every(known.every)


def _in_one(path: Path, source: Source, start: bytes, known: Unsaid, linear: dict) -> Iterator[Frames]:
    """Frames of a file that is read whole."""
    if start.startswith(b"\xff\xd8"):
        data = _whole(source, known)
        block = flir.joined(data)
        if not block:
            what = jpeg.without_flir(data)
            raise BadInput(what if "give" in what else what + COLOURS)
        yield from flir.read(block, "FLIR radiometric JPEG", known.parameters, known.planck, limit=known.limit)
    elif start.startswith(infratec.MAGIC):
        yield infratec.read(_whole(source, known), known.limit)
    elif start.startswith(tiff.PNG):
        yield tiff.read_png(_whole(source, known), limit=known.limit, **linear)
    else:
        _refuse(path, start)
        if not text.is_text(start):
            raise BadInput(text.NO_TEXT)
        said = {k: getattr(known, k) for k in ("unit", "below", "decimal", "rows", "labels")}
        yield text.read(_whole(source, known, text.PER_BYTE), **said, **linear)


def _sequence(source: Source, known: Unsaid) -> Iterator[Frames]:
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


def _whole(source: Source, known: Unsaid, times: float = WHOLE) -> bytes:
    """All bytes of a file whose kind is read whole."""
    fits(times * len(source) / PER_PIXEL, known.limit, f"{len(source) / 1e6:.0f} MB read at once")
    return source[0 : len(source)]


def _refuse(path: Path, data: bytes) -> None:
    """BadInput for what only a maker's closed kit reads and for pictures with a colour bar."""
    if whose := CLOSED.get(path.suffix.lower()):
        raise BadInput(f"{whose[0]}, which only the maker's closed kit reads; {whose[1]}")
    if data[4:8] == b"ftyp":
        raise BadInput("MP4" + COLOURS)
    for magic, what in FOREIGN.items():
        if data.startswith(magic):
            raise BadInput(what)
