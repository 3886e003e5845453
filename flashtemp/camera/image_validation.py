"""Checks of infrared images: memory, temperature range, shape, saturated pixels."""

from __future__ import annotations

import math
import mmap
from collections.abc import Iterator

import numpy as np

from flashtemp.errors import BadInput
from flashtemp.physics.quantities import KELVIN

DEFAULT_MEMORY_GB = 1.0  # GB of memory that reading one file may take
PIXELS_PER_CHUNK = 4_000_000  # pixels that are processed at a time
BYTES_PER_PIXEL = 32  # bytes: a temperature in double precision, what it is computed from, and masks
MAX_CAMERA_DEGC = 3500.0  # degC: no infrared camera reaches it
MIN_SENSOR_COLUMNS = 8  # columns of the smallest sensor
MAX_ROWS_PER_COLUMN = 64  # rows per column: a table over time has more
MAX_SIDE_PX = 16384  # pixels
SENSOR_SIZES = {  # columns: rows of the sensors that have so many
    60: (60,), 80: (60, 80), 120: (90, 120), 140: (140,), 160: (120,), 180: (180,), 200: (150,), 206: (156,),
    240: (180, 240), 256: (192,), 320: (240, 256), 336: (256,), 382: (288,), 384: (288,), 464: (348,),
    640: (480, 512), 1024: (768,), 1280: (960, 1024), 2048: (1536,),
}  # fmt: skip
MIN_DISTINCT_VALUES = 50  # distinct values that an image needs for a test of saturation
COMPARED_VALUES = 30  # neighbouring values with which the lowest and the highest one are compared
MIN_PLATEAU_PX, PLATEAU_RATIO = 16, 10  # pixels of a plateau, and their ratio to those of any neighbouring value
MARK_RATIO = 3  # the same ratio for a maker's mark
RANGE_STEP_K, MARK_OFFSET_K = 10.0, 0.01  # K: ranges end at multiples of ten degC, marks lie this much beyond
MARK_GAP_RATIO = 5.0  # times the widest gap between neighbouring values
MARK_TOLERANCE_K = 1.5e-3  # K


def iter_chunks(images: np.ndarray, step: int | None = None) -> Iterator[tuple[int, np.ndarray]]:
    """Images (frames, ...) a few at a time with the index of the first; a mapped file is released after use."""
    step = step or max(1, PIXELS_PER_CHUNK // max(1, images[0].size))
    for begin in range(0, len(images), step):
        yield begin, images[begin : begin + step]
        mapped = getattr(images, "_mmap", None)
        if mapped is not None and hasattr(mapped, "madvise"):  # Windows has none
            mapped.madvise(mmap.MADV_DONTNEED)


def finite_range(T: np.ndarray) -> tuple[float, float, int]:
    """Lowest and highest finite value of images (frames, ...), and the number of finite ones."""
    low, high, count = math.inf, -math.inf, 0
    for _, images in iter_chunks(T):
        known = images[np.isfinite(images)]
        if known.size:
            low, high, count = min(low, float(known.min())), max(high, float(known.max())), count + known.size
    return low, high, count


def check_memory(pixels: float, limit: float | None, what: str) -> None:
    """BadInput where so many pixels would need more memory than `limit` (GB, by default 1)."""
    limit = DEFAULT_MEMORY_GB if limit is None else limit
    if (need := BYTES_PER_PIXEL * pixels / 1e9) > limit:
        raise BadInput(
            f"{what} would take {need:.2g} GB of memory, the limit is {limit:g} GB; give a part of it (--every), or"
            f" --limit {math.ceil(need)} if that memory is there"
        )


def check_camera_range(T: np.ndarray) -> None:
    """BadInput where values (degC, NaN allowed) lie outside the range of infrared cameras."""
    low, high = float(np.nanmin(T)), float(np.nanmax(T))
    if low < -KELVIN or high > MAX_CAMERA_DEGC:
        raise BadInput(
            f"values from {low:.6g} to {high:.6g} degC are no temperatures of a camera ({-KELVIN:g} to"
            f" {MAX_CAMERA_DEGC:g}): a table of other quantities, another unit (--unit) or a damaged file; give the"
            " camera's own file"
        )


def check_matrix(
    values: np.ndarray, stated: tuple[int | None, int | None], rows_said: int | None, labels_said: bool = False
) -> None:
    """BadInput where a text matrix (rows, columns) is no complete image.

    `stated`: rows and columns of its header, None where unknown; `rows_said`: rows that the user states for a part of
    an image, 0 for any; `labels_said`: the user states which lines are labels.
    """
    rows, columns = values.shape
    if columns < MIN_SENSOR_COLUMNS or rows > MAX_ROWS_PER_COLUMN * columns or max(rows, columns) > MAX_SIDE_PX:
        raise BadInput(
            f"{rows} rows of {columns} numbers: a table, no image; give a text file with one row of the image per line,"
            " or --view points with a logger's table"
        )
    steps = np.diff(values[:, :2], axis=0)
    if (
        not labels_said
        and rows >= MIN_SENSOR_COLUMNS
        and steps[0, 0] != 0
        and np.ptp(steps[:, 0]) <= 1e-6 * abs(steps[0, 0]) < np.ptp(steps[:, 1])
    ):
        raise BadInput("its first column counts evenly, as times or row numbers do; remove it if the rest is an image")
    wanted = tuple(s if s is not None else n for s, n in zip(stated, (rows, columns), strict=True))
    if wanted != (rows, columns):
        raise BadInput(
            f"{rows} rows of {columns} values, its header says {wanted[0]} of {wanted[1]}; the file is cut off or"
            " damaged: copy it again or export it anew and give that"
        )
    if rows_said and rows_said != rows:
        raise BadInput(f"rows: {rows_said} stated, {rows} in the file; copy it again or correct that number")
    if rows == 1 and rows_said is None:
        raise BadInput(
            f"one row of {columns} values: the file is cut off; copy it again, or give --rows 1 if it is a line"
        )
    whole = SENSOR_SIZES.get(columns, ())
    if rows_said is None and stated[0] is None and 1 < rows < max(whole, default=0) and rows not in whole:
        raise BadInput(
            f"{rows} rows of {columns} values, a camera with {columns} columns has {' or '.join(map(str, whole))}:"
            f" the file is cut off or a part of an image; copy it again, or give --rows {rows} if it is a part"
        )


def saturated_pixels(T: np.ndarray) -> np.ndarray:
    """Mask of saturated pixels: a plateau at the lowest or the highest value of an image.

    In an image with noise far fewer pixels share one value than are clipped.  Fewer pixels are recognised where they
    lie at a maker's mark, 0.01 K beyond a multiple of ten degC, with a gap to all others.
    """
    known = np.isfinite(T)
    values, counts = np.unique(T[known], return_counts=True)
    mask = np.zeros(T.shape, dtype=bool)
    if len(values) < MIN_DISTINCT_VALUES:
        return mask
    for end, sign in ((slice(None), -1), (slice(None, None, -1), 1)):
        here, count = values[end][: COMPARED_VALUES + 1], counts[end][: COMPARED_VALUES + 1]
        most, gaps = count[1:].max(), np.abs(np.diff(here))
        from_mark = abs((here[0] - sign * MARK_OFFSET_K) / RANGE_STEP_K - round(here[0] / RANGE_STEP_K)) * RANGE_STEP_K
        marked = from_mark < MARK_TOLERANCE_K and (
            count[0] >= MARK_RATIO * most or gaps[0] > MARK_GAP_RATIO * gaps[1:].max()
        )
        if marked or (count[0] >= MIN_PLATEAU_PX and count[0] >= PLATEAU_RATIO * most):
            mask |= known & (here[0] == T)
    return mask
