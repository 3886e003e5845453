"""Is the final model good enough?  Tests that stay quiet while it is, and simulated tests of residual structure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from flashtemp.comparison.campaign import RecordingEntry
from flashtemp.comparison.noise import frame_mean, lag1_autocorrelation
from flashtemp.discovery.criteria import Criteria
from flashtemp.discovery.decision import AdequacyTest
from flashtemp.discovery.estimation.linear_gaussian import Array, DataBlock, whitened_residual
from flashtemp.discovery.estimation.linearised_fit import LinearisedFit
from flashtemp.discovery.estimation.nuisance_priors import (
    NUISANCE_SD,
    PRESSURE_MODE_SD,
    is_camera_gain,
    unnamed_heat_priors,
)
from flashtemp.discovery.estimation.per_condition import estimate_effect_by_condition
from flashtemp.discovery.parameters import Kind, ParameterId
from flashtemp.discovery.prediction.problem import Problem
from flashtemp.discovery.verdict import StructureTest

SIMULATED_DATA_SETS = 99  # noise-only data sets per block
MAX_TESTED_DATA = 4000  # last data of a block that they cover


def run_adequacy_tests(problem: Problem, fit: LinearisedFit, criteria: Criteria) -> tuple[AdequacyTest, ...]:
    """What is left of all data by a fit, its calibrated parameters and the agreement of conditions, with limits."""
    every = refit_all_data(fit)
    seen = fit.system.fitted_columns
    away = normalised_deviations(every) | {p: v for p, v in normalised_deviations(fit).items() if p in seen}
    setup = (Kind.SIZE, Kind.SCALE, Kind.TURN, Kind.CLOCK, Kind.SHIFT_U, Kind.SHIFT_V)  # reported by themselves
    keys = max((abs(v) for p, v in away.items() if p.kind is Kind.KEY), default=0.0)
    own = max((abs(v) for p, v in away.items() if p.kind is not Kind.KEY and p.kind not in setup), default=0.0)
    scatter = [
        s.probability for e in fit.model.effects for s in estimate_effect_by_condition(problem, fit, e, every=True)
    ]
    least = -float(np.log10(criteria.condition_scatter))
    return (
        AdequacyTest("amplitude differs between conditions (-log10 of its probability)",
                     max((-float(np.log10(max(p, 1e-99))) for p in scatter), default=0.0), least),
        AdequacyTest("heat of any shape (ln Bayes factor)", unnamed_heat_evidence(problem, fit),
                     criteria.ln_bayes_unnamed_heat),
        AdequacyTest("pressure of any shape (chi2 of modes)", pressure_mode_chi2(fit), criteria.pressure_modes_chi2),
        AdequacyTest("calibrated parameters (standard deviations)", keys, criteria.pull_adequate),
        AdequacyTest("camera and friction scatter (standard deviations)", own, criteria.pull_nuisance),
        AdequacyTest("noise left over (chi2 over what noise may give)", largest_misfit(fit, every, criteria), 1.0),
    )  # fmt: skip


def largest_misfit(fit: LinearisedFit, all_data_fit: LinearisedFit, criteria: Criteria) -> float:
    """Largest chi2 per datum of a recording, over what its noise may give: its stated variance is uncertain itself."""
    worst = 0.0
    fitted, all_data = (f.system.block_chi2(f.solution) for f in (fit, all_data_fit))
    for b, seen, unseen in zip(fit.blocks, fitted, all_data, strict=True):
        chance = criteria.adequacy_standard_errors * np.sqrt(2.0 / b.count)
        known = 2.0 * 2.0 * criteria.noise_sd_uncertainty  # two standard uncertainties of a variance
        chi2 = (unseen if b.held_out else seen) / b.count
        worst = max(worst, chi2 / (1.0 + float(np.hypot(chance, known))))
    return float(worst)


def unnamed_heat_evidence(problem: Problem, fit: LinearisedFit) -> float:
    """ln Bayes factor of heat of any shape along the block, per condition and growing over the repetitions.

    0 where nothing slides, or no data fitted feel it.
    """
    seen = fit.system.fitted_columns
    unnamed = unnamed_heat_priors(n for n in fit.system.names if n in seen)
    if not unnamed:
        return 0.0
    free = {p: v for p, v in fit.effect_priors.items() if p not in fit.bound}
    base = fit.solve_with(problem, free, fit.equations)
    wider = fit.solve_with(problem, free | unnamed, fit.equations)
    return float(wider.solution.ln_evidence - base.solution.ln_evidence)


def pressure_mode_chi2(fit: LinearisedFit) -> float:
    """chi2 of the pressure modes against their prior, at its nominal width."""
    modes = [p for p in fit.solution.names if p.kind is Kind.MODE]
    return float(sum((fit.solution[p] / (PRESSURE_MODE_SD / p.index[0])) ** 2 for p in modes))


def refit_all_data(fit: LinearisedFit) -> LinearisedFit:
    """A fit with held-out data fitted too: what was fitted is known within its errors only, and the question is whether
    one model may explain everything."""
    if not any(b.held_out for b in fit.blocks):
        return fit
    everything = fit.system.normal_equations(lambda b: True, fit.hyper.variances)
    return replace(fit, solution=fit.system.solve(fit.priors, everything))


def normalised_deviations(fit: LinearisedFit) -> dict[ParameterId, float]:
    """Distance of every nuisance from what was known, in standard deviations of that knowledge."""
    out, gains = {}, any(map(is_camera_gain, fit.priors))
    for p in fit.solution.names:
        mean, sd = fit.priors[p]
        apart = p.kind is Kind.SPREAD or (gains and p.kind is Kind.MAP)  # not all cameras are known alike
        known = sd if apart else NUISANCE_SD.get(p.kind, sd)
        out[p] = (fit.solution[p] - mean) / known
    return out


def simulate_structure_tests(fit: LinearisedFit, seed: int, stage: str) -> list[StructureTest]:
    """Structure in what is left, with the share of simulated noise-only data that shows more.

    Toys are noise projected like the data were.
    """
    rng = np.random.default_rng(seed)
    out = []
    for block in fit.blocks:
        left, Q = _last_residuals(block, fit)
        found = _structure_statistics(left)
        toys = np.empty((SIMULATED_DATA_SETS, len(found)))
        for i in range(SIMULATED_DATA_SETS):
            noise = rng.normal(size=len(left))
            toys[i] = list(_structure_statistics(noise - Q @ (Q.T @ noise)).values())
        for j, (name, value) in enumerate(found.items()):
            far = np.abs(toys[:, j] - np.median(toys[:, j])) >= abs(value - np.median(toys[:, j]))
            out.append(
                StructureTest(
                    name, block.label, float(value), float((1 + far.sum()) / (1 + SIMULATED_DATA_SETS)), stage
                )
            )
    return out


def _last_residuals(block: DataBlock, fit: LinearisedFit) -> tuple[Array, Array]:
    """What is left of the last data of a block (n,), and an orthonormal basis (n, k) of what was fitted to them."""
    used = sorted({c for p, c in block.names if p in fit.solution.names})
    part = slice(max(0, block.count - MAX_TESTED_DATA), None)
    C = np.concatenate([block.C[part], block.F[part]], axis=1)[:, used].astype(float)
    left = whitened_residual(block, fit.solution)[part]
    return left, np.linalg.qr(C)[0] if len(C) > C.shape[1] else np.zeros((len(left), 0))


def _structure_statistics(left: Array) -> dict[str, float]:
    return {
        "mean square": float(np.mean(left**2)),
        "correlation of neighbours": lag1_autocorrelation(left, 0)[0],
        "wider than a pixel": float(np.max(np.abs(_block_means(left)), initial=0.0)),
    }


def _block_means(left: Array, size: int = 8) -> Array:
    """Means over runs of neighbouring data, in standard errors."""
    whole = len(left) // size * size
    means: Array = left[:whole].reshape(-1, size).sum(axis=1) / np.sqrt(size)
    return means


def near_contact_rmse(view: RecordingEntry, residual: npt.NDArray[np.float64]) -> float:
    """Root mean square (K) of the mean over frames in the two rows of pixels nearest to the contact."""
    v = view.recording.v
    seen = np.flatnonzero(np.isfinite(residual).any(axis=(0, 2)))
    rows = seen[np.argsort(np.abs(v[seen]))[:2]]
    mean = frame_mean(residual[:, rows])
    return float(np.sqrt(np.nanmean(mean**2))) if np.isfinite(mean).any() else float("nan")


def time_mean_rmse(residual: npt.NDArray[np.float64]) -> float:
    """Root mean square (K) of the mean over frames."""
    mean = frame_mean(residual)
    return float(np.sqrt(np.nanmean(mean**2)))
