"""The fit of a hypothesis to a campaign: Gauss-Newton in a trust region for physics, all else in closed form.

The objective is half of chi2 of data and priors with all linear unknowns at their optimum and all images where the
data want them; hyperparameters are those of the present point.  Parameters of the physics alone are stepped: free
keys, parameters of effects, sizes of the block.  Every hypothesis is fitted by this one function, from the point of the
fit that it extends and from typical strengths, and ends with a `Status`, within a budget of simulations.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from flashtemp.discovery.estimation.hyperparameters import Hyperparameters, at_hyperparameters, estimate
from flashtemp.discovery.estimation.image_alignment import (
    Linearisation,
    align_images,
    image_steps,
    moved_images,
    objective,
    step_beyond_fields,
    step_scale,
)
from flashtemp.discovery.estimation.linear_gaussian import System
from flashtemp.discovery.estimation.linearised_fit import Fit, Status
from flashtemp.discovery.estimation.trust_region import GOOD_RATIO, POOR_RATIO, Quadratic, TrustRegion
from flashtemp.discovery.estimation.whitening import Data
from flashtemp.discovery.hypotheses.candidates import Candidate, Model, parameter_spec
from flashtemp.discovery.parameters import Kind, ParameterId, Priors
from flashtemp.discovery.prediction.prediction import Derivatives, Prediction, Task
from flashtemp.discovery.prediction.problem import Problem
from flashtemp.errors import FlashtempError, SolverFailure

MAX_EVALUATIONS = 10  # simulations of the campaign in one fit
NEGLIGIBLE_GAIN = 1.0  # ln evidence that a step promises, below which it is taken by the linearised model alone
NOISE_GAIN = 4.0  # ln evidence: another sequence of time steps changes it by 2 (rtol 1e-4), either way
MAX_POOR = 3  # poor steps in a row, each a quarter of the last one: what is promised is not there
OUTRUN_GAIN = 30.0  # ln evidence behind another hypothesis, promises included, from which a fit goes no further
PROMISE_KEPT = 2.0  # times what a linearised model promises: what a curved one may still gain

Watch = Callable[[str], Any]
Answers = Sequence[Prediction | FlashtempError]


@dataclass(frozen=True)
class Request:
    """What a fit wants simulated next, and the best that it has so far."""

    tasks: list[Task]
    best: Fit | None


Fitting = Generator[Request, Answers, Fit]


@dataclass(frozen=True)
class Hypothesis:
    """What is fitted: a `model` to begin at and the `effects` of it that move.

    `parent`: the fit that it extends.  Its derivatives serve until they prove too poor, so that only those of new
    effects are computed.  `keeps_candidates`: derivatives of effects that it lacks are carried along too.
    """

    problem: Problem
    data: Data
    model: Model
    effects: tuple[Candidate, ...] = ()
    parent: Fit | None = None
    keeps_candidates: bool = False

    @classmethod
    def extending(cls, problem: Problem, data: Data, parent: Fit, effects: Sequence[Candidate]) -> Hypothesis:
        """A fit with more effects, all of them off at first; their derivatives there belong to the parent's system."""
        model, own = parent.model, [c for c in problem.candidates if c.effect in parent.model.effects]
        for c in effects:
            model = model.with_effect(c.effect, c.off())
        return cls(problem, data, model, (*own, *effects), parent)

    @property
    def effect_priors(self) -> Priors:
        return {p: v for c in self.effects for p, v in c.priors().items()}

    def outer(self, system: System) -> tuple[ParameterId, ...]:
        """Parameters of the physics that a system has columns for."""
        sizes = [p for p in system.names if p.kind is Kind.SIZE]
        return tuple(p for p in (*self.problem.free, *self.effect_priors, *sizes) if p in system.index)

    def borrows(self, p: ParameterId) -> bool:
        """Whether a derivative of another fit is of use: not of effects that this one lacks, nor of fixed keys."""
        if self.keeps_candidates:
            return True
        if p.kind is Kind.EFFECT:
            return p in self.effect_priors
        return p.kind is not Kind.INPUT and (p.kind is not Kind.KEY or p in self.problem.free)

    def all_derivatives(self) -> Derivatives:
        own = (*self.problem.free, *self.effect_priors)
        return Derivatives(own=own, optics=True, laboratory=True, fields=True)

    def new_derivatives(self) -> Derivatives:
        """Those alone that the parent lacks; all where there is none."""
        if self.parent is None:
            return self.all_derivatives()
        own = tuple(p for p in self.effect_priors if p.effect not in self.parent.model.effects)
        return Derivatives(own=own, fields=True)


@dataclass(frozen=True)
class Point:
    """A linearised point of a fit with its hyperparameters; `exact`: all derivatives are of this point."""

    at: Linearisation
    hyper: Hyperparameters
    exact: bool


@dataclass
class _Progress:
    """Where a fit stands: changed by `fit_hypothesis` alone."""

    point: Point
    region: TrustRegion
    image_region: TrustRegion = field(default_factory=TrustRegion)
    count: int = 0
    history: list[float] = field(default_factory=list)
    refresh: bool = False  # whether the next point takes derivatives of its own
    poor: int = 0  # steps in a row that gained little of what was promised, or nothing


def fit_hypothesis(h: Hypothesis, first: Linearisation | None = None) -> Fitting:
    """The best point of a hypothesis, from its model; `first`: linearised there already.

    Raises SolverFailure where not even the first point can be simulated.
    """
    state = yield from _first_point(h, first)
    while True:
        model, scale = _quadratic(h, state.point)
        promise = model.reduction(model.best_step())
        state.history.append(promise)
        best = _as_fit(h, state.point, promise, state.count, state.history)
        if promise < NEGLIGIBLE_GAIN or max(state.history[-2:]) < NOISE_GAIN and len(state.history) > 1:
            if state.count < MAX_EVALUATIONS and (yield from _follow_images(h, state, best)):
                continue
            return replace(best, status=Status.CONVERGED)
        if state.count >= MAX_EVALUATIONS:
            return replace(best, status=Status.BUDGET)
        step = state.region.step(model, scale)
        ratio = yield from _try_step(h, state, step, model.reduction(step), best)
        state.region = state.region.after(ratio, step, scale)
        if state.poor >= MAX_POOR:
            return replace(best, status=Status.STALLED)
        if ratio > 0.0:
            continue
        if promise < NOISE_GAIN:  # what is left to gain is within the noise of numerics
            return replace(best, status=Status.CONVERGED)
        if not state.point.exact:  # derivatives of another point may be to blame, not the length of the step
            answer = yield from _evaluate(h, state.point.at.model, h.all_derivatives(), best)
            state.count += 1
            if not isinstance(answer, str):
                state.point, state.region = _begun(h, answer, True), TrustRegion()


def _first_point(h: Hypothesis, first: Linearisation | None) -> Generator[Request, Answers, _Progress]:
    """Where a fit begins: at the point of the parent with new effects off, or at a point of its own."""
    if first is not None:
        return _Progress(_begun(h, first, True), TrustRegion())
    if h.parent is not None:
        system = h.parent.system
        at = Linearisation(h.model, (), h.parent.predictions, system)
        # new effects count for nothing yet, so that the noise is the parent's
        return _Progress(Point(at, h.parent.hyper, True), TrustRegion(), refresh=True)
    answer = yield from _evaluate(h, h.model, h.all_derivatives(), None)
    if isinstance(answer, str):
        raise SolverFailure(answer)
    return _Progress(_begun(h, answer, True), TrustRegion(), count=1)


def _try_step(
    h: Hypothesis, state: _Progress, step: np.ndarray, predicted: float, best: Fit
) -> Generator[Request, Answers, float]:
    """Ratio of actual to predicted reduction by a step; where it gained anything, the fit stands there now.

    Derivatives of the last point serve the next one too while they predict well ("simplified Newton", Deuflhard,
    Newton Methods for Nonlinear Problems, 2011, section 2.1.2).
    """
    point, exact = state.point, state.refresh and h.parent is None
    steps = dict(zip(h.outer(point.at.system), step.tolist(), strict=True))
    wanted = h.new_derivatives() if state.refresh else Derivatives(fields=True)
    answer = yield from _evaluate(h, _stepped(h, point, steps), wanted, best)
    state.count += 1
    if isinstance(answer, str):
        return -1.0
    answer = _aligned(h, answer, point.hyper)
    before, after = (_objective(h, at, point.hyper) for at in (point.at, answer))
    ratio = (before - after) / max(predicted, 1e-300)
    state.refresh = not GOOD_RATIO <= ratio <= 1.0 / GOOD_RATIO
    state.poor = 0 if ratio > POOR_RATIO else state.poor + 1
    if ratio > 0.0:
        state.point = Point(answer, _hyperparameters(h, answer), exact)
    return ratio


def _follow_images(h: Hypothesis, state: _Progress, best: Fit) -> Generator[Request, Answers, bool]:
    """Whether images gain by fields of other times, the physics being at its best point; the fit stands there now.

    The promise of the physics counts data that are fitted: it says nothing of images of data that are held out.
    """
    at, hyper = state.point.at, state.point.hyper
    fixed = frozenset(h.outer(at.system))
    left, predicted, steps = step_beyond_fields(h.problem, at, hyper, fixed, state.image_region)
    if left < NOISE_GAIN:
        return False
    answer = yield from _evaluate(h, moved_images(at.model, steps), Derivatives(fields=True), best)
    state.count += 1
    if isinstance(answer, str):
        return False
    answer = _aligned(h, answer, hyper)
    before, after = (objective(h.problem, a, hyper, fixed, every=True) for a in (at, answer))
    size = np.array(list(steps.values()))
    state.image_region = state.image_region.after((before - after) / predicted, size, step_scale(steps))
    if before - after < NEGLIGIBLE_GAIN:
        return False
    state.point = Point(answer, _hyperparameters(h, answer), False)
    return True


def _begun(h: Hypothesis, at: Linearisation, exact: bool) -> Point:
    """A point with images aligned and hyperparameters found."""
    hyper = _hyperparameters(h, at)
    if all(p.full is not None for p in at.predictions):
        at = _aligned(h, at, hyper)
        hyper = _hyperparameters(h, at)
    return Point(at.bare(), hyper, exact)


def _aligned(h: Hypothesis, at: Linearisation, hyper: Hyperparameters) -> Linearisation:
    found = align_images(h.problem, h.data, at, hyper, frozenset(h.outer(at.system)))
    return found.bare()


def _evaluate(
    h: Hypothesis, model: Model, wanted: Derivatives, best: Fit | None
) -> Generator[Request, Answers, Linearisation | str]:
    """A linearised point, with derivatives that are not asked for lent by the best point or the parent; or why not."""
    tasks = h.problem.tasks(model, wanted)
    answers = yield Request(tasks, best)
    made = []
    for answer in answers:
        if isinstance(answer, FlashtempError):
            return str(answer)
        made.append(answer)
    try:
        blocks = h.data.blocks(made)
    except FlashtempError as fault:
        return str(fault)
    lender = best if best is not None else h.parent
    if lender is not None:
        blocks = [b.joined(o, h.borrows) for b, o in zip(blocks, lender.blocks, strict=True)]
    return Linearisation(model, tuple(tasks), tuple(made), System(blocks))


def _hyperparameters(h: Hypothesis, at: Linearisation) -> Hyperparameters:
    outer = _outer_priors(h, at.system, at.model)
    return estimate(h.problem, at.system, at.model, outer).hyper


def _outer_priors(h: Hypothesis, system: System, model: Model) -> Priors:
    """Priors of the parameters of effects, as seen from a point."""
    return {p: (mean - model.value(p), sd) for p, (mean, sd) in h.effect_priors.items() if p in system.index}


def _objective(h: Hypothesis, at: Linearisation, hyper: Hyperparameters) -> float:
    """Half of chi2 of data and priors at a point, all linear unknowns at their optimum."""
    outer = h.outer(at.system)
    priors = _all_priors(h, at.system, at.model, hyper)
    pulls = sum((priors[p][0] / priors[p][1]) ** 2 for p in outer)
    return objective(h.problem, at, hyper, frozenset(outer)) + 0.5 * pulls


def _all_priors(h: Hypothesis, system: System, model: Model, hyper: Hyperparameters) -> Priors:
    return at_hyperparameters(h.problem, system, model, hyper, _outer_priors(h, system, model))


def _quadratic(h: Hypothesis, point: Point) -> tuple[Quadratic, np.ndarray]:
    """The objective to second order in the parameters of the physics, and the scale of each of them."""
    system, model = point.at.system, point.at.model
    outer, priors = h.outer(system), _all_priors(h, system, model, point.hyper)
    nuisance = {p: v for p, v in priors.items() if p not in outer}
    found = system.projected(nuisance, list(outer), system.total(variances=point.hyper.variances))
    mean, sd = (np.array([priors[p][i] for p in outer]) for i in (0, 1))
    S = found.information + np.diag(sd**-2.0)
    g = found.score + mean * sd**-2.0
    limits = [_limits(h, p, model) for p in outer]
    low, high = (np.array([limit[i] for limit in limits]) for i in (0, 1))
    scale = np.array([max(s, abs(_strength(h, p, model))) for p, s in zip(outer, sd.tolist(), strict=True)])
    return Quadratic(g, S, low, high), scale


def _strength(h: Hypothesis, p: ParameterId, model: Model) -> float:
    """How far a strength is from off: one of a wide range moves by factors."""
    if p.kind is not Kind.EFFECT:
        return 0.0
    off = h.problem.case.known[p.effect].params()[p.name].off
    return 0.0 if off is None else model.value(p) - off


def _limits(h: Hypothesis, p: ParameterId, model: Model) -> tuple[float, float]:
    """How far a parameter may step down and up within its bounds."""
    if p.kind is Kind.EFFECT:
        param, value = h.problem.case.known[p.effect].params()[p.name], model.value(p)
        low = param.low + (1e-3 * abs(param.value) if param.open_low else 0.0)
        return min(low - value, 0.0), max(param.high - value, 0.0)
    if p.kind is Kind.KEY:
        param, case = parameter_spec(h.problem.case, p.name), h.problem.case
        now = case[p.name] * np.exp(model.free.get(p.name, 0.0))
        low = np.log(param.low / now) if param.low > 0.0 else -np.inf
        return min(low, 0.0), max(float(np.log(param.high / now)), 0.0)
    return -0.2 - model.placed(p), 0.2 - model.placed(p)


def _stepped(h: Hypothesis, point: Point, steps: Mapping[ParameterId, float]) -> Model:
    """The model after a step of the physics; images go where the linearised model wants them then."""
    at = point.at
    own = {p: v for p, v in _all_priors(h, at.system, at.model, point.hyper).items() if p not in steps}
    model = moved_images(at.model, image_steps(h.problem, at.system, own, steps, point.hyper))
    for p, step in steps.items():
        model = model.moved(p, step)
        if p.kind is Kind.EFFECT:  # rounding must not carry it across a bound
            low, high = _limits(h, p, model)
            model = model.moved(p, float(np.clip(0.0, low, high)))
    return model


def _as_fit(h: Hypothesis, point: Point, promise: float, count: int, history: list[float]) -> Fit:
    """The fit at a point: the solution includes the last linear step, but of what lies on a bound."""
    system, model = point.at.system, point.at.model
    outer, bound = _outer_priors(h, system, model), frozenset[ParameterId]()
    while True:
        more = {p: v for p, v in outer.items() if p not in bound}
        found = estimate(h.problem, system, model, more, variances=point.hyper.variances)
        outside = [p for p in more if _leaves(h, p, model, found.solution[p])]
        if not outside:
            break
        bound |= {max(outside, key=lambda p: abs(found.solution[p]) / more[p][1])}
    return Fit(
        model, point.at.predictions, system, found.solution, found.priors, found.hyper, Status.BUDGET, bound, promise,
        count, tuple(history),
    )  # fmt: skip


def _leaves(h: Hypothesis, p: ParameterId, model: Model, step: float) -> bool:
    """Whether a parameter on its bound would be pushed beyond."""
    low, high = _limits(h, p, model)
    return (step < 0.0 and low > -1e-12 * (1.0 + abs(model.value(p)))) or (
        step > 0.0 and high < 1e-12 * (1.0 + abs(model.value(p)))
    )


# --- several at once ----------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Outcome:
    """How fits of several hypotheses ended: `fits` of those that could be simulated, and why others `failed`."""

    fits: dict[Any, Fit] = field(default_factory=dict)
    failed: dict[Any, str] = field(default_factory=dict)


def run_fits(problem: Problem, fittings: Mapping[Any, Fitting], watch: Watch = lambda text: None) -> Outcome:
    """All fits to their ends, their simulations shared among the workers; one that others outrun goes no further."""
    live: dict[Any, tuple[Fitting, Request]] = {}
    fits: dict[Any, Fit] = {}
    failed: dict[Any, str] = {}

    def advance(key: Any, fitting: Fitting, answers: Answers | None) -> None:
        try:
            request = next(fitting) if answers is None else fitting.send(answers)
            live[key] = fitting, request
        except StopIteration as end:
            fits[key] = end.value
        except FlashtempError as fault:
            failed[key] = str(fault)

    for key, fitting in fittings.items():
        advance(key, fitting, None)
    rounds = 0
    while live:
        best = max((f.ln_evidence for f in fits.values()), default=-np.inf)
        for key, (fitting, request) in list(live.items()):
            if request.best is not None and _is_outrun(request.best, best):
                fitting.close()
                fits[key] = replace(request.best, status=Status.OUTRUN)
                del live[key]
        asked = list(live.items())
        live.clear()
        answers = iter(problem.run([t for _, (_, request) in asked for t in request.tasks]))
        for key, (fitting, request) in asked:
            advance(key, fitting, [next(answers) for _ in request.tasks])
        rounds += 1
        if live:
            watch(f"  evaluation {rounds}")
    return Outcome(fits, failed)


def _is_outrun(fit: Fit, best: float) -> bool:
    """Whether a fit cannot reach another one, if it gains twice what its linearised model promises."""
    return fit.ln_evidence + (PROMISE_KEPT - 1.0) * fit.promise < best - OUTRUN_GAIN
