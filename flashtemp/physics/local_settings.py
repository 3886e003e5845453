"""Settings files that libraries take, unasked, from the folder in which a command is given."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Any

LOCAL_SETTINGS_FILES = (
    "matplotlibrc",
    ".numba_config.yaml",
)  # looked for under these bare names, before the user's own


def ignore_local_settings() -> None:
    """From now on, matplotlib and numba find no settings file in the current folder; those of the user still hold.

    Neither library has a switch for it.  Both ask `os.path.exists` for the bare name, numba at every compilation.
    """
    exists = os.path.exists
    if hasattr(exists, "__wrapped__"):
        return

    @wraps(exists)
    def exists_elsewhere(path: Any) -> bool:
        return path not in LOCAL_SETTINGS_FILES and exists(path)

    os.path.exists = exists_elsewhere


@contextmanager
def without_local_settings() -> Iterator[None]:
    """The same for a block of code, as in a user's own program, whose other imports are not ours to change."""
    exists = os.path.exists
    ignore_local_settings()
    try:
        yield
    finally:
        os.path.exists = exists
