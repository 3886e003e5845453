"""Common parts of all commands: results and --json on stdout, messages, notes and progress on stderr, exit codes."""

from __future__ import annotations

import json
import logging
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from flashtemp.cli.exit_codes import EXIT_BAD_INPUT, EXIT_DONE, EXIT_FAILED, escape_controls, print_message
from flashtemp.display import to_json
from flashtemp.errors import BadInput, IncompleteResult
from flashtemp.physics.interpolation import TABLE_LOGGER
from flashtemp.runs.results.live_state import open_live_file, publish_messages

__all__ = ["EXIT_BAD_INPUT", "EXIT_DONE", "EXIT_FAILED", "escape_controls", "print_message"]  # re-exported

LINE_PERIOD_S, FIRST_LINE_FRACTION = 60.0, 0.1  # s between progress lines; fraction of it before the first line
SAMPLES_GROW = 1.05  # ratio of the times of two successive samples: about a hundred samples per hour
MAX_LEFT_RATIO = 1e5  # time left over elapsed time; above it only the first, tiny steps are done: print no estimate
SPEED_PERIOD_S = 300.0  # s over which a bar averages its speed: one step of a large 3D problem may last 30 s

Json = Annotated[
    bool, Parameter(name="--json", negative=(), help="Print the result as JSON on stdout, and nothing else there.")
]
Switch = Parameter(negative=())
Pdf = Annotated[
    bool, Parameter(name="--pdf", negative=(), help="Also write the report as report.pdf; needs flashtemp[report].")
]
Limit = Annotated[float | None, Parameter(help="Memory limit for reading one recording, GB; 1 when not given.")]
Trust = Annotated[
    bool,
    Parameter(
        name="--trust", negative=(), help="Run effect files of the case even if another user may have written them."
    ),
]


def message_printer(as_json: bool) -> Callable[[str], None]:
    """The function that prints progress messages; it prints nothing with --json."""
    return publish_messages((lambda text: None) if as_json else print_message)


def run_and_report(call: Callable[[], Any]) -> tuple[Any, int]:
    """The result of a call and the exit code; prints what is missing where the result is incomplete."""
    try:
        return call(), EXIT_DONE
    except IncompleteResult as fault:
        if fault.result is None:
            raise
        print_message(str(fault))
        return fault.result, EXIT_FAILED


def result_folder(out: Path | None, name: str, resumable: bool = False) -> Path:
    """`out`, or a free folder `name` in results/; an interrupted one of that name if the study is `resumable`."""
    from flashtemp.runs.results.result_folder import find_free_name

    return out or find_free_name(Path("results") / name, resumable)


@contextmanager
def progress_bar(label: str, load_case: Callable[[], Any]):
    """Progress of a time integration on stderr: yields the function watch(state, end) to call at every step.

    The web app also gets pictures of the run; only for these the case is loaded by `load_case`.
    """
    live = open_live_file()
    with progress_counter(label) as bar:
        if live is None:
            yield lambda now, end: bar(now.t, end)
            return
        from flashtemp.runs.live_run import LiveRun

        run = LiveRun(load_case().scene)
        latest: list[Any] = []

        def watch(now: Any, end: float) -> None:
            bar(now.t, end)
            latest[:] = [now]
            if live.is_due():
                live.write_sections(run=run.describe_state(now))

        try:
            yield watch
        finally:
            for now in latest:
                live.write_sections(run=run.describe_state(now))


@contextmanager
def progress_counter(label: str):
    """Progress with time left on stderr: yields the function watch(done, total) to call.

    It is a bar in a terminal and lines otherwise.
    """
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        yield publish_counts(ProgressLines(label))
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


def publish_counts(lines: ProgressLines) -> Callable[[float, float], None]:
    """The function watch(done, total) of progress lines; it also writes to the state file of the web app, if any."""
    live = open_live_file()
    if live is None:
        return lines

    def watch(done: float, total: float) -> None:
        lines(done, total)
        if live.is_due() or done >= total:
            live.write_sections(progress={"done": done, "total": total, "left_s": lines.seconds_left(done, total)})

    return watch


class ProgressLines:
    """Progress as lines for a log file: called with (done, total), prints after six seconds and then every minute.

    The time left is estimated from the second half of the elapsed time, because the first time steps are short.
    """

    def __init__(self, label: str):
        self.label, self.began, self.n_printed = label, time.monotonic(), 0
        self.period = float(os.environ.get("FLASHTEMP_PROGRESS", LINE_PERIOD_S))  # s; the web app sets a shorter one
        self.samples = [(0.0, 0.0)]  # (s, done): the last one before half of the elapsed time, and all later ones

    def __call__(self, done: float, total: float) -> None:
        elapsed = time.monotonic() - self.began
        if elapsed > SAMPLES_GROW * self.samples[-1][0]:
            self.samples.append((elapsed, done))
        while len(self.samples) > 2 and self.samples[1][0] <= 0.5 * elapsed:
            del self.samples[0]
        if elapsed > self.period * (self.n_printed + FIRST_LINE_FRACTION) and 0 < done < total:
            self.n_printed = int(elapsed / self.period) + 1
            print_message(f"{self.label}: {100 * done / total:.0f} %{self._time_left(elapsed, done, total)}")

    def _time_left(self, elapsed: float, done: float, total: float) -> str:
        """The estimated time left as text; empty where it is not known."""
        left = self._estimate_left(elapsed, done, total)
        return "" if left is None else f", about {left:.0f} s left"

    def seconds_left(self, done: float, total: float) -> float | None:
        """The estimated time left in s, None where it is not known."""
        return self._estimate_left(time.monotonic() - self.began, done, total)

    def _estimate_left(self, elapsed: float, done: float, total: float) -> float | None:
        """The time left in s; None where nothing was done since the first sample, or next to nothing."""
        since, before = self.samples[0]
        if done <= before:
            return None
        left = (elapsed - since) * (total - done) / (done - before)
        return left if left < MAX_LEFT_RATIO * elapsed else None


def print_result(data: Any, as_json: bool, text: str) -> None:
    """Print the result on stdout, as JSON or as text."""
    if as_json:  # unprintable characters in the escapes of JSON
        text = "".join(c if c.isprintable() or c == "\n" else json.dumps(c)[1:-1] for c in to_json(data))
    print(text if as_json else escape_controls(text))


class _Collector(logging.Handler):
    """A logging handler that collects every different message once, in order."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self.messages: dict[str, None] = {}

    def emit(self, record: logging.LogRecord) -> None:
        """Collect the message of a record."""
        self.messages[record.getMessage()] = None


@contextmanager
def table_notes() -> Iterator[None]:
    """Within this context collect notes on tables (rows skipped, units assumed); print them on stderr at its end.

    Nothing is printed if the input is refused.
    """
    logger = logging.getLogger(TABLE_LOGGER)
    handler, level = _Collector(), logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    is_refused = False
    try:
        yield
    except BadInput:
        is_refused = True
        raise
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)
        for message in () if is_refused else handler.messages:
            print_message(message)
