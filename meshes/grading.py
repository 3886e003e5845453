"""Graded cell edges: cells grow geometrically away from places where the temperature changes fast."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np

LEAST = 3  # smallest number of cells of a layer, enough for a parabola


def _root(of: Callable[[float], float], low: float, high: float) -> float:
    from scipy.optimize import brentq

    return float(brentq(of, low, high))


@lru_cache(1024)  # scenes that differ only in a law have the same mesh
def _rate(first: float, cells: int) -> float:
    """The rate a of the map expm1(a s)/expm1(a) whose first of `cells` cells is the fraction `first` of the length."""
    return _root(lambda a: np.expm1(a / cells) / np.expm1(a) - first, 1e-9, 300.0)


def geometric(length: float, first: float, cells: int, refine: float = 1, even: float = 0.0) -> np.ndarray:
    """Edges (n+1,) of a geometric series on [0, length] in m whose first cell is about `first`.

    `even` additional cells are spread evenly over the length, so no cell is larger than length/even.  `refine` puts
    `refine` times as many cells on the same smooth map, so that observed orders of accuracy are clean.  A `first` above
    length/cells gives uniform cells.

    >>> geometric(1.0, 0.25, 4).tolist()
    [0.0, 0.25, 0.5, 0.75, 1.0]
    >>> bool(np.isclose(geometric(1.0, 0.1, 4)[1], 0.1))
    True
    >>> e = np.diff(geometric(1.0, 0.001, 12, even=8))
    >>> len(e), bool(e[0] < 0.001), bool(e[-1] < 1 / 8), bool(np.all(np.diff(e) > 0))
    (20, True, True, True)
    """
    fine = max(1, round((cells + even) * refine))
    s = np.linspace(0.0, 1.0, fine + 1)
    if cells == 1 or first * cells >= length * (1 - 1e-9):
        return s * length
    rate = _rate(first / length, cells)
    edges = length * np.expm1(rate * s) / np.expm1(rate)
    if even:
        edges = length * _shared(s, cells, rate, even)
    edges[-1] = length
    return edges


def _shared(s: np.ndarray, cells: int, rate: float, even: float) -> np.ndarray:
    """Positions (fractions of the length) below which the fraction `s` of all cells lies, graded and even together."""
    z, grow = np.zeros_like(s), np.expm1(rate)
    for _ in range(100):  # Newton's method from the left of a concave function cannot overshoot
        below = cells * np.log1p(grow * z) / rate + even * z
        step = (s * (cells + even) - below) / (cells * grow / rate / (1.0 + grow * z) + even)
        z = z + step
        if np.max(np.abs(step)) < 1e-15:
            break
    return z


def layered(
    layers: Sequence[tuple[float, int | None]], first: float, cells: int, refine: float = 1, even: float = 0.0
) -> tuple[np.ndarray, tuple[int, ...]]:
    """Edges (n+1,) m up a stack of `layers` with an edge at every joint, and the first cells of the upper layers.

    The map is that of `geometric` over the whole stack.  Each layer (thickness in m, cells) divides its part of the map
    into that many even steps; if cells is None, into as many as the map puts there, and at least `LEAST`.

    >>> edges, joints = layered([(0.25, None), (0.75, 6)], 1.0, 16)
    >>> edges[:5].tolist(), joints, len(edges)
    ([0.0, 0.0625, 0.125, 0.1875, 0.25], (4,), 11)
    """
    ends = np.concatenate([[0.0], np.cumsum([thick for thick, _ in layers])])
    length, grown = ends[-1], cells > 1 and first * cells < ends[-1] * (1 - 1e-9)
    rate = _rate(first / length, cells) if grown else 0.0

    def below(z: np.ndarray) -> np.ndarray:
        return (cells * np.log1p(np.expm1(rate) * z) / rate + even * z) / (cells + even) if grown else z

    out, joints = [np.zeros(1)], [0]
    for (_, n_stated), low, high in zip(layers, ends[:-1], ends[1:], strict=True):
        s = below(np.array([low, high]) / length)
        usual = max(LEAST, round((cells + even) * float(s[1] - s[0])))
        n = max(LEAST, round((n_stated or usual) * refine))
        inner = np.linspace(*s, n + 1)[1:]
        z = length * (_shared(inner, cells, rate, even) if grown else inner)
        z[-1] = high
        out.append(z)
        joints.append(joints[-1] + n)
    return np.concatenate(out), tuple(joints[1:-1])


def two_sided(length: float, first: float, last: float, cells: int, refine: float = 1) -> np.ndarray:
    """Edges on [0, length] in m with cells of about `first` and `last` at the ends, coarsest where two series meet.

    >>> e = two_sided(1.0, 0.05, 0.1, 12)
    >>> bool(e[1] < 0.06), bool(abs(e[-1] - e[-2] - 0.1) < 0.02), len(e)
    (True, True, 13)
    """
    # a leading end that is much finer than the trailing end needs more of the cells
    lead = max(1, round(cells * (0.62 if first < 0.2 * last else 0.5)))
    trail = max(1, cells - lead)

    split = _meeting(length, first, last, lead, trail)
    a = geometric(split, first, lead, refine)
    b = geometric(length - split, last, trail, refine)
    return np.concatenate([a, (length - b[::-1])[1:]])


@lru_cache(1024)
def _meeting(length: float, first: float, last: float, lead: int, trail: int) -> float:
    """Position (m) at which the two series have the same cell size, so that the map is smooth there."""

    def jump(split: float) -> float:
        a = geometric(split, first, lead)
        b = geometric(length - split, last, trail)
        return (a[-1] - a[-2]) - (b[-1] - b[-2])

    low, high = 0.05 * length, 0.95 * length
    return _root(jump, low, high) if jump(low) * jump(high) < 0 else 0.5 * length
