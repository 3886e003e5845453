"""A system linearised at one instant: derivatives of heat, Jacobian products and solves with the preconditioner."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from flashtemp.solver import conduction, contact_lanes, kernels_contact
from flashtemp.solver.contact_flux import ContactState
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.interface import SolvedContact
from flashtemp.solver.road_frame import RoadFrame, RoadOverlap
from flashtemp.solver.wear_coupling import AbrasionCoupling


def contact_slopes(b: HeatBalance, contact: SolvedContact | None, at_walls):
    """Derivatives of all boundary and contact heat with respect to temperature.

    Returns the `HeatSlopes`, the rows of the ledger with respect to cells, and those with respect to lanes {entry:
    (columns,)}.  In the rows for cells a lane counts as if it kept its width; the difference is added in
    `LinearisedSystem.apply_jacobian`.
    """
    own = [(cells, slope) for _, cells, slope in at_walls]
    rows: dict[str, list] = {name: [] for name in b.ledger}
    for name, cells, slope in at_walls:
        rows[name].append((cells, slope))
    deposits, along, up, down, books = None, b.zero_columns, b.zero_columns, b.zero_columns, {}
    under = RoadOverlap(b.cell_road) if contact is None else contact.state.touched_road
    if contact is not None and contact.slopes is not None:
        state, d, area = contact.state, contact.slopes, b.scene.mesh.column_area
        face, lane = state.block_coverage * area, state.road_coverage * area
        if len(b.deposit_weights) and np.any(d.deep):
            deposits = face * d.deep[0], face * d.deep[1]
        # derivatives 0 are with respect to the block's first cell, 1 with respect to that of the road
        own += [(b.cell_block, face * (d.block[0] + d.deep[0]))]
        along, up, down = lane * d.road[1], lane * d.road[0], face * (d.block[1] + d.deep[1])
        for name, w, slopes in (("friction", face, d.heat), ("into_road", face, d.road)):
            books[name] = w * slopes[1]
            rows[name] += [(b.cell_block, w * slopes[0]), *state.touched_road.heat_parts(books[name])]
    cell = np.concatenate([np.empty(0, dtype=np.int64), *(cells for cells, _ in own)])
    slope = np.concatenate([np.empty(0), *(slope for _, slope in own)])
    return conduction.HeatSlopes(cell, slope, along, up, down, deposits, under), rows, books


class OutflowDerivatives(NamedTuple):
    """Derivatives (n,) W/(m K) of the heat that the road carries out of the window with respect to `cells` (n,)."""

    cells: np.ndarray
    derivatives: np.ndarray


def outflow_derivatives(b: HeatBalance, advection, capacity_ratio) -> OutflowDerivatives:
    """Derivatives of the heat that the road carries out of the window, minus what it brings in.

    `capacity_ratio` is dh/dT (cells,); `advection` (n_road,) is rho c v dz of the road's cells, W/(m K).
    """
    mesh, (first, before, last), upwind = b.scene.mesh, b.outflow_cells, b.upwind_weight[-1]
    # second-order upwind extrapolates the outflow from two cells; conduction at the inflow adds the first cell
    cells = [mesh.everywhere(at) for at in (last, before, first)]
    share, carried = mesh.share, np.outer(advection, mesh.share)
    leaving, correction = (carried if capacity_ratio is b.ones else carried * capacity_ratio[at] for at in cells[:2])
    parts = leaving * (1 + upwind), -correction * upwind, np.outer(b.g_in, share)
    return OutflowDerivatives(np.concatenate(cells, axis=None), np.concatenate(parts, axis=None))


class LedgerMap(NamedTuple):
    """Derivatives `weight` W/(m K) of ledger entries with respect to `cell`; those of entry i begin at offset[i]."""

    entry: np.ndarray
    offset: np.ndarray
    cell: np.ndarray
    weight: np.ndarray

    @classmethod
    def from_rows(cls, b: HeatBalance, rows: conduction.LedgerRows) -> LedgerMap:
        """The map from `LedgerRows`, packed into contiguous arrays."""
        offset = np.cumsum([0, *(len(cells) for cells, _ in rows.values())])
        cells, weights = (np.concatenate([row[k] for row in rows.values()]) for k in (0, 1))
        return cls(np.array([b.ledger_index[name] for name in rows]), offset, cells, weights)

    def add_changes(self, T: np.ndarray, scale: float, out: np.ndarray) -> None:
        """Add `scale` times the change of the ledger by changes T (cells,) K to `out` (size,)."""
        kernels_contact.add_to_ledger(self.entry, self.offset, self.cell, self.weight, T, scale, out)


@dataclass(frozen=True)
class LinearisedSystem:
    """A system linearised at one instant: Jacobian products, and solves with P, which approximates I - gamma J.

    `capacity_ratio` is dh/dT (cells,).  `ledger_map` are the derivatives of the ledger by cells, and `ledger_slopes`
    {entry: (columns,)} those by lanes.  `contact` is the `ContactState`, None where no heat depends on it.
    """

    b: HeatBalance
    gamma: float
    capacity_ratio: np.ndarray
    ledger_map: LedgerMap
    contact: ContactState | None
    ledger_slopes: dict[str, np.ndarray]
    solid: conduction.LinearisedPlane
    coupling: AbrasionCoupling | None

    def apply_jacobian(self, v: np.ndarray, out: np.ndarray) -> None:
        """out = J v; it conserves heat like the rate.

        Left out are the derivative of k(T), the effect of temperature on the tilt of a block on springs by friction,
        and the effect of the face's temperature on the contact fraction.
        """
        b, n = self.b, self.b.n
        h = v[:n]
        T = h if b.heat_capacity is None else h / self.capacity_ratio
        out[n:] = 0.0
        lane = deficit = b.zero_columns
        if self.contact is not None:
            lane, deficit = contact_lanes.follow_columns(b, self.contact, T)
        self.solid.apply_jacobian(T, lane, out[:n])
        self.ledger_map.add_changes(T, 1.0, out)
        for name, slope in self.ledger_slopes.items():
            out[b.ledger_index[name]] -= (slope * deficit).sum()  # the rows count lanes as columns
        if self.coupling is not None:
            w = self.coupling
            out[b.worn] = w.abrasion_rate_change(T[b.cell_block], lane)
            w.add_full_response(v[b.worn], T, lane, out)

    def solve(self, r: np.ndarray, z: np.ndarray) -> None:
        """z = P^-1 r; the ledger follows the cells exactly, so inexact Krylov solves conserve heat (theory.md, 8)."""
        b, n = self.b, self.b.n
        T, w = z[:n], self.coupling
        if w is not None:  # wear first: it changes the pressure, and the pressure changes the heat
            r = r.copy()
            w.add_depth_response(w.solve_depth(r[b.worn]), r, self.gamma)
        z[n:] = r[n:]
        self.solid.solve(r[:n], T)
        self.ledger_map.add_changes(T, self.gamma, z)
        if w is not None:
            z[b.worn] += self.gamma * w.abrasion_rate_change(T[b.cell_block], w.touched_road.column_values(T))
        if b.heat_capacity is not None:
            T *= self.capacity_ratio


@dataclass(frozen=True)
class ShiftedLinearisation:
    """A linearisation `base` in the block's frame, for road that is stored `shifted_lines` lines further upstream."""

    base: LinearisedSystem
    frame: RoadFrame
    shifted_lines: int

    @property
    def gamma(self) -> float:
        """Of P = I - gamma J."""
        return self.base.gamma

    def apply_jacobian(self, v: np.ndarray, out: np.ndarray) -> None:
        """out = J v; road that has left does not change, and the temperature of road that enters is prescribed."""
        b, block_frame = self.base.b, np.empty_like(out)
        self.base.apply_jacobian(self.frame.to_block_frame(v, self.shifted_lines, 0.0), block_frame)
        front = self.frame.to_memory_frame(block_frame, self.shifted_lines, out, 0.0)
        out[b.ledger_index["lane_out"]] += b.road_heat(front)

    def solve(self, r: np.ndarray, z: np.ndarray) -> None:
        """z = P^-1 r; heat that P assigns to prescribed road is booked as heat that leaves, so heat is conserved."""
        b, block_frame = self.base.b, np.empty_like(z)
        self.base.solve(self.frame.to_block_frame(r, self.shifted_lines, 0.0), block_frame)
        front = self.frame.to_memory_frame(block_frame, self.shifted_lines, z, r[: b.n])
        z[b.ledger_index["lane_out"]] += b.road_heat(front)
