"""Friction by theory: cost of its table, and cost of a run compared with constant friction.

Runs with and without the theory alternate, so that a busy machine slows both equally; medians of CPU seconds.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from pathlib import Path

import numpy as np
from common import ErrorRow, print_rows, time_call

from flashtemp.model.build import find_theory
from flashtemp.model.case import load_case
from flashtemp.physics.friction.friction_table import tabulate_friction
from flashtemp.physics.quantities import KELVIN
from flashtemp.solver.time_integration import integrate_schedule

THEORY = {"effects": ["persson_friction"]}
OTHERS: dict[str, dict] = {  # the same friction at the end, about
    "a number": {"effects": [], "friction.mu": 0.47},
    "mu(T), exponential": {"effects": ["friction_softening"], "friction.mu": 0.5},
    "a number, heat at one depth": {"effects": ["heat_depth"], "friction.mu": 0.47},
    "theory": THEORY,
}


STATED = 0.15  # %: of mu, by which a table is off at most


SPEEDS = {"one speed": (0.1, 0.1), "0.01 to 1 m/s": (0.01, 1.0)}


def table_rows(file: Path, repeat: int, spans=tuple(SPEEDS)) -> list[ErrorRow]:
    """Cost of tabulation: mu(v, T) alone, and the solver's table over speed, two temperatures and pressure."""
    rows = []
    scene, acting = find_theory(load_case(file, THEORY))
    theory, T = acting.p.theory, KELVIN + np.linspace(-20.0, 180.0, 40)
    v = np.geomspace(1e-6, 10.0, 60)[:, None]
    print(f"{'mu(v, T), 60 x 40':36s} {1e3 * time_call(lambda: theory(v, T, 1.5e5), repeat)[0]:6.0f} ms")
    for words in spans:
        made: list = []

        def make(speeds=SPEEDS[words], made=made):  # other spots each time, so that no table comes from the cache
            made.append(tabulate_friction(theory, scene.block, 3e-3 + 1e-9 * len(made), speeds, 1.5e5, 293.15, 4e-6))

        spent, _ = time_call(make, repeat)
        rows.append(ErrorRow(f"table for a run, {words}", 0, 100.0 * made[-1].error, STATED, spent))
    return rows


def print_run_times(file: Path, repeat: int, meshes) -> None:
    """CPU seconds of a 35 s slide, and their ratio to those with constant friction."""
    for mesh in meshes:
        cases = {name: load_case(file, given | {"numerics.mesh": mesh}) for name, given in OTHERS.items()}
        made = {name: (case.scene, case.settings) for name, case in cases.items()}
        spent: dict[str, list[float]] = {name: [] for name in made}
        for n in range(repeat + 1):
            for name, (scene, numerics) in made.items():
                start = time.process_time()
                integrate_schedule(scene, numerics)
                if n:  # the first round compiles
                    spent[name].append(time.process_time() - start)
        base = statistics.median(spent["a number"])
        cells = made["theory"][0].mesh.n_cells
        for name, seconds in spent.items():
            t = statistics.median(seconds)
            print(f"{cells:8d} cells  {name:28s} {t:7.3f} s  ratio {t / base:.2f}", flush=True)


if __name__ == "__main__":
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--repeat", type=int, default=9)
    arguments.add_argument("--meshes", type=float, nargs="+", default=[1.0, 2.0, 4.0])
    given = arguments.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        case = Path(folder) / "case.toml"
        case.write_text("effects = []\n")
        beyond = print_rows(table_rows(case, given.repeat))
        print()
        print_run_times(case, given.repeat, given.meshes)
    raise SystemExit(beyond)
