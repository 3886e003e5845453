"""Commands that the page has started: each a process of its own whose words stand in a log file in the folder."""

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
PROGRESS_INTERVAL_S = "0.5"  # s between lines of progress
PERCENT_PATTERN = re.compile(r"(\d+) %")
TIME_LEFT_PATTERN = re.compile(r"about (\d+) s left")
INTERRUPT_GRACE_S = 20.0  # s that an interrupted command gets to leave its checkpoint


@dataclass
class Job:
    """One command: its `words` after `flashtemp`, the `log` of what it said, its `process`, and when it began (s)."""

    words: tuple[str, ...]
    log: Path
    process: subprocess.Popen[bytes]
    began: float = field(default_factory=time.monotonic)

    @property
    def exit_code(self) -> int | None:
        """Exit code, None while it runs."""
        return self.process.poll()

    @property
    def state(self) -> str:
        """In a word."""
        if self.exit_code is None:
            return "running"
        return {0: "done", 130: "stopped"}.get(self.exit_code, f"failed, exit code {self.exit_code}")

    def log_lines(self, max_lines: int = 400) -> list[str]:
        """The last lines of its log."""
        with suppress(OSError):
            return self.log.read_text(encoding="utf-8", errors="replace").splitlines()[1:][-max_lines:]
        return []

    def progress(self) -> tuple[float | None, str]:
        """Share that is done, where it is known, and the last line."""
        said = self.log_lines(40)
        for line in reversed(said):
            if found := PERCENT_PATTERN.search(line):
                return float(found[1]) / 100.0, line
            if found := TIME_LEFT_PATTERN.search(line):
                gone = time.monotonic() - self.began
                return gone / (gone + float(found[1])), line
        return None, said[-1] if said else ""

    def stop(self) -> None:
        """Interrupt it as Ctrl-C does: it leaves what it has."""
        if self.exit_code is None:
            with suppress(ProcessLookupError):
                interrupt_process(self.process.pid)


class JobList:
    """All that this server has started in a folder, the newest first."""

    def __init__(self, folder: Path):
        self.folder, self.all = folder, list[Job]()

    def start(self, words: list[str]) -> Job:
        """Start `flashtemp words...` in the folder."""
        logs = self.folder / LOG_FOLDER
        logs.mkdir(exist_ok=True)
        log = logs / f"{time.strftime('%Y%m%d-%H%M%S')}-{len(self.all) + 1}-{words[0]}.log"
        command, env = make_python_command("-m", "flashtemp", *words)  # the folder may hold a stranger's random.py
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
        """Interrupt all that run, and wait until each has left its checkpoint."""
        running = [job for job in self.all if job.exit_code is None]
        for job in running:
            job.stop()
        for job in running:
            with suppress(subprocess.TimeoutExpired):
                job.process.wait(INTERRUPT_GRACE_S)


def command_text(words: list[str] | tuple[str, ...]) -> str:
    """The command line that does the same."""
    return shlex.join(["flashtemp", *words])
