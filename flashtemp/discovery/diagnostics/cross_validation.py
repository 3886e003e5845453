"""Cross-validation: how well a fit predicts held-out recordings, or each condition from the others."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from flashtemp.discovery.estimation.linear_gaussian import Array, DataBlock, LinearSystem, Solution, whitened_residual
from flashtemp.discovery.estimation.linearised_fit import LinearisedFit
from flashtemp.discovery.estimation.nuisance_priors import rigid_priors, usual_width_ratio
from flashtemp.discovery.estimation.whitening import WhitenedData
from flashtemp.discovery.parameters import ParameterId

HELD_OUT_FOLD = "held out"  # name of the fold of recordings and load-cell records that the campaign holds out
MAX_RIGID_PULL = 3.0  # usual standard deviations by which a key or nuisance may deviate where nothing is flexible

BlockFilter = Callable[[DataBlock], bool]


@dataclass(frozen=True)
class CrossValidation:
    """The prediction of left-out data, fold by fold.

    `density` (folds,): joint ln probability of each fold given the rest.  `rmse_K` and `z`: root mean square residual
    in K and in standard deviations.  `chi2`: of all left-out data, with the covariance of their prediction, so that it
    allows for what the other data leave uncertain.  `fitted_chi2`: of the same data when fitted with the others.
    `residuals` (n,): those of all left-out data, in standard deviations.
    """

    labels: tuple[str, ...]
    density: Array
    rmse_K: float
    z: float
    chi2: float
    fitted_chi2: float
    residuals: Array

    @property
    def is_held_out(self) -> bool:
        return self.labels == (HELD_OUT_FOLD,)


def without_flexible_terms(fit: LinearisedFit) -> LinearisedFit:
    """A fit without free pressure modes, wall terms and friction of repetitions: the model as the case describes it.

    No key and no nuisance deviates from its prior by more than MAX_RIGID_PULL usual standard deviations, however badly
    the model fits.  Effects keep the strengths that the data require, because they are what the model is extended by.
    """
    priors = rigid_priors(fit.priors) | fit.effect_priors
    limits = {p: _rigid_limit(p, fit) for p in priors.keys() - fit.effect_priors.keys()}
    solution = fit.system.solve_bounded(priors, limits, fit.equations)
    return replace(fit, priors=priors, solution=fit.system.fit_heldout_nuisances(solution, priors))


def _rigid_limit(p: ParameterId, fit: LinearisedFit) -> float:
    """The largest deviation of a key or nuisance from its prior, in prior standard deviations: MAX_RIGID_PULL of its
    usual ones."""
    return MAX_RIGID_PULL * usual_width_ratio(p, fit.hyper.families)


def is_at_limit(value: float, estimate: float, pull: float, prior_sd: float) -> bool:
    """Whether a value of a free key is the last one that `without_flexible_terms` allows.

    `pull`: deviation of another `estimate` of the key from its prior, in units of the prior standard deviation of ln.

    >>> is_at_limit(10.0 * np.exp(-0.9), 10.0, 0.0, 0.3), is_at_limit(9.0, 10.0, 0.0, 0.3)
    (True, False)
    """
    return bool(abs(np.log(value / estimate) / prior_sd + pull) > 0.999 * MAX_RIGID_PULL)


def cross_validate(data: WhitenedData, fit: LinearisedFit) -> CrossValidation:
    """Predict held-out recordings; if none are, each condition from the others, or (one condition) each recording."""
    system, variances = fit.system, fit.hyper.variances
    folds = _make_folds(system)
    densities, residuals, kelvins, count, total, chi2, fitted_chi2 = [], [], 0.0, 0, 0, 0.0, 0.0
    for inside in folds.values():
        every = system.solve(fit.priors, system.normal_equations(_including_fold(inside), variances))
        rest = system.solve(fit.priors, system.normal_equations(_excluding_fold(inside), variances))
        densities.append(every.ln_evidence - rest.ln_evidence)
        # of a linear Gaussian model the chi2 of a prediction is what the least chi2 of all data grows by
        chi2 += every.chi2 - rest.chi2
        for block in (b for b in system.blocks if inside(b)):
            residual = _heldout_residual(system, fit, rest, block)
            residuals.append(residual)
            total += block.count
            fitted_chi2 += float(np.sum(whitened_residual(block, every) ** 2)) / variances[block.label]
            if block.label in data.noises:
                difference = data.to_kelvin(block.label, residual)
                kelvins += float(np.sum(difference**2))
                count += block.count
    left_out = np.concatenate(residuals) if residuals else np.zeros(0)
    rmse, z = np.sqrt(kelvins / max(count, 1)), np.sqrt(float(left_out @ left_out) / max(total, 1))
    return CrossValidation(tuple(folds), np.array(densities), float(rmse), float(z), chi2, fitted_chi2, left_out)


def heldout_excess(data: WhitenedData, base: LinearisedFit, best: LinearisedFit) -> tuple[float, float]:
    """Excess misfit of left-out data as predicted by a base and by the `best` model that extends it.

    It is the chi2 of their prediction, at the stated noise, minus what the best fit leaves when it is fitted to them
    too: the noise that they have.  Noise that a fit has estimated would hide its own misfit.  Neither model has
    flexible terms: free pressure shapes that a wrong base needs would predict what its extension does.
    """
    stated = {b.label: 1.0 for b in best.blocks}
    fits = (replace(f, hyper=replace(f.hyper, variances=stated)) for f in (base, best))
    before, after = (cross_validate(data, without_flexible_terms(fit)) for fit in fits)
    return before.chi2 - after.fitted_chi2, after.chi2 - after.fitted_chi2


def rms_change_error(before: Array, after: Array) -> float:
    """Standard error of the change of a root mean square, from residuals (n,) of two models of the same data.

    Both share the noise of the data, so that the error is that of the paired differences of squares; NaN without data.

    >>> rms_change_error(np.array([1.0, -1.0]), np.array([1.0, 1.0]))
    0.0
    """
    if not len(before) or len(before) != len(after):
        return float("nan")
    change, rms = after**2 - before**2, sum(float(np.sqrt(np.mean(r**2))) for r in (before, after))
    return float(np.std(change) / np.sqrt(len(change)) / max(rms, 1e-300))


def _make_folds(system: LinearSystem) -> dict[str, BlockFilter]:
    if any(b.held_out for b in system.blocks):
        return {HELD_OUT_FOLD: lambda b: b.held_out}
    numbers = sorted({b.condition for b in system.blocks})
    if len(numbers) > 1:
        return {f"condition {n + 1}": _condition_filter(n) for n in numbers}
    return {b.label: _block_filter(b) for b in system.blocks}


def _including_fold(fold: BlockFilter) -> BlockFilter:
    return lambda b: not b.held_out or fold(b)


def _excluding_fold(fold: BlockFilter) -> BlockFilter:
    return lambda b: not b.held_out and not fold(b)


def _condition_filter(number: int) -> BlockFilter:
    return lambda b: b.condition == number


def _block_filter(block: DataBlock) -> BlockFilter:
    return lambda b: b is block


def _heldout_residual(system: LinearSystem, fit: LinearisedFit, training: Solution, block: DataBlock) -> Array:
    """Residual (n,) of a left-out block: shared parameters as estimated from the others, its own ones fitted.

    Its own ones, such as the place of its image and the friction of its condition, deviate from their priors by at most
    MAX_RIGID_PULL usual standard deviations: otherwise they would be fitted to what the model does not predict.
    """
    others = {p for b in system.blocks if b is not block for p, _ in b.names}
    present = {p for p, _ in block.names}
    priors, limits = {}, {}
    for i, p in enumerate(training.names):
        if p not in present:
            continue
        known = float(np.sqrt(training.covariance[i, i]))
        if p in others and p.is_shared:
            priors[p] = (float(training.d[i]), 1e-3 * known)
        else:
            priors[p], limits[p] = fit.priors[p], _rigid_limit(p, fit)
    equations = system.normal_equations(_block_filter(block), fit.hyper.variances)
    return whitened_residual(block, system.solve_bounded(priors, limits, equations))
