"""Recordings: temperatures of one camera view or of sensors, degC, with the time and position of every pixel."""

from __future__ import annotations

import contextlib
import warnings
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.camera import cf_attributes
from flashtemp.camera.camera_classes import CAMERA_CLASSES, UNCOOLED
from flashtemp.camera.image_validation import MAX_CAMERA_DEGC, check_memory, finite_range, iter_chunks
from flashtemp.camera.sensors import SENSOR_KEYS, SensorPositions, positions_from_arrays
from flashtemp.display import DisplayMixin, DisplayTable, atomic_write, format_count
from flashtemp.errors import BadInput, shorten_text
from flashtemp.physics import safe_hdf5
from flashtemp.physics.quantities import KELVIN

VIEW_DESCRIPTIONS = {
    "sidewall": "u = x from the leading edge, v = z above the interface",
    "wake": "road behind the block: u = x > L, v = y from the centre line",
    "profile": "no v: block surface along x",
    "points": "thermocouples or pyrometers at positions x, y, z; u counts them",
}
MAX_WRITE_AT_ONCE_BYTES = 64 * 2**20  # bytes of images: larger recordings are written in chunks
CHUNK_PIXELS = 1_000_000  # pixels that are compressed together
RECORDING_VARIABLES = ("temperature", "time", "repetition", "u", "v", *SENSOR_KEYS)
NAME_SEPARATOR = ";"  # between the names of points
OPTIONAL_ATTRIBUTES = {  # attribute: unit, lowest, highest value
    "emissivity": ("1", 0.05, 1.0),
    "reflected_degC": ("degC", -273.0, 1500.0),
    "netd_K": ("K", 1e-4, 10.0),
    "fixed_pattern_K": ("K", 0.0, 10.0),
    "psf_sigma_px": ("px", 0.0, 50.0),
    "exposure_s": ("s", 0.0, 10.0),
    "fps": ("1/s", 0.0, 1e6),
    "registration_sigma_px": ("px", 0.0, 100.0),
}


@dataclass(frozen=True, eq=False, repr=False)
class Recording(DisplayMixin):
    """Frames of one view: `temperature` (frames, nv, nu) degC, NaN = dead pixel; a profile has nv = 1.

    `time` (frames,) s from the first start of sliding; `repetition` (frames,) from 1, during a wait the preceding one;
    `u` (nu,), `v` (nv,) pixel centres in m, increasing; `source` of the data.  Facts of the camera are None where
    unknown: `netd_K` noise of one pixel of one frame, `fixed_pattern_K` constant scatter between pixels,
    `psf_sigma_px` blur, `registration_sigma_px` standard deviation of the origin.  A view of points has sensor
    positions `places`; u counts them and nv = 1.  The class of the `camera`, uncooled or cooled, sets the usual size of
    its errors.  `frozen_times` (s) are those of frames that were left out because they repeat the one before; they are
    not stored in files.  Raises BadInput for values outside their ranges.
    """

    view: str
    temperature: np.ndarray
    time: np.ndarray
    repetition: np.ndarray
    u: np.ndarray
    v: np.ndarray
    emissivity: float | None = None
    reflected_degC: float | None = None
    netd_K: float | None = None
    fixed_pattern_K: float | None = None
    psf_sigma_px: float | None = None
    exposure_s: float | None = None
    fps: float | None = None
    registration_sigma_px: float | None = None
    source: str = ""
    places: SensorPositions | None = None
    camera: str = UNCOOLED
    frozen_times: tuple[float, ...] = ()

    def __post_init__(self):
        if fault := self._find_fault():
            raise BadInput(fault)

    def _find_fault(self) -> str | None:
        """The first fault of the recording in one line, or None."""
        return self._shape_fault() or self._place_fault() or self._value_fault()

    def _shape_fault(self) -> str | None:
        if self.view not in VIEW_DESCRIPTIONS:
            return f"view: {self.view!r}; give {', '.join(VIEW_DESCRIPTIONS)}"
        shape = (len(self.time), len(self.v), len(self.u))
        if self.temperature.shape != shape:
            return f"temperature: shape {self.temperature.shape}; its coordinates (frame, v, u) ask for {shape}"
        if self.is_single_row and len(self.v) != 1:
            return f"v: {len(self.v)} rows; a {self.view.rstrip('s')} has none"
        if (self.view == "points") != (self.places is not None) or (self.places and len(self.places) != len(self.u)):
            return (
                f"x, y, z: of {len(self.places or ())} points for {len(self.u)} columns of view {self.view!r}; one each"
            )
        if not all(shape):
            return f"temperature: shape {shape}; at least one frame and one pixel are needed"
        return None

    def _place_fault(self) -> str | None:
        """Fault of the coordinates, or None."""
        for name in ("time", "u", "v"):
            values = getattr(self, name)
            if not np.all(np.isfinite(values)):
                return f"{name}: holds values that are not finite; repair them"
            if name != "time" and np.any(np.diff(values) <= 0):
                return f"{name}: pixel centres must increase; turn the image and give them in m"
        if np.any(np.diff(self.time) < 0):
            return "time: frames must be in order of time, in s from the first start of sliding"
        if self.repetition.shape != (self.frames,) or np.any(self.repetition < 1):
            return "repetition: one number for every frame, counted from 1"
        if np.any(np.diff(self.repetition) < 0):
            return "repetition: falls from one frame to a later one; count on from the first start of sliding"
        return None

    def _value_fault(self) -> str | None:
        """Fault of the temperatures or of the camera's facts, or None."""
        if self.camera not in CAMERA_CLASSES:
            return f"camera: {self.camera!r}; give {' or '.join(CAMERA_CLASSES)}"
        low, high, known = self.span
        if not known:
            return "temperature: no pixel holds a number; choose other frames or another file"
        if low < -KELVIN or high > MAX_CAMERA_DEGC:
            wrong = "below absolute zero" if low < -KELVIN else "hotter than any camera measures"
            return f"temperature: {low if low < -KELVIN else high:g} degC is {wrong}; give degC"
        for name, (unit, low, high) in OPTIONAL_ATTRIBUTES.items():
            value = getattr(self, name)
            if value is not None and not low <= value <= high:
                return f"{name}: {value:g}; give {low:g} to {high:g} {unit}"
        return None

    @property
    def is_single_row(self) -> bool:
        """Whether the values form one row: a profile or points."""
        return self.view in ("profile", "points")

    @property
    def frames(self) -> int:
        return len(self.time)

    @cached_property
    def span(self) -> tuple[float, float, int]:
        """Lowest and highest temperature, degC, and the number of known values."""
        return finite_range(self.temperature)

    @property
    def frames_after_frozen(self) -> tuple[int, ...]:
        """Indices of the first frames after frozen ones: the shutter was closed, so the offset may be another."""
        after = np.searchsorted(self.time, self.frozen_times)
        return tuple(sorted({int(k) for k in after if 0 < k < self.frames}))

    @property
    def pitch(self) -> tuple[float, float]:
        """Distance between pixels along u and v, m (mean; inf where there is only one)."""
        u, v = (float(np.diff(a).mean()) if len(a) > 1 else float("inf") for a in (self.u, self.v))
        return u, v

    def to_dataset(self):
        """The recording as an xarray Dataset (docs/reference/file_formats.md)."""
        import xarray as xr

        flat, along = self.is_single_row, "point" if self.view == "points" else "u"
        data = self.temperature[:, 0] if flat else self.temperature
        coords = {
            "time": ("frame", self.time, {"units": "s", "long_name": "time since the first start of sliding"}),
            "repetition": ("frame", self.repetition, {"units": "1", "long_name": "repetition, 1-based"}),
        }
        if self.places is None:
            coords["u"] = ("u", self.u, {"units": "m"})
        else:
            coords |= {k: ("point", getattr(self.places, k), {"units": unit}) for k, (unit, *_) in SENSOR_KEYS.items()}
        if not flat:
            coords["v"] = ("v", self.v, {"units": "m"})
        known = {name: getattr(self, name) for name in OPTIONAL_ATTRIBUTES if getattr(self, name) is not None}
        if self.camera != UNCOOLED:
            known["camera"] = self.camera
        if self.places is not None:
            known["names"] = NAME_SEPARATOR.join(n.replace(NAME_SEPARATOR, " ") for n in self.places.names)
        return xr.Dataset(
            {"temperature": (("frame", along) if flat else ("frame", "v", "u"), data, {"units": "degC"})},
            coords=coords,
            attrs={"view": self.view, "source": self.source, "Conventions": "CF-1.11"} | known,
        )

    def save(self, path) -> None:
        """Write NetCDF-4; an existing file is replaced only by a complete one."""
        path = Path(path)
        with atomic_write(path) as fresh:
            if self.temperature.nbytes <= MAX_WRITE_AT_ONCE_BYTES:
                encoding = {"temperature": {"zlib": True, "complevel": 4}, "time": {"dtype": "float64"}}
                fresh.write_bytes(bytes(self.to_dataset().to_netcdf(engine="h5netcdf", encoding=encoding)))
            else:
                self._write_frames(fresh)

    def _write_frames(self, path: Path) -> None:
        """Write a file a few frames at a time, for images that need not fit into memory."""
        import h5netcdf

        ds = self.to_dataset()
        about, dims = ds["temperature"].attrs, ds["temperature"].dims
        ds.drop_vars("temperature").to_netcdf(path, engine="h5netcdf", encoding={"time": {"dtype": "float64"}})
        with h5netcdf.File(path, "a") as file:
            flat = self.is_single_row
            step = max(1, CHUNK_PIXELS // self.temperature[0].size)
            shape = self.temperature[:, 0].shape if flat else self.temperature.shape
            variable = file.create_variable(
                "temperature", dims, self.temperature.dtype, chunks=(min(step, shape[0]), *shape[1:]),
                compression="gzip", compression_opts=4, shuffle=True, fillvalue=np.nan,
            )  # fmt: skip
            variable.attrs.update(about)
            variable.attrs["coordinates"] = "time repetition"
            for begin, images in iter_chunks(self.temperature, step):
                variable[begin : begin + len(images)] = images[:, 0] if flat else images

    def select_frames(self, keep: np.ndarray) -> Recording:
        """Recording with some of the frames: indices or a mask (frames,)."""
        return replace(self, temperature=self.temperature[keep], time=self.time[keep], repetition=self.repetition[keep])

    def __str__(self) -> str:
        low, high, known = self.span
        size = f"{len(self.u)} pixels" if self.is_single_row else f"{len(self.u)} x {len(self.v)} pixels"
        du, dv = (1e3 * p for p in self.pitch)
        pitch = f"{du:.3g} mm" if self.is_single_row else f"{du:.3g} x {dv:.3g} mm"
        size = f"{len(self.u)} points" if self.places is not None else f"{size} of {pitch}"
        lost = 100 * (1 - known / self.temperature.size)
        return (
            f"Recording '{self.view}' of {format_count(self.frames, 'frame')}, {size}\n"
            f"  time {self.time[0]:g} to {self.time[-1]:g} s, repetitions {self.repetition.min()} to"
            f" {self.repetition.max()}\n"
            f"  {low:.2f} to {high:.2f} degC, {lost:.2g} % of the values missing"
        )

    def to_table(self) -> DisplayTable:
        (low, high, known), mm = self.span, 1e3
        rows: list[tuple] = [("frames", self.frames, ""), ("time", (self.time[0], self.time[-1]), "s")]
        rows.append(("repetitions", (int(self.repetition.min()), int(self.repetition.max())), ""))
        if self.places is None:
            rows.append(("u", (mm * self.u[0], mm * self.u[-1]), "mm"))
        if not self.is_single_row:
            rows.append(("v", (mm * self.v[0], mm * self.v[-1]), "mm"))
        rows.append(("temperature", (low, high), "degC"))
        rows.append(("values missing", 100 * (1 - known / self.temperature.size), "%"))
        about = (
            (k, getattr(self, k), unit) for k, (unit, *_) in OPTIONAL_ATTRIBUTES.items() if getattr(self, k) is not None
        )
        title = f"Recording '{self.view}' ({VIEW_DESCRIPTIONS[self.view]})"
        return DisplayTable(title, [*rows, *about], notes=[self.source] if self.source else [])


def load(path: str | Path, limit: float | None = None) -> Recording:
    """Read a recording (NetCDF), with units by CF conventions.  BadInput names the file and the fault.

    Its size is checked before anything is read: at most `limit` GB of memory, by default 1.
    """
    import xarray as xr

    path = Path(path)
    if not path.is_file():
        raise BadInput(f"{path}: no such recording; give a .nc file that flashtemp import has written")
    try:
        safe_hdf5.check_hdf5_file(path, RECORDING_VARIABLES.__contains__, partial(_check_dataset, limit))
        with (
            warnings.catch_warnings(action="ignore", category=xr.SerializationWarning),  # both marks of missing values
            xr.open_dataset(path, engine="h5netcdf", decode_times=False, decode_timedelta=False) as opened,
        ):
            ds = opened.drop_vars([name for name in opened.variables if name not in RECORDING_VARIABLES])
            ds.load()
    except BadInput as fault:
        raise BadInput(*(f"{path}: {line}" for line in fault.lines)) from fault
    except Exception as fault:  # h5netcdf raises whatever the damage provokes
        what = shorten_text(" ".join(str(fault).split()))
        raise BadInput(f"{path}: not a NetCDF recording ({what}); write it with flashtemp import") from fault
    points = str(ds.attrs.get("view", "")) == "points"
    missing = [k for k in ("temperature", "time", "repetition", "z" if points else "u") if k not in ds.variables]
    if missing or "view" not in ds.attrs:
        what = ", ".join([*missing, *([] if "view" in ds.attrs else ["attribute view"])])
        raise BadInput(
            f"{path}: {what} missing; a recording holds temperature(frame, v, u), time, repetition, u, v, view"
        )
    view, T = shorten_text(str(ds.attrs["view"])), ds["temperature"]
    flat = view in ("profile", "points")
    wanted = ("frame", "point" if points else "u") if flat else ("frame", "v", "u")
    if set(T.dims) != set(wanted):
        raise BadInput(f"{path}: temperature{tuple(T.dims)}; give temperature({', '.join(wanted)}) for view {view!r}")
    if not flat and "v" not in ds.variables:
        raise BadInput(f"{path}: v missing; give the pixel centres v in m")
    try:
        _check_dimensions(ds, wanted)
        values = _read_variable(ds, "temperature", T.transpose(*wanted))
        values = values if np.isfinite(values).all() else np.where(np.isfinite(values), values, np.nan)
        return Recording(
            view,
            values[:, None, :] if flat else values,
            _read_variable(ds, "time"),
            _whole_numbers(_read_variable(ds, "repetition")),
            np.arange(values.shape[1], dtype=float) if points else _read_variable(ds, "u"),
            np.zeros(1) if flat else _read_variable(ds, "v"),
            source=shorten_text(str(ds.attrs.get("source", ""))),
            camera=shorten_text(str(ds.attrs.get("camera", UNCOOLED))),
            places=_read_positions(ds, values.shape[1]) if points else None,
            **_read_optional(ds),
        )
    except BadInput as fault:
        raise BadInput(*(f"{path}: {line}" for line in fault.lines)) from fault


def _read_optional(ds) -> dict[str, Any]:
    """What the attributes of a file tell about the camera.  Raises BadInput."""
    given: dict[str, Any] = {}
    for name in OPTIONAL_ATTRIBUTES.keys() & set(ds.attrs):
        with contextlib.suppress(TypeError, ValueError):
            given[name] = float(ds.attrs[name])
        if name not in given:
            raise BadInput(f"{name}: {shorten_text(repr(ds.attrs[name]))}; give a number")
    return given


def _check_dimensions(ds, wanted: tuple[str, ...]) -> None:
    """BadInput where a coordinate of the temperatures' dimensions is not one number along each."""
    along = {"time": "frame", "repetition": "frame", "u": "u", "v": "v"} | dict.fromkeys(SENSOR_KEYS, "point")
    for name in along.keys() & set(ds.variables):
        if along[name] in wanted and ds[name].dims != (along[name],):
            raise BadInput(f"{name}({', '.join(map(str, ds[name].dims))}); give {name}({along[name]})")


def _read_positions(ds, n: int) -> SensorPositions:
    """Places of the points of a file.  Raises BadInput."""
    names = [shorten_text(name) for name in str(ds.attrs.get("names", "")).split(NAME_SEPARATOR)]
    if len(names) != n:
        names = list(map(str, range(1, n + 1)))
    try:
        return positions_from_arrays(
            names, {k: np.atleast_1d(_read_variable(ds, k)) for k in SENSOR_KEYS if k in ds.variables}
        )
    except (TypeError, ValueError) as fault:
        raise BadInput(f"{', '.join(SENSOR_KEYS)}: hold what is no number; give one for every point") from fault


def _read_variable(ds, name: str, variable=None) -> np.ndarray:
    """A variable of a file, in the unit of recordings.  Raises BadInput."""
    unit = SENSOR_KEYS[name][0] if name in SENSOR_KEYS else cf_attributes.VARIABLE_UNITS[name]
    return cf_attributes.read_variable(name, ds[name] if variable is None else variable, unit)


def _check_dataset(limit: float | None, size: int, what: str, usual: bool) -> None:
    """BadInput where a dataset takes too much memory or has an unusual number type, a sign of damage."""
    check_memory(size, limit, what)
    if not usual:
        raise BadInput(f"{what} holds numbers of an unusual kind: damaged; write it again with flashtemp import")


def _whole_numbers(values: np.ndarray) -> np.ndarray:
    """Numbers of repetitions as integers.  BadInput where they are not whole."""
    if not np.all(np.isfinite(values)) or np.any(values != np.round(values)):
        raise BadInput("repetition: give whole numbers, counted from 1")
    return values.astype(int)
