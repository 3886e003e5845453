"""16-bit grey PNG, whose scale only the user knows.

The checksums of its parts are verified before anything is unpacked, since the codec only warns of some.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator

from flashtemp.camera.image_validation import check_memory
from flashtemp.camera.importing.formats.camera_file import CameraFile
from flashtemp.camera.importing.formats.raw_frames import (
    MAX_FRAME_PIXELS,
    NO_COLOURS,
    RawFrames,
    frames_from_pixels,
    require_module,
)
from flashtemp.errors import BadInput

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
MAGIC = (PNG_SIGNATURE,)
EXPORT_REMEDY = "copy it again or export it anew and give that"


def read(file: CameraFile) -> Iterator[RawFrames]:
    """One 16-bit grey PNG, degC: T = scale count + offset; 8 bits or colours raise BadInput."""
    data, options = file.read_all(), file.options
    if len(data) < 33:
        raise BadInput(f"PNG cut off in its header; {EXPORT_REMEDY}")
    columns, rows, depth, colour = struct.unpack_from(">2I2B", data, 16)
    if (depth, colour) != (16, 0):
        raise BadInput(f"PNG of {depth} bits {NO_COLOURS}")
    if not 0 < rows * columns <= MAX_FRAME_PIXELS:
        raise BadInput(f"PNG of {columns} x {rows} pixels; {EXPORT_REMEDY}")
    check_memory(rows * columns, options.limit, f"PNG of {columns} x {rows} pixels")
    check_png(data)
    try:
        image = require_module("imagecodecs").png_decode(data)
    except BadInput:
        raise
    except Exception as fault:  # the codec raises its own kind
        raise BadInput(f"damaged PNG ({' '.join(str(fault).split())}); {EXPORT_REMEDY}") from fault
    frames = frames_from_pixels(image[None], "PNG", None, options.scale, options.offset)
    yield frames.take_every(options.every)


def check_png(data: bytes) -> None:
    """BadInput where a part of a PNG is cut off or its checksum does not fit."""
    at, kind = len(PNG_SIGNATURE), b""
    while kind != b"IEND":
        if at + 12 > len(data):
            raise BadInput(f"damaged PNG: cut off; {EXPORT_REMEDY}")
        length, kind = struct.unpack_from(">I4s", data, at)
        end = at + 12 + length
        if end > len(data) or zlib.crc32(data[at + 4 : end - 4]) != struct.unpack_from(">I", data, end - 4)[0]:
            raise BadInput(f"damaged PNG: cut off, or a checksum does not fit; {EXPORT_REMEDY}")
        at = end
