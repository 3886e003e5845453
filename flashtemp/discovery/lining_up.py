"""Images that lie far from where they are told to: lined up with what was predicted, before anything is calibrated.

A pixel that crosses the edge of the block changes by kelvins, so no tangent leads back from an image that was turned by
two degrees about its far corner; all that it takes to line it up is the predicted image, moved and turned.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from flashtemp.camera.placement import Place, corner, pivot
from flashtemp.camera.recording import Recording
from flashtemp.discovery.nuisances import USUAL, astray
from flashtemp.discovery.prediction import Observable, Prediction
from flashtemp.discovery.problem import LIKELY, SEEN, Problem

Array = npt.NDArray[np.float64]
LEFT = 0.25  # of a misfit: what lining up leaves of it where nothing else is wrong; a peak of the pressure leaves more
LIKE = 3.0  # standard deviations of what is usual, within which an image may lie otherwise
TURNS = (0.0, -2.0, 2.0)  # of a usual turn: from where one is looked for


def lined_up(problem: Problem, first: Sequence[Prediction]) -> Problem:
    """The problem with side walls, which alone show an edge, where they clearly lie by the `first` predictions."""
    places, shifts = dict(problem.places), dict(problem.shifts)
    for condition, prediction in zip(problem.conditions, first, strict=True):
        for view in condition.views:
            if view.recording.view != "sidewall" or not view.recording.registration_sigma_px:
                continue
            found = _clearly(problem, view.recording, prediction.observables[view.file])
            if found is not None:
                places[view.file], shifts[view.file] = found
    return replace(problem, places=places, shifts=shifts)


def _clearly(problem: Problem, recording: Recording, seen: Observable) -> tuple[Place, tuple[float, float]] | None:
    """How an image lies, with its shift (px), if that and nothing else is wrong with it."""
    from scipy.optimize import least_squares

    image = _Image(problem, recording, seen)
    told = image.misfit(np.zeros(4))
    if not told > SEEN:
        return None
    ends = [least_squares(image.left_and_pulls, [0.0, 0.0, 0.0, turn]) for turn in TURNS]
    best = min(ends, key=lambda end: float(end.cost)).x
    place, shift = image.lies(best)
    pulls = [s / astray(recording, place, axis) for axis, s in enumerate(shift)]
    usual = max(map(abs, (*pulls, *best[2:]))) < LIKE
    return (place, shift) if usual and image.misfit(best) < LEFT * told else None


class _Image:
    """Mean measured rise (pixels,) K and the mean predicted one as pixels see it that lie elsewhere: `z` (4,) holds a
    shift along u and v in px, a scale and a turn in their usual size."""

    def __init__(self, problem: Problem, recording: Recording, seen: Observable):
        from scipy.ndimage import spline_filter

        still = problem.case["ambient.temperature"]
        known = seen.inside & np.isfinite(recording.temperature).all(axis=0)
        self.recording = recording
        self.measured: Array = recording.temperature[:, known].mean(axis=0) - still
        self.predicted = spline_filter(np.nan_to_num(seen.values.mean(axis=0) - still), mode="nearest")
        self.u, self.v = (a[known] for a in np.meshgrid(recording.u, recording.v))
        length = problem.case["block.length"]
        self.about, self.corner = pivot(recording, length), corner(recording, length)

    def lies(self, z: Array) -> tuple[Place, tuple[float, float]]:
        scale, turn = USUAL * z[2:]
        return Place(scale=float(scale), turn=float(turn)), (float(z[0]), float(z[1]))

    def left(self, z: Array) -> Array:
        """What is left (pixels,) K, the rise as much larger or smaller as friction may make it."""
        from scipy.ndimage import map_coordinates

        place, shift = self.lies(z)
        pitch, grown = self.recording.pitch, 1.0 + place.scale
        x = self.corner + (self.u + shift[0] * pitch[0] - self.corner) * grown - self.about[0]
        y = (self.v + shift[1] * pitch[1]) * grown - self.about[1]
        cos, sin = np.cos(place.turn), np.sin(place.turn)
        at = (self.about[1] + y * cos + x * sin, self.about[0] + x * cos - y * sin)
        first = self.recording.v[0], self.recording.u[0]
        pixels = [(a - b) / p for a, b, p in zip(at, first, pitch[::-1], strict=True)]
        rise = map_coordinates(self.predicted, pixels, order=3, mode="nearest", prefilter=False)
        factor = np.clip(self.measured @ rise / max(float(rise @ rise), 1e-300), 1.0 / LIKELY, LIKELY)
        return np.asarray(self.measured - factor * rise)

    def misfit(self, z: Array) -> float:
        """Root mean square of it, K."""
        return float(np.sqrt(np.mean(self.left(z) ** 2))) if self.measured.size else 0.0

    def left_and_pulls(self, z: Array) -> Array:
        """What is left in units of what is seen, and by how many standard deviations the image lies otherwise."""
        place, shift = self.lies(z)
        pulls = [s / astray(self.recording, place, axis) for axis, s in enumerate(shift)]
        return np.concatenate([self.left(z) / SEEN, pulls, z[2:]])
