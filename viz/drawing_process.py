"""Pictures of a run drawn by two processes: the second loads the libraries during the run and helps afterwards.

`python -m flashtemp.viz.drawing_process` is the second process.  It reads a run, its folder and picture requests from
stdin, and writes the results to stdout.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import IO, cast

from flashtemp import viz
from flashtemp.physics.local_settings import ignore_local_settings
from flashtemp.runs.results import processes
from flashtemp.runs.results.current_folder import make_python_command
from flashtemp.viz import PictureRequest

SECOND_PROCESS_AFTER_S = (
    1.0  # s of the run; after a shorter one all pictures are drawn before a second process is ready
)
MAX_SHARED_BYTES = 2**28  # bytes of a run's fields, which exist twice with two processes
STOP_PATIENCE_S = 10.0  # s for the picture in progress after Ctrl-C


class PictureDrawer:
    """Draws the pictures of a run, with a second process if the run takes longer than SECOND_PROCESS_AFTER_S.

    Where that process cannot be started, or fails, this one draws everything.
    """

    def __init__(self, several: bool):
        self._may = several and processes.cores() > 1 and bool(sys.executable)
        self._since = time.monotonic()
        self._second: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> PictureDrawer:
        return self

    def __exit__(self, *fault) -> None:
        if self._second is not None:
            _stop_process(self._second)

    def wrap_watch(self, watch: Callable | None) -> Callable:
        """A progress callback that starts the second process in time and then calls `watch`, if there is one."""

        def watch_and_start(progress, end: float) -> None:
            if self._may and time.monotonic() - self._since > SECOND_PROCESS_AFTER_S:
                self._may, self._second = False, _start_process()
            if watch is not None:
                watch(progress, end)

        return watch_and_start

    def draw_pictures(self, run, folder: Path, animated: bool) -> dict[str, str]:
        """Draw all pictures that apply into `folder`; returns {missing file: reason}."""
        pictures = viz.requested_pictures(animated=animated)
        pending = deque(pictures)
        answers: dict[PictureRequest, tuple[list[Path], dict[str, str]]] = {}

        def draw_pending() -> None:
            with suppress(IndexError):  # the second process has taken the last one
                while True:
                    picture = pending.popleft()
                    answers[picture] = viz.draw_picture(run, folder, picture)

        if self._second is None or run.field.nbytes > MAX_SHARED_BYTES:
            draw_pending()
        else:
            arguments = (self._second, (run, folder.absolute()), pending, answers)
            helper = threading.Thread(target=_share_pictures, args=arguments, daemon=True)
            helper.start()
            try:
                draw_pending()
                helper.join()
                draw_pending()  # a picture that the second process took and did not finish
            finally:  # the folder is renamed next: no process may still draw into it
                pending.clear()
                helper.join(STOP_PATIENCE_S)
        return viz.merge_results(answers[picture] for picture in pictures)[1]


def _start_process() -> subprocess.Popen[bytes] | None:
    """Start the second process with the module path of this one; None where it cannot be started."""
    command, env = make_python_command("-m", __name__)
    pipe, null = subprocess.PIPE, subprocess.DEVNULL
    try:
        return subprocess.Popen(
            command, env=env, stdin=pipe, stdout=pipe, stderr=null, **processes.detached_process_options()
        )
    except OSError:
        return None


def _share_pictures(
    process: subprocess.Popen[bytes], run_and_folder: tuple, pending: deque[PictureRequest], answers: dict
) -> None:
    """Send the run to the second process, then pictures from the end of `pending` until none is left or it fails."""
    stdin, stdout = cast(IO[bytes], process.stdin), cast(IO[bytes], process.stdout)
    picture = None
    try:
        _send_object(stdin, run_and_folder)
        while pending:
            picture = pending.pop()
            _send_object(stdin, picture)
            answers[picture] = pickle.load(stdout)
            picture = None
    except Exception:  # the process was killed, or cannot load a library: its picture is drawn here
        if picture is not None:
            pending.append(picture)


def _send_object(stream, content) -> None:
    pickle.dump(content, stream, protocol=pickle.HIGHEST_PROTOCOL)
    stream.flush()


def _stop_process(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    process.wait()
    for pipe in (process.stdin, process.stdout):
        with suppress(OSError):  # data still in the pipe
            cast(IO[bytes], pipe).close()


def serve() -> None:
    """Import the picture modules, then draw the requests from stdin until it closes."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # prints of libraries must not mix with the results
    ignore_local_settings()
    for module in {*viz.list_pictures(), *viz.list_animations()}:
        import_module(f"flashtemp.viz.run.{module}")
    with suppress(EOFError, BrokenPipeError):
        run, folder = pickle.load(sys.stdin.buffer)
        while True:
            _send_object(answers, viz.draw_picture(run, folder, pickle.load(sys.stdin.buffer)))


if __name__ == "__main__":
    serve()
