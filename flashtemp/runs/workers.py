"""Tasks of sweeps and searches shared out to local processes, or to a Dask cluster where its address is given."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from flashtemp.errors import BadInput, FlashtempError, SolverFailure
from flashtemp.runs.current_folder import safe_children
from flashtemp.runs.processes import cores

PATIENCE = 2  # times that processes may be killed one after the other without an answer between
KILLED = "a worker process was killed, perhaps for memory; give fewer --workers"


def attempt(function: Callable, task: Any) -> Any:
    """The function's answer, or the failure of the computation itself as an answer."""
    try:
        return function(task)
    except FlashtempError as fault:
        return fault


@contextmanager
def crew(function: Callable, workers: int | None = None, scheduler: str | None = None) -> Iterator[Callable]:
    """A function that maps `function` over a list of tasks, in order.

    `workers` processes, as many as there are cores for this one when not given; failures of a computation come back
    as answers.  Raises BadInput when the scheduler cannot be reached, SolverFailure when a process is killed.
    """
    if scheduler is not None:
        with _cluster(function, scheduler) as run:
            yield run
        return
    count = _hands(workers)
    if count == 1:
        yield lambda tasks: [attempt(function, t) for t in tasks]
        return
    from concurrent.futures.process import BrokenProcessPool

    with _pool(count) as pool:

        def run(tasks):
            try:
                return list(pool.map(partial(attempt, function), tasks))
            except BrokenProcessPool as fault:
                raise SolverFailure(KILLED) from fault

        yield run


def stream(
    function: Callable, tasks: list, workers: int | None = None, scheduler: str | None = None
) -> Iterator[tuple[int, Any]]:
    """(number of the task, its answer) of every task, once, as they come.

    Tasks of a process that is killed are given out again.  Raises like `crew`; SolverFailure when processes are
    killed and no answer comes between.
    """
    if scheduler is not None:
        yield from _from_cluster(function, tasks, scheduler)
        return
    count = min(_hands(workers), len(tasks))
    if count <= 1:
        for k, task in enumerate(tasks):
            yield k, attempt(function, task)
        return
    from concurrent.futures import as_completed
    from concurrent.futures.process import BrokenProcessPool

    left, killed = set(range(len(tasks))), 0
    while left:
        with _pool(count) as pool:
            asked = {pool.submit(attempt, function, tasks[k]): k for k in sorted(left)}
            try:
                for future in as_completed(asked):
                    answer = future.result()
                    left.discard(asked[future])
                    killed = 0
                    yield asked[future], answer
            except BrokenProcessPool as fault:
                killed += 1
                if killed > PATIENCE:
                    raise SolverFailure(KILLED) from fault


def _hands(workers: int | None) -> int:
    """How many processes: as many as there are cores for this one when not given."""
    if workers is not None and workers < 1:
        raise BadInput(f"--workers: {workers}; give at least 1")
    return workers or cores()


@contextmanager
def _pool(count: int):
    """Fresh processes that do not answer Ctrl-C and end with this one, however it ends, or when this block fails."""
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    context = get_context("spawn")
    held, leash = context.Pipe(duplex=False)
    with safe_children():  # also for the resource tracker, which the pool begins
        pool = ProcessPoolExecutor(count, mp_context=context, initializer=_begin, initargs=(held,))
        try:
            with _deaf():
                for _ in range(count):  # each of them begins one process
                    pool.submit(int)
            yield pool
        except BaseException:
            leash.close()
            pool.shutdown(cancel_futures=True)
            raise
        finally:
            pool.shutdown()
            leash.close()
            held.close()


@contextmanager
def _deaf() -> Iterator[None]:
    """Processes that begin here never see Ctrl-C, not even while they load; this one sees it afterwards."""
    import signal

    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin(held) -> None:
    """In a new process: one thread of arithmetic, one that waits for the parent's end, and no ear for Ctrl-C.

    Settings files of the current folder are not for it either.
    """
    import signal
    import threading

    signal.signal(signal.SIGINT, signal.SIG_IGN)

    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    threading.Thread(target=_follow, args=(held,), daemon=True).start()
    from flashtemp.physics.local_settings import ignore_local_settings

    ignore_local_settings()


def _follow(held) -> None:
    """End with the parent, who holds the other end and never sends anything."""
    held.poll(None)
    os._exit(1)


def _from_cluster(function: Callable, tasks: list, scheduler: str) -> Iterator[tuple[int, Any]]:
    with _client(scheduler) as client:
        from dask.distributed import as_completed

        with _lost(scheduler):
            asked = {client.submit(attempt, function, t, pure=False): k for k, t in enumerate(tasks)}
            for future in as_completed(list(asked)):
                yield asked[future], future.result()


@contextmanager
def _cluster(function: Callable, address: str) -> Iterator[Callable]:
    with _client(address) as client:

        def run(tasks):
            with _lost(address):
                return client.gather([client.submit(attempt, function, t, pure=False) for t in tasks])

        yield run


@contextmanager
def _lost(address: str) -> Iterator[None]:
    """SolverFailure, in one line, where the scheduler goes away; what Dask itself says of it is not for people."""
    import logging
    from asyncio import CancelledError
    from concurrent.futures import CancelledError as Cancelled

    for name in ("asyncio", "tornado.application", *logging.root.manager.loggerDict):
        if name.partition(".")[0] in ("asyncio", "tornado", "distributed"):
            logging.getLogger(name).disabled = True
    try:
        yield
    except (OSError, TimeoutError, Cancelled, CancelledError) as fault:
        raise SolverFailure(f"the scheduler at {address} has gone; give the address of one that runs") from fault


def _client(address: str):
    """A connection to a running Dask scheduler; BadInput when there is none."""
    try:
        from dask.distributed import Client
    except ImportError as fault:
        raise BadInput("--scheduler: dask.distributed is not installed; pip install 'flashtemp[cluster]'") from fault
    try:
        client = Client(address, timeout=10)
    except (OSError, TimeoutError, ValueError) as fault:
        raise BadInput(f"--scheduler: {address}: no answer; give the address of a running Dask scheduler") from fault
    return client
