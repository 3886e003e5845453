"""Array files: MATLAB (v5 to v7.3), HDF5 and NetCDF, and recordings of flashtemp."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.camera import recording
from flashtemp.camera.image_validation import check_memory
from flashtemp.camera.importing.formats import matlab
from flashtemp.camera.importing.formats.camera_file import CameraFile
from flashtemp.camera.importing.formats.raw_frames import (
    UNSTATED_SCALE,
    RawFrames,
    agree_on_unit,
    as_frame_stack,
    scale_counts,
    to_celsius,
)
from flashtemp.errors import BadInput, shorten_text

HDF5 = b"\x89HDF\r\n\x1a\n"
MATLAB = b"MATLAB"
NETCDF_CLASSIC = (b"CDF\x01", b"CDF\x02")
MAGIC = (HDF5, MATLAB, *NETCDF_CLASSIC)
TIME_NAMES = ("time", "t", "times", "time_s")
EXPORT_REMEDY = "copy it again or export it anew and give that"
PIXELS_PER_PIECE = 4_000_000  # pixels that are read at a time
NUMBERED_NAME = re.compile(r"(\D{1,200})(\d{1,9})")


@dataclass(frozen=True)
class StoredArray:
    """An array that need not be in memory: `shape` (rows, columns) or (frames, rows, columns), number type and unit.

    `read_part(a, b)` reads the frames from a to b.
    """

    shape: tuple[int, ...]
    kind: np.dtype
    unit: str | None
    read_part: Callable[[int, int], np.ndarray]

    @property
    def frames(self) -> int:
        return self.shape[0] if len(self.shape) == 3 else 1


def is_hdf5(start: bytes) -> bool:
    """Whether the first bytes are those of HDF5, also after the header block of MATLAB."""
    return start.startswith(HDF5) or start[512:520] == HDF5


def read(file: CameraFile) -> Iterator[RawFrames]:
    """The images of an array file, degC, a few at a time; where there are several, `variable` must name one."""
    options = file.options
    scaling, limit = (options.unit, options.scale, options.offset), options.limit
    if is_hdf5(file.start):
        yield from _read_hdf5(file.path, file.start, scaling, options.variable, options.every, limit)
        return
    data = file.read_all()
    if file.start.startswith(NETCDF_CLASSIC):
        arrays, kind = _read_or_refuse(lambda: _read_netcdf(data, limit), "NetCDF"), "NetCDF"
    else:
        arrays, kind = _read_or_refuse(lambda: _read_matlab(data, limit), "MATLAB"), "MATLAB"
    yield from _iter_frames(kind, arrays, *_select_array(arrays, options.variable), scaling, options.every, limit)


def _read_or_refuse(reader: Callable[[], Any], kind: str) -> Any:
    try:
        return reader()
    except (BadInput, MemoryError):
        raise
    except Exception as fault:  # damage raises any kind of exception
        raise BadInput(
            f"damaged {kind} file ({shorten_text(' '.join(str(fault).split()))[:120]}); {EXPORT_REMEDY}"
        ) from fault


def _read_hdf5(path: Path, start: bytes, scaling, variable, every: int, limit) -> Iterator[RawFrames]:
    import h5py

    matlab = start.startswith(MATLAB)
    file = _read_or_refuse(lambda: h5py.File(path), "HDF5")
    with file:
        if not matlab and _read_or_refuse(lambda: "view" in file.attrs and "temperature" in file, "HDF5"):
            yield _read_recording(path, limit).take_every(every)
            return
        arrays = _read_or_refuse(lambda: _numeric_datasets(file, matlab), "HDF5")
        yield from _iter_frames(
            "MATLAB v7.3" if matlab else "HDF5", arrays, *_select_array(arrays, variable), scaling, every, limit
        )


def _numeric_datasets(file, matlab: bool) -> dict[str, StoredArray]:
    """All numeric datasets; MATLAB stores the last index first, (frames, columns, rows)."""
    from flashtemp.physics import safe_hdf5

    def array(found) -> StoredArray:
        shape = found.shape if not matlab or len(found.shape) < 2 else (*found.shape[:-2], *found.shape[:-3:-1])

        def part(a: int, b: int) -> np.ndarray:
            values = np.asarray(found[a:b] if found.ndim == 3 else found[()])
            return values.swapaxes(-1, -2) if matlab and values.ndim > 1 else values

        unit = safe_hdf5.read_text_attribute(found, "units") or safe_hdf5.read_text_attribute(found, "unit")
        return StoredArray(tuple(shape), found.dtype, unit, part)

    numbers = {k: d for k, d in safe_hdf5.list_datasets(file).items() if d.dtype.kind in "fui" and d.ndim}
    for name, d in numbers.items():
        if not safe_hdf5.has_usual_type(d):
            raise BadInput(
                f"array '{shorten_text(name)}' of numbers of an unusual kind: damaged, or not for images;"
                f" {EXPORT_REMEDY}"
            )
        if d.chunks and d.id.get_storage_size() == 0 and d.size:
            raise BadInput(f"array '{shorten_text(name)}' of shape {d.shape} holds no data; {EXPORT_REMEDY}")
        check_memory(math.prod(d.chunks or (1,)), None, f"one chunk of array '{shorten_text(name)}'")
    return {k: array(d) for k, d in numbers.items()}


def _iter_frames(
    kind: str, arrays: dict[str, StoredArray], name: str, found: StoredArray, scaling, every: int, limit
) -> Iterator[RawFrames]:
    """Frames of an array, in pieces of at most `PIXELS_PER_PIECE` pixels."""
    unit, scale, offset = scaling
    rows, columns = found.shape[-2:]
    step = max(1, PIXELS_PER_PIECE // (rows * columns))
    check_memory(step * rows * columns, limit, f"{step} frames of array '{shorten_text(name)}' of shape {found.shape}")
    time = _frame_times(arrays, found.frames, limit)
    note = ""
    for begin in range(0, found.frames, step):
        chosen = np.arange(begin, min(begin + step, found.frames))
        chosen = chosen[chosen % every == 0]
        if not len(chosen):
            continue
        values = as_frame_stack(_read_or_refuse(partial(found.read_part, begin, begin + step), kind))[chosen - begin]
        if scale is not None or offset is not None or values.dtype.kind in "ui":
            T = scale_counts(values, scale, offset, f"{values.dtype} array '{shorten_text(name)}'")
        else:
            T, note = to_celsius(values, agree_on_unit(unit, found.unit, f"array '{shorten_text(name)}'"))
        T = np.where(np.isfinite(T), T, np.nan)
        notes = (f"array '{shorten_text(name)}'", *([note] if note else []))
        at = None if time is None else time[chosen]
        yield RawFrames(
            kind, T, time=at, outside=int(np.isnan(T).sum()), notes=notes, is_unscaled=scale is UNSTATED_SCALE,
            share_read=min(1.0, (begin + step) / found.frames),
        )  # fmt: skip


def _frame_times(arrays: dict[str, StoredArray], frames: int, limit) -> np.ndarray | None:
    """Times of the frames, if the file has an array of times with one number per frame."""
    for name in TIME_NAMES:
        if name in arrays and math.prod(arrays[name].shape) == frames:
            check_memory(frames, limit, f"array '{name}'")
            return np.asarray(arrays[name].read_part(0, frames), dtype=float).ravel()
    return None


def _read_recording(path: Path, limit) -> RawFrames:
    """A recording of flashtemp, with known place, time and repetition."""
    known = recording.load(path, limit)
    stated = {"emissivity": known.emissivity, "reflected": known.reflected_degC}
    return RawFrames(
        "recording",
        known.temperature,
        time=known.time,
        stated_parameters={k: v for k, v in stated.items() if v is not None},
        fps=known.fps,
        view=known.view,
        repetition=known.repetition,
        u=known.u,
        v=known.v,
        camera_attributes={k: v for k in recording.OPTIONAL_ATTRIBUTES if (v := getattr(known, k)) is not None},
    )


def _wrap_array(values: np.ndarray, unit: str | None = None) -> StoredArray:
    """StoredArray of values in memory."""
    return StoredArray(values.shape, values.dtype, unit, lambda a, b: values[a:b] if values.ndim == 3 else values)


def _read_netcdf(data: bytes, limit) -> dict[str, StoredArray]:
    from scipy.io import netcdf_file

    with netcdf_file(io.BytesIO(data), mmap=False) as file:
        found = {}
        for name, v in file.variables.items():
            check_memory(math.prod(v.shape), limit, f"array '{shorten_text(name)}' of shape {v.shape}")
            unit = getattr(v, "units", b"")
            found[name] = _wrap_array(
                _native_byte_order(v[:]), (unit.decode("latin-1") if isinstance(unit, bytes) else "") or None
            )
        return found


def _native_byte_order(values: np.ndarray) -> np.ndarray:
    return np.array(values, dtype=values.dtype.newbyteorder("="))


def _read_matlab(data: bytes, limit) -> dict[str, StoredArray]:
    """Arrays in MATLAB's order (rows, columns, frames), moved to (frames, rows, columns)."""
    found = matlab.read_arrays(data, limit)
    return {k: _wrap_array(np.moveaxis(v, -1, 0) if v.ndim == 3 else v) for k, v in found.items()}


def _stack_arrays(images: list[StoredArray]) -> StoredArray:
    """Single images as one array of frames."""

    def part(a: int, b: int) -> np.ndarray:
        return np.stack([image.read_part(0, 1) for image in images[a:b]])

    return StoredArray((len(images), *images[0].shape), images[0].kind, images[0].unit, part)


def _select_array(arrays: dict[str, StoredArray], variable: str | None) -> tuple[str, StoredArray]:
    """Name and array of the images; Frame0, Frame1, ... are one stack.  BadInput if `variable` must decide."""
    images = {k: a for k, a in arrays.items() if len(a.shape) in (2, 3) and min(a.shape[-2:]) > 1 and a.frames}
    numbered = {k: m for k in images if (m := NUMBERED_NAME.fullmatch(k))}
    order = sorted(numbered, key=lambda k: int(numbered[k][2]))
    stems = {m[1] for m in numbered.values()}
    alike = len({(images[k].shape, images[k].kind) for k in order}) == 1
    if len(order) > 1 and len(stems) == 1 and alike and not variable and len(images[order[0]].shape) == 2:
        together = _stack_arrays([images[k] for k in order])
        images = {k: a for k, a in images.items() if k not in numbered} | {stems.pop(): together}
    if variable is not None:
        if variable not in images:
            names = ", ".join(shorten_text(k) for k in list(images)[:16]) or "none at all"
            raise BadInput(f"variable: no images '{variable}' in it; known are {names}")
        return variable, images[variable]
    if len(images) > 1 and "temperature" in images:
        return "temperature", images["temperature"]
    if len(images) != 1:
        what = ", ".join(f"'{shorten_text(k)}' {a.shape}" for k, a in list(images.items())[:16])
        what = what or "no array of two or three dimensions"
        raise BadInput(f"holds {what}; give the one with the temperatures, --variable NAME")
    [(name, found)] = images.items()
    return name, found
