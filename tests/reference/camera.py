"""An infrared camera by quadrature: Planck's law over its band, optics on a fine grid, pixels summed point by point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter, map_coordinates, spline_filter

ZERO = 273.15
FINE, POINTS = 6, 4  # fine places per pixel, and points per pixel and direction at which it is summed
_grid_degC = np.linspace(-40.0, 400.0, 1761)
_grid_um = np.linspace(8.0, 14.0, 121)
_grid_radiance = np.trapezoid(
    _grid_um**-5 / np.expm1(14387.77 / (_grid_um * (_grid_degC[:, None] + ZERO))), _grid_um, axis=1
)
band_radiance, radiance_temperature = (
    CubicSpline(_grid_degC, _grid_radiance),
    CubicSpline(_grid_radiance, _grid_degC),
)  # of a black body, 8 to 14 um


@dataclass(frozen=True)
class Geometry:
    """How an image lies wrong: shift along u and v (px), pixels `larger` than told, turned (rad), left for right.

    What does not move as an image turns or grows is `fixed`: shares of its extent, (0.5, 0.5) its middle.
    """

    shift: tuple[float, float] = (0.0, 0.0)
    larger: float = 0.0
    turned: float = 0.0
    mirrored: bool = False
    fixed: tuple[float, float] = (0.5, 0.5)

    def find_true_places(self, u, v, pitch):
        """Where points of the image (m as told) really lie; it is mirrored about its middle."""
        about = [a.min() + share * np.ptp(a) for a, share in zip((u, v), self.fixed, strict=True)]
        a, b = (u.min() + u.max() - u if self.mirrored else u) - about[0], v - about[1]
        c, s = np.cos(self.turned), np.sin(self.turned)
        x = about[0] + (1.0 + self.larger) * (c * a - s * b) + self.shift[0] * pitch
        return x, about[1] + (1.0 + self.larger) * (s * a + c * b) + self.shift[1] * pitch


@dataclass(frozen=True)
class Optics:
    """What a camera is: width of its point spread (px), true emissivity, smooth `gain` (nv, nu), and what it is told."""

    psf: float = 0.7
    emissivity: float = 0.95
    stated_emissivity: float = 0.95
    reflected: float = 20.0
    gain: np.ndarray | float = 1.0


def simulate_image(field, box, air, u, v, optics, geometry):
    """Image (nv, nu) degC of `field(x, z)` -> (z, x) degC within `box` ((x0, x1), (z0, z1)) m, `air` degC outside.

    Places are averaged as light; the camera turns light back with the emissivity it was told.
    """
    pitch = u[1] - u[0]
    step, margin = pitch / FINE, 6.0 * pitch
    x = np.arange(u[0] - margin, u[-1] + margin, step)
    z = np.arange(v[0] - margin, v[-1] + margin, step)
    scene = np.full((len(z), len(x)), float(band_radiance(air)))
    i, j = ((a > lo - 0.5 * step) & (a < hi + 0.5 * step) for a, (lo, hi) in zip((x, z), box, strict=True))
    inside = [np.clip(a[own], lo, hi) for a, own, (lo, hi) in zip((x, z), (i, j), box, strict=True)]
    part = [np.minimum(a[own] + 0.5 * step, hi) - np.maximum(a[own] - 0.5 * step, lo)
            for a, own, (lo, hi) in zip((x, z), (i, j), box, strict=True)]  # fmt: skip
    share = np.outer(part[1], part[0]) / step**2  # a fine place on the edge is block in part
    scene[np.ix_(j, i)] += share * (band_radiance(field(*inside)) - band_radiance(air))
    scene = spline_filter(gaussian_filter(scene, optics.psf * FINE, truncate=6.0), mode="mirror")
    nodes, weights = np.polynomial.legendre.leggauss(POINTS)
    total = np.zeros((len(v), len(u)))
    for du, wu in zip(nodes, weights, strict=True):
        for dv, wv in zip(nodes, weights, strict=True):
            U, V = np.meshgrid(u + 0.5 * du * pitch, v + 0.5 * dv * pitch)
            X, Z = geometry.find_true_places(U, V, pitch)
            at = [(Z - z[0]) / step, (X - x[0]) / step]
            total += 0.25 * wu * wv * map_coordinates(scene, at, order=3, mode="mirror", prefilter=False)
    emissivity = optics.emissivity * optics.gain
    seen = emissivity * total + (1.0 - emissivity) * band_radiance(optics.reflected)
    return radiance_temperature(
        (seen - (1.0 - optics.stated_emissivity) * band_radiance(optics.reflected)) / optics.stated_emissivity
    )
