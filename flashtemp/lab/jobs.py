"""Commands started by the web app: each is a process with its output in a log file of the folder.

As many run at once as there are cores; later ones wait for their turn, in their order.  Watches run besides them.
"""

from __future__ import annotations

import os
import shlex
import subprocess
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from flashtemp.lab.job_record import LOG_FOLDER, LoggedJob, find_past_job, list_past_jobs
from flashtemp.runs.results.current_folder import make_python_command
from flashtemp.runs.results.live_state import LIVE_VARIABLE, LiveFile
from flashtemp.runs.results.processes import cores, detached_process_options, interrupt_process

__all__ = ["LOG_FOLDER"]
PROGRESS_INTERVAL_S = "0.5"  # between lines of progress, as an environment variable
INTERRUPT_GRACE_S = 20.0  # time for an interrupted command to write its checkpoint
INTERRUPT_AGAIN_S = 1.0  # until one that has not begun is interrupted again: imports of libraries can lose a signal
EXIT_STOPPED = 130
WATCH_COMMAND = "watch"  # mostly waits for camera files, so it never waits for its turn


@dataclass
class Job(LoggedJob):
    """A command of this server: its `process`, None while it waits for its turn; `cancelled` if that never came.

    `interrupted`: the user stopped it while it ran.
    """

    process: subprocess.Popen[bytes] | None = None
    cancelled: bool = False
    interrupted: bool = False

    @property
    def exit_code(self) -> int | None:
        """Exit code, None while the command waits or runs."""
        if self.process is None:
            return EXIT_STOPPED if self.cancelled else None
        code = self.process.poll()
        # Python that is interrupted before the command has begun ends with 1, as if it had failed
        unbegun = code == 1 and self.interrupted and self.live.number("began") is None
        return EXIT_STOPPED if unbegun else code

    @property
    def is_running(self) -> bool:
        """Whether the process is alive."""
        return self.process is not None and self.process.poll() is None

    @property
    def state(self) -> str:
        """State in a word, as of a `LoggedJob`; waiting until the process starts."""
        return "waiting" if self.process is None and not self.cancelled else super().state

    def stop(self) -> None:
        """Interrupt the command like Ctrl-C: it writes its checkpoint and ends.  One that waits never starts."""
        if self.process is None:
            self.cancelled = True
            LiveFile(self.state_file).write_end(EXIT_STOPPED)
        elif self.process.poll() is None:
            self.interrupted = True
            with suppress(ProcessLookupError):
                interrupt_process(self.process.pid)


class JobList:
    """The commands that this server has started in a folder, newest first."""

    def __init__(self, folder: Path, most_at_once: int | None = None):
        self.folder, self.all = folder, list[Job]()
        self.most_at_once = most_at_once or cores()
        self._turn = threading.Lock()

    def start(self, words: list[str]) -> Job:
        """Start `flashtemp words...` in the folder, or let it wait for its turn."""
        logs = self.folder / LOG_FOLDER
        logs.mkdir(exist_ok=True)
        log = logs / f"{time.strftime('%Y%m%d-%H%M%S')}-{len(self.all) + 1}-{words[0]}.log"
        with log.open("x", encoding="utf-8") as out:
            out.write(f"$ {command_text(words)}\n")
        job = Job(tuple(words), log)
        LiveFile(job.state_file).write_sections(queued=time.time())
        self.all.insert(0, job)
        self._start_waiting()
        return job

    def _start_waiting(self) -> None:
        """Start the jobs whose turn has come."""
        with self._turn:
            waiting = [job for job in reversed(self.all) if job.process is None and not job.cancelled]
            watches = [job for job in waiting if job.words[0] == WATCH_COMMAND]
            others = [job for job in waiting if job.words[0] != WATCH_COMMAND]
            n_free = self.most_at_once - sum(job.is_running and job.words[0] != WATCH_COMMAND for job in self.all)
            for job in [*watches, *others[: max(n_free, 0)]]:
                job.process = self._start_process(job)
                threading.Thread(target=self._await_end, args=(job.process, job), daemon=True).start()

    def _start_process(self, job: Job) -> subprocess.Popen[bytes]:
        command, env = make_python_command("-m", "flashtemp", *job.words)  # the folder may hold an untrusted random.py
        env |= {"FLASHTEMP_PROGRESS": PROGRESS_INTERVAL_S, LIVE_VARIABLE: os.fspath(job.state_file.absolute())}
        with job.log.open("ab") as out:
            return subprocess.Popen(
                command, cwd=self.folder, stdin=subprocess.DEVNULL, stdout=out, stderr=subprocess.STDOUT,
                env=env, **detached_process_options(),
            )  # fmt: skip

    def _await_end(self, process: subprocess.Popen[bytes], job: Job) -> None:
        """Wait for the end of a process; record it where the command could not, and start the next job."""
        process.wait()
        if job.live.number("end", "exit_code") is None:
            LiveFile(job.state_file).write_end(job.exit_code or 0)
        self._start_waiting()

    def list_past(self, most: int) -> list[LoggedJob]:
        """The newest jobs in the logs of the folder that this server has not started."""
        return list_past_jobs(self.folder, {job.name for job in self.all}, most)

    def find_job(self, name: str) -> LoggedJob | None:
        """The job of that name, of this server or an earlier one."""
        return next((job for job in self.all if job.name == name), None) or find_past_job(self.folder, name)

    def stop_all(self) -> None:
        """Interrupt all commands and wait until each has written its checkpoint."""
        running = [job for job in self.all if job.is_running]
        for job in reversed(self.all):  # none that waits may start when another ends
            if job.process is None and not job.cancelled:
                job.stop()
        for job in running:
            job.stop()
        deadline = time.monotonic() + INTERRUPT_GRACE_S
        for job in running:
            while job.is_running and time.monotonic() < deadline:
                with suppress(subprocess.TimeoutExpired):
                    assert job.process is not None
                    job.process.wait(INTERRUPT_AGAIN_S)
                if job.progress()[0] is None:
                    job.stop()


def command_text(words: list[str] | tuple[str, ...]) -> str:
    """The command line as text, quoted for a shell."""
    return shlex.join(["flashtemp", *words])
