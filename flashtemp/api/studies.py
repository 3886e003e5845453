"""Studies of a case by several runs: sweep, convergence, running-in, minimum wait, sensitivity."""

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
    say: Say = ignore_message,
) -> SweepResult:
    """Simulate every combination of several values of a case's keys; one dataset has the keys as dimensions.

    `axes` {"table.key": values}.  `out` saves every finished point, so that the same call continues an interrupted
    sweep.  `workers`: number of processes, one per core when not given; `scheduler`: address of a Dask scheduler to use
    instead.  `watch(done, total)` is called with the progress, `say` with a message for every finished run.  Raises
    BadInput, SolverFailure.
    """
    sweep_plan = case if isinstance(case, SweepPlan) else sweeps.plan_sweep(case, axes or {}, overrides)
    if out is None:
        return sweeps.run_sweep(sweep_plan, None, workers, scheduler, watch, say)
    with sweeps.open_sweep_folder(Path(out), sweep_plan) as work:
        result = sweeps.run_sweep(sweep_plan, work, workers, scheduler, watch, say)
        result.save(work)
        with report_drawing_faults(result, out, "sweep.png", f"flashtemp draw {out}"):
            from flashtemp.viz import theme
            from flashtemp.viz.studies import sweep as picture

            theme.save_figure(picture.draw(result.dataset), work / "sweep.png")
    return result


def converge(case: str | Path | Case, overrides: Overrides | None = None, *, say: Say = ignore_message) -> Convergence:
    """Estimate the order of accuracy and the numerical error of a case from a sequence of refined meshes.

    Raises BadInput, SolverFailure.
    """
    return convergence.estimate_convergence(resolve_case(case, overrides), say)


def repetitions(
    source: str | Path,
    *,
    within: float = 0.01,
    distance: float | None = None,
    of: Literal["friction", "pressure"] = "friction",
) -> RunningInResult:
    """Estimate how many repetitions pass until data are reproducible, by a relaxation over the distance slid.

    `source`: a result folder, or a CSV file with `distance` (m) per repetition.  `within`: the change that may
    remain, as a fraction of the final value.  `of`: the friction, or the unevenness of the pressure (result folder
    only).  Raises BadInput.
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
    """Find the shortest wait between repetitions that keeps the block, or its contact spots, `below` a temperature.

    `below` in degC.  Raises BadInput, SolverFailure.
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
    """Propagate the uncertainty of the inputs to the prediction: variance fractions, 95 % bands and signs.

    `keys`: uncertain inputs with a stated or default standard deviation; all of them when not given.  `samples`:
    number of runs of a Latin hypercube; when not given, sampling is used only where linear propagation is inaccurate.
    `linear`: linear propagation by sensitivities only, without a check of its accuracy.  `out`: folder for the case,
    numbers, run.nc and profile.png with bands; finished runs are saved, so that the same call continues an interrupted
    study.  Raises BadInput, SolverFailure.
    """
    loaded = resolve_case(case, overrides)
    folder = (
        uncertainty_propagation.open_study_folder(Path(out), loaded, keys, samples, linear)
        if out is not None
        else nullcontext()
    )
    with folder as work:
        result = uncertainty_propagation.study_uncertainty(
            loaded, keys, samples, linear, workers, scheduler, watch, say, work
        )
        if work is not None:
            from flashtemp.viz.run import profile
            from flashtemp.viz.studies import sensitivity as picture

            result.save(work)
            picture.draw(result).savefig(work / "sensitivity.png")
            profile.draw(result.run, bands=result.bands).savefig(work / "profile.png")
    return result
