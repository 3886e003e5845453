"""Residuals of the first predictions after a smooth fit, and rejection of pixels and lines with camera defects.

Used before the first fit, so that every hypothesis is compared with the same pixels and the same noise.  Lines are
rejected before recordings are tested too: a line that flickers is a defect whatever the recording shows, and a
hypothesis that moves it out of sight would seem better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from flashtemp.camera.image_screening import find_flickering_lines, find_outlying_pixels, temporal_noise
from flashtemp.comparison.campaign import RecordingEntry
from flashtemp.discovery.estimation.model_discrepancy import discrepancy_basis
from flashtemp.discovery.estimation.nuisance_priors import camera_smooth_basis
from flashtemp.discovery.prediction.prediction import Observable, Prediction
from flashtemp.discovery.prediction.problem import Problem, replace_views
from flashtemp.display import format_count

Array = npt.NDArray[np.float64]
RIDGE_FRACTION = 1e-6  # of the largest product of columns: bounds the coefficients of nearly dependent columns


def calibrated_residual(view: RecordingEntry, predicted: Observable) -> Array:
    """Measured minus predicted (frames, nv, nu) K after a least-squares fit of all sensitivities and of the model
    discrepancy; NaN where not compared.

    The fit has no priors: it only removes the smooth part that a calibration will explain.
    """
    left: Array = np.where(predicted.inside, view.recording.temperature - predicted.values, np.nan)
    known = np.isfinite(left[:, predicted.inside])
    shapes = predicted.columns | camera_smooth_basis(view, predicted) | discrepancy_basis(view, predicted)
    columns = [c[known].astype(float) for c in shapes.values()]
    if view.recording.places is not None or not columns or known.sum() < 2 * len(columns):
        return left
    C = np.stack(columns, axis=1)
    # columns of unit rms, so that one ridge bounds all nearly dependent ones alike
    C /= np.maximum(np.sqrt(np.mean(C**2, axis=0)), 1e-12)
    inside = left[:, predicted.inside]
    square = C.T @ C
    square[np.diag_indices_from(square)] += RIDGE_FRACTION * float(square.diagonal().max())
    inside[known] -= C @ np.linalg.solve(square, C.T @ inside[known])
    left[:, predicted.inside] = inside
    return left


def reject_outliers(problem: Problem, first: Sequence[Prediction], lines_only: bool = False) -> Problem:
    """The problem without lines of images that flicker and pixels whose residuals are outliers among their neighbours.

    `lines_only`: pixels are kept, because predictions may be those of another view than the recording shows.
    """
    views, found = [], dict(problem.screening)
    for condition, prediction in zip(problem.conditions, first, strict=True):
        for view in condition.views:
            if view.recording.places is not None:
                continue
            left = calibrated_residual(view, prediction.observables[view.file])
            sigma = temporal_noise(view.recording.temperature)
            # lines first: every pixel of a flickering line would stand out by itself
            rows, columns = (find_flickering_lines(left, axis, sigma) for axis in (1, 2))
            left[:, list(rows)], left[:, :, list(columns)] = np.nan, np.nan
            bad = np.zeros(left.shape[1:], bool) if lines_only else find_outlying_pixels(left)
            also = [(len(rows), "flickering row"), (len(columns), "flickering column"),
                    (int(bad.sum()), "outlying pixel")]  # fmt: skip
            bad[list(rows)], bad[:, list(columns)] = True, True
            if bad.any():
                T = np.where(bad, np.nan, view.recording.temperature)
                views.append(replace(view, recording=replace(view.recording, temperature=T)))
                said = "left out " + ", ".join(format_count(n, what) for n, what in also if n)
                found[view.file] = "; ".join(filter(None, (found.get(view.file, ""), said)))
    return replace(replace_views(problem, views), screening=found) if views else problem
