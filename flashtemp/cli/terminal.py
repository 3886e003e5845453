"""What every command shares: results and --json on stdout, messages and progress on stderr, exit codes."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from flashtemp.cli.ending import BAD, DONE, FAILED, plain, tell
from flashtemp.errors import Incomplete
from flashtemp.showing import to_json

__all__ = ["BAD", "DONE", "FAILED", "plain", "tell"]  # and what stands below

LINE_EVERY, FIRST_LINE = 60.0, 0.1  # s between lines of progress; of it until the first
FORESEEN = 0.01  # of all that is to be done, below which nothing is said of the time left

Json = Annotated[
    bool, Parameter(name="--json", negative=(), help="Print the result as JSON on stdout, nothing else there.")
]
Switch = Parameter(negative=())
Limit = Annotated[float | None, Parameter(help="GB of memory that reading one recording may take; 1 when not given.")]
Trust = Annotated[
    bool,
    Parameter(
        name="--trust", negative=(), help="Let effect files of the case run though they are not known to be yours."
    ),
]


def teller(as_json: bool) -> Callable[[str], None]:
    """Who is told what is being done: the person, or nobody beside JSON."""
    return (lambda text: None) if as_json else tell


def finished(call: Callable[[], Any]) -> tuple[Any, int]:
    """What a call returns and the exit code; where something is missing beside a result, that is told."""
    try:
        return call(), DONE
    except Incomplete as fault:
        if fault.result is None:
            raise
        tell(str(fault))
        return fault.result, FAILED


def result_folder(out: Path | None, name: str, go_on: bool = False) -> Path:
    """The folder asked for, or a free one of that name in results/; one that was begun only to `go_on`."""
    from flashtemp.runs.folders import free_name

    return out or free_name(Path("results") / name, go_on)


@contextmanager
def progress_bar(label: str):
    """Progress with time left on stderr, told watch(march, end)."""
    with counter(label) as bar:
        yield lambda now, end: bar(now.t, end)


@contextmanager
def counter(label: str):
    """Progress with time left on stderr, told watch(done, total): a bar, or lines where stderr is no terminal."""
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        yield Lines(label)
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as bar:
        task, shown = bar.add_task(escape(plain(label)), total=None), 0.0

        def watch(done: float, total: float) -> None:
            nonlocal shown
            if time.monotonic() - shown > 0.1:
                shown = time.monotonic()
                bar.update(task, completed=done, total=total)

        yield watch


class Lines:
    """Progress as lines for a log: told (done, total), one after six seconds, then one a minute."""

    def __init__(self, label: str):
        self.label, self.began, self.told = label, time.monotonic(), 0
        self.pace = float(os.environ.get("FLASHTEMP_PROGRESS", LINE_EVERY))  # s; a page asks for more

    def __call__(self, done: float, total: float) -> None:
        gone = time.monotonic() - self.began
        if gone > self.pace * (self.told + FIRST_LINE) and 0 < done < total:
            self.told = int(gone / self.pace) + 1
            left = f", about {gone * (total / done - 1.0):.0f} s left" if done > FORESEEN * total else ""
            tell(f"{self.label}: {100 * done / total:.0f} %{left}")


def emit(data: Any, as_json: bool, text: str) -> None:
    """The result on stdout, once, in the form asked for."""
    if as_json:  # the same characters are escaped, as JSON has it
        text = "".join(c if c.isprintable() or c == "\n" else json.dumps(c)[1:-1] for c in to_json(data))
    print(text if as_json else plain(text))
