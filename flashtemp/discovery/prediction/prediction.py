"""One condition predicted at one point: what cameras and load cells would show, and what every parameter would change.

A `Task` is all that a worker needs; a `Prediction` is what comes back.  Nothing here knows the measured values.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType, SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt

from flashtemp.camera.observation import Seen, observe
from flashtemp.camera.pixels import Kept
from flashtemp.camera.placement import Place
from flashtemp.camera.recording import VIEWS, Recording
from flashtemp.camera.wall import Face
from flashtemp.comparison.campaign import Force, View
from flashtemp.comparison.compare import check, grip, moments
from flashtemp.discovery.hypotheses.candidates import SHARE, Candidate, Model, parameter_spec
from flashtemp.discovery.hypotheses.discrepancy_effects import add_friction_scatter, add_pressure_mode
from flashtemp.discovery.hypotheses.input_steps import (
    CAMERA_INPUTS,
    RUN_STEP,
    has_same_mesh,
    is_neighbour,
    stepped_cases,
)
from flashtemp.discovery.parameters import SHIFTS, Kind, ParameterId
from flashtemp.discovery.prediction import sensor_parameters
from flashtemp.model.case import Case
from flashtemp.model.numerics import Settings
from flashtemp.model.scene import Acting, Scene
from flashtemp.physics.effect import Effect, Param
from flashtemp.physics.quantities import KELVIN
from flashtemp.solver.march import march
from flashtemp.solver.run import Run
from flashtemp.solver.sensitivity import Move, Neighbourhood, explore

Array = npt.NDArray[np.float64]
Single = npt.NDArray[np.float32]
Columns = dict[ParameterId, Array]
FREE, SCATTER, MODE = 1e-3, 1e-2, 1e-2  # steps: of ln factors, of friction, of relative pressure
SIZES, SIZED = ("block.length", "block.width"), 1e-3  # keys that a ruler gives, and their relative step
LAG = 0.02  # s: step of what moves frames in time
DULL = 5e-3  # K: a trace in the camera below it is taken again with the whole strength


@dataclass(frozen=True)
class Derivatives:
    """Which to compute: by the model's `own` parameters, by `scatter` of friction per repetition, by pressure
    `modes` (and their `trends`), by strengths of `candidates`, by the camera's `optics` and clock, by the
    `laboratory`: sizes of the block, by stated `inputs` of case and cameras.

    Columns by inputs are per ln of the value, or per unit of one whose kind is absolute (K, emissivity)."""

    own: tuple[ParameterId, ...] = ()
    scatter: bool = False
    modes: int = 0
    trends: bool = False
    candidates: tuple[Candidate, ...] = ()
    optics: bool = False
    laboratory: bool = False
    fields: bool = False
    inputs: tuple[ParameterId, ...] = ()


@dataclass(frozen=True)
class Task:
    """One condition at one point: the `case` with overrides `given` and `pins` of the mesh.

    The case brings the effect files that were read with it: no process reads or judges them again.
    """

    case: Case
    given: dict[str, Any]
    pins: dict[str, Any]
    model: Model
    views: tuple[View, ...]
    forces: tuple[Force, ...]
    derivatives: Derivatives = field(default_factory=Derivatives)


@dataclass(frozen=True)
class Observable:
    """A recording or trace as predicted: `values` (frames, nv, nu) or (n,), `inside` what may be compared.

    `columns` change per unit of each parameter, of the pixels inside (frames, pixels) or (n,).
    """

    values: Array
    inside: npt.NDArray[np.bool_]
    columns: dict[ParameterId, Single]


@dataclass(frozen=True)
class Prediction:
    """What a condition shows at a point: `observables` by file; `run` without its fields, for pictures and audits, and
    the `full` one where fields are asked for."""

    observables: dict[str, Observable]
    run: Run
    steps: dict[ParameterId, float]
    full: Run | None = None

    @property
    def bare(self) -> Prediction:
        """The same without columns, which blocks hold whitened, and without fields."""
        return replace(self, observables={f: replace(o, columns={}) for f, o in self.observables.items()}, full=None)


@dataclass(frozen=True)
class Point:
    """The scene of a task at its point, with what its neighbours are made from."""

    task: Task
    case: Case  # without what the model changes
    scene: Scene

    def neighbour(self, model: Model) -> Scene:
        """The scene with another model on the same case."""
        return model.on(self.case).scene

    def param(self, p: ParameterId) -> Param:
        """What is declared of a parameter of an effect."""
        return self.case.known[p.effect].params()[p.name]

    def step(self, p: ParameterId) -> float:
        """Of a parameter of an effect that the model holds already, away from the nearer bound."""
        param, now = self.param(p), self.task.model.value(p)
        size = abs(param.value - param.off) if param.off is not None else abs(now)
        step = SHARE * float(size or 1.0)
        return -step if now + step > param.high else step

    def acting(self, effect: str, values: dict[str, float]) -> Acting:
        return Acting(effect, self.case.known[effect](), SimpleNamespace(**values))


def predict_condition(task: Task) -> Prediction:
    """Simulate a condition at a point with all derivatives asked for.  Raises BadInput, SolverFailure."""
    base = task.case.with_values(task.given | task.pins)
    case = task.model.on(base)
    scene = case.scene
    for view in task.views:
        check(view, scene)
    point = Point(task, base, scene)
    moves = dict(_moves(point))
    frames = moments(task.views, scene, {v.file: task.model.place(v.file).clock for v in task.views})
    asked = task.derivatives
    early = tuple(t - LAG for t in frames if t > LAG) if asked.candidates or asked.optics or asked.fields else ()
    late = tuple(t + LAG for t in frames if t + LAG < scene.schedule.end) if asked.fields else ()
    settings = replace(case.settings, times=tuple(sorted({*frames, *early, *late})), fields=2)
    if moves:
        near = explore(scene, settings, moves, case.title, frames, bool(task.forces))
    else:
        near = Neighbourhood[ParameterId](march(scene, settings, case.title), None, {}, {})
    other = _separate_runs(point, settings, moves)
    shown = {view.file: _view(point, view, near, moves, other) for view in task.views}
    shown |= {force.file: _force(force, near, other) for force in task.forces}
    thin = replace(near.run, field=near.run.field[:0], frames=near.run.frames[:0])
    return Prediction(shown, thin, {k: m.step for k, m in moves.items()}, near.run if asked.fields else None)


def observe_again(task: Task, run: Run, view: View, model: Model) -> Observable:
    """A recording whose image lies where another model of the same physics has it, of a run that kept its fields.

    Columns of the camera's own unknowns come along.  A clock may differ by LAG from the one that the run was made for.
    """
    base = task.case.with_values(task.given | task.pins)
    moved = replace(task, model=model, derivatives=Derivatives(optics=True))
    point = Point(moved, base, model.on(base).scene)
    return _view(point, view, Neighbourhood[ParameterId](run, None, {}, {}), {}, {})


# --- neighbouring scenes: everything that is asked for and acts on heat ---------------------------------------
def _moves(point: Point) -> Iterator[tuple[ParameterId, Move]]:
    asked = point.task.derivatives
    yield from (pair for p in asked.own for pair in _own(point, p))
    yield from _inputs(point)
    if not point.scene.schedule.alone:  # else no contact to press or to rub
        if asked.scatter:
            yield from _scatter(point.scene)
        yield from _modes(point.scene, asked.modes, asked.trends)
    if asked.laboratory and any(v.recording.places is None for v in point.task.views):
        yield from _sizes(point)
    for c in asked.candidates:
        if not c.optical:
            yield from _strengths(point, c)


def _own(point: Point, p: ParameterId) -> Iterator[tuple[ParameterId, Move]]:
    """A free key, or a parameter of an effect that the model holds already."""
    model = point.task.model
    if p.kind is Kind.KEY:
        now = model.overrides(point.case).get(p.name, point.case[p.name])
        step = -FREE if now * np.exp(FREE) > parameter_spec(point.case, p.name).high else FREE
    elif point.case.known[p.effect].heat is not Effect.heat:
        step = point.step(p)
    else:
        return
    yield p, Move(point.neighbour(model.moved(p, step)), step)


def _scatter(scene: Scene) -> Iterator[tuple[ParameterId, Move]]:
    """Friction of each repetition; nothing differs before it begins."""
    for r in range(2, scene.schedule.repetitions + 1):
        begin = next(p.begin for p in scene.schedule.phases if p.repetition == r)
        yield ParameterId(Kind.SCATTER, (r,)), Move(add_friction_scatter(scene, r, SCATTER), SCATTER, begin)
    yield ParameterId(Kind.SCATTER, (1,)), Move(add_friction_scatter(scene, 1, SCATTER), SCATTER)


def _modes(scene: Scene, modes: int, trends: bool) -> Iterator[tuple[ParameterId, Move]]:
    for n in range(1, modes + 1):
        yield ParameterId(Kind.MODE, (n,)), Move(add_pressure_mode(scene, n, MODE), MODE)
        if trends and scene.schedule.repetitions > 1:
            yield ParameterId(Kind.TREND, (n,)), Move(add_pressure_mode(scene, n, MODE, True), MODE)


def _sizes(point: Point) -> Iterator[tuple[ParameterId, Move]]:
    """The block a little longer and wider; shorter, where longer would ask for another cell."""
    mesh = point.scene.mesh
    for key in SIZES:
        for step in (SIZED, -SIZED):
            scene = point.task.model.on(point.case.with_values({key: point.case[key] * (1.0 + step)})).scene
            if all(len(getattr(scene.mesh, k)) == len(getattr(mesh, k)) for k in ("x", "depth", "height", "y")):
                yield ParameterId(Kind.SIZE, name=key), Move(scene, step, stretched=True)
                break


def _strengths(point: Point, c: Candidate) -> Iterator[tuple[ParameterId, Move]]:
    for number in range(len(c.variants)):
        off = c.off(number)
        for k, a in c.strengths.items():
            step = a if c.params[k].curved else SHARE * a
            moved = point.task.model.with_effect(c.effect, off | {k: off[k] + step})
            yield c.column(k, number), Move(point.neighbour(moved), step)


def _inputs(point: Point) -> Iterator[tuple[ParameterId, Move]]:
    """Stated numbers of the case that leave schedule and cells as they are, or make cells a little larger."""
    for p in _inputs_of_case(point):
        for case, step in stepped_cases(point.case, p.name):
            scene = point.task.model.on(case).scene
            if is_neighbour(point.scene, scene):
                yield p, Move(scene, step, stretched=not has_same_mesh(point.scene, scene))
                break


def _inputs_of_case(point: Point) -> tuple[ParameterId, ...]:
    """Inputs that are keys of the case, without sizes that the laboratory's columns hold already."""
    images = any(v.recording.places is None for v in point.task.views)
    twice = SIZES if point.task.derivatives.laboratory and images else ()
    asked = (p for p in point.task.derivatives.inputs if p.name not in twice)
    return tuple(p for p in asked if p.name.partition(".")[0] not in VIEWS)


@dataclass(frozen=True)
class SeparateRun:
    """A run of a scene with one input moved by `step`, whose schedule or mesh no tangent can follow."""

    scene: Scene
    run: Run
    step: float


def _separate_runs(point: Point, settings: Settings, moves: dict[ParameterId, Move]) -> dict[ParameterId, SeparateRun]:
    """One run for each stated number of the case that changes the schedule or the cells.

    The step is the one that makes the schedule longer, so that no frame comes after its end.
    """
    out = {}
    views, model = point.task.views, point.task.model
    clocks = {v.file: model.place(v.file).clock for v in views}
    for p in _inputs_of_case(point):
        if p in moves:
            continue
        ways = [(model.on(case).scene, step) for case, step in stepped_cases(point.case, p.name, RUN_STEP)]
        if ways:
            scene, step = max(ways, key=lambda way: way[0].schedule.end)
            times = tuple(sorted({*moments(views, scene, clocks)}))
            out[p] = SeparateRun(scene, march(scene, replace(settings, times=times), point.case.title), step)
    return out


# --- what instruments show ------------------------------------------------------------------------------------
def _view(
    point: Point, view: View, near: Neighbourhood[ParameterId], moves: dict[ParameterId, Move],
    other: Mapping[ParameterId, SeparateRun] = MappingProxyType({}),
) -> Observable:  # fmt: skip
    recording = sensor_parameters.place_sensors(view, point.task.model)
    scene, asked = point.scene, point.task.derivatives
    shift, place = point.task.model.shift(view.file), point.task.model.place(view.file)
    ruler, kept = (point.case["block.length"], point.case["block.width"]), Kept()
    walls = recording.view in ("sidewall", "wake") and not scene.resolved
    face = Face.of(near.run, scene) if walls else None

    def see(
        run: Any = near.run, scene: Scene = scene, acting: Any = scene.acting, recording: Any = recording,
        place: Place = place, history: Face | None = None,
    ) -> Array:  # fmt: skip
        if history is None and face is not None:
            history = face if run is near.run else face.beside(run, near.level, scene)
        return mean(observe(run, scene, recording, acting, shift, 0.0, place, kept, history, ruler).temperature)

    def mean(values: Array) -> Array:
        """What a recording that was condensed keeps of frames."""
        return values if view.means is None else view.means.of(recording.time, values)

    now = observe(near.run, scene, recording, scene.acting, shift, 0.0, place, kept, face, ruler, asked.optics)
    seen = replace(now, temperature=mean(now.temperature))
    columns: dict[ParameterId, Single] = {}

    def keep(name: ParameterId, change: Array) -> None:
        # at once: all of them in double precision would be much memory
        columns[name] = flatten_valid_pixels(change, seen.inside)

    level = see(near.level) if moves else seen.temperature
    for name, move in moves.items():
        keep(name, (see(near.moved[name], move.scene, move.scene.acting) - level) / move.step)
    for name, one in other.items():
        history = Face.of(one.run, one.scene) if walls else None
        keep(name, (see(one.run, one.scene, one.scene.acting, history=history) - seen.temperature) / one.step)
    for name, change in _in_the_camera(point, see, seen.temperature, recording.view):
        keep(name, change)
    if asked.optics:
        for name, change in _optics(now, recording).items():
            keep(name, mean(change))
        if recording.places is not None:
            rise = seen.temperature - scene.ambient + KELVIN
            for name, change in sensor_parameters.sensor_columns(see, recording, rise).items():
                keep(name, change)
        later = see(place=replace(place, clock=place.clock + LAG))
        keep(ParameterId(Kind.CLOCK), (later - seen.temperature) / LAG)
    return Observable(seen.temperature, seen.inside, columns)


def _in_the_camera(
    point: Point, see: Callable[..., Array], plain: Array, view: str
) -> Iterator[tuple[ParameterId, Array]]:
    """Traces of what acts in the camera: of candidates, of effects that the model holds, of inputs of its `view`."""
    for name, (effect, param, step) in CAMERA_INPUTS.items():
        if (p := ParameterId.of_input(f"{view}.{name}")) in point.task.derivatives.inputs:
            moved = (*point.scene.acting, point.acting(effect, {param: step}))
            yield p, (see(acting=moved) - plain) / step
    for c in point.task.derivatives.candidates:
        if c.optical:
            for k, a in c.strengths.items():
                yield c.column(k), _optical(point, see, c, k, a, plain)
    for p in point.task.derivatives.own:
        if p.kind is Kind.EFFECT and point.case.known[p.effect].heat is Effect.heat:
            yield p, _refined(point, see, p, plain)


def flatten_valid_pixels(values: Array, inside: npt.NDArray[np.bool_]) -> Single:
    """Images (frames, nv, nu) as (frames, pixels inside), in single precision."""
    return values[:, inside].astype(np.float32)


def _optical(point: Point, see: Callable[..., Array], c: Candidate, k: str, a: float, plain: Array) -> Array:
    """Trace of an effect in the camera; with its whole strength where it is flat at off."""
    off = c.off()
    for share in (SHARE, 1.0):
        step = share * a
        slope = (see(acting=(*point.scene.acting, point.acting(c.effect, off | {k: off[k] + step}))) - plain) / step
        if np.nanmax(np.abs(slope)) * abs(a) > DULL:
            break
    return slope


def _refined(point: Point, see: Callable[..., Array], p: ParameterId, plain: Array) -> Array:
    """Trace of a parameter of an effect in the camera that the model holds already."""
    step, model = point.step(p), point.task.model
    others = tuple(a for a in point.scene.acting if a.name != p.effect)
    moved = point.acting(p.effect, model.effects[p.effect] | {p.name: model.value(p) + step})
    return (see(acting=(*others, moved)) - plain) / step


def _optics(seen: Seen, recording: Recording) -> Columns:
    """What the camera's own unknowns change: shift along u and v (px), scale, turn, gain, point spread (relative)."""
    told, slopes = bool(recording.registration_sigma_px), seen.slopes
    wide, high = len(recording.u) > 1, len(recording.v) > 1
    unknown = {
        SHIFTS[0]: told and wide,
        SHIFTS[1]: told and high and recording.view != "wake",
        Kind.SCALE: True,
        Kind.TURN: wide and high,
        Kind.GAIN: recording.view != "profile",
        Kind.SPREAD: bool(recording.psf_sigma_px),
    }
    return {ParameterId(k): slopes[k.value] for k, is_so in unknown.items() if is_so and slopes}


def _force(force: Force, near: Neighbourhood[ParameterId], other: Mapping[ParameterId, SeparateRun]) -> Observable:
    on, predicted = grip(near.run, force)
    columns = {name: near.slope(lambda run: grip(run, force)[1], name) for name in near.moved}
    columns |= {name: (grip(one.run, force)[1] - predicted) / one.step for name, one in other.items()}
    return Observable(predicted, on, {k: v.astype(np.float32) for k, v in columns.items()})
