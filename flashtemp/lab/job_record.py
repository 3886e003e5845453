"""The record of a command in the folder: its log, whose first line is the command, and beside it its state as JSON.

`NAME.log` begins with `$ flashtemp ...`.  `NAME.json` holds `queued`, `began`, `pid` and `end` (exit code and time).
The command writes them itself, so that a later server knows how it ended.
"""

from __future__ import annotations

import os
import re
import shlex
import signal
import stat
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from flashtemp.lab.live_state import LiveState, read_live_state
from flashtemp.runs.results.processes import interrupt_process

LOG_FOLDER = ".flashtemp-lab"  # folder of the logs
JOB_NAME = re.compile(r"\d{8}-\d{6}-\d+-[a-z]{2,20}")  # of a log file without its suffix
MAX_COMMAND_BYTES, MAX_LOG_BYTES = 16_384, 200_000  # of the first line, and of the end of a log that is shown
PERCENT_PATTERN = re.compile(r"(\d+) %")
TIME_LEFT_PATTERN = re.compile(r"about (\d+) s left")
TIME_NOTE_PATTERN = re.compile(r" \(\d+ s[^)]*\)$")  # at the end of a message
EXIT_STATES = {0: "done", 130: "stopped", -signal.SIGINT: "stopped"}  # the last: interrupted before it had begun
UNFINISHED_STATES = ("waiting", "running")
STATE_KINDS = {"done": "good", "running": "accent", "stopped": "warning", "waiting": ""}  # of the chip, else "error"


@dataclass
class LoggedJob:
    """One command: its `words` after `flashtemp` and its `log` file."""

    words: tuple[str, ...]
    log: Path
    _live: tuple[int, LiveState] = field(default=(-1, LiveState()), repr=False)  # time of change (ns), state

    @property
    def name(self) -> str:
        """The name of the job in addresses: that of its log."""
        return self.log.stem

    @property
    def state_file(self) -> Path:
        """The file in which the command writes its state."""
        return self.log.with_suffix(".json")

    @property
    def live(self) -> LiveState:
        """What the command has written of its state, read again when the file has changed."""
        try:
            changed = os.lstat(self.state_file).st_mtime_ns
        except OSError:
            changed = 0
        if changed != self._live[0]:
            self._live = (changed, read_live_state(self.state_file) if changed else LiveState())
        return self._live[1]

    @property
    def live_version(self) -> int:
        """A number that changes with what `live` was read from."""
        return self._live[0]

    @property
    def exit_code(self) -> int | None:
        """Exit code, None while the command runs or where it is not known."""
        code = self.live.number("end", "exit_code")
        return None if code is None else int(code)

    @property
    def is_running(self) -> bool:
        """Whether the process that writes this log is alive."""
        number = self.live.number("pid")
        return number is not None and self.exit_code is None and _is_writer(int(number), self.log)

    @property
    def state(self) -> str:
        """State in a word: waiting, running, done, stopped, not started, killed, unknown or failed."""
        code = self.exit_code
        if code is not None:
            return EXIT_STATES.get(code, "killed" if code < 0 else f"failed, exit code {code}")
        if self.is_running:
            return "running"
        if self.live.number("began") is not None:
            return "killed"
        return "not started" if self.live.number("queued") is not None else "unknown"

    @property
    def is_unfinished(self) -> bool:
        """Whether the job waits or runs."""
        return self.state in UNFINISHED_STATES

    @property
    def began(self) -> float:
        """Time at which the command began, s since 1970; that of its log where it is not known."""
        return self.live.number("began") or self.live.number("queued") or _time_of_name(self.name)

    @property
    def seconds(self) -> float | None:
        """How long the command ran or has been running, s; None where it is not known."""
        began, ended = self.live.number("began"), self.live.number("end", "time")
        if began is None or (ended is None and not self.is_running):
            return None
        return max(0.0, (time.time() if ended is None else ended) - began)

    def log_lines(self, max_lines: int = 400) -> list[str]:
        """The last lines of the log, without the command line."""
        with suppress(OSError, ValueError):
            if not _is_regular(self.log):
                return []
            with self.log.open("rb") as file:
                size = file.seek(0, os.SEEK_END)
                file.seek(max(0, size - MAX_LOG_BYTES))
                lines = file.read().decode("utf-8", "replace").splitlines()
            return lines[1:][-max_lines:]
        return []

    def progress(self) -> tuple[float | None, str]:
        """Fraction done (None if unknown), and the latest line about it."""
        lines = self.log_lines(40)
        done, total = self.live.number("progress", "done"), self.live.number("progress", "total")
        if done is not None and total:
            return min(max(done / total, 0.0), 1.0), lines[-1] if lines else f"{100 * done / total:.0f} %"
        done, total = self.live.number("stage", "done"), self.live.number("stage", "total")
        if done is not None and total:
            return min(max(done / total, 0.0), 1.0), lines[-1] if lines else ""
        left, said, began = (self.live.number(*k) for k in (("stage", "left_s"), ("said",), ("began",)))
        if left is not None and said is not None and began is not None:
            gone = time.time() - began
            left = max(left - (time.time() - said), 0.02 * gone)  # a stage may take longer than usual
            words = TIME_NOTE_PATTERN.sub("", self.live.text("message")).strip()
            return gone / (gone + left), f"{words}, about {format_duration(left)} left"
        return _progress_of_lines(lines, self.seconds or 0.0)

    def stop(self) -> None:
        """Interrupt the command like Ctrl-C: it writes its checkpoint and ends."""
        number = self.live.number("pid")
        if number is not None and self.is_running:
            with suppress(ProcessLookupError):
                interrupt_process(int(number))


def _progress_of_lines(lines: list[str], elapsed: float) -> tuple[float | None, str]:
    """Fraction done and the latest line about it, from the lines of a log."""
    for line in reversed(lines):
        if match := PERCENT_PATTERN.search(line):
            return min(float(match[1]) / 100.0, 1.0), line
        if match := TIME_LEFT_PATTERN.search(line):
            return elapsed / max(elapsed + float(match[1]), 1e-9), line
    return None, lines[-1] if lines else ""


def read_job(log: Path) -> LoggedJob | None:
    """The job of a log file; None where the file is none of a job, or no regular file."""
    try:
        if not JOB_NAME.fullmatch(log.stem) or log.suffix != ".log" or not _is_regular(log):
            return None
        with log.open("rb") as file:
            first = file.readline(MAX_COMMAND_BYTES).decode("utf-8")
        words = shlex.split(first.removeprefix("$ "))
    except (OSError, ValueError):
        return None
    is_command = first.startswith("$ flashtemp ") and first.endswith("\n") and len(words) > 1
    return LoggedJob(tuple(words[1:]), log) if is_command else None


def list_past_jobs(folder: Path, known: set[str], most: int) -> list[LoggedJob]:
    """The jobs in the logs of a folder except those with `known` names, newest first, at most `most`."""
    logs = folder / LOG_FOLDER
    if logs.is_symlink() or not logs.is_dir():
        return []
    names = sorted((n for n in os.listdir(logs) if n.endswith(".log") and JOB_NAME.fullmatch(n[:-4])), reverse=True)
    found = []
    for name in names:
        if name[:-4] not in known and (job := read_job(logs / name)) is not None:
            found.append(job)
            if len(found) == most:
                break
    return found


def find_past_job(folder: Path, name: str) -> LoggedJob | None:
    """The job of that name in the logs of a folder, None where there is none."""
    logs = folder / LOG_FOLDER
    return read_job(logs / f"{name}.log") if JOB_NAME.fullmatch(name) and not logs.is_symlink() else None


def format_duration(seconds: float) -> str:
    """A duration in words.

    >>> format_duration(8.2), format_duration(200), format_duration(7300), format_duration(200000)
    ('8 s', '3 min 20 s', '2 h 1 min', '2 d 7 h')
    """
    s = round(seconds)
    for unit, size, below, smaller in (("d", 86400, "h", 3600), ("h", 3600, "min", 60), ("min", 60, "s", 1)):
        if s >= size:
            return f"{s // size} {unit} {s % size // smaller} {below}"
    return f"{s} s"


def _time_of_name(name: str) -> float:
    """The time in the name of a job, s since 1970; 0 where it is not a time."""
    try:
        return time.mktime(time.strptime(name[:15], "%Y%m%d-%H%M%S"))
    except (ValueError, OverflowError):
        return 0.0


def _is_regular(file: Path) -> bool:
    return stat.S_ISREG(os.lstat(file).st_mode)


def _is_writer(process: int, log: Path) -> bool:
    """Whether a process is alive and has the log as its output, so that its number is not that of another program."""
    try:
        return process > 1 and os.path.samestat(os.stat(f"/proc/{process}/fd/1"), os.lstat(log))
    except (OSError, OverflowError, ValueError):  # elsewhere than on Linux: a job of an earlier server counts as ended
        return False
