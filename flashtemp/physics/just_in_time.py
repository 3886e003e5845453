"""Loops compiled by numba, whose cache counts only where nobody else can write it: its index files are programs."""

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
    """`numba.njit`; what it compiled is kept (`cache`) beside the program or in the user's cache folder.

    It is compiled anew in every process where neither can be had, or where others may write (`is_cache_private`).
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
    """Only the environment names a cache folder, by its full path; a settings file of the current folder does not."""
    config: Any = numba.config
    before, given = config.CACHE_DIR, os.environ.get(CACHE_FOLDER, "")
    with without_local_settings():
        config.CACHE_DIR = given if os.path.isabs(given) else ""
        try:
            yield
        finally:
            config.CACHE_DIR = before


@remember
def is_cache_private(folder: str) -> bool:
    """Whether what numba kept in a folder can be from nobody but this user, root, or whoever can write the program.

    numba reads its index files by pickle, which runs what they say.  Windows keeps users' folders apart by itself.
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
    """Whether a file or folder belongs to one of the owners, and no more can write it than the bits `may_write` say."""
    try:
        state = path.stat()
    except FileNotFoundError:  # another process has given it its name
        return True
    more = state.st_mode & OTHERS_WRITE & ~may_write
    return state.st_uid in owners and not more & stat.S_IWOTH and not (more and can_group_write(path, state))
