"""Ctrl-C and SIGTERM at any moment: the work ends cleanly, with one line.

While modules are being loaded an exception from a signal handler ends in their hands, not in ours: it turns into
another one, is printed and dropped, or leaves half a module.  There the signal waits until they are loaded.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from flashtemp.runs.processes import ENDS

SOON = 0.02  # s until a signal that has to wait is looked at again
ALARM = getattr(signal, "SIGALRM", None)  # Windows has none


class Interrupts:
    """Whether a signal has asked for the end: what fails afterwards fails for that reason."""

    def __init__(self) -> None:
        self.seen, self.waiting = False, signal.SIGINT

    def handle(self, number: int, frame: FrameType | None) -> None:
        """Raise KeyboardInterrupt, or wait while a module is being loaded."""
        self.seen, self.waiting = True, signal.Signals(number)
        if _loading(frame):
            self._later()
        else:
            raise KeyboardInterrupt

    def again(self, number: int, frame: FrameType | None) -> None:
        """A signal that had to wait, for whoever answers Ctrl-C by now."""
        signal.raise_signal(self.waiting)

    def _later(self) -> None:
        if ALARM is not None:
            signal.setitimer(signal.ITIMER_REAL, SOON)
        else:
            threading.Timer(SOON, signal.raise_signal, (self.waiting,)).start()

    def dropped(self, what: Any) -> None:
        """An exception that Python could not raise; Ctrl-C among them comes again."""
        if what.exc_type is KeyboardInterrupt:
            self._later()
        else:
            sys.__unraisablehook__(what)


def _loading(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False


@contextmanager
def interruptible(last: bool = False) -> Iterator[Interrupts]:
    """Ctrl-C and SIGTERM raise KeyboardInterrupt where it arrives; as before afterwards.

    After the `last` that a process does they are let pass: its exit code is known, and Python ends within moments.
    """
    state = Interrupts()
    if threading.current_thread() is not threading.main_thread():
        yield state
        return
    mine = dict.fromkeys(ENDS, state.handle) | ({} if ALARM is None else {ALARM: state.again})
    old = {s: signal.signal(s, h) for s, h in mine.items() if signal.getsignal(s) is not signal.SIG_IGN}
    hook, sys.unraisablehook = sys.unraisablehook, state.dropped
    try:
        yield state
    finally:
        if ALARM is not None:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        sys.unraisablehook = hook
        for s, handler in old.items():
            signal.signal(s, signal.SIG_IGN if last and s != ALARM else handler)
