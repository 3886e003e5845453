"""Pixel masks of an import: rectangles, a mask file, and dead pixels from the median test."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flashtemp.camera.importing import readers, rectification
from flashtemp.camera.importing.formats.raw_frames import RawFrames
from flashtemp.camera.importing.import_options import ImportOptions
from flashtemp.display import format_count
from flashtemp.errors import BadInput


def find_masked_pixels(frames: RawFrames, facts: ImportOptions, T: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Mask (rows, columns) of dead and foreign pixels from rectangles, a file and the median test, and notes."""
    mask, notes = rectification.rectangle_mask(frames.shape, facts.mask_box or ()), []
    if facts.mask is not None:
        mask |= _read_mask(facts.mask, frames.shape)
    if mask.any():
        notes.append(f"{mask.sum()} pixels masked")
    if facts.dead_pixels != "keep" and frames.u is None and min(frames.shape) > 2:
        dead = rectification.find_dead_pixels(np.where(mask, np.nan, T)) if not mask.all() else mask & False
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
