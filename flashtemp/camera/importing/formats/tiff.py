"""16-bit TIFF and PNG, whose scale only the user knows, and TIFF of floating-point temperatures."""

from __future__ import annotations

import logging
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from flashtemp.camera.image_validation import check_memory
from flashtemp.camera.importing.formats import png
from flashtemp.camera.importing.formats.raw_frames import (
    MAX_FRAME_PIXELS,
    UNSCALED,
    RawFrames,
    require_module,
    scale_counts,
    to_celsius,
)
from flashtemp.errors import BadInput, shorten_text

MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
PNG = png.PNG_SIGNATURE
PIXELS_PER_PIECE = 4_000_000  # pixels that are turned into temperatures at a time
EXPORT_REMEDY = "copy it again or export it anew and give that"
NO_COLOURS = (
    "holds colours, not temperatures: nobody can turn them back; give the radiometric file of the camera"
    " or its export as 16-bit TIFF or CSV"
)


def read(
    path: Path, unit=None, scale=None, offset=None, every: int = 1, limit: float | None = None
) -> Iterator[RawFrames]:
    """Pages of a TIFF file, one of `every`, degC: T = scale count + offset, or floating-point values in `unit`."""
    tifffile = require_module("tifffile")
    require_module("imagecodecs")  # tifffile calls it for compressed pages
    size, kind, held = path.stat().st_size, None, []
    with _silence_logger("tifffile"):
        try:
            with tifffile.TiffFile(path) as file:
                for number, page in enumerate(file.pages):
                    image = _read_page(page, size, limit)
                    if kind is not None and (image.shape, image.dtype) != kind:
                        raise BadInput(f"pages of different sizes or kinds in one TIFF; {EXPORT_REMEDY}")
                    kind = image.shape, image.dtype
                    if number % every == 0:
                        held.append(image)
                    if (len(held) + 1) * image.size > PIXELS_PER_PIECE:
                        yield _make_frames(np.stack(held), "TIFF", unit, scale, offset)
                        held = []
        except (BadInput, MemoryError):
            raise
        except Exception as fault:  # damage raises whatever it hits
            said = shorten_text(" ".join(str(fault).split()))
            raise BadInput(f"damaged TIFF ({said[:120]}); {EXPORT_REMEDY}") from fault
        if kind is None:
            raise BadInput(f"a TIFF without any page; {EXPORT_REMEDY}")
    if held:
        yield _make_frames(np.stack(held), "TIFF", unit, scale, offset)


@contextmanager
def _silence_logger(name: str) -> Iterator[None]:
    """What a library logs of damage is told once, by BadInput."""
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


def read_png(data: bytes, scale=None, offset=None, limit: float | None = None) -> RawFrames:
    """One 16-bit grey PNG, degC: T = scale count + offset; 8 bits or colours raise BadInput."""
    if len(data) < 33:
        raise BadInput(f"PNG cut off in its header; {EXPORT_REMEDY}")
    columns, rows, depth, colour = struct.unpack_from(">2I2B", data, 16)
    if (depth, colour) != (16, 0):
        raise BadInput(f"PNG of {depth} bits {NO_COLOURS}")
    if not 0 < rows * columns <= MAX_FRAME_PIXELS:
        raise BadInput(f"PNG of {columns} x {rows} pixels; {EXPORT_REMEDY}")
    check_memory(rows * columns, limit, f"PNG of {columns} x {rows} pixels")
    png.check_png(data)
    try:
        image = require_module("imagecodecs").png_decode(data)
    except BadInput:
        raise
    except Exception as fault:  # the codec raises its own kind
        raise BadInput(f"damaged PNG ({' '.join(str(fault).split())}); {EXPORT_REMEDY}") from fault
    return _make_frames(image[None], "PNG", None, scale, offset)


def saturated_counts(values: np.ndarray) -> np.ndarray:
    """Mask of the counts at the ends of their type, 0 and 65535, beyond which a camera cannot count."""
    ends = np.iinfo(values.dtype)
    return (values == ends.min) | (values == ends.max)


def _make_frames(values: np.ndarray, kind: str, unit, scale, offset) -> RawFrames:
    bits = 8 * values.dtype.itemsize
    if values.dtype.kind in "ui":
        T, note = scale_counts(values, scale, offset, f"{bits}-bit {kind}"), ""
        T[saturated_counts(values)] = np.nan
    elif values.dtype.kind == "f":
        T, note = to_celsius(values, unit)
    else:
        raise BadInput(f"{kind} of {values.dtype}; give 16-bit counts or floating-point temperatures")
    T = np.where(np.isfinite(T), T, np.nan)
    outside, counted = int(np.isnan(T).sum()), scale is UNSCALED
    return RawFrames(f"{bits}-bit {kind}", T, outside=outside, notes=(note,) if note else (), is_unscaled=counted)
