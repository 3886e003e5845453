"""Tasks of sweeps and searches shared out to local processes, or to a Dask cluster where its address is given."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from flashtemp.errors import BadInput, FlashtempError, SolverFailure
from flashtemp.runs.results.current_folder import safe_child_environment
from flashtemp.runs.results.processes import cores

MAX_KILLS = 2  # times that processes may be killed one after the other without an answer between
KILLED_MESSAGE = "a worker process was killed, perhaps for memory; give fewer --workers"


def call_safely(function: Callable, task: Any) -> Any:
    """The function's answer, or the failure of the computation itself as an answer."""
    try:
        return function(task)
    except FlashtempError as fault:
        return fault


@contextmanager
def open_worker_pool(function: Callable, workers: int | None = None, scheduler: str | None = None) -> Iterator[Callable]:
    """A function that maps `function` over a list of tasks, in order.

    `workers` processes, as many as there are cores for this one when not given; failures of a computation come back
    as answers.  Raises BadInput when the scheduler cannot be reached, SolverFailure when a process is killed.
    """
    if scheduler is not None:
        with _cluster_pool(function, scheduler) as map_tasks:
            yield map_tasks
        return
    count = _count_workers(workers)
    if count == 1:
        yield lambda tasks: [call_safely(function, t) for t in tasks]
        return
    from concurrent.futures.process import BrokenProcessPool

    with _process_pool(count) as pool:

        def map_tasks(tasks):
            try:
                return list(pool.map(partial(call_safely, function), tasks))
            except BrokenProcessPool as fault:
                raise SolverFailure(KILLED_MESSAGE) from fault

        yield map_tasks


def stream_results(
    function: Callable, tasks: list, workers: int | None = None, scheduler: str | None = None
) -> Iterator[tuple[int, Any]]:
    """(number of the task, its answer) of every task, once, as they come.

    Tasks of a process that is killed are given out again.  Raises like `open_worker_pool`; SolverFailure when processes are
    killed and no answer comes between.
    """
    if scheduler is not None:
        yield from _stream_from_cluster(function, tasks, scheduler)
        return
    count = min(_count_workers(workers), len(tasks))
    if count <= 1:
        for k, task in enumerate(tasks):
            yield k, call_safely(function, task)
        return
    from concurrent.futures import as_completed
    from concurrent.futures.process import BrokenProcessPool

    left, killed = set(range(len(tasks))), 0
    while left:
        with _process_pool(count) as pool:
            asked = {pool.submit(call_safely, function, tasks[k]): k for k in sorted(left)}
            try:
                for future in as_completed(asked):
                    answer = future.result()
                    left.discard(asked[future])
                    killed = 0
                    yield asked[future], answer
            except BrokenProcessPool as fault:
                killed += 1
                if killed > MAX_KILLS:
                    raise SolverFailure(KILLED_MESSAGE) from fault


def _count_workers(workers: int | None) -> int:
    """How many processes: as many as there are cores for this one when not given."""
    if workers is not None and workers < 1:
        raise BadInput(f"--workers: {workers}; give at least 1")
    return workers or cores()


@contextmanager
def _process_pool(count: int):
    """Fresh processes that do not answer Ctrl-C and end with this one, however it ends, or when this block fails."""
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    context = get_context("spawn")
    held, leash = context.Pipe(duplex=False)
    with safe_child_environment():  # also for the resource tracker, which the pool begins
        pool = ProcessPoolExecutor(count, mp_context=context, initializer=_start_worker, initargs=(held,))
        try:
            with _block_sigint():
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
def _block_sigint() -> Iterator[None]:
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


def _start_worker(parent_pipe) -> None:
    """In a new process: one thread of arithmetic, one that waits for the parent's end, and no ear for Ctrl-C.

    Settings files of the current folder are not for it either.
    """
    import signal
    import threading

    signal.signal(signal.SIGINT, signal.SIG_IGN)

    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    threading.Thread(target=_exit_with_parent, args=(parent_pipe,), daemon=True).start()
    from flashtemp.physics.local_settings import ignore_local_settings

    ignore_local_settings()


def _exit_with_parent(parent_pipe) -> None:
    """End with the parent, who holds the other end and never sends anything."""
    parent_pipe.poll(None)
    os._exit(1)


def _stream_from_cluster(function: Callable, tasks: list, scheduler: str) -> Iterator[tuple[int, Any]]:
    with _connect_scheduler(scheduler) as client:
        from dask.distributed import as_completed

        with _report_lost_scheduler(scheduler):
            asked = {client.submit(call_safely, function, t, pure=False): k for k, t in enumerate(tasks)}
            for future in as_completed(list(asked)):
                yield asked[future], future.result()


@contextmanager
def _cluster_pool(function: Callable, address: str) -> Iterator[Callable]:
    with _connect_scheduler(address) as client:

        def map_tasks(tasks):
            with _report_lost_scheduler(address):
                return client.gather([client.submit(call_safely, function, t, pure=False) for t in tasks])

        yield map_tasks


@contextmanager
def _report_lost_scheduler(address: str) -> Iterator[None]:
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


def _connect_scheduler(address: str):
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
