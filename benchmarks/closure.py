"""Averaged spots (Level H) against resolved ones (Level R): error of the closure, and flash factor to correct it.

    python benchmarks/closure.py             six patterns per point, 6 cells per diameter
    python benchmarks/closure.py --only 0 3  these points only
    python benchmarks/closure.py --cells     the first point and pattern with 6, 9, 12 and 18 cells per diameter

Both levels have the same block, load and time.  The resolved one is averaged over the second half of the slid distance:
by area (equal weight for every covered place and moment) and by load (equal weight for every moment).
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from common import ErrorRow

from flashtemp.errors import SolverFailure
from flashtemp.model.case import load_case
from flashtemp.model.numerics import installed_bindings
from flashtemp.solver.time_integration import integrate_schedule

POINTS = [  # speed m/s, diameter m, fraction
    (0.1, 3e-3, 0.2), (0.03, 3e-3, 0.2), (0.3, 3e-3, 0.2), (1.0, 3e-3, 0.2), (0.1, 1.5e-3, 0.2), (0.1, 6e-3, 0.2),
    (0.1, 3e-3, 0.1), (0.1, 3e-3, 0.35),
]  # fmt: skip
PATTERNS = [("random", 1), ("random", 2), ("random", 3), ("random", 4), ("regular", 1), ("stripes", 1)]
FINE = 6  # cells per diameter: one disc is then within 0.5 % (tests/solver/test_road_frame.py)
PASSES = 3  # of the block's length


def case_overrides(v: float, D: float, phi: float, pattern: tuple[str, int] | None, fine: int) -> dict:
    """Overrides: averaged where there is no pattern, else resolved by `fine` cells per diameter."""
    width = 4 * D
    given = {
        "schedule.speed": v, "schedule.distance": PASSES * 0.025,
        "contact.spot_fraction": phi, "contact.spot_diameter": D,
        "block.width": width, "block.height": 4e-3, "road.upstream": 0.0, "road.downstream": 0.0,
        "ambient.convection": 0.0, "numerics.rtol": 1e-3, "numerics.cells": [round(0.025 / D * fine), 18, 26],
        "numerics.first_x": D / fine, "numerics.last_x": D / fine,
        "numerics.first_block": 5e-6, "numerics.first_road": 5e-6,
        "output.fields": 25, "output.profiles": 25, "numerics.integrator": installed_bindings()[-1],
    }  # fmt: skip
    if pattern is None:
        return given | {"effects": [], "numerics.cells": [60, 18, 26]}
    kind, seed = pattern
    return given | {"effects": ["resolved_spots"], "resolved_spots.pattern": kind, "resolved_spots.seed": seed,
                    "resolved_spots.repeat": 0.05, "numerics.across": 2 if kind == "stripes" else 4 * fine}  # fmt: skip


def run_case(given: dict):
    made = load_case("cases/uniform_pressure", given)
    return integrate_schedule(made.scene, made.settings)


def mean_rises(run) -> np.ndarray:
    """Mean rise of face, spots by area, spots by load, and heat partition to the road, in the second half."""
    late = run.time[run.frames] > 0.5 * run.time[-1]
    at, dx = run.frames[late], run.mesh.dx_block / run.mesh.dx_block.sum()
    face = (run.T_block[at] @ dx).mean() - run.ambient_degC
    if run.maps:  # even cells along and across
        spot, cover = (run.maps[name][late].reshape(len(at), -1) for name in ("T_spot", "cover"))
    else:
        spot, cover = run.T_spot[at], np.tile(dx, (len(at), 1))
    heat = run.energy["friction"][-1] - run.energy["friction"][at[0]]
    road = (run.energy["into_road"][-1] - run.energy["into_road"][at[0]]) / heat
    means = (cover * spot).sum(axis=1) / cover.sum(axis=1)
    by_area = (means * cover.sum(axis=1)).sum() / cover.sum()
    return np.array([face, by_area - run.ambient_degC, means.mean() - run.ambient_degC, road])


def try_mean_rises(given: dict) -> np.ndarray:
    """Mean rises; NaN where at some time no spot is under the block."""
    try:
        return mean_rises(run_case(given))
    except SolverFailure as fault:
        if "no spot" not in str(fault):
            raise
        return np.full(4, np.nan)


def compare_levels(v: float, D: float, phi: float, patterns, fine: int) -> np.ndarray:
    """Print a row; the flash factors (patterns, 2), by area and by load, that give the averaged spots the same gap.

    A square lattice is left out of the means: its spots follow each other in the same lanes, unlike those of a road.
    """
    face, spot, _, road = mean_rises(run_case(case_overrides(v, D, phi, None, fine)))
    found = np.array([try_mean_rises(case_overrides(v, D, phi, one, fine)) for one in patterns])
    like = [kind != "regular" for kind, _ in patterns]
    rf, rs, _, rr = np.nanmean(found[like], axis=0)
    factors = (found[:, 1:3] - found[:, :1]) / (spot - face)
    middle, spread = np.nanmean(factors[like], axis=0), np.nanstd(factors[like], axis=0)
    each = " ".join(f"{f:.2f}" for f in factors[:, 1])
    print(
        f"{v:6.2f} {1e3 * D:5.1f} {phi:5.2f} {fine:6d} | {face:6.2f} {spot:6.2f} {100 * road:5.1f} | "
        f"{rf:6.2f} {rs:6.2f} {100 * rr:5.1f} | {100 * (spot / rs - 1):7.1f} | "
        f"{middle[0]:.2f} +- {spread[0]:.2f}  {middle[1]:.2f} +- {spread[1]:.2f} | {each}",
        flush=True,
    )
    return factors  # (patterns, 2), of all


def small_rows() -> list[ErrorRow]:
    """Large stripes, four cells per diameter: the flash factor is 1 within 25 %."""
    began = time.process_time()
    [[_, by_load]] = compare_levels(*POINTS[5], PATTERNS[-1:], 4)
    return [
        ErrorRow("flash factor of stripes, off 1", 0, 100.0 * abs(by_load - 1.0), 25.0, time.process_time() - began)
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", type=int, nargs="*", default=range(len(POINTS)))
    parser.add_argument("--cells", action="store_true")
    options = parser.parse_args()
    print(" v m/s  D mm   phi  cells |  averaged: face, |  resolved: face, | spots, | flash factor                |")
    print(
        "                    per D | spots K,  road % | spots K,  road % | H to R | by area       by load       | each"
    )
    if options.cells:
        for fine in (6, 9, 12, 18):
            compare_levels(*POINTS[0], PATTERNS[:1], fine)
        return
    chosen = [POINTS[k] for k in options.only]
    factors = np.array([compare_levels(v, D, phi, PATTERNS, FINE) for v, D, phi in chosen])
    factors = factors[:, [kind != "regular" for kind, _ in PATTERNS]]
    means, scatter = np.nanmean(factors, axis=(0, 1)), np.nanmean(factors, axis=1).std(axis=0)
    print(f"flash factor by area {means[0]:.2f}, by load {means[1]:.2f}; points scatter by {scatter[0]:.2f}, "
          f"patterns by {np.nanstd(factors, axis=1).mean():.2f}; square lattice left out")  # fmt: skip


if __name__ == "__main__":
    main()
