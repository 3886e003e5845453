"""Storage of whole fields at recorded times: in memory, or streamed to a file so that memory does not grow."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np


class FieldStore:
    """Rows of equal arrays {name: array}, appended one by one.

    With a `path`, rows are written to that file and read back on demand.  A run resumed from a checkpoint states the
    `checksums` and the `dtype` of the rows that the file holds already.

    >>> frames = FieldStore()
    >>> frames.append({"T": np.zeros(3)}), frames.append({"T": np.ones(3)})
    (None, None)
    >>> len(frames), frames.stack_rows()["T"].shape
    (2, (2, 3))
    """

    def __init__(self, path: Path | None = None, dtype: np.dtype | None = None, checksums: Sequence[bytes] = ()):
        self.path, self.dtype, self.checksums = path, dtype, list(checksums)
        self._rows: list[dict[str, np.ndarray]] = []

    def __len__(self) -> int:
        return len(self._rows) if self.path is None else len(self.checksums)

    def append(self, row: dict[str, np.ndarray]) -> None:
        """Append a row.  Raises OSError if the disk is full; earlier rows stay intact."""
        if self.dtype is None:
            self.dtype = np.dtype([(name, a.dtype, a.shape) for name, a in row.items()])
        if self.path is None:
            self._rows.append(row)
            return
        checksum = hashlib.blake2b(digest_size=16)
        with self.path.open("r+b" if self.path.exists() else "w+b") as file:
            file.seek(len(self) * self.dtype.itemsize)
            for array in row.values():
                data = np.ascontiguousarray(array).data
                file.write(data)
                checksum.update(data)
            file.truncate()
        self.checksums.append(checksum.digest())

    def sync_to_disk(self) -> None:
        """Force the rows of a file to disk, so that they survive a power cut."""
        if self.path is not None and self.path.exists():
            with self.path.open("r+b") as file:
                os.fsync(file.fileno())

    def describe_damage(self) -> str:
        """A sentence about damage of the file, or "" if all rows are as written."""
        if self.path is None or self.dtype is None or not self.checksums:
            return ""
        if not self.path.is_file():
            return f"{self.path} is missing"
        with self.path.open("rb") as file:
            for k, expected in enumerate(self.checksums):
                if hashlib.blake2b(file.read(self.dtype.itemsize), digest_size=16).digest() != expected:
                    return f"{self.path} is damaged in row {k + 1} of {len(self.checksums)}"
        return ""

    def read_row(self, k: int) -> dict[str, np.ndarray]:
        """Row number k, {name: array}."""
        return self._rows[k] if self.path is None else {name: a[k] for name, a in self.stack_rows().items()}

    def stack_rows(self) -> dict[str, np.ndarray]:
        """All rows, {name: (rows, ...)}; a file is memory-mapped, so only the parts in use are read."""
        if self.dtype is None:
            return {}
        if self.path is None:
            return {name: np.array([row[name] for row in self._rows]) for name in self.dtype.names or ()}
        if os.name == "nt":  # Windows renames no folder while a file in it is mapped
            table = np.fromfile(self.path, self.dtype, len(self))
        else:
            table = np.memmap(self.path, self.dtype, "r", shape=(len(self),))
        return {name: table[name] for name in self.dtype.names or ()}
