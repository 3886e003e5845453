"""Friction falling with temperature and speed changing: flashtemp against scipy solve_ivp BDF.

The peer is what a careful user would write: the slide-2d geometry in scipy.sparse, the analytic
sparse Jacobian handed to solve_ivp.  Both are judged against flashtemp on a finer mesh and a
tighter tolerance, at equal error.
"""

from __future__ import annotations

import argparse
import statistics
import time
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from common import profile_error, table, timed
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator

from flashtemp.model.case import load
from flashtemp.model.numerics import available
from flashtemp.solver.balance import Balance

CASE = Path(__file__).parent.parent / "cases" / "slide2d"
SPEED = [[0.0, 0.1], [10.0, 0.2], [20.0, 0.05], [35.0, 0.1]]
CHANGE = {
    "effects": ["holder_sink", "friction_softening"], "schedule.speed": SPEED,
    "output.profiles": 8, "output.fields": 2, "schedule.distance": 3.9,
}  # fmt: skip


class Triplets:
    """A sparse matrix (n, n) as it grows: entries (row, column, weight)."""

    def __init__(self, n: int):
        self.n = n
        self.rows: list[np.ndarray] = []
        self.columns: list[np.ndarray] = []
        self.weights: list[np.ndarray] = []

    def add(self, rows, columns, weights) -> None:
        """Entries of equal length."""
        for kept, new in ((self.rows, rows), (self.columns, columns), (self.weights, weights)):
            kept.append(new)

    def link(self, i, j, g) -> None:
        """Exchange between cells i and j with conductances g."""
        for a, c, w in ((i, i, -g), (j, j, -g), (i, j, g), (j, i, g)):
            self.add(a, c, w)

    def matrix(self):
        """Its sum, by rows."""
        entries = np.concatenate(self.weights), (np.concatenate(self.rows), np.concatenate(self.columns))
        return sp.coo_matrix(entries, shape=(self.n, self.n)).tocsr()


def conduction(b: Balance, across):
    """Conduction, films and the contact with conductances `across` (columns,): what does not change with speed."""
    mesh, out = b.scene.mesh, Triplets(b.n)
    c = np.arange(b.n)
    up, inside = c[b.gz > 0], c[b.gx > 0]
    out.link(up, up + 1, b.gz[up])
    out.link(inside, mesh.start[mesh.line[inside] - 1] + mesh.level[inside], b.gx[inside])
    sites = b.boundary
    for k, site in enumerate(sites.names):
        if site not in ("block.face", "road.under"):
            at = slice(sites.offset[k], sites.offset[k + 1])
            out.add(sites.cell[at], sites.cell[at], -sites.area[at] / (sites.half[at] + 1 / 20.0))
    out.link(b.cell_block, b.cell_road, across)
    out.add(mesh.road[0], mesh.road[0], -b.g_in)
    return out.matrix()


def advection(b: Balance):
    """The road's advection at 1 m/s, by the same second-order upwind stencil."""
    mesh, out = b.scene.mesh, Triplets(b.n)
    m, F = mesh.n_road, b.carry_unit
    for i in range(mesh.n_lines):
        here = mesh.start[i] + np.arange(m)
        targets = [(here, -1.0)] + ([(mesh.start[i + 1] + np.arange(m), 1.0)] if i + 1 < mesh.n_lines else [])
        for to, sign in targets:
            out.add(to, here, sign * F * (1 + b.slope[i]))
            if i:
                out.add(to, mesh.start[i - 1] + np.arange(m), -sign * F * b.slope[i])
    return out.matrix()


def sources(b: Balance, toward_block, toward_road):
    """Heat of every cell (n, columns) per unit q = mu p v: half in depth, half shared by the two faces."""
    mesh = b.scene.mesh
    S = sp.lil_matrix((b.n, len(b.cell_block)))
    deep = np.zeros(mesh.n_block)
    deep[: len(b.weight)] = b.weight
    for j, dx in enumerate(mesh.dx_block):
        S[mesh.block[j], j] = deep * dx
        S[b.cell_block[j], j] += 0.25 * dx * toward_block[j]
        S[b.cell_road[j], j] += 0.25 * dx * toward_road[j]
    return S.tocsc()


def peer(case, rtol: float):
    """Assemble A0 + v A1 and march with solve_ivp; returns cells, x, final rise of T_R (x,)."""
    scene = case.scene
    b, mesh = Balance(scene), scene.mesh
    r, s, n = b.cell_block, b.cell_road, b.n
    Rr, Rs, Ra = b.half_block, b.half_road, 1 / 2e5
    Rt = Rr + Rs + Ra
    C = sp.diags(1 / b.capacity)
    A0, A1 = (C @ conduction(b, mesh.dx_block / Rt)).tocsc(), (C @ advection(b)).tocsc()
    S = (C @ sources(b, (Ra + 2 * Rs) / Rt, (Ra + 2 * Rr) / Rt)).tocsc()
    t_speed, v_speed = np.array(SPEED).T
    bsoft = case["friction_softening.b"]

    def surface(y, q):
        flux = ((y[s] - y[r]) + 0.25 * q * (Ra + 2 * Rs)) / Rt
        return y[r] + flux * Rr, 1 - Rr / Rt, Rr / Rt, 0.25 * (Ra + 2 * Rs) / Rt * Rr

    def heat(t, y):
        """q per line and its slopes in both first cells, by a few Newton steps on the surface."""
        pv = 1e6 * np.interp(t, t_speed, v_speed)
        T = y[r].copy()
        for _ in range(4):
            mu = np.exp(-bsoft * T)
            surf, a0, a1, aq = surface(y, pv * mu)
            T = T - (T - surf) / (1 + aq * pv * bsoft * mu)
        mu = np.exp(-bsoft * T)
        gain = -bsoft * pv * mu / (1 + aq * pv * bsoft * mu)
        return pv * mu, gain * a0, gain * a1

    def rhs(t, y):
        return A0 @ y + np.interp(t, t_speed, v_speed) * (A1 @ y) + S @ heat(t, y)[0]

    rows = np.arange(len(r))

    def jac(t, y):
        _, d0, d1 = heat(t, y)
        D = sp.coo_matrix((np.concatenate([d0, d1]), (np.r_[rows, rows], np.r_[r, s])), shape=(len(r), n))
        return (A0 + np.interp(t, t_speed, v_speed) * A1 + S @ D.tocsc()).tocsc()

    end = scene.schedule.end
    out = solve_ivp(rhs, (0.0, end), np.zeros(n), method="BDF", jac=jac, rtol=rtol, atol=10 * rtol)
    y = out.y[:, -1]
    return n, mesh.x_block, surface(y, heat(end, y)[0])[0]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeat", type=int, default=3)
    options = parser.parse_args()
    fine = load(CASE, CHANGE | {"numerics.mesh": 2.0, "numerics.rtol": 1e-6})
    _, best = timed(fine, 1)
    rise = best.T_block[best.last] - best.ambient_degC
    keep = slice(4, -4)
    rows = []
    for binding in available():
        for rtol in (1e-2, 1e-3):
            case = load(CASE, CHANGE | {"numerics.integrator": binding, "numerics.rtol": rtol})
            seconds, run = timed(case, options.repeat)
            error = profile_error(run, best.x[keep], rise[keep])
            rows.append((f"flashtemp, {binding}, rtol {rtol:g}", run.mesh.n_cells, error, seconds))
    case = load(CASE, CHANGE)
    for rtol in (1e-2, 1e-3, 1e-4):
        spent = []
        for _ in range(options.repeat):
            began = time.process_time()
            n, x, T = peer(case, rtol)
            spent.append(time.process_time() - began)
        error = 100 * np.abs(PchipInterpolator(x, T)(best.x[keep]) - rise[keep]).max() / rise.max()
        rows.append((f"scipy solve_ivp BDF, rtol {rtol:g}", n, float(error), statistics.median(spent)))
    table(rows)


if __name__ == "__main__":
    main()
