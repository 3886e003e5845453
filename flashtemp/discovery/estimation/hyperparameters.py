"""Hyperparameters of a fit by maximum evidence, and the solution of all linear unknowns at them.

The unstated sizes of errors (friction scatter, free pressure shapes, model discrepancy, families of camera errors)
maximise the marginal likelihood: "evidence maximisation" of MacKay (Neural Computation 4, 1992, 415), also called
"type-II maximum likelihood".  The noise variance of each recording is estimated too, but never below the stated one.
If the model misfits a recording, its noise is taken as large as the misfit (Birge, Phys. Rev. 40, 1932, 207), so that
its weight decreases and the priors keep their influence.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from flashtemp.discovery.estimation.camera_error_columns import NO_CAMERA_ERRORS
from flashtemp.discovery.estimation.linear_gaussian import LinearSystem, NormalEquations, Solution
from flashtemp.discovery.estimation.model_discrepancy import LARGEST_DISCREPANCY, LEAST_DISCREPANCY
from flashtemp.discovery.estimation.nuisance_priors import is_camera_gain, nuisance_priors, scale_priors
from flashtemp.discovery.estimation.prior_widths import LN_ODDS_AGAINST_FAMILY, maximise_evidence_over_widths
from flashtemp.discovery.hypotheses.candidates import ModelPoint
from flashtemp.discovery.parameters import CAMERA_ERROR_KINDS, ParameterKind, Priors
from flashtemp.discovery.prediction.problem import Problem

MAX_NOISE_SWEEPS = 6  # alternations of noise variances and prior widths
VARIANCE_TOLERANCE = 0.02  # relative change of a noise variance below which the sweeps end


@dataclass(frozen=True)
class Hyperparameters:
    """Values of largest evidence: `scale` of free pressure shapes and friction scatter, `discrepancy_sd` of the model
    discrepancy (fraction of the temperature rise), `families` of camera errors (times the usual size), noise
    `variances` {label: times the stated variance, at least 1}."""

    scale: float
    discrepancy_sd: float
    families: Mapping[ParameterKind, float] = field(default_factory=lambda: NO_CAMERA_ERRORS)
    variances: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class EvidenceMaximum:
    """The `solution` of all linear unknowns with their `priors` at the `hyper` parameters of largest evidence."""

    solution: Solution
    priors: Priors
    hyper: Hyperparameters


def maximise_evidence(
    problem: Problem,
    system: LinearSystem,
    model: ModelPoint,
    more: Priors,
    *,
    variances: Mapping[str, float] | None = None,
    equations: NormalEquations | None = None,
    discrepancy_sds: tuple[float, ...] = (LARGEST_DISCREPANCY, LEAST_DISCREPANCY),
) -> EvidenceMaximum:
    """Solve for all nuisances and the parameters in `more` at the hyperparameters of largest evidence.

    Priors are relative to `model`.  With `variances`, the noise is fixed; `equations` are then the normal equations
    with these variances, if they exist already.  `discrepancy_sds`: allowed sizes of the model discrepancy.
    """
    plain = nuisance_priors(problem, system.names, model)
    if variances is not None:
        total = equations or system.normal_equations(variances=variances)
        return _maximise_at_noise(system, plain, more, total, variances, discrepancy_sds, problem)
    found, now = None, {b.label: 1.0 for b in system.blocks}
    for _ in range(MAX_NOISE_SWEEPS):
        found = _maximise_at_noise(
            system, plain, more, system.normal_equations(variances=now), now, discrepancy_sds, problem
        )
        # variances and widths depend on each other (eqs. (41) and (43)), so they alternate
        wanted = estimate_noise_variances(system, found.solution)
        if all(abs(wanted[k] - now[k]) <= VARIANCE_TOLERANCE * now[k] for k in now):
            break
        now = wanted
    assert found is not None
    return found


def estimate_noise_variances(system: LinearSystem, solution: Solution) -> dict[str, float]:
    """Noise variance of every block from its residual, in units of the stated one: chi2 per datum, at least 1.

    This is the square of Birge's ratio.
    """
    values = zip(system.blocks, system.block_chi2(solution), strict=True)
    # eq. (43); below 1 the stated noise holds, or a few data could seem more exact than their camera
    return {b.label: max(1.0, chi2 / b.count) for b, chi2 in values}


def _maximise_at_noise(
    system: LinearSystem, plain: Priors, more: Priors, equations: NormalEquations, variances: Mapping[str, float],
    discrepancy_sds: tuple[float, ...], problem: Problem,
) -> EvidenceMaximum:  # fmt: skip
    best = maximise_evidence_over_widths(system, plain | more, more, equations, discrepancy_sds)
    priors = scale_priors(plain, best.scale, best.discrepancy_sd, best.families) | more
    solution = system.fit_heldout_nuisances(system.solve(priors, equations), priors)
    families = {p.kind for p in priors if p.kind in CAMERA_ERROR_KINDS or is_camera_gain(p)}
    solution = replace(solution, ln_evidence=solution.ln_evidence - LN_ODDS_AGAINST_FAMILY * len(families))
    return EvidenceMaximum(solution, priors, Hyperparameters(best.scale, best.discrepancy_sd, best.families, variances))


def priors_at_hyperparameters(
    problem: Problem, system: LinearSystem, model: ModelPoint, hyper: Hyperparameters, more: Priors
) -> Priors:
    """Priors of the nuisances relative to a point, and of `more`, at given hyperparameters."""
    plain = nuisance_priors(problem, system.names, model)
    return scale_priors(plain, hyper.scale, hyper.discrepancy_sd, hyper.families) | more
