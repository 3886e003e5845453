"""Friction falling with temperature and speed changing: flashtemp against scipy solve_ivp BDF.

Both are compared with the peer's own solution, extrapolated from a mesh and that mesh halved.  The peer shares no code
with flashtemp (scipy_peer.py).  The reference is tests/data/slide2d_changing.json; --reference computes it in a minute.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import scipy_peer
from common import ErrorRow, print_rows, profile_error, time_call, time_run

from flashtemp.model.case import load_case
from flashtemp.model.numerics import installed_bindings

CASE = Path(__file__).parent.parent / "cases" / "slide2d"
REFERENCE = Path(__file__).parent.parent / "tests" / "data" / "slide2d_changing.json"
SPEED = [[0.0, 0.1], [10.0, 0.2], [20.0, 0.05], [35.0, 0.1]]
SOFTENING, END = 0.006, 35.25  # 1/K, s
CHANGE = {
    "effects": ["holder_sink", "friction_softening"], "friction_softening.b": SOFTENING, "schedule.speed": SPEED,
    "output.profiles": 8, "output.fields": 2, "schedule.distance": 3.9,
}  # fmt: skip
MESH = (1e-5, 5e-6, 1.3, 1.08)  # of the peer: 7,360 cells
OURS = {1e-2: 0.08, 1e-3: 0.08}  # rtol: stated error, %
PEERS = {1e-2: 0.15, 1e-3: 0.12, 1e-4: 0.1}


def reference() -> int:
    """Richardson of the peer on its mesh and that mesh halved, rtol 1e-6; 0."""
    coarse = scipy_peer.make_mesh(*MESH)
    a, b = (scipy_peer.solve_changing(m, SPEED, SOFTENING, END, 1e-6) for m in (coarse, scipy_peer.halve_cells(coarse)))
    rise = b + (b - a) / 3.0
    left = 100.0 * float(np.abs(rise - b).max() / rise.max())
    out = {"x": scipy_peer.AT.tolist(), "T_R_rise": rise.round(6).tolist(), "finest_percent": round(left, 4)}
    REFERENCE.write_text(json.dumps(out, indent=1) + "\n")
    return 0


def rows(repeat: int, small: bool = False) -> list[ErrorRow]:
    """flashtemp with every binding and the peer, at several tolerances or the loosest alone."""
    stored = json.loads(REFERENCE.read_text())
    x, rise = np.array(stored["x"]), np.array(stored["T_R_rise"])
    out = []
    for binding in installed_bindings():
        for rtol, limit in list(OURS.items())[: 1 if small else None]:
            case = load_case(CASE, CHANGE | {"numerics.integrator": binding, "numerics.rtol": rtol})
            seconds, run = time_run(case, repeat)
            name = f"flashtemp, {binding}, rtol {rtol:g}"
            out.append(ErrorRow(name, run.mesh.n_cells, profile_error(run, x, rise), limit, seconds))
    mesh = scipy_peer.make_mesh(*MESH)
    for rtol, limit in list(PEERS.items())[: 1 if small else None]:
        seconds, T = time_call(lambda rtol=rtol: scipy_peer.solve_changing(mesh, SPEED, SOFTENING, END, rtol), repeat)
        error = 100.0 * float(np.abs(T - rise).max() / rise.max())
        out.append(ErrorRow(f"scipy solve_ivp BDF, rtol {rtol:g}", mesh.cells, error, limit, seconds))
    return out


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--reference", action="store_true")
    options = parser.parse_args()
    return reference() if options.reference else print_rows(rows(options.repeat))


if __name__ == "__main__":
    raise SystemExit(main())
