"""Contact map of a road from its topography: the macroasperity regions in contact under a load.

SurfaceTopography reads or generates the heights, ContactMechanics solves the contact (extra `topography`): a smooth
elastic half-space on the road, hard wall, periodic.  Asperities shorter than `cutoff` are filtered out first: the
contact area decreases without limit as finer ones are resolved, so a map has a meaning only with that length.
"""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.display import DisplayMixin, atomic_write
from flashtemp.errors import BadInput
from flashtemp.physics.arrays import Value
from flashtemp.physics.friction.elastic_contact import load_topography_library, solve_contact_area
from flashtemp.physics.friction.spot_patterns import ContactMap

MAX_HEIGHT_OVER_SIDE = 0.3  # rms height over the shorter side above which the heights cannot be in m


@dataclass(frozen=True, repr=False)
class SolvedContactMap(DisplayMixin):
    """A contact map with its nominal `pressure` (Pa) and its statistics.

    `fraction` covered, `number` of regions, `diameter` (m) of a disc with their area-weighted mean area.
    """

    ground: ContactMap
    pressure: float
    cutoff: float
    rms_height: float
    fraction: float
    number: int
    diameter: float

    def save(self, file: Path) -> None:
        """Write the .npz file that `spot_patterns.read_contact_map` reads."""
        about = {k: getattr(self, k) for k in ("pressure", "cutoff", "rms_height", "fraction", "number", "diameter")}
        with atomic_write(Path(file)) as fresh, fresh.open("wb") as out:
            np.savez_compressed(out, covered=self.ground.covered.astype(np.uint8), pixel_m=self.ground.pixel, **about)

    def as_dict(self) -> dict[str, Any]:
        """For --json."""
        size = [n * d for n, d in zip(self.ground.covered.shape, self.ground.pixel, strict=True)]
        names = ("pressure", "cutoff", "rms_height", "fraction", "number", "diameter")
        return {k: getattr(self, k) for k in names} | {"size_m": size, "pixel_m": list(self.ground.pixel)}

    def __str__(self) -> str:
        (nx, ny), (dx, dy) = self.ground.covered.shape, self.ground.pixel
        return (
            f"Contact map {1e3 * nx * dx:.3g} x {1e3 * ny * dy:.3g} mm, {nx} x {ny} pixels, rms height "
            f"{1e6 * self.rms_height:.3g} um, asperities longer than {1e3 * self.cutoff:.3g} mm\n"
            f"  at {self.pressure:.3g} Pa: {self.number} regions cover {100 * self.fraction:.2g} %, "
            f"about {1e3 * self.diameter:.2g} mm across (area-weighted)\n"
            f"  contact.spot_fraction={self.fraction:.3g} contact.spot_diameter={self.diameter:.2g}"
        )


def read_height_map(file: Path, size: tuple[float, float] | None = None) -> Value:
    """Read a topography in m from any file format of SurfaceTopography.  Raises BadInput.

    `size` (m): length along the direction of sliding and width, for files that hold heights alone.
    """
    surface = load_topography_library()
    try:
        with surface.open_topography(str(file)) as opened:
            channel = opened.default_channel
            stated_size, unit, area = channel.physical_sizes, channel.unit, channel.dim == 2
    except Exception as fault:  # readers raise many types of exception for damaged files
        raise BadInput(_describe_unreadable(file, fault)) from fault
    if not area:
        raise BadInput(f"{file}: a line, not an area; give a height map")
    if stated_size is None and size is None:
        raise BadInput(f"{file}: heights without the size of their area; give --length and --width, m")
    if stated_size is not None and size is not None:
        raise BadInput(f"--length, --width: {file} states its own size; leave them out")
    try:
        options = {}
        if stated_size is None and size is not None:
            options["physical_sizes"] = size if unit is None else tuple(s / _unit_length_m(unit) for s in size)
        road = surface.read_topography(str(file), **options)
        road = (road.to_unit("m") if road.unit else road).detrend("height")
        rms = road.rms_height_from_area()
    except Exception as fault:
        raise BadInput(_describe_unreadable(file, fault)) from fault
    if not unit and rms > MAX_HEIGHT_OVER_SIDE * min(road.physical_sizes):
        raise BadInput(f"{file}: heights of {rms:.3g} m rms on {min(road.physical_sizes):.3g} m; give heights in m")
    return road


def _describe_unreadable(file: Value, fault: Value) -> str:
    why = textwrap.shorten(str(fault), 120, placeholder=" ...")
    remedy = "give a height map of an instrument, a text matrix of heights in m, or --synthetic"
    return f"{file}: no topography: {why}; {remedy}"


def _unit_length_m(unit: str) -> float:
    """Length of a unit in m."""
    from SurfaceTopography.Support.UnitConversion import get_unit_conversion_factor

    factor: float = get_unit_conversion_factor(unit, "m")
    return factor


def generate_topography(
    length: float, width: float, pixel: float, hurst: float, rms: float, rolloff: float, seed: int
) -> Value:
    """A self-affine topography of Hurst exponent `hurst`: rms height `rms`, flat above the wavelength `rolloff` (m)."""
    shape = tuple(max(16, round(side / pixel)) for side in (length, width))
    return load_topography_library().Generation.fourier_synthesis(
        shape, (length, width), hurst=hurst, rms_height=rms, long_cutoff=rolloff, rng=np.random.default_rng(seed)
    )


def solve_contact_map(topography: Value, pressure: float, modulus: float, cutoff: float) -> SolvedContactMap:
    """Where rubber of contact `modulus` E/(1 - nu^2) (Pa) touches the road under a nominal `pressure` (Pa).

    Asperities shorter than `cutoff` (m) are left out.  Raises BadInput where nothing is left or the solve fails.
    """
    from scipy.ndimage import label

    size, shape = topography.physical_sizes, topography.nb_grid_pts
    pixel = tuple(s / n for s, n in zip(size, shape, strict=True))
    if cutoff < 2 * max(pixel):
        raise BadInput(f"--cutoff: {cutoff:g} m is less than two pixels of {max(pixel):.3g} m; give a longer one")
    heights = _filter_heights(np.ma.filled(np.ma.asarray(topography.heights()).astype(float), np.nan), pixel, cutoff)
    covered = solve_contact_area(heights, size, modulus, pressure)
    regions, number = label(covered)
    areas = np.bincount(regions.ravel())[1:] * pixel[0] * pixel[1]
    diameter = float(np.sqrt(4 / np.pi * np.sum(areas**2) / np.sum(areas)))
    rms = float(heights.std())
    return SolvedContactMap(
        ContactMap(covered.astype(float), pixel), pressure, cutoff, rms, float(covered.mean()), number, diameter
    )


def _filter_heights(heights: np.ndarray, pixel: Value, cutoff: float) -> np.ndarray:
    """Heights without wavelengths shorter than `cutoff`; missing points at the mean."""
    heights = np.where(np.isfinite(heights), heights, np.nanmean(heights))
    q = np.hypot(
        *np.meshgrid(*(np.fft.fftfreq(n, d) for n, d in zip(heights.shape, pixel, strict=True)), indexing="ij")
    )
    return np.fft.ifft2(np.where(q * cutoff <= 1.0, np.fft.fft2(heights), 0.0)).real
