"""Commands started by the web app: each is a process with its output in a log file of the folder."""

from __future__ import annotations

import re
import shlex
import subprocess
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from flashtemp.runs.results.current_folder import make_python_command
from flashtemp.runs.results.processes import detached_process_options, interrupt_process

LOG_FOLDER = ".flashtemp-lab"  # folder of the logs
PROGRESS_INTERVAL_S = "0.5"  # between lines of progress, as an environment variable
PERCENT_PATTERN = re.compile(r"(\d+) %")
TIME_LEFT_PATTERN = re.compile(r"about (\d+) s left")
INTERRUPT_GRACE_S = 20.0  # time for an interrupted command to write its checkpoint


@dataclass
class Job:
    """One command: its `words` after `flashtemp`, its `log` file and `process`, and the time `began` (s)."""

    words: tuple[str, ...]
    log: Path
    process: subprocess.Popen[bytes]
    began: float = field(default_factory=time.monotonic)

    @property
    def exit_code(self) -> int | None:
        """Exit code, None while the command runs."""
        return self.process.poll()

    @property
    def state(self) -> str:
        """State in a word: running, done, stopped or failed."""
        if self.exit_code is None:
            return "running"
        return {0: "done", 130: "stopped"}.get(self.exit_code, f"failed, exit code {self.exit_code}")

    def log_lines(self, max_lines: int = 400) -> list[str]:
        """The last lines of the log, without the command line."""
        with suppress(OSError):
            return self.log.read_text(encoding="utf-8", errors="replace").splitlines()[1:][-max_lines:]
        return []

    def progress(self) -> tuple[float | None, str]:
        """Fraction done (None if unknown), and the latest line about it."""
        lines = self.log_lines(40)
        for line in reversed(lines):
            if match := PERCENT_PATTERN.search(line):
                return float(match[1]) / 100.0, line
            if match := TIME_LEFT_PATTERN.search(line):
                elapsed = time.monotonic() - self.began
                return elapsed / (elapsed + float(match[1])), line
        return None, lines[-1] if lines else ""

    def stop(self) -> None:
        """Interrupt the command like Ctrl-C: it writes its checkpoint and ends."""
        if self.exit_code is None:
            with suppress(ProcessLookupError):
                interrupt_process(self.process.pid)


class JobList:
    """The commands that this server has started in a folder, newest first."""

    def __init__(self, folder: Path):
        self.folder, self.all = folder, list[Job]()

    def start(self, words: list[str]) -> Job:
        """Start `flashtemp words...` in the folder."""
        logs = self.folder / LOG_FOLDER
        logs.mkdir(exist_ok=True)
        log = logs / f"{time.strftime('%Y%m%d-%H%M%S')}-{len(self.all) + 1}-{words[0]}.log"
        command, env = make_python_command("-m", "flashtemp", *words)  # the folder may hold an untrusted random.py
        with log.open("w", encoding="utf-8") as out:
            out.write(f"$ {command_text(words)}\n")
            out.flush()
            process = subprocess.Popen(
                command, cwd=self.folder, stdin=subprocess.DEVNULL, stdout=out, stderr=subprocess.STDOUT,
                env=env | {"FLASHTEMP_PROGRESS": PROGRESS_INTERVAL_S}, **detached_process_options(),
            )  # fmt: skip
        job = Job(tuple(words), log, process)
        self.all.insert(0, job)
        return job

    def stop_all(self) -> None:
        """Interrupt all running commands and wait until each has written its checkpoint."""
        running = [job for job in self.all if job.exit_code is None]
        for job in running:
            job.stop()
        for job in running:
            with suppress(subprocess.TimeoutExpired):
                job.process.wait(INTERRUPT_GRACE_S)


def command_text(words: list[str] | tuple[str, ...]) -> str:
    """The command line as text, quoted for a shell."""
    return shlex.join(["flashtemp", *words])
