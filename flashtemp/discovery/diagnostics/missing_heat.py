"""What is missing along the contact without any catalogue: regularised inversion of the residual."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flashtemp.comparison.campaign import Condition
from flashtemp.discovery.estimation.linear_gaussian import Array, Solution
from flashtemp.discovery.estimation.linearised_fit import Fit
from flashtemp.discovery.estimation.nuisance_priors import MODE, unnamed_heat
from flashtemp.discovery.parameters import Kind
from flashtemp.discovery.prediction.problem import Problem
from flashtemp.discovery.verdict import Missing
from flashtemp.solver.run import Run


def estimate_missing_heat(problem: Problem, fit: Fit) -> tuple[Missing, ...]:
    """Heat and pressure along the contact that the model lacks: regularised inversion for cosines along the block."""
    found = fit.solved(problem, fit.effects | unnamed_heat(fit.system.names))
    out = []
    for number, (condition, prediction) in enumerate(zip(problem.conditions, fit.predictions, strict=True)):
        out.append(_missing(_shape(found.solution, number, prediction.run), condition, prediction.run))
    return tuple(out)


@dataclass(frozen=True)
class Shape:
    """Cosines along the block at the run's columns, `waves` (n, k), and what was found of them: `d` (k,) with
    `covariance` and prior `sd` (k,); whether each is `steady` (k,) or grows over the repetitions."""

    waves: Array
    d: Array
    covariance: Array
    sd: Array
    steady: npt.NDArray[np.bool_]

    def along(self, weights: Array | float) -> tuple[Array, Array]:
        """The weighted sum of all cosines (n,), with its standard error."""
        B = self.waves * weights
        return B @ self.d, np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", B, self.covariance, B), 0.0))

    def prior(self, weights: Array | float) -> Array:
        """Standard error (n,) of the sum before anything was measured."""
        B = self.waves * weights
        return np.sqrt(np.maximum((B**2) @ self.sd**2, 1e-300))


def _shape(solution: Solution, number: int, run: Run) -> Shape:
    """What was found of the heat and pressure of one condition."""
    free = unnamed_heat(solution.names)
    names = [p for p in solution.names if p in free and p.condition == number]
    names += [p for p in solution.names if p.kind is Kind.MODE]
    at = [solution.names.index(p) for p in names]
    order = np.array([p.index[0] for p in names])
    sd = np.array([free[p][1] if p in free else MODE / p.index[0] for p in names])
    length = run.mesh.x[run.mesh.last]
    return Shape(
        np.cos(np.outer(run.x, order) * np.pi / length), solution.d[at], solution.covariance[np.ix_(at, at)], sd,
        np.array([p.kind is not Kind.TREND for p in names]),
    )  # fmt: skip


def _missing(shape: Shape, condition: Condition, run: Run) -> Missing:
    steady = shape.steady.astype(float)
    pressure, band = shape.along(steady)
    repetition = np.unique(run.repetition)
    sliding = run.sliding & np.isfinite(run.friction)
    flux, flux_sd = [], []
    for r in repetition:
        grown = 2.0 * (r - 1) / max(repetition[-1] - 1, 1) - 1.0
        heat = _heat(run, sliding & (run.repetition == r))
        value, error = shape.along(np.where(shape.steady, 1.0, grown))
        flux.append(heat * value)
        flux_sd.append(heat * error)
    return Missing(
        condition.words, run.x, repetition, np.array(flux), np.array(flux_sd), 1.0 + pressure, band,
        np.clip(1.0 - (band / shape.prior(steady)) ** 2, 0.0, 1.0),
    )  # fmt: skip


def _heat(run: Run, on: npt.NDArray[np.bool_]) -> float:
    """mu p v, W/m2 of nominal area, averaged over one repetition."""
    if on.sum() < 2:
        return 0.0
    dx = run.mesh.dx_block
    p = float((run.pressure[on] @ dx).mean() / dx.sum())
    v = float(np.ptp(run.slid[on]) / max(np.ptp(run.time[on]), 1e-12))
    return float(np.mean(run.friction[on])) * p * v
