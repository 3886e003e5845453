"""Where nothing in the catalogue explains the data: which quantity, as a function of what, would; learned and judged.

Every pair is scored by the traces of its nodes, the best are fitted in full, and one is learned only where it leaves
nothing over and predicts data that it did not see.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from flashtemp.discovery import assessment
from flashtemp.discovery.calibration import Descent
from flashtemp.discovery.fit import Fit
from flashtemp.discovery.formula import formula, legend
from flashtemp.discovery.hypothesis import Candidate, candidates
from flashtemp.discovery.linear_gaussian import NormalEquations
from flashtemp.discovery.parameters import ParameterId
from flashtemp.discovery.prediction import Derivatives
from flashtemp.discovery.problem import Problem
from flashtemp.discovery.rounds import Watch, descend
from flashtemp.discovery.scores import scores
from flashtemp.discovery.searched import HOPELESS, MORE, NAMED, Search, held, traced
from flashtemp.discovery.unknown_law import ARGUMENTS, NAME, UNKNOWNS, Argument, Law, Unknown, given, spread
from flashtemp.discovery.verdict import LearnedLaw
from flashtemp.discovery.whitening import Data
from flashtemp.model.case import Case
from flashtemp.physics.effect import Param

WIDTHS = (0.1, 0.3, 1.0, 3.0)  # of what is usual: how far a law may go, by evidence
TOGETHER = 6  # laws traced at a time: each holds images of all its nodes
SHORT = 2  # laws fitted in full
Array = npt.NDArray[np.float64]
NEAR = 8.0  # ln Bayes factor within which another law is told beside the best
VARIES = 0.05  # of an argument, below which nothing depends on it
RISE = 2.0  # K of temperature that counts as variation
POINTS, FINE, EDGE = 41, 400, 1.959964  # of a curve as told and as averaged; standard deviations of its band


@dataclass(frozen=True)
class Tried:
    """A law by its traces: `ln_bayes` of the best `width`, the `values` at its nodes there."""

    law: Law
    width: float
    ln_bayes: float
    values: tuple[float, ...]


@dataclass(frozen=True)
class Learned:
    """A law that explains the data: `law` with `values` at its nodes and their `covariance` (n, n), in a `search` of
    which it is the best; `tried` all laws by their traces, best first."""

    law: Law
    covariance: Array
    search: Search
    tried: tuple[Tried, ...]

    @property
    def beside(self) -> tuple[Tried, ...]:
        """Other laws whose traces speak for them nearly as much."""
        best = self.tried[0].ln_bayes
        return tuple(t for t in self.tried if t.law.name != self.law.name and t.ln_bayes > best - NEAR)

    @property
    def told(self) -> LearnedLaw:
        """The same for people."""
        law, form = self.law, formula(self.law, self.covariance)
        at = np.linspace(law.nodes[0], law.nodes[-1], POINTS)
        w = law.weights(at)
        middle = w @ np.array(law.values)
        reach = EDGE * np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", w, self.covariance, w), 0.0))
        return LearnedLaw(
            law.unknown.name, law.argument.name, law.words, law.unknown.unit, law.argument.unit,
            "" if form is None else f"{form.name}: {form.words}, {legend(law)}", at,
            law.shown(middle), law.shown(np.maximum(middle - reach, law.unknown.least)), law.shown(middle + reach),
            law.nodes,
            {t.law.words: t.ln_bayes for t in self.beside},
        )  # fmt: skip


Fitted = tuple[Fit, Law, Problem]  # a law at its best point, in a problem that has it


def learn(search: Search, watch: Watch, named: float = 0.0) -> Learned | None:
    """The law that explains what the catalogue does not, or clearly more than what was `named` (ln Bayes factor); or
    None.  Raises SolverFailure."""
    laws = list(_laws(search))
    if not laws:
        return None
    watch(f"looking for a law that nobody wrote down: {len(laws)} are tried")
    tried: list[Tried] = []
    for k in range(0, len(laws), TOGETHER):
        tried += _scored(search, laws[k : k + TOGETHER])
    tried.sort(key=lambda t: -t.ln_bayes)
    price = np.log(len(laws))
    likely = [t for t in tried if t.ln_bayes > named + NAMED + price][:SHORT]
    if not likely:
        return None
    found = _fitted(search, likely, watch)
    fit, law, problem = max(found, key=lambda f: f[0].ln_evidence, default=(search.base, None, search.problem))
    known = search.best.ln_evidence - search.base.ln_evidence
    least = max([named + NAMED + price, known, *search.unsettled.values()])  # no less than effects, ended or not
    if law is None or fit.ln_evidence - search.base.ln_evidence < least:
        return None
    fit, law, problem = _closer(search, (fit, law, problem), next(t for t in likely if t.law.name == law.name), watch)
    search, problem = _usual(search, problem, fit)
    after = _ended(search, problem, fit, watch)
    if not after.best.converged:
        return None
    law = _at_its_end(law, after.best)
    return Learned(*_centred(law, _covariance(after.best, len(law.nodes))), _written(after, law), tuple(tried))


def _closer(search: Search, found: Fitted, tried: Tried, watch: Watch) -> Fitted:
    """A law with nodes between its nodes, as long as it leaves something over and evidence asks for them."""
    fit, law, problem = found
    while _leaves(replace(search, problem=problem), fit) and len(finer := law.finer) > len(law.nodes):
        values = tuple(law.weights(np.array(finer)) @ np.array(law.values))
        wider = replace(law, nodes=finer, values=values)
        again = _fitted(search, [replace(tried, law=wider, values=values)], watch)
        if not again or again[0][0].ln_evidence < fit.ln_evidence + MORE:
            break
        fit, law, problem = again[0]
    return fit, law, problem


def _usual(search: Search, problem: Problem, fit: Fit) -> tuple[Search, Problem]:
    """Without the errors of the laboratory that the data wanted only as long as the law of a fit was missing."""
    kept = []
    for error in search.laboratory:
        usual = replace(problem, loose=problem.loose - {error.parameter})
        with_it, without = (fit.solved(p, fit.effects).solution.ln_evidence for p in (problem, usual))
        if with_it - without > NAMED:
            kept.append(error)
        else:
            problem = usual
    return replace(search, laboratory=tuple(kept)), problem


def _leaves(search: Search, fit: Fit) -> bool:
    """Whether a fit leaves something over that has no name."""
    return any(value > limit for value, limit in assessment.gates(search, fit).values())


def _covariance(fit: Fit, count: int) -> Array:
    """Of the values at the nodes of a law (count, count); 0 of one that lies on a bound."""
    out, names = np.zeros((count, count)), fit.solution.names
    at = {int(p.name.removeprefix("at_")) - 1: i for i, p in enumerate(names) if p.effect == NAME}
    own, where = list(at), list(at.values())
    out[np.ix_(own, own)] = assessment.INFLATED**2 * fit.solution.covariance[np.ix_(where, where)]
    return out


def _centred(law: Law, covariance: Array) -> tuple[Law, Array]:
    """A law without what says nothing: of a pressure only the shape counts, its mean is the case's."""
    if law.unknown.name != "pressure":
        return law, covariance
    step = (law.nodes[-1] - law.nodes[0]) / FINE
    at: Array = law.nodes[0] + step * (np.arange(FINE, dtype=float) + 0.5)
    weights = law.weights(at)
    factor = np.exp(weights @ np.array(law.values))
    mean = factor @ weights / factor.sum()  # of the ln, by every node
    centre = np.eye(len(mean)) - mean
    values = np.array(law.values) - np.log(factor.mean())
    return replace(law, values=tuple(map(float, values))), centre @ covariance @ centre.T


def _written(search: Search, law: Law) -> Search:
    """The search with the law's file as it was found: its values are the defaults."""
    case = search.problem.case
    own = tuple(law.own() if o.name == NAME else o for o in case.own)
    return replace(search, problem=replace(search.problem, case=replace(case, own=own)))


# --- what may be a law ----------------------------------------------------------------------------------------
def _laws(search: Search) -> Iterator[Law]:
    """All pairs of a quantity and an argument that varies in the campaign."""
    for unknown in UNKNOWNS:
        for name in unknown.arguments:
            nodes = _nodes(search, unknown, ARGUMENTS[name])
            if len(nodes) > 1:
                yield Law(unknown, ARGUMENTS[name], nodes, (unknown.size,) * len(nodes))


def _nodes(search: Search, unknown: Unknown, argument: Argument) -> tuple[float, ...]:
    """Where a law over an argument has its nodes; none where it does not vary among conditions that are fitted."""
    fitted = [any(not e.held_out for e in c.entries) for c in search.problem.conditions]
    runs = [p.run for p, is_so in zip(search.base.predictions, fitted, strict=True) if is_so]
    scenes = [c.scene for c, is_so in zip(_cases(search.problem), fitted, strict=True) if is_so]
    if argument.name == "temperature":
        return _ranged([r.T_spot for r in runs], RISE)
    if argument.name == "inside":
        of = "T_block" if unknown.name == "rubber" else "T_road"
        return _ranged([getattr(r, of) for r in runs], RISE)
    if argument.name == "pressure":
        seen = [r.pressure[r.sliding] for r in runs]
        if max(float(np.ptp(s)) for s in seen) < VARIES * max(float(s.max()) for s in seen):
            return _if_varied(given(float(s.mean()) for s in seen))
        return _ranged(seen, VARIES * max(float(s.max()) for s in seen))
    if argument.name == "speed":
        ends = [s.speeds for s in scenes]
        waits = any(s.schedule.wait > 0 and s.schedule.repetitions > 1 for s in scenes)
        rest = [0.0] if unknown.how == "film" and waits else []  # walls cool then too
        steady = all(high - low <= VARIES * high for low, high in ends)
        if steady:
            return _if_varied(given([*rest, *(high for _, high in ends)]))
        return _ranged([np.array([*rest, *(v for e in ends for v in e)])], 0.0)
    if argument.name == "repetition":
        most = max(s.schedule.repetitions for s in scenes)
        return given(range(1, most + 1)) if most > 1 else ()
    if argument.name == "place":
        return spread(0.0, max(s.length for s in scenes))
    schedules = [s.schedule for s in scenes]
    if argument.name == "passed":  # in a single repetition that is the distance slid
        whole = [s.distance * s.repetitions for s in schedules if s.repetitions > 1]
        return spread(0.0, max(whole), begins=True) if whole else ()
    return spread(0.0, max(s.distance if argument.name == "slid" else s.end for s in schedules), begins=True)


def _cases(problem: Problem) -> list[Case]:
    """The case under every condition, as it is believed."""
    return [problem.case.with_values(c.given | pins) for c, pins in zip(problem.conditions, problem.pins, strict=True)]


def _ranged(seen: list[np.ndarray], least: float) -> tuple[float, ...]:
    low, high = (float(f([f(s[np.isfinite(s)]) for s in seen])) for f in (np.min, np.max))
    return spread(low, high) if high - low > least else ()


def _if_varied(nodes: tuple[float, ...]) -> tuple[float, ...]:
    return nodes if nodes[-1] - nodes[0] > VARIES * nodes[-1] else ()


# --- how much each would explain --------------------------------------------------------------------------------
def _with(problem: Problem, data: Data, laws: dict[str, Law]) -> tuple[Problem, Data, dict[str, Candidate]]:
    """The problem with effects of these names to be tried besides."""
    own = tuple(law.own(name) for name, law in laws.items())
    names = {o.name for o in own}
    kept = tuple(o for o in problem.case.own if o.name not in names)
    case = replace(problem.case, own=(*kept, *own))
    made = {c.effect: c for c in candidates(case, tuple(laws))[0]}
    tried = (*(c for c in problem.tried if c.effect not in names), *made.values())
    wider = replace(problem, case=case, tried=tried)
    return wider, replace(data, problem=wider), made


def _scored(search: Search, laws: list[Law]) -> list[Tried]:
    """Some laws by the traces of their nodes, beside the calibrated base."""
    problem, data, made = _with(search.problem, search.data, {law.name: law for law in laws})
    asked = Derivatives(candidates=tuple(made.values()))
    descent = Descent(problem, data, search.base.model, (), asked, parent=search.base)
    fit = descent.take(problem.predictions(descent.tasks())).fit
    assert fit is not None
    equations = fit.system.total()
    plain = fit.solved(problem, {}, equations).solution.ln_evidence
    out = []
    for law in laws:
        if (c := made.get(law.name)) is not None:
            out.append(max((_at(problem, fit, equations, law, c, w, plain) for w in WIDTHS), key=lambda t: t.ln_bayes))
    return out


def _at(
    problem: Problem, fit: Fit, equations: NormalEquations, law: Law, c: Candidate, width: float, plain: float
) -> Tried:
    """A law whose values are known to `width` of what is usual."""
    priors = {p: (0.0, width * law.unknown.size) for p in c.columns() if p in fit.system.index}
    solution = fit.solved(problem, priors, equations).solution
    values = tuple(solution[p] if p in priors else 0.0 for p in c.columns())
    return Tried(law, width, solution.ln_evidence - plain - float(np.log(len(WIDTHS))), values)


# --- in full ----------------------------------------------------------------------------------------------------
def _fitted(search: Search, likely: list[Tried], watch: Watch) -> list[Fitted]:
    """Laws at their best points, side by side, so that what falls far behind goes no further."""
    watch(f"fitting: {'; '.join(t.law.words for t in likely)}")
    descents = [_begun(search, t) for t in likely]
    out = []
    for t, end in zip(likely, descend(search.problem, descents, watch, HOPELESS), strict=True):
        if end.fit is not None and end.fit.usable and not end.failed:
            out.append((end.fit, _at_its_end(t.law, end.fit), end.problem))
    return out


def _begun(search: Search, tried: Tried) -> Descent:
    """The way of a law to its best point, from where its traces put it."""
    law = replace(tried.law, values=(tried.width * tried.law.unknown.size,) * len(tried.law.nodes))
    problem, data, made = _with(search.problem, search.data, {NAME: law})
    c = made[NAME]
    start = {k: _inside(c.params[k], v) for k, v in zip(c.strengths, tried.values, strict=True)}
    model = search.base.model.with_effect(NAME, c.off() | start)
    return Descent(problem, data, model, (c,), rough=False, parent=search.base)


def _ended(search: Search, problem: Problem, fit: Fit, watch: Watch) -> Search:
    """The search that ends with a law at its certificate, and all candidates scored before and after it.

    The law stands on traces of its own: beside many others traces are as good, but not the same, and a law that
    explains thousands sees it.
    """
    data = replace(search.data, problem=problem)
    [end] = descend(problem, [Descent(problem, data, fit.model, tuple(held(problem, fit.model)), rough=False)], watch)
    best = end.fit or fit
    base, beside = (traced(problem, data, f, watch) for f in (search.base, best))
    ranking = tuple(scores(problem, f, problem.tried) for f in (base, beside))
    fits = search.fits | {frozenset(): base, frozenset({NAME}): best}
    after = replace(search, problem=problem, data=data, base=base, best=best, fits=fits, ranking=ranking)
    return replace(after, asked={}, ended={})


def _inside(param: Param, value: float) -> float:
    return float(np.clip(value, param.low, param.high))


def _at_its_end(law: Law, fit: Fit) -> Law:
    """A law with the values that a fit gives its nodes."""
    return replace(law, values=tuple(_value(fit, f"at_{k + 1}") for k in range(len(law.nodes))))


def _value(fit: Fit, k: str) -> float:
    """A node's value, last step included."""
    p = ParameterId.of_effect(NAME, k)
    return float(fit.model.value(p) + (fit.solution[p] if p in fit.solution.names else 0.0))
