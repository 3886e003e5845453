"""Pictures of a run by two processes: a second one loads what drawing needs during the march, and helps afterwards.

`python -m flashtemp.viz.drawing_process` is that process: a run, its folder and pictures come in, what was drawn goes out.
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

SECOND_PROCESS_AFTER_S = 1.0  # s of march; a shorter run has drawn its pictures before a second process is awake
MAX_SHARED_BYTES = 2**28  # bytes of a run's fields, which the second process holds again
STOP_PATIENCE_S = 10.0  # s for the picture that it is at after Ctrl-C


class PictureDrawer:
    """Draws a run's pictures; with a second process where `watch` has been told of a march that takes time.

    Where that process cannot be had, or fails, this one draws alone.
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
        """`watch`, if there is one, and an eye on how long the march takes."""

        def told(progress, end: float) -> None:
            if self._may and time.monotonic() - self._since > SECOND_PROCESS_AFTER_S:
                self._may, self._second = False, _start_process()
            if watch is not None:
                watch(progress, end)

        return told

    def draw_pictures(self, run, folder: Path, animated: bool) -> dict[str, str]:
        """Draw all that can be drawn; {what is missing: why}."""
        pictures = viz.requested_pictures(animated=animated)
        left = deque(pictures)
        answers: dict[PictureRequest, tuple[list[Path], dict[str, str]]] = {}

        def mine() -> None:
            with suppress(IndexError):  # the other has taken the last one
                while True:
                    picture = left.popleft()
                    answers[picture] = viz.draw_picture(run, folder, picture)

        if self._second is None or run.field.nbytes > MAX_SHARED_BYTES:
            mine()
        else:
            given = (self._second, (run, folder.absolute()), left, answers)
            helping = threading.Thread(target=_share_pictures, args=given, daemon=True)
            helping.start()
            try:
                mine()
                helping.join()
                mine()
            finally:  # nobody draws into the folder any more when it gets another name
                left.clear()
                helping.join(STOP_PATIENCE_S)
        return viz.merge_results(answers[picture] for picture in pictures)[1]


def _start_process() -> subprocess.Popen[bytes] | None:
    """The second process, which finds modules where this one does; None where none can be begun."""
    command, env = make_python_command("-m", __name__)
    pipe, quiet = subprocess.PIPE, subprocess.DEVNULL
    try:
        return subprocess.Popen(
            command, env=env, stdin=pipe, stdout=pipe, stderr=quiet, **processes.detached_process_options()
        )
    except OSError:
        return None


def _share_pictures(
    process: subprocess.Popen[bytes], run_and_folder: tuple, pending: deque[PictureRequest], answers: dict
) -> None:
    """Give the second process the run and its folder, and pictures from the end until none is left or it fails."""
    there, back = cast(IO[bytes], process.stdin), cast(IO[bytes], process.stdout)
    picture = None
    try:
        _send_object(there, run_and_folder)
        while pending:
            picture = pending.pop()
            _send_object(there, picture)
            answers[picture] = pickle.load(back)
            picture = None
    except Exception:  # it was killed, or cannot load what this process can
        if picture is not None:
            pending.append(picture)


def _send_object(stream, content) -> None:
    pickle.dump(content, stream, protocol=pickle.HIGHEST_PROTOCOL)
    stream.flush()


def _stop_process(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    process.wait()
    for pipe in (process.stdin, process.stdout):
        with suppress(OSError):  # what was on its way
            cast(IO[bytes], pipe).close()


def serve() -> None:
    """Load what drawing needs; then draw what comes until nothing more does."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints is no answer
    ignore_local_settings()
    for module in {*viz.PICTURES, *viz.ANIMATIONS}:
        import_module(f"flashtemp.viz.run.{module}")
    with suppress(EOFError, BrokenPipeError):
        run, folder = pickle.load(sys.stdin.buffer)
        while True:
            _send_object(answers, viz.draw_picture(run, folder, pickle.load(sys.stdin.buffer)))


if __name__ == "__main__":
    serve()
