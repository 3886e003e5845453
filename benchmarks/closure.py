"""Averaged spots (Level H) against resolved ones (Level R): error of the closure, and the flash factor that mends it.

    python benchmarks/closure.py             2 seeds of random patterns per point, 9 cells per diameter, five minutes
    python benchmarks/closure.py --cells     the first point with 6, 9, 12 and 18 cells per diameter

Both levels see the same block, load and time; the resolved one is averaged over the second half of the slid distance.
"""

from __future__ import annotations

import argparse

import numpy as np

from flashtemp.model.case import load
from flashtemp.model.numerics import available
from flashtemp.solver.march import march

POINTS = [  # speed m/s, diameter m, fraction
    (0.1, 3e-3, 0.2), (0.03, 3e-3, 0.2), (0.3, 3e-3, 0.2), (1.0, 3e-3, 0.2), (0.1, 1.5e-3, 0.2), (0.1, 6e-3, 0.2),
    (0.1, 3e-3, 0.1), (0.1, 3e-3, 0.35),
]  # fmt: skip
FINE = 9  # cells per diameter
PASSES = 3  # of the block's length


def case(v: float, D: float, phi: float, seed: int | None, fine: int) -> dict:
    """Overrides: averaged where there is no seed, else resolved by `fine` cells per diameter."""
    width = 4 * D
    given = {
        "schedule.speed": v, "schedule.distance": PASSES * 0.025,
        "contact.spot_fraction": phi, "contact.spot_diameter": D,
        "block.width": width, "block.height": 4e-3, "road.upstream": 0.0, "road.downstream": 0.0,
        "ambient.convection": 0.0, "numerics.rtol": 1e-3, "numerics.cells": [max(round(0.025 / D * fine), 60), 18, 26],
        "numerics.first_x": D / fine, "numerics.last_x": D / fine,
        "numerics.first_block": 5e-6, "numerics.first_road": 5e-6,
        "output.fields": 25, "output.profiles": 25, "numerics.integrator": available()[-1],
    }  # fmt: skip
    if seed is None:
        return given | {"effects": []}
    return given | {"effects": ["resolved_spots"], "resolved_spots.seed": seed, "resolved_spots.repeat": 0.05,
                    "numerics.across": 4 * fine}  # fmt: skip


def go(given: dict):
    made = load("cases/uniform_pressure", given)
    return march(made.scene, made.settings)


def seen(run) -> tuple[float, float, float]:
    """Mean rise of face and spots, and the share of the heat that the road takes, over the second half."""
    late = run.time[run.frames] > 0.5 * run.time[-1]
    at, dx = run.frames[late], run.mesh.dx_block / run.mesh.dx_block.sum()
    face = (run.T_block[at] @ dx).mean() - run.ambient_degC
    if run.maps:
        cover = run.maps["cover"][late]
        spot = (cover * run.maps["T_spot"][late]).sum() / cover.sum() - run.ambient_degC
    else:
        spot = (run.T_spot[at] @ dx).mean() - run.ambient_degC
    heat = run.energy["friction"][-1] - run.energy["friction"][at[0]]
    return face, spot, (run.energy["into_road"][-1] - run.energy["into_road"][at[0]]) / heat


def compare(v: float, D: float, phi: float, seeds: int, fine: int) -> float:
    """Print a row; the flash factor with which the averaged spots would have the gap of the resolved ones."""
    face, spot, road = seen(go(case(v, D, phi, None, fine)))
    found = np.array([seen(go(case(v, D, phi, s, fine))) for s in range(1, seeds + 1)])
    rf, rs, rr = found.mean(axis=0)
    gaps = found[:, 1] - found[:, 0]
    factor, spread = gaps.mean() / (spot - face), gaps.std() / (spot - face)
    print(
        f"{v:6.2f} {1e3 * D:5.1f} {phi:5.2f} {fine:6d} | {face:6.2f} {spot:6.2f} {100 * road:5.1f} | "
        f"{rf:6.2f} {rs:6.2f} {100 * rr:5.1f} | "
        f"{100 * (spot / rs - 1):8.1f} {100 / factor - 100:7.0f}   {factor:.2f} +- {spread:.2f}",
        flush=True,
    )
    return factor


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--cells", action="store_true")
    options = parser.parse_args()
    print(" v m/s  D mm   phi  cells |  averaged: face, |  resolved: face, | averaged over resolved:")
    print("                    per D | spots K,  road % | spots K,  road % | spots %   gap %   flash factor")
    if options.cells:
        for fine in (6, 9, 12, 18):
            compare(*POINTS[0], options.seeds, fine)
        return
    factors = [compare(*point, options.seeds, FINE) for point in POINTS]
    print(f"flash factor {np.mean(factors):.2f}, scatter {np.std(factors, ddof=1):.2f}")


if __name__ == "__main__":
    main()
