"""Time integration of a scene over its schedule: the integrator restarts at events, CVODE chooses all other steps."""

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
from flashtemp.solver.integration_state import IntegrationState
from flashtemp.solver.phase_transitions import has_state_change, remap_road, start_phase
from flashtemp.solver.recorder import build_run, record_state, record_times
from flashtemp.solver.run import Run
from flashtemp.solver.system import PhaseSystem

PRESSURE_RTOL_RATIO = 0.01  # of the integrator's relative tolerance: tolerance of the pressure's Newton iteration
StepHistory = list[tuple[float, np.ndarray]]  # time and state of every step


def integrate_schedule(
    scene: Scene,
    settings: SolverSettings,
    title: str = "",
    state: IntegrationState | None = None,
    watch: Callable[[IntegrationState], bool] | None = None,
    sensitivities=None,
) -> Run:
    """Integrate the scene over its whole schedule and return the Run.

    `state` resumes a stopped integration.  `watch(state)` is called after every internal step; if it returns True,
    the integration stops with KeyboardInterrupt and `state` holds all that is needed to resume.  `sensitivities` (a
    `sensitivity.SensitivityIntegrator`) follows every segment, restart and reversal.  Raises SolverFailure with time,
    cell and effect, and EnergyBalanceError.
    """
    began = clock.perf_counter()
    balance = _build_balance(scene, settings)
    now = state or IntegrationState()
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
            # a resumed state is stored for its own leg already
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
    """The heat balance of a scene.  Raises SolverFailure with the effect whose law fails before the start."""
    try:
        return HeatBalance(scene, PRESSURE_RTOL_RATIO * settings.rtol)
    except Exception as fault:
        if (message := find_failing_law(scene, fault)) is not None:
            raise SolverFailure(f"{message}; before the start") from fault
        raise


def _phase_systems(balance: HeatBalance, phase, state: IntegrationState, resumed: bool) -> list[PhaseSystem]:
    """The system during a phase, or one per leg where the road is in its own frame; legs already done are left out.

    A leg that ends exactly at the time of a resumed integration is kept, because it defines how the state is stored.
    """
    flow, frame = build_inflow(balance, phase, state.track), balance.road_frame
    if frame is None:
        return [PhaseSystem(balance, phase, flow)]
    legs = frame.split_phase(balance.scene.schedule, phase)
    return [PhaseSystem(balance, part, flow, leg) for leg, part in legs if not (resumed and part.end < state.t)]


def _start_phase(balance: HeatBalance, before, phase, state: IntegrationState, sensitivities) -> None:
    """Begin a new repetition, or reverse the block, in the run and in its sensitivities."""
    old = state.y
    start_phase(balance, before, phase, state)
    if sensitivities is not None:
        sensitivities.start_phase(before, phase, old)


def _remap_road(system: PhaseSystem, state: IntegrationState, sensitivities) -> None:
    """Shift the road in its own frame back on the mesh, in the run and in its sensitivities."""
    old = state.y
    remap_road(system, state)
    if sensitivities is not None:
        sensitivities.remap_road(system.phase, system.leg, old)


def _integrate_segment(
    system: PhaseSystem,
    settings,
    state: IntegrationState,
    due,
    resumed: bool,
    stop: Callable[[], bool],
    path,
) -> None:
    """Integrate one phase or leg: record at the times `due`, store road that leaves, append every step to `path`."""
    phase = system.phase
    solver = BdfIntegrator(settings.binding, system, _integrator_settings(system, settings))
    t, y, before = phase.begin, state.y, state.steps
    if resumed:
        # records of a step are made before its state is kept, so a failure may leave records after the resumed time
        last = state.records["time"][-1] if state.records else -np.inf
        t, due[:] = state.t, [one for one in due if one[0] > last]
    tiny = 1e-9 * (phase.end - phase.begin)
    try:
        if due and due[0][0] <= t + tiny:
            at, frame = due.pop(0)
            _record_checked(system, at, y, state, frame, settings)
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
                    system, at, y if abs(at - t) <= tiny else solver.interpolate(at), state, frame, settings
                )
            if state.track is not None and phase.sliding:
                store_passed_road(system, reached, t, solver.interpolate, state.track)
            state.t, state.y, state.steps = t, y, before + solver.steps
            _check(system, t, system.b.temperature_rise(y[: system.b.n]), settings)
            if stop():
                raise KeyboardInterrupt
        solver.close()
    except Exception as fault:
        _raise_with_context(system, state, fault)
        raise
    finally:
        for name, count in solver.calls.items():
            state.calls[name] += count


def _record_checked(
    system: PhaseSystem, t: float, y, state: IntegrationState, frame: bool, settings: SolverSettings
) -> None:
    """Record a state and check its profiles.  Raises SolverFailure for temperatures out of bounds."""
    record_state(system, t, y, state, frame)
    profiles = np.concatenate([state.records[name][-1] for name in ("T_block", "T_spot", "T_road", "T_wake")])
    _check(system, t, profiles + KELVIN - system.b.scene.ambient, settings)


def _check(system: PhaseSystem, t: float, T, settings: SolverSettings) -> None:
    sanity_checks.check_temperatures(system, t, T, hottest=settings.hottest, atol=absolute_tolerance(settings))


def absolute_tolerance(settings: SolverSettings) -> float:
    """Absolute tolerance (K) of the integrator."""
    return settings.atol or 10 * settings.rtol


def _integrator_settings(system: PhaseSystem, settings: SolverSettings) -> IntegratorSettings:
    """Tolerances of a phase; the law `march.rate` (1/s) of an effect limits the length of steps."""
    phase = system.phase
    rate = float(system.b.laws("march.rate", 0.0, None, system.law_context(phase.begin)))
    longest = 1.0 / rate if phase.sliding and rate > 0 else 0.0  # 0: no limit
    return IntegratorSettings(settings.rtol, absolute_tolerance(settings), settings.order, longest)


def _raise_with_context(system: PhaseSystem, state: IntegrationState, fault: Exception) -> None:
    """Raise SolverFailure with time, position and effect for a failed solve or law; return for any other fault."""
    if isinstance(fault, SolverFailure):
        raise SolverFailure(_describe_failure(system, state.t, state.y, fault)) from fault
    if (message := find_failing_law(system.b.scene, fault)) is not None:
        raise SolverFailure(f"{message}; after t = {state.t:.6g} s") from fault


def find_failing_law(scene: Scene, fault: Exception) -> str | None:
    """A message with the effect, file and line in which an exception arose; None if it was not in a law."""
    names = {type(a.effect).heat.__code__.co_filename: a.name for a in scene.acting}
    frames = [(frame.f_code.co_filename, line) for frame, line in traceback.walk_tb(fault.__traceback__)]
    if not isinstance(fault, FlashtempError):
        # a law with a wrong signature, or whose result is no number, has no frame: find it in the caller's local names
        *_, (last, _) = traceback.walk_tb(fault.__traceback__)
        laws = (getattr(last.f_locals.get(name), "law", None) for name in ("factor", "part"))
        code = next((law.__code__ for law in laws if isinstance(law, FunctionType)), last.f_code)
        frames.append((code.co_filename, code.co_firstlineno))
    for file, line in reversed(frames):
        if file in names:
            error = f"{type(fault).__name__}: {fault}"
            return f"effect '{names[file]}' ({file}:{line}): its law fails: {error}; repair that line"
    return None


def _describe_failure(system: PhaseSystem, t: float, y: np.ndarray, fault: SolverFailure) -> str:
    """A message with the failure, time, hottest cell and the effect with the largest heat."""
    b, mesh = system.b, system.b.scene.mesh
    h = system.to_block_frame(system.law_context(t), y)[: b.n]
    bad = np.flatnonzero(~np.isfinite(h))
    cell = int(bad[0]) if len(bad) else int(np.argmax(np.abs(h)))
    body = "block" if mesh.level[cell // mesh.n_across] >= mesh.n_road else "road"
    x, y_at, z = mesh.place(cell)
    where = f"x = {x * 1e3:.3g} mm, " + (f"y = {y_at * 1e3:.3g} mm, " if mesh.n_across > 1 else "")
    T = b.temperature_rise(h) + b.scene.ambient
    context = system.uniform_pressure_context(system.law_context(t))  # the local pressure may be what failed
    sizes = b.laws.heat_by_effect(T[b.cell_block], context)
    broken = [name for name, size in sizes.items() if not np.isfinite(size)]
    largest = f"largest effect: {max(sizes, key=sizes.__getitem__) if sizes else 'none'}"
    return (
        f"{fault}; at t = {t:.6g} s, hottest {body} cell {where}z = {z * 1e3:.3g} mm "
        f"({T[cell] - KELVIN:.4g} degC), {f'effect {broken[0]} returns no number' if broken else largest}"
    )
