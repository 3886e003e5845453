"""Result folders: whole or absent, never half-written."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from flashtemp.errors import BadInput


def free_name(out: Path) -> Path:
    """The folder itself, or the first of name-2, name-3... that does not exist yet."""
    n, path = 1, out
    while path.exists() or partial(path).exists():
        n += 1
        path = out.with_name(f"{out.name}-{n}")
    return path


def partial(out: Path) -> Path:
    """Where a result is written until it is whole."""
    return out.with_name(out.name + ".partial")


@contextmanager
def whole(out: Path) -> Iterator[Path]:
    """A new folder to write into, renamed to `out` at the end; a failure leaves nothing.  Raises BadInput."""
    if out.exists():
        raise BadInput(f"--out: {out} exists; choose another folder")
    work = partial(out)
    shutil.rmtree(work, ignore_errors=True)
    try:
        work.mkdir(parents=True)
    except OSError as fault:
        raise BadInput(f"--out: {out}: {fault.strerror}; choose a folder that can be written") from fault
    try:
        yield work
        work.rename(out)
    except BaseException:
        shutil.rmtree(work, ignore_errors=True)
        raise
