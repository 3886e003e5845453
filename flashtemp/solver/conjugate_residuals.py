"""Answers of a linearised run to many right-hand sides: (1 - gamma J)^-1 R by generalised conjugate residuals.

Eisenstat, Elman and Schultz, SIAM J. Numer. Anal. 20 (1983) 345, algorithm GCR, preconditioned by the run's own sweep.
One sweep alone leaves out how widening lanes answer: what it leaves grows from step to step once steps are long.
"""

from __future__ import annotations

import numpy as np

from flashtemp.physics.just_in_time import njit
from flashtemp.solver.linearisation import LinearisedSystem, ShiftedLinearisation

MAX_RESIDUAL_RATIO, MAX_GCR_SWEEPS = 0.1, 4  # share of a right-hand side that may be left, sweeps at most
FASTMATH_SUM = {"reassoc", "contract", "nsz"}


def solve_shifted_system(
    linearisation: LinearisedSystem | ShiftedLinearisation, size: int, ledger: int, R: np.ndarray
) -> np.ndarray:
    """(1 - gamma J)^-1 R for right-hand sides (k, n), n up to the `size` of a state.

    The ledger, from entry `ledger` on, follows the rest exactly.
    """
    X, (ways, answers) = np.empty_like(R), np.empty((2, MAX_GCR_SWEEPS, size))
    r = np.empty(size)
    for k, given in enumerate(R):
        r[: len(given)], r[len(given) :] = given, 0.0
        X[k] = _solve_one(linearisation, r, ledger, ways, answers)[: len(given)]
    return X


def _solve_one(
    linearisation: LinearisedSystem | ShiftedLinearisation,
    r: np.ndarray,
    ledger: int,
    directions: np.ndarray,
    products: np.ndarray,
) -> np.ndarray:
    """One solution (state,); r is its right-hand side and becomes what is left; `directions`, `products` is room for them."""
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
    """Size of what is left of r once x went the last of the `directions`, at whose place in `products` stands J times it.

    Way and answer are made orthogonal to those before, and of size 1; 0 where the way leads nowhere.
    """
    way, answer, before = directions[-1], products[-1], len(directions) - 1
    for i in range(len(r)):
        answer[i] = way[i] - gamma * answer[i]
    for n in range(before):
        share = 0.0
        for i in range(ledger):
            share += products[n, i] * answer[i]
        for i in range(len(r)):
            answer[i] -= share * products[n, i]
            way[i] -= share * directions[n, i]
    square = share = 0.0
    for i in range(ledger):
        square += answer[i] * answer[i]
        share += r[i] * answer[i]
    if not square > 0.0:
        return 0.0
    size, left = np.sqrt(square), 0.0
    for i in range(len(r)):
        way[i] /= size
        answer[i] /= size
        x[i] += share / size * way[i]
        r[i] -= share / size * answer[i]
    for i in range(ledger):
        left += r[i] * r[i]
    return np.sqrt(left)
