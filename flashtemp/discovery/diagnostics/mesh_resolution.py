"""Warnings that a mesh is too coarse for a campaign, with the key that makes it finer."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from flashtemp.discovery.criteria import CRITERIA
from flashtemp.discovery.diagnostics.adequacy_tests import normalised_deviations
from flashtemp.discovery.estimation.linearised_fit import FitStatus, LinearisedFit
from flashtemp.discovery.estimation.model_discrepancy import LARGEST_DISCREPANCY
from flashtemp.discovery.estimation.nuisance_priors import NUISANCE_SD
from flashtemp.discovery.estimation.whitening import WhitenedData
from flashtemp.discovery.parameters import ParameterKind
from flashtemp.discovery.prediction.prediction import Prediction
from flashtemp.model.case import Case

# cell factors of the runs that estimate the mesh error: along, up and down, and across in 3D
COARSER_CELL_FACTORS = ((0.6, 1, 1), (1, 0.6, 1), (1, 1, 0.6), (0.5, 0.5, 0.5))
COARSER_ACROSS_FACTORS = (1, 1, 1, 0.5)


def coarser_mesh_factors(case: Case) -> tuple[tuple[float, ...], ...]:
    """Cell factors of the meshes that estimate the mesh error of a case."""
    return (*COARSER_CELL_FACTORS, COARSER_ACROSS_FACTORS) if case["numerics.across"] > 1 else COARSER_CELL_FACTORS


def lateral_resolution_warnings(
    data: WhitenedData, predictions: Iterable[Prediction], coarser_across: int
) -> list[str]:
    """A warning if half the cells across change a recording by more than the largest model discrepancy.

    `coarser_across`: number, among the coarser meshes that were simulated, of the one with half the cells across; 2D
    runs have none.  The mesh error is taken as the usual fraction of that change; the worst recording is named.
    """
    worst = (0.0, 0.0, "")
    for prediction in predictions:
        for file, observable in prediction.observables.items():
            columns = {p.index: k for k, p in enumerate(data.fixed[file].names) if p.kind is ParameterKind.MESH}
            if observable.values.ndim != 3 or (coarser_across,) not in columns:
                continue
            change = data.to_kelvin(file, data.fixed[file].F[:, columns[coarser_across,]].astype(float))
            rise = observable.values[:, observable.inside] - float(np.nanmin(observable.values))
            change_K, rise_K = (float(np.sqrt(np.mean(a**2))) for a in (change, rise))
            worst = max(worst, (change_K / max(rise_K, 1e-9), change_K, file))
    fraction, change_K, file = worst
    if NUISANCE_SD[ParameterKind.MESH] * fraction < LARGEST_DISCREPANCY:
        return []
    case = data.problem.case
    first = f" with numerics.first_y = {case['numerics.first_y']:g}" if case["numerics.first_y"] else ""
    return [
        f"numerics.across = {case['numerics.across']}{first} may be too coarse: half as many cells change {file} by "
        f"{change_K:.2g} K rms, {100 * fraction:.2g} % of its temperature rise; try 60 with "
        "numerics.first_y = 3e-5, or 1 (2D)"
    ]


def unconverged_fit_warnings(fits: Mapping[frozenset[str], LinearisedFit], mesh: float) -> list[str]:
    """A warning if a fit did not converge and its estimated mesh error exceeds what the coarser meshes suggest."""
    far = []
    for names, fit in fits.items():
        if not fit.is_comparable and fit.status is not FitStatus.OUTRUN:
            of_mesh = (abs(v) for p, v in normalised_deviations(fit).items() if p.kind is ParameterKind.MESH)
            far.append((max(of_mesh, default=0.0), " with ".join(sorted(names)) or "the stated model"))
    worst, cause = max(far, default=(0.0, ""))
    if worst < CRITERIA.pull_nuisance:
        return []
    return [
        f"numerics.mesh = {mesh:g} may be too coarse: the fit of {cause} did not converge, and its mesh error is "
        f"{worst:.2g} prior standard deviations; try {2 * mesh:g}"
    ]
