"""The full run-in (10 repetitions, waits, track memory): error against cost, and growth with size."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from common import ErrorRow, print_rows, time_run

from flashtemp.model.case import load_case
from flashtemp.model.numerics import installed_bindings

CASE = Path(__file__).parent.parent / "cases" / "chosen_peak"


def repetition_end_rises(run) -> np.ndarray:
    """Rises at the end of every repetition (repetitions, lines), K."""
    last = [np.flatnonzero(run.sliding & (run.repetition == r))[-1] for r in np.unique(run.repetition)]
    return run.T_block[last] - run.ambient_degC


STATED = {(0.7, 1e-3): 1.0, (0.9, 5e-3): 0.5, (0.9, 1e-3): 0.7, (1.0, 1e-3): 0.6, (1.4, 1e-3): 0.4}  # mesh, rtol: %


def rows(repeat: int, runs=tuple(STATED), finest: float = 2.0, **more) -> list[ErrorRow]:
    """Every binding on every mesh against flashtemp on a finer mesh: the numerical error alone."""
    _, best = time_run(load_case(CASE, {"numerics.mesh": finest, "numerics.rtol": 1e-5} | more), 1)
    truth, out = repetition_end_rises(best), []
    for mesh, rtol in runs:
        for binding in installed_bindings():
            case = load_case(
                CASE, {"numerics.mesh": mesh, "numerics.rtol": rtol, "numerics.integrator": binding} | more
            )
            seconds, run = time_run(case, repeat)
            found = np.array([np.interp(best.x, run.x, row) for row in repetition_end_rises(run)])
            error = 100 * float(np.abs(found - truth)[:, 2:-2].max() / truth.max())
            out.append(
                ErrorRow(
                    f"{binding}, mesh {mesh:g}, rtol {rtol:g}", run.mesh.n_cells, error, STATED[mesh, rtol], seconds
                )
            )
    return out


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeat", type=int, default=3)
    return print_rows(rows(parser.parse_args().repeat))


if __name__ == "__main__":
    raise SystemExit(main())
