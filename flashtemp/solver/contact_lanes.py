"""Temperature of the heated lanes on the road: how lanes widen, and how they differ where the contact fraction varies.

Contact spots move with the road, so each leaves a heated track, here a *lane*.  The road is computed by columns of
cells, one per depth line and plane (a slice across the width).  A column represents the constant fraction
`HeatBalance.share` of the width and holds all the heat that the block gave it.  The lane's surface temperature, which
the spots meet, follows from it by two closures:

- Widening: heat spreads sideways out of a lane.  The mean of the spreading Gaussian over the overlap of two discs gives
  the lane's surface from the column's temperature over depth (theory.md, section 1.6, eq. (15c)).
- Nested lanes: what touches at a small contact fraction also touches at a larger one, so lanes in contact are warmer
  than their column where the fraction varies along x (section 1.7, eq. (15d)).

Neither closure adds a state, and neither gains or loses heat: the columns stay conservative.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from flashtemp.meshes.mesh import Mesh, centres
from flashtemp.model.effect_laws import COMPLEX_STEP
from flashtemp.solver import kernels_contact
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.kernels_contact import common_dtype

MIN_LANE_CONTACT_RATIO = 0.01  # of the mean contact fraction: smallest fraction in the weights of eq. (15d)
# TRACE_HEAT_FRACTION at half or double changes the temperature rise by 1e-8 of itself (run-in, spot_exponent = 1)
TRACE_HEAT_FRACTION = 1e-6  # of the mean heat: keeps eq. (15d) defined where the block is lifted off
MIN_CONTACT_FRACTION = 1e-6  # lower limit of the contact fraction
# LEAST_LANE_HEAT_FRACTION at half or double changes the rise by 2e-8 there; it matters only where heat goes both ways
LEAST_LANE_HEAT_FRACTION = 0.05  # of the friction heat: lower limit of the size |F| of the heat into the lanes


# --- lanes of different contact fractions: eq. (15d) -----------------------------------------------------
class LaneHistory(NamedTuple):
    """The weights of eq. (15d) for one contact fraction along x; they do not depend on temperature.

    `sums` (planes, 4, lines, lines) are matrices over the heat that columns take upstream: numerator and denominator
    for the surface temperature (w = 1/sqrt(x - x')), then both for the heat lost sideways (w = 1).  `trace_heat`
    (planes, lines) W/m2 is added to the heat, so that the ratio is defined before any heat has flowed.  `is_untouched`
    (columns,) marks columns of road on which no spot has been: there the ratio is 1.
    """

    sums: np.ndarray
    trace_heat: np.ndarray
    is_untouched: np.ndarray


class LaneSlopes(NamedTuple):
    """The state around which eq. (15d) is linearised.

    `size_slope` (planes, lines) is d|F|/dF of the heat F that columns take; `taken` and `size` (4, columns) are sums of
    F and |F| by `LaneHistory.sums`; `rise` and `lowered` (columns,) K are the rise of the columns and their
    `surface_deficit`.  `free` (columns,) is 0 where the maximum principle limits a lane, so that it follows no column.
    """

    history: LaneHistory
    size_slope: np.ndarray
    taken: np.ndarray
    size: np.ndarray
    rise: np.ndarray
    lowered: np.ndarray
    free: np.ndarray | float = 1.0


def build_lane_history(b: HeatBalance, phi, weights, heat: float) -> LaneHistory:
    """Weights of eq. (15d) for contact fractions `phi` (columns,) and the `history_weights` of upstream fluxes.

    A spot at x took heat wherever it was in contact before, on min(phi, phi') of the width, while the column took all
    heat.  So of F' = phi' J' a lane keeps F'/max(phi, phi').  `heat` (W/m2) is the scale for `TRACE_HEAT_FRACTION`.
    """
    phi = phi.reshape(-1, b.scene.mesh.n_across).T
    dx = b.scene.mesh.dx_block
    least = MIN_LANE_CONTACT_RATIO * (phi @ dx / dx.sum())[:, None]
    # eq. (15d) divides by the larger fraction: a lower limit keeps it finite where the block is lifted off
    here = np.where(np.real(phi) < np.real(least), least, phi)[:, :, None]
    larger = np.where(np.real(here) < np.real(phi[:, None]), phi[:, None], here)
    parts = [part for W in weights for part in (b.share * W / larger, W + 0.0 * larger)]
    met = weights[0] @ (np.real(phi) > MIN_CONTACT_FRACTION).T
    untouched = ((met == 0.0) & met.any(axis=0)).ravel()
    return LaneHistory(np.stack(parts, axis=1), TRACE_HEAT_FRACTION * (1.0 + heat) * phi, untouched)


def separate_lanes(b: HeatBalance, state: Any, T, road, heat) -> Any:
    """The `ContactState` with `lane_ratio` and `loss_ratio` of eq. (15d), at temperature rises T (cells,).

    `heat` (columns,) W/m2 is the heat of the contact per nominal area.  The columns take F = `heat` - J_b, where J_b is
    what the block's first cells conduct into the block.  `road` is `PhaseSystem.incoming_road`.
    """
    history, whole = state.lane_history, state._replace(loss_ratio=np.ones(len(state.phi)))
    heat = _by_planes(b, heat)
    taken = heat - _by_planes(b, heat_into_block(b, T)) + history.trace_heat
    # a smooth |F|: its lower limit keeps derivatives finite where F changes sign
    size = np.sqrt(taken**2 + (LEAST_LANE_HEAT_FRACTION * heat + history.trace_heat) ** 2)
    summed = _sum_upstream(history.sums, taken), _sum_upstream(history.sums, size)
    lane, loss = (np.where(history.is_untouched, 1.0, ratio) for ratio in _lane_ratios(*summed))
    rise, lowered = state.touched_road.column_values(T), surface_deficit(b, whole, T, road[0])
    real = (np.real(a) for a in (taken / size, *summed, rise, lowered))
    return state._replace(
        lane_ratio=lane, loss_ratio=loss / lane, lane_history=None, lane_slopes=LaneSlopes(history, *real)
    )


def follow_columns(b: HeatBalance, state: Any, T) -> tuple[np.ndarray, np.ndarray]:
    """Linearised lanes: the changes (columns,) of their rises over `lane_ratio` by changes T (cells,) of the rises.

    Returns these changes, and by how much more the columns change.  Friction counts as constant.
    """
    at, columns = state.lane_slopes, state.touched_road.column_values(T)
    if at is None:
        deficit = surface_deficit(b, state, T)
        return columns - deficit, deficit
    # the ratios are quotients of sums: a complex step along T gives their directional derivative
    sums, less = np.real(at.history.sums), _by_planes(b, heat_into_block(b, T))
    taken, size = (
        at.taken - 1j * COMPLEX_STEP * _sum_upstream(sums, less),
        at.size - 1j * COMPLEX_STEP * _sum_upstream(sums, at.size_slope * less),
    )
    lane, loss = (np.where(at.history.is_untouched, 1.0, ratio) for ratio in _lane_ratios(taken, size))
    lost = surface_deficit(b, state._replace(loss_ratio=np.ones(len(columns))), T)
    by_ratios = lane.imag / COMPLEX_STEP * at.rise - loss.imag / COMPLEX_STEP * at.lowered
    moved = by_ratios + lane.real * columns - loss.real * lost
    limited = state.lane_ratio == 0.0
    followed = at.free * np.where(limited, 0.0, moved / np.where(limited, 1.0, state.lane_ratio))
    return followed, columns - followed


def _by_planes(b: HeatBalance, columns) -> np.ndarray:
    """Values (columns,) as (planes, lines)."""
    planes: np.ndarray = columns.reshape(-1, b.scene.mesh.n_across).T
    return planes


def _sum_upstream(sums: np.ndarray, taken: np.ndarray) -> np.ndarray:
    """The four sums (4, columns) of eq. (15d) over the heat `taken` (planes, lines), by `LaneHistory.sums`."""
    total = np.einsum("jnik,jk->nij", sums, taken) if len(sums) > 1 else sums[0] @ taken[0]
    return total.reshape(4, -1)


def _lane_ratios(taken: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eq. (15d) (columns,): rise of the lanes over that of their columns, and the same ratio of the heat lost sideways.

    `taken` and `size` (4, columns) are sums of F and |F|.  Where heat went both ways the denominator may vanish, so |F|
    counts too, with the weight (1 - sum F/sum |F|)^2.
    """
    (N, D, P, Q), (n, d, p, q) = taken, size
    k, m = (1.0 - D / d) ** 2, (1.0 - Q / q) ** 2
    return (N + k * n) / (D + k * d), (P + m * p) / (Q + m * q)


def heat_into_block(b: HeatBalance, T) -> np.ndarray:
    """J_b of eq. (15d): flux (columns,) W/m2 from the block's first cells into the next, at rises T (cells,)."""
    mesh = b.scene.mesh
    drop = T[b.cell_block] - T[b.cell_block + mesh.n_across]
    flux: np.ndarray = 2.0 * b.scene.block.conductivity / mesh.height[2] * drop
    return flux


def uniform_lane_ratios(b: HeatBalance, phi) -> tuple[np.ndarray, np.ndarray] | None:
    """`lane_ratio` and `loss_ratio` (columns,) for a uniform contact fraction; None where it varies."""
    return (b.share / phi, np.ones(len(phi))) if np.isrealobj(phi) and np.ptp(phi) == 0.0 else None


def slid_road_length(mesh: Mesh, slid: float) -> float:
    """Length (m) of road that carries lanes of this pass, `slid` (m) after its start: at most the block's length."""
    return float(min(max(slid, mesh.dx_block[0]), mesh.x[mesh.last]))


def history_weights(mesh: Mesh, slid_length: float) -> tuple[np.ndarray, np.ndarray]:
    """Weights w of eq. (15d), integrated over each line: two matrices (lines, lines under the block).

    The first is for the surface temperature, w = 1/sqrt(x - x').  The second is for the heat lost sideways, w = 1,
    because that loss grows with sqrt(x - x') relative to the surface.  Fluxes count up to `slid_length` (m) upstream.
    """
    x, edges = mesh.x_block[:, None], mesh.x[mesh.first : mesh.last + 1]
    distance = np.clip(x - edges, 0.0, slid_length)
    root = np.sqrt(distance)
    return 2.0 * (root[:, :-1] - root[:, 1:]), distance[:, :-1] - distance[:, 1:]


def extend_over_lines(mesh: Mesh, columns) -> np.ndarray:
    """Ratios (columns,) under the block extended to all lines (n_lines, n_across): 1 before it, constant behind it."""
    extended = np.ones((mesh.n_lines, mesh.n_across))
    extended[mesh.first : mesh.last] = np.real(columns).reshape(-1, mesh.n_across)
    extended[mesh.last :] = extended[mesh.last - 1]
    return extended


# --- widening of a lane: eq. (15c) -----------------------------------------------------------------------
def spreading_loss(b: HeatBalance, now, edges) -> np.ndarray:
    """w(r) of eq. (15c) integrated over each road cell (..., n_road), deepest first.

    `edges` (..., n_road + 1) m are the values of r at the edges of the cells.  The law `road.lane_overlap` is c(r), and
    w = -dc/dr, so the integral over a cell is a difference of c.
    """
    overlap = b.laws("road.lane_overlap", 1.0, None, now, edges) * np.ones(edges.shape)
    return (overlap[..., :-1] - overlap[..., 1:])[..., ::-1]


def spreading_loss_at_depth(b: HeatBalance, now) -> np.ndarray:
    """Weights (n_road, n_road) of eq. (15c) at every depth z; the surface row is `ContactState.spreading_weights`.

    At depth z the column's temperature is needed at sqrt(z^2 + r^2).  Resolved spots have no closure.
    """
    depth = b.scene.mesh.depth
    distance = np.sqrt(np.maximum(depth**2 - centres(depth)[::-1, None] ** 2, 0.0))
    return (1.0 - b.laws("contact.resolved", 0.0, None, now)) * spreading_loss(b, now, distance)


def surface_deficit(b: HeatBalance, state: Any, T, T_in=None) -> np.ndarray:
    """By how much (columns,) K widening lowers the surface temperature of the lanes: the integral in eq. (15c).

    `T` (cells,) are rises, `T_in` (n_road n_across,) those of the columns of the entering road, 0 if None.
    """
    T_in = b.no_inflow if T_in is None else T_in
    weights, ratio, *_ = common_dtype(state.spreading_weights, state.loss_ratio, T[:1], T_in[:1])
    deficit: np.ndarray = kernels_contact.surface_deficit(b.deepest_road_cells, weights, ratio, T, T_in)
    return deficit


def lane_rises(b: HeatBalance, state: Any, T, road) -> np.ndarray:
    """Rises (columns,) K of the lanes in the road's first cells, at rises T (cells,).

    `road` is `PhaseSystem.incoming_road`.
    """
    rises, coldest = _lanes_and_bound(b, state, T, road)
    return rises if coldest is None else np.where(np.real(rises) < coldest, coldest, rises)


def limit_lane_slopes(b: HeatBalance, state: Any, T, road) -> Any:
    """The `ContactState` for derivatives: a lane at the bound of `lane_rises` follows no column."""
    rises, coldest = _lanes_and_bound(b, state, T, road)
    if coldest is None:
        return state
    free = np.real(rises) >= coldest
    follow = state.lane_slopes and state.lane_slopes._replace(free=free)
    return state._replace(lane_ratio=state.lane_ratio * free, loss_ratio=state.loss_ratio * free, lane_slopes=follow)


def _lanes_and_bound(b: HeatBalance, state: Any, T, road) -> tuple[np.ndarray, float | None]:
    """Rises (columns,) of the lanes by eqs. (15c) and (15d), and their lower bound, None where no lane is below it.

    The ratio of eq. (15d) is large where little touches, and it amplifies errors of the columns.  By the maximum
    principle of heat conduction (Protter and Weinberger 1967) no lane is colder than the coldest of what it exchanges
    heat with: the block's face, the mean of the road across y, and the road as it came in.
    """
    incoming, earlier = road
    deficit, columns = surface_deficit(b, state, T, incoming), state.touched_road.column_values(T)
    top = incoming[-b.scene.mesh.n_across :]
    arguments: tuple = common_dtype(state.lane_ratio, deficit, columns, top, state.spreading_weights, earlier)
    rises: np.ndarray = kernels_contact.lane_rises(1.0 - b.share, *arguments)
    least = rises.real.min()
    if least >= T[b.cell_block].real.min():  # the usual case: the bound need not be computed
        return rises, None
    as_entered: np.ndarray = kernels_contact.lane_rises(1.0 - b.share, 0.0 * arguments[0], *arguments[1:])
    mean = as_entered.real + b.share * (columns.reshape(-1, len(top)) - top).real.ravel()
    coldest = float(min(T[b.cell_block].real.min(), as_entered.real.min(), mean.min()))
    return rises, coldest if least < coldest else None


def incoming_lane_rises(b: HeatBalance, weights: np.ndarray, road) -> np.ndarray:
    """Rises (n_road, n_across) K of the lanes in the entering road; those of earlier passes have widened.

    `weights` are those of `spreading_loss_at_depth`, `road` is `PhaseSystem.incoming_road`.
    """
    incoming, earlier = np.reshape(road, (2, len(weights), -1))
    total = weights.sum(axis=1)[:, None]
    mixed = np.divide(weights @ earlier, total, out=earlier.copy(), where=total > 0.0)
    lanes: np.ndarray = incoming - (1.0 - b.share) * mixed
    return lanes
