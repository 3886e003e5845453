"""Many cases, each marched once and kept in a file as soon as it is there, so that the same command goes on."""

from __future__ import annotations

import hashlib
import shutil
import zipfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.errors import BadInput, FlashtempError, Halted, Incomplete, Interrupted
from flashtemp.model.case import Case
from flashtemp.runs.folders import Owner, check_place, claim, place, stoppable
from flashtemp.runs.workers import stream
from flashtemp.showing import whole_file

POINTS, AGAIN = "points", "the same command"
Answer = dict[str, np.ndarray]


def computed(
    function: Callable[[Case], Answer], points: Sequence[Case], work: Path | None = None, workers: int | None = None,
    scheduler: str | None = None, watch: Callable[[int, int], Any] = lambda done, total: None,
    needs: frozenset[str] = frozenset(), last: bool = True,
) -> tuple[list[Answer | None], dict[int, str]]:  # fmt: skip
    """Arrays that a `function` gives of every case, None where it fails, and {number: why}.

    What the folder `work` holds already, with all that `needs` names, is not marched again; nothing is kept where there
    is no folder.  Ctrl-C is seen after each point, but not after the last where nothing follows.
    Raises OSError, SolverFailure, Interrupted, KeyboardInterrupt.
    """
    files = [] if work is None else [work / POINTS / f"{_name(p)}.npz" for p in points]
    kept = {i: _held(file, needs) for i, file in enumerate(files)}
    found: dict[int, Any] = {i: point for i, point in kept.items() if point is not None}
    todo, count = [i for i in range(len(points)) if i not in found], len(points)
    failed: dict[int, str] = {}
    watch(count - len(todo), count)
    with stoppable() as stopped:
        for n, (k, answer) in enumerate(stream(function, [points[i] for i in todo], workers, scheduler), 1):
            if isinstance(answer, FlashtempError):
                failed[todo[k]] = str(answer)
            else:
                found[todo[k]] = answer
                if work is not None:
                    _keep(files[todo[k]], answer)
            watch(count - len(todo) + n, count)
            if stopped.is_set() and (n < len(todo) or not last):
                raise KeyboardInterrupt if work is None else Interrupted(work, AGAIN)
    return [found.get(i) for i in range(count)], failed


@contextmanager
def resumable(out: Path, command: str, plan: str, told: str, drop: bool = False) -> Iterator[Path]:
    """The folder to work in, renamed to `out` at the end; what is there of the same plan is gone on with.

    `told` is written into the file `plan`; with `drop` neither it nor the points stay in the result.  What cannot be
    gone on with, because no point is there or the input is at fault, is removed.
    Raises BadInput where `out` exists, is being written, or an interrupted run of something else waits for it.
    """
    mine = Owner(out.name, command, plan, AGAIN)
    with claim(out, mine, go_on=lambda path: _told(path / plan) == told) as work:
        (work / POINTS).mkdir(exist_ok=True)
        with whole_file(work / plan) as fresh:
            fresh.write_text(told, encoding="utf-8")
        try:
            yield work
        except (Incomplete, Interrupted) as fault:
            if isinstance(fault, Incomplete) or fault.path != work:  # only the picture
                place(work, out)
            raise
        except OSError as fault:
            raise Halted(fault, work, AGAIN) from fault
        except BaseException as fault:
            if isinstance(fault, BadInput) or not any((work / POINTS).iterdir()):
                shutil.rmtree(work, ignore_errors=True)
            raise
        lies = place(work, out, drop=(plan,) if drop else ())
        if drop:
            shutil.rmtree(lies / POINTS)
        check_place(out, lies, None)


def _told(plan: Path) -> str:
    """The plan that a folder holds; none where it is none of ours."""
    return plan.read_text(encoding="utf-8", errors="replace") if plan.is_file() else ""


def _name(case: Case) -> str:
    """A name that another case, or other contents of its files, does not have."""
    seen = hashlib.sha256(case.toml().encode())
    for _, file in sorted(case.files().items()):
        seen.update((case.folder / file).read_bytes())
    return seen.hexdigest()[:20]


def _keep(file: Path, answer: dict[str, Any]) -> None:
    """Write a point whole or not at all."""
    with whole_file(file) as fresh:
        np.savez_compressed(fresh, **answer)


def _held(file: Path, needs: frozenset[str]) -> Answer | None:
    """A point that is kept already; None where it is not there, or damaged."""
    try:
        with zipfile.ZipFile(file) as whole:
            if whole.testzip() is not None:
                return None
        with np.load(file) as held:
            found = dict(held)
    except Exception:  # whatever damage makes of it, it is marched again
        return None
    return found if needs <= {*found} else None
