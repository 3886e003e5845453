"""A solution at a point, at those scales of what has no known size that have the largest evidence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flashtemp.discovery.floor import LARGEST, LEAST, MIDDLE
from flashtemp.discovery.hypothesis import Model
from flashtemp.discovery.linear_gaussian import Array, NormalEquations, Solution, System
from flashtemp.discovery.nuisances import growth, nuisances, rescaled
from flashtemp.discovery.parameters import Kind, Priors
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
    evidence: both at once, for one hides the other.  Of all data that are fitted, those held out shown where their own
    cameras were, unless other `equations` are given."""
    asked, plain = equations or system.total(), nuisances(problem, system.names, model)
    ways = [(scale, floor) for floor in floors for scale in SCALES]
    given = plain | more
    names = system.known(given)
    sd = np.array([given[p][1] for p in names])
    kinds = np.array(["" if p in more else p.kind for p in names])
    way = ways[system.likeliest(given, [_widths(sd, kinds, *way) for way in ways], asked)]
    priors = rescaled(plain, *way) | more
    solution = system.solve(priors, asked)
    return Scaled(solution if equations else system.completed(solution, priors), priors, *way)


def _widths(sd: Array, kinds: npt.NDArray[np.str_], scale: float, floor: float) -> Array:
    """`rescaled` standard deviations (columns,) of priors of some `kinds`."""
    out = sd.copy()
    for kind, times in growth(scale).items():
        out[kinds == kind] *= times
    out[kinds == Kind.FLOOR] = floor
    return out
