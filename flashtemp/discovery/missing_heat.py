"""What is missing along the contact without any catalogue: regularised inversion of the residual."""

from __future__ import annotations

import numpy as np

from flashtemp.comparison.campaign import told
from flashtemp.discovery import adequacy
from flashtemp.discovery.calibration import Fit, solved
from flashtemp.discovery.linear_gaussian import Solution
from flashtemp.discovery.problem import MODE, Study
from flashtemp.discovery.verdict import Missing


def missing(study: Study, fit: Fit) -> tuple[Missing, ...]:
    """Heat and pressure along the contact that the model lacks: regularised inversion for cosines along the block."""
    free = {
        n: (0.0, adequacy.FLUX / int(n.split(":")[1].split("|")[0]) ** 0.5)
        for n in fit.system.names
        if n.startswith(("flux:", "trend:"))
    }
    more = {n: v for n, v in fit.priors.items() if n.split(".")[0] in fit.model.effects}
    solution, _, _ = solved(study, fit.system, fit.model, fit.shifts, more | free)
    out = []
    for number, ((given, _, _), look) in enumerate(zip(study.conditions, fit.looks, strict=True)):
        out.append(_missing(study, solution, free, number, given, look))
    return tuple(out)


def _missing(study: Study, solution: Solution, free, number: int, given, look) -> Missing:
    run = look.run
    x, L = run.x, run.mesh.x[run.mesh.last]
    names = [n for n in solution.names if n in free and n.endswith(f"|{number}")]
    names += [n for n in solution.names if n.startswith("mode:")]
    at = [solution.names.index(n) for n in names]
    order = np.array([int(n.split(":")[1].split("|")[0]) for n in names])
    waves = np.cos(np.outer(x, order) * np.pi / L)
    steady = np.array([not n.startswith("trend:") for n in names])
    d, cov = solution.d[at], solution.covariance[np.ix_(at, at)]
    sd0 = np.array([free[n][1] if n in free else MODE / order[i] for i, n in enumerate(names)])

    def along(weights):
        B = waves * weights
        return B @ d, np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", B, cov, B), 0.0)), B

    shape, band, B = along(steady.astype(float))
    prior = np.sqrt(np.maximum((B**2) @ sd0**2, 1e-300))
    repetition = np.unique(run.repetition)
    sliding = run.sliding & np.isfinite(run.friction)
    flux, flux_sd = [], []
    for r in repetition:
        grown = 2.0 * (r - 1) / max(repetition[-1] - 1, 1) - 1.0
        on = sliding & (run.repetition == r)
        heat = _heat(study, run, on)
        value, error, _ = along(np.where(steady, 1.0, grown))
        flux.append(heat * value)
        flux_sd.append(heat * error)
    return Missing(
        told(given), x, repetition, np.array(flux), np.array(flux_sd), 1.0 + shape, band,
        np.clip(1.0 - (band / prior) ** 2, 0.0, 1.0),
    )  # fmt: skip


def _heat(study: Study, run, on) -> float:
    """mu p v, W/m2 of nominal area, averaged over one repetition."""
    if on.sum() < 2:
        return 0.0
    dx = run.mesh.dx_block
    p = float((run.pressure[on] @ dx).mean() / dx.sum())
    v = float(np.ptp(run.slid[on]) / max(np.ptp(run.time[on]), 1e-12))
    return float(np.mean(run.friction[on])) * p * v
