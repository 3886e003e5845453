"""Candidates scored by their sensitivities: Bayes factors of each and of all pairs, and what distinguishes them.

A score is the ln Bayes factor of the linearised model with the candidate's strengths as further unknowns, against the
fit that it would extend, hyperparameters chosen anew; the noise of recordings stays as that fit has it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flashtemp.discovery.estimation.linear_gaussian import Array, NormalEquations, Solution
from flashtemp.discovery.estimation.linearised_fit import Fit
from flashtemp.discovery.hypotheses.candidates import Candidate
from flashtemp.discovery.parameters import ParameterId, Priors
from flashtemp.discovery.prediction.problem import Problem

NOTHING = 1e-3  # z of a signature of typical strength below which an effect does nothing here
SEEN = 1.0  # z of a typical strength below which an effect is no partner of another
UNLIKELY = 0.0  # ln Bayes factor by a trace from elsewhere, below which none is taken anew
SLACK = 1e-12  # beyond a bound that is rounding


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

    @classmethod
    def none(cls, candidate: Candidate, variant: int, seen: float, reason: str) -> Score:
        """Of a candidate that cannot be told from nothing."""
        zero = (0.0,) * len(candidate.strengths)
        return cls(candidate, variant, 0.0, zero, zero, 0.0, seen, 0.0, {}, reason)

    @property
    def effect(self) -> str:
        return self.candidate.effect

    def traced(self, fit: Fit) -> bool:
        """Whether a fit has its traces."""
        return all(p in fit.system.index for p in self.traces)

    @property
    def traces(self) -> dict[ParameterId, float]:
        """Columns in the best variant, with their typical strengths."""
        return _traces(self.candidate, self.variant)

    @property
    def values(self) -> dict[str, float]:
        """Values of all parameters from which a full fit may start."""
        off = self.candidate.off(self.variant)
        return off | {k: off[k] + a for k, a in zip(self.candidate.strengths, self.amplitude, strict=True)}


@dataclass(frozen=True)
class Base:
    """What candidates are scored against: a fit whose predictions hold their traces, and its own evidence."""

    problem: Problem
    fit: Fit
    equations: NormalEquations
    ln_evidence: float

    @classmethod
    def of(cls, problem: Problem, fit: Fit) -> Base:
        equations = fit.equations
        own = fit.solved(problem, _effects(fit), equations)
        return cls(problem, fit, equations, own.solution.ln_evidence)


def _effects(fit: Fit) -> Priors:
    """Priors of the parameters of effects that the model holds, but for those on a bound."""
    return {p: v for p, v in fit.effects.items() if p not in fit.bound}


def scores(problem: Problem, fit: Fit, tried: Sequence[Candidate]) -> tuple[Score, ...]:
    """All candidates at a fit whose predictions hold their traces, best first."""
    base = Base.of(problem, fit)
    out = []
    for c in tried:
        if c.effect not in fit.model.effects:
            found = [_score(base, c, v) for v in range(len(c.variants))]
            out.append(max(found, key=lambda s: s.ln_bayes))
    return tuple(sorted(out, key=lambda s: -s.ln_bayes))


def worth_another_look(problem: Problem, before: Fit, found: Fit, ranked: Sequence[Score]) -> tuple[Candidate, ...]:
    """Candidates that may explain any of what an extended fit leaves, by their sensitivities at the fit `before` it.

    Those that do nothing there are kept too: the effects that were found may awaken them.
    """
    system = before.system.shown({b.label: b.r for b in found.blocks})
    at = replace(before, model=found.model, system=system, hyper=found.hyper)

    def evidence(sensitivities: dict[ParameterId, float]) -> float:
        more = {p: (0.0, abs(a)) for p, a in sensitivities.items() if p in system.index}
        return at.solved(problem, more, at.equations).solution.ln_evidence

    tried, silent = [s.candidate for s in ranked], {s.effect for s in ranked if s.traced(before) and s.seen < SEEN}
    own = {p: a for c in tried if c.effect in found.model.effects for p, a in _traces(c, 0).items()}
    alone = evidence(own)
    others = [c for c in tried if c.effect not in found.model.effects]
    gains = {c.effect: max(evidence(own | _traces(c, v)) for v in range(len(c.variants))) - alone for c in others}
    return tuple(c for c in others if gains[c.effect] > UNLIKELY or c.effect in silent)


def _traces(c: Candidate, variant: int) -> dict[ParameterId, float]:
    """Columns of a candidate, with its typical strengths."""
    return dict(zip(c.columns(variant), c.strengths.values(), strict=True))


def _score(base: Base, c: Candidate, variant: int) -> Score:
    names, fit = c.columns(variant), base.fit
    if any(n not in fit.system.index for n in names):
        return Score.none(c, variant, 0.0, "nothing that was measured could show it")
    found = fit.system.projected(fit.nuisances, names, base.equations)
    info, u = found.information, found.score
    sd = np.array([abs(a) for a in c.strengths.values()])
    seen = float(np.sqrt(max(np.max(sd**2 * np.diag(info)), 0.0)))
    if seen < NOTHING or not np.all(np.isfinite(info)):
        return Score.none(c, variant, seen, "does nothing under these conditions")
    priors = {n: (0.0, abs(a)) for n, a in zip(names, c.strengths.values(), strict=True)}
    solution = fit.solved(base.problem, _effects(fit) | priors, base.equations).solution
    amplitude, errors = tuple(solution[n] for n in names), tuple(solution.sd(n) for n in names)
    z = float(np.sqrt(max(float(u @ np.linalg.pinv(info, hermitian=True) @ u), 0.0)))
    gain = solution.ln_evidence - base.ln_evidence - (np.log(len(c.variants)) if len(c.variants) > 1 else 0.0)
    reason = _impossible(c, variant, amplitude)
    return Score(
        candidate=c, variant=variant, ln_bayes=float(min(gain, 0.0) if reason else gain), amplitude=amplitude,
        sd=errors, z=z, seen=seen, raw_share=float(np.max(np.diag(info) / np.maximum(found.raw, 1e-300))),
        free={p.name: solution[p] for p in base.problem.free if p in solution.names}, reason=reason,
    )  # fmt: skip


def _impossible(c: Candidate, variant: int, amplitude: tuple[float, ...]) -> str:
    """Why no strength of a candidate can have its amplitude; empty where one can."""
    off = c.off(variant)
    wrong = [
        k
        for k, a in zip(c.strengths, amplitude, strict=True)
        if not c.params[k].low - SLACK <= off[k] + a <= c.params[k].high + SLACK
    ]
    if len(wrong) < len(amplitude):
        return ""
    sign = "below" if off[wrong[0]] + amplitude[0] < c.params[wrong[0]].low else "above"
    return f"would need {wrong[0]} {sign} what is possible"


@dataclass(frozen=True)
class Separability:
    """Projected signatures of candidates: correlation `rho` (n, n) and `z` (n,) of their typical strengths."""

    names: tuple[str, ...]
    rho: Array
    z: Array

    def distinctness(self, name: str) -> float:
        """Share of a signature that no single rival can imitate: sqrt(1 - max rho^2)."""
        if name not in self.names:
            return 0.0
        i = self.names.index(name)
        others = np.delete(self.rho[i], i)
        return float(np.sqrt(max(0.0, 1.0 - np.max(others**2)))) if len(others) else 1.0

    def nearest(self, name: str) -> tuple[str, float]:
        """The rival with the most similar signature, and its correlation; none where nothing is like it."""
        i = self.names.index(name)
        others = np.where(np.arange(len(self.names)) == i, 0.0, self.rho[i])
        j = int(np.argmax(np.abs(others)))
        return (self.names[j], float(others[j])) if others[j] else ("none", 0.0)


def separability(fit: Fit, tried: Sequence[Candidate]) -> Separability:
    """Correlations of what the nuisances leave of the candidates' signatures, one column each."""
    sizes: dict[ParameterId, float] = {}
    for c in tried:
        k, a = c.first
        if c.column(k) in fit.system.index:
            sizes[c.column(k)] = abs(a)
    info = fit.system.projected(fit.nuisances, list(sizes), fit.equations).information
    sd = np.array(list(sizes.values()))
    z = np.sqrt(np.maximum(np.diag(info), 0.0)) * sd
    good = z > NOTHING
    norm = np.sqrt(np.maximum(np.diag(info), 1e-300))
    rho = np.where(np.outer(good, good), info / np.outer(norm, norm), 0.0)
    np.fill_diagonal(rho, 1.0)
    return Separability(tuple(p.effect for p in sizes), rho, z)


@dataclass(frozen=True)
class Pair:
    """Two candidates together, `ln_bayes` of their traces against the model without both, and how much `more` that is
    than of either alone."""

    ln_bayes: float
    scores: tuple[Score, Score]
    more: float


def pairs(problem: Problem, fit: Fit, ranked: Sequence[Score], most: int = 12) -> list[Pair]:
    """Two effects together, for the candidates with the largest z; best first."""
    base = Base.of(problem, fit)
    best = sorted((s for s in ranked if s.seen > SEEN), key=lambda s: -s.z)[:most]

    def solved(*together: Score) -> Solution:
        more = {n: (0.0, abs(v)) for s in together for n, v in s.traces.items()}
        return fit.solved(problem, _effects(fit) | more, base.equations).solution

    out, alone = [], {s.effect: solved(s).ln_evidence for s in best}
    for i, a in enumerate(best):
        for b in best[i + 1 :]:
            solution = solved(a, b)
            if all(_possible(s, n, solution[n]) for s in (a, b) for n in s.traces):
                more = solution.ln_evidence - max(alone[a.effect], alone[b.effect])
                out.append(Pair(solution.ln_evidence - base.ln_evidence, (a, b), more))
    return sorted(out, key=lambda p: -p.ln_bayes)


def _possible(s: Score, p: ParameterId, amplitude: float) -> bool:
    param = s.candidate.params[p.name]
    return param.low - SLACK <= (param.off or 0.0) + amplitude <= param.high + SLACK
