"""The lanes that spots draw on the road, out of what its columns hold: where they are in contact, and how they widen.

A column of road cells stands for a constant share of the width and holds all heat that the block has lost there.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from flashtemp.meshes.mesh import Mesh, centres
from flashtemp.solver import kernels_contact
from flashtemp.solver.balance import Balance
from flashtemp.solver.kernels_contact import alike

SPARSE = 0.05  # lanes hold the heat of at least this share of the mean contact fraction
TRACE = 1e-6  # of the mean heat, so that lanes are told apart where the block is lifted off
LEFT = 0.05  # of the friction heat goes into the lanes at least


# --- lanes begin and end ---------------------------------------------------------------------------------
def in_contact(b: Balance, phi, now, memory: Callable[[float], tuple]) -> tuple[np.ndarray, np.ndarray]:
    """Rise of the lanes in contact over that of their columns, and how much more than these they lose by widening.

    A spot at x took heat wherever it was in contact before, on min(phi, phi') of the width, and the road all heat:
    both are summed as they warm the surface, and as they are lost sideways (docs/theory.md, section 2a).  `phi`
    (columns,) is the contact fraction; `memory` gives the `weights` of a distance slid (m) since the last turn.
    """
    mesh = b.scene.mesh
    phi, p = (a.reshape(-1, mesh.n_across) for a in (phi, now.local_pressure))
    least = SPARSE * phi.mean(axis=0)
    here = np.where(np.real(phi) < np.real(least), least, phi)
    weights = memory(now.leg)
    out = np.empty((2, *phi.shape), dtype=np.result_type(phi, p))
    for j in range(mesh.n_across):
        both = np.where(np.real(here[:, j, None]) < np.real(phi[:, j]), here[:, j, None], phi[:, j])
        common = [(W * both) / here[:, j, None] for W in weights]
        heat = p[:, j] / phi[:, j]
        flux = _taken(b, heat + TRACE * heat.mean() + TRACE, common[0], here[:, j], now)
        for k, W in enumerate(weights):
            out[k, :, j] = common[k] @ flux / (W @ (flux * phi[:, j]))
        pressed = np.real(p[:, j]) > 0.0
        if pressed.any():  # no spot has drawn on the road that has met none
            out[:, weights[0] @ pressed == 0.0, j] = 1.0 / b.share
    warm, lost = out.reshape(2, -1)
    return b.share * warm, lost / warm


def even(b: Balance, phi) -> tuple[np.ndarray, np.ndarray] | None:
    """What `in_contact` gives wherever spots cover as much everywhere; None where they do not."""
    return (b.share / phi, np.ones(len(phi))) if np.isrealobj(phi) and np.ptp(phi) == 0.0 else None


def way(mesh: Mesh, slid: float) -> float:
    """Length (m) of road under the block and in front of it that has been slid over, `slid` (m) after a start."""
    return float(min(max(slid, mesh.dx_block[0]), mesh.x[mesh.last]))


def weights(mesh: Mesh, way: float) -> tuple[np.ndarray, np.ndarray]:
    """Weights (lines, lines under the block) of fluxes at x' as far as `way` (m) upstream of the centre of each line.

    On the road's surface, as 1/sqrt(x - x'), and on what it loses sideways, which grows by a root more: evenly.
    """
    x, edges = mesh.x_block[:, None], mesh.x[mesh.first : mesh.last + 1]
    apart = np.clip(x - edges, 0.0, way)
    root = np.sqrt(apart)
    return 2.0 * (root[:, :-1] - root[:, 1:]), apart[:, :-1] - apart[:, 1:]


def _taken(b: Balance, heat, warming, phi, now) -> np.ndarray:
    """Flux (lines under the block,) of the lanes in some unit: friction `heat` p/phi less what goes up into the block.

    That is what a half-space takes which has been as warm as the lanes since the start.
    """
    v = now.speed if now.speed > 0.0 else now.last_speed or 1e-12
    t = max(now.contact_time - now.waited, b.scene.length / v)
    into_block = b.scene.block.effusivity / (b.scene.road.effusivity * np.sqrt(v * t) * np.pi)
    flux = heat
    for _ in range(3):
        up = into_block * (warming @ flux) / phi
        flux = np.where(np.real(up) < (1.0 - LEFT) * np.real(heat), heat - up, LEFT * heat)
    return flux


def everywhere(mesh: Mesh, columns) -> np.ndarray:
    """What lanes have under the block (columns,), on all lines (n_lines, n_across): behind it as at its end."""
    every = np.ones((mesh.n_lines, mesh.n_across))
    every[mesh.first : mesh.last] = np.real(columns).reshape(-1, mesh.n_across)
    every[mesh.last :] = every[mesh.last - 1]
    return every


# --- lanes widen -----------------------------------------------------------------------------------------
def loss(b: Balance, now, edges) -> np.ndarray:
    """Weights (..., n_road) of the cells, deepest first, between distances `edges` (..., n_road + 1) m."""
    overlap = b.laws("road.lane_overlap", 1.0, None, now, edges) * np.ones(edges.shape)
    return (overlap[..., :-1] - overlap[..., 1:])[..., ::-1]


def loss_at_depth(b: Balance, now) -> np.ndarray:
    """Weights (n_road, n_road) of a column's rises by which its lanes lie below them at every depth.

    At the surface they are `ContactState.widen`: heat at a depth z has come from there by sqrt(z^2 + r^2).
    """
    depth = b.scene.mesh.depth
    apart = np.sqrt(np.maximum(depth**2 - centres(depth)[::-1, None] ** 2, 0.0))
    return (1.0 - b.laws("contact.resolved", 0.0, None, now)) * loss(b, now, apart)


def fallen(b: Balance, state: Any, T, T_in=None) -> np.ndarray:
    """By how much (columns,) K widening lowers the surface of a column, at a `ContactState`.

    `T` (cells,) rises, `T_in` (n_road n_across,) of columns of the entering road, 0 if None.
    """
    T_in = b.no_inflow if T_in is None else T_in
    widen, fall, *_ = alike(state.widen, state.fall, T[:1], T_in[:1])
    lowered: np.ndarray = kernels_contact.fallen(b.under, widen, fall, T, T_in)
    return lowered


def rises(b: Balance, state: Any, T, road) -> np.ndarray:
    """Rises (columns,) K of the lanes at their first cells, at rises T (cells,) over a `System.road` that enters."""
    found, coldest = _lanes_and_bound(b, state, T, road)
    return found if coldest is None else np.where(np.real(found) < coldest, coldest, found)


def limited(b: Balance, state: Any, T, road) -> Any:
    """The `ContactState` for slopes: lanes that the bound of `rises` holds follow no column."""
    found, coldest = _lanes_and_bound(b, state, T, road)
    if coldest is None:
        return state
    free = np.real(found) >= coldest
    return state._replace(lane=state.lane * free, fall=state.fall * free)


def _lanes_and_bound(b: Balance, state: Any, T, road) -> tuple[np.ndarray, float | None]:
    """Rises of the lanes by the closure, and the least that lanes can have, None where all have more.

    Ratios of `in_contact` are large where little touches, and an error of the road's columns grows with them.  By the
    maximum principle of heat conduction (Protter and Weinberger 1967) no lane is colder than the coldest of what it
    exchanges heat with: the block's face, the road's mean across y, and the road as it came in.
    """
    came, own = road
    lowered, seen = fallen(b, state, T, came), state.under.seen(T)
    top = came[-b.scene.mesh.n_across :]
    given: tuple = alike(state.lane, lowered, seen, top, state.widen, own)
    found: np.ndarray = kernels_contact.lane_rises(1.0 - b.share, *given)
    least = found.real.min()
    if least >= T[b.cell_block].real.min():
        return found, None
    untouched: np.ndarray = kernels_contact.lane_rises(1.0 - b.share, 0.0 * given[0], *given[1:])
    mean = untouched.real + b.share * (seen - np.resize(top, len(seen))).real
    coldest = float(min(T[b.cell_block].real.min(), untouched.real.min(), mean.min()))
    return found, coldest if least < coldest else None


def entered(b: Balance, weights: np.ndarray, road) -> np.ndarray:
    """Rises (n_road, n_across) K of lanes in a `System.road` that enters: those of earlier passes have widened.

    `weights` as `loss_at_depth` says.
    """
    came, own = np.reshape(road, (2, len(weights), -1))
    whole = weights.sum(axis=1)[:, None]
    mixed = np.divide(weights @ own, whole, out=own.copy(), where=whole > 0.0)
    lanes: np.ndarray = came - (1.0 - b.share) * mixed
    return lanes
