"""Answers of a linearised run to many right-hand sides: (1 - gamma J)^-1 R by generalised conjugate residuals.

Eisenstat, Elman and Schultz, SIAM J. Numer. Anal. 20 (1983) 345, algorithm GCR, preconditioned by the run's own sweep.
One sweep alone leaves out how widening lanes answer: what it leaves grows from step to step once steps are long.
"""

from __future__ import annotations

import numpy as np

from flashtemp.solver.linearised import Linearised, Moved

SOLVED, SWEEPS = 0.1, 4  # share of a right-hand side that may be left, sweeps at most


def solve(at: Linearised | Moved, size: int, ledger: int, R: np.ndarray) -> np.ndarray:
    """(1 - gamma J)^-1 R for right-hand sides (k, n), n up to the `size` of a state.

    The ledger, from entry `ledger` on, follows the rest exactly.
    """
    X = np.empty_like(R)
    for k, r in enumerate(R):
        X[k] = _solved(at, np.append(r, np.zeros(size - len(r))), ledger)[: len(r)]
    return X


def _solved(at: Linearised | Moved, r: np.ndarray, ledger: int) -> np.ndarray:
    """One solution (state,); r is its right-hand side and becomes what is left."""
    x = np.zeros_like(r)
    found: list[tuple[np.ndarray, np.ndarray]] = []
    enough = SOLVED * np.linalg.norm(r[:ledger])
    for _ in range(SWEEPS):
        z, w = np.zeros_like(r), np.empty_like(r)
        at.solve(r, z)
        at.times(z, w)
        w = z - at.gamma * w
        for way, answer in found:
            share = answer[:ledger] @ w[:ledger]
            w -= share * answer
            z -= share * way
        size = np.linalg.norm(w[:ledger])
        if not size > 0.0:
            break
        found.append((z / size, w / size))
        share = r[:ledger] @ found[-1][1][:ledger]
        x += share * found[-1][0]
        r -= share * found[-1][1]
        if np.linalg.norm(r[:ledger]) <= enough:
            break
    x[ledger:] += r[ledger:]
    return x
