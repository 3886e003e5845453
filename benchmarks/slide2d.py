"""slide-2d at 0.1 % (and 1 %): flashtemp with both bindings against the peers, CPU seconds."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
from common import profile_error, table, timed
from scipy.interpolate import CubicSpline, PchipInterpolator

from flashtemp.model.case import load
from flashtemp.model.numerics import available

CASE = Path(__file__).parent.parent / "cases" / "slide2d"
GOOD = {
    "numerics.cells": [30, 16, 51], "numerics.first_x": 1.56e-4, "numerics.last_x": 6.1e-4,
    "numerics.first_block": 1.3e-5, "numerics.first_road": 1.5e-5, "numerics.rtol": 1e-3,
}  # fmt: skip
ROUGH = {
    "numerics.cells": [14, 9, 18], "numerics.first_x": 3e-4, "numerics.last_x": 1.5e-3,
    "numerics.first_block": 3e-5, "numerics.first_road": 1.6e-5, "numerics.rtol": 3e-3,
}  # fmt: skip
PEERS = {
    "scipy splu, Crank-Nicolson, 41 chosen steps": [
        "mol_splu.py",
        "CN",
        "plan:1",
        "1e-5",
        "5e-6",
        "1.3",
        "1.08",
        "central",
    ],
    "scipy solve_ivp BDF, sparse Jacobian": ["mol_solve_ivp.py", "1e-5", "5e-6", "1.3", "1.08", "1e-3"],
}


def middle(run, t: float) -> float:
    """Rise at x = L/2 and a time (s), cubic between the kept profiles, K."""
    at = [float(PchipInterpolator(run.x, T)(0.0125)) - run.ambient_degC for T in run.T_block]
    return float(CubicSpline(np.sqrt(run.time), at)(np.sqrt(t)))


def peer(folder: Path, command: list[str], repeat: int, python: str = sys.executable) -> tuple[int, float, float]:
    """Cells, error and CPU seconds that a peer's script reports."""
    out = subprocess.run(
        [python, str(folder / command[0]), *command[1:], str(repeat)],
        capture_output=True, text=True, check=True, env={"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip
    row = json.loads(out.stdout.strip().splitlines()[-1])
    return row["cells"], max(row["err_TR"], row["err_hist"]), row["user"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--peers", type=Path, help="folder with the peers' scripts")
    parser.add_argument("--fipy", help="a Python that has FiPy: include it (a minute)")
    parser.add_argument("--repeat", type=int, default=5)
    options = parser.parse_args()
    reference = json.loads((Path(__file__).parent.parent / "tests" / "data" / "slide2d_reference.json").read_text())
    x, rise = np.array(reference["x"]), np.array(reference["TR_rise"])
    history = reference["t_mid"], reference["TR_mid_rise"]
    rows = []
    for name, change in (("0.1 %", GOOD), ("1 %", ROUGH)):
        for binding in available():
            case = load(CASE, {"numerics.integrator": binding, "output.profiles": 150, "output.fields": 2, **change})
            seconds, run = timed(case, options.repeat)
            late = 100 * max(abs(middle(run, t) - T) for t, T in zip(*history, strict=True)) / rise.max()
            error = max(profile_error(run, x, rise), late)
            rows.append((f"flashtemp, {binding}, {name}", run.mesh.n_cells, error, seconds))
    if options.peers:
        for name, command in PEERS.items():
            rows.append((name, *peer(options.peers, command, options.repeat)))
        if options.fipy:
            command = ["fipy_slide2d.py", "1e-5", "5e-6", "1.07", "1.07", "0.25", "lu", "central"]
            rows.append(("FiPy, LU, 164 steps", *peer(options.peers, command, 1, options.fipy)))
    table(rows)


if __name__ == "__main__":
    main()
