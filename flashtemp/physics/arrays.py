"""Type aliases: arrays of floats, and values that a law accepts."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Value = Any  # a number or an array; complex where a derivative is computed by the complex-step method
