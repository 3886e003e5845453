"""Handling of Ctrl-C and SIGTERM: the command ends cleanly at any moment, with one line.

An exception raised by a signal handler during an import may be converted, swallowed, or leave a module half imported.
The signal is therefore delayed until the import has finished.
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

RETRY_DELAY_S = 0.02  # s until a delayed signal is raised again
ALARM = getattr(signal, "SIGALRM", None)  # Windows has none


class Interrupts:
    """State of the signal handling: after a signal `is_requested` is True, and later exceptions follow from it."""

    def __init__(self) -> None:
        self.is_requested, self.pending_signal = False, signal.SIGINT

    def handle_signal(self, number: int, frame: FrameType | None) -> None:
        """Raise KeyboardInterrupt, or delay the signal during an import."""
        self.is_requested, self.pending_signal = True, signal.Signals(number)
        if _is_loading(frame):
            self._repeat_later()
        else:
            raise KeyboardInterrupt

    def repeat_signal(self, number: int, frame: FrameType | None) -> None:
        """Raise a delayed signal again, for the handler that is installed by now."""
        signal.raise_signal(self.pending_signal)

    def _repeat_later(self) -> None:
        if ALARM is not None:
            signal.setitimer(signal.ITIMER_REAL, RETRY_DELAY_S)
        else:
            threading.Timer(RETRY_DELAY_S, signal.raise_signal, (self.pending_signal,)).start()

    def handle_unraisable(self, what: Any) -> None:
        """Replace `sys.unraisablehook`: repeat a KeyboardInterrupt that Python swallowed, e.g. in a destructor."""
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
    """Within this context Ctrl-C and SIGTERM raise KeyboardInterrupt; earlier handlers are restored at its end.

    `last`: the process ends afterwards, so both signals are then ignored: its exit code is decided already.
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
