"""Estimate of the cells and the run time of a case before it runs.

A step costs a fixed time and a time per cell.  The number of steps follows from the starts and stops of the schedule
and from effects that limit the step.  Results in the folder tell how fast this computer is.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from flashtemp.errors import FlashtempError
from flashtemp.model.case import Case
from flashtemp.model.effect_laws import EffectLaws

STEPS_PER_PHASE: Final = 200.0  # of the ready cases, at a relative tolerance of 1e-4: 110 to 330
STEP_S: Final = 3e-4  # fixed cost of a step; from the run-in of docs/explanation/performance.md
CELL_STEP_S: Final = 1.2e-7  # cost of a cell in one step
PICTURES_S: Final = 6.0  # drawing the pictures and the animation of a run
MIN_PACED_S: Final = 0.5  # shorter runs tell nothing of the pace: loading and compiling take longer
MAX_SUMMARY_BYTES: Final = 2**20
MAX_RESULTS_READ: Final = 12  # the latest results of a folder


@dataclass(frozen=True)
class CostEstimate:
    """About what a run costs: `cells`, time `steps`, and `seconds` of computing, with `pictures_s` for pictures."""

    cells: int
    steps: float
    seconds: float
    pictures_s: float

    def __str__(self) -> str:
        drawing = " and the pictures" if self.pictures_s else ""
        return f"about {format_seconds(self.seconds + self.pictures_s)} for {self.cells:,} cells{drawing}"


def estimate_cost(case: Case, pace: float = 1.0) -> CostEstimate:
    """The estimate for a checked case on a computer that is slower by the factor `pace` than the reference."""
    steps, cells = estimate_steps(case), case.scene.mesh.n_cells
    seconds = pace * steps * (STEP_S + CELL_STEP_S * cells)
    return CostEstimate(cells, steps, seconds, pace * PICTURES_S if case["output.pictures"] else 0.0)


def estimate_steps(case: Case) -> float:
    """About how many time steps a run takes: some after every start and stop, and more where an effect limits them."""
    scene, steps = case.scene, 0.0
    laws = EffectLaws(scene)
    for phase in scene.schedule.phases:
        try:
            rate = float(laws("march.rate", 0.0, None, scene.law_context(phase, phase.begin)))
        except FlashtempError:  # the run itself says why
            rate = 0.0
        steps += max(STEPS_PER_PHASE, rate * (phase.end - phase.begin) if phase.sliding else 0.0)
    return steps


def measure_pace(summaries: Iterable[Path]) -> float:
    """How much slower this computer is than the reference: the median of finished runs, 1 without any.

    `summaries` are files summary.json; those that are damaged or too large are left out.
    """
    paces = sorted(p for file in summaries if (p := _read_pace(file)) is not None)
    return paces[len(paces) // 2] if paces else 1.0


def latest_summaries(folder: Path, results: Iterable[Path]) -> list[Path]:
    """The summary.json of the latest results of a folder."""
    files = [folder / r / "summary.json" for r in results]
    there = [f for f in files if f.is_file() and not f.is_symlink()]
    return sorted(there, key=lambda f: f.stat().st_mtime)[-MAX_RESULTS_READ:]


def _read_pace(file: Path) -> float | None:
    """Measured over estimated time of a finished run; None where the file does not tell."""
    try:
        if os.path.getsize(file) > MAX_SUMMARY_BYTES:
            return None
        run: Any = json.loads(file.read_text(encoding="utf-8"))
        wall, steps, cells = (float(run[k]) for k in ("wall_s", "steps", "cells"))
        reference = steps * (STEP_S + CELL_STEP_S * cells)
        pace = wall / reference
    except (OSError, ValueError, KeyError, TypeError, ZeroDivisionError, RecursionError):
        return None
    return pace if 1e-3 < pace < 1e3 and reference >= MIN_PACED_S else None


def format_seconds(seconds: float) -> str:
    """A time with one or two digits, as an estimate deserves.

    >>> format_seconds(0.2), format_seconds(13.0), format_seconds(400.0), format_seconds(9000.0)
    ('1 s', '13 s', '7 min', '2.5 h')
    """
    if seconds < 90:
        return f"{max(1, round(seconds))} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.2g} h"
