"""Warnings that a mesh is too coarse for a campaign, with the key that makes it finer."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from flashtemp.discovery.criteria import CRITERIA
from flashtemp.discovery.diagnostics.adequacy_tests import normalised_deviations
from flashtemp.discovery.estimation.linearised_fit import FitStatus, LinearisedFit
from flashtemp.discovery.estimation.model_discrepancy import LARGEST_DISCREPANCY
from flashtemp.discovery.estimation.whitening import WhitenedData
from flashtemp.discovery.parameters import ParameterKind
from flashtemp.discovery.prediction.mesh_extrapolation import COARSER_CELL_FACTORS
from flashtemp.discovery.prediction.prediction import Prediction
from flashtemp.model.schema import refinement_factor


def mesh_resolution_warnings(data: WhitenedData, predictions: Iterable[Prediction]) -> list[str]:
    """Warnings if the error of the mesh in the plane of sliding, or across it, exceeds the largest model discrepancy.

    The errors are those of Richardson extrapolation; the recording with the largest relative error is named.
    """
    case = data.problem.case
    mesh = refinement_factor(case["numerics.mesh"])
    plane, across = range(len(COARSER_CELL_FACTORS)), [len(COARSER_CELL_FACTORS)]
    first = f" with numerics.first_y = {case['numerics.first_y']:g}" if case["numerics.first_y"] else ""
    keys = {
        f"numerics.mesh = {mesh:g}": (plane, f"{2.0 * mesh:g}"),
        f"numerics.across = {case['numerics.across']}{first}": (
            across,
            f"{max(60, 2 * case['numerics.across'])} with numerics.first_y = 3e-5, or 1 (2D)",
        ),
    }
    out, predictions = [], tuple(predictions)
    for key, (directions, remedy) in keys.items():
        found = (_mesh_error(data, p, file, directions) for p in predictions for file in p.observables)
        fraction, error_K, file = max(found, default=(0.0, 0.0, ""))
        if fraction >= LARGEST_DISCREPANCY:
            out.append(
                f"{key} may be too coarse: its error is about {error_K:.2g} K rms in {file}, {100 * fraction:.2g} % of "
                f"the temperature rise; try {remedy}"
            )
    return out


def _mesh_error(
    data: WhitenedData, prediction: Prediction, file: str, directions: Iterable[int]
) -> tuple[float, float, str]:
    """The mesh error (rms) of a recording in some directions together, as a fraction of its rise and in K."""
    observable, fixed = prediction.observables[file], data.fixed[file]
    columns = [k for k, p in enumerate(fixed.names) if p.kind is ParameterKind.MESH and p.index[0] in directions]
    if observable.values.ndim != 3 or not columns:
        return 0.0, 0.0, file
    error = data.to_kelvin(file, fixed.F[:, columns].astype(float).sum(axis=1))
    rise = observable.values[:, observable.inside] - float(np.nanmin(observable.values))
    known = data.is_compared[file]
    error_K, rise_K = (float(np.sqrt(np.sum(a[known] ** 2) / max(known.sum(), 1))) for a in (error, rise))
    return error_K / max(rise_K, 1e-9), error_K, file


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
