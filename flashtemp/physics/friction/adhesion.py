"""Attraction between rubber and road: how much more of the road touches with a work of adhesion than without.

Seen up to wavenumber q, the stress in the contact is spread by diffusion whose time is G(q): dP/dG = p^2 d2P/dsigma2,
all of it at sigma = p where nothing rough is seen.  Without attraction contact opens at sigma = 0, an absorbing wall:
A/A0 = erf(1/(2 sqrt G)).  With it contact bears tension up to sigma_a(q), and the wall stands at -sigma_a(q).

sigma_a: a penny crack of radius a between a half-space and a rigid body releases 2 sigma^2 a/(pi E*) per area that it
grows by.  Griffith sets this equal to the work of adhesion w; a = pi/q, half a wavelength, gives
sigma_a = sqrt(w E* q/2).  The size is an assumption, and the prefactor sqrt(1/2) with it.

To part at q, the solids need not pay w for all of the area: they win back the energy that rubber stores to follow the
shorter waves q..q1.  What is left, w_eff(q) P(q) = w P(q1) - (pi E*/2) int_q^q1 q'^2 C S P dq', takes the place of w
(after Persson's effective interfacial energy).  On roads it is zero up to the last waves.  With w at every q instead,
attraction is overrated: such a road would stick under no load.

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

PENNY_CRACK_FACTOR = np.sqrt(0.5)  # of sigma_a over sqrt(w E* q)
STRESS_CELLS, DIFFUSION_STEPS = 400, 400
START_DISTANCE_SD = 8.0  # standard deviations from the stress at the start to the wall: nothing has parted yet
STRESS_RANGE_SCALES, STRESS_GRID_STRETCH = (
    8.0,
    3.0,
)  # upper end of the stresses over their scale; how much wider the cells get towards it
SDIRK_GAMMA = 1.0 - np.sqrt(0.5)  # of second order, and damping every fast mode
STUCK_AREA_FRACTION = 0.5  # area in contact under hardly any load above which the solids count as stuck
UNLOADED_PRESSURE_RATIO = 1e-3  # of the lowest pressure
ADHESION_WAVENUMBERS = 400  # wavenumbers at which contact may part, closer towards q1
MAX_ADHESION_ROUNDS, AREA_TOLERANCE = 60, 1e-5  # of w_eff against P, and the change of the area at which they end


def detachment_stress(q: Value, work: Value, modulus: float, prefactor: float = PENNY_CRACK_FACTOR) -> Value:
    """Tensile stress sigma_a (Pa) that parts contact of size pi/q: `prefactor` sqrt(w E* q).

    q in 1/m, `work` of adhesion w in J/m^2, `modulus` E/(1 - nu^2) in Pa.
    """
    return prefactor * np.sqrt(work * modulus * np.asarray(q))


def area_with_tension(q: np.ndarray, G: np.ndarray, tension: Value) -> np.ndarray:
    """A/A0 (..., n) at wavenumbers q (n) where contact bears `tension` sigma_a/p (..., n), with G (..., n) as its time.

    G rises with q from where nothing rough is seen; `tension` >= 0 must not fall with q.  Finite volumes in
    s = sigma + sigma_a on a grid that grows with the spread of the stresses: absolute error below 3e-5, relative 3e-4.
    """
    G, tension = np.broadcast_arrays(np.asarray(G, dtype=float), np.asarray(tension, dtype=float))
    shape, n = G.shape, G.shape[-1]
    G, tension = G.reshape(-1, n), tension.reshape(-1, n)
    tables = [_diffusion_steps(np.log(q), g, b) for g, b in zip(G, tension, strict=True)]
    times, walls = (np.array(part) for part in zip(*tables, strict=True))
    left = np.log(_fraction_in_contact(times, walls))
    found = np.ones_like(G)
    for row, at, t, s in zip(found, G, np.log(times), left, strict=True):
        later = at > np.exp(t[0])
        row[later] = np.exp(PchipInterpolator(t, s, extrapolate=True)(np.log(at[later])))
    return found.reshape(shape)


def _diffusion_steps(x: np.ndarray, G: np.ndarray, tension: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times G (DIFFUSION_STEPS + 1) from before the first parting to the end, and the wall sigma_a/p there."""
    start = 0.5 * ((1.0 + tension[0]) / START_DISTANCE_SD) ** 2
    fine = np.linspace(x[0], x[-1], 8 * len(x))
    time, wall = (np.exp(PchipInterpolator(x, np.log(y))(fine)) for y in (G, 1.0 + tension))
    if time[-1] <= start:  # hardly any spread: all of it stays in contact
        return np.geomspace(start, 2 * start, DIFFUSION_STEPS + 1), np.full(DIFFUSION_STEPS + 1, wall[0] - 1.0)
    time, wall = np.append(min(start, time[0]), time), np.append(wall[0], wall)
    run = np.log(time) + 2.0 * np.log(wall)
    at = np.linspace(np.interp(np.log(start), np.log(time), run), run[-1], DIFFUSION_STEPS + 1)
    return np.exp(np.interp(at, run, np.log(time))), np.interp(at, run, wall) - 1.0


def _fraction_in_contact(times: np.ndarray, walls: np.ndarray) -> np.ndarray:
    """What of the stresses has not met the wall yet at `times` (m, k)."""
    faces = (
        STRESS_RANGE_SCALES
        * np.sinh(STRESS_GRID_STRETCH * np.linspace(0.0, 1.0, STRESS_CELLS + 1))
        / np.sinh(STRESS_GRID_STRETCH)
    )
    width = np.diff(faces)
    scale = np.sqrt((1.0 + walls) ** 2 + 2.0 * times)
    middle, spread = (1.0 + walls[:, :1]) / scale[:, :1], np.sqrt(2.0 * times[:, :1]) / scale[:, :1]
    held = np.diff(ndtr((faces - middle) / spread), axis=1)  # content of the cells
    kept = [held.sum(axis=1)]
    for k in range(times.shape[1] - 1):
        size = 0.5 * (scale[:, k] + scale[:, k + 1])
        diffusion = (times[:, k + 1] - times[:, k]) / size**2
        away, growth = (np.diff(y[:, k : k + 2])[:, 0] / size for y in (walls, scale))
        held = _advance_content(held, *_flow_rates(diffusion, away, growth, faces, width))
        kept.append(held.sum(axis=1))
    found: np.ndarray = np.array(kept).T / kept[0][:, None]
    return found


def _flow_rates(diffusion: Value, wall_speed: Value, growth: Value, faces: Value, width: Value) -> Value:
    """Content that flows in a step: to the cell before, out of every cell, to the cell after; (m, cells) each.

    Exponentially fitted fluxes: no content turns negative where the wall moves fast.
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
    """Content after one step: every row a tridiagonal system, all of them solved as one."""
    m, n = content.shape
    moved = -out * content
    moved[:, :-1] += (back * content)[:, 1:]
    moved[:, 1:] += (on * content)[:, :-1]
    before, after = -SDIRK_GAMMA * back, -SDIRK_GAMMA * on
    before[:, 0], after[:, -1] = 0.0, 0.0  # rows are systems of their own
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
    """What a `work` of adhesion (J/m^2) does to the area in contact at nominal `pressures` (Pa, rising).

    At speed v (m/s) and temperature T (K) of a theory; its `enlarged` does not count.  `modulus` E/(1 - nu^2) in Pa is
    that of the rubber at rest if none is given.  `stored` False leaves w as it is at every q, an upper bound.
    `viscous` 1 raises the viscoelastic part as much as the area, an upper bound too: with stored energy only the
    contact of the last waves grows.  Raises BadInput for a negative work, pressures that do not rise, or where
    attraction alone pulls half of the road into contact: soft rubber on so smooth a road that following it stores
    less than w, (pi E*/2) int q^2 C dq < w.
    """
    p = np.asarray(pressures, dtype=float)
    if not work >= 0 or not prefactor >= 0 or p.ndim != 1 or p.size == 0 or not p[0] > 0 or np.any(np.diff(p) <= 0):
        raise BadInput(f"work {work:g}, pressures {p.tolist()}; give a work of adhesion >= 0 J/m2 and rising pressures")
    rubber = theory.rubber
    modulus = float(abs(rubber.modulus(0.0))) / (1.0 - rubber.poisson**2) if modulus is None else modulus
    if not modulus > 0:
        raise BadInput(f"modulus: {modulus:g}; give E/(1 - nu^2) of the rubber in Pa, positive")
    p = np.append(UNLOADED_PRESSURE_RATIO * p[0], p)
    q, G = _stress_spread_grid(theory, v, T, p)
    bare = area_with_tension(q, G, 0.0)
    P = bare
    for _ in range(MAX_ADHESION_ROUNDS):
        left = _effective_work(theory, q, P, work, modulus) if stored else work
        before, P = P[:, -1], area_with_tension(q, G, detachment_stress(q, left, modulus, prefactor) / p[:, None])
        if not stored or np.all(np.abs(P[:, -1] / before - 1.0) < AREA_TOLERANCE):
            break
    else:
        raise BadInput(f"work: {work:g} J/m2: contact and stored energy do not settle; give less, or stored = False")
    if P[0, -1] > STUCK_AREA_FRACTION:
        raise BadInput(
            f"work: {work:g} J/m2 pulls {100 * P[0, -1]:.0f} % of the road into contact without load; give less, "
            f"stiffer rubber than E* = {modulus:.3g} Pa or a rougher road"
        )
    factor = (P / bare)[1:, -1]
    return AreaEnlargement(tuple(p[1:].tolist()), tuple(factor.tolist()), viscous)


def _stress_spread_grid(theory: PerssonTheory, v: float, T: float, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Wavenumbers (n) from q0 to q1, closer towards q1, and G (m, n) there at pressures p (m)."""
    found = theory(v, T, p)
    x = np.log(np.append(found.q, theory.road.q1))
    G = np.column_stack([found.G, found.G_at_q1])
    at = x[-1] - (x[-1] - x[0]) * np.linspace(1.0, 0.0, ADHESION_WAVENUMBERS) ** 2
    return np.exp(at), np.exp(PchipInterpolator(x, np.log(G), axis=1)(at))


def _effective_work(theory: PerssonTheory, q: np.ndarray, P: np.ndarray, work: float, modulus: float) -> np.ndarray:
    """Work of adhesion (m, n), J/m^2, less the energy stored in waves from q to q1; never falling with q."""
    S = theory.gamma + (1.0 - theory.gamma) * P**2
    density = 0.5 * np.pi * modulus * q**3 * theory.road(q) * S * P
    panel = 0.5 * (density[:, 1:] + density[:, :-1]) * np.diff(np.log(q))
    beyond = np.zeros_like(P)
    beyond[:, :-1] = np.cumsum(panel[:, ::-1], axis=1)[:, ::-1]
    left = np.maximum(work * P[:, -1:] - beyond, 0.0) / P
    return np.maximum.accumulate(left, axis=1)
