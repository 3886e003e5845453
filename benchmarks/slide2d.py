"""slide-2d at 0.1 % (and 1 %): flashtemp with both bindings against the peers, CPU seconds."""

from __future__ import annotations

import argparse
import json
import subprocess
from pathlib import Path

import numpy as np
import scipy_peer
from common import ErrorRow, print_rows, profile_error, time_call, time_run
from scipy.interpolate import CubicSpline, PchipInterpolator

from flashtemp.model.case import load_case
from flashtemp.model.numerics import installed_bindings

CASE = Path(__file__).parent.parent / "cases" / "slide2d"
GOOD = {
    "numerics.cells": [30, 16, 51], "numerics.first_x": 1.56e-4, "numerics.last_x": 6.1e-4,
    "numerics.first_block": 1.3e-5, "numerics.first_road": 1.5e-5, "numerics.rtol": 1e-3,
}  # fmt: skip
ROUGH = {
    "numerics.cells": [14, 9, 18], "numerics.first_x": 3e-4, "numerics.last_x": 1.5e-3,
    "numerics.first_block": 3e-5, "numerics.first_road": 1.6e-5, "numerics.rtol": 3e-3,
}  # fmt: skip
PEER = {  # mesh of the scipy peer by name, and its stated error, %
    "scipy splu, Crank-Nicolson, 41 chosen steps": ((1e-5, 5e-6, 1.3, 1.08), 0.1),
    "the same, 1 %": ((1e-5, 1e-5, 1.8, 1.3), 1.0),
}


def middle_rise(run, t: float) -> float:
    """Rise at x = L/2 and a time (s), cubic between the kept profiles, K."""
    at = [float(PchipInterpolator(run.x, T)(0.0125)) - run.ambient_degC for T in run.T_block]
    return float(CubicSpline(np.sqrt(run.time), at)(np.sqrt(t)))


def run_fipy(folder: Path, python: str) -> ErrorRow:
    """FiPy by the script `fipy_slide2d.py` in a folder, with a Python that has FiPy; takes a minute."""
    command = [python, str(folder / "fipy_slide2d.py"), "1e-5", "5e-6", "1.07", "1.07", "0.25", "lu", "central", "1"]
    alone = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    out = subprocess.run(command, capture_output=True, text=True, check=True, env=alone)
    row = json.loads(out.stdout.strip().splitlines()[-1])
    return ErrorRow("FiPy, LU, 164 steps", row["cells"], max(row["err_TR"], row["err_hist"]), 0.12, row["user"])


def rows(repeat: int) -> list[ErrorRow]:
    """Rows of flashtemp with every binding at 0.1 and 1 %, and of the scipy programs."""
    reference = json.loads((Path(__file__).parent.parent / "tests" / "data" / "slide2d_reference.json").read_text())
    x, rise = np.array(reference["x"]), np.array(reference["TR_rise"])
    history = reference["t_mid"], reference["TR_mid_rise"]
    out = []
    for limit, change in ((0.1, GOOD), (1.0, ROUGH)):
        for binding in installed_bindings():
            case = load_case(
                CASE, {"numerics.integrator": binding, "output.profiles": 150, "output.fields": 2, **change}
            )
            seconds, run = time_run(case, repeat)
            late = 100 * max(abs(middle_rise(run, t) - T) for t, T in zip(*history, strict=True)) / rise.max()
            error = max(profile_error(run, x, rise), late)
            out.append(ErrorRow(f"flashtemp, {binding}, {limit:g} %", run.mesh.n_cells, error, limit, seconds))

    def off(T) -> float:
        return 100.0 * float(np.abs(T - rise).max() / rise.max())

    for name, (given, limit) in PEER.items():
        mesh = scipy_peer.make_mesh(*given)
        seconds, T = time_call(lambda mesh=mesh: scipy_peer.crank_nicolson(mesh), repeat)
        out.append(ErrorRow(name, mesh.cells, off(T), limit, seconds))
    mesh = scipy_peer.make_mesh(*PEER[next(iter(PEER))][0])
    seconds, T = time_call(lambda: scipy_peer.solve_changing(mesh, [[0.0, 0.1], [35.0, 0.1]], 0.0, 35.0, 1e-3), repeat)
    out.append(ErrorRow("scipy solve_ivp BDF, sparse Jacobian", mesh.cells, off(T), 0.1, seconds))
    return out


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fipy", nargs=2, metavar=("FOLDER", "PYTHON"), help="FiPy's script, and a Python that has it")
    parser.add_argument("--repeat", type=int, default=5)
    options = parser.parse_args()
    found = rows(options.repeat)
    if options.fipy:
        found.append(run_fipy(Path(options.fipy[0]), options.fipy[1]))
    return print_rows(found)


if __name__ == "__main__":
    raise SystemExit(main())
