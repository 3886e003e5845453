"""The three ways a computation can end early, each with a sentence for people."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path


class FlashtempError(Exception):
    """Base of all errors that flashtemp raises on purpose."""


class BadInput(FlashtempError):
    """Input that cannot be used: one line naming file, key, value and what would be right.

    Several faults found together stand in `lines`, one each.

    >>> str(BadInput("case.toml: friction.mu: -1 is negative; give a number >= 0"))
    'case.toml: friction.mu: -1 is negative; give a number >= 0'
    """

    def __init__(self, *lines: str):
        super().__init__("\n".join(lines))
        self.lines = lines


class SolverFailure(FlashtempError):
    """The time integration stopped: says at what time, in which cell and under which effect."""


class Interrupted(FlashtempError):
    """The user stopped the work; what goes on from it is left in `path`, and `how` to."""

    def __init__(self, path: Path, how: str):
        super().__init__(f"interrupted; checkpoint left in {path}; go on with: {how}")
        self.path = path


def nearest(name: str, known: Iterable[str]) -> str:
    """What would be right instead of an unknown name, as half a sentence: the nearest or all known.

    >>> nearest("frction", ["friction", "contact"])
    "; did you mean 'friction'?"
    """
    known = list(known)
    match = [k for k in known if k.lower() == name.lower()] or get_close_matches(name, known, n=1, cutoff=0.5)
    if match:
        return f"; did you mean '{match[0]}'?"
    return f"; known are {', '.join(known)}" if known else "; nothing can stand here"
