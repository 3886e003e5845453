"""A block on lanes of a road, each with its own history: no ratio of lanes to columns, no mesh of the road.

Lanes are told apart by the contact fraction from which they touch: a lane of a class touches wherever the fraction is
as large, and remembers what it received there.  One class begins or ends at every column, so that classes lose nothing
of the fraction.  The road is a half-space by Duhamel's theorem, whose heat spreads sideways by eq. (15b), Bessel
functions; the block is finite volumes of its own, even along and graded up, by Euler's implicit steps.
All classes that touch have the heat p v mu/phi, and each is as hot as the rubber in its spots.  Rises in K, else SI.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_banded
from scipy.special import i0e, i1e


@dataclass(frozen=True)
class SlidingPair:
    """Block and road: sizes, conductivities `k`, heat capacities `rc` of a volume, the spots' `diameter`, `columns` along
    the block, `cells` up it."""

    length: float = 0.025
    height: float = 0.007
    k: float = 0.25
    rc: float = 1200.0 * 1700.0
    road_k: float = 1.0
    road_rc: float = 2300.0 * 950.0
    diameter: float = 3e-3
    columns: int = 60
    cells: int = 60

    @property
    def x(self) -> np.ndarray:
        return (np.arange(self.columns) + 0.5) * self.length / self.columns

    @property
    def dz(self) -> np.ndarray:
        """Heights of cells (cells,), 3 um at the face."""
        grow = np.linspace(1.0, 1.2, 2001)
        total = 3e-6 * np.array([np.sum(g ** np.arange(self.cells)) for g in grow])
        g = np.interp(self.height, total, grow)
        out = g ** np.arange(self.cells)
        return out * self.height / out.sum()


@dataclass(frozen=True)
class LaneClasses:
    """Lanes by the fraction from which they touch: `width` (classes,), and where each `touches` (classes, columns)."""

    width: np.ndarray
    touches: np.ndarray

    @classmethod
    def from_fractions(cls, fraction: np.ndarray) -> LaneClasses:
        """Classes that end at every fraction (columns,) that there is."""
        levels = np.unique(fraction)
        return cls(np.diff(levels, prepend=0.0), fraction[None] >= levels[:, None])


def retained_fraction(s: SlidingPair, age: np.ndarray, floor: float) -> np.ndarray:
    """Share of heat that a disc received an `age` ago which is still under it, never less than `floor`."""
    X = (s.diameter / 2) ** 2 / (2.0 * s.road_k / s.road_rc * age)
    return np.maximum(1.0 - i0e(X) - i1e(X), floor)


def simulate_sliding(
    s: SlidingPair, speed: float, distance: float, pressure, fraction, mu=1.0, widening=True, flash=True
):
    """Rises (columns,) of the block's face and in the spots after a slide under `pressure` (columns,) Pa.

    The flash is eqs. (12) and (13) after more than a diameter.
    """
    n, dt = s.columns, s.length / s.columns / speed
    fraction = np.broadcast_to(fraction, n).astype(float)
    lanes = LaneClasses.from_fractions(fraction)
    share = lanes.touches * lanes.width[:, None] / fraction  # of what touches in a column
    floor = fraction.mean()
    edge = (np.arange(n + 1) - 0.5) * dt
    edge[0] = 0.0
    memory = np.diff(np.sqrt(edge)) * 2.0 / np.sqrt(np.pi * s.road_k * s.road_rc)
    if widening:
        memory = memory * retained_fraction(s, (np.sqrt(edge[1:]) + np.sqrt(edge[:-1])) ** 2 / 4.0, floor)
    i, c = np.indices((n, n))
    weight = np.where(c < i, memory[np.abs(i - c)], 0.0)
    theta = 0.688545781 * np.sqrt(s.diameter / speed) / np.sqrt(s.k * s.rc) if flash else 0.0
    spot = (1.0 - fraction) * theta
    heat = mu * np.asarray(pressure) * speed / fraction
    block = ImplicitBlock(s, dt)
    received = np.zeros((n, *lanes.touches.shape))  # by stretch of road, class and the column under which it was
    for step in range(round(distance / speed / dt)):
        rows = (step - np.arange(n)) % n
        received[rows[0]] = 0.0
        past = (received[rows] @ weight[:, :, None])[:, :, 0].T
        known, answer = block.advance_unheated()
        mean = (share * past).sum(axis=0)
        beside = spot + memory[0]
        into = (memory[0] * heat + mean - known) / (beside + answer * fraction)  # mean of all that touch
        face = known + answer * fraction * into
        each = (memory[0] * heat + past - face) / beside
        received[rows, :, np.arange(n)] = np.where(lanes.touches, heat - each, 0.0).T
        block.add_flux(fraction * into)
    return face, face + spot * into


class ImplicitBlock:
    """Rises (cells, columns) of a block by implicit steps up and explicit ones along, its outer sides insulated."""

    def __init__(self, s: SlidingPair, dt: float):
        self.s, self.dt, self.T = s, dt, np.zeros((s.cells, s.columns))
        self.dz = dz = s.dz
        g = s.k * dt / (0.5 * (dz[1:] + dz[:-1])) / s.rc
        self.banded = np.zeros((3, s.cells))
        self.banded[1] = 1.0
        self.banded[1, 1:] += g / dz[1:]
        self.banded[1, :-1] += g / dz[:-1]
        self.banded[0, 1:] = -g / dz[:-1]
        self.banded[2, :-1] = -g / dz[1:]
        unit = np.zeros(s.cells)
        unit[0] = dt / (s.rc * dz[0])
        self.unit = solve_banded((1, 1), self.banded, unit)

    def advance_unheated(self) -> tuple[np.ndarray, float]:
        """The face (columns,) after the next step without heat, and the answer of the face to a flux of 1."""
        s = self.s
        dx = s.length / s.columns
        flow = np.diff(self.T, axis=1, prepend=self.T[:, :1], append=self.T[:, -1:])
        along = s.k / s.rc * self.dt / dx**2 * np.diff(flow, axis=1)
        self.T = solve_banded((1, 1), self.banded, self.T + along)
        half = self.dz[0] / (2.0 * s.k)
        return self.T[0], self.unit[0] + half

    def add_flux(self, flux: np.ndarray) -> None:
        """Add what a flux (columns,) W/m2 brought in the step."""
        self.T = self.T + self.unit[:, None] * flux
