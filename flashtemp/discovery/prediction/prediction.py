"""Prediction of one condition at one point: values of cameras and load cells, with derivatives by every parameter.

A worker receives a `PredictionTask` and returns a `Prediction`.  Measured values are not used here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType, SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt

from flashtemp.camera.image_placement import ImagePlacement
from flashtemp.camera.prediction.observation import PredictedImage, observe
from flashtemp.camera.prediction.pixel_sampling import MatrixCache
from flashtemp.camera.prediction.wall_temperature.side_wall_temperature import FaceHistory
from flashtemp.camera.recording import VIEW_DESCRIPTIONS, Recording
from flashtemp.comparison.campaign import LoadCellEntry, RecordingEntry
from flashtemp.comparison.compare import check_recording, predict_friction, required_times
from flashtemp.discovery.hypotheses.candidates import (
    STRENGTH_STEP_FRACTION,
    CandidateEffect,
    ModelPoint,
    parameter_spec,
)
from flashtemp.discovery.hypotheses.discrepancy_effects import add_friction_scatter, add_pressure_mode
from flashtemp.discovery.hypotheses.input_kinds import (
    CAMERA_INPUTS,
    RUN_STEP_RATIO,
    allows_tangent_run,
    has_same_mesh,
    iter_stepped_cases,
)
from flashtemp.discovery.parameters import SHIFT_KINDS, ParameterId, ParameterKind
from flashtemp.discovery.prediction import sensor_parameters
from flashtemp.model.case import Case
from flashtemp.model.numerics import SolverSettings
from flashtemp.model.scene import ActiveEffect, Scene
from flashtemp.physics.effect import Effect, Param
from flashtemp.physics.quantities import KELVIN
from flashtemp.solver.perturbed_run import Perturbation
from flashtemp.solver.run import Run
from flashtemp.solver.sensitivity import RunWithSensitivities, run_with_sensitivities
from flashtemp.solver.time_integration import integrate_schedule

Array = npt.NDArray[np.float64]
Single = npt.NDArray[np.float32]
Columns = dict[ParameterId, Array]
LN_FACTOR_STEP, FRICTION_SCATTER_STEP, PRESSURE_MODE_STEP = (
    1e-3,
    1e-2,
    1e-2,
)  # steps: of ln factors, of friction, of relative pressure
BLOCK_SIZE_KEYS, BLOCK_SIZE_STEP = (
    ("block.length", "block.width"),
    1e-3,
)  # keys measured with a ruler, and their relative step
CLOCK_STEP_S = 0.02  # s: step of the clock
MIN_CAMERA_SIGNAL_K = 5e-3  # K: below, a camera sensitivity is computed again with the full strength


@dataclass(frozen=True)
class DerivativeRequest:
    """Which derivatives to compute: by `model_parameters`, by friction `scatter` of each repetition, by pressure
    `modes` (and their `trends`), by strengths of `candidates`, by the camera's `optics` and clock, by `block_sizes`,
    and by stated `inputs` of case and cameras.

    Columns of inputs are per ln of the value, or per unit for absolute kinds (K, emissivity) and for `zero_inputs`,
    which all conditions state as zero.  With `fields` those of the run are kept, for clocks within CLOCK_STEP_S of the
    stated ones, or for the `stated_clocks` alone, which takes a third of the memory."""

    model_parameters: tuple[ParameterId, ...] = ()
    scatter: bool = False
    modes: int = 0
    trends: bool = False
    candidates: tuple[CandidateEffect, ...] = ()
    optics: bool = False
    block_sizes: bool = False
    fields: bool = False
    stated_clocks: bool = False
    inputs: tuple[ParameterId, ...] = ()
    zero_inputs: frozenset[ParameterId] = frozenset()


@dataclass(frozen=True)
class PredictionTask:
    """One condition at one point: the `case` with overrides `given` and `mesh_overrides`.

    The case contains its effect files, so that no worker reads or checks them again.
    """

    case: Case
    given: dict[str, Any]
    mesh_overrides: dict[str, Any]
    model: ModelPoint
    views: tuple[RecordingEntry, ...]
    forces: tuple[LoadCellEntry, ...]
    derivatives: DerivativeRequest = field(default_factory=DerivativeRequest)


@dataclass(frozen=True)
class Observable:
    """A predicted recording or load-cell record: `values` (frames, nv, nu) or (n,), and the valid ones, `inside`.

    `columns`: derivatives by each parameter, (frames, valid pixels) or (n,).
    """

    values: Array
    inside: npt.NDArray[np.bool_]
    columns: dict[ParameterId, Single]


@dataclass(frozen=True)
class Prediction:
    """The prediction of a condition at a point: `observables` by file, the `run` without its fields, and the
    `full_run` with fields if they were requested."""

    observables: dict[str, Observable]
    run: Run
    steps: dict[ParameterId, float]
    full_run: Run | None = None

    @property
    def without_columns(self) -> Prediction:
        """The prediction without columns, which blocks have in whitened form, and without fields."""
        return replace(
            self, observables={f: replace(o, columns={}) for f, o in self.observables.items()}, full_run=None
        )


@dataclass(frozen=True)
class EvaluationPoint:
    """The scene of a task at its point, with the case from which neighbouring scenes are made."""

    task: PredictionTask
    case: Case  # without the changes of the model
    scene: Scene

    def perturbed_scene(self, model: ModelPoint) -> Scene:
        """The scene of another model of the same case."""
        return model.apply_to(self.case).scene

    def effect_parameter(self, p: ParameterId) -> Param:
        """The declaration of an effect parameter."""
        return self.case.known_effects[p.effect].params()[p.name]

    def step_size(self, p: ParameterId) -> float:
        """The step of a parameter of an effect in the model, away from the nearer bound."""
        param, now = self.effect_parameter(p), self.task.model.effect_value(p)
        size = abs(param.value - param.off) if param.off is not None else abs(now)
        step = STRENGTH_STEP_FRACTION * float(size or 1.0)
        return -step if now + step > param.high else step

    def make_active_effect(self, effect: str, values: dict[str, float]) -> ActiveEffect:
        return ActiveEffect(effect, self.case.known_effects[effect](), SimpleNamespace(**values))


def predict_condition(task: PredictionTask) -> Prediction:
    """Simulate a condition at a point with all requested derivatives.  Raises BadInput, SolverFailure."""
    base = task.case.with_values(task.given | task.mesh_overrides)
    case = task.model.apply_to(base)
    scene = case.scene
    for view in task.views:
        check_recording(view, scene)
    point = EvaluationPoint(task, base, scene)
    moves = dict(_iter_perturbations(point))
    frames = required_times(task.views, scene, {v.file: task.model.image_placement(v.file).clock for v in task.views})
    asked = task.derivatives
    other_clocks = asked.fields and not asked.stated_clocks
    early = (
        tuple(t - CLOCK_STEP_S for t in frames if t > CLOCK_STEP_S)
        if asked.candidates or asked.optics or other_clocks
        else ()
    )
    late = tuple(t + CLOCK_STEP_S for t in frames if t + CLOCK_STEP_S < scene.schedule.end_time) if other_clocks else ()
    settings = replace(case.settings, times=tuple(sorted({*frames, *early, *late})), fields=2)
    if moves:
        near = run_with_sensitivities(scene, settings, moves, case.title, frames, bool(task.forces))
    else:
        near = RunWithSensitivities[ParameterId](integrate_schedule(scene, settings, case.title), None, {}, {})
    other = _run_separate_scenes(point, settings, moves)
    shown = {view.file: _predict_recording(point, view, near, moves, other) for view in task.views}
    shown |= {force.file: _predict_trace(force, near, other) for force in task.forces}
    thin = replace(near.run, field=near.run.field[:0], frames=near.run.frames[:0])
    return Prediction(shown, thin, {k: m.step for k, m in moves.items()}, near.run if asked.fields else None)


def predict_again(
    task: PredictionTask, run: Run, view: RecordingEntry, model: ModelPoint, with_columns: bool = True
) -> Observable:
    """A recording predicted again from the fields of a run, with the image placement of another model.

    The physics of both models is the same.  The recording has the columns of the camera parameters, if they are
    wanted.  A clock may differ by CLOCK_STEP_S from that of the run.
    """
    base = task.case.with_values(task.given | task.mesh_overrides)
    moved = replace(task, model=model, derivatives=DerivativeRequest(optics=with_columns))
    point = EvaluationPoint(moved, base, model.apply_to(base).scene)
    return _predict_recording(point, view, RunWithSensitivities[ParameterId](run, None, {}, {}), {}, {})


# --- perturbed scenes for derivatives by all parameters of the heat balance ------------------------------------
def _iter_perturbations(point: EvaluationPoint) -> Iterator[tuple[ParameterId, Perturbation]]:
    asked = point.task.derivatives
    yield from (pair for p in asked.model_parameters for pair in _perturb_model(point, p))
    yield from _perturb_inputs(point)
    if not point.scene.schedule.alone:  # without contact there is neither pressure nor friction
        if asked.scatter:
            yield from _perturb_friction(point.scene)
        yield from _perturb_modes(point.scene, asked.modes, asked.trends)
    if asked.block_sizes and any(v.recording.places is None for v in point.task.views):
        yield from _perturb_sizes(point)
    for c in asked.candidates:
        if not c.is_optical:
            yield from _iter_strength_perturbations(point, c)


def _perturb_model(point: EvaluationPoint, p: ParameterId) -> Iterator[tuple[ParameterId, Perturbation]]:
    """Scenes with a step of a free key or of a parameter of an effect in the model."""
    model = point.task.model
    if p.kind is ParameterKind.KEY:
        now = model.case_overrides(point.case).get(p.name, point.case[p.name])
        step = (
            -LN_FACTOR_STEP
            if now * np.exp(LN_FACTOR_STEP) > parameter_spec(point.case, p.name).high
            else LN_FACTOR_STEP
        )
    elif point.case.known_effects[p.effect].heat is not Effect.heat:
        step = point.step_size(p)
    else:
        return
    yield p, Perturbation(point.perturbed_scene(model.with_step(p, step)), step)


def _perturb_friction(scene: Scene) -> Iterator[tuple[ParameterId, Perturbation]]:
    """Friction of each repetition; the scenes are equal before the repetition begins."""
    for r in range(2, scene.schedule.repetitions + 1):
        begin = next(p.begin for p in scene.schedule.phases if p.repetition == r)
        yield (
            ParameterId(ParameterKind.SCATTER, (r,)),
            Perturbation(add_friction_scatter(scene, r, FRICTION_SCATTER_STEP), FRICTION_SCATTER_STEP, begin),
        )
    yield (
        ParameterId(ParameterKind.SCATTER, (1,)),
        Perturbation(add_friction_scatter(scene, 1, FRICTION_SCATTER_STEP), FRICTION_SCATTER_STEP),
    )


def _perturb_modes(scene: Scene, modes: int, trends: bool) -> Iterator[tuple[ParameterId, Perturbation]]:
    for n in range(1, modes + 1):
        yield (
            ParameterId(ParameterKind.MODE, (n,)),
            Perturbation(add_pressure_mode(scene, n, PRESSURE_MODE_STEP), PRESSURE_MODE_STEP),
        )
        if trends and scene.schedule.repetitions > 1:
            yield (
                ParameterId(ParameterKind.TREND, (n,)),
                Perturbation(add_pressure_mode(scene, n, PRESSURE_MODE_STEP, True), PRESSURE_MODE_STEP),
            )


def _perturb_sizes(point: EvaluationPoint) -> Iterator[tuple[ParameterId, Perturbation]]:
    """The block slightly longer and wider, or shorter where a longer one would need another cell."""
    mesh = point.scene.mesh
    for key in BLOCK_SIZE_KEYS:
        for step in (BLOCK_SIZE_STEP, -BLOCK_SIZE_STEP):
            scene = point.task.model.apply_to(point.case.with_values({key: point.case[key] * (1.0 + step)})).scene
            if all(len(getattr(scene.mesh, k)) == len(getattr(mesh, k)) for k in ("x", "depth", "height", "y")):
                yield ParameterId(ParameterKind.SIZE, name=key), Perturbation(scene, step, is_stretched=True)
                break


def _iter_strength_perturbations(
    point: EvaluationPoint, candidate: CandidateEffect
) -> Iterator[tuple[ParameterId, Perturbation]]:
    """The candidate at work with a small strength, one strength and shape variant at a time."""
    for variant in range(len(candidate.shape_variants)):
        off = candidate.neutral_values(variant)
        for name, usual_size in candidate.strengths.items():
            # a curved law is flat at its off value: a small step would show no effect, so it gets the usual size
            step = usual_size if candidate.params[name].curved else STRENGTH_STEP_FRACTION * usual_size
            moved = point.task.model.with_effect(candidate.effect, off | {name: off[name] + step})
            yield candidate.strength_column(name, variant), Perturbation(point.perturbed_scene(moved), step)


def _perturb_inputs(point: EvaluationPoint) -> Iterator[tuple[ParameterId, Perturbation]]:
    """Stated numbers of the case that do not change the schedule or the cells, except for their size."""
    for p in _case_inputs(point):
        for case, step in iter_stepped_cases(point.case, p.name, is_zero=p in point.task.derivatives.zero_inputs):
            scene = point.task.model.apply_to(case).scene
            if allows_tangent_run(point.scene, scene):
                yield p, Perturbation(scene, step, is_stretched=not has_same_mesh(point.scene, scene))
                break


def _case_inputs(point: EvaluationPoint) -> tuple[ParameterId, ...]:
    """Inputs that are keys of the case, without block sizes that have columns already."""
    images = any(v.recording.places is None for v in point.task.views)
    twice = BLOCK_SIZE_KEYS if point.task.derivatives.block_sizes and images else ()
    asked = (p for p in point.task.derivatives.inputs if p.name not in twice)
    return tuple(p for p in asked if p.name.partition(".")[0] not in VIEW_DESCRIPTIONS)


@dataclass(frozen=True)
class SeparateRun:
    """A separate run with one input changed by `step_size`, for inputs that change the schedule or the mesh."""

    scene: Scene
    run: Run
    step: float


def _run_separate_scenes(
    point: EvaluationPoint, settings: SolverSettings, moves: dict[ParameterId, Perturbation]
) -> dict[ParameterId, SeparateRun]:
    """One run for each stated number of the case that changes the schedule or the cells.

    The step lengthens the schedule, so that no frame comes after its end.
    """
    out = {}
    views, model = point.task.views, point.task.model
    clocks = {v.file: model.image_placement(v.file).clock for v in views}
    for p in _case_inputs(point):
        if p in moves:
            continue
        ways = [
            (model.apply_to(case).scene, step) for case, step in iter_stepped_cases(point.case, p.name, RUN_STEP_RATIO)
        ]
        if ways:
            scene, step = max(ways, key=lambda way: way[0].schedule.end_time)
            times = tuple(sorted({*required_times(views, scene, clocks)}))
            out[p] = SeparateRun(
                scene, integrate_schedule(scene, replace(settings, times=times), point.case.title), step
            )
    return out


# --- predicted recordings --------------------------------------------------------------------------------------
def _predict_recording(
    point: EvaluationPoint,
    view: RecordingEntry,
    near: RunWithSensitivities[ParameterId],
    moves: dict[ParameterId, Perturbation],
    other: Mapping[ParameterId, SeparateRun] = MappingProxyType({}),
) -> Observable:
    recording = sensor_parameters.place_sensors(view, point.task.model)
    scene, asked = point.scene, point.task.derivatives
    shift, place = point.task.model.image_shift(view.file), point.task.model.image_placement(view.file)
    ruler, kept = (point.case["block.length"], point.case["block.width"]), MatrixCache()
    walls = recording.view in ("sidewall", "wake") and not scene.resolved
    face = FaceHistory.from_run(near.run, scene) if walls else None

    def predict_images(
        run: Any = near.run, scene: Scene = scene, acting: Any = scene.acting, recording: Any = recording,
        place: ImagePlacement = place, history: FaceHistory | None = None,
    ) -> Array:  # fmt: skip
        if history is None and face is not None:
            history = face if run is near.run else face.for_perturbed_run(run, near.reference, scene)
        return group_means(observe(run, scene, recording, acting, shift, 0.0, place, kept, history, ruler).temperature)

    def group_means(values: Array) -> Array:
        """The means over frames of a recording whose frames were averaged."""
        return values if view.means is None else view.means.time_mean(recording.time, values)

    now = observe(near.run, scene, recording, scene.acting, shift, 0.0, place, kept, face, ruler, asked.optics)
    seen = replace(now, temperature=group_means(now.temperature))
    columns: dict[ParameterId, Single] = {}

    def keep_column(name: ParameterId, change: Array) -> None:
        # one at a time, because all of them in double precision would need much memory
        columns[name] = flatten_valid_pixels(change, seen.inside)

    level = predict_images(near.reference) if moves else seen.temperature
    for name, move in moves.items():
        keep_column(name, (predict_images(near.perturbed[name], move.scene, move.scene.acting) - level) / move.step)
    for name, one in other.items():
        history = FaceHistory.from_run(one.run, one.scene) if walls else None
        keep_column(
            name, (predict_images(one.run, one.scene, one.scene.acting, history=history) - seen.temperature) / one.step
        )
    for name, change in _iter_camera_columns(point, predict_images, seen.temperature, recording.view):
        keep_column(name, change)
    if asked.optics:
        for name, change in _optics_columns(now, recording).items():
            keep_column(name, group_means(change))
        if recording.places is not None:
            rise = seen.temperature - scene.ambient + KELVIN
            for name, change in sensor_parameters.sensor_columns(predict_images, recording, rise).items():
                keep_column(name, change)
        later = predict_images(place=replace(place, clock=place.clock + CLOCK_STEP_S))
        keep_column(ParameterId(ParameterKind.CLOCK), (later - seen.temperature) / CLOCK_STEP_S)
    return Observable(seen.temperature, seen.inside, columns)


def _iter_camera_columns(
    point: EvaluationPoint, predict_images: Callable[..., Array], plain: Array, view: str
) -> Iterator[tuple[ParameterId, Array]]:
    """Derivatives in the camera: by candidates, by effects of the model, and by inputs of the `view`."""
    for name, (effect, param, step) in CAMERA_INPUTS.items():
        if (p := ParameterId.of_input(f"{view}.{name}")) in point.task.derivatives.inputs:
            moved = (*point.scene.acting, point.make_active_effect(effect, {param: step}))
            yield p, (predict_images(acting=moved) - plain) / step
    for c in point.task.derivatives.candidates:
        if c.is_optical:
            for k, a in c.strengths.items():
                yield c.strength_column(k), _candidate_column(point, predict_images, c, k, a, plain)
    for p in point.task.derivatives.model_parameters:
        if p.kind is ParameterKind.EFFECT and point.case.known_effects[p.effect].heat is Effect.heat:
            yield p, _effect_column(point, predict_images, p, plain)


def flatten_valid_pixels(values: Array, inside: npt.NDArray[np.bool_]) -> Single:
    """Images (frames, nv, nu) as (frames, valid pixels), in single precision."""
    return values[:, inside].astype(np.float32)


def _candidate_column(
    point: EvaluationPoint, predict_images: Callable[..., Array], c: CandidateEffect, k: str, a: float, plain: Array
) -> Array:
    """Derivative by a camera effect; with its full strength if the derivative vanishes at the neutral value."""
    off = c.neutral_values()
    for share in (STRENGTH_STEP_FRACTION, 1.0):
        step = share * a
        slope = (
            predict_images(acting=(*point.scene.acting, point.make_active_effect(c.effect, off | {k: off[k] + step})))
            - plain
        ) / step
        if np.nanmax(np.abs(slope)) * abs(a) > MIN_CAMERA_SIGNAL_K:
            break
    return slope


def _effect_column(point: EvaluationPoint, predict_images: Callable[..., Array], p: ParameterId, plain: Array) -> Array:
    """Derivative by a parameter of a camera effect in the model."""
    step, model = point.step_size(p), point.task.model
    others = tuple(a for a in point.scene.acting if a.name != p.effect)
    moved = point.make_active_effect(p.effect, model.effects[p.effect] | {p.name: model.effect_value(p) + step})
    return (predict_images(acting=(*others, moved)) - plain) / step


def _optics_columns(image: PredictedImage, recording: Recording) -> Columns:
    """Derivatives by camera parameters: shift along u and v (px), scale, rotation, gain, point spread (relative)."""
    is_stated, slopes = bool(recording.registration_sigma_px), image.slopes
    wide, high = len(recording.u) > 1, len(recording.v) > 1
    unknown = {
        SHIFT_KINDS[0]: is_stated and wide,
        SHIFT_KINDS[1]: is_stated and high and recording.view != "wake",
        ParameterKind.SCALE: True,
        ParameterKind.TURN: wide and high,
        ParameterKind.GAIN: recording.view != "profile",
        ParameterKind.SPREAD: bool(recording.psf_sigma_px),
    }
    return {ParameterId(k): slopes[k.value] for k, is_so in unknown.items() if is_so and slopes}


def _predict_trace(
    force: LoadCellEntry, near: RunWithSensitivities[ParameterId], other: Mapping[ParameterId, SeparateRun]
) -> Observable:
    on, predicted = predict_friction(near.run, force)
    columns = {name: near.derivative_of(lambda run: predict_friction(run, force)[1], name) for name in near.perturbed}
    columns |= {name: (predict_friction(one.run, force)[1] - predicted) / one.step for name, one in other.items()}
    return Observable(predicted, on, {k: v.astype(np.float32) for k, v in columns.items()})
