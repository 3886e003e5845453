"""Is the best model good enough?  Gates that stay shut while it is, and tests of structure calibrated by simulation."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import numpy.typing as npt

from flashtemp.comparison.campaign import View
from flashtemp.comparison.noise import lag_one, over_frames
from flashtemp.discovery.fit import Fit
from flashtemp.discovery.linear_gaussian import Array, Block, Solution, residual
from flashtemp.discovery.nuisances import GROUPS, MODE, unnamed_heat
from flashtemp.discovery.parameters import Kind, ParameterId
from flashtemp.discovery.problem import Problem
from flashtemp.discovery.unknown_law import NAME
from flashtemp.discovery.verdict import OwnValue, Test

PULL = 4.0  # standard deviations beyond which a calibrated parameter is not what was known
SCATTERED = 4.0  # -log10 of the probability that an amplitude scatters so between conditions
TOYS, LARGEST = 99, 10_000  # simulated data per block, and how many of its last data they cover


def generic(problem: Problem, fit: Fit) -> float:
    """ln Bayes factor of heat of any shape along the block, per condition and growing over the repetitions.

    0 where nothing slides: two solutions of the same columns differ by rounding, and the gate's limit is 0.
    """
    unnamed = unnamed_heat(fit.system.names)
    if not unnamed:
        return 0.0
    base = fit.solved(problem, fit.effects)
    wider = fit.solved(problem, fit.effects | unnamed)
    return wider.solution.ln_evidence - base.solution.ln_evidence


def mode_pulls(fit: Fit) -> float:
    """chi2 of the pressure modes against their prior, at its nominal width."""
    modes = [p for p in fit.solution.names if p.kind is Kind.MODE]
    return float(sum((fit.solution[p] / (MODE / p.index[0])) ** 2 for p in modes))


def pulls(fit: Fit) -> dict[ParameterId, float]:
    """Distance of every nuisance from what was known, in standard deviations of that knowledge."""
    out = {}
    for p in fit.solution.names:
        mean, sd = fit.priors[p]
        out[p] = (fit.solution[p] - mean) / GROUPS.get(p.kind, sd)
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
        left, Q = _last(block, fit)
        found = _statistics(left)
        toys = np.empty((TOYS, len(found)))
        for i in range(TOYS):
            noise = rng.normal(size=len(left))
            toys[i] = list(_statistics(noise - Q @ (Q.T @ noise)).values())
        for j, (name, value) in enumerate(found.items()):
            far = np.abs(toys[:, j] - np.median(toys[:, j])) >= abs(value - np.median(toys[:, j]))
            out.append(Test(name, block.label, float(value), float((1 + far.sum()) / (1 + TOYS)), stage))
    return out


def _last(block: Block, fit: Fit) -> tuple[Array, Array]:
    """What is left of the last data of a block (n,), and an orthonormal basis (n, k) of what was fitted to them."""
    used = sorted({c for p, c in block.names if p in fit.solution.names})
    part = slice(max(0, block.count - LARGEST), None)
    C = np.concatenate([block.C[part], block.F[part]], axis=1)[:, used].astype(float)
    left = residual(block, fit.solution)[part]
    return left, np.linalg.qr(C)[0] if len(C) > C.shape[1] else np.zeros((len(left), 0))


def per_condition(problem: Problem, fit: Fit, parameter: ParameterId) -> tuple[OwnValue, ...]:
    """A parameter of an effect as each condition alone would have it, the rest as all say."""
    now, alone = fit.model.value(parameter), _alone(problem, fit, [parameter])
    return tuple(OwnValue(words, now + s[parameter], s.sd(parameter)) for words, s in alone)


def size_per_condition(problem: Problem, fit: Fit, effect: str) -> tuple[OwnValue, ...]:
    """How many times a law as found each condition alone would have it, all its nodes free there.

    A node alone says little: nodes beside it, kept as all conditions want them, leave it no room.
    """
    nodes = [p for p in fit.fitted if p.effect == effect]
    if not nodes:  # all on their bounds
        return ()
    values = np.array([fit.model.value(p) + fit.solution[p] for p in nodes])
    out = []
    for words, solution in _alone(problem, fit, nodes):
        at = [solution.names.index(p) for p in nodes]
        precision = np.linalg.inv(solution.covariance[np.ix_(at, at)]) @ values
        theirs = np.array([fit.model.value(p) + solution[p] for p in nodes])
        known = float(values @ precision)
        out.append(OwnValue(words, float(theirs @ precision) / known, known**-0.5))
    return tuple(out)


def _alone(problem: Problem, fit: Fit, own: Sequence[ParameterId]) -> Iterator[tuple[str, Solution]]:
    """Every condition in words, with what its data alone make of some parameters, the rest as all say."""
    shared = {
        p: (float(d), 1e-3 * float(np.sqrt(v)))
        for p, d, v in zip(fit.solution.names, fit.solution.d, np.diag(fit.solution.covariance), strict=True)
        if p.everywhere and p not in own
    }
    priors = fit.priors | shared | {p: (0.0, 1e3 * fit.priors[p][1]) for p in own}
    for number, condition in enumerate(problem.conditions):
        equations = fit.system.total(_fitted_of(number))
        if equations.count:
            yield condition.words, fit.system.solve(priors, equations)


def sizes_per_condition(problem: Problem, fit: Fit, effect: str) -> list[tuple[OwnValue, ...]]:
    """The same of everything that says how large an effect is: its parameters one by one, or a learned law whole."""
    if effect == NAME:
        return [size_per_condition(problem, fit, effect)]
    return [per_condition(problem, fit, p) for p in fit.fitted if p.effect == effect]


def _fitted_of(number: int) -> Callable[[Block], bool]:
    return lambda b: b.condition == number and not b.held_out


def consistent(conditions: Sequence[OwnValue]) -> float:
    """Probability of so much scatter between conditions if all had the same value."""
    from scipy.stats import chi2

    if len(conditions) < 2:
        return 1.0
    value, sd = np.array([c.value for c in conditions]), np.array([c.stderr for c in conditions])
    weight = 1.0 / sd**2
    mean = float(weight @ value / weight.sum())
    return float(chi2.sf(np.sum(((value - mean) / sd) ** 2), len(value) - 1))


def _statistics(left: Array) -> dict[str, float]:
    return {
        "mean square": float(np.mean(left**2)),
        "correlation of neighbours": lag_one(left, 0)[0],
        "wider than a pixel": float(np.max(np.abs(_runs(left)), initial=0.0)),
    }


def _runs(left: Array, size: int = 8) -> Array:
    """Means over runs of neighbouring data, in standard errors."""
    whole = len(left) // size * size
    means: Array = left[:whole].reshape(-1, size).sum(axis=1) / np.sqrt(size)
    return means


def near_contact(view: View, residual: npt.NDArray[np.float64]) -> float:
    """Root mean square (K) of the mean over frames in the two rows of pixels nearest to the contact."""
    v = view.recording.v
    seen = np.flatnonzero(np.isfinite(residual).any(axis=(0, 2)))
    rows = seen[np.argsort(np.abs(v[seen]))[:2]]
    mean = over_frames(residual[:, rows])
    return float(np.sqrt(np.nanmean(mean**2))) if np.isfinite(mean).any() else float("nan")


def mean_map(residual: npt.NDArray[np.float64]) -> float:
    """Root mean square (K) of the mean over frames."""
    mean = over_frames(residual)
    return float(np.sqrt(np.nanmean(mean**2)))
