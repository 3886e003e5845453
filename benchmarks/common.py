"""What the benchmarks share: timing flashtemp in-process, medians, one table."""

from __future__ import annotations

import statistics
import time
from dataclasses import replace

import numpy as np
from scipy.interpolate import PchipInterpolator

from flashtemp.model.case import Case
from flashtemp.solver.march import march


def timed(case: Case, repeat: int):
    """Median CPU seconds of set-up and solve of a case, and a Run of it; compiled beforehand.

    The timed runs keep two profiles a stretch, as the peers do; the Run returned keeps them all.
    """
    run = march(case.scene, case.settings)
    lean, seconds = replace(case.settings, profiles=2, fields=2), []
    for _ in range(repeat):
        began = time.process_time()
        march(case.scene, lean)
        seconds.append(time.process_time() - began)
    return statistics.median(seconds), run


def profile_error(run, x, rise) -> float:
    """Largest error of T(x) at the end in % of the largest rise; x in m, rise in K."""
    T = PchipInterpolator(run.x, run.T_block[run.last], extrapolate=True)(x) - run.ambient_degC
    return 100 * float(np.abs(T - rise).max() / np.max(np.abs(rise)))


def table(rows: list[tuple]) -> None:
    """Print (name, cells, error %, CPU s, ratio) rows."""
    print(f"{'solver':44s} {'cells':>7s} {'error %':>8s} {'CPU s':>8s} {'ratio':>7s}")
    base = rows[0][3]
    for name, cells, error, seconds in rows:
        print(f"{name:44s} {cells:7d} {error:8.3f} {seconds:8.3f} {seconds / base:7.2f}", flush=True)
