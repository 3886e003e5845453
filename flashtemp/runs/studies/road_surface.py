"""Measured or synthetic roads: their power spectrum, and the regions in contact under a load."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from textwrap import shorten
from typing import Any

import numpy as np

from flashtemp.display import DisplayMixin, DisplayTable
from flashtemp.errors import BadInput
from flashtemp.physics.friction import contact_map, measured_roughness
from flashtemp.physics.friction.elastic_contact import load_topography_library
from flashtemp.physics.friction.roughness_spectrum import MeasuredSpectrum

SYNTHETIC_LENGTH_M, SYNTHETIC_WIDTH_M = 0.05, 0.02  # default size of a synthetic road
MAX_REASON_CHARS = 120  # length of the message of a file reader


@dataclass(frozen=True)
class SelfAffineRoad:
    """Parameters of a synthetic road: `length`, `width` (None for the default), `pixel`, `rms` height, `rolloff`, m."""

    length: float | None = None
    width: float | None = None
    pixel: float = 1e-4
    hurst: float = 0.85
    rms: float = 3e-4
    rolloff: float = 5e-3
    seed: int = 1


def find_contact_regions(
    file: Path | None, road: SelfAffineRoad, cutoff: float, pressure: float, modulus: float
) -> contact_map.SolvedContactMap:
    """Compute the contact map of a file of heights, or of a synthetic `road` without a file.

    `cutoff` in m, nominal `pressure` and contact `modulus` in Pa.  `road` gives the size of a file that states none.
    Raises BadInput.
    """
    length, width = road.length, road.width
    if file is not None and (length is None) != (width is None):
        raise BadInput(
            f"--{'width' if width is None else 'length'}: missing; give both --length and --width, or neither"
        )
    given = {"pressure": pressure, "modulus": modulus, "cutoff": cutoff, "length": length, "width": width,
             "pixel": road.pixel, "hurst": road.hurst, "rms": road.rms, "rolloff": road.rolloff}  # fmt: skip
    for name, value in given.items():
        if value is not None and (not 0.0 < value < float("inf") or (name == "hurst" and value > 1)):
            raise BadInput(f"--{name}: {value:g}; give a number > 0" + (" and <= 1" if name == "hurst" else ""))
    if file is not None:
        heights = contact_map.read_height_map(file, None if length is None or width is None else (length, width))
    else:
        size = SYNTHETIC_LENGTH_M if length is None else length, SYNTHETIC_WIDTH_M if width is None else width
        heights = contact_map.generate_topography(*size, road.pixel, road.hurst, road.rms, road.rolloff, road.seed)
    return contact_map.solve_contact_map(heights, pressure, modulus, cutoff)


@dataclass(frozen=True, eq=False, repr=False)
class RoadSpectrum(DisplayMixin):
    """Power spectrum C(q) of a `file` at `points`, with `notes` on reading it.

    `missing`: fraction of heights without a value; `line`: rms height (m) of the line of a profile.
    """

    file: Path
    points: MeasuredSpectrum
    summary: measured_roughness.SpectrumSummary
    missing: float
    line: float | None = None
    notes: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """The summary as plain data."""
        own = {} if self.line is None else {"rms_height_of_line_m": self.line}
        return self.summary.as_dict() | {"missing": self.missing} | own

    def save(self, file: Path) -> None:
        """Write the CSV file for persson_friction.spectrum."""
        measured_roughness.save_spectrum(self.points, file)

    def __str__(self) -> str:
        text = f"{self.summary}\n  dropouts and spikes: {100 * self.missing:.2g} % of the heights"
        if self.line is not None:
            text += f"\n  rms height of the line itself: {1e3 * self.line:.3g} mm"
        return text

    def to_table(self) -> DisplayTable:
        units = {"m": "m", "m4": "m4"}
        rows = []
        for name, value in self.as_dict().items():
            words, _, unit = name.rpartition("_")
            known = unit in units
            if name != "remarks":
                rows.append(((words if known else name).replace("_", " "), value, units.get(unit, "1")))
        return DisplayTable(f"Power spectrum of {self.file.name}", rows, notes=self.summary.remarks)


def read_road_spectrum(
    file: Path, profile: bool = False, highpass: float | None = None, pixel: float | None = None
) -> RoadSpectrum:
    """Compute the power spectrum of a height map, or of a line `profile`, up to wavelengths of `highpass` m.

    A file whose header states a line scan with units needs no `profile`.  `pixel`: spacing (m) of the points of a
    file that contains only heights.  Raises BadInput.
    """
    for name, value in {"highpass": highpass, "pixel": pixel}.items():
        if value is not None and not 0.0 < value < float("inf"):
            raise BadInput(f"--{name}: {value:g}; give a number > 0")
    if not file.is_file():
        raise BadInput(f"{file}: not found; give a file of heights")
    load_topography_library()
    longest = float("inf") if highpass is None else highpass
    heights, step, notes = _read_heights(file, profile, pixel)
    heights = measured_roughness.remove_spikes(heights)
    missing, line = float((heights != heights).mean()), None
    if heights.ndim == 1:
        points = measured_roughness.spectrum_of_profile(heights, step, longest)
        line = measured_roughness.profile_height(heights, step, longest)
    else:
        points = measured_roughness.spectrum_of_topography(heights, step, longest)
    return RoadSpectrum(file, points, measured_roughness.SpectrumSummary.from_points(points), missing, line, notes)


def _read_heights(file: Path, profile: bool, pixel: float | None) -> tuple[np.ndarray, Any, tuple[str, ...]]:
    """Heights in m, (n,) of a line or (nx, ny) with nan for missing ones, their spacing in m, and notes on reading."""
    if pixel is not None:
        return _read_bare_heights(file, profile), pixel, ()
    if profile:
        scan = measured_roughness.read_line_scan(file)
        return scan.heights, scan.step, scan.notes
    try:
        road = _read_topography(file)
    except BadInput as fault:
        try:
            scan = measured_roughness.read_line_scan(file, stated=True)
        except BadInput:
            raise fault from fault.__cause__
        return scan.heights, scan.step, scan.notes
    heights = np.ma.filled(np.ma.asarray(road.heights()).astype(float), np.nan)
    return heights, tuple(s / n for s, n in zip(road.physical_sizes, heights.shape, strict=True)), ()


def _read_bare_heights(file: Path, profile: bool) -> np.ndarray:
    """Heights of a file that contains nothing else.  Raises BadInput."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", UserWarning)  # numpy warns of an empty file
            bare = np.load(file) if file.suffix == ".npy" else np.loadtxt(file, encoding="utf-8-sig")
        bare = np.squeeze(np.asarray(bare, dtype=float))
    except (ValueError, TypeError, OSError, EOFError, UserWarning) as fault:
        raise BadInput(
            f"{file}: not a table of heights in m separated by blanks; leave out --pixel for files with a header"
        ) from fault
    if bare.ndim != (1 if profile else 2):
        raise BadInput(f"{file}: {bare.ndim} dimensions; give rows of heights, or one line with --profile")
    return bare


def _read_topography(file: Path) -> Any:
    """The topography of a file.  Raises BadInput with the cause and the remedies for a spectrum."""
    try:
        return contact_map.read_height_map(file)
    except BadInput as fault:
        why = str(fault).removeprefix(f"{file}: ").rpartition("; ")[0]
        if fault.__cause__ is not None:  # the library lists the error of every reader
            message = str(fault.__cause__)
            reason = "no format that SurfaceTopography can read" if message.startswith("tried ") else message
            why = f"not a topography: {shorten(reason, MAX_REASON_CHARS, placeholder=' ...')}"
        remedy = "give a height map of an instrument, --profile for columns of distance and height, or --pixel"
        raise BadInput(f"{file}: {why}; {remedy} for heights in m separated by blanks") from fault
