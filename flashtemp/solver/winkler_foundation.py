"""Nominal contact pressure of a rubber block on a spring (Winkler) foundation.

Pressure balances the load at every instant, and the friction moment if the holder can tilt (theory.md, section 7.1).
With f = p_mean shape - k_n w, the pressure of the worn block before the holder moves:

    p = max(0, f + c + t xi),      xi = 1 - 2x/L,
    sum p dx = P,                  c approach of the holder, Pa,
    (L/2) sum p xi dx + K t = M    t tilt of the holder, Pa at the leading edge; K = inf: t = 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from flashtemp.errors import SolverFailure
from flashtemp.physics.just_in_time import njit
from flashtemp.solver import kernels_contact


class PressureSolution(NamedTuple):
    """Local pressure (columns,) Pa, lowering of the leading edge by the tilt (m), columns in contact, and K (m2)."""

    pressure: np.ndarray
    tilt: float
    touching: np.ndarray
    tilt_stiffness: float


@dataclass(frozen=True)
class SpringFoundation:
    """Columns of area `dx` (m2 per m across) at `x` (m) under a block of `length` (m) and `stiffness` k_n (Pa/m)."""

    x: np.ndarray
    dx: np.ndarray
    length: float
    stiffness: float

    @cached_property
    def _edge_coordinate(self) -> np.ndarray:
        """1 at the leading edge (columns,), -1 at the trailing one."""
        xi: np.ndarray = 1.0 - 2.0 * self.x / self.length
        return xi

    @cached_property
    def _total_length(self) -> float:
        """Sum of `dx`, m."""
        return float(self.dx.sum())

    def solve_equilibrium(self, unloaded, mean: float, moment=0.0, tilt_stiffness: float = np.inf) -> PressureSolution:
        """Pressure that carries the `mean` (Pa) and, where `tilt_stiffness` K is finite, the `moment` (N per m).

        `unloaded` is f (columns,) Pa.  Columns that would have to pull lift off.  A complex step in f or moment passes
        through.  Raises SolverFailure if the block tips over.
        """
        load = mean * self._total_length
        if load == 0:
            return PressureSolution(0.0 * unloaded, 0.0, np.zeros(len(unloaded), dtype=bool), np.inf)
        guided = tilt_stiffness == np.inf
        if (
            guided
            and not np.iscomplexobj(unloaded)
            and unloaded.min() >= 0
            and abs(unloaded @ self.dx - load) <= 1e-14 * load
        ):
            # it carries the load already: return it unchanged to the last bit
            return PressureSolution(unloaded, 0.0, np.ones(len(unloaded), dtype=bool), tilt_stiffness)
        if np.iscomplexobj(unloaded) or np.iscomplexobj(moment):
            unloaded, moment = unloaded + 0j, moment + 0j
        stiff, touching, pressure = (
            0.0 if guided else tilt_stiffness,
            np.ones(len(unloaded), dtype=np.bool_),
            np.empty_like(unloaded),
        )
        t, converged = _balance_load(
            unloaded, self.dx, self._edge_coordinate, 0.5 * self.length, load, moment, stiff, guided, touching, pressure
        )
        if not converged:
            raise SolverFailure("the friction moment tips the block over its edge: no contact pressure balances it")
        if abs(pressure.real @ self.dx - load) > 1e-8 * load:
            raise SolverFailure("no contact pressure balances load and friction moment; use a stiffer holder")
        return PressureSolution(pressure, t / self.stiffness, touching, tilt_stiffness)

    def pressure_response(self, solution: PressureSolution) -> SpringResponse:
        """Linear response of the pressure to worn depth around a solution."""
        on = solution.touching.astype(float)
        U, V = on[:, None], (self.dx * on)[None]
        G = V @ U if solution.touching.any() else np.eye(1)  # no contact: the response is zero
        if solution.tilt_stiffness < np.inf and solution.touching.any():
            xi = self._edge_coordinate
            U = np.stack([on, xi * on], axis=1)
            V = np.stack([self.dx * on, 0.5 * self.length * xi * self.dx * on])
            G = V @ U + np.diag([0.0, solution.tilt_stiffness])
        return SpringResponse(self.stiffness * on, U, V, G)


@dataclass(frozen=True)
class SpringResponse:
    """dp = -(K - U G^-1 V K) dw: a worn column loses its load, and the holder moves it to the other columns.

    `K` (columns,) is k_n in contact, else 0; U (columns, m), V (m, columns), G (m, m) with m = 1 for a guided holder
    and 2 for one that tilts.
    """

    K: np.ndarray
    U: np.ndarray
    V: np.ndarray
    G: np.ndarray

    def __call__(self, worn: np.ndarray) -> np.ndarray:
        """Change of pressure (columns,) Pa by a change of worn depth (columns,) m."""
        free: np.ndarray = -self.K * worn
        kernels_contact.redistribute_load(self._load_spread, self.V, free)
        return free

    @cached_property
    def _load_spread(self) -> np.ndarray:
        """U G^-1 (columns, m)."""
        spread: np.ndarray = self.U @ np.linalg.inv(self.G)
        return spread

    def build_wear_inverse(self, depth_per_pressure: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """The implicit step of the worn depth: solves (1 - diag(g) dp/dw) dw = r for any r.

        `depth_per_pressure` g (columns,) m/Pa is the worn depth of the step per pressure.
        """
        # dp/dw = -K + U G^-1 V K: independent springs, and a holder of rank m that moves the load.  The matrix is
        # diag(1 + g K) minus g U G^-1 V K, so Woodbury's identity leaves one inverse of (m, m).
        diagonal = 1.0 + depth_per_pressure * self.K
        X = (depth_per_pressure / diagonal)[:, None] * self.U
        inner = np.linalg.inv(self.G - (self.V * self.K) @ X)

        def apply_inverse(r: np.ndarray) -> np.ndarray:
            return r / diagonal + X @ (inner @ (self.V @ (self.K * r / diagonal)))

        return apply_inverse


@njit(cache=True)
def _balance_load(free, dx, xi, lever, load, moment, tilt_stiffness, guided, touching, pressure):
    """Tilt t, and whether the iteration converged; writes `touching` (columns,) and `pressure` (columns,) Pa.

    Newton's method on the active set: for a given set the equations are linear, so it ends when the set repeats.
    """
    n = len(free)
    c, t = 0.0 * free[0] + 0.0 * moment, 0.0 * free[0] + 0.0 * moment
    for attempt in range(200):
        a = b = d = 0.0
        r, s = load + 0.0 * c, moment + 0.0 * c
        for i in range(n):
            if touching[i]:
                a += dx[i]
                b += xi[i] * dx[i]
                d += lever * xi[i] * xi[i] * dx[i]
                r -= free[i] * dx[i]
                s -= lever * xi[i] * free[i] * dx[i]
        if a <= 0.0:
            return t, False
        leaning = False
        if guided:
            new_c, new_t = r / a, 0.0 * r
        else:
            det = a * (d + tilt_stiffness) - lever * b * b
            leaning = det <= 1e-9 * a * (lever * a + tilt_stiffness)
            if leaning:  # contact on one column leaves the tilt free: a weak spring fixes it until more columns touch
                d += 1e-3 * lever * a
                det = a * (d + tilt_stiffness) - lever * b * b
            new_c, new_t = ((d + tilt_stiffness) * r - b * s) / det, (a * s - lever * b * r) / det
        if attempt > 30:  # two sets that alternate: take half steps
            new_c, new_t = 0.5 * (c + new_c), 0.5 * (t + new_t)
        c, t = new_c, new_t
        same = True
        for i in range(n):
            touches = free[i].real + c.real + t.real * xi[i] > 0.0
            same = same and touches == touching[i]
            touching[i] = touches
        if same and not leaning and (attempt <= 30 or attempt > 80):
            for i in range(n):
                pressure[i] = free[i] + c + t * xi[i] if touching[i] else 0.0
            return t, True
    return t, False
