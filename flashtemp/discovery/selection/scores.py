"""Candidates scored by their sensitivities: Bayes factors of each and of all pairs, and what distinguishes them.

A score is the ln Bayes factor of the linearised model with the candidate's strengths as further unknowns, against the
fit that it would extend, hyperparameters chosen anew; the noise of recordings stays as that fit has it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flashtemp.discovery.estimation.linear_gaussian import Array, NormalEquations, Solution
from flashtemp.discovery.estimation.linearised_fit import LinearisedFit
from flashtemp.discovery.hypotheses.candidates import CandidateEffect
from flashtemp.discovery.parameters import ParameterId, Priors
from flashtemp.discovery.prediction.problem import Problem

MIN_EFFECT_Z = 1e-3  # z of a signature of typical strength below which an effect does nothing here
MIN_PARTNER_Z = 1.0  # z of a typical strength below which an effect is no partner of another
MIN_RESCORED_LN_BAYES = 0.0  # ln Bayes factor by a trace from elsewhere, below which none is taken anew
BOUND_ROUNDING = 1e-12  # beyond a bound that is rounding


@dataclass(frozen=True)
class CandidateScore:
    """A candidate in its best `variant`: `ln_bayes` against the model without it, `amplitude` of its strengths
    (change from off) with `sd`; `z` and `typical_z` (z of its typical strength) after projection, `raw_share` of
    its signal that nuisances cannot absorb; `free` steps of the free keys with it; `reason` why it cannot be, if so."""

    candidate: CandidateEffect
    variant: int
    ln_bayes: float
    amplitude: tuple[float, ...]
    sd: tuple[float, ...]
    z: float
    typical_z: float
    raw_share: float
    free: dict[str, float]
    reason: str = ""

    @classmethod
    def untestable(cls, candidate: CandidateEffect, variant: int, typical_z: float, reason: str) -> CandidateScore:
        """Of a candidate that cannot be told from nothing."""
        zero = (0.0,) * len(candidate.strengths)
        return cls(candidate, variant, 0.0, zero, zero, 0.0, typical_z, 0.0, {}, reason)

    @property
    def effect(self) -> str:
        return self.candidate.effect

    def has_columns(self, fit: LinearisedFit) -> bool:
        """Whether a fit has its traces."""
        return all(p in fit.system.index for p in self.typical_strengths)

    @property
    def typical_strengths(self) -> dict[ParameterId, float]:
        """Columns in the best variant, with their typical strengths."""
        return _typical_strengths(self.candidate, self.variant)

    @property
    def start_values(self) -> dict[str, float]:
        """Values of all parameters from which a full fit may start."""
        off = self.candidate.neutral_values(self.variant)
        return off | {k: off[k] + a for k, a in zip(self.candidate.strengths, self.amplitude, strict=True)}


@dataclass(frozen=True)
class ScoringContext:
    """What candidates are scored against: a fit whose predictions hold their traces, and its own evidence."""

    problem: Problem
    fit: LinearisedFit
    equations: NormalEquations
    ln_evidence: float

    @classmethod
    def from_fit(cls, problem: Problem, fit: LinearisedFit) -> ScoringContext:
        equations = fit.equations
        own = fit.solve_with(problem, _free_effect_priors(fit), equations)
        return cls(problem, fit, equations, own.solution.ln_evidence)


def _free_effect_priors(fit: LinearisedFit) -> Priors:
    """Priors of the parameters of effects that the model holds, but for those on a bound."""
    return {p: v for p, v in fit.effect_priors.items() if p not in fit.bound}


def score_candidates(
    problem: Problem, fit: LinearisedFit, tried: Sequence[CandidateEffect]
) -> tuple[CandidateScore, ...]:
    """All candidates at a fit whose predictions hold their traces, best first."""
    base = ScoringContext.from_fit(problem, fit)
    out = []
    for c in tried:
        if c.effect not in fit.model.effects:
            found = [_score_variant(base, c, v) for v in range(len(c.shape_variants))]
            out.append(max(found, key=lambda s: s.ln_bayes))
    return tuple(sorted(out, key=lambda s: -s.ln_bayes))


def select_for_rescoring(
    problem: Problem, before: LinearisedFit, found: LinearisedFit, ranked: Sequence[CandidateScore]
) -> tuple[CandidateEffect, ...]:
    """Candidates that may explain any of what an extended fit leaves, by their sensitivities at the fit `before` it.

    Those that do nothing there are kept too: the effects that were found may awaken them.
    """
    system = before.system.with_residuals({b.label: b.r for b in found.blocks})
    at = replace(before, model=found.model, system=system, hyper=found.hyper)

    def solve_evidence(sensitivities: dict[ParameterId, float]) -> float:
        more = {p: (0.0, abs(a)) for p, a in sensitivities.items() if p in system.index}
        return at.solve_with(problem, more, at.equations).solution.ln_evidence

    tried, silent = (
        [s.candidate for s in ranked],
        {s.effect for s in ranked if s.has_columns(before) and s.typical_z < MIN_PARTNER_Z},
    )
    own = {p: a for c in tried if c.effect in found.model.effects for p, a in _typical_strengths(c, 0).items()}
    alone = solve_evidence(own)
    others = [c for c in tried if c.effect not in found.model.effects]
    gains = {
        c.effect: max(solve_evidence(own | _typical_strengths(c, v)) for v in range(len(c.shape_variants))) - alone
        for c in others
    }
    return tuple(c for c in others if gains[c.effect] > MIN_RESCORED_LN_BAYES or c.effect in silent)


def _typical_strengths(c: CandidateEffect, variant: int) -> dict[ParameterId, float]:
    """Columns of a candidate, with its typical strengths."""
    return dict(zip(c.strength_columns(variant), c.strengths.values(), strict=True))


def _score_variant(base: ScoringContext, c: CandidateEffect, variant: int) -> CandidateScore:
    names, fit = c.strength_columns(variant), base.fit
    if any(n not in fit.system.index for n in names):
        return CandidateScore.untestable(c, variant, 0.0, "nothing that was measured could show it")
    found = fit.system.project_out(fit.free_priors, names, base.equations)
    info, u = found.information, found.score
    sd = np.array([abs(a) for a in c.strengths.values()])
    seen = float(np.sqrt(max(np.max(sd**2 * np.diag(info)), 0.0)))
    if seen < MIN_EFFECT_Z or not np.all(np.isfinite(info)):
        return CandidateScore.untestable(c, variant, seen, "does nothing under these conditions")
    priors = {n: (0.0, abs(a)) for n, a in zip(names, c.strengths.values(), strict=True)}
    solution = fit.solve_with(base.problem, _free_effect_priors(fit) | priors, base.equations).solution
    amplitude, errors = tuple(solution[n] for n in names), tuple(solution.sd(n) for n in names)
    z = float(np.sqrt(max(float(u @ np.linalg.pinv(info, hermitian=True) @ u), 0.0)))
    gain = (
        solution.ln_evidence - base.ln_evidence - (np.log(len(c.shape_variants)) if len(c.shape_variants) > 1 else 0.0)
    )
    reason = _impossibility_reason(c, variant, amplitude)
    return CandidateScore(
        candidate=c, variant=variant, ln_bayes=float(min(gain, 0.0) if reason else gain), amplitude=amplitude,
        sd=errors, z=z, typical_z=seen, raw_share=float(np.max(np.diag(info) / np.maximum(found.raw, 1e-300))),
        free={p.name: solution[p] for p in base.problem.free_keys if p in solution.names}, reason=reason,
    )  # fmt: skip


def _impossibility_reason(c: CandidateEffect, variant: int, amplitude: tuple[float, ...]) -> str:
    """Why no strength of a candidate can have its amplitude; empty where one can."""
    off = c.neutral_values(variant)
    wrong = [
        k
        for k, a in zip(c.strengths, amplitude, strict=True)
        if not c.params[k].low - BOUND_ROUNDING <= off[k] + a <= c.params[k].high + BOUND_ROUNDING
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

    def nearest_rival(self, name: str) -> tuple[str, float]:
        """The rival with the most similar signature, and its correlation; none where nothing is like it."""
        i = self.names.index(name)
        others = np.where(np.arange(len(self.names)) == i, 0.0, self.rho[i])
        j = int(np.argmax(np.abs(others)))
        return (self.names[j], float(others[j])) if others[j] else ("none", 0.0)


def compute_separability(fit: LinearisedFit, tried: Sequence[CandidateEffect]) -> Separability:
    """Correlations of what the nuisances leave of the candidates' signatures, one column each."""
    sizes: dict[ParameterId, float] = {}
    for c in tried:
        k, a = c.leading_strength
        if c.strength_column(k) in fit.system.index:
            sizes[c.strength_column(k)] = abs(a)
    info = fit.system.project_out(fit.free_priors, list(sizes), fit.equations).information
    sd = np.array(list(sizes.values()))
    z = np.sqrt(np.maximum(np.diag(info), 0.0)) * sd
    good = z > MIN_EFFECT_Z
    norm = np.sqrt(np.maximum(np.diag(info), 1e-300))
    rho = np.where(np.outer(good, good), info / np.outer(norm, norm), 0.0)
    np.fill_diagonal(rho, 1.0)
    return Separability(tuple(p.effect for p in sizes), rho, z)


@dataclass(frozen=True)
class EffectPair:
    """Two candidates together, `ln_bayes` of their traces against the model without both, and how much `more` that is
    than of either alone."""

    ln_bayes: float
    scores: tuple[CandidateScore, CandidateScore]
    more: float


def score_pairs(
    problem: Problem, fit: LinearisedFit, ranked: Sequence[CandidateScore], max_effects: int = 12
) -> list[EffectPair]:
    """Two effects together, for the candidates with the largest z; best first."""
    base = ScoringContext.from_fit(problem, fit)
    best = sorted((s for s in ranked if s.typical_z > MIN_PARTNER_Z), key=lambda s: -s.z)[:max_effects]

    def solve_together(*together: CandidateScore) -> Solution:
        more = {n: (0.0, abs(v)) for s in together for n, v in s.typical_strengths.items()}
        return fit.solve_with(problem, _free_effect_priors(fit) | more, base.equations).solution

    out, alone = [], {s.effect: solve_together(s).ln_evidence for s in best}
    for i, a in enumerate(best):
        for b in best[i + 1 :]:
            solution = solve_together(a, b)
            if all(_is_possible(s, n, solution[n]) for s in (a, b) for n in s.typical_strengths):
                more = solution.ln_evidence - max(alone[a.effect], alone[b.effect])
                out.append(EffectPair(solution.ln_evidence - base.ln_evidence, (a, b), more))
    return sorted(out, key=lambda p: -p.ln_bayes)


def _is_possible(s: CandidateScore, p: ParameterId, amplitude: float) -> bool:
    param = s.candidate.params[p.name]
    return param.low - BOUND_ROUNDING <= (param.off or 0.0) + amplitude <= param.high + BOUND_ROUNDING
