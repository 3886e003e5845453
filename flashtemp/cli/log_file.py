"""The option `--log FILE`: append all output of a command to a file, below its command line."""

from __future__ import annotations

import shlex
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, redirect_stderr, redirect_stdout
from typing import IO, Any

from flashtemp.cli.argument_checks import refuse_odd_words, refuse_unwritable
from flashtemp.errors import BadInput

LOG_OPTION = "--log"


class TeeStream:
    """A stream that writes to two streams.  It is not a terminal, so that progress is printed as lines."""

    def __init__(self, first: Any, log: IO[str]):
        self.first, self.log = first, log

    def write(self, text: str) -> int:
        """Write to both streams."""
        self.log.write(text)
        return int(self.first.write(text))

    def flush(self) -> None:
        """Flush both streams."""
        self.log.flush()
        self.first.flush()

    def isatty(self) -> bool:
        """Always False."""
        return False

    def __getattr__(self, name: str) -> Any:
        return getattr(self.first, name)


def split_log_option(words: list[str]) -> tuple[list[str], str | None]:
    """The words without `--log FILE`, and the file, None without the option.  Raises BadInput.

    >>> split_log_option(["run", "case", "--log", "a.log"]), split_log_option(["run", "--log=a.log"])
    ((['run', 'case'], 'a.log'), (['run'], 'a.log'))
    >>> split_log_option(["run"])
    (['run'], None)
    """
    for k, word in enumerate(words):
        if word.startswith(f"{LOG_OPTION}="):
            return words[:k] + words[k + 1 :], word.removeprefix(f"{LOG_OPTION}=")
        if word == LOG_OPTION:
            if k + 1 == len(words):
                raise BadInput(f"{LOG_OPTION}: missing; give the name of a file")
            return words[:k] + words[k + 2 :], words[k + 1]
    return words, None


@contextmanager
def log_to_file(file: str | None, words: list[str]) -> Iterator[None]:
    """Within this context stdout and stderr are also appended to `file`.  Raises BadInput and OSError."""
    if file is None:
        yield
        return
    refuse_odd_words([file])
    refuse_unwritable(file, LOG_OPTION)
    with ExitStack() as open_:
        log = open_.enter_context(open(file, "a", encoding="utf-8", buffering=1))
        log.write(f"# {time.strftime('%Y-%m-%d %H:%M:%S')} flashtemp {shlex.join(words)}\n")
        open_.enter_context(redirect_stdout(TeeStream(sys.stdout, log)))
        open_.enter_context(redirect_stderr(TeeStream(sys.stderr, log)))
        yield
