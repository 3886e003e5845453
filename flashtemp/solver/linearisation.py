"""A system linearised at one instant: slopes of all heat, J v, and P^-1 r of the preconditioner."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from flashtemp.solver import conduction, contact_lanes, kernels_contact
from flashtemp.solver.abrasion import AbrasionCoupling
from flashtemp.solver.contact_flux import ContactState
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.interface import SolvedContact
from flashtemp.solver.road_frame import RoadFrame, RoadOverlap


def contact_slopes(b: HeatBalance, contact: SolvedContact | None, at_walls):
    """Slopes of all heat of walls and contact with temperature; how the ledger follows the cells, and how the lanes.

    Lanes are among the cells as if they kept their width.
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
        own += [(b.cell_block, face * (d.block[0] + d.deep[0]))]
        along, up, down = lane * d.road[1], lane * d.road[0], face * (d.block[1] + d.deep[1])
        for name, w, slopes in (("friction", face, d.heat), ("into_road", face, d.road)):
            books[name] = w * slopes[1]
            rows[name] += [(b.cell_block, w * slopes[0]), *state.touched_road.heat_parts(books[name])]
    cell = np.concatenate([np.empty(0, dtype=np.int64), *(cells for cells, _ in own)])
    slope = np.concatenate([np.empty(0), *(slope for _, slope in own)])
    return conduction.HeatSlopes(cell, slope, along, up, down, deposits, under), rows, books


def outflow_slopes(b: HeatBalance, advection, capacity_ratio) -> tuple[np.ndarray, np.ndarray]:
    """Cells and slopes of the heat that the road carries out of the window, less what it brings in."""
    mesh, (first, before, last), slope = b.scene.mesh, b.outflow_cells, b.upwind_weight[-1]
    cells = [mesh.everywhere(at) for at in (last, before, first)]
    share, carried = mesh.share, np.outer(advection, mesh.share)
    gone, back = (carried if capacity_ratio is b.ones else carried * capacity_ratio[at] for at in cells[:2])
    parts = gone * (1 + slope), -back * slope, np.outer(b.g_in, share)
    return np.concatenate(cells, axis=None), np.concatenate(parts, axis=None)


class LedgerMap(NamedTuple):
    """How entries of the ledger follow the cells: `weight` W/(m K) of `cell`, from offset[i] on for entry number i."""

    entry: np.ndarray
    offset: np.ndarray
    cell: np.ndarray
    weight: np.ndarray

    @classmethod
    def from_rows(cls, b: HeatBalance, rows: conduction.LedgerRows) -> LedgerMap:
        """The same as `ledger_map`, in one piece."""
        offset = np.cumsum([0, *(len(cells) for cells, _ in rows.values())])
        cells, weights = (np.concatenate([row[k] for row in rows.values()]) for k in (0, 1))
        return cls(np.array([b.ledger_index[name] for name in rows]), offset, cells, weights)

    def add_changes(self, T: np.ndarray, scale: float, out: np.ndarray) -> None:
        """Add `scale` times what changes T (cells,) K do to the ledger."""
        kernels_contact.add_to_ledger(self.entry, self.offset, self.cell, self.weight, T, scale, out)


@dataclass(frozen=True)
class LinearisedSystem:
    """A system linearised at one instant: J v, and the preconditioner's P^-1 r for P = I - gamma J.

    `capacity_ratio` dh/dT (cells,); `ledger_map` how the ledger follows the cells, of which `ledger_slopes` {entry: slopes (columns,) with
    the road's columns}; `contact` of that state, None where nothing depends on it.
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
        """out = J v; conserves heat like the rate.

        Left out: slopes of k(T), and the ways from temperature over friction to the tilt of a block on springs, and
        from the face's temperature to the contact fraction.
        """
        b, n = self.b, self.b.n
        h = v[:n]
        T = h if b.heat_capacity is None else h / self.capacity_ratio
        out[n:] = 0.0
        lane = fallen = b.zero_columns
        if self.contact is not None:
            lane, fallen = contact_lanes.follow_columns(b, self.contact, T)
        self.solid.apply_jacobian(T, lane, out[:n])
        self.ledger_map.add_changes(T, 1.0, out)
        for name, slope in self.ledger_slopes.items():
            out[b.ledger_index[name]] -= (slope * fallen).sum()
        if self.coupling is not None:
            w = self.coupling
            out[b.worn] = w.abrasion_rate_change(T[b.cell_block], lane)
            w.add_full_response(v[b.worn], T, lane, out)

    def solve(self, r: np.ndarray, z: np.ndarray) -> None:
        """z = P^-1 r; the ledger follows the cells exactly, so that Krylov steps conserve heat."""
        b, n = self.b, self.b.n
        T, w = z[:n], self.coupling
        if w is not None:  # abrasion first: it moves the pressure, and that the heat
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
    """A system `base` a state as it lies under the block, for road that lies `shifted_lines` lines further upstream in memory."""

    base: LinearisedSystem
    frame: RoadFrame
    shifted_lines: int

    @property
    def gamma(self) -> float:
        """Of P = I - gamma J."""
        return self.base.gamma

    def apply_jacobian(self, v: np.ndarray, out: np.ndarray) -> None:
        """out = J v; road that has gone changes no more, and what has not come yet is given."""
        b, moved = self.base.b, np.empty_like(out)
        self.base.apply_jacobian(self.frame.to_block_frame(v, self.shifted_lines, 0.0), moved)
        front = self.frame.to_memory_frame(moved, self.shifted_lines, out, 0.0)
        out[b.ledger_index["lane_out"]] += b.road_heat(front)

    def solve(self, r: np.ndarray, z: np.ndarray) -> None:
        """z = P^-1 r; what P gives to road that has not come yet is booked as gone, so that heat is conserved."""
        b, moved = self.base.b, np.empty_like(z)
        self.base.solve(self.frame.to_block_frame(r, self.shifted_lines, 0.0), moved)
        front = self.frame.to_memory_frame(moved, self.shifted_lines, z, r[: b.n])
        z[b.ledger_index["lane_out"]] += b.road_heat(front)
