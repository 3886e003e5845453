"""Enthalpy as a function of temperature, for heat capacities that depend on temperature.

The state of a cell is its enthalpy rise over the rho c that the case states, in K: h is the integral of
c/c0 over the temperature rise (the enthalpy method: Voller & Prakash 1987, Int. J. Heat Mass Transfer 30, 1709).
It is conserved whatever c does, and equals the temperature rise where c is constant.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from flashtemp.errors import SolverFailure
from flashtemp.model.effect_laws import EffectLaws
from flashtemp.model.scene import Scene
from flashtemp.physics.arrays import Array

CAPACITY_TABLE_STEP_K = 0.5  # step of a table of c, linear in between: a kink of c is rounded off within one step
MIN_CAPACITY_RISE_K, MAX_CAPACITY_RISE_K = (
    -150.0,
    2000.0,
)  # rises above ambient that are tabulated; c is constant beyond
LEVEL_CAPACITY_RISE_K = 1e6  # rise to which c is continued as a constant
HEATED_BODIES = ("block", "road")
NON_POSITIVE_CAPACITY = "heat capacity fell to zero or below"


@dataclass(frozen=True)
class LinearCapacity:
    """c/c0 = 1 + `gradient` rise, with a gradient (cells,) in 1/K."""

    gradient: Array

    def enthalpy_rise(self, rise: Array) -> Array:
        """Enthalpy rises of the temperature rises of the first cells, K."""
        return rise * (1 + 0.5 * self.gradient[: len(rise)] * rise)

    def temperature_rise(self, h: Array) -> Array:
        """Temperature rises of the enthalpy rises of all cells, K.  Raises SolverFailure where c is not positive."""
        root = 1 + 2 * self.gradient * h
        if not np.min(root.real) > 0:
            raise SolverFailure(NON_POSITIVE_CAPACITY)
        return 2 * h / (1 + np.sqrt(root))

    def capacity_ratio(self, rise: Array) -> Array:
        """c/c0 = dh/dT at the temperature rises of all cells."""
        return 1.0 + self.gradient * rise


@dataclass(frozen=True)
class CapacityTable:
    """c/c0 `capacity_ratios` (n,) at temperature `rises` (n,) K, linear between them.

    `enthalpies` (n,) K are the enthalpy rises, 0 at the rise 0.
    """

    rises: Array
    capacity_ratios: Array
    enthalpies: Array

    @classmethod
    def tabulate(cls, rises: Array, relative: Array) -> CapacityTable:
        """The table of c/c0 `relative` (n,) at `rises` (n,) K, cut where c is not positive.

        Raises SolverFailure if c <= 0 at ambient temperature.
        """
        bad, zero = np.flatnonzero(~(relative > 0)), int(np.searchsorted(rises, 0.0))
        if zero in bad:
            raise SolverFailure(NON_POSITIVE_CAPACITY)
        begin, end = np.max(bad[bad < zero], initial=-1) + 1, np.min(bad[bad > zero], initial=len(rises))
        before, after = (
            [-LEVEL_CAPACITY_RISE_K] if begin == 0 else [],
            [LEVEL_CAPACITY_RISE_K] if end == len(rises) else [],
        )
        relative = np.pad(relative[begin:end], (len(before), len(after)), mode="edge")
        rises = np.concatenate([before, rises[begin:end], after])
        steps = np.diff(rises) * 0.5 * (relative[1:] + relative[:-1])
        start = int(np.searchsorted(rises, 0.0))  # summed from 0 both ways, so no digits are lost to the far ends
        below, above = -np.cumsum(steps[:start][::-1])[::-1], np.cumsum(steps[start:])
        return cls(rises, relative, np.concatenate([below, [0.0], above]))

    def _locate_segment(self, values: Array, nodes: Array) -> tuple[Array, Array, Array, Array]:
        """The node below each value, the distance from it, c/c0 at the node and its slope up to the next node.

        Raises SolverFailure for a value outside the table.
        """
        real = values.real
        if not (nodes[0] <= real.min() and real.max() <= nodes[-1]):
            raise SolverFailure(NON_POSITIVE_CAPACITY)
        k = np.minimum(np.searchsorted(nodes, real, side="right"), len(nodes) - 1) - 1
        slope = np.diff(self.capacity_ratios) / np.diff(self.rises)
        return k, values - nodes[k], self.capacity_ratios[k], slope[k]

    def enthalpy_rise(self, rise: Array) -> Array:
        """Enthalpy rises (any,) K of temperature rises (any,) K."""
        k, beyond, c, slope = self._locate_segment(rise, self.rises)
        return self.enthalpies[k] + beyond * (c + 0.5 * slope * beyond)

    def temperature_rise(self, h: Array) -> Array:
        """Temperature rises (any,) K of enthalpy rises (any,) K."""
        k, beyond, c, slope = self._locate_segment(h, self.enthalpies)
        return self.rises[k] + 2 * beyond / (c + np.sqrt(c * c + 2 * slope * beyond))

    def interpolate_ratio(self, rise: Array) -> Array:
        """c/c0 (any,) at temperature rises (any,) K."""
        _, beyond, c, slope = self._locate_segment(rise, self.rises)
        return c + slope * beyond


@dataclass(frozen=True)
class TabulatedCapacity:
    """c/c0 of every cell by one of a few `tables`; `table_numbers` (cells,) is its number, -1 where c is constant."""

    tables: tuple[CapacityTable, ...]
    table_numbers: Array

    def enthalpy_rise(self, rise: Array) -> Array:
        """Enthalpy rises of the temperature rises of the first cells, K."""
        return self._look_up_by_table(CapacityTable.enthalpy_rise, rise, rise)

    def temperature_rise(self, h: Array) -> Array:
        """Temperature rises of the enthalpy rises of all cells, K.  Raises SolverFailure where c is not positive."""
        return self._look_up_by_table(CapacityTable.temperature_rise, h, h)

    def capacity_ratio(self, rise: Array) -> Array:
        """c/c0 = dh/dT at the temperature rises of all cells."""
        return self._look_up_by_table(CapacityTable.interpolate_ratio, rise, np.ones_like(rise))

    def _look_up_by_table(
        self, look_up: Callable[[CapacityTable, Array], Array], values: Array, constant: Array
    ) -> Array:
        """`look_up` of every value in the table of its cell; `constant` for cells without a table."""
        out, which = constant.copy(), self.table_numbers[: len(values)]
        for number, table in enumerate(self.tables):
            cells = np.flatnonzero(which == number)
            if len(cells):
                out[cells] = look_up(table, values[cells])
        return out


def build_heat_capacity(scene: Scene, laws: EffectLaws) -> LinearCapacity | TabulatedCapacity | None:
    """c/c0 of all cells over temperature, or None where it is constant.  Raises SolverFailure if c <= 0 at ambient."""
    tabulated = [laws.has_law(f"{body}.heat_capacity") for body in HEATED_BODIES]
    if not any(tabulated) and not any(laws.has_law(f"{body}.capacity_gradient") for body in HEATED_BODIES):
        return None
    mesh = scene.mesh
    gradients = [laws(f"{body}.capacity_gradient", 0.0, None, None) for body in HEATED_BODIES]
    if not any(tabulated):
        slope = np.zeros(mesh.n_plane)
        slope[mesh.block], slope[mesh.road] = gradients
        return LinearCapacity(np.repeat(slope, mesh.n_across))
    rises = np.arange(MIN_CAPACITY_RISE_K, MAX_CAPACITY_RISE_K + CAPACITY_TABLE_STEP_K, CAPACITY_TABLE_STEP_K)
    tables: dict[bytes, CapacityTable] = {}
    which = np.full(mesh.n_plane, -1)
    for body, gradient, cells in zip(HEATED_BODIES, gradients, (mesh.block, mesh.road), strict=True):
        T = rises[:, None, None]  # the shape of cells for laws: along x, up the block, across
        linear = 1.0 + np.reshape(gradient, (-1, 1)) * T
        c = laws(f"{body}.heat_capacity", linear, scene.ambient + T, None) + 0.0 * T
        which[cells] = [_table_number(tables, rises, column) for column in c[:, :, 0].T]
    return TabulatedCapacity(tuple(tables.values()), np.repeat(which, mesh.n_across)) if tables else None


def _table_number(tables: dict[bytes, CapacityTable], rises: Array, relative: Array) -> int:
    """Number of the table of c/c0 `relative` (n,) at `rises` (n,), added if it is new; -1 for a constant c.

    An effect that is off must not change any bit of the state, and interpolation in a table would.
    """
    if np.all(relative == 1.0):
        return -1
    key = relative.tobytes()
    if key not in tables:
        tables[key] = CapacityTable.tabulate(rises, relative)
    return list(tables).index(key)
