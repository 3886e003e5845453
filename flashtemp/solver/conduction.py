"""Conduction and advection in block and road, and the depth-line preconditioner: one plane, or many across."""

from __future__ import annotations

import numpy as np

from flashtemp.errors import SolverFailure
from flashtemp.solver import kernels_2d, kernels_3d
from flashtemp.solver.balance import Balance


def solid(balance: Balance):
    """The solids of a balance: a Plane in 2D, a Slab in 3D."""
    return Plane(balance) if balance.scene.mesh.n_across == 1 else Slab(balance)


class _Solid:
    """What both have: the linearised laws of boundary and contact."""

    def __init__(self, balance: Balance):
        self.b, self.mesh = balance, balance.scene.mesh

    def conduction(self, T, now) -> np.ndarray:
        """Factor on conductivity (cells,) at the temperature rises T."""
        b, mesh = self.b, self.mesh
        if not b.nonlinear_conductivity:
            return b.ones
        f = np.ones(b.n, dtype=T.dtype)
        for site, cells in (("block", mesh.block), ("road", mesh.road)):
            warm = mesh.planes(T)[cells] + b.scene.ambient
            mesh.planes(f)[cells] = b.laws(f"{site}.conductivity", 1.0, warm, now)
        if np.min(f.real) <= 0:
            raise SolverFailure("thermal conductivity fell to zero or below")
        return f

    def linearise(self, gamma: float, kf, carry, stretch, own, up, down, deposits, rows) -> None:
        """Factors of P ~ I - gamma J around conductivities `kf` (cells,) and dh/dT `stretch`.

        `carry` (n_road,) rho c v dz; `own` [(cells, slopes)] heat per rise on the diagonal, `up`, `down`
        (columns,) across the interface: d(road heat)/d(block T) and d(block heat)/d(road T).  `deposits`: slopes
        (columns,) of the heat in depth with both temperatures; in P it is in the cells at the face.
        `rows` {entry of the ledger: (cells, slopes)} in W/(m K).
        """
        self.gamma, self.kf, self.carry, self.stretch = gamma, kf, carry, stretch
        self.cell = np.concatenate([np.empty(0, dtype=np.int64), *(np.ravel(cells) for cells, _ in own)])
        self.slope = np.concatenate([np.empty(0), *(np.ravel(slope) for _, slope in own)])
        self.up, self.down, self.deposits = up, down, deposits
        self._factorise(rows)

    def product(self, T, out) -> None:
        """out = J v of cells whose temperatures change by T (cells,), in K/s; nothing enters with the road."""
        b = self.b
        out[:] = 0.0
        kernels_2d.add_slopes(self.cell, self.slope, b.cell_road, b.cell_block, self.up, self.down, T, out)
        if self.deposits is not None:
            power = self.deposits[0] * T[b.cell_block] + self.deposits[1] * T[b.cell_road]
            out[b.cell_block] -= power
            kernels_2d.deposit(b.deep_cells, b.weight, power, out)
        h = T if b.capacity_gradient is None else T * self.stretch
        self.flows(T, h, self.none, self.none, self.kf, self.carry, out)


class Plane(_Solid):
    """One plane (x, z)."""

    def __init__(self, balance: Balance):
        super().__init__(balance)
        self.factors = tuple(np.empty(self.b.n) for _ in range(5))
        self.none = np.zeros(self.mesh.n_road)
        self._for = None

    def _conductances(self, kf):
        b, mesh = self.b, self.mesh
        if kf is b.ones:
            return b.gx, b.gz
        gx, gz = np.empty_like(kf), np.empty_like(kf)
        kernels_2d.face_conductances(mesh.start, mesh.n_road, b.half_x, b.half_z, kf, gx, gz)
        return gx, gz

    def flows(self, T, h, T_in, h_in, kf, carry, q) -> None:
        """Complete q (cells,): heat W/m from boundary and contact on entry, rates K/s on return."""
        b, mesh = self.b, self.mesh
        gx, gz = self._at if kf is self._for else self._conductances(kf)
        kernels_2d.heat_flows(
            mesh.start, mesh.n_road, gx, gz, carry, b.slope, T, h, T_in.astype(T.dtype), h_in.astype(T.dtype), b.g_in, q
        )
        q /= b.capacity

    def _factorise(self, rows) -> None:
        b, mesh = self.b, self.mesh
        self._for, self._at = self.kf, self._conductances(self.kf)
        own = np.zeros(b.n)
        np.add.at(own, self.cell, self.slope)
        up, down = np.zeros(mesh.n_lines), np.zeros(mesh.n_lines)
        up[mesh.first : mesh.last], down[mesh.first : mesh.last] = self.up, self.down
        self.across = up, down
        kernels_2d.factorise(
            mesh.start, mesh.n_road, b.capacity, *self._at, self.carry, b.slope, b.g_in, self.gamma,
            own, up, down, b.share, self.stretch, *self.factors,
        )  # fmt: skip

    def solve(self, r, z) -> None:
        """z = P^-1 r of cells; the columns of P conserve heat by themselves."""
        b, mesh = self.b, self.mesh
        kernels_2d.sweep(mesh.start, mesh.n_road, b.capacity, self.gamma, *self.across, *self.factors, r, z)


class Slab(_Solid):
    """Many planes (x, z) side by side, which share the factors of their mean; only the interface has its own."""

    def __init__(self, balance: Balance):
        super().__init__(balance)
        b, mesh = self.b, self.mesh
        dy = np.diff(mesh.y)
        apart = 0.5 * (dy[1:] + dy[:-1])
        self.dy, self.before, self.after = dy, np.zeros(len(dy)), np.zeros(len(dy))
        self.before[1:], self.after[:-1] = 1.0 / (apart * dy[1:]), 1.0 / (apart * dy[:-1])
        self.gy = b.conductivity * mesh.volume
        self.none = np.zeros(mesh.n_road * mesh.n_across)
        self.factors = tuple(np.empty(mesh.n_plane) for _ in range(5))
        self.weight = np.where(mesh.level < mesh.n_road, b.share, 1.0)
        self.faces = np.concatenate([mesh.road[mesh.first : mesh.last, -1], mesh.block[:, 0]])
        self.face = np.full(mesh.n_plane, -1)  # number of a plane's cell among the faces, if it is one
        self.face[self.faces] = np.arange(len(self.faces))

    def flows(self, T, h, T_in, h_in, kf, carry, q) -> None:
        """Complete q (cells,): heat W/m from boundary and contact on entry, rates K/s on return."""
        b, mesh = self.b, self.mesh
        T, h, q = (mesh.planes(a) for a in (T, h, q))
        T_in, h_in = (a.reshape(-1, mesh.n_across).astype(T.dtype) for a in (T_in, h_in))
        if kf is b.ones:
            kernels_3d.flows(
                mesh.start, mesh.n_road, b.gx, b.gz, self.gy, carry, b.slope, self.before, self.after,
                T, h, T_in, h_in, b.g_in, mesh.share, b.capacity, q,
            )  # fmt: skip
        else:
            kernels_3d.varying_flows(
                mesh.start, mesh.n_road, b.half_x, b.half_z, self.gy, mesh.planes(kf), carry, b.slope, self.dy,
                T, h, T_in, h_in, b.g_in, mesh.share, b.capacity, q,
            )  # fmt: skip

    def _factorise(self, rows) -> None:
        """Factors of the mean plane; then each plane's own pivots at the interface."""
        b, mesh, n = self.b, self.mesh, self.mesh.n_across
        share, gamma = mesh.share, self.gamma
        own = np.bincount(self.cell // n, self.slope, mesh.n_plane)
        up, down = np.zeros(mesh.n_lines), np.zeros(mesh.n_lines)
        on = slice(mesh.first, mesh.last)
        up[on], down[on] = (a.reshape(-1, n).sum(axis=1) for a in (self.up, self.down))
        if not (self.stretch != 1.0).any():  # what is off leaves no trace
            self.stretch = b.ones
        if not (self.kf != 1.0).any():
            self.kf = b.ones
        if self.kf is b.ones:
            gx, gz = b.gx, b.gz
        else:
            gx, gz = np.empty(mesh.n_plane), np.empty(mesh.n_plane)
            kernels_2d.face_conductances(
                mesh.start, mesh.n_road, b.half_x, b.half_z, mesh.planes(self.kf) @ share, gx, gz
            )
        stretch = np.ones(mesh.n_plane) if self.stretch is b.ones else mesh.planes(self.stretch) @ share
        kernels_2d.factorise(
            mesh.start, mesh.n_road, b.capacity, gx, gz, self.carry, b.slope, b.g_in, gamma,
            own, up, down, b.share, stretch, *self.factors,
        )  # fmt: skip
        self._net(rows, stretch)
        # slopes come with each plane's share of the width: what a plane's own matrix has is more by that
        self.crossing = tuple(np.ascontiguousarray(a.reshape(-1, n) / share) for a in (self.up, self.down))
        place = self.face[self.cell // n]
        at = place >= 0
        local = np.bincount(place[at] * n + self.cell[at] % n, self.slope[at], len(self.faces) * n)
        local = local.reshape(-1, n) / share
        pivot = 1.0 / (1.0 / self.factors[0][self.faces][:, None] - gamma * (local - own[self.faces][:, None]))
        self.pivots = pivot[: len(pivot) // 2], pivot[len(pivot) // 2 :]

    def _net(self, rows, stretch) -> None:
        """`net` (cells, weights): heat that the ledger says comes per rise of cells, W/(m K); what a lift `holds`."""
        b, mesh = self.b, self.mesh
        self.net = cells, weights = (
            np.concatenate([i for i, _ in rows.values()]),
            np.concatenate([b.counts(name) * w for name, (_, w) in rows.items()]),
        )
        inside = mesh.level[cells // mesh.n_across] >= mesh.n_road
        self.holds = (b.capacity * stretch)[mesh.block].sum() - self.gamma * weights[inside].sum()

    def solve(self, r, z) -> None:
        """z = P^-1 r of cells, lifted evenly in the block until it holds the heat that r brings."""
        b, mesh = self.b, self.mesh
        given, kept = kernels_3d.sweep(
            mesh.start, mesh.n_road, mesh.first, b.capacity, self.weight, mesh.share, self.gamma, *self.crossing,
            *self.pivots, *self.factors, mesh.planes(r), mesh.planes(z),
        )  # fmt: skip
        if self.stretch is not b.ones:
            kept = (self.weight * b.capacity) @ (mesh.planes(z * self.stretch) @ mesh.share)
        cells, weights = self.net
        missing = given - kept + self.gamma * (weights @ z[cells])
        kernels_3d.lift(mesh.start, mesh.n_road, missing / self.holds, mesh.planes(z))
