"""The folder in which a command is given holds data: nothing there is imported (settings: physics/local_settings).

Python itself searches that folder first in `python -m` and `python -c`, and so in every worker of `multiprocessing`.
PEP 587 and `python -P` (PYTHONSAFEPATH) name the remedy a safe path.
"""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

TRACKER_NAME = "resource_tracker"  # multiprocessing's process that counts semaphores; what it says begins with its name
PROGRAM_FOLDER = os.path.abspath(os.path.join(os.path.dirname(__file__), *[os.pardir] * 3))  # where the package lies


def exclude_current_folder() -> None:
    """In a process that runs one command: neither it nor what it starts imports from its folder."""
    sys.path[:] = list_search_path()
    os.environ.update(make_safe_environment())
    warnings.filterwarnings("ignore", TRACKER_NAME, UserWarning)


def list_search_path() -> list[str]:
    """Where Python finds modules, without the current folder unless PYTHONPATH names it by its full path.

    A checkout that is not installed is found in the folder in which it is run, and nowhere else: that one stays.
    """
    given = {*_list_named_folders(), PROGRAM_FOLDER}
    try:
        here = os.path.realpath(os.getcwd())
    except FileNotFoundError:  # it was removed
        here = ""
    return [p for p in sys.path if os.path.isabs(p) and (p in given or os.path.realpath(p) != here)]


def _list_named_folders() -> list[str]:
    """What PYTHONPATH names by full paths; an empty or relative entry would mean the current folder of each process."""
    return [p for p in os.environ.get("PYTHONPATH", "").split(os.pathsep) if os.path.isabs(p)]


def make_safe_environment() -> dict[str, str]:
    """Variables with which a process that this one starts runs nothing from the folder that it stands in.

    Programs such as git are searched by PATH, whose empty and relative entries mean that folder; Windows searches it
    before PATH unless NoDefaultCurrentDirectoryInExePath is set.  What the resource tracker says about processes that
    were killed is for programmers; it does not reach the terminal.
    """
    spoken = [w for w in os.environ.get("PYTHONWARNINGS", "").split(",") if w]
    quiet = f"ignore:{TRACKER_NAME}:UserWarning"
    programs = [p for p in os.environ.get("PATH", "").split(os.pathsep) if os.path.isabs(p)]
    return {
        "PATH": os.pathsep.join(programs) or os.defpath,
        "NoDefaultCurrentDirectoryInExePath": "1",
        "PYTHONSAFEPATH": "1",
        "PYTHONPATH": os.pathsep.join(_list_named_folders()),
        "PYTHONWARNINGS": ",".join([*(w for w in spoken if w != quiet), quiet]),
    }


def make_python_command(*words: str) -> tuple[list[str], dict[str, str]]:
    """Command line and environment of a Python process that finds modules where this one does, in no folder of data."""
    paths = {"PYTHONPATH": os.pathsep.join(list_search_path())}
    return [sys.executable, "-P", *words], {**os.environ, **make_safe_environment(), **paths}


@contextmanager
def safe_child_environment() -> Iterator[None]:
    """For processes that a library starts: within this block they get the variables of `make_safe_environment`."""
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
