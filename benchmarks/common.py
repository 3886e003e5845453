"""Shared code of the benchmarks: CPU times, medians, and a table of errors against stated errors."""

from __future__ import annotations

import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import PchipInterpolator

from flashtemp.model.case import Case
from flashtemp.solver.time_integration import integrate_schedule


def time_call(function, repeat: int):
    """Median CPU seconds of a call, and its result."""
    spent = []
    for _ in range(repeat):
        began = time.process_time()
        found = function()
        spent.append(time.process_time() - began)
    return statistics.median(spent), found


def time_run(case: Case, repeat: int):
    """Median CPU seconds of set-up and solve of a case, and its Run; kernels are compiled beforehand.

    The timed runs keep two profiles per phase, as the peers do; the returned Run keeps all.
    """
    run = integrate_schedule(case.scene, case.settings)
    lean, seconds = replace(case.settings, profiles=2, fields=2), []
    for _ in range(repeat):
        began = time.process_time()
        integrate_schedule(case.scene, lean)
        seconds.append(time.process_time() - began)
    return statistics.median(seconds), run


def profile_error(run, x, rise) -> float:
    """Largest error of T(x) at the end in % of the largest rise; x in m, rise in K."""
    T = PchipInterpolator(run.x, run.T_block[run.last_sliding_index], extrapolate=True)(x) - run.ambient_degC
    return 100 * float(np.abs(T - rise).max() / np.max(np.abs(rise)))


@dataclass(frozen=True)
class ErrorRow:
    """Cost of one solver, its error in % of the largest rise, and the stated error that it must stay below."""

    name: str
    cells: int
    error: float
    limit: float
    seconds: float

    @property
    def is_beyond_limit(self) -> bool:
        return not self.error <= self.limit


def print_rows(rows: Sequence[ErrorRow]) -> int:
    """Print the rows and mark those beyond their stated error; return 1 if there are any, else 0."""
    print(f"{'solver':44s} {'cells':>7s} {'error %':>8s} {'stated':>7s} {'CPU s':>8s} {'ratio':>7s}")
    for row in rows:
        mark = "  BEYOND ITS STATED ERROR" if row.is_beyond_limit else ""
        print(f"{row.name:44s} {row.cells:7d} {row.error:8.3f} {row.limit:7.3g} {row.seconds:8.3f} "
              f"{row.seconds / rows[0].seconds:7.2f}{mark}", flush=True)  # fmt: skip
    return int(any(row.is_beyond_limit for row in rows))
