"""16-bit TIFF and PNG, whose scale only the user knows, and TIFF of floating-point temperatures."""

from __future__ import annotations

import io
import logging
import struct

import numpy as np

from flashtemp.camera.raw_frames import MOST_PIXELS, Frames, celsius, linear, need, stacked
from flashtemp.errors import BadInput

MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
PNG = b"\x89PNG\r\n\x1a\n"
AGAIN = "copy it again or export it anew and give that"
NO_COLOURS = (
    "holds colours, not temperatures: nobody can turn them back; give the radiometric file of the camera"
    " or its export as 16-bit TIFF or CSV"
)


def read(data: bytes, unit=None, scale=None, offset=None) -> Frames:
    """All pages of a TIFF file, degC: T = scale count + offset, or floating-point temperatures in `unit`."""
    tifffile = need("tifffile")
    need("imagecodecs")  # tifffile calls it for compressed pages
    logger = logging.getLogger("tifffile")
    level = logger.level
    logger.setLevel(logging.CRITICAL + 1)  # damage is told once, by BadInput
    try:
        with tifffile.TiffFile(io.BytesIO(data)) as file:
            pages = [_page(page, len(data)) for page in file.pages]
    except BadInput:
        raise
    except Exception as fault:  # damage raises whatever it hits
        raise BadInput(f"damaged TIFF ({' '.join(str(fault).split())[:120]}); {AGAIN}") from fault
    finally:
        logger.setLevel(level)
    if len({(p.shape, p.dtype) for p in pages}) != 1:
        raise BadInput(f"pages of different sizes or kinds (or none at all) in one TIFF; {AGAIN}")
    return _frames(np.concatenate([stacked(p) for p in pages]), "TIFF", unit, scale, offset)


def _page(page, size: int) -> np.ndarray:
    pixels = int(np.prod(page.shape)) if page.shape else 0
    if not 0 < pixels <= MOST_PIXELS or pixels > 4000 * size:
        raise BadInput(f"a page of shape {tuple(page.shape)} in a file of {size} bytes: damaged; {AGAIN}")
    if len(page.shape) != 2 or page.dtype is None or page.dtype.itemsize < 2:
        raise BadInput(f"TIFF of shape {tuple(page.shape)} and {page.dtype} {NO_COLOURS}")
    if page.is_final and any(o + n > size for o, n in zip(page.dataoffsets, page.databytecounts, strict=False)):
        raise BadInput(f"cut off: the file has {size} bytes and its image more; {AGAIN}")
    return page.asarray()


def read_png(data: bytes, scale=None, offset=None) -> Frames:
    """One 16-bit grey PNG, degC: T = scale count + offset; 8 bits or colours raise BadInput."""
    if len(data) < 33:
        raise BadInput(f"PNG cut off in its header; {AGAIN}")
    columns, rows, depth, colour = struct.unpack_from(">2I2B", data, 16)
    if (depth, colour) != (16, 0):
        raise BadInput(f"PNG of {depth} bits {NO_COLOURS}")
    if not 0 < rows * columns <= MOST_PIXELS:
        raise BadInput(f"PNG of {columns} x {rows} pixels; {AGAIN}")
    try:
        image = need("imagecodecs").png_decode(data)
    except BadInput:
        raise
    except Exception as fault:  # the codec raises its own kind
        raise BadInput(f"damaged PNG ({' '.join(str(fault).split())}); {AGAIN}") from fault
    return _frames(image[None], "PNG", None, scale, offset)


def _frames(values: np.ndarray, kind: str, unit, scale, offset) -> Frames:
    bits = 8 * values.dtype.itemsize
    if values.dtype.kind in "ui":
        T, note = linear(values, scale, offset, f"{bits}-bit {kind}"), ""
    elif values.dtype.kind == "f":
        T, note = celsius(values, unit)
    else:
        raise BadInput(f"{kind} of {values.dtype}; give 16-bit counts or floating-point temperatures")
    T = np.where(np.isfinite(T), T, np.nan)
    return Frames(f"{bits}-bit {kind}", T, outside=int(np.isnan(T).sum()), notes=(note,) if note else ())
