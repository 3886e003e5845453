"""Cost of wear: the full run-in with and without it, and how the cost grows with cells and repetitions."""

from __future__ import annotations

import argparse
import statistics
import time
from dataclasses import replace
from pathlib import Path

from common import ErrorRow, print_rows

from flashtemp.model.case import load_case
from flashtemp.model.numerics import installed_bindings
from flashtemp.solver.run import Run
from flashtemp.solver.time_integration import integrate_schedule

CASE = Path(__file__).parent.parent / "cases" / "chosen_peak"
PLAIN = ["friction_softening", "track_memory", "edge_pressure"]
KINDS = {
    "peaked pressure, no wear": PLAIN,
    "uniform pressure": ["friction_softening", "track_memory"],
    "wear": [*PLAIN, "wear"],
    "wear and turning holder": [*PLAIN, "wear", "friction_moment"],
}


def time_case(case) -> tuple[float, Run]:
    """CPU seconds of set-up and solve with two profiles a stretch, and the Run."""
    lean, began = replace(case.settings, profiles=2, fields=2), time.process_time()
    run = integrate_schedule(case.scene, lean)
    return time.process_time() - began, run


LOST = 1e-8  # %: heat that appears or vanishes


def compare_kinds(repeat: int, given: dict) -> list[ErrorRow]:
    """One row per kind, with the lost heat as its error; kinds run in turn: a busy machine slows all equally."""
    cases = {kind: load_case(CASE, given | {"effects": effects}) for kind, effects in KINDS.items()}
    times: dict[str, list[float]] = {kind: [] for kind in KINDS}
    runs = {}
    for _ in range(repeat + 1):
        for kind, case in cases.items():
            spent, runs[kind] = time_case(case)
            times[kind].append(spent)
    return [
        ErrorRow(
            f"{kind}, {run.statistics['steps']} steps", run.mesh.n_cells, 100.0 * run.summary["energy_imbalance"], LOST,
            statistics.median(times[kind][1:]),
        )
        for kind, run in runs.items()
    ]  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeat", type=int, default=3)
    options = parser.parse_args()
    beyond = 0
    for binding in installed_bindings():
        for repetitions, mesh in ((30, 1.0), (10, 1.0), (10, 2.0)):
            print(f"{binding}, {repetitions} repetitions, mesh {mesh:g}")
            given = {"schedule.repetitions": repetitions, "numerics.mesh": mesh, "numerics.integrator": binding}
            beyond |= print_rows(compare_kinds(options.repeat, given))
    return beyond


if __name__ == "__main__":
    raise SystemExit(main())
