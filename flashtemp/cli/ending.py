"""How a command ends: exit codes (contract 5.1), and one line for every fault."""

from __future__ import annotations

import errno
import sys

from flashtemp.errors import BadInput, FlashtempError, Interrupted, short

DONE, FAILED, BAD, STOPPED = 0, 1, 2, 130
# what an operating system says of a path that a user gave
PATHS = (
    errno.ENAMETOOLONG,
    errno.ENOENT,
    errno.ENOTDIR,
    errno.EISDIR,
    errno.EACCES,
    errno.EPERM,
    errno.ELOOP,
    errno.EROFS,
)


def plain(text: str) -> str:
    r"""A text in which nothing moves a terminal's cursor, colours or title, or turns the order of letters.

    >>> plain("a\x1b[2Jb\n\u202ec")
    'a\\x1b[2Jb\n\\u202ec'
    """
    return "".join(c if c.isprintable() or c in "\n\t" else c.encode("unicode_escape").decode() for c in text)


def tell(text: str) -> None:
    """A message for the person at the terminal."""
    print(plain(text), file=sys.stderr)


def ended(fault: BaseException) -> int:
    """Say in words how a command came to its end; its exit code."""
    if isinstance(fault, BadInput):
        for line in fault.lines:  # a name or value in it may hold ends of lines
            tell(line.replace("\n", "\\n").replace("\r", "\\r"))
        return BAD
    if isinstance(fault, Interrupted | KeyboardInterrupt):
        tell(str(fault) or "interrupted")
        return STOPPED
    said = " ".join(str(fault).split())
    if isinstance(fault, OSError) and fault.errno in PATHS:
        tell(f"{short(str(fault.filename))}: {fault.strerror}; give a path that can be used")
        return BAD
    if isinstance(fault, FlashtempError | OSError):
        tell(f"the computation failed: {fault if isinstance(fault, FlashtempError) else said}")
    else:
        tell(f"the program failed: {type(fault).__name__}: {short(said)}; the same command with --debug shows where")
    return FAILED
