"""Missing heat and pressure along the contact, without a catalogue of effects: regularised inversion of residuals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flashtemp.comparison.campaign import Condition
from flashtemp.discovery.estimation.linear_gaussian import Array, Solution
from flashtemp.discovery.estimation.linearised_fit import LinearisedFit
from flashtemp.discovery.estimation.nuisance_priors import PRESSURE_MODE_SD, unnamed_heat_priors
from flashtemp.discovery.parameters import ParameterKind
from flashtemp.discovery.prediction.problem import Problem
from flashtemp.discovery.verdict import MissingHeatFlux
from flashtemp.solver.run import Run


def estimate_missing_heat(problem: Problem, fit: LinearisedFit) -> tuple[MissingHeatFlux, ...]:
    """Heat and pressure along the contact that the model lacks, as cosines along the block with priors on their size.

    One result for each condition in which the block slides.
    """
    if not any(np.ptp(prediction.run.slid) > 0.0 for prediction in fit.predictions):
        return ()
    maximum = fit.solve_with(problem, fit.effect_priors | unnamed_heat_priors(fit.system.names))
    out = []
    for number, (condition, prediction) in enumerate(zip(problem.conditions, fit.predictions, strict=True)):
        if np.ptp(prediction.run.slid) == 0.0:
            continue
        out.append(_missing_heat(_collect_series(maximum.solution, number, prediction.run), condition, prediction.run))
    return tuple(out)


@dataclass(frozen=True)
class CosineSeries:
    """Cosines along the block at the run's columns, `waves` (n, k), with estimated amplitudes `d` (k,), their
    `covariance` (k, k) and prior `sd` (k,); `steady` (k,): False for those that grow over the repetitions."""

    waves: Array
    d: Array
    covariance: Array
    sd: Array
    steady: npt.NDArray[np.bool_]

    def weighted_sum(self, weights: Array | float) -> tuple[Array, Array]:
        """The weighted sum of all cosines (n,), with its standard error."""
        B = self.waves * weights
        return B @ self.d, np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", B, self.covariance, B), 0.0))

    def prior_error(self, weights: Array | float) -> Array:
        """Prior standard deviation (n,) of the sum."""
        B = self.waves * weights
        return np.sqrt(np.maximum((B**2) @ self.sd**2, 1e-300))


def _collect_series(solution: Solution, number: int, run: Run) -> CosineSeries:
    """The estimated series of heat and pressure of one condition."""
    free = unnamed_heat_priors(solution.names)
    names = [p for p in solution.names if p in free and p.condition == number]
    names += [p for p in solution.names if p.kind is ParameterKind.MODE]
    at = [solution.names.index(p) for p in names]
    order = np.array([p.index[0] for p in names])
    sd = np.array([free[p][1] if p in free else PRESSURE_MODE_SD / p.index[0] for p in names])
    length = run.mesh.x[run.mesh.last]
    return CosineSeries(
        np.cos(np.outer(run.x, order) * np.pi / length), solution.d[at], solution.covariance[np.ix_(at, at)], sd,
        np.array([p.kind is not ParameterKind.TREND for p in names]),
    )  # fmt: skip


def _missing_heat(shape: CosineSeries, condition: Condition, run: Run) -> MissingHeatFlux:
    steady = shape.steady.astype(float)
    pressure, band = shape.weighted_sum(steady)
    repetition = np.unique(run.repetition)
    sliding = run.sliding & np.isfinite(run.friction)
    flux, flux_sd = [], []
    for r in repetition:
        grown = 2.0 * (r - 1) / max(repetition[-1] - 1, 1) - 1.0
        heat = _mean_heat_flux(run, sliding & (run.repetition == r))
        value, error = shape.weighted_sum(np.where(shape.steady, 1.0, grown))
        flux.append(heat * value)
        flux_sd.append(heat * error)
    return MissingHeatFlux(
        condition.words, run.x, repetition, np.array(flux), np.array(flux_sd), 1.0 + pressure, band,
        np.clip(1.0 - (band / shape.prior_error(steady)) ** 2, 0.0, 1.0),
    )  # fmt: skip


def _mean_heat_flux(run: Run, is_sliding: npt.NDArray[np.bool_]) -> float:
    """Mean friction heat flux mu p v (W/m2 of nominal area) of one repetition."""
    if is_sliding.sum() < 2:
        return 0.0
    dx = run.mesh.dx_block
    p = float((run.pressure[is_sliding] @ dx).mean() / dx.sum())
    v = float(np.ptp(run.slid[is_sliding]) / max(np.ptp(run.time[is_sliding]), 1e-12))
    return float(np.mean(run.friction[is_sliding])) * p * v
