"""Hyperparameters of the largest evidence: sizes of deviations and of camera errors that nobody states."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from flashtemp.discovery.estimation.camera_error_columns import FAMILIES, NONE, USUAL
from flashtemp.discovery.estimation.linear_gaussian import Array, NormalEquations, System
from flashtemp.discovery.estimation.nuisance_priors import factors, is_camera_gain
from flashtemp.discovery.parameters import Kind, Priors

SCALES = (0.3, 1.0, 3.0, 10.0, 30.0)  # of deviations of unknown shape: chosen under each hypothesis
COSTS = 3.0  # ln of the prior odds against each family of camera errors, as of any more freedom
SWEEPS = 4  # over the families of camera errors, at most


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


def likeliest_widths(
    system: System, given: Priors, more: Priors, equations: NormalEquations, floors: tuple[float, ...]
) -> Widths:
    """Hyperparameters of the largest evidence: scale and floor together, for one hides the other, then the families of
    camera errors one after the other until none changes; from cameras without errors and from usual ones.

    Each family that there is costs COSTS of ln evidence, its prior odds.
    """
    evidence, names = system.evidence(given, equations), system.known(given)
    sd = np.array([given[p][1] for p in names])
    columns: dict[tuple[Kind, bool], list[int]] = {}
    for i, p in enumerate(names):
        if p not in more:
            columns.setdefault((p.kind, is_camera_gain(p)), []).append(i)
    families = [kind for kind in FAMILIES if any(p.kind is kind for p in names)]

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
