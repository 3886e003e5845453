"""What is put right before an effect is blamed: errors of the laboratory, and keys of the case that were held."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flashtemp.discovery import adequacy
from flashtemp.discovery.calibration import Descent
from flashtemp.discovery.fit import Fit
from flashtemp.discovery.held_keys import freed, scored
from flashtemp.discovery.hypothesis import prior
from flashtemp.discovery.laboratory import FOUND, LabError, errors
from flashtemp.discovery.parameters import ParameterId
from flashtemp.discovery.rounds import Watch, descend
from flashtemp.discovery.scores import scores
from flashtemp.discovery.searched import APART, NAMED, SIMILAR, Search, held, traced

MOST_ERRORS = 3  # of the laboratory, at a time


def put_right(search: Search, watch: Watch) -> Search:
    """The same with the errors of the laboratory freed that the data want more than any effect."""
    for _ in range(MOST_ERRORS):
        found = errors(search.problem, search.best)
        ranked = scores(search.problem, search.best, search.problem.tried)
        rival = max((s.ln_bayes for s in ranked[:1]), default=0.0)
        least = max(NAMED, rival, adequacy.WORTH * search.best.misfit)
        if not found or found[0].ln_bayes <= least:
            break
        search = _loosened(search, found[0], watch)
    return search


def _loosened(search: Search, error: LabError, watch: Watch) -> Search:
    """All fits with a wide prior of one error of the laboratory, the best at its best point."""
    problem = replace(search.problem, loose=search.problem.loose | {error.parameter})
    data = replace(search.data, problem=problem)
    watch(f"fitting: {error.words}")
    fits = {}
    for names, fit in search.fits.items():
        descent = Descent(problem, data, fit.model, tuple(held(problem, fit.model)))
        again = descent.linearised(fit.system, fit.predictions).fit
        assert again is not None  # a first step never goes back
        fits[names] = again
    search = replace(search, problem=problem, data=data, fits=fits, laboratory=(*search.laboratory, error))
    search = replace(search, base=fits[frozenset()], best=fits[frozenset(search.best.model.effects)])
    if search.best.converged:
        return search
    [end] = descend(problem, [search.onward()], watch)
    if end.fit is None:
        return replace(search, failed=end.failed)
    best = traced(problem, data, end.fit, watch)
    fits = search.fits | {frozenset(best.model.effects): best}
    return replace(search, base=fits[frozenset()], best=best, fits=fits)


def doubt(search: Search, keys: tuple[str, ...], found: Fit | None, watch: Watch) -> Search:
    """With the keys that were held, by their traces; and the first of them freed, where that explains more than `found`
    does, or than any effect."""
    told = scored(search.problem, search.base, keys)
    search, best = replace(search, keys=told), told[0] if told else None
    rival = max((s.ln_bayes for s in search.ranking[0][:1]), default=0.0)
    if best is None or best.ln_bayes < max(NAMED, SIMILAR * rival):
        return search
    watch(f"fitting: what if {best.key} is not what the case says")
    problem, data = freed(search.problem, search.data, best.key)
    step = np.clip(np.log(best.value / best.told), -2.0 * prior(best.key), 2.0 * prior(best.key))
    model = replace(search.base.model, free=search.base.model.free | {best.key: float(step)})
    [end] = descend(problem, [Descent(problem, data, model)], watch)
    if end.fit is None or not end.fit.usable:
        return search
    p, gain = ParameterId.of_key(best.key), end.fit.ln_evidence - search.base.ln_evidence
    value = best.told * float(np.exp(end.fit.model.free[best.key] + end.fit.solution[p]))
    sure = replace(best, value=value, stderr=value * end.fit.solution.sd(p), ln_bayes=gain, fit=end.fit)
    if abs(value - best.told) < FOUND * sure.stderr:  # freed it comes to nothing: another point was found
        return search
    search = replace(search, keys=(sure, *told[1:]))
    effect = NAMED
    if found is not None:  # of two effects each has its price: one number is less than both
        effect = found.ln_evidence - search.base.ln_evidence - NAMED * (len(found.model.effects) - 1) + APART
    return replace(search, held_key=sure) if gain > max(NAMED, effect) else search
