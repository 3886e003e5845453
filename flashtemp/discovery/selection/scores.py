"""Scores of candidate effects by their sensitivities, without a full fit: Bayes factors of single effects and of pairs.

A score is the ln Bayes factor of the linearised model with the candidate's strengths as additional unknowns, against
the fit that it would extend.  Hyperparameters are estimated again, but the noise of recordings stays that of the fit.
`Separability` says how well the data distinguish the candidates from each other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flashtemp.discovery.estimation.linear_gaussian import Array, NormalEquations, Solution
from flashtemp.discovery.estimation.linearised_fit import LinearisedFit
from flashtemp.discovery.hypotheses.candidates import CandidateEffect
from flashtemp.discovery.hypotheses.heavy_tails import (
    MAX_WIDTH_SWEEPS,
    STRENGTH_TAIL,
    WIDTH_TOLERANCE,
    local_width,
    width_price,
)
from flashtemp.discovery.parameters import ParameterId
from flashtemp.discovery.prediction.problem import Problem

MIN_EFFECT_Z = (
    1e-3  # signal-to-noise ratio at typical strength, below which an effect does not act under the conditions
)
MIN_PARTNER_Z = 1.0  # the same, below which an effect is not tried in a pair
MIN_RESCORED_LN_BAYES = 0.0  # ln Bayes factor with sensitivities of another point, below which none are computed anew
BOUND_ROUNDING = 1e-12  # a value may exceed its bound by as much, from rounding


@dataclass(frozen=True)
class CandidateScore:
    """The score of a candidate in its best shape `variant`.

    `ln_bayes`: against the model without it.  `amplitude`: estimated change of its strengths from their neutral values,
    with standard errors `sd`.  `z`: signal-to-noise ratio of that amplitude after the nuisances were projected out;
    `typical_z`: the same at its typical strength.  `raw_share`: fraction of its signal that nuisances cannot absorb.
    `free`: steps of the free keys that go with it.  `reason`: why the estimate is impossible; empty if it is possible.
    """

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
        """The score of a candidate that no datum could show."""
        zero = (0.0,) * len(candidate.strengths)
        return cls(candidate, variant, 0.0, zero, zero, 0.0, typical_z, 0.0, {}, reason)

    @property
    def effect(self) -> str:
        return self.candidate.effect

    def has_columns(self, fit: LinearisedFit) -> bool:
        """Whether a fit has its sensitivities."""
        return all(p in fit.system.index for p in self.typical_strengths)

    @property
    def typical_strengths(self) -> dict[ParameterId, float]:
        """Its columns in the best variant, with typical strengths."""
        return _typical_strengths(self.candidate, self.variant)


@dataclass(frozen=True)
class ScoringContext:
    """The fit against which candidates are scored, with its own evidence; it must have their sensitivities."""

    problem: Problem
    fit: LinearisedFit
    equations: NormalEquations
    ln_evidence: float

    @classmethod
    def from_fit(cls, problem: Problem, fit: LinearisedFit) -> ScoringContext:
        equations = fit.equations
        own = fit.solve_with(problem, fit.free_effect_priors, equations)
        return cls(problem, fit, equations, own.solution.ln_evidence)


def score_candidates(
    problem: Problem, fit: LinearisedFit, tried: Sequence[CandidateEffect]
) -> tuple[CandidateScore, ...]:
    """Score all candidates that a fit does not contain yet, best first; the fit must have their sensitivities."""
    base = ScoringContext.from_fit(problem, fit)
    out = []
    for c in tried:
        if c.effect not in fit.model.effects:
            variants = [_score_variant(base, c, v) for v in range(len(c.shape_variants))]
            out.append(max(variants, key=lambda s: s.ln_bayes))
    return tuple(sorted(out, key=lambda s: -s.ln_bayes))


def select_for_rescoring(
    problem: Problem, before: LinearisedFit, found: LinearisedFit, ranked: Sequence[CandidateScore]
) -> tuple[CandidateEffect, ...]:
    """Candidates that may explain residuals of an extended fit `found`, by their sensitivities at the fit `before` it.

    Candidates without influence there are kept too, because the added effects may give them an influence.
    """
    system = before.system.with_residuals({b.label: b.r for b in found.blocks})
    # new residuals with the sensitivities of the fit before: no candidate is simulated again
    at = replace(before, model=found.model, system=system, hyper=found.hyper)

    def solve_evidence(sensitivities: dict[ParameterId, float]) -> float:
        more = {p: (0.0, abs(a)) for p, a in sensitivities.items() if p in system.index}
        return at.solve_with(problem, more, at.equations).solution.ln_evidence

    tried = [s.candidate for s in ranked]
    without_influence = {s.effect for s in ranked if s.has_columns(before) and s.typical_z < MIN_PARTNER_Z}
    own = {p: a for c in tried if c.effect in found.model.effects for p, a in _typical_strengths(c, 0).items()}
    alone = solve_evidence(own)
    others = [c for c in tried if c.effect not in found.model.effects]
    gains = {
        c.effect: max(solve_evidence(own | _typical_strengths(c, v)) for v in range(len(c.shape_variants))) - alone
        for c in others
    }
    return tuple(c for c in others if gains[c.effect] > MIN_RESCORED_LN_BAYES or c.effect in without_influence)


def _typical_strengths(c: CandidateEffect, variant: int) -> dict[ParameterId, float]:
    """The columns of a candidate, with its typical strengths."""
    return dict(zip(c.strength_columns(variant), c.strengths.values(), strict=True))


def _solve_with_strengths(base: ScoringContext, typical: Mapping[ParameterId, float]) -> Solution:
    """The linearised fit with the strengths of effects free, whose priors have the local widths at the solution.

    The better of two optima, near no effect and near the estimate from the data alone, if there are two.
    """
    usual = {p: abs(a) for p, a in typical.items()}
    near = _solve_with_widths(base, usual)
    widths = {p: _far_width(near[p], near.sd(p), a) for p, a in usual.items()}
    if widths == usual:
        return near
    for _ in range(MAX_WIDTH_SWEEPS):
        far = _solve_with_widths(base, widths)
        local = {p: local_width(a, far[p], STRENGTH_TAIL) for p, a in usual.items()}
        if all(1.0 / WIDTH_TOLERANCE < local[p] / widths[p] < WIDTH_TOLERANCE for p in usual):
            break
        widths = local
    price = sum(width_price(widths[p], a, STRENGTH_TAIL) for p, a in usual.items())
    far = replace(far, ln_evidence=far.ln_evidence - price)
    return max(near, far, key=lambda s: s.ln_evidence)


def _far_width(estimate: float, sd: float, usual: float) -> float:
    """Local width at the estimate from the data alone, if the prior has an optimum there; else the usual one."""
    precision = sd**-2.0 - usual**-2.0
    if precision <= 1e-9 * usual**-2.0:
        return usual
    alone = estimate * sd**-2.0 / precision
    # a + (1 + k) sd^2/a = alone: the condition of an optimum beyond the normal core
    return local_width(usual, alone, STRENGTH_TAIL) if alone**2 * precision > 4.0 * (1.0 + STRENGTH_TAIL) else usual


def _solve_with_widths(base: ScoringContext, widths: Mapping[ParameterId, float]) -> Solution:
    """The linearised fit with strengths free that have normal priors of given widths about no effect."""
    priors = {p: (0.0, sd) for p, sd in widths.items()}
    return base.fit.solve_with(base.problem, base.fit.free_effect_priors | priors, base.equations).solution


def _score_variant(base: ScoringContext, c: CandidateEffect, variant: int) -> CandidateScore:
    names, fit = c.strength_columns(variant), base.fit
    if any(n not in fit.system.index for n in names):
        return CandidateScore.untestable(c, variant, 0.0, "none of the measured quantities depends on it")
    projection = fit.system.project_out(fit.free_priors, names, base.equations)
    info, u = projection.information, projection.score
    sd = np.array([abs(a) for a in c.strengths.values()])
    typical_z = float(np.sqrt(max(np.max(sd**2 * np.diag(info)), 0.0)))
    if typical_z < MIN_EFFECT_Z or not np.all(np.isfinite(info)):
        return CandidateScore.untestable(c, variant, typical_z, "has no effect under these conditions")
    solution = _solve_with_strengths(base, dict(zip(names, c.strengths.values(), strict=True)))
    amplitude, errors = tuple(solution[n] for n in names), tuple(solution.sd(n) for n in names)
    # u' I^-1 u of eq. (42): what the data say of the effect beyond all nuisances
    z = float(np.sqrt(max(float(u @ np.linalg.pinv(info, hermitian=True) @ u), 0.0)))
    # the best of n variants is reported, each as likely as the others a priori: that costs ln n
    gain = (
        solution.ln_evidence - base.ln_evidence - (np.log(len(c.shape_variants)) if len(c.shape_variants) > 1 else 0.0)
    )
    reason = _impossibility_reason(c, variant, amplitude)
    return CandidateScore(
        candidate=c, variant=variant, ln_bayes=float(min(gain, 0.0) if reason else gain), amplitude=amplitude,
        sd=errors, z=z, typical_z=typical_z,
        raw_share=float(np.max(np.diag(info) / np.maximum(projection.raw, 1e-300))),
        free={p.name: solution[p] for p in base.problem.free_keys if p in solution.names}, reason=reason,
    )  # fmt: skip


def _impossibility_reason(c: CandidateEffect, variant: int, amplitude: tuple[float, ...]) -> str:
    """Why the estimated strengths of a candidate are all out of bounds; empty if at least one is possible."""
    off = c.neutral_values(variant)
    wrong = [
        k
        for k, a in zip(c.strengths, amplitude, strict=True)
        if not c.params[k].low - BOUND_ROUNDING <= off[k] + a <= c.params[k].high + BOUND_ROUNDING
    ]
    if len(wrong) < len(amplitude):
        return ""
    sign = "below" if off[wrong[0]] + amplitude[0] < c.params[wrong[0]].low else "above"
    return f"would need {wrong[0]} {sign} its bound"


@dataclass(frozen=True)
class Separability:
    """Projected signatures of candidates: correlation `rho` (n, n) and `z` (n,) of their typical strengths."""

    names: tuple[str, ...]
    rho: Array
    z: Array

    def distinctness(self, name: str) -> float:
        """Fraction of a signature that no other single candidate can imitate: sqrt(1 - max rho^2)."""
        if name not in self.names:
            return 0.0
        i = self.names.index(name)
        others = np.delete(self.rho[i], i)
        return float(np.sqrt(max(0.0, 1.0 - np.max(others**2)))) if len(others) else 1.0

    def pair_distinctness(self, name: str, other: str) -> float:
        """Fraction of a signature that one other candidate cannot imitate: sqrt(1 - rho^2); 1 if either is unknown."""
        if name not in self.names or other not in self.names:
            return 1.0
        rho = self.rho[self.names.index(name), self.names.index(other)]
        return float(np.sqrt(max(0.0, 1.0 - rho**2)))

    def nearest_rival(self, name: str) -> tuple[str, float]:
        """The candidate with the most similar signature, and its correlation; ("none", 0.0) if none correlates."""
        i = self.names.index(name)
        others = np.where(np.arange(len(self.names)) == i, 0.0, self.rho[i])
        j = int(np.argmax(np.abs(others)))
        return (self.names[j], float(others[j])) if others[j] else ("none", 0.0)


def compute_separability(fit: LinearisedFit, tried: Sequence[CandidateEffect]) -> Separability:
    """Correlations of the candidates' signatures after the nuisances were projected out, one column for each."""
    sizes: dict[ParameterId, float] = {}
    for c in tried:
        k, a = c.leading_strength
        if c.strength_column(k) in fit.system.index:
            sizes[c.strength_column(k)] = abs(a)
    info = fit.system.project_out(fit.free_priors, list(sizes), fit.equations).information
    sd = np.array(list(sizes.values()))
    z = np.sqrt(np.maximum(np.diag(info), 0.0)) * sd
    good = z > MIN_EFFECT_Z
    # cosines between signatures: at +-1 the calibrated data cannot tell two effects apart
    norm = np.sqrt(np.maximum(np.diag(info), 1e-300))
    rho = np.where(np.outer(good, good), info / np.outer(norm, norm), 0.0)
    np.fill_diagonal(rho, 1.0)
    return Separability(tuple(p.effect for p in sizes), rho, z)


@dataclass(frozen=True)
class EffectPair:
    """Two candidates together: `ln_bayes` of both against the model without them, and how much `more` that is than the
    ln Bayes factor of the better one alone."""

    ln_bayes: float
    scores: tuple[CandidateScore, CandidateScore]
    more: float


def score_pairs(
    problem: Problem, fit: LinearisedFit, ranked: Sequence[CandidateScore], max_effects: int = 12
) -> list[EffectPair]:
    """Score all pairs of the `max_effects` candidates with the largest z, best first."""
    base = ScoringContext.from_fit(problem, fit)
    # the number of pairs grows with the square, so only the candidates with the largest z take part
    best = sorted((s for s in ranked if s.typical_z > MIN_PARTNER_Z), key=lambda s: -s.z)[:max_effects]

    def solve_together(*together: CandidateScore) -> Solution:
        return _solve_with_strengths(base, {n: v for s in together for n, v in s.typical_strengths.items()})

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
