"""Where nothing in the catalogue explains the data: which quantity, as a function of what, would; learned and judged.

Every pair is scored by the traces of its nodes, the best are fitted in full, and one is learned only where it leaves
nothing over and predicts data that it did not see.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from flashtemp.discovery import assessment
from flashtemp.discovery.calibration import Descent
from flashtemp.discovery.fit import Fit
from flashtemp.discovery.hypotheses.formula_fit import fit_simplest_formula, variable_legend
from flashtemp.discovery.hypotheses.piecewise_linear_law import EFFECT_NAME, PiecewiseLinearLaw, candidate_laws
from flashtemp.discovery.hypothesis import Candidate, candidates
from flashtemp.discovery.linear_gaussian import NormalEquations
from flashtemp.discovery.parameters import ParameterId
from flashtemp.discovery.prediction import Derivatives
from flashtemp.discovery.problem import Problem
from flashtemp.discovery.rounds import Watch, descend
from flashtemp.discovery.scores import scores
from flashtemp.discovery.searched import HOPELESS, MORE, NAMED, Search, held, traced
from flashtemp.discovery.verdict import LearnedLaw
from flashtemp.discovery.whitening import Data
from flashtemp.model.case import Case
from flashtemp.physics.effect import Param

WIDTHS = (0.1, 0.3, 1.0, 3.0)  # of what is usual: how far a law may go, by evidence
TOGETHER = 6  # laws traced at a time: each holds images of all its nodes
SHORT = 2  # laws fitted in full
Array = npt.NDArray[np.float64]
NEAR = 8.0  # ln Bayes factor within which another law is told beside the best
POINTS, FINE, EDGE = 41, 400, 1.959964  # of a curve as told and as averaged; standard deviations of its band


@dataclass(frozen=True)
class Tried:
    """A law by its traces: `ln_bayes` of the best `width`, the `values` at its nodes there."""

    law: PiecewiseLinearLaw
    width: float
    ln_bayes: float
    values: tuple[float, ...]


@dataclass(frozen=True)
class Learned:
    """A law that explains the data: `law` with `values` at its nodes and their `covariance` (n, n), in a `search` of
    which it is the best; `tried` all laws by their traces, best first."""

    law: PiecewiseLinearLaw
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
        law, form = self.law, fit_simplest_formula(self.law, self.covariance)
        at = np.linspace(*law.domain, POINTS)
        w = law.hat_functions(at)
        middle = w @ np.array(law.values)
        reach = EDGE * np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", w, self.covariance, w), 0.0))
        return LearnedLaw(
            law.quantity.name, law.regressor.name, law.description, law.quantity.unit, law.regressor.unit,
            "" if form is None else f"{form.name}: {form.text}, {variable_legend(law)}", at,
            law.to_display(middle), law.to_display(np.maximum(middle - reach, law.quantity.lower_bound)),
            law.to_display(middle + reach),
            law.nodes,
            {t.law.description: t.ln_bayes for t in self.beside},
        )  # fmt: skip


Fitted = tuple[Fit, PiecewiseLinearLaw, Problem]  # a law at its best point, in a problem that has it


def learn(search: Search, watch: Watch, named: float = 0.0) -> Learned | None:
    """The law that explains what the catalogue does not, or clearly more than what was `named` (ln Bayes factor); or
    None.  Raises SolverFailure."""
    laws = _laws(search)
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
    while _leaves(replace(search, problem=problem), fit) and len(finer := law.refined_nodes) > len(law.nodes):
        values = tuple(law.hat_functions(np.array(finer)) @ np.array(law.values))
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
    at = {int(p.name.removeprefix("at_")) - 1: i for i, p in enumerate(names) if p.effect == EFFECT_NAME}
    own, where = list(at), list(at.values())
    out[np.ix_(own, own)] = assessment.INFLATED**2 * fit.solution.covariance[np.ix_(where, where)]
    return out


def _centred(law: PiecewiseLinearLaw, covariance: Array) -> tuple[PiecewiseLinearLaw, Array]:
    """A law without what says nothing: of a pressure only the shape counts, its mean is the case's."""
    if law.quantity.name != "pressure":
        return law, covariance
    low, high = law.domain
    step = (high - low) / FINE
    at: Array = low + step * (np.arange(FINE, dtype=float) + 0.5)
    weights = law.hat_functions(at)
    factor = np.exp(weights @ np.array(law.values))
    mean = factor @ weights / factor.sum()  # of the ln, by every node
    centre = np.eye(len(mean)) - mean
    values = np.array(law.values) - np.log(factor.mean())
    return replace(law, values=tuple(map(float, values))), centre @ covariance @ centre.T


def _written(search: Search, law: PiecewiseLinearLaw) -> Search:
    """The search with the law's file as it was found: its values are the defaults."""
    case = search.problem.case
    own = tuple(law.as_effect() if o.name == EFFECT_NAME else o for o in case.own)
    return replace(search, problem=replace(search.problem, case=replace(case, own=own)))


# --- what may be a law ----------------------------------------------------------------------------------------
def _laws(search: Search) -> list[PiecewiseLinearLaw]:
    """All pairs of a quantity and a regressor that varies among the conditions that are fitted."""
    fitted = [any(not e.held_out for e in c.entries) for c in search.problem.conditions]
    runs = [p.run for p, is_so in zip(search.base.predictions, fitted, strict=True) if is_so]
    scenes = [c.scene for c, is_so in zip(_cases(search.problem), fitted, strict=True) if is_so]
    return list(candidate_laws(runs, scenes))


def _cases(problem: Problem) -> list[Case]:
    """The case under every condition, as it is believed."""
    return [problem.case.with_values(c.given | pins) for c, pins in zip(problem.conditions, problem.pins, strict=True)]


# --- how much each would explain --------------------------------------------------------------------------------
def _with(
    problem: Problem, data: Data, laws: dict[str, PiecewiseLinearLaw]
) -> tuple[Problem, Data, dict[str, Candidate]]:
    """The problem with effects of these names to be tried besides."""
    own = tuple(law.as_effect(name) for name, law in laws.items())
    names = {o.name for o in own}
    kept = tuple(o for o in problem.case.own if o.name not in names)
    case = replace(problem.case, own=(*kept, *own))
    made = {c.effect: c for c in candidates(case, tuple(laws))[0]}
    tried = (*(c for c in problem.tried if c.effect not in names), *made.values())
    wider = replace(problem, case=case, tried=tried)
    return wider, replace(data, problem=wider), made


def _scored(search: Search, laws: list[PiecewiseLinearLaw]) -> list[Tried]:
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
    problem: Problem,
    fit: Fit,
    equations: NormalEquations,
    law: PiecewiseLinearLaw,
    c: Candidate,
    width: float,
    plain: float,
) -> Tried:
    """A law whose values are known to `width` of what is usual."""
    priors = {p: (0.0, width * law.quantity.typical_size) for p in c.columns() if p in fit.system.index}
    solution = fit.solved(problem, priors, equations).solution
    values = tuple(solution[p] if p in priors else 0.0 for p in c.columns())
    return Tried(law, width, solution.ln_evidence - plain - float(np.log(len(WIDTHS))), values)


# --- in full ----------------------------------------------------------------------------------------------------
def _fitted(search: Search, likely: list[Tried], watch: Watch) -> list[Fitted]:
    """Laws at their best points, side by side, so that what falls far behind goes no further."""
    watch(f"fitting: {'; '.join(t.law.description for t in likely)}")
    descents = [_begun(search, t) for t in likely]
    out = []
    for t, end in zip(likely, descend(search.problem, descents, watch, HOPELESS), strict=True):
        if end.fit is not None and end.fit.usable and not end.failed:
            out.append((end.fit, _at_its_end(t.law, end.fit), end.problem))
    return out


def _begun(search: Search, tried: Tried) -> Descent:
    """The way of a law to its best point, from where its traces put it."""
    law = replace(tried.law, values=(tried.width * tried.law.quantity.typical_size,) * len(tried.law.nodes))
    problem, data, made = _with(search.problem, search.data, {EFFECT_NAME: law})
    c = made[EFFECT_NAME]
    start = {k: _inside(c.params[k], v) for k, v in zip(c.strengths, tried.values, strict=True)}
    model = search.base.model.with_effect(EFFECT_NAME, c.off() | start)
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
    fits = search.fits | {frozenset(): base, frozenset({EFFECT_NAME}): best}
    after = replace(search, problem=problem, data=data, base=base, best=best, fits=fits, ranking=ranking)
    return replace(after, asked={}, ended={})


def _inside(param: Param, value: float) -> float:
    return float(np.clip(value, param.low, param.high))


def _at_its_end(law: PiecewiseLinearLaw, fit: Fit) -> PiecewiseLinearLaw:
    """A law with the values that a fit gives its nodes."""
    return replace(law, values=tuple(_value(fit, f"at_{k + 1}") for k in range(len(law.nodes))))


def _value(fit: Fit, k: str) -> float:
    """A node's value, last step included."""
    p = ParameterId.of_effect(EFFECT_NAME, k)
    return float(fit.model.value(p) + (fit.solution[p] if p in fit.solution.names else 0.0))
