"""Studies that march a case more than once: sweep, converge, repetitions, wait, sensitivity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any, Literal

from flashtemp.api.inputs import Count, Overrides, Say, ignore_message, ignore_progress, resolve_case
from flashtemp.api.picture_faults import report_drawing_faults
from flashtemp.model.case import Case
from flashtemp.runs.studies import convergence, running_in, uncertainty_propagation, wait_time
from flashtemp.runs.studies import sweep as sweeps
from flashtemp.runs.studies.convergence import Convergence
from flashtemp.runs.studies.running_in import RunningInResult
from flashtemp.runs.studies.sensitivity_result import SensitivityResult
from flashtemp.runs.studies.sweep import SweepPlan, SweepResult
from flashtemp.runs.studies.wait_time import WaitResult


def sweep(
    case: str | Path | Case | SweepPlan,
    axes: Mapping[str, Sequence[Any]] | None = None,
    overrides: Overrides | None = None,
    *,
    out: str | Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    watch: Count = ignore_progress,
) -> SweepResult:
    """A case over several values of its keys, every combination: one dataset with the keys as dimensions.

    `axes` {"table.key": values}; `out` keeps every point, so that the same call goes on with an interrupted sweep.
    Raises BadInput, SolverFailure.
    """
    asked = case if isinstance(case, SweepPlan) else sweeps.plan_sweep(case, axes or {}, overrides)
    if out is None:
        return sweeps.run_sweep(asked, None, workers, scheduler, watch)
    with sweeps.open_sweep_folder(Path(out), asked) as work:
        found = sweeps.run_sweep(asked, work, workers, scheduler, watch)
        found.save(work)
        with report_drawing_faults(found, out, "sweep.png", f"flashtemp draw {out}"):
            from flashtemp.viz import theme
            from flashtemp.viz.studies import sweep as picture

            theme.save_figure(picture.draw(found.dataset), work / "sweep.png")
    return found


def converge(case: str | Path | Case, overrides: Overrides | None = None, *, say: Say = ignore_message) -> Convergence:
    """Observed order of accuracy and error estimate of a case, by refining it.  Raises BadInput, SolverFailure."""
    return convergence.estimate_convergence(resolve_case(case, overrides), say)


def repetitions(
    source: str | Path,
    *,
    within: float = 0.01,
    distance: float | None = None,
    of: Literal["friction", "pressure"] = "friction",
) -> RunningInResult:
    """How many repetitions until data are reproducible: relaxation over the distance slid, with its uncertainty.

    `source`: a result folder, or a CSV file with `distance` m per repetition; `within` is what may remain of the
    change, as a share of the final value.  Raises BadInput.
    """
    return running_in.analyse_running_in(source, within, distance, of)


def wait(
    case: str | Path | Case,
    overrides: Overrides | None = None,
    *,
    below: float,
    of: Literal["block", "spot"] = "block",
    say: Say = ignore_message,
) -> WaitResult:
    """The shortest wait between repetitions that keeps the block, or its spots, below a temperature in degC.

    Raises BadInput, SolverFailure.
    """
    return wait_time.find_minimum_wait(resolve_case(case, overrides), below, of, say)


def sensitivity(
    case: str | Path | Case,
    keys: Sequence[str] | None = None,
    overrides: Overrides | None = None,
    *,
    samples: int | None = None,
    linear: bool = False,
    out: str | Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    watch: Count = ignore_progress,
    say: Say = ignore_message,
) -> SensitivityResult:
    """What every input does to a prediction, and how sure it is: shares of the variance, 95 % bands, signs.

    `keys`: inputs of which a standard deviation is stated or usual, all of them when not given.  `samples`: runs of a
    Latin hypercube, without it only where the linear part does not hold; `linear`: traces alone, untried.
    `out`: folder for the case, numbers, run.nc and profile.png with bands; runs of a sample are kept, so that the same
    call goes on with an interrupted one.  Raises BadInput, SolverFailure.
    """
    loaded = resolve_case(case, overrides)
    place = (
        uncertainty_propagation.open_study_folder(Path(out), loaded, keys, samples, linear)
        if out is not None
        else nullcontext()
    )
    with place as work:
        found = uncertainty_propagation.study_uncertainty(
            loaded, keys, samples, linear, workers, scheduler, watch, say, work
        )
        if work is not None:
            from flashtemp.viz.run import profile
            from flashtemp.viz.studies import sensitivity as picture

            found.save(work)
            picture.draw(found).savefig(work / "sensitivity.png")
            profile.draw(found.run, bands=found.bands).savefig(work / "profile.png")
    return found
