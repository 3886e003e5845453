"""Pixel masks of an import: rectangles, a mask file, and dead pixels from the median test."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flashtemp.camera.importing import readers
from flashtemp.camera.importing.formats.raw_frames import RawFrames
from flashtemp.camera.importing.import_options import ImportOptions
from flashtemp.camera.importing.rectification import fill_gaps
from flashtemp.display import format_count
from flashtemp.errors import BadInput

DEAD_PIXEL_SDS = 7.0  # robust standard deviations beyond the neighbours
MIN_SCATTER_K = 0.02  # K: lower bound of the scatter of neighbours


class MissingValues:
    """Pixels without a value in a sequence of frames: dead in every frame, or beyond the camera's range in some."""

    def __init__(self) -> None:
        self._never_known = np.zeros((0, 0), bool)
        self._frames, self._missing, self._marked = 0, 0, 0

    def add(self, frames: RawFrames) -> None:
        """Count the values of more frames, of the same shape."""
        unknown = ~np.isfinite(frames.temperature)
        never = unknown.all(axis=0)
        self._never_known = self._never_known & never if self._frames else never
        self._frames += len(unknown)
        self._missing += int(unknown.sum())
        self._marked += frames.outside

    @property
    def dead(self) -> np.ndarray:
        """Pixels (rows, columns) without a value in any of several frames."""
        return self._never_known & (self._frames > 1)

    @property
    def outside(self) -> int:
        """Number of values beyond the camera's range, without those of dead pixels."""
        return min(self._marked, self._missing - self._frames * int(self.dead.sum()))


def find_masked_pixels(frames: RawFrames, facts: ImportOptions, T: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Mask (rows, columns) of dead and foreign pixels from rectangles, a file and the median test, and notes."""
    mask, notes = rectangle_mask(frames.shape, facts.mask_box or ()), []
    if facts.mask is not None:
        mask |= _read_mask(facts.mask, frames.shape)
    if mask.any():
        notes.append(f"{mask.sum()} pixels masked")
    if facts.dead_pixels != "keep" and frames.u is None and min(frames.shape) > 2:
        dead = find_dead_pixels(np.where(mask, np.nan, T)) if not mask.all() else mask & False
        if dead.any():
            notes.append(
                f"{format_count(int(dead.sum()), 'dead pixel')} found and masked (--dead-pixels keep leaves them)"
            )
        mask |= dead
    return mask, notes


def _read_mask(path: Path, shape: tuple[int, int]) -> np.ndarray:
    try:
        values = readers.read_frames(path, unit="degC", scale=1.0, offset=0.0, below=-274.0, rows=0).temperature[0]
    except BadInput as fault:
        raise BadInput(*(f"mask: {t}" for t in fault.lines)) from fault
    if values.shape != shape:
        raise BadInput(f"mask: {path}: shape {values.shape}, images have {shape}; give one number for every pixel")
    return np.nan_to_num(values, nan=1.0) != 0


def rectangle_mask(shape: tuple[int, int], rectangles) -> np.ndarray:
    """Mask (rows, columns) of rectangles (column, row, column, row), with both corners."""
    mask = np.zeros(shape, bool)
    for c0, r0, c1, r1 in rectangles:
        if not (0 <= c0 <= c1 < shape[1] and 0 <= r0 <= r1 < shape[0]):
            raise BadInput(
                f"mask-box: {(c0, r0, c1, r1)} in an image of {shape[1]} x {shape[0]} pixels;"
                " give column, row, column, row within it, the smaller first"
            )
        mask[int(r0) : int(r1) + 1, int(c0) : int(c1) + 1] = True
    return mask


def find_dead_pixels(T: np.ndarray) -> np.ndarray:
    """Mask (rows, columns) of pixels that differ from the median of their neighbours in most frames.

    Median test: outside the range of all neighbours but one, by more than `DEAD_PIXEL_SDS` robust standard deviations
    of these neighbours and of the whole image about its local medians.  Lines, edges, gradients and clusters of three
    pass.
    """
    picked = T[np.unique(np.linspace(0, len(T) - 1, 25).astype(int))]
    known = np.isfinite(picked).any(axis=0)
    if not known.any():
        return ~known
    image = np.full(T.shape[1:], np.nan)
    image[known] = np.nanmedian(picked[:, known], axis=0)
    image = fill_gaps(image)
    padded = np.pad(image, 1, mode="reflect")
    rows, columns = T.shape[1:]
    shifted = [padded[i : i + rows, j : j + columns] for i in range(3) for j in range(3) if (i, j) != (1, 1)]
    around = np.sort(np.stack(shifted), axis=0)
    off = image - 0.5 * (around[3] + around[4])
    scatter = 1.4826 * np.median(np.abs(off - np.median(off)))
    local = 1.4826 * np.median(np.abs(around - 0.5 * (around[3] + around[4])), axis=0)
    beyond = np.maximum(image - around[6], around[1] - image)
    return known & (beyond > DEAD_PIXEL_SDS * np.maximum(local, max(scatter, MIN_SCATTER_K)))
