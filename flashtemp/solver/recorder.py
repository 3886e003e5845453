"""What a march keeps on its way: when it records, one row of records, and the Run that they make."""

from __future__ import annotations

from typing import Any

import numpy as np

from flashtemp.errors import SolverFailure
from flashtemp.meshes.mesh import Mesh
from flashtemp.model.numerics import Settings
from flashtemp.physics.quantities import KELVIN
from flashtemp.solver import lanes
from flashtemp.solver.balance import Balance
from flashtemp.solver.interface import Contact
from flashtemp.solver.progress import Progress
from flashtemp.solver.run import Run
from flashtemp.solver.system import System


def stretches(phase, schedule) -> int:
    """Into how many stretches events divide the sliding of this repetition."""
    return sum(p.sliding and p.repetition == phase.repetition for p in schedule.phases)


def record_times(phase, schedule, settings: Settings) -> list[tuple[float, bool]]:
    """Times (s) of a phase at which profiles are kept, and whether the whole field is kept with them.

    They are dense after each start or stop; every end and every time that `settings` asks for is among them.
    """
    sliding = -(-settings.profiles // stretches(phase, schedule))
    n = sliding if phase.sliding else max(4, settings.profiles // 4)
    t = phase.begin + (phase.end - phase.begin) * (np.arange(n + 1) / n) ** 2
    t[-1] = phase.end
    times = (t if phase.begin == 0.0 else t[1:]).tolist()
    last, wanted = len(times) - 1, -(-settings.fields // stretches(phase, schedule)) if phase.sliding else 2
    whole = {times[round(i * last / max(1, wanted - 1))] for i in range(wanted)}
    asked = {t for t in settings.times if phase.begin < t <= phase.end or t == phase.begin == 0.0}
    return [(t, t in whole or t in asked) for t in sorted({*times, *asked})]


def record(system: System, t: float, y: np.ndarray, now: Progress, frame: bool, precision: type = np.float32) -> None:
    """Append surface profiles, friction, ledger and, with `frame`, all cells' temperatures (in a `precision`) at t."""
    b, mesh, phase = system.b, system.b.scene.mesh, system.phase
    moment, worn = system.moment(t), b.worn_depth(y)
    if worn.max() >= b.scene.height:
        raise SolverFailure("the block is worn through to its holder")
    T, road = b.rise(system.placed(moment, y)[: b.n]), system.road(moment)
    kf = system.solid.conduction(T, moment)
    contact = system.interface.contact(moment, worn, T, road, kf)
    profiles = _temperatures(system, moment, contact, T, road, kf) | {
        "pressure": contact.state.pressure * (1.0 if moment.touching else 0.0),
        "worn": worn,
    }
    shown = T if b.road_frame is None else b.road_frame.shown(T, moment.passed)
    profiles = {name: _along_block(mesh, values, phase.direction) for name, values in profiles.items()}
    wake = {"T_wake": _surface(system, moment, shown, slice(mesh.last, None))}
    if -1 in b.scene.schedule.directions:
        wake["T_ahead"] = _surface(system, moment, shown, slice(0, mesh.first))
    energy = _energy(b, y, now)
    row = {
        "time": t,
        "repetition": phase.repetition,
        "slid": phase.slid_before + moment.slid,
        "sliding": phase.sliding,
        "direction": phase.direction,
        "friction": _mean_friction(system, contact),
        "tilt": phase.direction * 2.0 * contact.press.tilt / b.scene.length,
        "energy": list(energy.values()),
    }
    row |= {name: values @ mesh.share for name, values in wake.items()}
    row |= {name: mesh.across(values) for name, values in profiles.items()}
    if b.laws("contact.resolved", 0.0, None, moment) > 0:  # what touches counts
        cover = _along_block(mesh, contact.state.phi, phase.direction)
        weight = np.maximum(cover, 1e-6)
        row["T_spot"] = mesh.across(weight * profiles["T_spot"]) / mesh.across(weight)
        profiles["cover"] = cover
    if frame:
        kept = {"cells": _cells(system, moment, contact, shown, road, precision)}
        if mesh.n_across > 1:
            kept |= {name: a.reshape(-1, mesh.n_across) for name, a in (profiles | wake).items()}
        now.frames.append({name: a.astype(precision, copy=False) for name, a in kept.items()})
        row["frames"] = len(now.records.get("time", []))
    now.records.setdefault("ledger", list(energy))
    for name, value in row.items():
        now.records.setdefault(name, []).append(value)


def _along_block(mesh: Mesh, columns: np.ndarray, direction: int) -> np.ndarray:
    """Values (columns,) counted from the leading edge, in the order of the block's own x."""
    return columns.reshape(-1, mesh.n_across)[::direction].ravel()


def _mean_friction(system: System, contact: Contact) -> float:
    """Load-weighted friction, nan while the block waits."""
    if contact.flux is None or not system.phase.sliding:
        return np.nan
    # an unloaded block weighs evenly
    load = np.maximum(contact.state.pressure, 1e-300) * system.b.scene.mesh.column_area
    return float((contact.flux.mu * load).sum() / load.sum())


def _temperatures(system: System, moment, contact: Contact, T, road, kf) -> dict[str, np.ndarray]:
    """Block surface, spots and road lanes (columns,) in degC."""
    b = system.b
    state, flux = contact.state, contact.flux
    C0 = b.scene.ambient - KELVIN
    if moment.t == 0.0:  # the initial state, before any heat
        surface, lane = T[b.cell_block], T[b.cell_road] + C0
        spot = surface + C0
    elif flux is not None:
        surface = T[b.cell_block] + state.block * flux.into_block * b.half_block / kf[b.cell_block]
        spot, lane = flux.spot - KELVIN, flux.lane - KELVIN
    else:
        surface = b.boundary.surface_rise("block.face", system.interface.at(state, moment), T, kf)
        spot = surface + C0
        lane = lanes.rises(b, state, T, road) + C0
    return {"T_block": surface + C0, "T_spot": spot, "T_road": lane}


def _surface(system: System, moment, T, lines: slice) -> np.ndarray:
    """Road surface (lines, planes) in degC, over lanes and gaps: all heat that the road took."""
    b, mesh = system.b, system.b.scene.mesh
    free = mesh.planes(T)[mesh.road[lines][:, -1]]
    behind, top = mesh.x_centre[lines] - mesh.x[0], slice(-mesh.n_across, None)
    came, own = np.moveaxis(system.came_as(moment, behind)[..., top], 1, 0)
    return b.scene.ambient - KELVIN + came - own + b.share * (free - came + own)


def _energy(b: Balance, y, now: Progress) -> dict[str, float]:
    """The ledger, and the heat in block and lanes, J per metre."""
    block, road = np.add(b.stored(y), now.left)
    ledger = dict(zip(b.ledger, y[b.books], strict=True))
    return ledger | {"block": block, "lanes": road, "share": b.share}


def _cells(system: System, moment, contact: Contact, T, came, precision: type) -> np.ndarray:
    """Temperatures (cells,) in degC, those of the road as lane means."""
    mesh, C0 = system.b.scene.mesh, system.b.scene.ambient - KELVIN
    cells = np.add(T, C0, out=np.empty(len(T), precision), casting="same_kind")  # no second whole field beside it
    road, weights = mesh.planes(T)[mesh.road], system.interface.loss_at_depth(contact.state, moment)
    road -= came[0].reshape(mesh.n_road, -1)
    colder = system.b.share * min(road.min(), 0.0)  # the coldest mean of the road across y, below what came in
    fallen = weights @ road
    lane, fall = (lanes.everywhere(mesh, a)[:, None] for a in (contact.state.lane, contact.state.fall))
    fallen *= fall
    road -= fallen
    road *= lane
    fresh = lanes.entered(system.b, weights, came)
    road += C0 + fresh
    coldest = min(T[system.b.cell_block].min(), fresh.min() + colder)  # the bound of `lanes.rises`
    np.maximum(road, C0 + coldest, out=road)
    mesh.planes(cells)[mesh.road] = road
    return cells if moment.direction > 0 else mesh.planes(cells)[mesh.mirror].ravel()


def finish(balance: Balance, now: Progress, title: str) -> Run:
    """The Run of a march that has come to its end."""
    scene, r, maps = balance.scene, now.records, now.frames.stacked()
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
        conductivity=(scene.of_block("conductivity"), scene.road.conductivity),
        statistics={
            "steps": now.steps,
            "rhs_evaluations": now.calls["rate"],
            "jacobian_products": now.calls["times"],
            "preconditioner_setups": now.calls["setup"],
            "preconditioner_solves": now.calls["solve"],
            "wall_s": now.wall,
        },
    )
