"""Recordings that are mirrored: found by the evidence of each alone, and turned round.

A profile that rises where it should fall may as well be physics, a peak of pressure for one.  So both ways are given
the same freedom, pressure of any shape included, and the mirrored one must leave next to nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flashtemp.camera.recording import Recording
from flashtemp.comparison.campaign import View
from flashtemp.discovery.fit import Fit
from flashtemp.discovery.hypothesis import Model
from flashtemp.discovery.linear_gaussian import Block, System
from flashtemp.discovery.nuisances import everything
from flashtemp.discovery.prediction import Observable, Prediction
from flashtemp.discovery.problem import CLEARLY, Problem, misfit, with_views
from flashtemp.discovery.scales import solved
from flashtemp.discovery.whitening import Data
from flashtemp.errors import FlashtempError

WAYS = {"mirrored": (2,), "upside down": (1,), "turned by 180 degrees": (1, 2)}
ODD = 3.0  # standard errors of chi2 that are left over, from which an image that looks mirrored is tried
SURE = 50.0  # ln Bayes factor that a mirrored image needs
ALIKE = 3.0  # one that is of the same view as a mirrored image: a camera is set up, and its images exported, once


@dataclass(frozen=True)
class Turned:
    """A recording taken as mirrored: `view` set right, `ln_bayes` against the image as told, chi2 per value of both."""

    view: View
    ln_bayes: float
    chi2_told: float
    chi2: float

    @property
    def words(self) -> str:
        return f"{self.view.file} is mirrored: leading and trailing end are exchanged"


def mirrored(recording: Recording, length: float) -> Recording:
    """The recording with its ends exchanged: x becomes L - x; behind a block, pixels change order along the road."""
    T = np.ascontiguousarray(recording.temperature[:, :, ::-1])
    about = length if recording.view != "wake" else recording.u[0] + recording.u[-1]
    return replace(recording, temperature=T, u=np.ascontiguousarray((about - recording.u)[::-1]))


def in_doubt(problem: Problem, first: Sequence[Prediction]) -> bool:
    """Whether any recording, by the first predictions, may as well be mirrored."""
    shown = {file: o for made in first for file, o in made.observables.items()}
    images = (v for v in problem.campaign.views if v.recording.places is None)
    return any(_may_be_so(problem, v, shown[v.file]) for v in images)


def turned_round(problem: Problem, data: Data, first: Sequence[Prediction], odd: float = ODD) -> tuple[Turned, ...]:
    """Recordings that are clearly mirrored, by the first predictions and others of the images turned round; and those
    of the same views that rather are than not.  Tried are those of which alone more than `odd` standard errors are
    left over."""
    shown = {file: o for made in first for file, o in made.observables.items()}
    images = list(by_themselves(problem, data, first))
    suspects = [(a, v) for a, v in images if a.left_over > odd and _may_be_so(problem, v, shown[v.file])]
    ways = _both_ways(problem, data, suspects)
    views = {w.view.recording.view for w in ways if w.sure}
    asked = {w.view.file for w in ways}
    more = [(a, v) for a, v in images if v.recording.view in views and v.file not in asked]
    ways += _both_ways(problem, data, more)
    return tuple(w.as_turned(problem) for w in ways if w.sure or (w.view.recording.view in views and w.gain > ALIKE))


@dataclass(frozen=True)
class BothWays:
    """A recording `alone` as told, and `turned` round."""

    view: View
    alone: Alone
    turned: Alone

    @property
    def gain(self) -> float:
        """ln Bayes factor of its being mirrored."""
        return self.turned.ln_evidence - self.alone.ln_evidence

    @property
    def sure(self) -> bool:
        """Whether it is mirrored whatever others are."""
        return self.turned.fits_better_than(self.alone)

    def as_turned(self, problem: Problem) -> Turned:
        """It set right."""
        right = replace(self.view, recording=mirrored(self.view.recording, problem.case["block.length"]))
        return Turned(right, self.gain, 1.0 + self.alone.excess, 1.0 + self.turned.excess)


def _both_ways(problem: Problem, data: Data, suspects: Sequence[tuple[Alone, View]]) -> list[BothWays]:
    """Suspects and what they are turned round; what cannot be predicted so is not the other way round."""
    others = [_other_way(problem, view) for _, view in suspects]
    tasks = [task for other in others for task in other.tasks(problem.start, everything(other))]
    found = []
    for (alone, view), other, made in zip(suspects, others, problem.run(tasks) if tasks else (), strict=True):
        if not isinstance(made, FlashtempError):
            [block] = begun(other, data, [made])
            found.append(BothWays(view, alone, judged(other, block, other.start)))
    return found


@dataclass(frozen=True)
class Alone:
    """One recording by itself against a model with all its freedom: what is left, chi2 per value less one."""

    block: Block
    ln_evidence: float
    excess: float

    @property
    def left_over(self) -> float:
        """What no calibration explains, in standard errors of chi2."""
        return float(self.excess * np.sqrt(self.block.count / 2.0))

    def fits_better_than(self, other: Alone) -> bool:
        return self.excess < CLEARLY * other.excess and self.ln_evidence > other.ln_evidence + SURE


def other_ways(problem: Problem, data: Data, fit: Fit) -> Iterator[tuple[str, str, float]]:
    """Every image turned over: its file, the way in words, and the ln Bayes factor of it alone; pixels keep places.

    Raises SolverFailure.
    """
    predictions = problem.predictions(problem.tasks(fit.model, everything(problem)))
    told = {b.label: judged(problem, b, fit.model) for b in begun(problem, data, predictions)}
    for words, axes in WAYS.items():
        views = [
            replace(v, recording=replace(v.recording, temperature=np.flip(v.recording.temperature, axes)))
            for v in problem.campaign.views
            if v.recording.places is None and (v.recording.view == "sidewall" or axes == (2,))
        ]
        flipped = with_views(problem, views)
        files = {v.file for v in views}
        for block in begun(flipped, data, predictions):
            if block.label in files:
                gain = judged(problem, block, fit.model).ln_evidence - told[block.label].ln_evidence
                yield block.label, words, gain


def begun(problem: Problem, data: Data, predictions: Sequence[Prediction]) -> list[Block]:
    """Blocks of other images with the noise that is known: what of them is compared may differ."""
    return Data.begin(problem, predictions, noises=data.noises).blocks(predictions)


def judged(problem: Problem, block: Block, model: Model) -> Alone:
    """One block by itself, one held out too: how a camera stood is no claim about heat."""
    solution = solved(problem, System([replace(block, held_out=False)]), model, {}, cameras=False).solution
    return Alone(block, solution.ln_evidence, solution.chi2 / max(block.count, 1) - 1.0)


def by_themselves(problem: Problem, data: Data, first: Sequence[Prediction]) -> Iterator[tuple[Alone, View]]:
    """Images, each by itself."""
    views = {v.file: v for v in problem.campaign.views if v.recording.places is None}
    for block in data.blocks(first):
        if block.label in views:
            yield judged(problem, block, problem.start), views[block.label]


def _may_be_so(problem: Problem, view: View, seen: Observable) -> bool:
    """Whether a run has to tell how a recording looks with its ends exchanged: unless it, as much warmer as friction
    may make it, is clearly nearer to the picture predicted as told."""
    from scipy.interpolate import interp1d

    told, still = view.recording, problem.case["ambient.temperature"]
    if len(told.u) < 2:
        return True
    turned, rise = mirrored(told, problem.case["block.length"]), seen.values - still
    there = interp1d(told.u, np.where(seen.inside, rise, np.nan), bounds_error=False)(turned.u)
    other = misfit(turned.temperature - still, there, np.isfinite(there))
    return not np.isfinite(other) or misfit(told.temperature - still, rise, seen.inside) > CLEARLY * other


def _other_way(problem: Problem, view: View) -> Problem:
    """The problem of one recording alone, turned round."""
    right = replace(view, recording=mirrored(view.recording, problem.case["block.length"]))
    number = next(n for n, c in enumerate(problem.conditions) if any(v.file == view.file for v in c.views))
    condition = replace(problem.conditions[number], views=(right,), forces=())
    return replace(
        problem, conditions=(condition,), pins=(problem.pins[number],),
        campaign=replace(problem.campaign, views=(right,), forces=()),
    )  # fmt: skip
