"""Prior widths of largest evidence: unstated sizes of friction scatter, pressure shapes and camera errors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from flashtemp.discovery.estimation.camera_error_columns import (
    CAMERA_ERROR_SCALES,
    NO_CAMERA_ERRORS,
    USUAL_CAMERA_ERRORS,
)
from flashtemp.discovery.estimation.linear_gaussian import Array, LinearSystem, NormalEquations
from flashtemp.discovery.estimation.nuisance_priors import is_camera_gain, width_factors
from flashtemp.discovery.parameters import ParameterKind, Priors

DEVIATION_SCALES = (0.3, 1.0, 3.0, 10.0, 30.0)  # of pressure shapes and scatter: one is chosen for each hypothesis
LN_ODDS_AGAINST_FAMILY = 3.0  # ln of the prior odds against each family of camera errors
MAX_FAMILY_SWEEPS = 4  # over the families of camera errors, at most


@dataclass(frozen=True)
class PriorWidths:
    """Hyperparameters: `scale` of deviations, `discrepancy_sd` of the model discrepancy, sizes of `families`."""

    scale: float
    discrepancy_sd: float
    families: Mapping[ParameterKind, float]

    def column_sd(self, sd: Array, columns: Mapping[tuple[ParameterKind, bool], list[int]]) -> Array:
        """Standard deviations of columns whose usual ones are `sd`, with the indices of those of each kind."""
        out = sd.copy()
        for kind, times in width_factors(self.scale, self.families).items():
            out[columns.get(kind, [])] *= times
        out[columns.get((ParameterKind.MODEL_DISCREPANCY, False), [])] = self.discrepancy_sd
        return out


def maximise_evidence_over_widths(
    system: LinearSystem, given: Priors, more: Priors, equations: NormalEquations, discrepancy_sds: tuple[float, ...]
) -> PriorWidths:
    """The prior widths of largest evidence, by coordinate search on a grid.

    Scale and discrepancy are varied together, because one can compensate the other.  Then the families of camera errors
    are varied in turn until none changes.  The search starts from cameras without errors and from usual ones.
    Each family with errors costs LN_ODDS_AGAINST_FAMILY of ln evidence, its prior odds.
    """
    evidence, names = system.evidence_function(given, equations), system.known_columns(given)
    sd = np.array([given[p][1] for p in names])
    columns: dict[tuple[ParameterKind, bool], list[int]] = {}
    for i, p in enumerate(names):
        if p not in more:
            columns.setdefault((p.kind, is_camera_gain(p)), []).append(i)
    families = [kind for kind in CAMERA_ERROR_SCALES if any(p.kind is kind for p in names)]

    known: dict[tuple[float, ...], float] = {}  # the sweeps come back to the same widths

    def penalised_evidence(way: PriorWidths) -> float:
        sizes = tuple(way.families[kind] for kind in families)
        key = (way.scale, way.discrepancy_sd, *sizes)
        if key not in known:
            odds = LN_ODDS_AGAINST_FAMILY * sum(size > 0.0 for size in sizes)
            known[key] = evidence(way.column_sd(sd, columns)) - odds
        return known[key]

    def select_best(options: Iterator[PriorWidths]) -> tuple[float, PriorWidths]:
        return max(((penalised_evidence(way), way) for way in options), key=lambda pair: pair[0])

    ends = []
    # coordinate search may end in a local maximum: errors of one family can hide those of another
    for start in (NO_CAMERA_ERRORS, USUAL_CAMERA_ERRORS) if families else (NO_CAMERA_ERRORS,):
        now, way = -np.inf, PriorWidths(DEVIATION_SCALES[0], discrepancy_sds[0], start)
        for _ in range(MAX_FAMILY_SWEEPS):
            before = now
            now, way = select_best(PriorWidths(s, d, way.families) for d in discrepancy_sds for s in DEVIATION_SCALES)
            for kind in families:
                now, way = select_best(
                    PriorWidths(way.scale, way.discrepancy_sd, {**way.families, kind: size})
                    for size in CAMERA_ERROR_SCALES[kind]
                )
            if now <= before + 1e-9 or not families:
                break
        ends.append((now, way))
    return max(ends, key=lambda pair: pair[0])[1]
