"""Recording of a run: the times of records, one record of profiles and ledger, and the `Run` made of all records."""

from __future__ import annotations

from typing import Any

import numpy as np

from flashtemp.errors import SolverFailure
from flashtemp.meshes.mesh import Mesh
from flashtemp.model.numerics import SolverSettings
from flashtemp.physics.quantities import KELVIN
from flashtemp.solver import contact_lanes
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.integration_state import IntegrationState
from flashtemp.solver.interface import SolvedContact
from flashtemp.solver.run import Run
from flashtemp.solver.system import PhaseSystem


def sliding_segment_count(phase, schedule) -> int:
    """Number of segments into which events divide the sliding of this repetition."""
    return sum(p.sliding and p.repetition == phase.repetition for p in schedule.phases)


def record_times(phase, schedule, settings: SolverSettings) -> list[tuple[float, bool]]:
    """Times (s) of a phase at which profiles are recorded, and whether the whole field is recorded with them.

    They are dense after each start or stop, and include the end and all times of `settings.times`.
    """
    sliding = -(-settings.profiles // sliding_segment_count(phase, schedule))
    n = sliding if phase.sliding else max(4, settings.profiles // 4)
    # equal steps of sqrt(t), in which a surface warms after a start
    t = phase.begin + (phase.end - phase.begin) * (np.arange(n + 1) / n) ** 2
    t[-1] = phase.end
    times = (t if phase.begin == 0.0 else t[1:]).tolist()
    last, n_fields = (
        len(times) - 1,
        -(-settings.fields // sliding_segment_count(phase, schedule)) if phase.sliding else 2,
    )
    with_field = {times[round(i * last / max(1, n_fields - 1))] for i in range(n_fields)}
    requested = {t for t in settings.times if phase.begin < t <= phase.end or t == phase.begin == 0.0}
    return [(t, t in with_field or t in requested) for t in sorted({*times, *requested})]


def record_state(
    system: PhaseSystem,
    t: float,
    y: np.ndarray,
    integration_state: IntegrationState,
    with_field: bool,
    precision: type = np.float32,
) -> None:
    """Append a record at time t (s): profiles, friction and ledger, and all cells if `with_field`.

    Fields are stored in the floating-point type `precision`.  Raises SolverFailure if the block is worn through.
    """
    b, mesh, phase = system.b, system.b.scene.mesh, system.phase
    now, worn = system.law_context(t), b.worn_depth(y)
    if worn.max() >= b.scene.height:
        raise SolverFailure("the block is worn through to its holder")
    T, road = b.temperature_rise(system.to_block_frame(now, y)[: b.n]), system.incoming_road(now)
    kf = system.solid.conductivity_factor(T, now)
    contact = system.interface.solve_contact(now, worn, T, road, kf)
    profiles = _contact_temperatures(system, now, contact, T, road, kf) | {
        "pressure": contact.state.pressure * (1.0 if now.touching else 0.0),
        "worn": worn,
    }
    on_mesh = T if b.road_frame is None else b.road_frame.interpolate_to_mesh(T, now.passed)
    profiles = {name: _along_block(mesh, values, phase.direction) for name, values in profiles.items()}
    wake = {"T_wake": _road_surface(system, now, on_mesh, slice(mesh.last, None))}
    if -1 in b.scene.schedule.directions:
        wake["T_ahead"] = _road_surface(system, now, on_mesh, slice(0, mesh.first))
    energy = _energy_ledger(b, y, integration_state)
    row = {
        "time": t,
        "repetition": phase.repetition,
        "slid": phase.slid_before + now.slid,
        "sliding": phase.sliding,
        "direction": phase.direction,
        "friction": _mean_friction(system, contact),
        "tilt": phase.direction * 2.0 * contact.pressure_solution.tilt / b.scene.length,
        "energy": list(energy.values()),
    }
    row |= {name: values @ mesh.share for name, values in wake.items()}
    row |= {name: mesh.across(values) for name, values in profiles.items()}
    if b.laws("contact.resolved", 0.0, None, now) > 0:  # spots only where they touch
        cover = _along_block(mesh, contact.state.phi, phase.direction)
        weight = np.maximum(cover, 1e-6)
        row["T_spot"] = mesh.across(weight * profiles["T_spot"]) / mesh.across(weight)
        profiles["cover"] = cover
    if with_field:
        fields = {"cells": _cell_temperatures(system, now, contact, on_mesh, road, precision)}
        if mesh.n_across > 1:
            fields |= {name: a.reshape(-1, mesh.n_across) for name, a in (profiles | wake).items()}
        integration_state.frames.append({name: a.astype(precision, copy=False) for name, a in fields.items()})
        row["frames"] = len(integration_state.records.get("time", []))
    integration_state.records.setdefault("ledger", list(energy))
    for name, value in row.items():
        integration_state.records.setdefault(name, []).append(value)


def _along_block(mesh: Mesh, columns: np.ndarray, direction: int) -> np.ndarray:
    """Values (columns,) counted from the leading edge, reordered along the block's own x."""
    return columns.reshape(-1, mesh.n_across)[::direction].ravel()


def _mean_friction(system: PhaseSystem, contact: SolvedContact) -> float:
    """Load-weighted mean friction, nan while the block waits."""
    if contact.flux is None or not system.phase.sliding:
        return np.nan
    # without load all columns have equal weight
    load = np.maximum(contact.state.pressure, 1e-300) * system.b.scene.mesh.column_area
    return float((contact.flux.mu * load).sum() / load.sum())


def _contact_temperatures(system: PhaseSystem, now, contact: SolvedContact, T, road, kf) -> dict[str, np.ndarray]:
    """Temperatures (columns,) degC of the block's surface, of the spots and of the heated lanes on the road."""
    b = system.b
    state, flux = contact.state, contact.flux
    C0 = b.scene.ambient - KELVIN
    if now.t == 0.0:  # the initial state, before any heat
        surface, lane = T[b.cell_block], T[b.cell_road] + C0
        spot = surface + C0
    elif flux is not None:
        surface = T[b.cell_block] + state.block_coverage * flux.into_block * b.half_block / kf[b.cell_block]
        spot, lane = flux.spot - KELVIN, flux.lane - KELVIN
    else:
        surface = b.boundary.surface_rise("block.face", system.interface.context_at_contact(state, now), T, kf)
        spot = surface + C0
        lane = contact_lanes.lane_rises(b, state, T, road) + C0
    return {"T_block": surface + C0, "T_spot": spot, "T_road": lane}


def _road_surface(system: PhaseSystem, now, T, lines: slice) -> np.ndarray:
    """Mean temperature (lines, planes) degC of the road surface over lanes and gaps, as a camera sees it.

    A column stands for the fraction `share` of the width; the rest of the road is as it entered.
    """
    b, mesh = system.b, system.b.scene.mesh
    free = mesh.planes(T)[mesh.road[lines][:, -1]]
    behind, top = mesh.x_centre[lines] - mesh.x[0], slice(-mesh.n_across, None)
    entered, earlier = np.moveaxis(system.undisturbed_road(now, behind)[..., top], 1, 0)
    return b.scene.ambient - KELVIN + entered - earlier + b.share * (free - entered + earlier)


def _energy_ledger(b: HeatBalance, y, integration_state: IntegrationState) -> dict[str, float]:
    """The ledger, and the heat in block and lanes with that removed at restarts, J per metre."""
    block, road = np.add(b.stored_heat(y), integration_state.removed_heat)
    ledger = dict(zip(b.ledger, y[b.ledger_slice], strict=True))
    return ledger | {"block": block, "lanes": road, "share": b.share}


def _cell_temperatures(system: PhaseSystem, now, contact: SolvedContact, T, incoming, precision: type) -> np.ndarray:
    """Temperatures (cells,) degC; road cells have the temperature of the lanes, eqs. (15c) and (15d) at every depth."""
    mesh, C0 = system.b.scene.mesh, system.b.scene.ambient - KELVIN
    cells = np.add(T, C0, out=np.empty(len(T), precision), casting="same_kind")  # in place: no second whole field
    road, weights = mesh.planes(T)[mesh.road], system.interface.spreading_loss_at_depth(contact.state, now)
    road -= incoming[0].reshape(mesh.n_road, -1)
    colder = system.b.share * min(road.min(), 0.0)  # the coldest mean of the road across y, relative to entering road
    deficit = weights @ road
    lane, loss = (
        contact_lanes.extend_over_lines(mesh, a)[:, None] for a in (contact.state.lane_ratio, contact.state.loss_ratio)
    )
    deficit *= loss
    road -= deficit
    road *= lane
    fresh = contact_lanes.incoming_lane_rises(system.b, weights, incoming)
    road += C0 + fresh
    coldest = min(T[system.b.cell_block].min(), fresh.min() + colder)  # the bound of `contact_lanes.lane_rises`
    np.maximum(road, C0 + coldest, out=road)
    mesh.planes(cells)[mesh.road] = road
    return cells if now.direction > 0 else mesh.planes(cells)[mesh.mirror].ravel()


def build_run(balance: HeatBalance, integration_state: IntegrationState, title: str) -> Run:
    """The `Run` of a complete integration."""
    scene, r, maps = balance.scene, integration_state.records, integration_state.frames.stack_rows()
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
            "steps": integration_state.steps,
            "rhs_evaluations": integration_state.calls["rate"],
            "jacobian_products": integration_state.calls["times"],
            "preconditioner_setups": integration_state.calls["setup"],
            "preconditioner_solves": integration_state.calls["solve"],
            "wall_s": integration_state.wall_s,
        },
    )
