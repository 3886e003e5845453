"""A solution at a point, at those scales of what has no known size that have the largest evidence."""

from __future__ import annotations

from dataclasses import dataclass

from flashtemp.discovery.floor import LARGEST, LEAST, MIDDLE
from flashtemp.discovery.hypothesis import Model
from flashtemp.discovery.linear_gaussian import NormalEquations, Solution, System
from flashtemp.discovery.nuisances import nuisances, rescaled
from flashtemp.discovery.parameters import Priors
from flashtemp.discovery.problem import Problem

SCALES = (0.3, 1.0, 3.0, 10.0, 30.0)  # of deviations of unknown shape: chosen under each hypothesis


@dataclass(frozen=True)
class Scaled:
    """The best solution over the scales of deviations of unknown shape, its priors and that scale."""

    solution: Solution
    priors: Priors
    scale: float
    floor: float = MIDDLE


def solved(
    problem: Problem, system: System, model: Model, more: Priors, equations: NormalEquations | None = None,
    floors: tuple[float, ...] = (LARGEST, LEAST),
) -> Scaled:  # fmt: skip
    """Nuisances as seen from a point, and `more`, estimated at the scale and the floor, one of `floors`, of largest
    evidence: both at once, for one hides the other."""
    equations, plain = equations or system.total(), nuisances(problem, system.names, model)
    ways = [(scale, floor) for floor in floors for scale in SCALES]
    priors = [rescaled(plain, *way) | more for way in ways]
    k = system.likeliest(priors, equations)
    return Scaled(system.solve(priors[k], equations), priors[k], *ways[k])
