"""MATLAB's own files, v5 to v7: numeric arrays by name.

A reader of our own, because a damaged file must end in one line, while it can crash the interpreter in the usual one.
Layout: MathWorks, "MAT-File Format", level 5.
"""

from __future__ import annotations

import math
import struct
import zlib

import numpy as np

from flashtemp.camera.image_validation import DEFAULT_MEMORY_GB
from flashtemp.errors import BadInput

MATRIX, COMPRESSED = 14, 15
STORED_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
ARRAY_CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
MAT_HEADER_BYTES, COMPLEX_FLAG = 128, 0x800
MAT_FILE_REMEDY = "copy it again or save it anew and give that"
MEMORY_PER_ARRAY_BYTE = 8  # bytes of memory per byte of an array, until it has become temperatures
MEMORY_REMEDY = "its arrays take more memory than the limit; save fewer of them, or raise --limit (GB)"


def read_arrays(data: bytes, limit: float | None = None) -> dict[str, np.ndarray]:
    """Real numeric arrays of the file by name, indices in MATLAB's order; others are skipped.  Raises BadInput."""
    order = {b"IM": "<", b"MI": ">"}.get(data[126:128])
    if order is None:
        raise BadInput(f"MATLAB file with a damaged header; {MAT_FILE_REMEDY}")
    found: dict[str, np.ndarray] = {}
    at, room = MAT_HEADER_BYTES, int(1e9 * (DEFAULT_MEMORY_GB if limit is None else limit) / MEMORY_PER_ARRAY_BYTE)
    while at + 8 <= len(data):
        kind, body, at = _read_element(data, at, order)
        if kind == COMPRESSED:
            body = _decompress_element(body, room)
            kind, body, _ = _read_element(body, 0, order)
        if kind == MATRIX and (pair := _read_matrix(body, order, room)):
            found[pair[0]] = pair[1]
            room -= pair[1].nbytes
    return found


def _read_element(data: bytes, at: int, order: str) -> tuple[int, bytes, int]:
    """Type and bytes of the element at an offset, and the offset of the next one."""
    if at + 8 > len(data):
        raise BadInput(f"MATLAB file cut off; {MAT_FILE_REMEDY}")
    kind, length = struct.unpack_from(order + "2I", data, at)
    if kind >> 16:  # up to four bytes inside the tag
        kind, length = kind & 0xFFFF, kind >> 16
        return kind, data[at + 4 : at + 4 + min(length, 4)], at + 8
    end = at + 8 + length
    if end > len(data):
        raise BadInput(f"MATLAB file cut off: {end} bytes are needed and {len(data)} there; {MAT_FILE_REMEDY}")
    return kind, data[at + 8 : end], end if kind == COMPRESSED else end + -length % 8


def _decompress_element(body: bytes, room: int) -> bytes:
    unpacker = zlib.decompressobj()
    try:
        whole = unpacker.decompress(body, max(room, 1))
        if unpacker.unconsumed_tail:
            raise BadInput(MEMORY_REMEDY)
        return whole
    except zlib.error as fault:
        raise BadInput(f"MATLAB file with damaged compressed data; {MAT_FILE_REMEDY}") from fault


def _read_matrix(body: bytes, order: str, room: int) -> tuple[str, np.ndarray] | None:
    """Name and values of an array; None if it holds no real numbers."""
    if not body:
        return None
    _, flags, at = _read_element(body, 0, order)
    _, sizes, at = _read_element(body, at, order)
    _, name, at = _read_element(body, at, order)
    (flag,) = struct.unpack_from(order + "I", flags)
    if flag & 0xFF not in ARRAY_CLASSES or flag & COMPLEX_FLAG:
        return None
    stored, values, _ = _read_element(body, at, order)
    shape = np.frombuffer(sizes, order + "i4").tolist()
    if stored not in STORED_TYPES or len(shape) < 2 or min(shape) < 0:
        raise BadInput(f"MATLAB array of an unknown kind or damaged; {MAT_FILE_REMEDY}")
    numbers = np.frombuffer(values, order + STORED_TYPES[stored])
    if numbers.size != math.prod(shape):
        raise BadInput(f"MATLAB array of {numbers.size} numbers for shape {tuple(shape)}; {MAT_FILE_REMEDY}")
    if numbers.size * np.dtype(ARRAY_CLASSES[flag & 0xFF]).itemsize > room:
        raise BadInput(MEMORY_REMEDY)
    return name.decode("latin-1"), numbers.astype(ARRAY_CLASSES[flag & 0xFF]).reshape(shape, order="F")
