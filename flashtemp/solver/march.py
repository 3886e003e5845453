"""March a scene through its schedule: events are exact restart points, everything else is CVODE's."""

from __future__ import annotations

import time as clock
import traceback
from collections.abc import Callable
from dataclasses import replace
from types import FunctionType

import numpy as np

from flashtemp.errors import FlashtempError, SolverFailure
from flashtemp.model.numerics import SolverSettings
from flashtemp.model.scene import Scene
from flashtemp.physics.quantities import KELVIN
from flashtemp.solver import sanity_checks
from flashtemp.solver.circular_track import build_inflow, build_track, has_road_memory, store_passed_road
from flashtemp.solver.cvode import BdfIntegrator, IntegratorSettings
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.march_state import MarchState
from flashtemp.solver.phase_transitions import has_state_change, remap_road, start_phase
from flashtemp.solver.recorder import build_run, record_state, record_times
from flashtemp.solver.run import Run
from flashtemp.solver.system import PhaseSystem

PRESSURE_RTOL_RATIO = 0.01  # of the integrator's relative tolerance: what is left of the pressure's own iteration
StepHistory = list[tuple[float, np.ndarray]]  # time and state of every step


def march(
    scene: Scene,
    settings: SolverSettings,
    title: str = "",
    state: MarchState | None = None,
    watch: Callable[[MarchState], bool] | None = None,
    sensitivities=None,
) -> Run:
    """Integrate the scene over its whole schedule and return the Run.

    `sensitivities` is told about every stretch, every restart and every turn (`sensitivity.Neighbours`).

    `watch(progress)` is called after every internal step; returning True stops the march with
    KeyboardInterrupt, `progress` then holds all that is needed to go on.  Raises SolverFailure
    with time, cell and effect.
    """
    began = clock.perf_counter()
    balance = _build_balance(scene, settings)
    now = state or MarchState()
    resumed, spent = now.y is not None, now.wall_s
    if not resumed:
        now.y, now.removed_heat = balance.initial_state(), np.zeros(2)
    if now.track is None and has_road_memory(scene):
        now.track = replace(build_track(balance, scene.schedule.lap), **(now.track_columns or {}))

    def is_stopped() -> bool:
        now.wall_s = spent + clock.perf_counter() - began
        return watch is not None and watch(now)

    phases, at = scene.schedule.phases, 0
    while now.phase < len(phases):
        phase = phases[now.phase]
        if not resumed and now.phase > 0 and has_state_change(phases[now.phase - 1], phase):
            _start_phase(balance, phases[now.phase - 1], phase, now, sensitivities)
        due = record_times(phase, scene.schedule, settings)
        for system in _phase_systems(balance, phase, now, resumed):
            if not resumed and system.leg > at:
                _remap_road(system, now, sensitivities)
            at = system.leg
            path: StepHistory | None = [] if sensitivities is not None else None
            _integrate_segment(system, settings, now, due, resumed, is_stopped, path)
            if sensitivities is not None:
                sensitivities.integrate_segment(system.phase, path, now.records, system.leg)
            resumed = False
        now.phase += 1
    now.wall_s = spent + clock.perf_counter() - began
    return sanity_checks.check_energy_balance(build_run(balance, now, title), absolute_tolerance(settings))


def _build_balance(scene: Scene, settings: SolverSettings) -> HeatBalance:
    """The heat balance of a scene; SolverFailure names the law that fails already now."""
    try:
        return HeatBalance(scene, PRESSURE_RTOL_RATIO * settings.rtol)
    except Exception as fault:
        if (said := find_failing_law(scene, fault)) is not None:
            raise SolverFailure(f"{said}; before the start") from fault
        raise


def _phase_systems(balance: HeatBalance, phase, march_state: MarchState, resumed: bool) -> list[PhaseSystem]:
    """The system during a phase, or during each leg of it where the road is in its own frame; what is over is left out.

    A leg that is over just now is not: it says how the state lies in memory.
    """
    flow, frame = build_inflow(balance, phase, march_state.track), balance.road_frame
    if frame is None:
        return [PhaseSystem(balance, phase, flow)]
    legs = frame.split_phase(balance.scene.schedule, phase)
    return [PhaseSystem(balance, part, flow, leg) for leg, part in legs if not (resumed and part.end < march_state.t)]


def _start_phase(balance: HeatBalance, before, phase, march_state: MarchState, sensitivities) -> None:
    """A new repetition begins, or the block turns; `sensitivities` is told out of what state."""
    old = march_state.y
    start_phase(balance, before, phase, march_state)
    if sensitivities is not None:
        sensitivities.start_phase(before, phase, old)


def _remap_road(system: PhaseSystem, march_state: MarchState, sensitivities) -> None:
    """The road in its own frame is put back on the mesh; `sensitivities` is told out of what state."""
    old = march_state.y
    remap_road(system, march_state)
    if sensitivities is not None:
        sensitivities.remap_road(system.phase, system.leg, old)


def _integrate_segment(
    system: PhaseSystem, settings, march_state: MarchState, due, resumed: bool, stop: Callable[[], bool], path
) -> None:
    """One phase or leg: integrate, record what is `due`, keep what leaves on the track; `path` gets every step."""
    phase = system.phase
    solver = BdfIntegrator(settings.binding, system, _integrator_settings(system, settings))
    t, y, before = phase.begin, march_state.y, march_state.steps
    if resumed:
        last = (
            march_state.records["time"][-1] if march_state.records else -np.inf
        )  # a fault may have come between two of a step
        t, due[:] = march_state.t, [one for one in due if one[0] > last]
    tiny = 1e-9 * (phase.end - phase.begin)
    try:
        if due and due[0][0] <= t + tiny:
            at, frame = due.pop(0)
            _record_checked(system, at, y, march_state, frame, settings)
        solver.start(t, y, phase.end)
        if path is not None:
            path.append((t, y))
        while phase.end - t > tiny:
            reached, (t, y) = t, solver.step()
            if path is not None:
                path.append((t, y))
            while due and due[0][0] <= t + tiny:
                at, frame = due.pop(0)
                _record_checked(
                    system, at, y if abs(at - t) <= tiny else solver.interpolate(at), march_state, frame, settings
                )
            if march_state.track is not None and phase.sliding:
                store_passed_road(system, reached, t, solver.interpolate, march_state.track)
            march_state.t, march_state.y, march_state.steps = t, y, before + solver.steps
            _check(system, t, system.b.temperature_rise(y[: system.b.n]), settings)
            if stop():
                raise KeyboardInterrupt
        solver.close()
    except Exception as fault:
        _raise_with_context(system, march_state, fault)
        raise
    finally:
        for name, count in solver.calls.items():
            march_state.calls[name] += count


def _record_checked(
    system: PhaseSystem, t: float, y, march_state: MarchState, frame: bool, settings: SolverSettings
) -> None:
    """Record a state, if its profiles can be."""
    record_state(system, t, y, march_state, frame)
    shown = np.concatenate([march_state.records[name][-1] for name in ("T_block", "T_spot", "T_road", "T_wake")])
    _check(system, t, shown + KELVIN - system.b.scene.ambient, settings)


def _check(system: PhaseSystem, t: float, T, settings: SolverSettings) -> None:
    sanity_checks.check_temperatures(system, t, T, hottest=settings.hottest, atol=absolute_tolerance(settings))


def absolute_tolerance(settings: SolverSettings) -> float:
    """Absolute tolerance (K) of the integrator."""
    return settings.atol or 10 * settings.rtol


def _integrator_settings(system: PhaseSystem, settings: SolverSettings) -> IntegratorSettings:
    """Tolerances of a phase; no step is longer than an effect's pace allows."""
    phase = system.phase
    pace = float(system.b.laws("march.rate", 0.0, None, system.moment(phase.begin)))
    longest = 1.0 / pace if phase.sliding and pace > 0 else 0.0  # 0: as long as the phase
    return IntegratorSettings(settings.rtol, absolute_tolerance(settings), settings.order, longest)


def _raise_with_context(system: PhaseSystem, march_state: MarchState, fault: Exception) -> None:
    """Raise SolverFailure with time, place and effect where a solve or a law fails."""
    if isinstance(fault, SolverFailure):
        raise SolverFailure(_describe_failure(system, march_state.t, march_state.y, fault)) from fault
    if (said := find_failing_law(system.b.scene, fault)) is not None:
        raise SolverFailure(f"{said}; after t = {march_state.t:.6g} s") from fault


def find_failing_law(scene: Scene, fault: Exception) -> str | None:
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


def _describe_failure(system: PhaseSystem, t: float, y: np.ndarray, fault: SolverFailure) -> str:
    """The failure with time, hottest cell and the effect with the largest heat."""
    b, mesh = system.b, system.b.scene.mesh
    h = system.to_block_frame(system.moment(t), y)[: b.n]
    bad = np.flatnonzero(~np.isfinite(h))
    cell = int(bad[0]) if len(bad) else int(np.argmax(np.abs(h)))
    body = "block" if mesh.level[cell // mesh.n_across] >= mesh.n_road else "road"
    x, y_at, z = mesh.place(cell)
    where = f"x = {x * 1e3:.3g} mm, " + (f"y = {y_at * 1e3:.3g} mm, " if mesh.n_across > 1 else "")
    T = b.temperature_rise(h) + b.scene.ambient
    moment = system.uniform_pressure_moment(system.moment(t))  # what failed may be the pressure itself
    sizes = b.laws.heat_by_effect(T[b.cell_block], moment)
    broken = [name for name, size in sizes.items() if not np.isfinite(size)]
    largest = f"largest effect: {max(sizes, key=sizes.__getitem__) if sizes else 'none'}"
    return (
        f"{fault}; at t = {t:.6g} s, hottest {body} cell {where}z = {z * 1e3:.3g} mm "
        f"({T[cell] - KELVIN:.4g} degC), {f'no number comes from effect {broken[0]}' if broken else largest}"
    )
