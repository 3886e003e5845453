"""Viscoelastic half-space that slides steadily over a rigid rough surface: pressure, contact and friction, resolved.

In the frame of the road the surface moves by u(q) = 2 p(q)/(|q| E*(q_x v)), E* = E(omega)/(1 - nu^2) complex, and

    p >= 0,  gap = g0 + u - h >= 0,  p gap = 0,  <p> = p0,   mu_visc = <p dh/dx>/p0

with the rubber moving towards +x.  The operator is positive but, for rubber that loses energy, not symmetric: no energy
has its minimum there, so that a primal-dual active set takes the place of conjugate gradients, each solved by GMRES.

>>> x = np.arange(64)[:, None] / 64
>>> found = slide(1e-3 * np.cos(2 * np.pi * x), (1.0, 1.0), lambda omega: np.full(np.shape(omega), 1e6), 1.0, 3e3)
>>> print(abs(found.mu) < 1e-9, round(found.area, 3))  # exactly (2/pi) asin sqrt(3e3/(pi 1e3)) = 0.864
True 0.859
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse.linalg import LinearOperator, gmres

from flashtemp.errors import SolverFailure
from flashtemp.physics.arrays import Value

SETS, SOLVES = 400, 60  # active sets; restarts of GMRES
CLOSE = 1e-7  # of the residual in the contact
INNER = 40  # vectors between restarts
COARSE = 32  # points along x below which contact is sought from all of them


@dataclass(frozen=True, eq=False)
class Slid:
    """Pressure and gap (nx, ny) in Pa and m, friction `mu` = <p dh/dx>/<p>, share `area` in contact.

    `friction_by_loss` is the energy that the rubber loses per way, over <p>: the same number by another road.
    """

    pressure: np.ndarray
    gap: np.ndarray
    mu: float
    friction_by_loss: float
    area: float


class Surface:
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
        self.stiff = 0.5 * q * E
        self.soft = 1.0 / self.stiff
        self.soft[0, 0] = 0.0
        slope = 1j * qx * np.ones_like(qy)
        if nx % 2 == 0:
            slope[nx // 2] = 0.0
        self.along = slope

    def through(self, factor: np.ndarray, field: np.ndarray) -> np.ndarray:
        """A field (nx, ny) with every wave multiplied by `factor`."""
        found: np.ndarray = np.fft.irfft2(factor * np.fft.rfft2(field), s=self.shape)
        return found

    def pressed(self, on: np.ndarray, start: np.ndarray, load: float) -> tuple[np.ndarray, np.ndarray]:
        """Pressure (nx, ny) of mean `load` (Pa) that holds the points `on` at the road, and the gap everywhere."""
        count = int(on.sum())
        p = np.where(on, start, 0.0)
        p += np.where(on, (load - p.mean()) * on.size / count, 0.0)

        def level(field: np.ndarray) -> np.ndarray:
            inside: np.ndarray = field[on]
            inside -= inside.mean()
            return inside

        def spread(values: np.ndarray) -> np.ndarray:
            field = np.zeros(self.shape)
            field[on] = values
            return field

        def act(values: np.ndarray) -> np.ndarray:
            return level(self.through(self.soft, spread(values - values.mean())))

        def near(values: np.ndarray) -> np.ndarray:
            return level(self.through(self.stiff, spread(values)))

        miss = level(self.heights - self.through(self.soft, p))
        size = np.linalg.norm(level(self.heights))
        if count > 1 and np.linalg.norm(miss) > CLOSE * size:
            shape = (count, count)
            change, fault = gmres(
                LinearOperator(shape, act), miss, rtol=0.0, atol=CLOSE * size, restart=INNER, maxiter=SOLVES,
                M=LinearOperator(shape, near),
            )  # fmt: skip
            if fault:
                raise SolverFailure(f"sliding contact: GMRES does not settle on {count} points")
            p = p + spread(change - change.mean())
        gap = self.through(self.soft, p) - self.heights
        return p, gap - gap[on].mean()


def slide(
    heights: np.ndarray, size: tuple[float, float], modulus: Callable[..., Value], speed: float, pressure: float
) -> Slid:
    """Rubber pressed on `heights` (nx, ny) m by a nominal `pressure` (Pa) and slid along x at `speed` (m/s).

    `modulus`(omega) is E/(1 - nu^2) in Pa at omega >= 0 in rad/s, complex.  Raises SolverFailure.
    """
    surface = Surface(heights, size, modulus, speed)
    on, p = _started(heights, size, modulus, speed, pressure)
    for _ in range(SETS):
        p, gap = surface.pressed(on, p, pressure)
        new = np.where(on, p > 0.0, gap < 0.0)
        if np.array_equal(new, on):
            break
        on = new if new.any() else heights == heights.max()
    else:
        raise SolverFailure(f"sliding contact: no set of points settles after {SETS}")
    climbed, followed = (surface.through(surface.along, f) for f in (heights, surface.through(surface.soft, p)))
    mu, loss = (float((p * slope).mean() / p.mean()) for slope in (climbed, followed))
    return Slid(p, np.where(on, 0.0, gap), mu, loss, float(on.mean()))


def _started(
    heights: np.ndarray, size: tuple[float, float], modulus: Callable[..., Value], speed: float, pressure: float
) -> tuple[np.ndarray, np.ndarray]:
    """Contact and pressure to start from: those of every other point, or all points where they are few."""
    nx, ny = heights.shape
    along, across = (2 if n > COARSE and n % 2 == 0 else 1 for n in (nx, ny))
    if along == 1:
        return np.ones(heights.shape, dtype=bool), np.full(heights.shape, pressure)
    coarse = slide(heights[::along, ::across], size, modulus, speed, pressure)
    p = np.repeat(np.repeat(coarse.pressure, along, axis=0), across, axis=1)
    return p > 0.0, p
