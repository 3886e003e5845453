"""Where images lie, solved to convergence on predicted fields, without simulating anything again.

Place, scale, turn and clock of an image, and place and time constant of a thermocouple, change what is seen of a
temperature field but not the field.  With the physics fixed they are found by Gauss-Newton steps on images predicted
anew from the same fields: the inner loop of variable projection (Golub and Pereyra, Inverse Problems 19, 2003, R1).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flashtemp.discovery.estimation.hyperparameters import Hyperparameters, at_hyperparameters
from flashtemp.discovery.estimation.linear_gaussian import Array, System
from flashtemp.discovery.estimation.nuisance_priors import nuisance_priors
from flashtemp.discovery.estimation.trust_region import Quadratic, TrustRegion
from flashtemp.discovery.estimation.whitening import Data
from flashtemp.discovery.hypotheses.candidates import Model
from flashtemp.discovery.parameters import BEADS, PLACED, SHIFTS, Kind, ParameterId, Priors
from flashtemp.discovery.prediction.prediction import LAG, Prediction, Task, observe_again
from flashtemp.discovery.prediction.problem import Problem
from flashtemp.errors import FlashtempError, SolverFailure

MAX_ALIGNMENTS = 8  # images predicted again per simulation; two or three as a rule
NEGLIGIBLE_GAIN = 0.1  # ln evidence: no decision turns on less
FIXED_SD = 1e-6  # of what stands still in a solution of all unknowns, relative: nothing moves it, nothing overflows
# Scale of a step of each kind: the contrast at an edge bends over a pixel, fields are kept within LAG of a frame
STEP_SCALE = {
    Kind.SHIFT_U: 0.5, Kind.SHIFT_V: 0.5, Kind.SCALE: 0.01, Kind.TURN: 0.01, Kind.CLOCK: 0.5 * LAG, Kind.PLACE: 2.5e-4,
    Kind.LAG: 0.25,
}  # fmt: skip


@dataclass(frozen=True)
class Linearisation:
    """A model with what it predicts and the linearised `system` there; `tasks` that made the predictions."""

    model: Model
    tasks: tuple[Task, ...]
    predictions: tuple[Prediction, ...]
    system: System

    def bare(self) -> Linearisation:
        """The same without the fields of the runs."""
        return replace(self, predictions=tuple(p.bare for p in self.predictions))


def image_parameters(system: System) -> tuple[ParameterId, ...]:
    """Parameters of images and sensors that a system has columns for, each recording's own."""
    own = (*SHIFTS, *PLACED)
    return tuple(p for p in system.names if p.kind in BEADS or (p.kind in own and p.file))


def align_images(
    problem: Problem, data: Data, at: Linearisation, hyper: Hyperparameters, fixed: frozenset[ParameterId]
) -> Linearisation:
    """Images where the data want them with the physics (`fixed` parameters) as it is.  Raises SolverFailure."""
    marched, region = at.model, TrustRegion()
    value = objective(problem, at, hyper, fixed, every=True)
    for _ in range(MAX_ALIGNMENTS):
        names, model = _quadratic(problem, at, hyper, fixed, marched)
        if model.reduction(model.best_step()) < NEGLIGIBLE_GAIN:
            break
        scale = step_scale(names)
        step = _of_promising_images(names, model, region.step(model, scale))
        if not step.any():
            break
        trial = _seen_again(problem, data, at, moved_images(at.model, dict(zip(names, step.tolist(), strict=True))))
        there = objective(problem, trial, hyper, fixed, every=True)
        ratio = (value - there) / max(model.reduction(step), 1e-300)
        region = region.after(ratio, step, scale)
        if ratio > 0.0:
            at, value = trial, there
    return at


def _of_promising_images(names: Sequence[ParameterId], model: Quadratic, step: Array) -> Array:
    """A step without images that promise less than their share of what is negligible: they are not predicted again."""
    promised = step * (model.gradient - 0.5 * model.hessian @ step)  # adds up to the reduction by the step
    files = [p.file for p in names]
    gains = dict.fromkeys(files, 0.0)
    for file, gain in zip(files, promised.tolist(), strict=True):
        gains[file] += gain
    moves = np.array([gains[file] > NEGLIGIBLE_GAIN / len(gains) for file in files], bool)
    return np.where(moves, step, 0.0)


def objective(
    problem: Problem, at: Linearisation, hyper: Hyperparameters, fixed: frozenset[ParameterId], every: bool = False
) -> float:
    """Half of chi2 of data and priors at a point: physics and images stand still, all else is at its optimum.

    Priors of `fixed` parameters of the physics are not counted.  `every` datum counts, or those that are fitted.
    """
    images = image_parameters(at.system)
    free = _nuisance_priors(problem, at, hyper, fixed)
    total = at.system.total((lambda b: True) if every else None, hyper.variances)
    found = at.system.solve(free, total)
    mean, precision = _image_prior(problem, at, images)
    return 0.5 * (found.chi2 + float(mean @ precision @ mean))


def step_beyond_fields(
    problem: Problem, at: Linearisation, hyper: Hyperparameters, fixed: frozenset[ParameterId], region: TrustRegion
) -> tuple[float, float, dict[ParameterId, float]]:
    """What images still promise if the fields were of any time, what a step within a region promises, and that step.

    Alignment has clocks no farther than LAG from those of the run: beyond that the campaign is simulated anew.
    """
    names, model = _quadratic(problem, at, hyper, fixed)
    step = region.step(model, step_scale(names))
    return model.reduction(model.best_step()), model.reduction(step), dict(zip(names, step.tolist(), strict=True))


def step_scale(names: Iterable[ParameterId]) -> Array:
    """Scales (k,) of steps of images' parameters."""
    return np.array([STEP_SCALE[p.kind] for p in names])


def _quadratic(
    problem: Problem, at: Linearisation, hyper: Hyperparameters, fixed: frozenset[ParameterId],
    marched: Model | None = None,
) -> tuple[tuple[ParameterId, ...], Quadratic]:  # fmt: skip
    """The objective to second order in what images and sensors do; clocks within reach of the model `marched`."""
    images = image_parameters(at.system)
    free = _nuisance_priors(problem, at, hyper, fixed)
    keep = at.system.total(lambda b: True, hyper.variances)  # cameras of data that are held out stand somewhere too
    found = at.system.projected(free, list(images), keep)
    mean, precision = _image_prior(problem, at, images)
    limits = [_clock_limits(p, at.model, marched) for p in images]
    low, high = (np.array([limit[i] for limit in limits]) for i in (0, 1))
    return images, Quadratic(found.score + precision @ mean, found.information + precision, low, high)


def _nuisance_priors(
    problem: Problem, at: Linearisation, hyper: Hyperparameters, fixed: frozenset[ParameterId]
) -> Priors:
    """Priors of everything linear but what images and sensors do."""
    priors = at_hyperparameters(problem, at.system, at.model, hyper, {})
    moving = (*SHIFTS, *PLACED, *BEADS)
    return {p: v for p, v in priors.items() if p not in fixed and p.kind not in moving}


def _image_prior(problem: Problem, at: Linearisation, images: tuple[ParameterId, ...]) -> tuple[Array, Array]:
    """Means (k,), as seen from a point, and precision (k, k) of images' parameters: each its own error, and one that
    all images of a view share."""
    views = {v.file: v.recording.view for v in problem.campaign.views}
    priors = nuisance_priors(problem, at.system.names, at.model)
    mean, sd = (np.array([priors[p][i] for p in images]) for i in (0, 1))
    covariance = np.diag(sd**2)
    for p in priors:
        if p.kind in PLACED and not p.file:
            own = [i for i, q in enumerate(images) if q.kind is p.kind and q.file and views[q.file] == p.name]
            covariance[np.ix_(own, own)] += priors[p][1] ** 2
    return mean, np.linalg.inv(covariance)


def image_steps(
    problem: Problem, system: System, nuisances_there: Priors, steps: Mapping[ParameterId, float],
    hyper: Hyperparameters,
) -> dict[ParameterId, float]:  # fmt: skip
    """How far images move, by the linearised model, when the physics takes given `steps`.

    Images of data that are held out stay: data that are fitted would have them where they are stated to lie.
    """
    fixed = {p: (step, FIXED_SD * max(abs(step), FIXED_SD)) for p, step in steps.items()}
    found = system.solve(nuisances_there | fixed, system.total(variances=hyper.variances))
    views = {v.file: v.recording.view for v in problem.campaign.views}
    out, seen = {}, system.seen
    for p in image_parameters(system):
        parts = {p, replace(p, file="", name=views[p.file])} if p.kind in PLACED else {p}
        out[p] = sum(found[q] for q in parts if q in found.names) if p in seen else 0.0
    return out


def moved_images(model: Model, steps: Mapping[ParameterId, float]) -> Model:
    """The model with its images and sensors moved."""
    for p, step in steps.items():
        if p.kind in SHIFTS:
            shift = list(model.shift(p.file))
            shift[p.axis] += step
            model = replace(model, shifts=model.shifts | {p.file: (shift[0], shift[1])})
        else:
            model = model.moved(p, step)
    return model


def _clock_limits(p: ParameterId, model: Model, marched: Model | None) -> tuple[float, float]:
    """How far a clock may step down and up: fields were kept within LAG of the one that the run was made for."""
    if p.kind is not Kind.CLOCK or marched is None:
        return -np.inf, np.inf
    now, middle = model.placed(p), marched.placed(p)
    return min(middle - LAG - now, 0.0), max(middle + LAG - now, 0.0)


def _seen_again(problem: Problem, data: Data, at: Linearisation, model: Model) -> Linearisation:
    """The linearisation with images predicted again where they moved; columns of the physics stay."""
    changed, predictions = {}, []
    blocks = {b.label: b for b in at.system.blocks}
    for number, (task, prediction) in enumerate(zip(at.tasks, at.predictions, strict=True)):
        shown = dict(prediction.observables)
        for view in task.views:
            if not _moves(view.file, at.model, model):
                continue
            assert prediction.full is not None
            try:
                observable = observe_again(task, prediction.full, view, model)
            except FlashtempError as fault:
                raise SolverFailure(str(fault)) from fault
            block = data.block(number, view, observable)
            changed[view.file] = block.joined(blocks[view.file], lambda p: True)
            shown[view.file] = replace(observable, columns={})
        predictions.append(replace(prediction, observables=shown))
    return Linearisation(model, at.tasks, tuple(predictions), at.system.with_blocks(changed))


def _moves(file: str, before: Model, after: Model) -> bool:
    """Whether an image lies elsewhere, or any sensor does: sensors carry names that several recordings share."""
    return (
        before.shift(file) != after.shift(file) or before.place(file) != after.place(file)
        or before.beads != after.beads
    )  # fmt: skip
