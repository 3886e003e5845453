"""Whole fields at the kept moments of a run: in memory, or streamed to a file so that memory does not grow."""

from __future__ import annotations

from pathlib import Path

import numpy as np


class Frames:
    """Rows of equal arrays {name: array}, appended one by one.

    With a `path` rows go to that file, one after the other, and are read back where they are asked for; `count`
    of those that a file holds already are kept (a run that goes on from a checkpoint).

    >>> frames = Frames()
    >>> frames.append({"T": np.zeros(3)}), frames.append({"T": np.ones(3)})
    (None, None)
    >>> len(frames), frames.stacked()["T"].shape
    (2, (2, 3))
    """

    def __init__(self, path: Path | None = None, count: int = 0):
        self.path, self.count = path, count
        self.dtype: np.dtype | None = None
        self._rows: list[dict[str, np.ndarray]] = []

    def __len__(self) -> int:
        return self.count

    def append(self, row: dict[str, np.ndarray]) -> None:
        """Keep one more row.  Raises OSError where the disk is full; the rows before it stay whole."""
        if self.dtype is None:
            self.dtype = np.dtype([(name, a.dtype, a.shape) for name, a in row.items()])
        if self.path is None:
            self._rows.append(row)
        else:
            with self.path.open("r+b" if self.path.exists() else "w+b") as file:
                file.seek(self.count * self.dtype.itemsize)
                for array in row.values():
                    file.write(np.ascontiguousarray(array).data)
                file.truncate()
        self.count += 1

    def row(self, k: int) -> dict[str, np.ndarray]:
        """One row."""
        return self._rows[k] if self.path is None else {name: a[k] for name, a in self.stacked().items()}

    def stacked(self) -> dict[str, np.ndarray]:
        """All rows, {name: (rows, ...)}: of a file only what is looked at comes into memory."""
        if self.dtype is None:
            return {}
        if self.path is None:
            return {name: np.array([row[name] for row in self._rows]) for name in self.dtype.names or ()}
        table = np.memmap(self.path, self.dtype, "r", shape=(self.count,))
        return {name: table[name] for name in self.dtype.names or ()}
