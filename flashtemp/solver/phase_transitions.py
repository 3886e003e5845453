"""What happens between two phases: the road at a new start, and the whole state where the block turns to slide back.

The balance always sees road that moves towards +x, with the leading edge at x = 0.  Where sliding turns, cells, worn
depth and track change ends, so that no law of the balance knows of two directions.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flashtemp.solver.circular_track import build_inflow, store_leaving_column
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.march_state import MarchState
from flashtemp.solver.system import PhaseSystem


def start_phase(balance: HeatBalance, before: Any, phase: Any, march_state: MarchState) -> None:
    """Make the state of a march, which stands at the end of the phase `before`, that with which `phase` begins."""
    if phase.sliding and phase.begin == phase.start:
        restart_repetition(balance, before, march_state)
    if phase.direction != before.direction:
        reverse_direction(balance, before, phase, march_state)


def has_state_change(before: Any, phase: Any) -> bool:
    """Whether the state changes between two phases."""
    return bool(phase.direction != before.direction or (phase.sliding and phase.begin == phase.start))


def remap_road(system: PhaseSystem, march_state: MarchState) -> None:
    """Put the road in its own frame back on the mesh at the begin of a leg: columns behind go, others come in front."""
    b, mesh, frame = system.b, system.b.scene.mesh, system.b.road_frame
    assert frame is not None
    moment, lines = system.moment(system.phase.begin), frame.leg_lines
    before = mesh.x_centre[:lines] - mesh.x[0]  # so far behind the edge of the window has road come already
    come = [system.incoming_rise(moment._replace(passed=moment.passed - way)) for way in before]
    fresh = np.stack([system.incoming_enthalpy(T_in).reshape(mesh.n_road, -1) for T_in in come])
    y = frame.to_block_frame(march_state.y, lines, 0.0)
    gone = mesh.planes(march_state.y[: b.n])[mesh.road[-lines:]]
    mesh.planes(y[: b.n])[mesh.road[:lines]] = fresh
    y[b.ledger_index["lane_out"]] += b.road_heat(gone) - b.road_heat(fresh)
    march_state.y = y


def restart_repetition(balance: HeatBalance, before: Any, march_state: MarchState) -> None:
    """The road at a new start: as it is where the block rested on it, else forgotten or carried."""
    scene, mesh = balance.scene, balance.scene.mesh
    if not scene.schedule.lifted:
        return
    y = march_state.y.copy()
    old = balance.stored_heat(y)
    system = PhaseSystem(balance, before, build_inflow(balance, before, march_state.track))
    moment = system.moment(before.end)
    rise = balance.temperature_rise(y[: balance.n])
    road, behind = mesh.planes(rise)[mesh.road], mesh.x_centre - mesh.x[0]
    came = system.undisturbed_road(moment, behind)[:, 0].reshape(road.shape)
    fresh = came + 0.0 * road
    if march_state.track is not None and march_state.track.is_endless:
        march_state.track.clear()
    elif march_state.track is not None:
        left = system.earlier_pass_rise(moment, behind).reshape(road.shape) + road - came
        march_state.track.store_initial_road(before.end, moment.passed - mesh.x_centre, left)
        carried = balance.share * left.reshape(mesh.n_lines, -1)
        fresh = system.road_after_passes(moment, carried)[:, 0].reshape(road.shape)
    everywhere = mesh.everywhere(mesh.road)
    rise[everywhere] = fresh
    y[everywhere] = balance.enthalpy_rise(rise)[everywhere]
    march_state.removed_heat = march_state.removed_heat + np.subtract(old, balance.stored_heat(y))
    march_state.y = y


def reverse_direction(balance: HeatBalance, before: Any, phase: Any, march_state: MarchState) -> None:
    """Block, road around it and track seen from the other edge, which leads from now on."""
    scene, mesh, y = balance.scene, balance.scene.mesh, march_state.y.copy()
    if march_state.track is not None and before.sliding and phase.repetition == before.repetition:
        store_leaving_column(
            PhaseSystem(balance, before, build_inflow(balance, before, march_state.track)),
            before.end,
            march_state.y,
            march_state.track,
            1e-9,
        )
    mesh.planes(y[: balance.n])[:] = mesh.planes(march_state.y[: balance.n])[mesh.mirror]
    y[balance.worn] = march_state.y[balance.worn].reshape(-1, mesh.n_across)[::-1].ravel()
    march_state.y = y
    if march_state.track is not None:
        slid = scene.schedule.slid_distance(phase, phase.begin)
        march_state.track.reverse_direction(phase.slid_before + slid, mesh)
