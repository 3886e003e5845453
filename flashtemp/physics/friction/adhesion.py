"""Adhesion between rubber and road: the increase of the contact area by a work of adhesion.

With roughness up to wavenumber q, the contact stress sigma has a distribution that diffuses with time G(q):
dP/dG = p^2 d2P/dsigma2, starting at sigma = p for a smooth road.  Without adhesion contact opens at sigma = 0, an
absorbing wall: A/A0 = erf(1/(2 sqrt G)), eq. (16).  With adhesion, contact bears tension up to sigma_a(q), and the wall
is at -sigma_a(q).

Detachment stress sigma_a: a penny crack of radius a between a half-space and a rigid body releases the energy
2 sigma^2 a/(pi E*) per new area.  Griffith's criterion equates this with the work of adhesion w; a = pi/q, half a
wavelength, gives sigma_a = sqrt(w E* q/2).  The crack size and thus the prefactor sqrt(1/2) are assumptions.

Separation at q does not cost w on the whole area, because it recovers the elastic energy by which rubber follows the
shorter waves q..q1.  The effective work w_eff(q) P(q) = w P(q1) - (pi E*/2) int_q^q1 q'^2 C S P dq' replaces w (after
Persson's effective interfacial energy).  On roads it is zero except for the shortest waves.  Using w at every q
overestimates adhesion: such a road would stick without load.

>>> G = np.array([0.01, 1.0, 100.0])
>>> print(np.round(area_with_tension(np.array([1.0, 10.0, 100.0]), G, 0.0 * G), 4))
[1.     0.5205 0.0564]
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.linalg.lapack import dgttrf, dgttrs
from scipy.special import ndtr

from flashtemp.errors import BadInput
from flashtemp.physics.arrays import Value
from flashtemp.physics.friction.persson import AreaEnlargement, PerssonTheory

PENNY_CRACK_FACTOR = np.sqrt(0.5)  # sigma_a over sqrt(w E* q)
STRESS_CELLS, DIFFUSION_STEPS = 400, 400
START_DISTANCE_SD = 8.0  # initial standard deviations from the stress to the wall: no separation yet
STRESS_RANGE_SCALES = 8.0  # upper end of the stress grid over the stress scale
STRESS_GRID_STRETCH = 3.0  # stretching of the cells towards that end
SDIRK_GAMMA = 1.0 - np.sqrt(0.5)  # L-stable, second order
STUCK_AREA_FRACTION = 0.5  # contact area under almost no load above which the solids count as stuck
UNLOADED_PRESSURE_RATIO = 1e-3  # "almost no load" over the lowest pressure
ADHESION_WAVENUMBERS = 400  # wavenumbers at which contact may separate, denser towards q1
MAX_ADHESION_ROUNDS, AREA_TOLERANCE = 60, 1e-5  # iterations of w_eff and P; relative change of the area at convergence


def detachment_stress(q: Value, work: Value, modulus: float, prefactor: float = PENNY_CRACK_FACTOR) -> Value:
    """Tensile stress sigma_a (Pa) that separates a contact of size pi/q: `prefactor` sqrt(w E* q).

    q in 1/m, `work` of adhesion w in J/m^2, `modulus` E/(1 - nu^2) in Pa.
    """
    return prefactor * np.sqrt(work * modulus * np.asarray(q))


def area_with_tension(q: np.ndarray, G: np.ndarray, tension: Value) -> np.ndarray:
    """A/A0 (..., n) at wavenumbers q (n) where contact bears `tension` sigma_a/p (..., n); G (..., n) is the time.

    G increases with q from 0 for a smooth road; `tension` >= 0 must not decrease with q.  Finite volumes in
    s = sigma + sigma_a on a grid that grows with the width of the distribution; error below 3e-5, relative 3e-4.
    """
    G, tension = np.broadcast_arrays(np.asarray(G, dtype=float), np.asarray(tension, dtype=float))
    shape, n = G.shape, G.shape[-1]
    G, tension = G.reshape(-1, n), tension.reshape(-1, n)
    tables = [_diffusion_steps(np.log(q), g, b) for g, b in zip(G, tension, strict=True)]
    times, walls = (np.array(part) for part in zip(*tables, strict=True))
    ln_fraction = np.log(_fraction_in_contact(times, walls))
    area = np.ones_like(G)
    for row, at, t, s in zip(area, G, np.log(times), ln_fraction, strict=True):
        later = at > np.exp(t[0])
        row[later] = np.exp(PchipInterpolator(t, s, extrapolate=True)(np.log(at[later])))
    return area.reshape(shape)


def _diffusion_steps(x: np.ndarray, G: np.ndarray, tension: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times G (DIFFUSION_STEPS + 1) from before the first separation to the end, and the wall sigma_a/p there."""
    start = 0.5 * ((1.0 + tension[0]) / START_DISTANCE_SD) ** 2
    fine = np.linspace(x[0], x[-1], 8 * len(x))
    time, wall = (np.exp(PchipInterpolator(x, np.log(y))(fine)) for y in (G, 1.0 + tension))
    if time[-1] <= start:  # narrow distribution: everything stays in contact
        return np.geomspace(start, 2 * start, DIFFUSION_STEPS + 1), np.full(DIFFUSION_STEPS + 1, wall[0] - 1.0)
    time, wall = np.append(min(start, time[0]), time), np.append(wall[0], wall)
    run = np.log(time) + 2.0 * np.log(wall)
    at = np.linspace(np.interp(np.log(start), np.log(time), run), run[-1], DIFFUSION_STEPS + 1)
    return np.exp(np.interp(at, run, np.log(time))), np.interp(at, run, wall) - 1.0


def _fraction_in_contact(times: np.ndarray, walls: np.ndarray) -> np.ndarray:
    """Fraction of the stress distribution that has not reached the wall at `times` (m, k)."""
    faces = (
        STRESS_RANGE_SCALES
        * np.sinh(STRESS_GRID_STRETCH * np.linspace(0.0, 1.0, STRESS_CELLS + 1))
        / np.sinh(STRESS_GRID_STRETCH)
    )
    width = np.diff(faces)
    scale = np.sqrt((1.0 + walls) ** 2 + 2.0 * times)
    middle, spread = (1.0 + walls[:, :1]) / scale[:, :1], np.sqrt(2.0 * times[:, :1]) / scale[:, :1]
    content = np.diff(ndtr((faces - middle) / spread), axis=1)  # probability in each cell
    remaining = [content.sum(axis=1)]
    for k in range(times.shape[1] - 1):
        size = 0.5 * (scale[:, k] + scale[:, k + 1])
        diffusion = (times[:, k + 1] - times[:, k]) / size**2
        away, growth = (np.diff(y[:, k : k + 2])[:, 0] / size for y in (walls, scale))
        content = _advance_content(content, *_flow_rates(diffusion, away, growth, faces, width))
        remaining.append(content.sum(axis=1))
    fraction: np.ndarray = np.array(remaining).T / remaining[0][:, None]
    return fraction


def _flow_rates(diffusion: Value, wall_speed: Value, growth: Value, faces: Value, width: Value) -> Value:
    """Rates of flow to the previous cell, out of every cell, and to the next cell; (m, cells) each.

    Exponentially fitted fluxes (Scharfetter-Gummel) keep the content positive where the wall moves fast.
    """
    centre = 0.5 * (faces[1:] + faces[:-1])
    gap = np.append(centre[0], np.diff(centre))  # the wall is a face, not a cell
    peclet = (wall_speed[:, None] - growth[:, None] * faces[:-1]) * gap / diffusion[:, None]
    reach = diffusion[:, None] / gap
    down, up = reach * _bernoulli(peclet), reach * _bernoulli(-peclet)
    back = down / width
    on = np.zeros_like(back)
    on[:, :-1] = up[:, 1:] / width[:-1]
    return back, back + on, on


def _bernoulli(x: Value) -> Value:
    """x/(e^x - 1)."""
    x = np.clip(x, -300.0, 300.0)
    small = np.abs(x) < 1e-6
    return np.where(small, 1.0 - 0.5 * x, x / np.expm1(np.where(small, 1.0, x)))


def _advance_content(content: Value, back: Value, out: Value, on: Value) -> Value:
    """Content after one SDIRK step: the tridiagonal systems of all rows are solved as one."""
    m, n = content.shape
    moved = -out * content
    moved[:, :-1] += (back * content)[:, 1:]
    moved[:, 1:] += (on * content)[:, :-1]
    before, after = -SDIRK_GAMMA * back, -SDIRK_GAMMA * on
    before[:, 0], after[:, -1] = 0.0, 0.0  # decouples the rows in the joint system
    factors = dgttrf(after.ravel()[:-1], (1.0 + SDIRK_GAMMA * out).ravel(), before.ravel()[1:])[:5]
    new = (content + (1.0 - 2.0 * SDIRK_GAMMA) * moved).ravel()
    for _ in range(2):
        new = dgttrs(*factors, new)[0]
    return new.reshape(m, n)


def adhesion_enlargement(
    theory: PerssonTheory,
    v: float,
    T: float,
    work: float,
    pressures: Value,
    modulus: float | None = None,
    prefactor: float = PENNY_CRACK_FACTOR,
    stored: bool = True,
    viscous: float = 1.0,
) -> AreaEnlargement:
    """Effect of a `work` of adhesion (J/m^2) on the contact area at increasing nominal `pressures` (Pa).

    At speed v (m/s) and temperature T (K) of a theory, whose `enlarged` is ignored.  `modulus` is E/(1 - nu^2) in Pa,
    by default that of the rubber at rest.  `stored` False uses w at every q, an upper bound.  `viscous` 1 increases the
    viscoelastic part as much as the area, also an upper bound: with stored energy only the contact of the shortest
    waves grows.  Raises BadInput for a negative work, pressures that do not increase, or where adhesion alone pulls
    half of the road into contact: soft rubber on a road so smooth that (pi E*/2) int q^2 C dq < w.
    """
    p = np.asarray(pressures, dtype=float)
    if not work >= 0 or not prefactor >= 0 or p.ndim != 1 or p.size == 0 or not p[0] > 0 or np.any(np.diff(p) <= 0):
        raise BadInput(
            f"work {work:g}, pressures {p.tolist()}; give a work of adhesion >= 0 J/m2 and increasing pressures"
        )
    rubber = theory.rubber
    modulus = float(abs(rubber.modulus(0.0))) / (1.0 - rubber.poisson**2) if modulus is None else modulus
    if not modulus > 0:
        raise BadInput(f"modulus: {modulus:g}; give E/(1 - nu^2) of the rubber in Pa, positive")
    p = np.append(UNLOADED_PRESSURE_RATIO * p[0], p)
    q, G = _stress_spread_grid(theory, v, T, p)
    bare = area_with_tension(q, G, 0.0)
    P = bare
    for _ in range(MAX_ADHESION_ROUNDS):
        w_eff = _effective_work(theory, q, P, work, modulus) if stored else work
        before, P = P[:, -1], area_with_tension(q, G, detachment_stress(q, w_eff, modulus, prefactor) / p[:, None])
        if not stored or np.all(np.abs(P[:, -1] / before - 1.0) < AREA_TOLERANCE):
            break
    else:
        raise BadInput(f"work: {work:g} J/m2: contact and stored energy do not converge; give less, or stored = False")
    if P[0, -1] > STUCK_AREA_FRACTION:
        raise BadInput(
            f"work: {work:g} J/m2 pulls {100 * P[0, -1]:.0f} % of the road into contact without load; give less, "
            f"stiffer rubber than E* = {modulus:.3g} Pa or a rougher road"
        )
    factor = (P / bare)[1:, -1]
    return AreaEnlargement(tuple(p[1:].tolist()), tuple(factor.tolist()), viscous)


def _stress_spread_grid(theory: PerssonTheory, v: float, T: float, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Wavenumbers (n) from q0 to q1, denser towards q1, and G (m, n) there at pressures p (m)."""
    result = theory(v, T, p)
    x = np.log(np.append(result.q, theory.road.q1))
    G = np.column_stack([result.G, result.G_at_q1])
    at = x[-1] - (x[-1] - x[0]) * np.linspace(1.0, 0.0, ADHESION_WAVENUMBERS) ** 2
    return np.exp(at), np.exp(PchipInterpolator(x, np.log(G), axis=1)(at))


def _effective_work(theory: PerssonTheory, q: np.ndarray, P: np.ndarray, work: float, modulus: float) -> np.ndarray:
    """Work of adhesion (m, n), J/m^2, minus the energy stored in waves from q to q1; it does not decrease with q."""
    S = theory.gamma + (1.0 - theory.gamma) * P**2
    density = 0.5 * np.pi * modulus * q**3 * theory.road(q) * S * P
    panel = 0.5 * (density[:, 1:] + density[:, :-1]) * np.diff(np.log(q))
    beyond = np.zeros_like(P)
    beyond[:, :-1] = np.cumsum(panel[:, ::-1], axis=1)[:, ::-1]
    effective = np.maximum(work * P[:, -1:] - beyond, 0.0) / P
    return np.maximum.accumulate(effective, axis=1)
