"""Buffer for the images of one import: in memory while they are few, in a temporary file if they are many."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import IO

import numpy as np

from flashtemp.camera.image_validation import iter_chunks

MAX_BUFFER_BYTES = 200 * 10**6  # bytes of images that stay in memory


class FrameBuffer:
    """Collects images (frames, nv, nu) in single precision; `folder` takes the temporary file."""

    def __init__(self, folder: Path | None = None):
        self._folder, self._bytes, self._frames = folder, 0, 0
        self._in_memory: list[np.ndarray] = []
        self._file: IO[bytes] | None = None
        self._shape: tuple[int, int] = (0, 0)

    def add(self, images: np.ndarray) -> None:
        """Append images."""
        images = np.ascontiguousarray(images, dtype=np.float32)
        self._in_memory.append(images)
        self._shape = images.shape[1:]
        self._frames += len(images)
        self._bytes += images.nbytes
        if self._bytes > MAX_BUFFER_BYTES:
            self._file = self._file or self._new_file()
            self._write_pieces(self._file, self._in_memory)
            self._in_memory, self._bytes = [], 0

    def close(self) -> None:
        """Drop all images, and the temporary file."""
        self._in_memory = []
        if self._file is not None:
            self._file.close()

    def _new_file(self) -> IO[bytes]:
        return tempfile.TemporaryFile(dir=self._folder)  # noqa: SIM115 (lives as long as the images)

    @staticmethod
    def _write_pieces(file: IO[bytes], pieces: list[np.ndarray]) -> None:
        for piece in pieces:
            file.write(piece.data)

    def ordered_images(self, order: np.ndarray) -> np.ndarray:
        """All images (frames, nv, nu) in the given order; a read-only memory map if they are many."""
        if self._file is None:
            return np.concatenate(self._in_memory)[order]
        self._write_pieces(self._file, self._in_memory)
        self._in_memory = []
        images = self._memory_map(self._file)
        if np.array_equal(order, np.arange(len(order))):
            return images
        sorted_file = self._new_file()
        for _, chosen in iter_chunks(order, max(1, 4_000_000 // images[0].size)):
            self._write_pieces(sorted_file, [np.ascontiguousarray(images[chosen])])
        return self._memory_map(sorted_file)

    def _memory_map(self, file: IO[bytes]) -> np.ndarray:
        file.flush()
        return np.memmap(file, dtype=np.float32, mode="r", shape=(self._frames, *self._shape))
