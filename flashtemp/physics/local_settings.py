"""Prevent matplotlib and numba from reading settings files in the current folder."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Any

LOCAL_SETTINGS_FILES = ("matplotlibrc", ".numba_config.yaml")  # read by these bare names, before the user's own files


def ignore_local_settings() -> None:
    """Hide settings files in the current folder from matplotlib and numba; the user's own settings still apply.

    Neither library has an option for this.  Both call `os.path.exists` with the bare name, numba at every compilation,
    so this function replaces `os.path.exists` for the whole process.
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
    """`ignore_local_settings` for one block of code, so that other code of the calling program is not affected."""
    exists = os.path.exists
    ignore_local_settings()
    try:
        yield
    finally:
        os.path.exists = exists
