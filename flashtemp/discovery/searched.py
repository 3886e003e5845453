"""The believed model at its best point, and what a search keeps of everything that it tried."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from flashtemp.discovery import adequacy
from flashtemp.discovery.calibration import Descent
from flashtemp.discovery.first_residuals import reject_outliers
from flashtemp.discovery.fit import Fit
from flashtemp.discovery.held_keys import HeldKey
from flashtemp.discovery.hypothesis import Candidate, Model
from flashtemp.discovery.laboratory import LabError
from flashtemp.discovery.lining_up import lined_up
from flashtemp.discovery.nuisances import everything
from flashtemp.discovery.orientation import ODD, Turned, in_doubt, turned_round
from flashtemp.discovery.parameters import Kind, ParameterId
from flashtemp.discovery.prediction import Derivatives, Prediction
from flashtemp.discovery.problem import Problem, strangers, with_views, without
from flashtemp.discovery.rounds import FAR, Watch, advance, descend
from flashtemp.discovery.scores import Score
from flashtemp.discovery.starts import chi2, misfits, worst
from flashtemp.discovery.whitening import Data
from flashtemp.errors import BadInput, SolverFailure

NAMED, WEAK = 8.0, 5.0  # ln Bayes factors: of a named cause, and of a hint
APART = 5.0  # ln Bayes factor below which two explanations cannot be told apart: one of 150 is the wrong one above it
MORE = 3.0  # ln Bayes factor that more freedom has to bring
SIMILAR = 0.4  # of the best score: what is refitted beside it
HOPELESS = 40.0  # behind the best: a refit goes no further
IDLE = "ends where it does nothing"  # why a full fit is no rival
LONGER = 0.02  # share of the length by which the first looks take the block longer and shorter than told
LENGTHS = (0.5, 1.5, 2.0)  # times that: the further looks on the side that fits better
STRAINED = {Kind.SHIFT_U: 3.0, Kind.SHIFT_V: 3.0, Kind.SIZE: 0.8}  # standard deviations by which a first look moves it
COARSE = ((0.6, 1, 1), (1, 0.6, 1), (1, 1, 0.6), (0.5, 0.5, 0.5))  # cells of runs that tell what the mesh gets wrong
ACROSS = (1, 1, 1, 0.5)  # and in 3D
Ranking = tuple[Score, ...]


@dataclass(frozen=True)
class Calibrated:
    """The believed model `base` at its best point; `refused` {recording: why it was left out}, `mirrored` recordings
    that were turned round."""

    problem: Problem
    data: Data
    base: Fit
    refused: dict[str, str]
    mirrored: tuple[Turned, ...] = ()


@dataclass(frozen=True)
class Search:
    """What was tried: `base` calibrated, `best` extended, both with traces of all candidates.

    `fits` {effects: fit} of every refit; `ranking` the candidates' scores at the base and at every extension;
    `refused` {recording: why}; `failed` why the last fit failed that came to nothing; `asked` {effects: ln Bayes factor
    by trace} of every full fit that was begun, `ended` {effects: why} of those that came to nothing.  Put right beside
    the effects: `mirrored` recordings, errors of the `laboratory`, the `held_key` that was freed; `keys` held.
    """

    problem: Problem
    data: Data
    refused: dict[str, str]
    base: Fit
    best: Fit
    fits: dict[frozenset[str], Fit]
    ranking: tuple[Ranking, ...] = ()
    failed: str = ""
    asked: dict[frozenset[str], float] = field(default_factory=dict)
    ended: dict[frozenset[str], str] = field(default_factory=dict)
    mirrored: tuple[Turned, ...] = ()
    laboratory: tuple[LabError, ...] = ()
    held_key: HeldKey | None = None
    keys: tuple[HeldKey, ...] = ()

    @property
    def open_ends(self) -> dict[frozenset[str], float]:
        """Groups of effects that their traces speak for and that no full fit has judged, with ln Bayes factors."""
        return {
            names: gain
            for names, gain in self.asked.items()
            if gain > NAMED * len(names)
            and self.ended.get(names) not in (FAR, IDLE)
            and not (names in self.fits and self.fits[names].usable)
        }

    @property
    def unsettled(self) -> dict[frozenset[str], float]:
        """Groups of effects whose full fits did not come to an end and yet explain more than the best, with by how
        much (ln Bayes factor)."""
        gains = {names: f.ln_evidence - self.best.ln_evidence for names, f in self.fits.items() if not f.usable}
        return {names: gain for names, gain in gains.items() if gain > MORE}

    @property
    def extended(self) -> list[Fit]:
        """Fits that hold more effects than the present best and are near their best point."""
        return [f for k, f in self.fits.items() if len(k) > len(self.best.model.effects) and f.usable]

    @property
    def own(self) -> list[Candidate]:
        """Candidates that the present best holds."""
        return held(self.problem, self.best.model)

    def start(self, model: Model, effects: Sequence[Candidate], rough: bool = True) -> Descent:
        return Descent(self.problem, self.data, model, tuple(effects), rough=rough)

    def onward(self, rough: bool = True) -> Descent:
        """The present best on its way, from where it stands with the traces that are there."""
        return self.start(self.best.model, self.own, rough).linearised(self.best.system, self.best.predictions)


def held(problem: Problem, model: Model) -> list[Candidate]:
    """Candidates that a model holds."""
    return [c for c in problem.tried if c.effect in model.effects]


# --- calibration -------------------------------------------------------------------------------------
def calibrate(problem: Problem, watch: Watch = lambda text: None) -> Calibrated:
    """The base model at its best point, with traces of all nuisances.  Raises BadInput, SolverFailure.

    Images that may be mirrored and leave nothing over by themselves are turned round where all leave a little over.
    """
    watch("calibrating the model that is believed")
    first = _first(problem)
    refused = strangers(problem, first)
    if refused:
        problem, (first,) = without(problem, [first], refused)
        if not problem.campaign.views:  # load cells alone would find nothing wrong
            raise BadInput(*(f"{file}: {why}" for file, why in refused.items()))
    problem = reject_outliers(problem, first)
    mirrored = turned_round(problem, Data.begin(problem, first), first)
    doubt = not mirrored and in_doubt(problem, first)
    if mirrored:
        problem = with_views(problem, [m.view for m in mirrored])
        first = _first(problem)
    while True:
        found, first = lined_up(problem, first)
        data = Data.begin(found, first, _coarser(found))
        begun = Descent(found, data, found.start).take(first)
        del first  # columns of all pixels
        fit = _best_point(begun, watch)
        turned = doubt and not fit.hopeless and max(fit.excess.values()) > ODD
        if turned:
            first, doubt = _first(problem), False
            mirrored = turned_round(problem, Data.begin(problem, first), first, -np.inf)
        if not (turned and mirrored):
            return Calibrated(found, data, fit, refused, mirrored)
        problem = with_views(problem, [m.view for m in mirrored])
        first = _first(problem)


def _first(problem: Problem) -> list[Prediction]:
    """Predictions of the case as it is believed, with traces of all nuisances."""
    return problem.predictions(problem.tasks(problem.start, everything(problem)))


def _coarser(problem: Problem) -> list[list[Prediction]]:
    """Predictions of the same on coarser meshes."""
    cells = (*COARSE, ACROSS) if problem.case["numerics.across"] > 1 else COARSE
    tasks = [task for c in cells for task in problem.tasks(problem.start, Derivatives(), c)]  # at once: for all workers
    answers, count = problem.predictions(tasks), len(problem.conditions)
    return [answers[k : k + count] for k in range(0, len(answers), count)]


def _best_point(begun: Descent, watch: Watch) -> Fit:
    """The base model at its best point.  Raises SolverFailure."""
    watch("going to the best point of it")
    looked = _astray(begun)
    if looked:
        begun = _by_length(begun)
    [end] = descend(begun.problem, [begun], watch, HOPELESS)
    if end.fit is None:
        raise SolverFailure(end.failed)
    if not looked and _bent(end.fit):
        end = _other_length(end, watch)
    assert end.fit is not None
    return end.fit


def _by_length(begun: Descent) -> Descent:
    """Begun at the length of the block that fits the condition best that misfits most: images show its trailing edge
    within a pixel or two, and no tangent tells which way it is farther off."""
    problem, data, fit = begun.problem, begun.data, begun.fit
    assert fit is not None
    if problem.case["schedule.alone"]:
        return begun

    def left(shares: Iterable[float]) -> dict[float, float]:
        models = {share: _longer(fit.model, share) for share in shares}
        return dict(zip(models, misfits(problem, data, fit, list(models.values())), strict=True))

    found = left((-LONGER, LONGER))
    way = min(found, key=lambda share: found[share])
    if chi2(problem, fit, worst(problem, fit)) - found[way] < 2.0 * HOPELESS:
        return begun
    found |= left(times * way for times in LENGTHS)
    best = _longer(fit.model, min(found, key=lambda share: found[share]))
    return Descent(problem, data, best).take(problem.predictions(problem.tasks(best, everything(problem))))


def _other_length(end: Descent, watch: Watch) -> Descent:
    """The best point of a model from a block longer or shorter than told, where that has more evidence: an edge of an
    image may be held by the wrong end, and then no step leads away."""
    problem = end.problem
    if problem.case["schedule.alone"]:
        return end
    starts = [Descent(problem, end.data, _longer(problem.start, share)) for share in (-LONGER, LONGER)]
    better = [d for d in advance(problem, starts) if _evidence(d) > _evidence(end)]
    return max((end, *descend(problem, better, watch, HOPELESS)), key=_evidence)


def _longer(model: Model, share: float) -> Model:
    return replace(model, sizes={"block.length": share})


def _evidence(end: Descent) -> float:
    return -np.inf if end.fit is None else end.fit.ln_evidence


def _astray(begun: Descent) -> bool:
    """Whether a model misfits grossly at its first look, or moves images or edges far."""
    assert begun.fit is not None
    return begun.fit.hopeless or _strained(begun.fit)


def _bent(fit: Fit) -> bool:
    """Whether a camera or the model's own error has to be farther from what is usual than it is likely to be."""
    return any(abs(v) > adequacy.PULL for p, v in adequacy.pulls(fit).items() if p.kind is not Kind.KEY)


def _strained(fit: Fit) -> bool:
    """Whether a first look moves an image, or an edge of the block, farther than it is likely to be off."""
    return any(
        abs(fit.solution[p]) > STRAINED[p.kind] * fit.priors[p][1] for p in fit.solution.names if p.kind in STRAINED
    )


def traced(
    problem: Problem, data: Data, fit: Fit, watch: Watch, keys: tuple[ParameterId, ...] = (),
    among: Sequence[Candidate] | None = None,
) -> Fit:  # fmt: skip
    """A fit as near to its best point as it was, with the traces of all candidates (or `among` some) that it does not
    hold, and of `keys` that are held.  Raises BadInput, SolverFailure.
    """
    watch("traces of the candidate effects")
    others = tuple(c for c in (problem.tried if among is None else among) if c.effect not in fit.model.effects)
    descent = Descent(
        problem, data, fit.model, tuple(held(problem, fit.model)), Derivatives(candidates=others, held=keys)
    )
    found = descent.take(problem.predictions(descent.tasks())).fit
    assert found is not None  # a first step never goes back
    return replace(found, vain=fit.vain, noisy=fit.noisy)


def all_traces(search: Search) -> Fit:
    """The present best with the traces of all candidates: those that explain nothing here may elsewhere."""
    return traced(search.problem, search.data, search.best, lambda text: None)
