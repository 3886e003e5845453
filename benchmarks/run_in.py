"""The full run-in (10 repetitions, waits, track memory): error against cost, and growth with size."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from common import table, timed

from flashtemp.model.case import load
from flashtemp.model.numerics import available

CASE = Path(__file__).parent.parent / "cases" / "run_in"


def ends(run) -> np.ndarray:
    """Rises at the end of every repetition (repetitions, lines), K."""
    last = [np.flatnonzero(run.sliding & (run.repetition == r))[-1] for r in np.unique(run.repetition)]
    return run.T_block[last] - run.ambient_degC


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeat", type=int, default=3)
    options = parser.parse_args()
    _, best = timed(load(CASE, {"numerics.mesh": 2.0, "numerics.rtol": 1e-5}), 1)
    truth, rows = ends(best), []
    for mesh in (0.7, 0.9, 1.0, 1.4):
        for binding in available():
            case = load(CASE, {"numerics.mesh": mesh, "numerics.rtol": 1e-3, "numerics.integrator": binding})
            seconds, run = timed(case, options.repeat)
            found = np.array([np.interp(best.x, run.x, row) for row in ends(run)])
            error = 100 * np.abs(found - truth)[:, 2:-2].max() / truth.max()
            rows.append((f"{binding}, mesh {mesh:g}, rtol 1e-3", run.mesh.n_cells, float(error), seconds))
    table(rows)


if __name__ == "__main__":
    main()
