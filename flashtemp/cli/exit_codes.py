"""How a command ends: exit codes (contract 5.1), and one line for every fault."""

from __future__ import annotations

import errno
import sys

from flashtemp.errors import BadInput, FlashtempError, UserInterrupt, shorten_text

EXIT_DONE, EXIT_FAILED, EXIT_BAD_INPUT, EXIT_STOPPED = 0, 1, 2, 130
# what an operating system says of a path that a user gave
PATH_ERRNOS = (
    errno.ENAMETOOLONG,
    errno.ENOENT,
    errno.ENOTDIR,
    errno.EISDIR,
    errno.EACCES,
    errno.EPERM,
    errno.ELOOP,
    errno.EROFS,
)


def escape_controls(text: str) -> str:
    r"""A text in which nothing moves a terminal's cursor, colours or title, or turns the order of letters.

    >>> escape_controls("a\x1b[2Jb\n\u202ec")
    'a\\x1b[2Jb\n\\u202ec'
    """
    return "".join(c if c.isprintable() or c in "\n\t" else c.encode("unicode_escape").decode() for c in text)


def print_message(text: str) -> None:
    """A message for the person at the terminal."""
    print(escape_controls(text), file=sys.stderr)


def report_fault(fault: BaseException) -> int:
    """Say in words how a command came to its end; its exit code."""
    if isinstance(fault, BadInput):
        for line in fault.lines:  # a name or value in it may hold ends of lines
            print_message(line.replace("\n", "\\n").replace("\r", "\\r"))
        return EXIT_BAD_INPUT
    if isinstance(fault, UserInterrupt | KeyboardInterrupt):
        print_message(str(fault) or "interrupted")
        return EXIT_STOPPED
    said = " ".join(str(fault).split())
    if isinstance(fault, OSError) and fault.errno in PATH_ERRNOS:
        print_message(f"{shorten_text(str(fault.filename))}: {fault.strerror}; give a path that can be used")
        return EXIT_BAD_INPUT
    if isinstance(fault, FlashtempError | OSError):
        print_message(f"the computation failed: {fault if isinstance(fault, FlashtempError) else said}")
    else:
        print_message(
            f"the program failed: {type(fault).__name__}: {shorten_text(said)}; the same command with --debug shows where"
        )
    return EXIT_FAILED
