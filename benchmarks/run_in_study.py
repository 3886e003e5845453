"""Run-in from first principles: friction laws, speeds and loads, and a map over the properties of the holder.

    .venv/bin/python benchmarks/run_in_study.py [laws] [map] [--out benchmarks/results/run_in_study.json]

Every run of `cases/run_in` is written when it ends; runs that are in the file are not repeated.
"""

from __future__ import annotations

import argparse
import itertools
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.errors import SolverFailure
from flashtemp.model.case import load_case
from flashtemp.solver.run import Run
from flashtemp.solver.time_integration import integrate_schedule

ROOT = Path(__file__).parent.parent
CASE = ROOT / "cases" / "run_in"
RESULT = ROOT / "benchmarks" / "results" / "run_in_study.json"
COARSE = {"numerics.mesh": 0.6, "output.profiles": 4}

MECHANICS = ["track_memory", "face_shape", "sheared_block", "friction_moment", "wear", "thermal_expansion"]
FRICTION: dict[str, dict[str, Any]] = {
    "constant": {"effects": MECHANICS},
    "exponential": {"effects": ["friction_softening", *MECHANICS]},
    "theory": {"effects": ["persson_friction", *MECHANICS], "persson_friction.spots": "theory"},
}
SPEEDS, LOADS = (0.1, 0.5, 1.0), (0.05e6, 0.15e6, 0.3e6)
COMPLIANCES = (0.0, 0.005, 0.01, 0.015, 0.02, 0.03, 0.05, 0.1, 0.3, 1.0)  # rad/(N m), 0: guided
ARMS = (0.0, 5e-3, 10e-3, 15e-3, 20e-3, 25e-3, 30e-3, 35e-3, 40e-3)  # m
WEAR_RATES, EXPONENTS = (1e-10, 2.5e-10), (0.0, 1.0)

# the three statements of the paper, as bounds
NEW_HOT_SPOT = 0.2  # x/L: hottest place of the face at the end of the first repetition
EVENNESS = 0.15  # half the range of the rise over its middle, from 0.2 L to 0.9 L after ten repetitions


def describe_run(run: Run) -> dict[str, Any]:
    """Friction per repetition, place of the hot spot, evenness, pressure and worn depth of a run."""
    length = run.mesh.x[run.mesh.last]
    at, dx = run.x / length, run.mesh.dx_block
    inner, first, last = (at > 0.2) & (at < 0.9), at < 0.1, at > 0.9
    found: dict[str, Any] = {"friction": np.round(run.friction_per_repetition, 5).tolist()}
    for name, repetition in (("new", 1), ("worn", int(run.repetition[run.last_sliding_index]))):
        k = np.flatnonzero(run.sliding & (run.repetition == repetition))[-1]
        rise, p = run.T_block[k] - run.ambient_degC, run.pressure[k]
        T = rise[inner]
        mean = p @ dx / dx.sum()
        found[name] = {
            "hot_spot": round(float(at[np.argmax(rise)]), 4),
            "rise_max_K": round(float(rise.max()), 3),
            "evenness": round(float(np.ptp(T) / (T.max() + T.min())), 4),
            "pressure_leading_tenth": round(float(p[first] @ dx[first] / dx[first].sum() / mean), 3),
            "pressure_trailing_tenth": round(float(p[last] @ dx[last] / dx[last].sum() / mean), 3),
            "lifted_off": round(float(dx[p < 0.01 * mean].sum() / dx.sum()), 3),
        }
    worn = run.worn[-1] - run.worn[0]
    found["worn_mean_m"] = float(f"{worn @ dx / dx.sum():.4g}")
    found["worn_leading_m"], found["worn_trailing_m"] = (float(f"{worn[k]:.4g}") for k in (0, -1))
    return found


def judge_statements(found: dict[str, Any]) -> dict[str, bool]:
    """Which of the paper's three statements are true of a described run."""
    mu = found["friction"]
    return {
        "hot_spot_leading": found["new"]["hot_spot"] <= NEW_HOT_SPOT,
        "even_after_ten": found["worn"]["evenness"] <= EVENNESS,
        "friction_rises": mu[-1] > mu[0],
    }


def solve(overrides: dict[str, Any]) -> dict[str, Any]:
    """A described run with its statements, or the reason of a failure."""
    began = time.process_time()
    try:
        case = load_case(CASE, COARSE | overrides)
        found = describe_run(integrate_schedule(case.scene, case.settings, case.title))
        found["holds"] = judge_statements(found)
    except SolverFailure as failure:
        found = {"failure": str(failure)}
    return found | {"cpu_s": round(time.process_time() - began, 2)}


def plan_laws() -> dict[str, dict[str, Any]]:
    """Overrides of every friction law, speed and load, by a name."""
    return {
        f"{law}, {v:g} m/s, {1e-6 * p:g} MPa": given | {"schedule.speed": v, "contact.pressure": p}
        for (law, given), v, p in itertools.product(FRICTION.items(), SPEEDS, LOADS)
    }


def plan_map() -> dict[str, dict[str, Any]]:
    """Overrides over holder compliance, pivot height, wear rate and exponent; a guided holder has no pivot."""
    return {
        f"{c:g} rad/(N m), {1e3 * h:g} mm, {k:g} m2/N, n = {n:g}": {
            "friction_moment.compliance": c, "friction_moment.arm": h, "wear.rate": k, "contact.spot_exponent": n,
        }
        for n, k, c, h in itertools.product(EXPONENTS, WEAR_RATES, COMPLIANCES, ARMS)
        if c or not h
    }  # fmt: skip


def write_rows(result: dict[str, dict[str, Any]]) -> str:
    """JSON with one run a line."""
    parts = (
        f"{json.dumps(part)}: {{\n" + ",\n".join(f" {json.dumps(k)}: {json.dumps(v)}" for k, v in runs.items()) + "\n}"
        for part, runs in result.items()
    )
    return "{" + ",\n".join(parts) + "}\n"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", default=["laws", "map"], help="laws, map; both if not given")
    parser.add_argument("--out", type=Path, default=RESULT)
    options = parser.parse_args()
    result = json.loads(options.out.read_text()) if options.out.is_file() else {}
    for part in options.parts:
        plan, kept = {"laws": plan_laws, "map": plan_map}[part](), result.setdefault(part, {})
        for name, overrides in plan.items():
            if name not in kept:
                kept[name] = {"overrides": overrides} | solve(overrides)
                options.out.write_text(write_rows(result))
                print(name, {k: v for k, v in kept[name].items() if k in ("friction", "holds", "failure")}, flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
