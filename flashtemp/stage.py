"""The balance during one phase of the schedule: rate, linearisation and preconditioner."""

from __future__ import annotations

import numpy as np

from flashtemp import kernels
from flashtemp.balance import Balance
from flashtemp.coupling import Coupling
from flashtemp.errors import SolverFailure
from flashtemp.footprint import Footprint, Meeting


class Stage:
    """The balance during one phase of the schedule: rate, linearisation and preconditioner."""

    def __init__(self, balance: Balance, phase, inflow=None):
        self.b, self.phase, self.inflow = balance, phase, inflow
        self.calls = {"rate": 0, "times": 0, "setup": 0, "solve": 0}
        mesh, n = balance.scene.mesh, balance.n
        lines = mesh.n_lines
        self.footprint = Footprint(balance)
        self.own = np.zeros(n)
        self.up, self.down = np.zeros(lines), np.zeros(lines)
        self.factors = tuple(np.empty(n) for _ in range(5))
        self.carry_unit = balance.scene.road.volumetric_capacity * balance.dz_road
        self.no_inflow = np.zeros(mesh.n_road)

    # --- what acts now -----------------------------------------------------------------------
    def moment(self, t: float):
        """The moment with the ambient temperature of the time."""
        now = self.b.scene.moment(self.phase, t)
        laws = self.b.laws
        if laws.has("ambient.temperature"):
            now = now._replace(ambient=laws("ambient.temperature", now.ambient, None, now))
        return now

    def entering(self, now) -> np.ndarray:
        """Temperature rise (n_road,) of the road that enters now, deepest cell first."""
        drift = now.ambient - self.b.scene.ambient
        if self.inflow is None:
            return self.no_inflow + drift
        carried = self.inflow(now)
        return self.b.laws("road.inflow", drift + 0.0 * carried, None, now._replace(carried=carried))

    def meet(self, now, y) -> Meeting:
        """Block and road at a state y: pressure, contact laws and, unless the block is lifted, fluxes."""
        T = self.b.rise(y[: self.b.n])
        return self.footprint.meet(now, self.b.worn_depth(y), T, self.entering(now), self.conduction(T, now)[2])

    # --- rate --------------------------------------------------------------------------------
    def rate(self, t: float, y: np.ndarray, out: np.ndarray) -> None:
        """dy/dt of cells (K/s), worn depth (units per s) and ledger (W/m) at time t (s)."""
        self.calls["rate"] += 1
        b, mesh, n = self.b, self.b.scene.mesh, self.b.n
        now = self.moment(t)
        h = y[:n]
        T = b.rise(h)
        q = out[:n]
        out[:] = 0.0
        gx, gz, kf = self.conduction(T, now)
        carry = self.carry_unit * now.speed
        T_in = self.entering(now)
        h_in = T_in if b.capacity_gradient is None else T_in * (1 + 0.5 * b.capacity_gradient[: mesh.n_road] * T_in)
        kernels.heat_flows(
            mesh.start, mesh.n_road, gx, gz, carry, b.slope, T, h, T_in.astype(y.dtype), h_in.astype(y.dtype), b.g_in, q
        )
        led = dict.fromkeys(b.ledger, 0.0)
        meeting = self.footprint.meet(now, b.worn_depth(y), T, T_in, kf)
        state, flux = meeting.state, meeting.flux
        if flux is not None:
            dx = mesh.dx_block
            block = state.phi * flux.into_block * dx
            road = flux.into_road * dx
            q[b.cell_block] += block
            q[b.cell_road] += road
            power = state.phi * flux.heat * dx
            if len(b.weight):
                kernels.deposit(b.deep_cells, b.weight, power, q)
            led["friction"] = power.sum()
            led["into_road"] = (state.phi * road).sum()
            led["lane_in"] = road.sum()
            if b.abrades:
                out[b.worn] = self.footprint.abrasion_rate(meeting, now) / b.worn_unit
        b.sites.exchange(self.footprint.at(state, now), T, kf, q, led)
        a, z = mesh.start[0], mesh.start[-2]
        m = mesh.n_road
        leave = carry * (h[z : z + m] + b.slope[-1] * (h[z : z + m] - h[mesh.start[-3] : mesh.start[-3] + m]))
        led["lane_out"] = (leave - carry * h_in - b.g_in * (T_in - T[a : a + m])).sum()
        q /= b.capacity
        for name, i in b.entry.items():
            out[i] = led[name]
        if not np.isfinite(out.sum()):
            raise SolverFailure("the heat balance is no longer finite")

    def conduction(self, T, now):
        """Face conductances and the factor on conductivity at the temperatures T (rise)."""
        b, mesh = self.b, self.b.scene.mesh
        if not b.nonlinear_conductivity:
            return b.gx, b.gz, b.ones
        f = np.ones(b.n, dtype=T.dtype)
        for site, cells in (("block", mesh.block), ("road", mesh.road)):
            f[cells] = b.laws(f"{site}.conductivity", 1.0, T[cells] + b.scene.ambient, now)
        if np.min(f.real) <= 0:
            raise SolverFailure("thermal conductivity fell to zero or below")
        gx, gz = np.empty_like(f), np.empty_like(f)
        kernels.face_conductances(mesh.start, mesh.n_road, b.half_x, b.half_z, f, gx, gz)
        return gx, gz, f

    # --- preconditioner ------------------------------------------------------------------------
    def setup(self, t: float, y: np.ndarray, gamma: float) -> None:
        """Linearise at (t, y) and factorise P = I - gamma J by depth lines."""
        self.calls["setup"] += 1
        b, mesh = self.b, self.b.scene.mesh
        now = self.moment(t)
        T = b.rise(y[: b.n])
        self.gx, self.gz, kf = self.conduction(T, now)
        self.gamma, self.carry = gamma, self.carry_unit * now.speed
        self.stretch = b.ones if b.capacity_gradient is None else 1.0 + b.capacity_gradient * T
        self._linearise(now, y, T, kf)
        inv, mul, low, low2, high = self.factors
        kernels.factorise(
            mesh.start, mesh.n_road, b.capacity, self.gx, self.gz, self.carry, b.slope, b.g_in, gamma,
            self.own, self.up, self.down, b.share, self.stretch, inv, mul, low, low2, high,
        )  # fmt: skip

    def _linearise(self, now, y, T, kf) -> None:
        b, mesh = self.b, self.b.scene.mesh
        self.own[:] = self.up[:] = self.down[:] = 0.0
        rows: dict[str, list] = {name: [] for name in b.ledger}
        T_in = self.entering(now)
        meeting = self.footprint.meet(now, b.worn_depth(y), T, T_in, kf, slopes=True)
        state, d = meeting.state, meeting.slopes
        b.sites.slopes(self.footprint.at(state, now), T, kf, self.own, rows)
        self.coupling = None
        if d is not None:
            dx, phi = mesh.dx_block, state.phi
            deep = phi * (1.0 - state.surface) * dx
            on = slice(mesh.first, mesh.last)
            self.own[b.cell_block] += phi * dx * d.block[0] + deep * d.heat[0]
            self.own[b.cell_road] += dx * d.road[1]
            self.up[on] = dx * d.road[0]
            self.down[on] = phi * dx * d.block[1] + deep * d.heat[1]
            for name, w, slopes in (
                ("friction", phi * dx, d.heat),
                ("into_road", phi * dx, d.road),
                ("lane_in", dx, d.road),
            ):
                rows[name] += [(b.cell_block, w * slopes[0]), (b.cell_road, w * slopes[1])]
            if b.abrades:
                self.coupling = Coupling(self.footprint, meeting, now, T, T_in, kf, self.gamma)
        last = mesh.road[-2:]
        leave, before = (self.carry * self.stretch[cells] for cells in (last[1], last[0]))
        rows["lane_out"] += [
            (last[1], leave * (1 + b.slope[-1])),
            (last[0], -before * b.slope[-1]),
            (mesh.road[0], b.g_in),
        ]
        self.rows = [
            (b.entry[name], np.concatenate([i for i, _ in parts]), np.concatenate([w for _, w in parts]))
            for name, parts in rows.items()
            if parts
        ]

    def times(self, v: np.ndarray, out: np.ndarray) -> None:
        """out = J v with the balance linearised at the last set-up; conserves heat like the rate.

        Left out: slopes of k(T), and the way from temperature over friction to the tilt of a holder that turns.
        """
        self.calls["times"] += 1
        b, mesh, n = self.b, self.b.scene.mesh, self.b.n
        h = v[:n]
        T = h if b.capacity_gradient is None else h / self.stretch
        out[:] = 0.0
        q = out[:n]
        none = self.no_inflow
        kernels.heat_flows(
            mesh.start, mesh.n_road, self.gx, self.gz, self.carry, b.slope, T, h, none, none, b.g_in, q
        )  # fmt: skip
        kernels.add_slopes(mesh.start, mesh.n_road, self.own, self.up, self.down, T, q)
        q /= b.capacity
        for i, index, weight in self.rows:
            out[i] = weight @ T[index]
        if self.coupling is not None:
            w = self.coupling
            out[b.worn] = w.heated(T[b.cell_block], T[b.cell_road])
            w.add(w.pressure(v[b.worn]), out)

    def solve(self, r: np.ndarray, z: np.ndarray) -> None:
        """z = P^-1 r; the ledger follows the cells exactly, so that Krylov steps conserve heat."""
        self.calls["solve"] += 1
        b, mesh, n = self.b, self.b.scene.mesh, self.b.n
        inv, mul, low, low2, high = self.factors
        T, w = z[:n], self.coupling
        if w is not None:  # abrasion first: it moves the pressure, and that the heat
            r = r.copy()
            w.add(w.pressure(w.undo(r[b.worn])), r, self.gamma)
        z[n:] = r[n:]
        kernels.sweep(
            mesh.start, mesh.n_road, b.capacity, self.gamma, self.up, self.down,
            inv, mul, low, low2, high, r[:n], T,
        )  # fmt: skip
        for i, index, weight in self.rows:
            z[i] += self.gamma * (weight @ T[index])
        if w is not None:
            z[b.worn] += self.gamma * w.heated(T[b.cell_block], T[b.cell_road])
        if b.capacity_gradient is not None:
            T *= self.stretch
