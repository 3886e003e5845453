"""Linear-Gaussian arithmetic of hypotheses: everything follows from products of whitened columns.

Data r = C d + noise of unit variance, d normal about `mean` with standard deviation `sd`.  Per block of data
only the products of C and r are kept, so that any choice of columns, priors and blocks is a small matrix.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import lsq_linear


@dataclass(frozen=True)
class Block:
    """Whitened data of one recording or trace: residual `r` (n,), columns `C` (n, k), several `names` per column.

    `F` (n, f) are columns that many blocks share, with their products `FF`; they are numbered after those of C.
    `condition` its number, `held_out` whether no fit may see it.
    """

    label: str
    condition: int
    held_out: bool
    r: np.ndarray
    C: np.ndarray
    names: tuple[tuple[str, int], ...]
    F: np.ndarray
    FF: np.ndarray

    @property
    def count(self) -> int:
        return len(self.r)


@dataclass(frozen=True)
class Solution:
    """Estimate `d` and `covariance` of the columns `names`; `ln_evidence` and `chi2` of data with priors."""

    names: tuple[str, ...]
    d: np.ndarray
    covariance: np.ndarray
    ln_evidence: float
    chi2: float
    count: int

    def __getitem__(self, name: str) -> float:
        return float(self.d[self.names.index(name)])

    def sd(self, name: str) -> float:
        """Standard error of one column's strength."""
        i = self.names.index(name)
        return float(np.sqrt(self.covariance[i, i]))

    def as_dict(self) -> dict[str, float]:
        return dict(zip(self.names, self.d.tolist(), strict=True))


class System:
    """Products of all columns of all blocks."""

    def __init__(self, blocks: Iterable[Block]):
        self.blocks = list(blocks)
        self.names: list[str] = list(dict.fromkeys(n for b in self.blocks for n, _ in b.names))
        self.index = {n: i for i, n in enumerate(self.names)}
        self.parts = [self._products(b) for b in self.blocks]

    def _products(self, block: Block):
        C, k = block.C.astype(float), block.C.shape[1]
        F = block.F
        G = np.empty((k + F.shape[1],) * 2)
        G[:k, :k], G[k:, k:] = C.T @ C, block.FF
        G[k:, :k] = F.T @ C
        G[:k, k:] = G[k:, :k].T
        g = np.concatenate([C.T @ block.r, F.T @ block.r])
        at = np.array([self.index[n] for n, _ in block.names], dtype=int)
        col = np.array([c for _, c in block.names], dtype=int)
        return at, G[np.ix_(col, col)], g[col], float(block.r @ block.r)

    def total(self, keep=None) -> tuple[np.ndarray, np.ndarray, float, int]:
        """C'C, C'r, r'r and the number of data of the blocks for which keep(block) holds, those fitted by default."""
        keep = keep or (lambda b: not b.held_out)
        n = len(self.names)
        N, b, rr, count = np.zeros((n, n)), np.zeros(n), 0.0, 0
        for block, (at, G, g, own) in zip(self.blocks, self.parts, strict=True):
            if keep(block):
                N[np.ix_(at, at)] += G
                b[at] += g
                rr, count = rr + own, count + block.count
        return N, b, rr, count

    def solve(self, priors: dict[str, tuple[float, float]], products=None) -> Solution:
        """Estimate the columns named in `priors` {name: (mean, sd)}; those that no block knows are left out."""
        names = tuple(n for n in priors if n in self.index)
        at = [self.index[n] for n in names]
        N, b, rr, count = products or self.total()
        mean = np.array([priors[n][0] for n in names])
        sd = np.array([priors[n][1] for n in names])
        A = sd[:, None] * N[np.ix_(at, at)] * sd[None] + np.eye(len(at))
        rhs = sd * b[at] + mean / sd
        factor = cho_factor(A, lower=True)
        u = cho_solve(factor, rhs)
        chi2 = rr + float(np.sum((mean / sd) ** 2)) - float(rhs @ u)
        ln_det = 2.0 * float(np.sum(np.log(np.diag(factor[0]))))
        inverse = cho_solve(factor, np.eye(len(at)))
        return Solution(names, sd * u, sd[:, None] * inverse * sd[None], -0.5 * (chi2 + ln_det), chi2, count)

    def bounded(self, priors: dict[str, tuple[float, float]], most: float) -> Solution:
        """As `solve`, but no column may leave its prior mean by more than `most` standard deviations."""
        free = self.solve(priors)
        at = [self.index[n] for n in free.names]
        N, b, rr, count = self.total()
        mean, sd = (np.array([priors[n][i] for n in free.names]) for i in (0, 1))
        A = sd[:, None] * N[np.ix_(at, at)] * sd[None] + np.eye(len(at))
        rhs, middle = sd * b[at] + mean / sd, mean / sd
        L = np.linalg.cholesky(A)
        u = lsq_linear(L.T, np.linalg.solve(L, rhs), (middle - most, middle + most)).x
        chi2 = rr + float(middle @ middle) + float(u @ A @ u - 2.0 * rhs @ u)
        return Solution(free.names, sd * u, free.covariance, free.ln_evidence, chi2, count)

    def projected(self, nuisance: dict[str, tuple[float, float]], wanted: list[str], products=None):
        """What the nuisances cannot absorb: score u (w,), information I (w, w) and its raw diagonal (w,)."""
        N, b, _, _ = products or self.total()
        at = [self.index[n] for n in nuisance if n in self.index]
        sd = np.array([nuisance[n][1] for n in nuisance if n in self.index])
        mean = np.array([nuisance[n][0] for n in nuisance if n in self.index])
        own = [self.index[n] for n in wanted]
        factor = cho_factor(sd[:, None] * N[np.ix_(at, at)] * sd[None] + np.eye(len(at)), lower=True)
        cross = sd[:, None] * N[np.ix_(at, own)]
        solved = cho_solve(factor, cross)
        raw = N[np.ix_(own, own)]
        u = b[own] - solved.T @ (sd * b[at] + mean / sd)
        return u, raw - cross.T @ solved, np.diag(raw)


def residual(block: Block, solution: Solution) -> np.ndarray:
    """What is left of a block's data (n,), in sigma."""
    found = solution.as_dict()
    k = block.C.shape[1]
    d = np.zeros(k + block.F.shape[1])
    for name, column in block.names:
        d[column] += found.get(name, 0.0)
    return block.r - block.C @ d[:k] - block.F @ d[k:]
