"""How heat answers to abrasion: by the pressure that moves, and by what the debris does to the contact."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from flashtemp.model.laws import STEP
from flashtemp.solver import kernels_contact
from flashtemp.solver.balance import Balance
from flashtemp.solver.elastic_foundation import ElasticResponse
from flashtemp.solver.road_frame import Overlap
from flashtemp.solver.winkler import Response


def slope(values) -> np.ndarray:
    """The derivative that a complex step carried along."""
    return np.imag(values) / STEP


Pattern = tuple[np.ndarray, np.ndarray, np.ndarray]


class Answer(NamedTuple):
    """How all rates follow what changes in the columns, their pressure or worn depth: a sparse matrix.

    It has `gain` in the row `place` (of a state) and the column `column`; `abrasion` (columns,) is the part that stands
    in the rates of worn depth, m/s.
    """

    place: np.ndarray
    column: np.ndarray
    gain: np.ndarray
    abrasion: np.ndarray

    @classmethod
    def of(cls, at: Pattern, b: Balance, under: Overlap, face, deep, road, books, abrasion) -> Answer:
        """Out of slopes (columns,) of the heat into the block's `face`, in depth (`deep`) and into the road's cells.

        `books` are those of friction and of all heat into the road (W/m); `under` the road that is touched.
        """
        place, column, unit = at
        heats = [face, *(heat for _, heat in under.parts(road)), np.outer(deep, b.weight).ravel()]
        gain = np.concatenate([*heats, abrasion, *books])
        return cls(place, column, gain / unit, abrasion)

    def add(self, change: np.ndarray, scale: float, out: np.ndarray) -> None:
        """Add `scale` times what a `change` (columns,) does to `out` (size of a state,)."""
        kernels_contact.scatter(self.place, self.column, self.gain, change, scale, out)


def pattern(b: Balance, under: Overlap) -> Pattern:
    """Rows and columns of an `Answer`, and what there makes rates of heat (W/m), of m/s and of what is booked."""
    mesh, n = b.scene.mesh, len(b.cell_block)
    each = np.arange(n)
    roads = [cells for cells, _ in under.parts(b.idle)]
    cells = np.concatenate([b.cell_block, *roads, b.deep_cells.ravel()])
    plane, across = np.divmod(cells, mesh.n_across)
    entries = [np.full(n, b.entry[name]) for name in ("friction", "into_road")]
    one = np.ones(n)
    return (
        np.concatenate([cells, np.arange(b.worn.start, b.worn.stop), *entries]),
        np.concatenate([each, *(each for _ in roads), np.repeat(each, len(b.weight)), each, each, each]),
        np.concatenate([b.capacity[plane] * mesh.share[across], b.worn_unit * one, one, one]),
    )


@dataclass(frozen=True)
class AbrasionCoupling:
    """The linearised way from abrasion, swelling and friction to pressure to heat, and back: for Newton's method.

    Its preconditioner leaves out what swelling and friction do.  `under` is the road that is touched.  What follows
    when columns are `pressed` harder, and when they are worn `deeper` at the same pressure, None where nothing does;
    `warm` and `pulls` slopes of the rate of abrasion and of the friction traction with the temperatures of block and
    lane.  `undo` r -> (1 - gamma d(rate)/d(depth))^-1 r, by way of the pressure.
    """

    b: Balance
    under: Overlap
    pressed: Answer
    deeper: Answer | None
    warm: tuple[Any, ...]
    response: Response | ElasticResponse
    undo: Callable[[np.ndarray], np.ndarray]
    pulls: tuple[Any, ...]

    def heated(self, block: np.ndarray, lane: np.ndarray) -> np.ndarray:
        """Change of the abrasion rate by changes of temperature (columns,) K of the block's first cells and lanes."""
        return self.warm[0] * block + self.warm[1] * lane

    def add(self, worn: np.ndarray, out: np.ndarray, scale: float = 1.0) -> None:
        """Add what changes of the worn depth in the state do to all rates."""
        depth = worn * self.b.worn_unit
        self._add(depth, self.response(depth), scale, out)

    def add_all(self, worn: np.ndarray, T: np.ndarray, lane: np.ndarray, out: np.ndarray) -> None:
        """The same, with what changes of T (cells,) K and of the lanes (columns,) K do by swelling and friction."""
        depth = worn * self.b.worn_unit
        change = self.response(depth - self.b.swelling(T) if self.b.expansion else depth)
        if isinstance(self.response, ElasticResponse):
            change = change + self.response.respond_to_traction(
                self.pulls[0] * T[self.b.cell_block] + self.pulls[1] * lane
            )
        self._add(depth, change, 1.0, out)

    def _add(self, depth: np.ndarray, pressure: np.ndarray, scale: float, out: np.ndarray) -> None:
        self.pressed.add(pressure, scale, out)
        if self.deeper is not None:
            self.deeper.add(depth, scale, out)
