"""Grid convergence of a case: observed order of accuracy and numerical error by Richardson extrapolation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace

import numpy as np

from flashtemp.display import DisplayMixin, DisplayTable
from flashtemp.model import case as cases
from flashtemp.model import schema
from flashtemp.solver.run import Run
from flashtemp.solver.time_integration import integrate_schedule

WATCHED_QUANTITIES = ("rise at the leading edge", "rise at the middle", "rise at the trailing edge", "mean friction")
WATCHED_UNITS = ("K", "K", "K", "")


@dataclass(frozen=True, repr=False)
class Convergence(DisplayMixin):
    """Result of `estimate_convergence`: values on three meshes, and for every quantity its order and error.

    `cells` and `values` (levels, quantities) from coarse to fine; the case itself is the middle level.  `order` is the
    observed order (nan where the differences do not decrease), `space` and `time` the estimated errors of the case in
    the unit of the quantity, `profile_percent` the deviation of T(x) from the finest level.
    """

    cells: list[int]
    values: list[list[float]]
    order: list[float]
    space: list[float]
    time: list[float]
    profile_percent: float

    def as_dict(self) -> dict:
        """All numbers as plain data."""
        return {"quantities": list(WATCHED_QUANTITIES), **asdict(self)}

    def __str__(self) -> str:
        rows = [
            f"  {name:28s} {value:12.6g}   order {order:>5s}   error: space {space:.2g}, time {time:.2g}"
            for name, value, order, space, time in self._table_rows()
        ]
        return "\n".join([self._cells_text(), *rows, f"  {self._profile_text()}"])

    def to_table(self) -> DisplayTable:
        head = ("", "value", "order", "error of space", "error of time")
        return DisplayTable(self._cells_text(), self._table_rows(), head, [self._profile_text()])

    def _table_rows(self) -> list[tuple[str, float, str, float, float]]:
        names = [
            f"{name}, {unit}" if unit else name for name, unit in zip(WATCHED_QUANTITIES, WATCHED_UNITS, strict=True)
        ]
        orders = [f"{order:.2f}" if np.isfinite(order) else "-" for order in self.order]
        return list(zip(names, self.values[1], orders, self.space, self.time, strict=True))

    def _cells_text(self) -> str:
        return f"{' / '.join(map(str, self.cells))} cells"

    def _profile_text(self) -> str:
        return f"T(x) differs from the finest level by {self.profile_percent:.3f} %"


def watched_values(run: Run) -> np.ndarray:
    """The quantities compared: temperature rises (K) at three positions, and mean friction."""
    T = run.T_block[run.last_sliding_index] - run.ambient_degC
    L = run.mesh.x[run.mesh.last]
    mu = run.friction_per_repetition or [0.0]  # nothing slides
    rises = [run.at_x(T, fraction * L) for fraction in (0.02, 0.5, 0.98)]
    if run.leading_line_index(run.last_sliding_index) != 0:
        rises.reverse()
    return np.array([*rises, float(np.mean(mu))])


def estimate_convergence(case: cases.Case, watch: Callable[[str], None] = lambda text: None) -> Convergence:
    """Run a case with half, equal and twice the number of cells per direction at rtol/10, and once at its own rtol.

    The error in space is Richardson's estimate on three levels, whose meshes follow one smooth mapping.  The error in
    time is the change from rtol to rtol/10.  `watch` is called with progress messages.
    """
    scene, numerics = case.scene, case.settings
    level = schema.refinement_factor(case["numerics.mesh"])
    tight = replace(numerics, rtol=numerics.rtol / 10, profiles=4, fields=2)
    runs = []
    for factor in (0.5, 1.0, 2.0):
        watch(f"mesh x {factor:g}")
        finer = replace(case, values=case.values | {"numerics": case.values["numerics"] | {"mesh": level * factor}})
        runs.append(integrate_schedule(finer.scene, tight))
    watch("tolerance of the case")
    own = integrate_schedule(scene, replace(numerics, profiles=4, fields=2))
    values = np.array([watched_values(r) for r in runs])
    coarse, fine = values[1] - values[0], values[2] - values[1]
    with np.errstate(divide="ignore", invalid="ignore"):
        order = np.log2(np.abs(coarse / fine))
    order = np.where(np.isfinite(order) & (np.abs(fine) > 1e-12), order, np.nan)
    gain = 2 ** np.clip(np.nan_to_num(order, nan=1.0), 0.5, 3.0)
    space = np.abs(fine) * gain / (gain - 1)
    last = [r.T_block[r.last_sliding_index] for r in runs]
    reference = np.interp(runs[1].x, runs[2].x, last[2])
    scale = max(np.abs(reference - runs[1].ambient_degC).max(), 1e-300)
    inner = slice(2, -2) if len(reference) > 4 else slice(None)
    return Convergence(
        cells=[r.mesh.n_cells for r in runs],
        values=values.tolist(),
        order=order.tolist(),
        space=space.tolist(),
        time=np.abs(watched_values(own) - values[1]).tolist(),
        profile_percent=float(100 * np.abs(last[1] - reference)[inner].max() / scale),
    )
