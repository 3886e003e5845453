"""Adequacy tests of the final model, and simulated tests for structure in its residuals."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from flashtemp.comparison.campaign import RecordingEntry
from flashtemp.comparison.line_noise import frame_mean
from flashtemp.comparison.noise import lag1_autocorrelation
from flashtemp.discovery.criteria import Criteria
from flashtemp.discovery.decision import NOISE_TEST, AdequacyTest
from flashtemp.discovery.estimation.linear_gaussian import Array, DataBlock, whitened_residual
from flashtemp.discovery.estimation.linearised_fit import LinearisedFit
from flashtemp.discovery.estimation.nuisance_priors import (
    NUISANCE_SD,
    PRESSURE_MODE_SD,
    is_camera_gain,
    unnamed_heat_priors,
    usual_width_ratio,
)
from flashtemp.discovery.estimation.per_condition import estimate_effect_by_condition
from flashtemp.discovery.parameters import ParameterId, ParameterKind
from flashtemp.discovery.prediction.problem import Problem
from flashtemp.discovery.verdict import SIMULATED_DATA_SETS, StructureTest

MAX_TESTED_DATA = 4000  # the tests cover as many of the last data of a block
NEIGHBOUR_CORRELATION = "correlation of neighbours"


def run_adequacy_tests(problem: Problem, fit: LinearisedFit, criteria: Criteria) -> tuple[AdequacyTest, ...]:
    """Six tests of a fit with their limits: equal amplitudes in all conditions, no heat or pressure of another shape,
    free keys near their priors, all other unknowns and strengths of effects too, and residuals as small as the noise.

    Held-out data are included: a model must describe all data, even if it was fitted to a part of them.
    """
    every = refit_all_data(fit)
    fitted = fit.system.fitted_columns
    pulls = normalised_deviations(every) | {p: v for p, v in normalised_deviations(fit).items() if p in fitted}
    setup = (
        ParameterKind.SIZE,
        ParameterKind.SCALE,
        ParameterKind.TURN,
        ParameterKind.CLOCK,
        ParameterKind.SHIFT_U,
        ParameterKind.SHIFT_V,
    )  # see `setup_errors`
    # a stated input that the data contradict is reported as such
    keys = max(
        (abs(v) for p, v in pulls.items() if p.kind is ParameterKind.KEY and p.name not in problem.freed_inputs),
        default=0.0,
    )
    other = max(
        (abs(v) for p, v in pulls.items() if p.kind is not ParameterKind.KEY and p.kind not in setup), default=0.0
    )
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
        AdequacyTest("camera and friction scatter (standard deviations)", other, criteria.pull_nuisance),
        _test_noise(largest_misfit(fit, every, criteria)),
    )  # fmt: skip


@dataclass(frozen=True)
class RecordingMisfit:
    """`chi2` per datum of a recording with the file `label`, and the largest value `limit` that its noise explains."""

    label: str
    chi2: float
    limit: float

    @property
    def misfit_words(self) -> str:
        """The misfit in words, as ratios of rms values."""
        ratio, explained = np.sqrt(self.chi2), np.sqrt(self.limit)
        return (
            f"the residuals of {self.label} are {ratio:.3g} times its noise (rms), which explains {explained:.3g} times"
        )


def _test_noise(worst: RecordingMisfit | None) -> AdequacyTest:
    """The test of noise on the recording with the largest misfit; passed without data."""
    if worst is None:
        return AdequacyTest(NOISE_TEST, 0.0, 1.0)
    return AdequacyTest(NOISE_TEST, worst.chi2 / worst.limit, 1.0, worst.misfit_words)


def largest_misfit(fit: LinearisedFit, all_data_fit: LinearisedFit, criteria: Criteria) -> RecordingMisfit | None:
    """The recording whose chi2 per datum is largest relative to the largest value that its noise explains.

    The noise explains an excess from chance and from the uncertainty of its own stated variance, added in quadrature.
    """
    out = []
    fitted, all_data = (f.system.block_chi2(f.solution) for f in (fit, all_data_fit))
    for b, chi2_fitted, chi2_all_data in zip(fit.blocks, fitted, all_data, strict=True):
        chance = criteria.adequacy_standard_errors * np.sqrt(2.0 / b.count)
        stated = 2.0 * 2.0 * criteria.noise_sd_uncertainty  # two standard uncertainties of a variance
        chi2 = (chi2_all_data if b.held_out else chi2_fitted) / b.count
        out.append(RecordingMisfit(b.label, float(chi2), 1.0 + float(np.hypot(chance, stated))))
    return max(out, key=lambda m: m.chi2 / m.limit, default=None)


def unnamed_heat_evidence(problem: Problem, fit: LinearisedFit) -> float:
    """ln Bayes factor of additional heat of any shape along the block, for each condition and growing over repetitions.

    0 if nothing slides, or if no fitted data depend on it.
    """
    fitted = fit.system.fitted_columns
    unnamed = unnamed_heat_priors(n for n in fit.system.names if n in fitted)
    if not unnamed:
        return 0.0
    free = {p: v for p, v in fit.effect_priors.items() if p not in fit.bound}
    base = fit.solve_with(problem, free, fit.equations)
    wider = fit.solve_with(problem, free | unnamed, fit.equations)
    return float(wider.solution.ln_evidence - base.solution.ln_evidence)


def pressure_mode_chi2(fit: LinearisedFit) -> float:
    """chi2 of the pressure modes that the data require, against prior (of nominal width) and data uncertainty together.

    This is a prior predictive check (Box, J. R. Stat. Soc. A 143, 1980, 383).  Modes that were drawn from their prior
    give a chi2 variable with as many degrees of freedom as there are modes, however uncertain the data leave them.
    """
    modes = [p for p in fit.solution.names if p.kind is ParameterKind.MODE]
    if not modes:
        return 0.0
    others = {p: v for p, v in fit.free_priors.items() if p not in modes}
    data = fit.system.project_out(others, modes, fit.equations)
    variances = np.diag([(PRESSURE_MODE_SD / p.index[0]) ** 2 for p in modes])
    # the score is I d, where the estimate d of the data alone has the covariance I^-1 and that of the prior
    covariance = data.information + data.information @ variances @ data.information
    return float(data.score @ np.linalg.pinv(covariance, hermitian=True) @ data.score)


def refit_all_data(fit: LinearisedFit) -> LinearisedFit:
    """The same model and point with held-out data fitted too, to see whether one model can explain all data."""
    if not any(b.held_out for b in fit.blocks):
        return fit
    everything = fit.system.normal_equations(lambda b: True, fit.hyper.variances)
    return replace(fit, solution=fit.system.solve(fit.priors, everything))


def normalised_deviations(fit: LinearisedFit) -> dict[ParameterId, float]:
    """Deviation of every estimated parameter from its prior mean, in its usual standard deviations."""
    out, gains = {}, any(map(is_camera_gain, fit.priors))
    for p in fit.solution.names:
        mean, sd = fit.priors[p]
        # priors of these kinds depend on the camera; those of other kinds may have been widened by hyperparameters
        is_of_camera = p.kind is ParameterKind.SPREAD or (gains and p.kind is ParameterKind.MAP)
        usual = sd * usual_width_ratio(p, fit.hyper.families)
        prior_sd = usual if is_of_camera else NUISANCE_SD.get(p.kind, usual)
        out[p] = (fit.solution[p] - mean) / prior_sd
    return out


def simulate_structure_tests(fit: LinearisedFit, seed: int, stage: str) -> list[StructureTest]:
    """Tests for structure in the residuals, with p values from simulated data sets of noise alone.

    The simulated noise is projected like the data were, so that it lacks what the fit absorbs.
    """
    rng = np.random.default_rng(seed)
    out = []
    for block in fit.blocks:
        residual, Q = _last_residuals(block, fit)
        statistics = _structure_statistics(residual)
        simulated = np.empty((SIMULATED_DATA_SETS, len(statistics)))
        for i in range(SIMULATED_DATA_SETS):
            noise = rng.normal(size=len(residual))
            simulated[i] = list(_structure_statistics(noise - Q @ (Q.T @ noise)).values())
        for j, (name, value) in enumerate(statistics.items()):
            middle = np.median(simulated[:, j])
            is_farther = np.abs(simulated[:, j] - middle) >= abs(value - middle)
            p = float((1 + is_farther.sum()) / (1 + SIMULATED_DATA_SETS))
            is_small = bool(value < middle) and name != NEIGHBOUR_CORRELATION
            out.append(StructureTest(name, block.label, float(value), p, stage, is_small))
    return out


def _last_residuals(block: DataBlock, fit: LinearisedFit) -> tuple[Array, Array]:
    """Residuals (n,) of the last data of a block, and an orthonormal basis (n, k) of the columns fitted to them."""
    used = sorted({c for p, c in block.names if p in fit.solution.names})
    part = slice(max(0, block.count - MAX_TESTED_DATA), None)
    C = np.concatenate([block.C[part], block.F[part]], axis=1)[:, used].astype(float)
    residual = whitened_residual(block, fit.solution)[part]
    return residual, np.linalg.qr(C)[0] if len(C) > C.shape[1] else np.zeros((len(residual), 0))


def _structure_statistics(residual: Array) -> dict[str, float]:
    return {
        "mean square": float(np.mean(residual**2)),
        NEIGHBOUR_CORRELATION: lag1_autocorrelation(residual, 0)[0],
        "largest mean of eight neighbours": float(np.max(np.abs(_block_means(residual)), initial=0.0)),
    }


def _block_means(residual: Array, size: int = 8) -> Array:
    """Means over `size` neighbouring data each, in standard errors."""
    whole = len(residual) // size * size
    means: Array = residual[:whole].reshape(-1, size).sum(axis=1) / np.sqrt(size)
    return means


def near_contact_rmse(view: RecordingEntry, residual: npt.NDArray[np.float64]) -> float:
    """Root mean square (K) of the mean over frames in the two rows of pixels nearest to the contact."""
    v = view.recording.v
    compared = np.flatnonzero(np.isfinite(residual).any(axis=(0, 2)))
    rows = compared[np.argsort(np.abs(v[compared]))[:2]]
    mean = frame_mean(residual[:, rows])
    return float(np.sqrt(np.nanmean(mean**2))) if np.isfinite(mean).any() else float("nan")


def time_mean_rmse(residual: npt.NDArray[np.float64]) -> float:
    """Root mean square (K) of the mean over frames."""
    mean = frame_mean(residual)
    return float(np.sqrt(np.nanmean(mean**2)))
