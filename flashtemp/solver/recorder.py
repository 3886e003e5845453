"""What a march keeps on its way: when it records, one row of records, and the Run that they make."""

from __future__ import annotations

from typing import Any

import numpy as np

from flashtemp.errors import SolverFailure
from flashtemp.meshes.mesh import Mesh
from flashtemp.model.numerics import SolverSettings
from flashtemp.physics.quantities import KELVIN
from flashtemp.solver import contact_lanes
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.interface import SolvedContact
from flashtemp.solver.march_state import MarchState
from flashtemp.solver.run import Run
from flashtemp.solver.system import PhaseSystem


def sliding_segment_count(phase, schedule) -> int:
    """Into how many stretches events divide the sliding of this repetition."""
    return sum(p.sliding and p.repetition == phase.repetition for p in schedule.phases)


def record_times(phase, schedule, settings: SolverSettings) -> list[tuple[float, bool]]:
    """Times (s) of a phase at which profiles are kept, and whether the whole field is kept with them.

    They are dense after each start or stop; every end and every time that `settings` asks for is among them.
    """
    sliding = -(-settings.profiles // sliding_segment_count(phase, schedule))
    n = sliding if phase.sliding else max(4, settings.profiles // 4)
    t = phase.begin + (phase.end - phase.begin) * (np.arange(n + 1) / n) ** 2
    t[-1] = phase.end
    times = (t if phase.begin == 0.0 else t[1:]).tolist()
    last, wanted = len(times) - 1, -(-settings.fields // sliding_segment_count(phase, schedule)) if phase.sliding else 2
    whole = {times[round(i * last / max(1, wanted - 1))] for i in range(wanted)}
    asked = {t for t in settings.times if phase.begin < t <= phase.end or t == phase.begin == 0.0}
    return [(t, t in whole or t in asked) for t in sorted({*times, *asked})]


def record_state(
    system: PhaseSystem,
    t: float,
    y: np.ndarray,
    march_state: MarchState,
    with_field: bool,
    precision: type = np.float32,
) -> None:
    """Append surface profiles, friction, ledger and, with `with_field`, all cells' temperatures (in a `precision`) at t."""
    b, mesh, phase = system.b, system.b.scene.mesh, system.phase
    moment, worn = system.moment(t), b.worn_depth(y)
    if worn.max() >= b.scene.height:
        raise SolverFailure("the block is worn through to its holder")
    T, road = b.temperature_rise(system.to_block_frame(moment, y)[: b.n]), system.incoming_road(moment)
    kf = system.solid.conductivity_factor(T, moment)
    contact = system.interface.solve_contact(moment, worn, T, road, kf)
    profiles = _contact_temperatures(system, moment, contact, T, road, kf) | {
        "pressure": contact.state.pressure * (1.0 if moment.touching else 0.0),
        "worn": worn,
    }
    shown = T if b.road_frame is None else b.road_frame.interpolate_to_mesh(T, moment.passed)
    profiles = {name: _along_block(mesh, values, phase.direction) for name, values in profiles.items()}
    wake = {"T_wake": _road_surface(system, moment, shown, slice(mesh.last, None))}
    if -1 in b.scene.schedule.directions:
        wake["T_ahead"] = _road_surface(system, moment, shown, slice(0, mesh.first))
    energy = _energy_ledger(b, y, march_state)
    row = {
        "time": t,
        "repetition": phase.repetition,
        "slid": phase.slid_before + moment.slid,
        "sliding": phase.sliding,
        "direction": phase.direction,
        "friction": _mean_friction(system, contact),
        "tilt": phase.direction * 2.0 * contact.pressure_solution.tilt / b.scene.length,
        "energy": list(energy.values()),
    }
    row |= {name: values @ mesh.share for name, values in wake.items()}
    row |= {name: mesh.across(values) for name, values in profiles.items()}
    if b.laws("contact.resolved", 0.0, None, moment) > 0:  # what touches counts
        cover = _along_block(mesh, contact.state.phi, phase.direction)
        weight = np.maximum(cover, 1e-6)
        row["T_spot"] = mesh.across(weight * profiles["T_spot"]) / mesh.across(weight)
        profiles["cover"] = cover
    if with_field:
        kept = {"cells": _cell_temperatures(system, moment, contact, shown, road, precision)}
        if mesh.n_across > 1:
            kept |= {name: a.reshape(-1, mesh.n_across) for name, a in (profiles | wake).items()}
        march_state.frames.append({name: a.astype(precision, copy=False) for name, a in kept.items()})
        row["frames"] = len(march_state.records.get("time", []))
    march_state.records.setdefault("ledger", list(energy))
    for name, value in row.items():
        march_state.records.setdefault(name, []).append(value)


def _along_block(mesh: Mesh, columns: np.ndarray, direction: int) -> np.ndarray:
    """Values (columns,) counted from the leading edge, in the order of the block's own x."""
    return columns.reshape(-1, mesh.n_across)[::direction].ravel()


def _mean_friction(system: PhaseSystem, contact: SolvedContact) -> float:
    """Load-weighted friction, nan while the block waits."""
    if contact.flux is None or not system.phase.sliding:
        return np.nan
    # an unloaded block weighs evenly
    load = np.maximum(contact.state.pressure, 1e-300) * system.b.scene.mesh.column_area
    return float((contact.flux.mu * load).sum() / load.sum())


def _contact_temperatures(system: PhaseSystem, moment, contact: SolvedContact, T, road, kf) -> dict[str, np.ndarray]:
    """Block surface, spots and road lanes (columns,) in degC."""
    b = system.b
    state, flux = contact.state, contact.flux
    C0 = b.scene.ambient - KELVIN
    if moment.t == 0.0:  # the initial state, before any heat
        surface, lane = T[b.cell_block], T[b.cell_road] + C0
        spot = surface + C0
    elif flux is not None:
        surface = T[b.cell_block] + state.block_coverage * flux.into_block * b.half_block / kf[b.cell_block]
        spot, lane = flux.spot - KELVIN, flux.lane - KELVIN
    else:
        surface = b.boundary.surface_rise("block.face", system.interface.moment_at_contact(state, moment), T, kf)
        spot = surface + C0
        lane = contact_lanes.lane_rises(b, state, T, road) + C0
    return {"T_block": surface + C0, "T_spot": spot, "T_road": lane}


def _road_surface(system: PhaseSystem, moment, T, lines: slice) -> np.ndarray:
    """Road surface (lines, planes) in degC, over lanes and gaps: all heat that the road took."""
    b, mesh = system.b, system.b.scene.mesh
    free = mesh.planes(T)[mesh.road[lines][:, -1]]
    behind, top = mesh.x_centre[lines] - mesh.x[0], slice(-mesh.n_across, None)
    came, own = np.moveaxis(system.undisturbed_road(moment, behind)[..., top], 1, 0)
    return b.scene.ambient - KELVIN + came - own + b.share * (free - came + own)


def _energy_ledger(b: HeatBalance, y, march_state: MarchState) -> dict[str, float]:
    """The ledger, and the heat in block and lanes, J per metre."""
    block, road = np.add(b.stored_heat(y), march_state.removed_heat)
    ledger = dict(zip(b.ledger, y[b.ledger_slice], strict=True))
    return ledger | {"block": block, "lanes": road, "share": b.share}


def _cell_temperatures(system: PhaseSystem, moment, contact: SolvedContact, T, came, precision: type) -> np.ndarray:
    """Temperatures (cells,) in degC, those of the road as lane means."""
    mesh, C0 = system.b.scene.mesh, system.b.scene.ambient - KELVIN
    cells = np.add(T, C0, out=np.empty(len(T), precision), casting="same_kind")  # no second whole field beside it
    road, weights = mesh.planes(T)[mesh.road], system.interface.spreading_loss_at_depth(contact.state, moment)
    road -= came[0].reshape(mesh.n_road, -1)
    colder = system.b.share * min(road.min(), 0.0)  # the coldest mean of the road across y, below what came in
    fallen = weights @ road
    lane, fall = (
        contact_lanes.extend_over_lines(mesh, a)[:, None] for a in (contact.state.lane_ratio, contact.state.loss_ratio)
    )
    fallen *= fall
    road -= fallen
    road *= lane
    fresh = contact_lanes.incoming_lane_rises(system.b, weights, came)
    road += C0 + fresh
    coldest = min(T[system.b.cell_block].min(), fresh.min() + colder)  # the bound of `lanes.rises`
    np.maximum(road, C0 + coldest, out=road)
    mesh.planes(cells)[mesh.road] = road
    return cells if moment.direction > 0 else mesh.planes(cells)[mesh.mirror].ravel()


def build_run(balance: HeatBalance, march_state: MarchState, title: str) -> Run:
    """The Run of a march that has come to its end."""
    scene, r, maps = balance.scene, march_state.records, march_state.frames.stack_rows()
    arrays = ("time", "repetition", "slid", "T_block", "T_spot", "T_road", "T_wake", "pressure", "friction", "worn")
    profiles: dict[str, Any] = {name: np.array(r[name]) for name in (*arrays, "tilt", "frames")}
    back: dict[str, Any] = (
        {"T_ahead": np.array(r["T_ahead"]), "direction": np.array(r["direction"])} if "T_ahead" in r else {}
    )
    return Run(
        title=title,
        mesh=scene.mesh.mirrored() if scene.schedule.directions == {-1} else scene.mesh,
        **back,
        **profiles,
        sliding=np.array(r["sliding"], dtype=bool),
        energy=dict(zip(r["ledger"], np.array(r["energy"]).T, strict=True)),
        field=maps.pop("cells"),
        maps=maps,
        ambient_degC=scene.ambient - KELVIN,
        width=scene.width,
        conductivity=(scene.block_property("conductivity"), scene.road.conductivity),
        statistics={
            "steps": march_state.steps,
            "rhs_evaluations": march_state.calls["rate"],
            "jacobian_products": march_state.calls["times"],
            "preconditioner_setups": march_state.calls["setup"],
            "preconditioner_solves": march_state.calls["solve"],
            "wall_s": march_state.wall_s,
        },
    )
