"""Arrays of laboratories: MATLAB (v5 to v7.3), HDF5 and NetCDF, and recordings of our own."""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np

from flashtemp.camera import recording
from flashtemp.camera.formats import matlab
from flashtemp.camera.raw_frames import MOST_PIXELS, Frames, celsius, linear, stacked
from flashtemp.errors import BadInput

HDF5 = b"\x89HDF\r\n\x1a\n"
MATLAB = b"MATLAB"
CLASSIC = (b"CDF\x01", b"CDF\x02")
TIMES = ("time", "t", "times", "time_s")
AGAIN = "copy it again or export it anew and give that"


def read(path: Path, data: bytes, unit=None, scale=None, offset=None, variable=None) -> Frames:
    """The images of an array file, degC; which array, `variable`, is asked for where there are several."""
    if data.startswith(HDF5) or data[512:520] == HDF5:
        if data.startswith(HDF5) and _is_recording(data):
            return _recording(path)
        matlab = data.startswith(MATLAB)
        arrays, kind = _damaged(_hdf5, data, "HDF5"), "MATLAB v7.3" if matlab else "HDF5"
        # MATLAB stores the last index first: (rows, columns, frames) stands there as (frames, columns, rows)
        arrays = {k: (v.swapaxes(-1, -2) if matlab else v, u) for k, (v, u) in arrays.items()}
    elif data.startswith(CLASSIC):
        arrays, kind = _damaged(_classic, data, "NetCDF"), "NetCDF"
    else:
        arrays, kind = _damaged(_matlab, data, "MATLAB"), "MATLAB"
    name, values, said_unit = _chosen(arrays, variable)
    if scale is not None or offset is not None or values.dtype.kind in "ui":
        T, note = linear(values, scale, offset, f"{values.dtype} array '{name}'"), ""
    else:
        T, note = celsius(values, unit or said_unit)
    T = np.where(np.isfinite(T), T, np.nan)
    time = next((arrays[t][0].ravel() for t in TIMES if t in arrays and arrays[t][0].size == len(T)), None)
    notes = (f"array '{name}'", *([note] if note else []))
    return Frames(kind, T, time=time, outside=int(np.isnan(T).sum()), notes=notes)


def _damaged(reader, data: bytes, kind: str):
    try:
        return reader(data)
    except BadInput:
        raise
    except Exception as fault:  # damage raises whatever it hits
        raise BadInput(f"damaged {kind} file ({' '.join(str(fault).split())[:120]}); {AGAIN}") from fault


def _is_recording(data: bytes) -> bool:
    import h5py

    try:
        with h5py.File(io.BytesIO(data)) as file:
            return "view" in file.attrs and "temperature" in file
    except Exception:  # told by the reader that comes next
        return False


def _recording(path: Path) -> Frames:
    """A recording of contract 5.4: place, time and repetition are known; rows are turned so that v points up."""
    known = recording.load(path)
    said = {"emissivity": known.emissivity, "reflected": known.reflected_degC}
    return Frames(
        "recording",
        known.temperature,
        time=known.time,
        said={k: v for k, v in said.items() if v is not None},
        fps=known.fps,
        view=known.view,
        repetition=known.repetition,
        u=known.u,
        v=known.v,
        told={k: v for k in recording.OPTIONAL if (v := getattr(known, k)) is not None},
    )


def _hdf5(data: bytes) -> dict[str, tuple[np.ndarray, str | None]]:
    import h5py

    found = {}

    def visit(name, item):
        name = name if isinstance(name, str) else name.decode("latin-1")  # a damaged name stays bytes
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "fui" and item.size <= 40 * MOST_PIXELS:
            if item.ndim and item.size > 4000 * len(data):
                raise BadInput(f"array '{name}' of shape {item.shape} in a file of {len(data)} bytes; {AGAIN}")
            unit = item.attrs.get("units", item.attrs.get("unit"))
            unit = unit.decode("ascii", "replace") if isinstance(unit, bytes) else unit
            found[name] = (np.asarray(item), unit if isinstance(unit, str) else None)

    with h5py.File(io.BytesIO(data)) as file:
        file.visititems(visit)
    return found


def _classic(data: bytes):
    from scipy.io import netcdf_file

    with netcdf_file(io.BytesIO(data), mmap=False) as file:
        return {k: (_native(v[:]), getattr(v, "units", b"").decode() or None) for k, v in file.variables.items()}


def _native(values: np.ndarray) -> np.ndarray:
    return np.array(values, dtype=values.dtype.newbyteorder("="))


def _matlab(data: bytes):
    """MATLAB's own order (rows, columns, frames), turned to (frames, rows, columns)."""
    return {k: (np.moveaxis(v, -1, 0) if v.ndim == 3 else v, None) for k, v in matlab.read(data).items()}


def _chosen(arrays, variable):
    """Name, images (frames, rows, columns) and unit of the array to read; Frame0, Frame1, ... are one stack."""
    images = {k: (stacked(v), u) for k, (v, u) in arrays.items() if v.ndim in (2, 3) and min(v.shape[-2:]) > 1}
    numbered = sorted((k for k in images if re.fullmatch(r"\D+\d+", k)), key=lambda k: int(re.findall(r"\d+", k)[0]))
    stems = {re.sub(r"\d+$", "", k) for k in numbered}
    if len(numbered) > 1 and len(stems) == 1 and len({images[k][0].shape for k in numbered}) == 1 and not variable:
        stack = np.concatenate([images[k][0] for k in numbered])
        images = {k: v for k, v in images.items() if k not in numbered} | {stems.pop(): (stack, images[numbered[0]][1])}
    if variable is not None:
        if variable not in images:
            raise BadInput(f"variable: no images '{variable}' in it; known are {', '.join(images) or 'none at all'}")
        return variable, *images[variable]
    if len(images) > 1 and "temperature" in images:
        return "temperature", *images["temperature"]
    if len(images) != 1:
        what = ", ".join(f"'{k}' {v.shape}" for k, (v, _) in images.items()) or "no array of two or three dimensions"
        raise BadInput(f"holds {what}; give the one with the temperatures, --variable NAME")
    [(name, (values, unit))] = images.items()
    return name, values, unit
