"""How heat answers to abrasion: by the pressure that moves, and by what the debris does to the contact."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from flashtemp.model.effect_laws import COMPLEX_STEP
from flashtemp.solver import kernels_contact
from flashtemp.solver.elastic_foundation import ElasticResponse
from flashtemp.solver.heat_balance import HeatBalance
from flashtemp.solver.road_frame import RoadOverlap
from flashtemp.solver.winkler_foundation import SpringResponse


def complex_step_derivative(values) -> np.ndarray:
    """The derivative that a complex step carried along."""
    return np.imag(values) / COMPLEX_STEP


SparsityPattern = tuple[np.ndarray, np.ndarray, np.ndarray]


class SparseResponse(NamedTuple):
    """How all rates follow what changes in the columns, their pressure or worn depth: a sparse matrix.

    It has `gain` in the row `place` (of a state) and the column `column`; `abrasion` (columns,) is the part that stands
    in the rates of worn depth, m/s.
    """

    place: np.ndarray
    column: np.ndarray
    gain: np.ndarray
    abrasion: np.ndarray

    @classmethod
    def from_derivatives(
        cls, sparsity: SparsityPattern, b: HeatBalance, under: RoadOverlap, face, deep, road, books, abrasion
    ) -> SparseResponse:
        """Out of slopes (columns,) of the heat into the block's `face`, in depth (`deep`) and into the road's cells.

        `books` are those of friction and of all heat into the road (W/m); `touched_road` the road that is touched.
        """
        place, column, unit = sparsity
        heats = [face, *(heat for _, heat in under.heat_parts(road)), np.outer(deep, b.deposit_weights).ravel()]
        gain = np.concatenate([*heats, abrasion, *books])
        return cls(place, column, gain / unit, abrasion)

    def add_change(self, change: np.ndarray, scale: float, out: np.ndarray) -> None:
        """Add `scale` times what a `change` (columns,) does to `out` (size of a state,)."""
        kernels_contact.scatter_response(self.place, self.column, self.gain, change, scale, out)


def build_sparsity(b: HeatBalance, under: RoadOverlap) -> SparsityPattern:
    """Rows and columns of an `SparseResponse`, and what there makes rates of heat (W/m), of m/s and of what is booked."""
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
    """The linearised way from abrasion, swelling and friction to pressure to heat, and back: for Newton's method.

    Its preconditioner leaves out what swelling and friction do.  `touched_road` is the road that is touched.  What follows
    when columns are `rates_by_pressure` harder, and when they are worn `rates_by_depth` at the same pressure, None where nothing does;
    `abrasion_slopes` and `traction_slopes` slopes of the rate of abrasion and of the friction traction with the temperatures of block and
    lane.  `solve_depth` r -> (1 - gamma d(rate)/d(depth))^-1 r, by way of the pressure.
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
        """Change of the abrasion rate by changes of temperature (columns,) K of the block's first cells and lanes."""
        return self.abrasion_slopes[0] * block + self.abrasion_slopes[1] * lane

    def add_depth_response(self, worn: np.ndarray, out: np.ndarray, scale: float = 1.0) -> None:
        """Add what changes of the worn depth in the state do to all rates."""
        depth = worn * self.b.worn_unit
        self._add_responses(depth, self.pressure_by_depth(depth), scale, out)

    def add_full_response(self, worn: np.ndarray, T: np.ndarray, lane: np.ndarray, out: np.ndarray) -> None:
        """The same, with what changes of T (cells,) K and of the lanes (columns,) K do by swelling and friction."""
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
