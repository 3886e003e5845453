"""Distribution of tasks to local processes, or to a Dask cluster if its address is given."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from flashtemp.errors import BadInput, FlashtempError, SolverFailure
from flashtemp.runs.results.current_folder import safe_child_environment
from flashtemp.runs.results.processes import cores

MAX_KILLS = 2  # pools that may be killed in succession without a result in between
KILLED_MESSAGE = "a worker process was killed, perhaps for memory; give fewer --workers"


def call_safely(function: Callable, task: Any) -> Any:
    """The result of the function, or the FlashtempError that it raised, without the exceptions that led to it.

    Those of a library need not be picklable, and a long chain exceeds the recursion limit.
    """
    try:
        return function(task)
    except FlashtempError as fault:
        fault.__cause__ = fault.__context__ = None
        return fault


@contextmanager
def open_worker_pool(
    function: Callable, workers: int | None = None, scheduler: str | None = None
) -> Iterator[Callable]:
    """Yield a function that maps `function` over a list of tasks, in order.

    `workers`: number of processes, one per available core when not given.  A task that raises a FlashtempError returns
    it.  Raises BadInput when the scheduler cannot be reached, SolverFailure when a process is killed.
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
    """Yield (index of the task, its result) for every task, in order of completion.

    Tasks of a killed process are repeated.  Raises like `open_worker_pool`; SolverFailure when processes are killed
    repeatedly without a result in between.
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

    pending, killed = set(range(len(tasks))), 0
    while pending:
        with _process_pool(count) as pool:
            futures = {pool.submit(call_safely, function, tasks[k]): k for k in sorted(pending)}
            try:
                for future in as_completed(futures):
                    answer = future.result()
                    pending.discard(futures[future])
                    killed = 0
                    yield futures[future], answer
            except BrokenProcessPool as fault:
                killed += 1
                if killed > MAX_KILLS:
                    raise SolverFailure(KILLED_MESSAGE) from fault


def _count_workers(workers: int | None) -> int:
    """The number of processes; one per available core when not given.  Raises BadInput."""
    if workers is not None and workers < 1:
        raise BadInput(f"--workers: {workers}; give at least 1")
    return workers or cores()


@contextmanager
def _process_pool(count: int):
    """Yield a pool of new processes that ignore Ctrl-C.

    They end with this process, however it ends, or when the context fails: each worker waits on a pipe whose other end
    only this process holds open.
    """
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    context = get_context("spawn")
    worker_end, parent_end = context.Pipe(duplex=False)
    with safe_child_environment():  # also for the resource tracker, which the pool starts
        pool = ProcessPoolExecutor(count, mp_context=context, initializer=_start_worker, initargs=(worker_end,))
        try:
            with _block_sigint():
                for _ in range(count):  # each call starts one process
                    pool.submit(int)
            yield pool
        except BaseException:
            parent_end.close()
            pool.shutdown(cancel_futures=True)
            raise
        finally:
            pool.shutdown()
            parent_end.close()
            worker_end.close()


@contextmanager
def _block_sigint() -> Iterator[None]:
    """Processes started in this context never receive Ctrl-C, even while loading; this process gets it afterwards."""
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
    """Initialise a worker: ignore Ctrl-C, one BLAS thread, and a thread that ends the worker with its parent.

    Settings files of the current folder are ignored, as in the parent.
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
    """Wait for the end of the parent, which closes its end of the pipe, and end this process."""
    parent_pipe.poll(None)
    os._exit(1)


def _stream_from_cluster(function: Callable, tasks: list, scheduler: str) -> Iterator[tuple[int, Any]]:
    with _connect_scheduler(scheduler) as client:
        from dask.distributed import as_completed

        with _report_lost_scheduler(scheduler):
            futures = {client.submit(call_safely, function, t, pure=False): k for k, t in enumerate(tasks)}
            for future in as_completed(list(futures)):
                yield futures[future], future.result()


@contextmanager
def _cluster_pool(function: Callable, address: str) -> Iterator[Callable]:
    with _connect_scheduler(address) as client:

        def map_tasks(tasks):
            with _report_lost_scheduler(address):
                return client.gather([client.submit(call_safely, function, t, pure=False) for t in tasks])

        yield map_tasks


@contextmanager
def _report_lost_scheduler(address: str) -> Iterator[None]:
    """Raise a SolverFailure of one line where the scheduler disappears; the log messages of Dask are disabled."""
    import logging
    from asyncio import CancelledError
    from concurrent.futures import CancelledError as Cancelled

    for name in ("asyncio", "tornado.application", *logging.root.manager.loggerDict):
        if name.partition(".")[0] in ("asyncio", "tornado", "distributed"):
            logging.getLogger(name).disabled = True
    try:
        yield
    except (OSError, TimeoutError, Cancelled, CancelledError) as fault:
        raise SolverFailure(f"the scheduler at {address} has stopped; give the address of a running one") from fault


def _connect_scheduler(address: str):
    """A connection to a running Dask scheduler.  Raises BadInput without one."""
    try:
        from dask.distributed import Client
    except ImportError as fault:
        raise BadInput("--scheduler: dask.distributed is not installed; pip install 'flashtemp[cluster]'") from fault
    try:
        client = Client(address, timeout=10)
    except (OSError, TimeoutError, ValueError) as fault:
        raise BadInput(f"--scheduler: {address}: no answer; give the address of a running Dask scheduler") from fault
    return client
