"""Process functions of the operating system: file locks, interrupts, number of cores, syncing to disk."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
from pathlib import Path
from typing import Any

STOP_SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGBREAK") if hasattr(signal, name))
LOCK_HELD_ERRNOS = (errno.EWOULDBLOCK, errno.EACCES, errno.EDEADLK)  # errors of a lock that another process holds


def lock_path(path: Path, wait: bool = False) -> int:
    """Lock an existing file or folder; returns a file descriptor, and closing it releases the lock.

    A file system without locks is treated as if locked.  Raises BlockingIOError where another process holds the lock,
    unless `wait` is set.
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
    """Lock a separate file in the temporary folder: Windows cannot rename a folder that contains an open file."""
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
    """Raise BlockingIOError where another process holds the lock; other errors mean a file system without locks."""
    if fault.errno in LOCK_HELD_ERRNOS and not wait:
        os.close(lock)
        raise BlockingIOError(fault.errno, "another process holds it") from fault


def interrupt_process(process: int) -> None:
    """Interrupt a process that leads its own process group, like Ctrl-C.  Raises ProcessLookupError."""
    os.kill(process, getattr(signal, "CTRL_BREAK_EVENT", signal.SIGINT))


def cores() -> int:
    """The number of cores that this process may use."""
    allowed = getattr(os, "sched_getaffinity", None)  # macOS and Windows have none
    return len(allowed(0)) if allowed else os.cpu_count() or 1


def detached_process_options() -> dict[str, Any]:
    """Arguments of subprocess.Popen for a child process that does not receive the Ctrl-C of this one."""
    return {"start_new_session": True, "creationflags": getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)}


def sync_to_disk(path: Path) -> None:
    """Sync one file or folder to disk; ignored for folders on Windows and on file systems that refuse it."""
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
