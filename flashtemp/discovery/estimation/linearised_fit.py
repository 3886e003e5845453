"""A model at the best point of its fit: the linearised system there, its solution, and how the fit ended."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property

import numpy as np

from flashtemp.discovery.estimation.hyperparameters import EvidenceMaximum, Hyperparameters, maximise_evidence
from flashtemp.discovery.estimation.linear_gaussian import DataBlock, LinearSystem, NormalEquations, Solution
from flashtemp.discovery.estimation.model_discrepancy import LARGEST_DISCREPANCY
from flashtemp.discovery.hypotheses.candidates import ModelPoint
from flashtemp.discovery.parameters import ParameterId, Priors
from flashtemp.discovery.prediction.prediction import Prediction
from flashtemp.discovery.prediction.problem import Problem


class FitStatus(StrEnum):
    """How a fit ended."""

    CONVERGED = "converged"  # no step promises a gain that any decision could feel
    STALLED = "stalled"  # steps that promise a gain do not give it: the numerics' own noise, or a kink
    BUDGET = "budget"  # as many simulations as a fit may have
    OUTRUN = "outrun"  # another hypothesis explains more than this one could reach
    FAILED = "failed"  # nothing could be simulated


@dataclass(frozen=True)
class LinearisedFit:
    """A model at its best point: `predictions` there, the linearised `system`, its `solution` with `priors` as seen
    from the point, at hyperparameters `hyper`.

    `bound` parameters that lie on a bound; `promise` ln evidence that a further step would gain by the linearised
    model; `evaluations` simulations of the campaign that it took; `history` predicted gain at each accepted point.
    """

    model: ModelPoint
    predictions: tuple[Prediction, ...]
    system: LinearSystem
    solution: Solution
    priors: Priors
    hyper: Hyperparameters
    status: FitStatus
    bound: frozenset[ParameterId] = frozenset()
    promise: float = np.inf
    evaluations: int = 0
    history: tuple[float, ...] = ()

    @property
    def blocks(self) -> list[DataBlock]:
        return self.system.blocks

    @property
    def is_converged(self) -> bool:
        return self.status is FitStatus.CONVERGED

    @property
    def is_comparable(self) -> bool:
        """Whether it may be compared with others: it is at its best point as far as numerics can tell."""
        return self.status in (FitStatus.CONVERGED, FitStatus.STALLED)

    @cached_property
    def equations(self) -> NormalEquations:
        """Normal equations of all that is fitted, with the noise that the fit found."""
        return self.system.normal_equations(variances=self.hyper.variances)

    @cached_property
    def chi2(self) -> float:
        """Sum of squares of what is left of all data that are fitted, in stated standard deviations."""
        left = zip(self.blocks, self.system.block_chi2(self.solution), strict=True)
        return float(sum(chi2 for b, chi2 in left if not b.held_out))

    @property
    def ln_evidence(self) -> float:
        return self.solution.ln_evidence

    @property
    def secured_evidence(self) -> float:
        """ln evidence that is certain: of a fit that did not converge, without what its linearised model promises."""
        return self.ln_evidence - (0.0 if self.is_converged else self.promise)

    @property
    def free_priors(self) -> Priors:
        """Priors of all that may move, but for what lies on a bound."""
        return {p: v for p, v in self.priors.items() if p not in self.bound}

    @property
    def effect_priors(self) -> Priors:
        """Those of the parameters of effects."""
        return {p: v for p, v in self.priors.items() if p.effect in self.model.effects}

    @property
    def effect_parameters(self) -> list[ParameterId]:
        """Parameters of effects that were estimated."""
        return [p for p in self.solution.names if p.effect in self.model.effects]

    def solve_with(
        self, problem: Problem, more: Priors, equations: NormalEquations | None = None, noise: bool = False
    ) -> EvidenceMaximum:
        """The same data and point with other priors than those of the nuisances; with `noise` its variances too are
        found anew, else they stay as the fit has them."""
        variances = None if noise else self.hyper.variances
        return maximise_evidence(problem, self.system, self.model, more, variances=variances, equations=equations)

    def evidence_at_max_discrepancy(self, problem: Problem, more: Priors) -> float:
        """ln evidence with these priors where the model's own error may be as large as it ever is."""
        found = maximise_evidence(
            problem, self.system, self.model, more, variances=self.hyper.variances, discrepancies=(LARGEST_DISCREPANCY,)
        )
        return found.solution.ln_evidence
