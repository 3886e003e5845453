"""InfraTec's IRB: a directory of 32-byte blocks, each image with its own palette of kelvins.

A pixel is two bytes, a fraction and an index i: T = palette[i] + fraction/256 (palette[i + 1] - palette[i]), K.
Layout: byte map and sample image of the project `irb` (J. Schilling).
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator

import numpy as np

from flashtemp.camera.image_validation import check_memory
from flashtemp.camera.importing.formats.camera_file import CameraFile
from flashtemp.camera.importing.formats.raw_frames import MAX_FRAME_PIXELS, RawFrames
from flashtemp.errors import BadInput
from flashtemp.physics.quantities import KELVIN

MAGIC = (b"\xffIRB\0",)
IRB_HEADER_BYTES, IRB_ENTRY_BYTES, IMAGE_BLOCK = 64, 32, 1
PALETTE_OFFSET, CLOCK_OFFSET, PIXELS_OFFSET = 60, 1624, 1728  # offsets inside an image block
MAX_PALETTE_UNEVENNESS = 0.2  # relative change between steps of a palette, ten times that of a valid one
SECONDS_PER_DAY, UNIX_EPOCH_DAYS = 86400.0, 25569.0  # s; days from 1899-12-30 to 1970
DAMAGED_FILE_REMEDY = "copy it again or export it anew; what is there cannot be used"
ASCII_EXPORT_REMEDY = "export it from IRBIS as ASCII (File, Export) and give that"


def read(file: CameraFile) -> Iterator[RawFrames]:
    """All images of an IRB file, degC, one of `every`."""
    yield read_irb(file.read_all(), file.options.limit).take_every(file.options.every)


def read_irb(data: bytes, limit: float | None = None) -> RawFrames:
    """All images of an IRB file, degC; compressed images and video (another layout) raise BadInput."""
    images, clocks = [], []
    places = list(_iter_image_blocks(data))
    check_memory(sum(length - PIXELS_OFFSET for _, length in places) // 2, limit, f"{len(places)} images at once")
    said: dict[str, float] = {}
    for at, length in places:
        image = data[at : at + length]
        images.append(_decode_temperatures(image))
        clocks.append(_camera_clock(image))
        said = said or _stated_parameters(image)
        if images[-1].shape != images[0].shape:
            raise BadInput(
                f"images of {images[0].shape} and {images[-1].shape} pixels in one file; {ASCII_EXPORT_REMEDY}"
            )
    if not images:
        raise BadInput(f"no image in it (a video or an empty file); {ASCII_EXPORT_REMEDY}")
    return RawFrames(
        format="InfraTec IRB",
        temperature=np.stack(images),
        clock=None if None in clocks else np.array(clocks),
        stated_parameters=said,
        camera=_camera_name(data, images_at=places[0][0]),
    )


def _iter_image_blocks(data: bytes):
    """Offset and length of every image block."""
    if len(data) < IRB_HEADER_BYTES:
        raise BadInput(f"cut off in its header; {DAMAGED_FILE_REMEDY}")
    start, entries = struct.unpack_from("<2I", data, 25)
    if not 0 < entries <= 100_000 or start + IRB_ENTRY_BYTES * entries > len(data):
        raise BadInput(f"the directory of its blocks is cut off or damaged; {DAMAGED_FILE_REMEDY}")
    seen: set[int] = set()
    for k in range(entries):
        kind, _, _, at, length = struct.unpack_from("<5I", data, start + IRB_ENTRY_BYTES * k)
        if kind == IMAGE_BLOCK:
            if at + length > len(data):
                raise BadInput(
                    f"cut off: an image needs {at + length} bytes and the file has {len(data)}; {DAMAGED_FILE_REMEDY}"
                )
            if at < start + IRB_ENTRY_BYTES * entries or at in seen:
                raise BadInput(f"two blocks of it lie at one place; {DAMAGED_FILE_REMEDY}")
            seen.add(at)
            if length < PIXELS_OFFSET:
                raise BadInput(f"an image block of {length} bytes is none of a single image; {ASCII_EXPORT_REMEDY}")
            yield at, length


def _decode_temperatures(image: bytes) -> np.ndarray:
    depth, compressed, columns, rows = struct.unpack_from("<4H", image)
    last_column, last_row = struct.unpack_from("<H2xH", image, 14)
    if (last_column, last_row) not in ((0, 0), (columns - 1, rows - 1)):
        raise BadInput(
            f"an image of {columns} x {rows} pixels that ends at {last_column}, {last_row}; {DAMAGED_FILE_REMEDY}"
        )
    if compressed or depth != 2:
        kind = "compressed" if compressed else f"{depth} bytes per pixel"
        raise BadInput(f"its images are of a kind that cannot be read here ({kind}); {ASCII_EXPORT_REMEDY}")
    if not 0 < rows * columns <= MAX_FRAME_PIXELS or len(image) < PIXELS_OFFSET + 2 * rows * columns:
        raise BadInput(f"{len(image) - PIXELS_OFFSET} bytes for {columns} x {rows} pixels; {DAMAGED_FILE_REMEDY}")
    with np.errstate(invalid="ignore"):  # damage may spell a signalling NaN
        palette = np.frombuffer(image, "<f4", 256, PALETTE_OFFSET).astype(float)
    if not (np.all(np.isfinite(palette)) and palette.min() >= 0 and 0 < palette.max() < 5000):
        raise BadInput(f"the palette of its temperatures is damaged; {DAMAGED_FILE_REMEDY}")
    pixels = np.frombuffer(image, np.uint8, 2 * rows * columns, PIXELS_OFFSET).reshape(rows, columns, 2)
    fraction, index = pixels[..., 0] / 256.0, pixels[..., 1]
    steps = np.diff(palette, append=palette[-1])
    used = steps[index.min() : max(int(index.max()), 1)]
    if np.any(used <= 0) or np.any(np.abs(np.diff(used)) > MAX_PALETTE_UNEVENNESS * np.median(used)):
        raise BadInput(f"the palette of its temperatures does not rise evenly: it is damaged; {DAMAGED_FILE_REMEDY}")
    return palette[index] + fraction * steps[index] - KELVIN


def _camera_clock(image: bytes) -> float | None:
    """Seconds since 1970 of the camera's clock, stored as days since 1899-12-30 and thousandths of a second."""
    days, thousandths = struct.unpack_from("<dI", image, CLOCK_OFFSET)
    if not (
        math.isfinite(days) and UNIX_EPOCH_DAYS < days < 2 * UNIX_EPOCH_DAYS + SECONDS_PER_DAY and thousandths < 1000
    ):
        return None
    return round((days - UNIX_EPOCH_DAYS) * SECONDS_PER_DAY) + thousandths / 1000


def _stated_parameters(image: bytes) -> dict[str, float]:
    emissivity, distance, surroundings = struct.unpack_from("<3f", image, 24)
    said = {"emissivity": emissivity, "distance": distance, "reflected": surroundings - KELVIN}
    known = 0 < emissivity <= 1 and 0 <= distance < 1e4 and 0 < surroundings < 3000
    return {k: float(f"{v:.6g}") for k, v in said.items()} if known else {}


def _camera_name(data: bytes, images_at: int) -> str:
    """Name of the camera from the headers of file and image."""
    device = data[5:13].split(b"\0")[0].decode("ascii", "replace")
    optics = data[images_at + 1286 : images_at + 1318].split(b"\0")[0].decode("ascii", "replace")
    return f"{device}, {optics}" if optics.isprintable() and optics else device
