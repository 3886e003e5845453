"""Conduction and advection in block and road; the depth-line preconditioner is factorised and solved from here."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from flashtemp.errors import SolverFailure
from flashtemp.solver import kernels_2d, kernels_3d
from flashtemp.solver.balance import Balance
from flashtemp.solver.kernel_arrays import Crossing, Factors, Lines, Transport, Walls
from flashtemp.solver.road_frame import Overlap

Rows = dict[str, tuple[np.ndarray, np.ndarray]]  # entry of the ledger: cells and slopes, W/(m K)


@dataclass(frozen=True)
class Slopes:
    """Slopes of the heat of boundary and contact with temperature, W/(m K).

    `own` of cells `cell` with their own temperature; at the interface (columns,) `lane` d(road heat)/d(lane T), `up`
    d(road heat)/d(block T), `down` d(block heat)/d(lane T); `deposits` (columns,) of the heat in depth with block and
    lane, None where there is none.
    """

    cell: np.ndarray
    own: np.ndarray
    lane: np.ndarray
    up: np.ndarray
    down: np.ndarray
    deposits: tuple[np.ndarray, np.ndarray] | None
    under: Overlap

    def diagonal(self) -> tuple[np.ndarray, np.ndarray]:
        """Cells and their own slopes in P, where lanes keep their width.

        What `across` leaves out, since that road lies on no line of the block, stays in it.
        """
        parts = self.under.parts(self.lane)
        if self.under.other is not None:
            slope, down, shift = parts[1][1], self.under.parts(self.down)[1][1], self.under.shift
            ends = slice(None, -shift) if shift < 0 else slice(-shift, None)
            slope[ends] += down[ends]
        return np.concatenate([self.cell, *(i for i, _ in parts)]), np.concatenate([self.own, *(w for _, w in parts)])

    def across(self) -> np.ndarray:
        """Slopes (columns,) in P of all heat of the block with the road on its line, counted in that column of it."""
        if self.under.other is None:
            return self.down
        (_, down), (_, beside) = self.under.parts(self.down)
        shift = self.under.shift
        if shift < 0:
            down[:shift] += beside[-shift:]
        else:
            down[shift:] += beside[:-shift]
        return down


@dataclass(frozen=True)
class Bounded:
    """Faces (n, 4) of the road that advection may not take below the `floor`, at enthalpy rises h and h_in."""

    b: Balance
    faces: np.ndarray
    carry: np.ndarray
    floor: float
    h: np.ndarray
    h_in: np.ndarray

    def add_rate(self, out) -> None:
        """Add to rates (cells,) K/s what these faces carry more."""
        b, mesh = self.b, self.b.scene.mesh
        kernels_2d.bound_faces(
            self.faces, mesh.line, mesh.n_across, b.slope, self.carry, b.capacity, self.floor, self.h,
            self.h_in.astype(self.h.dtype, copy=False), out,
        )  # fmt: skip

    def add_product(self, v, out) -> None:
        """Add to a product of the Jacobian what changes v (cells,) K do there."""
        b, mesh = self.b, self.b.scene.mesh
        held = np.real(self.h[self.faces[:, 0]]) < self.floor
        kernels_2d.bound_products(
            self.faces, mesh.line, mesh.n_across, b.slope, self.carry, b.capacity, held, v, out
        )  # fmt: skip


def solid(balance: Balance) -> Plane | Slab:
    """The solids of a balance: a Plane in 2D, a Slab in 3D."""
    mesh = balance.scene.mesh
    lines = Lines(
        start=mesh.start,
        m=mesh.n_road,
        first=mesh.first,
        capacity=balance.capacity,
        slope=balance.slope,
        g_in=balance.g_in,
        weight=np.where(mesh.level < mesh.n_road, balance.share, 1.0),
        share=mesh.share,
    )
    return Plane(balance, lines) if mesh.n_across == 1 else Slab.of(balance, lines)


@dataclass(frozen=True)
class Plane:
    """One plane (x, z)."""

    b: Balance
    lines: Lines

    def conduction(self, T, now) -> np.ndarray:
        """Factor on conductivity (cells,) at the temperature rises T."""
        b, mesh = self.b, self.b.scene.mesh
        if not b.nonlinear_conductivity:
            return b.ones
        f = np.ones(b.n, dtype=T.dtype)
        for site, cells in (("block", mesh.block), ("road", mesh.road)):
            warm = mesh.planes(T)[cells] + b.scene.ambient
            mesh.planes(f)[cells] = b.laws(f"{site}.conductivity", 1.0, warm, now)
        if np.min(f.real) <= 0:
            raise SolverFailure("thermal conductivity fell to zero or below")
        return f

    def conductances(self, kf) -> Any:
        """What conducts between cells, W/(m K), for factors kf (cells,) on conductivity: what `flows` takes."""
        b = self.b
        if kf is b.ones:
            return b.gx, b.gz
        gx, gz = np.empty_like(kf), np.empty_like(kf)
        kernels_2d.face_conductances(self.lines.start, self.lines.m, b.half_x, b.half_z, b.gap, kf, gx, gz)
        return gx, gz

    def flows(self, T, h, T_in, h_in, conductances, carry, q) -> None:
        """Complete q (cells,): heat W/m from boundary and contact on entry, rates K/s on return."""
        b, lines, (gx, gz) = self.b, self.lines, conductances
        kernels_2d.heat_flows(
            lines.start, lines.m, gx, gz, carry, b.slope, T, h, T_in.astype(T.dtype, copy=False),
            h_in.astype(T.dtype, copy=False), b.g_in, q,
        )  # fmt: skip
        q /= b.capacity

    def bound(self, h, h_in, carry, floor: float) -> Bounded | None:
        """Faces that would carry road colder than the `floor` (enthalpy rise in K), None where there are none.

        The second-order upwind scheme extrapolates to faces, and undershoots before a cold front.  A face is held at
        the lesser of its own cell and the floor: the positivity-preserving limiter of Zhang and Shu (2010, J. Comput.
        Phys. 229, 3091), which leaves the order of the scheme wherever it does not act, and conserves heat.
        """
        if floor == -np.inf or not carry.any():
            return None
        faces = kernels_2d.undershooting_faces(self.lines.start, self.lines.m, self.b.slope, floor, h, h_in)
        return Bounded(self.b, faces, carry, floor, h, h_in) if len(faces) else None

    def linearised(
        self, gamma: float, kf, carry, stretch, slopes: Slopes, rows: Rows, bounded: Bounded | None
    ) -> LinearisedPlane:
        """Around conductivities `kf` (cells,) and dh/dT `stretch` (cells,), with P ~ I - gamma J factorised.

        `carry` (n_road,) rho c v dz; `rows` how the ledger follows the cells.  In P the heat in depth is in the
        cells at the face, and lanes keep their width.
        """
        gx, gz = self.conductances(kf)
        own = np.zeros(self.b.n)
        np.add.at(own, *slopes.diagonal())
        up, down = slopes.up, slopes.across()
        factors = self._factors(gamma, Transport(gx, gz, carry, stretch), own, up, down)
        pivots = (factors.inv[cells] for cells in (self.b.cell_road, self.b.cell_block))
        crossing = Crossing(up, down, *pivots)
        return LinearisedPlane(self, gamma, (gx, gz), carry, stretch, slopes, factors, crossing, bounded)

    def _factors(self, gamma, transport: Transport, own, up, down) -> Factors:
        # one block: malloc keeps its memory for the next, small ones would fault their pages in anew
        factors = Factors(*np.empty((len(Factors._fields), len(own))))
        kernels_2d.factorise(self.lines, transport, gamma, own, up, down, factors)
        return factors


@dataclass(frozen=True)
class LinearisedPlane:
    """The cells of block and road linearised around a state: J v, and P^-1 r of the preconditioner."""

    solid: Plane | Slab
    gamma: float
    conductances: tuple
    carry: np.ndarray
    stretch: np.ndarray
    slopes: Slopes
    factors: Factors
    crossing: Crossing
    bounded: Bounded | None

    def product(self, T, lane, out) -> None:
        """out = J v of cells whose temperatures change by T (cells,), lanes' by `lane` (columns,), in K/s.

        Nothing enters with the road.
        """
        b, slopes = self.solid.b, self.slopes
        out[:] = 0.0
        along, up = slopes.lane, slopes.up
        if slopes.under.other is not None:
            slopes.under.give(up * T[b.cell_block] + along * lane, out)
            along, up = 0.0 * along, 0.0 * up
        kernels_2d.add_slopes(slopes.cell, slopes.own, b.cell_road, b.cell_block, along, up, slopes.down, T, lane, out)
        if slopes.deposits is not None:
            power = slopes.deposits[0] * T[b.cell_block] + slopes.deposits[1] * lane
            out[b.cell_block] -= power
            kernels_2d.deposit(b.deep_cells, b.weight, power, out)
        h = T if b.heat_capacity is None else T * self.stretch
        self.solid.flows(T, h, b.no_inflow, b.no_inflow, self.conductances, self.carry, out)
        if self.bounded is not None:
            self.bounded.add_product(h, out)

    def solve(self, r, z) -> None:
        """z = P^-1 r of cells; the columns of P conserve heat by themselves."""
        start, m, first, capacity, *_ = self.solid.lines
        up, down, *_ = self.crossing
        kernels_2d.sweep(start, m, first, capacity, self.gamma, up, down, *self.factors, r, z)


@dataclass(frozen=True)
class Slab(Plane):
    """Many planes (x, z) side by side, which share the factors of their mean; only the interface has its own."""

    walls: Walls
    faces: np.ndarray  # cells of a plane at the interface: the road's, then the block's
    face: np.ndarray  # number (n_plane,) of a plane's cell among the faces, -1 if it is none

    @classmethod
    def of(cls, b: Balance, lines: Lines) -> Slab:
        """The slab of a balance."""
        mesh = b.scene.mesh
        dy = np.diff(mesh.y)
        apart = 0.5 * (dy[1:] + dy[:-1])
        before, after = np.zeros(len(dy)), np.zeros(len(dy))
        before[1:], after[:-1] = 1.0 / (apart * dy[1:]), 1.0 / (apart * dy[:-1])
        faces = np.concatenate([mesh.road[mesh.first : mesh.last, -1], mesh.block[:, 0]])
        face = np.full(mesh.n_plane, -1)
        face[faces] = np.arange(len(faces))
        gy, even = b.conductivity * mesh.volume, np.ones(1)
        return cls(b, lines, Walls(b.gx, b.gz, gy, b.half_x, b.half_z, b.gap, even, dy, before, after), faces, face)

    def conductances(self, kf):
        """What conducts between cells, for factors kf (cells,) on conductivity: what `flows` takes."""
        return self.walls if kf is self.b.ones else self.walls._replace(factor=self.b.scene.mesh.planes(kf))

    def flows(self, T, h, T_in, h_in, conductances, carry, q) -> None:
        """Complete q (cells,): heat W/m from boundary and contact on entry, rates K/s on return."""
        mesh = self.b.scene.mesh
        T, h, q = (mesh.planes(a) for a in (T, h, q))
        T_in, h_in = (a.reshape(-1, mesh.n_across).astype(T.dtype) for a in (T_in, h_in))
        run = kernels_3d.flows if conductances.factor.ndim == 1 else kernels_3d.varying_flows
        run(self.lines, conductances, carry, T, h, T_in, h_in, q)

    def linearised(
        self, gamma: float, kf, carry, stretch, slopes: Slopes, rows: Rows, bounded: Bounded | None
    ) -> LinearisedSlab:
        """As that of a Plane: factors of the mean plane, then each plane's own pivots at the interface."""
        b, mesh, n = self.b, self.b.scene.mesh, self.b.scene.mesh.n_across
        diagonal = slopes.diagonal()
        own = np.bincount(diagonal[0] // n, diagonal[1], mesh.n_plane)
        up, down = (a.reshape(-1, n).sum(axis=1) for a in (slopes.up, slopes.across()))
        # what is off leaves no trace
        kf, stretch = (a if a is not b.ones and (a != 1.0).any() else b.ones for a in (kf, stretch))
        even = np.ones(mesh.n_plane) if stretch is b.ones else mesh.planes(stretch) @ mesh.share
        mean = b.ones if kf is b.ones else mesh.planes(kf) @ mesh.share
        gx, gz = super().conductances(mean)
        factors = self._factors(gamma, Transport(gx, gz, carry, even), own, up, down)
        cells = np.concatenate([i for i, _ in rows.values()])
        weights = np.concatenate([b.counts(name) * w for name, (_, w) in rows.items()])
        inside = mesh.level[cells // n] >= mesh.n_road
        return LinearisedSlab(
            self, gamma, self.conductances(kf), carry, stretch, slopes, factors,
            self._crossing(gamma, slopes, diagonal, own, factors), bounded,
            arrives=(cells, weights),
            holds=(b.capacity * even)[mesh.block].sum() - gamma * weights[inside].sum(),
        )  # fmt: skip

    def _crossing(self, gamma: float, slopes: Slopes, diagonal, own, factors: Factors) -> Crossing:
        """Each plane's own interface; slopes come with its share of the width: its own matrix has more by that."""
        mesh, n = self.b.scene.mesh, self.b.scene.mesh.n_across
        up, down = (np.ascontiguousarray(a.reshape(-1, n) / mesh.share) for a in (slopes.up, slopes.across()))
        cell, slope = diagonal
        place = self.face[cell // n]
        at = place >= 0
        local = np.bincount(place[at] * n + cell[at] % n, slope[at], len(self.faces) * n)
        local = local.reshape(-1, n) / mesh.share
        pivot = 1.0 / (1.0 / factors.inv[self.faces][:, None] - gamma * (local - own[self.faces][:, None]))
        return Crossing(up, down, pivot[: len(pivot) // 2], pivot[len(pivot) // 2 :])


@dataclass(frozen=True)
class LinearisedSlab(LinearisedPlane):
    """`arrives` (cells, weights): heat that the ledger says comes per rise of cells, W/(m K); what a lift `holds`."""

    arrives: tuple[np.ndarray, np.ndarray]
    holds: float

    def solve(self, r, z) -> None:
        """z = P^-1 r of cells, lifted evenly in the block until it holds the heat that r brings."""
        b, mesh, lines = self.solid.b, self.solid.b.scene.mesh, self.solid.lines
        r, planes = mesh.planes(r), mesh.planes(z)
        given, kept = kernels_3d.sweep(lines, self.factors, self.crossing, self.gamma, r, planes)
        if self.stretch is not b.ones:
            kept = (lines.weight * b.capacity) @ (mesh.planes(z * self.stretch) @ mesh.share)
        cells, weights = self.arrives
        come = (weights * z[cells]).sum()  # no dot product: BLAS would wake threads, which then wait busily
        missing = given - kept + self.gamma * come
        kernels_3d.lift(lines.start, lines.m, missing / self.holds, planes)
