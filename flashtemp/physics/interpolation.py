"""Measured or computed curves and surfaces: read from rows in a case or from a CSV file, interpolated linearly."""

from __future__ import annotations

import logging
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.errors import BadInput, renamed_names
from flashtemp.physics.arrays import Array, Value
from flashtemp.physics.tables.column_matching import RequiredColumn, note_assumed_units, read_required_columns
from flashtemp.physics.tables.table import read_table
from flashtemp.physics.tables.text_table import TextTable

Source = Any  # value in a case: the name of a CSV file, or rows
TABLE_LOGGER = "flashtemp.tables"  # logger that receives notes on tables
DECIMAL_COMMA_NUMBER = re.compile(r"[-+]?\d+,\d+\s*[^.,\d]*")  # a number with a decimal comma, perhaps with a unit


def interpolate_linear(values: Array, nodes: Array, wanted: Array) -> Array:
    """Interpolate values (n, ...) at `nodes` (n,) linearly along their first axis, constant beyond the outer nodes.

    >>> interpolate_linear(np.array([[0.0], [2.0]]), np.array([1.0, 2.0]), np.array([0.0, 1.5])).ravel().tolist()
    [0.0, 1.0]
    """
    k = np.clip(np.searchsorted(nodes, wanted, side="right") - 1, 0, max(0, len(nodes) - 2))
    following = np.minimum(k + 1, len(nodes) - 1)
    step = nodes[following] - nodes[k]
    weight = np.clip((wanted - nodes[k]) / np.where(step > 0, step, 1.0), 0.0, 1.0)
    weight = weight.reshape(-1, *[1] * (values.ndim - 1))
    out: Array = (1.0 - weight) * values[k] + weight * values[following]
    return out


@dataclass(frozen=True)
class Curve:
    """Piecewise linear y(x), constant outside its range.  Complex x is supported for complex-step derivatives.

    >>> Curve((0.0, 1.0), (0.0, 2.0))(0.25)
    0.5
    """

    x: tuple[float, ...]
    y: tuple[float, ...]

    @cached_property
    def _node_arrays(self) -> tuple[Array, Array]:
        return np.asarray(self.x), np.asarray(self.y)

    def __call__(self, at: Value) -> Value:
        return _interpolate_nodes(*self._node_arrays, at)


def _interpolate_nodes(x: Array, y: Array, at: Value) -> Value:
    """Piecewise linear y(`at`), constant outside `x`, where also a complex step vanishes."""
    if not np.iscomplexobj(at):
        value = np.interp(at, x, y)
        return value if np.ndim(at) else float(value)
    k = np.clip(np.searchsorted(x, at.real) - 1, 0, len(x) - 2)
    inside = (at.real >= x[0]) & (at.real <= x[-1])
    step = np.where(inside, at, np.clip(at.real, x[0], x[-1]))
    out = y[k] + (y[k + 1] - y[k]) / (x[k + 1] - x[k]) * (step - x[k])
    return out if np.ndim(at) else out.item()


def line_through_means(edges: Array, means: Array) -> tuple[Array, Array]:
    """Nodes and values (2n+1,) of a piecewise linear function whose mean between `edges` (n+1,) is `means` (n,).

    Its nodes are the edges, where it interpolates the means linearly, and the middle of each column.

    >>> [v.tolist() for v in line_through_means(np.array([0.0, 1.0, 2.0]), np.array([1.0, 3.0]))]
    [[0.0, 0.5, 1.0, 1.5, 2.0], [0.0, 1.0, 2.0, 3.0, 4.0]]
    """
    middle = 0.5 * (edges[1:] + edges[:-1])
    at, value = np.empty(2 * len(means) + 1), np.empty(2 * len(means) + 1)
    at[0::2], at[1::2] = edges, middle
    value[0::2] = np.interp(edges, middle, means)
    if len(means) > 1:
        for end, first, second in ((0, 0, 1), (-1, -1, -2)):
            slope = (means[second] - means[first]) / (middle[second] - middle[first])
            value[end] = means[first] + slope * (edges[end] - middle[first])
    value[1::2] = 2.0 * means - 0.5 * (value[:-1:2] + value[2::2])
    return at, value


@dataclass(frozen=True)
class Surface:
    """Bilinear table z(u, v), constant outside its nodes.  Complex v is supported for complex-step derivatives.

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

    @cached_property
    def _argument_nodes(self) -> Array:
        return np.asarray(self.v)

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
        return _interpolate_nodes(self._argument_nodes, row, v)


def read_rows(source: Source, folder: Path, key: str, columns: int | Sequence[RequiredColumn]) -> Array:
    """Rows (n, columns) of numbers from a list of lists or a CSV file name.

    `columns` are the quantities of the key in their order, or only their number.  Columns of a file are found by the
    names in its header and converted to the unit of the quantity; without names, their order decides.
    Raises BadInput naming the key, the file and its line.
    """
    return _read_rows_and_table(source, folder, key, columns)[0]


def _read_rows_and_table(
    source: Source, folder: Path, key: str, columns: int | Sequence[RequiredColumn]
) -> tuple[Array, TextTable | None]:
    """Rows of numbers and the table they come from, None for a list; notes on a table go to `TABLE_LOGGER`."""
    count = columns if isinstance(columns, int) else len(columns)
    if not isinstance(source, (list, tuple)):
        table = _read_file(source, folder, key)
        if isinstance(columns, int):
            columns = [RequiredColumn(f"number {n + 1}", "1", "") for n in range(count)]
        data = read_required_columns(table, columns)
        for note in (*table.notes, *note_assumed_units(table, columns)):
            logging.getLogger(TABLE_LOGGER).info("%s: %s", table.where, note)
        return data, table
    given = [list(r) if isinstance(r, (list, tuple)) else [r] for r in source]
    if not given:
        raise BadInput(f"{key}: no rows of numbers; give {count} numbers per row, separated by commas")
    for number, row in enumerate(given, 1):
        place = f"{key}: row {number}"
        if len(row) != count:
            raise BadInput(f"{place}: {row!r} has {len(row)} values; give {count} numbers per row")
        for v in row:
            if isinstance(v, bool) or not isinstance(v, (int, float)) or not math.isfinite(v):
                raise BadInput(f"{place}: {v!r} is not a finite number; remove or repair the row")
    return np.array(given, dtype=float), None


def _read_file(source: Source, folder: Path, key: str) -> TextTable:
    """The table of a file.  Raises BadInput."""
    if not isinstance(source, str):
        raise BadInput(f"{key}: {source!r}; give a CSV file name or a list of rows")
    path = folder / source
    if not path.is_file():
        if DECIMAL_COMMA_NUMBER.fullmatch(source):
            raise BadInput(f"{key}: '{source}'; write the number with a point: {source.replace(',', '.')}")
        raise BadInput(f"{key}: file '{source}' not found in {folder}; give a CSV file there or a list of rows")
    return read_table(path, f"{key}: {source}")


def read_xy_pairs(
    source: Source,
    folder: Path,
    key: str,
    low: float = -math.inf,
    high: float = math.inf,
    columns: int | Sequence[RequiredColumn] = 2,
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Two columns with the first strictly increasing and the second from low to high; `columns` as of `read_rows`."""
    data, table = _read_rows_and_table(source, folder, key, columns)
    step = np.diff(data[:, 0])
    if np.any(step <= 0):
        k = int(np.argmax(step <= 0))
        place = f"{key}: row {k + 2}" if table is None else table.locate_row(k + 1)
        what = "first column" if isinstance(columns, int) else columns[0].name
        raise BadInput(f"{place}: {what} goes from {data[k, 0]:g} to {data[k + 1, 0]:g}; it must increase strictly")
    outside = (data[:, 1] < low) | (data[:, 1] > high)
    if np.any(outside):
        k = int(np.argmax(outside))
        upper = f" and <= {high:g}" if high < math.inf else ""
        place = key if table is None else table.locate_row(k)
        raise BadInput(f"{place}: value {data[k, 1]:g} in the table; give values >= {low:g}{upper}")
    return tuple(data[:, 0].tolist()), tuple(data[:, 1].tolist())


def read_surface(source: Source, folder: Path, key: str, columns: int | Sequence[RequiredColumn] = 3) -> Surface:
    """A Surface from rows (u, v, z) that fill a complete grid; `columns` as of `read_rows`."""
    table = read_rows(source, folder, key, columns)
    u, v = np.unique(table[:, 0]), np.unique(table[:, 1])
    places, count = np.unique(table[:, :2], axis=0, return_counts=True)
    if np.any(count > 1):
        twice = ", ".join(f"{value:g}" for value in places[np.argmax(count > 1)])
        raise BadInput(f"{key}: the pair {twice} occurs twice; give one row for every pair")
    if len(u) * len(v) != len(table):
        raise BadInput(f"{key}: {len(table)} rows do not fill {len(u)} x {len(v)} nodes; give one row for every pair")
    order = np.lexsort((table[:, 1], table[:, 0]))
    z = table[order, 2].reshape(len(u), len(v))
    return Surface(tuple(u.tolist()), tuple(v.tolist()), tuple(map(tuple, z.tolist())))


__getattr__ = renamed_names(
    __name__, {"rows": "read_rows", "pairs": "read_xy_pairs", "grid": "read_surface"}
)  # of earlier releases
