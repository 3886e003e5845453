"""What happens between two phases: the road at a new start, and the whole state where the block turns to slide back.

The balance always sees road that moves towards +x, with the leading edge at x = 0.  Where sliding turns, cells, worn
depth and track change ends, so that no law of the balance knows of two directions.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flashtemp.solver.balance import Balance
from flashtemp.solver.circular_track import inflow, leave
from flashtemp.solver.progress import Progress
from flashtemp.solver.system import System


def renew(balance: Balance, before: Any, phase: Any, now: Progress) -> None:
    """Make the state of a march, which stands at the end of the phase `before`, that with which `phase` begins."""
    if phase.sliding and phase.begin == phase.start:
        restart(balance, before, now)
    if phase.direction != before.direction:
        turn(balance, before, phase, now)


def renews(before: Any, phase: Any) -> bool:
    """Whether the state changes between two phases."""
    return bool(phase.direction != before.direction or (phase.sliding and phase.begin == phase.start))


def pass_on(system: System, now: Progress) -> None:
    """Put the road in its own frame back on the mesh at the begin of a leg: columns behind go, others come in front."""
    b, mesh, frame = system.b, system.b.scene.mesh, system.b.road_frame
    assert frame is not None
    moment, lines = system.moment(system.phase.begin), frame.passing
    before = mesh.x_centre[:lines] - mesh.x[0]  # so far behind the edge of the window has road come already
    come = [system.entering(moment._replace(passed=moment.passed - way)) for way in before]
    fresh = np.stack([system.entering_enthalpy(T_in).reshape(mesh.n_road, -1) for T_in in come])
    y = frame.placed(now.y, lines, 0.0)
    gone = mesh.planes(now.y[: b.n])[mesh.road[-lines:]]
    mesh.planes(y[: b.n])[mesh.road[:lines]] = fresh
    y[b.entry["lane_out"]] += b.road_heat(gone) - b.road_heat(fresh)
    now.y = y


def restart(balance: Balance, before: Any, now: Progress) -> None:
    """The road at a new start: as it is where the block rested on it, else forgotten or carried."""
    scene, mesh = balance.scene, balance.scene.mesh
    if not scene.schedule.lifted:
        return
    y = now.y.copy()
    old = balance.stored(y)
    system = System(balance, before, inflow(balance, before, now.track))
    moment = system.moment(before.end)
    rise = balance.rise(y[: balance.n])
    road, behind = mesh.planes(rise)[mesh.road], mesh.x_centre - mesh.x[0]
    came = system.came_as(moment, behind)[:, 0].reshape(road.shape)
    fresh = came + 0.0 * road
    if now.track is not None and now.track.endless:
        now.track.forget()
    elif now.track is not None:
        left = system.remembered(moment, behind).reshape(road.shape) + road - came
        now.track.lay(before.end, moment.passed - mesh.x_centre, left)
        carried = balance.share * left.reshape(mesh.n_lines, -1)
        fresh = system.met(moment, carried)[:, 0].reshape(road.shape)
    everywhere = mesh.everywhere(mesh.road)
    rise[everywhere] = fresh
    y[everywhere] = balance.enthalpy(rise)[everywhere]
    now.left = now.left + np.subtract(old, balance.stored(y))
    now.y = y


def turn(balance: Balance, before: Any, phase: Any, now: Progress) -> None:
    """Block, road around it and track seen from the other edge, which leads from now on."""
    scene, mesh, y = balance.scene, balance.scene.mesh, now.y.copy()
    if now.track is not None and before.sliding and phase.repetition == before.repetition:
        leave(System(balance, before, inflow(balance, before, now.track)), before.end, now.y, now.track, 1e-9)
    mesh.planes(y[: balance.n])[:] = mesh.planes(now.y[: balance.n])[mesh.mirror]
    y[balance.worn] = now.y[balance.worn].reshape(-1, mesh.n_across)[::-1].ravel()
    now.y = y
    if now.track is not None:
        slid = scene.schedule.slid(phase, phase.begin)
        now.track.turn(phase.slid_before + slid, mesh)
