"""JPEG: the radiometric images of FLIR; for those of other makers, what to export instead."""

from __future__ import annotations

import struct
from collections.abc import Iterator

from flashtemp.camera.importing.formats import flir
from flashtemp.camera.importing.formats.camera_file import COLOUR_IMAGE_REMEDY, CameraFile
from flashtemp.camera.importing.formats.raw_frames import RawFrames
from flashtemp.errors import BadInput

MAGIC = (b"\xff\xd8",)
MAKER_REMEDIES = {  # letters in the header: the maker's format, and what to export instead
    b"DJI": (
        "DJI R-JPEG: its temperatures are in a form that only DJI's Thermal SDK reads; convert it there (dji_irp -a"
        " measure) or in DJI Thermal Analysis Tool to TIFF and give that"
    ),
    b"HIKMICRO": "HIKMICRO JPEG: export the temperatures as CSV from HIKMICRO Analyzer and give that",
    b"Testo": "Testo JPEG: export the temperatures as CSV or XLSX from IRSoft and give the CSV",
    b"Fluke": "Fluke JPEG: export the temperatures as CSV from SmartView and give that",
    b"InfraTec": "InfraTec JPEG: export it from IRBIS as ASCII and give that",
    b"Optris": "Optris JPEG: export the temperatures as CSV from PIX Connect and give that",
}
COMMON_SEGMENTS = (b"JFIF", b"JFXX", b"Exif", b"http://ns.adobe.com/", b"ICC_PROFILE", b"Photoshop", b"Adobe", b"MPF")
MIN_MAKER_BYTES = 10_000  # of a maker's own data: temperatures of the smallest sensors take more


def read(file: CameraFile) -> Iterator[RawFrames]:
    """The image of a radiometric JPEG of FLIR, degC; a JPEG without FLIR's thermal data raises BadInput."""
    data = file.read_all()
    block = flir.join_jpeg_pieces(data)
    if not block:
        what = describe_foreign_jpeg(data)
        raise BadInput(what if "give" in what else what + COLOUR_IMAGE_REMEDY)
    options = file.options
    yield from flir.read_fff(block, "FLIR radiometric JPEG", options.parameters, options.planck, limit=options.limit)


def describe_foreign_jpeg(data: bytes) -> str:
    """Message for a JPEG without FLIR's thermal data: its maker, and what to export instead."""
    segments = list(_iter_segments(data))
    own = sum(len(body) for kind, body in segments if 0xE0 <= kind <= 0xEF and not body.startswith(COMMON_SEGMENTS))
    if own < MIN_MAKER_BYTES:
        return "JPEG without thermal data"
    head = b"".join(body[:4096] for _, body in segments)
    for letters, words in MAKER_REMEDIES.items():
        if letters in head or letters.lower() in head:
            return words
    return (
        f"JPEG with {own / 1e3:.0f} kB of its maker's own data, in a form that cannot be read here; export TIFF or CSV"
        " with the maker's program and give that"
    )


def _iter_segments(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Kind and content of every segment before the image itself."""
    at = 2
    while at + 4 <= len(data) and data[at] == 0xFF and data[at + 1] not in (0xDA, 0xD9):
        (length,) = struct.unpack_from(">H", data, at + 2)
        yield data[at + 1], data[at + 4 : at + 2 + length]
        at += 2 + max(length, 2)
