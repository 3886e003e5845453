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

from flashtemp.errors import BadInput, FlashtempError, SystemFailure, IncompleteResult, UserInterrupt
from flashtemp.model.case import Case
from flashtemp.runs.results.result_folder import OwnerMarker, check_published_name, reserve_folder, publish_folder, stop_on_signal
from flashtemp.runs.results.worker_pool import stream_results
from flashtemp.display import atomic_write

POINTS_FOLDER, RERUN_HINT = "points", "the same command"
PointArrays = dict[str, np.ndarray]


def run_batch(
    function: Callable[[Case], PointArrays], points: Sequence[Case], work: Path | None = None, workers: int | None = None,
    scheduler: str | None = None, watch: Callable[[int, int], Any] = lambda done, total: None,
    needs: frozenset[str] = frozenset(), last: bool = True,
) -> tuple[list[PointArrays | None], dict[int, str]]:  # fmt: skip
    """Arrays that a `function` gives of every case, None where it fails, and {number: why}.

    What the folder `work` holds already, with all that `needs` names, is not marched again; nothing is kept where there
    is no folder.  Ctrl-C is seen after each point, but not after the last where nothing follows.
    Raises OSError, SolverFailure, Interrupted, KeyboardInterrupt.
    """
    files = [] if work is None else [work / POINTS_FOLDER / f"{_hash_case(p)}.npz" for p in points]
    kept = {i: _load_point(file, needs) for i, file in enumerate(files)}
    found: dict[int, Any] = {i: point for i, point in kept.items() if point is not None}
    todo, count = [i for i in range(len(points)) if i not in found], len(points)
    failed: dict[int, str] = {}
    watch(count - len(todo), count)
    with stop_on_signal() as stopped:
        for n, (k, answer) in enumerate(stream_results(function, [points[i] for i in todo], workers, scheduler), 1):
            if isinstance(answer, FlashtempError):
                failed[todo[k]] = str(answer)
            else:
                found[todo[k]] = answer
                if work is not None:
                    _save_point(files[todo[k]], answer)
            watch(count - len(todo) + n, count)
            if stopped.is_set() and (n < len(todo) or not last):
                raise KeyboardInterrupt if work is None else UserInterrupt(work, RERUN_HINT)
    return [found.get(i) for i in range(count)], failed


@contextmanager
def open_batch_folder(out: Path, command: str, plan: str, plan_text: str, drop: bool = False) -> Iterator[Path]:
    """The folder to work in, renamed to `out` at the end; what is there of the same plan is gone on with.

    `plan_text` is written into the file `plan`; with `drop` neither it nor the points stay in the result.  What cannot be
    gone on with, because no point is there or the input is at fault, is removed.
    Raises BadInput where `out` exists, is being written, or an interrupted run of something else waits for it.
    """
    mine = OwnerMarker(out.name, command, plan, RERUN_HINT)
    with reserve_folder(out, mine, go_on=lambda path: _read_plan(path / plan) == plan_text) as work:
        (work / POINTS_FOLDER).mkdir(exist_ok=True)
        with atomic_write(work / plan) as fresh:
            fresh.write_text(plan_text, encoding="utf-8")
        try:
            yield work
        except (IncompleteResult, UserInterrupt) as fault:
            if isinstance(fault, IncompleteResult) or fault.path != work:  # only the picture
                publish_folder(work, out)
            raise
        except OSError as fault:
            raise SystemFailure(fault, work, RERUN_HINT) from fault
        except BaseException as fault:
            if isinstance(fault, BadInput) or not any((work / POINTS_FOLDER).iterdir()):
                shutil.rmtree(work, ignore_errors=True)
            raise
        lies = publish_folder(work, out, drop=(plan,) if drop else ())
        if drop:
            shutil.rmtree(lies / POINTS_FOLDER)
        check_published_name(out, lies, None)


def _read_plan(plan: Path) -> str:
    """The plan that a folder holds; none where it is none of ours."""
    return plan.read_text(encoding="utf-8", errors="replace") if plan.is_file() else ""


def _hash_case(case: Case) -> str:
    """A name that another case, or other contents of its files, does not have."""
    seen = hashlib.sha256(case.toml().encode())
    for _, file in sorted(case.named_files().items()):
        seen.update((case.folder / file).read_bytes())
    return seen.hexdigest()[:20]


def _save_point(file: Path, answer: dict[str, Any]) -> None:
    """Write a point whole or not at all."""
    with atomic_write(file) as fresh:
        np.savez_compressed(fresh, **answer)


def _load_point(file: Path, needs: frozenset[str]) -> PointArrays | None:
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
