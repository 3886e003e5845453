"""Compile loops with numba; its cache is used only where no other user can write, because it can contain code."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache as remember
from pathlib import Path
from typing import Any

from flashtemp.physics.local_settings import without_local_settings
from flashtemp.physics.permissions import ROOT_USER, can_group_write, describe_other_writer

with without_local_settings():
    import numba
CACHE_FOLDER = "NUMBA_CACHE_DIR"
PACKAGE_FOLDER = Path(__file__).parents[1]
OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH


def njit(*, cache: bool = False, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """`numba.njit` that stores compiled code (`cache`) next to the program or in the user's cache folder.

    Every process compiles again where neither folder is available, or where others may write (`is_cache_private`).
    """

    def compile_function(function: Callable[..., Any]) -> Any:
        plain = numba.njit(**options)
        if not cache:
            return plain(function)
        try:
            with _without_local_cache():
                kept = numba.njit(cache=True, **options)(function)
        except RuntimeError:  # no folder can be written
            return plain(function)
        folder = kept.stats.cache_path if hasattr(kept, "stats") else None  # none under NUMBA_DISABLE_JIT
        return kept if folder is None or is_cache_private(folder) else plain(function)

    return compile_function


@contextmanager
def _without_local_cache() -> Iterator[None]:
    """Accept a cache folder only as a full path from the environment, not from settings in the current folder."""
    config: Any = numba.config
    before, requested = config.CACHE_DIR, os.environ.get(CACHE_FOLDER, "")
    with without_local_settings():
        config.CACHE_DIR = requested if os.path.isabs(requested) else ""
        try:
            yield
        finally:
            config.CACHE_DIR = before


@remember
def is_cache_private(folder: str) -> bool:
    """Whether only this user, root, or somebody who can change the program itself can have written numba's cache.

    numba reads its index files by pickle, which executes code in them.  Windows separates users' folders by itself.
    """
    if not os.path.isabs(folder):
        return False
    if not hasattr(os, "geteuid"):
        return True
    path = Path(folder)
    try:
        program = path.parent.stat()
        if path.name == "__pycache__" and path.is_relative_to(PACKAGE_FOLDER):
            # whoever can write the program needs no cache to change what it does
            owners, may_write = {os.geteuid(), ROOT_USER, program.st_uid}, program.st_mode & OTHERS_WRITE
        elif describe_other_writer(path) is None:
            owners, may_write = {os.geteuid(), ROOT_USER}, 0
        else:
            return False
        found = [path, *path.iterdir()]
    except OSError:
        return False
    return all(_is_as_private(part, owners, may_write) for part in found)


def _is_as_private(path: Path, owners: set[int], may_write: int) -> bool:
    """Whether a file or folder belongs to one of the owners, with no more write permission than `may_write` allows."""
    try:
        state = path.stat()
    except FileNotFoundError:  # a temporary file that another process has just renamed
        return True
    more = state.st_mode & OTHERS_WRITE & ~may_write
    return state.st_uid in owners and not more & stat.S_IWOTH and not (more and can_group_write(path, state))
