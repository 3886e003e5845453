"""Changes of the state between two phases: the road at the start of a repetition, and the reversal of sliding.

In the heat balance the road always moves towards +x and the leading edge is at x = 0.  When sliding reverses, cells,
worn depth and track are mirrored instead, so no law needs to distinguish two directions.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flashtemp.solver.circular_track import build_inflow, store_leaving_column
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.integration_state import IntegrationState
from flashtemp.solver.system import PhaseSystem


def start_phase(balance: HeatBalance, before: Any, phase: Any, integration_state: IntegrationState) -> None:
    """Change the state of an integration from the end of the phase `before` to the begin of `phase`, in place."""
    if phase.sliding and phase.begin == phase.start:
        restart_repetition(balance, before, integration_state)
    if phase.direction != before.direction:
        reverse_direction(balance, before, phase, integration_state)


def has_state_change(before: Any, phase: Any) -> bool:
    """Whether the state changes between two phases: at a new repetition or a reversal."""
    return bool(phase.direction != before.direction or (phase.sliding and phase.begin == phase.start))


def remap_road(system: PhaseSystem, integration_state: IntegrationState) -> None:
    """Shift the road in its own frame back on the mesh at the begin of a leg.

    Columns that have passed behind the window are dropped, fresh ones are added in front, and the ledger books both.
    """
    b, mesh, frame = system.b, system.b.scene.mesh, system.b.road_frame
    assert frame is not None
    now, lines = system.law_context(system.phase.begin), frame.leg_lines
    behind = mesh.x_centre[:lines] - mesh.x[0]  # distance from the upstream edge: where each column has entered
    rises = [system.incoming_rise(now._replace(passed=now.passed - distance)) for distance in behind]
    fresh = np.stack([system.incoming_enthalpy(T_in).reshape(mesh.n_road, -1) for T_in in rises])
    y = frame.to_block_frame(integration_state.y, lines, 0.0)
    gone = mesh.planes(integration_state.y[: b.n])[mesh.road[-lines:]]
    mesh.planes(y[: b.n])[mesh.road[:lines]] = fresh
    y[b.ledger_index["lane_out"]] += b.road_heat(gone) - b.road_heat(fresh)
    integration_state.y = y


def restart_repetition(balance: HeatBalance, before: Any, integration_state: IntegrationState) -> None:
    """The road at the start of a repetition.

    A block that rested on the road finds it unchanged.  A lifted block starts on fresh road, or with `track_memory` on
    the road that earlier passes left.  Heat that is removed from the road is added to `removed_heat`.
    """
    scene, mesh = balance.scene, balance.scene.mesh
    if not scene.schedule.lifted:
        return
    y = integration_state.y.copy()
    old = balance.stored_heat(y)
    system = PhaseSystem(balance, before, build_inflow(balance, before, integration_state.track))
    now = system.law_context(before.end)
    rise = balance.temperature_rise(y[: balance.n])
    road, behind = mesh.planes(rise)[mesh.road], mesh.x_centre - mesh.x[0]
    entered = system.undisturbed_road(now, behind)[:, 0].reshape(road.shape)
    # road as if nothing had slid over it; heat of earlier passes is added where the track has kept it
    fresh = entered + 0.0 * road
    if integration_state.track is not None and integration_state.track.is_endless:
        integration_state.track.clear()
    elif integration_state.track is not None:
        left = system.earlier_pass_rise(now, behind).reshape(road.shape) + road - entered
        integration_state.track.store_initial_road(before.end, now.passed - mesh.x_centre, left)
        carried = balance.share * left.reshape(mesh.n_lines, -1)
        fresh = system.road_after_passes(now, carried)[:, 0].reshape(road.shape)
    everywhere = mesh.everywhere(mesh.road)
    rise[everywhere] = fresh
    y[everywhere] = balance.enthalpy_rise(rise)[everywhere]
    integration_state.removed_heat = integration_state.removed_heat + np.subtract(old, balance.stored_heat(y))
    integration_state.y = y


def reverse_direction(balance: HeatBalance, before: Any, phase: Any, integration_state: IntegrationState) -> None:
    """Mirror block, road and track at a reversal: the other edge leads from now on."""
    scene, mesh, y = balance.scene, balance.scene.mesh, integration_state.y.copy()
    if integration_state.track is not None and before.sliding and phase.repetition == before.repetition:
        store_leaving_column(
            PhaseSystem(balance, before, build_inflow(balance, before, integration_state.track)),
            before.end,
            integration_state.y,
            integration_state.track,
            1e-9,
        )
    mesh.planes(y[: balance.n])[:] = mesh.planes(integration_state.y[: balance.n])[mesh.mirror]
    y[balance.worn] = integration_state.y[balance.worn].reshape(-1, mesh.n_across)[::-1].ravel()
    integration_state.y = y
    if integration_state.track is not None:
        slid = scene.schedule.slid_distance(phase, phase.begin)
        integration_state.track.reverse_direction(phase.slid_before + slid, mesh)
