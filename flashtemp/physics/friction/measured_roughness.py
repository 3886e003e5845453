"""Power spectra of measured roads, read from a file or computed from heights by SurfaceTopography.

flashtemp's C(q) is isotropic with <h^2> = 2 pi int q C dq (m^4).  The spectra of SurfaceTopography differ by powers of
2 pi:

    area:  C = C2/(4 pi^2),       from <h^2> = 1/(2 pi) int q C2 dq
    line:  S(k) = C1/(2 pi),      two-sided, from <h^2> = 1/pi int C1 dk

A line scan at an angle to a wave sees a longer wave, so S(k) collects all waves with q >= k:

    S(k) = 2 int_k^inf C(q) q dq/sqrt(q^2 - k^2),      C(q) = -1/pi int_q^inf S'(k) dk/sqrt(k^2 - q^2)    (Abel)

S ~ k^(-1-2H) gives C = S(q)/q Gamma(1 + H)/(sqrt(pi) Gamma(H + 1/2)).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.display import atomic_write
from flashtemp.errors import BadInput
from flashtemp.physics import interpolation, safe_text
from flashtemp.physics.arrays import Value
from flashtemp.physics.friction.elastic_contact import load_topography_library, suppress_library_warnings
from flashtemp.physics.friction.instrument_tables import ColumnSpec, read_instrument_table, table_of_rows
from flashtemp.physics.friction.roughness_spectrum import MeasuredSpectrum, RoughnessSpectrum, SelfAffineLaw
from flashtemp.physics.interpolation import Source

AREA_BINS_PER_DECADE = 20  # bins of q for an area
LINE_BINS_PER_DECADE = 10  # for a line, whose spectrum is differentiated
SPIKE_SD = 10.0  # robust standard deviations from the median that no point of a road reaches
MAX_MISSING_FRACTION = 0.5
LONG_WAVE_VARIANCE_RATIO = 25.0  # variance of ln C of the longest waves over that of the shortest
RMS_HEIGHT_RANGE_M = (1e-9, 0.1)  # plausible rms heights
MAX_ROAD_RMS_SLOPE = 10.0  # largest plausible rms slope
SPECTRUM_LAW_TEXT = ", or a law { height = m, rolloff = 1/m, hurst = 1, lowest = 1/m }"

LENGTH_SPELLINGS = {  # by length in m; stylus instruments also use angstrom, microinch and mil
    1.0: "m metre metres meter meters", 1e-2: "cm", 1e-3: "mm millimetre millimetres millimeter millimeters",
    1e-6: "um micrometre micrometres micrometer micrometers Micrometer micron microns",
    1e-9: "nm nanometre nanometres nanometer nanometers Nanometer", 1e-12: "pm",
    1e-10: "\u00c5 \u212b A angstrom angstroms Angstrom Angstroms", 0.0254: "in inch inches", 2.54e-5: "mil mils",
    2.54e-8: "uin uinch",
}  # fmt: skip
LENGTH_UNITS_M = {unit: metres for metres, units in LENGTH_SPELLINGS.items() for unit in units.split()}
ANY = ""  # pattern that matches every name
WAVENUMBER_COLUMN = ColumnSpec(
    "wavenumber",
    r"q|k|(?:wave|number|vector|spatial|angular|frequency){1,6}[qk]?",
    {name.format(u): (1 / f, 0.0) for u, f in LENGTH_UNITS_M.items() for name in ("1/{}", "rad/{}", "{}-1")},
    ((ANY, "1/m"),),
    "q (1/m)",
)  # fmt: skip
SPECTRUM_COLUMN = ColumnSpec(
    "power spectrum",
    r"C|(?:psd|isotropic|iso|2d|power|spectr(?:um|al)|density|c(?:iso|2d)?|cq|q){1,6}",
    {f"{u}4": (f**4, 0.0) for u, f in LENGTH_UNITS_M.items()},
    ((ANY, "m4"),),
    "C (m^4), isotropic: not the m^3 of a line",
)
DISTANCE_COLUMN = ColumnSpec(
    "distance",
    r"[xX]|(?:x|distance|position|pos|length|abscissa|lateral|scan|travel|path|displacement|horizontal|axis|coordinate|weg){1,6}",
    {k: (f, 0.0) for k, f in LENGTH_UNITS_M.items()}, ((ANY, "m"),), "x (mm)",
)  # fmt: skip
HEIGHT_COLUMN = ColumnSpec(
    "height",
    r"[zZhH]|(?:z|h|height|depth|elevation|profile|profil|total|raw|primary|measured|vertical|data|deflection|axis"
    r"|coordinate|höhe|tiefe){1,6}",
    {k: (f, 0.0) for k, f in LENGTH_UNITS_M.items()}, ((ANY, "m"),), "z (mm)",
)  # fmt: skip
UNIT_OF_AXIS = re.compile(
    r"\b(?P<axis>[xz])[ _-]?(?:axis )?units?[^\w\n]{1,4}(?P<unit>[A-Za-z\u00c5]{1,12})", re.IGNORECASE
)
MAX_HEADER_BYTES = 20_000  # first bytes of a file that are searched for units of axes
LATERAL_COLUMN = ColumnSpec(
    "y", r"[yY]|(?:y|axis|coordinate|position){2,6}", HEIGHT_COLUMN.units, ((ANY, "m"),), "y (mm)"
)
VALIDITY_COLUMN = ColumnSpec(
    "valid", r"valid|validity", dict.fromkeys(("", "1/0", "0/1", "-", "1"), (1.0, 0.0)), ((ANY, ""),), "valid"
)


def read_spectrum(source: Source, folder: Path, key: str) -> MeasuredSpectrum:
    """C(q) of a file or of rows [q 1/m, C m^4]; rows at the same wavenumber are averaged (log mean).

    Raises BadInput naming key, file and line for values <= 0, and where the rms height indicates wrong units.
    """
    if isinstance(source, (list, tuple)):
        table = table_of_rows(
            interpolation.read_rows(source, folder, key, 2), key, (WAVENUMBER_COLUMN, SPECTRUM_COLUMN)
        )
    else:
        table = read_instrument_table(
            source,
            folder,
            key,
            (WAVENUMBER_COLUMN, SPECTRUM_COLUMN),
            ("wavenumber", "power spectrum"),
            SPECTRUM_LAW_TEXT,
        )
    where = table.name
    for quantity in (WAVENUMBER_COLUMN, SPECTRUM_COLUMN):
        if quantity.name not in table:
            raise BadInput(f"{where}: no column of the {quantity.name}; name it {quantity.usual}")
        values = table[quantity.name]
        table.require_rows(~((values > 0) & np.isfinite(values)), quantity.name, "a number > 0")
    q, back = np.unique(table["wavenumber"], return_inverse=True)
    C = np.exp(np.bincount(back, np.log(table["power spectrum"])) / np.bincount(back))
    if len(q) < 3:
        raise BadInput(f"{where}: {len(q)} different wavenumbers; give 3 or more")
    return _check_rms_height(q, C, where)


@dataclass(frozen=True)
class LineScan:
    """Heights (n,) of one line in m, nan for missing points, their `step` (m), and notes on assumptions."""

    heights: np.ndarray
    step: float
    notes: tuple[str, ...] = ()


def read_profile(file: Path, key: str = "profile") -> tuple[np.ndarray, float]:
    """Heights (n,) in m and step (m) of a line scan, nan for missing points.  Raises BadInput as `read_line_scan`."""
    scan = read_line_scan(file, key)
    return scan.heights, scan.step


def read_line_scan(file: Path, key: str = "profile", stated: bool = False) -> LineScan:
    """The line scan in a file: columns of distance and height in any unit, or a format of SurfaceTopography.

    With `stated` the file itself must state both units.  Raises BadInput for files without both columns, for areas, and
    for uneven steps.
    """
    try:
        return _scan_of_columns(file, key, stated)
    except BadInput as fault:
        scan = _scan_of_library(file, key)
        if scan is None:
            raise fault
        return scan


def _scan_of_columns(file: Path, key: str, stated: bool) -> LineScan:
    """Line scan from columns of text."""
    table = read_instrument_table(
        file.name,
        file.parent,
        key,
        (DISTANCE_COLUMN, HEIGHT_COLUMN, LATERAL_COLUMN, VALIDITY_COLUMN),
        ("distance", "height"),
    )
    where = f"{key}: {file.name}"
    height = "height" if "height" in table else "y"
    for name, quantity in (("distance", DISTANCE_COLUMN), (height, HEIGHT_COLUMN)):
        if name not in table:
            raise BadInput(f"{where}: no column of the {quantity.name}; name it {quantity.usual}")
    if height == "height" and "y" in table and np.ptp(table["y"]) > 0:
        raise BadInput(f"{where}: y varies, an area and not one line; give a height map of the instrument")
    x, h = table["distance"], table[height]
    if "valid" in table:
        h = np.where(table["valid"] > 0, h, np.nan)
    step = (x[-1] - x[0]) / max(1, len(x) - 1)
    gaps = np.append(step, np.diff(x))
    table.require_rows(~(np.abs(gaps - step) < 0.2 * abs(step)), "distance", f"even steps, here of {abs(step):.4g} m")
    columns = [table.columns[name] for name in ("distance", height)]
    above = {} if any(c.stated for c in columns) else _units_above(file)
    if any(c.stated for c in columns) != all(c.stated for c in columns) or len(above) == 1:
        bare = next(c for c, axis in zip(columns, "xz", strict=True) if not c.stated and axis not in above)
        raise BadInput(
            f"{where}: no unit of {bare.name!r}, while the other column has one; name it {HEIGHT_COLUMN.usual}"
        )
    units = [c.unit if c.stated else above.get(axis, c.unit) for c, axis in zip(columns, "xz", strict=True)]
    factors = [1.0 if c.stated else LENGTH_UNITS_M[unit] for c, unit in zip(columns, units, strict=True)]
    notes = [f"{where}: {', '.join(f'{c.name!r} in {unit}' for c, unit in zip(columns, units, strict=True))}"]
    if not above and not columns[0].stated:
        notes = [f"{where}: unit of {c.name!r} not in the file, taken as {c.unit}" for c in columns]
    if stated and not (above or columns[0].stated):
        raise BadInput(f"{where}: no units of its columns; name them {DISTANCE_COLUMN.usual} and {HEIGHT_COLUMN.usual}")
    return LineScan(factors[1] * h, float(abs(factors[0] * step)), tuple(notes))


def _units_above(file: Path) -> dict[str, str]:
    """Units of x and z that the header states, as "X Units: mm, Z Units: um"."""
    text = _read_head(file).decode("utf-8", "replace").replace("µ", "u").replace("μ", "u")
    found = (m.groupdict() for m in UNIT_OF_AXIS.finditer(text))
    return {f["axis"].lower(): f["unit"] for f in found if f["unit"] in LENGTH_UNITS_M}


def _read_head(file: Path) -> bytes:
    """The first bytes of a file, which contain the header."""
    with file.open("rb") as opened:
        return opened.read(MAX_HEADER_BYTES)


def _is_bounded(file: Path) -> bool:
    """Whether a file and, in a text, its lines are short enough to be parsed."""
    try:
        data = safe_text.read_bounded_bytes(file, file.name)
        if b"\0" not in data[:MAX_HEADER_BYTES]:
            safe_text.split_bounded_lines(data.decode("latin-1"), file.name)
    except BadInput:
        return False
    return True


def _scan_of_library(file: Path, key: str) -> LineScan | None:
    """A line scan with units, read by SurfaceTopography, or None.  Raises BadInput for uneven steps."""
    if not _is_bounded(file):
        return None
    surface = load_topography_library()
    try:
        with suppress_library_warnings(), surface.open_topography(str(file)) as opened:
            if opened.default_channel.dim != 1 or opened.default_channel.unit is None:
                return None
            line = opened.topography().to_unit("m")
            x, h = map(_unmask_values, line.positions_and_heights())
    except Exception:  # readers raise many types of exception for damaged files
        return None
    step = (x[-1] - x[0]) / max(1, len(x) - 1)
    if not np.all(np.abs(np.diff(x) - step) < 0.2 * abs(step)):
        raise BadInput(
            f"{key}: {file.name}: steps along the line from {np.diff(x).min():.3g} to {np.diff(x).max():.3g} m;"
            " give a line with even steps"
        )
    return LineScan(
        h, float(abs(step)), (f"{key}: {file.name}: a line scan of {len(x)} points, read in its own units",)
    )


def _unmask_values(values: Value) -> np.ndarray:
    """Values with nan instead of masked ones."""
    return np.asarray(np.ma.filled(np.ma.asarray(values, float), np.nan))


def remove_spikes(heights: np.ndarray) -> np.ndarray:
    """Replace heights beyond ten robust standard deviations from the median by nan: dropouts, end plates.

    Raises BadInput where more than half of the heights are missing.
    """
    h = np.array(heights, dtype=float)
    _require_mostly_measured(h)
    away = np.abs(h - np.nanmedian(h))
    limit = SPIKE_SD * 1.4826 * np.nanmedian(away)
    return np.where(away > limit, np.nan, h) if limit > 0 else h


def spectrum_of_topography(heights: np.ndarray, pixel: Value, longest: float = np.inf) -> MeasuredSpectrum:
    """C(q) of heights (nx, ny) in m, nan where missing, `pixel` m (or one per axis), for waves up to `longest` m.

    The tilt is removed, a Hann window applied, and missing points are interpolated.  q extends from two waves over the
    field to the Nyquist wavenumber of the coarser axis.  Raises BadInput for too many missing points or flat heights.
    """
    h = np.asarray(heights, dtype=float)
    if h.ndim != 2 or min(h.shape) < 16:
        raise BadInput(f"topography: {' x '.join(map(str, h.shape))} heights; give 16 x 16 or more")
    size = tuple(n * d for n, d in zip(h.shape, np.broadcast_to(pixel, 2), strict=True))
    _require_mostly_measured(h)
    masked = np.ma.masked_invalid(h) if _has_missing_heights(h) else h
    road = load_topography_library().Topography(masked, size)
    if _has_missing_heights(h):
        road = load_topography_library().Topography(np.asarray(road.interpolate_undefined_data().heights()), size)
    q, C = road.detrend("height").power_spectrum_from_area(nb_points_per_decade=AREA_BINS_PER_DECADE)
    return _select_points(q, C / (4 * np.pi**2), min(longest, max(size) / 2), "topography")


def spectrum_of_profile(heights: np.ndarray, step: float, longest: float = np.inf) -> MeasuredSpectrum:
    """Isotropic C(q) of a line's heights (n,) in m, nan where missing, every `step` m, for waves up to `longest` m.

    Several lines (m, n) are averaged.  The road is assumed isotropic, with C decreasing with q.  q extends from two
    waves on the line to half the Nyquist wavenumber, above which lines are aliased.  Raises BadInput as
    `spectrum_of_topography` does.
    """
    k, S = _line_spectrum(heights, step)
    if len(k) < 3 or not np.all(S > 0):
        raise BadInput("profile: the heights are flat; give a rough surface")
    C = isotropic_spectrum(k, S)
    keep = k <= np.pi / step / 2
    return _select_points(k[keep], C[keep], min(longest, np.pi / k[0]), "profile")


def profile_height(heights: np.ndarray, step: float, longest: float = np.inf) -> float:
    """Rms height (m) of the line (n,) itself, from waves along it up to `longest` m."""
    scan = _prepare_line(heights, step)
    k, C = scan.power_spectrum_from_profile(resampling_method=None)
    keep = (k > 0) & (k >= 2 * np.pi / longest)
    return float(np.sqrt(np.sum(C[keep]) * (k[1] - k[0]) / np.pi))


def isotropic_spectrum(k: np.ndarray, S: np.ndarray) -> np.ndarray:
    """C (n,) in m^4 at k (1/m, increasing) from the two-sided spectrum S (n,) in m^3 of a line: Abel's inverse.

    Weighted isotonic regression makes S monotone, as for a decreasing C; a power law fitted to its last half decade
    extends it.
    """
    from scipy.interpolate import PchipInterpolator
    from scipy.optimize import isotonic_regression

    x, y = np.log(k), np.log(isotonic_regression(S, weights=k, increasing=False).x)
    curve = PchipInterpolator(x, y)
    upper = x >= x[-1] - 0.5 * np.log(10.0)
    beyond = float(np.clip(np.polyfit(x[upper], y[upper], 1)[0], -3.0, -1.05)) if upper.sum() > 1 else -2.0
    u = np.linspace(0.0, 10.0, 2001)  # k = q cosh u
    at = x[:, None] + np.log(np.cosh(u))
    inside = at < x[-1]
    clipped = np.minimum(at, x[-1])
    slope = np.where(inside, curve(clipped, 1), beyond)
    ln_S = curve(clipped) + beyond * (at - clipped)
    C: np.ndarray = np.trapezoid(-slope * np.exp(ln_S - at), u, axis=1) / np.pi
    return C


@dataclass(frozen=True)
class SpectrumSummary:
    """Summary of a spectrum: rms height (m) and rms slope between its ends q0, q1 (1/m), and its self-affine fit."""

    height: float
    slope: float
    q0: float
    q1: float
    law: SelfAffineLaw

    @classmethod
    def from_points(cls, points: MeasuredSpectrum) -> SpectrumSummary:
        """Summary of points over their whole range."""
        road = RoughnessSpectrum(points, *points.valid_range)
        return cls(road.rms_height, road.rms_slope(), *points.valid_range, fit_self_affine(points))

    @property
    def remarks(self) -> list[str]:
        """Remarks on implausible values: a Hurst exponent outside 0 to 1 or an rms slope above 10."""
        remarks = []
        if not 0.0 <= round(self.law.hurst, 2) <= 1.0:
            remarks.append(
                f"Hurst exponent {self.law.hurst:.2f}: a self-affine road has one from 0 to 1; "
                "is this noise, or are heights filtered?"
            )
        if not self.slope <= MAX_ROAD_RMS_SLOPE:
            remarks.append(f"rms slope {self.slope:.3g}: no road is so steep; are heights and their distance in m?")
        return remarks

    def as_dict(self) -> dict[str, Any]:
        """For --json: lengths and wavelengths in m, level in m^4."""
        waves = {"rolloff_m": self.law.rolloff, "longest_m": self.q0, "shortest_m": self.q1}
        return {
            "rms_height_m": self.height,
            "rms_slope": self.slope,
            "hurst": self.law.hurst,
            "level_m4": self.law.level,
            **{k: 2 * np.pi / q for k, q in waves.items()},
            "remarks": self.remarks,
        }

    def __str__(self) -> str:
        rolloff, longest, shortest = (2e3 * np.pi / q for q in (self.law.rolloff, self.q0, self.q1))
        text = (
            f"Power spectrum from {longest:.3g} to {shortest:.3g} mm wavelength: "
            f"rms height {1e3 * self.height:.3g} mm, rms slope {self.slope:.3g}\n"
            f"  self-affine below {rolloff:.3g} mm: Hurst exponent {self.law.hurst:.2f}, C0 {self.law.level:.3g} m^4"
        )
        return "\n".join([text, *(f"  remark: {remark}" for remark in self.remarks)])


def save_spectrum(points: MeasuredSpectrum, file: Path) -> None:
    """Write the CSV that `read_spectrum` reads."""
    rows = (f"{q:.9e},{C:.9e}\n" for q, C in zip(points.q, points.C, strict=True))
    with atomic_write(file) as fresh:
        fresh.write_text("q_1/m,C_m4\n" + "".join(rows), encoding="utf-8")


def fit_self_affine(points: MeasuredSpectrum, longest: float = np.inf, shortest: float = 0.0) -> SelfAffineLaw:
    """Least-squares fit of a self-affine law with roll-off to ln C between two wavelengths (m).

    Raises BadInput for fewer than four points between them.
    """
    q, C = np.array(points.q), np.array(points.C)
    keep = (2 * np.pi / q <= longest) & (2 * np.pi / q >= shortest)
    if keep.sum() < 4:
        raise BadInput(f"spectrum: {keep.sum()} points from {shortest:g} to {longest:g} m; give a wider range")
    x, y = np.log(q[keep]), np.log(C[keep])
    weight = 1 / (1 + LONG_WAVE_VARIANCE_RATIO * (q[0] / q[keep]) ** 2)  # a measurement contains few long waves
    best = (np.inf, 0.0, 0.0, 0.0)
    for start in [x[0], *np.linspace(x[0], x[-1], 200)[1:]]:
        bent = np.maximum(x - start, 0.0)
        if np.count_nonzero(bent) < max(3, len(x) // 4):
            break
        (slope, level), residual = _fit_line(bent, y, weight)
        best = min(best, (residual, start, slope, level))
    _, start, slope, level = best
    return SelfAffineLaw(float(np.exp(level)), float(np.exp(start)), float(-slope / 2 - 1))


def _fit_line(x: Value, y: Value, weight: Value) -> tuple[np.ndarray, float]:
    line = np.polyfit(x, y, 1, w=np.sqrt(weight))
    return line, float(np.sum(weight * (y - np.polyval(line, x)) ** 2))


def _line_spectrum(heights: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """k (1/m) and the two-sided spectrum S (m^3), mean over the lines."""
    lines = np.atleast_2d(np.asarray(heights, dtype=float))
    scans = [_prepare_line(h, step, cut=len(lines) == 1) for h in lines]
    spectra = [s.power_spectrum_from_profile(nb_points_per_decade=LINE_BINS_PER_DECADE) for s in scans]
    full = ~np.ma.getmaskarray(spectra[0][1])
    return np.asarray(spectra[0][0])[full], np.mean([np.asarray(C)[full] for _, C in spectra], axis=0) / (2 * np.pi)


def _prepare_line(heights: np.ndarray, step: float, cut: bool = True) -> Value:
    """A line without tilt; gaps are interpolated linearly, missing ends `cut` off or extended as constants."""
    h = np.asarray(heights, dtype=float)
    _require_mostly_measured(h)
    if _has_missing_heights(h):
        measured = np.flatnonzero(np.isfinite(h))
        span = (measured[0], measured[-1] + 1) if cut else (0, len(h))
        h = np.interp(np.arange(*span), measured, h[measured])
    if h.ndim != 1 or len(h) < 64:
        raise BadInput(f"profile: {len(h)} heights; give 64 or more")
    return load_topography_library().UniformLineScan(h, len(h) * step).detrend("height")


def _require_mostly_measured(h: np.ndarray) -> None:
    """Raise BadInput where more than half of the heights are missing."""
    missing = np.mean(~np.isfinite(h)) if h.size else 1.0
    if missing > MAX_MISSING_FRACTION:
        raise BadInput(f"heights: {100 * missing:.0f} % are missing; give a measurement with half of them or more")


def _has_missing_heights(h: np.ndarray) -> bool:
    """Whether heights are missing."""
    return not np.isfinite(h).all()


def _select_points(q: Value, C: Value, longest: float, where: str) -> MeasuredSpectrum:
    q, C = np.ma.filled(np.ma.masked_where(np.ma.getmaskarray(C), q), np.nan), np.ma.filled(C, np.nan)
    keep = (q >= (1 - 1e-9) * 2 * np.pi / longest) & np.isfinite(C)
    if keep.sum() < 3:
        raise BadInput(f"{where}: fewer than 3 wavenumbers are left; give more heights, or longer waves")
    if not np.all(C[keep] > 0):
        raise BadInput(f"{where}: the heights are flat; give a rough surface")
    return _check_rms_height(q[keep], C[keep], where)


def _check_rms_height(q: Value, C: Value, where: str) -> MeasuredSpectrum:
    """The points as a spectrum, checked for a plausible rms height.  Raises BadInput."""
    points = MeasuredSpectrum(tuple(map(float, q)), tuple(map(float, C)))
    height = RoughnessSpectrum(points, *points.valid_range).rms_height
    if not RMS_HEIGHT_RANGE_M[0] <= height <= RMS_HEIGHT_RANGE_M[1]:
        raise BadInput(
            f"{where}: rms height {height:.3g} m; give one from 1e-9 to 0.1 m: is q in 1/m and C in m^4 "
            "(heights in m)? say so in a units line"
        )
    return points
