"""Images that lie far from where they are told to: lined up with what was predicted, before anything is calibrated.

A pixel that crosses the edge of the block changes by kelvins, so no tangent leads back from an image that was turned by
two degrees about its far corner; all that it takes to line it up is the predicted image, moved and turned.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from flashtemp.camera.placement import Place, corner, pivot
from flashtemp.camera.recording import Recording
from flashtemp.discovery.fit import MISFIT
from flashtemp.discovery.nuisances import GROUPS, astray, everything
from flashtemp.discovery.orientation import begun, by_themselves, judged
from flashtemp.discovery.parameters import Kind
from flashtemp.discovery.prediction import Observable, Prediction
from flashtemp.discovery.problem import LIKELY, SEEN, Problem, checked
from flashtemp.discovery.whitening import Data
from flashtemp.errors import FlashtempError

Array = npt.NDArray[np.float64]
Lies = tuple[Place, tuple[float, float]]  # how an image lies, and its shift along u and v in px
LEFT = 0.25  # of a misfit: what lining up leaves of it where nothing else is wrong; a peak of the pressure leaves more
LIKE = 3.0  # standard deviations of what is usual, within which an image may lie otherwise
TURNS = (0.0, -2.0, 2.0)  # of a usual turn: from where one is looked for


def lined_up(problem: Problem, first: list[Prediction]) -> tuple[Problem, list[Prediction]]:
    """The problem with side walls, which alone show an edge, where they clearly lie by the `first` predictions, and the
    first predictions of that.

    An image that leaves nothing over where it is told to be, whatever the shape of the pressure, stays there: turned by
    a degree it would hide a tilt.
    """
    found = dict(_elsewhere(problem, first))
    if not found:
        return problem, first
    data = Data.begin(problem, first)
    told = {view.file: alone for alone, view in by_themselves(problem, data, first) if alone.left_over > MISFIT}
    found = {file: lies for file, lies in found.items() if file in told}
    while found:
        there = _placed(problem, found)
        made = there.run(there.tasks(there.start, everything(there)))
        if any(isinstance(answer, FlashtempError) for answer in made):
            break
        seen = [checked(answer) for answer in made]
        better = {b.label: judged(there, b, there.start) for b in begun(there, data, seen) if b.label in found}
        sure = {file: found[file] for file, alone in better.items() if alone.fits_better_than(told[file])}
        if len(sure) == len(found):
            return there, seen
        found = sure
    return problem, first


def _placed(problem: Problem, found: dict[str, Lies]) -> Problem:
    """The problem with images elsewhere."""
    places = {file: place for file, (place, _) in found.items()}
    shifts = {file: shift for file, (_, shift) in found.items()}
    return replace(problem, places=problem.places | places, shifts=problem.shifts | shifts)


def _elsewhere(problem: Problem, first: Sequence[Prediction]) -> Iterator[tuple[str, Lies]]:
    """Side walls that the predicted picture fits much better elsewhere, and where."""
    for condition, prediction in zip(problem.conditions, first, strict=True):
        for view in condition.views:
            r = view.recording
            if r.view != "sidewall" or not r.registration_sigma_px or min(len(r.u), len(r.v)) < 2:
                continue
            found = _clearly(problem, r, prediction.observables[view.file])
            if found is not None:
                yield view.file, found


def _clearly(problem: Problem, recording: Recording, seen: Observable) -> Lies | None:
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
        left = recording.temperature - seen.values
        known = seen.inside & np.isfinite(left).any(axis=0)
        mean = np.nan_to_num(seen.values.mean(axis=0) - still)
        self.recording = recording
        self.measured: Array = mean[known] + np.nanmean(left[:, known], axis=0)  # frames without a value count for none
        self.predicted = spline_filter(mean, mode="nearest")
        self.u, self.v = (a[known] for a in np.meshgrid(recording.u, recording.v))
        length = problem.case["block.length"]
        self.about, self.corner = pivot(recording, length), corner(recording, length)

    def lies(self, z: Array) -> Lies:
        scale, turn = GROUPS[Kind.SCALE] * z[2], GROUPS[Kind.TURN] * z[3]
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
        centres = self.recording.v, self.recording.u
        pixels = [np.interp(a, c, np.arange(len(c))) for a, c in zip(at, centres, strict=True)]
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
