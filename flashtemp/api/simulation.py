"""Simulate a case, with its pictures."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from flashtemp.model.case import Case
from flashtemp.runs import job
from flashtemp.solver.march import Progress
from flashtemp.solver.run import Run


def simulate(
    case: Case,
    out: Path | None = None,
    overwrite: bool = False,
    pvd: bool = False,
    watch: Callable[[Progress, float], None] | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> Run:
    """March a case and, with `out`, leave a whole result folder with pictures there.

    `watch(progress, end)` is told about every step.  Raises BadInput when `out` exists,
    Interrupted after Ctrl-C with a checkpoint in `out`.partial, SolverFailure.
    """
    return job.simulate(case, out, overwrite, pvd, watch, say, _draw)


def resume(
    folder: Path,
    pvd: bool = False,
    watch: Callable[[Progress, float], None] | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> Run:
    """Go on with an interrupted run from its checkpoint.  Raises BadInput, Interrupted, SolverFailure."""
    return job.resume(folder, pvd, watch, say, _draw)


def _draw(run: Run, folder: Path, animated: bool, say: Callable[[str], None]) -> None:
    """Pictures of a run and, where something moves in it, its animations."""
    from flashtemp import viz

    say("drawing pictures")
    viz.draw_all(run, folder)
    if animated and any(viz.applies(module, run) for module in viz.ANIMATIONS):
        say("drawing the animation")
        viz.animate(run, folder)
