"""The ways a computation can end early, each with a sentence for people, and names of earlier releases."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterable, Mapping
from difflib import get_close_matches
from importlib import import_module
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


REPORTED_NAMES: set[str] = set()  # of this process


def warn_renamed(old: str, new: str) -> None:
    """Warn the caller's caller, once in a process, that a name has changed."""
    if old not in REPORTED_NAMES:
        REPORTED_NAMES.add(old)
        warnings.warn(f"{old} is now {new}; the old name will go in a later release", FutureWarning, stacklevel=3)


class RenamedAttribute:
    """An attribute or method of a class under its old name.

    >>> class Case:
    ...     known_effects = ("wear",)
    ...     known = RenamedAttribute("known_effects")
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("ignore")
    ...     Case().known
    ('wear',)
    """

    def __init__(self, new: str):
        self.new = new

    def __set_name__(self, owner: type, name: str) -> None:
        self.old, self.owner = name, owner.__name__

    def __get__(self, instance: Any, owner: type) -> Any:
        warn_renamed(f"{self.owner}.{self.old}", f"{self.owner}.{self.new}")
        return getattr(owner if instance is None else instance, self.new)


def renamed_names(module: str, names: Mapping[str, str]) -> Callable[[str], Any]:
    """The `__getattr__` of a module that still answers to `names` {old: new}."""

    def find_attribute(name: str) -> Any:
        if name not in names:
            raise AttributeError(f"module '{module}' has no attribute '{name}'")
        warn_renamed(f"{module}.{name}", f"{module}.{names[name]}")
        return getattr(import_module(module), names[name])

    return find_attribute
