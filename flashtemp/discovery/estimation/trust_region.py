"""Steps of a Gauss-Newton method in a rectangular trust region, with bounds.

The region is a box, so that bounds of parameters and the region itself are one set of limits and the subproblem is a
bounded linear least-squares problem, solved exactly (Voglis and Lagaris, "A rectangular trust region dogleg approach",
WSEAS 2004).  Its size follows the ratio of actual to predicted reduction with the usual constants (Nocedal and
Wright, Numerical Optimization, 2006, algorithm 4.1).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

FIRST_RADIUS = 2.0  # in units of the scale of each parameter: prior standard deviations
MAX_RADIUS = 8.0
POOR_RATIO, GOOD_RATIO = 0.25, 0.75  # of actual to predicted reduction (Nocedal and Wright, algorithm 4.1)
SHRINK_FACTOR, GROW_FACTOR = 0.25, 2.0  # of the radius (same)
LIMITED_STEP_FRACTION = 0.99  # fraction of the radius from which a step counts as limited by it


@dataclass(frozen=True)
class QuadraticModel:
    """A quadratic model of an objective: reduction g.d - d.S.d/2 by a step d (k,), with d in [low, high] (k,)."""

    gradient: Array
    hessian: Array
    low: Array
    high: Array

    def predicted_reduction(self, step: Array) -> float:
        """Predicted reduction of the objective by a step."""
        return float(self.gradient @ step - 0.5 * step @ self.hessian @ step)

    def best_step(self, radius: Array | float = np.inf) -> Array:
        """The step (k,) of largest predicted reduction within bounds and the box of half widths `radius` (k,)."""
        from scipy.optimize import lsq_linear

        if not len(self.gradient):
            return np.zeros(0)
        low, high = np.maximum(self.low, -radius), np.minimum(self.high, radius)
        # S = L L' turns eq. (44) into |L' d - L^-1 g|^2 / 2; a tiny ridge makes S definite where data say nothing
        scale = np.sqrt(np.maximum(np.diag(self.hessian), 1e-300))
        S = self.hessian / np.outer(scale, scale)
        S[np.diag_indices_from(S)] += 1e-12
        lower = np.linalg.cholesky(S)
        target = np.linalg.solve(lower, self.gradient / scale)
        free = np.linalg.solve(lower.T, target) / scale
        if np.all((free >= low) & (free <= high)):  # then it solves eq. (44) without a limit
            return free
        fixed = high - low < 1e-12 * (1.0 + np.abs(np.where(np.isfinite(low), low, 0.0)))
        high = np.where(fixed, low + 1e-12, high)  # lsq_linear wants room between its bounds
        found = lsq_linear(lower.T, target, (low * scale, high * scale), method="bvls").x / scale
        return np.asarray(np.clip(found, low, high))


@dataclass(frozen=True)
class TrustRegion:
    """A box about a point: half width `radius` in units of the `scale` (k,) of each parameter."""

    radius: float = FIRST_RADIUS

    def limited_step(self, model: QuadraticModel, scale: Array) -> Array:
        return model.best_step(self.radius * scale)

    def next_region(self, ratio: float, step: Array, scale: Array) -> TrustRegion:
        """The region for the next step, by the ratio of actual to predicted reduction of the last one."""
        size = float(np.max(np.abs(step) / scale, initial=0.0))
        # the step, not the box, is what failed: it may have been far shorter (eq. (45))
        if ratio < POOR_RATIO:
            return TrustRegion(SHRINK_FACTOR * size)
        if ratio > GOOD_RATIO and size > LIMITED_STEP_FRACTION * self.radius:
            return TrustRegion(min(GROW_FACTOR * self.radius, MAX_RADIUS))
        return self
