"""A model at its best point: its solution, how near that point is, and what may be concluded from it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from flashtemp.discovery.floor import LARGEST
from flashtemp.discovery.hypothesis import Model
from flashtemp.discovery.linear_gaussian import Block, NormalEquations, Solution, System
from flashtemp.discovery.parameters import ParameterId, Priors
from flashtemp.discovery.prediction import Prediction
from flashtemp.discovery.problem import Problem
from flashtemp.discovery.scales import Scaled, solved

ENOUGH = 0.01  # largest last step over its prior standard deviation
KNOWN = 1.0  # ln evidence that a step may promise of a fit whose evidence counts as known
EVEN = 0.05  # ln evidence that a last step still promises, below which it is not worth taking
NOISE = 4.0  # the same where numerics leave evidence uncertain by as much
MISFIT = 20.0  # standard errors of chi2 of a gross misfit, of all data or of a recording or a load cell's trace alone
LOOSE = 0.2  # step that is enough to compare
LITTLE = 0.01  # of a gross misfit: what steps may still gain of a fit that is compared with others


@dataclass(frozen=True)
class Fit:
    """A model at its best point: `solution` of its last linearisation, and the `history` of steps over prior
    standard deviations, of which the last is the one it would still take.

    `priors` as seen from the point; `bound` parameters that lie on a bound;
    `promise` the ln evidence that the last step would still gain, `vain` whether the step before promised as little,
    was taken and did not gain it: where rims of an image come and go, two points point at each other.  `noisy`: points
    as near as numerics can tell apart have less evidence, by more than it promises, or a step lost and a shorter one
    gained nothing.  `adrift` the longest step that an image held out would still take, which no fit counts.
    """

    model: Model
    predictions: tuple[Prediction, ...]
    system: System
    solution: Solution
    priors: Priors
    history: tuple[float, ...]
    bound: frozenset[ParameterId] = frozenset()
    promise: float = np.inf
    vain: bool = False
    noisy: bool = False
    adrift: float = 0.0

    @property
    def blocks(self) -> list[Block]:
        return self.system.blocks

    @property
    def converged(self) -> bool:
        """Whether the certificate holds: the next step is short, or gains nothing."""
        return self.history[-1] < ENOUGH or self._noise or (self.near and (self.promise < EVEN or self.vain))

    @property
    def near(self) -> bool:
        """Whether its best point is near."""
        return self.history[-1] < LOOSE or self.promise < KNOWN or self._noise

    @property
    def placed(self) -> bool:
        """Whether images that are held out lie where they are seen."""
        return self.adrift < LOOSE

    @property
    def usable(self) -> bool:
        """Whether it may be compared and extended: it is near its best point, or as near as a gross misfit asks for."""
        return self.near or self.promise < LITTLE * self.misfit

    @property
    def _noise(self) -> bool:
        return self.noisy and self.promise < NOISE

    @cached_property
    def excess(self) -> dict[str, float]:
        """chi2 per datum of every recording and trace, less one, in standard errors of noise alone."""
        left = zip(self.blocks, self.system.left(self.solution), strict=True)
        return {b.label: (chi2 / b.count - 1.0) * np.sqrt(0.5 * b.count) for b, chi2 in left}

    @property
    def hopeless(self) -> bool:
        """Whether the model misfits so grossly that its best point says little."""
        return self.misfit > 0.0

    @property
    def misfit(self) -> float:
        """ln evidence that a gross misfit costs, of all that is fitted or of a recording or a trace alone; 0 where none
        is."""
        all_of_it = (self.solution.chi2 / self.solution.count - 1.0) * np.sqrt(0.5 * self.solution.count)
        each = ((self.excess[b.label], b.count) for b in self.blocks if not b.held_out)
        gross = (e * np.sqrt(0.5 * n) for e, n in ((all_of_it, self.solution.count), *each) if e > MISFIT)
        return float(max(gross, default=0.0))

    @property
    def spare(self) -> float:
        """ln evidence that data leave over beyond their noise: what any other model may gain, about."""
        return max(0.0, 0.5 * (self.solution.chi2 - self.solution.count))

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

    def at_largest(self, problem: Problem, more: Priors) -> float:
        """ln evidence with these priors where the model's own error may be as large as it ever is."""
        return solved(problem, self.system, self.model, more, floors=(LARGEST,)).solution.ln_evidence


@dataclass(frozen=True)
class Reached:
    """A point that was visited, its fit, and the evidence there, all that moves standing still; whether all traces are
    its `own`, none borrowed."""

    fit: Fit
    ln_evidence: float
    own: bool = True
