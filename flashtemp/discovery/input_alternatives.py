"""Stated inputs as alternatives to missing effects: a number that is stated wrongly may look like new physics.

At every step of the selection, the input that explains the misfit best is compared with the effect that was accepted
there.  It is estimated with its prior, which has heavy tails, in place of the effect.  An input that would have to be
many standard deviations off therefore loses to an effect, and an effect loses to an input that is plausibly wrong.
"""

from __future__ import annotations

from dataclasses import replace

from flashtemp.discovery.assessment import screen_inputs
from flashtemp.discovery.criteria import CRITERIA
from flashtemp.discovery.diagnostics.input_checks import InputCheck, InputVerdict, find_column, same_nuisance
from flashtemp.discovery.diagnostics.stated_inputs import StatedInput
from flashtemp.discovery.estimation.concurrent_fits import lowest_score_within_reach
from flashtemp.discovery.estimation.fitting import Hypothesis, ProgressCallback
from flashtemp.discovery.estimation.hyperparameters import maximise_evidence
from flashtemp.discovery.estimation.image_alignment import Linearisation
from flashtemp.discovery.estimation.linear_gaussian import LinearSystem
from flashtemp.discovery.estimation.linearised_fit import LinearisedFit
from flashtemp.discovery.hypotheses.heavy_tails import INPUT_TAIL, width_price
from flashtemp.discovery.parameters import ParameterId
from flashtemp.discovery.prediction.problem import Problem, check_free_key
from flashtemp.discovery.selection.forward_selection import (
    EffectSearch,
    InputAlternative,
    effect_names,
    finish_fit,
)
from flashtemp.errors import BadInput, SolverFailure


def find_input_alternatives(search: EffectSearch, watch: ProgressCallback) -> tuple[InputAlternative, ...]:
    """The best stated input in place of what was accepted at each step of a selection; empty if nothing was accepted.

    Raises BadInput, SolverFailure.
    """
    every = {s.effect for ranked in search.ranking[:1] for s in ranked}
    out = []
    for ranked in search.ranking[:-1]:
        # the ranking of a step contains all candidates but the effects of the model for which it was made
        fit = search.fits.get(frozenset(every - {s.effect for s in ranked}))
        if fit is None or effect_names(fit) == effect_names(search.best):
            continue
        watch("comparing stated inputs with the missing effect")
        assessment = screen_inputs(search, fit)
        least = max(lowest_score_within_reach(ranked[0].ln_bayes), CRITERIA.ln_bayes_hint)
        likely = [
            c for c in assessment.checks
            if c.verdict is not InputVerdict.NOT_CHECKABLE
            and c.ln_bayes > least
            and same_nuisance(fit.free_priors, c.input) is None
        ]  # fmt: skip
        if likely:
            best = max(likely, key=lambda c: c.ln_bayes)
            out.append(_fit_alternative(search, fit, best, assessment.system, watch))
    return tuple(out)


def _fit_alternative(
    search: EffectSearch, fit: LinearisedFit, check: InputCheck, system: LinearSystem, watch: ProgressCallback
) -> InputAlternative:
    """Estimate an input at a fit: in full if it can be a free key, else by the linearised model."""
    problem, keeps, i, width = search.problem, effect_names(fit), check.input, check.prior_width
    price = width_price(width, i.sd, INPUT_TAIL)
    column = find_column(system, i)
    assert column is not None  # it was checked
    more = fit.free_effect_priors | {column: (0.0, width)}
    linear = maximise_evidence(problem, system, fit.model, more).solution
    change, sd = linear[column], linear.sd(column)
    ln_evidence = linear.ln_evidence + i.ln_bound_factor(change, sd) - price
    linearised = InputAlternative(i.key, keeps, ln_evidence, width, False, *i.changed_value(change, sd))
    if not can_be_freed(problem, i):
        return linearised
    freed = free_input(problem, i.key, width)
    own = tuple(c for c in problem.candidates if c.effect in keeps)
    model = replace(fit.model, free=fit.model.free | {i.key: 0.0})
    h = Hypothesis(freed, search.data, model, own)
    try:
        tasks = freed.make_tasks(model, h.all_derivatives())
        predictions = freed.predict(tasks)
        blocks = search.data.make_blocks(predictions)
        found = finish_fit(h, Linearisation(model, tuple(tasks), tuple(predictions), LinearSystem(blocks)), watch)
    except SolverFailure:  # a value far off may not be computable; the linearised model says how good it would be
        return linearised
    freed_key = ParameterId.of_key(i.key)
    change = found.model.free[i.key] + found.solution[freed_key]
    needed = i.changed_value(change, found.solution.sd(freed_key))
    return InputAlternative(i.key, keeps, found.secured_evidence - price, width, True, *needed)


def can_be_freed(problem: Problem, i: StatedInput) -> bool:
    """Whether an input can be estimated as a free key: one positive number of the case, the same in all conditions."""
    table, _, name = i.key.rpartition(".")
    value = problem.case.values.get(table, {}).get(name)
    is_stated_elsewhere = any(i.key in c.given for c in problem.conditions)
    if is_stated_elsewhere or not i.relative or not isinstance(value, (int, float)) or value <= 0.0:
        return False
    try:
        check_free_key(problem.campaign, problem.case, i.key)
    except BadInput:
        return False
    return True


def free_input(problem: Problem, key: str, prior_sd: float) -> Problem:
    """The problem with a stated input among the free keys, with the prior of the input."""
    campaign = problem.campaign
    return replace(
        problem,
        campaign=replace(campaign, free=(*campaign.free, key), priors=campaign.priors | {key: prior_sd}),
        freed_inputs=(*problem.freed_inputs, key),
    )
