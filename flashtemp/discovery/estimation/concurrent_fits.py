"""Several fits at the same time: one batch of simulations for each round, and no more of fits that stay behind."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from flashtemp.discovery.estimation.fitting import Answers, FitGenerator, ProgressCallback, SimulationRequest
from flashtemp.discovery.estimation.linearised_fit import FitStatus, LinearisedFit
from flashtemp.discovery.prediction.problem import Problem
from flashtemp.display import ProgressMessage
from flashtemp.errors import FlashtempError

OUTRUN_DEFICIT = 30.0  # ln evidence behind another hypothesis, predicted gain included, from which a fit is stopped
PROMISE_FACTOR = 2.0  # a nonlinear model may gain as many times what its linearised model predicts


@dataclass(frozen=True)
class FitOutcome:
    """Results of several fits by key: `fits` of those that could be simulated, `failed` with the reason of others."""

    fits: dict[Any, LinearisedFit] = field(default_factory=dict)
    failed: dict[Any, str] = field(default_factory=dict)


def run_fits(
    problem: Problem,
    fittings: Mapping[Any, FitGenerator],
    watch: ProgressCallback = lambda text: None,
    least: float = -np.inf,
) -> FitOutcome:
    """Run several fits until all end, with the simulations of each round in one batch for the workers.

    A fit that cannot reach the best finished one, or the ln evidence `least`, is stopped with `FitStatus.OUTRUN`.
    """
    live: dict[Any, tuple[FitGenerator, SimulationRequest]] = {}
    fits: dict[Any, LinearisedFit] = {}
    failed: dict[Any, str] = {}

    def advance_fit(key: Any, fitting: FitGenerator, answers: Answers | None) -> None:
        try:
            request = next(fitting) if answers is None else fitting.send(answers)
            live[key] = fitting, request
        except StopIteration as end:
            fits[key] = end.value
        except FlashtempError as fault:
            failed[key] = str(fault)

    for key, fitting in fittings.items():
        advance_fit(key, fitting, None)
    rounds = 0
    while live:
        goal = max([least, *(f.ln_evidence - OUTRUN_DEFICIT for f in fits.values())])
        for key, (fitting, request) in list(live.items()):
            if request.best is not None and _is_outrun(request.best, goal):
                fitting.close()
                fits[key] = replace(request.best, status=FitStatus.OUTRUN)
                del live[key]
        # all fits of a round are simulated together, so that one batch keeps every worker busy
        pending = list(live.items())
        live.clear()
        answers = iter(problem.run([t for _, (_, request) in pending for t in request.tasks]))
        for key, (fitting, request) in pending:
            advance_fit(key, fitting, [next(answers) for _ in request.tasks])
        rounds += 1
        if live:
            begun = {key: request.best for key, (_, request) in live.items() if request.best is not None}
            watch(ProgressMessage(f"  evaluation {rounds}", evaluation=rounds, running=_describe_fits(begun, fits)))
    return FitOutcome(fits, failed)


def describe_fit(names: Iterable[str], fit: LinearisedFit, is_running: bool = False) -> dict[str, Any]:
    """The state of a fit with these effects as plain data."""
    state = "fitting" if is_running else fit.status.value
    return {"effects": sorted(names), "ln_evidence": fit.secured_evidence, "state": state}


def _describe_fits(begun: Mapping[Any, LinearisedFit], ended: Mapping[Any, LinearisedFit]) -> list[dict[str, Any]]:
    """The states of fits that are begun and ended; a fit whose key is not a set of effects is left out."""
    return [
        describe_fit(names, fit, is_running)
        for group, is_running in ((begun, True), (ended, False))
        for names, fit in group.items()
        if names and isinstance(names, frozenset)
    ]


def lowest_score_within_reach(best: float) -> float:
    """The linearised ln Bayes factor above which a full fit may turn out better than the one with the `best` score.

    It is the rule by which a running fit is stopped (`_is_outrun`), for a fit that has not begun.
    """
    return (best - OUTRUN_DEFICIT) / PROMISE_FACTOR


def _is_outrun(fit: LinearisedFit, goal: float) -> bool:
    """Whether a fit stays below the ln evidence `goal` even if it gains PROMISE_FACTOR times its predicted gain."""
    return fit.ln_evidence + (PROMISE_FACTOR - 1.0) * fit.promise < goal
