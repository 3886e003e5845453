"""Identification of a law outside the catalogue: which quantity depends on which variable, and how.

Every pair of a quantity and a regressor is scored by the sensitivities of its nodes at the calibrated base.  The best
pairs are fitted in full, and nodes are added while the evidence requires them.  `decision.decide` judges from
`excess_left` whether the law predicts left-out data.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flashtemp.discovery.criteria import CRITERIA
from flashtemp.discovery.diagnostics.adequacy_tests import run_adequacy_tests
from flashtemp.discovery.diagnostics.cross_validation import heldout_excess
from flashtemp.discovery.estimation.concurrent_fits import lowest_score_within_reach, run_fits
from flashtemp.discovery.estimation.fitting import Hypothesis, ProgressCallback, fit_hypothesis
from flashtemp.discovery.estimation.hyperparameters import EvidenceMaximum, Hyperparameters, priors_at_hyperparameters
from flashtemp.discovery.estimation.image_alignment import Linearisation
from flashtemp.discovery.estimation.linear_gaussian import Array, DataBlock, LinearSystem
from flashtemp.discovery.estimation.linearised_fit import LinearisedFit
from flashtemp.discovery.estimation.whitening import WhitenedData
from flashtemp.discovery.hypotheses.candidates import CandidateEffect, find_candidates
from flashtemp.discovery.hypotheses.formula_fit import fit_simplest_formula, variable_legend
from flashtemp.discovery.hypotheses.piecewise_linear_law import LEARNED_LAW_NAME, PiecewiseLinearLaw, candidate_laws
from flashtemp.discovery.parameters import ParameterId, ParameterKind
from flashtemp.discovery.prediction.prediction import DerivativeRequest
from flashtemp.discovery.prediction.problem import Problem
from flashtemp.discovery.selection.forward_selection import (
    EffectSearch,
    finish_fit,
    refit_with_candidates,
    update_image_errors,
)
from flashtemp.discovery.selection.scores import score_candidates, select_for_rescoring
from flashtemp.discovery.verdict import LearnedLaw
from flashtemp.errors import SolverFailure

# Prior standard deviation of a law at its nodes, in units of the typical size of its quantity; evidence chooses one.
RELATIVE_WIDTHS = (0.1, 0.3, 1.0, 3.0)
# Laws simulated in one batch: each batch simulates the base again, and every node has a column of all data.  The
# smallest batch has some 30 columns and needs about as much memory as a base.
MIN_BATCH_LAWS, MAX_BATCH_BYTES = 6, 2.0e8
# Points of a reported curve, and of the mean of a pressure factor over the block (error below 1e-4): plotting only.
CURVE_POINTS, AVERAGING_POINTS = 41, 400
BAND_STANDARD_ERRORS = 1.959964  # half width of a 95 % band of a normal distribution


@dataclass(frozen=True)
class ScoredLaw:
    """The score of a law from the sensitivities of its nodes: `ln_bayes` against the base at the best `relative_width`
    of its prior, with the `values` at its nodes; `fitted_ln_bayes` is that of its full fit with all nodes that it
    requires, if there is one.

    `unresolved_gain`: ln Bayes factor that the last nodes gained, where the law would need more than MAX_LAW_NODES.
    `columns`: data blocks with these sensitivities alone, of laws that may be fitted, under the name of a verdict.
    """

    law: PiecewiseLinearLaw
    relative_width: float
    ln_bayes: float
    values: tuple[float, ...]
    fitted_ln_bayes: float | None = None
    unresolved_gain: float = 0.0
    columns: tuple[DataBlock, ...] = ()

    @property
    def prior_sd(self) -> float:
        """Prior standard deviation of the value at a node."""
        return self.relative_width * self.law.quantity.typical_size


@dataclass(frozen=True)
class FittedLaw:
    """A law with the values of its full `fit`, in a `problem` whose case has its effect file.

    `finer`: the same law with more nodes, where evidence is neither for nor against them.
    """

    scored: ScoredLaw
    problem: Problem
    fit: LinearisedFit
    finer: FittedLaw | None = None

    @property
    def law(self) -> PiecewiseLinearLaw:
        return _with_fitted_values(self.scored.law, self.fit)


@dataclass(frozen=True)
class IdentifiedLaw:
    """The law with the largest evidence: `law` with `values` at its nodes and their `covariance` (n, n).

    `search` has the law's fit as its best one; `scored` holds all laws that were compared, best first.
    """

    law: PiecewiseLinearLaw
    covariance: Array
    search: EffectSearch
    scored: tuple[ScoredLaw, ...]

    @property
    def ln_bayes(self) -> float:
        """ln Bayes factor against the calibrated base, less ln of the number of laws that were compared."""
        return self.search.best.ln_evidence - self.search.base.ln_evidence - ln_choice_odds(self.scored)

    @property
    def alternatives(self) -> dict[str, float]:
        """{law in words: ln Bayes factor} of other laws that the data do not distinguish from this one.

        Laws with a full fit are compared by their fits with the nodes that each requires, others by their scores.
        Where MAX_LAW_NODES do not resolve a curve, its error counts: about as much as the last nodes gained, because
        the error at an edge falls as the distance of nodes.
        """
        own = next(s for s in self.scored if s.law.name == self.law.name)
        out = {}
        for other in self.scored:
            ln_bayes, best = (other.ln_bayes, own.ln_bayes)
            if other.fitted_ln_bayes is not None and own.fitted_ln_bayes is not None:
                ln_bayes, best = other.fitted_ln_bayes, own.fitted_ln_bayes
            margin = max(CRITERIA.ln_bayes_distinct, own.unresolved_gain, other.unresolved_gain)
            if other is not own and ln_bayes > best - margin:
                out[other.law.description] = ln_bayes
        return out

    def to_report(self) -> LearnedLaw:
        """The curve with its 95 % band, a formula if one fits, and the alternatives."""
        law, formula = self.law, fit_simplest_formula(self.law, self.covariance)
        at = np.linspace(*law.domain, CURVE_POINTS)
        weights = law.hat_functions(at)
        curve = weights @ np.array(law.values)
        variance = np.einsum("ij,jk,ik->i", weights, self.covariance, weights)
        half_width = BAND_STANDARD_ERRORS * np.sqrt(np.maximum(variance, 0.0))
        low, high = law.quantity.lower_bound, law.quantity.upper_bound
        return LearnedLaw(
            quantity=law.quantity.name,
            argument=law.regressor.name,
            words=law.description,
            unit=law.quantity.unit,
            argument_unit=law.regressor.unit,
            formula="" if formula is None else f"{formula.name}: {formula.text}, {variable_legend(law)}",
            at=at,
            curve=law.to_display(curve),
            low=law.to_display(np.maximum(curve - half_width, low)),
            high=law.to_display(np.minimum(curve + half_width, high)),
            nodes=law.nodes,
            beside=self.alternatives,
        )


def ln_choice_odds(laws: Sequence[object]) -> float:
    """ln of the prior odds against any one of the compared laws."""
    return float(np.log(len(laws)))


def identify_law(search: EffectSearch, watch: ProgressCallback) -> IdentifiedLaw | None:
    """The law that explains more than any effect of the catalogue; None if no law does.

    The ln Bayes factor of a law against the base must reach `ln_bayes_named` and that of the best fit of the catalogue,
    plus ln of the number of compared laws.  Raises SolverFailure.
    """
    laws = [] if LEARNED_LAW_NAME in search.problem.case.effects else list(list_possible_laws(search))
    if not laws:
        return None
    watch(f"identifying a law: {len(laws)} are scored")
    scored = score_laws(search, laws)
    known = max((f.ln_evidence for f in search.fits.values() if f.is_comparable), default=search.base.ln_evidence)
    gain = known - search.base.ln_evidence
    score = search.ranking[0][0].ln_bayes if search.ranking and search.ranking[0] else 0.0
    fitted = _fit_laws(search, shortlist_laws(scored, min(gain, score)), watch)
    if not fitted:
        return None
    best = max(fitted, key=lambda f: f.fit.ln_evidence)
    least = max(CRITERIA.ln_bayes_named, gain) + ln_choice_odds(laws)
    if best.fit.ln_evidence - search.base.ln_evidence < least:
        return None
    refined = _refine_laws(search, fitted, watch)
    ends = {f.scored.law.name: f for f in refined}
    scored = tuple(_with_full_fit(s, ends.get(s.law.name), search) for s in scored)
    best = max(refined, key=lambda f: f.fit.ln_evidence)
    found = _finish_law(search, best, scored, watch)
    # the tests that decided on the nodes are weaker: their derivatives are not exact, and no data were left out
    if best.finer is not None and not _is_sound(found):
        finer = _finish_law(search, best.finer, scored, watch)
        return finer if _is_sound(finer) else found
    return found


def _is_sound(found: IdentifiedLaw) -> bool:
    """Whether the model with a law passes all tests of adequacy and predicts left-out data."""
    predicts = excess_left(found.search) <= CRITERIA.law_excess_left
    return predicts and _is_adequate(found.search.problem, found.search.best)


def _with_full_fit(scored: ScoredLaw, found: FittedLaw | None, search: EffectSearch) -> ScoredLaw:
    """A score with the result of its full fit, if there is one."""
    if found is None:
        return replace(scored, columns=())
    gain = found.fit.ln_evidence - search.base.ln_evidence
    return replace(scored, fitted_ln_bayes=gain, unresolved_gain=found.scored.unresolved_gain, columns=())


def excess_left(search: EffectSearch) -> float:
    """The fraction of the excess misfit of left-out data that remains with the best fit; 1 if the base has none."""
    before, after = heldout_excess(search.data, search.base, search.best)
    return max(after, 0.0) / before if before > 0.0 else 1.0


def list_possible_laws(search: EffectSearch) -> Iterator[PiecewiseLinearLaw]:
    """All pairs of a quantity and a regressor that varies under the fitted conditions."""
    problem, runs, scenes = search.problem, [], []
    for condition, pins, prediction in zip(
        problem.conditions, problem.mesh_overrides, search.base.predictions, strict=True
    ):
        if any(not entry.held_out for entry in condition.entries):
            runs.append(prediction.run)
            scenes.append(problem.case.with_values(condition.given | pins).scene)
    return candidate_laws(runs, scenes)


# --- scores -----------------------------------------------------------------------------------------------------
def score_laws(search: EffectSearch, laws: Sequence[PiecewiseLinearLaw]) -> tuple[ScoredLaw, ...]:
    """Score all laws by the sensitivities of their nodes at the calibrated base, best first.  Raises SolverFailure."""
    out: list[ScoredLaw] = []
    most_fitted = int(CRITERIA.shortlist)
    size = batch_size(laws, sum(b.count for b in search.base.blocks))
    for first in range(0, len(laws), size):
        batch = {law.name: law for law in laws[first : first + size]}
        problem, _, found = _with_laws(search.problem, search.data, batch)
        fit = _with_sensitivities(problem, search, tuple(found.values()))
        plain = fit.solve_with(problem, fit.free_effect_priors, fit.equations).solution.ln_evidence
        out += [_score_law(problem, fit, plain, batch[name], c) for name, c in found.items()]
        out.sort(key=lambda s: -s.ln_bayes)
        out[most_fitted:] = [replace(s, columns=()) for s in out[most_fitted:]]
    return tuple(out)


def batch_size(laws: Sequence[PiecewiseLinearLaw], data: int) -> int:
    """Number of laws in a batch for a number of data: batches of equal size within the memory limit."""
    bytes_each = max(len(law.nodes) for law in laws) * data * np.dtype(np.float32).itemsize
    most = max(MIN_BATCH_LAWS, int(MAX_BATCH_BYTES / max(bytes_each, 1)))
    return -(-len(laws) // -(-len(laws) // most))


def _score_law(
    problem: Problem, fit: LinearisedFit, plain: float, law: PiecewiseLinearLaw, c: CandidateEffect
) -> ScoredLaw:
    """Score a law at the prior width of largest evidence, with the other hyperparameters given."""
    columns = [p for p in c.strength_columns() if p in fit.system.index]
    nodes, found = _solve_within_bounds(problem, fit, law, columns, 1.0)
    width = _likeliest_width(problem, fit, law, nodes, found.hyper)
    nodes, found = _solve_within_bounds(problem, fit, law, columns, width)
    gain = found.solution.ln_evidence - plain - np.log(len(RELATIVE_WIDTHS))
    values = tuple(found.solution[p] if p in nodes else 0.0 for p in c.strength_columns())
    return ScoredLaw(law, width, float(gain), values, columns=_columns_of_law(fit.blocks, c))


def _likeliest_width(
    problem: Problem, fit: LinearisedFit, law: PiecewiseLinearLaw, nodes: Sequence[ParameterId], hyper: Hyperparameters
) -> float:
    """The relative prior width of some nodes that has the largest evidence at given hyperparameters."""
    own = fit.free_effect_priors

    def evidence_at(width: float) -> float:
        more = own | {p: (0.0, width * law.quantity.typical_size) for p in nodes}
        priors = priors_at_hyperparameters(problem, fit.system, fit.model, hyper, more)
        return fit.system.solve(priors, fit.equations).ln_evidence

    return max(RELATIVE_WIDTHS, key=evidence_at)


def _solve_within_bounds(
    problem: Problem, fit: LinearisedFit, law: PiecewiseLinearLaw, columns: Sequence[ParameterId], width: float
) -> tuple[list[ParameterId], EvidenceMaximum]:
    """The linearised fit with the nodes of a law free whose values are within bounds; the others stay neutral."""
    low, high = law.quantity.lower_bound, law.quantity.upper_bound
    nodes = list(columns)
    while True:
        priors = {p: (0.0, width * law.quantity.typical_size) for p in nodes}
        found = fit.solve_with(problem, fit.free_effect_priors | priors, fit.equations)
        outside = [p for p in nodes if not low <= found.solution[p] <= high]
        if not outside:
            return nodes, found
        nodes.remove(max(outside, key=lambda p: abs(found.solution[p])))


def shortlist_laws(scored: Sequence[ScoredLaw], known: float = 0.0) -> list[ScoredLaw]:
    """Laws that are fitted in full, best first: they are strong enough for their number, and may reach the best.

    `known`: ln Bayes factor of the best effect of the catalogue, which a law must exceed in the end.
    """
    likely = [s for s in scored if s.ln_bayes > CRITERIA.ln_bayes_named + ln_choice_odds(scored)]
    if not likely:
        return []
    lowest = lowest_score_within_reach(max(likely[0].ln_bayes, known))
    return [s for s in likely if s.ln_bayes > lowest][: int(CRITERIA.shortlist)]


# --- full fits --------------------------------------------------------------------------------------------------
def _fit_laws(search: EffectSearch, likely: Sequence[ScoredLaw], watch: ProgressCallback) -> list[FittedLaw]:
    """Fit some laws in full, together, so that a law that cannot reach the others is stopped early."""
    if not likely:
        return []
    watch(f"fitting: {'; '.join(s.law.description for s in likely)}")
    problems, fittings = {}, {}
    for s in likely:
        problem, data, candidate = _with_law(search, s)
        parent = replace(search.base, system=_borrow_columns(s.columns, search.base))
        problems[s.law.name] = problem
        fittings[s.law.name] = fit_hypothesis(Hypothesis.from_parent(problem, data, parent, [candidate]))
    fits = run_fits(search.problem, fittings, watch).fits
    return [FittedLaw(s, problems[s.law.name], fits[s.law.name]) for s in likely if s.law.name in fits]


def _refine_laws(search: EffectSearch, fitted: Sequence[FittedLaw], watch: ProgressCallback) -> list[FittedLaw]:
    """Add nodes to the best law; where it needs them, to all other fitted laws too.

    A curve that a few nodes cannot follow may be nearer to that of another quantity, so laws are comparable only with
    as many nodes as each of them requires.
    """
    best = max(fitted, key=lambda f: f.fit.ln_evidence)
    refined = _refine_nodes(search, best, watch)
    others = [f for f in fitted if f is not best]
    if refined.scored.law.nodes == best.scored.law.nodes:
        return [refined, *others]
    return [refined, *(_refine_nodes(search, f, watch) for f in others)]


def _refine_nodes(search: EffectSearch, found: FittedLaw, watch: ProgressCallback) -> FittedLaw:
    """Add nodes between the nodes of a law while the evidence requires them, or else the adequacy of the model.

    Adequacy counts where the evidence is not against the new nodes: a chord may miss the curve by less than what
    their priors cost.  A finer law is not fitted to the end once neither evidence nor adequacy can require its nodes.
    """
    while len(nodes := found.scored.law.refined_nodes) > len(found.scored.law.nodes):
        watch(f"{len(nodes)} nodes in place of {len(found.scored.law.nodes)}: {found.scored.law.description}")
        try:
            least = found.fit.ln_evidence - CRITERIA.ln_bayes_law_node  # the least with which nodes are kept
            finer = _fit_refined(search, found, nodes, watch, least)
        except SolverFailure:
            break  # the coarser law remains
        gain = finer.fit.ln_evidence - found.fit.ln_evidence
        if gain < CRITERIA.ln_bayes_law_node:
            is_neutral = gain > -CRITERIA.ln_bayes_law_node
            if not is_neutral or _is_adequate(found.problem, found.fit) or not _is_adequate(finer.problem, finer.fit):
                return replace(found, finer=finer if is_neutral else None)
        is_limited = finer.scored.law.refined_nodes == finer.scored.law.nodes
        unresolved = max(gain, 0.0) if is_limited else 0.0
        found = replace(finer, scored=replace(finer.scored, unresolved_gain=unresolved))
    return found


def _is_adequate(problem: Problem, fit: LinearisedFit) -> bool:
    """Whether a model passes all tests of adequacy."""
    return all(test.passed for test in run_adequacy_tests(problem, fit, CRITERIA))


def _fit_refined(
    search: EffectSearch, found: FittedLaw, nodes: tuple[float, ...], watch: ProgressCallback, least: float
) -> FittedLaw:
    """Fit a law with more nodes, starting at its last fit, if it can reach the ln evidence `least`.

    Raises SolverFailure.

    The finer law has the same curve at first, so the point and all other derivatives are those of the last fit.
    """
    fit, law = found.fit, found.scored.law
    coarse_values = [
        fit.model.effect_value(ParameterId.of_effect(LEARNED_LAW_NAME, f"at_{k + 1}")) for k in range(len(law.nodes))
    ]
    values = law.hat_functions(np.array(nodes)) @ np.array(coarse_values)
    scored = replace(found.scored, law=replace(law, nodes=nodes, values=tuple(values.tolist())))
    problem, data, candidate = _with_law(search, scored)
    model = fit.model.with_effect(LEARNED_LAW_NAME, dict(zip(candidate.strengths, values.tolist(), strict=True)))
    own = tuple(c for c in problem.candidates if c.effect in model.effects)
    tasks = problem.make_tasks(model, DerivativeRequest(model_parameters=tuple(candidate.strength_columns())))
    predictions = problem.predict(tasks)
    system = _borrow_columns(data.make_blocks(predictions), fit)
    first = Linearisation(model, tuple(tasks), tuple(predictions), system)
    return FittedLaw(scored, problem, finish_fit(Hypothesis(problem, data, model, own), first, watch, least))


def _finish_law(
    search: EffectSearch, found: FittedLaw, scored: tuple[ScoredLaw, ...], watch: ProgressCallback
) -> IdentifiedLaw:
    """The law with exact derivatives at its best point, and scores of the effects that may act in addition to it."""
    search = update_image_errors(search, found.fit)
    problem, data = found.problem, replace(search.data, problem=found.problem)
    before = (
        search.ranking[0]
        if search.ranking
        else score_candidates(search.problem, search.base, search.problem.candidates)
    )
    more = select_for_rescoring(search.problem, search.base, found.fit, before)
    watch(f"candidates in addition to {found.law.description}")
    best = refit_with_candidates(problem, data, found.fit, more, watch)
    law = _with_fitted_values(found.scored.law, best)
    own = tuple(law.as_effect() if o.name == LEARNED_LAW_NAME else o for o in problem.case.own)
    problem = replace(problem, case=replace(problem.case, own=own))  # its file has the fitted values
    after = replace(
        search, problem=problem, data=replace(data, problem=problem), best=best,
        fits=search.fits | {frozenset(best.model.effects): best},
        ranking=(before, score_candidates(problem, best, problem.candidates)),
    )  # fmt: skip
    return IdentifiedLaw(*_centre_pressure(law, node_covariance(best, len(law.nodes))), after, scored)


def _with_fitted_values(law: PiecewiseLinearLaw, fit: LinearisedFit) -> PiecewiseLinearLaw:
    """A law with the fitted values at its nodes, including the last linear step."""
    values = []
    for k in range(len(law.nodes)):
        p = ParameterId.of_effect(LEARNED_LAW_NAME, f"at_{k + 1}")
        values.append(fit.model.effect_value(p) + (fit.solution[p] if p in fit.solution.names else 0.0))
    return replace(law, values=tuple(map(float, values)))


def node_covariance(fit: LinearisedFit, count: int) -> Array:
    """Covariance (count, count) of the values at the nodes of a law.

    A node on a bound counts as free: the data allow values within its bound up to about that standard error.  A normal
    posterior whose mean is at or beyond the bound has at least 95 % of its part within the bound up to 1.96 of them.
    """
    out = np.zeros((count, count))
    is_bounded = any(p.effect == LEARNED_LAW_NAME for p in fit.bound)
    solution = fit.system.solve(fit.priors, fit.equations) if is_bounded else fit.solution
    at = {int(p.name.removeprefix("at_")) - 1: i for i, p in enumerate(solution.names) if p.effect == LEARNED_LAW_NAME}
    nodes, columns = list(at), list(at.values())
    out[np.ix_(nodes, nodes)] = solution.covariance[np.ix_(columns, columns)]
    return out


def _centre_pressure(law: PiecewiseLinearLaw, covariance: Array) -> tuple[PiecewiseLinearLaw, Array]:
    """A pressure law scaled to a mean factor of 1, because the load fixes the mean pressure; other laws unchanged."""
    if law.quantity.name != "pressure":
        return law, covariance
    low, high = law.domain
    step = (high - low) / AVERAGING_POINTS
    weights = law.hat_functions(low + step * (np.arange(AVERAGING_POINTS, dtype=float) + 0.5))
    factor = np.exp(weights @ np.array(law.values))
    mean_ln = factor @ weights / factor.sum()  # derivative of ln of the mean factor by every node
    centre = np.eye(len(mean_ln)) - mean_ln
    values = np.array(law.values) - np.log(factor.mean())
    return replace(law, values=tuple(map(float, values))), centre @ covariance @ centre.T


# --- problems and fits with laws --------------------------------------------------------------------------------
def _with_laws(
    problem: Problem, data: WhitenedData, laws: dict[str, PiecewiseLinearLaw]
) -> tuple[Problem, WhitenedData, dict[str, CandidateEffect]]:
    """The problem with laws as additional candidates, by the names of their effect files."""
    own = tuple(law.as_effect(name) for name, law in laws.items())
    case = replace(problem.case, own=(*(o for o in problem.case.own if o.name not in laws), *own))
    found = {c.effect: replace(c, has_heavy_tails=False) for c in find_candidates(case, tuple(laws))[0]}
    every = (*(c for c in problem.candidates if c.effect not in laws), *found.values())
    wider = replace(problem, case=case, candidates=every)
    return wider, replace(data, problem=wider), found


def _with_law(search: EffectSearch, scored: ScoredLaw) -> tuple[Problem, WhitenedData, CandidateEffect]:
    """The problem with one law under the name that a verdict uses, with the prior width of its score."""
    law = replace(scored.law, values=(scored.prior_sd,) * len(scored.law.nodes))
    problem, data, found = _with_laws(search.problem, search.data, {LEARNED_LAW_NAME: law})
    return problem, data, found[LEARNED_LAW_NAME]


def _with_sensitivities(problem: Problem, search: EffectSearch, laws: tuple[CandidateEffect, ...]) -> LinearisedFit:
    """The calibrated base with sensitivities of laws in place of those of the catalogue.  Raises SolverFailure."""
    fit, data = search.base, replace(search.data, problem=problem)
    predictions = problem.predict(problem.make_tasks(fit.model, DerivativeRequest(candidates=laws)))
    return replace(fit, system=_borrow_columns(data.make_blocks(predictions), fit))


def _borrow_columns(blocks: Sequence[DataBlock], fit: LinearisedFit) -> LinearSystem:
    """A system of some blocks with the residuals and columns of `fit`, except for effects that its model lacks."""

    def is_borrowed(p: ParameterId) -> bool:
        is_lacking = p.kind is ParameterKind.EFFECT and p.effect not in fit.model.effects
        return p.kind is not ParameterKind.INPUT and not is_lacking

    pairs = zip(blocks, fit.blocks, strict=True)
    return LinearSystem([new.with_columns_of(old, is_borrowed).with_residual(old.r) for new, old in pairs])


def _columns_of_law(blocks: Sequence[DataBlock], law: CandidateEffect) -> tuple[DataBlock, ...]:
    """Blocks with the columns of one law alone, under the name that a verdict uses."""
    names = {p: replace(p, effect=LEARNED_LAW_NAME) for p in law.strength_columns()}
    out = []
    for block in blocks:
        own = [(names[p], column) for p, column in block.names if p in names]
        columns = sorted({column for _, column in own})
        at = {column: i for i, column in enumerate(columns)}
        out.append(replace(block, C=block.C[:, columns], names=tuple((p, at[column]) for p, column in own)))
    return tuple(out)
