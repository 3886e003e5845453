"""Keys of the case that were held: does freeing one of them explain what a cause would?

A number that nobody doubted is doubted first: friction that a load cell shows to be another, a conductivity from a
handbook.  Their traces are those of free keys, their priors too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flashtemp.discovery.fit import Fit
from flashtemp.discovery.hypothesis import declaration, prior
from flashtemp.discovery.parameters import ParameterId
from flashtemp.discovery.problem import Problem, may_move
from flashtemp.discovery.whitening import Data
from flashtemp.errors import BadInput

TABLES = ("contact", "friction", "ambient", "materials", "layers")  # and those of the effects that the case holds
NEVER = {  # choices of the model, which nobody measures
    "contact.heat_split", "contact.flash_factor", "contact.lane_widening", "contact.reference_pressure",
}  # fmt: skip


@dataclass(frozen=True)
class HeldKey:
    """A key that was held: `told` in the case, `value` with `stderr` that the data want in `unit`, `ln_bayes` of
    freeing it; `fit` the full one, None where the trace alone was asked."""

    key: str
    told: float
    value: float
    stderr: float
    unit: str
    ln_bayes: float
    fit: Fit | None = None

    @property
    def words(self) -> str:
        unit = "" if self.unit == "1" else f" {self.unit}"
        return (
            f"{self.key} was held at {self.told:.4g}{unit}; the data want {self.value:.4g} +- {self.stderr:.2g}{unit}"
        )


def holdable(problem: Problem) -> tuple[str, ...]:
    """Numbers of the case that could be freed and are not: above zero, finite, and of the physics."""
    case, out = problem.case, []
    for table, own in case.values.items():
        if not (table.split(".")[0] in TABLES or table in case.effects):
            continue
        for name, value in own.items():
            key = f"{table}.{name}"
            plain = isinstance(value, (int, float)) and not isinstance(value, bool) and 0.0 < value < np.inf
            known = key in NEVER or key in problem.campaign.free or _given(problem, key)
            if plain and not known and _moves(problem, key):
                out.append(key)
    return tuple(out)


def _given(problem: Problem, key: str) -> bool:
    """Whether the conditions set a key: then its value of the case is nobody's."""
    return any(key in c.given for c in problem.conditions)


def _moves(problem: Problem, key: str) -> bool:
    try:
        may_move(problem.campaign, problem.case, key)
    except (BadInput, KeyError):
        return False
    return True


def freed(problem: Problem, data: Data, key: str) -> tuple[Problem, Data]:
    """The same with one more free key."""
    campaign = replace(problem.campaign, free=(*problem.campaign.free, key))
    wider = replace(problem, campaign=campaign)
    return wider, replace(data, problem=wider)


def scored(problem: Problem, fit: Fit, keys: tuple[str, ...]) -> tuple[HeldKey, ...]:
    """Every key that was held, by its trace at a fit; the one that explains most first."""
    plain = fit.solved(problem, fit.effects).solution.ln_evidence
    out = []
    for key in keys:
        p = ParameterId.of_key(key)
        if p not in fit.system.index:
            continue
        found = fit.solved(problem, fit.effects | {p: (0.0, prior(key))}).solution
        told = float(problem.case[key])
        value, sd = told * float(np.exp(found[p])), found.sd(p)
        unit = declaration(problem.case, key).unit
        out.append(HeldKey(key, told, value, value * sd, unit, found.ln_evidence - plain))
    return tuple(sorted(out, key=lambda h: -h.ln_bayes))
