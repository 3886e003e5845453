"""FLIR radiometric data: single FFF blocks, sequences of them (SEQ, CSQ), or pieces inside a JPEG.

A block is a header of 64 bytes, a directory of 32-byte entries (type, offset, length) and the records they point
to; the counts are one record, the calibration and the object's parameters another.  Byte order differs from file
to file and, inside one, from record to record.  Layout: ExifTool's table of FLIR tags, and the sample files.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from flashtemp.camera.image_validation import check_memory
from flashtemp.camera.importing.formats import png
from flashtemp.camera.importing.formats.byte_reader import ByteReader, unpack_at
from flashtemp.camera.importing.formats.camera_file import CameraFile
from flashtemp.camera.importing.formats.raw_frames import MAX_FRAME_PIXELS, RawFrames, require_module
from flashtemp.camera.radiometry import (
    AIR_CONSTANTS,
    PARAMETER_NAMES,
    PARAMETER_RANGES,
    ObjectParameters,
    PlanckCalibration,
    object_temperature,
)
from flashtemp.errors import BadInput
from flashtemp.physics.quantities import KELVIN

MAGIC = (b"FFF\0", b"AFF\0")
FFF_HEADER_BYTES, FFF_ENTRY_BYTES, COUNTS_HEADER_BYTES, MIN_INFO_BYTES = 64, 32, 32, 0x310
COUNTS_RECORD, INFO_RECORD = 0x01, 0x20
MAX_MISSING_BYTES = 8  # bytes that a camera may leave out at the very end of a sequence
PNG, JPEG = png.PNG_SIGNATURE, b"\xff\xd8\xff"
DAMAGED_FILE_REMEDY = "copy it again or export it anew; what is there cannot be used"
INFO_OFFSETS = {  # record INFO: attribute, offset
    "emissivity": 0x20, "distance": 0x24, "reflected": 0x28, "air": 0x2C, "window_temperature": 0x30,
    "window": 0x34, "humidity": 0x3C, "R1": 0x58, "B": 0x5C, "F": 0x60, "alpha1": 0x70, "alpha2": 0x74,
    "beta1": 0x78, "beta2": 0x7C, "X": 0x80, "highest": 0x98, "lowest": 0x9C, "R2": 0x30C,
}  # fmt: skip
CALIBRATION_RANGES = {"B": (500.0, 6000.0), "F": (0.3, 3.0), "O": (-1e6, 1e6)}  # lowest, highest of any camera
CORE_R1_OVER_R2 = 366545.0  # R1/R2 of an uncalibrated Tau 2 core, with B = 1428 K, F = 1, O = 342 counts
ROOM_DEGC = 26.85  # degC, at which the sensitivity of a calibration is checked
MIN_COUNTS_PER_K = 1.0
MAX_COUNTS = 65535.0
PIXELS_PER_PIECE = 4_000_000  # pixels that are converted at a time
IN_KELVIN = ("reflected", "air", "window_temperature", "highest", "lowest")


@dataclass(frozen=True)
class FffBlock:
    """One FFF block: bytes `begin` to `end` of the data, `records` {type: (offset, length, checksums)}.

    A checksum is a CRC-32 of the record in either byte order; cameras that write none write 0.
    """

    begin: int
    end: int
    records: dict[int, tuple[int, int, tuple[int, ...]]]


def join_jpeg_pieces(jpeg: bytes) -> bytes:
    """The FFF block in the numbered pieces of a JPEG's APP1 segments; empty if there is none.  Raises BadInput."""
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
        raise BadInput(f"piece {missing[0] + 1} of {last + 1} of the thermal data is missing; {DAMAGED_FILE_REMEDY}")
    return b"".join(pieces[n] for n in range(last + 1))


def iter_blocks(data: bytes | ByteReader) -> Iterator[FffBlock]:
    """Every FFF block of the data in order; a block that is cut off or broken raises BadInput."""
    begin, number = 0, 0
    while begin >= 0:
        number += 1
        block = _parse_block(data, begin, number)
        yield block
        begin = _find_next_block(data, block.end)


def _find_next_block(data: bytes | ByteReader, begin: int) -> int:
    """Offset of the next block; -1 if there is none."""
    near = data[begin : begin + FFF_HEADER_BYTES]
    found = [p for m in MAGIC if (p := near.find(m)) >= 0]
    if found:
        return begin + min(found)
    return min((p for p in (data.find(m, begin) for m in MAGIC) if p >= 0), default=-1)


def _parse_block(data: bytes | ByteReader, begin: int, number: int) -> FffBlock:
    if begin + FFF_HEADER_BYTES > len(data):
        raise BadInput(f"frame {number} is cut off in its header; {DAMAGED_FILE_REMEDY}")
    order = next((o for o in "<>" if 100 <= unpack_at(data, o + "I", begin + 0x14)[0] < 300), None)
    if order is None:
        raise BadInput(f"frame {number} has no readable FFF header; {DAMAGED_FILE_REMEDY}")
    start, entries = unpack_at(data, order + "2I", begin + 0x18)
    end = start + FFF_ENTRY_BYTES * entries
    if entries > 1000 or begin + end > len(data):
        raise BadInput(f"frame {number}: the directory of its records is cut off; {DAMAGED_FILE_REMEDY}")
    directory = data[begin + start : begin + end]
    records: dict[int, tuple[int, int, tuple[int, ...]]] = {}
    for k in range(entries):
        kind, _, _, _, offset, length, _, _, checksum = unpack_at(directory, order + "2H7I", FFF_ENTRY_BYTES * k)
        if kind in (COUNTS_RECORD, INFO_RECORD):
            if begin + offset + length > len(data) + MAX_MISSING_BYTES:
                raise BadInput(
                    f"frame {number} is cut off: it needs {offset + length} bytes and has {len(data) - begin};"
                    f" {DAMAGED_FILE_REMEDY}"
                )
            sums = (checksum, int.from_bytes(checksum.to_bytes(4, "little"), "big")) if checksum else ()
            records.setdefault(kind, (begin + offset, length, sums))
        if kind and begin + offset + length <= len(data):
            end = max(end, offset + length)
    return FffBlock(begin, begin + end, records)


def _read_record(data: bytes | ByteReader, block: FffBlock, kind: int, number: int) -> bytes:
    """A record of a block, verified by its checksum if it has one.  Raises BadInput."""
    what = {COUNTS_RECORD: "counts", INFO_RECORD: "calibration"}[kind]
    if kind not in block.records:
        raise BadInput(f"frame {number} has no record of its {what}; choose a radiometric file of the camera")
    at, length, sums = block.records[kind]
    record = data[at : at + length]
    if sums and zlib.crc32(record) not in sums:
        raise BadInput(
            f"frame {number}: the checksum of its {what} does not fit: they are damaged or changed;"
            f" {DAMAGED_FILE_REMEDY}"
        )
    return record


def decode_counts(record: bytes, limit: float | None = None) -> np.ndarray:
    """Counts (rows, columns), 16 bits, of a record: plain, PNG or JPEG-LS."""
    order = "<" if record[:2] == b"\x02\0" else ">"
    if len(record) < COUNTS_HEADER_BYTES or struct.unpack_from(order + "H", record)[0] != 2:
        raise BadInput(f"the record of the counts has no readable header; {DAMAGED_FILE_REMEDY}")
    columns, rows = _image_size(record, order)
    payload = record[COUNTS_HEADER_BYTES:]
    if not 0 < rows * columns <= MAX_FRAME_PIXELS:
        raise BadInput(f"an image of {columns} x {rows} pixels; {DAMAGED_FILE_REMEDY}")
    check_memory(rows * columns, limit, f"an image of {columns} x {rows} pixels")
    if payload.startswith(PNG):
        png.check_png(payload)
        return _fix_byte_order(
            _decode_image(payload, (rows, columns), "png_decode", struct.unpack_from(">2I", payload, 16))
        )
    if payload.startswith(JPEG) and (size := _jpegls_size(payload)):
        return _decode_image(payload, (rows, columns), "jpegls_decode", size)
    if len(payload) < 2 * rows * columns:
        raise BadInput(f"{len(payload)} bytes of counts for {columns} x {rows} pixels; {DAMAGED_FILE_REMEDY}")
    return np.frombuffer(payload, order + "u2", rows * columns).reshape(rows, columns).astype(np.uint16)


def _image_size(record: bytes, order: str) -> tuple[int, int]:
    """Columns and rows of a record's image, which most cameras write twice: as numbers and as last indices."""
    columns, rows, _, _, _, last_column, _, last_row = struct.unpack_from(order + "8H", record, 2)
    if (last_column, last_row) not in ((0, 0), (columns - 1, rows - 1)):
        raise BadInput(
            f"an image of {columns} x {rows} pixels that ends at {last_column}, {last_row}; {DAMAGED_FILE_REMEDY}"
        )
    return columns, rows


def _jpegls_size(payload: bytes) -> tuple[int, int] | None:
    """Columns and rows in the frame header of a JPEG-LS image; None if it is no such image."""
    at = 2
    while at + 9 <= min(len(payload), 4096) and payload[at] == 0xFF:
        if payload[at + 1] == 0xF7:
            rows, columns = struct.unpack_from(">2H", payload, at + 5)
            return columns, rows
        at += 2 + max(2, struct.unpack_from(">H", payload, at + 2)[0])
    return None


def _decode_image(payload: bytes, shape, decoder: str, size) -> np.ndarray:
    """A compressed image, whose (columns, rows) `size` must agree with the `shape` of the record.  Raises BadInput."""
    if tuple(size) != shape[::-1]:
        raise BadInput(
            f"an image of {size[0]} x {size[1]} pixels in a record of {shape[1]} x {shape[0]}; {DAMAGED_FILE_REMEDY}"
        )
    try:
        image = getattr(require_module("imagecodecs"), decoder)(payload)
    except BadInput:
        raise
    except Exception as fault:  # each codec raises its own kind
        raise BadInput(
            f"the compressed counts are damaged ({' '.join(str(fault).split())}); {DAMAGED_FILE_REMEDY}"
        ) from fault
    if image.shape != shape or image.dtype != np.uint16:
        raise BadInput(
            f"compressed image of shape {image.shape} and {image.dtype}, not 16 bits of {shape}; {DAMAGED_FILE_REMEDY}"
        )
    return image


def _fix_byte_order(image: np.ndarray) -> np.ndarray:
    """The image or its byte-swapped copy, whichever is smoother: cameras write PNG in either byte order."""
    swapped = image.byteswap()
    rough = [np.abs(np.diff(i.astype(np.int32), axis=1)).mean() if i.shape[1] > 1 else 0 for i in (image, swapped)]
    return image if rough[0] <= rough[1] else swapped


@dataclass(frozen=True)
class CameraInfo:
    """Facts of a block besides its counts: numbers by name, camera name, clock (s) and frame rate."""

    values: dict[str, float]
    camera: str
    clock: float | None
    fps: float | None


def parse_info(record: bytes) -> CameraInfo:
    """Calibration of the camera and object parameters from their record.  Raises BadInput."""
    order = "<" if record[:2] == b"\x02\0" else ">"
    if len(record) < MIN_INFO_BYTES or struct.unpack_from(order + "H", record)[0] != 2:
        raise BadInput("the calibration record is missing or damaged; choose a radiometric file of the camera")
    values = {name: struct.unpack_from(order + "f", record, at)[0] for name, at in INFO_OFFSETS.items()}
    values["O"] = float(struct.unpack_from(order + "i", record, 0x308)[0])
    values |= {name: round(values[name] - KELVIN, 4) for name in IN_KELVIN}
    for name in ("emissivity", "distance", "window", "humidity"):
        values[name] = float(f"{values[name]:.7g}")  # 0.95, not the nearest float32
    if 2 < values["humidity"] <= 100:
        values["humidity"] /= 100
    camera = record[0xD4:0xF4].split(b"\0")[0].decode("ascii", "replace").strip()
    fps = struct.unpack_from(order + "H", record, 0x464)[0] if len(record) >= 0x466 else 0
    return CameraInfo(values, camera, _camera_clock(record, order), float(fps) if fps else None)


def _camera_clock(record: bytes, order: str) -> float | None:
    """Seconds since 1970 in the camera's own time zone, to 1 ms."""
    if len(record) < 0x38E:
        return None
    seconds, thousandths, zone = struct.unpack_from(order + "2Ih", record, 0x384)
    return seconds - 60 * zone + (thousandths & 0xFFFF) / 1000 if seconds else None


@lru_cache(maxsize=64)
def _temperature_table(
    planck: PlanckCalibration, parameters: ObjectParameters, own: ObjectParameters, lowest: float, highest: float
):
    """Temperature, degC, of each of the 65536 counts; NaN beyond the range (degC) at the file's `own` parameters."""
    counts = np.arange(65536.0)
    T, T_own = (object_temperature(counts, planck, p) for p in (parameters, own))
    return np.where((T_own < lowest) | (T_own > highest), np.nan, T)


def _stated_calibration(v: dict[str, float]) -> PlanckCalibration:
    """The calibration that a file states.  BadInput if it is damaged or not that of this camera.

    Cores that were never calibrated write the initial constants R1 366545, R2 1, B 1428, F 1, O 342, with counts =
    R1/(exp(B/T) - F) + O, while files of cameras subtract O.  Their counts lie around 8192 for any scene, which would
    read as 100 degC.
    """
    for name, (low, high) in CALIBRATION_RANGES.items():
        if not low <= v[name] <= high:
            raise BadInput(
                f"planck: {name} of {v[name]:g} in its calibration, cameras have {low:g} to {high:g};"
                f" {DAMAGED_FILE_REMEDY}"
            )
    planck = PlanckCalibration(*(v[k] for k in ("R1", "R2", "B", "F", "O")))
    stated = f"R1 {planck.R1:g}, R2 {planck.R2:g}, B {planck.B:g}, F {planck.F:g}, O {planck.O:g}"
    remedy = "give the camera's own with --planck R1 R2 B F O, or the file of a radiometric camera"
    if planck.R2 == 1 and (planck.R1 == CORE_R1_OVER_R2 or planck.O > 0):
        raise BadInput(
            f"planck: {stated} is what cores without a calibration for temperatures write: the counts are no"
            f" temperatures; {remedy}"
        )
    per_K = 1 / float(planck.temperature_per_count(planck.counts(ROOM_DEGC)))
    if not per_K >= MIN_COUNTS_PER_K:
        raise BadInput(
            f"planck: {stated} makes {per_K:.2g} counts per K, which is no calibration of a camera; {remedy}"
        )
    if v["lowest"] > -KELVIN and planck.counts(v["lowest"]) > MAX_COUNTS:
        raise BadInput(
            f"planck: {stated} makes {planck.counts(v['lowest']):.3g} counts at {v['lowest']:g} degC, the coldest that"
            f" the camera measures, and 16 bits hold {MAX_COUNTS:g}: no calibration of this camera; {remedy}"
        )
    return planck


def _calibration_remarks(planck: PlanckCalibration, p: ObjectParameters) -> list[str]:
    """Notes on assumptions about the calibration and the air."""
    remarks = []
    if abs(planck.R1 / planck.R2 / CORE_R1_OVER_R2 - 1) < 1e-5 and (planck.B, planck.F) == (1428.0, 1.0):
        remarks.append(
            "calibration: the constants that the core starts with, not those of this very camera; temperatures may be"
            " several K off (--planck replaces them)"
        )
    if p.distance > 0 and not any(getattr(p, name) for name in AIR_CONSTANTS):
        remarks.append("air: the file states no constants of it (all are 0); its transmission is taken as 1")
    return remarks


def radiometric_settings(info: CameraInfo, given: dict[str, float], planck: PlanckCalibration | None):
    """Arguments of `_temperature_table` for a frame; `given` values replace those that the file states."""
    v = info.values
    planck = planck or _stated_calibration(v)
    stated = {k: v[k] for k in (*PARAMETER_NAMES, *AIR_CONSTANTS)}
    if stated["window"] == 1:
        stated["window_temperature"] = 20.0  # without a window some cameras write 0 K
    coldest, hottest, _ = PARAMETER_RANGES["air"]
    if (stated | given)["distance"] == 0 and not coldest <= stated["air"] <= hottest:
        stated["air"] = 20.0  # without a path some cameras write 0 K
    parameters = ObjectParameters(**(stated | given))
    lowest, highest = v["lowest"], v["highest"]
    if not (math.isfinite(lowest) and math.isfinite(highest) and -KELVIN < lowest < highest):
        lowest, highest = -KELVIN, math.inf
    try:
        own = ObjectParameters(**stated)
    except BadInput:
        own = parameters
    return planck, parameters, own, lowest, highest


def read(file: CameraFile) -> Iterator[RawFrames]:
    """Frames of a file of one FFF block, or of many: a sequence (SEQ, CSQ)."""
    options = file.options
    pieces = read_fff(file.source, "FLIR FFF", options.parameters, options.planck, options.every, options.limit)
    first = next(pieces, None)
    second = next(pieces, None)
    for frames in (first, second):
        if frames is not None:
            many = second is not None or len(frames.temperature) > 1
            yield replace(frames, format="FLIR sequence") if many else frames
    for frames in pieces:
        yield replace(frames, format="FLIR sequence")


def read_fff(
    data: bytes | ByteReader,
    name: str,
    given: dict[str, float],
    planck: PlanckCalibration | None = None,
    every: int = 1,
    limit: float | None = None,
) -> Iterator[RawFrames]:
    """Frames of FFF data, one of `every`, a few at a time, degC with the file's parameters or those given instead."""
    images: list[np.ndarray] = []
    infos: list[CameraInfo] = []
    found: list[tuple] = []
    first: tuple | None = None
    shape = None
    for number, block in enumerate(iter_blocks(data), 1):
        if (number - 1) % every:
            continue
        record = _read_record(data, block, INFO_RECORD, number)
        about, image = parse_info(record), decode_counts(_read_record(data, block, COUNTS_RECORD, number), limit)
        if image.shape != (shape := shape or image.shape):
            raise BadInput(f"frame {number} has shape {image.shape}, frame 1 {shape}; {DAMAGED_FILE_REMEDY}")
        images.append(image)
        infos.append(about)
        found.append(radiometric_settings(about, given, planck))
        first = first or found[0]
        if (len(images) + 1) * image.size > PIXELS_PER_PIECE:
            frames = _make_frames(name, images, infos, found, first, every)
            yield replace(frames, share_read=min(1.0, block.end / len(data)))
            images, infos, found = [], [], []
    if images:
        assert first is not None  # set with the first image
        yield _make_frames(name, images, infos, found, first, every)


def _make_frames(name: str, images, infos: list[CameraInfo], found: list[tuple], first: tuple, every: int) -> RawFrames:
    T = np.empty((len(images), *images[0].shape))
    for temperature, image, setting in zip(T, images, found, strict=True):
        temperature[:] = _temperature_table(*setting)[image]
    clocks = [i.clock for i in infos]
    change = ["parameters change from frame to frame; each has its own"] if any(f != first for f in found) else []
    return RawFrames(
        format=name,
        temperature=T,
        clock=None if None in clocks else np.array(clocks),
        stated_parameters={k: infos[0].values[k] for k in PARAMETER_NAMES},
        parameters=found[0][1],
        counts=np.stack(images),
        planck=found[0][0],
        camera=infos[0].camera,
        fps=infos[0].fps / every if infos[0].fps else None,
        outside=int(np.isnan(T).sum()),
        notes=(*change, *_calibration_remarks(found[0][0], found[0][1])),
    )
