"""Find the maximum of a sampled curve, between its nodes or at one of its ends.

>>> find_peak([1.0, 2.0, 4.0], [1.0, 3.0, 1.0])
CurvePeak(at=2.0, value=3.0, first=False, last=False)
>>> find_peak([1.0, 2.0, 4.0], [1.0, 2.0, 3.0]).last
True
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flashtemp.physics.arrays import Value


class CurvePeak(NamedTuple):
    """Position `at` and `value` of a maximum, and whether it is the `first` or the `last` computed point."""

    at: float
    value: float
    first: bool = False
    last: bool = False

    @property
    def is_at_edge(self) -> bool:
        """Whether the curve may be higher beyond the computed range."""
        return self.first or self.last


def find_peak(positions: Value, values: Value) -> CurvePeak:
    """Maximum of `values` (n,) over positive, increasing `positions` (n,) in any unit.

    It is that of a parabola in ln(position) through the highest node and its neighbours.
    """
    positions, values = np.asarray(positions, dtype=float), np.asarray(values, dtype=float)
    i = int(np.argmax(values))
    if i in (0, len(positions) - 1):
        return CurvePeak(float(positions[i]), float(values[i]), i == 0, i == len(positions) - 1)
    x, y = np.log(positions[i - 1 : i + 2] / positions[i]), values[i - 1 : i + 2] - values[i]
    a, b = np.linalg.solve(np.stack([x[::2] ** 2, x[::2]], axis=1), y[::2])
    if not a < 0:
        return CurvePeak(float(positions[i]), float(values[i]))
    return CurvePeak(float(positions[i] * np.exp(-b / (2 * a))), float(values[i] - b * b / (4 * a)))
