"""A solution at a point, at those scales of what has no known size that have the largest evidence."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from flashtemp.discovery.camera_errors import FAMILIES, NONE, USUAL
from flashtemp.discovery.floor import LARGEST, LEAST, MIDDLE
from flashtemp.discovery.hypothesis import Model
from flashtemp.discovery.linear_gaussian import Array, NormalEquations, Solution, System
from flashtemp.discovery.nuisances import factors, is_camera_gain, nuisances, rescaled
from flashtemp.discovery.parameters import OF_THE_CAMERA, Kind, Priors
from flashtemp.discovery.problem import Problem

SCALES = (0.3, 1.0, 3.0, 10.0, 30.0)  # of deviations of unknown shape: chosen under each hypothesis
COSTS = 3.0  # ln of the prior odds against each family of camera errors, as of any more freedom
SWEEPS = 4  # over the families of camera errors, at most


@dataclass(frozen=True)
class Scaled:
    """The best solution over the scales of deviations of unknown shape and of camera errors, its priors and scales."""

    solution: Solution
    priors: Priors
    scale: float
    floor: float = MIDDLE
    families: Mapping[Kind, float] = field(default_factory=lambda: NONE)


@dataclass(frozen=True)
class Widths:
    """Hyperparameters: `scale` of deviations, `floor` of the model's own error, sizes of `families`."""

    scale: float
    floor: float
    families: Mapping[Kind, float]

    def of(self, sd: Array, columns: Mapping[tuple[Kind, bool], list[int]]) -> Array:
        """Standard deviations of columns whose usual ones are `sd`, with the indices of those of each kind."""
        out = sd.copy()
        for kind, times in factors(self.scale, self.families).items():
            out[columns.get(kind, [])] *= times
        out[columns.get((Kind.FLOOR, False), [])] = self.floor
        return out


def solved(
    problem: Problem, system: System, model: Model, more: Priors, equations: NormalEquations | None = None,
    floors: tuple[float, ...] = (LARGEST, LEAST), cameras: bool = True,
) -> Scaled:  # fmt: skip
    """Nuisances as seen from a point, and `more`, estimated at the scale, the floor, one of `floors`, and the sizes of
    camera errors of largest evidence.  Of all data that are fitted, those held out shown where their own cameras were,
    unless other `equations` are given."""
    asked, plain = equations or system.total(), nuisances(problem, system.names, model)
    best = _likeliest(system, plain | more, more, asked, floors, cameras and not problem.stiff)
    priors = rescaled(plain, best.scale, best.floor, best.families) | more
    solution = system.solve(priors, asked)
    solution = solution if equations else system.completed(solution, priors)
    families = {p.kind for p in priors if p.kind in OF_THE_CAMERA or is_camera_gain(p)}
    if families:
        solution = replace(solution, ln_evidence=solution.ln_evidence - COSTS * len(families))
    return Scaled(solution, priors, best.scale, best.floor, best.families)


def _likeliest(
    system: System, given: Priors, more: Priors, equations: NormalEquations, floors: tuple[float, ...], cameras: bool
) -> Widths:
    """Hyperparameters of the largest evidence: scale and floor together, for one hides the other, then the families of
    camera errors one after the other until none changes; from cameras without errors and from usual ones.

    Each family that there is costs COSTS of ln evidence, its prior odds.
    Without `cameras` there is none: where a model misfits grossly, they must not be bent to what physics will do.
    """
    evidence, names = system.evidence(given, equations), system.known(given)
    sd = np.array([given[p][1] for p in names])
    columns: dict[tuple[Kind, bool], list[int]] = {}
    for i, p in enumerate(names):
        if p not in more:
            columns.setdefault((p.kind, is_camera_gain(p)), []).append(i)
    families = [kind for kind in FAMILIES if cameras and any(p.kind is kind for p in names)]

    def value(way: Widths) -> float:
        return evidence(way.of(sd, columns)) - COSTS * sum(way.families[kind] > 0.0 for kind in families)

    def best(ways: Iterator[Widths]) -> tuple[float, Widths]:
        return max(((value(way), way) for way in ways), key=lambda pair: pair[0])

    ends = []
    for start in (NONE, USUAL) if families else (NONE,):
        now, way = -np.inf, Widths(SCALES[0], floors[0], start)
        for _ in range(SWEEPS):
            before = now
            now, way = best(Widths(s, f, way.families) for f in floors for s in SCALES)
            for kind in families:
                now, way = best(Widths(way.scale, way.floor, {**way.families, kind: size}) for size in FAMILIES[kind])
            if now <= before + 1e-9 or not families:
                break
        ends.append((now, way))
    return max(ends, key=lambda pair: pair[0])[1]
