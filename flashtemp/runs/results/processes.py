"""What one process does to another: locks, and the signals that ask for its end, as the operating system has them."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
from pathlib import Path
from typing import Any

STOP_SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGBREAK") if hasattr(signal, name))
LOCK_HELD_ERRNOS = (errno.EWOULDBLOCK, errno.EACCES, errno.EDEADLK)  # what a lock says that another process holds


def lock_path(path: Path, wait: bool = False) -> int:
    """A lock on a file or folder that exists, until the number is closed; none where the file system knows no locks.

    Raises BlockingIOError where another process holds it, unless it is to `wait`.
    """
    try:
        import fcntl
    except ModuleNotFoundError:
        return _lock_on_windows(path, wait)
    lock = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except OSError as fault:
        _raise_if_locked(lock, fault, wait)
    return lock


def _lock_on_windows(path: Path, wait: bool) -> int:
    """A lock for Windows, which renames no folder in which a file is open: on a file of the path's own elsewhere."""
    import hashlib
    import msvcrt
    import tempfile

    name = hashlib.sha256(os.path.normcase(path.resolve()).encode()).hexdigest()[:32]
    lock = os.open(Path(tempfile.gettempdir()) / f"flashtemp-{name}.lock", os.O_RDWR | os.O_CREAT)
    try:
        msvcrt.locking(lock, msvcrt.LK_LOCK if wait else msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
    except OSError as fault:
        _raise_if_locked(lock, fault, wait)
    return lock


def _raise_if_locked(lock: int, fault: OSError, wait: bool) -> None:
    """BlockingIOError where another process holds a lock; a file system without locks is none."""
    if fault.errno in LOCK_HELD_ERRNOS and not wait:
        os.close(lock)
        raise BlockingIOError(fault.errno, "another process holds it") from fault


def interrupt_process(process: int) -> None:
    """Ask a process that leads a group of its own for its end, as Ctrl-C does.  Raises ProcessLookupError."""
    os.kill(process, getattr(signal, "CTRL_BREAK_EVENT", signal.SIGINT))


def cores() -> int:
    """How many cores this process may use."""
    allowed = getattr(os, "sched_getaffinity", None)  # macOS and Windows have none
    return len(allowed(0)) if allowed else os.cpu_count() or 1


def detached_process_options() -> dict[str, Any]:
    """What a process is begun with, for subprocess.Popen, so that it does not hear this one's Ctrl-C."""
    return {"start_new_session": True, "creationflags": getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)}


def sync_to_disk(path: Path) -> None:
    """One file or folder on disk; some file systems refuse it for folders, and Windows knows it of files alone."""
    windows = os.name == "nt"
    if windows and path.is_dir():
        return
    file = os.open(path, os.O_RDWR if windows else os.O_RDONLY)
    try:
        os.fsync(file)
    except OSError as fault:
        if fault.errno not in (errno.EINVAL, errno.ENOTSUP, errno.EROFS):
            raise
    finally:
        os.close(file)
