"""What a model misses: calibrate, score every candidate, refit the best and extend, as long as evidence asks for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from flashtemp.discovery import adequacy
from flashtemp.discovery.calibration import Descent
from flashtemp.discovery.fit import Fit
from flashtemp.discovery.held_keys import freed, holdable
from flashtemp.discovery.parameters import ParameterId
from flashtemp.discovery.problem import Problem
from flashtemp.discovery.put_right import doubt, put_right
from flashtemp.discovery.rounds import Watch, advance, descend
from flashtemp.discovery.scores import SEEN, Score, likely, pairs, scores
from flashtemp.discovery.searched import (
    HOPELESS,
    IDLE,
    NAMED,
    SIMILAR,
    WEAK,
    Calibrated,
    Ranking,
    Search,
    held,
    traced,
)  # fmt: skip
from flashtemp.discovery.starts import by_runs, dragged, inside, typical

MOST = 2  # causes; where a third is asked for, it is rather one that the catalogue lacks
SHORT = 3  # candidates refitted
NEAR = 20.0  # ln Bayes factor behind the best, up to which one is refitted too: traces bend by as much
TOGETHER = 6  # pairs tried at a time: each holds its images


def explore(calibrated: Calibrated, watch: Watch = lambda text: None) -> Search:
    """Put the laboratory right, then add the best candidate, or pair, as long as the evidence asks for it; bring the
    best to its certificate."""
    problem, data, keys = calibrated.problem, calibrated.data, holdable(calibrated.problem)
    base = traced(problem, data, calibrated.base, watch, tuple(map(ParameterId.of_key, keys)))
    search = Search(problem, data, calibrated.refused, base, base, {frozenset(): base}, mirrored=calibrated.mirrored)
    search = put_right(search, watch)
    for depth in range(MOST):
        stiff = replace(search.problem, stiff=dragged(search.best))
        ranked = scores(stiff, search.best, problem.tried)
        search = _refit(replace(search, ranking=(*search.ranking, ranked)), ranked, depth, watch)
        found = _worth_it(search, depth)
        if not depth:
            search = doubt(search, keys, found, watch)
            if search.held_key is not None:
                return _once_more(search, calibrated, watch)
        if found is None:
            return put_right(_sure(search, watch), watch)
        more = likely(search.problem, search.best, found, ranked)
        best = traced(search.problem, search.data, found, watch, among=more)
        search = replace(search, best=best, fits=search.fits | {frozenset(found.model.effects): best})
        if len(found.model.effects) >= MOST:
            break
    last = scores(search.problem, search.best, problem.tried)
    return put_right(_sure(replace(search, ranking=(*search.ranking, last)), watch), watch)


def _once_more(search: Search, calibrated: Calibrated, watch: Watch) -> Search:
    """The search again, with the key freed that was held wrongly."""
    key = search.held_key
    assert key is not None
    assert key.fit is not None
    problem, data = freed(search.problem, search.data, key.key)
    begun = replace(calibrated, problem=problem, data=data, base=key.fit)
    again = explore(begun, watch)
    return replace(again, held_key=key, laboratory=(*search.laboratory, *again.laboratory))


def _sure(search: Search, watch: Watch) -> Search:
    """The best model at its certificate, unless it misfits whatever that would be."""
    return search if adequacy.beyond_doubt(search.best) else settled(search, watch)


def settled(search: Search, watch: Watch) -> Search:
    """The best model at its certificate, where a base that misfits was left rough or new traces point elsewhere."""
    if search.best.converged:
        return search
    [end] = descend(search.problem, [search.onward(rough=not search.best.hopeless)], watch, HOPELESS)
    if end.fit is None:
        return replace(search, failed=end.failed or search.failed)
    return replace(search, best=end.fit, fits=search.fits | {frozenset(end.fit.model.effects): end.fit})


def _refit(search: Search, ranked: Ranking, depth: int, watch: Watch) -> Search:
    """Full fits of the shortlist from the present best, and of pairs where no effect alone will do."""
    least = max(WEAK, adequacy.WORTH * search.best.misfit) if depth else WEAK - 2.0
    good = [s for s in ranked if s.ln_bayes > least][:SHORT]
    good = [s for s in good if s.ln_bayes > SIMILAR * good[0].ln_bayes or s.ln_bayes > good[0].ln_bayes - NEAR]
    search = _fit(search, [(s,) for s in good], watch)
    if depth:
        return search
    if not _worth_it(search, depth):
        search = _fit(search, [(s,) for s in _left_over(search, ranked)], watch)
    if len(ranked) > 1:
        search = _fit(search, _together(search, ranked), watch)
    if good and search.best.hopeless and not search.extended:
        search = _run(search, _companions(search, good[0], ranked, watch), watch)
    return _run(search, _each_alone(search), watch)


def _each_alone(search: Search) -> list[Descent]:
    """Members of the pair that would be accepted, alone from where it ended: traces that bend may have kept one that
    explains all from a full fit."""
    best = _worth_it(search, 0)
    if best is None or len(best.model.effects) < 2:
        return []
    models = [replace(best.model, effects={e: own}) for e, own in best.model.effects.items()]
    fresh = [m for m in models if frozenset(m.effects) not in search.fits]
    return [search.start(m, held(search.problem, m)) for m in fresh]


def _together(search: Search, ranked: Ranking) -> list[tuple[Score, ...]]:
    """Pairs that explain more by their traces than any full fit of one effect, and enough more than either alone."""
    alone = [f for names, f in search.fits.items() if len(names) == 1]
    best = max(alone, key=lambda f: f.ln_evidence, default=search.best)
    least = max(best.ln_evidence - search.best.ln_evidence, NAMED) + NAMED
    worth = adequacy.WORTH * best.misfit
    both = pairs(search.problem, search.best, ranked)[:2]
    return [p.scores for p in both if p.ln_bayes > least and p.more > worth]


def _left_over(search: Search, ranked: Ranking) -> list[Score]:
    """Candidates that would be named by their traces and had no full fit."""
    return [s for s in ranked if s.ln_bayes > NAMED and frozenset({s.effect}) not in search.asked][:SHORT]


def _worth_it(search: Search, depth: int) -> Fit | None:
    """The best of the fits with more effects, if it is worth its parameters."""
    extended = [f for f in search.extended if not depth or (_agrees(search, f) and _above(search, f))]
    if not extended:
        return None
    best = max(extended, key=lambda f: f.ln_evidence - NAMED * len(f.model.effects))
    gained = best.ln_evidence - search.best.ln_evidence
    return best if gained > NAMED * (len(best.model.effects) - len(search.best.model.effects)) else None


def _agrees(search: Search, fit: Fit) -> bool:
    """Whether what a further cause adds is the same in all conditions: if not, it mops up something else."""
    new = fit.model.effects.keys() - search.best.model.effects.keys()
    found = [s for e in new for s in adequacy.sizes_per_condition(search.problem, fit, e)]
    return all(f.consistent > 10.0**-adequacy.SCATTERED for f in found)


def _above(search: Search, fit: Fit) -> bool:
    """Whether a further cause is more than what a smooth error of the model, as large as one may be, explains as well:
    a fit with it may have found a point where the model errs less, and the cause be nothing."""
    before, after = (f.at_largest(search.problem, f.effects) for f in (search.best, fit))
    return after - before > NAMED


def _companions(search: Search, first: Score, ranked: Ranking, watch: Watch) -> list[Descent]:
    """The best partners of a strong effect that has no best point alone, after one step of each pair.

    Both begin at typical strength, the images where they were taken: where two effects shape each other, no
    trace of one alone shows the other, and a base that misfits shifts the images.
    """
    watch(f"fitting: {first.effect} alone has no best point; looking for a partner")
    model = replace(search.problem.start, effects={first.effect: typical(first)})
    best: list[tuple[float, Descent]] = []
    others = [s for s in ranked if s is not first and s.seen > SEEN]
    for k in range(0, len(others), TOGETHER):
        tried = [
            search.start(model.with_effect(s.effect, typical(s)), (first.candidate, s.candidate), rough=False)
            for s in others[k : k + TOGETHER]
        ]
        best += [(d.fit.ln_evidence, d) for d in advance(search.problem, tried) if d.fit is not None]
        best = sorted(best, key=lambda pair: -pair[0])[:SHORT]
    return [d for _, d in best]


def _fit(search: Search, groups: Sequence[tuple[Score, ...]], watch: Watch) -> Search:
    """With full fits of groups of candidates added to the present best, from where their traces point."""
    descents, asked, stray = [], dict(search.asked), dragged(search.best)
    for group in groups:
        names = frozenset({*search.best.model.effects, *(s.effect for s in group)})
        if names in search.fits:
            continue
        model = replace(search.problem.start, effects=search.best.model.effects) if stray else search.best.model
        for s in group:
            values = by_runs(search.problem, search.data, search.best, s) if stray else inside(s)
            model = model.with_effect(s.effect, values)
        if len(group) == 1 and not stray:
            model = replace(model, free=_moved(search.problem, model.free, group[0].free))
        start = search.start(model, [*search.own, *(s.candidate for s in group)])
        descents.append(start if stray else replace(start, parent=search.best))
        asked[names] = _gain(search, group)
    return _run(replace(search, asked=asked), descents, watch, first=stray)


def _gain(search: Search, group: tuple[Score, ...]) -> float:
    """ln Bayes factor of effects by their traces together."""
    if len(group) == 1:
        return group[0].ln_bayes
    more = {p: (0.0, abs(a)) for s in group for p, a in s.traces.items()}
    wider = search.best.solved(search.problem, search.best.effects | more).solution.ln_evidence
    return wider - search.best.solved(search.problem, search.best.effects).solution.ln_evidence


def _run(search: Search, descents: list[Descent], watch: Watch, first: bool = False) -> Search:
    """With full fits, kept where they found anything; the `first` of them may go before, and show how far one gets; if
    it ends well it lends its traces to the others, whose images lie where its images do."""
    if not descents:
        return search
    watch(f"fitting {', '.join(' with '.join(d.model.effects) for d in descents)}")
    fits, failed, ended = dict(search.fits), search.failed, dict(search.ended)
    before = descend(search.problem, descents[:1], watch) if first else []
    after = descents[len(before) :]
    for d in before:
        if d.fit is not None and d.fit.usable and not d.fit.hopeless:
            after = [replace(other, parent=d.fit) for other in after]
    for d in descend(search.problem, [*before, *after], watch, HOPELESS):
        names = frozenset(d.model.effects)
        if d.fit is None:
            failed = d.failed or failed
        elif alive(search.problem, d.fit):
            fits[names] = d.fit
        ended[names] = d.failed or ("" if names in fits else IDLE)
    return replace(search, fits=fits, failed=failed, ended=ended)


def _moved(problem: Problem, free: dict[str, float], steps: dict[str, float]) -> dict[str, float]:
    """Free keys after steps, within two standard deviations of what was known."""
    out = {}
    for p, sd in problem.priors.items():
        out[p.name] = float(np.clip(free[p.name] + steps.get(p.name, 0.0), -2.0 * sd, 2.0 * sd))
    return out


def alive(problem: Problem, fit: Fit) -> bool:
    """Whether every effect of a model still acts: none of its strengths ended at off."""
    for name, values in fit.model.effects.items():
        params = problem.case.known[name].params()
        if all(values[k] == p.off for k, p in params.items() if k in values and p.off is not None):
            return False
    return True
