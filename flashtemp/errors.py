"""The ways a computation can end early, each with a sentence for people."""

from __future__ import annotations

import re
from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path
from typing import Any

LONG_WORD = re.compile(r"[^\s/]{256,}|\S{1000,}")  # longer than the name of any file, and than a path that is read
MAX_LISTED_NAMES = 16  # names in a message


class FlashtempError(Exception):
    """Base of all errors that flashtemp raises on purpose."""


class BadInput(FlashtempError):
    """Input that cannot be used: one line naming file, key, value and what would be right.

    Several faults found together stand in `lines`, one each.

    >>> str(BadInput("case.toml: friction.mu: -1 is negative; give a number >= 0"))
    'case.toml: friction.mu: -1 is negative; give a number >= 0'
    """

    def __init__(self, *lines: str):
        self.lines = tuple(LONG_WORD.sub(lambda word: shorten_text(word[0]), line) for line in lines)
        super().__init__("\n".join(self.lines))


class SolverFailure(FlashtempError):
    """The time integration stopped: says at what time, in which cell and under which effect."""


class EnergyBalanceError(SolverFailure):
    """The march ended, but its books do not balance; `run` is what it gave, to be looked at and not believed."""

    def __init__(self, said: str, run: Any):
        super().__init__(said)
        self.run = run


class UserInterrupt(FlashtempError):
    """The user stopped the work; what goes on from it is `left` in `path`, and `how` to."""

    def __init__(self, path: Path, how: str, left: str = "checkpoint"):
        super().__init__(f"interrupted; {left} left in {path}; go on with: {how}")
        self.path = path


def shorten_text(text: str) -> str:
    """A text for a message, cut where nobody would read on.

    >>> shorten_text("7" * 500)[-20:]
    '... (500 characters)'
    """
    return text if len(text) <= 200 else f"{text[:160]}... ({len(text)} characters)"


class SystemFailure(FlashtempError):
    """The machine stopped the work, as by a full disk; what goes on from it is left in `path`, and `how` to."""

    def __init__(self, fault: BaseException, path: Path, how: str):
        super().__init__(f"{describe_exception(fault)}; checkpoint left in {path}; mend that and go on with: {how}")
        self.path = path


class IncompleteResult(FlashtempError):
    """A `result` is there, but not all that should lie beside it: says what is missing and how to get it."""

    def __init__(self, text: str, result: Any):
        super().__init__(text)
        self.result = result


def describe_exception(fault: BaseException) -> str:
    """Why something failed, in one line.

    >>> describe_exception(OSError(28, "No space left on device", "run.nc")), describe_exception(ValueError())
    ('No space left on device: run.nc', 'ValueError')
    """
    if isinstance(fault, OSError) and fault.strerror:
        return f"{fault.strerror}: {fault.filename}" if fault.filename else fault.strerror
    said, kind = shorten_text(" ".join(str(fault).split())), type(fault).__name__
    return said if isinstance(fault, FlashtempError) else f"{kind}: {said}" if said else kind


def suggest_name(name: str, known: Iterable[str]) -> str:
    """What would be right instead of an unknown name, as half a sentence: the nearest or all known.

    >>> suggest_name("frction", ["friction", "contact"])
    "; did you mean 'friction'?"
    """
    known = list(known)
    match = [k for k in known if k.lower() == name.lower()] or get_close_matches(name, known, n=1, cutoff=0.5)
    if match:
        return f"; did you mean '{match[0]}'?"
    if not known:
        return "; nothing can stand here"
    more = f" and {len(known) - MAX_LISTED_NAMES} more" if len(known) > MAX_LISTED_NAMES else ""
    return f"; known are {', '.join(known[:MAX_LISTED_NAMES])}{more}"
