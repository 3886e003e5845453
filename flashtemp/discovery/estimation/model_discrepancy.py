"""Model discrepancy: smooth relative errors of the model in every view, in space and time, of unknown size.

No mesh and no closure is accurate to a thousandth of the temperature rise, while the 1e5 values of a camera would turn
a common deviation of a millikelvin into strong evidence.  A deviation as smooth and small as a model error is therefore
absorbed by these terms (Kennedy and O'Hagan, J. R. Stat. Soc. B 63, 2001, 425).
"""

from __future__ import annotations

from itertools import product

import numpy as np
import numpy.typing as npt

from flashtemp.camera.recording import Recording
from flashtemp.comparison.campaign import RecordingEntry
from flashtemp.discovery.parameters import ParameterId, ParameterKind
from flashtemp.discovery.prediction.prediction import Observable, Single, flatten_valid_pixels

# of the rise, rms over a view: errors of discretisation and closures (docs: verification); evidence chooses one
LEAST_DISCREPANCY, LARGEST_DISCREPANCY = 1e-3, 3e-3
MAX_DISCREPANCY_ORDER = 3  # half waves at most, along, up, within a repetition and over the repetitions together
TYPICAL_DISCREPANCY = 2e-3  # prior width for pulls


def discrepancy_basis(view: RecordingEntry, predicted: Observable) -> dict[ParameterId, Single]:
    """Columns of a view: products of half waves along and up the image, within and over repetitions, times the rise.

    Weights are such that one prior width for all is a relative rms error of that size; finer waves have less weight.
    """
    r = view.recording
    if r.places is not None:
        return {}
    rise = predicted.values - (r.reflected_degC if r.reflected_degC is not None else float(np.nanmin(predicted.values)))
    x, y = _half_waves(_scale_to_unit(r.u)), _half_waves(_scale_to_unit(r.v))
    inside, between = (_half_waves(t) for t in _relative_times(r))
    up = r.view == "sidewall"
    found = [
        k
        for k in product(range(MAX_DISCREPANCY_ORDER + 1), repeat=4)
        if sum(k) <= MAX_DISCREPANCY_ORDER and (up or not k[1])
    ]
    # a wave in time needs several frames, or several repetitions: without them it equals the constant one
    found = [(m, n, q, s) for m, n, q, s in found if (not q or np.ptp(inside[1])) and (not s or np.ptp(between[1]))]
    weight = np.array([1.0 / (1.0 + sum(k)) for k in found])
    square = [np.mean(x[m] ** 2) * np.mean(y[n] ** 2) * np.mean((inside[q] * between[s]) ** 2) for m, n, q, s in found]
    weight /= np.sqrt(np.sum(weight**2 * square))
    out = {}
    for (m, n, q, s), w in zip(found, weight, strict=True):
        wave = (w * inside[q] * between[s])[:, None, None] * y[n][:, None] * x[m]
        out[ParameterId(ParameterKind.MODEL_DISCREPANCY, (m, n, q, s))] = flatten_valid_pixels(
            rise * wave, predicted.inside
        )
    return out


def _relative_times(r: Recording) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Time of every frame in its repetition, and number of the repetition, both scaled from 0 to 1."""
    inside = np.zeros(r.frames)
    for number in np.unique(r.repetition):
        own = r.repetition == number
        inside[own] = _scale_to_unit(r.time[own])
    return inside, _scale_to_unit(r.repetition.astype(float))


def _scale_to_unit(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Values scaled from 0 to 1; all 0 if they are equal."""
    values = np.asarray(values, float)
    out: npt.NDArray[np.float64] = (values - values[0]) / max(float(values[-1] - values[0]), 1e-12)
    return out


def _half_waves(t: npt.NDArray[np.float64]) -> list[npt.NDArray[np.float64]]:
    return [np.cos(m * np.pi * t) for m in range(MAX_DISCREPANCY_ORDER + 1)]
