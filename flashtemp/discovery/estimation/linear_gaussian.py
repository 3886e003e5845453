"""Linear-Gaussian arithmetic of hypotheses: everything follows from products of whitened columns.

Data r = C d + noise of unit variance, d normal about `mean` with standard deviation `sd`.  Per block of data
only the products of C and r are kept, so that any choice of columns, priors and blocks is a small matrix.
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
MAX_KEPT_BYTES = 1e8  # of what eliminated recordings take from products: some sizes of 40 recordings
GRAM_CHUNK_ROWS = 8192  # of columns that are multiplied at a time: about what a core keeps near it


@dataclass(frozen=True)
class DataBlock:
    """Whitened data of one recording or trace: residual `r` (n,), columns `C` (n, k), several `names` per column.

    `F` (n, f) are columns that many blocks share, with their products `FF`; they are numbered after those of C.
    `condition` its number, `held_out` whether no fit may see it.
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
        """With those wanted columns of another block of the same data that this one lacks."""
        have, own, others = {n for n, _ in self.names}, self.C.shape[1], other.C.shape[1]
        lent = [(n, c) for n, c in other.names if c < others and n not in have and is_wanted(n)]
        columns = sorted({c for _, c in lent})
        at = {c: own + i for i, c in enumerate(columns)}
        shared = tuple((n, c if c < own else c + len(columns)) for n, c in self.names)
        names = (*shared, *((n, at[c]) for n, c in lent))
        out = replace(self, C=np.hstack([self.C, other.C[:, columns]]), names=names)
        if self.F is other.F and "gram" in vars(other):  # most columns are lent: their products need no data again
            vars(out)["gram"] = out._gram_with_lent(other.gram, own, [*columns, *range(others, len(other.gram))])
        return out

    @cached_property
    def gram(self) -> Array:
        """Products (k + f, k + f) of all columns, C before F, in double precision."""
        square, cross = gram_matrices([self.C], [self.F])
        return np.block([[square, cross.T], [cross, self.FF]])

    def _gram_with_lent(self, known: Array, own: int, columns: list[int]) -> Array:
        """Products of the first `own` columns with all, and those of the others, which are `columns` of `known_columns`."""
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
    """`matrix` C'C (k, k), `right` C'r (k,), `square` r'r and the number `count` of data; `eliminated` is what
    `EvidenceFunction` keeps of them."""

    matrix: Array
    right: Array
    square: float
    count: int
    eliminated: dict[bytes, Eliminated] = field(default_factory=dict, init=False, repr=False, compare=False)


@dataclass(frozen=True)
class BlockEquations:
    """Normal equations of one block, for the columns `at` (k,) of the system."""

    at: npt.NDArray[np.int64]
    equations: NormalEquations


@dataclass(frozen=True)
class Solution:
    """Estimate `d` and `covariance` of the columns `names`; `ln_evidence` and `chi2` of data with priors."""

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
        """Standard error of one column's strength."""
        i = self._column_index[name]
        return float(np.sqrt(self.covariance[i, i]))

    def as_dict(self) -> dict[ParameterId, float]:
        return dict(zip(self.names, self.d.tolist(), strict=True))


@dataclass(frozen=True)
class Projection:
    """What nuisances cannot absorb of some columns: `score` u (w,), `information` I (w, w) and its `raw` diagonal."""

    score: Array
    information: Array
    raw: Array


def gram_matrices(own: Sequence[Columns], others: Sequence[Columns] = ()) -> tuple[Array, Array]:
    """A^T A and B^T A in double precision, A the columns (n, ...) of `own` side by side and B those of `others`.

    By parts of the rows, each converted once: a copy of all of them would be much memory.
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
    """Products of all columns of all blocks."""

    def __init__(self, blocks: Iterable[DataBlock]):
        self.blocks = list(blocks)
        self.index = _number_columns(self.blocks)
        self.names = list(self.index)
        self.parts = [self._block_equations(b) for b in self.blocks]

    def with_residuals(self, residuals: Mapping[str, Array]) -> LinearSystem:
        """The same columns with other residuals, by label."""
        out = copy(self)
        out.blocks = [b.with_residual(residuals[b.label]) for b in self.blocks]
        out.parts = [
            replace(p, equations=_with_block_residual(p.equations, b))
            for p, b in zip(self.parts, out.blocks, strict=True)
        ]
        return out

    def with_blocks(self, changed: Mapping[str, DataBlock]) -> LinearSystem:
        """The same with other blocks by label; products of those that stay are kept."""
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
        """The same products with some columns of all conditions one for each of them, named with its number."""
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
        """Those of the blocks for which keep(block) holds, of those fitted by default.

        `variances` {label: times that the variance of its noise is larger than stated} of blocks.
        """
        n = len(self.names)
        N, b, rr, count = np.zeros((n, n)), np.zeros(n), 0.0, 0
        for block, part in zip(self.blocks, self.parts, strict=True):
            if keep(block) if keep else not block.held_out:
                own, weight = part.equations, 1.0 / (variances or {}).get(block.label, 1.0)
                N[np.ix_(part.at, part.at)] += weight * own.matrix
                b[part.at] += weight * own.right
                rr, count = rr + weight * own.square, count + own.count
        return NormalEquations(N, b, rr, count)

    def block_chi2(self, solution: Solution) -> list[float]:
        """Sum of squares of what a solution leaves of every block's data."""
        found, out = solution.as_dict(), []
        d = np.array([found.get(n, 0.0) for n in self.names])
        for part in self.parts:
            own, equations = d[part.at], part.equations
            out.append(equations.square + float(own @ (equations.matrix @ own - 2.0 * equations.right)))
        return out

    def solve(self, priors: Priors, equations: NormalEquations | None = None) -> Solution:
        """Estimate the columns named in `priors`; those that no block knows are left out."""
        total = equations or self.normal_equations()
        names = self.known_columns(priors)
        right, matrix = self._select_columns(names, total)
        found = _solve_posterior(right, matrix, total.square, *_prior_moments(priors, names))
        inverse = cho_solve((found.lower, True), np.eye(len(names)), check_finite=False)
        covariance = found.sd[:, None] * inverse * found.sd[None]
        return Solution(names, found.sd * found.u, covariance, found.ln_evidence, found.chi2, total.count)

    @property
    def fitted_columns(self) -> frozenset[ParameterId]:
        """Columns that any block knows which is fitted."""
        return frozenset(n for b in self.blocks if not b.held_out for n, _ in b.names)

    def fit_heldout_nuisances(self, solution: Solution, priors: Priors) -> Solution:
        """With what only blocks know that are held out, of their own, such as where their images lie, estimated from
        them; all that is shared or fitted stands as it was found."""
        if not any(b.held_out for b in self.blocks):
            return solution
        seen = self.fitted_columns
        own = np.flatnonzero([n not in seen and not n.is_shared for n in solution.names])
        if not len(own):
            return solution
        total, at = self.normal_equations(lambda b: b.held_out), np.array([self.index[n] for n in solution.names])
        matrix, others = total.matrix[np.ix_(at, at)], np.setdiff1d(np.arange(len(at)), own)
        right = total.right[at[own]] - matrix[np.ix_(own, others)] @ solution.d[others]
        mean, sd = _prior_moments(priors, tuple(solution.names[i] for i in own.tolist()))
        found = _solve_posterior(right, matrix[np.ix_(own, own)], total.square, mean, sd)
        inverse = sd[:, None] * cho_solve((found.lower, True), np.diag(sd), check_finite=False)
        follow = -inverse @ matrix[np.ix_(own, others)]  # what is found when what is shared differs by one
        d, covariance = solution.d.copy(), solution.covariance.copy()
        d[own] = found.sd * found.u
        covariance[np.ix_(own, others)] = follow @ covariance[np.ix_(others, others)]
        covariance[np.ix_(others, own)] = covariance[np.ix_(own, others)].T
        covariance[np.ix_(own, own)] = inverse + covariance[np.ix_(own, others)] @ follow.T
        return replace(solution, d=d, covariance=covariance)

    def evidence_function(self, priors: Priors, equations: NormalEquations | None = None) -> EvidenceFunction:
        """The ln evidence as a function of the standard deviations of the columns that `priors` name."""
        total, names = equations or self.normal_equations(), self.known_columns(priors)
        at = np.array([self.index[n] for n in names], dtype=int)
        files = [n.file for n in names]
        groups = [
            np.array([i for i, f in enumerate(files) if f == file]) for file in dict.fromkeys(filter(None, files))
        ]
        shared = np.array([i for i, f in enumerate(files) if not f], dtype=int)
        everything = np.array([i for i, n in enumerate(self.names) if not n.file], dtype=int)
        return EvidenceFunction(total, at, _prior_moments(priors, names)[0], shared, tuple(groups), everything)

    def known_columns(self, priors: Priors) -> tuple[ParameterId, ...]:
        """Columns of those named that a block knows."""
        return tuple(n for n in priors if n in self.index)

    def _select_columns(self, names: tuple[ParameterId, ...], total: NormalEquations) -> tuple[Array, Array]:
        """Right-hand side and matrix of some columns."""
        at = [self.index[n] for n in names]
        return total.right[at], total.matrix[np.ix_(at, at)]

    def solve_bounded(self, priors: Priors, max_deviation: float, equations: NormalEquations | None = None) -> Solution:
        """As `solve`, but no column may leave its prior mean by more than `max_deviation` standard deviations."""
        total = equations or self.normal_equations()
        free = self.solve(priors, total)
        at = [self.index[n] for n in free.names]
        mean, sd = (np.array([priors[n][i] for n in free.names]) for i in (0, 1))
        A = sd[:, None] * total.matrix[np.ix_(at, at)] * sd[None] + np.eye(len(at))
        rhs, middle = sd * total.right[at] + mean / sd, mean / sd
        L = np.linalg.cholesky(A)
        u = lsq_linear(L.T, np.linalg.solve(L, rhs), (middle - max_deviation, middle + max_deviation)).x
        chi2 = total.square + float(middle @ middle) + float(u @ A @ u - 2.0 * rhs @ u)
        return Solution(free.names, sd * u, free.covariance, free.ln_evidence, chi2, total.count)

    def project_out(
        self, nuisance: Priors, wanted: list[ParameterId], equations: NormalEquations | None = None
    ) -> Projection:
        """What the nuisances cannot absorb of the columns `wanted`."""
        total = equations or self.normal_equations()
        N, b = total.matrix, total.right
        at = [self.index[n] for n in nuisance if n in self.index]
        sd = np.array([nuisance[n][1] for n in nuisance if n in self.index])
        mean = np.array([nuisance[n][0] for n in nuisance if n in self.index])
        own = [self.index[n] for n in wanted]
        factor = cho_factor(sd[:, None] * N[np.ix_(at, at)] * sd[None] + np.eye(len(at)), lower=True)
        cross = sd[:, None] * N[np.ix_(at, own)]
        solved = cho_solve(factor, cross)
        raw = N[np.ix_(own, own)]
        u = b[own] - solved.T @ (sd * b[at] + mean / sd)
        return Projection(u, raw - cross.T @ solved, np.diag(raw))


def _number_columns(blocks: Iterable[DataBlock]) -> dict[ParameterId, int]:
    """All columns that blocks know, in the order in which they name them."""
    return {n: i for i, n in enumerate(dict.fromkeys(n for b in blocks for n, _ in b.names))}


class Eliminated(NamedTuple):
    """What the columns of one recording take from products of the columns that recordings share, right-hand side last
    (s + 1, s + 1), and the ln determinant that they leave."""

    taken: Array
    ln_det: float


@dataclass(frozen=True)
class EvidenceFunction:
    """ln evidence of data for columns of many widths: those of one recording alone (`groups`, indices) are eliminated
    recording by recording, so that only the `shared` ones are a dense matrix (block arrowhead, Schur complement).

    `at` (columns,) are their numbers in `normal_equations`, whose columns `everything` are shared.  A recording is eliminated from
    all of them at once: hypotheses that differ in what is shared alone find it done.
    """

    total: NormalEquations
    at: Indices
    mean: Array
    shared: Indices
    groups: tuple[Indices, ...]
    everything: Indices

    def __call__(self, sd: Array) -> float:
        """ln evidence with standard deviations `sd` (columns,); a column of none is left out."""
        s = self.shared[sd[self.shared] > 0.0]
        wide, at = np.append(sd[s], 1.0), self.at[s]
        left = np.zeros((len(s) + 1, len(s) + 1))
        left[:-1, :-1] = self.total.matrix[np.ix_(at, at)]
        left[:-1, -1] = left[-1, :-1] = self.total.right[at]
        ln_det, squares = 0.0, self.total.square
        places = np.append(np.searchsorted(self.everything, at), len(self.everything))
        for group in self.groups:
            found = self._eliminated(group[sd[group] > 0.0], sd)
            left -= found.taken[np.ix_(places, places)]
            ln_det += found.ln_det
        left *= wide[:, None] * wide
        own = np.flatnonzero(sd > 0.0)
        squares += float(np.sum((self.mean[own] / sd[own]) ** 2)) + float(left[-1, -1])
        A = left[:-1, :-1]
        A[np.diag_indices_from(A)] += 1.0
        lower = cho_factor(A, lower=True, overwrite_a=True, check_finite=False)[0]
        rhs = left[:-1, -1] + self.mean[s] / sd[s]
        u = cho_solve((lower, True), rhs, check_finite=False)
        return -0.5 * (squares - float(rhs @ u) + ln_det + 2.0 * float(np.sum(np.log(np.diag(lower)))))

    def _eliminated(self, own: Indices, sd: Array) -> Eliminated:
        """The columns `own` of one recording eliminated from all that are shared."""
        at, wide, mean, kept = self.at[own], sd[own], self.mean[own], self.total.eliminated
        key = at.tobytes() + wide.tobytes() + mean.tobytes()
        if key not in kept:
            A = wide[:, None] * self.total.matrix[np.ix_(at, at)] * wide
            A[np.diag_indices_from(A)] += 1.0
            right = wide * self.total.right[at] + mean / wide
            cross = np.column_stack([wide[:, None] * self.total.matrix[np.ix_(at, self.everything)], right])
            lower = np.linalg.cholesky(A)
            half = solve_triangular(lower, cross, lower=True, check_finite=False)
            if len(kept) >= MAX_KEPT_BYTES / (8 * cross.shape[1] ** 2):
                kept.clear()
            kept[key] = Eliminated(half.T @ half, 2.0 * float(np.sum(np.log(np.diag(lower)))))
        return kept[key]


class _PosteriorEstimate(NamedTuple):
    """Estimate `u` in units of `sd`, with the Cholesky factor `lower` of its inverse covariance."""

    u: Array
    sd: Array
    lower: Array
    chi2: float
    ln_evidence: float


def _prior_moments(priors: Priors, names: tuple[ParameterId, ...]) -> tuple[Array, Array]:
    """Means and standard deviations of the columns."""
    both = np.array([priors[n] for n in names]).reshape(-1, 2)
    return both[:, 0], both[:, 1]


def _solve_posterior(right: Array, matrix: Array, square: float, mean: Array, sd: Array) -> _PosteriorEstimate:
    """The estimate from normal equations of the columns and their priors."""
    A = sd[:, None] * matrix * sd[None]
    A[np.diag_indices_from(A)] += 1.0
    rhs = sd * right + mean / sd
    lower = cho_factor(A, lower=True, overwrite_a=True, check_finite=False)[0]
    u = cho_solve((lower, True), rhs, check_finite=False)
    chi2 = square + float(np.sum((mean / sd) ** 2)) - float(rhs @ u)
    ln_det = 2.0 * float(np.sum(np.log(np.diag(lower))))
    return _PosteriorEstimate(u, sd, lower, chi2, -0.5 * (chi2 + ln_det))


def _with_block_residual(equations: NormalEquations, block: DataBlock) -> NormalEquations:
    """Normal equations with the residual that a block has now."""
    square, cross = gram_matrices([block.r], [block.C, block.F])
    return replace(equations, right=cross[_column_of_names(block), 0], square=float(square[0, 0]))


def _column_of_names(block: DataBlock) -> npt.NDArray[np.int64]:
    """Which column every name of a block stands for."""
    return np.array([c for _, c in block.names], dtype=int)


def predicted_change(block: DataBlock, solution: Solution) -> Array:
    """What a solution adds to a block's prediction (n,), in sigma."""
    found = solution.as_dict()
    k = block.C.shape[1]
    d = np.zeros(k + block.F.shape[1])
    for name, column in block.names:
        d[column] += found.get(name, 0.0)
    out = np.empty(block.count)
    for first in range(0, len(out), GRAM_CHUNK_ROWS):
        part = slice(first, first + GRAM_CHUNK_ROWS)
        out[part] = block.C[part] @ d[:k] + block.F[part] @ d[k:]
    return out


def whitened_residual(block: DataBlock, solution: Solution) -> Array:
    """What is left of a block's data (n,), in sigma."""
    return block.r - predicted_change(block, solution)
