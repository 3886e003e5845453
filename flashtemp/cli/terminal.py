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

from flashtemp.cli.exit_codes import EXIT_BAD_INPUT, EXIT_DONE, EXIT_FAILED, escape_controls, print_message
from flashtemp.display import to_json
from flashtemp.errors import IncompleteResult

__all__ = ["EXIT_BAD_INPUT", "EXIT_DONE", "EXIT_FAILED", "escape_controls", "print_message"]  # and what stands below

LINE_PERIOD_S, FIRST_LINE_FRACTION = 60.0, 0.1  # s between lines of progress; of it until the first
SAMPLES_GROW = 1.05  # from one sample of progress to the next, in time: a hundred say what happened in an hour
MAX_LEFT_RATIO = 1e5  # of time left over time so far: beyond it all that was done is the first, tiny steps
SPEED_PERIOD_S = 300.0  # s over which a bar takes the pace: one step of a large 3D problem may last half a minute

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


def message_printer(as_json: bool) -> Callable[[str], None]:
    """Who is told what is being done: the person, or nobody beside JSON."""
    return (lambda text: None) if as_json else print_message


def run_and_report(call: Callable[[], Any]) -> tuple[Any, int]:
    """What a call returns and the exit code; where something is missing beside a result, that is told."""
    try:
        return call(), EXIT_DONE
    except IncompleteResult as fault:
        if fault.result is None:
            raise
        print_message(str(fault))
        return fault.result, EXIT_FAILED


def result_folder(out: Path | None, name: str, go_on: bool = False) -> Path:
    """The folder asked for, or a free one of that name in results/; one that was begun only to `go_on`."""
    from flashtemp.runs.results.result_folder import find_free_name

    return out or find_free_name(Path("results") / name, go_on)


@contextmanager
def progress_bar(label: str):
    """Progress with time left on stderr, told watch(march, end)."""
    with progress_counter(label) as bar:
        yield lambda now, end: bar(now.t, end)


@contextmanager
def progress_counter(label: str):
    """Progress with time left on stderr, told watch(done, total): a bar, or lines where stderr is no terminal."""
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        yield ProgressLines(label)
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True, speed_estimate_period=SPEED_PERIOD_S) as bar:
        task, shown = bar.add_task(escape(escape_controls(label)), total=None), 0.0

        def update_bar(done: float, total: float) -> None:
            nonlocal shown
            if time.monotonic() - shown > 0.1:
                shown = time.monotonic()
                bar.update(task, completed=done, total=total)

        yield update_bar


class ProgressLines:
    """Progress as lines for a log: told (done, total), one after six seconds, then one a minute.

    Time left follows from the pace of the second half of the time so far: the first steps of an integration are short.
    """

    def __init__(self, label: str):
        self.label, self.began, self.told = label, time.monotonic(), 0
        self.pace = float(os.environ.get("FLASHTEMP_PROGRESS", LINE_PERIOD_S))  # s; a page asks for more
        self.samples = [(0.0, 0.0)]  # (s, done): the last before half of the time, and what came after it

    def __call__(self, done: float, total: float) -> None:
        gone = time.monotonic() - self.began
        if gone > SAMPLES_GROW * self.samples[-1][0]:
            self.samples.append((gone, done))
        while len(self.samples) > 2 and self.samples[1][0] <= 0.5 * gone:
            del self.samples[0]
        if gone > self.pace * (self.told + FIRST_LINE_FRACTION) and 0 < done < total:
            self.told = int(gone / self.pace) + 1
            print_message(f"{self.label}: {100 * done / total:.0f} %{self._time_left(gone, done, total)}")

    def _time_left(self, gone: float, done: float, total: float) -> str:
        """How long the rest takes, in words; nothing where little has moved lately."""
        since, before = self.samples[0]
        if done <= before:
            return ""
        left = (gone - since) * (total - done) / (done - before)
        return f", about {left:.0f} s left" if left < MAX_LEFT_RATIO * gone else ""


def print_result(data: Any, as_json: bool, text: str) -> None:
    """The result on stdout, once, in the form asked for."""
    if as_json:  # the same characters are escaped, as JSON has it
        text = "".join(c if c.isprintable() or c == "\n" else json.dumps(c)[1:-1] for c in to_json(data))
    print(text if as_json else escape_controls(text))
