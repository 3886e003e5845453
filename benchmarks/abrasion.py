"""What wear costs: the full run-in with and without it, and how the cost grows with cells and repetitions."""

from __future__ import annotations

import argparse
import statistics
import time
from dataclasses import replace
from pathlib import Path

from flashtemp.model.case import load
from flashtemp.model.numerics import available
from flashtemp.solver.march import march
from flashtemp.solver.run import Run

CASE = Path(__file__).parent.parent / "cases" / "run_in"
PLAIN = ["friction_softening", "track_memory", "edge_pressure"]
KINDS = {
    "uniform pressure": ["friction_softening", "track_memory"],
    "peaked pressure, no wear": PLAIN,
    "wear": [*PLAIN, "wear"],
    "wear and turning holder": [*PLAIN, "wear", "friction_moment"],
}


def seconds(case) -> tuple[float, Run]:
    """CPU seconds of set-up and solve with two profiles a stretch, and the Run."""
    lean, began = replace(case.settings, profiles=2, fields=2), time.process_time()
    run = march(case.scene, lean)
    return time.process_time() - began, run


def compare(repeat: int, given: dict) -> None:
    """One row per kind; kinds take turns, so that a busy machine slows all of them alike."""
    cases = {kind: load(CASE, given | {"effects": effects}) for kind, effects in KINDS.items()}
    times: dict[str, list[float]] = {kind: [] for kind in KINDS}
    runs = {}
    for _ in range(repeat + 1):
        for kind, case in cases.items():
            spent, runs[kind] = seconds(case)
            times[kind].append(spent)
    base = statistics.median(times["peaked pressure, no wear"][1:])
    for kind, run in runs.items():
        spent = statistics.median(times[kind][1:])
        print(
            f"{kind:26s} {run.mesh.n_cells:7d} {run.statistics['steps']:7d} {spent:8.2f} {spent / base:7.2f}",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeat", type=int, default=3)
    options = parser.parse_args()
    for binding in available():
        for repetitions, mesh in ((30, 1.0), (10, 1.0), (10, 2.0)):
            print(f"{binding}, {repetitions} repetitions, mesh {mesh:g}: cells, steps, CPU s, ratio")
            compare(options.repeat, {
                "schedule.repetitions": repetitions, "numerics.mesh": mesh, "numerics.integrator": binding,
            })  # fmt: skip


if __name__ == "__main__":
    main()
