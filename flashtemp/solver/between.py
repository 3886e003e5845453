"""Interpolation in time between integration steps: states of a run, and differences of perturbed runs."""

from __future__ import annotations

import numpy as np

from flashtemp.solver.march import StepHistory


class StateInterpolant:
    """State of a run at any time of a segment, linear between the steps of the integrator."""

    def __init__(self, path: StepHistory):
        self.t, self.y = np.array([t for t, _ in path]), [y for _, y in path]

    def __call__(self, t: float) -> np.ndarray:
        k = int(np.clip(np.searchsorted(self.t, t), 1, len(self.t) - 1))
        w = (t - self.t[k - 1]) / (self.t[k] - self.t[k - 1])
        return (1.0 - w) * self.y[k - 1] + w * self.y[k]


def interpolate_quadratic(u: float, at, S) -> np.ndarray:
    """Value at `u` of the parabola through three steps (`at`, S), or of the line through the last two.

    The line is used if the first two places are equal, as after the first step.
    """
    (a, b, c), (A, B, C) = at, S
    if a == b:
        return B + (u - b) / (c - b) * (C - B)
    first, second = (B - A) / (b - a), (C - B) / (c - b)
    return B + (u - b) * (second + (u - c) * (second - first) / (c - a))
