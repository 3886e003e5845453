"""March a scene through its schedule: events are exact restart points, everything else is CVODE's."""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from flashtemp.errors import SolverFailure
from flashtemp.model.numerics import Settings
from flashtemp.model.scene import Scene
from flashtemp.physics.quantities import KELVIN
from flashtemp.solver.balance import Balance
from flashtemp.solver.circular_track import Track
from flashtemp.solver.cvode import Integrator, Tolerance
from flashtemp.solver.field_store import Frames
from flashtemp.solver.run import Run
from flashtemp.solver.system import Stage


@dataclass
class Progress:
    """Where a march stands; enough to go on from a checkpoint."""

    t: float = 0.0
    phase: int = 0
    y: np.ndarray | None = None
    records: dict[str, list] = field(default_factory=dict)
    frames: Frames = field(default_factory=Frames)
    steps: int = 0
    calls: dict[str, int] = field(default_factory=lambda: {"rate": 0, "times": 0, "setup": 0, "solve": 0})
    wall: float = 0.0
    left: np.ndarray | None = None  # heat (J/m) in block and lanes removed at restarts
    track: Track | None = None
    columns: dict[str, list] | None = None  # of the track, as read from a checkpoint


def stretches(phase, schedule) -> int:
    """Into how many stretches events divide the sliding of this repetition."""
    return sum(p.sliding and p.repetition == phase.repetition for p in schedule.phases)


def record_times(phase, schedule, settings: Settings) -> np.ndarray:
    """Times (s) at which profiles are kept: dense after each start or stop, and every end."""
    sliding = -(-settings.profiles // stretches(phase, schedule))
    n = sliding if phase.sliding else max(4, settings.profiles // 4)
    t = phase.begin + (phase.end - phase.begin) * (np.arange(n + 1) / n) ** 2
    t[-1] = phase.end
    return t if phase.begin == 0.0 else t[1:]


def march(
    scene: Scene,
    settings: Settings,
    title: str = "",
    state: Progress | None = None,
    watch: Callable[[Progress], bool] | None = None,
    beside=None,
) -> Run:
    """Integrate the scene over its whole schedule and return the Run.

    `beside` is told about every stretch and every restart (`tangent.Neighbours`).

    `watch(progress)` is called after every internal step; returning True stops the march with
    KeyboardInterrupt, `progress` then holds all that is needed to go on.  Raises SolverFailure
    with time, cell and effect.
    """
    began = clock.perf_counter()
    balance = Balance(scene)
    now = state or Progress()
    resumed, spent = now.y is not None, now.wall
    if not resumed:
        now.y, now.left = balance.initial(), np.zeros(2)
    if now.track is None and scene.schedule.lap is not None:
        now.track = replace(lap_memory(scene), **(now.columns or {}))
    phases = scene.schedule.phases
    while now.phase < len(phases):
        phase = phases[now.phase]
        if not resumed and phase.sliding and phase.begin == phase.start and now.phase > 0:
            old = now.y
            restart(scene, balance, phases[now.phase - 1], now)
            if beside is not None:
                beside.restart(phases[now.phase - 1], old, now.y)
        path = [] if beside is not None else None
        _stretch(balance, phase, settings, now, resumed, watch, spent, began, path)
        if beside is not None:
            beside.stretch(phase, path, now.records)
        resumed = False
        now.phase += 1
    now.wall = spent + clock.perf_counter() - began
    return finish(scene, balance, now, title)


def _stretch(balance, phase, settings, now, resumed, watch, spent, began, path) -> None:
    """One phase: integrate, record, keep what leaves on the track; `path` gets every step."""
    scene = balance.scene
    stage = Stage(balance, phase, inflow(scene, phase, now.track))
    longest, pace = phase.end - phase.begin, float(balance.laws("march.rate", 0.0, None, stage.moment(phase.begin)))
    if phase.sliding and pace > 0:
        longest = min(longest, 1.0 / pace)
    tol = Tolerance(settings.rtol, settings.atol or 10 * settings.rtol, settings.order, longest)
    solver = Integrator(settings.binding, stage, tol)
    times = record_times(phase, scene.schedule, settings).tolist()
    total, wanted = len(times), -(-settings.fields // stretches(phase, scene.schedule)) if phase.sliding else 2
    keep = {times[round(i * (total - 1) / max(1, wanted - 1))] for i in range(wanted)} if times else set()
    asked = {t for t in settings.times if phase.begin < t <= phase.end or t == phase.begin == 0.0}
    times, keep = sorted({*times, *asked}), keep | asked
    if resumed:
        times = [t for t in times if t > now.t]
    t, y = (now.t, now.y) if resumed else (phase.begin, now.y)
    tiny = 1e-9 * (phase.end - phase.begin)
    before = now.steps
    try:
        if times and times[0] <= t + tiny:
            at = times.pop(0)
            record(balance, stage, at, y, now, at in keep)
        solver.start(t, y, phase.end)
        if path is not None:
            path.append((t, y))
        while phase.end - t > tiny:
            t, y = solver.step()
            if path is not None:
                path.append((t, y))
            while times and times[0] <= t + tiny:
                at = times.pop(0)
                record(balance, stage, at, y if abs(at - t) <= tiny else solver.at(at), now, at in keep)
            if now.track is not None and phase.sliding:
                leave(scene, stage, t, y, now.track)
            now.t, now.y = t, y
            now.steps = before + solver.steps
            now.wall = spent + clock.perf_counter() - began
            if watch is not None and watch(now):
                _count(now, stage)
                raise KeyboardInterrupt
    except SolverFailure as fault:
        raise SolverFailure(_explain(balance, stage, now.t, now.y, fault)) from fault
    _count(now, stage)


def _count(now, stage) -> None:
    for name, value in stage.calls.items():
        now.calls[name] += value


def _explain(balance, stage, t, y, fault) -> str:
    """The failure with time, hottest cell and the effect with the largest heat."""
    mesh, h = balance.scene.mesh, y[: balance.n]
    bad = np.flatnonzero(~np.isfinite(h))
    cell = int(bad[0]) if len(bad) else int(np.argmax(np.abs(h)))
    body = "block" if mesh.level[cell // mesh.n_across] >= mesh.n_road else "road"
    x, y_at, z = mesh.place(cell)
    where = f"x = {x * 1e3:.3g} mm, " + (f"y = {y_at * 1e3:.3g} mm, " if mesh.n_across > 1 else "")
    T = balance.rise(h) + balance.scene.ambient
    moment = stage.moment(t)  # evenly pressed: what failed may be the pressure itself
    even = stage.footprint.state(moment, np.full(len(mesh.column_x), moment.pressure))
    moment = stage.footprint.at(even, moment)
    sizes = balance.laws.contributors(T[balance.cell_block], moment)
    effect = max(sizes, key=sizes.get) if sizes else "none"
    return (
        f"{fault}; at t = {t:.6g} s, hottest {body} cell {where}z = {z * 1e3:.3g} mm "
        f"({T[cell] - KELVIN:.4g} degC), largest effect: {effect}"
    )


def lap_memory(scene: Scene) -> Track:
    film = sum(
        part.law(scene.moment(scene.schedule.phases[0], 0.0), a.p)
        for a in scene.acting
        for part in a.contributions(scene)
        if getattr(part, "site", "") == "road.free" and part.kind == "film"
    )
    lateral = (scene.spot_diameter / 2) ** 2 / (5.78 * scene.road.diffusivity)
    dz = scene.mesh.thickness[: scene.mesh.n_road]
    road, planes = scene.road, scene.mesh.n_across
    return Track(scene.track_length, dz, road.conductivity, road.volumetric_capacity, film, lateral, planes)


def inflow(scene, phase, track):
    if track is None:
        return None

    def carried(now):
        slid = phase.slid_before + now.slid
        return track.carried(now.t, slid - scene.mesh.x[0])

    return carried


def leave(scene, stage, t, y, track) -> None:
    """Keep the column that leaves the window, at most 400 per lap."""
    now = stage.moment(t)
    place = stage.phase.slid_before + now.slid - scene.mesh.x[-1]
    if track.place and place - track.place[-1] < track.lap / 400:
        return
    last = scene.mesh.everywhere(scene.mesh.road[-1]).ravel()
    column, drift = stage.b.rise(y[: stage.b.n])[last], now.ambient - scene.ambient
    track.leave(t, place, column - drift, stage.entering(now) - drift, stage.meet(now, y).state.covered)


def restart(scene, balance, before, now) -> None:
    """The road at a new start: spread sideways where the block rested on it, else forgotten or carried."""
    mesh = scene.mesh
    y = now.y.copy()
    old = balance.stored(y)
    stage = Stage(balance, before, inflow(scene, before, now.track))
    moment = stage.moment(before.end)
    rise = balance.rise(y[: balance.n])
    road, entering = mesh.planes(rise)[mesh.road], stage.entering(moment).reshape(mesh.n_road, -1)
    fresh = entering + 0.0 * road
    if not scene.schedule.lifted:
        spread = stage.footprint.lanes(stage.meet(moment, y).state, moment)
        fresh += spread[:, None, None] * (road - entering)
    elif now.track is not None:
        share = stage.meet(moment, y).state.covered
        mixed = share + (1 - share) * np.exp(-moment.waited / now.track.lateral)
        fresh += balance.laws("road.inflow", 0.0, None, moment._replace(carried=mixed * (road - entering)))
    everywhere = mesh.everywhere(mesh.road)
    rise[everywhere] = fresh
    y[everywhere] = balance.enthalpy(rise)[everywhere]
    now.left = now.left + np.subtract(old, balance.stored(y))
    now.y = y


def record(balance, stage, t, y, now, frame, precision=np.float32) -> None:
    """Append surface profiles, friction, ledger and the cell temperatures (in a `precision`) at time t."""
    scene, mesh, n = balance.scene, balance.scene.mesh, balance.n
    moment = stage.moment(t)
    worn = balance.worn_depth(y)
    if worn.max() >= scene.height:
        raise SolverFailure("the block is worn through to its holder")
    T = balance.rise(y[:n])
    entering = stage.entering(moment)
    kf = stage.solid.conduction(T, moment)
    C0 = scene.ambient - KELVIN
    under = entering[-mesh.n_across :]
    mu = np.nan
    state, press, flux, _ = stage.footprint.meet(moment, worn, T, entering, kf)
    if flux is not None and stage.phase.sliding:
        load = np.maximum(state.pressure, 1e-300) * mesh.column_area  # an unloaded block weighs evenly
        mu = float((flux.mu * load).sum() / load.sum())
    if t == 0.0:  # the initial state, before any heat
        surface, lane = T[balance.cell_block], T[balance.cell_road] + C0
        spot = surface + C0
    elif moment.touching:
        surface = T[balance.cell_block] + state.block * flux.into_block * balance.half_block / kf[balance.cell_block]
        spot, lane = flux.spot - KELVIN, flux.lane - KELVIN
    else:
        surface = balance.sites.surface_rise("block.face", stage.footprint.at(state, moment), T, kf)
        spot = surface + C0
        below = np.tile(under, mesh.last - mesh.first)
        lane = below + state.lane * (T[balance.cell_road] - below) + C0
    behind = mesh.planes(T)[mesh.road[mesh.last :, -1]]  # lanes keep their heat as they widen: so does the mean
    wake = C0 + under + state.covered * (behind - under)
    block, road = np.add(balance.stored(y), now.left)
    energy = dict(zip(balance.ledger, y[balance.books], strict=True)) | {
        "block": block,
        "lanes": road,
        "share": balance.share,
    }
    row = {
        "time": t,
        "repetition": stage.phase.repetition,
        "slid": stage.phase.slid_before + moment.slid,
        "sliding": stage.phase.sliding,
        "T_wake": wake @ mesh.share,
        "friction": mu,
        "tilt": 2.0 * press.tilt / (balance.foundation.stiffness * scene.length),
        "energy": list(energy.values()),
    }
    contact = {
        "T_block": surface + C0,
        "T_spot": spot,
        "T_road": lane,
        "pressure": state.pressure * (1.0 if moment.touching else 0.0),
        "worn": worn,
    }
    row |= {name: mesh.across(values) for name, values in contact.items()}
    if balance.laws("contact.resolved", 0.0, None, moment) > 0:  # what touches counts
        weight = np.maximum(state.phi, 1e-6)
        row["T_spot"] = mesh.across(weight * spot) / mesh.across(weight)
        contact["cover"] = state.phi
    if frame:
        cells, lanes = T + C0, stage.footprint.lanes(state, moment)[:, None, None]
        fresh = entering.reshape(mesh.n_road, -1)
        road = mesh.planes(T)[mesh.road]
        mesh.planes(cells)[mesh.road] = C0 + fresh + lanes * (road - fresh)
        kept = {"cells": cells}
        if mesh.n_across > 1:
            kept |= {name: a.reshape(-1, mesh.n_across) for name, a in (contact | {"T_wake": wake}).items()}
        now.frames.append({name: a.astype(precision) for name, a in kept.items()})
        row |= {"frames": len(now.records.get("time", []))}
    now.records.setdefault("ledger", list(energy))
    for name, value in row.items():
        now.records.setdefault(name, []).append(value)


def finish(scene, balance, now, title) -> Run:
    r, maps = now.records, now.frames.stacked()
    energy = dict(zip(r["ledger"], np.array(r["energy"]).T, strict=True))
    statistics = {
        "steps": now.steps,
        "rhs_evaluations": now.calls["rate"],
        "jacobian_products": now.calls["times"],
        "preconditioner_setups": now.calls["setup"],
        "preconditioner_solves": now.calls["solve"],
        "wall_s": now.wall,
    }
    return Run(
        title=title,
        mesh=scene.mesh,
        time=np.array(r["time"]),
        repetition=np.array(r["repetition"]),
        slid=np.array(r["slid"]),
        sliding=np.array(r["sliding"], dtype=bool),
        T_block=np.array(r["T_block"]),
        T_spot=np.array(r["T_spot"]),
        T_road=np.array(r["T_road"]),
        T_wake=np.array(r["T_wake"]),
        pressure=np.array(r["pressure"]),
        friction=np.array(r["friction"]),
        worn=np.array(r["worn"]),
        tilt=np.array(r["tilt"]),
        energy=energy,
        frames=np.array(r["frames"]),
        field=maps.pop("cells"),
        maps=maps,
        ambient_degC=scene.ambient - KELVIN,
        width=scene.width,
        conductivity=(scene.block.conductivity, scene.road.conductivity),
        statistics=statistics,
    )
