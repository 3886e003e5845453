"""Any camera file -> Frames: the kind is told by its first bytes, not by its name."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field, replace
from pathlib import Path

from flashtemp.camera.formats import arrays, flir, infratec, text, tiff
from flashtemp.camera.radiometry import Planck
from flashtemp.camera.raw_frames import Frames
from flashtemp.errors import BadInput

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
MOST_BYTES = 8 * 2**30


@dataclass(frozen=True)
class Unsaid:
    """What a file may not say: `scale` and `offset` (degC) of counts, `unit`, `variable`, `decimal`, `below` (degC).

    `parameters` and `planck` go before what a radiometric file says itself; `every`: keep one frame of so many.
    """

    scale: float | None = None
    offset: float | None = None
    unit: str | None = None
    variable: str | None = None
    decimal: str | None = None
    below: float | None = None
    parameters: dict[str, float] = field(default_factory=dict)
    planck: Planck | None = None
    every: int = 1


def read(path, **unsaid) -> Frames:
    """Frames of a camera file; `unsaid` as in `Unsaid`.

    Raises BadInput in one line that begins with the file's name.
    """
    path, known = Path(path), Unsaid(**unsaid)
    try:
        data = _bytes(path)
        frames = _by_magic(path, data, known)
        return frames if frames.counts is not None else frames.every(known.every)
    except BadInput as fault:
        name = str(path)
        raise BadInput(*(t if t.startswith(name) else f"{name}: {t}" for t in fault.lines)) from fault
    except MemoryError as fault:
        raise BadInput(f"{path}: more than the memory holds; give a part of it, or copy it again if damaged") from fault
    except (struct.error, ValueError, IndexError, OverflowError) as fault:
        raise BadInput(f"{path}: damaged ({' '.join(str(fault).split())}); copy it again or export it anew") from fault


def _bytes(path: Path) -> bytes:
    if not path.is_file():
        raise BadInput("no such file; give camera files, a folder of them or a recording template (.toml)")
    try:
        if path.stat().st_size > MOST_BYTES:
            raise BadInput(f"{path.stat().st_size / 2**30:.0f} GiB in one file; give an export of the part you need")
        data = path.read_bytes()
    except OSError as fault:
        raise BadInput(f"cannot be read ({fault.strerror}); give a file that can") from fault
    if not data:
        raise BadInput("the file is empty; copy it again or choose another")
    return data


def _by_magic(path: Path, data: bytes, known: Unsaid) -> Frames:
    linear = {"scale": known.scale, "offset": known.offset}
    if data.startswith(b"\xff\xd8"):
        return _jpeg(data, known)
    if data.startswith(flir.MAGIC):
        frames = flir.read(data, "FLIR FFF", known.parameters, known.planck, known.every)
        return replace(frames, format="FLIR sequence") if len(frames.temperature) > 1 else frames
    if data.startswith(infratec.MAGIC):
        return infratec.read(data)
    if data.startswith(tiff.MAGIC):
        return tiff.read(data, unit=known.unit, **linear)
    if data.startswith(tiff.PNG):
        return tiff.read_png(data, **linear)
    if data.startswith((arrays.HDF5, arrays.MATLAB, *arrays.CLASSIC)):
        return arrays.read(path, data, unit=known.unit, variable=known.variable, **linear)
    _refuse(path, data)
    return text.read(data, unit=known.unit, below=known.below, decimal=known.decimal, **linear)


def _jpeg(data: bytes, known: Unsaid) -> Frames:
    block = flir.joined(data)
    if not block:
        raise BadInput("JPEG without thermal data" + COLOURS)
    return flir.read(block, "FLIR radiometric JPEG", known.parameters, known.planck)


def _refuse(path: Path, data: bytes) -> None:
    """BadInput for what only a maker's closed kit reads and for pictures with a colour bar."""
    if whose := CLOSED.get(path.suffix.lower()):
        raise BadInput(f"{whose[0]}, which only the maker's closed kit reads; {whose[1]}")
    if data[4:8] == b"ftyp":
        raise BadInput("MP4" + COLOURS)
    for magic, what in FOREIGN.items():
        if data.startswith(magic):
            raise BadInput(what)
