"""Linear-Gaussian estimation and evidence from normal equations of whitened data.

The data are r = C d + noise of unit variance, with d normal about `mean` with standard deviation `sd`.  The products of
C and r are computed once for each block of data.  Any choice of columns, priors and blocks is then a small matrix.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.optimize import lsq_linear

from flashtemp.discovery.parameters import ParameterId, Priors

Array = npt.NDArray[np.float64]
Columns = npt.NDArray[np.floating[Any]]  # kept in single precision, multiplied in double
Indices = npt.NDArray[np.int64]
MAX_KEPT_BYTES = 1e8  # of cached Schur complements of recordings: several prior widths of 40 recordings
GRAM_CHUNK_ROWS = 8192  # rows that are multiplied at a time, so that they fit the cache of a core


@dataclass(frozen=True)
class DataBlock:
    """Whitened data of one recording or load-cell record: residual `r` (n,) and columns `C` (n, k).

    `names`: pairs of parameter and column number; several parameters may share a column.  `F` (n, f): columns that many
    blocks share, with their products `FF` (f, f); they are numbered after those of C.
    `condition`: its number.  `held_out`: whether it is excluded from every fit.
    """

    label: str
    condition: int
    held_out: bool
    r: Array
    C: Columns
    names: tuple[tuple[ParameterId, int], ...]
    F: Columns
    FF: Array

    @property
    def count(self) -> int:
        return len(self.r)

    def with_columns_of(self, other: DataBlock, is_wanted: Callable[[ParameterId], bool]) -> DataBlock:
        """The block with the wanted columns of another block of the same data that it lacks."""
        have, own, others = {n for n, _ in self.names}, self.C.shape[1], other.C.shape[1]
        lent = [(n, c) for n, c in other.names if c < others and n not in have and is_wanted(n)]
        columns = sorted({c for _, c in lent})
        at = {c: own + i for i, c in enumerate(columns)}
        shared = tuple((n, c if c < own else c + len(columns)) for n, c in self.names)
        names = (*shared, *((n, at[c]) for n, c in lent))
        out = replace(self, C=np.hstack([self.C, other.C[:, columns]]), names=names)
        if self.F is other.F and "gram" in vars(other):  # most columns are copies, so their products are known already
            vars(out)["gram"] = out._gram_with_lent(other.gram, own, [*columns, *range(others, len(other.gram))])
        return out

    @cached_property
    def gram(self) -> Array:
        """Products (k + f, k + f) of all columns, C before F, in double precision."""
        square, cross = gram_matrices([self.C], [self.F])
        return np.block([[square, cross.T], [cross, self.FF]])

    def _gram_with_lent(self, known: Array, own: int, columns: list[int]) -> Array:
        """`gram` if only the first `own` columns are new; the others are the `columns` of the products `known`."""
        square, cross = gram_matrices([self.C[:, :own]], [self.C[:, own:], self.F])
        return np.block([[square, cross.T], [cross, known[np.ix_(columns, columns)]]])

    def with_residual(self, r: Array) -> DataBlock:
        """The same columns with another residual."""
        out = replace(self, r=r)
        if "gram" in vars(self):
            vars(out)["gram"] = self.gram
        return out


@dataclass(frozen=True)
class NormalEquations:
    """`matrix` C'C (k, k), `right` C'r (k,), `square` r'r and the number `count` of data.

    `ln_noise`: sum over all data of the logarithm of the noise standard deviation, relative to the stated one.
    `schur_complements` is a cache of `EvidenceFunction`.
    """

    matrix: Array
    right: Array
    square: float
    count: int
    ln_noise: float = 0.0
    schur_complements: dict[bytes, SchurComplement] = field(default_factory=dict, init=False, repr=False, compare=False)


@dataclass(frozen=True)
class BlockEquations:
    """Normal equations of one block, for the columns `at` (k,) of the system."""

    at: npt.NDArray[np.int64]
    equations: NormalEquations


@dataclass(frozen=True)
class Solution:
    """Estimate `d` (k,) and `covariance` (k, k) of the parameters `names`; `ln_evidence` and `chi2` of data and priors;
    `count` of data."""

    names: tuple[ParameterId, ...]
    d: Array
    covariance: Array
    ln_evidence: float
    chi2: float
    count: int

    @cached_property
    def _column_index(self) -> dict[ParameterId, int]:
        return {n: i for i, n in enumerate(self.names)}

    def __getitem__(self, name: ParameterId) -> float:
        return float(self.d[self._column_index[name]])

    def sd(self, name: ParameterId) -> float:
        """Standard error of one parameter."""
        i = self._column_index[name]
        return float(np.sqrt(self.covariance[i, i]))

    def as_dict(self) -> dict[ParameterId, float]:
        return dict(zip(self.names, self.d.tolist(), strict=True))


@dataclass(frozen=True)
class Projection:
    """Some columns after nuisances were projected out: `score` (w,), `information` (w, w), and the diagonal `raw` (w,)
    of the information before."""

    score: Array
    information: Array
    raw: Array


def gram_matrices(own: Sequence[Columns], others: Sequence[Columns] = ()) -> tuple[Array, Array]:
    """A^T A and B^T A in double precision, A the columns (n, ...) of `own` side by side and B those of `others`.

    Rows are converted to double precision in parts, because a copy of all of them would need much memory.
    """
    square, cross, n = (
        np.zeros((_count_columns(own),) * 2),
        np.zeros((_count_columns(others), _count_columns(own))),
        len(own[0]),
    )
    for first in range(0, n, GRAM_CHUNK_ROWS):
        a, b = (_stack_rows(columns, slice(first, min(first + GRAM_CHUNK_ROWS, n))) for columns in (own, others))
        square += a.T @ a
        cross += b.T @ a
    return square, cross


def _count_columns(columns: Sequence[Columns]) -> int:
    return sum(1 if c.ndim == 1 else c.shape[1] for c in columns)


def _stack_rows(columns: Sequence[Columns], part: slice) -> Array:
    """A part of the rows of columns, side by side in double precision."""
    out, at = np.empty((part.stop - part.start, _count_columns(columns)), order="F"), 0
    for c in columns:
        wide = _count_columns((c,))
        out[:, at : at + wide] = c[part].reshape(len(out), wide)
        at += wide
    return out


class LinearSystem:
    """Blocks of data with a common numbering of their columns (`names`, `index`) and their normal equations."""

    def __init__(self, blocks: Iterable[DataBlock]):
        self.blocks = list(blocks)
        self.index = _number_columns(self.blocks)
        self.names = list(self.index)
        self.parts = [self._block_equations(b) for b in self.blocks]

    def with_residuals(self, residuals: Mapping[str, Array]) -> LinearSystem:
        """The system with other residuals, by label of the block."""
        out = copy(self)
        out.blocks = [b.with_residual(residuals[b.label]) for b in self.blocks]
        out.parts = [
            replace(p, equations=_with_block_residual(p.equations, b))
            for p, b in zip(self.parts, out.blocks, strict=True)
        ]
        return out

    def with_blocks(self, changed: Mapping[str, DataBlock]) -> LinearSystem:
        """The system with some blocks replaced, by label; products of the others are not computed again."""
        out = copy(self)
        out.blocks = [changed.get(b.label, b) for b in self.blocks]
        out.index = _number_columns(out.blocks)
        out.names = list(out.index)
        out.parts = [
            out._block_equations(b) if b.label in changed else replace(p, at=out._column_numbers(b))
            for p, b in zip(self.parts, out.blocks, strict=True)
        ]
        return out

    def split_by_condition(self, own: Iterable[ParameterId]) -> LinearSystem:
        """The system in which each parameter in `own` is replaced by one parameter for each condition."""
        out, mine = copy(self), set(own)
        out.blocks = [
            replace(b, names=tuple((replace(n, condition=b.condition) if n in mine else n, c) for n, c in b.names))
            for b in self.blocks
        ]
        out.index = _number_columns(out.blocks)
        out.names = list(out.index)
        out.parts = [replace(p, at=out._column_numbers(b)) for p, b in zip(self.parts, out.blocks, strict=True)]
        return out

    def _block_equations(self, block: DataBlock) -> BlockEquations:
        square, cross = gram_matrices([block.r], [block.C, block.F])
        col = _column_of_names(block)
        own = NormalEquations(block.gram[np.ix_(col, col)], cross[col, 0], float(square[0, 0]), block.count)
        return BlockEquations(self._column_numbers(block), own)

    def _column_numbers(self, block: DataBlock) -> npt.NDArray[np.int64]:
        return np.array([self.index[n] for n, _ in block.names], dtype=int)

    def normal_equations(
        self, keep: Callable[[DataBlock], bool] | None = None, variances: Mapping[str, float] | None = None
    ) -> NormalEquations:
        """Normal equations of the blocks for which keep(block) is true, by default of all that are not held out.

        `variances` {label: factor}: noise variance of a block relative to the stated one.
        """
        n = len(self.names)
        N, b, rr, count, ln_noise = np.zeros((n, n)), np.zeros(n), 0.0, 0, 0.0
        for block, part in zip(self.blocks, self.parts, strict=True):
            if keep(block) if keep else not block.held_out:
                own, weight = part.equations, 1.0 / (variances or {}).get(block.label, 1.0)
                ln_noise -= 0.5 * own.count * float(np.log(weight))
                N[np.ix_(part.at, part.at)] += weight * own.matrix
                b[part.at] += weight * own.right
                rr, count = rr + weight * own.square, count + own.count
        return NormalEquations(N, b, rr, count, ln_noise)

    def block_chi2(self, solution: Solution) -> list[float]:
        """Sum of squared residuals of every block with a solution."""
        values, out = solution.as_dict(), []
        d = np.array([values.get(n, 0.0) for n in self.names])
        for part in self.parts:  # |r - C d|^2 from the products: the data themselves are not read again
            own, equations = d[part.at], part.equations
            out.append(equations.square + float(own @ (equations.matrix @ own - 2.0 * equations.right)))
        return out

    def solve(self, priors: Priors, equations: NormalEquations | None = None) -> Solution:
        """Posterior mean and covariance of the parameters in `priors`, without those that have no column."""
        total = equations or self.normal_equations()
        names = self.known_columns(priors)
        right, matrix = self._select_columns(names, total)
        found = _solve_posterior(right, matrix, total.square, *_prior_means_and_sds(priors, names))
        inverse = cho_solve((found.lower, True), np.eye(len(names)), check_finite=False)
        covariance = found.sd[:, None] * inverse * found.sd[None]
        # a larger variance of n data costs n/2 of its logarithm: the normalisation in eq. (41)
        ln_evidence = found.ln_evidence - total.ln_noise
        return Solution(names, found.sd * found.u, covariance, ln_evidence, found.chi2, total.count)

    @property
    def fitted_columns(self) -> frozenset[ParameterId]:
        """Parameters that have a column in a block that is not held out."""
        return frozenset(n for b in self.blocks if not b.held_out for n, _ in b.names)

    def fit_heldout_nuisances(self, solution: Solution, priors: Priors) -> Solution:
        """A solution in which parameters of held-out recordings alone, such as their image placements, are estimated
        from those recordings; shared and fitted parameters stay as they are."""
        if not any(b.held_out for b in self.blocks):
            return solution
        fitted = self.fitted_columns
        own = np.flatnonzero([n not in fitted and not n.is_shared for n in solution.names])
        if not len(own):
            return solution
        total, at = self.normal_equations(lambda b: b.held_out), np.array([self.index[n] for n in solution.names])
        matrix, others = total.matrix[np.ix_(at, at)], np.setdiff1d(np.arange(len(at)), own)
        # held-out data may not move the shared parameters: these stay as they are and only shift the right-hand side
        right = total.right[at[own]] - matrix[np.ix_(own, others)] @ solution.d[others]
        mean, sd = _prior_means_and_sds(priors, tuple(solution.names[i] for i in own.tolist()))
        found = _solve_posterior(right, matrix[np.ix_(own, own)], total.square, mean, sd)
        inverse = sd[:, None] * cho_solve((found.lower, True), np.diag(sd), check_finite=False)
        follow = -inverse @ matrix[np.ix_(own, others)]  # change of the own parameters per unit of the shared ones
        d, covariance = solution.d.copy(), solution.covariance.copy()
        # own = (own data at given shared parameters) + follow shared, so the error of the shared ones adds to theirs
        d[own] = found.sd * found.u
        covariance[np.ix_(own, others)] = follow @ covariance[np.ix_(others, others)]
        covariance[np.ix_(others, own)] = covariance[np.ix_(own, others)].T
        covariance[np.ix_(own, own)] = inverse + covariance[np.ix_(own, others)] @ follow.T
        return replace(solution, d=d, covariance=covariance)

    def evidence_function(self, priors: Priors, equations: NormalEquations | None = None) -> EvidenceFunction:
        """The ln evidence as a function of the prior standard deviations of the parameters in `priors`."""
        total, names = equations or self.normal_equations(), self.known_columns(priors)
        at = np.array([self.index[n] for n in names], dtype=int)
        files = [n.file for n in names]
        groups = [
            np.array([i for i, f in enumerate(files) if f == file]) for file in dict.fromkeys(filter(None, files))
        ]
        shared = np.array([i for i, f in enumerate(files) if not f], dtype=int)
        everything = np.array([i for i, n in enumerate(self.names) if not n.file], dtype=int)
        return EvidenceFunction(total, at, _prior_means_and_sds(priors, names)[0], shared, tuple(groups), everything)

    def known_columns(self, priors: Priors) -> tuple[ParameterId, ...]:
        """The parameters in `priors` that have a column."""
        return tuple(n for n in priors if n in self.index)

    def _select_columns(self, names: tuple[ParameterId, ...], total: NormalEquations) -> tuple[Array, Array]:
        """Right-hand side (k,) and matrix (k, k) of some parameters."""
        at = [self.index[n] for n in names]
        return total.right[at], total.matrix[np.ix_(at, at)]

    def solve_bounded(self, priors: Priors, limits: Mapping[ParameterId, float], total: NormalEquations) -> Solution:
        """As `solve`, but a parameter with a limit deviates by at most as many prior standard deviations."""
        free = self.solve(priors, total)
        at = [self.index[n] for n in free.names]
        mean, sd = (np.array([priors[n][i] for n in free.names]) for i in (0, 1))
        reach = np.array([limits.get(n, np.inf) for n in free.names])
        if np.all(np.abs(free.d - mean) <= reach * sd):
            return free
        A = sd[:, None] * total.matrix[np.ix_(at, at)] * sd[None] + np.eye(len(at))
        rhs, middle = sd * total.right[at] + mean / sd, mean / sd
        # |L' u - L^-1 rhs|^2 is the quadratic form of A up to a constant, which lsq_linear minimises within bounds
        L = np.linalg.cholesky(A)
        u = lsq_linear(L.T, np.linalg.solve(L, rhs), (middle - reach, middle + reach)).x
        chi2 = total.square + float(middle @ middle) + float(u @ A @ u - 2.0 * rhs @ u)
        return Solution(free.names, sd * u, free.covariance, free.ln_evidence, chi2, total.count)

    def project_out(
        self, nuisance: Priors, wanted: list[ParameterId], equations: NormalEquations | None = None
    ) -> Projection:
        """Information on the parameters `wanted` after marginalising over the nuisances (Schur complement)."""
        total = equations or self.normal_equations()
        N, b = total.matrix, total.right
        at = [self.index[n] for n in nuisance if n in self.index]
        sd = np.array([nuisance[n][1] for n in nuisance if n in self.index])
        mean = np.array([nuisance[n][0] for n in nuisance if n in self.index])
        own = [self.index[n] for n in wanted]
        # eq. (42); in units of the prior widths P needs no inverse of a vanishing width
        factor = cho_factor(sd[:, None] * N[np.ix_(at, at)] * sd[None] + np.eye(len(at)), lower=True)
        cross = sd[:, None] * N[np.ix_(at, own)]
        solved = cho_solve(factor, cross)
        raw = N[np.ix_(own, own)]
        u = b[own] - solved.T @ (sd * b[at] + mean / sd)
        return Projection(u, raw - cross.T @ solved, np.diag(raw))


def _number_columns(blocks: Iterable[DataBlock]) -> dict[ParameterId, int]:
    """{parameter: number} of all parameters of the blocks, in order of first occurrence."""
    return {n: i for i, n in enumerate(dict.fromkeys(n for b in blocks for n, _ in b.names))}


class SchurComplement(NamedTuple):
    """What eliminating the columns of one recording subtracts from the products of the shared columns, eq. (42).

    `matrix` (s + 1, s + 1) has the right-hand side last; `ln_det` is ln det of the eliminated block.
    """

    matrix: Array
    ln_det: float


@dataclass(frozen=True)
class EvidenceFunction:
    """ln evidence as a function of the prior widths of all parameters, for many evaluations.

    The matrix is a block arrowhead: parameters of one recording alone (`groups`, indices) are eliminated recording by
    recording (Schur complement), so that only the `shared` ones need a dense matrix.
    `at` (k,): numbers of the parameters in the normal equations `total`; `everything`: all shared columns there.  A
    recording is eliminated from all of them at once and the result is cached, so that hypotheses that differ only in
    shared parameters use it again.
    """

    total: NormalEquations
    at: Indices
    mean: Array
    shared: Indices
    groups: tuple[Indices, ...]
    everything: Indices

    def __call__(self, sd: Array) -> float:
        """ln evidence with standard deviations `sd` (k,); a parameter with sd 0 is left out."""
        s = self.shared[sd[self.shared] > 0.0]
        # the right-hand side is the last column, so one subtraction eliminates all recordings from both (eq. (42))
        wide, at = np.append(sd[s], 1.0), self.at[s]
        left = np.zeros((len(s) + 1, len(s) + 1))
        left[:-1, :-1] = self.total.matrix[np.ix_(at, at)]
        left[:-1, -1] = left[-1, :-1] = self.total.right[at]
        places = np.append(np.searchsorted(self.everything, at), len(self.everything))
        found = self._eliminate_recordings(sd)
        left -= found.matrix[np.ix_(places, places)]  # Schur complement (eq. (42)): its ln det adds to eq. (41)
        left *= wide[:, None] * wide
        own = np.flatnonzero(sd > 0.0)
        squares = self.total.square + float(np.sum((self.mean[own] / sd[own]) ** 2)) + float(left[-1, -1])
        A = left[:-1, :-1]
        A[np.diag_indices_from(A)] += 1.0
        lower = cho_factor(A, lower=True, overwrite_a=True, check_finite=False)[0]
        rhs = left[:-1, -1] + self.mean[s] / sd[s]
        u = cho_solve((lower, True), rhs, check_finite=False)
        return -0.5 * (squares - float(rhs @ u) + found.ln_det + 2.0 * float(np.sum(np.log(np.diag(lower)))))

    def _eliminate_recordings(self, sd: Array) -> SchurComplement:
        """The sum of the Schur complements of all recordings, from the cache if it is there."""
        kept = self.total.schur_complements
        groups = [group[sd[group] > 0.0] for group in self.groups]
        own = np.concatenate([np.empty(0, dtype=int), *groups])
        key = b"sum" + self.at[own].tobytes() + sd[own].tobytes() + self.mean[own].tobytes()
        if key not in kept:
            matrix, ln_det = np.zeros((len(self.everything) + 1,) * 2), 0.0
            for group in groups:
                part = self._schur_complement(group, sd)
                matrix += part.matrix
                ln_det += part.ln_det
            self._keep_in_cache(key, SchurComplement(matrix, ln_det))
        return kept[key]

    def _schur_complement(self, own: Indices, sd: Array) -> SchurComplement:
        """The Schur complement of the parameters `own` of one recording, from the cache if it is there."""
        at, wide, mean, kept = self.at[own], sd[own], self.mean[own], self.total.schur_complements
        key = at.tobytes() + wide.tobytes() + mean.tobytes()
        if key not in kept:
            A = wide[:, None] * self.total.matrix[np.ix_(at, at)] * wide
            A[np.diag_indices_from(A)] += 1.0
            right = wide * self.total.right[at] + mean / wide
            cross = np.column_stack([wide[:, None] * self.total.matrix[np.ix_(at, self.everything)], right])
            lower = np.linalg.cholesky(A)
            # cross' A^-1 cross = half' half, symmetric to the last digit and at half the cost of a solve
            half = solve_triangular(lower, cross, lower=True, check_finite=False)
            self._keep_in_cache(key, SchurComplement(half.T @ half, 2.0 * float(np.sum(np.log(np.diag(lower))))))
        return kept[key]

    def _keep_in_cache(self, key: bytes, found: SchurComplement) -> None:
        kept = self.total.schur_complements
        if len(kept) >= MAX_KEPT_BYTES / found.matrix.nbytes:
            kept.clear()
        kept[key] = found


class _PosteriorEstimate(NamedTuple):
    """Estimate `u` (k,) in units of `sd`, with the Cholesky factor `lower` of its inverse covariance."""

    u: Array
    sd: Array
    lower: Array
    chi2: float
    ln_evidence: float


def _prior_means_and_sds(priors: Priors, names: tuple[ParameterId, ...]) -> tuple[Array, Array]:
    """Prior means and standard deviations (k,) of some parameters."""
    both = np.array([priors[n] for n in names]).reshape(-1, 2)
    return both[:, 0], both[:, 1]


def _solve_posterior(right: Array, matrix: Array, square: float, mean: Array, sd: Array) -> _PosteriorEstimate:
    """The posterior estimate from normal equations and priors; unknowns are scaled by their prior widths."""
    # unknowns in units of their prior widths: A of eq. (41) is well conditioned however little the data say
    A = sd[:, None] * matrix * sd[None]
    A[np.diag_indices_from(A)] += 1.0
    rhs = sd * right + mean / sd
    lower = cho_factor(A, lower=True, overwrite_a=True, check_finite=False)[0]
    u = cho_solve((lower, True), rhs, check_finite=False)
    chi2 = square + float(np.sum((mean / sd) ** 2)) - float(rhs @ u)
    ln_det = 2.0 * float(np.sum(np.log(np.diag(lower))))
    return _PosteriorEstimate(u, sd, lower, chi2, -0.5 * (chi2 + ln_det))


def _with_block_residual(equations: NormalEquations, block: DataBlock) -> NormalEquations:
    """Normal equations with the present residual of a block."""
    square, cross = gram_matrices([block.r], [block.C, block.F])
    return replace(equations, right=cross[_column_of_names(block), 0], square=float(square[0, 0]))


def _column_of_names(block: DataBlock) -> npt.NDArray[np.int64]:
    """The column number (names,) of every name of a block."""
    return np.array([c for _, c in block.names], dtype=int)


def predicted_change(block: DataBlock, solution: Solution) -> Array:
    """Change (n,) of a block's prediction by a solution, in standard deviations of its noise."""
    values = solution.as_dict()
    k = block.C.shape[1]
    d = np.zeros(k + block.F.shape[1])
    for name, column in block.names:  # several parameters may share a column: their values add
        d[column] += values.get(name, 0.0)
    out = np.empty(block.count)
    for first in range(0, len(out), GRAM_CHUNK_ROWS):
        part = slice(first, first + GRAM_CHUNK_ROWS)
        out[part] = block.C[part] @ d[:k] + block.F[part] @ d[k:]
    return out


def whitened_residual(block: DataBlock, solution: Solution) -> Array:
    """Residual (n,) of a block with a solution, in standard deviations of its noise."""
    return block.r - predicted_change(block, solution)
