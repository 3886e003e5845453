"""What a reader of a camera format is given: the file, its first bytes, and what the user states about it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from flashtemp.camera.image_validation import BYTES_PER_PIXEL, check_memory
from flashtemp.camera.importing.formats.byte_reader import ByteReader
from flashtemp.camera.radiometry import PlanckCalibration

SIGNATURE_BYTES = 8192  # first bytes of a file, by which its format is recognised
MEMORY_PER_FILE_SIZE = 4  # bytes of memory per byte of a file that is read whole
COLOUR_IMAGE_REMEDY = (
    "; it holds colours or a film, not temperatures: give the radiometric file of the camera or its export as CSV"
)


@dataclass(frozen=True)
class ReaderOptions:
    """What a file may not say: `scale` and `offset` (degC) of counts, `unit`, `variable`, `decimal`, `below` (degC).

    `rows` of a text file that holds a part of an image, `labels` around it ("none", "columns", "rows", "both").
    `parameters` and `planck` replace those that a radiometric file states; `every`: keep one frame of so many;
    `limit`: GB of memory that one file may take.
    """

    scale: float | None = None
    offset: float | None = None
    unit: str | None = None
    variable: str | None = None
    decimal: str | None = None
    below: float | None = None
    rows: int | None = None
    labels: str | None = None
    parameters: dict[str, float] = field(default_factory=dict)
    planck: PlanckCalibration | None = None
    every: int = 1
    limit: float | None = None


@dataclass(frozen=True)
class CameraFile:
    """An open camera file: `path`, its bytes by slices (`source`), the first of them (`start`) and the `options`."""

    path: Path
    source: ByteReader
    start: bytes
    options: ReaderOptions

    def read_all(self, memory_per_byte: float = MEMORY_PER_FILE_SIZE) -> bytes:
        """All bytes.  BadInput where `memory_per_byte` times their number exceeds the memory limit."""
        size = len(self.source)
        check_memory(memory_per_byte * size / BYTES_PER_PIXEL, self.options.limit, f"{size / 1e6:.0f} MB read at once")
        return self.source[0:size]
