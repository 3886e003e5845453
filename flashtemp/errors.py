"""Exceptions that flashtemp raises, texts of error messages, and warnings for names of earlier releases."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterable, Mapping
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from typing import Any

LONG_WORD = re.compile(r"[^\s/]{256,}|\S{1000,}")  # longer than any file name or readable path
MAX_LISTED_NAMES = 16  # names listed in one message


class FlashtempError(Exception):
    """Base class of all errors that flashtemp raises on purpose."""

    def __reduce__(self) -> tuple[Any, ...]:
        # the standard way repeats __init__ with the message alone, which fails where it takes more
        return _restore_error, (type(self), self.args, vars(self))


def _restore_error(kind: type[FlashtempError], args: tuple[Any, ...], attributes: dict[str, Any]) -> FlashtempError:
    """An error as it was pickled."""
    fault = kind.__new__(kind, *args)
    vars(fault).update(attributes)
    return fault


class BadInput(FlashtempError):
    """Input that cannot be used: one line with file, key, value and remedy.

    Several errors found together are in `lines`, one each.

    >>> str(BadInput("case.toml: friction.mu: -1 is negative; give a number >= 0"))
    'case.toml: friction.mu: -1 is negative; give a number >= 0'
    """

    def __init__(self, *lines: str):
        self.lines = tuple(LONG_WORD.sub(lambda word: shorten_text(word[0]), line) for line in lines)
        super().__init__("\n".join(self.lines))


class SolverFailure(FlashtempError):
    """The time integration failed; the message gives the time, the cell and the effect."""


class EnergyBalanceError(SolverFailure):
    """The run finished, but its energy balance does not close; `run` is the result, for diagnosis only."""

    def __init__(self, text: str, run: Any):
        super().__init__(text)
        self.run = run


class UserInterrupt(FlashtempError):
    """The user interrupted the work; `path` contains what was `saved`, and the command `how` continues from it."""

    def __init__(self, path: Path, how: str, saved: str = "checkpoint"):
        super().__init__(f"interrupted; {saved} saved in {path}; continue with: {how}")
        self.path = path


def shorten_text(text: str) -> str:
    """A text for a message, cut to its first 160 characters where it is longer than 200.

    >>> shorten_text("7" * 500)[-20:]
    '... (500 characters)'
    """
    return text if len(text) <= 200 else f"{text[:160]}... ({len(text)} characters)"


class SystemFailure(FlashtempError):
    """The machine stopped the work, e.g. a full disk; `path` contains a checkpoint, and `how` continues from it."""

    def __init__(self, fault: BaseException, path: Path, how: str):
        super().__init__(
            f"{describe_exception(fault)}; checkpoint saved in {path}; solve the problem and continue with: {how}"
        )
        self.path = path


class IncompleteResult(FlashtempError):
    """The `result` is complete, but a file that belongs to it is missing; the message says how to make it."""

    def __init__(self, text: str, result: Any):
        super().__init__(text)
        self.result = result


def describe_exception(fault: BaseException) -> str:
    """The message of an exception in one line.

    >>> describe_exception(OSError(28, "No space left on device", "run.nc")), describe_exception(ValueError())
    ('No space left on device: run.nc', 'ValueError')
    """
    if isinstance(fault, OSError) and fault.strerror:
        return f"{fault.strerror}: {fault.filename}" if fault.filename else fault.strerror
    text, kind = shorten_text(" ".join(str(fault).split())), type(fault).__name__
    return text if isinstance(fault, FlashtempError) else f"{kind}: {text}" if text else kind


def suggest_name(name: str, known: Iterable[str], table: str = "") -> str:
    """The end of an error message for an unknown name: the nearest of the `known` names, or all of them.

    A suggested key of a `table` is written with its table.

    >>> suggest_name("frction", ["friction", "contact"]), suggest_name("presure", ["pressure"], "contact")
    ("; did you mean 'friction'?", "; did you mean 'contact.pressure'?")
    """
    known = list(known)
    match = [k for k in known if k.lower() == name.lower()] or get_close_matches(name, known, n=1, cutoff=0.5)
    if match:
        return f"; did you mean '{table}.{match[0]}'?" if table else f"; did you mean '{match[0]}'?"
    if not known:
        return "; no name is allowed here"
    more = f" and {len(known) - MAX_LISTED_NAMES} more" if len(known) > MAX_LISTED_NAMES else ""
    return f"; known are {', '.join(known[:MAX_LISTED_NAMES])}{more}"


REPORTED_NAMES: set[str] = set()  # old names that this process has warned of


def warn_renamed(old: str, new: str) -> None:
    """Warn, once per process, that a name has changed; the warning points to the caller's caller."""
    if old not in REPORTED_NAMES:
        REPORTED_NAMES.add(old)
        warnings.warn(
            f"{old} is now {new}; the old name will be removed in a later release", FutureWarning, stacklevel=3
        )


class RenamedAttribute:
    """Descriptor: an attribute or method of a class under its name of an earlier release.

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
        if instance is None:  # documentation tools look at the class; its users at an instance
            return self
        warn_renamed(f"{self.owner}.{self.old}", f"{self.owner}.{self.new}")
        return getattr(instance, self.new)


def renamed_names(module: str, names: Mapping[str, str]) -> Callable[[str], Any]:
    """A `__getattr__` for a module whose earlier `names` {old: new} keep working."""

    def find_attribute(name: str) -> Any:
        if name not in names:
            raise AttributeError(f"module '{module}' has no attribute '{name}'")
        warn_renamed(f"{module}.{name}", f"{module}.{names[name]}")
        return getattr(import_module(module), names[name])

    return find_attribute


__getattr__ = renamed_names(  # of earlier releases; a user's own effect file may import them
    __name__,
    {
        "AuditFailure": "EnergyBalanceError",
        "Halted": "SystemFailure",
        "Incomplete": "IncompleteResult",
        "Interrupted": "UserInterrupt",
        "nearest": "suggest_name",
        "reason": "describe_exception",
        "short": "shorten_text",
    },
)
