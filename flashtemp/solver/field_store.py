"""Whole fields at the kept moments of a run: in memory, or streamed to a file so that memory does not grow."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np


class FieldStore:
    """Rows of equal arrays {name: array}, appended one by one.

    With a `path` rows go to that file, one after the other, and are read back where they are asked for; those with
    the `checksums` (checksums) and the `dtype` told are there already (a run that goes on from a checkpoint).

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
        """Keep one more row.  Raises OSError where the disk is full; the rows before it stay whole."""
        if self.dtype is None:
            self.dtype = np.dtype([(name, a.dtype, a.shape) for name, a in row.items()])
        if self.path is None:
            self._rows.append(row)
            return
        seen = hashlib.blake2b(digest_size=16)
        with self.path.open("r+b" if self.path.exists() else "w+b") as file:
            file.seek(len(self) * self.dtype.itemsize)
            for array in row.values():
                data = np.ascontiguousarray(array).data
                file.write(data)
                seen.update(data)
            file.truncate()
        self.checksums.append(seen.digest())

    def sync_to_disk(self) -> None:
        """The rows of a file on disk, so that they outlast a power cut."""
        if self.path is not None and self.path.exists():
            with self.path.open("r+b") as file:
                os.fsync(file.fileno())

    def describe_damage(self) -> str:
        """What is wrong with the file, in words; nothing where all rows are as they were written."""
        if self.path is None or self.dtype is None or not self.checksums:
            return ""
        if not self.path.is_file():
            return f"{self.path} is gone"
        with self.path.open("rb") as file:
            for k, known in enumerate(self.checksums):
                if hashlib.blake2b(file.read(self.dtype.itemsize), digest_size=16).digest() != known:
                    return f"{self.path} is damaged in row {k + 1} of {len(self.checksums)}"
        return ""

    def read_row(self, k: int) -> dict[str, np.ndarray]:
        """One row."""
        return self._rows[k] if self.path is None else {name: a[k] for name, a in self.stack_rows().items()}

    def stack_rows(self) -> dict[str, np.ndarray]:
        """All rows, {name: (rows, ...)}: of a file only what is looked at comes into memory."""
        if self.dtype is None:
            return {}
        if self.path is None:
            return {name: np.array([row[name] for row in self._rows]) for name in self.dtype.names or ()}
        if os.name == "nt":  # which renames no folder while a file in it is mapped
            table = np.fromfile(self.path, self.dtype, len(self))
        else:
            table = np.memmap(self.path, self.dtype, "r", shape=(len(self),))
        return {name: table[name] for name in self.dtype.names or ()}
