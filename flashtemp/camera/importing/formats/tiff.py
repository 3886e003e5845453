"""TIFF: 16-bit counts, whose scale only the user knows, and floating-point temperatures."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from flashtemp.camera.image_validation import check_memory
from flashtemp.camera.importing.formats.camera_file import CameraFile
from flashtemp.camera.importing.formats.raw_frames import (
    MAX_FRAME_PIXELS,
    NO_COLOURS,
    RawFrames,
    frames_from_pixels,
    require_module,
)
from flashtemp.errors import BadInput, shorten_text

MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
PIXELS_PER_PIECE = 4_000_000  # pixels that are converted at a time
EXPORT_REMEDY = "copy it again or export it anew and give that"


def read(file: CameraFile) -> Iterator[RawFrames]:
    """Pages of a TIFF file, one of `every`, degC: T = scale count + offset, or floating-point values in `unit`."""
    options = file.options
    scaling = (options.unit, options.scale, options.offset)
    tifffile = require_module("tifffile")
    require_module("imagecodecs")  # tifffile calls it for compressed pages
    size, kind, kept = file.path.stat().st_size, None, []
    with _silence_logger("tifffile"):
        try:
            with tifffile.TiffFile(file.path) as pages_file:
                for number, page in enumerate(pages_file.pages):
                    image = _read_page(page, size, options.limit)
                    if kind is not None and (image.shape, image.dtype) != kind:
                        raise BadInput(f"pages of different sizes or kinds in one TIFF; {EXPORT_REMEDY}")
                    kind = image.shape, image.dtype
                    if number % options.every == 0:
                        kept.append(image)
                    if (len(kept) + 1) * image.size > PIXELS_PER_PIECE:
                        share = min(1.0, sum(page.dataoffsets[-1:]) / size)
                        yield replace(frames_from_pixels(np.stack(kept), "TIFF", *scaling), share_read=share)
                        kept = []
        except (BadInput, MemoryError):
            raise
        except Exception as fault:  # damage raises any kind of exception
            said = shorten_text(" ".join(str(fault).split()))
            raise BadInput(f"damaged TIFF ({said[:120]}); {EXPORT_REMEDY}") from fault
        if kind is None:
            raise BadInput(f"a TIFF without any page; {EXPORT_REMEDY}")
    if kept:
        yield frames_from_pixels(np.stack(kept), "TIFF", *scaling)


@contextmanager
def _silence_logger(name: str) -> Iterator[None]:
    """Silences a library that would log damage in addition to our BadInput."""
    logger = logging.getLogger(name)
    level = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        logger.setLevel(level)


def _read_page(page, size: int, limit: float | None) -> np.ndarray:
    pixels = int(np.prod(page.shape)) if page.shape else 0
    if not 0 < pixels <= MAX_FRAME_PIXELS or pixels > 4000 * size:
        raise BadInput(f"a page of shape {tuple(page.shape)} in a file of {size} bytes: damaged; {EXPORT_REMEDY}")
    if len(page.shape) != 2 or page.dtype is None or page.dtype.itemsize < 2:
        raise BadInput(f"TIFF of shape {tuple(page.shape)} and {page.dtype} {NO_COLOURS}")
    if page.is_final and any(o + n > size for o, n in zip(page.dataoffsets, page.databytecounts, strict=False)):
        raise BadInput(f"cut off: the file has {size} bytes and its image more; {EXPORT_REMEDY}")
    check_memory(pixels, limit, f"a page of shape {tuple(page.shape)}")
    tile = int(np.prod(page.chunks)) if page.chunks else 1
    check_memory(tile, limit, f"a strip of shape {tuple(page.chunks)}")
    image = page.asarray()
    if image.shape != tuple(page.shape):
        raise BadInput(f"a page of shape {image.shape} and {tuple(page.shape)}: damaged; {EXPORT_REMEDY}")
    return image
