"""The lanes that spots draw on the road, out of what its columns hold: where they are in contact, and how they widen.

A column of road cells stands for a constant share of the width and holds all heat that the block has lost there.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from flashtemp.meshes.mesh import Mesh, centres
from flashtemp.model.effect_laws import COMPLEX_STEP
from flashtemp.solver import kernels_contact
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.kernels_contact import common_dtype

MIN_LANE_CONTACT_RATIO = (
    0.01  # lanes hold the heat of at least this share of the mean contact fraction; contact opens there
)
# TRACE_HEAT_FRACTION at half or double moves the rise by 1e-8 of itself (run-in, spots in proportion to pressure)
TRACE_HEAT_FRACTION = 1e-6  # of the mean heat, so that lanes are told apart where the block is lifted off
MIN_CONTACT_FRACTION = 1e-6  # contact fraction that there always is
# LEAST_LANE_HEAT_FRACTION at half or double moves the rise by 2e-8 of itself there; only heat both ways feels it
LEAST_LANE_HEAT_FRACTION = 0.05  # of the friction heat: what goes into the lanes counts as at least that, in doubt


# --- lanes begin and end ---------------------------------------------------------------------------------
class LaneHistory(NamedTuple):
    """What tells lanes in contact from their columns where the contact fraction varies, apart from temperature.

    `sums` (planes, 4, lines, lines) of what columns take upstream: what a lane at a line keeps of it, and all, each as
    it warms the surface and as it is lost sideways; `trace_heat` (planes, lines) W/m2, by which they differ before any heat;
    `is_untouched` (columns,) where no spot has drawn on the road, so that there are no lanes.
    """

    sums: np.ndarray
    trace_heat: np.ndarray
    is_untouched: np.ndarray


class LaneSlopes(NamedTuple):
    """How lanes in contact follow the cells: their `LaneHistory`, which share (planes, lines) a change of what columns take
    is of its size, both in the sums (4, columns), and rises (columns,) of columns and what they lose.

    `free` (columns,) is 0 where a bound holds the lanes.
    """

    history: LaneHistory
    share: np.ndarray
    taken: np.ndarray
    size: np.ndarray
    rise: np.ndarray
    lowered: np.ndarray
    free: np.ndarray | float = 1.0


def build_lane_history(b: HeatBalance, phi, weights, heat: float) -> LaneHistory:
    """`LaneHistory` of contact fractions (columns,) and `history_weights` of fluxes, `heat` W/m2 the scale of what there is to take.

    A spot at x took heat wherever it was in contact before, on min(phi, phi') of the width, and the road all heat: of
    F' = phi' J' a lane keeps F'/max(phi, phi') (docs/explanation/theory.md, eq. (15d)).
    """
    phi = phi.reshape(-1, b.scene.mesh.n_across).T
    dx = b.scene.mesh.dx_block
    least = MIN_LANE_CONTACT_RATIO * (phi @ dx / dx.sum())[:, None]
    here = np.where(np.real(phi) < np.real(least), least, phi)[:, :, None]
    larger = np.where(np.real(here) < np.real(phi[:, None]), phi[:, None], here)
    parts = [part for W in weights for part in (b.share * W / larger, W + 0.0 * larger)]
    met = weights[0] @ (np.real(phi) > MIN_CONTACT_FRACTION).T
    untouched = ((met == 0.0) & met.any(axis=0)).ravel()
    return LaneHistory(np.stack(parts, axis=1), TRACE_HEAT_FRACTION * (1.0 + heat) * phi, untouched)


def separate_lanes(b: HeatBalance, state: Any, T, road, heat) -> Any:
    """The `ContactState` whose lanes are told apart at rises T (cells,) over a `System.road` that enters.

    Their rise over that of their columns, and how much more than these they lose by widening, if the contact gives off
    `heat` (columns,) W/m2 of all of its area: the columns take of it what the block's face does not conduct away.
    """
    told, whole = state.lane_history, state._replace(loss_ratio=np.ones(len(state.phi)))
    heat = _by_planes(b, heat)
    taken = heat - _by_planes(b, heat_into_block(b, T)) + told.trace_heat
    size = np.sqrt(taken**2 + (LEAST_LANE_HEAT_FRACTION * heat + told.trace_heat) ** 2)
    summed = _sum_upstream(told.sums, taken), _sum_upstream(told.sums, size)
    lane, own = (np.where(told.is_untouched, 1.0, ratio) for ratio in _lane_ratios(*summed))
    rise, lowered = state.touched_road.column_values(T), surface_deficit(b, whole, T, road[0])
    real = (np.real(a) for a in (taken / size, *summed, rise, lowered))
    return state._replace(
        lane_ratio=lane, loss_ratio=own / lane, lane_history=None, lane_slopes=LaneSlopes(told, *real)
    )


def follow_columns(b: HeatBalance, state: Any, T) -> tuple[np.ndarray, np.ndarray]:
    """Changes (columns,) of lanes over `ContactState.lane`, by changes T (cells,); how much more columns change.

    Friction counts as constant.
    """
    at, seen = state.lane_slopes, state.touched_road.column_values(T)
    if at is None:
        fall = surface_deficit(b, state, T)
        return seen - fall, fall
    sums, less = np.real(at.history.sums), _by_planes(b, heat_into_block(b, T))
    taken, size = (
        at.taken - 1j * COMPLEX_STEP * _sum_upstream(sums, less),
        at.size - 1j * COMPLEX_STEP * _sum_upstream(sums, at.share * less),
    )
    lane, own = (np.where(at.history.is_untouched, 1.0, ratio) for ratio in _lane_ratios(taken, size))
    lost = surface_deficit(b, state._replace(loss_ratio=np.ones(len(seen))), T)
    moved = (
        lane.imag / COMPLEX_STEP * at.rise - own.imag / COMPLEX_STEP * at.lowered + lane.real * seen - own.real * lost
    )
    held = state.lane_ratio == 0.0
    followed = at.free * np.where(held, 0.0, moved / np.where(held, 1.0, state.lane_ratio))
    return followed, seen - followed


def _by_planes(b: HeatBalance, columns) -> np.ndarray:
    """Values (columns,) as (planes, lines)."""
    planes: np.ndarray = columns.reshape(-1, b.scene.mesh.n_across).T
    return planes


def _sum_upstream(sums: np.ndarray, taken: np.ndarray) -> np.ndarray:
    """Sums (4, columns) of what columns take (planes, lines), by `LaneHistory.sums`."""
    every = np.einsum("jnik,jk->nij", sums, taken) if len(sums) > 1 else sums[0] @ taken[0]
    return every.reshape(4, -1)


def _lane_ratios(taken: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What lanes have over what their columns have, and what they lose over what those lose (columns,).

    Of sums (4, columns) of what columns have `taken`, and of its size.  Where heat went both ways, so that little of
    the sum is left, it is its size that counts.
    """
    (N, D, P, Q), (n, d, p, q) = taken, size
    k, m = (1.0 - D / d) ** 2, (1.0 - Q / q) ** 2
    return (N + k * n) / (D + k * d), (P + m * p) / (Q + m * q)


def heat_into_block(b: HeatBalance, T) -> np.ndarray:
    """Heat (columns,) W/m2 that the block's first cells conduct into the next at rises T (cells,)."""
    mesh = b.scene.mesh
    fall = T[b.cell_block] - T[b.cell_block + mesh.n_across]
    flux: np.ndarray = 2.0 * b.scene.block.conductivity / mesh.height[2] * fall
    return flux


def uniform_lane_ratios(b: HeatBalance, phi) -> tuple[np.ndarray, np.ndarray] | None:
    """What `separate_lanes` gives wherever spots cover as much everywhere; None where they do not."""
    return (b.share / phi, np.ones(len(phi))) if np.isrealobj(phi) and np.ptp(phi) == 0.0 else None


def slid_road_length(mesh: Mesh, slid: float) -> float:
    """Length (m) of road under the block and in front of it that has been slid over, `slid` (m) after a start."""
    return float(min(max(slid, mesh.dx_block[0]), mesh.x[mesh.last]))


def history_weights(mesh: Mesh, slid_length: float) -> tuple[np.ndarray, np.ndarray]:
    """Weights (lines, lines under the block) of fluxes at x' as far as `slid_road_length` (m) upstream of the centre of each line.

    On the road's surface, as 1/sqrt(x - x'), and on what it loses sideways, which grows by a root more: evenly.
    """
    x, edges = mesh.x_block[:, None], mesh.x[mesh.first : mesh.last + 1]
    apart = np.clip(x - edges, 0.0, slid_length)
    root = np.sqrt(apart)
    return 2.0 * (root[:, :-1] - root[:, 1:]), apart[:, :-1] - apart[:, 1:]


def extend_over_lines(mesh: Mesh, columns) -> np.ndarray:
    """What lanes have under the block (columns,), on all lines (n_lines, n_across): behind it as at its end."""
    every = np.ones((mesh.n_lines, mesh.n_across))
    every[mesh.first : mesh.last] = np.real(columns).reshape(-1, mesh.n_across)
    every[mesh.last :] = every[mesh.last - 1]
    return every


# --- lanes widen -----------------------------------------------------------------------------------------
def spreading_loss(b: HeatBalance, now, edges) -> np.ndarray:
    """Weights (..., n_road) of the cells, deepest first, between distances `edges` (..., n_road + 1) m."""
    overlap = b.laws("road.lane_overlap", 1.0, None, now, edges) * np.ones(edges.shape)
    return (overlap[..., :-1] - overlap[..., 1:])[..., ::-1]


def spreading_loss_at_depth(b: HeatBalance, now) -> np.ndarray:
    """Weights (n_road, n_road) of a column's rises by which its lanes lie below them at every depth.

    At the surface they are `ContactState.widen`: heat at a depth z has come from there by sqrt(z^2 + r^2).
    """
    depth = b.scene.mesh.depth
    apart = np.sqrt(np.maximum(depth**2 - centres(depth)[::-1, None] ** 2, 0.0))
    return (1.0 - b.laws("contact.resolved", 0.0, None, now)) * spreading_loss(b, now, apart)


def surface_deficit(b: HeatBalance, state: Any, T, T_in=None) -> np.ndarray:
    """By how much (columns,) K widening lowers the surface of a column, at a `ContactState`.

    `T` (cells,) rises, `T_in` (n_road n_across,) of columns of the entering road, 0 if None.
    """
    T_in = b.no_inflow if T_in is None else T_in
    widen, fall, *_ = common_dtype(state.spreading_weights, state.loss_ratio, T[:1], T_in[:1])
    lowered: np.ndarray = kernels_contact.surface_deficit(b.deepest_road_cells, widen, fall, T, T_in)
    return lowered


def lane_rises(b: HeatBalance, state: Any, T, road) -> np.ndarray:
    """Rises (columns,) K of the lanes at their first cells, at rises T (cells,) over a `System.road` that enters."""
    found, coldest = _lanes_and_bound(b, state, T, road)
    return found if coldest is None else np.where(np.real(found) < coldest, coldest, found)


def limit_lane_slopes(b: HeatBalance, state: Any, T, road) -> Any:
    """The `ContactState` for slopes: lanes that the bound of `lane_rises` holds follow no column."""
    found, coldest = _lanes_and_bound(b, state, T, road)
    if coldest is None:
        return state
    free = np.real(found) >= coldest
    follow = state.lane_slopes and state.lane_slopes._replace(free=free)
    return state._replace(lane_ratio=state.lane_ratio * free, loss_ratio=state.loss_ratio * free, lane_slopes=follow)


def _lanes_and_bound(b: HeatBalance, state: Any, T, road) -> tuple[np.ndarray, float | None]:
    """Rises of the lanes by the closure, and the least that lanes can have, None where all have more.

    Ratios of `separate_lanes` are large where little touches, and an error of the road's columns grows with them.  By the
    maximum principle of heat conduction (Protter and Weinberger 1967) no lane is colder than the coldest of what it
    exchanges heat with: the block's face, the road's mean across y, and the road as it came in.
    """
    came, own = road
    lowered, seen = surface_deficit(b, state, T, came), state.touched_road.column_values(T)
    top = came[-b.scene.mesh.n_across :]
    given: tuple = common_dtype(state.lane_ratio, lowered, seen, top, state.spreading_weights, own)
    found: np.ndarray = kernels_contact.lane_rises(1.0 - b.share, *given)
    least = found.real.min()
    if least >= T[b.cell_block].real.min():
        return found, None
    untouched: np.ndarray = kernels_contact.lane_rises(1.0 - b.share, 0.0 * given[0], *given[1:])
    mean = untouched.real + b.share * (seen - np.resize(top, len(seen))).real
    coldest = float(min(T[b.cell_block].real.min(), untouched.real.min(), mean.min()))
    return found, coldest if least < coldest else None


def incoming_lane_rises(b: HeatBalance, weights: np.ndarray, road) -> np.ndarray:
    """Rises (n_road, n_across) K of lanes in a `System.road` that enters: those of earlier passes have widened.

    `history_weights` as `spreading_loss_at_depth` says.
    """
    came, own = np.reshape(road, (2, len(weights), -1))
    whole = weights.sum(axis=1)[:, None]
    mixed = np.divide(weights @ own, whole, out=own.copy(), where=whole > 0.0)
    lanes: np.ndarray = came - (1.0 - b.share) * mixed
    return lanes
