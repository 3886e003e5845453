"""MATLAB's own files, v5 to v7: numeric arrays by name.

Own reader because damaged files must end in one line: the usual one takes the interpreter down with it.
Layout: MathWorks, "MAT-File Format", level 5.
"""

from __future__ import annotations

import math
import struct
import zlib

import numpy as np

from flashtemp.camera.plausible import LIMIT
from flashtemp.errors import BadInput

MATRIX, COMPRESSED = 14, 15
STORED = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
HEADER, COMPLEX = 128, 0x800
AGAIN = "copy it again or save it anew and give that"
WORK = 8  # times the bytes of an array that are in memory until it is temperatures
TOO_MUCH = "its arrays take more memory than the limit; save fewer of them, or raise --limit (GB)"


def read(data: bytes, limit: float | None = None) -> dict[str, np.ndarray]:
    """Real numeric arrays of the file by name, indices in MATLAB's order; others are passed over."""
    order = {b"IM": "<", b"MI": ">"}.get(data[126:128])
    if order is None:
        raise BadInput(f"MATLAB file with a damaged header; {AGAIN}")
    found: dict[str, np.ndarray] = {}
    at, room = HEADER, int(1e9 * (LIMIT if limit is None else limit) / WORK)
    while at + 8 <= len(data):
        kind, body, at = _element(data, at, order)
        if kind == COMPRESSED:
            body = _unpacked(body, room)
            kind, body, _ = _element(body, 0, order)
        if kind == MATRIX and (pair := _matrix(body, order, room)):
            found[pair[0]] = pair[1]
            room -= pair[1].nbytes
    return found


def _element(data: bytes, at: int, order: str) -> tuple[int, bytes, int]:
    """Type and bytes of the element at an offset, and where the next one begins."""
    if at + 8 > len(data):
        raise BadInput(f"MATLAB file cut off; {AGAIN}")
    kind, length = struct.unpack_from(order + "2I", data, at)
    if kind >> 16:  # up to four bytes inside the tag
        kind, length = kind & 0xFFFF, kind >> 16
        return kind, data[at + 4 : at + 4 + min(length, 4)], at + 8
    end = at + 8 + length
    if end > len(data):
        raise BadInput(f"MATLAB file cut off: {end} bytes are needed and {len(data)} there; {AGAIN}")
    return kind, data[at + 8 : end], end if kind == COMPRESSED else end + -length % 8


def _unpacked(body: bytes, room: int) -> bytes:
    unpacker = zlib.decompressobj()
    try:
        whole = unpacker.decompress(body, max(room, 1))
        if unpacker.unconsumed_tail:
            raise BadInput(TOO_MUCH)
        return whole
    except zlib.error as fault:
        raise BadInput(f"MATLAB file with damaged compressed data; {AGAIN}") from fault


def _matrix(body: bytes, order: str, room: int) -> tuple[str, np.ndarray] | None:
    """Name and values of an array; None where it holds no real numbers."""
    if not body:
        return None
    _, flags, at = _element(body, 0, order)
    _, sizes, at = _element(body, at, order)
    _, name, at = _element(body, at, order)
    (flag,) = struct.unpack_from(order + "I", flags)
    if flag & 0xFF not in CLASSES or flag & COMPLEX:
        return None
    stored, values, _ = _element(body, at, order)
    shape = np.frombuffer(sizes, order + "i4").tolist()
    if stored not in STORED or len(shape) < 2 or min(shape) < 0:
        raise BadInput(f"MATLAB array of an unknown kind or damaged; {AGAIN}")
    numbers = np.frombuffer(values, order + STORED[stored])
    if numbers.size != math.prod(shape):
        raise BadInput(f"MATLAB array of {numbers.size} numbers for shape {tuple(shape)}; {AGAIN}")
    if numbers.size * np.dtype(CLASSES[flag & 0xFF]).itemsize > room:
        raise BadInput(TOO_MUCH)
    return name.decode("latin-1"), numbers.astype(CLASSES[flag & 0xFF]).reshape(shape, order="F")
