"""Gauss-Newton with a certificate: parameters of a campaign re-linearised until the next step is negligible."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from flashtemp.discovery.hypothesis import Candidate, Model
from flashtemp.discovery.linear_gaussian import Block, Solution, System
from flashtemp.discovery.prediction import Look, Wanted
from flashtemp.discovery.problem import Data, Study, nuisances
from flashtemp.physics.effect import catalogue

ENOUGH = 0.01  # largest last step over its prior standard deviation
SHIFTED = 0.2  # of it counts for the place of an image: 0.05 of what is known of it moves no pixel's value
TRIES = 12
LONGEST = 1.5  # step, in prior standard deviations
HALVINGS, WORSE, TIGHT = 3, 2.0, 1e-6  # steps back, the loss that asks for one, and what stands still
MISFIT, LOOSE, FEW = 20.0, 0.2, 6  # standard errors of chi2, and the step and tries that then are enough
SCALES = (0.3, 1.0, 3.0, 10.0, 30.0)  # of deviations of unknown shape: chosen under each hypothesis


@dataclass(frozen=True)
class Fit:
    """A model at its best point: `solution` of its last linearisation, `last` the step it would still take.

    `priors` {column: (mean, sd)} as seen from the point, `scale` of deviations of unknown shape; `history` of
    steps over prior standard deviations; `bound` parameters that lie on a bound.
    """

    model: Model
    shifts: dict[str, tuple[float, float]]
    looks: list[Look]
    blocks: list[Block]
    system: System
    solution: Solution
    priors: dict[str, tuple[float, float]]
    scale: float
    history: tuple[float, ...]
    bound: frozenset[str] = frozenset()

    @property
    def converged(self) -> bool:
        """Whether the certificate holds."""
        return self.history[-1] < ENOUGH

    @property
    def hopeless(self) -> bool:
        """Whether the model misfits so grossly that its best point says little."""
        return (self.solution.chi2 / self.solution.count - 1.0) * np.sqrt(self.solution.count / 2.0) > MISFIT

    @property
    def ln_evidence(self) -> float:
        return self.solution.ln_evidence


@dataclass(frozen=True)
class Extra:
    """Priors of an effect that a model holds: `priors` {"effect.parameter": (mean, sd)}."""

    priors: dict[str, tuple[float, float]] = field(default_factory=dict)

    def seen_from(self, model: Model) -> dict[str, tuple[float, float]]:
        """The same about the present values."""
        out = {}
        for name, (mean, sd) in self.priors.items():
            effect, k = name.split(".")
            out[name] = (mean - model.effects[effect][k], sd)
        return out


def extra(candidates: list[Candidate]) -> Extra:
    """Priors of all that a full fit of these effects may move."""
    priors = {}
    for c in candidates:
        params = c.kind.params()
        for k, a in c.strengths.items():
            priors[f"{c.effect}.{k}"] = (float(params[k].off), abs(a))
        for k, value in c.shapes.items():
            if params[k].spread > 1.0:
                priors[f"{c.effect}.{k}"] = (value, abs(value) * float(np.log(params[k].spread)))
    return Extra(priors)


def solved(study: Study, system: System, model: Model, shifts, more, products=None) -> tuple[Solution, dict, float]:
    """The best solution over the scales of deviations of unknown shape, its priors and that scale."""
    products = products or system.total()
    found = []
    for scale in SCALES:
        priors = nuisances(study, system.names, model, shifts, scale) | more
        found.append((system.solve(priors, products), priors, scale))
    return max(found, key=lambda f: f[0].ln_evidence)


@dataclass
class Descent:
    """One model on its way to its best point; `tasks` ask for the next look, `take` uses it."""

    study: Study
    data: Data
    model: Model
    shifts: dict[str, tuple[float, float]]
    more: Extra = field(default_factory=Extra)
    wanted: Wanted = field(default_factory=Wanted)
    history: list[float] = field(default_factory=list)
    fit: Fit | None = None
    failed: str = ""
    reached: tuple[Model, dict, float] | None = None  # the best point so far and its evidence
    halved: int = 0
    rough: bool = True  # a model that misfits grossly need not be exact: what extends it must

    @property
    def own(self) -> tuple[str, ...]:
        return (*self.study.campaign.free, *self.more.priors)

    def tasks(self) -> list[Any]:
        """What to look at next."""
        wanted = Wanted(self.own, self.wanted.scatter, self.wanted.modes, self.wanted.trends,
                        self.wanted.candidates, True)  # fmt: skip
        return self.study.tasks(self.model, wanted, self.shifts)

    @property
    def done(self) -> bool:
        if self.fit is None or self.failed:
            return bool(self.failed)
        rough = self.rough and self.fit.hopeless
        return self.fit.history[-1] < (LOOSE if rough else ENOUGH) or len(self.history) >= (FEW if rough else TRIES)

    def take(self, looks: list[Look]) -> None:
        """Linearise at the present point, keep the fit, and move to where it points."""
        blocks = self.data.blocks(looks)
        system = System(blocks)
        bound: set[str] = set()
        while True:
            more = {k: v for k, v in self.more.seen_from(self.model).items() if k not in bound}
            solution, priors, scale = solved(self.study, system, self.model, self.shifts, more)
            outside = [n for n in more if n in solution.names and self._leaves(n, solution[n])]
            if not outside:
                break
            bound.add(max(outside, key=lambda n: abs(solution[n]) / priors[n][1]))
        steps = {n: solution[n] for n in solution.names if n in priors and self._moves(n)}
        value = _evidence(system, priors, list(steps))
        if self.reached is not None and value < self.reached[2] - WORSE and self.halved < HALVINGS:
            self._back()
            return
        self.reached, self.halved = (self.model, dict(self.shifts), value), 0
        size = max((abs(s) / priors[n][1] * (SHIFTED if n.startswith("shift_") else 1.0) for n, s in steps.items()),
                   default=0.0)  # fmt: skip
        self.history.append(float(size))
        self.fit = Fit(self.model, dict(self.shifts), looks, blocks, system, solution, priors, scale,
                       tuple(self.history), frozenset(bound))  # fmt: skip
        if not self.fit.converged:
            self._move(steps, priors)

    def _back(self) -> None:
        """Half the way back to the best point so far: the last step went too far."""
        self.halved += 1
        model, shifts, _ = self.reached
        free = {k: 0.5 * (v + model.free[k]) for k, v in self.model.free.items()}
        effects = {
            e: {k: 0.5 * (v + model.effects[e][k]) if v != model.effects[e][k] else v for k, v in own.items()}
            for e, own in self.model.effects.items()
        }
        self.model = Model(free, effects)
        old = {f: shifts.get(f, (0.0, 0.0)) for f in self.shifts}
        self.shifts = {f: (0.5 * (s[0] + old[f][0]), 0.5 * (s[1] + old[f][1])) for f, s in self.shifts.items()}

    def _moves(self, name: str) -> bool:
        return name in self.study.priors or name in self.more.priors or name.startswith("shift_")

    def _move(self, steps, priors) -> None:
        free, effects = dict(self.model.free), {k: dict(v) for k, v in self.model.effects.items()}
        shifts = {f: list(s) for f, s in self.shifts.items()}
        far = max((abs(s) / priors[n][1] for n, s in steps.items() if not n.startswith("shift_")), default=0.0)
        for name, step in steps.items():
            step = float(step) * min(1.0, LONGEST / max(far, 1e-300))
            if name in free:
                free[name] += step
            elif name.startswith("shift_"):
                file = name.split("|")[1]
                shifts.setdefault(file, [0.0, 0.0])[name[6] == "v"] += float(np.clip(step, -1.0, 1.0))
            else:
                effect, k = name.split(".")
                effects[effect][k] = self._bounded(name, effects[effect][k] + step)
        self.model = Model(free, effects)
        self.shifts = {f: (float(s[0]), float(s[1])) for f, s in shifts.items()}

    def _value(self, name: str) -> float:
        effect, k = name.split(".")
        return self.model.effects[effect][k]

    def _bounded(self, name: str, value: float) -> float:
        effect, k = name.split(".")
        param = catalogue()[effect].params()[k]
        low = param.low + (1e-3 * abs(param.value) if param.open_low else 0.0)
        return float(np.clip(value, low, param.high))

    def _leaves(self, name: str, step: float) -> bool:
        """Whether a parameter that lies on its bound would be pushed beyond."""
        value = self._value(name)
        return value == self._bounded(name, value) and self._bounded(name, value + step) == value and step != 0.0


def _evidence(system: System, priors, moving: list[str]) -> float:
    """ln evidence at the point itself: what moves stands still, the rest is free."""
    still = {n: ((0.0, TIGHT * sd) if n in moving else (mean, sd)) for n, (mean, sd) in priors.items()}
    pulls = sum((priors[n][0] / priors[n][1]) ** 2 for n in moving)
    return system.solve(still).ln_evidence - 0.5 * pulls


def advance(study: Study, descents: list[Descent]) -> None:
    """One round of several models; all their looks are shared among the workers."""
    asked = [d.tasks() for d in descents]
    answers = iter(study.run([t for tasks in asked for t in tasks]))
    for d, tasks in zip(descents, asked, strict=True):
        looks = [next(answers) for _ in tasks]
        faults = [a for a in looks if isinstance(a, Exception)]
        if faults:
            d.failed = str(faults[0])
        else:
            d.take(looks)


def descend(
    study: Study, descents: list[Descent], watch: Callable[[str], Any] = lambda text: None, hopeless: float = np.inf
) -> None:
    """Bring several models to their best points; all looks of a round are shared among the workers.

    A model whose evidence lies more than `hopeless` behind the best after three rounds goes no further.
    """
    while live := [d for d in descents if not d.done]:
        advance(study, live)
        top = max((d.fit.ln_evidence for d in descents if d.fit is not None), default=-np.inf)
        for d in live:
            if not d.done and len(d.history) >= 3 and d.fit.ln_evidence < top - hopeless:
                d.failed = "far behind the best"
        watch(f"  round {max((len(d.history) for d in live), default=0)}")
