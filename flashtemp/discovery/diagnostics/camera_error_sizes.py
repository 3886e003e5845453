"""The estimated size of camera errors in each recording, for reports."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flashtemp.discovery.estimation.linear_gaussian import DataBlock, predicted_change
from flashtemp.discovery.estimation.linearised_fit import LinearisedFit
from flashtemp.discovery.estimation.nuisance_priors import is_camera_gain
from flashtemp.discovery.estimation.whitening import WhitenedData
from flashtemp.discovery.parameters import CAMERA_ERROR_KINDS, Kind, ParameterId

CAMERA_ERROR_WORDS = {
    Kind.OFFSET: "offset in time",
    Kind.STATIC: "static map",
    Kind.MAP: "gain map",
    Kind.OPTICS: "smear and stray light",
}
MIN_REPORTED_ERROR_K = 5e-3  # rms below which a camera error is not reported


def camera_error_warnings(data: WhitenedData, fit: LinearisedFit) -> tuple[str, ...]:
    """One line for each recording in which a fit estimates camera errors, with their rms in K."""
    out = []
    for block in fit.blocks:
        sizes = {kind: _family_rms(data, fit, block, kind) for kind in CAMERA_ERROR_WORDS}
        parts = [
            f"{CAMERA_ERROR_WORDS[kind]} {size:.2g} K" for kind, size in sizes.items() if size > MIN_REPORTED_ERROR_K
        ]
        if parts:
            out.append(f"{block.label}: camera errors were calibrated (rms): {', '.join(parts)}")
    return tuple(out)


def _family_rms(data: WhitenedData, fit: LinearisedFit, block: DataBlock, kind: Kind) -> float:
    """Root mean square (K) of the estimated errors of one family in a recording."""
    keep = {p for p in fit.solution.names if p.kind is kind and p.file == block.label and _is_camera_error(p)}
    if not keep:
        return 0.0
    own = tuple((p, column) for p, column in block.names if p in keep)
    values = data.to_kelvin(block.label, predicted_change(replace(block, names=own), fit.solution))
    return float(np.sqrt(np.mean(values[data.is_compared[block.label]] ** 2)))


def _is_camera_error(p: ParameterId) -> bool:
    return p.kind in CAMERA_ERROR_KINDS or is_camera_gain(p)
