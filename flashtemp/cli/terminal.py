"""What every command shares: results on stdout, messages and progress on stderr, exit codes of the contract."""

from __future__ import annotations

import json
import sys
import time
from contextlib import contextmanager
from typing import Annotated

from cyclopts import Parameter

DONE, FAILED, BAD, STOPPED = 0, 1, 2, 130
Json = Annotated[
    bool, Parameter(name="--json", negative=(), help="Print the result as JSON on stdout, nothing else there.")
]
Switch = Parameter(negative=())


def tell(text: str) -> None:
    """A message for the person at the terminal."""
    print(text, file=sys.stderr)


@contextmanager
def progress_bar(label: str):
    """Progress with time left on stderr, told watch(march, end); silent where stderr is no terminal."""
    with counter(label) as bar:
        yield lambda now, end: bar(now.t, end)


@contextmanager
def counter(label: str):
    """Progress with time left on stderr, told watch(done, total); silent where stderr is no terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, disable=not console.is_terminal, transient=True) as bar:
        task, shown = bar.add_task(label, total=None), 0.0

        def watch(done: float, total: float) -> None:
            nonlocal shown
            if time.monotonic() - shown > 0.1:
                shown = time.monotonic()
                bar.update(task, completed=done, total=total)

        yield watch


def emit(data, as_json: bool, text: str) -> None:
    """The result on stdout, once, in the form asked for."""
    print(json.dumps(finite(data), indent=2) if as_json else text)


def finite(data):
    """Data with infinite and undefined numbers as text or null, so that the JSON is valid everywhere."""
    if isinstance(data, dict):
        return {k: finite(v) for k, v in data.items()}
    if isinstance(data, (list, tuple)):
        return [finite(v) for v in data]
    if isinstance(data, float) and data != data:
        return None
    if isinstance(data, float) and abs(data) == float("inf"):
        return "inf" if data > 0 else "-inf"
    return data
