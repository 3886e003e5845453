"""What lies between steps: states of a run at any time, and differences beside it."""

from __future__ import annotations

import numpy as np

from flashtemp.solver.march import StepHistory


class StateInterpolant:
    """States of the run at any time of a stretch, linear between its steps."""

    def __init__(self, path: StepHistory):
        self.t, self.y = np.array([t for t, _ in path]), [y for _, y in path]

    def __call__(self, t: float) -> np.ndarray:
        k = int(np.clip(np.searchsorted(self.t, t), 1, len(self.t) - 1))
        w = (t - self.t[k - 1]) / (self.t[k] - self.t[k - 1])
        return (1.0 - w) * self.y[k - 1] + w * self.y[k]


def interpolate_quadratic(u: float, at, S) -> np.ndarray:
    """The parabola through three steps, or the line through two."""
    (a, b, c), (A, B, C) = at, S
    if a == b:
        return B + (u - b) / (c - b) * (C - B)
    first, second = (B - A) / (b - a), (C - B) / (c - b)
    return B + (u - b) * (second + (u - c) * (second - first) / (c - a))
