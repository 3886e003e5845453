"""Closed-form solutions of sliding heat conduction, with which tests verify the solver and the effects.

Numbers V1..V23 are those of the verification list (docs/explanation/claims.md).  All functions are pure.  `body`,
`rubber` and `road` are `HalfSpace`s, z is the depth below the heated surface in m and t the time in s.  Results are
temperature rises above the initial or ambient temperature in K, unless stated otherwise.  V15, V18 and V19 are
properties of the solver and have no function of their own beyond `speed_scaling` and `road_rise`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import beta, betainc, dawsn, erf, erfc, erfcx, ive, k0e, k1e

Value = Any  # a number or an array
ROOT_PI = np.sqrt(np.pi)
SPOT_OVERLAP_INTEGRAL = float(4 / np.pi * beta(0.75, 1.5))  # I of V10: integral of w^-1/2 h(w) from 0 to 1


class HalfSpace(Protocol):
    """Properties of a material: conductivity W/(m K), rho c J/(m3 K), diffusivity m2/s, effusivity W s^0.5/(m2 K)."""

    @property
    def conductivity(self) -> float: ...

    @property
    def volumetric_capacity(self) -> float: ...

    @property
    def diffusivity(self) -> float: ...

    @property
    def effusivity(self) -> float: ...


def ierfc(x: Value) -> Value:
    """Integral of erfc from x to infinity (1)."""
    return np.exp(-np.square(x)) / ROOT_PI - x * erfc(x)


# --- half-spaces ------------------------------------------------------------------------------------


def constant_flux(body: HalfSpace, flux: float, t: Value, z: Value = 0.0) -> Value:
    """V1: half-space under a constant flux (W/m2).  Carslaw & Jaeger 2.9."""
    reach = 2 * np.sqrt(body.diffusivity * t)
    return flux * reach / body.conductivity * ierfc(z / reach)


def flux_pulse(body: HalfSpace, flux: float, on: float, t: Value, z: Value = 0.0) -> Value:
    """V2: flux (W/m2) from 0 to `on` (s), insulated afterwards, t > on.  V1 superposed."""
    return constant_flux(body, flux, t, z) - constant_flux(body, flux, t - on, z)


def deep_source(body: HalfSpace, power: float, depth: float, t: Value, z: Value = 0.0) -> Value:
    """V3: insulated half-space, total power (W/m2) released as exp(-z/depth).  Carslaw & Jaeger 2.11."""
    m, s = 1.0 / depth, np.sqrt(body.diffusivity * t)
    near, far = m * s - z / (2 * s), m * s + z / (2 * s)
    fade = np.exp(-np.square(z / (2 * s)))
    # the product exp(m^2 s^2 - m z) erfc(near) without overflow on either side of near = 0
    direct = np.exp(np.minimum(m * s * m * s - m * z, 0.0)) * erfc(np.minimum(near, 0.0))
    left = np.where(near > 0, fade * erfcx(np.maximum(near, 0.0)), direct)
    shape = 2 * m * s * ierfc(z / (2 * s)) - np.exp(-m * z) + 0.5 * (left + fade * erfcx(far))
    return power / (body.conductivity * m) * shape


def persson_kernel(a: float, b: float, diffusivity: float, tau: Value) -> Value:
    """V4: kernel K(a, b, D tau) in 1/m, for source decay a and weight b (1/m).  theory.md, eq. (14)."""
    y = a * np.sqrt(diffusivity * tau)
    if a == b:
        late = np.maximum(y, 1.0)  # the closed form loses its digits to cancellation as y^2
        tail = (2 / late - 2 / late**3 + 4.5 / late**5) / ROOT_PI
        return 0.5 * a * np.where(y > 300, tail, (1 - 2 * y * y) * erfcx(y) + 2 * y / ROOT_PI)
    return a * b / (b * b - a * a) * (b * erfcx(y) - a * erfcx(b * np.sqrt(diffusivity * tau)))


def persson_step(a: float, b: float, diffusivity: float, t: Value) -> Value:
    """V4: step response, the integral of the kernel from 0 to t, s/m (a != b)."""

    def step_term(decay: Value) -> Value:
        """Integral (s) of erfcx(decay sqrt(D tau)) over tau from 0 to t; `decay` in 1/m."""
        y = decay * np.sqrt(diffusivity * t)
        return (erfcx(y) - 1 + 2 * y / ROOT_PI) / (decay * decay * diffusivity)

    return a * b / (b * b - a * a) * (b * step_term(a) - a * step_term(b))


# --- two half-spaces in contact ---------------------------------------------------------------------


def contact_rate(rubber: HalfSpace, road: HalfSpace, alpha: float) -> float:
    """eta = alpha (1/e_R + 1/e_S) in s^-1/2: the conductance alpha (W/m2K) matters while eta sqrt t < 1."""
    return alpha * (1 / rubber.effusivity + 1 / road.effusivity)


def contact_flux(rubber: HalfSpace, road: HalfSpace, difference: float, alpha: float, t: Value) -> Value:
    """V5: flux (W/m2) from rubber to road that touch at t = 0, rubber warmer by `difference` (K)."""
    if np.isinf(alpha):
        e = rubber.effusivity * road.effusivity / (rubber.effusivity + road.effusivity)
        return difference * e / np.sqrt(np.pi * t)
    return alpha * difference * erfcx(contact_rate(rubber, road, alpha) * np.sqrt(t))


def contact_temperature(rubber: HalfSpace, road: HalfSpace, difference: float) -> float:
    """V5: temperature rise of the interface above the road's temperature, alpha = inf."""
    return difference * rubber.effusivity / (rubber.effusivity + road.effusivity)


def shared_source(rubber: HalfSpace, road: HalfSpace, flux: float, alpha: float, t: Value) -> Value:
    """V6: interface source (W/m2) on the rubber's side: (J_S W/m2, T_R, T_S)."""
    eR, eS = rubber.effusivity, road.effusivity
    if np.isinf(alpha):
        rise = 2 * flux * np.sqrt(t / np.pi) / (eR + eS)
        return flux * eS / (eR + eS), rise, rise
    eta = contact_rate(rubber, road, alpha)
    y = eta * np.sqrt(t)
    J = flux * eS / (eR + eS) * (1 - erfcx(y))
    T = flux * alpha / (eR * eS * eta * eta) * (2 * y / ROOT_PI - 1 + erfcx(y))
    return J, T + J / alpha, T


def shared_deep_source(
    rubber: HalfSpace, road: HalfSpace, flux: float, power: float, depth: float, alpha: float, t: Value
) -> Value:
    """V7: V6 plus power (W/m2) released in the rubber as exp(-z/depth): J_S in W/m2 (eta depth != sqrt D_R)."""
    eR, eS, s = rubber.effusivity, road.effusivity, np.sqrt(t)
    b = np.sqrt(rubber.diffusivity) / depth
    if np.isinf(alpha):
        return eS / (eR + eS) * (flux + power * (1 - erfcx(b * s)))
    eta = contact_rate(rubber, road, alpha)
    slow, fast = (1 - erfcx(b * s)) / b, (1 - erfcx(eta * s)) / eta
    return alpha / eR * (flux * fast + power * b / (eta - b) * (slow - fast))


def shared_deep_rise(rubber: HalfSpace, road: HalfSpace, flux: float, power: float, depth: float, t: Value) -> Value:
    """V7: temperature rise of the interface for alpha = inf."""
    b = np.sqrt(rubber.diffusivity) / depth
    y = b * np.sqrt(t)
    deep = power / b * (2 * y / ROOT_PI - 1 + erfcx(y))
    return (2 * flux * np.sqrt(t / np.pi) + deep) / (rubber.effusivity + road.effusivity)


def resting_conductance(rubber: HalfSpace, road: HalfSpace, modulus: float, pressure: float, decay: float) -> float:
    """alpha (W/m2K) of an elastic contact at rest: 2 k_m p/(E* u0), k_m = k_R k_S/(k_R + k_S).

    Barber's relation of conductance and stiffness with p ~ exp(-u/u0): `modulus` E* and local `pressure` in Pa,
    `decay` u0 in m, 0.4 to 0.5 of the rms height.  For a spot, use the pressure and the rms height inside it.
    """
    k = rubber.conductivity * road.conductivity / (rubber.conductivity + road.conductivity)
    return 2.0 * k * pressure / (modulus * decay)


# --- road that slides past --------------------------------------------------------------------------


def road_rise(road: HalfSpace, speed: float, flux: float, x: Value) -> Value:
    """V8, V19: road surface at x (m) behind the leading edge of a uniform flux (W/m2), Pe >> 1."""
    return 2 * flux * np.sqrt(x / (np.pi * speed)) / road.effusivity


def road_rise_linear(road: HalfSpace, speed: float, flux: float, length: float, x: Value) -> Value:
    """V8: flux falling linearly from `flux` (W/m2) at the leading edge to 0 at `length` (m)."""
    scale = flux / (road.effusivity * np.sqrt(np.pi * speed))
    return scale * (2 * np.sqrt(x) - 4 / 3 * np.power(x, 1.5) / length)


def road_rise_exponential(road: HalfSpace, speed: float, flux: float, decay: float, x: Value) -> Value:
    """V8: flux `flux` exp(-x/decay) in W/m2; the rise peaks at x = 0.854033 decay."""
    scale = 2 * flux * np.sqrt(decay) / (road.effusivity * np.sqrt(np.pi * speed))
    return scale * dawsn(np.sqrt(x / decay))


def road_rise_by_quadrature(road: HalfSpace, speed: float, flux: Callable[..., Value], x: float) -> float:
    """V8: any flux law (W/m2 at x), by quadrature in sqrt(x - x'), which removes the singularity."""
    value, _ = quad(lambda u: 2 * flux(x - u * u), 0.0, np.sqrt(x), epsabs=0.0, epsrel=1e-12, limit=200)
    found: float = value / (road.effusivity * np.sqrt(np.pi * speed))
    return found


def road_wake(road: HalfSpace, speed: float, flux: float, length: float, x: Value) -> Value:
    """V8: road surface behind the block, x > length (m), after a uniform flux (W/m2)."""
    return road_rise(road, speed, flux, x) - road_rise(road, speed, flux, x - length)


def isothermal_wall_coefficient(road: HalfSpace, speed: float, length: float) -> float:
    """V8: mean flux per kelvin (W/m2K) from an isothermal wall into the road, per spot area."""
    found: float = 2 * road.effusivity * np.sqrt(speed / (np.pi * length))
    return found


def jaeger_strip(peclet: float, X: Value) -> Value:
    """V9: theta = pi k V T/(2 D q) of a strip source of half-length b moving towards +X = x/b, Pe = V b/(2 D)."""

    def bessel_integral(u: Value) -> Value:  # integral of exp(-u) K0|u| from 0 to u, DLMF 10.43(i)
        a = np.maximum(np.abs(u), 1e-300)
        ahead = 1 + a * np.exp(-2 * a) * (k0e(a) - k1e(a))
        behind = 1 - a * (k0e(a) + k1e(a))
        return np.where(u == 0, 0.0, np.where(u > 0, ahead, behind))

    X = np.asarray(X, dtype=float)
    return bessel_integral(peclet * (X + 1)) - bessel_integral(peclet * (X - 1))


def jaeger_strip_peak(peclet: float) -> float:
    """V9: position X of the highest temperature under the strip."""

    def rise_slope(X: Value) -> Value:
        ahead, behind = peclet * (X + 1), peclet * (1 - X)
        return np.exp(-2 * ahead) * k0e(ahead) - k0e(behind)  # exp(-u) K0|u| at both ends

    return float(brentq(rise_slope, -1 + 1e-9, 0.0, xtol=1e-14))


# --- flash temperature in the spots -----------------------------------------------------------------


def spot_overlap(w: Value) -> Value:
    """h(w): common area of two equal discs displaced by w diameters, 1 at w = 0."""
    w = np.clip(w, 0.0, 1.0)
    return 2 / np.pi * (np.arccos(w) - w * np.sqrt(1 - w * w))


def flash_build_up(r: Value) -> Value:
    """V10: F(r), fraction of the full flash temperature after sliding r spot diameters, by an incomplete beta function.

    theory.md, eq. (13b), integrated by parts.
    """
    r = np.clip(r, 0.0, 1.0)
    return (2 * np.sqrt(r) * spot_overlap(r)) / SPOT_OVERLAP_INTEGRAL + betainc(0.75, 1.5, r * r)


def spot_flash(rubber: HalfSpace, flux: float, diameter: float, speed: float) -> float:
    """V11: mean excess in circular spots of a surface flux (W/m2 of spot) on rubber that slides past."""
    found: float = SPOT_OVERLAP_INTEGRAL / ROOT_PI * flux * np.sqrt(diameter / speed) / rubber.effusivity
    return found


def spot_flash_deep(rubber: HalfSpace, power: float, depth: float, diameter: float, speed: float) -> float:
    """Eq. (13): surface excess in circular spots of power (W/m2 of spot) released as exp(-z/depth)."""
    time, m = diameter / speed, 1.0 / depth

    def rate(s: Value) -> Value:  # w = s^2
        return 2 * s * spot_overlap(s * s) * m * erfcx(m * np.sqrt(rubber.diffusivity * time) * s)

    value, _ = quad(rate, 0.0, 1.0, epsabs=0.0, epsrel=1e-12)
    found: float = power * time / rubber.volumetric_capacity * value
    return found


def spot_flash_weighted(rubber: HalfSpace, power: float, q: float, diameter: float, speed: float) -> float:
    """V11: T_q, the excess weighted as 2q exp(-2qz), of power (W/m2) released in the same way; q in 1/m."""
    time = diameter / speed

    def rate(s: Value) -> Value:
        return 2 * s * spot_overlap(s * s) * persson_kernel(2 * q, 2 * q, rubber.diffusivity, time * s * s)

    value, _ = quad(rate, 0.0, 1.0, epsabs=0.0, epsrel=1e-12)
    found: float = power * time / rubber.volumetric_capacity * value
    return found


def periodic_flux_excess(duty: float, terms: int = 1_000_000) -> float:
    """V12: mean excess while a periodic on-off flux is on, in units of flux sqrt(period)/e; 0 < duty < 1."""
    n = np.arange(1, terms + 1)
    series = (np.square(np.sin(np.pi * n * duty)) * n**-2.5).sum() + terms**-1.5 / 3  # tail: sin^2 is 1/2 on average
    return float(2 * np.cos(np.pi / 4) * series / (np.pi**2.5 * np.sqrt(2)) / duty)


# --- slab, cooling, scaling -------------------------------------------------------------------------


def slab_heating(body: HalfSpace, height: float, flux: float, t: float, z: Value = 0.0) -> Value:
    """V13: slab with flux (W/m2) into z = 0 and an insulated back at z = height (m).  Carslaw & Jaeger 3.8."""
    fo = body.diffusivity * t / height**2
    n = np.arange(1, 2 + int(np.sqrt(40 / (np.pi**2 * fo))))
    u = 1 - np.asarray(z, dtype=float)[..., None] / height
    waves = (-1.0) ** n * np.exp(-((n * np.pi) ** 2) * fo) / n**2 * np.cos(n * np.pi * u)
    shape = fo + (3 * u[..., 0] ** 2 - 1) / 6 - 2 / np.pi**2 * waves.sum(-1)
    return flux * height / body.conductivity * shape


def half_space_cooling(body: HalfSpace, h: float, t: Value, z: Value = 0.0) -> Value:
    """V14: remaining part (1) of a unit temperature rise, half-space cooled by h (W/m2K).  Carslaw & Jaeger 2.7."""
    s = np.sqrt(body.diffusivity * t)
    y = h * s / body.conductivity + z / (2 * s)
    return erf(z / (2 * s)) + np.exp(-np.square(z / (2 * s))) * erfcx(y)


def slowest_slab_mode(body: HalfSpace, height: float, h: float) -> tuple[float, float, float]:
    """V14: slowest mode of a slab cooled on one face: zeta, its amplitude C1, its time constant (s)."""
    zeta = _slab_root(h * height / body.conductivity, 0)
    return zeta, _mode_amplitude(zeta), height**2 / (body.diffusivity * zeta**2)


def slab_cooling(body: HalfSpace, height: float, h: float, t: float, z: Value = 0.0) -> Value:
    """V14: remaining part (1) of a unit temperature rise in a slab cooled at z = 0, insulated at z = height (m)."""
    modes = 2 + int(np.sqrt(40 * height**2 / (np.pi**2 * body.diffusivity * t)))
    roots = np.array([_slab_root(h * height / body.conductivity, n) for n in range(modes)])
    u = 1 - np.asarray(z, dtype=float)[..., None] / height
    decay = np.exp(-np.square(roots / height) * body.diffusivity * t)
    return (_mode_amplitude(roots) * decay * np.cos(roots * u)).sum(-1)


def _slab_root(biot: float, n: int) -> float:
    low = n * np.pi
    return float(brentq(lambda s: s * np.sin(s) - biot * np.cos(s), low + 1e-12, low + np.pi / 2, xtol=1e-15))


def _mode_amplitude(zeta: Value) -> Value:
    return 4 * np.sin(zeta) / (2 * zeta + np.sin(2 * zeta))


def speed_scaling(speed: float, reference: float) -> float:
    """V15: ratio (1) of temperature rises at two speeds after equal slid distance; exact for alpha = inf, h = 0."""
    return float(np.sqrt(speed / reference))


def approach_to_final_temperature(
    rubber: HalfSpace, road: HalfSpace, length: float, spot_fraction: float, distance: Value
) -> Value:
    """V16: temperature rise of the rubber's surface after sliding `distance` (m), over its final value; an estimate."""
    per_root_speed = spot_fraction * isothermal_wall_coefficient(road, 1.0, length)
    return 1 - erfcx(per_root_speed * np.sqrt(distance) / rubber.effusivity)


def abrasion_relaxation(stiffness: float, rate: float, slid: Value) -> Value:
    """V17: remaining part (1) of a pressure deviation; Winkler `stiffness` Pa/m, `rate` m3/(N m), `slid` m."""
    return np.exp(-stiffness * rate * slid)


def abrasion_depth(rate: float, pressure: float, slid: Value) -> Value:
    """V17: mean worn depth in m at a mean pressure in Pa."""
    return rate * pressure * slid


# --- lanes ------------------------------------------------------------------------------------------


def lane_retained(diffusivity: float, diameter: float, tau: Value) -> Value:
    """V23: fraction of heat still under the disc on which it was released tau (s) ago; theory.md, eq. (15b)."""
    X = (diameter / 2) ** 2 / (2 * diffusivity * np.asarray(tau, dtype=float))
    wide = np.maximum(X, 1.0)  # asymptotic expansion for large X, where the Bessel functions lose accuracy
    kept = np.where(
        X > 1e5, (2 - 0.25 / wide) / np.sqrt(2 * np.pi * wide), ive(0, np.minimum(X, 1e5)) + ive(1, np.minimum(X, 1e5))
    )
    return 1 - kept


def lane_factor(diffusivity: float, diameter: float, t: float) -> float:
    """V23: mean temperature rise of a lane over that of a 1D column after a uniform flux for t (s)."""
    value, _ = quad(
        lambda u: lane_retained(diffusivity, diameter, u * u), 0.0, np.sqrt(t), epsabs=0.0, epsrel=1e-11, limit=200
    )
    found: float = value / np.sqrt(t)
    return found
