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

from flashtemp.runs.results.processes import STOP_SIGNALS

RETRY_DELAY_S = 0.02  # s until a signal that has to wait is looked at again
ALARM = getattr(signal, "SIGALRM", None)  # Windows has none


class Interrupts:
    """Whether a signal has asked for the end: what fails afterwards fails for that reason."""

    def __init__(self) -> None:
        self.is_requested, self.pending_signal = False, signal.SIGINT

    def handle_signal(self, number: int, frame: FrameType | None) -> None:
        """Raise KeyboardInterrupt, or wait while a module is being loaded."""
        self.is_requested, self.pending_signal = True, signal.Signals(number)
        if _is_loading(frame):
            self._repeat_later()
        else:
            raise KeyboardInterrupt

    def repeat_signal(self, number: int, frame: FrameType | None) -> None:
        """A signal that had to wait, for whoever answers Ctrl-C by now."""
        signal.raise_signal(self.pending_signal)

    def _repeat_later(self) -> None:
        if ALARM is not None:
            signal.setitimer(signal.ITIMER_REAL, RETRY_DELAY_S)
        else:
            threading.Timer(RETRY_DELAY_S, signal.raise_signal, (self.pending_signal,)).start()

    def handle_unraisable(self, what: Any) -> None:
        """An exception that Python could not raise; Ctrl-C among them comes again."""
        if what.exc_type is KeyboardInterrupt:
            self._repeat_later()
        else:
            sys.__unraisablehook__(what)


def _is_loading(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False


@contextmanager
def answer_interrupts(last: bool = False) -> Iterator[Interrupts]:
    """Ctrl-C and SIGTERM raise KeyboardInterrupt where it arrives; as before afterwards.

    After the `last` that a process does they are let pass: its exit code is known, and Python ends within moments.
    """
    state = Interrupts()
    if threading.current_thread() is not threading.main_thread():
        yield state
        return
    mine = dict.fromkeys(STOP_SIGNALS, state.handle_signal) | ({} if ALARM is None else {ALARM: state.repeat_signal})
    old = {s: signal.signal(s, h) for s, h in mine.items() if signal.getsignal(s) is not signal.SIG_IGN}
    hook, sys.unraisablehook = sys.unraisablehook, state.handle_unraisable
    try:
        yield state
    finally:
        if ALARM is not None:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        sys.unraisablehook = hook
        for s, handler in old.items():
            signal.signal(s, signal.SIG_IGN if last and s != ALARM else handler)
