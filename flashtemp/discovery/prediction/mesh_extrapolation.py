"""Richardson extrapolation: the mesh error of a prediction, estimated from meshes that are coarser in one direction.

A scheme of order p on cells of size h errs by C h^p.  A mesh with cells r times as large differs from it by
C h^p (r^p - 1), so the exact value exceeds the prediction by that difference, prediction minus coarser prediction, over
r^p - 1 (Richardson 1911; Roache 1994, J. Fluids Eng. 116:405).  The finite volumes are of second order.
"""

from __future__ import annotations

from typing import Any

from flashtemp.model.case import Case

# cell factors of the runs that estimate the mesh error: along, up and down, and across in 3D
COARSER_CELL_FACTORS = ((0.6, 1.0, 1.0), (1.0, 0.6, 1.0), (1.0, 1.0, 0.6))
COARSER_ACROSS_FACTORS = (1.0, 1.0, 1.0, 0.5)
ORDER_OF_ACCURACY = 2
MIN_MESH_REFINEMENT = 0.1  # of numerics.finer that a case may give


def coarser_mesh_factors(case: Case) -> tuple[tuple[float, ...], ...]:
    """Cell factors of the meshes that estimate the mesh error of a case."""
    return (*COARSER_CELL_FACTORS, COARSER_ACROSS_FACTORS) if case["numerics.across"] > 1 else COARSER_CELL_FACTORS


def coarser_mesh_keys(case: Case, along: float, up: float, down: float, across: float = 1.0) -> dict[str, Any]:
    """Keys of a mesh with these factors on the number of cells."""
    finer = zip((along, up, down), case["numerics.finer"], strict=True)
    out: dict[str, Any] = {"numerics.finer": [max(MIN_MESH_REFINEMENT, k * f) for k, f in finer]}
    if across < 1.0:
        out["numerics.across"] = max(2, round(across * case["numerics.across"]))
        if first := case["numerics.first_y"]:
            out["numerics.first_y"] = first * case["numerics.across"] / out["numerics.across"]
    return out


def error_per_difference(case: Case, factors: tuple[float, ...]) -> float:
    """The mesh error as a fraction of the difference to the mesh of a case with these factors on the number of cells.

    The factors are those that the mesh can have: few cells across cannot be halved.  0 if no mesh is coarser.
    """
    keys = coarser_mesh_keys(case, *factors)
    ratios = [new / old for new, old in zip(keys["numerics.finer"], case["numerics.finer"], strict=True)]
    if "numerics.across" in keys:
        ratios.append(keys["numerics.across"] / case["numerics.across"])
    return 1.0 / (min(ratios) ** -ORDER_OF_ACCURACY - 1.0) if min(ratios) < 1.0 else 0.0
