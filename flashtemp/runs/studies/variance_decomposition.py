"""Variance-based sensitivity: first-order and total Sobol indices of a result by its uncertain inputs.

For a linear result both indices are (slope sd)^2 over the sum of all.  Otherwise the result is expanded in polynomials
that are orthonormal under the priors of the inputs, fitted to a Latin hypercube (polynomial chaos).  The variance is
the sum of squared coefficients, so the indices need no further runs (Sudret 2008).  The designs of Saltelli and Jansen
need k + 2 runs for every row.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Powers = tuple[int, ...]
MAX_POWER, MAX_CUBIC_INPUTS = 4, 6  # highest power of one input; number of inputs in mixed terms of third order
TERM_COST_ROWS = 3.0  # degrees of freedom of a term chosen among many (Friedman 1991)
MAX_TERMS_PER_ROW = 0.3  # highest number of terms over number of rows
NEGLIGIBLE_VARIANCE = 1e-10  # fraction of unexplained variance at which the fit stops


@dataclass(frozen=True, eq=False)
class PolynomialChaos:
    """Polynomial expansion in standard normal inputs z: `terms` (powers of every input) with `weights`.

    `unexplained`: fraction of the variance that is not predicted in leave-one-out cross-validation.
    """

    terms: tuple[Powers, ...]
    weights: Array
    unexplained: float

    def __call__(self, z: Array) -> Array:
        """Values (rows,) at z (rows, inputs)."""
        return hermite_basis(z, self.terms) @ self.weights

    @property
    def variance(self) -> float:
        """Variance over the priors."""
        return float(sum(w * w for t, w in zip(self.terms, self.weights, strict=True) if any(t)))

    def first_order_indices(self, count: int) -> Array:
        """First-order Sobol indices (inputs,)."""
        return self._sum_squares(count, lambda t, i: t[i] > 0 and sum(t) == t[i])

    def total_indices(self, count: int) -> Array:
        """Total Sobol indices (inputs,)."""
        return self._sum_squares(count, lambda t, i: t[i] > 0)

    def _sum_squares(self, count: int, belongs) -> Array:
        whole = max(self.variance, 1e-300)
        parts = zip(self.terms, self.weights, strict=True)
        squares = [(t, w * w / whole) for t, w in parts]
        return np.array([sum(s for t, s in squares if belongs(t, i)) for i in range(count)])


def latin_hypercube(rows: int, count: int, seed: int = 0, even: bool = True) -> Array:
    """A Latin hypercube (rows, count) of standard normal deviates; `even`: optimised for uniform filling."""
    from scipy.special import ndtri
    from scipy.stats import qmc

    return np.asarray(
        ndtri(qmc.LatinHypercube(count, seed=seed, optimization="random-cd" if even else None).random(rows))
    )


def linear_shares(slopes: Array) -> Array:
    """Fractions of the variance (inputs,) of a linear result with `slopes` per standard deviation; 0 if constant.

    >>> linear_shares(np.array([3.0, 4.0])).tolist()
    [0.36, 0.64]
    """
    return slopes**2 / max(float(np.sum(slopes**2)), 1e-300)


def hermite_basis(z: Array, terms: tuple[Powers, ...]) -> Array:
    """Products (rows, terms) of orthonormal Hermite polynomials of z (rows, inputs)."""
    one = [np.ones_like(z), z]
    for n in range(2, MAX_POWER + 1):
        one.append((z * one[-1] - np.sqrt(n - 1) * one[-2]) / np.sqrt(n))
    out = np.ones((len(z), len(terms)))
    for k, term in enumerate(terms):
        for i, power in enumerate(term):
            if power:
                out[:, k] *= one[power][:, i]
    return out


def fit_polynomial_chaos(z: Array, values: Array) -> PolynomialChaos:
    """The expansion of `values` (rows,) at z (rows, inputs) with the terms that predict left-out rows best."""
    count, nothing = z.shape[1], (0,) * z.shape[1]
    if np.ptp(values) <= 1e-12 * max(1.0, float(np.abs(values).max())):
        return PolynomialChaos((nothing,), np.array([float(values.mean())]), 0.0)
    alone = [_term_powers(count, {i: n}) for i in range(count) for n in range(1, MAX_POWER + 1)]
    strength = np.abs(hermite_basis(z, tuple(alone)).T @ (values - values.mean())).reshape(count, MAX_POWER).max(axis=1)
    strong = set(np.argsort(strength)[::-1][:MAX_CUBIC_INPUTS].tolist())
    terms = [nothing, *alone]
    for i, j in combinations(range(count), 2):
        terms.append(_term_powers(count, {i: 1, j: 1}))
        if {i, j} <= strong:
            terms += [_term_powers(count, {i: 2, j: 1}), _term_powers(count, {i: 1, j: 2})]
    return _matching_pursuit(hermite_basis(z, tuple(terms)), tuple(terms), values)


def _term_powers(count: int, powers: dict[int, int]) -> Powers:
    return tuple(powers.get(i, 0) for i in range(count))


def _matching_pursuit(design: Array, terms: tuple[Powers, ...], values: Array) -> PolynomialChaos:
    """Orthogonal matching pursuit; the number of terms minimises the corrected leave-one-out error."""
    rows, chosen, spread = len(values), [0], float(np.var(values)) * len(values)
    best: tuple[float, list[int], Array] = (np.inf, [0], np.array([values.mean()]))
    while len(chosen) < MAX_TERMS_PER_ROW * rows:
        part = design[:, chosen]
        q, r = np.linalg.qr(part)
        residual = values - q @ (q.T @ values)
        leverage = np.clip((q**2).sum(axis=1), 0.0, 1.0 - 1e-9)
        correction = (1.0 - len(chosen) / rows) / (1.0 - TERM_COST_ROWS * (len(chosen) - 1) / rows - 1.0 / rows)
        error = float(np.sum((residual / (1.0 - leverage)) ** 2)) / spread * correction**2
        if error < best[0]:
            best = error, list(chosen), np.linalg.solve(r, q.T @ values)
        if np.sum(residual**2) < NEGLIGIBLE_VARIANCE * spread:
            break
        rest = design - q @ (q.T @ design)
        size = np.linalg.norm(rest, axis=0)
        match = np.where(size > 1e-8, np.abs(rest.T @ residual) / np.maximum(size, 1e-300), 0.0)
        match[chosen] = -1.0
        chosen.append(int(np.argmax(match)))
        if len(chosen) > len(terms) - 1:
            break
    error, kept, weights = best
    return PolynomialChaos(tuple(terms[k] for k in kept), weights, min(1.0, error))
