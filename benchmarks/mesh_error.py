"""Error of the face temperature on coarse meshes: `.venv/bin/python benchmarks/mesh_error.py` (5 minutes).

Uniform pressure, a peak at the leading edge and friction by theory, at 0.1 and 1 m/s after 0.5 m, against four times
the cells per direction of the default mesh.  Errors are the largest between 0.05 L and 0.95 L, in percent of the
largest rise: the first and the last twentieth hold the singular edges.  Writes benchmarks/results/mesh_error.json,
which flashtemp/runs/checks/mesh_error.py quotes.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.errors import BadInput
from flashtemp.model.case import load_case
from flashtemp.solver.run import Run
from flashtemp.solver.time_integration import integrate_schedule

ROOT = Path(__file__).parents[1]
OUT = ROOT / "benchmarks" / "results" / "mesh_error.json"
FINEST = 4.0
FACTORS = (2.0, 1.0, 0.7, 0.5, 0.4, 0.3, 0.25, 0.2, 0.15, 0.1, 0.05)
INNER = (0.05, 0.95)  # of the length
SHORT = {"schedule.distance": 0.5, "output.profiles": 2, "output.fields": 2, "numerics.rtol": 1e-6}
PLAIN = {"payne_rest": 1.0, "flattened": 1.0, "work_of_adhesion": 0.0}
CASES: dict[str, dict[str, Any]] = {
    "uniform_pressure": {},
    "run_in": {"schedule.repetitions": 1},
    "mu_of_p": {f"persson_friction.{key}": value for key, value in PLAIN.items()},
}


def simulate(case: str, speed: float, factor: float) -> Run:
    """A short run on a mesh with a factor on the number of cells per direction."""
    given = load_case(ROOT / "cases" / case, SHORT | CASES[case] | {"schedule.speed": speed, "numerics.mesh": factor})
    return integrate_schedule(given.scene, given.settings)


def face_error(run: Run, finest: Run) -> float:
    """Largest difference of the face temperature in the inner part, in percent of the largest rise."""
    k = run.last_sliding_index
    rise = finest.T_block[k].max() - finest.T_block[0].min()
    inner = (run.x > INNER[0] * finest.x.max()) & (run.x < INNER[1] * finest.x.max())
    off = run.T_block[k] - np.interp(run.x, finest.x, finest.T_block[k])
    return float(100 * np.abs(off[inner]).max() / rise)


def main() -> None:
    """Measure, print and write."""
    errors: dict[str, dict[str, float | None]] = {}
    for case in CASES:
        for speed in (0.1, 1.0):
            finest = simulate(case, speed, FINEST)
            own = errors.setdefault(f"{case}, {speed:g} m/s", {})
            for factor in FACTORS:
                try:
                    own[f"{factor:g}"] = round(face_error(simulate(case, speed, factor), finest), 2)
                except BadInput:  # the first cell is too coarse for heat in depth: refused
                    own[f"{factor:g}"] = None
            print(case, speed, own, flush=True)
    worst = {f"{f:g}": max(e for own in errors.values() if (e := own[f"{f:g}"]) is not None) for f in FACTORS}
    answer = {"percent_of_largest_rise": errors, "worst": worst}
    OUT.write_text(json.dumps(answer, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
