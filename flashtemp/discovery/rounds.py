"""Several models on their way to their best points at once, so that what falls far behind goes no further."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from flashtemp.discovery.calibration import BACK, Descent
from flashtemp.discovery.problem import Problem, checked
from flashtemp.errors import FlashtempError

FAR = "far behind the best"  # why a descent went no further
BESIDES = 0.25  # of what a look promises: what may be gained besides; a peak of the pressure gained 1 % more

Watch = Callable[[str], Any]


def advance(problem: Problem, descents: Sequence[Descent]) -> list[Descent]:
    """One round of several models; all their predictions are shared among the workers."""
    asked = [d.tasks() for d in descents]
    answers = iter(problem.run([t for tasks in asked for t in tasks]))
    out = []
    for d, tasks in zip(descents, asked, strict=True):
        own = [next(answers) for _ in tasks]
        try:
            out.append(d.take([checked(a) for a in own]))
        except FlashtempError as fault:
            if d.best is None or d.back > BACK:
                out.append(replace(d, failed=str(fault)))
            else:
                out.append(d.retreat(d.best.fit))
    return out


def descend(
    problem: Problem, descents: Sequence[Descent], watch: Watch = lambda text: None, hopeless: float = np.inf
) -> list[Descent]:
    """Bring several models to their best points; all predictions of a round are shared among the workers.

    A model that after two rounds, or two steps that lost, promises `hopeless` less than another one has, or after three
    rounds less than another one promises, goes no further; nor does one that promises by far less than one has that
    leaves nothing over.
    """
    now = list(descents)
    while live := [k for k, d in enumerate(now) if not d.done]:
        for k, d in zip(live, advance(problem, [now[k] for k in live]), strict=True):
            now[k] = d
        for k in live:
            if not now[k].done and (_far(now[k], now, hopeless) or _lost(now[k], now, hopeless)):
                now[k] = replace(now[k], failed=FAR)
        watch(f"  round {max((len(now[k].history) for k in live), default=0)}")
    return now


def _lost(descent: Descent, others: Sequence[Descent], hopeless: float) -> bool:
    """Whether a model stays behind one that ended well, whatever that leaves over, if it gains all that it promises and
    a share of it besides, since no tangent reaches far."""
    fit = descent.fit
    if fit is None:
        return False
    reach = fit.ln_evidence + BESIDES * fit.promise
    ends = [d.fit for d in others if d.fit is not None and d.fit.usable and not d.fit.hopeless]
    return any(end.ln_evidence - end.spare - hopeless > reach for end in ends)


def _far(descent: Descent, others: Sequence[Descent], hopeless: float) -> bool:
    """Whether a model lies far behind the best of others, and will."""
    fits = [d.fit for d in others if d.fit is not None]
    rounds = max(len(descent.history), min(descent.back, 2))  # two steps that lose in a row tell as much
    if descent.fit is None or rounds < 2:
        return False
    most = max(f.ln_evidence - (f.promise if rounds < 3 else 0.0) for f in fits)
    return descent.fit.ln_evidence < most - hopeless
