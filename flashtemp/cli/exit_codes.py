"""Exit codes of a command, and one line on stderr for every error.

0: done; 1: the computation or the program failed; 2: invalid input; 130: interrupted.
"""

from __future__ import annotations

import errno
import sys

from flashtemp.errors import BadInput, FlashtempError, UserInterrupt, shorten_text

EXIT_DONE, EXIT_FAILED, EXIT_BAD_INPUT, EXIT_STOPPED = 0, 1, 2, 130
# errors of the operating system that mean an unusable path, so invalid input
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
    r"""A text with control and bidirectional characters escaped, so that a terminal cannot act on them.

    >>> escape_controls("a\x1b[2Jb\n\u202ec")
    'a\\x1b[2Jb\n\\u202ec'
    """
    return "".join(c if c.isprintable() or c in "\n\t" else c.encode("unicode_escape").decode() for c in text)


def print_message(text: str) -> None:
    """Print a message on stderr."""
    print(escape_controls(text), file=sys.stderr)


def report_fault(fault: BaseException) -> int:
    """Print the message of an exception on stderr; returns the exit code."""
    if isinstance(fault, BadInput):
        for line in fault.lines:  # a name or value may contain line ends
            print_message(line.replace("\n", "\\n").replace("\r", "\\r"))
        return EXIT_BAD_INPUT
    if isinstance(fault, UserInterrupt | KeyboardInterrupt):
        print_message(str(fault) or "interrupted")
        return EXIT_STOPPED
    text = " ".join(str(fault).split())
    if isinstance(fault, OSError) and fault.errno in PATH_ERRNOS:
        print_message(f"{shorten_text(str(fault.filename))}: {fault.strerror}; give a usable path")
        return EXIT_BAD_INPUT
    if isinstance(fault, FlashtempError | OSError):
        print_message(f"the computation failed: {fault if isinstance(fault, FlashtempError) else text}")
    else:
        cause = f"{type(fault).__name__}: {shorten_text(text)}"
        print_message(f"the program failed: {cause}; the same command with --debug shows where")
    return EXIT_FAILED
