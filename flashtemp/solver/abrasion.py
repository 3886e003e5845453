"""How heat answers to abrasion: by the pressure that moves, and by what the debris does to the contact."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from flashtemp.model.laws import STEP
from flashtemp.solver import kernels_2d
from flashtemp.solver.balance import Balance
from flashtemp.solver.road_frame import Overlap
from flashtemp.solver.winkler import Response


def slope(values) -> np.ndarray:
    """The derivative that a complex step carried along."""
    return np.imag(values) / STEP


class Answer(NamedTuple):
    """Slopes (columns,) with local pressure or with worn depth.

    Of the heat into the block's `face`, in depth (`deep`) and into the road's cells (`road`), of the `books` of
    friction and of all heat into the road (W/m), and of the rate of `abrasion`.
    """

    face: np.ndarray
    deep: np.ndarray
    road: np.ndarray
    books: tuple[np.ndarray, np.ndarray]
    abrasion: np.ndarray


@dataclass(frozen=True)
class AbrasionCoupling:
    """The linearised way from abrasion, and from swelling, to pressure to heat, and back: for Newton's method.

    Its preconditioner leaves out what swelling does.  `under` is the road that is touched.  What follows when columns
    are `pressed` harder, and when they are worn `deeper` at the same pressure, None where that changes nothing; `warm`
    slopes of the rate of abrasion with the temperatures of block and lane.  `undo` r -> (1 - gamma d(rate)/d(depth))^-1
    r, by way of the pressure.
    """

    b: Balance
    under: Overlap
    pressed: Answer
    deeper: Answer | None
    warm: tuple[Any, ...]
    response: Response
    undo: Callable[[np.ndarray], np.ndarray]

    def heated(self, block: np.ndarray, lane: np.ndarray) -> np.ndarray:
        """Change of the abrasion rate by changes of temperature (columns,) K of the block's first cells and lanes."""
        return self.warm[0] * block + self.warm[1] * lane

    def add(self, worn: np.ndarray, out: np.ndarray, scale: float = 1.0, T: np.ndarray | None = None) -> None:
        """Add what changes of the worn depth in the state, and of T (cells,) K by way of swelling, do to all rates."""
        depth = worn * self.b.worn_unit
        low = depth if T is None or not self.b.expansion else depth - self.b.swelling(T)
        self._add(self.pressed, self.response(low), out, scale)
        if self.deeper is not None:
            self._add(self.deeper, depth, out, scale)

    def _add(self, answer: Answer, change: np.ndarray, out: np.ndarray, scale: float) -> None:
        b = self.b
        heat = np.zeros(b.n)
        heat[b.cell_block] = scale * answer.face * change
        self.under.give(scale * answer.road * change, heat)
        if len(b.weight):
            kernels_2d.deposit(b.deep_cells, b.weight, scale * answer.deep * change, heat)
        mesh = b.scene.mesh
        mesh.planes(out[: b.n])[:] += mesh.planes(heat) / np.outer(b.capacity, mesh.share)
        out[b.worn] += scale / b.worn_unit * answer.abrasion * change
        for name, gain in zip(("friction", "into_road"), answer.books, strict=True):
            out[b.entry[name]] += scale * (gain @ change)
