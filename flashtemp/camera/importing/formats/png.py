"""PNG: the checksums of its parts, before anything is unpacked; the codec only warns of some."""

from __future__ import annotations

import struct
import zlib

from flashtemp.errors import BadInput

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
EXPORT_REMEDY = "copy it again or export it anew and give that"


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
