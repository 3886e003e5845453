"""Where a full fit of a candidate begins: where its trace points or, where the base misfits grossly, where runs say."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from flashtemp.discovery import adequacy
from flashtemp.discovery.fit import Fit
from flashtemp.discovery.hypothesis import Model
from flashtemp.discovery.parameters import OF_THE_LABORATORY, SHIFTS
from flashtemp.discovery.prediction import Derivatives, Prediction
from flashtemp.discovery.problem import Problem
from flashtemp.discovery.scores import Score
from flashtemp.discovery.whitening import Data
from flashtemp.errors import FlashtempError

DRAGGED = 3.0  # standard deviations by which an image, or the block, is not likely to be off where a model misfits


def dragged(fit: Fit) -> bool:
    """Whether a model has dragged images or the block to where they are not: what extends it begins where all was told
    to be.  One that misfits grossly drags them anywhere; another one hides what it misses that way."""
    own, far = (*SHIFTS, *OF_THE_LABORATORY), DRAGGED if fit.hopeless else adequacy.PULL
    return any(abs(v) > far for p, v in adequacy.pulls(fit).items() if p.kind in own)


def by_runs(problem: Problem, data: Data, fit: Fit, s: Score) -> dict[str, float]:
    """Values of an effect, of those that its trace and its typical strength suggest, that leave least of the condition
    that misfits most: no tangent reaches far from a base that misfits grossly."""
    options, model = list(_options(s)), replace(problem.start, effects=fit.model.effects)
    left = misfits(replace(problem, stiff=True), data, fit, [model.with_effect(s.effect, o) for o in options])
    return options[int(np.argmin(left))]


def misfits(problem: Problem, data: Data, fit: Fit, models: Sequence[Model]) -> list[float]:
    """chi2 that models leave of the condition that a fit misfits most, with the traces of the fit; infinite where
    nothing can be predicted."""
    number = worst(problem, fit)
    only = replace(problem, conditions=problem.conditions[number : number + 1], pins=problem.pins[number : number + 1])
    now = {b.label: b.r for b in fit.blocks}

    def left(answer: Prediction | FlashtempError) -> float:
        if isinstance(answer, FlashtempError):
            return np.inf
        try:
            seen = replace(data, problem=only).residuals([answer])
        except FlashtempError:
            return np.inf
        return chi2(problem, replace(fit, system=fit.system.shown(now | seen)), number)

    return [left(answer) for answer in problem.run([only.tasks(model, Derivatives())[0] for model in models])]


def worst(problem: Problem, fit: Fit) -> int:
    """Number of the condition that a fit misfits most."""
    excess = {b.label: 0.0 if b.held_out else fit.excess[b.label] for b in fit.blocks}
    totals = [sum(excess[e.file] for e in c.entries) for c in problem.conditions]
    return int(np.argmax(totals))


def chi2(problem: Problem, fit: Fit, number: int) -> float:
    """What a fit leaves of one condition, by itself."""
    own = fit.system.total(lambda b: b.condition == number and not b.held_out)
    return fit.solved(problem, fit.effects, own).solution.chi2


def _options(s: Score) -> Iterator[dict[str, float]]:
    """Values of an effect from which a fit may begin."""
    yield inside(s)
    for variant in range(len(s.candidate.variants)):
        yield typical(replace(s, variant=variant))


def typical(s: Score) -> dict[str, float]:
    """Values of an effect at its typical strength, with the sign of its trace where that is possible."""
    params, values = s.candidate.params, dict(s.values)
    for (k, a), change in zip(s.candidate.strengths.items(), s.amplitude, strict=True):
        p, off = params[k], params[k].off or 0.0
        values[k] = off + float(np.copysign(a, change))
        if not p.low <= values[k] <= p.high:
            values[k] = off + a
    return values


def inside(s: Score) -> dict[str, float]:
    """Start values of a full fit, within bounds and not off."""
    params, values = s.candidate.params, dict(s.values)
    for k, a in s.candidate.strengths.items():
        p = params[k]
        values[k] = float(np.clip(values[k], p.low, p.high))
        if values[k] == p.off:
            values[k] = float(np.clip(p.off + 0.1 * a, p.low, p.high))
    return values
