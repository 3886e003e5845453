"""Result folders: whole or absent, never half-written, and Ctrl-C seen where work leaves something whole."""

from __future__ import annotations

import shutil
import signal
import threading
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path

from flashtemp.errors import BadInput


def free_name(out: Path) -> Path:
    """The folder itself, or the first of name-2, name-3... that does not exist yet."""
    n, path = 1, out
    while path.exists() or partial(path).exists():
        n += 1
        path = out.with_name(f"{out.name}-{n}")
    return path


def partial(out: Path) -> Path:
    """Where a result is written until it is whole."""
    return out.with_name(out.name + ".partial")


@contextmanager
def whole(out: Path) -> Iterator[Path]:
    """A new folder to write into, renamed to `out` at the end; a failure leaves nothing.  Raises BadInput."""
    if out.exists():
        raise BadInput(f"--out: {out} exists; choose another folder")
    work = partial(out)
    shutil.rmtree(work, ignore_errors=True)
    try:
        work.mkdir(parents=True)
    except OSError as fault:
        raise BadInput(f"--out: {out}: {fault.strerror}; choose a folder that can be written") from fault
    try:
        yield work
        work.rename(out)
    except BaseException:
        shutil.rmtree(work, ignore_errors=True)
        raise


def wanted(out: Path | str | None) -> AbstractContextManager[Path | None]:
    """A new folder as `whole` makes it, or None where nothing is to be written.  Raises BadInput."""
    return nullcontext() if out is None else whole(Path(out))


@contextmanager
def stoppable() -> Iterator[threading.Event]:
    """An event that SIGINT and SIGTERM set, so that work ends where it leaves something whole."""
    stopped = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield stopped
        return
    old = {s: signal.signal(s, lambda *_: stopped.set()) for s in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stopped
    finally:
        for s, handler in old.items():
            signal.signal(s, handler)
