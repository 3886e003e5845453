"""One condition seen at one point: what cameras and load cells would show, and what every parameter would change.

A `Task` is all that a worker needs; a `Look` is what comes back.  Nothing here knows the measured values.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from flashtemp.camera.observation import observe
from flashtemp.comparison.campaign import Force, View
from flashtemp.comparison.compare import check, grip, moments
from flashtemp.discovery.generic import with_mode, with_scatter
from flashtemp.discovery.hypothesis import SHARE, Candidate, Model, believed
from flashtemp.model import case as cases
from flashtemp.model.scene import Acting, Scene
from flashtemp.model.schema import declared
from flashtemp.physics.effect import Effect, catalogue
from flashtemp.solver.march import march
from flashtemp.solver.run import Run
from flashtemp.solver.sensitivity import Move, Neighbourhood, explore

STEP = 1e-30  # complex step of what is linear in pixels and radiance
FREE, SCATTER, MODE = 1e-3, 1e-2, 1e-2  # steps: of ln factors, of friction, of relative pressure
LAG = 0.02  # s: step of what moves frames in time
DULL = 5e-3  # K: a trace in the camera below it is taken again with the whole strength


@dataclass(frozen=True)
class Wanted:
    """Which traces to compute besides those of the model's own parameters: `scatter` of friction per
    repetition, pressure `modes` (and their `trends`), `candidates`."""

    own: tuple[str, ...] = ()
    scatter: bool = False
    modes: int = 0
    trends: bool = False
    candidates: tuple[Candidate, ...] = ()
    optics: bool = False


@dataclass(frozen=True)
class Task:
    """One condition at one point: `case` file with overrides `given` and `pins` of the mesh."""

    case: Path
    given: dict[str, Any]
    pins: dict[str, Any]
    model: Model
    views: tuple[View, ...]
    forces: tuple[Force, ...]
    wanted: Wanted = field(default_factory=Wanted)
    shifts: dict[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Sight:
    """A recording or trace predicted: `predicted` as measured (frames, nv, nu) or (n,), `inside` what may be compared.

    `columns` {name: change per unit of its parameter}, of the pixels inside (frames, pixels) or (n,).
    """

    predicted: np.ndarray
    inside: np.ndarray
    columns: dict[str, np.ndarray]


@dataclass(frozen=True)
class Look:
    """What a condition shows at a point, by file; `run` without its fields, for pictures and audits."""

    sights: dict[str, Sight]
    run: Run
    steps: dict[str, float]


def look(task: Task) -> Look:
    """Simulate a condition at a point with everything wanted beside it.  Raises BadInput, SolverFailure."""
    case = believed(task.case, task.given | task.pins, task.model)
    scene = cases.build(case)
    for view in task.views:
        check(view, scene)
    moves = _moves(task, case, scene)
    frames = moments(task.views, scene)
    early = tuple(t - LAG for t in frames if t > LAG) if task.wanted.candidates else ()
    settings = replace(cases.settings(case), times=tuple(sorted({*frames, *early})), fields=2)
    if moves:
        hood = explore(scene, settings, moves, case.title, frames, bool(task.forces))
    else:
        run = march(scene, settings, case.title)
        hood = Neighbourhood(run, None, {}, {})
    sights: dict[str, Sight] = {}
    for view in task.views:
        sights[view.file] = _view(task, view, scene, hood, moves)
    for force in task.forces:
        sights[force.file] = _force(force, hood, moves)
    thin = replace(hood.run, field=hood.run.field[:0], frames=hood.run.frames[:0])
    return Look(sights, thin, {k: m.step for k, m in moves.items()})


def _moves(task: Task, case, scene: Scene) -> dict[str, Move]:
    """Neighbouring scenes of everything that is wanted and acts on heat."""
    wanted, moves = task.wanted, {}

    def built(model: Model) -> Scene:
        return cases.build(believed(task.case, task.given | task.pins, model))

    for name in wanted.own:
        if name in task.model.free:
            step = -FREE if case[name] * np.exp(FREE) > _highest(name) else FREE
            moves[name] = Move(built(task.model.moved(name, step)), step)
        elif catalogue()[name.split(".")[0]].heat is not Effect.heat:
            moves[name] = _own(task, built, name)
    if wanted.scatter:
        for r in range(2, scene.schedule.repetitions + 1):
            begin = next(p.begin for p in scene.schedule.phases if p.repetition == r)
            moves[f"scatter:{r}"] = Move(with_scatter(scene, r, SCATTER), SCATTER, begin)
        moves["scatter:1"] = Move(with_scatter(scene, 1, SCATTER), SCATTER)
    for n in range(1, wanted.modes + 1):
        moves[f"mode:{n}"] = Move(with_mode(scene, n, MODE), MODE)
        if wanted.trends and scene.schedule.repetitions > 1:
            moves[f"trend:{n}"] = Move(with_mode(scene, n, MODE, True), MODE)
    for c in wanted.candidates:
        if c.optical:
            continue
        for number in range(len(c.variants)):
            for k, a in c.strengths.items():
                off, step = c.off(number), a if c.kind.params()[k].curved else SHARE * a
                moves[c.column(k, number)] = Move(
                    built(task.model.with_effect(c.effect, off | {k: off[k] + step})), step
                )
    return moves


def _highest(key: str) -> float:
    """Upper bound of a key of the case."""
    table, name = key.rsplit(".", 1)
    return declared(table)[name].high


def _own(task: Task, built, name: str) -> Move:
    """A parameter of an effect that the model holds already, moved away from the nearer bound."""
    effect, k = name.split(".")
    param, now = catalogue()[effect].params()[k], task.model.effects[effect][k]
    size = abs(param.value - param.off) if param.off is not None else abs(now)
    step = SHARE * (size or 1.0)
    if now + step > param.high:
        step = -step
    return Move(built(task.model.moved(name, step)), step)


def _view(task: Task, view: View, scene: Scene, hood: Neighbourhood, moves) -> Sight:
    recording, acting = view.recording, scene.acting
    shift = task.shifts.get(view.file, (0.0, 0.0))

    def see(run, scene=scene, acting=acting, recording=recording, shift=shift, change=0.0):
        return observe(run, scene, recording, acting, shift, change).temperature

    seen = observe(hood.run, scene, recording, acting, shift)
    columns: dict[str, np.ndarray] = {}
    level = see(hood.level) if moves else None
    for name, move in moves.items():
        columns[name] = (see(hood.moved[name], move.scene, move.scene.acting) - level) / move.step
    for c in task.wanted.candidates:
        if c.optical:
            for k, a in c.strengths.items():
                columns[c.column(k)] = _optical(see, hood.run, scene, c, k, a, seen.temperature)
    for name in task.wanted.own:
        if name not in columns and "." in name and name.split(".")[0] in task.model.effects:
            columns[name] = _refined(task, see, hood.run, scene, name, seen.temperature)
    if task.wanted.optics:
        columns |= _optics(see, hood.run, recording, shift)
    return Sight(seen.temperature, seen.inside, {k: packed(v, seen.inside) for k, v in columns.items()})


def packed(values: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Images (frames, nv, nu) as (frames, pixels inside), in single precision."""
    return values[:, inside].astype(np.float32)


def _acting(effect: str, values: dict[str, float]) -> Acting:
    return Acting(effect, catalogue()[effect](), SimpleNamespace(**values))


def _optical(see, run, scene, c: Candidate, k: str, a: float, plain) -> np.ndarray:
    """Trace of an effect in the camera; with its whole strength where it is flat at off."""
    for share in (SHARE, 1.0):
        step = share * a
        with_it = (*scene.acting, _acting(c.effect, c.off() | {k: c.off()[k] + step}))
        slope = (see(run, acting=with_it) - plain) / step
        if np.nanmax(np.abs(slope)) * abs(a) > DULL:
            break
    return slope


def _refined(task: Task, see, run, scene, name: str, plain) -> np.ndarray:
    """Trace of a parameter of an effect in the camera that the model holds already."""
    effect, k = name.split(".")
    param, now = catalogue()[effect].params()[k], task.model.effects[effect][k]
    step = SHARE * (abs(param.value - param.off) if param.off is not None else abs(now)) or SHARE
    if now + step > param.high:
        step = -step
    others = tuple(a for a in scene.acting if a.name != effect)
    moved = (*others, _acting(effect, task.model.effects[effect] | {k: now + step}))
    return (see(run, acting=moved) - plain) / step


def _optics(see, run, recording, shift) -> dict[str, np.ndarray]:
    """What the camera's own unknowns change: shift along u and v (px), gain, point spread (relative)."""
    out = {}
    for axis, n in ((0, len(recording.u)), (1, len(recording.v))):
        if n > 1 and recording.registration_sigma_px and (axis == 0 or recording.view != "wake"):
            moved = np.array(shift) + 1j * STEP * np.eye(2)[axis]
            out[f"shift_{'uv'[axis]}"] = see(run, shift=moved).imag / STEP
    if recording.view != "profile":
        out["gain"] = see(run, change=1j * STEP).imag / STEP
    if recording.psf_sigma_px:
        wide = replace(recording, psf_sigma_px=recording.psf_sigma_px * 1.01)
        out["spread"] = (see(run, recording=wide) - see(run)) / 0.01
    return out


def _force(force: Force, hood: Neighbourhood, moves) -> Sight:
    on, predicted = grip(hood.run, force)
    columns = {}
    for name in moves:
        columns[name] = hood.slope(lambda run: grip(run, force)[1], name)
    return Sight(predicted, on, {k: v.astype(np.float32) for k, v in columns.items()})
