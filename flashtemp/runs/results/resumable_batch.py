"""Batches of runs that can be continued: every finished run is saved at once, and the same command skips it."""

from __future__ import annotations

import hashlib
import shutil
import zipfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.display import atomic_write
from flashtemp.errors import BadInput, FlashtempError, IncompleteResult, SystemFailure, UserInterrupt
from flashtemp.model.case import Case
from flashtemp.runs.results.result_folder import (
    OwnerMarker,
    check_published_name,
    publish_folder,
    reserve_folder,
    stop_on_signal,
)
from flashtemp.runs.results.worker_pool import stream_results

POINTS_FOLDER, RERUN_HINT = "points", "the same command"
PointArrays = dict[str, np.ndarray]


def run_batch(
    function: Callable[[Case], PointArrays],
    points: Sequence[Case],
    work: Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    watch: Callable[[int, int], Any] = lambda done, total: None,
    needs: frozenset[str] = frozenset(),
    last: bool = True,
    report: Callable[[int, PointArrays], Any] = lambda index, answer: None,
) -> tuple[list[PointArrays | None], dict[int, str]]:
    """The arrays that `function` returns for every case, None where it fails, and {index: error message}.

    A case is not run again if the folder `work` contains its result with all arrays in `needs`; without a folder
    nothing is saved.  Ctrl-C takes effect after each case, but not after the final one if this batch is the `last`.
    `report(index, answer)` is called for every case that is done, at once where it is saved.
    Raises OSError, SolverFailure, UserInterrupt, KeyboardInterrupt.
    """
    files = [] if work is None else [work / POINTS_FOLDER / f"{_hash_case(p)}.npz" for p in points]
    saved = {i: _load_point(file, needs) for i, file in enumerate(files)}
    results: dict[int, Any] = {i: point for i, point in saved.items() if point is not None}
    todo, count = [i for i in range(len(points)) if i not in results], len(points)
    failed: dict[int, str] = {}
    for i, point in results.items():
        report(i, point)
    watch(count - len(todo), count)
    with stop_on_signal() as stopped:
        for n, (k, answer) in enumerate(stream_results(function, [points[i] for i in todo], workers, scheduler), 1):
            if isinstance(answer, FlashtempError):
                failed[todo[k]] = str(answer)
            else:
                results[todo[k]] = answer
                if work is not None:
                    _save_point(files[todo[k]], answer)
                report(todo[k], answer)
            watch(count - len(todo) + n, count)
            if stopped.is_set() and (n < len(todo) or not last):
                raise KeyboardInterrupt if work is None else UserInterrupt(work, RERUN_HINT)
    return [results.get(i) for i in range(count)], failed


@contextmanager
def open_batch_folder(out: Path, command: str, plan: str, plan_text: str, drop: bool = False) -> Iterator[Path]:
    """Yield the working folder, renamed to `out` at the end; an interrupted batch with the same plan is continued.

    `plan_text` is written to the file `plan`; with `drop` neither this file nor the points stay in the result.  The
    folder is removed if it cannot be continued, because it has no points or the input is invalid.
    Raises BadInput where `out` exists, is being written, or belongs to another interrupted command.
    """
    mine = OwnerMarker(out.name, command, plan, RERUN_HINT)
    with reserve_folder(out, mine, is_resumable=lambda path: _read_plan(path / plan) == plan_text) as work:
        (work / POINTS_FOLDER).mkdir(exist_ok=True)
        with atomic_write(work / plan) as fresh:
            fresh.write_text(plan_text, encoding="utf-8")
        try:
            yield work
        except (IncompleteResult, UserInterrupt) as fault:
            if isinstance(fault, IncompleteResult) or fault.path != work:  # only the picture is missing
                publish_folder(work, out)
            raise
        except OSError as fault:
            raise SystemFailure(fault, work, RERUN_HINT) from fault
        except BaseException as fault:
            if isinstance(fault, BadInput) or not any((work / POINTS_FOLDER).iterdir()):
                shutil.rmtree(work, ignore_errors=True)
            raise
        published = publish_folder(work, out, drop=(plan,) if drop else ())
        if drop:
            shutil.rmtree(published / POINTS_FOLDER)
        check_published_name(out, published, None)


def _read_plan(plan: Path) -> str:
    """The text of a plan file; empty where there is none."""
    return plan.read_text(encoding="utf-8", errors="replace") if plan.is_file() else ""


def _hash_case(case: Case) -> str:
    """A file name from a digest of the case and of the contents of its files."""
    digest = hashlib.sha256(case.toml().encode())
    for _, file in sorted(case.named_files().items()):
        digest.update((case.folder / file).read_bytes())
    return digest.hexdigest()[:20]


def _save_point(file: Path, answer: dict[str, Any]) -> None:
    """Save the arrays of a point atomically."""
    with atomic_write(file) as fresh:
        np.savez_compressed(fresh, **answer)


def _load_point(file: Path, needs: frozenset[str]) -> PointArrays | None:
    """The arrays of a saved point; None where the file is missing, damaged, or lacks an array in `needs`."""
    try:
        with zipfile.ZipFile(file) as archive:
            if archive.testzip() is not None:
                return None
        with np.load(file) as arrays:
            point = dict(arrays)
    except Exception:  # a damaged file may raise anything; the case is then run again
        return None
    return point if needs <= {*point} else None
