"""Is the best model good enough?  Gates that stay shut while it is, and tests of structure calibrated by simulation."""

from __future__ import annotations

import numpy as np

from flashtemp.comparison.campaign import told
from flashtemp.comparison.noise import lag_one, over_frames
from flashtemp.discovery.calibration import Fit, Study, solved
from flashtemp.discovery.linear_gaussian import residual
from flashtemp.discovery.problem import GROUPS, MODE
from flashtemp.discovery.verdict import Test

FLUX = 0.05  # of the local heat: standard deviation of modes that have no name
PULL = 4.0  # standard deviations beyond which a calibrated parameter is not what was known
SCATTERED = 4.0  # -log10 of the probability that an amplitude scatters so between conditions
TOYS, LARGEST = 99, 10_000  # simulated data per block, and how many of its last data they cover


def generic(study: Study, fit: Fit) -> float:
    """ln Bayes factor of heat of any shape along the block, per condition and growing over the repetitions."""
    more = {n: v for n, v in fit.priors.items() if n.split(".")[0] in fit.model.effects}
    base, _, _ = solved(study, fit.system, fit.model, fit.shifts, more)
    free = {
        n: (0.0, FLUX / int(n.split(":")[1].split("|")[0]) ** 0.5)
        for n in fit.system.names
        if n.startswith(("flux:", "trend:"))
    }
    return solved(study, fit.system, fit.model, fit.shifts, more | free)[0].ln_evidence - base.ln_evidence


def mode_pulls(fit: Fit) -> float:
    """chi2 of the pressure modes against their prior, at its nominal width."""
    names = [n for n in fit.solution.names if n.startswith("mode:")]
    return float(sum((fit.solution[n] / (MODE / int(n[5:]))) ** 2 for n in names))


def pulls(fit: Fit) -> dict[str, float]:
    """Distance of every nuisance from what was known, in standard deviations of that knowledge."""
    out = {}
    for n in fit.solution.names:
        mean, sd = fit.priors[n]
        kind = n.partition("|")[0].split(":")[0]
        out[n] = (fit.solution[n] - mean) / GROUPS.get(kind, sd)
    return out


def excess(fit: Fit) -> dict[str, float]:
    """chi2 per datum of every recording and trace, less one, in standard errors of noise alone."""
    out = {}
    for block in fit.blocks:
        left = residual(block, fit.solution)
        out[block.label] = float((np.mean(left**2) - 1.0) * np.sqrt(block.count / 2.0))
    return out


def structure(fit: Fit, seed: int, stage: str) -> list[Test]:
    """Structure in what is left, with the share of simulated noise-only data that shows more.

    Toys are noise projected like the data were.
    """
    rng = np.random.default_rng(seed)
    out = []
    for block in fit.blocks:
        used = sorted({c for n, c in block.names if n in fit.solution.names})
        part = slice(max(0, block.count - LARGEST), None)
        C = np.concatenate([block.C[part], block.F[part]], axis=1)[:, used].astype(float)
        left = residual(block, fit.solution)[part]
        Q = np.linalg.qr(C)[0] if len(C) > C.shape[1] else np.zeros((len(left), 0))
        found = _statistics(left)
        toys = np.empty((TOYS, len(found)))
        for i in range(TOYS):
            noise = rng.normal(size=len(left))
            toys[i] = list(_statistics(noise - Q @ (Q.T @ noise)).values())
        for j, (name, value) in enumerate(found.items()):
            far = np.abs(toys[:, j] - np.median(toys[:, j])) >= abs(value - np.median(toys[:, j]))
            out.append(Test(name, block.label, float(value), float((1 + far.sum()) / (1 + TOYS)), stage))
    return out


def per_condition(study: Study, fit: Fit, name: str) -> tuple[tuple[str, float, float], ...]:
    """The first parameter of an effect as each condition alone would have it, the rest as all say."""
    out, now = [], fit.model.effects[name.split(".")[0]][name.split(".")[1]]
    shared = {n: (float(d), 1e-3 * float(np.sqrt(v))) for n, d, v in
              zip(fit.solution.names, fit.solution.d, np.diag(fit.solution.covariance), strict=True)
              if "|" not in n and n != name}  # fmt: skip
    for number, (given, _, _) in enumerate(study.conditions):
        own = fit.system.total(lambda b, number=number: b.condition == number and not b.held_out)
        if own[3]:
            solution = fit.system.solve(fit.priors | shared | {name: (0.0, 1e3 * fit.priors[name][1])}, own)
            out.append((told(given), now + solution[name], solution.sd(name)))
    return tuple(out)


def consistent(conditions) -> float:
    """Probability of so much scatter between conditions if all had the same value."""
    from scipy.stats import chi2

    if len(conditions) < 2:
        return 1.0
    value, sd = np.array([c[1] for c in conditions]), np.array([c[2] for c in conditions])
    weight = 1.0 / sd**2
    mean = float(weight @ value / weight.sum())
    return float(chi2.sf(np.sum(((value - mean) / sd) ** 2), len(value) - 1))


def _statistics(left: np.ndarray) -> dict[str, float]:
    return {
        "mean square": float(np.mean(left**2)),
        "correlation of neighbours": lag_one(left, 0)[0],
        "wider than a pixel": float(np.max(np.abs(_runs(left)), initial=0.0)),
    }


def _runs(left: np.ndarray, size: int = 8) -> np.ndarray:
    """Means over runs of neighbouring data, in standard errors."""
    whole = len(left) // size * size
    return left[:whole].reshape(-1, size).sum(axis=1) / np.sqrt(size)


def near_contact(view, residual: np.ndarray) -> float:
    """Root mean square (K) of the mean over frames in the two rows of pixels nearest to the contact."""
    v = view.recording.v
    seen = np.flatnonzero(np.isfinite(residual).any(axis=(0, 2)))
    rows = seen[np.argsort(np.abs(v[seen]))[:2]]
    mean = over_frames(residual[:, rows])
    return float(np.sqrt(np.nanmean(mean**2))) if np.isfinite(mean).any() else float("nan")


def mean_map(residual: np.ndarray) -> float:
    """Root mean square (K) of the mean over frames."""
    mean = over_frames(residual)
    return float(np.sqrt(np.nanmean(mean**2)))
