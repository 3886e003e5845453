"""Sign of the effect of heating on friction and on its load dependence, over the ranges of unpublished inputs.

Run it with the interpreter of the project: `.venv/bin/python benchmarks/heating_sign.py` (20 minutes).  It draws the
inputs from a Latin hypercube, runs each draw at 0.1 and 1 m/s and at 0.05 and 0.3 MPa, with and without softening, and
writes benchmarks/results/heating_sign.json.  There are two sets of ranges: rubber A as well as a
laboratory knows a compound, and any compound of the ranges to which docs/explanation/friction.md fits its cold-hot law.
"""

from __future__ import annotations

import argparse
import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import qmc, spearmanr

from flashtemp.errors import SolverFailure
from flashtemp.model.case import load_case
from flashtemp.physics.material import LIBRARY
from flashtemp.runs.studies.load_dependence import MINIMAL_OUTPUT, LoadCase, compute_load_frictions

ROOT = Path(__file__).parents[1]
OUT = ROOT / "benchmarks" / "results" / "heating_sign.json"
SPEEDS, PRESSURES = (0.1, 1.0), (5e4, 3e5)  # m/s, Pa
LOG, LINEAR = True, False
RUBBER = LIBRARY["tread_rubber"]
RANGES = {  # lowest, highest, whether logarithmic
    "relaxed modulus, Pa": (3e6, 20e6, LOG),
    "exponent of the master curve": (0.4, 0.6, LINEAR),
    "time of the master curve, s": (1e-9, 1e-7, LOG),
    "rms slope": (1.0, 1.4, LINEAR),
    "shear stress, Pa": (2e6, 6.5e6, LINEAR),
    "activation energy, eV": (0.9, 1.1, LINEAR),
    "gamma": (0.4, 0.6, LINEAR),
    "spot diameter, m": (1.5e-3, 12e-3, LOG),
    "contact fraction where given": (0.08, 0.5, LOG),
    "alpha, W/m2K": (3e3, 1e6, LOG),
    "conductivity of the rubber, W/mK": (0.2, 0.35, LINEAR),
    "ambient temperature, degC": (5.0, 40.0, LINEAR),
    "payne_rest": (0.2, 0.8, LINEAR),
    "payne_strain": (0.01, 0.1, LOG),
}
RUBBER_A = RANGES | {  # a master curve shifted by half a decade each way, moduli within 20 %, the slopes in use
    "relaxed modulus, Pa": (6.4e6, 9.6e6, LOG),
    "exponent of the master curve": (0.48, 0.52, LINEAR),
    "time of the master curve, s": (10**-8.5, 10**-7.5, LOG),
    "rms slope": (1.2, 1.4, LINEAR),
}
SETS = {"rubber A": RUBBER_A, "any compound": RANGES}
LAWS = ("fixed by the road", "P(2 pi/D) of the theory")
BESIDE = ("alone", "beside softening")


def draw_inputs(ranges: dict[str, tuple[float, float, bool]], count: int, seed: int) -> list[dict[str, float]]:
    """`count` points of a Latin hypercube over the ranges."""
    points = qmc.LatinHypercube(len(ranges), rng=np.random.default_rng(seed)).random(count)
    low, high, log = (np.array(column) for column in zip(*ranges.values(), strict=True))
    with np.errstate(divide="ignore"):
        values = np.where(log, low * (high / low) ** points, low + (high - low) * points)
    return [dict(zip(ranges, row.tolist(), strict=True)) for row in values]


def case_values(x: dict[str, float], law: str, softened: bool) -> dict[str, Any]:
    """Keys of a case for one point, one law of the contact fraction, with softening or without."""
    theory = "persson_friction."
    curve = {
        "relaxed": x["relaxed modulus, Pa"], "unrelaxed": 2e9, "exponent": x["exponent of the master curve"],
        "time": x["time of the master curve, s"],
    }  # fmt: skip
    return MINIMAL_OUTPUT | {
        theory + "master_curve": curve, theory + "wlf": [7.718, 116.6], theory + "rms_slope": x["rms slope"],
        theory + "shear_stress": x["shear stress, Pa"], theory + "activation": x["activation energy, eV"],
        theory + "gamma": x["gamma"], theory + "flattened": 1.0, theory + "work_of_adhesion": 0.0,
        theory + "payne_rest": x["payne_rest"] if softened else 1.0, theory + "payne_strain": x["payne_strain"],
        theory + "spots": "given" if law == LAWS[0] else "theory",
        "contact.spot_fraction": x["contact fraction where given"], "contact.spot_exponent": 0.0,
        "contact.spot_diameter": x["spot diameter, m"], "contact.alpha": x["alpha, W/m2K"],
        "materials.tread_rubber": {
            "conductivity": x["conductivity of the rubber, W/mK"], "density": RUBBER.density,
            "heat_capacity": RUBBER.heat_capacity,
        },
        "ambient.temperature": x["ambient temperature, degC"], "numerics.mesh": 0.5, "numerics.rtol": 1e-3,
    }  # fmt: skip


def measure(x: dict[str, float], law: str, softened: bool, speed: float) -> dict[str, Any]:
    """Friction coefficient at PRESSURES with heating and without."""
    case = load_case(ROOT / "cases" / "mu_of_p", case_values(x, law, softened) | {"schedule.speed": speed})
    return {name: compute_load_frictions(LoadCase(case, PRESSURES, name == "cold")) for name in ("hot", "cold")}


def heating_effects(found: dict[str, Any]) -> dict[str, float]:
    """Change of ln mu by heating at the higher load, and of its change from the lower load to the higher one."""
    at = np.log(np.array(found["hot"]) / np.array(found["cold"]))
    return {"level": float(at[-1]), "load": float(at[-1] - at[0])}


def summary(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """For each set, speed, law and softening: fraction of draws that fall, quantiles, and largest rank correlations."""
    out = []
    for name in itertools.product(SETS, SPEEDS, LAWS, BESIDE):
        own = [r for r in rows if (r["set"], r["speed"], r["law"], r["beside"]) == name]
        said: dict[str, Any] = dict(zip(("set", "speed", "law", "beside"), name, strict=True)) | {"draws": len(own)}
        for what in ("level", "load"):
            y = np.array([r[what] for r in own])
            ranks = {k: float(spearmanr([r["inputs"][k] for r in own], y).statistic) for k in RANGES}
            first = sorted(ranks, key=lambda k: -abs(ranks[k]))[:3]
            said[what] = {
                "share_falls": float(np.mean(y < 0)),
                "percent": [round(100 * v, 1) for v in np.expm1(np.quantile(y, (0.05, 0.5, 0.95)))],
                "ranks": {k: round(ranks[k], 2) for k in first},
            }
        out.append(said)
    return out


def _round_numbers(value: Any) -> Any:
    """Numbers rounded to four digits, for a readable file."""
    if isinstance(value, dict):
        return {k: _round_numbers(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_round_numbers(v) for v in value]
    return float(f"{value:.4g}") if isinstance(value, float) else value


def main() -> None:
    """Draw, run, print and write."""
    args = argparse.ArgumentParser(description=__doc__)
    args.add_argument("--draws", type=int, default=60)
    args.add_argument("--seed", type=int, default=1)
    args.add_argument("--out", type=Path, default=OUT)
    given = args.parse_args()
    rows, failed = [], []
    inputs = {kind: draw_inputs(ranges, given.draws, given.seed) for kind, ranges in SETS.items()}
    for kind, points in inputs.items():
        for n, x in enumerate(points):
            for speed, law, beside in itertools.product(SPEEDS, LAWS, BESIDE):
                name = {"set": kind, "draw": n, "speed": speed, "law": law, "beside": beside}
                try:
                    found = measure(x, law, beside == BESIDE[1], speed)
                except SolverFailure as fault:
                    failed.append(name | {"why": str(fault)})
                    continue
                rows.append(name | heating_effects(found) | found | {"inputs": x})
    said = summary(rows)
    for one in said:
        print(json.dumps(one))
    kept = [{k: v for k, v in row.items() if k != "inputs"} for row in rows]
    answer = {
        "ranges": SETS, "pressures_Pa": PRESSURES, "summary": said, "failed": failed, "inputs": inputs, "rows": kept,
    }  # fmt: skip
    given.out.write_text(json.dumps(_round_numbers(answer), indent=None) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
