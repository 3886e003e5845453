"""Skewed roads: contact area of a Gaussian road whose heights above the mean plane are multiplied by f < 1.

Worn tops cause negative skewness.  ContactMechanics (extra `topography`) solves the contact: a smooth elastic
half-space on the road, hard wall, periodic.  As long as only tops touch, the road acts as one with f times the heights:
A(p) of the skewed road is exactly A(p/f) of the Gaussian road, and the area grows by R = 1/f.  At higher pressure the
unchanged surface below the mean plane is also reached and R falls to 1: A(p) bends earlier.

The effect of R on viscoelastic friction is an argument, not a theorem.  Where tops touch, C becomes f^2 C and P becomes
P/f, so that mu_visc ~ int q^3 C P dq is multiplied by f = 1/R.  Hence `viscous` = -1; the adhesive part is proportional
to the area.

>>> print(f"{skewness_of_scale(0.8):.6f} {scale_of_skewness(-0.7595):.4f}")
-0.264479 0.5000
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, least_squares

from flashtemp.errors import BadInput
from flashtemp.physics.arrays import Value
from flashtemp.physics.friction.elastic_contact import solve_contact_area
from flashtemp.physics.friction.persson import AreaEnlargement
from flashtemp.physics.friction.roughness_spectrum import READY_ROADS, RoughnessSpectrum

GRID_POINTS = 256  # points along a side
DEFAULT_SEEDS = (0, 1, 2)
SIDE_WAVELENGTHS = 2.0  # side of the square in wavelengths 2 pi/q0
MIN_WAVE_PIXELS = 4.0  # pixels per shortest wavelength
SOLVED_LOADS = 6  # pressures at which the contact is solved
LOAD_POWER_RANGE = (0.3, 3.0)  # bounds of the exponent of the load in the fit


def _unit_moments(f: float) -> tuple[float, float]:
    """Mean and variance of a unit Gaussian whose positive part is multiplied by f."""
    mean = (f - 1.0) / np.sqrt(2 * np.pi)
    return mean, 0.5 * (1.0 + f * f) - mean**2


def skewness_of_scale(f: float) -> float:
    """Skewness <(h - <h>)^3>/rms^3 of Gaussian heights with those above the mean plane multiplied by f >= 0.

    From the raw moments of the two half Gaussians; claim C5.
    """
    mean, variance = _unit_moments(f)
    third = 2.0 * (f**3 - 1.0) / np.sqrt(2 * np.pi)
    return float((third - 3.0 * mean * (variance + mean**2) + 2.0 * mean**3) / variance**1.5)


def scale_of_skewness(skew: float) -> float:
    """The factor f in ]0, 1] that gives a skewness.  Raises BadInput where there is none."""
    lowest = skewness_of_scale(0.0)
    if not lowest < skew <= 0.0:
        raise BadInput(f"skewness: {skew:g}; give a value from {lowest:.3g} (tops cut off) to 0 (Gaussian)")
    return float(brentq(lambda f: skewness_of_scale(f) - skew, 0.0, 1.0, xtol=1e-14))


REFERENCE_SCALES = {
    "unscaled": lambda f: 1.0,
    "slope": lambda f: float(np.sqrt(0.5 * (1.0 + f * f))),
    "height": lambda f: float(np.sqrt(_unit_moments(f)[1])),
}


@dataclass(frozen=True)
class AreaRatio:
    """R = A_skewed/A_reference at loads p/E* (n): `each` (seeds, n) as solved, `areas` the mean A/A0 of both (2, n).

    The fit ln R = top + (end - top) x/(1 + x), x = (load/bend)^power, begins at `top` = ln(g/f), where g is the factor
    on the heights of the reference.  That value is exact where only tops touch and A ~ p.
    """

    load: np.ndarray
    each: np.ndarray
    areas: np.ndarray
    top: float
    end: float
    bend: float
    power: float

    def __call__(self, load: Value) -> Value:
        """Fitted R at loads p/E*; it decreases with load."""
        x = (np.asarray(load) / self.bend) ** self.power
        return np.exp(self.top + (self.end - self.top) * x / (1.0 + x))

    @property
    def relative_sd(self) -> np.ndarray:
        """Relative standard deviation (n,) of one seed about the fit."""
        sd: np.ndarray = np.sqrt(np.mean((self.each / self(self.load) - 1.0) ** 2, axis=0))
        return sd


def solve_areas(
    f: float,
    loads: Value,
    grid: int = GRID_POINTS,
    seeds: Sequence[int] = DEFAULT_SEEDS,
    road: RoughnessSpectrum = READY_ROADS["asphalt A"],
    scale_below: float = 1.0,
) -> np.ndarray:
    """A/A0 (seeds, n) of skewed roads at nominal pressures over contact modulus p/E* (n), E* = E/(1 - nu^2).

    Heights above the mean plane are multiplied by f, those below it by `scale_below`.  The square of `grid`^2 points is
    two wavelengths 2 pi/q0 of the `road` wide and contains waves down to four pixels: compare areas of one grid only.
    Raises BadInput for f outside ]0, 1], loads that are not positive, a grid below 32, or where no contact is found.
    """
    loads = _check_inputs(f, loads, grid, seeds)
    areas = np.empty((len(seeds), len(loads)))
    for i, seed in enumerate(seeds):
        heights, side = gaussian_heights(road, grid, seed)
        heights = np.where(heights > 0.0, f, scale_below) * heights
        areas[i] = [solve_contact_area(heights, (side, side), 1.0, load).mean() for load in loads]
    return areas


def gaussian_heights(road: RoughnessSpectrum, grid: int, seed: int) -> tuple[np.ndarray, float]:
    """Heights (grid, grid) m about a mean of zero with the spectrum of a road, and the side of the square, m."""
    side = SIDE_WAVELENGTHS * 2 * np.pi / road.q0
    along = 2 * np.pi * np.fft.fftfreq(grid, side / grid)
    q = np.hypot(along[:, None], along[: grid // 2 + 1])
    in_band = (q >= road.q0 * (1 - 1e-9)) & (q <= min(road.q1, 2 * np.pi * grid / (MIN_WAVE_PIXELS * side)))
    C = np.where(in_band, road(np.maximum(q, road.q0)), 0.0)
    noise = np.fft.rfft2(np.random.default_rng(seed).standard_normal((grid, grid)))
    return np.fft.irfft2(noise * np.sqrt(C) * 2 * np.pi * grid / side, s=(grid, grid)), side


def solve_area_ratio(
    f: float,
    loads: Value,
    grid: int = GRID_POINTS,
    seeds: Sequence[int] = DEFAULT_SEEDS,
    road: RoughnessSpectrum = READY_ROADS["asphalt A"],
    against: str = "unscaled",
) -> AreaRatio:
    """Ratio of the contact areas of a skewed and a Gaussian road at loads p/E* (n), with its fit.

    `against`: "unscaled", the road before its tops were lowered; "slope" or "height", a Gaussian road of the skewed
    road's rms slope or rms height.  Raises BadInput as `solve_areas` does, and for any other word.
    """
    if against not in REFERENCE_SCALES:
        raise BadInput(f"against: {against}; give one of {', '.join(REFERENCE_SCALES)}")
    loads = _check_inputs(f, loads, grid, seeds)
    g = REFERENCE_SCALES[against](f)
    worn = solve_areas(f, loads, grid, seeds, road)
    plain = solve_areas(1.0, loads / g, grid, seeds, road)  # heights times g need p/E* times g for the same area
    each = worn / plain
    means = np.array([worn.mean(axis=0), plain.mean(axis=0)])
    return AreaRatio(loads, each, means, *_fit_ratio(loads, np.log(each).mean(axis=0), f, g))


def _fit_ratio(loads: Value, logs: Value, f: float, g: float) -> tuple[float, float, float, float]:
    """`top`, `end`, `bend` and `power` of `AreaRatio`: R lies between g, because A is concave in p, and g/f."""
    top = float(np.log(g / f))

    def ln_ratio(x: Value) -> Value:
        part = np.exp(x[1] * (np.log(loads) - x[0]))
        return top + (x[2] * np.log(g) - top) * part / (1.0 + part)

    bounds = ([np.log(1e-4), LOAD_POWER_RANGE[0], 0.0], [np.log(1e2), LOAD_POWER_RANGE[1], 1.0])
    found = least_squares(lambda x: ln_ratio(x) - logs, [np.log(0.1), 1.0, 0.5], bounds=bounds).x
    return top, float(found[2] * np.log(g)), float(np.exp(found[0])), float(found[1])


def skewness_enlargement(
    f: float,
    modulus: float,
    pressures: Sequence[float],
    grid: int = GRID_POINTS,
    seeds: Sequence[int] = DEFAULT_SEEDS,
    road: RoughnessSpectrum = READY_ROADS["asphalt A"],
    against: str = "unscaled",
    viscous: float = -1.0,
) -> AreaEnlargement:
    """Effect of lowering the tops of a road by f on the contact area at increasing nominal `pressures` (Pa).

    `modulus` E/(1 - nu^2) in Pa is the rubber's at the frequency q0 v of the macroasperities, which determine the
    penetration.  Contact is solved at six pressures over the range and fitted: at 256^2 points one seed is within 3 %
    of the fit.  With finer waves R falls at higher loads: for f = 0.6 and p/E* = 0.1 it is 1.25, 1.32, 1.38 with waves
    down to 1.6, 0.8 (the default), 0.4 mm.
    Raises BadInput as `solve_area_ratio` does.
    """
    p = np.asarray(pressures, dtype=float)
    if not modulus > 0 or p.ndim != 1 or p.size == 0 or not np.all(p > 0) or np.any(np.diff(p) <= 0):
        raise BadInput(f"skewed: modulus {modulus:g}, pressures {p.tolist()}; give positive ones in Pa, increasing")
    loads = np.geomspace(p[0], p[-1], SOLVED_LOADS if len(p) > 1 else 1) / modulus
    ratio = solve_area_ratio(f, loads, grid, seeds, road, against)
    return AreaEnlargement(tuple(p.tolist()), tuple(ratio(p / modulus).tolist()), viscous)


def _check_inputs(f: float, loads: Value, grid: int, seeds: Value) -> np.ndarray:
    loads = np.asarray(loads, dtype=float)
    if not 0.0 < f <= 1.0:
        raise BadInput(f"f: {f:g}; give a factor on the heights above the mean plane, 0 < f <= 1")
    if loads.ndim != 1 or loads.size == 0 or not np.all(loads > 0) or not np.all(np.isfinite(loads)):
        raise BadInput(f"loads: {loads.tolist()}; give pressures over modulus > 0")
    if grid < 32 or len(seeds) == 0:
        raise BadInput(f"grid: {grid} points a side, {len(seeds)} seeds; give at least 32 points and one seed")
    checked: np.ndarray = loads
    return checked
