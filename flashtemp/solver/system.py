"""The balance during one phase of the schedule: rate, linearisation and preconditioner."""

from __future__ import annotations

import numpy as np

from flashtemp.errors import SolverFailure
from flashtemp.solver import kernels_2d
from flashtemp.solver.balance import Balance
from flashtemp.solver.conduction import solid
from flashtemp.solver.coupling import Coupling
from flashtemp.solver.interface import Footprint, Meeting


class Stage:
    """The balance during one phase of the schedule: rate, linearisation and preconditioner."""

    def __init__(self, balance: Balance, phase, inflow=None):
        self.b, self.phase, self.inflow = balance, phase, inflow
        self.calls = {"rate": 0, "times": 0, "setup": 0, "solve": 0}
        mesh = balance.scene.mesh
        self.footprint, self.solid = Footprint(balance), solid(balance)
        self.carry_unit = balance.scene.road.volumetric_capacity * balance.dz_road
        self.no_inflow = np.zeros(mesh.n_road * mesh.n_across)

    # --- what acts now -----------------------------------------------------------------------
    def moment(self, t: float):
        """The moment with the ambient temperature of the time."""
        now = self.b.scene.moment(self.phase, t)
        laws = self.b.laws
        if laws.has("ambient.temperature"):
            now = now._replace(ambient=laws("ambient.temperature", now.ambient, None, now))
        return now

    def entering(self, now) -> np.ndarray:
        """Temperature rise (n_road n_across,) of the road that enters now, deepest cells first."""
        drift = now.ambient - self.b.scene.ambient
        if self.inflow is None:
            return self.no_inflow + drift
        carried = self.inflow(now)
        return self.b.laws("road.inflow", drift + 0.0 * carried, None, now._replace(carried=carried))

    def meet(self, now, y) -> Meeting:
        """Block and road at a state y: pressure, contact laws and, unless the block is lifted, fluxes."""
        T = self.b.rise(y[: self.b.n])
        return self.footprint.meet(now, self.b.worn_depth(y), T, self.entering(now), self.solid.conduction(T, now))

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
        kf = self.solid.conduction(T, now)
        carry = self.carry_unit * now.speed
        T_in = self.entering(now)
        h_in = T_in if b.capacity_gradient is None else T_in * (1 + 0.5 * b.capacity_gradient[: len(T_in)] * T_in)
        led = dict.fromkeys(b.ledger, 0.0)
        meeting = self.footprint.meet(now, b.worn_depth(y), T, T_in, kf)
        state, flux = meeting.state, meeting.flux
        if flux is not None:
            area = mesh.column_area
            road = flux.into_road * area
            q[b.cell_block] += state.block * flux.into_block * area
            q[b.cell_road] += state.road * road
            if len(b.weight):
                kernels_2d.deposit(b.deep_cells, b.weight, state.block * flux.deep * area, q)
            led["friction"] = (state.block * flux.heat * area).sum()
            led["into_road"] = (state.block * road).sum()
            led["lane_in"] = (state.road * road).sum()
            if b.abrades:
                out[b.worn] = self.footprint.abrasion_rate(meeting, now) / b.worn_unit
        b.sites.exchange(self.footprint.at(state, now), T, kf, q, led)
        self.solid.flows(T, h, T_in, h_in, kf, carry, q)
        led["lane_out"] = self._leaving(T, h, T_in, h_in, carry)
        for name, i in b.entry.items():
            out[i] = led[name]
        if not np.isfinite(out.sum()):
            raise SolverFailure("the heat balance is no longer finite")

    def _leaving(self, T, h, T_in, h_in, carry):
        """Heat (W/m) that the road carries out of the window, less what it brings in."""
        b, mesh = self.b, self.b.scene.mesh
        before, last = (mesh.planes(h)[cells] for cells in mesh.road[-2:])
        first = mesh.planes(T)[mesh.road[0]]
        T_in, h_in = (a.reshape(-1, mesh.n_across) for a in (T_in, h_in))
        leave = carry[:, None] * (last + b.slope[-1] * (last - before) - h_in) - b.g_in[:, None] * (T_in - first)
        return (leave @ mesh.share).sum()

    # --- preconditioner ------------------------------------------------------------------------
    def setup(self, t: float, y: np.ndarray, gamma: float) -> None:
        """Linearise at (t, y) and factorise P = I - gamma J by depth lines."""
        self.calls["setup"] += 1
        b = self.b
        now = self.moment(t)
        T = b.rise(y[: b.n])
        kf = self.solid.conduction(T, now)
        self.gamma, self.carry = gamma, self.carry_unit * now.speed
        self.stretch = b.ones if b.capacity_gradient is None else 1.0 + b.capacity_gradient * T
        self._linearise(now, y, T, kf)

    def _linearise(self, now, y, T, kf) -> None:
        b, mesh = self.b, self.b.scene.mesh
        own: list = []
        rows: dict[str, list] = {name: [] for name in b.ledger}
        T_in = self.entering(now)
        meeting = self.footprint.meet(now, b.worn_depth(y), T, T_in, kf, slopes=True)
        state, d = meeting.state, meeting.slopes
        b.sites.slopes(self.footprint.at(state, now), T, kf, own, rows)
        self.coupling = deposits = None
        up = down = np.zeros(len(b.cell_block))
        if d is not None:
            face, lane = state.block * mesh.column_area, state.road * mesh.column_area
            if len(b.weight) and np.any(d.deep):
                deposits = face * d.deep[0], face * d.deep[1]
            own += [(b.cell_block, face * (d.block[0] + d.deep[0])), (b.cell_road, lane * d.road[1])]
            up, down = lane * d.road[0], face * (d.block[1] + d.deep[1])
            for name, w, slopes in (("friction", face, d.heat), ("into_road", face, d.road), ("lane_in", lane, d.road)):
                rows[name] += [(b.cell_block, w * slopes[0]), (b.cell_road, w * slopes[1])]
            if b.abrades:
                self.coupling = Coupling(self.footprint, meeting, now, T, T_in, kf, self.gamma)
        before, last, first = (mesh.everywhere(mesh.road[i]) for i in (-2, -1, 0))
        leave, back = (np.outer(self.carry, mesh.share) * self.stretch[cells] for cells in (last, before))
        rows["lane_out"] += [
            (last.ravel(), (leave * (1 + b.slope[-1])).ravel()),
            (before.ravel(), (-back * b.slope[-1]).ravel()),
            (first.ravel(), np.outer(b.g_in, mesh.share).ravel()),
        ]
        self.rows = {
            name: (np.concatenate([i for i, _ in parts]), np.concatenate([w for _, w in parts]))
            for name, parts in rows.items()
            if parts
        }
        self.solid.linearise(self.gamma, kf, self.carry, self.stretch, own, up, down, deposits, self.rows)

    def times(self, v: np.ndarray, out: np.ndarray) -> None:
        """out = J v with the balance linearised at the last set-up; conserves heat like the rate.

        Left out: slopes of k(T), and the way from temperature over friction to the tilt of a holder that turns.
        """
        self.calls["times"] += 1
        b, n = self.b, self.b.n
        h = v[:n]
        T = h if b.capacity_gradient is None else h / self.stretch
        out[n:] = 0.0
        self.solid.product(T, out[:n])
        for name, (index, weight) in self.rows.items():
            out[b.entry[name]] = weight @ T[index]
        if self.coupling is not None:
            w = self.coupling
            out[b.worn] = w.heated(T[b.cell_block], T[b.cell_road])
            w.add(w.pressure(v[b.worn]), out)

    def solve(self, r: np.ndarray, z: np.ndarray) -> None:
        """z = P^-1 r; the ledger follows the cells exactly, so that Krylov steps conserve heat."""
        self.calls["solve"] += 1
        b, n = self.b, self.b.n
        T, w = z[:n], self.coupling
        if w is not None:  # abrasion first: it moves the pressure, and that the heat
            r = r.copy()
            w.add(w.pressure(w.undo(r[b.worn])), r, self.gamma)
        z[n:] = r[n:]
        self.solid.solve(r[:n], T)
        for name, (index, weight) in self.rows.items():
            z[b.entry[name]] += self.gamma * (weight @ T[index])
        if w is not None:
            z[b.worn] += self.gamma * w.heated(T[b.cell_block], T[b.cell_road])
        if b.capacity_gradient is not None:
            T *= self.stretch
