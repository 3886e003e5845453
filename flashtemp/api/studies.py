"""Studies that march a case more than once: sweep, converge, repetitions, wait, sensitivity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any, Literal

from flashtemp.api.inputs import Count, Overrides, Say, case_of, silent, uncounted
from flashtemp.api.pictures import drawing
from flashtemp.model.case import Case
from flashtemp.runs import convergence, prediction_band, running_in, wait_time
from flashtemp.runs import sweep as sweeps
from flashtemp.runs.convergence import Convergence
from flashtemp.runs.running_in import Settling
from flashtemp.runs.sensitivity_result import Sensitivity
from flashtemp.runs.sweep import Sweep, Swept
from flashtemp.runs.wait_time import Waiting


def sweep(
    case: str | Path | Case | Sweep,
    axes: Mapping[str, Sequence[Any]] | None = None,
    overrides: Overrides | None = None,
    *,
    out: str | Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    watch: Count = uncounted,
) -> Swept:
    """A case over several values of its keys, every combination: one dataset with the keys as dimensions.

    `axes` {"table.key": values}; `out` keeps every point, so that the same call goes on with an interrupted sweep.
    Raises BadInput, SolverFailure.
    """
    asked = case if isinstance(case, Sweep) else sweeps.plan(case, axes or {}, overrides)
    if out is None:
        return sweeps.carry_out(asked, None, workers, scheduler, watch)
    with sweeps.folder(Path(out), asked) as work:
        found = sweeps.carry_out(asked, work, workers, scheduler, watch)
        found.save(work)
        with drawing(found, out, "sweep.png", f"flashtemp draw {out}"):
            from flashtemp.viz import sweep as picture
            from flashtemp.viz import theme

            theme.save(picture.draw(found.dataset), work / "sweep.png")
    return found


def converge(case: str | Path | Case, overrides: Overrides | None = None, *, say: Say = silent) -> Convergence:
    """Observed order of accuracy and error estimate of a case, by refining it.  Raises BadInput, SolverFailure."""
    return convergence.converge(case_of(case, overrides), say)


def repetitions(
    source: str | Path,
    *,
    within: float = 0.01,
    distance: float | None = None,
    of: Literal["friction", "pressure"] = "friction",
) -> Settling:
    """How many repetitions until data are reproducible: relaxation over the distance slid, with its uncertainty.

    `source`: a result folder, or a CSV file with `distance` m per repetition; `within` is what may remain of the
    change, as a share of the final value.  Raises BadInput.
    """
    return running_in.settling(source, within, distance, of)


def wait(
    case: str | Path | Case,
    overrides: Overrides | None = None,
    *,
    below: float,
    of: Literal["block", "spot"] = "block",
    say: Say = silent,
) -> Waiting:
    """The shortest wait between repetitions that keeps the block, or its spots, below a temperature in degC.

    Raises BadInput, SolverFailure.
    """
    return wait_time.shortest(case_of(case, overrides), below, of, say)


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
    watch: Count = uncounted,
    say: Say = silent,
) -> Sensitivity:
    """What every input does to a prediction, and how sure it is: shares of the variance, 95 % bands, signs.

    `keys`: inputs of which a standard deviation is stated or usual, all of them when not given.  `samples`: runs of a
    Latin hypercube, without it only where the linear part does not hold; `linear`: traces alone, untried.
    `out`: folder for the case, numbers, run.nc and profile.png with bands; runs of a sample are kept, so that the same
    call goes on with an interrupted one.  Raises BadInput, SolverFailure.
    """
    loaded = case_of(case, overrides)
    place = prediction_band.folder(Path(out), loaded, keys, samples, linear) if out is not None else nullcontext()
    with place as work:
        found = prediction_band.study(loaded, keys, samples, linear, workers, scheduler, watch, say, work)
        if work is not None:
            from flashtemp.viz import profile
            from flashtemp.viz import sensitivity as picture

            found.save(work)
            picture.draw(found).savefig(work / "sensitivity.png")
            profile.draw(found.run, bands=found.bands).savefig(work / "profile.png")
    return found
