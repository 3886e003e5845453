"""Persson's contact and friction theory: G(q), contact area P(q), friction and the depth of its heat; eqs. (16), (17).

>>> from flashtemp.physics.friction import rheology, roughness_spectrum
>>> theory = PerssonTheory(rheology.READY_RUBBERS["A"], roughness_spectrum.READY_ROADS["asphalt A"])
>>> result = theory(0.1, 293.15, 1.5e5)
>>> print(f"{result.G_at_q1:.2f} {result.area:.6e} {result.viscous:.6f}")
27503.09 3.401990e-03 0.428219
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.special import erf, erfinv

from flashtemp.errors import BadInput, SolverFailure
from flashtemp.physics.arrays import Value
from flashtemp.physics.friction.adhesive_shear import AdhesiveShear
from flashtemp.physics.friction.rheology import Rubber
from flashtemp.physics.friction.roughness_spectrum import RoughnessSpectrum

GAUSS_POINTS_PER_PANEL = 8  # Gauss points per panel of q
MAX_SOFTENING_ITERATIONS = 400  # fixed-point iteration of the softening with strain
ANGLE_POINTS = 64  # Gauss points from 0 to pi/2
LN_FREQUENCY_GRID = np.log(10.0) * np.arange(-14.0, 19.0, 0.05)  # of q v a_T in rad/s


@dataclass(frozen=True)
class PayneSoftening:
    """Softening of filled rubber with strain e: factors on storage and loss modulus at small strain (Kraus 1984).

    With x = (e/e_c)^m storage falls as rest + (1 - rest)/(1 + x^2): `rest` is what remains at large strain, `strain`
    e_c where half of the decrease is reached, `power` m.  Loss falls by the same factor where `loss_peak` is None, else
    it follows loss_rest + (1 - loss_rest)/(1 + x^2) + 2 (loss_peak - (1 + loss_rest)/2) x/(1 + x^2): 1 at small
    strain, `loss_peak` at e_c, `loss_rest` at large strain.  With loss_rest = 1 that is Kraus' own law, largest at e_c.
    Raises BadInput for a `loss_peak` below (1 + loss_rest)/2, where the term of Kraus would be negative.
    """

    rest: float = 0.4
    strain: float = 0.05
    power: float = 0.6
    loss_peak: float | None = None
    loss_rest: float = 1.0

    def __post_init__(self) -> None:
        lowest = 0.5 * (1.0 + self.loss_rest)
        if self.loss_peak is not None and self.loss_peak < lowest:
            raise BadInput(
                f"payne_loss_peak: {self.loss_peak:g} is below {lowest:g}, the mean of 1 and payne_loss_rest = "
                f"{self.loss_rest:g}; give at least that"
            )

    def __call__(self, strain: Value) -> Value:
        """Factor on the storage modulus."""
        return self.rest + (1.0 - self.rest) / (1.0 + (strain / self.strain) ** (2 * self.power))

    def loss_factor(self, strain: Value) -> Value:
        """Factor on the loss modulus."""
        if self.loss_peak is None:
            return self(strain)
        x = (strain / self.strain) ** self.power
        kraus = 2.0 * (self.loss_peak - 0.5 * (1.0 + self.loss_rest)) * x
        return self.loss_rest + (1.0 - self.loss_rest + kraus) / (1.0 + x**2)


@dataclass(frozen=True)
class AreaEnlargement:
    """A factor on the contact area that depends on the nominal pressure (Pa, increasing), by skewness or adhesion.

    The adhesive part of friction is proportional to the area; the viscoelastic part to the factor to the power
    `viscous`.  Only waves longer than `cutoff` (m) are changed; 0 changes all of them.  The shorter waves keep their
    spectrum on the enlarged contact: their contribution to G is unchanged, and P follows from the sum.
    """

    pressure: tuple[float, ...]
    factor: tuple[float, ...]
    viscous: float = 1.0
    cutoff: float = 0.0

    def __call__(self, p: Value) -> Value:
        """Factor on the contact area at nominal pressures p (Pa), constant beyond the given pressures."""
        return np.exp(np.interp(np.log(p), np.log(self.pressure), np.log(self.factor)))


@dataclass(frozen=True)
class TheoryResult:
    """Contact and friction at speeds, temperatures and pressures (...); spectra over `q` (..., n).

    `G`, `P` = A(q)/A0; `density` dmu_visc/dq (m) and `weight` dq (1/m) of every node: viscous = sum weight density;
    `viscous`, `adhesive` friction coefficients; `G_at_q1` G and `area` A/A0 at q1.
    """

    q: np.ndarray
    weight: np.ndarray
    G: np.ndarray
    P: np.ndarray
    density: np.ndarray
    viscous: np.ndarray
    adhesive: np.ndarray
    G_at_q1: np.ndarray
    area: np.ndarray

    @property
    def mu(self) -> Value:
        """Friction coefficient, viscoelastic and adhesive."""
        return self.viscous + self.adhesive


@lru_cache(maxsize=16)
def _angular_integrals(rubber: Rubber) -> Value:
    """Splines over ln(q v a_T) of integrals over the angle phi; E over 1 - nu^2, Pa.

    ln of I = int |E|^2 dphi, int cos phi Im E dphi over the root of I, and int (Im E)^2 dphi over I.
    """
    x, w = np.polynomial.legendre.leggauss(ANGLE_POINTS)
    cos, w = np.cos(np.pi / 4 * (x + 1)), np.pi * w  # four quarters of the circle
    E = rubber.modulus(np.multiply.outer(np.exp(LN_FREQUENCY_GRID), cos)) / (1.0 - rubber.poisson**2)
    square = (np.abs(E) ** 2) @ w
    lost, share = (E.imag * cos) @ w / np.sqrt(square), E.imag**2 @ w / square
    return (
        CubicSpline(LN_FREQUENCY_GRID, np.log(square)),
        CubicSpline(LN_FREQUENCY_GRID, lost),
        CubicSpline(LN_FREQUENCY_GRID, share),
    )


@lru_cache(maxsize=16)
def _truncate_theory(theory: PerssonTheory, q: float) -> PerssonTheory:
    return replace(theory, road=replace(theory.road, q1=q))


@dataclass(frozen=True)
class PerssonTheory:
    """Rubber on a road: all inputs of the theory except speed, temperature and pressure.

    `gamma` of S = gamma + (1 - gamma) P^2, the fraction of stored energy lost in partial contact; `shear` the shear
    stress of the real contact.  `saturation` False uses the limit of small contact, unbounded P = 1/sqrt(pi G) and
    S = gamma; `payne` softens the rubber with strain; `enlarged` changes the contact area.
    """

    rubber: Rubber
    road: RoughnessSpectrum
    gamma: float = 0.5
    shear: AdhesiveShear | None = None
    saturation: bool = True
    payne: PayneSoftening | None = None
    enlarged: tuple[AreaEnlargement, ...] = ()

    @cached_property
    def _quadrature_nodes(self) -> Value:
        """Gauss nodes of q in panels of ln q, their weights dq, half widths, and the matrix of running integrals."""
        ends = self.road.panel_edges()
        inner = [2 * np.pi / part.cutoff for part in self.enlarged if self._is_partial(part)]
        edges = np.log(np.union1d(ends, inner) if inner else ends)
        x, w = np.polynomial.legendre.leggauss(GAUSS_POINTS_PER_PANEL)
        half = 0.5 * np.diff(edges)
        q = np.exp(0.5 * (edges[1:] + edges[:-1])[:, None] + half[:, None] * x)
        legendre = np.polynomial.legendre
        basis = np.array([legendre.legval(x, row) for row in np.eye(GAUSS_POINTS_PER_PANEL)])
        rising = np.array([legendre.legval(x, legendre.legint(row, lbnd=-1)) for row in np.eye(GAUSS_POINTS_PER_PANEL)])
        return q, half[:, None] * w * q, half[:, None], np.linalg.solve(basis, rising)

    @property
    def q(self) -> np.ndarray:
        """Wavenumbers (n,) of the nodes, 1/m."""
        nodes: np.ndarray = self._quadrature_nodes[0].ravel()
        return nodes

    def cumulative_integral(self, values: np.ndarray) -> np.ndarray:
        """Integrals of q-densities (..., n) from q0 up to every node."""
        q, weight, half, rising = self._quadrature_nodes
        f = values.reshape(*values.shape[:-1], *q.shape)
        panel = np.sum(f * weight, axis=-1)
        before = np.cumsum(panel, axis=-1) - panel
        running: np.ndarray = (before[..., None] + (f * q * half) @ rising).reshape(values.shape)
        return running

    def __call__(self, v: Value, T: Value, p: Value, surface: Value = None) -> TheoryResult:
        """Contact and friction at speed v (m/s), temperature T (K) and nominal pressure p (Pa), which broadcast (...).

        T may be (..., n), one value per wavenumber; then `surface` (...) K is that of the real contact, T at q1
        if none is given.
        """
        v, p = np.asarray(v, dtype=float), np.asarray(p, dtype=float)
        T = np.asarray(T, dtype=float)
        if not (T.ndim and T.shape[-1] == len(self.q)):
            T = T[..., None]
        surface = T[..., -1] if surface is None else np.asarray(surface, dtype=float)
        shape = np.broadcast_shapes(v.shape, p.shape, T.shape[:-1], surface.shape)
        v, p, T = (np.broadcast_to(a, (*shape, a.shape[-1])) for a in (v[..., None], p[..., None], T))
        q = self.q
        square, loss, share = _angular_integrals(self.rubber)
        x = np.clip(np.log(q * v * self.rubber.shift_factor(T)), LN_FREQUENCY_GRID[0], LN_FREQUENCY_GRID[-1])
        root = np.exp(0.5 * square(x)) / p
        C = self.road(q)
        # strain depends on the softened modulus and the modulus on strain: fixed-point iteration of
        # the factors on the root of int |E|^2 dphi and on the loss modulus
        softer: Value = 1.0
        loss_factor: Value = 1.0
        loss_share = np.clip(share(x), 0.0, 1.0) if self._has_own_loss else 0.0
        for _ in range(1 if self.payne is None else MAX_SOFTENING_ITERATIONS):
            rate = q**3 * C * (softer * root) ** 2 / 8
            G = np.maximum(self.cumulative_integral(rate), 1e-300)
            P = self._area_fraction(G)
            if self.payne is None:
                break
            strain = np.sqrt(2 * np.pi) / (P * softer * root)
            new = self.payne(strain)
            loss_factor = self.payne.loss_factor(strain)
            if self._has_own_loss:
                new = np.sqrt((1.0 - loss_share) * new**2 + loss_share * loss_factor**2)
            change, softer = np.max(np.abs(new - softer)), new
            if change < 1e-8:
                break
        else:
            raise SolverFailure(f"softening of the rubber with strain does not converge: {change:.1g} of the modulus")
        S = self._dissipated_share(P)
        density = 0.5 * q**3 * C * S * P * loss_factor * root * loss(x)
        stretch = np.sum(rate * self.weight, axis=-1)
        area = self._area_fraction(stretch)
        for part in self.enlarged:
            if part.cutoff > 0.0 and 2 * np.pi / part.cutoff <= self.road.q0:  # the road has no such waves
                continue
            factor = part(p)
            if self._is_partial(part):
                P, density, area = self._enlarge_long_waves(part, factor, rate, P, density)
                continue
            P, density, area = P * factor, density * factor**part.viscous, area * factor[..., 0]
        if self.saturation and self.enlarged:
            P, area = np.minimum(P, 1.0), np.minimum(area, 1.0)
        viscous = np.sum(density * self.weight, axis=-1)
        adhesive = 0.0 * viscous if self.shear is None else self.shear(v[..., 0], surface) * area / p[..., 0]
        return TheoryResult(q, self.weight, G, P, density, viscous, adhesive, stretch, area)

    def _dissipated_share(self, P: Value) -> Value:
        """S of P: fraction of the stored energy that is lost in partial contact; eq. (17)."""
        return self.gamma + (1 - self.gamma) * P**2 * self.saturation

    def _enlarge_long_waves(self, part: AreaEnlargement, factor: Value, rate: Value, P: Value, density: Value) -> Value:
        """P and dmu_visc/dq (..., n) and A/A0 (...) after a part enlarges the contact of waves longer than its cutoff.

        `rate` (..., n) is dG/dq.  The enlarged contact at the cutoff corresponds to a smaller G; the shorter waves add
        the same amount to it as before.
        """
        long = self.q < 2 * np.pi / part.cutoff
        G = np.maximum(self.cumulative_integral(rate), 1e-300)
        whole = np.sum(rate * self.weight, axis=-1, keepdims=True)
        before = np.sum((rate * self.weight)[..., long], axis=-1, keepdims=True)
        enlarged = factor * self._area_fraction(before)
        after = 0.25 / erfinv(np.minimum(enlarged, 1 - 1e-9)) ** 2 if self.saturation else 1 / (np.pi * enlarged**2)
        plain, shifted = self._area_fraction(G), self._area_fraction(np.maximum(G - before + after, 1e-300))
        gain = shifted / plain
        kept = self._dissipated_share(shifted) / self._dissipated_share(plain)
        P = P * np.where(long, factor, gain)
        density = density * np.where(long, factor**part.viscous, gain * kept)
        return P, density, self._area_fraction(whole - before + after)[..., 0]

    @property
    def _has_own_loss(self) -> bool:
        """Whether the loss modulus changes with strain by another factor than the storage modulus."""
        return self.payne is not None and self.payne.loss_peak is not None

    def _is_partial(self, part: AreaEnlargement) -> bool:
        """Whether a part changes the contact on some of the waves only."""
        return part.cutoff > 0.0 and self.road.q0 < 2 * np.pi / part.cutoff < self.road.q1

    def _area_fraction(self, G: Value) -> Value:
        """P of G: erf(1/(2 sqrt G)), eq. (16), or its limit at small contact without saturation."""
        return erf(0.5 / np.sqrt(G)) if self.saturation else 1.0 / np.sqrt(np.pi * G)

    @property
    def weight(self) -> np.ndarray:
        """Gauss weights dq (n,) of the nodes, 1/m."""
        weights: np.ndarray = self._quadrature_nodes[1].ravel()
        return weights

    def without_shorter_waves(self, q: float) -> PerssonTheory:
        """The theory of the same road without waves shorter than 2 pi/q.  Raises BadInput where no waves are left."""
        if not q > self.road.q0:
            longest, shortest = 2 * np.pi / self.road.q0, 2 * np.pi / q
            raise BadInput(
                f"contact.spot_diameter: {shortest:.3g} m is not below the road's longest wave, {longest:.3g} m; "
                "give smaller spots, their fraction, or a spectrum with longer waves"
            )
        return _truncate_theory(self, q)

    def contact_fraction_law(self, q: float, T: Value, p: float) -> Callable[..., Value]:
        """Law (v, p, T) of P at one wavenumber q (1/m), around a pressure p (Pa): G falls as 1/p^2 there.

        `T` (n,) K are the increasing temperatures at which it is computed; splines between them, constant beyond.
        """
        cut = self.without_shorter_waves(q)

        @lru_cache(maxsize=2)
        def ln_stress_spline(v: Value) -> CubicSpline:  # ln Pa over T
            return CubicSpline(T, np.log(p * np.sqrt(cut(v, T[:, None], p).G_at_q1[:, 0])))

        def fraction_law(v: Value, local: Value, at: Value) -> Value:
            clipped = np.clip(np.real(at), T[0], T[-1])
            log = ln_stress_spline(v)(clipped)
            if np.iscomplexobj(at):  # splines take real arguments only: propagate the complex step by the slope
                log = log + 1j * np.imag(at) * ln_stress_spline(v)(clipped, 1)
            return erf(0.5 * local / np.exp(log))

        return fraction_law

    def contact_fraction(self, q: float, v: Value, T: Value, p: Value) -> Value:
        """P at one wavenumber q (1/m): the fraction in contact on a road without shorter waves."""
        return self.without_shorter_waves(q)(v, T, p).area
