"""Image registration: one small shift per recording, by Gauss-Newton with exact resampling."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flashtemp.camera.prediction.observation import PredictedImage, observe
from flashtemp.camera.recording import Recording

SHIFT_DERIVATIVES = ("shift_u", "shift_v")  # keys of `PredictedImage.slopes`
MAX_SHIFT_SDS = 3.0  # prior standard deviations: a larger shift has another cause and is not applied


@dataclass(frozen=True)
class Alignment:
    """Shift of an image along u and v in px with its standard errors, and the image predicted with it.

    `refused` (px): the best-fitting shift if it contradicts the stated origin; then none is applied.
    """

    shift: tuple[float, float]
    error: tuple[float, float]
    seen: PredictedImage
    refused: tuple[float, float] | None = None


def align_image(run, scene, recording: Recording, plain: PredictedImage, weigh, known: float) -> Alignment:
    """Shift with which a run explains a recording best, under a Gaussian prior of `known` px (standard deviation).

    `plain` is the image predicted without shift, which is returned where none applies.  `weigh(residual)` divides
    residuals (frames, nv, nu) K by their noise.  A single row of pixels cannot be shifted across itself.  Nor is the
    wake shifted along y, because only its edges depend on that and they are left out.
    """
    axes = [a for a, n in enumerate((len(recording.u), len(recording.v))) if n > 1 and recording.places is None]
    if recording.view == "wake":
        axes = [a for a in axes if a == 0]
    shift = np.zeros(2)
    acting = scene.acting
    if known <= 0.0 or not axes:
        return Alignment((0.0, 0.0), (0.0, 0.0), plain)
    seen = observe(run, scene, recording, acting, slopes=True)
    for _ in range(8):
        residual = _weighted_column(weigh, recording.temperature - seen.temperature, seen)
        J = np.stack([_weighted_column(weigh, seen.slopes[SHIFT_DERIVATIVES[a]], seen) for a in axes], axis=1)
        good = np.isfinite(residual)
        normal = J[good].T @ J[good] + np.eye(len(axes)) / known**2
        step = np.linalg.solve(normal, J[good].T @ residual[good] - shift[axes] / known**2)
        # an image is linear over less than a pixel at an edge
        step = np.clip(step, -1.0, 1.0)
        shift[axes] += step
        seen = observe(run, scene, recording, acting, shift, slopes=True)
        if np.abs(step).max() < 1e-6:
            break
    if np.abs(shift).max() > MAX_SHIFT_SDS * known:
        return Alignment((0.0, 0.0), (0.0, 0.0), plain, _as_pair(shift))
    error = np.zeros(2)
    error[axes] = np.sqrt(np.diag(np.linalg.inv(normal)))
    return Alignment(_as_pair(shift), _as_pair(error), seen)


def _as_pair(values: np.ndarray) -> tuple[float, float]:
    return float(values[0]), float(values[1])


def _weighted_column(weigh, values: np.ndarray, seen: PredictedImage) -> np.ndarray:
    """Residuals or slopes (frames, nv, nu) K as one column over their noise, NaN at the edge of a body."""
    return weigh(np.where(seen.inside, values, np.nan)).ravel()
