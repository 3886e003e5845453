"""The fit of a model's parameters to a campaign: Gauss-Newton with a certificate that the next step is negligible."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from flashtemp.discovery.floor import MIDDLE, SIZES
from flashtemp.discovery.hypothesis import Candidate, Model
from flashtemp.discovery.linear_gaussian import Block, NormalEquations, Solution, System
from flashtemp.discovery.nuisances import nuisances
from flashtemp.discovery.parameters import SHIFTS, Kind, ParameterId, Priors
from flashtemp.discovery.prediction import Derivatives, Prediction, Task
from flashtemp.discovery.problem import Problem
from flashtemp.discovery.whitening import Data
from flashtemp.errors import FlashtempError

ENOUGH = 0.01  # largest last step over its prior standard deviation
SHIFTED = 0.2  # of it counts for the place of an image: 0.05 of what is known of it moves no pixel's value
TRIES = 12
LONGEST = 1.5  # step, in prior standard deviations
HALVINGS, WORSE, TIGHT = 3, 2.0, 1e-6  # steps back, the loss that asks for one, and what stands still
MISFIT, LOOSE, FEW = 20.0, 0.2, 6  # standard errors of chi2, and the step and tries that then are enough
SCALES = (0.3, 1.0, 3.0, 10.0, 30.0)  # of deviations of unknown shape: chosen under each hypothesis
FAR = "far behind the best"  # why a descent went no further

Watch = Callable[[str], Any]


@dataclass(frozen=True)
class Scaled:
    """The best solution over the scales of deviations of unknown shape, its priors and that scale."""

    solution: Solution
    priors: Priors
    scale: float
    floor: float = MIDDLE


def solved(
    problem: Problem, system: System, model: Model, more: Priors, equations: NormalEquations | None = None
) -> Scaled:
    """Nuisances as seen from a point, and `more`, estimated at the scale and the floor of largest evidence."""
    equations = equations or system.total()

    def at(scale: float, floor: float) -> Scaled:
        priors = nuisances(problem, system.names, model, scale, floor) | more
        return Scaled(system.solve(priors, equations), priors, scale, floor)

    best = max((at(scale, SIZES[-1]) for scale in SCALES), key=_evident)
    return max((best, *(at(best.scale, floor) for floor in SIZES[:-1])), key=_evident)


def _evident(found: Scaled) -> float:
    return found.solution.ln_evidence


@dataclass(frozen=True)
class Fit:
    """A model at its best point: `solution` of its last linearisation, and the `history` of steps over prior
    standard deviations, of which the last is the one it would still take.

    `priors` as seen from the point, `scale` of deviations of unknown shape; `bound` parameters that lie on a bound.
    """

    model: Model
    predictions: tuple[Prediction, ...]
    system: System
    solution: Solution
    priors: Priors
    scale: float
    history: tuple[float, ...]
    bound: frozenset[ParameterId] = frozenset()

    @property
    def blocks(self) -> list[Block]:
        return self.system.blocks

    @property
    def converged(self) -> bool:
        """Whether the certificate holds."""
        return self.history[-1] < ENOUGH

    @property
    def usable(self) -> bool:
        """Whether it is near enough to its best point to be compared and extended."""
        return self.history[-1] < LOOSE

    @property
    def hopeless(self) -> bool:
        """Whether the model misfits so grossly that its best point says little."""
        excess = (self.solution.chi2 / self.solution.count - 1.0) * np.sqrt(self.solution.count / 2.0)
        return bool(excess > MISFIT)

    @property
    def ln_evidence(self) -> float:
        return self.solution.ln_evidence

    @property
    def nuisances(self) -> Priors:
        """Priors of all that may move, but for what lies on a bound."""
        return {p: v for p, v in self.priors.items() if p not in self.bound}

    @property
    def effects(self) -> Priors:
        """Those of the parameters of effects."""
        return {p: v for p, v in self.priors.items() if p.effect in self.model.effects}

    @property
    def fitted(self) -> list[ParameterId]:
        """Parameters of effects that were estimated."""
        return [p for p in self.solution.names if p.effect in self.model.effects]

    def solved(self, problem: Problem, more: Priors, equations: NormalEquations | None = None) -> Scaled:
        """The same data and point with other priors than those of the nuisances."""
        return solved(problem, self.system, self.model, more, equations)


@dataclass(frozen=True)
class Reached:
    """A point that was visited, and the evidence there."""

    model: Model
    ln_evidence: float


@dataclass(frozen=True)
class Descent:
    """One model on its way to its best point: `tasks` ask for the next predictions, `take` gives the next state.

    `effects` candidates that the model holds and moves; `rough`: a model that misfits grossly need not be exact
    (what extends it must).  `fit` at the point reached last, `best` point so far, `failed` says why it ends.
    """

    problem: Problem
    data: Data
    model: Model
    effects: tuple[Candidate, ...] = ()
    derivatives: Derivatives = field(default_factory=Derivatives)
    rough: bool = True
    history: tuple[float, ...] = ()
    fit: Fit | None = None
    failed: str = ""
    best: Reached | None = None
    halved: int = 0

    @property
    def priors(self) -> Priors:
        """Of the parameters of effects that may move."""
        return {p: v for c in self.effects for p, v in c.priors().items()}

    def tasks(self) -> list[Task]:
        """What to predict next."""
        own = (*self.problem.free, *self.priors)
        return self.problem.tasks(self.model, replace(self.derivatives, own=own, optics=True))

    @property
    def done(self) -> bool:
        if self.fit is None or self.failed:
            return bool(self.failed)
        rough = self.rough and self.fit.hopeless
        return self.fit.history[-1] < (LOOSE if rough else ENOUGH) or len(self.history) >= (FEW if rough else TRIES)

    def take(self, predictions: Sequence[Prediction]) -> Descent:
        """Linearise at the present point, keep the fit, and move to where it points, or half the way back."""
        system = System(self.data.blocks(predictions))
        found, bound = self._within_bounds(system)
        solution, priors = found.solution, found.priors
        steps = {p: solution[p] for p in solution.names if p in priors and self._moves(p)}
        value = _evidence(system, priors, list(steps))
        if self.best is not None and value < self.best.ln_evidence - WORSE and self.halved < HALVINGS:
            return replace(self, model=_halfway(self.model, self.best.model), halved=self.halved + 1)
        sizes = (abs(s) / priors[p][1] * (SHIFTED if p.kind in SHIFTS else 1.0) for p, s in steps.items())
        history = (*self.history, float(max(sizes, default=0.0)))
        fit = Fit(self.model, tuple(predictions), system, solution, priors, found.scale, history, bound)
        return replace(
            self, model=self.model if fit.converged else self._moved(steps, priors), history=history, fit=fit,
            best=Reached(self.model, value), halved=0,
        )  # fmt: skip

    def _within_bounds(self, system: System) -> tuple[Scaled, frozenset[ParameterId]]:
        """The solution with all parameters left out that lie on a bound and would be pushed beyond."""
        bound: frozenset[ParameterId] = frozenset()
        about = {p: (mean - self.model.value(p), sd) for p, (mean, sd) in self.priors.items()}
        while True:
            more = {p: v for p, v in about.items() if p not in bound}
            found = solved(self.problem, system, self.model, more)
            step = found.solution
            outside = [p for p in more if p in step.names and self._leaves(p, step[p])]
            if not outside:
                return found, bound
            bound |= {max(outside, key=lambda p: abs(step[p]) / found.priors[p][1])}

    def _moves(self, p: ParameterId) -> bool:
        return p.kind is Kind.KEY or p.kind in SHIFTS or p in self.priors

    def _moved(self, steps: dict[ParameterId, float], priors: Priors) -> Model:
        """The model after steps, none too long and none across a bound."""
        far = max((abs(s) / priors[p][1] for p, s in steps.items() if p.kind not in SHIFTS), default=0.0)
        model = self.model
        for p, whole in steps.items():
            step = float(whole) * min(1.0, LONGEST / max(far, 1e-300))
            if p.kind in SHIFTS:
                shift = list(model.shift(p.file))
                shift[p.axis] += float(np.clip(step, -1.0, 1.0))
                model = replace(model, shifts=model.shifts | {p.file: (shift[0], shift[1])})
            elif p.kind is Kind.KEY:
                model = model.moved(p, step)
            else:
                values = model.effects[p.effect] | {p.name: self._bounded(p, model.value(p) + step)}
                model = model.with_effect(p.effect, values)
        return model

    def _bounded(self, p: ParameterId, value: float) -> float:
        param = self.problem.case.known[p.effect].params()[p.name]
        low = param.low + (1e-3 * abs(param.value) if param.open_low else 0.0)
        return float(np.clip(value, low, param.high))

    def _leaves(self, p: ParameterId, step: float) -> bool:
        """Whether a parameter that lies on its bound would be pushed beyond."""
        value = self.model.value(p)
        return value == self._bounded(p, value) and self._bounded(p, value + step) == value and step != 0.0


def _halfway(there: Model, back: Model) -> Model:
    """Half the way back to a point: the last step went too far."""
    free = {k: 0.5 * (v + back.free[k]) for k, v in there.free.items()}
    effects = {
        e: {k: 0.5 * (v + back.effects[e][k]) if v != back.effects[e][k] else v for k, v in own.items()}
        for e, own in there.effects.items()
    }
    shifts = {f: (0.5 * (u + back.shift(f)[0]), 0.5 * (v + back.shift(f)[1])) for f, (u, v) in there.shifts.items()}
    return Model(free, effects, shifts)


def _evidence(system: System, priors: Priors, moving: list[ParameterId]) -> float:
    """ln evidence at the point itself: what moves stands still, the rest is free."""
    still = {p: ((0.0, TIGHT * sd) if p in moving else (mean, sd)) for p, (mean, sd) in priors.items()}
    pulls = sum((priors[p][0] / priors[p][1]) ** 2 for p in moving)
    return system.solve(still).ln_evidence - 0.5 * pulls


def advance(problem: Problem, descents: Sequence[Descent]) -> list[Descent]:
    """One round of several models; all their predictions are shared among the workers."""
    asked = [d.tasks() for d in descents]
    answers = iter(problem.run([t for tasks in asked for t in tasks]))
    out = []
    for d, tasks in zip(descents, asked, strict=True):
        own = [next(answers) for _ in tasks]
        faults = [a for a in own if isinstance(a, FlashtempError)]
        made = [a for a in own if isinstance(a, Prediction)]
        out.append(replace(d, failed=str(faults[0])) if faults else d.take(made))
    return out


def descend(
    problem: Problem, descents: Sequence[Descent], watch: Watch = lambda text: None, hopeless: float = np.inf
) -> list[Descent]:
    """Bring several models to their best points; all predictions of a round are shared among the workers.

    A model whose evidence lies more than `hopeless` behind the best after three rounds goes no further.
    """
    now = list(descents)
    while live := [k for k, d in enumerate(now) if not d.done]:
        for k, d in zip(live, advance(problem, [now[k] for k in live]), strict=True):
            now[k] = d
        top = max((d.fit.ln_evidence for d in now if d.fit is not None), default=-np.inf)
        for k in live:
            d = now[k]
            if not d.done and len(d.history) >= 3 and d.fit is not None and d.fit.ln_evidence < top - hopeless:
                now[k] = replace(d, failed=FAR)
        watch(f"  round {max((len(now[k].history) for k in live), default=0)}")
    return now
