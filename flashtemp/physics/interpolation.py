"""Measured or computed curves from a case: pairs in the case itself or a CSV file beside it."""

from __future__ import annotations

import csv
import math
import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.errors import BadInput
from flashtemp.physics import bounded_reading
from flashtemp.physics.arrays import Array, Value

Source = Any  # of a case: a CSV file's name, or rows
COMMA = re.compile(r"[-+]?\d+,\d+\s*[^.,\d]*")  # a number as people write it whose language has decimal commas


def between(values: Array, at: Array, wanted: Array) -> Array:
    """Linear interpolation along the first axis of values (n, ...) kept `at` (n,), outermost values held.

    >>> between(np.array([[0.0], [2.0]]), np.array([1.0, 2.0]), np.array([0.0, 1.5])).ravel().tolist()
    [0.0, 1.0]
    """
    k = np.clip(np.searchsorted(at, wanted, side="right") - 1, 0, max(0, len(at) - 2))
    following = np.minimum(k + 1, len(at) - 1)
    step = at[following] - at[k]
    weight = np.clip((wanted - at[k]) / np.where(step > 0, step, 1.0), 0.0, 1.0)
    weight = weight.reshape(-1, *[1] * (values.ndim - 1))
    out: Array = (1.0 - weight) * values[k] + weight * values[following]
    return out


@dataclass(frozen=True)
class Curve:
    """A broken line y(x), held constant outside its range; complex x passes its derivative on.

    >>> Curve((0.0, 1.0), (0.0, 2.0))(0.25)
    0.5
    """

    x: tuple[float, ...]
    y: tuple[float, ...]

    @cached_property
    def _arrays(self) -> tuple[Array, Array, Array]:
        x, y = np.asarray(self.x), np.asarray(self.y)
        return x, y, np.diff(y) / np.diff(x)

    def __call__(self, at: Value) -> Value:
        x, y, slope = self._arrays
        real = np.real(at)
        k = np.clip(np.searchsorted(x, real) - 1, 0, len(slope) - 1)
        inside = (real >= x[0]) & (real <= x[-1])
        held = np.clip(real, x[0], x[-1])
        step = np.where(inside, at, held)
        value = y[k] + slope[k] * (step - x[k])
        return value if np.ndim(at) else value.item()


@dataclass(frozen=True)
class Surface:
    """A table z(u, v), linear between its nodes, held outside; complex v passes its derivative on.

    >>> s = Surface((0.1, 1.0), (20.0, 60.0), ((0.8, 0.6), (0.9, 0.7)))
    >>> round(float(s(0.1, 40.0)), 12)
    0.7
    """

    u: tuple[float, ...]
    v: tuple[float, ...]
    z: tuple[tuple[float, ...], ...]

    @cached_property
    def _grid(self) -> Array:
        return np.asarray(self.z)

    def __call__(self, u: float, v: Value) -> Value:
        z = self._grid
        if len(self.u) == 1:
            row = z[0]
        else:
            k = int(np.clip(np.searchsorted(self.u, u) - 1, 0, len(self.u) - 2))
            w = min(max((u - self.u[k]) / (self.u[k + 1] - self.u[k]), 0.0), 1.0)
            row = (1 - w) * z[k] + w * z[k + 1]
        if len(self.v) == 1:
            return row[0] + 0.0 * v
        return Curve(self.v, tuple(row))(v)


def rows(source: Source, folder: Path, key: str, columns: int) -> Array:
    """Rows (n, columns) of numbers from a list of lists or a CSV file name.

    Raises BadInput naming the key, the file and its line.
    """
    if isinstance(source, (list, tuple)):
        data = [list(r) if isinstance(r, (list, tuple)) else [r] for r in source]
        where = [f"{key}: row {i + 1}" for i in range(len(data))]
    else:
        data, where = _read(source, folder, key)
    if not data:
        name = f" {source}:" if isinstance(source, str) else ""
        raise BadInput(f"{key}:{name} no rows of numbers; give {columns} numbers per row, separated by commas")
    for place, row in zip(where, data, strict=True):
        if len(row) != columns:
            raise BadInput(f"{place}: {row!r} has {len(row)} values; give {columns} numbers per row")
        for v in row:
            if isinstance(v, bool) or not isinstance(v, (int, float)) or not math.isfinite(v):
                raise BadInput(f"{place}: {v!r} is not a finite number; remove or repair the row")
    return np.array(data, dtype=float)


def _read(source: Source, folder: Path, key: str) -> tuple[list[list[float]], list[str]]:
    if not isinstance(source, str):
        raise BadInput(f"{key}: {source!r}; give a CSV file name or a list of rows")
    path = folder / source
    if not path.is_file():
        if COMMA.fullmatch(source):
            raise BadInput(f"{key}: '{source}'; write the number with a point: {source.replace(',', '.')}")
        raise BadInput(f"{key}: file '{source}' not found in {folder}; give a CSV file there or a list of rows")
    text = bounded_reading.raw(path, f"{key}: {source}")
    try:
        lines = bounded_reading.lines(text.decode("utf-8-sig"), f"{key}: {source}")
        table = list(csv.reader(lines))
    except (UnicodeDecodeError, csv.Error) as fault:
        raise BadInput(f"{key}: {source}: not a text file of numbers; give a CSV file") from fault
    return _numbers(table, f"{key}: {source}")


def _numbers(table: list[list[str]], name: str) -> tuple[list[list[float]], list[str]]:
    """Rows of numbers and where they stand; one row of words may stand above them, and comments anywhere."""
    data, where, header = [], [], False
    for number, line in enumerate(table, 1):
        cells = [c.strip() for c in line]
        if not any(cells) or cells[0].startswith("#"):
            continue
        row = [bounded_reading.number(c) for c in cells]
        known = [v for v in row if v is not None]
        if len(known) == len(cells):
            data.append(known)
            where.append(f"{name}:{number}")
        elif not data and not header and not known and not any(map(bounded_reading.mistyped, cells)):
            header = True
        else:
            raise BadInput(
                f"{name}:{number}: {bounded_reading.told(cells)} is not numeric; give numbers separated by commas, with"
                " at most one row of names above them"
            )
    return data, where


def pairs(
    source: Source, folder: Path, key: str, low: float = -math.inf, high: float = math.inf
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Two columns with the first strictly increasing and the second from low to high."""
    table = rows(source, folder, key, 2)
    step = np.diff(table[:, 0])
    if np.any(step <= 0):
        k = int(np.argmax(step <= 0))
        raise BadInput(
            f"{key}: first column goes from {table[k, 0]:g} to {table[k + 1, 0]:g}; it must increase strictly"
        )
    outside = (table[:, 1] < low) | (table[:, 1] > high)
    if np.any(outside):
        bad, upper = table[np.argmax(outside), 1], f" and <= {high:g}" if high < math.inf else ""
        raise BadInput(f"{key}: value {bad:g} in the table; give values >= {low:g}{upper}")
    return tuple(table[:, 0].tolist()), tuple(table[:, 1].tolist())


def grid(source: Source, folder: Path, key: str) -> Surface:
    """A Surface from rows (u, v, z) that fill a complete grid."""
    table = rows(source, folder, key, 3)
    u, v = np.unique(table[:, 0]), np.unique(table[:, 1])
    places, count = np.unique(table[:, :2], axis=0, return_counts=True)
    if np.any(count > 1):
        twice = ", ".join(f"{value:g}" for value in places[np.argmax(count > 1)])
        raise BadInput(f"{key}: the pair {twice} stands there twice; give one row for every pair")
    if len(u) * len(v) != len(table):
        raise BadInput(f"{key}: {len(table)} rows do not fill {len(u)} x {len(v)} nodes; give one row for every pair")
    order = np.lexsort((table[:, 1], table[:, 0]))
    z = table[order, 2].reshape(len(u), len(v))
    return Surface(tuple(u.tolist()), tuple(v.tolist()), tuple(map(tuple, z.tolist())))
