"""How large the errors of real cameras came out in each recording, for people."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flashtemp.discovery.estimation.linear_gaussian import Block, predicted_change
from flashtemp.discovery.estimation.linearised_fit import Fit
from flashtemp.discovery.estimation.nuisance_priors import is_camera_gain
from flashtemp.discovery.estimation.whitening import Data
from flashtemp.discovery.parameters import OF_THE_CAMERA, Kind, ParameterId

CALLED = {
    Kind.OFFSET: "offset in time",
    Kind.STATIC: "static map",
    Kind.MAP: "gain map",
    Kind.OPTICS: "smear and stray light",
}
TOLD_K = 5e-3  # rms below which an error of a camera is not worth a word


def unusual_camera_errors(data: Data, fit: Fit) -> tuple[str, ...]:
    """One line for each recording in which a fit found errors of the camera, with their rms in K."""
    out = []
    for block in fit.blocks:
        sizes = {kind: _size(data, fit, block, kind) for kind in CALLED}
        parts = [f"{CALLED[kind]} {size:.2g} K" for kind, size in sizes.items() if size > TOLD_K]
        if parts:
            out.append(f"{block.label}: errors of the camera were calibrated (rms): {', '.join(parts)}")
    return tuple(out)


def _size(data: Data, fit: Fit, block: Block, kind: Kind) -> float:
    """Root mean square (K) of what the columns of one family add to a recording."""
    keep = {p for p in fit.solution.names if p.kind is kind and p.file == block.label and _of_a_camera(p)}
    if not keep:
        return 0.0
    own = tuple((p, column) for p, column in block.names if p in keep)
    values = data.kelvin(block.label, predicted_change(replace(block, names=own), fit.solution))
    known = data.known[block.label]
    return float(np.sqrt(np.mean(values[known] ** 2)))


def _of_a_camera(p: ParameterId) -> bool:
    return p.kind in OF_THE_CAMERA or is_camera_gain(p)
