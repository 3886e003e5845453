"""The profile of a recording through its largest difference, measured and computed, for a plot."""

from __future__ import annotations

from typing import Any

import numpy as np

from flashtemp.camera.recording import Recording
from flashtemp.comparison.noise import ResidualPeak

DECIMALS_K, DECIMALS_MM = 3, 4
MAX_PROFILE_POINTS = 400


def find_largest_profile(
    recording: Recording, predicted: np.ndarray, residual: np.ndarray, largest: ResidualPeak | None
) -> dict[str, Any] | None:
    """T(x) of the row and frame with the largest difference, for points T(t) of the point, as in compare.json.

    None where nothing is compared.  Without a largest difference it is the middle row of the last frame.
    """
    frame, row, column = len(recording.time) - 1, len(recording.v) // 2, 0
    if largest is not None:
        frame = int(np.argmin(np.abs(recording.time - largest.time)))
        row = int(np.argmin(np.abs(recording.v - largest.v)))
        column = int(np.argmin(np.abs(recording.u - largest.u)))
    over_time = recording.places is not None
    cut = (slice(None), row, column) if over_time else (frame, row, slice(None))
    measured, computed = recording.temperature[cut], predicted[cut]
    compared = np.flatnonzero(np.isfinite(residual[cut]) & np.isfinite(measured) & np.isfinite(computed))
    if not len(compared):
        return None
    kept = compared[:: -(-len(compared) // MAX_PROFILE_POINTS)]
    at = recording.time if over_time else 1e3 * recording.u
    return {
        "over": "time_s" if over_time else "x_mm",
        "at": np.round(at[kept], DECIMALS_MM).tolist(),
        "measured_degC": np.round(measured[kept], DECIMALS_K).tolist(),
        "computed_degC": np.round(computed[kept], DECIMALS_K).tolist(),
        "point": recording.places.names[column] if recording.places is not None else None,
        "time_s": None if over_time else float(recording.time[frame]),
        "v_mm": None if over_time or recording.is_single_row else float(1e3 * recording.v[row]),
    }
