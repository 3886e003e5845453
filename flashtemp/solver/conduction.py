"""Conduction and advection in block and road, and the depth-line preconditioner (theory.md, section 8)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from flashtemp.errors import SolverFailure
from flashtemp.solver import kernels_2d, kernels_3d
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.kernel_arrays import (
    DepthLines,
    InterfaceCoupling,
    LateralConductances,
    LineFactors,
    TransportCoefficients,
)
from flashtemp.solver.road_frame import RoadOverlap

LedgerRows = dict[str, tuple[np.ndarray, np.ndarray]]  # entry of the ledger: cells and slopes, W/(m K)


@dataclass(frozen=True)
class HeatSlopes:
    """Derivatives of boundary and contact heat with respect to temperature, W/(m K).

    `own` are those of cells `cell` by their own temperature.  At the interface (columns,) `lane` is d(road heat)/d(lane
    T), `up` d(road heat)/d(block T) and `down` d(block heat)/d(lane T).  `deposits` are the derivatives (columns,) of
    the heat in depth by the temperatures of block and lane, None without such heat.
    """

    cell: np.ndarray
    own: np.ndarray
    lane: np.ndarray
    up: np.ndarray
    down: np.ndarray
    deposits: tuple[np.ndarray, np.ndarray] | None
    touched_road: RoadOverlap

    def diagonal_entries(self) -> tuple[np.ndarray, np.ndarray]:
        """Cells and diagonal entries for P, in which lanes keep their width.

        Entries that `crossing_slopes` cannot place, because their road lies on no line under the block, are added here.
        """
        parts = self.touched_road.heat_parts(self.lane)
        if self.touched_road.other is not None:
            slope, down, shift = parts[1][1], self.touched_road.heat_parts(self.down)[1][1], self.touched_road.shift
            ends = slice(None, -shift) if shift < 0 else slice(-shift, None)
            slope[ends] += down[ends]
        return np.concatenate([self.cell, *(i for i, _ in parts)]), np.concatenate([self.own, *(w for _, w in parts)])

    def crossing_slopes(self) -> np.ndarray:
        """Entries (columns,) of P across the interface: d(block heat)/d(road T), summed for the road on each line."""
        if self.touched_road.other is None:
            return self.down
        (_, down), (_, neighbour) = self.touched_road.heat_parts(self.down)
        shift = self.touched_road.shift
        if shift < 0:
            down[:shift] += neighbour[-shift:]
        else:
            down[shift:] += neighbour[:-shift]
        return down


@dataclass(frozen=True)
class LimitedFaces:
    """Faces (n, 4) of the road on which the advected value is limited by the `floor`, at enthalpy rises h and h_in."""

    b: HeatBalance
    faces: np.ndarray
    advection: np.ndarray
    floor: float
    h: np.ndarray
    h_in: np.ndarray

    def add_rate(self, out) -> None:
        """Add the change of the rates (cells,) K/s by the limiter to `out`."""
        b, mesh = self.b, self.b.scene.mesh
        kernels_2d.limit_faces(
            self.faces, mesh.line, mesh.n_across, b.upwind_weight, self.advection, b.capacity, self.floor, self.h,
            self.h_in.astype(self.h.dtype, copy=False), out,
        )  # fmt: skip

    def add_product(self, v, out) -> None:
        """Add the change of a Jacobian product by changes v (cells,) K at these faces to `out`."""
        b, mesh = self.b, self.b.scene.mesh
        at_cell = np.real(self.h[self.faces[:, 0]]) < self.floor
        kernels_2d.limit_products(
            self.faces, mesh.line, mesh.n_across, b.upwind_weight, self.advection, b.capacity, at_cell, v, out
        )  # fmt: skip


def build_solid(balance: HeatBalance) -> SolidPlane | SolidSlab:
    """The solids of a balance: a `SolidPlane` in 2D, a `SolidSlab` in 3D."""
    mesh = balance.scene.mesh
    lines = DepthLines(
        start=mesh.start,
        m=mesh.n_road,
        first=mesh.first,
        capacity=balance.capacity,
        upwind_weight=balance.upwind_weight,
        g_in=balance.g_in,
        weight=np.where(mesh.level < mesh.n_road, balance.share, 1.0),
        share=mesh.share,
    )
    return SolidPlane(balance, lines) if mesh.n_across == 1 else SolidSlab.from_balance(balance, lines)


@dataclass(frozen=True)
class SolidPlane:
    """Block and road in one plane (x, z)."""

    b: HeatBalance
    lines: DepthLines

    def conductivity_factor(self, T, now) -> np.ndarray:
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
        """Conductances W/(m K) for factors kf (cells,) on conductivity, in the form that `heat_to_rates` takes."""
        b = self.b
        if kf is b.ones:
            return b.gx, b.gz
        gx, gz = np.empty_like(kf), np.empty_like(kf)
        kernels_2d.face_conductances(self.lines.start, self.lines.m, b.half_x, b.half_z, b.gap, kf, gx, gz)
        return gx, gz

    def heat_to_rates(self, T, h, T_in, h_in, conductances, advection, q) -> None:
        """Complete q (cells,): heat W/m from boundary and contact on entry, rates K/s on return."""
        b, lines, (gx, gz) = self.b, self.lines, conductances
        kernels_2d.add_heat_flows(
            lines.start, lines.m, gx, gz, advection, b.upwind_weight, T, h, T_in.astype(T.dtype, copy=False),
            h_in.astype(T.dtype, copy=False), b.g_in, q,
        )  # fmt: skip
        q /= b.capacity

    def limit_undershoots(self, h, h_in, advection, floor: float) -> LimitedFaces | None:
        """Faces on which the advected value falls below the `floor` (enthalpy rise in K), None if there are none.

        The second-order upwind scheme extrapolates to faces, and undershoots before a front.  On such a face the value
        is limited to the floor, or to the cell upstream if that is colder.  This is the positivity-preserving limiter
        of Zhang and Shu (2010, J. Comput. Phys. 229, 3091); it conserves heat, and keeps the order where it does not
        act.
        """
        if floor == -np.inf or not advection.any():
            return None
        faces = kernels_2d.find_undershoots(self.lines.start, self.lines.m, self.b.upwind_weight, floor, h, h_in)
        return LimitedFaces(self.b, faces, advection, floor, h, h_in) if len(faces) else None

    def linearise(
        self,
        gamma: float,
        kf,
        advection,
        capacity_ratio,
        slopes: HeatSlopes,
        rows: LedgerRows,
        limited_faces: LimitedFaces | None,
    ) -> LinearisedPlane:
        """Linearise and factorise P, which approximates I - gamma J.

        `kf` (cells,) are factors on conductivity, `capacity_ratio` dh/dT (cells,), `advection` rho c v dz (n_road,);
        `rows` are the derivatives of the ledger.  P puts heat released in depth into the cells at the face and keeps
        the width of lanes, so it stays tridiagonal along lines.
        """
        gx, gz = self.conductances(kf)
        own = np.zeros(self.b.n)
        np.add.at(own, *slopes.diagonal_entries())
        up, down = slopes.up, slopes.crossing_slopes()
        factors = self._factorise_lines(gamma, TransportCoefficients(gx, gz, advection, capacity_ratio), own, up, down)
        pivots = (factors.inv[cells] for cells in (self.b.cell_road, self.b.cell_block))
        crossing = InterfaceCoupling(up, down, *pivots)
        return LinearisedPlane(
            self, gamma, (gx, gz), advection, capacity_ratio, slopes, factors, crossing, limited_faces
        )

    def _factorise_lines(self, gamma, transport: TransportCoefficients, own, up, down) -> LineFactors:
        # one array for all factors: malloc reuses its memory, while small ones would fault their pages in every time
        factors = LineFactors(*np.empty((len(LineFactors._fields), len(own))))
        kernels_2d.factorise_lines(self.lines, transport, gamma, own, up, down, factors)
        return factors


@dataclass(frozen=True)
class LinearisedPlane:
    """The cells of block and road linearised around a state: Jacobian products and solves with P."""

    solid: SolidPlane | SolidSlab
    gamma: float
    conductances: tuple
    advection: np.ndarray
    capacity_ratio: np.ndarray
    slopes: HeatSlopes
    factors: LineFactors
    coupling: InterfaceCoupling
    limited_faces: LimitedFaces | None

    def apply_jacobian(self, T, lane, out) -> None:
        """out = J v (cells,) in K/s for changes T (cells,) of the cells and `lane` (columns,) of the lanes.

        The entering road does not change.
        """
        b, slopes = self.solid.b, self.slopes
        out[:] = 0.0
        along, up = slopes.lane, slopes.up
        if slopes.touched_road.other is not None:
            slopes.touched_road.add_heat(up * T[b.cell_block] + along * lane, out)
            along, up = 0.0 * along, 0.0 * up
        kernels_2d.add_slopes(slopes.cell, slopes.own, b.cell_road, b.cell_block, along, up, slopes.down, T, lane, out)
        if slopes.deposits is not None:
            power = slopes.deposits[0] * T[b.cell_block] + slopes.deposits[1] * lane
            out[b.cell_block] -= power
            kernels_2d.deposit_heat(b.deep_cells, b.deposit_weights, power, out)
        h = T if b.heat_capacity is None else T * self.capacity_ratio
        self.solid.heat_to_rates(T, h, b.no_inflow, b.no_inflow, self.conductances, self.advection, out)
        if self.limited_faces is not None:
            self.limited_faces.add_product(h, out)

    def solve(self, r, z) -> None:
        """z = P^-1 r of cells; the columns of P sum to those of the exact matrix, so heat is conserved."""
        start, m, first, capacity, *_ = self.solid.lines
        up, down, *_ = self.coupling
        kernels_2d.sweep_lines(start, m, first, capacity, self.gamma, up, down, *self.factors, r, z)


@dataclass(frozen=True)
class SolidSlab(SolidPlane):
    """Block and road in 3D: planes (x, z) next to each other.

    The preconditioner uses the factors of the mean plane for all of them; only the interface has its own per plane.
    """

    lateral_conductances: LateralConductances
    interface_cells: np.ndarray  # cells of a plane at the interface: the road's, then the block's
    interface_number: np.ndarray  # (n_plane,) index of a cell in `interface_cells`, -1 for all others

    @classmethod
    def from_balance(cls, b: HeatBalance, lines: DepthLines) -> SolidSlab:
        """The slab of a 3D balance."""
        mesh = b.scene.mesh
        dy = np.diff(mesh.y)
        apart = 0.5 * (dy[1:] + dy[:-1])
        before, after = np.zeros(len(dy)), np.zeros(len(dy))
        before[1:], after[:-1] = 1.0 / (apart * dy[1:]), 1.0 / (apart * dy[:-1])
        faces = np.concatenate([mesh.road[mesh.first : mesh.last, -1], mesh.block[:, 0]])
        face = np.full(mesh.n_plane, -1)
        face[faces] = np.arange(len(faces))
        gy, even = b.conductivity * mesh.volume, np.ones(1)
        return cls(
            b,
            lines,
            LateralConductances(b.gx, b.gz, gy, b.half_x, b.half_z, b.gap, even, dy, before, after),
            faces,
            face,
        )

    def conductances(self, kf):
        """Conductances for factors kf (cells,) on conductivity, in the form that `heat_to_rates` takes."""
        return (
            self.lateral_conductances
            if kf is self.b.ones
            else self.lateral_conductances._replace(factor=self.b.scene.mesh.planes(kf))
        )

    def heat_to_rates(self, T, h, T_in, h_in, conductances, advection, q) -> None:
        """Complete q (cells,): heat W/m from boundary and contact on entry, rates K/s on return."""
        mesh = self.b.scene.mesh
        T, h, q = (mesh.planes(a) for a in (T, h, q))
        T_in, h_in = (a.reshape(-1, mesh.n_across).astype(T.dtype) for a in (T_in, h_in))
        run = kernels_3d.uniform_rates if conductances.factor.ndim == 1 else kernels_3d.varying_rates
        run(self.lines, conductances, advection, T, h, T_in, h_in, q)

    def linearise(
        self,
        gamma: float,
        kf,
        advection,
        capacity_ratio,
        slopes: HeatSlopes,
        rows: LedgerRows,
        limited_faces: LimitedFaces | None,
    ) -> LinearisedSlab:
        """As in `SolidPlane`: factors of the mean plane, then the pivots of each plane at the interface."""
        b, mesh, n = self.b, self.b.scene.mesh, self.b.scene.mesh.n_across
        diagonal = slopes.diagonal_entries()
        own = np.bincount(diagonal[0] // n, diagonal[1], mesh.n_plane)
        up, down = (a.reshape(-1, n).sum(axis=1) for a in (slopes.up, slopes.crossing_slopes()))
        # factors of exactly 1 take the constant branch, so an effect that is off changes no bit
        kf, capacity_ratio = (a if a is not b.ones and (a != 1.0).any() else b.ones for a in (kf, capacity_ratio))
        even = np.ones(mesh.n_plane) if capacity_ratio is b.ones else mesh.planes(capacity_ratio) @ mesh.share
        mean = b.ones if kf is b.ones else mesh.planes(kf) @ mesh.share
        gx, gz = super().conductances(mean)
        factors = self._factorise_lines(gamma, TransportCoefficients(gx, gz, advection, even), own, up, down)
        cells = np.concatenate([i for i, _ in rows.values()])
        weights = np.concatenate([b.ledger_weight(name) * w for name, (_, w) in rows.items()])
        inside = mesh.level[cells // n] >= mesh.n_road
        return LinearisedSlab(
            self, gamma, self.conductances(kf), advection, capacity_ratio, slopes, factors,
            self._interface_coupling(gamma, slopes, diagonal, own, factors), limited_faces,
            ledger_weights=(cells, weights),
            lift_capacity=(b.capacity * even)[mesh.block].sum() - gamma * weights[inside].sum(),
        )  # fmt: skip

    def _interface_coupling(
        self, gamma: float, slopes: HeatSlopes, diagonal, own, factors: LineFactors
    ) -> InterfaceCoupling:
        """The interface in P for each plane.

        Derivatives are heat per plane, so division by the plane's fraction of the width gives those per metre of width.
        """
        mesh, n = self.b.scene.mesh, self.b.scene.mesh.n_across
        up, down = (np.ascontiguousarray(a.reshape(-1, n) / mesh.share) for a in (slopes.up, slopes.crossing_slopes()))
        cell, slope = diagonal
        place = self.interface_number[cell // n]
        at = place >= 0
        local = np.bincount(place[at] * n + cell[at] % n, slope[at], len(self.interface_cells) * n)
        local = local.reshape(-1, n) / mesh.share
        pivot = 1.0 / (
            1.0 / factors.inv[self.interface_cells][:, None] - gamma * (local - own[self.interface_cells][:, None])
        )
        return InterfaceCoupling(up, down, pivot[: len(pivot) // 2], pivot[len(pivot) // 2 :])


@dataclass(frozen=True)
class LinearisedSlab(LinearisedPlane):
    """A linearised slab.

    `ledger_weights` (cells, weights) are the derivatives W/(m K) of all heat in the ledger by the cells, and
    `lift_capacity` is the heat that a uniform rise of the block by 1 K takes.
    """

    ledger_weights: tuple[np.ndarray, np.ndarray]
    lift_capacity: float

    def solve(self, r, z) -> None:
        """z = P^-1 r of cells, with a uniform rise added to the block so that heat is conserved.

        The sweeps leave out conduction across y and use the mean plane, so in 3D the columns of P alone do not conserve
        heat.
        """
        b, mesh, lines = self.solid.b, self.solid.b.scene.mesh, self.solid.lines
        r, planes = mesh.planes(r), mesh.planes(z)
        heat_in, heat_out = kernels_3d.sweep_lines(lines, self.factors, self.coupling, self.gamma, r, planes)
        if self.capacity_ratio is not b.ones:
            heat_out = (lines.weight * b.capacity) @ (mesh.planes(z * self.capacity_ratio) @ mesh.share)
        cells, weights = self.ledger_weights
        ledger_heat = (weights * z[cells]).sum()  # no dot product: BLAS would start threads that then wait busily
        missing = heat_in - heat_out + self.gamma * ledger_heat
        kernels_3d.lift_block(lines.start, lines.m, missing / self.lift_capacity, planes)
