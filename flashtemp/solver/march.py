"""March a scene through its schedule: events are exact restart points, everything else is CVODE's."""

from __future__ import annotations

import time as clock
import traceback
from collections.abc import Callable
from dataclasses import replace
from types import FunctionType

import numpy as np

from flashtemp.errors import FlashtempError, SolverFailure
from flashtemp.model.numerics import Settings
from flashtemp.model.scene import Scene
from flashtemp.physics.quantities import KELVIN
from flashtemp.solver import limits
from flashtemp.solver.balance import Balance
from flashtemp.solver.circular_track import inflow, pass_by, remembers, track_of
from flashtemp.solver.cvode import Integrator, Tolerance
from flashtemp.solver.progress import Progress
from flashtemp.solver.recorder import finish, record, record_times
from flashtemp.solver.run import Run
from flashtemp.solver.system import System
from flashtemp.solver.turning import pass_on, renew, renews

PRESSURE_SHARE = 0.01  # of the integrator's relative tolerance: what is left of the pressure's own iteration
Path = list[tuple[float, np.ndarray]]  # time and state of every step


def march(
    scene: Scene,
    settings: Settings,
    title: str = "",
    state: Progress | None = None,
    watch: Callable[[Progress], bool] | None = None,
    beside=None,
) -> Run:
    """Integrate the scene over its whole schedule and return the Run.

    `beside` is told about every stretch, every restart and every turn (`sensitivity.Neighbours`).

    `watch(progress)` is called after every internal step; returning True stops the march with
    KeyboardInterrupt, `progress` then holds all that is needed to go on.  Raises SolverFailure
    with time, cell and effect.
    """
    began = clock.perf_counter()
    balance = _balance(scene, settings)
    now = state or Progress()
    resumed, spent = now.y is not None, now.wall
    if not resumed:
        now.y, now.left = balance.initial(), np.zeros(2)
    if now.track is None and remembers(scene):
        now.track = replace(track_of(balance, scene.schedule.lap), **(now.columns or {}))

    def stop() -> bool:
        now.wall = spent + clock.perf_counter() - began
        return watch is not None and watch(now)

    phases, at = scene.schedule.phases, 0
    while now.phase < len(phases):
        phase = phases[now.phase]
        if not resumed and now.phase > 0 and renews(phases[now.phase - 1], phase):
            _renew(balance, phases[now.phase - 1], phase, now, beside)
        due = record_times(phase, scene.schedule, settings)
        for system in _legs(balance, phase, now, resumed):
            if not resumed and system.leg > at:
                _pass_on(system, now, beside)
            at = system.leg
            path: Path | None = [] if beside is not None else None
            _stretch(system, settings, now, due, resumed, stop, path)
            if beside is not None:
                beside.stretch(system.phase, path, now.records, system.leg)
            resumed = False
        now.phase += 1
    now.wall = spent + clock.perf_counter() - began
    return limits.audit(finish(balance, now, title), absolute_tolerance(settings))


def _balance(scene: Scene, settings: Settings) -> Balance:
    """The heat balance of a scene; SolverFailure names the law that fails already now."""
    try:
        return Balance(scene, PRESSURE_SHARE * settings.rtol)
    except Exception as fault:
        if (said := law_at_fault(scene, fault)) is not None:
            raise SolverFailure(f"{said}; before the start") from fault
        raise


def _legs(balance: Balance, phase, now: Progress, resumed: bool) -> list[System]:
    """The system during a phase, or during each leg of it where the road is in its own frame; what is over is left out.

    A leg that is over just now is not: it says how the state lies in memory.
    """
    flow, frame = inflow(balance, phase, now.track), balance.road_frame
    if frame is None:
        return [System(balance, phase, flow)]
    legs = frame.legs(balance.scene.schedule, phase)
    return [System(balance, part, flow, leg) for leg, part in legs if not (resumed and part.end < now.t)]


def _renew(balance: Balance, before, phase, now: Progress, beside) -> None:
    """A new repetition begins, or the block turns; `beside` is told out of what state."""
    old = now.y
    renew(balance, before, phase, now)
    if beside is not None:
        beside.renew(before, phase, old)


def _pass_on(system: System, now: Progress, beside) -> None:
    """The road in its own frame is put back on the mesh; `beside` is told out of what state."""
    old = now.y
    pass_on(system, now)
    if beside is not None:
        beside.pass_on(system.phase, system.leg, old)


def _stretch(system: System, settings, now: Progress, due, resumed: bool, stop: Callable[[], bool], path) -> None:
    """One phase or leg: integrate, record what is `due`, keep what leaves on the track; `path` gets every step."""
    phase = system.phase
    solver = Integrator(settings.binding, system, _tolerance(system, settings))
    t, y, before = phase.begin, now.y, now.steps
    if resumed:
        last = now.records["time"][-1] if now.records else -np.inf  # a fault may have come between two of a step
        t, due[:] = now.t, [one for one in due if one[0] > last]
    tiny = 1e-9 * (phase.end - phase.begin)
    try:
        if due and due[0][0] <= t + tiny:
            at, frame = due.pop(0)
            _keep(system, at, y, now, frame, settings)
        solver.start(t, y, phase.end)
        if path is not None:
            path.append((t, y))
        while phase.end - t > tiny:
            reached, (t, y) = t, solver.step()
            if path is not None:
                path.append((t, y))
            while due and due[0][0] <= t + tiny:
                at, frame = due.pop(0)
                _keep(system, at, y if abs(at - t) <= tiny else solver.at(at), now, frame, settings)
            if now.track is not None and phase.sliding:
                pass_by(system, reached, t, solver.at, now.track)
            now.t, now.y, now.steps = t, y, before + solver.steps
            _check(system, t, system.b.rise(y[: system.b.n]), settings)
            if stop():
                raise KeyboardInterrupt
        solver.close()
    except Exception as fault:
        _tell(system, now, fault)
        raise
    finally:
        for name, count in solver.calls.items():
            now.calls[name] += count


def _keep(system: System, t: float, y, now: Progress, frame: bool, settings: Settings) -> None:
    """Record a state, if its profiles can be."""
    record(system, t, y, now, frame)
    shown = np.concatenate([now.records[name][-1] for name in ("T_block", "T_spot", "T_road", "T_wake")])
    _check(system, t, shown + KELVIN - system.b.scene.ambient, settings)


def _check(system: System, t: float, T, settings: Settings) -> None:
    limits.check(system, t, T, hottest=settings.hottest, atol=absolute_tolerance(settings))


def absolute_tolerance(settings: Settings) -> float:
    """Absolute tolerance (K) of the integrator."""
    return settings.atol or 10 * settings.rtol


def _tolerance(system: System, settings: Settings) -> Tolerance:
    """Tolerances of a phase; no step is longer than an effect's pace allows."""
    phase = system.phase
    pace = float(system.b.laws("march.rate", 0.0, None, system.moment(phase.begin)))
    longest = 1.0 / pace if phase.sliding and pace > 0 else 0.0  # 0: as long as the phase
    return Tolerance(settings.rtol, absolute_tolerance(settings), settings.order, longest)


def _tell(system: System, now: Progress, fault: Exception) -> None:
    """Raise SolverFailure with time, place and effect where a solve or a law fails."""
    if isinstance(fault, SolverFailure):
        raise SolverFailure(_explain(system, now.t, now.y, fault)) from fault
    if (said := law_at_fault(system.b.scene, fault)) is not None:
        raise SolverFailure(f"{said}; after t = {now.t:.6g} s") from fault


def law_at_fault(scene: Scene, fault: Exception) -> str | None:
    """The effect in whose file an exception arose, with the line; None where no law is to blame."""
    names = {type(a.effect).heat.__code__.co_filename: a.name for a in scene.acting}
    frames = [(frame.f_code.co_filename, line) for frame, line in traceback.walk_tb(fault.__traceback__)]
    if not isinstance(fault, FlashtempError):  # called wrongly, or its answer is no number: then it has no frame itself
        *_, (last, _) = traceback.walk_tb(fault.__traceback__)
        laws = (getattr(last.f_locals.get(name), "law", None) for name in ("factor", "part"))
        asked = next((law.__code__ for law in laws if isinstance(law, FunctionType)), last.f_code)
        frames.append((asked.co_filename, asked.co_firstlineno))
    for file, line in reversed(frames):
        if file in names:
            said = f"{type(fault).__name__}: {fault}"
            return f"effect '{names[file]}' ({file}:{line}): its law fails: {said}; repair that line"
    return None


def _explain(system: System, t: float, y: np.ndarray, fault: SolverFailure) -> str:
    """The failure with time, hottest cell and the effect with the largest heat."""
    b, mesh = system.b, system.b.scene.mesh
    h = system.placed(system.moment(t), y)[: b.n]
    bad = np.flatnonzero(~np.isfinite(h))
    cell = int(bad[0]) if len(bad) else int(np.argmax(np.abs(h)))
    body = "block" if mesh.level[cell // mesh.n_across] >= mesh.n_road else "road"
    x, y_at, z = mesh.place(cell)
    where = f"x = {x * 1e3:.3g} mm, " + (f"y = {y_at * 1e3:.3g} mm, " if mesh.n_across > 1 else "")
    T = b.rise(h) + b.scene.ambient
    moment = system.evenly_pressed(system.moment(t))  # what failed may be the pressure itself
    sizes = b.laws.contributors(T[b.cell_block], moment)
    broken = [name for name, size in sizes.items() if not np.isfinite(size)]
    largest = f"largest effect: {max(sizes, key=sizes.__getitem__) if sizes else 'none'}"
    return (
        f"{fault}; at t = {t:.6g} s, hottest {body} cell {where}z = {z * 1e3:.3g} mm "
        f"({T[cell] - KELVIN:.4g} degC), {f'no number comes from effect {broken[0]}' if broken else largest}"
    )
