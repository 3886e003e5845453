"""The fit of a hypothesis to a campaign: Gauss-Newton steps in a trust region, with linear unknowns in closed form.

The objective is half of chi2 of data and priors, with all linear unknowns at their optimum and all images aligned
(variable projection); the hyperparameters are those of the present point.  Only parameters of the physics are stepped:
free keys, parameters of effects and sizes of the block.  `fit_hypothesis` fits every hypothesis; it starts at the best
point of the fit that it extends, with the new effects neutral, and ends with a `FitStatus` within a budget of
simulations.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from flashtemp.discovery.estimation.hyperparameters import Hyperparameters, maximise_evidence, priors_at_hyperparameters
from flashtemp.discovery.estimation.image_alignment import (
    Linearisation,
    align_images,
    move_images,
    predict_image_steps,
    profile_objective,
    step_beyond_fields,
    step_scales,
)
from flashtemp.discovery.estimation.linear_gaussian import LinearSystem
from flashtemp.discovery.estimation.linearised_fit import FitStatus, LinearisedFit
from flashtemp.discovery.estimation.trust_region import GOOD_RATIO, POOR_RATIO, QuadraticModel, TrustRegion
from flashtemp.discovery.estimation.whitening import WhitenedData
from flashtemp.discovery.hypotheses.candidates import CandidateEffect, ModelPoint, parameter_spec
from flashtemp.discovery.hypotheses.heavy_tails import (
    MAX_WIDTH_SWEEPS,
    STRENGTH_TAIL,
    WIDE_PRIOR,
    WIDTH_TOLERANCE,
    local_width,
    width_price,
)
from flashtemp.discovery.parameters import ParameterId, ParameterKind, Priors
from flashtemp.discovery.prediction.prediction import DerivativeRequest, Prediction, PredictionTask
from flashtemp.discovery.prediction.problem import Problem
from flashtemp.errors import FlashtempError, SolverFailure

MAX_FIT_EVALUATIONS = 10  # simulations of the campaign in one fit
NEGLIGIBLE_STEP_GAIN = 1.0  # predicted gain of ln evidence, below which a step is not simulated any more
NUMERICAL_NOISE_GAIN = 4.0  # ln evidence: another sequence of time steps changes it by 2 (rtol 1e-4), either way
MAX_POOR_STEPS = 3  # poor steps in a row, each a quarter of the last one: the predicted gain is not real

ProgressCallback = Callable[[str], Any]
Answers = Sequence[Prediction | FlashtempError]


@dataclass(frozen=True)
class SimulationRequest:
    """The simulations that a fit needs next, and its best point so far."""

    tasks: list[PredictionTask]
    best: LinearisedFit | None


FitGenerator = Generator[SimulationRequest, Answers, LinearisedFit]


@dataclass(frozen=True)
class Hypothesis:
    """What is fitted: a `model` as the starting point and the `effects` whose parameters are estimated.

    `parent`: the fit that it extends.  Its derivatives are used until they predict badly, so that only those of new
    effects are computed.  `keeps_candidates`: derivatives of effects that are not in the model are kept too.
    """

    problem: Problem
    data: WhitenedData
    model: ModelPoint
    effects: tuple[CandidateEffect, ...] = ()
    parent: LinearisedFit | None = None
    keeps_candidates: bool = False

    @classmethod
    def from_parent(
        cls, problem: Problem, data: WhitenedData, parent: LinearisedFit, effects: Sequence[CandidateEffect]
    ) -> Hypothesis:
        """The parent's model with more effects, which start neutral; the parent's system has their derivatives."""
        model, own = parent.model, [c for c in problem.candidates if c.effect in parent.model.effects]
        for c in effects:
            model = model.with_effect(c.effect, c.neutral_values())
        return cls(problem, data, model, (*own, *effects), parent)

    @property
    def effect_priors(self) -> Priors:
        return {p: v for c in self.effects for p, v in c.parameter_priors().items()}

    @property
    def heavy_tailed_strengths(self) -> dict[ParameterId, float]:
        """Typical strengths of the effects whose priors have heavy tails."""
        heavy = (c for c in self.effects if c.has_heavy_tails)
        return {c.strength_column(k): abs(a) for c in heavy for k, a in c.strengths.items()}

    def stepped_parameters(self, system: LinearSystem) -> tuple[ParameterId, ...]:
        """The parameters that Gauss-Newton steps: those of the physics that have columns in a system."""
        sizes = [p for p in system.names if p.kind is ParameterKind.SIZE]
        return tuple(p for p in (*self.problem.free_keys, *self.effect_priors, *sizes) if p in system.index)

    def can_borrow(self, p: ParameterId) -> bool:
        """Whether a derivative of another fit may be used: not for effects outside this model, nor for fixed keys."""
        if self.keeps_candidates:
            return True
        if p.kind is ParameterKind.EFFECT:
            return p in self.effect_priors
        return p.kind is not ParameterKind.INPUT and (p.kind is not ParameterKind.KEY or p in self.problem.free_keys)

    def all_derivatives(self) -> DerivativeRequest:
        own = (*self.problem.free_keys, *self.effect_priors)
        return DerivativeRequest(model_parameters=own, optics=True, block_sizes=True, fields=True)

    def new_derivatives(self) -> DerivativeRequest:
        """Only the derivatives that the parent lacks; all of them if there is no parent."""
        if self.parent is None:
            return self.all_derivatives()
        own = tuple(p for p in self.effect_priors if p.effect not in self.parent.model.effects)
        return DerivativeRequest(model_parameters=own, fields=True)


@dataclass(frozen=True)
class LinearisedPoint:
    """A linearised point with its hyperparameters; `is_exact`: all derivatives were computed at this point."""

    linearisation: Linearisation
    hyper: Hyperparameters
    is_exact: bool


@dataclass
class _FitState:
    """The mutable state of one fit; only `fit_hypothesis` and its helpers change it.

    `region` and `image_region`: trust regions of the physics and of image placements.  `count`: simulations so far.
    `history`: predicted gain at each point.
    """

    point: LinearisedPoint
    region: TrustRegion
    image_region: TrustRegion = field(default_factory=TrustRegion)
    count: int = 0
    history: list[float] = field(default_factory=list)
    needs_derivatives: bool = False  # whether derivatives are computed anew at the next point
    poor_steps: int = 0  # steps in a row that gained little of the prediction, or nothing


def fit_hypothesis(h: Hypothesis, first: Linearisation | None = None) -> FitGenerator:
    """Fit a hypothesis, starting at its model; `first`: the linearisation there, if it exists already.

    A generator: it yields the simulations that it needs, receives their answers, and returns the fit.  `run_fits` can
    therefore simulate the requests of several fits in one batch.  Raises SolverFailure if the first point cannot be
    simulated.
    """
    state = yield from _first_point(h, first)
    while True:
        local = _quadratic_model(h, state.point)
        model, promise = local.quadratic, local.promise
        state.history.append(promise)
        best = _as_fit(h, state.point, promise, state.count, state.history)
        if promise < NEGLIGIBLE_STEP_GAIN or max(state.history[-2:]) < NUMERICAL_NOISE_GAIN and len(state.history) > 1:
            if state.count < MAX_FIT_EVALUATIONS and (yield from _follow_images(h, state, best)):
                continue
            return replace(best, status=FitStatus.CONVERGED)
        if state.count >= MAX_FIT_EVALUATIONS:
            return replace(best, status=FitStatus.BUDGET)
        scale = _step_scales(h, state.point, local.widths)
        step = state.region.limited_step(model, scale)
        ratio = yield from _try_step(h, state, step, model.predicted_reduction(step), best)
        state.region = state.region.next_region(ratio, step, scale)
        if state.poor_steps >= MAX_POOR_STEPS:
            return replace(best, status=FitStatus.STALLED)
        if ratio > 0.0:
            continue
        if promise < NUMERICAL_NOISE_GAIN:  # the remaining gain is below the numerical noise
            return replace(best, status=FitStatus.CONVERGED)
        if not state.point.is_exact:  # derivatives of another point may have caused the failure, not the step length
            answer = yield from _evaluate_model(h, state.point.linearisation.model, h.all_derivatives(), best)
            state.count += 1
            if not isinstance(answer, str):
                state.point, state.region = _start_point(h, answer, True), TrustRegion()


def _first_point(h: Hypothesis, first: Linearisation | None) -> Generator[SimulationRequest, Answers, _FitState]:
    """The starting point: that of the parent with new effects neutral, or the hypothesis' own model."""
    if first is not None:
        return _FitState(_start_point(h, first, True), TrustRegion())
    if h.parent is not None:
        system = h.parent.system
        at = Linearisation(h.model, (), h.parent.predictions, system)
        # the new effects are still neutral, but errors of the camera that stood for them may be needed no more
        return _FitState(LinearisedPoint(at, _find_hyperparameters(h, at), True), TrustRegion(), needs_derivatives=True)
    answer = yield from _evaluate_model(h, h.model, h.all_derivatives(), None)
    if isinstance(answer, str):
        raise SolverFailure(answer)
    return _FitState(_start_point(h, answer, True), TrustRegion(), count=1)


def _try_step(
    h: Hypothesis, state: _FitState, step: np.ndarray, predicted: float, best: LinearisedFit
) -> Generator[SimulationRequest, Answers, float]:
    """Simulate a step and return the ratio of actual to predicted reduction; a step that gains is accepted.

    Derivatives of the last point are used at the next one while they predict well ("simplified Newton", Deuflhard,
    Newton Methods for Nonlinear Problems, 2011, section 2.1.2).
    """
    point, exact = state.point, state.needs_derivatives and h.parent is None
    steps = dict(zip(h.stepped_parameters(point.linearisation.system), step.tolist(), strict=True))
    wanted = h.new_derivatives() if state.needs_derivatives else DerivativeRequest(fields=True)
    answer = yield from _evaluate_model(h, _take_step(h, point, steps), wanted, best)
    state.count += 1
    if isinstance(answer, str):
        return -1.0
    answer = _align_images(h, answer, point.hyper)
    before, after = (_full_objective(h, at, point.hyper) for at in (point.linearisation, answer))
    ratio = (before - after) / max(predicted, 1e-300)  # eq. (45)
    state.needs_derivatives = not GOOD_RATIO <= ratio <= 1.0 / GOOD_RATIO
    state.poor_steps = 0 if ratio > POOR_RATIO else state.poor_steps + 1
    if ratio > 0.0:
        state.point = LinearisedPoint(answer, _find_hyperparameters(h, answer), exact)
    return ratio


def _follow_images(h: Hypothesis, state: _FitState, best: LinearisedFit) -> Generator[SimulationRequest, Answers, bool]:
    """Align images further than the stored fields allow, at the best physics; return whether that gained anything.

    The predicted gain of the physics counts fitted data only, so it does not include images of held-out data.
    """
    at, hyper = state.point.linearisation, state.point.hyper
    fixed = frozenset(h.stepped_parameters(at.system))
    possible_gain, predicted, steps = step_beyond_fields(h.problem, at, hyper, fixed, state.image_region)
    if possible_gain < NUMERICAL_NOISE_GAIN:
        return False
    answer = yield from _evaluate_model(h, move_images(at.model, steps), DerivativeRequest(fields=True), best)
    state.count += 1
    if isinstance(answer, str):
        return False
    answer = _align_images(h, answer, hyper)
    before, after = (profile_objective(h.problem, a, hyper, fixed, with_heldout=True) for a in (at, answer))
    size = np.array(list(steps.values()))
    state.image_region = state.image_region.next_region((before - after) / predicted, size, step_scales(steps))
    if before - after < NEGLIGIBLE_STEP_GAIN:
        return False
    state.point = LinearisedPoint(answer, _find_hyperparameters(h, answer), False)
    return True


def _start_point(h: Hypothesis, at: Linearisation, exact: bool) -> LinearisedPoint:
    """A linearised point with images aligned and hyperparameters estimated."""
    hyper = _find_hyperparameters(h, at)
    if all(p.full_run is not None for p in at.predictions):
        at = _align_images(h, at, hyper)
        hyper = _find_hyperparameters(h, at)
    return LinearisedPoint(at.without_fields(), hyper, exact)


def _align_images(h: Hypothesis, at: Linearisation, hyper: Hyperparameters) -> Linearisation:
    fixed = frozenset(h.stepped_parameters(at.system))
    return align_images(h.problem, h.data, at, hyper, fixed, h.model).without_fields()


def _evaluate_model(
    h: Hypothesis, model: ModelPoint, wanted: DerivativeRequest, best: LinearisedFit | None
) -> Generator[SimulationRequest, Answers, Linearisation | str]:
    """Simulate and linearise a model; return the linearisation, or the reason of a failure as text.

    Derivatives that are not `wanted` anew are taken from the best point so far or from the parent.
    """
    tasks = h.problem.make_tasks(model, wanted)
    answers = yield SimulationRequest(tasks, best)
    predictions = []
    for answer in answers:
        if isinstance(answer, FlashtempError):
            return str(answer)
        predictions.append(answer)
    try:
        blocks = h.data.make_blocks(predictions)
    except FlashtempError as fault:
        return str(fault)
    lender = best if best is not None else h.parent
    if lender is not None:
        blocks = [b.with_columns_of(o, h.can_borrow) for b, o in zip(blocks, lender.blocks, strict=True)]
    return Linearisation(model, tuple(tasks), tuple(predictions), LinearSystem(blocks))


def _find_hyperparameters(h: Hypothesis, at: Linearisation) -> Hyperparameters:
    outer = _outer_priors(h, at.system, at.model)
    return maximise_evidence(h.problem, at.system, at.model, outer).hyper


def _outer_priors(h: Hypothesis, system: LinearSystem, model: ModelPoint) -> Priors:
    """Priors of the effect parameters, relative to a point, with the local widths there."""
    there = {p: v for c in h.effects for p, v in c.parameter_priors(model.effects[c.effect]).items()}
    return {p: (mean - model.effect_value(p), sd) for p, (mean, sd) in there.items() if p in system.index}


def _width_price(h: Hypothesis, priors: Priors) -> float:
    """What ln evidence loses because priors of effect parameters are wider than the typical ones."""
    return sum(width_price(priors[p][1], a, STRENGTH_TAIL) for p, a in h.heavy_tailed_strengths.items() if p in priors)


def _full_objective(h: Hypothesis, at: Linearisation, hyper: Hyperparameters) -> float:
    """Half of chi2 of data and priors at a point, with all linear unknowns at their optimum."""
    outer = h.stepped_parameters(at.system)
    priors = _all_priors(h, at.system, at.model, hyper)
    pulls = sum((priors[p][0] / priors[p][1]) ** 2 for p in outer)
    # the prior itself: the normal distributions that touch it, with their norms, differ from point to point
    prior = 0.5 * pulls + (1.0 + 1.0 / STRENGTH_TAIL) * _width_price(h, priors)
    return profile_objective(h.problem, at, hyper, frozenset(outer)) + prior


def _all_priors(h: Hypothesis, system: LinearSystem, model: ModelPoint, hyper: Hyperparameters) -> Priors:
    return priors_at_hyperparameters(h.problem, system, model, hyper, _outer_priors(h, system, model))


@dataclass(frozen=True)
class _LocalModel:
    """The objective to second order about a point, for priors of local `widths` (k,) at its best step.

    `promise`: gain of the objective by that step; less than the quadratic model predicts, because widths at the point
    itself are smaller.
    """

    quadratic: QuadraticModel
    widths: np.ndarray
    promise: float


def _quadratic_model(h: Hypothesis, point: LinearisedPoint) -> _LocalModel:
    """The objective to second order in the stepped parameters, with nuisances projected out.

    A prior with heavy tails can have two optima, near its centre and near the estimate from the data alone: both are
    sought, and the better one is taken.
    """
    system, model = point.linearisation.system, point.linearisation.model
    outer, priors = h.stepped_parameters(system), _all_priors(h, system, model, point.hyper)
    nuisance = {p: v for p, v in priors.items() if p not in outer}
    projection = system.project_out(nuisance, list(outer), system.normal_equations(variances=point.hyper.variances))
    limits = [_step_limits(h, p, model) for p in outer]
    low, high = (np.array([limit[i] for limit in limits]) for i in (0, 1))
    mean, here = (np.array([priors[p][i] for p in outer]) for i in (0, 1))
    strengths = h.heavy_tailed_strengths

    def settle_widths(widths: np.ndarray) -> _LocalModel:
        for _ in range(MAX_WIDTH_SWEEPS):
            # the stepped parameters have priors too: they add to the marginalised information of eq. (42)
            S, g = projection.information + np.diag(widths**-2.0), projection.score + mean * widths**-2.0
            quadratic = QuadraticModel(g, S, low, high)
            step = quadratic.best_step()
            reached = zip(outer, step - mean, widths, strict=True)
            local = np.array([local_width(strengths.get(p, w), a if p in strengths else 0.0, STRENGTH_TAIL)
                              for p, a, w in reached])  # fmt: skip
            if np.all(np.abs(np.log(local / widths)) < np.log(WIDTH_TOLERANCE)):
                break
            widths = local
        excess = (1.0 + STRENGTH_TAIL) * np.log(widths / here) - 0.5 * mean**2 * (here**-2.0 - widths**-2.0)
        return _LocalModel(quadratic, widths, quadratic.predicted_reduction(step) - float(np.sum(excess)))

    wide = np.array([WIDE_PRIOR if p in strengths else 1.0 for p in outer])
    ways = [settle_widths(here), *([settle_widths(wide * here)] if strengths else [])]
    return max(ways, key=lambda way: way.promise)


def _step_scales(h: Hypothesis, point: LinearisedPoint, widths: np.ndarray) -> np.ndarray:
    """Scales (k,) of the stepped parameters: prior widths, or for a strength its distance from its neutral value."""
    outer, model = h.stepped_parameters(point.linearisation.system), point.linearisation.model
    return np.array([max(w, abs(_distance_from_off(h, p, model))) for p, w in zip(outer, widths, strict=True)])


def _distance_from_off(h: Hypothesis, p: ParameterId, model: ModelPoint) -> float:
    """Distance of a strength from its neutral value; a strength with a wide range may be stepped by that much."""
    if p.kind is not ParameterKind.EFFECT:
        return 0.0
    off = h.problem.case.known_effects[p.effect].params()[p.name].off
    return 0.0 if off is None else model.effect_value(p) - off


def _step_limits(h: Hypothesis, p: ParameterId, model: ModelPoint) -> tuple[float, float]:
    """The largest steps down and up that keep a parameter within its bounds."""
    if p.kind is ParameterKind.EFFECT:
        param, value = h.problem.case.known_effects[p.effect].params()[p.name], model.effect_value(p)
        low = param.low + (1e-3 * abs(param.value) if param.open_low else 0.0)
        return min(low - value, 0.0), max(param.high - value, 0.0)
    if p.kind is ParameterKind.KEY:
        param, case = parameter_spec(h.problem.case, p.name), h.problem.case
        # a free key is the ln of a factor on its value, so its bounds are logarithms of ratios
        now = case[p.name] * np.exp(model.free.get(p.name, 0.0))
        low = np.log(param.low / now) if param.low > 0.0 else -np.inf
        return min(low, 0.0), max(float(np.log(param.high / now)), 0.0)
    return -0.2 - model.setup_value(p), 0.2 - model.setup_value(p)


def _take_step(h: Hypothesis, point: LinearisedPoint, steps: Mapping[ParameterId, float]) -> ModelPoint:
    """The model after a step of the physics, with images moved as the linearised model predicts."""
    at = point.linearisation
    own = {p: v for p, v in _all_priors(h, at.system, at.model, point.hyper).items() if p not in steps}
    model = move_images(at.model, predict_image_steps(h.problem, at.system, own, steps, point.hyper))
    for p, step in steps.items():
        model = model.with_step(p, step)
        if p.kind is ParameterKind.EFFECT:  # rounding must not move it across a bound
            low, high = _step_limits(h, p, model)
            model = model.with_step(p, float(np.clip(0.0, low, high)))
    return model


def _as_fit(h: Hypothesis, point: LinearisedPoint, promise: float, count: int, history: list[float]) -> LinearisedFit:
    """The fit at a point: its solution includes the last linear step, except for parameters on a bound.

    Parameters that the step would push out of their bounds are fixed one at a time, the worst first.
    """
    system, model = point.linearisation.system, point.linearisation.model
    outer, bound = _outer_priors(h, system, model), frozenset[ParameterId]()
    while True:
        more = {p: v for p, v in outer.items() if p not in bound}
        found = maximise_evidence(h.problem, system, model, more, variances=point.hyper.variances)
        outside = [p for p in more if _is_pushed_out(h, p, model, found.solution[p])]
        if not outside:
            break
        bound |= {max(outside, key=lambda p: abs(found.solution[p]) / more[p][1])}
    price = _width_price(h, more)
    solution = replace(found.solution, ln_evidence=found.solution.ln_evidence - price)
    return LinearisedFit(
        model, point.linearisation.predictions, system, solution, found.priors, found.hyper, FitStatus.BUDGET,
        bound, promise, count, tuple(history), price,
    )  # fmt: skip


def _is_pushed_out(h: Hypothesis, p: ParameterId, model: ModelPoint, step: float) -> bool:
    """Whether a step would push a parameter that is on its bound beyond it."""
    low, high = _step_limits(h, p, model)
    return (step < 0.0 and low > -1e-12 * (1.0 + abs(model.effect_value(p)))) or (
        step > 0.0 and high < 1e-12 * (1.0 + abs(model.effect_value(p)))
    )
