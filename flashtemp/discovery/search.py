"""What a model misses: calibrate, score every candidate, refit the best, extend, and judge on what no fit has seen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from flashtemp.discovery import adequacy
from flashtemp.discovery.calibration import LOOSE, Descent, Fit, advance, descend, extra
from flashtemp.discovery.hypothesis import Candidate, Model
from flashtemp.discovery.prediction import Wanted
from flashtemp.discovery.problem import MODES, Data, Study
from flashtemp.discovery.scores import Score, pairs, scores
from flashtemp.discovery.strangers import strangers, without
from flashtemp.errors import BadInput

NAMED, WEAK = 8.0, 5.0  # ln Bayes factors: of a named cause, and of a hint
APART = 3.0  # ln Bayes factor below which two explanations cannot be told apart
MOST = 2  # causes; where a third is asked for, it is rather one that the catalogue lacks
SHORT = 3  # candidates refitted
SIMILAR = 0.4  # of the best score: what is refitted beside it
TOGETHER = 6  # pairs tried at a time: each holds its images
HOPELESS = 40.0  # behind the best: a refit goes no further
COARSE = ((0.6, 1, 1), (1, 0.6, 1), (1, 1, 0.6), (0.5, 0.5, 0.5))  # cells of runs that tell what the mesh gets wrong


@dataclass
class Search:
    """A campaign on its way to a verdict: `base` calibrated, `best` extended; `fits` {effects: fit} of every refit;
    `ranking` the candidates' scores at the base and at every extension; `refused` {recording: why}."""

    study: Study
    data: Data
    watch: Callable[[str], Any]
    base: Fit | None = None
    best: Fit | None = None
    fits: dict[frozenset[str], Fit] = field(default_factory=dict)
    ranking: list[list[Score]] = field(default_factory=list)
    failed: str = ""
    refused: dict[str, str] = field(default_factory=dict)

    # --- calibration ---------------------------------------------------------------------------
    def calibrate(self) -> None:
        """The base model at its best point, with traces of all nuisances; `failed` says why there is none."""
        model = Model({k: 0.0 for k in self.study.campaign.free})
        wanted = Wanted(scatter=True, modes=MODES, trends=True)
        descent = Descent(self.study, self.data, model, {}, wanted=wanted)
        self.watch("calibrating the model that is believed")
        first = self.study.run(descent.tasks())
        coarse = [self.study.run(self.study.tasks(model, Wanted(), {}, c)) for c in COARSE]
        for answer in (*first, *(a for looks in coarse for a in looks)):
            if isinstance(answer, Exception):
                raise answer
        self.refused = strangers(self.study, first)
        if self.refused:
            self.study, (first, *coarse) = without(self.study, [first, *coarse], self.refused)
            self.data = Data(self.study)
            if not self.study.campaign.views:  # load cells alone would find nothing wrong
                raise BadInput(*(f"{file}: {why}" for file, why in self.refused.items()))
        self.data.fix(first, coarse)
        descent = Descent(self.study, self.data, model, {})
        descent.take(first)
        self.base = self._descend([descent])[0]

    def _from(self, model, shifts, effects: list[Candidate]) -> Descent:
        return Descent(self.study, self.data, model, dict(shifts), extra(effects))

    def _descend(self, descents: list[Descent]) -> list[Fit | None]:
        descend(self.study, descents, self.watch, HOPELESS)
        for d in descents:
            if d.fit is None:
                self.failed = d.failed or self.failed
        return [d.fit for d in descents]

    # --- candidates ----------------------------------------------------------------------------
    def traced(self, fit: Fit) -> Fit:
        """A fit with the traces of all candidates at its point."""
        self.watch("traces of the candidate effects")
        descent = self._from(fit.model, fit.shifts, self._candidates(fit.model))
        descent.wanted = Wanted(candidates=tuple(c for c in self.study.tried if c.effect not in fit.model.effects))
        looks = self.study.run(descent.tasks())
        for answer in looks:
            if isinstance(answer, Exception):
                raise answer
        descent.take(looks)
        return descent.fit

    def _candidates(self, model: Model) -> list[Candidate]:
        return [c for c in self.study.tried if c.effect in model.effects]

    def extend(self) -> None:
        """Add the best candidate, or pair, as long as the evidence asks for it."""
        self.best = self.traced(self.base)
        self.base = self.best
        self.fits[frozenset()] = self.best
        for depth in range(MOST):
            ranked = scores(self.study, self.best, list(self.study.tried))
            self.ranking.append(ranked)
            found = self._refit(ranked, depth)
            if found is None:
                return
            self.best = self.traced(found)
            self.fits[frozenset(found.model.effects)] = self.best
            if len(found.model.effects) >= MOST:
                break
        self.ranking.append(scores(self.study, self.best, list(self.study.tried)))

    def settle(self) -> None:
        """Bring the best model to its certificate, where a base that misfits was left rough."""
        if not self.best.converged:
            descent = self._from(self.best.model, self.best.shifts, self._candidates(self.best.model))
            descent.rough = False
            found = self._descend([descent])[0]
            if found is not None:
                self.best = self.fits[frozenset(found.model.effects)] = found

    def _refit(self, ranked: list[Score], depth: int) -> Fit | None:
        """Full fits of the shortlist from the present best; the best of them if it is worth its parameters."""
        good = [s for s in ranked if s.ln_bayes > (WEAK if depth else WEAK - 2.0)][:SHORT]
        good = [s for s in good if s.ln_bayes > SIMILAR * good[0].ln_bayes or s.ln_bayes > good[0].ln_bayes - 10.0]
        self._fit([(s,) for s in good])
        single = max((f.ln_evidence for k, f in self.fits.items() if len(k) == depth + 1), default=-np.inf)
        if depth == 0 and len(ranked) > 1:
            both = pairs(self.study, self.best, ranked)[:2]
            self._fit([p[1:] for p in both if p[0] > single - self.best.ln_evidence + NAMED and p[0] > 2 * NAMED])
        if depth == 0 and good and self.best.hopeless and not self._extended():
            self._run(self._companions(good[0], ranked))
        extended = self._extended()
        if depth:
            extended = [f for f in extended if self._agrees(f)]
        if not extended:
            return None
        best = max(extended, key=lambda f: f.ln_evidence - NAMED * len(f.model.effects))
        gained = best.ln_evidence - self.best.ln_evidence
        return best if gained > NAMED * (len(best.model.effects) - len(self.best.model.effects)) else None

    def _extended(self) -> list[Fit]:
        """Fits that hold more effects than the present best and are near their best point."""
        return [f for k, f in self.fits.items() if len(k) > len(self.best.model.effects) and usable(f)]

    def _companions(self, first: Score, ranked: list[Score]) -> list[Descent]:
        """The best partners of a strong effect that has no best point alone, after one step of each pair.

        Both begin at typical strength, the images where they were taken: where two effects shape each other, no
        trace of one alone shows the other, and a base that misfits shifts the images.
        """
        self.watch(f"fitting: {first.effect} alone has no best point; looking for a partner")
        model = Model(dict.fromkeys(self.best.model.free, 0.0), {first.effect: _typical(first)})
        best: list[Descent] = []
        others = [s for s in ranked if s is not first and s.seen > 0.0]
        for k in range(0, len(others), TOGETHER):
            for s in others[k : k + TOGETHER]:
                pair = model.with_effect(s.effect, _typical(s))
                best.append(self._from(pair, {}, [first.candidate, s.candidate]))
                best[-1].rough = False
            advance(self.study, [d for d in best if d.fit is None])
            best = sorted((d for d in best if not d.failed), key=lambda d: -d.fit.ln_evidence)[:SHORT]
        return best

    def _agrees(self, fit: Fit) -> bool:
        """Whether what a further cause adds is the same in all conditions: if not, it mops up something else."""
        new = fit.model.effects.keys() - self.best.model.effects.keys()
        added = [n for n in fit.solution.names if n.split(".")[0] in new]
        found = [adequacy.per_condition(self.study, fit, n) for n in added]
        return all(adequacy.consistent(f) > 10.0**-adequacy.SCATTERED for f in found)

    def _fit(self, groups: list[tuple[Score, ...]]) -> None:
        """Full fits of groups of candidates added to the present best, from where their traces point."""
        descents = []
        for group in groups:
            model, own = self.best.model, self._candidates(self.best.model)
            for s in group:
                model = model.with_effect(s.effect, _inside(s))
            if len(group) == 1:
                model = Model(_moved(self.study, model.free, group[0].free), model.effects)
            if frozenset(model.effects) not in self.fits:
                descents.append(self._from(model, self.best.shifts, [*own, *(s.candidate for s in group)]))
        self._run(descents)

    def _run(self, descents: list[Descent]) -> None:
        """Full fits, kept where they found anything."""
        if descents:
            self.watch(f"fitting {', '.join(' with '.join(d.model.effects) for d in descents)}")
        for d, fit in zip(descents, self._descend(descents), strict=True):
            if fit is not None and alive(fit):
                self.fits[frozenset(d.model.effects)] = fit


def usable(fit: Fit) -> bool:
    """Whether a fit is near enough to its best point to be compared and extended."""
    return fit.history[-1] < LOOSE


def _moved(study: Study, free: dict[str, float], steps: dict[str, float]) -> dict[str, float]:
    """Free keys after steps, within two standard deviations of what was known."""
    out = {}
    for k, v in free.items():
        sd = study.priors[k]
        out[k] = float(np.clip(v + steps.get(k, 0.0), -2.0 * sd, 2.0 * sd))
    return out


def alive(fit: Fit) -> bool:
    """Whether every effect of a model still acts: none of its strengths ended at off."""
    from flashtemp.physics.effect import catalogue

    for name, values in fit.model.effects.items():
        params = catalogue()[name].params()
        if all(values[k] == p.off for k, p in params.items() if k in values and p.off is not None):
            return False
    return True


def _typical(s: Score) -> dict[str, float]:
    """Values of an effect at its typical strength, with the sign of its trace where that is possible."""
    params, values = s.candidate.kind.params(), dict(s.values)
    for (k, a), change in zip(s.candidate.strengths.items(), s.amplitude, strict=True):
        p = params[k]
        values[k] = p.off + float(np.copysign(a, change))
        if not p.low <= values[k] <= p.high:
            values[k] = p.off + a
    return values


def _inside(s: Score) -> dict[str, float]:
    """Start values of a full fit, within bounds and not off."""
    params, values = s.candidate.kind.params(), dict(s.values)
    for k, a in s.candidate.strengths.items():
        p = params[k]
        values[k] = float(np.clip(values[k], p.low, p.high))
        if values[k] == p.off:
            values[k] = float(np.clip(p.off + 0.1 * a, p.low, p.high))
    return values
