"""Warn of a mesh that is coarser than the coarsest verified one, with an estimate of its error.

`benchmarks/mesh_error.py` measures FACE_ERROR_PERCENT and writes it to `benchmarks/results/mesh_error.json`.
"""

from __future__ import annotations

import numpy as np

from flashtemp.model.case import Case
from flashtemp.model.schema import MESH_LEVEL_FACTORS, refinement_factor

COARSEST_VERIFIED_FACTOR = MESH_LEVEL_FACTORS["coarse"]  # factor on the number of cells per direction
# factor on the number of cells: largest error of the face temperature between 0.05 L and 0.95 L, in percent of the
# largest temperature rise, for uniform pressure, a pressure peak at the leading edge, and friction theory, at 0.1 and
# 1 m/s
FACE_ERROR_PERCENT = {
    0.05: 52.0,
    0.1: 20.0,
    0.15: 11.0,
    0.2: 5.0,
    0.25: 3.8,
    0.3: 2.5,
    0.4: 1.3,
    0.5: 0.9,
    0.7: 0.4,
    1.0: 0.2,
}


def estimate_face_error(factor: float) -> float:
    """Error of the face temperature (percent of the largest rise) at a factor on the number of cells per direction.

    Log-log interpolation of measured errors, constant outside their range.
    """
    return float(
        np.exp(np.interp(np.log(factor), np.log(list(FACE_ERROR_PERCENT)), np.log(list(FACE_ERROR_PERCENT.values()))))
    )


def find_coarse_factor(case: Case) -> float | None:
    """The factor on the number of cells where a sliding block has fewer than the coarsest verified mesh, else None."""
    factor = refinement_factor(case["numerics.mesh"]) * min(case["numerics.finer"])
    is_verified = factor >= COARSEST_VERIFIED_FACTOR * (1 - 1e-9)
    return None if is_verified or case.scene.schedule.alone else factor


def warn_of_coarse_mesh(case: Case) -> list[str]:
    """A warning where a sliding block has fewer cells in some direction than the coarsest verified mesh."""
    factor = find_coarse_factor(case)
    if factor is None:
        return []
    return [
        f"mesh coarser than verified: numerics.mesh with numerics.finer gives {factor:.3g} times the cells per "
        f"direction; the error of the face temperature is about {estimate_face_error(factor):.2g} % of the largest "
        f"rise, instead of {estimate_face_error(COARSEST_VERIFIED_FACTOR):.2g} % at the coarsest verified factor "
        f"{COARSEST_VERIFIED_FACTOR:g}; give a finer numerics.mesh"
    ]
