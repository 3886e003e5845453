"""Keep the current folder out of imports, because it contains data (settings files: physics/local_settings).

Python searches that folder first in `python -m` and `python -c`, and so in every worker of `multiprocessing`.  The
remedy is the "safe path" of PEP 587 and `python -P` (PYTHONSAFEPATH).
"""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

TRACKER_NAME = "resource_tracker"  # the semaphore tracker of multiprocessing, with which its warnings begin
PROGRAM_FOLDER = str(Path(os.path.abspath(__file__)).parents[3])  # the folder that contains the package


def exclude_current_folder() -> None:
    """In a process that runs one command: neither it nor its child processes import from the current folder."""
    sys.path[:] = list_search_path()
    os.environ.update(make_safe_environment())
    warnings.filterwarnings("ignore", TRACKER_NAME, UserWarning)


def list_search_path() -> list[str]:
    """The search path of Python without the current folder, unless PYTHONPATH contains its full path.

    The folder of the package stays in the path: a checkout that is not installed is found nowhere else.
    """
    allowed = {*_list_named_folders(), PROGRAM_FOLDER}
    try:
        here = os.path.realpath(os.getcwd())
    except FileNotFoundError:  # it was removed
        here = ""
    return [p for p in sys.path if os.path.isabs(p) and (p in allowed or os.path.realpath(p) != here)]


def _list_named_folders() -> list[str]:
    """Absolute entries of PYTHONPATH; an empty or relative one would mean the current folder of each process."""
    return [p for p in os.environ.get("PYTHONPATH", "").split(os.pathsep) if os.path.isabs(p)]


def make_safe_environment() -> dict[str, str]:
    """Environment variables with which a child process runs nothing from its current folder.

    Programs such as git are searched by PATH, whose empty and relative entries mean that folder; Windows searches it
    before PATH unless NoDefaultCurrentDirectoryInExePath is set.  Warnings of the resource tracker about killed
    processes are for programmers and are suppressed.
    """
    filters = [w for w in os.environ.get("PYTHONWARNINGS", "").split(",") if w]
    quiet = f"ignore:{TRACKER_NAME}:UserWarning"
    programs = [p for p in os.environ.get("PATH", "").split(os.pathsep) if os.path.isabs(p)]
    return {
        "PATH": os.pathsep.join(programs) or os.defpath,
        "NoDefaultCurrentDirectoryInExePath": "1",
        "PYTHONSAFEPATH": "1",
        "PYTHONPATH": os.pathsep.join(_list_named_folders()),
        "PYTHONWARNINGS": ",".join([*(w for w in filters if w != quiet), quiet]),
    }


def make_python_command(*words: str) -> tuple[list[str], dict[str, str]]:
    """Command line and environment of a Python process with the search path of this one, without the current folder."""
    paths = {"PYTHONPATH": os.pathsep.join(list_search_path())}
    return [sys.executable, "-P", *words], {**os.environ, **make_safe_environment(), **paths}


@contextmanager
def safe_child_environment() -> Iterator[None]:
    """Within this context, processes started by a library get the variables of `make_safe_environment`."""
    safe = make_safe_environment()
    before = {name: os.environ.get(name) for name in safe}
    os.environ.update(safe)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
