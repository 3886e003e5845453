"""FLIR headers and counts are parsed here: FFF alone, one after another (SEQ, CSQ) or in pieces inside a JPEG.

A block is a header of 64 bytes, a directory of 32-byte entries (type, offset, length) and the records they point
to; the counts are one record, the calibration and the object's parameters another.  Byte order differs from file
to file and, inside one, from record to record.  Layout: ExifTool's table of FLIR tags, and the sample files.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from flashtemp.camera.formats import png
from flashtemp.camera.plausible import fits
from flashtemp.camera.radiometry import CONSTANTS, NAMES, RANGES, ObjectParameters, Planck, object_temperature
from flashtemp.camera.raw_frames import MOST_PIXELS, Frames, need
from flashtemp.camera.source import Source, unpacked
from flashtemp.errors import BadInput
from flashtemp.physics.quantities import KELVIN

MAGIC = (b"FFF\0", b"AFF\0")
HEADER, ENTRY, RAW_HEADER, INFO_LEAST = 64, 32, 32, 0x310
COUNTS, INFO = 0x01, 0x20
PADDING = 8  # bytes that a camera may leave out at the very end of a sequence
PNG, JPEG = png.START, b"\xff\xd8\xff"
AGAIN = "copy it again or export it anew; what is there cannot be used"
FLOATS = {  # record INFO: attribute, offset
    "emissivity": 0x20, "distance": 0x24, "reflected": 0x28, "air": 0x2C, "window_temperature": 0x30,
    "window": 0x34, "humidity": 0x3C, "R1": 0x58, "B": 0x5C, "F": 0x60, "alpha1": 0x70, "alpha2": 0x74,
    "beta1": 0x78, "beta2": 0x7C, "X": 0x80, "highest": 0x98, "lowest": 0x9C, "R2": 0x30C,
}  # fmt: skip
PLAUSIBLE = {"B": (500.0, 6000.0), "F": (0.3, 3.0), "O": (-1e6, 1e6)}  # of any camera: lowest, highest
CORE_R = 366545.0  # R1/R2 that a Tau 2 core has before it is calibrated, with B = 1428 K, F = 1, O = 342 counts
ROOM = 26.85  # degC: where the sensitivity of a calibration is judged
FEWEST_COUNTS_PER_K = 1.0
MOST_COUNTS = 65535.0
PIECE = 4_000_000  # pixels that are turned into temperatures at a time
IN_KELVIN = ("reflected", "air", "window_temperature", "highest", "lowest")


@dataclass(frozen=True)
class Block:
    """One FFF block: bytes `begin` to `end` of the data, `records` {type: (offset, length, checksums)}.

    A checksum is a CRC-32 of the record in either byte order; cameras that write none write 0.
    """

    begin: int
    end: int
    records: dict[int, tuple[int, int, tuple[int, ...]]]


def joined(jpeg: bytes) -> bytes:
    """The FFF block that a JPEG's APP1 segments carry in numbered pieces; empty where there is none."""
    pieces, last, at = {}, None, 2
    while at + 4 <= len(jpeg) and jpeg[at] == 0xFF and jpeg[at + 1] not in (0xDA, 0xD9):
        (length,) = struct.unpack_from(">H", jpeg, at + 2)
        if jpeg[at + 1] == 0xE1 and jpeg[at + 4 : at + 9] == b"FLIR\0" and length > 10:
            number, last = jpeg[at + 10], jpeg[at + 11]
            pieces[number] = jpeg[at + 12 : at + 2 + length]
        at += 2 + max(length, 2)
    if last is None:
        return b""
    if missing := [n for n in range(last + 1) if n not in pieces]:
        raise BadInput(f"piece {missing[0] + 1} of {last + 1} of the thermal data is missing; {AGAIN}")
    return b"".join(pieces[n] for n in range(last + 1))


def blocks(data: bytes | Source) -> Iterator[Block]:
    """Every FFF block of the data in order; a block that is cut off or broken raises BadInput."""
    begin, number = 0, 0
    while begin >= 0:
        number += 1
        block = _block(data, begin, number)
        yield block
        begin = _next(data, block.end)


def _next(data: bytes | Source, begin: int) -> int:
    """Where the next block begins; -1 where there is none."""
    near = data[begin : begin + HEADER]
    found = [p for m in MAGIC if (p := near.find(m)) >= 0]
    if found:
        return begin + min(found)
    return min((p for p in (data.find(m, begin) for m in MAGIC) if p >= 0), default=-1)


def _block(data: bytes | Source, begin: int, number: int) -> Block:
    if begin + HEADER > len(data):
        raise BadInput(f"frame {number} is cut off in its header; {AGAIN}")
    order = next((o for o in "<>" if 100 <= unpacked(data, o + "I", begin + 0x14)[0] < 300), None)
    if order is None:
        raise BadInput(f"frame {number} has no readable FFF header; {AGAIN}")
    start, entries = unpacked(data, order + "2I", begin + 0x18)
    end = start + ENTRY * entries
    if entries > 1000 or begin + end > len(data):
        raise BadInput(f"frame {number}: the directory of its records is cut off; {AGAIN}")
    directory = data[begin + start : begin + end]
    records: dict[int, tuple[int, int, tuple[int, ...]]] = {}
    for k in range(entries):
        kind, _, _, _, offset, length, _, _, checksum = unpacked(directory, order + "2H7I", ENTRY * k)
        if kind in (COUNTS, INFO):
            if begin + offset + length > len(data) + PADDING:
                raise BadInput(
                    f"frame {number} is cut off: it needs {offset + length} bytes and has {len(data) - begin}; {AGAIN}"
                )
            sums = (checksum, int.from_bytes(checksum.to_bytes(4, "little"), "big")) if checksum else ()
            records.setdefault(kind, (begin + offset, length, sums))
        if kind and begin + offset + length <= len(data):
            end = max(end, offset + length)
    return Block(begin, begin + end, records)


def _record(data: bytes | Source, block: Block, kind: int, number: int) -> bytes:
    """A record of a block, whole as far as its checksum tells."""
    what = {COUNTS: "counts", INFO: "calibration"}[kind]
    if kind not in block.records:
        raise BadInput(f"frame {number} has no record of its {what}; choose a radiometric file of the camera")
    at, length, sums = block.records[kind]
    record = data[at : at + length]
    if sums and zlib.crc32(record) not in sums:
        raise BadInput(f"frame {number}: the checksum of its {what} does not fit: they are damaged or changed; {AGAIN}")
    return record


def counts(record: bytes, limit: float | None = None) -> np.ndarray:
    """Counts (rows, columns), 16 bits, of a record: plain, PNG or JPEG-LS."""
    order = "<" if record[:2] == b"\x02\0" else ">"
    if len(record) < RAW_HEADER or struct.unpack_from(order + "H", record)[0] != 2:
        raise BadInput(f"the record of the counts has no readable header; {AGAIN}")
    columns, rows = _size(record, order)
    payload = record[RAW_HEADER:]
    if not 0 < rows * columns <= MOST_PIXELS:
        raise BadInput(f"an image of {columns} x {rows} pixels; {AGAIN}")
    fits(rows * columns, limit, f"an image of {columns} x {rows} pixels")
    if payload.startswith(PNG):
        png.check(payload)
        return _smoother(_decoded(payload, (rows, columns), "png_decode", struct.unpack_from(">2I", payload, 16)))
    if payload.startswith(JPEG) and (size := _jpegls_size(payload)):
        return _decoded(payload, (rows, columns), "jpegls_decode", size)
    if len(payload) < 2 * rows * columns:
        raise BadInput(f"{len(payload)} bytes of counts for {columns} x {rows} pixels; {AGAIN}")
    return np.frombuffer(payload, order + "u2", rows * columns).reshape(rows, columns).astype(np.uint16)


def _size(record: bytes, order: str) -> tuple[int, int]:
    """Columns and rows of a record's image, which most cameras write twice: as numbers and as last places."""
    columns, rows, _, _, _, last_column, _, last_row = struct.unpack_from(order + "8H", record, 2)
    if (last_column, last_row) not in ((0, 0), (columns - 1, rows - 1)):
        raise BadInput(f"an image of {columns} x {rows} pixels that ends at {last_column}, {last_row}; {AGAIN}")
    return columns, rows


def _jpegls_size(payload: bytes) -> tuple[int, int] | None:
    """Columns and rows that the frame header of a JPEG-LS image states, None where it is no such image."""
    at = 2
    while at + 9 <= min(len(payload), 4096) and payload[at] == 0xFF:
        if payload[at + 1] == 0xF7:
            rows, columns = struct.unpack_from(">2H", payload, at + 5)
            return columns, rows
        at += 2 + max(2, struct.unpack_from(">H", payload, at + 2)[0])
    return None


def _decoded(payload: bytes, shape, decoder: str, size) -> np.ndarray:
    """A compressed image whose own (columns, rows) must be those of the record."""
    if tuple(size) != shape[::-1]:
        raise BadInput(f"an image of {size[0]} x {size[1]} pixels in a record of {shape[1]} x {shape[0]}; {AGAIN}")
    try:
        image = getattr(need("imagecodecs"), decoder)(payload)
    except BadInput:
        raise
    except Exception as fault:  # each codec raises its own kind
        raise BadInput(f"the compressed counts are damaged ({' '.join(str(fault).split())}); {AGAIN}") from fault
    if image.shape != shape or image.dtype != np.uint16:
        raise BadInput(f"compressed image of shape {image.shape} and {image.dtype}, not 16 bits of {shape}; {AGAIN}")
    return image


def _smoother(image: np.ndarray) -> np.ndarray:
    """The image or its byte-swapped twin: cameras write PNG either way, and only neighbours tell which."""
    swapped = image.byteswap()
    rough = [np.abs(np.diff(i.astype(np.int32), axis=1)).mean() if i.shape[1] > 1 else 0 for i in (image, swapped)]
    return image if rough[0] <= rough[1] else swapped


@dataclass(frozen=True)
class Info:
    """What a block says besides its counts: numbers by name, the camera's name, its clock (s) and frame rate."""

    values: dict[str, float]
    camera: str
    clock: float | None
    fps: float | None


def info(record: bytes) -> Info:
    """The record of the camera's calibration and the object's parameters."""
    order = "<" if record[:2] == b"\x02\0" else ">"
    if len(record) < INFO_LEAST or struct.unpack_from(order + "H", record)[0] != 2:
        raise BadInput("the calibration record is missing or damaged; choose a radiometric file of the camera")
    values = {name: struct.unpack_from(order + "f", record, at)[0] for name, at in FLOATS.items()}
    values["O"] = float(struct.unpack_from(order + "i", record, 0x308)[0])
    values |= {name: round(values[name] - KELVIN, 4) for name in IN_KELVIN}
    for name in ("emissivity", "distance", "window", "humidity"):
        values[name] = float(f"{values[name]:.7g}")  # 0.95, not the nearest float32
    if 2 < values["humidity"] <= 100:
        values["humidity"] /= 100
    camera = record[0xD4:0xF4].split(b"\0")[0].decode("ascii", "replace").strip()
    fps = struct.unpack_from(order + "H", record, 0x464)[0] if len(record) >= 0x466 else 0
    return Info(values, camera, _clock(record, order), float(fps) if fps else None)


def _clock(record: bytes, order: str) -> float | None:
    """Seconds since 1970 in the camera's own time zone, to 1 ms."""
    if len(record) < 0x38E:
        return None
    seconds, thousandths, zone = struct.unpack_from(order + "2Ih", record, 0x384)
    return seconds - 60 * zone + (thousandths & 0xFFFF) / 1000 if seconds else None


@lru_cache(maxsize=64)
def _table(planck: Planck, parameters: ObjectParameters, own: ObjectParameters, lowest: float, highest: float):
    """Temperature, degC, of each of the 65536 counts; NaN beyond the range (degC) at the file's `own` parameters."""
    counts = np.arange(65536.0)
    T, T_own = (object_temperature(counts, planck, p) for p in (parameters, own))
    return np.where((T_own < lowest) | (T_own > highest), np.nan, T)


def _calibration(v: dict[str, float]) -> Planck:
    """The calibration that a file states.  BadInput where it is damaged or none of the camera's own.

    Cores that were never calibrated write the constants that the core starts with, R1 366545, R2 1, B 1428, F 1,
    O 342: counts = R1/(exp(B/T) - F) + O in the core's own sign, while files of cameras subtract O.  Their counts stand
    about 8192 whatever is before the camera, which reads as 100 degC.
    """
    for name, (low, high) in PLAUSIBLE.items():
        if not low <= v[name] <= high:
            raise BadInput(
                f"planck: {name} of {v[name]:g} in its calibration, cameras have {low:g} to {high:g}; {AGAIN}"
            )
    planck = Planck(*(v[k] for k in ("R1", "R2", "B", "F", "O")))
    stated = f"R1 {planck.R1:g}, R2 {planck.R2:g}, B {planck.B:g}, F {planck.F:g}, O {planck.O:g}"
    remedy = "give the camera's own with --planck R1 R2 B F O, or the file of a radiometric camera"
    if planck.R2 == 1 and (planck.R1 == CORE_R or planck.O > 0):
        raise BadInput(
            f"planck: {stated} is what cores without a calibration for temperatures write: the counts are no"
            f" temperatures; {remedy}"
        )
    per_K = 1 / float(planck.slope(planck.counts(ROOM)))
    if not per_K >= FEWEST_COUNTS_PER_K:
        raise BadInput(
            f"planck: {stated} makes {per_K:.2g} counts per K, which is no calibration of a camera; {remedy}"
        )
    if v["lowest"] > -KELVIN and planck.counts(v["lowest"]) > MOST_COUNTS:
        raise BadInput(
            f"planck: {stated} makes {planck.counts(v['lowest']):.3g} counts at {v['lowest']:g} degC, the coldest that"
            f" the camera measures, and 16 bits hold {MOST_COUNTS:g}: no calibration of this camera; {remedy}"
        )
    return planck


def _remarks(planck: Planck, p: ObjectParameters) -> list[str]:
    """What is assumed of the calibration and of the air."""
    remarks = []
    if abs(planck.R1 / planck.R2 / CORE_R - 1) < 1e-5 and (planck.B, planck.F) == (1428.0, 1.0):
        remarks.append(
            "calibration: the constants that the core starts with, not those of this very camera; temperatures may be"
            " several K off (--planck replaces them)"
        )
    if p.distance > 0 and not any(getattr(p, name) for name in CONSTANTS):
        remarks.append("air: the file states no constants of it (all are 0); its transmission is taken as 1")
    return remarks


def physics(info: Info, given: dict[str, float], planck: Planck | None):
    """What `_table` needs of a frame; what a person gives goes before what the file says."""
    v = info.values
    planck = planck or _calibration(v)
    said = {k: v[k] for k in (*NAMES, *CONSTANTS)}
    if said["window"] == 1:
        said["window_temperature"] = 20.0  # without a window some cameras write 0 K
    if (said | given)["distance"] == 0 and not RANGES["air"][0] <= said["air"] <= RANGES["air"][1]:
        said["air"] = 20.0  # without a path some cameras write 0 K
    parameters = ObjectParameters(**(said | given))
    lowest, highest = v["lowest"], v["highest"]
    if not (math.isfinite(lowest) and math.isfinite(highest) and -KELVIN < lowest < highest):
        lowest, highest = -KELVIN, math.inf
    try:
        own = ObjectParameters(**said)
    except BadInput:
        own = parameters
    return planck, parameters, own, lowest, highest


def read(
    data: bytes | Source,
    name: str,
    given: dict[str, float],
    planck: Planck | None = None,
    every: int = 1,
    limit: float | None = None,
) -> Iterator[Frames]:
    """Frames of FFF data, one of `every`, a few at a time, degC with the file's parameters or those given instead."""
    images: list[np.ndarray] = []
    infos: list[Info] = []
    found: list[tuple] = []
    first: tuple | None = None
    shape = None
    for number, block in enumerate(blocks(data), 1):
        if (number - 1) % every:
            continue
        record = _record(data, block, INFO, number)
        about, image = info(record), counts(_record(data, block, COUNTS, number), limit)
        if image.shape != (shape := shape or image.shape):
            raise BadInput(f"frame {number} has shape {image.shape}, frame 1 {shape}; {AGAIN}")
        images.append(image)
        infos.append(about)
        found.append(physics(about, given, planck))
        first = first or found[0]
        if (len(images) + 1) * image.size > PIECE:
            yield _frames(name, images, infos, found, first, every)
            images, infos, found = [], [], []
    if images:
        assert first is not None  # set with the first image
        yield _frames(name, images, infos, found, first, every)


def _frames(name: str, images, infos: list[Info], found: list[tuple], first: tuple, every: int) -> Frames:
    T = np.empty((len(images), *images[0].shape))
    for temperature, image, setting in zip(T, images, found, strict=True):
        temperature[:] = _table(*setting)[image]
    clocks = [i.clock for i in infos]
    change = ["parameters change from frame to frame; each has its own"] if any(f != first for f in found) else []
    return Frames(
        format=name,
        temperature=T,
        clock=None if None in clocks else np.array(clocks),
        said={k: infos[0].values[k] for k in NAMES},
        parameters=found[0][1],
        counts=np.stack(images),
        planck=found[0][0],
        camera=infos[0].camera,
        fps=infos[0].fps / every if infos[0].fps else None,
        outside=int(np.isnan(T).sum()),
        notes=(*change, *_remarks(found[0][0], found[0][1])),
    )
