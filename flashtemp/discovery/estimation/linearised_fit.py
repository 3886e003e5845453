"""The result of a fit: a model at its best point, the linearised system and its solution there, and how it ended."""

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

    CONVERGED = "converged"  # no step predicts a gain that could change a decision
    STALLED = "stalled"  # steps do not gain what is predicted: numerical noise, or a kink of the model
    BUDGET = "budget"  # the maximum number of simulations was reached
    OUTRUN = "outrun"  # another hypothesis explains more than this one can reach
    FAILED = "failed"  # nothing could be simulated


@dataclass(frozen=True)
class LinearisedFit:
    """A model at its best point: `predictions` there, the linearised `system`, its `solution` with `priors` relative
    to the point, and hyperparameters `hyper`.

    `bound`: parameters that lie on a bound.  `promise`: ln evidence that another step would gain by the linearised
    model.  `evaluations`: number of simulations of the campaign.  `history`: predicted gain at each point.
    `width_price`: what ln evidence loses because effects are larger than typical (`heavy_tails`).
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
    width_price: float = 0.0

    @property
    def blocks(self) -> list[DataBlock]:
        return self.system.blocks

    @property
    def is_converged(self) -> bool:
        return self.status is FitStatus.CONVERGED

    @property
    def is_comparable(self) -> bool:
        """Whether its evidence may be compared with that of others: it is at its best point within numerical noise."""
        return self.status in (FitStatus.CONVERGED, FitStatus.STALLED)

    @cached_property
    def equations(self) -> NormalEquations:
        """Normal equations of all fitted data, with the noise variances that the fit estimated."""
        return self.system.normal_equations(variances=self.hyper.variances)

    @cached_property
    def chi2(self) -> float:
        """Sum of squared residuals of all fitted data, in stated standard deviations."""
        values = zip(self.blocks, self.system.block_chi2(self.solution), strict=True)
        return float(sum(chi2 for b, chi2 in values if not b.held_out))

    @property
    def ln_evidence(self) -> float:
        return self.solution.ln_evidence

    @property
    def secured_evidence(self) -> float:
        """ln evidence without predictions: that of a fit that did not converge is reduced by its predicted gain."""
        return self.ln_evidence - (0.0 if self.is_converged else self.promise)

    @property
    def free_priors(self) -> Priors:
        """Priors of all parameters that are not on a bound."""
        return {p: v for p, v in self.priors.items() if p not in self.bound}

    @property
    def effect_priors(self) -> Priors:
        """Priors of the effect parameters."""
        return {p: v for p, v in self.priors.items() if p.effect in self.model.effects}

    @property
    def free_effect_priors(self) -> Priors:
        """Priors of the effect parameters that are not on a bound."""
        return {p: v for p, v in self.effect_priors.items() if p not in self.bound}

    @property
    def effect_parameters(self) -> list[ParameterId]:
        """Effect parameters that were estimated."""
        return [p for p in self.solution.names if p.effect in self.model.effects]

    def solve_with(
        self, problem: Problem, more: Priors, equations: NormalEquations | None = None, noise: bool = False
    ) -> EvidenceMaximum:
        """Maximise the evidence at this point with priors `more` in addition to those of the nuisances.

        With `noise`, the noise variances are estimated again, else they stay those of the fit.
        """
        variances = None if noise else self.hyper.variances
        return maximise_evidence(problem, self.system, self.model, more, variances=variances, equations=equations)

    def evidence_at_max_discrepancy(self, problem: Problem, more: Priors) -> float:
        """ln evidence with priors `more` where the model discrepancy is as large as it may be (LARGEST_DISCREPANCY).

        `more` are those of the effects, or none: then the effects are held at their values.
        """
        found = maximise_evidence(
            problem,
            self.system,
            self.model,
            more,
            variances=self.hyper.variances,
            discrepancy_sds=(LARGEST_DISCREPANCY,),
        )
        return found.solution.ln_evidence - (self.width_price if more else 0.0)
