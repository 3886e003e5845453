"""Resolved spots: cost and error of time steps, with the road in its own frame and on fixed cells.

    python benchmarks/spots.py

One disc of 3 mm fixed to the road slides by six diameters under the block, with 6 cells per diameter.  Its mean
rise is compared with an independent program (tests/solver/test_road_frame.py).  Uneven lines fix the cells of the road.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from common import ErrorRow, print_rows

from flashtemp.model.numerics import SolverSettings, choose_binding
from flashtemp.physics.effect import Term
from flashtemp.physics.effects.resolved_spots import STEPS_PER_DIAMETER, ResolvedSpots
from flashtemp.solver.time_integration import integrate_schedule

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

CELLS = 6  # per diameter
UNEVEN = 1e-4  # of a cell, by which the first line of fixed cells is moved
LOOSE, TIGHT = 1e-2, 1e-4  # relative tolerances
STATED = {"own frame": 0.6, "fixed cells": 8.0}  # % of the rise


class PacedSpots(ResolvedSpots):
    """Resolved spots whose steps are at most D/(steps v)."""

    def __init__(self, steps: float) -> None:
        self.steps = steps

    def heat(self, scene, p):
        """The heat of the spots, with another limit of the time step."""
        yield from (term for term in super().heat(scene, p) if term.target != "march.rate")
        yield Term("march.rate", lambda T, now, p: self.steps * p.weight * now.speed / scene.spot_diameter)


def disc_scene(frame: str, steps: float):
    """One disc between block and road, with at least `steps` time steps per diameter."""
    import conftest as lab
    from solver.test_road_frame import one_disc

    made = one_disc(lab, CELLS)
    acting = tuple(
        replace(a, effect=PacedSpots(steps)) if isinstance(a.effect, ResolvedSpots) else a for a in made.acting
    )
    x = made.mesh.x.copy()
    if frame != "own frame":
        x[0] -= UNEVEN * (x[1] - x[0])
    return replace(made, acting=acting, mesh=replace(made.mesh, x=x))


@cache
def compile_kernels() -> None:
    """Compile the kernels that all rows use."""
    for frame in STATED:
        integrate_schedule(
            disc_scene(frame, STEPS_PER_DIAMETER), SolverSettings(choose_binding(None), LOOSE, profiles=4)
        )


def measure_row(frame: str, steps: float, rtol: float) -> ErrorRow:
    """One row, with the number of steps in its name."""
    from solver.test_road_frame import WAVES, mean_rise

    made, settings = disc_scene(frame, steps), SolverSettings(choose_binding(None), rtol, profiles=4)
    compile_kernels()
    began = time.process_time()
    run = integrate_schedule(made, settings)
    seconds = time.process_time() - began
    error = 100.0 * abs(mean_rise(run) / WAVES - 1.0)
    limit = f"D/{steps:g}v" if steps else "no limit"
    name = f"{frame}, rtol {rtol:g}, {limit}: {run.statistics['steps']} steps"
    return ErrorRow(name, made.mesh.n_cells, error, STATED[frame], seconds)


def small_rows() -> list[ErrorRow]:
    """Both frames with the default steps, at a loose tolerance."""
    return [measure_row(frame, STEPS_PER_DIAMETER, LOOSE) for frame in STATED]


def rows() -> list[ErrorRow]:
    """All rows.  Fixed cells have none without a limit of the step, because they fail at a loose tolerance."""
    limits = {
        "own frame": (4.0 * STEPS_PER_DIAMETER, STEPS_PER_DIAMETER, 0.0),
        "fixed cells": (4.0 * STEPS_PER_DIAMETER, STEPS_PER_DIAMETER),
    }
    rtols = [float(r) for r in np.geomspace(LOOSE, TIGHT, 3)]
    return [measure_row(frame, steps, rtol) for frame in STATED for rtol in rtols for steps in limits[frame]]


if __name__ == "__main__":
    raise SystemExit(print_rows(rows()))
