"""Coupling of wear, thermal expansion and friction to the heat, by the pressure and by debris in the contact."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from flashtemp.model.effect_laws import COMPLEX_STEP
from flashtemp.solver import kernels_contact
from flashtemp.solver.elastic_contact import ElasticResponse
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.road_frame import RoadOverlap
from flashtemp.solver.winkler_foundation import SpringResponse


def complex_step_derivative(values) -> np.ndarray:
    """The derivative from values at a complex step of `COMPLEX_STEP`."""
    return np.imag(values) / COMPLEX_STEP


SparsityPattern = tuple[np.ndarray, np.ndarray, np.ndarray]


class SparseResponse(NamedTuple):
    """Derivative of all rates with respect to pressure or worn depth of the columns: a sparse matrix.

    The entry in row `place` (of a state) and column `column` is `gain`; `abrasion` (columns,) is the derivative of the
    wear rate, in m/s.
    """

    place: np.ndarray
    column: np.ndarray
    gain: np.ndarray
    abrasion: np.ndarray

    @classmethod
    def from_derivatives(
        cls, sparsity: SparsityPattern, b: HeatBalance, under: RoadOverlap, face, deep, road, books, abrasion
    ) -> SparseResponse:
        """The matrix from derivatives (columns,) of heat into the block's `face`, in depth (`deep`) and into the road.

        `books` are the derivatives of the ledger entries friction and into_road (W/m); `under` is the road under the
        columns.
        """
        place, column, unit = sparsity
        heats = [face, *(heat for _, heat in under.heat_parts(road)), np.outer(deep, b.deposit_weights).ravel()]
        gain = np.concatenate([*heats, abrasion, *books])
        return cls(place, column, gain / unit, abrasion)

    def add_change(self, change: np.ndarray, scale: float, out: np.ndarray) -> None:
        """Add `scale` times the product with a `change` (columns,) to `out` (size,)."""
        kernels_contact.scatter_response(self.place, self.column, self.gain, change, scale, out)


def build_sparsity(b: HeatBalance, under: RoadOverlap) -> SparsityPattern:
    """Rows and columns of a `SparseResponse`, and the units that turn its entries into rates of the state.

    Heat in W/m is divided by the heat capacity, m/s by the unit of the worn depth, ledger entries by 1.
    """
    mesh, n = b.scene.mesh, len(b.cell_block)
    each = np.arange(n)
    roads = [cells for cells, _ in under.heat_parts(b.zero_columns)]
    cells = np.concatenate([b.cell_block, *roads, b.deep_cells.ravel()])
    plane, across = np.divmod(cells, mesh.n_across)
    entries = [np.full(n, b.ledger_index[name]) for name in ("friction", "into_road")]
    one = np.ones(n)
    return (
        np.concatenate([cells, np.arange(b.worn.start, b.worn.stop), *entries]),
        np.concatenate([each, *(each for _ in roads), np.repeat(each, len(b.deposit_weights)), each, each, each]),
        np.concatenate([b.capacity[plane] * mesh.share[across], b.worn_unit * one, one, one]),
    )


@dataclass(frozen=True)
class AbrasionCoupling:
    """Linearised coupling of wear, thermal expansion and friction, by way of the pressure, to all rates.

    The Jacobian uses all of it; the preconditioner leaves out expansion and friction.  `touched_road` is the road under
    the columns.  `rates_by_pressure` and `rates_by_depth` are the derivatives of all rates with respect to pressure,
    and to worn depth at constant pressure (None if they vanish).  `abrasion_slopes` and `traction_slopes` are the
    derivatives of the wear rate and of the friction traction with respect to the temperatures of block [0] and lane
    [1].  `pressure_by_depth` is the linear response of the pressure, and `solve_depth` maps r to
    (1 - gamma d(rate)/d(depth))^-1 r.
    """

    b: HeatBalance
    touched_road: RoadOverlap
    rates_by_pressure: SparseResponse
    rates_by_depth: SparseResponse | None
    abrasion_slopes: tuple[Any, ...]
    pressure_by_depth: SpringResponse | ElasticResponse
    solve_depth: Callable[[np.ndarray], np.ndarray]
    traction_slopes: tuple[Any, ...]

    def abrasion_rate_change(self, block: np.ndarray, lane: np.ndarray) -> np.ndarray:
        """Change of the wear rate by changes (columns,) K of the block's first cells and of the lanes."""
        return self.abrasion_slopes[0] * block + self.abrasion_slopes[1] * lane

    def add_depth_response(self, worn: np.ndarray, out: np.ndarray, scale: float = 1.0) -> None:
        """Add the change of all rates by changes `worn` of the worn depth, in units of the state, to `out`."""
        depth = worn * self.b.worn_unit
        self._add_responses(depth, self.pressure_by_depth(depth), scale, out)

    def add_full_response(self, worn: np.ndarray, T: np.ndarray, lane: np.ndarray, out: np.ndarray) -> None:
        """The same, plus the effect of changes T (cells,) K and `lane` (columns,) K by expansion and friction."""
        depth = worn * self.b.worn_unit
        change = self.pressure_by_depth(depth - self.b.thermal_displacement(T) if self.b.expansion else depth)
        if isinstance(self.pressure_by_depth, ElasticResponse):
            change = change + self.pressure_by_depth.respond_to_traction(
                self.traction_slopes[0] * T[self.b.cell_block] + self.traction_slopes[1] * lane
            )
        self._add_responses(depth, change, 1.0, out)

    def _add_responses(self, depth: np.ndarray, pressure: np.ndarray, scale: float, out: np.ndarray) -> None:
        self.rates_by_pressure.add_change(pressure, scale, out)
        if self.rates_by_depth is not None:
            self.rates_by_depth.add_change(depth, scale, out)
