"""Steady sliding contact of a viscoelastic half-space with a rigid rough surface: pressure, contact area and friction.

In the frame of the road the surface displacement is u(q) = 2 p(q)/(|q| E*(q_x v)), with complex
E* = E(omega)/(1 - nu^2), and

    p >= 0,  gap = g0 + u - h >= 0,  p gap = 0,  <p> = p0,   mu_visc = <p dh/dx>/p0

with the rubber moving towards +x.  The operator is positive but, for dissipative rubber, not symmetric: the solution
minimises no energy.  A primal-dual active-set method with GMRES therefore replaces conjugate gradients.

>>> heights = 1e-3 * np.cos(2 * np.pi * np.arange(64)[:, None] / 64)
>>> result = solve_sliding_contact(heights, (1.0, 1.0), lambda omega: np.full(np.shape(omega), 1e6), 1.0, 3e3)
>>> print(abs(result.mu) < 1e-9, round(result.area, 3))  # exactly (2/pi) asin sqrt(3e3/(pi 1e3)) = 0.864
True 0.859
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse.linalg import LinearOperator, gmres

from flashtemp.errors import SolverFailure
from flashtemp.physics.arrays import Value

MAX_CONTACT_SETS, MAX_GMRES_RESTARTS = 400, 60  # active sets; restarts of GMRES
GMRES_TOLERANCE = 1e-7  # residual in the contact over the norm of the heights
GMRES_VECTORS = 40  # vectors between restarts
COARSEST_POINTS = 32  # points along x up to which the initial set is all points


@dataclass(frozen=True, eq=False)
class SlidingContactResult:
    """Pressure and gap (nx, ny) in Pa and m, friction `mu` = <p dh/dx>/<p>, fraction `area` in contact.

    `friction_by_loss` is the energy loss of the rubber per slid distance over <p>, a check of `mu`.
    """

    pressure: np.ndarray
    gap: np.ndarray
    mu: float
    friction_by_loss: float
    area: float


class SlidingSurface:
    """Heights (nx, ny) m, periodic over `size` m, under rubber of contact modulus E*(omega) Pa at `speed` m/s."""

    def __init__(self, heights: np.ndarray, size: tuple[float, float], modulus: Callable[..., Value], speed: float):
        nx, ny = self.shape = heights.shape
        self.heights = heights
        qx = 2 * np.pi * np.fft.fftfreq(nx, size[0] / nx)[:, None]
        qy = 2 * np.pi * np.fft.rfftfreq(ny, size[1] / ny)[None, :]
        q = np.hypot(qx, qy)
        q[0, 0] = 1.0
        E = np.asarray(modulus(np.abs(qx) * speed + 0.0 * qy), dtype=complex)
        E = np.where(qx < 0, np.conj(E), E)
        if nx % 2 == 0:
            E[nx // 2] = np.abs(E[nx // 2])  # the shortest wave along x has no direction
        self.stiffness = 0.5 * q * E
        self.compliance = 1.0 / self.stiffness
        self.compliance[0, 0] = 0.0
        slope = 1j * qx * np.ones_like(qy)
        if nx % 2 == 0:
            slope[nx // 2] = 0.0
        self.slope_factor = slope

    def apply_factor(self, factor: np.ndarray, field: np.ndarray) -> np.ndarray:
        """A field (nx, ny) with every Fourier component multiplied by `factor`."""
        product: np.ndarray = np.fft.irfft2(factor * np.fft.rfft2(field), s=self.shape)
        return product

    def solve_pressure(self, in_contact: np.ndarray, start: np.ndarray, load: float) -> tuple[np.ndarray, np.ndarray]:
        """Pressure (nx, ny) of mean `load` (Pa) that closes the gap at the points `in_contact`, and the gap."""
        count = int(in_contact.sum())
        p = np.where(in_contact, start, 0.0)
        p += np.where(in_contact, (load - p.mean()) * in_contact.size / count, 0.0)

        def take_contact_values(field: np.ndarray) -> np.ndarray:
            inside: np.ndarray = field[in_contact]
            inside -= inside.mean()  # the rigid displacement g0 is free: only differences between points count
            return inside

        def scatter_values(values: np.ndarray) -> np.ndarray:
            field = np.zeros(self.shape)
            field[in_contact] = values
            return field

        def apply_operator(values: np.ndarray) -> np.ndarray:
            return take_contact_values(self.apply_factor(self.compliance, scatter_values(values - values.mean())))

        def apply_preconditioner(values: np.ndarray) -> np.ndarray:
            return take_contact_values(self.apply_factor(self.stiffness, scatter_values(values)))

        miss = take_contact_values(self.heights - self.apply_factor(self.compliance, p))
        size = np.linalg.norm(take_contact_values(self.heights))
        if count > 1 and np.linalg.norm(miss) > GMRES_TOLERANCE * size:
            shape = (count, count)
            change, fault = gmres(
                LinearOperator(shape, apply_operator),
                miss,
                rtol=0.0,
                atol=GMRES_TOLERANCE * size,
                restart=GMRES_VECTORS,
                maxiter=MAX_GMRES_RESTARTS,
                M=LinearOperator(shape, apply_preconditioner),
            )
            if fault:
                raise SolverFailure(f"sliding contact: GMRES does not converge on {count} points")
            p = p + scatter_values(change - change.mean())
        gap = self.apply_factor(self.compliance, p) - self.heights
        return p, gap - gap[in_contact].mean()


def solve_sliding_contact(
    heights: np.ndarray, size: tuple[float, float], modulus: Callable[..., Value], speed: float, pressure: float
) -> SlidingContactResult:
    """Rubber pressed on `heights` (nx, ny) m by a nominal `pressure` (Pa) and slid along x at `speed` (m/s).

    `modulus`(omega) is E/(1 - nu^2) in Pa at omega >= 0 in rad/s, complex.  Raises SolverFailure.
    """
    surface = SlidingSurface(heights, size, modulus, speed)
    on, p = _initial_contact(heights, size, modulus, speed, pressure)
    for _ in range(MAX_CONTACT_SETS):
        p, gap = surface.solve_pressure(on, p, pressure)
        new = np.where(on, p > 0.0, gap < 0.0)
        if np.array_equal(new, on):
            break
        on = new if new.any() else heights == heights.max()
    else:
        raise SolverFailure(f"sliding contact: the set of contact points changes after {MAX_CONTACT_SETS} iterations")
    climbed, followed = (
        surface.apply_factor(surface.slope_factor, f) for f in (heights, surface.apply_factor(surface.compliance, p))
    )
    mu, loss = (float((p * slope).mean() / p.mean()) for slope in (climbed, followed))
    return SlidingContactResult(p, np.where(on, 0.0, gap), mu, loss, float(on.mean()))


def _initial_contact(
    heights: np.ndarray, size: tuple[float, float], modulus: Callable[..., Value], speed: float, pressure: float
) -> tuple[np.ndarray, np.ndarray]:
    """Initial contact and pressure: the solution on every second point, or all points of a small grid."""
    nx, ny = heights.shape
    along, across = (2 if n > COARSEST_POINTS and n % 2 == 0 else 1 for n in (nx, ny))
    if along == 1:
        return np.ones(heights.shape, dtype=bool), np.full(heights.shape, pressure)
    coarse = solve_sliding_contact(heights[::along, ::across], size, modulus, speed, pressure)
    p = np.repeat(np.repeat(coarse.pressure, along, axis=0), across, axis=1)
    return p > 0.0, p
