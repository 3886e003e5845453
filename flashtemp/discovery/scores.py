"""Candidates scored from their traces: evidence of each, of all pairs, and what distinguishes them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flashtemp.discovery.calibration import Fit, Study, solved
from flashtemp.discovery.hypothesis import Candidate

NOTHING = 1e-3  # z of a signature of typical strength below which an effect does nothing here


@dataclass(frozen=True)
class Score:
    """A candidate in its best `variant`: `ln_bayes` against the model without it, `amplitude` of its strengths
    (change from off) with `sd`; `z` and `seen` (z of its typical strength) after projection, `raw_share` of
    its signal that nuisances cannot absorb; `free` steps of the free keys with it; `reason` why it cannot be, if so."""

    candidate: Candidate
    variant: int
    ln_bayes: float
    amplitude: tuple[float, ...]
    sd: tuple[float, ...]
    z: float
    seen: float
    raw_share: float
    free: dict[str, float]
    reason: str = ""

    @property
    def effect(self) -> str:
        return self.candidate.effect

    @property
    def values(self) -> dict[str, float]:
        """Values of all parameters from which a full fit may start."""
        off = self.candidate.off(self.variant)
        return off | {k: off[k] + a for k, a in zip(self.candidate.strengths, self.amplitude, strict=True)}


def scores(study: Study, fit: Fit, tried: list[Candidate]) -> list[Score]:
    """All candidates at a fit whose looks hold their traces, best first."""
    products = fit.system.total()
    own = {n: v for n, v in fit.priors.items() if n not in fit.bound}
    more = {n: v for n, v in own.items() if n.split(".")[0] in fit.model.effects}
    base, _, _ = solved(study, fit.system, fit.model, fit.shifts, more, products)
    out = []
    for c in tried:
        if c.effect not in fit.model.effects:
            found = [_score(study, fit, c, v, own, more, base.ln_evidence, products) for v in range(len(c.variants))]
            out.append(max(found, key=lambda s: s.ln_bayes))
    return sorted(out, key=lambda s: -s.ln_bayes)


def _score(study, fit, c: Candidate, variant: int, own, more, base: float, products) -> Score:
    names = c.columns(variant)
    params, off = c.kind.params(), c.off(variant)
    if any(n not in fit.system.index for n in names):
        none = (0.0,) * len(names)
        return Score(c, variant, 0.0, none, none, 0.0, 0.0, 0.0, {}, "nothing that was measured could show it")
    priors = {n: (0.0, abs(a)) for n, a in zip(names, c.strengths.values(), strict=True)}
    u, info, raw = fit.system.projected(own, names, products)
    sd = np.array([abs(a) for a in c.strengths.values()])
    seen = float(np.sqrt(max(np.max(sd**2 * np.diag(info)), 0.0)))
    share = float(np.max(np.diag(info) / np.maximum(raw, 1e-300)))
    none = (0.0,) * len(names)
    if seen < NOTHING or not np.all(np.isfinite(info)):
        return Score(c, variant, 0.0, none, none, 0.0, seen, 0.0, {}, "does nothing under these conditions")
    solution, _, _ = solved(study, fit.system, fit.model, fit.shifts, more | priors, products)
    amplitude = tuple(solution[n] for n in names)
    errors = tuple(solution.sd(n) for n in names)
    z = float(np.sqrt(max(u @ np.linalg.pinv(info, hermitian=True) @ u, 0.0)))
    gain = solution.ln_evidence - base - (np.log(len(c.variants)) if len(c.variants) > 1 else 0.0)
    free = {k: solution[k] for k in study.priors if k in solution.names}
    wrong = [
        k
        for k, a in zip(c.strengths, amplitude, strict=True)
        if not params[k].low - 1e-12 <= off[k] + a <= params[k].high + 1e-12
    ]
    reason = ""
    if len(wrong) == len(names):
        sign = "below" if off[wrong[0]] + amplitude[0] < params[wrong[0]].low else "above"
        reason = f"would need {wrong[0]} {sign} what is possible"
        gain = min(gain, 0.0)
    return Score(c, variant, float(gain), amplitude, errors, z, seen, share, free, reason)


@dataclass(frozen=True)
class Separability:
    """Projected signatures of candidates: correlation `rho` (n, n) and `z` (n,) of their typical strengths."""

    names: tuple[str, ...]
    rho: np.ndarray
    z: np.ndarray

    def distinctness(self, name: str) -> float:
        """Share of a signature that no single rival can imitate: sqrt(1 - max rho^2)."""
        if name not in self.names:
            return 0.0
        i = self.names.index(name)
        others = np.delete(self.rho[i], i)
        return float(np.sqrt(max(0.0, 1.0 - np.max(others**2)))) if len(others) else 1.0

    def nearest(self, name: str) -> tuple[str, float]:
        """The rival with the most similar signature, and its correlation."""
        i = self.names.index(name)
        order = np.argsort(-np.abs(self.rho[i]))
        j = next(int(k) for k in order if k != i)
        return self.names[j], float(self.rho[i, j])


def separability(fit: Fit, tried: list[Candidate], products=None) -> Separability:
    """Correlations of what the nuisances leave of the candidates' signatures, one column each."""
    names = [c.column(next(iter(c.strengths))) for c in tried]
    names = [n for n in names if n in fit.system.index]
    own = {n: v for n, v in fit.priors.items() if n not in fit.bound}
    _, info, _ = fit.system.projected(own, names, products)
    sizes = {c.column(next(iter(c.strengths))): abs(next(iter(c.strengths.values()))) for c in tried}
    sd = np.array([sizes[n] for n in names])
    z = np.sqrt(np.maximum(np.diag(info), 0.0)) * sd
    good = z > NOTHING
    norm = np.sqrt(np.maximum(np.diag(info), 1e-300))
    rho = np.where(np.outer(good, good), info / np.outer(norm, norm), 0.0)
    np.fill_diagonal(rho, 1.0)
    return Separability(tuple(n.split(".")[0] for n in names), rho, z)


def pairs(study: Study, fit: Fit, ranked: list[Score], most: int = 12) -> list[tuple[float, Score, Score]]:
    """Evidence of two effects together, from their traces, for the candidates with the largest z; best first."""
    products = fit.system.total()
    own = {n: v for n, v in fit.priors.items() if n not in fit.bound}
    more = {n: v for n, v in own.items() if n.split(".")[0] in fit.model.effects}
    base, _, _ = solved(study, fit.system, fit.model, fit.shifts, more, products)
    best = sorted((s for s in ranked if s.seen > 1.0), key=lambda s: -s.z)[:most]
    out = []
    for i, a in enumerate(best):
        for b in best[i + 1 :]:
            both = [
                (s, n, abs(v))
                for s in (a, b)
                for n, v in zip(s.candidate.columns(s.variant), s.candidate.strengths.values(), strict=True)
            ]
            solution, _, _ = solved(
                study, fit.system, fit.model, fit.shifts, more | {n: (0.0, v) for _, n, v in both}, products
            )
            if all(_possible(s, n, solution[n]) for s, n, _ in both):
                out.append((solution.ln_evidence - base.ln_evidence, a, b))
    return sorted(out, key=lambda p: -p[0])


def _possible(s: Score, column: str, amplitude: float) -> bool:
    k = column.split(".")[1].split("@")[0]
    param = s.candidate.kind.params()[k]
    return param.low - 1e-12 <= param.off + amplitude <= param.high + 1e-12
