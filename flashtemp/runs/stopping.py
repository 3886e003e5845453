"""Ctrl-C as a wish that is seen between two steps of work, not as an exception within one."""

from __future__ import annotations

import signal
import threading
from contextlib import contextmanager


@contextmanager
def stoppable():
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
