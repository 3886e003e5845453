"""Random access to the bytes of a file, so that a sequence of gigabytes takes no memory."""

from __future__ import annotations

import os
import struct
from pathlib import Path
from typing import Any

SEARCH_WINDOW_BYTES = 1 << 20  # bytes searched at a time


class ByteReader:
    """Bytes of a file with the interface of `bytes`: len, [a:b], find.  A context manager that closes the file."""

    def __init__(self, path: Path):
        self._file = os.open(path, os.O_RDONLY | getattr(os, "O_BINARY", 0))
        self._size = os.fstat(self._file).st_size

    def __enter__(self) -> ByteReader:
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._file)

    def __len__(self) -> int:
        return self._size

    def __getitem__(self, part: slice) -> bytes:
        begin, end, _ = part.indices(self._size)
        os.lseek(self._file, begin, os.SEEK_SET)
        pieces = []
        while begin < end and (got := os.read(self._file, end - begin)):
            pieces.append(got)
            begin += len(got)
        return pieces[0] if len(pieces) == 1 else b"".join(pieces)

    def find(self, mark: bytes, begin: int = 0) -> int:
        """Offset of the first `mark` from `begin` on; -1 if there is none."""
        while begin < self._size:
            found = self[begin : begin + SEARCH_WINDOW_BYTES + len(mark) - 1].find(mark)
            if found >= 0:
                return begin + found
            begin += SEARCH_WINDOW_BYTES
        return -1


def unpack_at(data: bytes | ByteReader, form: str, at: int) -> tuple[Any, ...]:
    """Numbers of a struct format at an offset; struct.error if the data end before."""
    return struct.unpack(form, data[at : at + struct.calcsize(form)])
