"""Peer program: slide-2d in plain numpy and scipy as a careful user would write it, on a mesh given as arrays.

It imports nothing of flashtemp.  Rises above 20 degC; block over road; x along, z up, the contact at z = 0.  Finite
volumes, central differences, films and contact as resistances in series with half a cell.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq
from scipy.sparse.linalg import splu

LENGTH, HEIGHT, DEPTH, AHEAD, BEHIND = 0.025, 0.007, 0.010, 0.005, 0.010  # m
BLOCK, ROAD = (0.23, 1200.0 * 1700.0), (1.2, 2400.0 * 900.0)  # W/mK, J/m3K
PRESSURE, CONDUCTANCE, FILM, FADING = 1e6, 2e5, 20.0, 1e-4  # Pa, W/m2K, W/m2K, m
IN_DEPTH = 0.5  # fraction of the heat; each face gets half of the rest
AT = (np.arange(50) + 0.5) * LENGTH / 50  # m: where profiles are compared


def graded_edges(size: float, first: float, growth: float) -> np.ndarray:
    """Edges (n + 1,) from 0 to a size, cells growing from about `first` by about `growth`."""
    n = max(1, round(np.log1p(size * (growth - 1.0) / first) / np.log(growth)))
    if abs(n * first - size) < 1e-9 * size:
        return np.linspace(0.0, size, n + 1)

    def excess(r: float) -> float:
        return first * np.expm1(n * np.log(r)) / (r - 1.0) - size

    r = brentq(excess, 1.0 + 1e-9, 50.0) if n * first < size else brentq(excess, 1e-2, 1.0 - 1e-9)
    return size * np.expm1(np.arange(n + 1) * np.log(r)) / np.expm1(n * np.log(r))


@dataclass(frozen=True)
class Mesh:
    """Edges: `x` of road columns, `ends` of them bounding the block; `up` the block; `down` the road from below."""

    x: np.ndarray
    ends: tuple[int, int]
    up: np.ndarray
    down: np.ndarray

    @property
    def cells(self) -> int:
        return (self.ends[1] - self.ends[0]) * (len(self.up) - 1) + (len(self.x) - 1) * (len(self.down) - 1)


def make_mesh(first_x: float, first_z: float, along: float, across: float) -> Mesh:
    """A mesh graded towards both edges of the block and the contact, by growths of `along` and `across`."""
    half, wide = graded_edges(0.5 * LENGTH, first_x, along), 1.3 * along
    ahead, behind = graded_edges(AHEAD, first_x, wide), LENGTH + graded_edges(BEHIND, first_x, wide)
    block = np.concatenate([half, LENGTH - half[-2::-1]])
    x = np.concatenate([-ahead[::-1], block[1:], behind[1:]])
    first = len(ahead) - 1
    down = -graded_edges(DEPTH, first_z, across)[::-1]
    return Mesh(x, (first, first + len(block) - 1), graded_edges(HEIGHT, first_z, across), down)


def halve_cells(m: Mesh) -> Mesh:
    """Every cell cut in two."""

    def cut(edges: np.ndarray) -> np.ndarray:
        return np.sort(np.concatenate([edges, 0.5 * (edges[1:] + edges[:-1])]))

    return Mesh(cut(m.x), (2 * m.ends[0], 2 * m.ends[1]), cut(m.up), cut(m.down))


class Slide2d:
    """dT/dt = (still + v moving) T + heated q, q (columns,) W/m2 being the friction heat."""

    def __init__(self, m: Mesh):
        dx, up, down = np.diff(m.x), np.diff(m.up), np.diff(m.down)
        on = dx[m.ends[0] : m.ends[1]]
        block = np.arange(len(up) * len(on)).reshape(len(up), -1)
        road = block.size + np.arange(len(down) * len(dx)).reshape(len(down), -1)
        self.x, self.n = 0.5 * (m.x[1:] + m.x[:-1])[m.ends[0] : m.ends[1]], m.cells
        self.above, self.below = block[0], road[-1, m.ends[0] : m.ends[1]]
        capacity = np.concatenate([np.outer(up, on).ravel() * BLOCK[1], np.outer(down, dx).ravel() * ROAD[1]])
        still, moving = _Entries(), _Entries()
        for cells, wide, high, k in ((block, on, up, BLOCK[0]), (road, dx, down, ROAD[0])):
            still.link(cells[:, :-1], cells[:, 1:], k * high[:, None] / (0.5 * (wide[1:] + wide[:-1])))
            still.link(cells[:-1], cells[1:], k * wide / (0.5 * (high[1:] + high[:-1]))[:, None])
        open_road = np.r_[0 : m.ends[0], m.ends[1] : len(dx)]
        for cells, half, k, area in (
            (block[:, 0], 0.5 * on[0], BLOCK[0], up), (block[:, -1], 0.5 * on[-1], BLOCK[0], up),
            (block[-1], 0.5 * up[-1], BLOCK[0], on), (road[-1, open_road], 0.5 * down[-1], ROAD[0], dx[open_road]),
        ):  # fmt: skip
            still.add(cells, cells, -area / (half / k + 1.0 / FILM))
        still.add(road[:, 0], road[:, 0], -ROAD[0] * down / (0.5 * dx[0]))  # road enters at a rise of 0
        carried, later = ROAD[1] * down[:, None], dx[1:] / (dx[1:] + dx[:-1])
        a, b = road[:, :-1], road[:, 1:]
        for from_, share in ((a, later), (b, 1.0 - later)):
            moving.add(a, from_, -carried * share)
            moving.add(b, from_, carried * share)
        moving.add(road[:, -1], road[:, -1], -carried[:, 0])
        self.r = 0.5 * up[0] / BLOCK[0], 0.5 * down[-1] / ROAD[0], 1.0 / CONDUCTANCE
        still.link(self.above, self.below, on / sum(self.r))
        heated, columns = _Entries(), np.arange(len(on))
        fall = np.exp(-m.up / FADING)
        heated.add(block, columns + 0 * block, IN_DEPTH * np.outer(fall[:-1] - fall[1:], on))
        face = 0.5 * (1.0 - IN_DEPTH)
        to_block = face * (self.r[2] + 2.0 * self.r[1]) / sum(self.r)
        heated.add(self.above, columns, on * to_block)
        heated.add(self.below, columns, on * (2.0 * face - to_block))
        shape, C = (self.n, self.n), sp.diags(1.0 / capacity)
        self.still, self.moving = (C @ e.matrix(shape) for e in (still, moving))
        self.heated = (C @ heated.matrix((self.n, len(on)))).tocsc()
        whole = sum(self.r)
        self.own, self.other = 1.0 - self.r[0] / whole, self.r[0] / whole
        self.by_heat = self.r[0] * to_block

    def surface(self, T: np.ndarray, q) -> np.ndarray:
        """Rise (columns,) of the block's surface."""
        return self.own * T[self.above] + self.other * T[self.below] + self.by_heat * q

    def compared_rise(self, T: np.ndarray, q) -> np.ndarray:
        """Rise of the block's surface at the places of comparison."""
        return PchipInterpolator(self.x, self.surface(T, q), extrapolate=True)(AT)


class _Entries:
    """Entries of a sparse matrix in any order."""

    def __init__(self):
        self.parts = []

    def add(self, rows, columns, weights) -> None:
        """Arrays of one shape, weights broadcast to it."""
        self.parts.append((np.ravel(rows), np.ravel(columns), np.broadcast_to(weights, np.shape(rows)).ravel()))

    def link(self, a, b, g) -> None:
        """Heat passes between cells a and b at conductances g."""
        for i, j, weight in ((a, a, -g), (b, b, -g), (a, b, g), (b, a, g)):
            self.add(i, j, weight)

    def matrix(self, shape):
        """The matrix with repeated entries summed."""
        rows, columns, weights = (np.concatenate(part) for part in zip(*self.parts, strict=True))
        return sp.coo_matrix((weights, (rows, columns)), shape).tocsr()


# --- constant speed and friction -------------------------------------------------------------------------
STEPS = ((0.1, 4), (0.5, 8), (1.0, 4), (2.0, 4), (5.0, 6), (10.0, 5), (20.0, 4), (35.0, 6))  # (until s, steps), by hand
DAMPED = 2  # first steps, each as two of implicit Euler by the same factors (Rannacher 1984)


def crank_nicolson(m: Mesh, speed: float = 0.1) -> np.ndarray:
    """Rise at `AT` after 35 s, by steps chosen by hand and one factorisation for each of their lengths."""
    s, T, t = Slide2d(m), np.zeros(m.cells), 0.0
    A, q = (s.still + speed * s.moving).tocsc(), np.full(len(s.x), PRESSURE * speed)
    g, one = s.heated @ q, sp.identity(m.cells, format="csc")
    for until, count in STEPS:
        dt = (until - t) / count
        solve = splu((one - 0.5 * dt * A).tocsc(), permc_spec="MMD_AT_PLUS_A").solve
        for k in range(count):
            if t == 0.0 and k < DAMPED:
                T = solve(solve(T + 0.5 * dt * g) + 0.5 * dt * g)
            else:
                T = solve(T + dt * (0.5 * (A @ T) + g))
        t = until
    return s.compared_rise(T, q)


# --- speed that changes, friction that falls with temperature ---------------------------------------------
def solve_changing(m: Mesh, table, softening: float, end: float, rtol: float) -> np.ndarray:
    """Rise at `AT` at the end: mu = exp(-softening T_surface), speed between the (s, m/s) of a table; solve_ivp BDF."""
    s, (at, speeds) = Slide2d(m), np.array(table).T
    still, moving = s.still.tocsc(), s.moving.tocsc()

    def heat(t: float, T: np.ndarray):
        """q and its derivatives by both first cells; the surface temperature depends on q itself."""
        cold, pv = s.surface(T, 0.0), PRESSURE * np.interp(t, at, speeds)
        surface = cold.copy()
        for _ in range(4):
            mu = np.exp(-softening * surface)
            surface -= (surface - cold - s.by_heat * pv * mu) / (1.0 + s.by_heat * pv * softening * mu)
        mu = np.exp(-softening * surface)
        slope = -softening * pv * mu / (1.0 + s.by_heat * pv * softening * mu)
        return pv * mu, slope * s.own, slope * s.other

    def rate(t: float, T: np.ndarray) -> np.ndarray:
        return still @ T + np.interp(t, at, speeds) * (moving @ T) + s.heated @ heat(t, T)[0]

    rows, columns = np.tile(np.arange(len(s.x)), 2), np.concatenate([s.above, s.below])

    def jacobian(t: float, T: np.ndarray):
        slopes = sp.coo_matrix((np.concatenate(heat(t, T)[1:]), (rows, columns)), (len(s.x), s.n))
        return (still + np.interp(t, at, speeds) * moving + s.heated @ slopes.tocsc()).tocsc()

    found = solve_ivp(rate, (0.0, end), np.zeros(s.n), method="BDF", jac=jacobian, rtol=rtol, atol=10.0 * rtol)
    T = found.y[:, -1]
    return s.compared_rise(T, heat(end, T)[0])
