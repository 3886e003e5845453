"""RawFrames: the content of one camera file before its place and time are stated, and conversions to degC."""

from __future__ import annotations

import importlib
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, fields

import numpy as np

from flashtemp.camera.image_validation import check_camera_range
from flashtemp.camera.radiometry import ObjectParameters, PlanckCalibration
from flashtemp.errors import BadInput
from flashtemp.physics.quantities import KELVIN

MAX_FRAME_PIXELS = 50_000_000  # of one frame: a larger size field is damaged
TEMPERATURE_UNIT_NAMES = {
    "c": "degC", "celsius": "degC", "centigrade": "degC", "f": "degF", "fahrenheit": "degF", "k": "K", "kelvin": "K",
    "kelvins": "K", "mk": "mK", "millikelvin": "mK",
}  # fmt: skip
UNIT_REMEDY = "give --unit degC, K, mK or degF, or --scale and --offset for counts"
MAX_MEDIAN_WITHOUT_UNIT_DEGC = 150.0  # a median above this could be kelvin: the unit must be stated
NO_COLOURS = (
    "holds colours, not temperatures: nobody can turn them back; give the radiometric file of the camera"
    " or its export as 16-bit TIFF or CSV"
)


@dataclass(frozen=True)
class RawFrames:
    """Images of one file: `temperature` (frames, rows, columns) degC, row 0 at the top, NaN where unknown.

    `clock` (frames,) s since 1970 on the camera's clock, in its time zone; `time` (frames,) s if the file counts from a
    start; `stated_parameters`: object parameters that the file states; `parameters`: those with which `temperature` was
    computed (radiometric files only, as `counts` and `planck`).  `outside`: number of pixels beyond the camera's range;
    `difference`: K, not degC (a lock-in amplitude); `is_unscaled`: counts of unknown scale.  Recordings have their
    place already: `view`, `repetition`, `u`, `v` (m) and the `camera_attributes`.  `share_read`: part of the file that
    has been read, from 0 to 1.  BadInput for impossible temperatures.
    """

    format: str
    temperature: np.ndarray
    clock: np.ndarray | None = None
    time: np.ndarray | None = None
    stated_parameters: dict[str, float] = field(default_factory=dict)
    parameters: ObjectParameters | None = None
    counts: np.ndarray | None = None
    planck: PlanckCalibration | None = None
    camera: str = ""
    fps: float | None = None
    outside: int = 0
    notes: tuple[str, ...] = ()
    difference: bool = False
    is_unscaled: bool = False
    view: str | None = None
    repetition: np.ndarray | None = None
    u: np.ndarray | None = None
    v: np.ndarray | None = None
    camera_attributes: dict[str, float] = field(default_factory=dict)
    share_read: float = 1.0

    def __post_init__(self):
        T = self.temperature
        if T.ndim != 3 or T.size == 0:
            raise BadInput(f"holds an array of shape {T.shape}; give images (rows, columns) or (frame, rows, columns)")
        if not (self.difference or self.is_unscaled) and np.isfinite(T).any():
            check_camera_range(T)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of one image."""
        return self.temperature.shape[1:]

    def take_every(self, step: int) -> RawFrames:
        """Every `step`-th frame."""
        if step == 1:
            return self
        chosen = {}
        for name in ("temperature", "clock", "time", "counts", "repetition"):
            values = getattr(self, name)
            chosen[name] = values if values is None else values[::step]
        kept = {f.name: getattr(self, f.name) for f in fields(self)}
        return RawFrames(**(kept | chosen | {"fps": self.fps / step if self.fps else None}))

    def __str__(self) -> str:
        T = self.temperature[np.isfinite(self.temperature)]
        many = f"{len(self.temperature)} frames of " if len(self.temperature) > 1 else ""
        camera = f", {self.camera}" if self.camera else ""
        size, unit = f"{self.shape[1]} x {self.shape[0]} pixels", "K" if self.difference else "degC"
        span = f"{T.min():.2f} to {T.max():.2f} {unit}" if T.size else "no temperature"
        return f"{self.format}{camera}, {many}{size}, {span}"


def concatenate_frames(pieces: Sequence[RawFrames]) -> RawFrames:
    """The pieces of one file as one RawFrames, in order."""
    first = pieces[0]
    if len(pieces) == 1:
        return first
    chosen = {}
    for name in ("temperature", "clock", "time", "counts", "repetition"):
        parts = [getattr(p, name) for p in pieces]
        chosen[name] = None if any(p is None for p in parts) else np.concatenate(parts)
    kept = {f.name: getattr(first, f.name) for f in fields(first)}
    notes = tuple(dict.fromkeys(note for p in pieces for note in p.notes))
    return RawFrames(**(kept | chosen | {"outside": sum(p.outside for p in pieces), "notes": notes}))


def temperature_unit(text: str) -> str | None:
    """degC, degF, K or mK of a unit as files write it; None if it is no unit of temperature.

    >>> temperature_unit("°F"), temperature_unit("deg C"), temperature_unit("[Kelvin]"), temperature_unit("mm")
    ('degF', 'degC', 'K', None)
    """
    bare = re.sub(r"[°º˚\s._\[\](){}]", "", text.replace("℃", "C").replace("℉", "F")).lower()
    return TEMPERATURE_UNIT_NAMES.get(re.sub(r"^(?:deg(?:rees?)?|grad|o(?=[cf]$))", "", bare))


def agree_on_unit(stated: str | None, in_file: str | None, where: str) -> str | None:
    """The unit that the user states, or else the file at `where`.  BadInput if both are stated and differ."""
    if stated and in_file and temperature_unit(in_file) not in (None, temperature_unit(stated)):
        raise BadInput(f"unit: --unit {stated}, but {where} says {in_file}; leave --unit out, or repair the file")
    return stated or in_file


def to_celsius(
    values: np.ndarray, unit: str | None, difference: bool = False, remedy: str = UNIT_REMEDY
) -> tuple[np.ndarray, str]:
    """Values in degC and a note; an unknown unit is taken as degC, or raises BadInput if it could be another.

    `difference`: the values are differences of temperatures (a lock-in amplitude), K.  `remedy`: how the user states a
    missing unit.
    """
    values = np.asarray(values, dtype=float)
    if unit is None:
        known = values[np.isfinite(values)]
        middle = float(np.median(known)) if known.size else 0.0
        if not -100 < middle < MAX_MEDIAN_WITHOUT_UNIT_DEGC:
            raise ScaleMissing(
                f"values {known.min():g} to {known.max():g} in a unit that the file does not say; {remedy}"
            )
        return values, "unit not said in the file, taken as degC"
    known = temperature_unit(unit)
    if known is None:
        raise BadInput(f"unit: {unit!r}; give --unit degC, K, mK or degF")
    scale = {"mK": 1e-3, "degF": 1 / 1.8}.get(known, 1.0)
    offset = {"degC": 0.0, "degF": -32 / 1.8}.get(known, -KELVIN)
    return scale * values + (0.0 if difference else offset), ""


class UnstatedScale(float):
    """Scale of counts that stay counts, because it is not stated yet."""


class ScaleMissing(BadInput):
    """The scale or unit of a file's numbers is missing, and only the user knows it."""


UNSTATED_SCALE = UnstatedScale(1.0)


def scale_counts(counts: np.ndarray, scale: float | None, offset: float | None, what: str) -> np.ndarray:
    """Temperatures, degC, of counts (T - offset)/scale.  ScaleMissing unless both are stated."""
    if scale is None or offset is None:
        missing = " and ".join(k for k, v in (("--scale", scale), ("--offset", offset)) if v is None)
        raise ScaleMissing(
            f"{what} of {counts.min()} to {counts.max()} counts; give {missing}: T = scale count + offset in degC,"
            " often --scale 0.01, 0.04, 0.1 or 0.4 and --offset -273.15"
        )
    if scale is UNSTATED_SCALE:
        return counts.astype(float)
    T = scale * counts.astype(float) + offset
    middle = float(np.median(T))
    if not -100 <= middle <= 1500:
        raise BadInput(
            f"scale: {scale:g} and offset {offset:g} make {T.min():.4g} to {T.max():.4g} degC of {what}; give the"
            " camera's own, often --scale 0.01, 0.04, 0.1 or 0.4 and --offset -273.15"
        )
    return T


def saturated_counts(values: np.ndarray) -> np.ndarray:
    """Mask of the counts at the ends of their type, 0 and 65535, where a camera saturates."""
    ends = np.iinfo(values.dtype)
    return (values == ends.min) | (values == ends.max)


def frames_from_pixels(values: np.ndarray, kind: str, unit, scale, offset) -> RawFrames:
    """Frames from the pixels of an image file: counts, with `scale` and `offset`, or temperatures in `unit`."""
    bits = 8 * values.dtype.itemsize
    if values.dtype.kind in "ui":
        T, note = scale_counts(values, scale, offset, f"{bits}-bit {kind}"), ""
        T[saturated_counts(values)] = np.nan
    elif values.dtype.kind == "f":
        T, note = to_celsius(values, unit)
    else:
        raise BadInput(f"{kind} of {values.dtype}; give 16-bit counts or floating-point temperatures")
    T = np.where(np.isfinite(T), T, np.nan)
    outside, counted = int(np.isnan(T).sum()), scale is UNSTATED_SCALE
    return RawFrames(f"{bits}-bit {kind}", T, outside=outside, notes=(note,) if note else (), is_unscaled=counted)


def as_frame_stack(values: np.ndarray) -> np.ndarray:
    """Images as (frames, rows, columns), from (rows, columns) or (frames, rows, columns)."""
    return values[None] if values.ndim == 2 else values


def require_module(module: str):
    """A module of the optional extra `camera`.  BadInput states how to install it."""
    try:
        return importlib.import_module(module)
    except ImportError as fault:
        package = {"skimage.transform": "scikit-image"}.get(module, module)
        raise BadInput(f"needs {package}, which is not installed; use pip install 'flashtemp[camera]'") from fault
