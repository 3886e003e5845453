"""Solve (1 - gamma J) X = R for many right-hand sides by generalised conjugate residuals (GCR).

Eisenstat, Elman and Schultz, SIAM J. Numer. Anal. 20 (1983) 345, with the depth-line sweeps as preconditioner.  The
preconditioner alone would not do: it leaves out the widening of lanes, and with long steps that error grows from step
to step.
"""

from __future__ import annotations

import numpy as np

from flashtemp.physics.just_in_time import njit
from flashtemp.solver.linearisation import LinearisedSystem, ShiftedLinearisation

MAX_RESIDUAL_RATIO, MAX_GCR_SWEEPS = 0.1, 4  # accepted residual over the right-hand side; most iterations
FASTMATH_SUM = {"reassoc", "contract", "nsz"}  # sums may be reordered, so that they run on vector registers


def solve_shifted_system(
    linearisation: LinearisedSystem | ShiftedLinearisation, size: int, ledger: int, R: np.ndarray
) -> np.ndarray:
    """(1 - gamma J)^-1 R for right-hand sides R (k, n) with n <= `size`, the length of a state.

    Entries from `ledger` on are integrals of the others and follow from them exactly.
    """
    X, (directions, products) = np.empty_like(R), np.empty((2, MAX_GCR_SWEEPS, size))
    r = np.empty(size)
    for k, row in enumerate(R):
        r[: len(row)], r[len(row) :] = row, 0.0
        X[k] = _solve_one(linearisation, r, ledger, directions, products)[: len(row)]
    return X


def _solve_one(
    linearisation: LinearisedSystem | ShiftedLinearisation,
    r: np.ndarray,
    ledger: int,
    directions: np.ndarray,
    products: np.ndarray,
) -> np.ndarray:
    """One solution (size,).  `r` is the right-hand side and is overwritten by the residual.

    `directions`, `products` (sweeps, size) are buffers for the search directions and their products with 1 - gamma J.
    """
    x = np.zeros_like(r)
    enough = MAX_RESIDUAL_RATIO * np.linalg.norm(r[:ledger])
    for n in range(len(directions)):
        linearisation.solve(r, directions[n])
        linearisation.apply_jacobian(directions[n], products[n])
        if _reduce_residual(directions[: n + 1], products[: n + 1], linearisation.gamma, ledger, r, x) <= enough:
            break
    x[ledger:] += r[ledger:]
    return x


@njit(cache=True, fastmath=FASTMATH_SUM)
def _reduce_residual(directions, products, gamma, ledger, r, x):
    """One GCR step along the last of the `directions`, which updates x and r in place; returns the residual norm.

    On entry the last of the `products` is J times the direction.  Both are orthogonalised against the earlier ones and
    normalised, as to their products without the ledger.  Returns 0 for a direction without any product.
    """
    direction, product, before = directions[-1], products[-1], len(directions) - 1
    for i in range(len(r)):
        product[i] = direction[i] - gamma * product[i]
    # sums end before the ledger: it follows the cells exactly (`_solve_one`) and has other units
    for n in range(before):
        projection = 0.0
        for i in range(ledger):
            projection += products[n, i] * product[i]
        for i in range(len(r)):
            product[i] -= projection * products[n, i]
            direction[i] -= projection * directions[n, i]
    square = projection = 0.0
    for i in range(ledger):
        square += product[i] * product[i]
        projection += r[i] * product[i]
    if not square > 0.0:
        return 0.0
    norm, residual = np.sqrt(square), 0.0
    for i in range(len(r)):
        direction[i] /= norm
        product[i] /= norm
        x[i] += projection / norm * direction[i]
        r[i] -= projection / norm * product[i]
    for i in range(ledger):
        residual += r[i] * r[i]
    return np.sqrt(residual)
