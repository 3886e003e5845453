"""Types of numbers in physics: arrays of floats, and values that a law may be given."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Value = Any  # a number or an array, real or, where a derivative is taken by a complex step, complex
