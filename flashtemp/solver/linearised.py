"""A system linearised at one instant: slopes of all heat, J v, and P^-1 r of the preconditioner."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from flashtemp.solver import conduction, kernels_contact, lanes
from flashtemp.solver.abrasion import AbrasionCoupling
from flashtemp.solver.balance import Balance
from flashtemp.solver.contact_flux import ContactState
from flashtemp.solver.interface import Contact
from flashtemp.solver.road_frame import Overlap, RoadFrame


def contact_slopes(b: Balance, contact: Contact | None, at_walls):
    """Slopes of all heat of walls and contact with temperature; how the ledger follows the cells, and how the lanes.

    Lanes are among the cells as if they kept their width.
    """
    own = [(cells, slope) for _, cells, slope in at_walls]
    rows: dict[str, list] = {name: [] for name in b.ledger}
    for name, cells, slope in at_walls:
        rows[name].append((cells, slope))
    deposits, along, up, down, books = None, b.idle, b.idle, b.idle, {}
    under = Overlap(b.cell_road) if contact is None else contact.state.under
    if contact is not None and contact.slopes is not None:
        state, d, area = contact.state, contact.slopes, b.scene.mesh.column_area
        face, lane = state.block * area, state.road * area
        if len(b.weight) and np.any(d.deep):
            deposits = face * d.deep[0], face * d.deep[1]
        own += [(b.cell_block, face * (d.block[0] + d.deep[0]))]
        along, up, down = lane * d.road[1], lane * d.road[0], face * (d.block[1] + d.deep[1])
        for name, w, slopes in (("friction", face, d.heat), ("into_road", face, d.road)):
            books[name] = w * slopes[1]
            rows[name] += [(b.cell_block, w * slopes[0]), *state.under.parts(books[name])]
    cell = np.concatenate([np.empty(0, dtype=np.int64), *(cells for cells, _ in own)])
    slope = np.concatenate([np.empty(0), *(slope for _, slope in own)])
    return conduction.Slopes(cell, slope, along, up, down, deposits, under), rows, books


def leaving_slopes(b: Balance, carry, stretch) -> tuple[np.ndarray, np.ndarray]:
    """Cells and slopes of the heat that the road carries out of the window, less what it brings in."""
    mesh, (first, before, last), slope = b.scene.mesh, b.ends, b.slope[-1]
    cells = [mesh.everywhere(at) for at in (last, before, first)]
    share, carried = mesh.share, np.outer(carry, mesh.share)
    gone, back = (carried if stretch is b.ones else carried * stretch[at] for at in cells[:2])
    parts = gone * (1 + slope), -back * slope, np.outer(b.g_in, share)
    return np.concatenate(cells, axis=None), np.concatenate(parts, axis=None)


class Booked(NamedTuple):
    """How entries of the ledger follow the cells: `weight` W/(m K) of `cell`, from offset[i] on for entry number i."""

    entry: np.ndarray
    offset: np.ndarray
    cell: np.ndarray
    weight: np.ndarray

    @classmethod
    def of(cls, b: Balance, rows: conduction.Rows) -> Booked:
        """The same as `rows`, in one piece."""
        offset = np.cumsum([0, *(len(cells) for cells, _ in rows.values())])
        cells, weights = (np.concatenate([row[k] for row in rows.values()]) for k in (0, 1))
        return cls(np.array([b.entry[name] for name in rows]), offset, cells, weights)

    def add(self, T: np.ndarray, scale: float, out: np.ndarray) -> None:
        """Add `scale` times what changes T (cells,) K do to the ledger."""
        kernels_contact.book(self.entry, self.offset, self.cell, self.weight, T, scale, out)


@dataclass(frozen=True)
class Linearised:
    """A system linearised at one instant: J v, and the preconditioner's P^-1 r for P = I - gamma J.

    `stretch` dh/dT (cells,); `rows` how the ledger follows the cells, of which `books` {entry: slopes (columns,) with
    the road's columns}; `contact` of that state, None where nothing depends on it.
    """

    b: Balance
    gamma: float
    stretch: np.ndarray
    rows: Booked
    contact: ContactState | None
    books: dict[str, np.ndarray]
    solid: conduction.LinearisedPlane
    coupling: AbrasionCoupling | None

    def times(self, v: np.ndarray, out: np.ndarray) -> None:
        """out = J v; conserves heat like the rate.

        Left out: slopes of k(T), and the ways from temperature over friction to the tilt of a block on springs, and
        from the face's temperature to the contact fraction.
        """
        b, n = self.b, self.b.n
        h = v[:n]
        T = h if b.heat_capacity is None else h / self.stretch
        out[n:] = 0.0
        lane = fallen = b.idle
        if self.contact is not None:
            lane, fallen = lanes.follow_columns(b, self.contact, T)
        self.solid.product(T, lane, out[:n])
        self.rows.add(T, 1.0, out)
        for name, slope in self.books.items():
            out[b.entry[name]] -= (slope * fallen).sum()
        if self.coupling is not None:
            w = self.coupling
            out[b.worn] = w.heated(T[b.cell_block], lane)
            w.add_all(v[b.worn], T, lane, out)

    def solve(self, r: np.ndarray, z: np.ndarray) -> None:
        """z = P^-1 r; the ledger follows the cells exactly, so that Krylov steps conserve heat."""
        b, n = self.b, self.b.n
        T, w = z[:n], self.coupling
        if w is not None:  # abrasion first: it moves the pressure, and that the heat
            r = r.copy()
            w.add(w.undo(r[b.worn]), r, self.gamma)
        z[n:] = r[n:]
        self.solid.solve(r[:n], T)
        self.rows.add(T, self.gamma, z)
        if w is not None:
            z[b.worn] += self.gamma * w.heated(T[b.cell_block], w.under.seen(T))
        if b.heat_capacity is not None:
            T *= self.stretch


@dataclass(frozen=True)
class Moved:
    """A system `at` a state as it lies under the block, for road that lies `k` lines further upstream in memory."""

    at: Linearised
    frame: RoadFrame
    k: int

    @property
    def gamma(self) -> float:
        """Of P = I - gamma J."""
        return self.at.gamma

    def times(self, v: np.ndarray, out: np.ndarray) -> None:
        """out = J v; road that has gone changes no more, and what has not come yet is given."""
        b, moved = self.at.b, np.empty_like(out)
        self.at.times(self.frame.placed(v, self.k, 0.0), moved)
        front = self.frame.back(moved, self.k, out, 0.0)
        out[b.entry["lane_out"]] += b.road_heat(front)

    def solve(self, r: np.ndarray, z: np.ndarray) -> None:
        """z = P^-1 r; what P gives to road that has not come yet is booked as gone, so that heat is conserved."""
        b, moved = self.at.b, np.empty_like(z)
        self.at.solve(self.frame.placed(r, self.k, 0.0), moved)
        front = self.frame.back(moved, self.k, z, r[: b.n])
        z[b.entry["lane_out"]] += b.road_heat(front)
