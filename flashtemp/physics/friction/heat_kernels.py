"""Memory kernels of flash temperature (Level K): effect of earlier friction heat on the temperature of a wavenumber.

The temperature for wavenumber q is T_q = int 2q exp(-2qz) T dz; heat of wavenumber q' decays as exp(-2q'z).  In a
half-space

    T_q(t) = T_b + int dt' h(w) int dq' Q'(q', t') K(2q, 2q', D(t - t'))/(rho c),    w = |s(t) - s(t')|/D_spot

with K(a, b, D tau) = ab/(b^2 - a^2) [b erfcx(a sqrt(D tau)) - a erfcx(b sqrt(D tau))] (theory.md, eq. (14); V4).

>>> age = 0.01 * 0.25 / (1200 * 1700)
>>> print(f"{heat_kernel(2e4, 2e4, age):.4f} {heat_kernel(2e4, 2e5, age):.4f}")
8003.3472 10462.5656
>>> round(float(disc_overlap(0.0)), 9), round(overlap_integral(1.0), 6)
(1.0, 1.220416)
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.special import erfcx, ive

from flashtemp.physics.arrays import Value

FULL_OVERLAP_INTEGRAL = 1.2204156216029  # (8/(3 sqrt pi)) Gamma(7/4)/Gamma(9/4)
ROOT_PI = np.sqrt(np.pi)


def disc_overlap(w: Value) -> Value:
    """h(w): overlap of two equal discs displaced by w diameters, over their area."""
    w = np.clip(w, 0.0, 1.0)
    return 1.0 - (2.0 / np.pi) * (w * np.sqrt(1.0 - w * w) + np.arcsin(w))


@cache
def _overlap_spline() -> CubicSpline:
    s = np.linspace(0.0, 1.0, 201)  # s = sqrt(w) removes the square-root start
    nodes, weights = np.polynomial.legendre.leggauss(8)
    half = 0.5 * np.diff(s)
    mid = 0.5 * (s[1:] + s[:-1])
    parts = sum(w * 2 * disc_overlap((mid + half * n) ** 2) for n, w in zip(nodes, weights, strict=True)) * half
    return CubicSpline(s, np.concatenate([[0.0], np.cumsum(parts)]))


def overlap_integral(r: Value) -> Value:
    """Integral of w^-1/2 h(w) from 0 to r (slid distance over spot diameter); theory.md, eq. (13b), V10."""
    return float(_overlap_spline()(np.sqrt(min(max(r, 0.0), 1.0))))


@cache
def _flash_spline() -> CubicSpline:
    nodes, weights = np.polynomial.legendre.leggauss(120)
    s = 0.5 * (nodes + 1)  # w = s^2
    logs = np.linspace(-5.0, 5.0, 801)
    kappa = 10.0 ** logs[:, None]
    integral = 0.5 * np.sum(weights * 2 * s * disc_overlap(s * s) * erfcx(kappa * s), axis=1)
    return CubicSpline(logs, kappa[:, 0] * integral * ROOT_PI / FULL_OVERLAP_INTEGRAL)


def flash_response(kappa: Value, r: float = 1.0) -> Value:
    """Flash temperature relative to that of a surface flux at the surface, eq. (13): kappa = sqrt(D t_spot)/depth.

    It is that of a source decaying over `depth`, at the surface, or that of a surface flux, for wavenumber
    1/(2 depth).  Before a spot has slid its diameter, for a slid ratio `r` < 1, both integrals end at r (V10): heat in
    depth warms the surface in proportion to time at first, a flux in proportion to the root of time.

    >>> round(float(flash_response(0.3, 1e-6) / (0.5 * np.sqrt(np.pi) * 0.3 * 1e-3)), 3)  # kappa sqrt(pi r)/2
    1.0
    """
    if r >= 1.0:
        return _flash_spline()(np.log10(np.clip(kappa, 1e-5, 1e5)))
    if r <= 0.0:
        return 0.0 * kappa
    u, weights = _unit_quadrature()
    s = np.sqrt(r) * u**3  # denser nodes near 0, where erfcx is steep for shallow sources
    change = 3.0 * np.sqrt(r) * u**2 * weights
    integral = np.sum(change * 2.0 * s * disc_overlap(s * s) * erfcx(np.multiply.outer(kappa, s)), axis=-1)
    return kappa * integral * ROOT_PI / overlap_integral(r)


@cache
def _unit_quadrature() -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes and weights (40,) of the interval 0 to 1."""
    nodes, weights = np.polynomial.legendre.leggauss(40)
    return 0.5 * (nodes + 1.0), 0.5 * weights


def retained_fraction(tau: Value, diameter: float, diffusivity: Value) -> Value:
    """R(tau): fraction of heat still under a disc of `diameter` (m) after tau (s); theory.md, eq. (15b)."""
    X = (diameter / 2) ** 2 / (2 * diffusivity * np.asarray(tau, dtype=float))
    near = np.minimum(X, 1e6)  # asymptote beyond, where the Bessel functions lose accuracy
    return np.where(X > 1e6, 1.0 - np.sqrt(2.0 / (np.pi * X)), 1.0 - ive(0, near) - ive(1, near))


def heat_kernel(a: Value, b: Value, age: Value) -> Value:
    """K (1/m) for decay rates a = 2q of the temperature and b = 2q' of the source (1/m); `age` is D (t - t'), m^2."""
    s = np.sqrt(age)
    if np.ndim(a) == 0 and a == b:
        return _equal_rates_kernel(a, a * s)
    return a * b / (b * b - a * a) * (b * erfcx(a * s) - a * erfcx(b * s))


def _equal_rates_kernel(a: Value, y: Value) -> Value:
    """K of equal rates a at y = a sqrt(age); asymptotic for large y, where the closed form cancels."""
    near = np.minimum(y, 20.0)
    closed = 0.5 * a * ((1.0 - 2.0 * near * near) * erfcx(near) + 2.0 * near / ROOT_PI)
    far = np.maximum(y, 20.0)
    return np.where(y > 20.0, a * (1.0 - 1.0 / far**2 + 2.25 / far**4) / (ROOT_PI * far), closed)


def _mean_step_response(y: Value) -> Value:
    """(erfcx y - 1 + 2y/sqrt pi)/y^2: time-mean response to a steady source; a series near y = 0."""
    y = np.asarray(y, dtype=float)
    safe = np.where(y > 0.02, y, 1.0)
    series = 1.0 - 4.0 * y / (3 * ROOT_PI) + y**2 / 2 - 8.0 * y**3 / (15 * ROOT_PI) + y**4 / 6
    return np.where(y > 0.02, (erfcx(safe) - 1.0 + 2.0 * safe / ROOT_PI) / safe**2, series)


def step_response(a: float, b: float, diffusivity: float, t: float) -> float:
    """int_0^t K dt' in s/m: times Q/(rho c) the increase of T_q by a steady source of Q W/m2 (V4).

    A closed-form reference for tests; the model does not use it.
    """
    s = np.sqrt(diffusivity * t)
    if a == b:
        return float(0.5 * a * t * (3.0 * _mean_step_response(a * s) - 2.0 * erfcx(a * s)))
    return float(a * b / (b * b - a * a) * t * (b * _mean_step_response(a * s) - a * _mean_step_response(b * s)))


@dataclass(frozen=True)
class HeatMemory:
    """Response of the half-space between all wavenumbers q (n,) 1/m; `capacity` rho c in J/m3K, `diffusivity` m2/s.

    K(2q, 2q') separates into products of functions of one wavenumber each.  A history of N steps therefore costs N n
    operations and one matrix product, instead of N n^2.
    """

    q: np.ndarray
    capacity: float
    diffusivity: float

    @cached_property
    def _kernel_factors(self) -> Value:
        a = 2.0 * self.q
        gap = a[None, :] ** 2 - a[:, None] ** 2
        np.fill_diagonal(gap, np.inf)
        return a[:, None] * a[None, :] ** 2 / gap, a[:, None] ** 2 * a[None, :] / gap

    def spread_heat(self, heat: np.ndarray) -> np.ndarray:
        """The first of the two products for a heat (n,) W/m2 per node, to be stored with the heat."""
        spread: np.ndarray = self._kernel_factors[0] @ heat
        return spread

    def age_weights(self, age: Value) -> tuple[np.ndarray, np.ndarray]:
        """int_0^age of the kernel's factors off the diagonal and on it (..., n), s and s/m."""
        age = np.asarray(age, dtype=float)[..., None]
        a = 2.0 * self.q
        y = a * np.sqrt(self.diffusivity * age)
        f = _mean_step_response(y)
        return age * f, 0.5 * a * age * (3.0 * f - 2.0 * erfcx(y))

    @property
    def effusivity(self) -> float:
        """e = rho c sqrt(D) in W s^0.5/(m2 K)."""
        return float(self.capacity * np.sqrt(self.diffusivity))

    def surface_weights(self, off: Value) -> np.ndarray:
        """K m2/W: response of T_q to a surface flux, and of the surface to heat of q; `off` of `age_weights`."""
        weights: np.ndarray = 2.0 * self.q * off / self.capacity
        return weights

    def temperature_rise(self, off: Value, on: Value, heat: Value, spread: Value) -> np.ndarray:
        """T_q - T_b (n,) K by heats (m, n) with weights `off`, `on` (m, n) from `age_weights`; eq. (14)."""
        mixed = np.sum(off * spread, axis=0) - self._kernel_factors[1] @ np.sum(off * heat, axis=0)
        rise: np.ndarray = (mixed + np.sum(on * heat, axis=0)) / self.capacity
        return rise

    def steady_weights(self, residence: float) -> tuple[np.ndarray, np.ndarray]:
        """Weights (1, n) of a steady heat while a spot passes in `residence` s."""
        nodes, weights = np.polynomial.legendre.leggauss(8)
        edges = np.linspace(0.0, 1.0, 33)
        half = 0.5 * np.diff(edges)[:, None]
        u = (0.5 * (edges[1:] + edges[:-1])[:, None] + half * nodes).ravel()  # age = residence u^3
        h = ((half * weights).ravel() * 3 * u**2 * residence * disc_overlap(u**3))[:, None]
        y = 2.0 * self.q * np.sqrt(self.diffusivity * residence * u**3)[:, None]
        return np.sum(h * erfcx(y), axis=0)[None], np.sum(h * _equal_rates_kernel(self.q * 2.0, y), axis=0)[None]
