"""Alignment of images with the data, solved to convergence on predicted fields without a new simulation.

Place, scale, turn and clock of an image, and place and time constant of a thermocouple, change what is seen of a
temperature field but not the field.  With the physics fixed they are found by Gauss-Newton steps on images predicted
anew from the same fields: the inner loop of variable projection (Golub and Pereyra, Inverse Problems 19, 2003, R1).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flashtemp.discovery.estimation.hyperparameters import Hyperparameters, priors_at_hyperparameters
from flashtemp.discovery.estimation.linear_gaussian import Array, LinearSystem
from flashtemp.discovery.estimation.nuisance_priors import nuisance_priors
from flashtemp.discovery.estimation.trust_region import QuadraticModel, TrustRegion
from flashtemp.discovery.estimation.whitening import WhitenedData
from flashtemp.discovery.hypotheses.candidates import ModelPoint
from flashtemp.discovery.parameters import BEAD_KINDS, PLACEMENT_KINDS, SHIFT_KINDS, ParameterId, ParameterKind, Priors
from flashtemp.discovery.prediction.prediction import CLOCK_STEP_S, Prediction, PredictionTask, predict_again
from flashtemp.discovery.prediction.problem import Problem
from flashtemp.errors import FlashtempError, SolverFailure

MAX_ALIGNMENTS = 8  # iterations for one simulation; usually two or three suffice
NEGLIGIBLE_ALIGNMENT_GAIN = 0.1  # ln evidence; a smaller change affects no decision
FIXED_STEP_SD = 1e-6  # relative prior width of a fixed parameter: small enough to fix it, large enough not to overflow
# Scale of a step of each kind: the image is linear over less than a pixel at an edge, fields are stored near each frame
IMAGE_STEP_SCALES = {
    ParameterKind.SHIFT_U: 0.5,  # px
    ParameterKind.SHIFT_V: 0.5,
    ParameterKind.SCALE: 0.01,
    ParameterKind.TURN: 0.01,  # rad
    ParameterKind.CLOCK: 0.5 * CLOCK_STEP_S,
    ParameterKind.PLACE: 2.5e-4,  # m
    ParameterKind.LAG: 0.25,  # s
}


@dataclass(frozen=True)
class Linearisation:
    """A model with its `predictions`, the linearised `system` there, and the `tasks` of the predictions."""

    model: ModelPoint
    tasks: tuple[PredictionTask, ...]
    predictions: tuple[Prediction, ...]
    system: LinearSystem

    def without_fields(self) -> Linearisation:
        """The linearisation without the stored temperature fields of the runs."""
        return replace(self, predictions=tuple(p.without_columns for p in self.predictions))


def image_parameters(system: LinearSystem) -> tuple[ParameterId, ...]:
    """Parameters of images and sensors that have columns in a system, those of single recordings."""
    own = (*SHIFT_KINDS, *PLACEMENT_KINDS)
    return tuple(p for p in system.names if p.kind in BEAD_KINDS or (p.kind in own and p.file))


def align_images(
    problem: Problem,
    data: WhitenedData,
    start: Linearisation,
    hyper: Hyperparameters,
    fixed: frozenset[ParameterId],
    origin: ModelPoint,
) -> Linearisation:
    """Align images with the data, with the physics (`fixed` parameters) unchanged.

    Images that end farther from their placement in the model `origin` than they are linear may be in a worse optimum,
    where physics that did not fit has led them: they are aligned from there too (multistart), and the better result is
    returned.  Raises SolverFailure.
    """
    found, value = _align_from(problem, data, start, hyper, fixed, start.model)
    returned = _return_far_images(found.model, origin)
    if returned is None:
        return found
    moved = _predict_images(problem, data, found, returned)
    other, value_there = _align_from(problem, data, moved, hyper, fixed, start.model)
    return other if value_there < value else found


def _return_far_images(model: ModelPoint, origin: ModelPoint) -> ModelPoint | None:
    """The model with shift, scale and turn of `origin` for images that lie far from there; None if there are none.

    Clocks stay, because fields are stored near the present ones.
    """
    size = IMAGE_STEP_SCALES
    shifts, placements = dict(model.shifts), dict(model.placements)
    for file in model.shifts.keys() | model.placements.keys():
        now, first = model.image_placement(file), origin.image_placement(file)
        shift = np.subtract(model.image_shift(file), origin.image_shift(file))
        steps = {
            ParameterKind.SHIFT_U: shift[0], ParameterKind.SHIFT_V: shift[1],
            ParameterKind.SCALE: now.scale - first.scale, ParameterKind.TURN: now.turn - first.turn,
        }  # fmt: skip
        if any(abs(step) > size[kind] for kind, step in steps.items()):
            shifts[file] = origin.image_shift(file)
            placements[file] = replace(first, clock=now.clock)
    is_same = shifts == model.shifts and placements == model.placements
    return None if is_same else replace(model, shifts=shifts, placements=placements)


def _align_from(
    problem: Problem,
    data: WhitenedData,
    start: Linearisation,
    hyper: Hyperparameters,
    fixed: frozenset[ParameterId],
    simulated: ModelPoint,
) -> tuple[Linearisation, float]:
    """Gauss-Newton steps of images from their placement at the start, and the objective at their end.

    Fields are stored near the clocks of the `simulated` model.
    """
    region = TrustRegion()
    value = profile_objective(problem, start, hyper, fixed, with_heldout=True)
    for _ in range(MAX_ALIGNMENTS):
        names, model = _quadratic_model(problem, start, hyper, fixed, simulated)
        if model.predicted_reduction(model.best_step()) < NEGLIGIBLE_ALIGNMENT_GAIN:
            break
        scale = step_scales(names)
        step = _of_promising_images(names, model, region.limited_step(model, scale))
        if not step.any():
            break
        trial = _predict_images(
            problem, data, start, move_images(start.model, dict(zip(names, step.tolist(), strict=True)))
        )
        there = profile_objective(problem, trial, hyper, fixed, with_heldout=True)
        ratio = (value - there) / max(model.predicted_reduction(step), 1e-300)
        region = region.next_region(ratio, step, scale)
        if ratio > 0.0:
            start, value = trial, there
    return start, value


def _of_promising_images(names: Sequence[ParameterId], model: QuadraticModel, step: Array) -> Array:
    """A step without images whose predicted gain is negligible, so that they need not be predicted again."""
    promised = step * (model.gradient - 0.5 * model.hessian @ step)  # adds up to the reduction by the step
    files = [p.file for p in names]
    gains = dict.fromkeys(files, 0.0)
    for file, gain in zip(files, promised.tolist(), strict=True):
        gains[file] += gain
    moves = np.array([gains[file] > NEGLIGIBLE_ALIGNMENT_GAIN / len(gains) for file in files], bool)
    return np.where(moves, step, 0.0)


def profile_objective(
    problem: Problem,
    at: Linearisation,
    hyper: Hyperparameters,
    fixed: frozenset[ParameterId],
    with_heldout: bool = False,
) -> float:
    """Half of chi2 of data and priors at a point, with physics and images fixed and all else at its optimum.

    Priors of `fixed` parameters of the physics are not included.  `with_heldout`: include held-out data.
    """
    images = image_parameters(at.system)
    free = _nuisance_priors(problem, at, hyper, fixed)
    total = at.system.normal_equations((lambda b: True) if with_heldout else None, hyper.variances)
    found = at.system.solve(free, total)
    mean, precision = _image_prior(problem, at, images)
    return 0.5 * (found.chi2 + float(mean @ precision @ mean))


def step_beyond_fields(
    problem: Problem, at: Linearisation, hyper: Hyperparameters, fixed: frozenset[ParameterId], region: TrustRegion
) -> tuple[float, float, dict[ParameterId, float]]:
    """Predicted gain of images with fields at any time, predicted gain of a step within a region, and that step.

    Fields are stored within CLOCK_STEP_S of the clock of the simulation; larger steps need another simulation.
    """
    names, model = _quadratic_model(problem, at, hyper, fixed)
    step = region.limited_step(model, step_scales(names))
    return (
        model.predicted_reduction(model.best_step()),
        model.predicted_reduction(step),
        dict(zip(names, step.tolist(), strict=True)),
    )


def step_scales(names: Iterable[ParameterId]) -> Array:
    """Scales (k,) of steps of image parameters."""
    return np.array([IMAGE_STEP_SCALES[p.kind] for p in names])


def _quadratic_model(
    problem: Problem, at: Linearisation, hyper: Hyperparameters, fixed: frozenset[ParameterId],
    simulated: ModelPoint | None = None,
) -> tuple[tuple[ParameterId, ...], QuadraticModel]:  # fmt: skip
    """The objective to second order in image and sensor parameters; clocks within the fields of `simulated`."""
    images = image_parameters(at.system)
    free = _nuisance_priors(problem, at, hyper, fixed)
    keep = at.system.normal_equations(lambda b: True, hyper.variances)  # images of held-out data are aligned too
    found = at.system.project_out(free, list(images), keep)
    mean, precision = _image_prior(problem, at, images)
    limits = [_clock_limits(p, at.model, simulated) for p in images]
    low, high = (np.array([limit[i] for limit in limits]) for i in (0, 1))
    return images, QuadraticModel(found.score + precision @ mean, found.information + precision, low, high)


def _nuisance_priors(
    problem: Problem, at: Linearisation, hyper: Hyperparameters, fixed: frozenset[ParameterId]
) -> Priors:
    """Priors of all linear unknowns except image and sensor parameters."""
    priors = priors_at_hyperparameters(problem, at.system, at.model, hyper, {})
    moving = (*SHIFT_KINDS, *PLACEMENT_KINDS, *BEAD_KINDS)
    return {p: v for p, v in priors.items() if p not in fixed and p.kind not in moving}


def _image_prior(problem: Problem, at: Linearisation, images: tuple[ParameterId, ...]) -> tuple[Array, Array]:
    """Prior means (k,), relative to a point, and precision (k, k) of image parameters: each image has its own error and
    one that all images of its view share."""
    views = {v.file: v.recording.view for v in problem.campaign.views}
    priors = nuisance_priors(problem, at.system.names, at.model)
    mean, sd = (np.array([priors[p][i] for p in images]) for i in (0, 1))
    covariance = np.diag(sd**2)
    for p in priors:
        if p.kind in PLACEMENT_KINDS and not p.file:
            own = [i for i, q in enumerate(images) if q.kind is p.kind and q.file and views[q.file] == p.name]
            covariance[np.ix_(own, own)] += priors[p][1] ** 2
    return mean, np.linalg.inv(covariance)


def predict_image_steps(
    problem: Problem, system: LinearSystem, nuisances_there: Priors, steps: Mapping[ParameterId, float],
    hyper: Hyperparameters,
) -> dict[ParameterId, float]:  # fmt: skip
    """Predicted steps of images by the linearised model if the physics takes given `steps`.

    Images of held-out data are not moved, because fitted data contain no information on them.
    """
    fixed = {p: (step, FIXED_STEP_SD * max(abs(step), FIXED_STEP_SD)) for p, step in steps.items()}
    found = system.solve(nuisances_there | fixed, system.normal_equations(variances=hyper.variances))
    views = {v.file: v.recording.view for v in problem.campaign.views}
    out, seen = {}, system.fitted_columns
    for p in image_parameters(system):
        parts = {p, replace(p, file="", name=views[p.file])} if p.kind in PLACEMENT_KINDS else {p}
        out[p] = sum(found[q] for q in parts if q in found.names) if p in seen else 0.0
    return out


def move_images(model: ModelPoint, steps: Mapping[ParameterId, float]) -> ModelPoint:
    """The model after steps of its images and sensors."""
    for p, step in steps.items():
        if p.kind in SHIFT_KINDS:
            shift = list(model.image_shift(p.file))
            shift[p.shift_axis] += step
            model = replace(model, shifts=model.shifts | {p.file: (shift[0], shift[1])})
        else:
            model = model.with_step(p, step)
    return model


def _clock_limits(p: ParameterId, model: ModelPoint, simulated: ModelPoint | None) -> tuple[float, float]:
    """The largest steps of a clock down and up: fields are stored within CLOCK_STEP_S of the simulated one."""
    if p.kind is not ParameterKind.CLOCK or simulated is None:
        return -np.inf, np.inf
    now, middle = model.setup_value(p), simulated.setup_value(p)
    return min(middle - CLOCK_STEP_S - now, 0.0), max(middle + CLOCK_STEP_S - now, 0.0)


def _predict_images(problem: Problem, data: WhitenedData, at: Linearisation, model: ModelPoint) -> Linearisation:
    """The linearisation with moved images predicted again; columns of the physics are not computed again."""
    changed, predictions = {}, []
    blocks = {b.label: b for b in at.system.blocks}
    for number, (task, prediction) in enumerate(zip(at.tasks, at.predictions, strict=True)):
        shown = dict(prediction.observables)
        for view in task.views:
            if not _has_moved(view.file, at.model, model):
                continue
            assert prediction.full_run is not None
            try:
                observable = predict_again(task, prediction.full_run, view, model)
            except FlashtempError as fault:
                raise SolverFailure(str(fault)) from fault
            block = data.make_block(number, view, observable)
            changed[view.file] = block.with_columns_of(blocks[view.file], lambda p: True)
            shown[view.file] = replace(observable, columns={})
        predictions.append(replace(prediction, observables=shown))
    return Linearisation(model, at.tasks, tuple(predictions), at.system.with_blocks(changed))


def _has_moved(file: str, before: ModelPoint, after: ModelPoint) -> bool:
    """Whether the placement of an image, or of any sensor, differs; several recordings may share a sensor."""
    return (
        before.image_shift(file) != after.image_shift(file)
        or before.image_placement(file) != after.image_placement(file)
        or before.bead_offsets != after.bead_offsets
    )
